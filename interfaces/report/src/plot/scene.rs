//! Outlines of bodies in a plane, to scale.

use super::palette::Legend;
use super::{escaped, px};
use ballast_session::table::figure;
use std::fmt::Write;

/// A closed polygon and how it is filled.
#[derive(Debug, Clone, PartialEq)]
pub struct Outline {
    /// Corners in order, m.
    pub corners: Vec<[f64; 2]>,
    /// A class of the page's style.
    pub class: String,
    /// What the outline is, shown where a pointer rests; none if empty.
    pub said: String,
}

/// A picture of a box of the plane.
#[derive(Debug, Clone, PartialEq)]
pub struct Scene {
    pub title: String,
    /// What is to be seen, for those who hear it.
    pub spoken: String,
    /// Lower left and upper right corner, m.
    pub low: [f64; 2],
    pub high: [f64; 2],
    pub outlines: Vec<Outline>,
}

/// About as wide as the page shows it: texts keep their size.
const WIDTH: f64 = 340.0;
const ABOVE: f64 = 22.0;
/// Between the picture and the legend, with the scale.
const BELOW: f64 = 34.0;

impl Scene {
    /// The picture, with a bar that shows its scale and a legend if there is one.
    pub fn svg(&self, legend: Option<&Legend>) -> String {
        let [x0, z0] = self.low;
        let scale = WIDTH / (self.high[0] - x0).max(f64::MIN_POSITIVE);
        let floor = ABOVE + (self.high[1] - z0) * scale;
        let mut out = format!(
            "<svg viewBox=\"0 0 {WIDTH} {}\" role=\"img\" aria-label=\"{}\">\
             <text x=\"0\" y=\"14\" class=\"title\">{}</text>\
             <rect x=\"0\" y=\"{ABOVE}\" width=\"{WIDTH}\" height=\"{}\" class=\"air\"/>",
            px(floor + BELOW + if legend.is_some() { 44.0 } else { 6.0 }),
            escaped(&format!("{}: {}", self.title, self.spoken)),
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
            let _ = match outline.said.as_str() {
                "" => write!(out, "/>"),
                said => write!(out, "><title>{}</title></path>", escaped(said)),
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

/// A round length of about a fifth of the picture.
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
            said: "a < b".into(),
        };
        let scene = Scene {
            title: "t".into(),
            spoken: "one stone".into(),
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
