//! Runs of a case with plates.

use crate::setup::{Ended, Place};
use std::ops::RangeInclusive;

/// A wall that stands among the stones and vibrates, and a loaded lid on them.
const CASE: &str = r#"name = "press"

[bed]
size_m = [0.18, 0.12, 0.25]
sleeper_underside_z_m = 0.06
grains = { classes = [{ size_m = 0.03, number_fraction = 1 }], shape_count = 6 }
preparation = { iterations = 20, max_settling_s = 0.4 }

[[plate]]
name = "wall"
x_m = 0.01
y_m = 0.06
z_m = 0.08
in_preparation = true
boxes = [{ size_m = [0.02, 0.12, 0.16] }]
motion = [{ time_s = 0.02, displacement_m = [0, 0, 0] }, { time_s = 0.05, displacement_m = [0.004, 0, 0] }]
vibration = { amplitude_m = [0, 0, 0.001], frequency_Hz = 50, end_s = 0.04 }

[[plate]]
name = "lid"
x_m = 0.1
y_m = 0.06
boxes = [{ size_m = [0.15, 0.12, 0.02] }]
mount = { z = "free", mass_kg = 3 }
load = [{ time_s = 0.01, force_N = [0, 0, -200] }, { time_s = 0.06, force_N = [0, 0, -300] }]

[run]
duration_s = 0.06
step_s = 1e-3
output_interval_s = 0.02

[solver]
max_iterations = 30
tolerance = 1e-3
"#;

fn run(place: &Place, arguments: &str) -> Ended {
    place.call(&format!("run tiny.toml --bed-cache beds {arguments}")).with_code(0)
}

/// Returns the rows `steps` of a column of the table `steps`.
fn column(place: &Place, folder: &str, name: &str, steps: RangeInclusive<usize>) -> Vec<f64> {
    place.call(&format!("export {folder}/results.vtkhdf --out {folder}_tables")).with_code(0);
    let table = place.text(&format!("{folder}_tables/steps.csv"));
    let mut lines = table.lines().filter(|line| !line.starts_with('#'));
    // From the end of the line: the unit of the phase has commas.
    let mut header = lines.next().unwrap().rsplit(',');
    let column = header.position(|title| title.starts_with(name)).expect(name);
    let rows: Vec<&str> = lines.collect();
    rows[*steps.start() - 1..*steps.end()]
        .iter()
        .map(|row| row.rsplit(',').nth(column).unwrap().parse().unwrap())
        .collect()
}

#[test]
fn plates_move_alike_in_a_run_its_parts_and_its_replay() {
    let place = Place::with(CASE);
    run(&place, "--out whole --record run.mcap");
    let hash = place.hash("whole");
    run(&place, "--out parts --steps 31");
    place.call(&format!("resume parts/checkpoint.h5 --expect-hash {hash}")).with_code(0);
    assert_eq!(place.summary("parts"), place.summary("whole"));
    let replay = format!("replay run.mcap --bed-cache beds --out replayed --expect-hash {hash}");
    place.call(&replay).with_code(0);
    let summary = place.summary("whole");
    let names: Vec<&String> = summary["plates"].as_object().unwrap().keys().collect();
    assert_eq!(names, ["lid", "wall"]);
    let x = column(&place, "whole", "wall_x", 20..=60);
    assert!((x[0] - 0.01).abs() < 1e-12 && (x[40] - 0.014).abs() < 1e-12, "{x:?}");
    assert!((x[15] - 0.012).abs() < 1e-12, "{x:?}");
    let force = column(&place, "whole", "lid_force_z", 40..=60);
    assert!(force.iter().sum::<f64>() / 21.0 > 200.0, "{force:?}");
}
