//! Checks with their findings: measured figures compared with expected ones.

use serde_json::{Value, json};

/// Verdict on a measured figure.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CheckVerdict {
    /// Within the tolerance.
    Passed,
    /// Beyond the tolerance by no more than is documented.
    KnownDeviation,
    /// Beyond the tolerance.
    Failed,
    /// Without an expected value to compare with.
    Informational,
}

impl CheckVerdict {
    /// Name in tables and files.
    pub fn word(self) -> &'static str {
        match self {
            CheckVerdict::Passed => "passed",
            CheckVerdict::KnownDeviation => "known deviation",
            CheckVerdict::Failed => "failed",
            CheckVerdict::Informational => "informational",
        }
    }

    /// Returns the verdict on a condition.
    pub fn from_condition(passed: bool) -> Self {
        if passed { CheckVerdict::Passed } else { CheckVerdict::Failed }
    }
}

/// Default number of significant digits.
pub const DEFAULT_DIGITS: usize = 4;

/// Returns the number of digits that show a tenth of the tolerance.
fn digits(measured: f64, tolerance: f64) -> usize {
    let place = |value: f64| value.abs().log10().floor();
    let needed = place(measured) - place(tolerance) + 2.0;
    if needed.is_finite() { (needed as usize).clamp(DEFAULT_DIGITS, 15) } else { DEFAULT_DIGITS }
}

/// Formats a number, small and large ones with powers of ten.
fn plain(value: f64) -> String {
    let is_short = value == 0.0 || (1e-4..1e7).contains(&value.abs());
    if is_short { value.to_string() } else { format!("{value:e}") }
}

/// Documented deviation of a figure from what is expected.
#[derive(Debug, Clone, PartialEq)]
pub struct KnownDeviation {
    /// Largest distance from the permitted range that is documented.
    pub largest: f64,
    /// Likely reason.
    pub reason: String,
}

/// Measured figure with its expected value and verdict.
#[derive(Debug, Clone, PartialEq)]
pub struct CheckFinding {
    /// Description of the quantity.
    pub quantity: String,
    /// Measured value.
    pub measured: f64,
    /// Significant digits shown.
    pub digits: usize,
    /// Expected value, range or trend, as text.
    pub expected: String,
    /// Tolerance, as text.
    pub tolerance: String,
    /// Distance of the measured value from the permitted range; 0 within it or without a range.
    pub deviation: f64,
    /// Documented deviation, if there is one.
    pub known: Option<KnownDeviation>,
    /// Verdict.
    pub verdict: CheckVerdict,
}

impl CheckFinding {
    /// Creates a finding about a value at a distance from its permitted range; NaN counts as infinitely far.
    pub fn at_distance(
        quantity: impl Into<String>,
        measured: f64,
        [expected, tolerance]: [String; 2],
        distance: f64,
    ) -> Self {
        let deviation = if distance.is_nan() { f64::INFINITY } else { distance.max(0.0) };
        Self {
            quantity: quantity.into(),
            measured,
            digits: DEFAULT_DIGITS,
            expected,
            tolerance,
            deviation,
            known: None,
            verdict: CheckVerdict::from_condition(deviation == 0.0),
        }
    }

    /// Documents a deviation: a value at most `largest` away from its permitted range does not fail.
    pub fn with_known_deviation(mut self, largest: f64, reason: &str) -> Self {
        if self.verdict == CheckVerdict::Failed && self.deviation <= largest {
            self.verdict = CheckVerdict::KnownDeviation;
        }
        self.known = Some(KnownDeviation { largest, reason: reason.into() });
        self
    }

    /// Creates a finding that must be within `tolerance` of `expected`.
    pub fn near(quantity: impl Into<String>, measured: f64, expected: f64, tolerance: f64) -> Self {
        let texts = [plain(expected), format!("± {}", plain(tolerance))];
        let distance = (measured - expected).abs() - tolerance;
        let digits = digits(measured, tolerance);
        Self { digits, ..Self::at_distance(quantity, measured, texts, distance) }
    }

    /// Creates a finding that must be between two bounds.
    pub fn between(quantity: impl Into<String>, measured: f64, [low, high]: [f64; 2]) -> Self {
        let texts = [format!("{low} to {high}"), "as stated".into()];
        // Comparisons in this order keep NaN.
        let distance = if measured < low { low - measured } else { measured - high };
        Self::at_distance(quantity, measured, texts, distance)
    }

