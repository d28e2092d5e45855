//! Time step from state to state (T-1 to T-12).
//!
//! Reads: model, state, inputs. Writes: another state, workspace. Contract: same inputs, same bytes,
//! for any number of threads (sequential and synchronous schedules); a refused step leaves the state
//! as it was.

use crate::cancel::{CancelToken, StopReason};
use crate::contact_recheck::{self, RecheckReason};
use crate::ddm::{self, SolveOutcome};
use crate::detection::{match_contacts, open_impulse, store_contacts};
use crate::drive::StepInputs;
use crate::error::{Cause, Error, Result};
pub use crate::force_check::ForceCheck;
pub use crate::integrate::Reaction;
use crate::integrate::{self, ContactBalance, StepMotion};
use crate::local_problem::VelocitySolution;
use crate::math::Vec3;
use crate::model::{Model, PenetrationCorrection, Schedule, Solver};
pub use crate::nlgs::{ComplementarityGap, Residuals};
use crate::state::{EnergyLedger, State};
use crate::workspace::{CorrectionBuffers, Workspace};
use rayon::prelude::*;
use std::ops::ControlFlow;
use std::sync::Arc;

/// Maximum number of threads: more than a step has work for. Thousands of threads on a few processors wait for each other
/// for minutes.
pub const MAX_THREADS: usize = 1024;

/// Advances `state` by one time step.
///
/// # Errors
/// As for [`advance`]. The state is then exactly that of before the step.
pub fn step(
    model: &Model,
    state: &mut State,
    inputs: &StepInputs,
    ws: &mut Workspace,
    observer: &mut impl StepObserver,
) -> Result<StepReport> {
    let mut next = std::mem::take(&mut ws.next);
    let report = advance(model, state, &mut next, inputs, ws, observer);
    if report.is_ok() {
        std::mem::swap(state, &mut next);
    }
    ws.next = next;
    report
}

/// Computes the step from `state` to `next`. The content of `next` is not read, but its memory is used, so that a shared
/// state need not be copied.
///
/// # Errors
/// [`Error::Input`] for inputs that do not fit, [`Error::State`] for a state that is not finite, [`Error::Step`] for a
/// velocity that is not finite or a driven body beyond its limit, [`Error::Stopped`] when `observer` cancels the step.
/// The content of `next` is then undefined.
pub fn advance(
    model: &Model,
    state: &State,
    next: &mut State,
    inputs: &StepInputs,
    ws: &mut Workspace,
    observer: &mut impl StepObserver,
) -> Result<StepReport> {
    // Enters the pool once: a caller outside would block on each parallel loop.
    rayon::scope(|_| {
        ws.motion.predict(model, state, inputs)?;
        if let Some(limit) = inputs.speed_limit {
            limit.check(model, state, inputs.targets)?;
        }
        ws.detection_range.reset(model, &ws.motion);
        observer.phase_finished(Phase::Predict);
        detect(model, state, inputs, ws, observer);
        let [open, total] = open_impulse(model, &state.contacts, &ws.contacts);
        let mut report = solve(model, state, next, inputs, ws, model.solver, observer)?;
        while let Some(reason) = contact_recheck::recheck(model, ws, report.solve_passes) {
            observer.phase_finished(Phase::NarrowPhase);
            let mut solver = model.solver;
            match reason {
                RecheckReason::RangeTooSmall => detect(model, state, inputs, ws, observer),
                // Starts from the solved impulses, to which little is added.
                RecheckReason::EndOfStepPenetration => {
                    solver.max_iterations = solver.max_iterations.div_ceil(2)
                }
            }
            let again = solve(model, state, next, inputs, ws, solver, observer)?;
            report = again.merged_with(report);
        }
        observer.phase_finished(Phase::NarrowPhase);
        if let Some(limit) = inputs.speed_limit {
            limit.check_moved(model, state, next)?;
        }
        store_contacts(&ws.motion, &ws.contacts, &ws.impulse, &ws.overlap, &mut next.contacts);
        observer.phase_finished(Phase::Store);
        report.open_impulse = open;
        report.total_impulse = total;
        Ok(report)
    })
}

