//! Scales of axes: positions of values, and ticks at round numbers.

use ballast_session::table::figure;

/// Distance below which a tick counts as zero, over the step between ticks.
const LINE_WIDTH: f64 = 0.01;

/// Axis from `low` to `high`, linear or logarithmic.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AxisScale {
    low: f64,
    high: f64,
    log: bool,
}

impl AxisScale {
    /// Creates an axis for all finite values; a logarithmic one for those above zero.
    pub fn over(values: impl Iterator<Item = f64>, log: bool, starting_at_zero: bool) -> Self {
        let shown = values.filter(|v| v.is_finite() && (!log || *v > 0.0));
        let [mut low, mut high] = shown
            .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], v| [low.min(v), high.max(v)]);
        if low > high {
            [low, high] = if log { [1.0, 10.0] } else { [0.0, 1.0] };
        }
        if log {
            // Whole decades, and at least one.
            low = 10f64.powf((low.log10() + 1e-9).floor());
            high = 10f64.powf((high.log10() - 1e-9).ceil()).max(10.0 * low);
            return Self { low, high, log };
        }
        if starting_at_zero {
            (low, high) = (low.min(0.0), high.max(0.0));
        }
        if high - low <= 1e-12 * high.abs().max(low.abs()) {
            let room = if high == 0.0 { 1.0 } else { 0.1 * high.abs() };
            (low, high) = (low - room, high + room);
        }
        let step = round_step((high - low) / 5.0);
        // A value on a round number, or beyond it by less than a line is wide, needs no room there.
        let down = (low / step + LINE_WIDTH).floor() * step;
        let up = (high / step - LINE_WIDTH).ceil() * step;
        Self { low: down, high: up, log }
    }

    /// Creates an axis with exactly these ends.
    pub fn exactly(low: f64, high: f64) -> Self {
        Self { low, high: if high > low { high } else { low + 1.0 }, log: false }
    }

    /// Returns the position of a value, 0 to 1; `None` for values that cannot be shown.
    pub fn place(&self, value: f64) -> Option<f64> {
        let share = if self.log {
            (value / self.low).ln() / (self.high / self.low).ln()
        } else {
            (value - self.low) / (self.high - self.low)
        };
        (share.is_finite() && (!self.log || value > 0.0)).then_some(share)
    }

    /// Returns round numbers along the axis with their texts.
    pub fn ticks(&self) -> Vec<(f64, String)> {
        if self.log {
            let decades = (self.high / self.low).log10().round() as i32;
            let every = (decades / 6).max(1) as usize;
            let exponent = self.low.log10().round() as i32;
            let all = (0..=decades).step_by(every).map(|k| exponent + k);
            // All in one form.
            let is_plain = exponent >= -3 && exponent + decades <= 4;
            return all.map(|e| (10f64.powi(e), power_of_ten(e, is_plain))).collect();
        }
        let step = round_step((self.high - self.low) / 5.0);
        let first = (self.low / step - 1e-9).ceil() as i64;
        let last = (self.high / step + 1e-9).floor() as i64;
        (first..=last).map(|k| (k as f64 * step, label(k, step))).collect()
    }
}

/// Returns 1, 2 or 5 times a power of ten, near `rough`.
fn round_step(rough: f64) -> f64 {
    let power = 10f64.powf(rough.log10().floor());
    let factor = [1.0, 2.0, 5.0, 10.0].into_iter().find(|f| f * power >= rough * 0.999);
    factor.unwrap_or(10.0) * power
}

fn label(k: i64, step: f64) -> String {
    let value = k as f64 * step;
    let decimals = (-step.log10() - 1e-9).ceil().max(0.0) as usize;
    match (k, decimals) {
        (0, _) => "0".into(),
        (_, 0..=4) if value.abs() < 1e6 => format!("{value:.decimals$}").replace('-', "−"),
        _ => figure(value, 2).replace('-', "−"),
    }
}

fn power_of_ten(exponent: i32, is_plain: bool) -> String {
    match is_plain {
        true => figure(10f64.powi(exponent), 1),
        false => format!("1e{exponent}").replace('-', "−"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(scale: &AxisScale) -> Vec<String> {
        scale.ticks().into_iter().map(|t| t.1).collect()
    }

    #[test]
    fn ticks_are_round_and_inside() {
        let scale = AxisScale::over([0.13, 0.97].into_iter(), false, false);
        assert_eq!(labels(&scale), ["0", "0.2", "0.4", "0.6", "0.8", "1.0"]);
        assert_eq!(scale.place(0.5), Some(0.5));
        assert_eq!(labels(&AxisScale::exactly(0.0, 5.0)), ["0", "1", "2", "3", "4", "5"]);
        assert_eq!(labels(&AxisScale::exactly(0.3, 0.7)), ["0.3", "0.4", "0.5", "0.6", "0.7"]);
        let negative = AxisScale::over([-12.0, 30.0].into_iter(), false, false);
        assert_eq!(labels(&negative)[0], "−20");
        let nearly = AxisScale::over([-0.003, 371.0].into_iter(), false, false);
        assert_eq!(labels(&nearly)[0], "0", "three thousandths of a joule need no hundred");
    }

    #[test]
    fn a_logarithmic_axis_shows_decades_and_nothing_below_zero() {
        let scale = AxisScale::over([3e-6, 0.0, -1.0, 2e-2].into_iter(), true, false);
        assert_eq!(scale.place(0.0), None);
        assert_eq!(scale.place(-1.0), None);
        assert!((scale.place(1e-6).unwrap()).abs() < 1e-12);
        assert_eq!(labels(&scale), ["1e−6", "1e−5", "1e−4", "1e−3", "1e−2", "1e−1"]);
        let plain = AxisScale::over([0.003, 20.0].into_iter(), true, false);
        assert_eq!(labels(&plain), ["0.001", "0.01", "0.1", "1", "10", "100"]);
    }

    #[test]
    fn constant_and_absent_values_have_an_axis_too() {
        for values in [vec![], vec![0.0], vec![5.0, 5.0], vec![f64::NAN], vec![-3.0]] {
            for log in [false, true] {
                let scale = AxisScale::over(values.iter().copied(), log, false);
                assert!(scale.ticks().len() >= 2, "{values:?} {log}");
            }
        }
    }
}
