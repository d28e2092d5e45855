//! The figures of a whole run, gathered from the rows of its tables.
//!
//! Nothing but rows and the last state goes in, so a resumed run, which reads the earlier rows back, ends with the
//! same figures as one that was never interrupted.

use crate::record::{Column, Followed, Row};
use crate::statistics::{MovingMean, Statistics, norm};
use ballast::model::Role;
use ballast::state::State;
use ballast::track::TampingPhase;
use ballast_hdf5::results::Table;
use serde_json::{Value, json};

/// What the summary needs to know of the run beforehand.
#[derive(Debug, Clone)]
pub struct Setting {
    pub followed: Vec<Followed>,
    /// Names of the zones.
    pub zones: Vec<String>,
    /// Steps per vibration period; 1 without vibration.
    pub period: usize,
    /// Size `d` that penetrations are compared with, m.
    pub grain_size: f64,
    /// Whether steps are to converge: without a tolerance they take all their iterations.
    pub has_tolerance: bool,
    /// What the case asks of each followed body, where it says.
    pub asked: Vec<Option<Asked>>,
}

/// How far a tine is to come in a cycle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Asked {
    /// Height of its reference point at full depth, m.
    pub lowest: f64,
    /// How far it is to close in the squeeze, m, and to which side along x: 1 or -1.
    pub closing: f64,
    pub direction: f64,
}

/// Figures of a run so far.
#[derive(Debug, Clone)]
pub struct Summary {
    setting: Setting,
    pub steps: u64,
    pub not_converged: u64,
    pub guarded: u64,
    pub repeated: u64,
    pub visits: f64,
    pub contacts: Statistics,
    pub active_contacts: Statistics,
    pub interface_contacts: Statistics,
    pub subdomains: Statistics,
    pub iterations: Statistics,
    /// The largest of LMGC90's norms.
    pub residual: Statistics,
    pub natural_map: Statistics,
    pub mean_penetration: Statistics,
    pub max_penetration: Statistics,
    /// Energy of the steps in which contacts gave more than they took, J.
    pub created: f64,
    /// At the first step, at the step of the minimum, at the last one.
    pub coordination: Option<[Moment; 3]>,
    pub bodies: Vec<BodyFigures>,
    /// First and last observation of each zone.
    pub compactness: Vec<[f64; 2]>,
    /// Grains that have left the bed by the end, once that is told.
    pub lost: Option<usize>,
    /// Steps of the run before the first of these: a replay may begin within a run.
    pub from_step: u64,
    /// Time and dissipated energy of the last state, s and J.
    time: f64,
    dissipated: f64,
    last: Option<Row>,
}

/// A value at a moment of the run.
#[derive(Debug, Clone, PartialEq)]
pub struct Moment {
    pub value: f64,
    /// s.
    pub time: f64,
    pub phase: TampingPhase,
}

/// Force on a tine or sleeper, N, and its work on the ballast, J.
#[derive(Debug, Clone)]
pub struct BodyFigures {
    /// Largest force of one step, and when.
    pub peak: Option<Moment>,
    /// Largest mean over a vibration period, once there was a whole one.
    pub period_peak: Option<f64>,
    /// While the tines go down, and while they close.
    pub insertion: PhaseForce,
    pub squeeze: PhaseForce,
    pub work: f64,
    /// Lowest place of the reference point so far, m.
    pub lowest: f64,
    /// Where the reference point was along x before the squeeze, and the extremes of its way from there in it, m.
    squeezed_from: Option<f64>,
    squeezed: Option<[f64; 2]>,
    recent: MovingMean,
}

/// Force in one phase of the cycle, N.
#[derive(Debug, Clone)]
pub struct PhaseForce {
    phase: TampingPhase,
    /// Sizes of the forces of single steps.
    pub single: Statistics,
    sum: [f64; 3],
    /// Largest mean over a vibration period that lies in the phase as a whole.
    pub period_peak: Option<f64>,
    recent: MovingMean,
}

impl PhaseForce {
    fn of(phase: TampingPhase, period: usize) -> Self {
        let recent = MovingMean::new(period);
        Self { phase, single: Statistics::default(), sum: [0.0; 3], period_peak: None, recent }
    }

