//! Preparing a bed: pour, settle, place the sleepers, fill the cribs, settle to rest.
//!
//! Reads: the plan. Writes: a bed: grains at rest, sleepers and boundaries. Cost: about a thousand
//! steps of few iterations.
//! Contract: the same plan gives the same bytes. Two grains never overlap when they are laid.
//!
//! 1. *pour*: grains are laid up to a little above the sleepers' underside, and fall together;
//! 2. *fill*: grains in the way of the sleepers are taken out, the voids that this leaves right
//!    under the blocks are stuffed, the sleepers are put in, and the cribs fill around them; where grains pack so densely
//!    that the bed lies low then, what lacks is laid and settles, too;
//! 3. *trim*: what lies above the fill level or sticks far out of it, or sits too deep in another
//!    grain, is taken off; friction becomes that of the run;
//! 4. *rest*: the run's own step.
//!
//! Stages 1 and 2 run with the low friction that makes beds dense, and with damped free fall.

use super::boundary::boundaries;
use super::clearance::SLACK;
use super::pour::{self, Laid, Templates};
use super::relief::Relief;
use super::scene::{run_settings, sleeper_pose};
use super::settle::{Bench, DepositProgress, DepositStage, Settling};
use super::sleeper::sleeper;
use crate::error::{Error, Result};
use crate::geometry::{AxisBox, Clipper, Polyhedron};
use crate::math::{Pose, Vec3};
use crate::model::{Grains, Model, Schedule, Solver, Stepping};
use crate::state::{EnergyLedger, State};
use crate::track::plan::Plan;
use crate::workspace::Workspace;
use rand::SeedableRng;
use rand_pcg::Pcg64;
use std::ops::ControlFlow;

/// Speed that damping lets falling grains reach, m/s: 1 mm per step of 1 ms. A step must gain less.
pub const FALL_SPEED: f64 = 1.0;
/// Compactness that poured volumes are reckoned with; rather too high, what is too much is trimmed. Broad gradings pack more
/// densely, and are topped up.
const RECKONED_COMPACTNESS: f64 = 0.62;
/// How far a bed may lie below its fill level in the mean, in mean grain sizes, before it is topped up.
const LOW: f64 = 0.5;
/// How often at most: each time lays what lacked to the level, and half a grain more.
const TOP_UPS: usize = 3;
/// A bed that lacks more than this share of what it lacked has not been filled by topping up: its cribs are too narrow.
const NO_FULLER: f64 = 0.8;
/// Steps before a pour may count as at rest: it starts from rest.
const LEAST_STEPS: u64 = 50;
/// Longest last stage, s: the bed is at rest already, only impulses have to settle.
const LAST_STAGE: f64 = 0.02;
/// Most grains of a bed, reckoned without voids.
pub const MOST_GRAINS: f64 = 2e7;
/// Deepest penetration left in a bed, in mean grain sizes: nothing in a run would push it out.
const DEEPEST: f64 = 0.05;
/// How far a grain may stick out of the fill level after trimming, in mean grain sizes.
pub const HIGHEST: f64 = 0.5;
/// Cap and tolerance of the last settling: the tolerance that is usual in this field.
const REST_ITERATIONS: u32 = 500;
const REST_TOLERANCE: f64 = 1.666e-4;
/// Overlap with a sleeper that counts as none, of the grain's volume.
const TOUCH: f64 = 1e-9;

/// A prepared bed: grains at rest, boundaries and sleepers, no tines.
#[derive(Debug, Clone, PartialEq)]
pub struct Bed {
    pub model: Model,
    pub state: State,
}

/// Prepares the bed of a plan; `None` if `watch`, called after each step, asks to stop.
///
/// # Errors
/// A plan that describes no bed, or a step that fails.
pub fn deposit(
    plan: &Plan,
    watch: &mut dyn FnMut(&DepositProgress) -> ControlFlow<()>,
) -> Result<Option<Bed>> {
    check(plan)?;
    let mut rng = Pcg64::seed_from_u64(plan.bed.seed);
    let mut bench = empty_box(plan)?;
    let templates = Templates::generate(&plan.bed, &mut rng, &mut bench.model.shapes)?;
    check_count(plan, templates.mean_volume(&bench.model.shapes))?;
    let mut site = Site { plan, templates, rng, bench, watch };
    for stage in [Site::pour_below, Site::fill_cribs, Site::top_up, Site::trim, Site::rest] {
        if stage(&mut site)?.is_break() {
            return Ok(None);
        }
    }
    let Bench { model, mut state, .. } = site.bench;
    state.step = 0;
    state.time_ns = 0;
    state.energy = EnergyLedger::default();
    Ok(Some(Bed { model, state }))
}

