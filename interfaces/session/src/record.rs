//! Rows of the table `steps` of the results.

use crate::quantities::Quantity;
use ballast::model::{Model, Role};
use ballast::observe::Coordination;
use ballast::state::State;
use ballast::step::StepReport;
use ballast::track::TampingPhase;

/// Defines columns of the table, each a [`Quantity`] with its value.
macro_rules! columns {
    ($(#[$about:meta])* $columns:ident of $source:ty { $($column:ident: $value:expr;)* }) => {
        $(#[$about])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        #[allow(missing_docs)]
        pub enum $columns { $($column),* }

        impl $columns {
            const ALL: &[Quantity] = &[$(Quantity::$column),*];
            const COUNT: usize = Self::ALL.len();

            /// Returns the values in the order of the columns.
            fn values(source: &$source) -> [f64; Self::COUNT] {
                let values: [fn(&$source) -> f64; Self::COUNT] = [$($value),*];
                values.map(|value| value(source))
            }
        }
    };
}

columns! {
    /// First columns of the table; after them come those of each tine and sleeper.
    Column of StepSource<'_> {
        Time: |s| s.state.time();
        Phase: |s| s.phase as usize as f64;
        Contacts: |s| s.report.contacts as f64;
        ActiveContacts: |s| s.report.active_contacts as f64;
        InterfaceContacts: |s| s.report.interface_contacts as f64;
        Subdomains: |s| s.report.subdomains as f64;
        Iterations: |s| s.report.iterations.into();
        Visits: |s| s.report.visits as f64;
        ResidualQuad: |s| s.report.residuals.quad;
        ResidualMax16: |s| s.report.residuals.max16;
        ResidualWeighted: |s| s.report.residuals.weighted;
        ResidualNaturalMap: |s| s.report.residuals.natural_map;
        Converged: |s| s.report.converged.into();
        SyncFallback: |s| s.report.sync_fallback.into();
        SolvePasses: |s| s.report.solve_passes.into();
        OpenImpulse: |s| s.report.open_impulse;
        TotalImpulse: |s| s.report.total_impulse;
        LimitedRotations: |s| s.report.limited_rotations as f64;
        ForceDifference: |s| s.report.force_check.difference;
        ForceCompared: |s| s.report.force_check.total;
        ComplementarityGap: |s| s.report.complementarity.gap;
        InfeasibleWork: |s| s.report.complementarity.infeasible;
        MeanPenetration: |s| s.report.mean_penetration;
        MaxPenetration: |s| s.report.max_penetration;
        Coordination: |s| s.coordination.mean_neighbours[0];
        PointsPerGrain: |s| s.coordination.mean_points[0];
        Rattlers: |s| s.coordination.rattlers as f64;
        Kinetic: |s| s.state.energy.kinetic;
        Potential: |s| s.state.energy.potential;
        Elastic: |s| s.state.energy.elastic;
        ExternalWork: |s| s.state.energy.work_in;
        Dissipated: |s| s.state.energy.dissipated;
        BalanceError: |s| s.state.energy.balance_error();
    }
}

/// Values per tine and sleeper: force of the step, x, y, z; work; position, x, y, z.
const BODY_COLUMNS: usize = 7;

/// Sources of the first columns of a row.
struct StepSource<'a> {
    state: &'a State,
    report: &'a StepReport,
    phase: TampingPhase,
    coordination: &'a Coordination,
}

/// Row of the table `steps`.
#[derive(Debug, Clone, PartialEq)]
pub struct StepRow(pub Vec<f64>);

/// Driven body with columns in the table `steps`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TrackedBody {
    /// Name in the case.
    pub name: String,
    /// Role in the model.
    pub role: Role,
    /// Index among the driven bodies.
    pub driven: usize,
}

/// Returns the tines, sleepers and plates of a model, in the order of the model.
pub fn tracked(model: &Model) -> Vec<TrackedBody> {
    let bodies = model.driven.iter().enumerate();
    bodies
        .filter(|(_, body)| body.role != Role::Boundary)
        .map(|(driven, body)| TrackedBody { name: body.name.clone(), role: body.role, driven })
        .collect()
}

/// Returns names and units of all columns.
pub fn columns(tracked: &[TrackedBody]) -> Vec<(String, String)> {
    let first = Column::ALL.iter().map(|q| (q.column().to_string(), q.unit()));
    let of_body = |body: &TrackedBody| {
        let name = body.name.clone();
        let quantities = [Quantity::Force, Quantity::Work, Quantity::Position];
        quantities.into_iter().flat_map(move |quantity| {
            let column = quantity.column().replace("BODY", &name);
            let columns = match column.strip_suffix("{x,y,z}") {
                Some(prefix) => ["x", "y", "z"].map(|axis| format!("{prefix}{axis}")).to_vec(),
                None => vec![column],
            };
            columns.into_iter().map(move |column| (column, quantity.unit()))
        })
    };
    first.chain(tracked.iter().flat_map(of_body)).collect()
}

/// Returns the row of a step of length `h` (s).
pub fn row(
    h: f64,
    state: &State,
    report: &StepReport,
    phase: TampingPhase,
    coordination: &Coordination,
    tracked: &[TrackedBody],
) -> StepRow {
    let mut values = Column::values(&StepSource { state, report, phase, coordination }).to_vec();
    // Driven bodies come last.
    let first = state.position.len() - report.reactions.len();
    for body in tracked {
        let reaction = &report.reactions[body.driven];
        let force = reaction.impulse / h;
        let position = state.position[first + body.driven];
        values.extend([force.x, force.y, force.z, reaction.work]);
        values.extend([position.x, position.y, position.z]);
    }
    StepRow(values)
}

