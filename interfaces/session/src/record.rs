//! What each step leaves in the table `steps` of the results.

use ballast::math::Vec3;
use ballast::model::{Model, Role};
use ballast::observe::Coordination;
use ballast::state::State;
use ballast::step::StepReport;
use ballast::track::TampingPhase;

/// Columns of the table: one list of what each is called here, its name and unit in the file, and its value.
macro_rules! columns {
    ($(#[$about:meta])* $columns:ident of $source:ty {
        $($column:ident: $name:literal, $unit:expr, $value:expr;)*
    }) => {
        $(#[$about])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        pub enum $columns { $($column),* }

        impl $columns {
            const COUNT: usize = [$($name),*].len();

            /// Names and units in the file, in order.
            fn names() -> [(&'static str, String); Self::COUNT] {
                [$(($name, String::from($unit))),*]
            }

            /// Values in the same order.
            fn values(source: &$source) -> [f64; Self::COUNT] {
                let values: [fn(&$source) -> f64; Self::COUNT] = [$($value),*];
                values.map(|value| value(source))
            }
        }
    };
}

columns! {
    /// The first columns; after them come [`BodyColumn`]s for each tine and sleeper. docs/src/guide/results.md tells their meaning.
    Column of Step<'_> {
        Time: "time", "s", |s| s.state.time();
        Phase: "phase", phases(), |s| s.phase as usize as f64;
        Contacts: "contacts", "", |s| s.report.contacts as f64;
        ActiveContacts: "active_contacts", "", |s| s.report.active_contacts as f64;
        InterfaceContacts: "interface_contacts", "", |s| s.report.interface_contacts as f64;
        Subdomains: "subdomains", "", |s| s.report.subdomains as f64;
        Iterations: "iterations", "", |s| s.report.iterations.into();
        Visits: "visits", "", |s| s.report.visits as f64;
        Quad: "quad", "", |s| s.report.residuals.quad;
        Max16: "max16", "", |s| s.report.residuals.max16;
        Weighted: "weighted", "", |s| s.report.residuals.weighted;
        NaturalMap: "natural_map", "", |s| s.report.residuals.natural_map;
        Converged: "converged", "", |s| s.report.converged.into();
        Guarded: "guarded", "", |s| s.report.sync_fallback.into();
        Attempts: "attempts", "", |s| s.report.solve_passes.into();
        MeanPenetration: "mean_penetration", "m", |s| s.report.mean_penetration;
        MaxPenetration: "max_penetration", "m", |s| s.report.max_penetration;
        Coordination: "coordination", "", |s| s.coordination.mean_neighbours[0];
        PointsPerGrain: "points_per_grain", "", |s| s.coordination.mean_points[0];
        Rattlers: "rattlers", "", |s| s.coordination.rattlers as f64;
        Kinetic: "kinetic", "J", |s| s.state.energy.kinetic;
        Potential: "potential", "J", |s| s.state.energy.potential;
        WorkIn: "work_in", "J", |s| s.state.energy.work_in;
        Dissipated: "dissipated", "J", |s| s.state.energy.dissipated;
        BalanceError: "balance_error", "J", |s| s.state.energy.balance_error();
    }
}

columns! {
    /// Per tine and sleeper: mean force of the step on the body, the body's work on the ballast, and where
    /// its reference point is. In the file the body's name comes before these.
    BodyColumn of BodyStep {
        ForceX: "force_x", "N", |b| b.force.x;
        ForceY: "force_y", "N", |b| b.force.y;
        ForceZ: "force_z", "N", |b| b.force.z;
        Work: "work", "J", |b| b.work;
        X: "x", "m", |b| b.place.x;
        Y: "y", "m", |b| b.place.y;
        Z: "z", "m", |b| b.place.z;
    }
}

/// What the first columns of a row are taken from.
struct Step<'a> {
    state: &'a State,
    report: &'a StepReport,
    phase: TampingPhase,
    coordination: &'a Coordination,
}

/// What the columns of a body are taken from.
struct BodyStep {
    /// N.
    force: Vec3,
    /// J.
    work: f64,
    /// m.
    place: Vec3,
}

/// The phases with their numbers, in the place of a unit.
fn phases() -> String {
    let numbered = TampingPhase::ALL.iter().enumerate().map(|(n, p)| format!("{n} {}", p.name()));
    numbered.collect::<Vec<_>>().join(", ")
}

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
    let first = Column::names().map(|(name, unit)| (name.to_string(), unit));
    let of_body =
        |f: &Followed| BodyColumn::names().map(|(name, unit)| (format!("{}_{name}", f.name), unit));
    first.into_iter().chain(followed.iter().flat_map(of_body)).collect()
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
    let mut values = Column::values(&Step { state, report, phase, coordination }).to_vec();
    // Driven bodies come last.
    let first = state.position.len() - report.reactions.len();
    for body in followed {
        let reaction = &report.reactions[body.driven];
        values.extend(BodyColumn::values(&BodyStep {
            force: reaction.impulse / h,
            work: reaction.work,
            place: state.position[first + body.driven],
        }));
    }
    Row(values)
}

impl Row {
    /// The value of one of the first columns.
    pub fn get(&self, column: Column) -> f64 {
        self.0[column as usize]
    }

    /// The value of one of the columns of the `i`-th followed body.
    fn of_body(&self, i: usize, column: BodyColumn) -> f64 {
        self.0[Column::COUNT + i * BodyColumn::COUNT + column as usize]
    }

    /// The phase of the cycle at the end of the step.
    pub fn phase(&self) -> TampingPhase {
        let number = self.get(Column::Phase) as usize;
        TampingPhase::ALL.get(number).copied().unwrap_or(TampingPhase::Done)
    }

