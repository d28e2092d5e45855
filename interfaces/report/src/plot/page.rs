//! Self-contained HTML pages: headings, texts, tables, figures.

use super::escaped;
use ballast_session::files::PAGE_START;
use ballast_session::table::TextTable;
use std::fmt::Write;

/// Number of colours of series, after which they repeat.
pub const COLOUR_COUNT: usize = 6;

/// Style of drawings: colours by variables, for light, dark and paper.
const COLOURS: &str = include_str!("colours.css");
const LAYOUT: &str = include_str!("layout.css");

/// Self-contained HTML page.
#[derive(Debug, Clone)]
pub struct HtmlPage {
    title: String,
    body: String,
}

impl HtmlPage {
    /// Creates an empty page.
    pub fn new(title: &str) -> Self {
        let body = format!("<h1>{}</h1>\n", escaped(title));
        Self { title: title.into(), body }
    }

    /// Adds a heading.
    pub fn heading(&mut self, text: &str) {
        let _ = writeln!(self.body, "<h2>{}</h2>", escaped(text));
    }

    /// Adds a paragraph.
    pub fn text(&mut self, text: &str) {
        let _ = writeln!(self.body, "<p>{}</p>", escaped(text));
    }

    /// Adds a remark below a figure or table.
    pub fn note(&mut self, text: &str) {
        let _ = writeln!(self.body, "<p class=\"note\">{}</p>", escaped(text));
    }

    /// Adds cards with the most important figures: label, value, reference.
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

    /// Adds small drawings in a row.
    pub fn figures(&mut self, drawings: &[String]) {
        self.body += "<div class=\"figures\">";
        for drawing in drawings {
            let _ = write!(self.body, "<figure>{drawing}</figure>");
        }
        self.body += "</div>\n";
    }

    /// Adds a drawing over the width of the text, which scrolls on narrow screens.
    pub fn figure(&mut self, drawing: &str) {
        let _ = writeln!(self.body, "<figure class=\"wide scroll\">{drawing}</figure>");
    }

    /// Adds a table unless it is empty; its first row is the header.
    pub fn table(&mut self, table: &TextTable) {
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

    /// Adds a long text that is folded at first.
    pub fn details(&mut self, summary: &str, text: &str) {
        let (summary, text) = (escaped(summary), escaped(text));
        let _ =
            writeln!(self.body, "<details><summary>{summary}</summary><pre>{text}</pre></details>");
    }

    /// Returns the page as HTML.
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
        let mut page = HtmlPage::new("a & b");
        let mut table = TextTable::new("check", ["verdict"]);
        table.row(["x <y>", "failed"]);
        page.table(&table);
        page.table(&TextTable::new("empty", ["x"]));
        page.details("case", "</pre><script>");
        let html = page.html();
        assert!(html.contains("x &lt;y&gt;") && html.contains("class=\"bad\""));
        for word in ["<script", "http", "src=", "@import", "empty"] {
            assert!(!html.contains(word), "{word} in {html}");
        }
    }
}
