//! Conversion of model and state to the JSON of a sample.

use super::file::{FORMAT, SampleFile, SampleFixedBody, SampleFriction, SampleGrain, SampleSolver};
use ballast::math::{Pose, Vec3, frame};
use ballast::model::{Model, Part};
use ballast::state::State;
use serde_json::{Value, json};

/// Half the edge length of the block that replaces a half-space, m: larger than any bed.
const HALF_EDGE: f64 = 10.0;

/// Returns the text of a sample of `model` in `state`, to be run for `steps` more steps, with `meta` and a note of the state.
///
/// Each part of a driven body becomes a fixed body with the friction of the first one; half-spaces
/// become large blocks. Vertices are written in principal frames, so reading the text again gives the
/// same bodies up to rounding.
pub fn write(model: &Model, state: &State, steps: u64, meta: &Value) -> String {
    let (iterations, tolerance) = match model.solver.tolerance {
        Some(tolerance) => (None, Some(tolerance)),
        None => (Some(model.solver.max_iterations), None),
    };
    let file = SampleFile {
        format: FORMAT.into(),
        gravity: model.gravity.into(),
        dt: model.stepping.h(),
        theta: model.stepping.theta,
        steps,
        alert: model.stepping.detection_distance,
        friction: SampleFriction {
            grain_grain: model.grain_friction,
            grain_wall: model.driven.first().map_or(model.grain_friction, |d| d.friction),
        },
        restitution: model.restitution,
        solver: SampleSolver {
            iterations,
            tolerance,
            max_iterations: model.solver.max_iterations,
            check_every: model.solver.convergence_check_interval,
            relax: model.solver.relaxation,
            norm: model.solver.norm,
        },
        grains: (0..model.grains.len()).map(|i| grain(model, state, i)).collect(),
        fixed: fixed(model, state),
        meta: with_time(meta, state),
    };
    // Numbers and texts always have a JSON form.
    serde_json::to_string(&file).unwrap_or_default()
}

fn with_time(meta: &Value, state: &State) -> Value {
    let mut meta = match meta {
        Value::Object(map) => map.clone(),
        Value::Null => serde_json::Map::new(),
        other => serde_json::Map::from_iter([("meta".to_string(), other.clone())]),
    };
    let after = format!("Ballast, {} steps, {} s", state.step, state.time());
    meta.insert("state_after".into(), json!(after));
    Value::Object(meta)
}

fn grain(model: &Model, state: &State, i: usize) -> SampleGrain {
    let shape = &model.shapes[model.grains.shape[i] as usize];
    let pose = state.pose(i);
    SampleGrain {
        vertices: shape.vertices.iter().map(|v| (*v).into()).collect(),
        position: pose.position.into(),
        quaternion: quaternion(&pose),
        density: model.grains.mass[i] / shape.volume,
        velocity: state.velocity[i].into(),
        omega: state.angular_velocity[i].into(),
    }
}

fn quaternion(pose: &Pose) -> [f64; 4] {
    let q = pose.orientation;
    [q.w, q.i, q.j, q.k]
}

fn fixed(model: &Model, state: &State) -> Vec<SampleFixedBody> {
    let mut fixed = Vec::new();
    for (d, body) in model.driven.iter().enumerate() {
        let pose = state.pose(model.grains.len() + d);
        for (k, part) in body.parts.iter().enumerate() {
            let vertices: Vec<Vec3> = match part {
                Part::Convex { shape, pose } => {
                    let shape = &model.shapes[*shape as usize];
                    shape.vertices.iter().map(|v| pose.point(v)).collect()
                }
                Part::HalfSpace { normal, offset } => block_below(normal, *offset),
            };
            let name = match body.parts.len() {
                1 => body.name.clone(),
                _ => format!("{}/{}", body.name, k + 1),
            };
            fixed.push(SampleFixedBody {
                name: Some(name),
                vertices: vertices.into_iter().map(Into::into).collect(),
                position: pose.position.into(),
                quaternion: quaternion(&pose),
            });
        }
    }
    fixed
}

/// Returns the vertices of the block whose upper face is the plane `normal · x = offset`.
fn block_below(normal: &Vec3, offset: f64) -> Vec<Vec3> {
    let (t, s) = frame::tangents(normal);
    let middle = normal * offset;
    let corner = |i: usize| {
        let side = |bit: usize| if i >> bit & 1 == 0 { -HALF_EDGE } else { HALF_EDGE };
        let depth = if i & 1 == 0 { -HALF_EDGE } else { 0.0 };
        middle + normal * depth + t * side(1) + s * side(2)
    };
    (0..8).map(corner).collect()
}