    fn take(&mut self, phase: TampingPhase, force: [f64; 3]) {
        if phase != self.phase {
            // What the phase is left with is no part of its next period.
            return self.recent.clear();
        }
        self.single.take(norm(force));
        self.sum = std::array::from_fn(|k| self.sum[k] + force[k]);
        if let Some(mean) = self.recent.take(force) {
            self.period_peak = larger(self.period_peak, norm(mean));
        }
    }

    /// Mean size of the force, where the phase has begun.
    pub fn mean_size(&self) -> Option<f64> {
        (!self.single.is_empty()).then(|| self.single.mean())
    }

    /// Size of impulse over duration: what pushes to and fro cancels.
    fn resultant(&self) -> Option<f64> {
        (!self.single.is_empty()).then(|| norm(self.sum) / self.single.count() as f64)
    }

    fn json(&self) -> Value {
        json!({
            "mean_force_n": self.mean_size(), "resultant_n": self.resultant(),
            "peak_force_n": (!self.single.is_empty()).then(|| self.single.max()),
            "peak_period_mean_n": self.period_peak,
        })
    }
}

fn larger(most: Option<f64>, value: f64) -> Option<f64> {
    Some(most.map_or(value, |most| most.max(value)))
}

impl Summary {
    /// A summary of nothing yet, from the beginning of a run.
    pub fn new(setting: Setting) -> Self {
        let body = BodyFigures {
            peak: None,
            period_peak: None,
            insertion: PhaseForce::of(TampingPhase::Insertion, setting.period),
            squeeze: PhaseForce::of(TampingPhase::Squeeze, setting.period),
            work: 0.0,
            lowest: f64::INFINITY,
            squeezed_from: None,
            squeezed: None,
            recent: MovingMean::new(setting.period),
        };
        Self {
            bodies: vec![body; setting.followed.len()],
            setting,
            steps: 0,
            not_converged: 0,
            guarded: 0,
            repeated: 0,
            visits: 0.0,
            contacts: Statistics::default(),
            active_contacts: Statistics::default(),
            interface_contacts: Statistics::default(),
            subdomains: Statistics::default(),
            iterations: Statistics::default(),
            residual: Statistics::default(),
            natural_map: Statistics::default(),
            mean_penetration: Statistics::default(),
            max_penetration: Statistics::default(),
            created: 0.0,
            coordination: None,
            compactness: Vec::new(),
            lost: None,
            from_step: 0,
            time: 0.0,
            dissipated: 0.0,
            last: None,
        }
    }

    /// The same of what comes after `state`.
    pub fn after(self, state: &State) -> Self {
        let (from_step, time, dissipated) = (state.step, state.time(), state.energy.dissipated);
        Self { from_step, time, dissipated, ..self }
    }

    /// Takes a row of the table of steps.
    pub fn take_step(&mut self, row: &Row) {
        self.steps += 1;
        self.not_converged += u64::from(row.get(Column::Converged) == 0.0);
        self.guarded += u64::from(row.get(Column::Guarded) != 0.0);
        self.repeated += u64::from(row.get(Column::Attempts) > 1.0);
        self.visits += row.get(Column::Visits);
        self.residual.take(row.qm16());
        for (statistics, column) in [
            (&mut self.contacts, Column::Contacts),
            (&mut self.active_contacts, Column::ActiveContacts),
            (&mut self.interface_contacts, Column::InterfaceContacts),
            (&mut self.subdomains, Column::Subdomains),
            (&mut self.iterations, Column::Iterations),
            (&mut self.natural_map, Column::NaturalMap),
            (&mut self.mean_penetration, Column::MeanPenetration),
            (&mut self.max_penetration, Column::MaxPenetration),
        ] {
            statistics.take(row.get(column));
        }
        let dissipated = row.get(Column::Dissipated);
        self.created += (self.dissipated - dissipated).max(0.0);
        (self.time, self.dissipated) = (row.get(Column::Time), dissipated);
        self.take_coordination(row);
        for (i, body) in self.bodies.iter_mut().enumerate() {
            body.take(row, i);
        }
        self.last = Some(row.clone());
    }

