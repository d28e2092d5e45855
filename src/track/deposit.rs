//! Preparing a bed: pour, settle, place the sleepers, fill the cribs, settle to rest.
//!
//! Reads: the plan. Writes: a bed: grains at rest, sleepers and boundaries. Cost: about a thousand
//! steps of few iterations.
//! Contract: the same plan gives the same bytes. Two grains never overlap when they are laid. Plates of the preparation stand
//! in the box from the start, and no grain is laid below or above them.
//!
//! 1. *pour*: grains are laid up to a little above the sleepers' underside, and fall together;
//! 2. *fill*: grains in the way of the sleepers are taken out, the voids that this leaves right
//!    under the blocks are stuffed, the sleepers are put in, and the cribs fill around them; where grains pack so densely
//!    that the bed lies low then, what lacks is laid and settles, too;
//! 3. *trim*: what lies above the fill level or sticks far out of it, or sits too deep in another
//!    grain, is taken off; friction becomes that of the run;
//! 4. *traffic*, where the plan has some: load cycles on the sleepers; bed and floor are moved up by the settlement;
//! 5. *refill* after the traffic: the cribs are filled up again with the friction of the run;
//! 6. *rest*: the run's own step.
//!
//! Stages 1 and 2 run with the low friction that makes beds dense, and with damped free fall.

use super::boundary::boundaries;
use super::clearance::{MAX_TRIMMED_PROTRUSION, ROUNDING_TOLERANCE};
use super::height_map::HeightMap;
use super::plate;
use super::pour::{self, PlacedGrain, Templates};
use super::settle::{BedBuilder, DepositProgress, DepositStage, Settling};
use super::shape::overlaps;
use super::sleeper::{block_boxes, sleeper, sleeper_pose};
use super::subgrade;
use super::traffic;
use crate::error::{Error, Result};
use crate::geometry::{AxisBox, Clipper, Polyhedron};
use crate::math::{Pose, Vec3};
use crate::model::{ContactStiffness, Grains, Model, Schedule, Solver, Stepping};
use crate::state::{EnergyLedger, State};
use crate::track::plan::{Plan, apply_run_settings};
use crate::workspace::Workspace;
use rand::SeedableRng;
use rand_pcg::Pcg64;
use std::ops::ControlFlow;

/// Speed that damping lets falling grains reach, m/s: 1 mm per step of 1 ms. A step must gain less.
pub const FALL_SPEED: f64 = 1.0;
/// Compactness assumed for poured volumes: rather too high, since the excess is trimmed. Broad gradings pack more
/// densely, and are topped up.
const ASSUMED_COMPACTNESS: f64 = 0.62;
/// Mean height below the fill level at which a bed is topped up, in mean grain sizes.
const MAX_LACKING_HEIGHT: f64 = 0.5;
/// Maximum number of top-ups: each adds the missing height and half a grain more.
const TOP_UPS: usize = 3;
/// Maximum fraction of the missing volume that may remain after a top-up; beyond it the cribs are too narrow.
const MAX_FILL_FRACTION: f64 = 0.8;
/// Steps before a pour may count as at rest: it starts from rest.
const MIN_STEPS: u64 = 50;
/// Maximum duration of the last stage, s: the bed is at rest already, only impulses have to settle.
const MAX_REST_DURATION: f64 = 0.02;
/// Maximum number of grains of a bed, estimated without voids.
pub const MAX_GRAINS: f64 = 2e7;
/// Maximum penetration left in a bed, in mean grain sizes: a run would not remove it.
const MAX_BED_PENETRATION: f64 = 0.05;
/// Cap and tolerance of the last settling: the tolerance that is usual in this field.
const REST_ITERATIONS: u32 = 500;
const REST_TOLERANCE: f64 = 1.666e-4;

/// A prepared bed: grains at rest, boundaries, sleepers and the plates that stand in it; no tines.
#[derive(Debug, Clone, PartialEq)]
pub struct Bed {
    /// Bodies, shapes and settings.
    pub model: Model,
    /// State at rest.
    pub state: State,
    /// Mean settlement of the sleepers at the end of each cycle of the traffic, m; empty without traffic.
    pub settlements: Vec<f64>,
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
    let mut builder = empty_box(plan)?;
    let templates = Templates::generate(&plan.bed, &mut rng, &mut builder.model.shapes)?;
    check_count(plan, templates.mean_volume(&builder.model.shapes))?;
    plate::place_standing(plan, &mut builder)?;
    let mut site = Site { plan, templates, rng, builder, settlements: Vec::new(), watch };
    let stages = [
        Site::pour_below,
        Site::fill_cribs,
        Site::top_up,
        Site::trim,
        Site::carry_traffic,
        Site::refill,
        Site::rest,
    ];
    for stage in stages {
        if stage(&mut site)?.is_break() {
            return Ok(None);
        }
    }
    let Site { builder: BedBuilder { model, mut state, .. }, settlements, .. } = site;
    state.step = 0;
    state.time_ns = 0;
    state.energy = EnergyLedger::default();
    Ok(Some(Bed { model, state, settlements }))
}

