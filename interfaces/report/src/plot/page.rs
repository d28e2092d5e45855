//! A self-contained page: headings, texts, tables, figures.

use super::escaped;
use ballast_session::files::PAGE_START;
use ballast_session::table::Table;
use std::fmt::Write;

/// Lines have as many colours, then they start over.
pub const COLOUR_COUNT: usize = 6;

/// Style of drawings: colours by variables, for light, dark and paper.
const COLOURS: &str = include_str!("colours.css");
const LAYOUT: &str = include_str!("layout.css");

/// A page under construction.
#[derive(Debug, Clone)]
pub struct Page {
    title: String,
    body: String,
}

impl Page {
    pub fn new(title: &str) -> Self {
        let body = format!("<h1>{}</h1>\n", escaped(title));
        Self { title: title.into(), body }
    }

    pub fn heading(&mut self, text: &str) {
        let _ = writeln!(self.body, "<h2>{}</h2>", escaped(text));
    }

    pub fn text(&mut self, text: &str) {
        let _ = writeln!(self.body, "<p>{}</p>", escaped(text));
    }

    /// A remark below a figure or table.
    pub fn note(&mut self, text: &str) {
        let _ = writeln!(self.body, "<p class=\"note\">{}</p>", escaped(text));
    }

    /// Figures that matter most: label, value, what to compare with.
    pub fn cards(&mut self, cards: &[[String; 3]]) {
        self.body += "<div class=\"cards\">";
        for [label, value, note] in cards {
            let _ = write!(
                self.body,
                "<div class=\"card\"><span>{}</span><strong>{}</strong><small>{}</small></div>",
                escaped(label),
                escaped(value),
                escaped(note)
            );
        }
        self.body += "</div>\n";
    }

    /// Small drawings side by side, as far as the page is wide enough.
    pub fn figures(&mut self, drawings: &[String]) {
        self.body += "<div class=\"figures\">";
        for drawing in drawings {
            let _ = write!(self.body, "<figure>{drawing}</figure>");
        }
        self.body += "</div>\n";
    }

    /// One drawing over the width of the text; on a narrow screen it stays readable, and is moved sideways.
    pub fn figure(&mut self, drawing: &str) {
        let _ = writeln!(self.body, "<figure class=\"wide scroll\">{drawing}</figure>");
    }

    /// A table; its first row is the header. Empty ones are left out.
    pub fn table(&mut self, table: &Table) {
        let [header, rows @ ..] = table.rows() else { return };
        if rows.is_empty() {
            return;
        }
        self.body += "<div class=\"scroll\"><table><thead>";
        self.row(header, "th");
        self.body += "</thead><tbody>";
        rows.iter().for_each(|row| self.row(row, "td"));
        self.body += "</tbody></table></div>\n";
    }

    fn row(&mut self, cells: &[String], tag: &str) {
        self.body += "<tr>";
        for (k, cell) in cells.iter().enumerate() {
            // The first cell names the row.
            let (tag, scope) = match (k, tag) {
                (0, "td") => ("th", " scope=\"row\""),
                (_, "th") => ("th", " scope=\"col\""),
                _ => ("td", ""),
            };
            let class = match cell.as_str() {
                "passed" => " class=\"good\"",
                "failed" => " class=\"bad\"",
                _ => "",
            };
            let _ = write!(self.body, "<{tag}{scope}{class}>{}</{tag}>", escaped(cell));
        }
        self.body += "</tr>";
    }

    /// A long text that is opened by who wants it.
    pub fn details(&mut self, summary: &str, text: &str) {
        let (summary, text) = (escaped(summary), escaped(text));
        let _ =
            writeln!(self.body, "<details><summary>{summary}</summary><pre>{text}</pre></details>");
    }

    pub fn html(&self) -> String {
        format!(
            "{PAGE_START}\n<html lang=\"en\"><head><meta charset=\"utf-8\">\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\
             <meta name=\"color-scheme\" content=\"light dark\"><title>{}</title>\n\
             <style>{COLOURS}{LAYOUT}</style></head>\n<body><main>\n{}</main></body></html>\n",
            escaped(&self.title),
            self.body
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_needs_nothing_from_outside() {
        let mut page = Page::new("a & b");
        let mut table = Table::new("check", ["verdict"]);
        table.row(["x <y>", "failed"]);
        page.table(&table);
        page.table(&Table::new("empty", ["x"]));
        page.details("case", "</pre><script>");
        let html = page.html();
        assert!(html.contains("x &lt;y&gt;") && html.contains("class=\"bad\""));
        for word in ["<script", "http", "src=", "@import", "empty"] {
            assert!(!html.contains(word), "{word} in {html}");
        }
    }
}