    /// Takes the tables of a results file up to step `last`: as many rows of steps as are returned.
    pub fn take_tables(&mut self, steps: &Table, zones: &Table, last: u64) -> u64 {
        let rows = |table: &Table| -> Vec<Row> {
            let upto = table.steps.iter().filter(|step| **step <= last).count();
            let rows = table.rows.chunks_exact(table.columns.len().max(1));
            rows.take(upto).map(|row| Row(row.to_vec())).collect()
        };
        let steps = rows(steps);
        steps.iter().for_each(|row| self.take_step(row));
        rows(zones).iter().for_each(|row| self.take_zones(&row.0[1..]));
        steps.len() as u64
    }

    /// Takes the compactness of each zone at a moment.
    pub fn take_zones(&mut self, compactness: &[f64]) {
        if self.compactness.is_empty() {
            self.compactness = compactness.iter().map(|value| [*value, *value]).collect();
        }
        for (zone, value) in self.compactness.iter_mut().zip(compactness) {
            zone[1] = *value;
        }
    }

    fn take_coordination(&mut self, row: &Row) {
        let now = moment(row, row.get(Column::Coordination));
        match &mut self.coordination {
            None => self.coordination = Some([now.clone(), now.clone(), now]),
            Some([_, minimum, last]) => {
                if now.value < minimum.value {
                    *minimum = now.clone();
                }
                *last = now;
            }
        }
    }

    pub fn setting(&self) -> &Setting {
        &self.setting
    }

    /// Steps that did not converge, where they were to: a partner may ask for a tolerance that the case has not.
    pub fn not_converged(&self) -> Option<u64> {
        (self.setting.has_tolerance || self.not_converged > 0).then_some(self.not_converged)
    }

    /// How far each tine that has been lowered as long as the case allows is from the depth that it asks, m.
    pub fn short_of_depth(&self) -> Vec<f64> {
        let lowered = |body: &BodyFigures| !body.insertion.single.is_empty();
        self.short(|asked, body| lowered(body).then_some(body.lowest - asked.lowest))
    }

    /// How far each tine is at its farthest from the closing that the case asks, m.
    pub fn short_of_closing(&self) -> Vec<f64> {
        self.short(|asked, body| Some(asked.closing - body.closed(asked)?))
    }

    /// What is short of what the case asks, body by body, once that is over.
    fn short(&self, of: impl Fn(&Asked, &BodyFigures) -> Option<f64>) -> Vec<f64> {
        let is_over = self.last.as_ref().is_some_and(|row| row.phase() > TampingPhase::Hold);
        let bodies = self.setting.asked.iter().zip(&self.bodies).filter(|_| is_over);
        bodies.filter_map(|(asked, body)| of(asked.as_ref()?, body)).collect()
    }

    /// The last row, if there is one.
    pub fn last(&self) -> Option<&Row> {
        self.last.as_ref()
    }

    /// Everything that does not depend on the machine the run was made on.
    pub fn json(&self) -> Value {
        let d = self.setting.grain_size;
        let Setting { followed, asked, .. } = &self.setting;
        let named = followed.iter().zip(asked).zip(&self.bodies);
        let bodies = |role: Role| -> Value {
            named
                .clone()
                .filter(|((followed, _), _)| followed.role == role)
                .map(|((followed, asked), body)| (followed.name.clone(), body.json(asked.as_ref())))
                .collect::<serde_json::Map<_, _>>()
                .into()
        };
        let zones = self.setting.zones.iter().zip(&self.compactness);
        let last = |column| self.last.as_ref().map(|row| row.get(column));
        let has_steps = self.steps > 0;
        json!({
            "steps": self.steps,
            "from_step": self.from_step,
            "time_s": self.time,
            "compactness": zones
                .map(|(name, [before, after])| {
                    (name.clone(), json!({ "before": before, "after": after }))
                })
                .collect::<serde_json::Map<_, _>>(),
            "coordination": self.coordination.as_ref().map(|[start, minimum, end]| json!({
                "start": start.value, "minimum": minimum.json(), "end": end.value,
                "points_per_grain": last(Column::PointsPerGrain), "rattlers": last(Column::Rattlers),
            })),
            "tines": bodies(Role::Tine),
            "sleepers": bodies(Role::Sleeper),
            "penetration_over_d": {
                "mean": has_steps.then(|| self.mean_penetration.mean() / d),
                "max": has_steps.then(|| self.max_penetration.max() / d),
                "grain_size_m": d,
            },
            "grains_lost": self.lost,
            "energy_j": {
                "kinetic": last(Column::Kinetic), "potential": last(Column::Potential),
                "work_in": last(Column::WorkIn), "dissipated": last(Column::Dissipated),
                "balance_error": last(Column::BalanceError), "created": self.created,
            },
            "solver": {
                "contacts": self.contacts.json(), "active_contacts": self.active_contacts.json(),
                "interface_contacts": self.interface_contacts.json(),
                "subdomains": self.subdomains.json(), "visits": self.visits,
                "iterations": self.iterations.json(), "residual_qm16": self.residual.json(),
                "residual_natural_map": self.natural_map.json(),
                "steps_not_converged": self.not_converged(), "steps_guarded": self.guarded,
                "steps_repeated": self.repeated,
            },
        })
    }
}

