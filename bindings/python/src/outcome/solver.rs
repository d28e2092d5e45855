//! How a window was solved, and what became of the energy.

use ballast::component::SolverResult;
use ballast::state::EnergyLedger;
use pyo3::prelude::*;

/// Getters of plain numbers.
macro_rules! numbers {
    ($class:ident: $($(#[$doc:meta])* $name:ident: $kind:ty),* $(,)?; $($more:item)*) => {
        #[pymethods]
        impl $class {
            $($(#[$doc])*
            #[getter]
            fn $name(&self) -> $kind {
                self.0.$name
            })*
            $($more)*
        }
    };
}

/// How a window was solved.
#[pyclass(frozen, module = "ballast", name = "SolverOutcome")]
pub struct Solver(pub(super) SolverResult);

numbers!(Solver:
    /// Over all steps.
    iterations: u64,
    /// Of contacts, over all steps.
    visits: u64,
    /// Steps that stopped at their cap of iterations above the tolerance; 0 where none is asked for.
    steps_not_converged: u64,
    /// Largest of a step, without unit.
    residual_qm16: f64,
    /// Largest of a step, without unit.
    residual_natural_map: f64,
    /// In the last step.
    contacts: usize,
    /// Those that carry, in the last step.
    active_contacts: usize,
    /// Of the last step, m.
    mean_penetration: f64,
    /// Largest of all steps, m.
    max_penetration: f64;

    fn __repr__(&self) -> String {
        let SolverResult { iterations, steps_not_converged, residual_qm16, max_penetration, .. } = self.0;
        format!(
            "SolverOutcome({iterations} iterations, {steps_not_converged} steps at the cap, \
             residual_qm16={residual_qm16:.1e}, max_penetration={max_penetration:.1e} m)"
        )
    }
);

/// Energies of the grains since the start of the run, J.
#[pyclass(frozen, module = "ballast", name = "EnergyLedger")]
pub struct Energy(pub(super) EnergyLedger);

numbers!(Energy:
    /// At the start of the run, J.
    initial_kinetic: f64,
    /// At the start of the run, J.
    initial_potential: f64,
    /// Now, J.
    kinetic: f64,
    /// Now, J.
    potential: f64,
    /// Work of driven bodies on the grains, J.
    work_in: f64,
    /// By friction and in impacts, J.
    dissipated: f64;

    /// What the ledger cannot account for, J.
    #[getter]
    fn balance_error(&self) -> f64 {
        self.0.balance_error()
    }

    fn __repr__(&self) -> String {
        let EnergyLedger { kinetic, potential, work_in, dissipated, .. } = self.0;
        format!(
            "EnergyLedger(kinetic={kinetic:.3e} J, potential={potential:.3e} J, \
             work_in={work_in:.3e} J, dissipated={dissipated:.3e} J)"
        )
    }
);
