//! Summary of a whole run, computed from the rows of its tables.
//!
//! The only inputs are rows and the last state. A resumed run reads the earlier rows back and therefore ends with the
//! figures of a run without interruption.

use crate::phase_figures::{ContactWork, PhaseForce, larger};
use crate::quantities::Quantity as Q;
use crate::record::{Column, StepRow, TrackedBody};
use crate::statistics::{MovingMean, Statistics, norm};
use ballast::model::Role;
use ballast::state::State;
use ballast::track::{TampingPhase, plan::LoadCycles};
use ballast_hdf5::results::ResultsTable;
use serde_json::{Value, json};

/// Settings of a summary, known before the run.
#[derive(Debug, Clone, Default)]
pub struct SummarySettings {
    /// Tines and sleepers.
    pub tracked: Vec<TrackedBody>,
    /// Names of the zones.
    pub zones: Vec<String>,
    /// Steps per vibration period; 1 without vibration.
    pub period: usize,
    /// Grain size `d` that penetrations are compared with, m.
    pub grain_size: f64,
    /// True if the solver has a tolerance; without one, steps take all iterations.
    pub has_tolerance: bool,
    /// Targets of each tracked body, if the case has any.
    pub targets: Vec<Option<Targets>>,
    /// Traffic after the cycle with its start, s.
    pub traffic: Option<(f64, LoadCycles)>,
}

/// Targets of a tine in a cycle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Targets {
    /// Height of the reference point at full depth, m.
    pub depth_z: f64,
    /// Closing in the squeeze, m.
    pub closing: f64,
    /// Direction of the closing along x: 1 or -1.
    pub direction: f64,
}

/// Summary of a run up to the last row taken.
#[derive(Debug, Clone, Default)]
pub struct RunSummary {
    settings: SummarySettings,
    /// Number of steps.
    pub steps: u64,
    /// Number of steps that did not converge.
    pub not_converged: u64,
    /// Number of steps re-solved synchronously.
    pub sync_fallback: u64,
    /// Number of steps re-solved for missed contacts.
    pub resolved: u64,
    /// Number of contact visits.
    pub visits: f64,
    /// Contacts per step.
    pub contacts: Statistics,
    /// Active contacts per step.
    pub active_contacts: Statistics,
    /// Interface contacts per step.
    pub interface_contacts: Statistics,
    /// Subdomains per step.
    pub subdomains: Statistics,
    /// Iterations per step.
    pub iterations: Statistics,
    /// Impulses on pairs that end open, and on all pairs, N s.
    pub open_and_total_impulse: [f64; 2],
    /// Sums of the differences and of the magnitudes of the impulses of checked steps, N s.
    pub force_difference_and_compared: [f64; 2],
    /// Contact work of each phase of the cycle.
    pub contact_work: [ContactWork; TampingPhase::ALL.len()],
    /// Touching grains whose energy was limited, over the steps.
    pub limited_rotations: u64,
    /// Largest of LMGC90's norms.
    pub residual: Statistics,
    /// Natural map residual of the steps.
    pub natural_map: Statistics,
    /// Mean penetration of the steps, m.
    pub mean_penetration: Statistics,
    /// Largest penetration of the steps, m.
    pub max_penetration: Statistics,
    /// Energy of the steps in which contacts released more than they dissipated, J.
    pub spurious_contact_energy: f64,
    /// Touching neighbours per grain at the first step, at the minimum and at the last step.
    pub coordination: Option<[TimedValue; 3]>,
    /// Tines and sleepers.
    pub bodies: Vec<BodySummary>,
    /// First and last observation of each zone.
    pub compactness: Vec<[f64; 2]>,
    /// Grains that have left the bed by the end; `None` before the end.
    pub lost: Option<usize>,
    /// Number of steps before the first one taken; a replay may start within a run.
    pub from_step: u64,
    /// Time of the last state, s.
    time: f64,
    /// Dissipated energy of the last state, J.
    dissipated: f64,
    last: Option<StepRow>,
}

/// Value at a time of the run.
#[derive(Debug, Clone, PartialEq)]
pub struct TimedValue {
    /// Value in the unit of the quantity.
    pub value: f64,
    /// Time, s.
    pub time: f64,
    /// Phase of the cycle.
    pub phase: TampingPhase,
}

/// Summary of a tine or sleeper: forces, work, lowest position.
#[derive(Debug, Clone)]
pub struct BodySummary {
    /// Largest force of one step, N.
    pub peak: Option<TimedValue>,
    /// Largest force averaged over a vibration period, N; `None` before the first whole period.
    pub period_peak: Option<f64>,
    /// Force during the insertion.
    pub insertion: PhaseForce,
    /// Force during the squeeze.
    pub squeeze: PhaseForce,
    /// Work on the ballast, J.
    pub work: f64,
    /// Lowest position of the reference point, m.
    pub min_z: f64,
    /// Position of the reference point along x before the squeeze, m.
    squeeze_start_x: Option<f64>,
    /// Extremes of the displacement along x in the squeeze, m.
    squeeze_displacement: Option<[f64; 2]>,
    /// Heights of the reference point before the traffic and at the end of each of its cycles, m.
    traffic_z: Vec<f64>,
    recent: MovingMean,
}

