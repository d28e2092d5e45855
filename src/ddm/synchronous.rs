//! Subdomains in parallel, then the interface, with a barrier between (HSDA, Algorithm 1).
//!
//! One set of contacts (the sequential schedule) is the case without interface. Where a tolerance is asked for,
//! iterations have momentum; where with it neither full nor smaller steps get on, they are accelerated.

use super::acceleration::Acceleration;
use super::decomposition::Set;
use super::momentum::Momentum;
use super::{Decomposition, Outcome, Softening, is_solved, is_test};
use crate::model::{Norm, Solver};

/// Iterates until the tolerance or the cap is reached.
pub(super) fn iterate(decomposition: &mut Decomposition, solver: &Solver) -> Outcome {
    let (mut softening, mut acceleration) = (Softening::new(solver.relaxation), None);
    let mut momentum = (solver.momentum && solver.tolerance.is_some()).then(Momentum::new);
    let mut outcome = Outcome { converged: solver.tolerance.is_none(), ..Outcome::default() };
    for done in 1..=solver.iterations {
        let measured = is_test(solver, done);
        // What the cap ends with are sweeps from the best impulses.
        let closing = solver.iterations - done <= solver.check_every.max(1);
        let relaxation =
            acceleration.as_ref().map_or(softening.relaxation, Acceleration::relaxation);
        let is_point = momentum.as_ref().is_some_and(|momentum| momentum.is_point(done));
        let visit = |set: &mut Set, sweeps| {
            set.sweeps(sweeps, relaxation, measured);
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
            softening.observe(done, outcome.residuals.qm16());
            let wanted = solver.tolerance.is_some() && !closing;
            if softening.is_spent() && acceleration.is_none() && wanted {
                let relaxations = [softening.relaxation, solver.relaxation];
                acceleration = Some(Acceleration::begin(decomposition, done, relaxations));
            }
        }
        if closing {
            if let Some(mut acceleration) = acceleration.take() {
                acceleration.retreat(decomposition);
            }
        } else if let Some(acceleration) = &mut acceleration {
            acceleration.go_on(decomposition, done);
        } else if let Some(momentum) = &mut momentum {
            momentum.go_on(decomposition, done, measured);
        }
    }
    outcome.residuals.natural_map = decomposition.natural_map();
    outcome.visits = decomposition.visits();
    outcome
}
