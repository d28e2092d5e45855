//! The scene of a run: a prepared bed with the tines above it.
//!
//! Reads: the plan, a bed. Writes: model and state at the start of the run.

use super::deposit::{Bed, top};
use super::mounting::put_on_mount;
use super::sleeper::sleeper_pose;
use super::tamping_cycle::start_position;
use super::tine::tine;
use crate::error::{Error, Result};
use crate::integrate;
use crate::math::{Pose, Vec3};
use crate::model::{DrivenBody, Model};
use crate::state::State;
use crate::track::plan::{Plan, SleeperPlan, TinePlan, apply_run_settings};
use std::sync::Arc;

/// The model of a run and its start: the bed, and the tines clear above it.
///
/// # Errors
/// A bed that was prepared for other sleepers than the plan's, that holds the tines already, or that
/// reaches up to them.
pub fn scene(plan: &Plan, bed: Bed) -> Result<(Model, State)> {
    let Bed { mut model, mut state, .. } = bed;
    for s in &plan.sleepers {
        let index = check_sleeper(plan, s, &model, &state)?;
        if let Some(mount) = s.mount {
            put_on_mount(&mut model, &mut state, index, mount);
        }
    }
    for t in &plan.tines {
        if model.driven_index(&t.name).is_some() {
            return Err(Error::Model {
                place: format!("tine {:?}", t.name),
                expected: "a name that no body of the bed has".into(),
                found: "a body of this name".into(),
            });
        }
        check_clear(t, start_position(plan, t), &model, &state)?;
        let body = tine(t, plan.bed.friction.tine, &mut model.shapes)?;
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

/// Refuses a tine whose blade starts among grains, `at` being the middle of its upper edge.
fn check_clear(tine: &TinePlan, at: Vec3, model: &Model, state: &State) -> Result<()> {
    let lower_edge = at.z - tine.blade.z;
    let beside = |p: &Vec3, radius: f64| {
        let (half, d) = (tine.blade * 0.5, p - at);
        d.x.abs() > half.x + radius || d.y.abs() > half.y + radius
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

/// The sleeper's place among the driven bodies.
fn check_sleeper(plan: &Plan, s: &SleeperPlan, model: &Model, state: &State) -> Result<usize> {
    let refused = |found: String| {
        Err(Error::Model {
            place: format!("sleeper {:?}", s.name),
            expected: "a bed that was prepared for it".into(),
            found,
        })
    };
    let Some(index) = model.driven_index(&s.name) else {
        return refused("no body of this name in the bed".into());
    };
    let found = state.position[model.grains.len() + index];
    let expected = sleeper_pose(plan, s).position;
    if (found - expected).norm() > 1e-6 {
        return refused(format!("it stands at {:?} m", found.as_slice()));
    }
    Ok(index)
}