    /// Creates a finding about a condition.
    pub fn trend(quantity: &str, holds: bool) -> Self {
        let measured = f64::from(u8::from(holds));
        let texts = ["1".into(), "trend".into()];
        let found =
            Self::at_distance(format!("{quantity} (1: yes)"), measured, texts, 1.0 - measured);
        Self { digits: 1, ..found }
    }

    /// Creates a finding without a verdict.
    pub fn informational(
        quantity: impl Into<String>,
        measured: f64,
        expected: impl Into<String>,
    ) -> Self {
        let texts = [expected.into(), "none".into()];
        let found = Self::at_distance(quantity, measured, texts, 0.0);
        Self { verdict: CheckVerdict::Informational, ..found }
    }

    fn json(&self) -> Value {
        json!({
            "quantity": self.quantity, "measured": self.measured, "expected": self.expected,
            "tolerance": self.tolerance, "verdict": self.verdict.word(), "deviation": self.deviation,
            "known_deviation": self.known.as_ref().map(|known| json!({
                "largest": known.largest, "reason": known.reason,
            })),
        })
    }
}

/// ValidationCheck with its findings.
#[derive(Debug, Clone, PartialEq)]
pub struct ValidationCheck {
    /// Name of the check.
    pub name: String,
    /// Procedure and sizes.
    pub what: String,
    /// Source of the expected values.
    pub origin: String,
    /// Findings.
    pub findings: Vec<CheckFinding>,
    /// Drawings (SVG).
    pub charts: Vec<String>,
    /// Likely reasons, limits.
    pub remark: String,
    /// Wall time, s; the only figure that differs between runs.
    pub seconds: f64,
}

impl ValidationCheck {
    /// Creates a check without findings.
    pub fn new(name: &str, what: impl Into<String>, origin: &str) -> Self {
        Self {
            name: name.into(),
            what: what.into(),
            origin: origin.into(),
            findings: vec![],
            charts: vec![],
            remark: String::new(),
            seconds: 0.0,
        }
    }

    /// Number of findings with a verdict.
    pub fn count(&self, verdict: CheckVerdict) -> usize {
        self.findings.iter().filter(|f| f.verdict == verdict).count()
    }

    /// Returns the check as JSON.
    pub fn json(&self) -> Value {
        json!({
            "check": self.name, "what": self.what, "origin": self.origin, "remark": self.remark,
            "findings": self.findings.iter().map(CheckFinding::json).collect::<Vec<_>>(),
            "seconds": self.seconds,
        })
    }
}

/// Returns the exponent of the power law through two points.
pub fn exponent(a: [f64; 2], b: [f64; 2]) -> f64 {
    (b[1] / a[1]).ln() / (b[0] / a[0]).ln()
}

/// Returns the mean of `values` and its standard error.
pub fn mean_and_error(values: &[f64]) -> [f64; 2] {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let variance = values.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (n - 1.0);
    [mean, (variance / n).sqrt()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nan_fails() {
        assert_eq!(CheckFinding::near("x", f64::NAN, 1.0, 0.1).verdict, CheckVerdict::Failed);
        assert_eq!(CheckFinding::between("x", f64::NAN, [0.0, 1.0]).verdict, CheckVerdict::Failed);
        assert_eq!(CheckFinding::near("x", 1.05, 1.0, 0.1).verdict, CheckVerdict::Passed);
        assert_eq!(CheckFinding::near("x", 1.15, 1.0, 0.1).verdict, CheckVerdict::Failed);
    }

    #[test]
    fn only_what_is_worse_than_documented_fails() {
        let found = |measured: f64| {
            CheckFinding::between("x", measured, [1.0, 2.0])
                .with_known_deviation(0.5, "why")
                .verdict
        };
        assert_eq!(found(1.5), CheckVerdict::Passed);
        assert_eq!(found(2.5), CheckVerdict::KnownDeviation);
        assert_eq!(found(0.6), CheckVerdict::KnownDeviation);
        assert_eq!(found(2.6), CheckVerdict::Failed);
        assert_eq!(found(0.4), CheckVerdict::Failed);
        assert_eq!(found(f64::NAN), CheckVerdict::Failed);
    }

    #[test]
    fn digits_show_a_tenth_of_the_tolerance() {
        let near = CheckFinding::near("x", 1.0000002, 1.0, 2e-6);
        assert_eq!(
            (near.digits, near.tolerance.as_str(), near.expected.as_str()),
            (8, "± 2e-6", "1")
        );
        for (measured, tolerance) in [(3e-10, 1e-7), (0.0, 1e-7), (0.5, 0.02), (f64::NAN, 0.1)] {
            assert_eq!(CheckFinding::near("x", measured, 0.0, tolerance).digits, DEFAULT_DIGITS);
        }
    }
}
