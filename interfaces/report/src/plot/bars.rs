//! Horizontal bar charts.

use super::{escaped, px};
use std::fmt::Write;

/// Horizontal bar chart of values of one unit.
#[derive(Debug, Clone, PartialEq)]
pub struct BarChart {
    /// Title.
    pub title: String,
    /// Name, value, and text behind the bar.
    pub bars: Vec<(String, f64, String)>,
}

const WIDTH: f64 = 720.0;
const LEFT: f64 = 130.0;
const RIGHT: f64 = 150.0;
const HIGH: f64 = 22.0;

impl BarChart {
    /// Returns the description for screen readers.
    fn description(&self) -> String {
        let bars: Vec<_> =
            self.bars.iter().map(|(name, _, tooltip)| format!("{name} {tooltip}")).collect();
        format!("{}; {}", self.title, bars.join("; "))
    }

    /// Returns the drawing.
    pub fn svg(&self) -> String {
        let most = self.bars.iter().map(|b| b.1).fold(f64::MIN_POSITIVE, f64::max);
        let height = 26.0 + HIGH * self.bars.len() as f64;
        let mut out = format!(
            "<svg viewBox=\"0 0 {WIDTH} {}\" role=\"img\" aria-label=\"{1}\">\
             <text x=\"0\" y=\"14\" class=\"title\">{2}</text>",
            px(height),
            escaped(&self.description()),
            escaped(&self.title)
        );
        for (k, (name, value, tooltip)) in self.bars.iter().enumerate() {
            let y = 24.0 + HIGH * k as f64;
            let width = (WIDTH - LEFT - RIGHT) * (value / most).max(0.0);
            let _ = write!(
                out,
                "<text x=\"{}\" y=\"{text}\" class=\"axis\" text-anchor=\"end\">{}</text>\
                 <rect x=\"{LEFT}\" y=\"{}\" width=\"{}\" height=\"14\" class=\"f0\"/>\
                 <text x=\"{}\" y=\"{text}\" class=\"tick\">{}</text>",
                px(LEFT - 8.0),
                escaped(name),
                px(y),
                px(width),
                px(LEFT + width + 6.0),
                escaped(tooltip),
                text = px(y + 11.0)
            );
        }
        out += "</svg>";
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_longest_bar_fills_the_room() {
        let bars = BarChart {
            title: "t".into(),
            bars: vec![("a".into(), 2.0, "2 s".into()), ("b".into(), 1.0, "1 s".into())],
        };
        let svg = bars.svg();
        assert!(svg.contains("width=\"440\"") && svg.contains("width=\"220\""), "{svg}");
        assert!(svg.contains("aria-label=\"t; a 2 s; b 1 s\""), "{svg}");
    }
}