impl BodyFigures {
    /// Takes what the row says of the `i`-th followed body.
    fn take(&mut self, row: &Row, i: usize) {
        let force = row.force(i);
        let size = norm(force);
        if self.peak.as_ref().is_none_or(|peak| size > peak.value) {
            self.peak = Some(moment(row, size));
        }
        self.work += row.work(i);
        let [x, _, z] = row.place(i);
        self.lowest = self.lowest.min(z);
        self.take_squeeze(row.phase(), x);
        if let Some(mean) = self.recent.take(force) {
            self.period_peak = larger(self.period_peak, norm(mean));
        }
        self.insertion.take(row.phase(), force);
        self.squeeze.take(row.phase(), force);
    }

    fn take_squeeze(&mut self, phase: TampingPhase, x: f64) {
        if phase < TampingPhase::Squeeze {
            self.squeezed_from = Some(x);
        } else if phase == TampingPhase::Squeeze {
            let way = x - *self.squeezed_from.get_or_insert(x);
            let [low, high] = self.squeezed.unwrap_or([way, way]);
            self.squeezed = Some([low.min(way), high.max(way)]);
        }
    }

    /// How far it has come in the squeeze towards where it is to close, m; none before that.
    fn closed(&self, asked: &Asked) -> Option<f64> {
        let [low, high] = self.squeezed?;
        Some(if asked.direction > 0.0 { high } else { -low })
    }

    fn json(&self, asked: Option<&Asked>) -> Value {
        let mut told = self.figures();
        if let Some(asked) = asked {
            told["asked_lowest_m"] = json!(asked.lowest);
            told["closed_m"] = json!(self.closed(asked));
            told["asked_closing_m"] = json!(asked.closing);
        }
        told
    }

    fn figures(&self) -> Value {
        json!({
            "peak_force_n": self.peak.as_ref().map(Moment::json),
            "peak_period_mean_n": self.period_peak,
            "insertion": self.insertion.json(),
            "squeeze": self.squeeze.json(),
            "work_j": self.work,
            "lowest_m": self.lowest,
        })
    }
}

impl Moment {
    fn json(&self) -> Value {
        json!({ "value": self.value, "time_s": self.time, "phase": self.phase.name() })
    }
}