/// Finds the contacts within the detection range, and their initial impulses.
fn detect(
    model: &Model,
    state: &State,
    inputs: &StepInputs,
    ws: &mut Workspace,
    observer: &mut impl StepObserver,
) {
    ws.detection_range.mark_searched();
    ws.detector.broad_phase(model, &ws.motion, &ws.detection_range);
    observer.phase_finished(Phase::BroadPhase);

    ws.detector.narrow_phase(model, &ws.motion, &ws.detection_range, &mut ws.contacts);
    observer.phase_finished(Phase::NarrowPhase);

    match_contacts(model, &ws.motion, &state.contacts, &ws.contacts, &mut ws.history);
    let factor = if inputs.zero_start { 0.0 } else { model.solver.warm_start_factor };
    let previous = ws.history.impulse.par_iter().with_min_len(8192);
    previous.map(|r| r * factor).collect_into_vec(&mut ws.impulse);
    observer.phase_finished(Phase::WarmStart);
}

/// Solves the step with the detected contacts, from the initial impulses.
fn solve(
    model: &Model,
    state: &State,
    next: &mut State,
    inputs: &StepInputs,
    ws: &mut Workspace,
    solver: Solver,
    observer: &mut impl StepObserver,
) -> Result<StepReport> {
    partition(model, ws);
    observer.phase_finished(Phase::Partition);

    let Workspace { problem, motion, contacts, impulse, history, .. } = &mut *ws;
    problem.build(model, state, motion, contacts, impulse, history);
    observer.phase_finished(Phase::LocalProblem);

    ws.decomposition.pack(&ws.problem);
    observer.phase_finished(Phase::ContactGraph);

    let outcome =
        ddm::solve(&mut ws.decomposition, &ws.problem, &solver, &mut || observer.cancelled())?;
    unpack_solution(model, state, ws)?;
    observer.phase_finished(Phase::Solve);

    let report = integrate_and_report(model, state, next, inputs, ws, &outcome);
    observer.phase_finished(Phase::Integrate);

    // A workspace may have stepped another model before.
    ws.correction.velocity.clear();
    ws.correction.angular_velocity.clear();
    if let Some(correction) = &model.solver.penetration_correction {
        correct_penetration(model, state, next, ws, correction, observer)?;
        observer.phase_finished(Phase::PenetrationCorrection);
    }
    Ok(report)
}

/// Distributes grains and contacts over subdomains according to the schedule.
fn partition(model: &Model, ws: &mut Workspace) {
    let mobile = model.mobile_count();
    let partition = ws.decomposition.partition_mut();
    match model.solver.schedule {
        Schedule::Sequential => partition.assign_single_set(mobile, &ws.contacts),
        Schedule::Synchronous | Schedule::Asynchronous => {
            partition.divide(model.solver.partition, &ws.motion.position[..mobile], &ws.contacts)
        }
    }
}

/// Reads impulses and velocities from the contact sets, and refuses values that are not finite.
fn unpack_solution(model: &Model, state: &State, ws: &mut Workspace) -> Result<()> {
    let Workspace { decomposition, problem, impulse, velocity, angular_velocity, .. } = ws;
    impulse.resize(problem.contacts.len(), Vec3::zeros());
    decomposition.unpack_impulses(problem, impulse);
    decomposition.unpack_velocities(problem, velocity, angular_velocity);
    check_finite(model, state, velocity, angular_velocity)
}

/// Refuses velocities that are not finite, naming the body.
fn check_finite(
    model: &Model,
    state: &State,
    velocity: &[Vec3],
    angular_velocity: &[Vec3],
) -> Result<()> {
    let bad = (0..velocity.len()).into_par_iter().with_min_len(4096).find_first(|&i| {
        !(velocity[i].norm_squared() + angular_velocity[i].norm_squared()).is_finite()
    });
    match bad {
        None => Ok(()),
        Some(body) => Err(Error::Step {
            cause: Cause::NotFinite,
            time_s: state.time(),
            place: match body.checked_sub(model.grains.len()) {
                None => format!("grain {body}"),
                Some(d) => format!("driven body {:?}", model.driven[d].name),
            },
            expected: "finite velocity".into(),
            found: format!(
                "v = {:?} m/s, w = {:?} rad/s",
                velocity[body].as_slice(),
                angular_velocity[body].as_slice()
            ),
        }),
    }
}

