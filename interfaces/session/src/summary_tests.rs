//! Tests of summaries.

use super::*;
use crate::record::columns;
use crate::summary_text::tine_depth_warning;
use ballast::state::EnergyLedger;

fn settings() -> SummarySettings {
    let tine = TrackedBody { name: "left".into(), role: Role::Tine, driven: 0 };
    SummarySettings {
        tracked: vec![tine],
        zones: vec!["under".into()],
        period: 2,
        grain_size: 0.02,
        has_tolerance: true,
        targets: vec![Some(Targets { depth_z: 0.65, closing: 0.03, direction: -1.0 })],
        traffic: None,
    }
}

fn step(time: f64, phase: f64, coordination: f64, force: f64, converged: bool) -> StepRow {
    let names = columns(&settings().tracked);
    let mut row = StepRow(vec![0.0; names.len()]);
    let mut set = |name: &str, value: f64| {
        row.0[names.iter().position(|n| n.0 == name).unwrap()] = value;
    };
    set("time", time);
    set("phase", phase);
    set("coordination", coordination);
    set("points_per_grain", 1.5 * coordination);
    set("rattlers", 10.0 * time);
    set("converged", f64::from(u8::from(converged)));
    set("max_penetration", 0.001 * time);
    set("dissipated", 4.0 - time.min(2.0));
    set("complementarity_gap", 0.01 * time);
    set("infeasible_work", 0.005);
    set("left_force_x", force);
    set("left_work", 2.0);
    set("left_z", 1.0 - 0.1 * time);
    set("left_x", 0.5 - 0.01 * time);
    row
}

#[test]
fn figures_of_a_short_cycle() {
    let mut summary = RunSummary::new(settings());
    summary.take_step(&step(1.0, 2.0, 6.0, 900.0, true));
    summary.take_step(&step(2.0, 3.0, 4.5, -300.0, false));
    summary.take_step(&step(3.0, 3.0, 5.0, 500.0, true));
    for value in [0.58, 0.60, 0.61] {
        summary.take_zones(&[value]);
    }
    let json = summary.json();
    assert_eq!(json["coordination"]["start"], 6.0);
    assert_eq!(json["coordination"]["minimum"]["value"], 4.5);
    assert_eq!(json["coordination"]["minimum"]["phase"], "squeeze");
    assert_eq!(json["coordination"]["end"], 5.0);
    assert_eq!(json["coordination"]["points_per_grain"], 7.5);
    assert_eq!(json["coordination"]["rattlers"], 30.0);
    let tine = &json["tines"]["left"];
    assert_eq!(tine["peak_force_N"]["value"], 900.0);
    assert_eq!(tine["peak_period_averaged_force_N"], 300.0);
    assert_eq!(tine["squeeze"]["mean_force_magnitude_N"], 400.0);
    assert_eq!(tine["squeeze"]["mean_force_vector_norm_N"], 100.0);
    assert_eq!(tine["squeeze"]["peak_force_N"], 500.0);
    // The period with the last step of the insertion in it counts for the whole run only.
    assert_eq!(tine["squeeze"]["peak_period_averaged_force_N"], 100.0);
    assert!(tine["insertion"]["peak_period_averaged_force_N"].is_null());
    assert_eq!(tine["work_J"], 6.0);
    assert_eq!(tine["insertion"]["mean_force_magnitude_N"], 900.0);
    assert_eq!(tine["min_z_m"], 1.0 - 0.1 * 3.0);
    // Two steps of the squeeze since the last one before it.
    assert!((tine["max_closing_m"].as_f64().unwrap() - 0.02).abs() < 1e-12);
    assert_eq!(
        (&tine["target_closing_m"], &tine["target_depth_z_m"]),
        (&json!(0.03), &json!(0.65))
    );
    assert_eq!(json["compactness"]["under"]["before"], 0.58);
    assert_eq!(json["compactness"]["under"]["after"], 0.61);
    assert_eq!(json["relative_penetration"]["max"], 0.15);
    assert_eq!(json["solver"]["steps_not_converged"], 1);
    assert_eq!(json["energy_J"]["dissipated"], 2.0);
    assert_eq!(json["energy_J"]["spurious_contact_energy"], 1.0);
    assert_eq!((&json["time_s"], &json["from_step"]), (&json!(3.0), &json!(0)));
    summary.take_step(&step(4.0, 5.0, 5.0, 0.0, true));
    assert!((summary.closing_shortfalls()[0] - 0.01).abs() < 1e-12);
}

#[test]
fn the_complementarity_gap_is_compared_with_the_energy_dissipated_in_the_same_steps() {
    let mut summary = RunSummary::new(settings());
    let state = State {
        energy: EnergyLedger { dissipated: 10.0, ..Default::default() },
        ..Default::default()
    };
    summary = summary.starting_at(&state);
    for (time, phase, dissipated) in [(1.0, 1.0, 9.0), (2.0, 2.0, 12.0), (3.0, 2.0, 14.0)] {
        let mut row = step(time, phase, 5.0, 0.0, true);
        row.0[Column::Dissipated as usize] = dissipated;
        summary.take_step(&row);
    }
    let json = summary.json();
    let close = |found: &serde_json::Value, expected: f64| {
        assert!((found.as_f64().unwrap() - expected).abs() < 1e-12, "{found} {expected}");
    };
    close(&json["energy_J"]["complementarity_gap"], 0.06);
    close(&json["energy_J"]["infeasible_work"], 0.015);
    let error = &json["solver"]["complementarity_error"];
    close(&error["run"], 0.075 / 4.0);
    close(&error["insertion"], 0.06 / 5.0);
    assert!(error["squeeze"].is_null());
    assert!(summary.contact_work[TampingPhase::Lift as usize].error().is_none(), "released energy");
}

#[test]
fn figures_without_a_target_are_null() {
    let mut summary = RunSummary::new(SummarySettings { has_tolerance: false, ..settings() });
    summary.take_step(&step(1.0, 2.0, 6.0, 900.0, true));
    assert!(summary.json()["solver"]["steps_not_converged"].is_null());
    assert!(summary.depth_shortfalls().is_empty(), "the tine still moves");
    summary.take_step(&step(3.0, 5.0, 6.0, 0.0, true));
    assert!((summary.depth_shortfalls()[0] - 0.05).abs() < 1e-12);
    assert!(tine_depth_warning(&summary).unwrap().contains("50 mm above its depth"));
    summary.settings.grain_size = 0.06;
    assert_eq!(tine_depth_warning(&summary), None);
    assert!(summary.closing_shortfalls().is_empty(), "there was no squeeze");
    // A partner has targets for one.
    summary.take_step(&step(4.0, 5.0, 6.0, 0.0, false));
    assert_eq!(summary.json()["solver"]["steps_not_converged"], 1);
}

#[test]
fn an_empty_run_has_a_summary_too() {
    let json = RunSummary::new(settings()).json();
    assert_eq!((&json["steps"], &json["time_s"]), (&json!(0), &json!(0.0)));
    assert!(json["solver"]["residual_qm16"]["max"].is_null());
    assert!(json["relative_penetration"]["mean"].is_null());
    assert!(json["coordination"].is_null());
}
