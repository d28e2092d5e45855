//! What each step and each observation of the zones leaves in the run's tables.

use crate::series::Row;
use ballast::model::{Model, Role};
use ballast::state::State;
use ballast::step::StepReport;

/// The first columns of `steps.csv`; after them come [`PER_BODY`] for each tine and sleeper.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Column {
    Time,
    Contacts,
    ActiveContacts,
    InterfaceContacts,
    Subdomains,
    Iterations,
    Visits,
    Quad,
    Max16,
    Weighted,
    NaturalMap,
    Converged,
    Guarded,
    MeanPenetration,
    MaxPenetration,
    Coordination,
    Kinetic,
    Potential,
    WorkIn,
    Dissipated,
    BalanceError,
}

/// Names of [`Column`]s in the file, in order.
const NAMES: [&str; 21] = [
    "time_s",
    "contacts",
    "active_contacts",
    "interface_contacts",
    "subdomains",
    "iterations",
    "visits",
    "quad",
    "max16",
    "weighted",
    "natural_map",
    "converged",
    "guarded",
    "mean_penetration_m",
    "max_penetration_m",
    "coordination",
    "kinetic_j",
    "potential_j",
    "work_in_j",
    "dissipated_j",
    "balance_error_j",
];

/// Per tine and sleeper: mean force of the step on the body, and the body's work on the ballast.
const PER_BODY: [&str; 4] = ["fx_n", "fy_n", "fz_n", "work_j"];

/// A driven body that the tables follow.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Followed {
    pub name: String,
    pub role: Role,
    /// Index among the driven bodies.
    pub driven: usize,
}

/// The tines and sleepers of a model, in the model's order.
pub fn followed(model: &Model) -> Vec<Followed> {
    let bodies = model.driven.iter().enumerate();
    bodies
        .filter(|(_, body)| body.role != Role::Boundary)
        .map(|(driven, body)| Followed { name: body.name.clone(), role: body.role, driven })
        .collect()
}

/// Column names of `steps.csv`.
pub fn columns(followed: &[Followed]) -> Vec<String> {
    let bodies =
        followed.iter().flat_map(|f| PER_BODY.map(|column| format!("{}_{column}", f.name)));
    NAMES.map(String::from).into_iter().chain(bodies).collect()
}

/// The row of a step of length `h` (s).
pub fn row(
    h: f64,
    state: &State,
    report: &StepReport,
    phase: &str,
    coordination: f64,
    followed: &[Followed],
) -> Row {
    let (residuals, energy) = (&report.residuals, &state.energy);
    let mut values = vec![
        state.time(),
        report.contacts as f64,
        report.active_contacts as f64,
        report.interface_contacts as f64,
        report.subdomains as f64,
        f64::from(report.iterations),
        report.visits as f64,
        residuals.quad,
        residuals.max16,
        residuals.weighted,
        residuals.natural_map,
        f64::from(u8::from(report.converged)),
        f64::from(u8::from(report.guarded)),
        report.mean_penetration,
        report.max_penetration,
        coordination,
        energy.kinetic,
        energy.potential,
        energy.work_in,
        energy.dissipated,
        energy.balance_error(),
    ];
    for body in followed {
        let reaction = &report.reactions[body.driven];
        values.extend((reaction.impulse / h).iter());
        values.push(reaction.work);
    }
    Row { step: state.step, phase: phase.into(), values }
}

impl Row {
    /// The value of a column of `steps.csv`.
    pub fn get(&self, column: Column) -> f64 {
        self.values[column as usize]
    }

    /// Mean force of the step on the `i`-th followed body, N.
    pub fn force(&self, i: usize) -> [f64; 3] {
        let at = NAMES.len() + i * PER_BODY.len();
        [self.values[at], self.values[at + 1], self.values[at + 2]]
    }

    /// Work of the `i`-th followed body on the ballast during the step, J.
    pub fn work(&self, i: usize) -> f64 {
        self.values[NAMES.len() + i * PER_BODY.len() + 3]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ballast::math::Vec3;
    use ballast::state::EnergyLedger;
    use ballast::step::{Reaction, Residuals};

    #[test]
    fn a_row_holds_what_its_columns_say() {
        let state = State {
            step: 7,
            time_ns: 1_400_000,
            energy: EnergyLedger { kinetic: 1.0, work_in: 3.0, ..Default::default() },
            ..Default::default()
        };
        let report = StepReport {
            contacts: 11,
            iterations: 40,
            residuals: Residuals { max16: 0.25, ..Default::default() },
            converged: true,
            max_penetration: 1e-5,
            reactions: vec![
                Reaction::default(),
                Reaction { impulse: Vec3::new(0.2, 0.0, -0.4), work: 0.5, ..Default::default() },
            ],
            ..Default::default()
        };
        let tine = Followed { name: "left".into(), role: Role::Tine, driven: 1 };
        let followed = [tine];
        let row = row(2e-4, &state, &report, "squeeze", 5.5, &followed);
        let names = columns(&followed);
        assert_eq!(names.len(), row.values.len());
        let named = |name: &str| row.values[names.iter().position(|n| n == name).unwrap()];
        for (name, column, value) in [
            ("time_s", Column::Time, 1.4e-3),
            ("contacts", Column::Contacts, 11.0),
            ("iterations", Column::Iterations, 40.0),
            ("max16", Column::Max16, 0.25),
            ("converged", Column::Converged, 1.0),
            ("max_penetration_m", Column::MaxPenetration, 1e-5),
            ("coordination", Column::Coordination, 5.5),
            ("balance_error_j", Column::BalanceError, -2.0),
        ] {
            assert_eq!(named(name), value, "{name}");
            assert_eq!(row.get(column), value, "{name}");
        }
        assert_eq!(row.force(0), [0.2 / 2e-4, 0.0, -0.4 / 2e-4]);
        assert_eq!(row.work(0), 0.5);
        assert_eq!(named("left_work_j"), 0.5);
    }
}
