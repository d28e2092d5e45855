//! Subdomains in parallel, then the interface, with a barrier between (HSDA, Algorithm 1).
//!
//! One set of contacts (the sequential schedule) is the case without interface.

use super::{Decomposition, Outcome, Softening, is_solved, is_test};
use crate::model::{Norm, Solver};

/// Iterates until the tolerance or the cap is reached.
pub(super) fn iterate(decomposition: &mut Decomposition, solver: &Solver) -> Outcome {
    let mut softening = Softening::new(solver.relaxation);
    let mut outcome = Outcome { converged: solver.tolerance.is_none(), ..Outcome::default() };
    for done in 1..=solver.iterations {
        let measured = is_test(solver, done);
        let relaxation = softening.relaxation;
        decomposition
            .on_subdomains(|set| set.sweeps(solver.subdomain_sweeps, relaxation, measured));
        decomposition.on_interface(|set| set.sweeps(solver.interface_sweeps, relaxation, measured));
        outcome.iterations = done;
        if measured {
            outcome.residuals = decomposition.visit_norms().residuals();
            if solver.norm == Norm::NaturalMap {
                outcome.residuals.natural_map = decomposition.natural_map();
            }
            softening.observe(done, outcome.residuals.qm16());
            if is_solved(solver, &outcome.residuals) {
                outcome.converged = true;
                break;
            }
        }
    }
    outcome.residuals.natural_map = decomposition.natural_map();
    outcome.visits = decomposition.visits();
    outcome
}
