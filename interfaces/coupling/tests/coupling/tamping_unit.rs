//! The tamping unit alone: figures of `examples/machine/reference.json`, which the model in Python gives.

use crate::model::{Parameters, Phase, Sleeper, TampingUnit, Tine, TraceRow};
use ballast_coupling::{ForceRows, Partner};
use serde_json::Value;

/// Values of a row of the trace.
type Column = fn(&TraceRow) -> Vec<f64>;

fn reference() -> Value {
    serde_json::from_str(include_str!("../../../../examples/machine/reference.json")).unwrap()
}

/// A unit with two pairs of tines.
fn unit() -> TampingUnit {
    let tine = |pair: usize, direction: f64| Tine {
        name: format!("{pair}{direction}"),
        direction,
        pair,
        start: [0.5 - 0.2 * direction, 0.1 + 0.1 * pair as f64, 0.4],
    };
    let tines = vec![tine(0, 1.0), tine(0, -1.0), tine(1, 1.0), tine(1, -1.0)];
    let sleeper = Sleeper { name: "sleeper".into(), start: [0.5, 0.1, 0.2] };
    TampingUnit::new(tines, sleeper, 0.2, Parameters::default(), vec![vec![0, 1]])
}

/// Runs a cycle against springs that resist the closing of each pair; returns the values after each window.
fn run(unit: &mut TampingUnit, stiffness: [f64; 2], onset: f64, step: f64) -> Vec<TraceRow> {
    let (mut t, mut rows) = (0.0, Vec::new());
    while unit.phase() != Phase::Done {
        let up = if unit.phase() == Phase::Squeeze { 500.0 } else { 0.0 };
        let closings = unit.closings().into_iter();
        let mut forces: ForceRows = unit
            .tines()
            .iter()
            .zip(closings)
            .map(|(tine, closing)| {
                let resistance = stiffness[tine.pair] * (closing - onset).max(0.0);
                let row = [-tine.direction * resistance, 0.0, up, 0.0, 0.0, 0.0];
                (tine.name.clone(), vec![row; 2])
            })
            .collect();
        forces.insert("sleeper".into(), vec![[0.0; 6]; 2]);
        unit.advance(t, t + 2.0 * step, &forces).unwrap();
        t += 2.0 * step;
        assert!(t < 3.0, "the cycle stays in {}", unit.phase());
        rows.push(unit.trace()[1].clone());
    }
    rows
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
}

/// Asserts that values are equal to 1 % of the largest of the reference.
fn assert_close(found: &[f64], expected: &[f64], what: &str) {
    let largest = expected.iter().fold(0.0_f64, |most, v| most.max(v.abs()));
    assert_eq!(found.len(), expected.len(), "{what}");
    for (f, e) in found.iter().zip(expected) {
        assert!((f - e).abs() <= 0.01 * largest, "{what}: expected {e}, found {f}");
    }
}

#[test]
fn parameters_are_those_of_python() {
    let reference = reference();
    let expected = reference["parameters"].as_object().unwrap();
    let mut parameters = Parameters::default();
    for (name, value) in expected {
        assert_eq!(parameters.by_name(name).copied(), value.as_f64(), "{name}");
    }
    assert_eq!(parameters.by_name("wheels"), None);
    let written = format!("{parameters:?}").matches(": ").count();
    assert_eq!(written, expected.len());
}

#[test]
fn a_cycle_on_springs_has_the_figures_of_python() {
    let reference = reference();
    let mut unit = unit();
    let stiffness = numbers(&reference["stiffness"]);
    let [onset, step] = ["onset", "step"].map(|name| reference[name].as_f64().unwrap());
    let rows = run(&mut unit, [stiffness[0], stiffness[1]], onset, step);
    let instants = reference["instants"].as_array().unwrap();
    let columns: [(&str, Column); 4] = [
        ("depth", |row| vec![row.depth]),
        ("supply", |row| vec![row.supply]),
        ("closing", |row| row.closing.clone()),
        ("load_pressure", |row| row.load_pressure.clone()),
    ];
    for (name, of) in columns {
        let found: Vec<f64> = rows.iter().skip(59).step_by(60).flat_map(of).collect();
        let expected: Vec<f64> = instants.iter().flat_map(|i| numbers(&i[name])).collect();
        assert_close(&found, &expected, name);
    }
    for (squeeze, expected) in unit.squeezes().iter().zip(reference["squeezes"].as_array().unwrap())
    {
        assert_eq!(squeeze.pair as u64, expected["pair"].as_u64().unwrap());
        assert_eq!(squeeze.cause.to_string(), expected["cause"].as_str().unwrap());
        let found = [squeeze.time, squeeze.closing, squeeze.pressure];
        for (name, found) in ["time", "closing", "pressure"].into_iter().zip(found) {
            assert_close(&[found], &[expected[name].as_f64().unwrap()], name);
        }
    }
    assert_eq!(unit.squeezes().len(), 2);
}

#[test]
fn energy_of_the_unit_is_conserved() {
    let mut unit = unit();
    run(&mut unit, [8e5, 3e5], 0.01, 8e-4);
    let (e, reference) = (unit.energies(), reference());
    let drives = e.pump + e.eccentric_motor;
    let lost = e.valves + e.friction + e.leakage_and_relief;
    assert!((drives - e.stored - lost - e.tines).abs() < 1e-4 * drives, "{e:?}");
    for (name, found) in [
        ("pump", e.pump),
        ("eccentric motor", e.eccentric_motor),
        ("stored", e.stored),
        ("valves", e.valves),
        ("friction", e.friction),
        ("leakage and relief", e.leakage_and_relief),
        ("tines", e.tines),
    ] {
        assert_close(&[found], &[reference["energies"][name].as_f64().unwrap()], name);
    }
}
