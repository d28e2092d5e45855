//! Shades for values between two bounds, and their legend.

use super::{escaped, px};
use ballast_session::table::figure;
use std::fmt::Write;

/// Number of shades, from low to high; their colours are in the style sheet.
pub const SHADES: usize = 8;

/// Legend of shades in equal steps between two values.
#[derive(Debug, Clone, PartialEq)]
pub struct Legend {
    /// Lower bound.
    pub low: f64,
    /// Upper bound.
    pub high: f64,
    /// Quantity with its unit.
    pub label: String,
}

impl Legend {
    /// Returns the shade of a value, clamped to the bounds.
    pub fn shade(&self, value: f64) -> usize {
        let share = (value - self.low) / (self.high - self.low).max(f64::MIN_POSITIVE);
        if share.is_nan() { 0 } else { ((share * SHADES as f64) as usize).min(SHADES - 1) }
    }

    /// Returns the legend as a strip whose upper left corner is at `x`, `y`; 44 px high.
    pub(super) fn strip(&self, x: f64, y: f64, out: &mut String) {
        const WIDTH: f64 = 22.0;
        let _ = write!(
            out,
            "<text x=\"{}\" y=\"{}\" class=\"axis\">{}</text>",
            px(x),
            px(y + 10.0),
            escaped(&self.label)
        );
        for shade in 0..SHADES {
            let _ = write!(
                out,
                "<rect x=\"{}\" y=\"{}\" width=\"{WIDTH}\" height=\"10\" class=\"s{shade}\"/>",
                px(x + WIDTH * shade as f64),
                px(y + 16.0)
            );
        }
        for (value, share, anchor) in [(self.low, 0.0, "start"), (self.high, 1.0, "end")] {
            let _ = write!(
                out,
                "<text x=\"{}\" y=\"{}\" class=\"tick\" text-anchor=\"{anchor}\">{}</text>",
                px(x + WIDTH * SHADES as f64 * share),
                px(y + 38.0),
                figure(value, 2)
            );
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shades_are_equal_steps_and_end_at_the_bounds() {
        let legend = Legend { low: 0.0, high: 8.0, label: "m".into() };
        let shades: Vec<usize> =
            [-1.0, 0.0, 0.99, 1.0, 7.5, 8.0, 99.0, f64::NAN].map(|v| legend.shade(v)).to_vec();
        assert_eq!(shades, [0, 0, 0, 1, 7, 7, 7, 0]);
    }
}