impl StepRow {
    /// Returns the value of one of the first columns.
    pub fn get(&self, column: Column) -> f64 {
        self.0[column as usize]
    }

    /// Returns the columns of the `i`-th tracked body.
    fn body(&self, i: usize) -> &[f64] {
        &self.0[Column::COUNT + i * BODY_COLUMNS..][..BODY_COLUMNS]
    }

    /// Returns the phase of the cycle at the end of the step.
    pub fn phase(&self) -> TampingPhase {
        let number = self.get(Column::Phase) as usize;
        TampingPhase::ALL.get(number).copied().unwrap_or(TampingPhase::Done)
    }

    /// Returns the largest of LMGC90's norms (T-11).
    pub fn qm16(&self) -> f64 {
        let [quad, max16, weighted] =
            [Column::ResidualQuad, Column::ResidualMax16, Column::ResidualWeighted]
                .map(|column| self.get(column));
        quad.max(max16).max(weighted)
    }

    /// Returns the mean force of the step on the `i`-th tracked body, N.
    pub fn force(&self, i: usize) -> [f64; 3] {
        [self.body(i)[0], self.body(i)[1], self.body(i)[2]]
    }

    /// Returns the work of the `i`-th tracked body on the ballast during the step, J.
    pub fn work(&self, i: usize) -> f64 {
        self.body(i)[3]
    }

    /// Returns the position of the reference point of the `i`-th tracked body, m.
    pub fn position(&self, i: usize) -> [f64; 3] {
        [self.body(i)[4], self.body(i)[5], self.body(i)[6]]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ballast::math::Vec3;
    use ballast::state::EnergyLedger;
    use ballast::step::{ComplementarityGap, ForceCheck, Reaction, Residuals};

    /// Step in which all figures differ.
    fn step() -> (State, StepReport, Coordination) {
        let state = State {
            step: 7,
            time_ns: 1_400_000,
            position: vec![Vec3::zeros(), Vec3::zeros(), Vec3::new(0.1, 0.2, 0.3)],
            energy: EnergyLedger {
                initial_kinetic: 0.5,
                initial_potential: 13.0,
                initial_elastic: 0.5,
                kinetic: 1.25,
                potential: 16.5,
                elastic: 0.5,
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
            open_impulse: 0.5,
            total_impulse: 2.0,
            limited_rotations: 7,
            force_check: ForceCheck { difference: 0.25, total: 5.0 },
            complementarity: ComplementarityGap { gap: 0.01, infeasible: 0.02 },
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
    fn row_has_the_values_of_its_columns() {
        let (state, mut report, coordination) = step();
        let tracked = [TrackedBody { name: "left".into(), role: Role::Tine, driven: 1 }];
        let hold = TampingPhase::Hold;
        let row =
            |report: &StepReport| super::row(2e-4, &state, report, hold, &coordination, &tracked);
        let taken = row(&report);
        let phases = "0 waiting, 1 lift, 2 insertion, 3 squeeze, 4 hold, 5 withdrawal, 6 release, 7 traffic, 8 done";
        let expected = [
            ("time", "s", 1.4e-3),
            ("phase", phases, 4.0),
            ("contacts", "", 11.0),
            ("active_contacts", "", 9.0),
            ("interface_contacts", "", 6.0),
            ("subdomains", "", 5.0),
            ("iterations", "", 40.0),
            ("visits", "", 440.0),
            ("residual_quad", "", 0.125),
            ("residual_max16", "", 0.25),
            ("residual_weighted", "", 0.0625),
            ("residual_natural_map", "", 0.03125),
            ("converged", "", 1.0),
            ("sync_fallback", "", 0.0),
            ("solve_passes", "", 12.0),
            ("open_impulse", "N s", 0.5),
            ("total_impulse", "N s", 2.0),
            ("limited_rotations", "", 7.0),
            ("force_difference", "N s", 0.25),
            ("force_compared", "N s", 5.0),
            ("complementarity_gap", "J", 0.01),
            ("infeasible_work", "J", 0.02),
            ("mean_penetration", "m", 1e-6),
            ("max_penetration", "m", 1e-5),
            ("coordination", "", 5.5),
            ("points_per_grain", "", 8.25),
            ("rattlers", "", 3.0),
            ("kinetic", "J", 1.25),
            ("potential", "J", 16.5),
            ("elastic", "J", 0.5),
            ("external_work", "J", 3.75),
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
        let columns = columns(&tracked);
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
        assert_eq!((taken.work(0), taken.position(0)), (0.75, [0.1, 0.2, 0.3]));
        (report.converged, report.sync_fallback) = (false, true);
        let taken = row(&report);
        assert_eq!([Column::Converged, Column::SyncFallback].map(|c| taken.get(c)), [0.0, 1.0]);
    }

    #[test]
    fn phase_is_restored_from_its_number() {
        let (state, report, coordination) = step();
        for phase in TampingPhase::ALL {
            assert_eq!(row(2e-4, &state, &report, phase, &coordination, &[]).phase(), phase);
        }
    }
}
