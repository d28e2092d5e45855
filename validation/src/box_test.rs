//! Box test: settlement of ballast under load cycles, before and after tamping.

use super::case_run::run_case;
use super::check::{CheckFinding, ValidationCheck, mean_and_error};
use super::suite_size::SuiteSize;
use ballast::model::Role;
use ballast_report::plot::{Chart, SeriesStyle};
use ballast_session::case::{self, CaseOverrides};
use ballast_session::record::TrackedBody;
use ballast_session::{Failure, Reporter, Result, beds};
use std::path::Path;

const CASE: &str = include_str!("box.toml");
/// Number of load cycles before tamping in the quick check.
const QUICK_CYCLES: u32 = 8;
/// Number of cycles that are compared before and after tamping.
const COMPARED: usize = 10;

/// Fit of a settlement curve: `S(N) = first (1 + rate ln N)`.
struct SettlementLaw {
    /// Settlement of the first cycle, m.
    first: f64,
    /// Coefficient of the logarithm over the settlement of the first cycle.
    rate: f64,
    /// Share of the variance that the law explains.
    explained: f64,
}

impl SettlementLaw {
    /// Fits settlements at the end of each cycle by least squares.
    fn fit(settlements: &[f64]) -> Self {
        let x: Vec<f64> = (1..=settlements.len()).map(|k| (k as f64).ln()).collect();
        let [mx, my] = [&x[..], settlements].map(|v| mean_and_error(v)[0]);
        let moment = |a: &[f64], ma: f64, b: &[f64], mb: f64| -> f64 {
            a.iter().zip(b).map(|(a, b)| (a - ma) * (b - mb)).sum()
        };
        let slope = moment(&x, mx, settlements, my) / moment(&x, mx, &x, mx);
        let first = my - slope * mx;
        let rest: f64 =
            x.iter().zip(settlements).map(|(x, y)| (y - first - slope * x).powi(2)).sum();
        let explained = 1.0 - rest / moment(settlements, my, settlements, my);
        Self { first, rate: slope / first, explained }
    }
}

/// Measures the settlement of a block under load cycles, before and after tamping.
pub fn box_test(
    size: &SuiteSize,
    folder: &Path,
    console: &dyn Reporter,
) -> Result<ValidationCheck> {
    let mut case = case::parse(CASE.into(), "box", &CaseOverrides::default(), console)?;
    let Some(traffic) = &mut case.plan.bed.traffic else {
        return Err(Failure::Failed("box: expected [bed.traffic], found none".into()));
    };
    if size.quick {
        traffic.load.cycles = QUICK_CYCLES;
    }
    let load = traffic.load;
    let tamped =
        if size.quick { "" } else { ", then tamping and as many loads again as are compared" };
    let mut check = ValidationCheck::new(
        "box test",
        format!(
            "The stones of examples/slice.toml, μ = {}, in a box of steel; a block of 0.25 × 0.29 m carries {} cycles between {} \
             and {} kN at {} Hz{tamped} (validation/src/box.toml). Settlements at the ends of cycles.",
            case.plan.bed.friction.grain,
            load.cycles,
            1e-3 * load.min_load,
            1e-3 * load.max_load,
            load.frequency,
        ),
        "Lim 2004; McDowell et al. 2005: settlement over the logarithm of the number of loads is a line, and the law starts again after tamping",
    );
    let before = beds::bed_without_progress(&case, folder, console)?.settlements;
    let law = SettlementLaw::fit(&before);
    check.findings.push(CheckFinding::informational("S1 (mm)", 1e3 * law.first, ""));
    check.findings.push(CheckFinding::informational("C", law.rate, ""));
    let name = "share of the variance that S(N) = S1 (1 + C ln N) explains";
    check.findings.push(CheckFinding::between(name, law.explained, [0.95, 1.0]));
    let mut chart = Chart::new("Box test", "cycles", "settlement (mm)").log_x();
    let curve = |settlements: &[f64]| {
        settlements.iter().enumerate().map(|(k, s)| [k as f64 + 1.0, 1e3 * s]).collect()
    };
    chart = chart.with("before tamping", curve(&before), SeriesStyle::Line);
    if !size.quick {
        let (setting, summary) = run_case(&case, folder, console)?;
        let is_block = |tracked: &TrackedBody| tracked.role == Role::Sleeper;
        let block = setting.tracked.iter().position(is_block);
        let after = block.map_or(vec![], |at| summary.bodies[at].traffic_settlements());
        chart = chart.with("after tamping", curve(&after), SeriesStyle::Line);
        let of = |settlements: &[f64], from: usize| match settlements.get(from..) {
            Some([first, .., last]) => 1e3 * (last - first),
            _ => f64::NAN,
        };
        let last = of(&before, before.len().saturating_sub(COMPARED));
        let first = after.last().map_or(f64::NAN, |s| 1e3 * s);
        let name = format!("settlement of the last {COMPARED} cycles before tamping (mm)");
        check.findings.push(CheckFinding::informational(name, last, ""));
        let name = format!("settlement of the first {COMPARED} cycles after tamping (mm)");
        check.findings.push(CheckFinding::informational(name, first, ""));
        check
            .findings
            .push(CheckFinding::trend("settles more after tamping than before it", first > last));
    }
    check.charts.push(chart.svg());
    Ok(check)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::specimen::{STIFFNESS, STONE_FRICTION, STONE_SHAPE};
    use ballast_scenario::read_case;

    #[test]
    fn all_laboratory_tests_have_the_stones_of_the_demonstration() {
        let demonstration = include_str!("../../examples/slice.toml");
        let [slice, test] =
            [demonstration, CASE].map(|text| read_case(text, "case.toml").unwrap().plan.bed);
        assert_eq!(test.grains, slice.grains);
        assert_eq!(
            (test.friction.grain, test.stiffness.grain),
            (slice.friction.grain, slice.stiffness.grain)
        );
        assert_eq!((STONE_SHAPE, STONE_FRICTION), (slice.grains.shape, slice.friction.grain));
        assert_eq!(STIFFNESS.normal, slice.stiffness.grain.normal);
    }
}
