//! Parts that all iteration schedules share: outcome, stopping rule and adaptive relaxation (T-11, T-12).

use crate::cancel::StopReason;
use crate::model::{Norm, Solver};
use crate::nlgs::{ComplementarityGap, Residuals};

/// Outcome of the iterations of a step.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct SolveOutcome {
    /// Number of DDM iterations.
    pub iterations: u32,
    /// Number of contact visits over all sweeps.
    pub visits: u64,
    /// Residuals of the last convergence test.
    pub residuals: Residuals,
    /// Complementarity gap at the end.
    pub complementarity: ComplementarityGap,
    /// True if the tolerance was reached, or none was set.
    pub converged: bool,
    /// True if the asynchronous iterations diverged and the synchronous schedule solved the step.
    pub sync_fallback: bool,
}

/// Callback after each convergence test, which returns a reason to cancel the step.
pub type CancelCheck<'a> = &'a mut (dyn FnMut() -> Option<StopReason> + Send);

/// Returns the first iteration after `done` that is a multiple of `period` after iteration `start`.
pub(super) fn next_multiple(done: u32, start: u32, period: u32) -> u32 {
    done.saturating_add(period - (done - start) % period)
}

/// Returns the residual in the norm of `solver`.
pub(super) fn selected_residual(solver: &Solver, residuals: &Residuals) -> f64 {
    match solver.norm {
        Norm::Qm16 => residuals.qm16(),
        Norm::Quad => residuals.quad,
        Norm::NaturalMap => residuals.natural_map,
    }
}

/// Returns true if `residuals` are below the tolerance and the relative velocity change is not above one (T-11).
pub(super) fn is_solved(solver: &Solver, residuals: &Residuals, relative_dv: f64) -> bool {
    let value = selected_residual(solver, residuals);
    solver.tolerance.is_some_and(|tolerance| value < tolerance) && relative_dv <= 1.0
}

/// Adaptive under-relaxation: lowers the relaxation factor when the residual stagnates.
///
/// With a friction coefficient near 1, full Gauss-Seidel steps can cycle for ever between stick and slip of a few
/// contacts. Smaller steps break some of these cycles but converge more slowly. The factor is therefore reduced by
/// [`Self::REDUCTION`] only after [`Self::STALL_ITERATIONS`] without progress, at most [`Self::MAX_REDUCTIONS`] times.
/// Not used with a fixed number of iterations (no tolerance).
#[derive(Debug, Clone, Copy)]
pub(super) struct AdaptiveRelaxation {
    /// Current relaxation factor.
    pub relaxation: f64,
    tolerance: Option<f64>,
    /// Smallest residual so far.
    best: f64,
    /// Iteration of the last reduction or of the last progress.
    last_change: u32,
    /// Number of reductions.
    reductions: u32,
}

impl AdaptiveRelaxation {
    /// Iterations without progress that count as stagnation.
    const STALL_ITERATIONS: u32 = 200;
    /// Ratio of residuals below which the iterations make progress.
    const PROGRESS: f64 = 0.7;
    /// Factor of one reduction.
    const REDUCTION: f64 = 0.8;
    /// Maximum number of reductions.
    const MAX_REDUCTIONS: u32 = 3;

    /// Starts with the relaxation factor of `solver`.
    pub fn new(solver: &Solver) -> Self {
        Self {
            relaxation: solver.relaxation,
            tolerance: solver.tolerance,
            best: f64::INFINITY,
            last_change: 0,
            reductions: 0,
        }
    }

    /// Records the residual and the relative velocity change after iteration `done`.
    ///
    /// Both must fall: the velocity change is compared with the tolerance at its limit of one, and the larger decides.
    pub fn observe(&mut self, done: u32, residual: f64, relative_dv: f64) {
        let Some(tolerance) = self.tolerance else { return };
        let remaining = residual.max(tolerance * relative_dv);
        if remaining < Self::PROGRESS * self.best {
            self.best = remaining;
            self.last_change = done;
        } else if done - self.last_change >= Self::STALL_ITERATIONS {
            if self.reductions < Self::MAX_REDUCTIONS {
                self.reductions += 1;
                self.relaxation *= Self::REDUCTION;
            }
            self.last_change = done;
        }
    }

    /// Returns the same factor and count of reductions for iterations that are counted from zero again.
    pub fn restarted(self) -> Self {
        Self { best: f64::INFINITY, last_change: 0, ..self }
    }

    /// Returns true if the iterations have stagnated again after a reduction.
    pub fn has_stagnated_twice(&self) -> bool {
        self.reductions > 1
    }

    /// Returns true if all reductions are used up.
    pub fn is_exhausted(&self) -> bool {
        self.reductions >= Self::MAX_REDUCTIONS
    }
}
