//! Traffic over a bed before the run: load cycles on the sleepers, which settle and compact the ballast.
//!
//! Reads: plan, bed under preparation. Writes: bed with the sleepers at their level, settlements. Cost: a step per step.
//! Contract: the same plan gives the same bytes. Afterwards the sleepers stand at the level of the plan; bed and floor are
//! moved up by the settlement.

use super::mounting::{put_on_mount, take_off_mount};
use super::settle::{BedBuilder, DepositProgress, DepositStage, Settling};
use super::sleeper::{sleeper_mount, sleeper_pose};
use super::tamping_cycle::check_load_cycles;
use crate::drive::{Load, StepInputs};
use crate::error::Result;
use crate::math::Vec3;
use crate::model::check::expect;
use crate::model::{DofMode, Model, Mount, Solver};
use crate::step::step;
use crate::track::motion_law::smooth_step;
use crate::track::plan::{Plan, SleeperPlan, TrafficPlan};
use std::ops::ControlFlow;

/// Duration in which sleepers that have settled differently are brought to one level, s.
const LEVELLING_DURATION: f64 = 0.1;
/// Name of the floor among the driven bodies.
const FLOOR: &str = super::boundary::BOUNDARY_NAMES[0];

/// Refuses traffic with numbers out of range, or without sleepers.
pub(super) fn check(plan: &Plan, traffic: &TrafficPlan) -> Result<()> {
    check_load_cycles(&traffic.load, "bed.traffic")?;
    let limit = traffic.settlement_limit;
    expect(limit >= 0.0, "bed.traffic.settlement_limit", "0 m or more", limit)?;
    expect(!plan.sleepers.is_empty(), "bed.traffic", "a bed with sleepers", "none")
}

/// Loads the sleepers through all cycles, or until a cycle settles them less than the limit. Adds the mean settlement at
/// the end of each cycle to `settlements` (m); returns whether a stop was requested. `solver` solves the steps.
pub(super) fn carry_traffic(
    plan: &Plan,
    traffic: &TrafficPlan,
    solver: Solver,
    builder: &mut BedBuilder,
    settlements: &mut Vec<f64>,
    watch: &mut dyn FnMut(&DepositProgress) -> ControlFlow<()>,
) -> Result<ControlFlow<()>> {
    // The floor may be on the subgrade; the sleepers stand behind it.
    let first = builder.model.mounted_count();
    for s in &plan.sleepers {
        let index = sleeper_index(&builder.model, s);
        put_on_mount(&mut builder.model, &mut builder.state, index, vertical_mount(s));
    }
    let h = plan.run.stepping.h();
    let steps = |duration: f64| (duration / h).round().max(1.0) as u64;
    let total = steps(traffic.load.duration());
    let settling = settling(plan, solver, total);
    builder.adopt(&settling);
    let targets = builder.state.imposed_poses(&builder.model);
    let start = mean_level(plan, builder);
    for done in 1..=total {
        let load = traffic.load.load((done as f64 - 0.5) * h);
        let load = Load { force: Vec3::new(0.0, 0.0, -load), torque: Vec3::zeros() };
        let mut loads = vec![load; builder.model.mounted_count()];
        loads[..first].fill(Load::zero());
        let inputs = StepInputs { loads: &loads, ..StepInputs::from_targets(&targets) };
        if advance(builder, &settling, done, &inputs, watch)?.is_break() {
            return Ok(ControlFlow::Break(()));
        }
        let cycles = settlements.len() as u32 + 1;
        if done == steps(f64::from(cycles) / traffic.load.frequency) {
            let before = settlements.last().copied().unwrap_or(0.0);
            let settlement = start - mean_level(plan, builder);
            settlements.push(settlement);
            if settlement - before < traffic.settlement_limit {
                break;
            }
        }
    }
    for _ in &plan.sleepers {
        take_off_mount(&mut builder.model, &mut builder.state, first);
    }
    if plan.sleepers.len() > 1 && level_sleepers(plan, solver, builder, watch)?.is_break() {
        return Ok(ControlFlow::Break(()));
    }
    raise(plan, builder);
    Ok(ControlFlow::Continue(()))
}

