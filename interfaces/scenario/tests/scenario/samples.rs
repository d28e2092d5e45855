//! Neutral samples: conversion in both directions, and errors of broken ones.

use ballast::math::Vec3;
use ballast::model::{ContactStiffness, DrivenBody, Norm, Part, Role, Schedule};
use ballast_scenario::sample::{self, Sample, SampleError};
use serde_json::{Value, json};

const EIGHT: &str = include_str!("../data/eight_grains.json");

fn eight() -> Sample {
    sample::read(EIGHT, "eight.json").unwrap_or_else(|e| panic!("{e}"))
}

/// The sample with the value at a JSON pointer replaced.
fn changed(pointer: &str, value: Value) -> String {
    let mut json: Value = serde_json::from_str(EIGHT).unwrap();
    *json.pointer_mut(pointer).expect(pointer) = value;
    json.to_string()
}

fn refused(text: &str) -> SampleError {
    sample::read(text, "broken.json").expect_err("a broken sample")
}

#[test]
fn a_sample_becomes_model_and_state() {
    let Sample { model, state, steps, meta } = eight();
    model.check().unwrap();
    assert_eq!((model.grains.len(), model.driven.len()), (8, 5));
    assert_eq!((steps, model.stepping.step_ns), (50, 1_000_000));
    assert_eq!((model.grain_friction, model.driven[0].friction), (1.0, 0.8));
    assert_eq!(model.driven[0].name, "floor");
    assert!(model.driven.iter().all(|d| d.role == Role::Boundary));
    assert_eq!(model.solver.schedule, Schedule::Sequential);
    assert_eq!((model.solver.max_iterations, model.solver.tolerance), (100, None));
    assert_eq!(model.solver.norm, Norm::Quad);
    assert_eq!(meta["seed"], 7);
    assert_eq!(state.position.len(), 13);
    for b in 0..13 {
        assert!(state.pose(b).is_sound());
    }
}

/// Vertices of a grain in world axes, sorted.
fn corners(sample: &Sample, i: usize) -> Vec<Vec3> {
    let shape = &sample.model.shapes[sample.model.grains.shape[i] as usize];
    let mut corners: Vec<Vec3> =
        shape.vertices.iter().map(|v| sample.state.pose(i).point(v)).collect();
    corners.sort_by(|a, b| a.x.total_cmp(&b.x));
    corners
}

#[test]
fn grains_lie_where_the_file_says_in_their_principal_frames() {
    let sample = eight();
    let json: Value = serde_json::from_str(EIGHT).unwrap();
    for i in 0..8 {
        let grain = &json["grains"][i];
        let number = |v: &Value| v.as_f64().unwrap();
        let vector = |v: &Value| Vec3::new(number(&v[0]), number(&v[1]), number(&v[2]));
        let [w, x, y, z] = [0, 1, 2, 3].map(|k| number(&grain["quaternion"][k]));
        // The rotation of a vector by a quaternion, written out.
        let q = Vec3::new(x, y, z);
        let turn = |v: Vec3| v + 2.0 * q.cross(&(q.cross(&v) + w * v));
        let mut expected: Vec<Vec3> = grain["vertices"]
            .as_array()
            .unwrap()
            .iter()
            .map(|v| vector(&grain["position"]) + turn(vector(v)))
            .collect();
        expected.sort_by(|a, b| a.x.total_cmp(&b.x));
        let found = corners(&sample, i);
        assert_eq!(found.len(), expected.len(), "grain {i}");
        for (a, b) in found.iter().zip(&expected) {
            assert!((a - b).norm() < 1e-12, "grain {i}: {a} {b}");
        }
    }
}

#[test]
fn writing_and_reading_again_gives_the_same_bodies() {
    let mut first = eight();
    for i in 0..8 {
        first.state.velocity[i] = Vec3::new(0.1, -0.2, i as f64);
        first.state.angular_velocity[i] = Vec3::new(1.0, 2.0, -3.0);
    }
    first.state.step = 3;
    first.state.time_ns = 3_000_000;
    let text = sample::write(&first.model, &first.state, first.steps, &first.meta);
    let second = sample::read(&text, "again.json").unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(second.meta["state_after"], "Ballast, 3 steps, 0.003 s");
    assert_eq!(second.meta["box"], first.meta["box"]);
    assert_eq!(second.model.solver, first.model.solver);
    assert_eq!(second.model.stepping, first.model.stepping);
    for i in 0..8 {
        let (m, n) = (first.model.grains.mass[i], second.model.grains.mass[i]);
        assert!((m - n).abs() < 1e-12 * m, "{m} {n}");
        let (v, w) = (first.state.velocity[i], second.state.velocity[i]);
        assert!((v - w).norm() < 1e-12, "{v} {w}");
        assert!((first.state.angular_velocity[i] - second.state.angular_velocity[i]).norm() == 0.0);
        for (a, b) in corners(&first, i).iter().zip(&corners(&second, i)) {
            assert!((a - b).norm() < 1e-12, "{a} {b}");
        }
    }
}