/// Returns the bed without grains: sleepers, plates and boundaries before anything is poured.
///
/// # Errors
/// As for a plan that describes no bed.
pub fn empty_bed(plan: &Plan) -> Result<Bed> {
    check(plan)?;
    let mut builder = empty_box(plan)?;
    plate::place_standing(plan, &mut builder)?;
    place_sleepers(plan, &mut builder)?;
    Ok(Bed { model: builder.model, state: builder.state, settlements: Vec::new() })
}

/// Bed under preparation.
struct Site<'a> {
    plan: &'a Plan,
    templates: Templates,
    rng: Pcg64,
    builder: BedBuilder,
    settlements: Vec<f64>,
    watch: &'a mut dyn FnMut(&DepositProgress) -> ControlFlow<()>,
}

/// Stages of the preparation; each returns whether a stop was requested.
impl Site<'_> {
    /// Stage 1: the bed below the sleepers.
    fn pour_below(&mut self) -> Result<ControlFlow<()>> {
        let (plan, bed) = (self.plan, &self.plan.bed);
        let largest = bed.grains.max_size();
        let level = if plan.sleepers.is_empty() {
            bed.preparation.fill_level
        } else {
            (bed.preparation.ballast_depth + 0.5 * largest).min(bed.preparation.fill_level)
        };
        let mut height_map = ground(plan)?;
        let area_share = height_map.open_share();
        let volume = ASSUMED_COMPACTNESS * bed.size.x * bed.size.y * level * area_share;
        let (shapes, size) = (&self.builder.model.shapes, &bed.size);
        let laid =
            pour::pour(&mut height_map, &self.templates, shapes, size, volume, &mut self.rng)?;
        self.insert(&laid);
        self.settle(&pouring(plan, DepositStage::Pour))
    }

    /// Stage 2: the sleepers, and the cribs around them.
    fn fill_cribs(&mut self) -> Result<ControlFlow<()>> {
        let plan = self.plan;
        if plan.sleepers.is_empty() {
            return Ok(ControlFlow::Continue(()));
        }
        make_room(plan, &mut self.builder, plan.bed.preparation.ballast_depth);
        place_sleepers(plan, &mut self.builder)?;
        let laid = self.lay_cribs()?;
        self.insert(&laid);
        self.settle(&pouring(plan, DepositStage::Fill))
    }

    /// Stage 2, continued: tops up to the fill level.
    fn top_up(&mut self) -> Result<ControlFlow<()>> {
        self.fill_up(&pouring(self.plan, DepositStage::Fill))
    }

    /// Lays what lacks up to the fill level, and settles it.
    fn fill_up(&mut self, settling: &Settling) -> Result<ControlFlow<()>> {
        let (plan, bed) = (self.plan, &self.plan.bed);
        let (level, mean_size) = (bed.preparation.fill_level, bed.grains.mean_size());
        let mut before = f64::INFINITY;
        for _ in 0..TOP_UPS {
            let mut height_map = present_height_map(plan, &self.builder)?;
            block_boxes(plan).for_each(|block| keep_clear(&mut height_map, &block));
            let [lacking, area] = height_map.lacking(level);
            if lacking <= MAX_LACKING_HEIGHT * mean_size * area
                || lacking > MAX_FILL_FRACTION * before
            {
                break;
            }
            before = lacking;
            let volume = ASSUMED_COMPACTNESS * (lacking + 0.5 * mean_size * area);
            let laid = self.lay_where_it_fits(&mut height_map, volume);
            self.insert(&laid);
            let settled = self.settle(settling)?;
            if settled.is_break() {
                return Ok(settled);
            }
        }
        Ok(ControlFlow::Continue(()))
    }

    /// Stage 3: the fill level, and the friction of the run.
    fn trim(&mut self) -> Result<ControlFlow<()>> {
        let mut settling = pouring(self.plan, DepositStage::Trim);
        settling.grain_friction = self.plan.bed.friction.grain;
        self.trim_to_level(&settling)
    }

    /// Takes off what lies above the fill level or too deep in others, and settles the bed.
    fn trim_to_level(&mut self, settling: &Settling) -> Result<ControlFlow<()>> {
        let (plan, builder) = (self.plan, &mut self.builder);
        let level = plan.bed.preparation.fill_level;
        let mean_size = plan.bed.grains.mean_size();
        let (grains, state, shapes) =
            (&builder.model.grains, &builder.state, &builder.model.shapes);
        let top = |g: usize| top(&shapes[grains.shape[g] as usize], &state.pose(g));
        let within = |g: usize| {
            state.position[g].z <= level && top(g) <= level + MAX_TRIMMED_PROTRUSION * mean_size
        };
        let mut keep: Vec<bool> = (0..grains.len()).map(within).collect();
        builder.deny_deep(MAX_BED_PENETRATION * mean_size, &mut keep);
        builder.retain(&keep);
        apply_run_settings(plan, &mut builder.model);
        self.settle(settling)
    }

    /// Stage 4: the traffic.
    fn carry_traffic(&mut self) -> Result<ControlFlow<()>> {
        let Some(load) = &self.plan.bed.traffic else { return Ok(ControlFlow::Continue(())) };
        let (builder, settlements) = (&mut self.builder, &mut self.settlements);
        let solver = solver(REST_ITERATIONS, Some(REST_TOLERANCE));
        traffic::carry_traffic(self.plan, load, solver, builder, settlements, self.watch)
    }

    /// Stage 5: the cribs after the traffic.
    fn refill(&mut self) -> Result<ControlFlow<()>> {
        if self.plan.bed.traffic.is_none() {
            return Ok(ControlFlow::Continue(()));
        }
        let mut settling = pouring(self.plan, DepositStage::Refill);
        settling.grain_friction = self.plan.bed.friction.grain;
        if self.fill_up(&settling)?.is_break() {
            return Ok(ControlFlow::Break(()));
        }
        self.trim_to_level(&settling)
    }

    /// Stage 6: the run's time step.
    fn rest(&mut self) -> Result<ControlFlow<()>> {
        let plan = self.plan;
        let most = (MAX_REST_DURATION / plan.run.stepping.h()).ceil() as u64;
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
        self.builder.settle(settling, self.watch)
    }

    fn insert(&mut self, laid: &[PlacedGrain]) {
        let grains: Vec<(u32, Pose)> = laid.iter().map(|g| (g.shape as u32, g.pose)).collect();
        self.builder.insert(&grains, self.plan.bed.density);
    }

    /// Lays about this volume (m³) where grains fit.
    fn lay_where_it_fits(&mut self, height_map: &mut HeightMap, volume: f64) -> Vec<PlacedGrain> {
        let (shapes, size) = (&self.builder.model.shapes, &self.plan.bed.size);
        pour::pour_where_it_fits(height_map, &self.templates, shapes, size, volume, &mut self.rng)
    }

    /// Lays what lacks under the blocks, and in the cribs up to the fill level, where grains fit into them.
    fn lay_cribs(&mut self) -> Result<Vec<PlacedGrain>> {
        let (plan, bed) = (self.plan, &self.plan.bed);
        let mut height_map = present_height_map(plan, &self.builder)?;
        let area_share = height_map.open_share();
        let (grains, shapes) = (&self.builder.model.grains, &self.builder.model.shapes);
        let mut laid = Vec::new();
        for block in block_boxes(plan) {
            let (templates, rng) = (&self.templates, &mut self.rng);
            laid.extend(pour::fill_voids(&mut height_map, templates, shapes, &block, rng));
        }
        block_boxes(plan).for_each(|block| keep_clear(&mut height_map, &block));
        let filled = bed.preparation.fill_level;
        let occupied: f64 = block_boxes(plan)
            .map(|b| AxisBox { high: Vec3::new(b.high.x, b.high.y, b.high.z.min(filled)), ..b })
            .map(|b| b.volume())
            .sum();
        let room = bed.size.x * bed.size.y * filled * area_share - occupied;
        let present: f64 = grains.shape.iter().map(|shape| shapes[*shape as usize].volume).sum();
        let added: f64 = laid.iter().map(|g| shapes[g.shape].volume).sum();
        let lacking = ASSUMED_COMPACTNESS * room - present - added;
        laid.extend(self.lay_where_it_fits(&mut height_map, lacking));
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
        steps: [MIN_STEPS, (preparation.max_settling / h).ceil().max(1.0) as u64],
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

fn empty_box(plan: &Plan) -> Result<BedBuilder> {
    let low = plan.bed.friction.boundary.map(|own| own.min(plan.bed.preparation.friction));
    let mut driven = boundaries(&plan.bed.size, low);
    let mut state = State::default();
    driven.iter().for_each(|_| state.push(Pose::identity()));
    driven[0].mount = subgrade::floor_mount(&plan.bed);
    state.mount.extend(driven[0].mount.map(|_| Pose::identity()));
    let mut model = Model {
        shapes: Vec::new(),
        grains: Grains::default(),
        driven,
        gravity: Vec3::new(0.0, 0.0, -plan.bed.gravity),
        grain_friction: plan.bed.preparation.friction,
        grain_stiffness: ContactStiffness::RIGID,
        restitution: plan.run.restitution,
        stepping: plan.run.stepping,
        solver: plan.run.solver,
    };
    plan.bed.stiffness.apply(&mut model);
    let has_traffic = plan.bed.traffic.is_some();
    Ok(BedBuilder { model, state, workspace: Workspace::default(), has_traffic })
}

fn place_sleepers(plan: &Plan, builder: &mut BedBuilder) -> Result<()> {
    let friction = plan.bed.friction.sleeper.min(plan.bed.preparation.friction);
    for s in &plan.sleepers {
        let body = sleeper(s, friction, &mut builder.model.shapes)?;
        builder.model.driven.push(body);
        builder.state.push(sleeper_pose(plan, s));
    }
    plan.bed.stiffness.apply(&mut builder.model);
    Ok(())
}

/// Takes out the grains that reach into the sleepers' columns above `level`.
fn make_room(plan: &Plan, builder: &mut BedBuilder, level: f64) {
    let columns: Vec<AxisBox> = block_boxes(plan)
        .map(|b| AxisBox {
            low: Vec3::new(b.low.x, b.low.y, level),
            high: Vec3::new(b.high.x, b.high.y, f64::MAX),
        })
        .collect();
    let mut clipper = Clipper::default();
    let (grains, state, shapes) = (&builder.model.grains, &builder.state, &builder.model.shapes);
    let keep: Vec<bool> = (0..grains.len())
        .map(|g| {
            let shape = &shapes[grains.shape[g] as usize];
            !columns.iter().any(|c| overlaps(&mut clipper, shape, &state.pose(g), c))
        })
        .collect();
    builder.retain(&keep);
}

/// Height of a grain's highest point, m.
pub(super) fn top(shape: &Polyhedron, pose: &Pose) -> f64 {
    shape.vertices.iter().map(|v| pose.point(v).z).fold(f64::NEG_INFINITY, f64::max)
}

/// The relief of the bed without grains: the floor, and nothing is laid below or above a plate.
fn ground(plan: &Plan) -> Result<HeightMap> {
    let mut height_map = pour::height_map(&plan.bed)?;
    plate::standing_boxes(plan).for_each(|part| keep_clear(&mut height_map, &part));
    Ok(height_map)
}

/// The relief of the grains that are there.
fn present_height_map(plan: &Plan, builder: &BedBuilder) -> Result<HeightMap> {
    let mut height_map = ground(plan)?;
    let (grains, shapes) = (&builder.model.grains, &builder.model.shapes);
    let shape = |g: usize| &shapes[grains.shape[g] as usize];
    let present = (0..grains.len()).map(|g| (shape(g), builder.state.pose(g)));
    pour::cover_present(&mut height_map, present);
    Ok(height_map)
}

/// Nothing is laid below or upon a block.
fn keep_clear(height_map: &mut HeightMap, block: &AxisBox) {
    height_map.forbid([block.low.x, block.low.y], [block.high.x, block.high.y]);
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
    if let Some(soil) = &bed.subgrade {
        subgrade::check(soil)?;
    }
    if let Some(load) = &bed.traffic {
        traffic::check(plan, load)?;
    }
    for block in block_boxes(plan) {
        let inside = (0..2).all(|k| {
            block.low[k] >= -ROUNDING_TOLERANCE && block.high[k] <= bed.size[k] + ROUNDING_TOLERANCE
        });
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
    if count <= MAX_GRAINS {
        return Ok(());
    }
    Err(Error::Model {
        place: "bed".into(),
        expected: format!("at most {MAX_GRAINS} grains"),
        found: format!("about {count:.0}"),
    })
}

#[cfg(test)]
#[path = "deposit_tests.rs"]
mod tests;