fn settling(plan: &Plan, solver: Solver, steps: u64) -> Settling {
    Settling {
        stage: DepositStage::Traffic,
        stepping: plan.run.stepping,
        solver,
        grain_friction: plan.bed.friction.grain,
        fall_speed: None,
        steps: [steps, steps],
        rest_speed: plan.bed.preparation.rest_speed,
    }
}

fn advance(
    builder: &mut BedBuilder,
    settling: &Settling,
    number: u64,
    inputs: &StepInputs<'_>,
    watch: &mut dyn FnMut(&DepositProgress) -> ControlFlow<()>,
) -> Result<ControlFlow<()>> {
    let BedBuilder { model, state, workspace, .. } = builder;
    let report = step(model, state, inputs, workspace, &mut ())?;
    let speed = builder.mean_speed();
    Ok(watch(&builder.progress(settling, number, speed, &report)))
}

/// Brings all sleepers to their mean level, as the rails do.
fn level_sleepers(
    plan: &Plan,
    solver: Solver,
    builder: &mut BedBuilder,
    watch: &mut dyn FnMut(&DepositProgress) -> ControlFlow<()>,
) -> Result<ControlFlow<()>> {
    let h = plan.run.stepping.h();
    let steps = (LEVELLING_DURATION / h).ceil().max(1.0) as u64;
    let settling = settling(plan, solver, steps);
    let (start, level) = (builder.state.imposed_poses(&builder.model), mean_level(plan, builder));
    let bodies: Vec<usize> =
        plan.sleepers.iter().map(|s| sleeper_index(&builder.model, s)).collect();
    for done in 1..=steps {
        let mut targets = start.clone();
        for &d in &bodies {
            let way = level - start[d].position.z;
            targets[d].position.z += way * smooth_step(done as f64 / steps as f64);
        }
        let inputs = StepInputs::from_targets(&targets);
        if advance(builder, &settling, done, &inputs, watch)?.is_break() {
            return Ok(ControlFlow::Break(()));
        }
    }
    Ok(ControlFlow::Continue(()))
}

/// Moves grains, sleepers and floor up together, so that the sleepers stand at the level of the plan.
fn raise(plan: &Plan, builder: &mut BedBuilder) {
    let rise = plan.bed.preparation.ballast_depth - mean_level(plan, builder);
    let ng = builder.model.grains.len();
    for s in &plan.sleepers {
        let b = ng + sleeper_index(&builder.model, s);
        builder.state.position[b] = sleeper_pose(plan, s).position;
        builder.state.velocity[b] = Vec3::zeros();
    }
    let floor = builder.model.driven_index(FLOOR).map(|d| ng + d);
    (0..ng).chain(floor).for_each(|b| builder.state.position[b].z += rise);
    builder.state.mount.iter_mut().for_each(|pose| pose.position.z += rise);
}

/// Mean level of the sleepers' undersides, m.
fn mean_level(plan: &Plan, builder: &BedBuilder) -> f64 {
    let ng = builder.model.grains.len();
    let level = |s| builder.state.position[ng + sleeper_index(&builder.model, s)].z;
    plan.sleepers.iter().map(level).sum::<f64>() / plan.sleepers.len() as f64
}

/// Index of a sleeper of the plan among the driven bodies of its bed.
fn sleeper_index(model: &Model, s: &SleeperPlan) -> usize {
    model.driven_index(&s.name).expect("a bed holds the sleepers of its plan")
}

/// Mount of a sleeper that loads move vertically, with the mass of its mount in the run, or that of concrete.
fn vertical_mount(s: &SleeperPlan) -> Mount {
    let of_concrete = || sleeper_mount(&s.blocks, None, [DofMode::Prescribed; 6]);
    s.mount.unwrap_or_else(of_concrete).free_vertically()
}

#[cfg(test)]
#[path = "traffic_tests.rs"]
mod tests;
