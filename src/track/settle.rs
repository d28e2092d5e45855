//! Settling: stepping a bed under damping until it rests.
//!
//! Reads: a stage's settings. Writes: model settings, state. Cost: one step per step.
//! Contract: damping exists in the preparation only, and never when a stage ends: it takes speed
//! from free fall, which would otherwise drive grains into each other, not from a bed at rest.

use crate::drive::StepInputs;
use crate::error::{Error, Result};
use crate::math::{Pose, Vec3};
use crate::model::{Model, Solver, Stepping};
use crate::observe;
use crate::state::{ContactMemory, State};
use crate::step::{StepReport, step};
use crate::workspace::Workspace;
use std::ops::ControlFlow;

/// The stages of the preparation, in order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum DepositStage {
    /// Pours the bed up to the underside of the sleepers.
    Pour,
    /// Fills the cribs.
    Fill,
    /// Removes grains above the fill level and settles with the friction of the run.
    Trim,
    /// Loads the sleepers as traffic does.
    Traffic,
    /// Fills up the cribs after the traffic.
    Refill,
    /// Settles with the time step of the run.
    Rest,
}

impl DepositStage {
    /// The stage's name for people.
    pub fn name(self) -> &'static str {
        match self {
            DepositStage::Pour => "pour",
            DepositStage::Fill => "fill",
            DepositStage::Trim => "trim",
            DepositStage::Traffic => "traffic",
            DepositStage::Refill => "refill",
            DepositStage::Rest => "rest",
        }
    }
}

/// Progress of the preparation after a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DepositProgress {
    /// Stage of the preparation.
    pub stage: DepositStage,
    /// True if the preparation has a stage of traffic.
    pub has_traffic: bool,
    /// Number of steps of the stage so far.
    pub step: u64,
    /// Number of steps before which the stage does not end.
    pub least_steps: u64,
    /// Maximum number of steps of the stage.
    pub most_steps: u64,
    /// Number of grains.
    pub grains: usize,
    /// Number of contact points.
    pub contacts: usize,
    /// Mean speed of the grains, m/s.
    pub mean_speed: f64,
    /// Mean speed below which the bed is at rest, m/s.
    pub rest_speed: f64,
    /// Mean penetration, m (T-26).
    pub mean_penetration: f64,
    /// Largest penetration, m (T-26).
    pub max_penetration: f64,
}

/// Settings of a stage.
pub(super) struct Settling {
    pub stage: DepositStage,
    pub stepping: Stepping,
    pub solver: Solver,
    pub grain_friction: f64,
    /// Speed that damping lets a falling grain reach, m/s; `None`: no damping.
    pub fall_speed: Option<f64>,
    /// Steps before rest is looked for, and most steps.
    pub steps: [u64; 2],
    /// Mean grain speed that counts as rest, m/s.
    pub rest_speed: f64,
}

/// Model and state under preparation.
pub(super) struct BedBuilder {
    pub model: Model,
    pub state: State,
    pub workspace: Workspace,
    /// True if the plan has traffic.
    pub has_traffic: bool,
}

impl BedBuilder {
    /// Runs a stage to its end, while the driven bodies stay where they are; `Break` if the watcher asks to stop.
    pub fn settle(
        &mut self,
        settling: &Settling,
        watch: &mut dyn FnMut(&DepositProgress) -> ControlFlow<()>,
    ) -> Result<ControlFlow<()>> {
        self.adopt(settling);
        let g = self.model.gravity.norm();
        let keep = settling.fall_speed.map_or(1.0, |v| 1.0 - g * settling.stepping.h() / v);
        let targets = self.state.imposed_poses(&self.model);
        let inputs = StepInputs::from_targets(&targets);
        let [least, most] = settling.steps;
        for done in 1..=most {
            let report = step(&self.model, &mut self.state, &inputs, &mut self.workspace, &mut ())?;
            let speed = self.mean_speed();
            let progress = self.progress(settling, done, speed, &report);
            if watch(&progress).is_break() {
                return Ok(ControlFlow::Break(()));
            }
            // What a stage ends with is a step, as it was solved.
            if done == most || (done >= least && speed < settling.rest_speed) {
                break;
            }
            self.damp(keep);
        }
        self.check_inside()?;
        Ok(ControlFlow::Continue(()))
    }

    /// Sets stepping, solver and friction between grains to those of a stage.
    pub fn adopt(&mut self, settling: &Settling) {
        if !self.model.is_rigid() {
            // The springs keep their forces through a change of the time step.
            let factor = settling.stepping.h() / self.model.stepping.h();
            self.state.contacts.impulse.iter_mut().for_each(|r| *r *= factor);
        }
        self.model.stepping = settling.stepping;
        self.model.solver = settling.solver;
        self.model.grain_friction = settling.grain_friction;
    }

