//! Charts and pages: inline SVG in self-contained HTML, without scripts, fonts or other files.
//!
//! Colours are CSS variables, so that a chart suits light, dark and printed pages; plotting libraries write colours into
//! every line. Contract: equal numbers give equal bytes.

mod bars;
mod chart;
mod heat_map;
mod page;
mod palette;
mod scale;
mod scene;

pub use bars::BarChart;
pub use chart::{Chart, ChartBand, SeriesStyle};
pub use heat_map::HeatMap;
pub use page::HtmlPage;
pub use palette::Legend;
pub use scene::{Outline, OutlineDrawing};

/// Escapes a text for markup.
pub fn escaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out += "&amp;",
            '<' => out += "&lt;",
            '>' => out += "&gt;",
            '"' => out += "&quot;",
            c => out.push(c),
        }
    }
    out
}

/// Formats a coordinate to a tenth of a pixel, which keeps files small.
fn px(value: f64) -> String {
    let text = format!("{value:.1}");
    text.strip_suffix(".0").unwrap_or(&text).to_string()
}

#[cfg(test)]
mod tests {
    #[test]
    fn markup_is_escaped() {
        assert_eq!(super::escaped("a<b>\"&c"), "a&lt;b&gt;&quot;&amp;c");
        assert_eq!((super::px(3.04), super::px(-2.25)), ("3".into(), "-2.2".into()));
    }
}
