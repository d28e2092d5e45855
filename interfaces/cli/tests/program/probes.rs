//! `ballast probe`: tables, events and curves of a sleeper.

use crate::setup::Place;

#[test]
fn a_sleeper_is_probed_on_the_bed_of_a_case_and_at_the_end_of_a_run() {
    let place = Place::new();
    let arguments = "--max-load 300 --min-load 50 --cycles 1 --ramp 0.02 --out support.csv";
    let probed = place.with_beds(&format!("probe stiffness tiny.toml {arguments}")).with_code(0);
    assert!(probed.stdout().contains("unloading (kN/mm)"), "{}", probed.stdout());
    assert!(probed.stderr().contains("all contacts are rigid"), "{}", probed.stderr());
    let curve = place.text("support.csv");
    assert_eq!(curve.lines().next(), Some("time_s,load_N,settlement_m"));
    // A point of each step of 1 ms.
    assert_eq!(curve.lines().count(), 1 + 2 * 20);

    place.run("--out run").with_code(0);
    let arguments = "--displacement 3e-4 --speed 0.02 --out push.csv --json";
    let events = place.call(&format!("probe push run {arguments}")).with_code(0).events();
    let event = events.iter().find(|e| e["event"] == "lateral_resistance").expect("the result");
    assert_eq!(event["sleeper"], "sleeper_1");
    assert!(event["largest_force_N"].as_f64().is_some_and(|force| force > 0.0), "{event}");
    assert!(event["force_at_2_mm_N"].is_null(), "not pushed that far: {event}");
    assert_eq!(place.text("push.csv").lines().count(), 1 + 15);
}

#[test]
fn impossible_probes_are_refused() {
    let place = Place::new();
    let of = |arguments: &str| place.with_beds(&format!("probe {arguments}"));
    let unknown = of("stiffness tiny.toml --sleeper bench").with_code(2);
    assert!(unknown.stderr().contains("expected one of [\"sleeper_1\"], found \"bench\""));
    let heavy = of("stiffness tiny.toml --min-load 1e9").with_code(1);
    assert!(heavy.stderr().contains("below the largest load"), "{}", heavy.stderr());
    of("push missing.h5").with_code(1);
}
