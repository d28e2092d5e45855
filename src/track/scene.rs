//! The scene of a run: a prepared bed with its plates, and the tines above it.
//!
//! Reads: the plan, a bed. Writes: model and state at the start of the run.

use super::deposit::{Bed, top};
use super::mounting::put_on_mount;
use super::plate;
use super::sleeper::sleeper_pose;
use super::tamping_cycle::start_position;
use super::tine::tine;
use crate::error::{Error, Result};
use crate::geometry::AxisBox;
use crate::integrate;
use crate::math::{Pose, Vec3};
use crate::model::{DrivenBody, Model};
use crate::state::State;
use crate::track::plan::{Plan, TinePlan, apply_run_settings};
use std::sync::Arc;

/// The model of a run and its start: the bed, plates in it or on it, and the tines clear above it.
///
/// # Errors
/// A bed that was prepared for other sleepers or plates than the plan's, that holds the tines already, or that
/// reaches up to them; plates that start in grains or other bodies.
pub fn scene(plan: &Plan, bed: Bed) -> Result<(Model, State)> {
    let Bed { mut model, mut state, .. } = bed;
    for s in &plan.sleepers {
        let place = (format!("sleeper {:?}", s.name), &s.name[..], sleeper_pose(plan, s).position);
        let index = check_standing(place, &model, &state)?;
        if let Some(mount) = s.mount {
            put_on_mount(&mut model, &mut state, index, mount);
        }
    }
    for p in plan.plates.iter().filter(|p| p.in_preparation) {
        let place = (format!("plate {:?}", p.name), &p.name[..], plate::planned_position(p));
        let index = check_standing(place, &model, &state)?;
        plate::check_bodies(p, plate::planned_position(p), &model, &state)?;
        if let Some(mount) = p.mount {
            put_on_mount(&mut model, &mut state, index, mount);
        }
    }
    for p in plan.plates.iter().filter(|p| !p.in_preparation) {
        check_new(&format!("plate {:?}", p.name), &p.name, &model)?;
        let pose = plate::start_pose(p, plan.bed.preparation.fill_level, &model, &state)?;
        let body = plate::plate(p, p.friction, &mut model.shapes)?;
        add(&mut model, &mut state, DrivenBody { mount: p.mount, ..body }, pose);
    }
    for t in &plan.tines {
        check_new(&format!("tine {:?}", t.name), &t.name, &model)?;
        let body = tine(t, plan.bed.friction.tine, &mut model.shapes)?;
        check_clear(t, start_position(plan, t), &model, &state)?;
        add(&mut model, &mut state, body, Pose::at(start_position(plan, t)));
    }
    apply_run_settings(plan, &mut model);
    state.step = 0;
    state.time_ns = 0;
    state.window = Arc::default();
    state.driver = Arc::default();
    state.energy = integrate::open_ledger(&model, &state);
    Ok((model, state))
}

/// Adds a driven body at rest: behind all others, or behind the other mounted ones.
fn add(model: &mut Model, state: &mut State, body: DrivenBody, pose: Pose) {
    if body.mount.is_none() {
        model.driven.push(body);
        state.push(pose);
        return;
    }
    let (d, b) = (model.mounted_count(), model.mobile_count());
    model.driven.insert(d, body);
    state.position.insert(b, pose.position);
    state.orientation.insert(b, pose.orientation);
    state.velocity.insert(b, Vec3::zeros());
    state.angular_velocity.insert(b, Vec3::zeros());
    state.mount.push(pose);
    state.contacts.renumber(|other| other + usize::from(other >= b));
}

/// Refuses a tine whose blade starts among grains, with its reference point at `at`.
fn check_clear(tine: &TinePlan, at: Vec3, model: &Model, state: &State) -> Result<()> {
    let AxisBox { low, high } = tine.blade_bounds();
    let lower_edge = at.z + low.z;
    let beside = |p: &Vec3, radius: f64| {
        let d = p - at;
        (0..2).any(|k| d[k] < low[k] - radius || d[k] > high[k] + radius)
    };
    let tops = (0..model.grains.len()).filter_map(|g| {
        let shape = &model.shapes[model.grains.shape[g] as usize];
        let pose = state.pose(g);
        (!beside(&pose.position, shape.radius)).then(|| top(shape, &pose))
    });
    let highest = tops.fold(f64::NEG_INFINITY, f64::max);
    if highest < lower_edge {
        return Ok(());
    }
    Err(Error::Model {
        place: format!("start of tine {:?}", tine.name),
        expected: format!(
            "a clearance that keeps its lower edge above the grains ({highest:.4} m)"
        ),
        found: format!("lower edge at {lower_edge:.4} m"),
    })
}

/// Refuses a body whose name the bed has already.
fn check_new(place: &str, name: &str, model: &Model) -> Result<()> {
    if model.driven_index(name).is_none() {
        return Ok(());
    }
    Err(Error::Model {
        place: place.into(),
        expected: "a name that no body of the bed has".into(),
        found: "a body of this name".into(),
    })
}

/// Number among the driven bodies of a body of the bed, given by its kind and name, its name and its position (m).
fn check_standing(
    (place, name, expected): (String, &str, Vec3),
    model: &Model,
    state: &State,
) -> Result<usize> {
    let refused = |found: String| {
        let expected = "a bed that was prepared for it".into();
        Err(Error::Model { place, expected, found })
    };
    let Some(index) = model.driven_index(name) else {
        return refused("no body of this name in the bed".into());
    };
    let found = state.position[model.grains.len() + index];
    if (found - expected).norm() > 1e-6 {
        return refused(format!("it stands at {:?} m", found.as_slice()));
    }
    Ok(index)
}
