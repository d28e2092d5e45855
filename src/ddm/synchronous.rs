//! Subdomains in parallel, then the interface, with a barrier between (HSDA, Algorithm 1).
//!
//! One set of contacts (the sequential schedule) is the case without interface. Where a tolerance is asked for,
//! iterations have momentum; where with it neither full nor smaller steps get on, they are accelerated, and
//! begin anew in rounds.

use super::decomposition::Set;
use super::round::Round;
use super::{Decomposition, Outcome, is_solved, is_test};
use crate::model::{Norm, Solver};

/// Iterates until the tolerance or the cap is reached.
pub(super) fn iterate(decomposition: &mut Decomposition, solver: &Solver) -> Outcome {
    let mut round = Round::first(solver);
    let mut outcome = Outcome { converged: solver.tolerance.is_none(), ..Outcome::default() };
    for done in 1..=solver.iterations {
        let measured = is_test(solver, done);
        // What the cap ends with are sweeps from the best impulses.
        let closing = solver.iterations - done <= solver.check_every.max(1);
        let (relaxation, is_point) = (round.relaxation(), round.is_point(done));
        let visit = |set: &mut Set, sweeps| {
            set.sweeps(round.sweeps().saturating_mul(sweeps), relaxation, measured);
            if is_point {
                set.momentum.measure(&set.contacts);
            }
        };
        decomposition.on_subdomains(|set| visit(set, solver.subdomain_sweeps));
        decomposition.on_interface(|set| visit(set, solver.interface_sweeps));
        outcome.iterations = done;
        if measured {
            outcome.residuals = decomposition.visit_norms().residuals();
            if solver.norm == Norm::NaturalMap {
                outcome.residuals.natural_map = decomposition.natural_map();
            }
            if is_solved(solver, &outcome.residuals) {
                outcome.converged = true;
                break;
            }
            // Nothing leads back from what is not a number.
            if outcome.residuals.quad.is_nan() {
                break;
            }
            round.observe(done, outcome.residuals.qm16());
        }
        if closing {
            round.retreat(decomposition);
        } else {
            round.go_on(decomposition, done, measured);
        }
    }
    outcome.residuals.natural_map = decomposition.natural_map();
    outcome.visits = decomposition.visits();
    outcome
}