/// The bed without its stones: what is known of the other bodies before anything is poured.
///
/// # Errors
/// As for a plan that describes no bed.
pub fn bare(plan: &Plan) -> Result<Bed> {
    check(plan)?;
    let mut bench = empty_box(plan)?;
    place_sleepers(plan, &mut bench)?;
    Ok(Bed { model: bench.model, state: bench.state })
}

/// A bed in the making.
struct Site<'a> {
    plan: &'a Plan,
    templates: Templates,
    rng: Pcg64,
    bench: Bench,
    watch: &'a mut dyn FnMut(&DepositProgress) -> ControlFlow<()>,
}

/// The stages; each tells whether it was asked to stop.
impl Site<'_> {
    /// Stage 1: the bed below the sleepers.
    fn pour_below(&mut self) -> Result<ControlFlow<()>> {
        let (plan, bed) = (self.plan, &self.plan.bed);
        let largest = bed.grains.classes.iter().map(|c| c.size).fold(0.0, f64::max);
        let level = if plan.sleepers.is_empty() {
            bed.preparation.fill_level
        } else {
            (bed.preparation.ballast_depth + 0.5 * largest).min(bed.preparation.fill_level)
        };
        let volume = RECKONED_COMPACTNESS * bed.size.x * bed.size.y * level;
        let mut relief = pour::relief(bed)?;
        let (shapes, size) = (&self.bench.model.shapes, &bed.size);
        let laid = pour::pour(&mut relief, &self.templates, shapes, size, volume, &mut self.rng)?;
        self.insert(&laid);
        self.settle(&pouring(plan, DepositStage::Pour))
    }

    /// Stage 2: the sleepers, and the cribs around them.
    fn fill_cribs(&mut self) -> Result<ControlFlow<()>> {
        let plan = self.plan;
        if plan.sleepers.is_empty() {
            return Ok(ControlFlow::Continue(()));
        }
        make_room(plan, &mut self.bench, plan.bed.preparation.ballast_depth);
        place_sleepers(plan, &mut self.bench)?;
        let laid = self.lay_cribs()?;
        self.insert(&laid);
        self.settle(&pouring(plan, DepositStage::Fill))
    }

    /// Stage 2, gone on with: what lacks to the fill level.
    fn top_up(&mut self) -> Result<ControlFlow<()>> {
        let (plan, bed) = (self.plan, &self.plan.bed);
        let (level, mean_size) = (bed.preparation.fill_level, bed.grains.mean_size());
        let mut before = f64::INFINITY;
        for _ in 0..TOP_UPS {
            let mut relief = present_relief(plan, &self.bench)?;
            block_boxes(plan).for_each(|block| keep_clear(&mut relief, &block));
            let [lacking, area] = relief.lacking(level);
            if lacking <= LOW * mean_size * area || lacking > NO_FULLER * before {
                break;
            }
            before = lacking;
            let volume = RECKONED_COMPACTNESS * (lacking + 0.5 * mean_size * area);
            let laid = self.lay_where_it_fits(&mut relief, volume);
            self.insert(&laid);
            let settled = self.settle(&pouring(plan, DepositStage::Fill))?;
            if settled.is_break() {
                return Ok(settled);
            }
        }
        Ok(ControlFlow::Continue(()))
    }

    /// Stage 3: the fill level, and the friction of the run.
    fn trim(&mut self) -> Result<ControlFlow<()>> {
        let (plan, bench) = (self.plan, &mut self.bench);
        let level = plan.bed.preparation.fill_level;
        let mean_size = plan.bed.grains.mean_size();
        let (grains, state, shapes) = (&bench.model.grains, &bench.state, &bench.model.shapes);
        let top = |g: usize| top(&shapes[grains.shape[g] as usize], &state.pose(g));
        let within =
            |g: usize| state.position[g].z <= level && top(g) <= level + HIGHEST * mean_size;
        let mut keep: Vec<bool> = (0..grains.len()).map(within).collect();
        bench.deny_deep(DEEPEST * mean_size, &mut keep);
        bench.retain(&keep);
        run_settings(plan, &mut bench.model);
        let mut settling = pouring(plan, DepositStage::Trim);
        settling.grain_friction = plan.bed.friction.grain;
        self.settle(&settling)
    }

    /// Stage 4: the run's time step.
    fn rest(&mut self) -> Result<ControlFlow<()>> {
        let plan = self.plan;
        let most = (LAST_STAGE / plan.run.stepping.h()).ceil() as u64;
        self.settle(&Settling {
            stage: DepositStage::Rest,
            stepping: plan.run.stepping,
            solver: solver(REST_ITERATIONS, Some(REST_TOLERANCE)),
            grain_friction: plan.bed.friction.grain,
            fall_speed: None,
            steps: [most.min(10), most],
            rest_speed: plan.bed.preparation.rest_speed,
        })
    }

    fn settle(&mut self, settling: &Settling) -> Result<ControlFlow<()>> {
        self.bench.settle(settling, self.watch)
    }

    fn insert(&mut self, laid: &[Laid]) {
        let grains: Vec<(u32, Pose)> = laid.iter().map(|g| (g.shape as u32, g.pose)).collect();
        self.bench.insert(&grains, self.plan.bed.density);
    }

    /// Lays about this volume (m³) where grains fit.
    fn lay_where_it_fits(&mut self, relief: &mut Relief, volume: f64) -> Vec<Laid> {
        let (shapes, size) = (&self.bench.model.shapes, &self.plan.bed.size);
        pour::pour_where_it_fits(relief, &self.templates, shapes, size, volume, &mut self.rng)
    }

    /// Lays what lacks under the blocks, and in the cribs up to the fill level, where grains fit into them.
    fn lay_cribs(&mut self) -> Result<Vec<Laid>> {
        let (plan, bed) = (self.plan, &self.plan.bed);
        let mut relief = present_relief(plan, &self.bench)?;
        let (grains, shapes) = (&self.bench.model.grains, &self.bench.model.shapes);
        let mut laid = Vec::new();
        for block in block_boxes(plan) {
            let (templates, rng) = (&self.templates, &mut self.rng);
            laid.extend(pour::stuff(&mut relief, templates, shapes, &block, rng));
        }
        block_boxes(plan).for_each(|block| keep_clear(&mut relief, &block));
        let filled = bed.preparation.fill_level;
        let occupied: f64 = block_boxes(plan)
            .map(|b| AxisBox { high: Vec3::new(b.high.x, b.high.y, b.high.z.min(filled)), ..b })
            .map(|b| b.volume())
            .sum();
        let room = bed.size.x * bed.size.y * filled - occupied;
        let present: f64 = grains.shape.iter().map(|shape| shapes[*shape as usize].volume).sum();
        let added: f64 = laid.iter().map(|g| shapes[g.shape].volume).sum();
        let lacking = RECKONED_COMPACTNESS * room - present - added;
        laid.extend(self.lay_where_it_fits(&mut relief, lacking));
        Ok(laid)
    }
}

