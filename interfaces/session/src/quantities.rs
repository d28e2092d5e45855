//! Quantities of a run with their names on every surface: one table from which results, summaries and documents take
//! columns, keys, labels and units.

use ballast::track::TampingPhase;
use std::fmt::Write;

/// Names of one quantity; an empty text where a surface does not have it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct QuantityNames {
    /// Column of a table in the results; `BODY` stands for the name of a body.
    pub column: &'static str,
    /// Path in `summary.json`; `BODY`, `ZONE` and `PHASE` stand for names.
    pub path: &'static str,
    /// Label in printed summaries.
    pub label: &'static str,
    /// Unit; `1` for fractions, empty for counts and flags.
    pub unit: &'static str,
    /// Property of the Python package.
    pub python: &'static str,
    /// Meaning, in one sentence.
    pub description: &'static str,
}

/// Defines the quantities: variant, column, path, label, unit, Python property, description.
macro_rules! quantities {
    ($($quantity:ident: $column:literal, $path:literal, $label:literal, $unit:literal, $python:literal, $description:literal;)*) => {
        /// Quantity of a run, of a step, of a body or of a zone.
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        pub enum Quantity {
            $(#[doc = $description] $quantity),*
        }

        impl Quantity {
            /// All quantities, in the order of the reference page.
            pub const ALL: &[Self] = &[$(Self::$quantity),*];

            /// Returns the names of the quantity.
            pub const fn names(self) -> QuantityNames {
                match self {
                    $(Self::$quantity => QuantityNames {
                        column: $column, path: $path, label: $label, unit: $unit, python: $python,
                        description: $description,
                    }),*
                }
            }
        }
    };
}

quantities! {
    Time: "time", "time_s", "time", "s", "", "Simulated time at the end of the step, since the start of the run.";
    Phase: "phase", "", "phase", "", "", "Phase of the tamping cycle at the end of the step, as a number.";
    Contacts: "contacts", "solver.contacts", "contacts", "", "SolverResult.contacts", "Number of contact points within the detection distance, open ones included (T-35).";
    ActiveContacts: "active_contacts", "solver.active_contacts", "active contacts", "", "SolverResult.active_contacts", "Number of contact points with an impulse.";
    InterfaceContacts: "interface_contacts", "solver.interface_contacts", "interface contacts", "", "", "Number of contact points between different subdomains (T-13).";
    Subdomains: "subdomains", "solver.subdomains", "subdomains", "", "", "Number of subdomains (T-13).";
    Iterations: "iterations", "solver.iterations", "iterations per step, all passes", "", "SolverResult.iterations", "Number of solver iterations (T-12), over all solve passes of the step.";
    Visits: "visits", "solver.visits", "visits", "", "SolverResult.visits", "Number of visits of single contacts (T-17), over all solve passes.";
    ResidualQuad: "residual_quad", "", "residual (quad)", "", "", "Relative change of the velocities in the last convergence test, root mean square (T-11).";
    ResidualMax16: "residual_max16", "", "residual (max/16)", "", "", "Relative change of the velocities in the last convergence test, largest one (T-11).";
    ResidualWeighted: "residual_weighted", "", "residual (weighted)", "", "", "Relative change of the velocities in the last convergence test, larger of the two impulse-weighted means (T-11).";
    ResidualQm16: "", "solver.residual_qm16", "residual (QM/16)", "", "SolverResult.residual_qm16", "Largest of the three relative changes of the velocities (T-11).";
    ResidualNaturalMap: "residual_natural_map", "solver.residual_natural_map", "residual (natural map)", "", "SolverResult.residual_natural_map", "Natural map residual of the step, unit-free (T-10).";
    Converged: "converged", "", "converged", "", "", "1 if the step has converged (T-11) or no tolerance is set, else 0.";
    StepsNotConverged: "", "solver.steps_not_converged", "steps not converged", "", "SolverResult.steps_not_converged", "Number of steps that have not reached the tolerance.";
    SyncFallback: "sync_fallback", "solver.steps_sync_fallback", "steps re-solved synchronously", "", "", "1 if asynchronous iterations diverged and the step was solved synchronously (T-13), else 0; in summaries the number of such steps.";
    SolvePasses: "solve_passes", "", "solve passes", "", "", "Number of solves of the step: 1, and 1 more for each time that missed contacts were added (T-35, T-36).";
    StepsResolved: "", "solver.steps_resolved", "steps re-solved for missed contacts", "", "", "Number of steps with more than one solve pass.";
    OpenImpulse: "open_impulse", "", "impulse of open contacts", "N s", "", "Sum of the impulses of the previous step on pairs that are open where it ended (T-40).";
    TotalImpulse: "total_impulse", "", "impulse of all contacts", "N s", "", "Sum of the impulses of the previous step on all pairs.";
    OpenImpulseShare: "", "solver.open_impulse_share", "impulse on contacts that end open", "1", "", "Share of the impulses of a run on pairs that are open where their step ended (T-40).";
    LimitedRotations: "limited_rotations", "solver.limited_rotations", "grains that turned too far in a step", "", "", "Number of touching grains, over the steps in summaries, whose energy was limited because they turned too far in a step (T-41).";
    ForceDifference: "force_difference", "", "difference of impulses", "N s", "SolverResult.force_difference", "Sum of the differences of the impulses on tines and sleepers between two solutions of the step; 0 where it was not checked (T-43).";
    ForceCompared: "force_compared", "", "compared impulses", "N s", "SolverResult.force_compared", "Sum of the magnitudes of the impulses on tines and sleepers of a checked step; 0 where it was not checked (T-43).";
    ForceError: "", "solver.force_error", "error of forces on tools and sleepers", "1", "SolverResult.force_error", "Relative difference of the forces on tines and sleepers between two solutions of the checked steps (T-43).";
    ComplementarityGap: "complementarity_gap", "energy_J.complementarity_gap", "complementarity gap", "J", "SolverResult.complementarity_gap", "Energy by which impulses on opening contacts and friction miss the contact law where the solve of a step ends (T-44); in summaries of all steps.";
    InfeasibleWork: "infeasible_work", "energy_J.infeasible_work", "infeasible work", "J", "SolverResult.infeasible_work", "Energy of contacts that still close where the solve of a step ends (T-44); in summaries of all steps.";
    ComplementarityError: "", "solver.complementarity_error", "complementarity gap over dissipated energy", "1", "SolverResult.complementarity_error", "Complementarity gap and infeasible part over the energy dissipated in the same steps (T-44).";
    MeanPenetration: "mean_penetration", "relative_penetration.mean", "penetration", "m", "SolverResult.mean_penetration", "Mean depth of the penetrating contact points at the midpoint configuration (T-26); in summaries over the mean grain size.";
    MaxPenetration: "max_penetration", "relative_penetration.max", "penetration", "m", "SolverResult.max_penetration", "Depth of the deepest contact point (T-26); in summaries over the mean grain size.";
    GrainSize: "", "relative_penetration.grain_size_m", "d", "m", "", "Mean grain size that penetrations are compared with.";
    Coordination: "coordination", "coordination", "touching neighbours", "", "ZoneResult.coordination", "Touching neighbours per grain, over all grains (T-25).";
    PointsPerGrain: "points_per_grain", "coordination.points_per_grain", "contact points per grain", "", "", "Contact points per grain, over all grains (T-25).";
    Rattlers: "rattlers", "coordination.rattlers", "rattlers", "", "", "Number of grains without an impulse (T-25).";
    Kinetic: "kinetic", "energy_J.kinetic", "kinetic", "J", "EnergyLedger.kinetic", "Kinetic energy of the grains (T-14).";
    Potential: "potential", "energy_J.potential", "potential", "J", "EnergyLedger.potential", "Potential energy of the grains in gravity, 0 at the origin of the world (T-14).";
    Elastic: "elastic", "energy_J.elastic", "elastic", "J", "EnergyLedger.elastic", "Energy of the contacts' springs (T-42).";
    ExternalWork: "external_work", "energy_J.external_work", "external work", "J", "EnergyLedger.external_work", "Work of the driven bodies on the grains since the start (T-14).";
    Dissipated: "dissipated", "energy_J.dissipated", "dissipated", "J", "EnergyLedger.dissipated", "Energy dissipated in contacts since the start (T-14).";
    BalanceError: "balance_error", "energy_J.balance_error", "balance error", "J", "EnergyLedger.balance_error", "Energy that the other terms leave unaccounted for since the start (T-14).";
    SpuriousContactEnergy: "", "energy_J.spurious_contact_energy", "spurious contact energy", "J", "", "Energy of the steps in which contacts released more than they dissipated.";
    Force: "BODY_force_{x,y,z}", "", "force", "N", "BodyResult.mean_force", "Force of the ballast on the body, mean over the step (T-27).";
    Work: "BODY_work", "BODY.work_J", "work (J)", "J", "BodyResult.work", "Work of the body on the ballast (T-27): of the step in columns, of the run in summaries.";
    Position: "BODY_{x,y,z}", "", "position", "m", "", "Position of the body's reference point at the end of the step.";
    PeakForce: "", "BODY.peak_force_N", "peak", "N", "BodyResult.peak_force", "Largest force magnitude of a single step.";
    PeakPeriodAveragedForce: "", "BODY.peak_period_averaged_force_N", "peak (period-averaged)", "N", "", "Largest magnitude of the force averaged over a vibration period.";
    MeanForceMagnitude: "", "BODY.PHASE.mean_force_magnitude_N", "mean |F|", "N", "", "Mean of the force magnitudes of the steps of a phase.";
    MeanForceVectorNorm: "", "BODY.PHASE.mean_force_vector_norm_N", "|mean F|", "N", "", "Magnitude of the mean force vector of a phase.";
    MinZ: "", "BODY.min_z_m", "min z (m)", "m", "", "Lowest position of the body's reference point.";
    TargetDepthZ: "", "BODY.target_depth_z_m", "target depth z (m)", "m", "Tine.full_depth_z", "Height of the reference point at full depth according to the case.";
    TargetClosing: "", "BODY.target_closing_m", "target closing (m)", "m", "", "Closing in the squeeze according to the case.";
    MaxClosing: "", "BODY.max_closing_m", "max closing (m)", "m", "", "Largest closing in the squeeze.";
    TrafficSettlement: "", "BODY.traffic_settlement_m", "settlement under traffic", "m", "", "Settlement of a sleeper at the end of each load cycle after tamping, a list.";
    TinesBelowTargetDepth: "", "", "tines above target depth", "", "", "Number of tines that did not reach the target depth.";
    TinesBelowTargetClosing: "", "", "tines below target closing", "", "", "Number of tines that did not reach the target closing.";
    Compactness: "ZONE", "compactness.ZONE", "compactness", "1", "ZoneResult.compactness", "Compactness of a zone (T-21); in summaries before and after the run.";
    InertialNumber: "", "zones.ZONE.inertial_number", "inertial number", "1", "ZoneResult.inertial_number", "Inertial number of a zone at the end of the step (T-22).";
    StoneElongation: "", "stones.elongation", "elongation I/L", "1", "Simulation.stones", "Width over length of the stones, mean and standard deviation by mass.";
    StoneFlatness: "", "stones.flatness", "flatness S/I", "1", "Simulation.stones", "Thickness over width of the stones, mean and standard deviation by mass.";
    StoneSphericity: "", "stones.sphericity", "sphericity", "1", "Simulation.stones", "Wadell's sphericity: surface of the sphere of equal volume over the surface of the stone, mean and standard deviation by mass.";
    StoneAngularity: "", "stones.angularity_deg", "angularity", "°", "Simulation.stones", "Angle between the normals of the two faces at an edge, mean over the edges by length, mean and standard deviation by mass.";
    FlakinessIndex: "", "stones.flakiness_index", "flakiness index", "1", "Simulation.stones", "Share by mass of stones thinner than half the upper sieve of their size fraction (EN 933-3).";
    ShapeIndex: "", "stones.shape_index", "shape index", "1", "Simulation.stones", "Share by mass of stones more than three times as long as thick (EN 933-4).";
    StoneGrading: "", "stones.grading", "passing", "1", "Simulation.stones", "Share by mass that passes each sieve of EN 13450.";
    Steps: "", "steps", "steps", "", "", "Number of steps with figures.";
    FromStep: "", "from_step", "first step", "", "", "Number of steps before the first one with figures, for a replay that starts within a run.";
    Grains: "", "grains", "grains", "", "", "Number of grains.";
    GrainsLost: "", "grains_lost", "grains lost", "", "", "Number of grains that have left the bed.";
}

impl Quantity {
    /// Column in the results.
    pub const fn column(self) -> &'static str {
        self.names().column
    }

    /// Last key of the path in `summary.json`.
    pub fn key(self) -> &'static str {
        let path = self.names().path;
        path.rsplit('.').next().unwrap_or(path)
    }

    /// Label in printed summaries.
    pub const fn label(self) -> &'static str {
        self.names().label
    }

    /// Unit of the column; for the phase its numbers with their names.
    pub fn unit(self) -> String {
        match self {
            Self::Phase => {
                let numbered = TampingPhase::ALL.iter().enumerate();
                let numbered = numbered.map(|(n, phase)| format!("{n} {}", phase.name()));
                numbered.collect::<Vec<_>>().join(", ")
            }
            _ => self.names().unit.into(),
        }
    }
}

