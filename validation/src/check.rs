//! What a check found, compared with what is known.

use serde_json::{Value, json};

/// Whether what was measured is what is known.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    Passed,
    Failed,
    /// Nothing is known to compare with: the figure is told.
    Told,
}

impl Verdict {
    pub fn word(self) -> &'static str {
        match self {
            Verdict::Passed => "passed",
            Verdict::Failed => "failed",
            Verdict::Told => "told",
        }
    }

    /// The verdict of a condition; NaN fails every one.
    pub fn of(passed: bool) -> Self {
        if passed { Verdict::Passed } else { Verdict::Failed }
    }
}

/// Significant digits of a figure that is told.
pub const DIGITS: usize = 4;

/// Enough digits to see a tenth of the tolerance.
fn digits(measured: f64, tolerance: f64) -> usize {
    let place = |value: f64| value.abs().log10().floor();
    let needed = place(measured) - place(tolerance) + 2.0;
    if needed.is_finite() { (needed as usize).clamp(DIGITS, 15) } else { DIGITS }
}

/// A number as it was given, small ones by their powers of ten.
fn plain(value: f64) -> String {
    let is_short = value == 0.0 || (1e-4..1e7).contains(&value.abs());
    if is_short { value.to_string() } else { format!("{value:e}") }
}

/// One figure.
#[derive(Debug, Clone, PartialEq)]
pub struct Finding {
    pub quantity: String,
    pub measured: f64,
    /// Significant digits that are shown of it.
    pub digits: usize,
    /// In words: a value, a range, a trend.
    pub expected: String,
    pub tolerance: String,
    pub verdict: Verdict,
}

impl Finding {
    /// A figure that has to be within `tolerance` of `expected`.
    pub fn near(quantity: impl Into<String>, measured: f64, expected: f64, tolerance: f64) -> Self {
        Self {
            quantity: quantity.into(),
            measured,
            digits: digits(measured, tolerance),
            expected: plain(expected),
            tolerance: format!("± {}", plain(tolerance)),
            verdict: Verdict::of((measured - expected).abs() <= tolerance),
        }
    }

    /// A figure that has to be between two bounds.
    pub fn between(quantity: impl Into<String>, measured: f64, [low, high]: [f64; 2]) -> Self {
        Self {
            quantity: quantity.into(),
            measured,
            digits: DIGITS,
            expected: format!("{low} to {high}"),
            tolerance: "as stated".into(),
            verdict: Verdict::of((low..=high).contains(&measured)),
        }
    }

    /// Whether something goes as it should.
    pub fn trend(quantity: &str, holds: bool) -> Self {
        Self {
            quantity: format!("{quantity} (1: yes)"),
            measured: f64::from(u8::from(holds)),
            digits: 1,
            expected: "1".into(),
            tolerance: "trend".into(),
            verdict: Verdict::of(holds),
        }
    }

    /// A figure with nothing to compare with, or with something that decides nothing.
    pub fn told(quantity: impl Into<String>, measured: f64, expected: impl Into<String>) -> Self {
        Self {
            quantity: quantity.into(),
            measured,
            digits: DIGITS,
            expected: expected.into(),
            tolerance: "none".into(),
            verdict: Verdict::Told,
        }
    }

    fn json(&self) -> Value {
        json!({
            "quantity": self.quantity, "measured": self.measured, "expected": self.expected,
            "tolerance": self.tolerance, "verdict": self.verdict.word(),
        })
    }
}

/// A check with its figures.
#[derive(Debug, Clone, PartialEq)]
pub struct Check {
    pub name: String,
    /// What is done, and with how much.
    pub what: String,
    /// Where the expected values are from.
    pub origin: String,
    pub findings: Vec<Finding>,
    /// Drawings (SVG).
    pub charts: Vec<String>,
    /// Likely reasons, limits.
    pub remark: String,
    /// Wall time, s: the only figure that differs from run to run.
    pub seconds: f64,
}

impl Check {
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

    pub fn failed(&self) -> usize {
        self.findings.iter().filter(|f| f.verdict == Verdict::Failed).count()
    }

    pub fn json(&self) -> Value {
        json!({
            "check": self.name, "what": self.what, "origin": self.origin, "remark": self.remark,
            "findings": self.findings.iter().map(Finding::json).collect::<Vec<_>>(),
            "seconds": self.seconds,
        })
    }
}

/// Exponent of the power law through two points.
pub fn exponent(a: [f64; 2], b: [f64; 2]) -> f64 {
    (b[1] / a[1]).ln() / (b[0] / a[0]).ln()
}

/// Mean, and its standard error.
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
    fn what_is_no_number_fails() {
        assert_eq!(Finding::near("x", f64::NAN, 1.0, 0.1).verdict, Verdict::Failed);
        assert_eq!(Finding::between("x", f64::NAN, [0.0, 1.0]).verdict, Verdict::Failed);
        assert_eq!(Finding::near("x", 1.05, 1.0, 0.1).verdict, Verdict::Passed);
        assert_eq!(Finding::near("x", 1.15, 1.0, 0.1).verdict, Verdict::Failed);
    }

    #[test]
    fn digits_go_as_far_as_a_tenth_of_the_tolerance() {
        let near = Finding::near("x", 1.0000002, 1.0, 2e-6);
        assert_eq!(
            (near.digits, near.tolerance.as_str(), near.expected.as_str()),
            (8, "± 2e-6", "1")
        );
        for (measured, tolerance) in [(3e-10, 1e-7), (0.0, 1e-7), (0.5, 0.02), (f64::NAN, 0.1)] {
            assert_eq!(Finding::near("x", measured, 0.0, tolerance).digits, DIGITS);
        }
    }
}