/// The settings of the damped stages.
fn pouring(plan: &Plan, stage: DepositStage) -> Settling {
    let preparation = &plan.bed.preparation;
    let h = pouring_h(plan);
    Settling {
        stage,
        stepping: Stepping {
            step_ns: preparation.step_ns,
            theta: plan.run.stepping.theta,
            detection_distance: Stepping::default_detection_distance(preparation.step_ns),
        },
        solver: solver(preparation.iterations, None),
        grain_friction: preparation.friction,
        fall_speed: Some(FALL_SPEED),
        steps: [LEAST_STEPS, (preparation.max_settling / h).ceil().max(1.0) as u64],
        rest_speed: preparation.rest_speed,
    }
}

/// The solver of the preparation. It is not the run's: one bed serves runs of all solvers, and an
/// asynchronous one would prepare another bed each time.
fn solver(iterations: u32, tolerance: Option<f64>) -> Solver {
    Solver {
        schedule: Schedule::Synchronous,
        max_iterations: iterations,
        tolerance,
        convergence_check_interval: 10,
        ..Solver::default()
    }
}

fn pouring_h(plan: &Plan) -> f64 {
    plan.bed.preparation.step_ns as f64 * 1e-9
}

fn empty_box(plan: &Plan) -> Result<Bench> {
    let low = plan.bed.friction.boundary.min(plan.bed.preparation.friction);
    let driven = boundaries(&plan.bed.size, low);
    let mut state = State::default();
    driven.iter().for_each(|_| state.push(Pose::identity()));
    let model = Model {
        shapes: Vec::new(),
        grains: Grains::default(),
        driven,
        gravity: Vec3::new(0.0, 0.0, -plan.bed.gravity),
        grain_friction: plan.bed.preparation.friction,
        restitution: plan.run.restitution,
        stepping: plan.run.stepping,
        solver: plan.run.solver,
    };
    Ok(Bench { model, state, workspace: Workspace::default() })
}

fn place_sleepers(plan: &Plan, bench: &mut Bench) -> Result<()> {
    let friction = plan.bed.friction.sleeper.min(plan.bed.preparation.friction);
    for s in &plan.sleepers {
        let body = sleeper(s, friction, &mut bench.model.shapes)?;
        bench.model.driven.push(body);
        bench.state.push(sleeper_pose(plan, s));
    }
    Ok(())
}

