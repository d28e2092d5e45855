//! Neutral samples from the command line.

use crate::setup::Place;
use serde_json::Value;
use std::path::PathBuf;

fn bench_file(place: &Place, file: &str, steps: u32) -> Value {
    let ended = place.call(&format!("bench sample {file} --steps {steps} --tolerance 1e-4"));
    serde_json::from_str(&ended.with_code(0).stdout()).expect("one JSON line")
}

fn bench(place: &Place, steps: u32) -> Value {
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/rested500.json");
    bench_file(place, file, steps)
}

#[test]
fn a_bed_at_rest_stays_at_rest() {
    let place = Place::new();
    let [early, late] = [10, 50].map(|steps| bench(&place, steps));
    assert_eq!(late["grains"], 500);
    assert_eq!(late["steps_not_converged"], 0);
    assert_eq!(late["grains_lost"], 0);
    let number = |v: &Value, path: &str| v.pointer(path).and_then(Value::as_f64).expect("a number");
    let [before, after] = [&early, &late].map(|v| number(v, "/mean_speed_m_per_s"));
    assert!(after < before && after < 5e-5, "it comes to rest: {before} to {after} m/s");
    for (what, slack) in [("max", 1.001), ("mean", 1.02)] {
        let [start, end] =
            ["start", "end"].map(|when| number(&late, &format!("/penetration_m/{what}_{when}")));
        assert!(end < slack * start, "{what} penetration grows: {start} to {end} m");
    }
    let again = bench(&place, 50);
    assert_eq!(again["state_hash"], late["state_hash"]);
}

/// Stones that fall by gaps of tenths of a millimetre and are caught: sweeps alone go round for ever in a fifth of the
/// steps.
#[test]
fn a_bed_that_rearranges_is_solved_in_every_step() {
    let default = || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../shared/cases");
    let folder = std::env::var_os("BALLAST_CASES").map_or_else(default, PathBuf::from);
    let Ok(file) = std::fs::canonicalize(folder.join("settled500.json")) else {
        eprintln!("left out: no settled500.json in {}; set BALLAST_CASES", folder.display());
        return;
    };
    let place = Place::new();
    let told = bench_file(&place, &file.display().to_string(), 50);
    assert_eq!((&told["steps_not_converged"], &told["grains_lost"]), (&0.into(), &0.into()));
}