impl RunSummary {
    /// Creates an empty summary for a run from its beginning.
    pub fn new(settings: SummarySettings) -> Self {
        let body = BodySummary {
            peak: None,
            period_peak: None,
            insertion: PhaseForce::of(TampingPhase::Insertion, settings.period),
            squeeze: PhaseForce::of(TampingPhase::Squeeze, settings.period),
            work: 0.0,
            min_z: f64::INFINITY,
            squeeze_start_x: None,
            squeeze_displacement: None,
            traffic_z: Vec::new(),
            recent: MovingMean::new(settings.period),
        };
        Self { bodies: vec![body; settings.tracked.len()], settings, ..Self::default() }
    }

    /// Returns the summary for a run that starts at `state`.
    pub fn starting_at(self, state: &State) -> Self {
        Self {
            from_step: state.step,
            time: state.time(),
            dissipated: state.energy.dissipated,
            ..self
        }
    }

    /// Returns the share of the impulses on pairs that end their step open; `None` without impulses.
    pub fn open_impulse_share(&self) -> Option<f64> {
        let [open, total] = self.open_and_total_impulse;
        (total > 0.0).then(|| open / total)
    }

    /// Returns the relative difference of forces between two solutions of the checked steps; `None` without any.
    pub fn force_error(&self) -> Option<f64> {
        let [difference, compared] = self.force_difference_and_compared;
        (compared > 0.0).then(|| difference / compared)
    }

    /// Returns the contact work of all steps.
    pub fn total_contact_work(&self) -> ContactWork {
        self.contact_work.iter().copied().sum()
    }

    /// Adds a row of the table `steps`.
    pub fn take_step(&mut self, row: &StepRow) {
        self.steps += 1;
        self.not_converged += u64::from(row.get(Column::Converged) == 0.0);
        self.sync_fallback += u64::from(row.get(Column::SyncFallback) != 0.0);
        self.resolved += u64::from(row.get(Column::SolvePasses) > 1.0);
        self.visits += row.get(Column::Visits);
        self.open_and_total_impulse[0] += row.get(Column::OpenImpulse);
        self.open_and_total_impulse[1] += row.get(Column::TotalImpulse);
        self.force_difference_and_compared[0] += row.get(Column::ForceDifference);
        self.force_difference_and_compared[1] += row.get(Column::ForceCompared);
        self.limited_rotations += row.get(Column::LimitedRotations) as u64;
        self.residual.take(row.qm16());
        for (statistics, column) in [
            (&mut self.contacts, Column::Contacts),
            (&mut self.active_contacts, Column::ActiveContacts),
            (&mut self.interface_contacts, Column::InterfaceContacts),
            (&mut self.subdomains, Column::Subdomains),
            (&mut self.iterations, Column::Iterations),
            (&mut self.natural_map, Column::ResidualNaturalMap),
            (&mut self.mean_penetration, Column::MeanPenetration),
            (&mut self.max_penetration, Column::MaxPenetration),
        ] {
            statistics.take(row.get(column));
        }
        let dissipated = row.get(Column::Dissipated);
        self.spurious_contact_energy += (self.dissipated - dissipated).max(0.0);
        self.contact_work[row.phase() as usize].take(row, dissipated - self.dissipated);
        self.time = row.get(Column::Time);
        self.dissipated = dissipated;
        self.take_coordination(row);
        let cycle = self.settings.traffic.as_ref().and_then(|(start, load)| {
            // A cycle ends with the step that ends with it, whatever the sums of seconds are rounded to.
            let cycle = ((self.time - start) * load.frequency - 1e-6).ceil().max(0.0);
            (cycle <= f64::from(load.cycles)).then_some(cycle as usize)
        });
        for (i, body) in self.bodies.iter_mut().enumerate() {
            body.take(row, i);
            if let Some(cycle) = cycle {
                body.traffic_z.resize(cycle + 1, f64::NAN);
                body.traffic_z[cycle] = row.position(i)[2];
            }
        }
        self.last = Some(row.clone());
    }

