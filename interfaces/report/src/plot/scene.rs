//! Drawings of outlines of bodies in a plane, to scale.

use super::palette::Legend;
use super::{escaped, px};
use ballast_session::table::figure;
use std::fmt::Write;

/// Closed polygon with its style.
#[derive(Debug, Clone, PartialEq)]
pub struct Outline {
    /// Corners in order, m.
    pub corners: Vec<[f64; 2]>,
    /// Class in the style sheet.
    pub class: String,
    /// Tooltip; empty for none.
    pub tooltip: String,
}

/// Drawing of outlines in a box of the plane.
#[derive(Debug, Clone, PartialEq)]
pub struct OutlineDrawing {
    /// Title.
    pub title: String,
    /// Description for screen readers.
    pub description: String,
    /// Lower left corner, m.
    pub low: [f64; 2],
    /// Upper right corner, m.
    pub high: [f64; 2],
    /// Outlines, the last ones on top.
    pub outlines: Vec<Outline>,
}

/// Width of the drawing, about that on the page, so that texts keep their size.
const WIDTH: f64 = 340.0;
const ABOVE: f64 = 22.0;
/// Height of the strip with the scale bar below the picture.
const BELOW: f64 = 34.0;

impl OutlineDrawing {
    /// Returns the drawing with a scale bar and an optional legend.
    pub fn svg(&self, legend: Option<&Legend>) -> String {
        let [x0, z0] = self.low;
        let scale = WIDTH / (self.high[0] - x0).max(f64::MIN_POSITIVE);
        let floor = ABOVE + (self.high[1] - z0) * scale;
        let mut out = format!(
            "<svg viewBox=\"0 0 {WIDTH} {}\" role=\"img\" aria-label=\"{}\">\
             <text x=\"0\" y=\"14\" class=\"title\">{}</text>\
             <rect x=\"0\" y=\"{ABOVE}\" width=\"{WIDTH}\" height=\"{}\" class=\"air\"/>",
            px(floor + BELOW + if legend.is_some() { 44.0 } else { 6.0 }),
            escaped(&format!("{}: {}", self.title, self.description)),
            escaped(&self.title),
            px(floor - ABOVE)
        );
        for outline in &self.outlines {
            out += "<path d=\"";
            for (k, [x, z]) in outline.corners.iter().enumerate() {
                let (x, z) = ((x - x0) * scale, floor - (z - z0) * scale);
                let _ = write!(out, "{}{} {}", if k == 0 { 'M' } else { 'L' }, px(x), px(z));
            }
            let _ = write!(out, "Z\" class=\"{}\"", outline.class);
            let _ = match outline.tooltip.as_str() {
                "" => write!(out, "/>"),
                tooltip => write!(out, "><title>{}</title></path>", escaped(tooltip)),
            };
        }
        let length = bar(self.high[0] - x0);
        let _ = write!(
            out,
            "<path d=\"M0.5 {0}H{WIDTH}\" class=\"edge\"/>\
             <path d=\"M{1} {2}H{3}\" class=\"edge\"/><text x=\"{1}\" y=\"{4}\" class=\"tick\">{5} m</text>",
            px(floor),
            px(WIDTH - length * scale),
            px(floor + 12.0),
            px(WIDTH),
            px(floor + 27.0),
            figure(length, 1)
        );
        if let Some(legend) = legend {
            legend.strip(0.0, floor + BELOW, &mut out);
        }
        out += "</svg>";
        out
    }
}

/// Returns a round length of about a fifth of the picture.
fn bar(width: f64) -> f64 {
    let power = 10f64.powf((0.2 * width).log10().floor());
    let factor = [5.0, 2.0, 1.0].into_iter().find(|f| f * power <= 0.25 * width).unwrap_or(1.0);
    factor * power
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_is_to_scale_and_upright() {
        let outline = Outline {
            corners: vec![[0.0, 0.0], [1.0, 0.0], [0.5, 1.0]],
            class: "tool".into(),
            tooltip: "a < b".into(),
        };
        let scene = OutlineDrawing {
            title: "t".into(),
            description: "one stone".into(),
            low: [0.0, 0.0],
            high: [1.0, 1.0],
            outlines: vec![outline],
        };
        let svg = scene.svg(None);
        assert!(svg.contains("M0 362L340 362L170 22Z"), "{svg}");
        assert!(svg.contains("aria-label=\"t: one stone\""), "{svg}");
        assert!(svg.contains("a &lt; b") && svg.contains("0.2 m"), "{svg}");
    }
}
