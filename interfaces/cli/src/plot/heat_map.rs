//! A grid of shaded cells over a vertical section.

use super::palette::Legend;
use super::{escaped, px};
use std::fmt::Write;

/// Values on a grid, row by row from below.
#[derive(Debug, Clone, PartialEq)]
pub struct HeatMap {
    pub title: String,
    /// Edges of the cells along both directions, m.
    pub x: Vec<f64>,
    pub z: Vec<f64>,
    /// `[rows * columns]`; NaN: nothing to show.
    pub values: Vec<f64>,
}

const WIDTH: f64 = 320.0;

impl HeatMap {
    /// The map with its own legend below it.
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
            "<svg viewBox=\"0 0 {WIDTH} {}\" role=\"img\" aria-label=\"{}: {}\">\
             <text x=\"0\" y=\"13\" class=\"title\">{}</text>",
            px(height + 72.0),
            escaped(&self.title),
            escaped(&legend.label),
            escaped(&self.title)
        );
        for (k, value) in self.values.iter().enumerate() {
            let (row, column) = (k / columns.max(1), k % columns.max(1));
            let class =
                if value.is_nan() { "none".into() } else { format!("s{}", legend.shade(*value)) };
            let said = if value.is_nan() { "no room".into() } else { format!("{value:.2}") };
            let _ = write!(
                out,
                "<rect x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\" class=\"{class}\"><title>{said}</title></rect>",
                px((self.x[column] - x0) * scale),
                px(20.0 + (z1 - self.z[row + 1]) * scale),
                px((self.x[column + 1] - self.x[column]) * scale + 0.4),
                px((self.z[row + 1] - self.z[row]) * scale + 0.4)
            );
        }
        legend.strip(0.0, height + 26.0, &mut out);
        out += "</svg>";
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_are_shaded_from_below_and_absent_ones_are_told() {
        let map = HeatMap {
            title: "t".into(),
            x: vec![0.0, 1.0, 2.0],
            z: vec![0.0, 1.0],
            values: vec![0.0, f64::NAN],
        };
        let svg = map.svg(&Legend { low: 0.0, high: 1.0, label: "φ".into() });
        assert!(svg.contains("class=\"s0\"><title>0.00") && svg.contains("no room"), "{svg}");
    }
}
