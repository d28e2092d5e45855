//! Timings published by Hoang, Saussine, Dureisseix and Alart (2012).
//!
//! Source: *Domain decomposition with discrete element simulations using shared-memory parallel computing for
//! railways applications*, European Journal of Computational Mechanics 21 (3-6), pp. 242-253; `docs/src/theory.md`
//! lists it with the slips of its text. The two tables were measured on different machines: their times are
//! not comparable with each other.

/// Row of a published table; unknown figures are `None`.
#[derive(Debug, Default)]
pub struct PublishedRow {
    pub by: &'static str,
    pub rule: &'static str,
    pub threads: Option<u32>,
    pub subdomains: Option<u32>,
    pub contacts: Option<u32>,
    /// Time of the whole run, min.
    pub run_min: Option<f64>,
    /// Contact visits of the solve, 10⁶ per second.
    pub mvisits_per_s: Option<f64>,
    /// Shares of solve, detection and rest in the time, %.
    pub shares: Option<[f64; 3]>,
    /// Time of detection, s per step.
    pub detection: Option<f64>,
}

/// Citation of the published rows.
pub const CITATION: &str =
    "Hoang et al. 2012, European Journal of Computational Mechanics 21, pp. 242-253";

const NOTHING: PublishedRow = PublishedRow {
    by: "",
    rule: "",
    threads: None,
    subdomains: None,
    contacts: None,
    run_min: None,
    mvisits_per_s: None,
    shares: None,
    detection: None,
};

/// Their Table 1: seven sleepers, 88 100 grains, 8820 steps of 0.2 ms.
const PROCESSORS: [PublishedRow; 3] = [
    PublishedRow {
        by: "published, 1 processor",
        rule: "740 iterations",
        threads: Some(1),
        contacts: Some(310_000),
        mvisits_per_s: Some(2.99),
        ..NOTHING
    },
    PublishedRow {
        by: "published, 4 processors",
        rule: "740 iterations",
        threads: Some(4),
        contacts: Some(310_000),
        mvisits_per_s: Some(6.6),
        ..NOTHING
    },
    // Printed as "1659 minutes (4.3 days)", which is 6159.
    PublishedRow {
        by: "published, as in the text",
        rule: "740 iterations",
        contacts: Some(310_000),
        run_min: Some(6159.0),
        detection: Some(16.8),
        ..NOTHING
    },
];

/// Their Table 2: one sleeper, steps of 0.8 ms, 19 800 and 22 800 contacts in two subdomains, 3 000 between.
const VERSIONS: [PublishedRow; 1] = [PublishedRow {
    by: "published, sequential",
    rule: "500 iterations",
    threads: Some(1),
    contacts: Some(45_600),
    shares: Some([80.5, 17.6, 1.8]),
    ..NOTHING
}];

/// Rows of their Table 1 for a case.
pub fn by_processors(case: &str) -> &'static [PublishedRow] {
    if case == "seven_sleepers" { &PROCESSORS } else { &[] }
}

/// Rows of their Table 2 for a case.
pub fn by_version(case: &str) -> &'static [PublishedRow] {
    if case == "one_sleeper" { &VERSIONS } else { &[] }
}