/// Corrects penetration on the position level (T-34); the energy of lifted grains counts as negative dissipation.
fn correct_penetration(
    model: &Model,
    state: &State,
    next: &mut State,
    ws: &mut Workspace,
    correction: &PenetrationCorrection,
    observer: &mut impl StepObserver,
) -> Result<()> {
    let Workspace {
        decomposition,
        motion,
        contacts,
        problem,
        impulse,
        velocity,
        angular_velocity,
        ..
    } = ws;
    let (positions, h) = (&mut ws.correction, model.stepping.h());
    let solved =
        VelocitySolution { problem, motion, contacts, impulse, velocity, angular_velocity };
    let ng = model.grains.len();
    if !positions.problem.build_positions(ng, &solved, correction, h) {
        return Ok(());
    }
    decomposition.pack(&positions.problem);
    let solver = Solver {
        max_iterations: correction.iterations,
        tolerance: None,
        relaxation: 1.0,
        // Between tests only active contacts are visited, so rare tests would miss contacts that the correction closes.
        convergence_check_interval: model
            .solver
            .convergence_check_interval
            .min(Solver::default().convergence_check_interval),
        ..model.solver
    };
    ddm::solve(decomposition, &positions.problem, &solver, &mut || observer.cancelled())?;
    let CorrectionBuffers { problem, velocity, angular_velocity } = positions;
    decomposition.unpack_velocities(problem, velocity, angular_velocity);
    check_finite(model, state, velocity, angular_velocity)?;

    integrate::shift_grains(&velocity[..ng], &angular_velocity[..ng], h, next);
    let (kinetic, potential) = integrate::mechanical_energy(model, next);
    let energy = &mut next.energy;
    energy.dissipated -= kinetic + potential - energy.kinetic - energy.potential;
    (energy.kinetic, energy.potential) = (kinetic, potential);
    Ok(())
}

/// Moves the bodies, updates the energy ledger, and reports the step.
fn integrate_and_report(
    model: &Model,
    state: &State,
    next: &mut State,
    inputs: &StepInputs,
    ws: &mut Workspace,
    outcome: &SolveOutcome,
) -> StepReport {
    let Workspace {
        contacts, motion, impulse, history, overlap, velocity, angular_velocity, ..
    } = ws;
    let (contacts, motion, impulse) = (&*contacts, &*motion, &*impulse);
    let step_motion = StepMotion { model, state, motion, velocity, angular_velocity };
    step_motion.end_overlaps(contacts, history, overlap);
    let balance = ContactBalance::new(&step_motion, contacts, impulse, overlap);
    let reactions = balance.reactions(&step_motion, contacts, impulse);
    integrate::write_end_configuration(&step_motion, inputs.targets, next);
    let rotation_limit = integrate::limit_rotation(&step_motion, next);
    let ledger = if state.step == 0 { integrate::open_ledger(model, state) } else { state.energy };
    let (kinetic, potential) = integrate::mechanical_energy(model, next);
    next.energy = EnergyLedger {
        kinetic,
        potential,
        work_in: ledger.work_in + reactions.iter().map(|r| r.work).sum::<f64>(),
        elastic: balance.elastic,
        dissipated: ledger.dissipated + balance.absorbed + ledger.elastic - balance.elastic
            + rotation_limit.energy,
        ..ledger
    };
    next.window = Arc::clone(&state.window);
    next.driver = Arc::clone(&state.driver);
    next.step = state.step + 1;
    next.time_ns = state.time_ns + model.stepping.step_ns;

    let interface = &ws.decomposition.partition().interface;
    StepReport {
        contacts: contacts.len(),
        active_contacts: balance.active,
        interface_contacts: interface.contacts.items.len(),
        subdomains: ws.decomposition.partition().contacts.len(),
        iterations: outcome.iterations,
        visits: outcome.visits,
        residuals: outcome.residuals,
        complementarity: outcome.complementarity,
        converged: outcome.converged,
        sync_fallback: outcome.sync_fallback,
        solve_passes: 1,
        mean_penetration: balance.depth_sum / balance.penetrating.max(1) as f64,
        max_penetration: balance.max_depth,
        open_impulse: 0.0,
        total_impulse: 0.0,
        force_check: ForceCheck::default(),
        limited_rotations: rotation_limit.grains,
        reactions,
    }
}

/// Phase of a step, in order of execution; profiles, recordings and documents use these names.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Phase {
    /// Free velocities and configuration m.
    Predict,
    /// Candidate pairs.
    BroadPhase,
    /// Contact points.
    NarrowPhase,
    /// Initial impulses from the previous step.
    WarmStart,
    /// Subdomains and interface.
    Partition,
    /// Frames, arms and Delassus blocks.
    LocalProblem,
    /// Packing into blocks of independent contacts.
    ContactGraph,
    /// Iterations.
    Solve,
    /// End-of-step configuration, reactions and energies.
    Integrate,
    /// Position-level penetration correction.
    PenetrationCorrection,
    /// Contact memory for the next step.
    Store,
}

impl Phase {
    /// All phases in the order of the step.
    pub const ALL: [Phase; 11] = [
        Phase::Predict,
        Phase::BroadPhase,
        Phase::NarrowPhase,
        Phase::WarmStart,
        Phase::Partition,
        Phase::LocalProblem,
        Phase::ContactGraph,
        Phase::Solve,
        Phase::Integrate,
        Phase::PenetrationCorrection,
        Phase::Store,
    ];

