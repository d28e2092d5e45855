//! Content key of prepared beds.

use crate::{BASE, changed};
use ballast_scenario::{content_key, read_case};
use std::collections::BTreeSet;

fn key(text: &str) -> String {
    content_key(&read_case(text, "case.toml").unwrap_or_else(|e| panic!("{e}")).plan)
}

#[test]
fn the_key_is_the_same_on_every_machine() {
    // Obtained from the seventeenth version of the key; changes with it, and with the base case.
    assert_eq!(key(BASE), "2428f0a1ad02d8c7d0458f572d17bf35");
}

#[test]
fn the_key_does_not_depend_on_the_run() {
    for (from, to) in [
        ("\"base\"", "\"other\""),
        ("= 1.764", "= 1.768"),
        ("stroke_m = 0.05", "stroke_m = 0.04"),
        ("[-0.1, 0.1]", "[-0.1]"),
        ("restitution = 0", "output_interval_s = 0"),
        ("[2, 1, 1]", "[1, 2, 1]"),
        ("tolerance = 1.666e-4", "tolerance = 0"),
        ("max_iterations = 300", "max_iterations = 301"),
        ("density_kg_per_m3 = 2700", "density_kg_per_m3 = 2_700.0 # the same"),
    ] {
        assert_eq!(key(&changed(from, to)), key(BASE), "{to}");
    }
}

#[test]
fn the_key_depends_on_the_preparation() {
    let mut keys = BTreeSet::from([key(BASE)]);
    for (from, to) in [
        ("density_kg_per_m3 = 2700", "seed = 2"),
        ("= 2700", "= 2701"),
        ("0.70, 0.45]", "0.71, 0.45]"),
        ("= 0.28", "= 0.281"),
        ("[8, 40]", "[8, 39]"),
        ("number_fraction = 0.7 }, { size_m = 0.05", "number_fraction = 0.7 }, { size_m = 0.051"),
        ("step_s = 1e-3", "step_s = 9e-4"),
        ("[sleepers]", "[sleepers]\nfirst_x_m = 0.301"),
        ("0.40, 0.15]", "0.41, 0.15]"),
        ("step_s = 8e-4", "step_s = 4e-4"),
        ("restitution = 0", "theta = 0.6"),
        ("[sleepers]", "[bed.subgrade]\nmodulus_N_per_m3 = 6e7\n[sleepers]"),
        ("[sleepers]", "[bed.subgrade]\nmodulus_N_per_m3 = 7e7\n[sleepers]"),
    ] {
        assert!(keys.insert(key(&changed(from, to))), "{to}");
    }
}