    /// Adds the tables of a results file up to step `last`, and returns the number of steps added.
    pub fn take_tables(&mut self, steps: &ResultsTable, zones: &ResultsTable, last: u64) -> u64 {
        let rows = |table: &ResultsTable| -> Vec<StepRow> {
            let upto = table.steps.iter().filter(|step| **step <= last).count();
            let rows = table.rows.chunks_exact(table.columns.len().max(1));
            rows.take(upto).map(|row| StepRow(row.to_vec())).collect()
        };
        let steps = rows(steps);
        steps.iter().for_each(|row| self.take_step(row));
        rows(zones).iter().for_each(|row| self.take_zones(&row.0[1..]));
        steps.len() as u64
    }

    /// Adds an observation of the compactness of each zone.
    pub fn take_zones(&mut self, compactness: &[f64]) {
        if self.compactness.is_empty() {
            self.compactness = compactness.iter().map(|value| [*value, *value]).collect();
        }
        for (zone, value) in self.compactness.iter_mut().zip(compactness) {
            zone[1] = *value;
        }
    }

    fn take_coordination(&mut self, row: &StepRow) {
        let now = timed(row, row.get(Column::Coordination));
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

    /// Settings of the summary.
    pub fn settings(&self) -> &SummarySettings {
        &self.settings
    }

    /// Returns the number of steps that did not converge; `None` without a tolerance. A partner may set a tolerance that the
    /// case does not have.
    pub fn not_converged(&self) -> Option<u64> {
        (self.settings.has_tolerance || self.not_converged > 0).then_some(self.not_converged)
    }

    /// Returns the distance of each tine to its target depth after the insertion, m.
    pub fn depth_shortfalls(&self) -> Vec<f64> {
        let lowered = |body: &BodySummary| !body.insertion.single.is_empty();
        self.shortfalls(|targets, body| lowered(body).then_some(body.min_z - targets.depth_z))
    }

    /// Returns the distance of each tine to its target closing after the squeeze, m.
    pub fn closing_shortfalls(&self) -> Vec<f64> {
        self.shortfalls(|targets, body| Some(targets.closing - body.max_closing(targets)?))
    }

    /// Returns the distances to a target after the phase of holding, for bodies with targets.
    fn shortfalls(&self, of: impl Fn(&Targets, &BodySummary) -> Option<f64>) -> Vec<f64> {
        let is_over = self.last.as_ref().is_some_and(|row| row.phase() > TampingPhase::Hold);
        let bodies = self.settings.targets.iter().zip(&self.bodies).filter(|_| is_over);
        bodies.filter_map(|(targets, body)| of(targets.as_ref()?, body)).collect()
    }

    /// Returns the last row.
    pub fn last(&self) -> Option<&StepRow> {
        self.last.as_ref()
    }

    /// Returns the summary as JSON, without timings.
    pub fn json(&self) -> Value {
        let d = self.settings.grain_size;
        let SummarySettings { tracked, targets, .. } = &self.settings;
        let named = tracked.iter().zip(targets).zip(&self.bodies);
        let bodies = |role: Role| -> Value {
            named
                .clone()
                .filter(|((tracked, _), _)| tracked.role == role)
                .map(|((tracked, targets), body)| {
                    (tracked.name.clone(), body.json(targets.as_ref()))
                })
                .collect::<serde_json::Map<_, _>>()
                .into()
        };
        let zones = self.settings.zones.iter().zip(&self.compactness);
        let last = |column| self.last.as_ref().map(|row| row.get(column));
        let has_steps = self.steps > 0;
        let contact_work = self.total_contact_work();
        json!({
            (Q::Steps.key()): self.steps,
            (Q::FromStep.key()): self.from_step,
            (Q::Time.key()): self.time,
            "compactness": zones
                .map(|(name, [before, after])| {
                    (name.clone(), json!({ "before": before, "after": after }))
                })
                .collect::<serde_json::Map<_, _>>(),
            (Q::Coordination.key()): self.coordination.as_ref().map(|[start, minimum, end]| json!({
                "start": start.value, "minimum": minimum.json(), "end": end.value,
                (Q::PointsPerGrain.key()): last(Column::PointsPerGrain),
                (Q::Rattlers.key()): last(Column::Rattlers),
            })),
            "tines": bodies(Role::Tine),
            "sleepers": bodies(Role::Sleeper),
            "plates": bodies(Role::Plate),
            "relative_penetration": {
                (Q::MeanPenetration.key()): has_steps.then(|| self.mean_penetration.mean() / d),
                (Q::MaxPenetration.key()): has_steps.then(|| self.max_penetration.max() / d),
                (Q::GrainSize.key()): d,
            },
            (Q::GrainsLost.key()): self.lost,
            "energy_J": {
                (Q::Kinetic.key()): last(Column::Kinetic),
                (Q::Potential.key()): last(Column::Potential),
                (Q::Elastic.key()): last(Column::Elastic),
                (Q::ExternalWork.key()): last(Column::ExternalWork),
                (Q::Dissipated.key()): last(Column::Dissipated),
                (Q::BalanceError.key()): last(Column::BalanceError),
                (Q::SpuriousContactEnergy.key()): self.spurious_contact_energy,
                (Q::ComplementarityGap.key()): contact_work.gap,
                (Q::InfeasibleWork.key()): contact_work.infeasible,
            },
            "solver": {
                (Q::Contacts.key()): self.contacts.json(),
                (Q::ActiveContacts.key()): self.active_contacts.json(),
                (Q::InterfaceContacts.key()): self.interface_contacts.json(),
                (Q::Subdomains.key()): self.subdomains.json(),
                (Q::Visits.key()): self.visits,
                (Q::Iterations.key()): self.iterations.json(),
                (Q::ResidualQm16.key()): self.residual.json(),
                (Q::ResidualNaturalMap.key()): self.natural_map.json(),
                (Q::StepsNotConverged.key()): self.not_converged(),
                (Q::SyncFallback.key()): self.sync_fallback,
                (Q::StepsResolved.key()): self.resolved,
                (Q::OpenImpulseShare.key()): self.open_impulse_share(),
                (Q::ForceError.key()): self.force_error(),
                (Q::ComplementarityError.key()): json!({
                    "run": contact_work.error(),
                    "insertion": self.contact_work[TampingPhase::Insertion as usize].error(),
                    "squeeze": self.contact_work[TampingPhase::Squeeze as usize].error(),
                }),
                (Q::LimitedRotations.key()): self.limited_rotations,
            },
        })
    }
}

impl BodySummary {
    /// Adds the columns of the `i`-th tracked body.
    fn take(&mut self, row: &StepRow, i: usize) {
        let force = row.force(i);
        let magnitude = norm(force);
        if self.peak.as_ref().is_none_or(|peak| magnitude > peak.value) {
            self.peak = Some(timed(row, magnitude));
        }
        self.work += row.work(i);
        let [x, _, z] = row.position(i);
        self.min_z = self.min_z.min(z);
        self.take_squeeze(row.phase(), x);
        if let Some(mean) = self.recent.take(force) {
            self.period_peak = larger(self.period_peak, norm(mean));
        }
        self.insertion.take(row.phase(), force);
        self.squeeze.take(row.phase(), force);
    }

