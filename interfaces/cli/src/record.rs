//! What each step leaves in the table `steps` of the results.

use ballast::model::{Model, Role};
use ballast::observe::Coordination;
use ballast::state::State;
use ballast::step::StepReport;
use ballast::track::TampingPhase;

/// The first columns of the table; after them come [`PER_BODY`] for each tine and sleeper.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Column {
    Time,
    Phase,
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
    Attempts,
    MeanPenetration,
    MaxPenetration,
    Coordination,
    PointsPerGrain,
    Rattlers,
    Kinetic,
    Potential,
    WorkIn,
    Dissipated,
    BalanceError,
}

/// Names and units of [`Column`]s in the file, in order.
const NAMES: [(&str, &str); 25] = [
    ("time", "s"),
    ("phase", PHASES),
    ("contacts", ""),
    ("active_contacts", ""),
    ("interface_contacts", ""),
    ("subdomains", ""),
    ("iterations", ""),
    ("visits", ""),
    ("quad", ""),
    ("max16", ""),
    ("weighted", ""),
    ("natural_map", ""),
    ("converged", ""),
    ("guarded", ""),
    ("attempts", ""),
    ("mean_penetration", "m"),
    ("max_penetration", "m"),
    ("coordination", ""),
    ("points_per_grain", ""),
    ("rattlers", ""),
    ("kinetic", "J"),
    ("potential", "J"),
    ("work_in", "J"),
    ("dissipated", "J"),
    ("balance_error", "J"),
];

/// The phase's numbers in the file.
const PHASES: &str = "0 waiting, 1 lift, 2 insertion, 3 squeeze, 4 hold, 5 withdrawal, 6 done";

/// The phases in the order of their numbers.
const PHASE: [TampingPhase; 7] = [
    TampingPhase::Waiting,
    TampingPhase::Lift,
    TampingPhase::Insertion,
    TampingPhase::Squeeze,
    TampingPhase::Hold,
    TampingPhase::Withdrawal,
    TampingPhase::Done,
];

/// Per tine and sleeper: mean force of the step on the body, the body's work on the ballast, and where
/// its reference point is.
const PER_BODY: [(&str, &str); 7] = [
    ("force_x", "N"),
    ("force_y", "N"),
    ("force_z", "N"),
    ("work", "J"),
    ("x", "m"),
    ("y", "m"),
    ("z", "m"),
];

/// A row of the table.
#[derive(Debug, Clone, PartialEq)]
pub struct Row(pub Vec<f64>);

/// A driven body that the table follows.
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

/// Names and units of all columns.
pub fn columns(followed: &[Followed]) -> Vec<(String, String)> {
    let owned = |(name, unit): (&str, &str)| (name.to_string(), unit.to_string());
    let bodies = followed
        .iter()
        .flat_map(|f| PER_BODY.map(|(name, unit)| owned((&format!("{}_{name}", f.name), unit))));
    NAMES.map(owned).into_iter().chain(bodies).collect()
}

/// The row of a step of length `h` (s).
pub fn row(
    h: f64,
    state: &State,
    report: &StepReport,
    phase: TampingPhase,
    coordination: &Coordination,
    followed: &[Followed],
) -> Row {
    let (residuals, energy) = (&report.residuals, &state.energy);
    let mut values = vec![
        state.time(),
        number(phase),
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
        f64::from(report.attempts),
        report.mean_penetration,
        report.max_penetration,
        coordination.mean_neighbours[0],
        coordination.mean_points[0],
        coordination.rattlers as f64,
        energy.kinetic,
        energy.potential,
        energy.work_in,
        energy.dissipated,
        energy.balance_error(),
    ];
    // Driven bodies come last.
    let first = state.position.len() - report.reactions.len();
    for body in followed {
        let reaction = &report.reactions[body.driven];
        values.extend((reaction.impulse / h).iter());
        values.push(reaction.work);
        values.extend(state.position[first + body.driven].iter());
    }
    Row(values)
}

fn number(phase: TampingPhase) -> f64 {
    PHASE.iter().take_while(|p| **p != phase).count() as f64
}

impl Row {
    /// The value of one of the first columns.
    pub fn get(&self, column: Column) -> f64 {
        self.0[column as usize]
    }

    /// The phase of the cycle at the end of the step.
    pub fn phase(&self) -> TampingPhase {
        let number = self.get(Column::Phase) as usize;
        PHASE.get(number).copied().unwrap_or(TampingPhase::Done)
    }

    /// The largest of LMGC90's norms (T-11).
    pub fn qm16(&self) -> f64 {
        self.get(Column::Quad).max(self.get(Column::Max16)).max(self.get(Column::Weighted))
    }

    /// Mean force of the step on the `i`-th followed body, N.
    pub fn force(&self, i: usize) -> [f64; 3] {
        let at = NAMES.len() + i * PER_BODY.len();
        [self.0[at], self.0[at + 1], self.0[at + 2]]
    }

    /// Work of the `i`-th followed body on the ballast during the step, J.
    pub fn work(&self, i: usize) -> f64 {
        self.0[NAMES.len() + i * PER_BODY.len() + 3]
    }

    /// Where the reference point of the `i`-th followed body is, m.
    pub fn place(&self, i: usize) -> [f64; 3] {
        let at = NAMES.len() + i * PER_BODY.len() + 4;
        [self.0[at], self.0[at + 1], self.0[at + 2]]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ballast::math::Vec3;
    use ballast::state::EnergyLedger;
    use ballast::step::{Reaction, Residuals};

    #[test]
    fn phases_are_numbered_as_the_file_says() {
        for (number, phase) in PHASE.iter().enumerate() {
            assert!(PHASES.split(", ").any(|p| p == format!("{number} {}", phase.name())));
        }
    }

    #[test]
    fn a_row_holds_what_its_columns_say() {
        let state = State {
            step: 7,
            time_ns: 1_400_000,
            position: vec![Vec3::zeros(), Vec3::zeros(), Vec3::new(0.1, 0.2, 0.3)],
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
        let coordination = Coordination {
            mean_neighbours: [5.5, 6.5],
            mean_points: [8.25, 9.0],
            rattlers: 3,
            ..Default::default()
        };
        let row = row(2e-4, &state, &report, TampingPhase::Squeeze, &coordination, &followed);
        let names = columns(&followed);
        assert_eq!(names.len(), row.0.len());
        let named = |name: &str| row.0[names.iter().position(|n| n.0 == name).unwrap()];
        for (name, column, value) in [
            ("time", Column::Time, 1.4e-3),
            ("contacts", Column::Contacts, 11.0),
            ("iterations", Column::Iterations, 40.0),
            ("max16", Column::Max16, 0.25),
            ("converged", Column::Converged, 1.0),
            ("max_penetration", Column::MaxPenetration, 1e-5),
            ("coordination", Column::Coordination, 5.5),
            ("points_per_grain", Column::PointsPerGrain, 8.25),
            ("rattlers", Column::Rattlers, 3.0),
            ("balance_error", Column::BalanceError, -2.0),
        ] {
            assert_eq!(named(name), value, "{name}");
            assert_eq!(row.get(column), value, "{name}");
        }
        assert_eq!(row.phase(), TampingPhase::Squeeze);
        assert_eq!(row.force(0), [0.2 / 2e-4, 0.0, -0.4 / 2e-4]);
        assert_eq!(row.work(0), 0.5);
        assert_eq!(named("left_work"), 0.5);
        assert_eq!((named("left_x"), row.place(0)), (0.1, [0.1, 0.2, 0.3]));
    }
}