    /// The largest of LMGC90's norms (T-11).
    pub fn qm16(&self) -> f64 {
        self.get(Column::Quad).max(self.get(Column::Max16)).max(self.get(Column::Weighted))
    }

    /// Mean force of the step on the `i`-th followed body, N.
    pub fn force(&self, i: usize) -> [f64; 3] {
        [BodyColumn::ForceX, BodyColumn::ForceY, BodyColumn::ForceZ].map(|c| self.of_body(i, c))
    }

    /// Work of the `i`-th followed body on the ballast during the step, J.
    pub fn work(&self, i: usize) -> f64 {
        self.of_body(i, BodyColumn::Work)
    }

    /// Where the reference point of the `i`-th followed body is, m.
    pub fn place(&self, i: usize) -> [f64; 3] {
        [BodyColumn::X, BodyColumn::Y, BodyColumn::Z].map(|c| self.of_body(i, c))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ballast::state::EnergyLedger;
    use ballast::step::{Reaction, Residuals};

    /// A step of which every figure is another one.
    fn step() -> (State, StepReport, Coordination) {
        let state = State {
            step: 7,
            time_ns: 1_400_000,
            position: vec![Vec3::zeros(), Vec3::zeros(), Vec3::new(0.1, 0.2, 0.3)],
            energy: EnergyLedger {
                initial_kinetic: 0.5,
                initial_potential: 13.0,
                kinetic: 1.25,
                potential: 16.5,
                work_in: 3.75,
                dissipated: 1.75,
            },
            ..Default::default()
        };
        let report = StepReport {
            contacts: 11,
            active_contacts: 9,
            interface_contacts: 6,
            subdomains: 5,
            iterations: 40,
            visits: 440,
            residuals: Residuals {
                quad: 0.125,
                max16: 0.25,
                weighted: 0.0625,
                natural_map: 0.03125,
            },
            converged: true,
            sync_fallback: false,
            solve_passes: 12,
            mean_penetration: 1e-6,
            max_penetration: 1e-5,
            reactions: vec![
                Reaction::default(),
                Reaction { impulse: Vec3::new(0.2, 0.3, -0.4), work: 0.75, ..Default::default() },
            ],
        };
        let coordination = Coordination {
            mean_neighbours: [5.5, 6.5],
            mean_points: [8.25, 9.0],
            rattlers: 3,
            ..Default::default()
        };
        (state, report, coordination)
    }

    #[test]
    fn a_row_holds_what_its_columns_say() {
        let (state, mut report, coordination) = step();
        let followed = [Followed { name: "left".into(), role: Role::Tine, driven: 1 }];
        let hold = TampingPhase::Hold;
        let row =
            |report: &StepReport| super::row(2e-4, &state, report, hold, &coordination, &followed);
        let taken = row(&report);
        let phases = "0 waiting, 1 lift, 2 insertion, 3 squeeze, 4 hold, 5 withdrawal, 6 done";
        let expected = [
            ("time", "s", 1.4e-3),
            ("phase", phases, 4.0),
            ("contacts", "", 11.0),
            ("active_contacts", "", 9.0),
            ("interface_contacts", "", 6.0),
            ("subdomains", "", 5.0),
            ("iterations", "", 40.0),
            ("visits", "", 440.0),
            ("quad", "", 0.125),
            ("max16", "", 0.25),
            ("weighted", "", 0.0625),
            ("natural_map", "", 0.03125),
            ("converged", "", 1.0),
            ("guarded", "", 0.0),
            ("attempts", "", 12.0),
            ("mean_penetration", "m", 1e-6),
            ("max_penetration", "m", 1e-5),
            ("coordination", "", 5.5),
            ("points_per_grain", "", 8.25),
            ("rattlers", "", 3.0),
            ("kinetic", "J", 1.25),
            ("potential", "J", 16.5),
            ("work_in", "J", 3.75),
            ("dissipated", "J", 1.75),
            ("balance_error", "J", 2.25),
            ("left_force_x", "N", 0.2 / 2e-4),
            ("left_force_y", "N", 0.3 / 2e-4),
            ("left_force_z", "N", -0.4 / 2e-4),
            ("left_work", "J", 0.75),
            ("left_x", "m", 0.1),
            ("left_y", "m", 0.2),
            ("left_z", "m", 0.3),
        ];
        let columns = columns(&followed);
        let found = columns
            .iter()
            .zip(&taken.0)
            .map(|((name, unit), value)| (&name[..], &unit[..], *value));
        assert_eq!(found.collect::<Vec<_>>(), expected);
        assert_eq!((columns.len(), taken.0.len()), (expected.len(), expected.len()));
        assert_eq!(taken.get(Column::BalanceError), 2.25);
        assert_eq!(taken.phase(), TampingPhase::Hold);
        assert_eq!(taken.qm16(), 0.25);
        assert_eq!(taken.force(0), [0.2 / 2e-4, 0.3 / 2e-4, -0.4 / 2e-4]);
        assert_eq!((taken.work(0), taken.place(0)), (0.75, [0.1, 0.2, 0.3]));
        (report.converged, report.sync_fallback) = (false, true);
        let taken = row(&report);
        assert_eq!([Column::Converged, Column::Guarded].map(|c| taken.get(c)), [0.0, 1.0]);
    }

    #[test]
    fn every_phase_is_read_back_from_its_number() {
        let (state, report, coordination) = step();
        for phase in TampingPhase::ALL {
            assert_eq!(row(2e-4, &state, &report, phase, &coordination, &[]).phase(), phase);
        }
    }
}
