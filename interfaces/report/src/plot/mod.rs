//! Plots and pages: inline SVG in self-contained HTML, without scripts, fonts or files beside it.
//!
//! Colours are CSS variables, so that one plot is right on light, dark and printed pages; a plotting library would
//! write them into every line. Contract: the same numbers give the same bytes.

mod bars;
mod chart;
mod heat_map;
mod page;
mod palette;
mod scale;
mod scene;

pub use bars::Bars;
pub use chart::{Band, Chart, Mark};
pub use heat_map::HeatMap;
pub use page::Page;
pub use palette::Legend;
pub use scene::{Outline, Scene};

/// Text inside markup.
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

/// A coordinate in a drawing: a tenth of a pixel is enough, and keeps files small.
fn px(value: f64) -> String {
    let text = format!("{value:.1}");
    text.strip_suffix(".0").unwrap_or(&text).to_string()
}

#[cfg(test)]
mod tests {
    #[test]
    fn markup_in_texts_stays_text() {
        assert_eq!(super::escaped("a<b>\"&c"), "a&lt;b&gt;&quot;&amp;c");
        assert_eq!((super::px(3.04), super::px(-2.25)), ("3".into(), "-2.2".into()));
    }
}