    /// Name of the phase in profiles and files.
    pub fn name(self) -> &'static str {
        match self {
            Phase::Predict => "predict",
            Phase::BroadPhase => "broad phase",
            Phase::NarrowPhase => "narrow phase",
            Phase::WarmStart => "warm start",
            Phase::Partition => "partition",
            Phase::LocalProblem => "local problem",
            Phase::ContactGraph => "contact graph",
            Phase::Solve => "solve",
            Phase::Integrate => "integrate",
            Phase::PenetrationCorrection => "penetration correction",
            Phase::Store => "store",
        }
    }
}

/// Observer of running steps: receives phase boundaries and finished steps, and may request the end of the window.
///
/// The core reads no clock; an observer that measures times brings one. `()` observes nothing.
pub trait StepObserver: Send {
    /// Called when `phase` has finished.
    fn phase_finished(&mut self, _phase: Phase) {}

    /// Called when a step of a window has finished and has led to `state`; `Break` ends the window.
    fn step_finished(&mut self, _state: &State, _report: &StepReport) -> ControlFlow<StopReason> {
        ControlFlow::Continue(())
    }

    /// Returns `Some` to cancel the running step; the state is then exactly that of before the step.
    ///
    /// Called after every convergence test, from whichever worker thread ran it, and periodically from the calling
    /// thread. The reason says what becomes of the enclosing window.
    fn cancelled(&mut self) -> Option<StopReason> {
        None
    }
}

impl StepObserver for () {}

impl StepObserver for CancelToken {
    fn step_finished(&mut self, _state: &State, _report: &StepReport) -> ControlFlow<StopReason> {
        self.reason().map_or(ControlFlow::Continue(()), ControlFlow::Break)
    }

    fn cancelled(&mut self) -> Option<StopReason> {
        self.reason()
    }
}

/// Observer that calls a function after each step.
pub struct StepCallback<F>(pub F);

impl<F> StepObserver for StepCallback<F>
where
    F: FnMut(&State, &StepReport) -> ControlFlow<StopReason> + Send,
{
    fn step_finished(&mut self, state: &State, report: &StepReport) -> ControlFlow<StopReason> {
        self.0(state, report)
    }
}

/// Report of a step. A step that did not converge is reported here, not as an error.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct StepReport {
    /// Number of contact points.
    pub contacts: usize,
    /// Number of contact points with an impulse.
    pub active_contacts: usize,
    /// Number of contact points of the interface Γ.
    pub interface_contacts: usize,
    /// Number of subdomains, including those without contacts.
    pub subdomains: usize,
    /// Number of DDM iterations of all solve passes.
    pub iterations: u32,
    /// Number of contact visits over all sweeps of all solve passes.
    pub visits: u64,
    /// Residuals of the last convergence test.
    pub residuals: Residuals,
    /// Energy by which the solution misses the contact law.
    pub complementarity: ComplementarityGap,
    /// True if the tolerance was reached, or there is none.
    pub converged: bool,
    /// True if asynchronous iterations diverged and were repeated by the synchronous schedule.
    pub sync_fallback: bool,
    /// Number of solves: one, and one more for each recheck that found missed contacts (T-35, T-36).
    pub solve_passes: u32,
    /// Mean penetration over the penetrating points, m.
    pub mean_penetration: f64,
    /// Largest penetration, m.
    pub max_penetration: f64,
    /// Sum of the impulses of the previous step on pairs that are open where it ended, N s.
    ///
    /// Zero for an exact contact law: a gap that is linear in the step closes where none is (T-40).
    pub open_impulse: f64,
    /// Sum of the impulses of the previous step on all pairs, N s.
    pub total_impulse: f64,
    /// Number of grains whose energy was limited because they turned too far in the step (T-41).
    pub limited_rotations: usize,
    /// Comparison of the forces on tines and sleepers with those of a second solution; zero where none was made.
    pub force_check: ForceCheck,
    /// Reaction of the ballast on each driven body `[nd]`.
    pub reactions: Vec<Reaction>,
}

impl StepReport {
    /// Returns the report of the last solve, with the costs of the solves before it.
    fn merged_with(self, before: Self) -> Self {
        Self {
            solve_passes: self.solve_passes + before.solve_passes,
            iterations: self.iterations + before.iterations,
            visits: self.visits + before.visits,
            sync_fallback: self.sync_fallback || before.sync_fallback,
            ..self
        }
    }
}