    pub fn progress(
        &self,
        settling: &Settling,
        step: u64,
        mean_speed: f64,
        report: &StepReport,
    ) -> DepositProgress {
        DepositProgress {
            stage: settling.stage,
            has_traffic: self.has_traffic,
            step,
            least_steps: settling.steps[0],
            most_steps: settling.steps[1],
            grains: self.model.grains.len(),
            contacts: report.contacts,
            mean_speed,
            rest_speed: settling.rest_speed,
            mean_penetration: report.mean_penetration,
            max_penetration: report.max_penetration,
        }
    }

    /// Mean speed of the grains, m/s.
    pub fn mean_speed(&self) -> f64 {
        observe::mean_speed(&self.model, &self.state)
    }

    fn damp(&mut self, keep: f64) {
        if keep < 1.0 {
            let n = self.model.grains.len();
            self.state.velocity[..n].iter_mut().for_each(|v| *v *= keep);
            self.state.angular_velocity[..n].iter_mut().for_each(|w| *w *= keep);
        }
    }

    /// Inserts grains at rest after those present; driven bodies keep following the grains.
    pub fn insert(&mut self, grains: &[(u32, Pose)], density: f64) {
        let n = self.model.grains.len();
        for &(shape, _) in grains {
            self.model.grains.push(shape, &self.model.shapes[shape as usize], density);
        }
        let zeros = || grains.iter().map(|_| Vec3::zeros());
        self.state.position.splice(n..n, grains.iter().map(|g| g.1.position));
        self.state.orientation.splice(n..n, grains.iter().map(|g| g.1.orientation));
        self.state.velocity.splice(n..n, zeros());
        self.state.angular_velocity.splice(n..n, zeros());
        let added = |b: usize| if b >= n { grains.len() } else { 0 };
        self.state.contacts.renumber(|b| b + added(b));
    }

    /// Denies, of each two grains that the last step found deeper than `deepest` (m) in each other,
    /// the lighter one, unless either is denied already; and every grain so deep in a driven body.
    pub fn deny_deep(&self, deepest: f64, keep: &mut [bool]) {
        let contacts = &self.workspace.contacts;
        let n = self.model.grains.len();
        let deep = (0..contacts.len()).filter(|&i| contacts.gap[i] < -deepest);
        for [a, b] in deep.map(|i| contacts.bodies[i].map(|b| b as usize)) {
            if b >= n {
                keep[a] = false;
            } else if keep[a] && keep[b] {
                let mass = &self.model.grains.mass;
                keep[if mass[b] < mass[a] { b } else { a }] = false;
            }
        }
    }

    /// Removes the grains that `keep` denies `[ng]`; the others stay in order, with their contacts.
    pub fn retain(&mut self, keep: &[bool]) {
        let n = self.model.grains.len();
        let kept = |b: usize| b >= n || keep[b];
        let mut number = 0;
        let numbers: Vec<Option<u32>> = (0..self.model.body_count())
            .map(|b| {
                kept(b).then(|| {
                    number += 1;
                    number - 1
                })
            })
            .collect();
        let grains = &mut self.model.grains;
        sift(&mut grains.shape, kept);
        sift(&mut grains.mass, kept);
        sift(&mut grains.inertia, kept);
        sift(&mut self.state.position, kept);
        sift(&mut self.state.orientation, kept);
        sift(&mut self.state.velocity, kept);
        sift(&mut self.state.angular_velocity, kept);
        renumber(&mut self.state.contacts, &numbers);
    }

    /// No grain may have left the box: a centre behind a wall would never come back.
    fn check_inside(&self) -> Result<()> {
        for b in 0..self.model.grains.len() {
            let p = self.state.position[b];
            let walls = self.model.driven.iter().enumerate();
            for (d, wall, part) in walls.flat_map(|(d, w)| w.parts.iter().map(move |q| (d, w, q))) {
                let crate::model::Part::HalfSpace { normal, offset } = part else { continue };
                let origin = self.state.position[self.model.grains.len() + d];
                let height = normal.dot(&(p - origin)) - offset;
                // Written so that a position that is not a number is found as well.
                if !(height > 0.0) {
                    return Err(Error::State {
                        place: format!("grain {b} of the bed under preparation"),
                        expected: format!("inside of boundary {:?}", wall.name),
                        found: format!("{height} m"),
                    });
                }
            }
        }
        Ok(())
    }
}

/// Keeps the entries whose index `kept` accepts.
fn sift<T: Copy>(values: &mut Vec<T>, kept: impl Fn(usize) -> bool) {
    let mut index = 0;
    values.retain(|_| {
        index += 1;
        kept(index - 1)
    });
}

/// Drops contacts of bodies without a new number; the new numbers keep the order of the old.
fn renumber(memory: &mut ContactMemory, numbers: &[Option<u32>]) {
    let new = |pair: &[u32; 2]| Some([numbers[pair[0] as usize]?, numbers[pair[1] as usize]?]);
    let keep: Vec<bool> = memory.bodies.iter().map(|pair| new(pair).is_some()).collect();
    let kept = |i: usize| keep[i];
    memory.bodies = memory.bodies.iter().filter_map(new).collect();
    sift(&mut memory.feature, kept);
    sift(&mut memory.local_point, kept);
    sift(&mut memory.impulse, kept);
    sift(&mut memory.overlap, kept);
}