/// Takes out the grains that reach into the sleepers' columns above `level`.
fn make_room(plan: &Plan, bench: &mut Bench, level: f64) {
    let columns: Vec<AxisBox> = block_boxes(plan)
        .map(|b| AxisBox {
            low: Vec3::new(b.low.x, b.low.y, level),
            high: Vec3::new(b.high.x, b.high.y, f64::MAX),
        })
        .collect();
    let mut clipper = Clipper::default();
    let (grains, state, shapes) = (&bench.model.grains, &bench.state, &bench.model.shapes);
    let keep: Vec<bool> = (0..grains.len())
        .map(|g| {
            let shape = &shapes[grains.shape[g] as usize];
            !columns.iter().any(|c| overlaps(&mut clipper, shape, &state.pose(g), c))
        })
        .collect();
    bench.retain(&keep);
}

/// Height of a grain's highest point, m.
pub(super) fn top(shape: &Polyhedron, pose: &Pose) -> f64 {
    shape.vertices.iter().map(|v| pose.point(v).z).fold(f64::NEG_INFINITY, f64::max)
}

fn overlaps(clipper: &mut Clipper, shape: &Polyhedron, pose: &Pose, region: &AxisBox) -> bool {
    let p = pose.position;
    let apart =
        (0..3).any(|k| p[k] + shape.radius < region.low[k] || p[k] - shape.radius > region.high[k]);
    !apart && clipper.volume_inside(shape, pose, &region.half_spaces()) > TOUCH * shape.volume
}

/// The relief of the grains that are there.
fn present_relief(plan: &Plan, bench: &Bench) -> Result<Relief> {
    let mut relief = pour::relief(&plan.bed)?;
    let (grains, shapes) = (&bench.model.grains, &bench.model.shapes);
    let shape = |g: usize| &shapes[grains.shape[g] as usize];
    let present = (0..grains.len()).map(|g| (shape(g), bench.state.pose(g)));
    pour::cover_present(&mut relief, present);
    Ok(relief)
}

/// Nothing is laid upon a block.
fn keep_clear(relief: &mut Relief, block: &AxisBox) {
    relief.forbid([block.low.x, block.low.y], [block.high.x, block.high.y]);
}

/// The blocks of all sleepers at their level, world.
pub(super) fn block_boxes(plan: &Plan) -> impl Iterator<Item = AxisBox> + '_ {
    let depth = plan.bed.preparation.ballast_depth;
    plan.sleepers.iter().flat_map(move |s| {
        s.blocks.iter().map(move |b| {
            let middle = Vec3::new(s.centre[0], s.centre[1] + b.offset_y, depth);
            let half = Vec3::new(0.5 * b.size.x, 0.5 * b.size.y, 0.0);
            AxisBox { low: middle - half, high: middle + half + Vec3::z() * b.size.z }
        })
    })
}

fn check(plan: &Plan) -> Result<()> {
    let refused = |place: &str, expected: &str, found: String| {
        Err(Error::Model { place: place.into(), expected: expected.into(), found })
    };
    let bed = &plan.bed;
    let p = &bed.preparation;
    if !bed.size.iter().all(|s| s.is_finite() && *s > 0.0) {
        return refused(
            "bed.size",
            "three lengths above 0 m",
            format!("{:?}", bed.size.as_slice()),
        );
    }
    if !(p.ballast_depth > 0.0 && p.ballast_depth <= p.fill_level && p.fill_level.is_finite()) {
        return refused(
            "bed.preparation",
            "0 < ballast_depth <= fill_level",
            format!("{} m and {} m", p.ballast_depth, p.fill_level),
        );
    }
    if p.step_ns == 0 || plan.run.stepping.step_ns == 0 {
        return refused("step", "more than 0 s", "0".into());
    }
    if !(bed.gravity * pouring_h(plan) < FALL_SPEED) {
        return refused(
            "bed.preparation.step",
            &format!("a step in which free fall gains less than {FALL_SPEED} m/s"),
            format!("{} s", pouring_h(plan)),
        );
    }
    for block in block_boxes(plan) {
        let inside = (0..2).all(|k| block.low[k] >= -SLACK && block.high[k] <= bed.size[k] + SLACK);
        if !inside {
            let found = format!("from {:?} to {:?} m", block.low.as_slice(), block.high.as_slice());
            return refused("sleepers", "blocks inside the box of the bed", found);
        }
    }
    Ok(())
}

fn check_count(plan: &Plan, mean_volume: f64) -> Result<()> {
    let bed = &plan.bed;
    let count = bed.size.x * bed.size.y * bed.preparation.fill_level / mean_volume;
    if count <= MOST_GRAINS {
        return Ok(());
    }
    Err(Error::Model {
        place: "bed".into(),
        expected: format!("at most {MOST_GRAINS} grains"),
        found: format!("about {count:.0}"),
    })
}

#[cfg(test)]
#[path = "deposit_tests.rs"]
mod tests;
