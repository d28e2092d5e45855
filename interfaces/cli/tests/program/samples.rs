//! Neutral samples from the command line.

use crate::setup::Place;
use serde_json::Value;

/// Stones that have come to rest under exact contacts; the file looks for them up to 1 mm.
const RESTED: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/rested500.json");

fn bench_file(place: &Place, file: &str, choices: &str) -> Value {
    let ended = place.call(&format!("bench sample {file} --tolerance 1e-4 {choices}"));
    serde_json::from_str(&ended.with_code(0).stdout()).expect("one JSON line")
}

fn number(expected: &Value, path: &str) -> f64 {
    expected.pointer(path).and_then(Value::as_f64).expect("a number")
}

fn bench(place: &Place, steps: u32) -> Value {
    bench_file(place, RESTED, &format!("--steps {steps}"))
}

#[test]
fn a_bed_at_rest_stays_at_rest() {
    let place = Place::new();
    let [early, late] = [10, 50].map(|steps| bench(&place, steps));
    assert_eq!(late["grains"], 500);
    assert_eq!(late["steps_not_converged"], 0);
    assert_eq!(late["grains_lost"], 0);
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

#[test]
fn figures_are_kept_as_a_table_with_the_machine() {
    let place = Place::new();
    let expected = bench_file(&place, RESTED, "--steps 3 --threads 1 --csv s.csv");
    let text = std::fs::read_to_string(place.path("s.csv")).unwrap();
    let (notes, table): (Vec<&str>, Vec<&str>) = text.lines().partition(|l| l.starts_with('#'));
    assert!(notes[0].starts_with("# command: ballast bench sample "), "{text}");
    let [names, values]: [Vec<&str>; 2] =
        [0, 1].map(|k| table.get(k).map_or(vec![], |line| line.split(',').collect()));
    assert_eq!((table.len(), names.len()), (2, values.len()), "{text}");
    let kept = |name: &str| values[names.iter().position(|n| *n == name).expect(name)];
    assert_eq!((kept("grains"), kept("steps"), kept("threads")), ("500", "3", "1"));
    assert_eq!(kept("state_hash"), expected["state_hash"].as_str().unwrap());
    for (name, path) in [("contacts", "/contacts/mean"), ("cpu_ms_per_step", "/ms_per_step/cpu")] {
        let [kept, expected] = [kept(name).parse().expect(name), number(&expected, path)];
        assert!((kept / expected - 1.0f64).abs() < 1e-5, "{name}: {kept} and {expected}");
    }
    assert!(values.iter().all(|value| !value.is_empty()), "{text}");
}

#[test]
fn contacts_that_no_step_reaches_do_not_matter() {
    let place = Place::new();
    let [far, near] = ["", "--detection-distance-m 1e-4"]
        .map(|choice| bench_file(&place, RESTED, &format!("--steps 10 {choice}")));
    assert_eq!(
        (number(&far, "/detection_distance_m"), number(&near, "/detection_distance_m")),
        (1e-3, 1e-4)
    );
    assert_eq!(near["steps_resolved"], 0);
    let [contacts, active] = ["contacts", "active_contacts"].map(|what| {
        number(&near, &format!("/{what}/mean")) / number(&far, &format!("/{what}/mean"))
    });
    assert!(contacts < 0.7, "{contacts} of the contacts");
    assert!((active - 1.0).abs() < 0.03, "{active} of those that carry");
    let speed = number(&near, "/mean_speed_m_per_s");
    assert!(speed < 2e-4, "it stays at rest: {speed} m/s");
    for wrong in ["0", "-1", "nan", "inf"] {
        for option in ["--detection-distance-m", "--tolerance"] {
            let ended = place.call(&format!("bench sample {RESTED} {option}={wrong}"));
            let said = ended.with_code(2).stderr();
            assert!(said.contains(option) && said.contains("above 0"), "{said}");
        }
    }
}

/// Stones that fall by gaps of tenths of a millimetre and are caught: sweeps alone go round for ever in a fifth of the
/// steps.
#[test]
fn a_bed_that_rearranges_is_solved_in_every_step() {
    for name in ["settled500", "settled2000"] {
        let file = format!("{}/../../tests/data/{name}.json", env!("CARGO_MANIFEST_DIR"));
        let expected = bench_file(&Place::new(), &file, "--steps 50");
        assert_eq!(
            (&expected["steps_not_converged"], &expected["grains_lost"]),
            (&0.into(), &0.into())
        );
    }
}