/// Returns the reference page of all quantities, in Markdown.
pub fn markdown() -> String {
    let mut page = String::from(
        "# Quantities\n\n\
         Generated from `interfaces/session/src/quantities.rs`. `BODY`, `ZONE` and `PHASE` stand for names. Numbers like\n\
         (T-14) are equations of the theory page. `stones` is in the JSON of `ballast prepare` and `ballast inspect`.\n\n\
         | column | `summary.json` | label | unit | Python | meaning |\n\
         |---|---|---|---|---|---|\n",
    );
    let code = |text: &str| if text.is_empty() { String::new() } else { format!("`{text}`") };
    for quantity in Quantity::ALL {
        let QuantityNames { column, path, label, python, description, .. } = quantity.names();
        let (column, path, python) = (code(column), code(path), code(python));
        let label = label.replace('|', "\\|");
        let unit = quantity.unit();
        let _ =
            writeln!(page, "| {column} | {path} | {label} | {unit} | {python} | {description} |");
    }
    page
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn columns_and_paths_are_unique() {
        for of in [|names: QuantityNames| names.column, |names: QuantityNames| names.path] {
            let all = Quantity::ALL.iter().map(|quantity| of(quantity.names()));
            let all: Vec<&str> = all.filter(|name| !name.is_empty()).collect();
            assert_eq!(all.iter().collect::<BTreeSet<_>>().len(), all.len());
        }
    }

    #[test]
    fn every_quantity_has_a_label_and_a_sentence() {
        for names in Quantity::ALL.iter().map(|quantity| quantity.names()) {
            assert!(!names.label.is_empty() && names.description.ends_with('.'), "{names:?}");
        }
    }
}
