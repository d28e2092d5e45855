//! Subdomains in parallel, then the interface (HSDA, Algorithm 1), without a barrier between ([`super::turns`]).
//!
//! One set of contacts (the sequential schedule) is the case without interface. Where a tolerance is asked for,
//! iterations have momentum; where with it neither full nor smaller steps get on, they are accelerated, and
//! begin anew in rounds.

use super::round::Round;
use super::{Decomposition, Outcome, is_solved, next_after};
use crate::model::{Norm, Solver};

/// Iterates until the tolerance or the cap is reached.
pub(super) fn iterate(decomposition: &mut Decomposition, solver: &Solver) -> Outcome {
    let mut round = Round::first(solver);
    let mut outcome = Outcome { converged: solver.tolerance.is_none(), ..Outcome::default() };
    let check_every = solver.check_every.max(1);
    // What the cap ends with are sweeps from the best impulses.
    let closing = solver.iterations.saturating_sub(check_every);
    // By which all sets go on before they are swept.
    let mut share = None;
    while outcome.iterations < solver.iterations {
        // On to the next iteration after which something is looked at or done.
        let before = outcome.iterations;
        let test = next_after(before, 0, check_every).min(solver.iterations);
        let stops = [round.next_point(before), (before < closing).then_some(closing)];
        let done = stops.into_iter().flatten().fold(test, u32::min);
        let measured = done == test;
        let (relaxation, is_point) = (round.relaxation(), round.is_point(done));
        let passes = u32::from(share.is_some()) + done - before;
        decomposition.in_turn(passes, |set, turn| {
            if let (Some(share), 0) = (share, turn.pass) {
                return set.momentum.go_on(&mut set.contacts, share);
            }
            let is_last = turn.pass + 1 == passes;
            let sweeps =
                if turn.of_interface { solver.interface_sweeps } else { solver.subdomain_sweeps };
            set.sweeps(round.sweeps().saturating_mul(sweeps), relaxation, measured && is_last);
            if is_point && is_last {
                set.momentum.measure(&set.contacts);
            }
        });
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
        share = if done < closing {
            round.go_on(decomposition, done, measured)
        } else {
            round.retreat(decomposition);
            None
        };
    }
    outcome.residuals.natural_map = decomposition.natural_map();
    outcome.visits = decomposition.visits();
    outcome
}