#[test]
fn half_spaces_are_written_as_blocks_below_their_plane() {
    let Sample { mut model, mut state, steps, meta } = eight();
    model.driven.push(DrivenBody {
        name: "slope".into(),
        role: Role::Boundary,
        friction: 0.8,
        stiffness: ContactStiffness::RIGID,
        parts: vec![Part::HalfSpace { normal: Vec3::new(0.6, 0.0, 0.8), offset: 0.25 }],
        mount: None,
    });
    state.push(ballast::math::Pose::at(Vec3::new(0.0, 0.0, -1.0)));
    let text = sample::write(&model, &state, steps, &meta);
    let again = sample::read(&text, "again.json").unwrap_or_else(|e| panic!("{e}"));
    let Part::Convex { shape, pose } = again.model.driven[5].parts[0] else { panic!() };
    let body = again.state.pose(13);
    let heights: Vec<f64> = again.model.shapes[shape as usize]
        .vertices
        .iter()
        .map(|v| body.point(&pose.point(v)) + Vec3::z())
        .map(|p| p.dot(&Vec3::new(0.6, 0.0, 0.8)))
        .collect();
    let top = heights.iter().fold(f64::MIN, |a, b| a.max(*b));
    assert!((top - 0.25).abs() < 1e-12, "{top}");
    assert_eq!(heights.iter().filter(|h| (*h - top).abs() < 1e-9).count(), 4);
}

#[test]
fn a_tolerance_is_used_if_the_number_of_sweeps_is_null() {
    let mut json: Value = serde_json::from_str(EIGHT).unwrap();
    json["solver"] = json!({ "iterations": null, "tolerance": 1e-4, "max_iterations": 500,
        "check_every": 5, "relax": 0.9, "norm": "QM/16" });
    let solver = sample::read(&json.to_string(), "s").unwrap().model.solver;
    assert_eq!((solver.max_iterations, solver.tolerance), (500, Some(1e-4)));
    assert_eq!(
        (solver.convergence_check_interval, solver.relaxation, solver.norm),
        (5, 0.9, Norm::Qm16)
    );
}

#[test]
fn invalid_values_are_reported_with_their_path() {
    let flat = json!([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]]);
    let many = Value::from(vec![json!([0.0, 0.0, 0.0]); 1001]);
    for (pointer, value, path, words) in [
        ("/format", json!("nscd-sample-2"), "format", "nscd-sample-1"),
        ("/gravity", json!([0, 0]), "gravity", "3"),
        ("/gravity/2", Value::Null, "gravity[2]", "null"),
        ("/dt", json!("1 ms"), "dt", "string"),
        ("/dt", json!(1.5e-9), "dt", "whole number of nanoseconds"),
        ("/dt", json!(0), "dt", "whole number of nanoseconds"),
        ("/theta", json!(0.3), "theta", "0.5 to 1"),
        ("/steps", json!(-1), "steps", "-1"),
        ("/alert", json!(0), "alert", "above 0"),
        ("/friction/grain_wall", json!(-0.1), "friction.grain_wall", "0 or more"),
        ("/restitution", json!(1.5), "restitution", "0 to 1"),
        ("/solver/iterations", Value::Null, "solver.iterations", "tolerance"),
        ("/solver/iterations", json!(0), "solver.iterations", "1 or more"),
        ("/solver/relax", json!(0), "solver.relax", "above 0"),
        ("/solver/norm", json!("Maxm"), "solver.norm", "Quad"),
        ("/grains/3/density", json!(-1), "grains[3].density", "above 0"),
        ("/grains/3/quaternion", json!([0, 0, 0, 0]), "grains[3].quaternion", "norm 1"),
        ("/grains/3/vertices", flat, "grains[3].vertices", "flat"),
        ("/grains/3/vertices", json!([]), "grains[3].vertices", "4 to 1000"),
        ("/grains/3/vertices", many, "grains[3].vertices", "1001"),
        ("/grains/3/vertices/2/1", json!(1e300), "grains[3].vertices[2]", "1e6"),
        ("/grains/3/velocity", json!([0, 0, 1e9]), "grains[3].velocity", "1e6"),
        ("/fixed/1/name", json!("floor"), "fixed[1].name", "unique"),
        ("/fixed", json!({}), "fixed", "a sequence"),
    ] {
        let error = refused(&changed(pointer, value.clone()));
        assert_eq!(error.path, path, "{pointer} = {value}: {error}");
        assert!(error.to_string().contains(words), "{pointer}: no {words:?} in {error}");
        assert!(error.to_string().starts_with("broken.json"), "{error}");
    }
}

#[test]
fn missing_unknown_and_unreadable_values_are_reported_with_their_line() {
    let missing = EIGHT.replace("\"alert\"", "\"alarm\"");
    let error = refused(&missing);
    assert!(error.to_string().contains("alarm"), "{error}");
    assert!(error.line >= 1, "{error}");
    let huge = EIGHT.replace("\"alert\": 0.001", "\"alert\": 1e999");
    assert_ne!(huge, EIGHT);
    assert!(refused(&huge).to_string().contains("number out of range"), "{}", refused(&huge));
    let cut = &EIGHT[..EIGHT.len() / 2];
    assert!(refused(cut).to_string().contains("EOF"), "{}", refused(cut));
    let mut json: Value = serde_json::from_str(EIGHT).unwrap();
    json.as_object_mut().unwrap().remove("gravity");
    assert!(refused(&json.to_string()).to_string().contains("missing field `gravity`"));
    assert!(refused(&format!("{EIGHT}x")).to_string().contains("trailing"));
}
