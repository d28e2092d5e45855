//! Heat maps: shaded cells over a vertical section.

use super::palette::Legend;
use super::{escaped, px};
use std::fmt::Write;

/// Heat map of values on a grid, row by row from below.
#[derive(Debug, Clone, PartialEq)]
pub struct HeatMap {
    /// Title.
    pub title: String,
    /// Edges of the cells along x, m.
    pub x: Vec<f64>,
    /// Edges of the cells along z, m.
    pub z: Vec<f64>,
    /// Values `[rows * columns]`; 0: empty, NaN: no accessible volume.
    pub values: Vec<f64>,
    /// Outlines over the cells: closed polygons, corners in order, m.
    pub outlines: Vec<Vec<[f64; 2]>>,
}

const WIDTH: f64 = 320.0;
const ABOVE: f64 = 22.0;

impl HeatMap {
    /// Returns the drawing with a legend below it.
    pub fn svg(&self, legend: &Legend) -> String {
        let columns = self.x.len().saturating_sub(1);
        let ends = |edges: &[f64]| match edges {
            [first, .., last] => [*first, *last],
            _ => [0.0, 1.0],
        };
        let ([x0, x1], [z0, z1]) = (ends(&self.x), ends(&self.z));
        let scale = WIDTH / (x1 - x0).max(f64::MIN_POSITIVE);
        let height = (z1 - z0) * scale;
        let mut out = format!(
            "<svg viewBox=\"0 0 {WIDTH} {}\" role=\"img\" aria-label=\"{}\">\
             <text x=\"0\" y=\"14\" class=\"title\">{}</text>",
            px(height + 74.0),
            escaped(&self.description(legend)),
            escaped(&self.title)
        );
        for (k, value) in self.values.iter().enumerate() {
            let (row, column) = (k / columns.max(1), k % columns.max(1));
            let (class, tooltip) = match *value {
                v if v.is_nan() => ("block".into(), "no room".into()),
                0.0 => ("void".into(), "empty".into()),
                v => (format!("s{}", legend.shade(v)), format!("{v:.2}")),
            };
            let _ = write!(
                out,
                "<rect x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\" class=\"{class}\"><title>{tooltip}</title></rect>",
                px((self.x[column] - x0) * scale),
                px(ABOVE + (z1 - self.z[row + 1]) * scale),
                px((self.x[column + 1] - self.x[column]) * scale + 0.4),
                px((self.z[row + 1] - self.z[row]) * scale + 0.4)
            );
        }
        for outline in &self.outlines {
            out += "<path d=\"";
            for (k, [x, z]) in outline.iter().enumerate() {
                let (x, z) = ((x - x0) * scale, ABOVE + (z1 - z) * scale);
                let _ = write!(out, "{}{} {}", if k == 0 { 'M' } else { 'L' }, px(x), px(z));
            }
            out += "Z\" class=\"outline\"/>";
        }
        legend.strip(0.0, height + 28.0, &mut out);
        out += "</svg>";
        out
    }

    /// Returns the description for screen readers.
    fn description(&self, legend: &Legend) -> String {
        let filled = self.values.iter().filter(|v| !v.is_nan());
        let ends =
            filled.fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], v| [a.min(*v), b.max(*v)]);
        let range = match ends {
            [low, high] if low <= high => format!("{low:.2} to {high:.2}"),
            _ => "none".into(),
        };
        let (rows, columns) = (self.z.len().saturating_sub(1), self.x.len().saturating_sub(1));
        format!("{}: {}, {columns} × {rows} cells, {range}", self.title, legend.label)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_are_shaded_from_below_and_absent_ones_are_told() {
        let map = HeatMap {
            title: "t".into(),
            x: vec![0.0, 1.0, 2.0, 3.0],
            z: vec![0.0, 1.0],
            values: vec![0.1, f64::NAN, 0.0],
            outlines: vec![vec![[1.0, 0.0], [2.0, 0.0], [2.0, 1.0]]],
        };
        let svg = map.svg(&Legend { low: 0.0, high: 1.0, label: "φ".into() });
        assert!(svg.contains("class=\"s0\"><title>0.10") && svg.contains("no room"), "{svg}");
        assert!(svg.contains("class=\"void\"><title>empty") && svg.contains("Z\" class=\"outline"));
        assert!(svg.contains("aria-label=\"t: φ, 3 × 1 cells, 0.00 to 0.10\""), "{svg}");
    }
}