    fn take_squeeze(&mut self, phase: TampingPhase, x: f64) {
        if phase < TampingPhase::Squeeze {
            self.squeeze_start_x = Some(x);
        } else if phase == TampingPhase::Squeeze {
            let displacement = x - *self.squeeze_start_x.get_or_insert(x);
            let [low, high] = self.squeeze_displacement.unwrap_or([displacement; 2]);
            self.squeeze_displacement = Some([low.min(displacement), high.max(displacement)]);
        }
    }

    /// Returns the settlement at the end of each cycle of the traffic, m; empty without traffic.
    pub fn traffic_settlements(&self) -> Vec<f64> {
        let mut levels = self.traffic_z.iter();
        let start = levels.next().copied().unwrap_or(f64::NAN);
        levels.map(|z| start - z).collect()
    }

    /// Returns the largest closing in the squeeze, m; `None` before the squeeze.
    fn max_closing(&self, targets: &Targets) -> Option<f64> {
        let [low, high] = self.squeeze_displacement?;
        Some(if targets.direction > 0.0 { high } else { -low })
    }

    fn json(&self, targets: Option<&Targets>) -> Value {
        let mut json = json!({
            (Q::PeakForce.key()): self.peak.as_ref().map(TimedValue::json),
            (Q::PeakPeriodAveragedForce.key()): self.period_peak,
            "insertion": self.insertion.json(),
            "squeeze": self.squeeze.json(),
            (Q::Work.key()): self.work,
            (Q::MinZ.key()): self.min_z,
        });
        if let Some(targets) = targets {
            json[Q::TargetDepthZ.key()] = json!(targets.depth_z);
            json[Q::MaxClosing.key()] = json!(self.max_closing(targets));
            json[Q::TargetClosing.key()] = json!(targets.closing);
        }
        if targets.is_none() && self.traffic_z.len() > 1 {
            json[Q::TrafficSettlement.key()] = json!(self.traffic_settlements());
        }
        json
    }
}

impl TimedValue {
    fn json(&self) -> Value {
        json!({ "value": self.value, "time_s": self.time, "phase": self.phase.name() })
    }
}

/// Returns the settlement in the last cycle, m, from the settlements at the end of each; 0 without a cycle.
pub fn last_cycle(settlements: &[f64]) -> f64 {
    match settlements {
        [] => 0.0,
        [only] => *only,
        [.., before, last] => last - before,
    }
}

fn timed(row: &StepRow, value: f64) -> TimedValue {
    TimedValue { value, time: row.get(Column::Time), phase: row.phase() }
}

#[cfg(test)]
#[path = "summary_tests.rs"]
mod tests;