fn moment(row: &Row, value: f64) -> Moment {
    Moment { value, time: row.get(Column::Time), phase: row.phase() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::columns;

    fn setting() -> Setting {
        let tine = Followed { name: "left".into(), role: Role::Tine, driven: 0 };
        Setting {
            followed: vec![tine],
            zones: vec!["under".into()],
            period: 2,
            grain_size: 0.02,
            has_tolerance: true,
            asked: vec![Some(Asked { lowest: 0.65, closing: 0.03, direction: -1.0 })],
        }
    }

    fn step(time: f64, phase: f64, coordination: f64, force: f64, converged: bool) -> Row {
        let names = columns(&setting().followed);
        let mut row = Row(vec![0.0; names.len()]);
        let mut set = |name: &str, value: f64| {
            row.0[names.iter().position(|n| n.0 == name).unwrap()] = value;
        };
        set("time", time);
        set("phase", phase);
        set("coordination", coordination);
        set("points_per_grain", 1.5 * coordination);
        set("rattlers", 10.0 * time);
        set("converged", f64::from(u8::from(converged)));
        set("max_penetration", 0.001 * time);
        set("dissipated", 4.0 - time.min(2.0));
        set("left_force_x", force);
        set("left_work", 2.0);
        set("left_z", 1.0 - 0.1 * time);
        set("left_x", 0.5 - 0.01 * time);
        row
    }

    #[test]
    fn figures_of_a_short_cycle() {
        let mut summary = Summary::new(setting());
        summary.take_step(&step(1.0, 2.0, 6.0, 900.0, true));
        summary.take_step(&step(2.0, 3.0, 4.5, -300.0, false));
        summary.take_step(&step(3.0, 3.0, 5.0, 500.0, true));
        for value in [0.58, 0.60, 0.61] {
            summary.take_zones(&[value]);
        }
        let json = summary.json();
        assert_eq!(json["coordination"]["start"], 6.0);
        assert_eq!(json["coordination"]["minimum"]["value"], 4.5);
        assert_eq!(json["coordination"]["minimum"]["phase"], "squeeze");
        assert_eq!(json["coordination"]["end"], 5.0);
        assert_eq!(json["coordination"]["points_per_grain"], 7.5);
        assert_eq!(json["coordination"]["rattlers"], 30.0);
        let tine = &json["tines"]["left"];
        assert_eq!(tine["peak_force_n"]["value"], 900.0);
        assert_eq!(tine["peak_period_mean_n"], 300.0);
        assert_eq!(tine["squeeze"]["mean_force_n"], 400.0);
        assert_eq!(tine["squeeze"]["resultant_n"], 100.0);
        assert_eq!(tine["squeeze"]["peak_force_n"], 500.0);
        // The period with the last step of the insertion in it counts for the whole run only.
        assert_eq!(tine["squeeze"]["peak_period_mean_n"], 100.0);
        assert!(tine["insertion"]["peak_period_mean_n"].is_null());
        assert_eq!(tine["work_j"], 6.0);
        assert_eq!(tine["insertion"]["mean_force_n"], 900.0);
        assert_eq!(tine["lowest_m"], 1.0 - 0.1 * 3.0);
        // Two steps of the squeeze since the last one before it.
        assert!((tine["closed_m"].as_f64().unwrap() - 0.02).abs() < 1e-12);
        assert_eq!(
            (&tine["asked_closing_m"], &tine["asked_lowest_m"]),
            (&json!(0.03), &json!(0.65))
        );
        assert_eq!(json["compactness"]["under"]["before"], 0.58);
        assert_eq!(json["compactness"]["under"]["after"], 0.61);
        assert_eq!(json["penetration_over_d"]["max"], 0.15);
        assert_eq!(json["solver"]["steps_not_converged"], 1);
        assert_eq!(json["energy_j"]["dissipated"], 2.0);
        assert_eq!(json["energy_j"]["created"], 1.0);
        assert_eq!((&json["time_s"], &json["from_step"]), (&json!(3.0), &json!(0)));
        summary.take_step(&step(4.0, 5.0, 5.0, 0.0, true));
        assert!((summary.short_of_closing()[0] - 0.01).abs() < 1e-12);
    }

    #[test]
    fn what_nothing_asked_for_is_not_told_as_reached() {
        let mut summary = Summary::new(Setting { has_tolerance: false, ..setting() });
        summary.take_step(&step(1.0, 2.0, 6.0, 900.0, true));
        assert!(summary.json()["solver"]["steps_not_converged"].is_null());
        assert!(summary.short_of_depth().is_empty(), "it is still on its way");
        summary.take_step(&step(3.0, 5.0, 6.0, 0.0, true));
        assert!((summary.short_of_depth()[0] - 0.05).abs() < 1e-12);
        assert!(summary.short_of_closing().is_empty(), "there was no squeeze");
        // A partner has asked for one.
        summary.take_step(&step(4.0, 5.0, 6.0, 0.0, false));
        assert_eq!(summary.json()["solver"]["steps_not_converged"], 1);
    }

    #[test]
    fn an_empty_run_has_a_summary_too() {
        let json = Summary::new(setting()).json();
        assert_eq!((&json["steps"], &json["time_s"]), (&json!(0), &json!(0.0)));
        assert!(json["solver"]["residual_qm16"]["max"].is_null());
        assert!(json["penetration_over_d"]["mean"].is_null());
        assert!(json["coordination"].is_null());
    }
}
