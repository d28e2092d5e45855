//! `ballast probe`: support stiffness and lateral resistance of a sleeper.

use super::expected_file::ExpectedFile;
use crate::args::{ProbeArgs, ProbeCommand, PushArgs, StiffnessArgs};
use crate::case::{self, CaseOverrides};
use crate::console::Console;
use crate::files::{check_writable, csv_text, replace_text};
use crate::table::{TextTable, figure};
use crate::{beds, interrupt};
use ballast::component::{
    ProbePoint, PushCurve, PushProbe, Refusal, StepObserver, StiffnessProbe, StopReason,
    find_sleeper, sleepers,
};
use ballast::model::Model;
use ballast::state::State;
use ballast::step::StepReport;
use ballast_hdf5::checkpoint;
use ballast_session::{Failure, ProgressLabel, ProgressMeter, Reporter, Result};
use serde_json::{Value, json};
use std::ops::ControlFlow;
use std::path::Path;

pub fn probe(command: ProbeCommand, console: Console) -> Result {
    interrupt::install()?;
    match command {
        ProbeCommand::Stiffness(args) => stiffness(&args, console),
        ProbeCommand::Push(args) => push(&args, console),
    }
}

fn stiffness(args: &StiffnessArgs, console: Console) -> Result {
    let StiffnessArgs { probe: common, max_load, min_load, cycles, ramp } = args;
    let probe =
        StiffnessProbe { max_load: *max_load, min_load: *min_load, cycles: *cycles, ramp: *ramp };
    let bed = ProbedBed::open(common, console)?;
    let mut progress = ProbeProgress::start(&bed.name, probe.duration(), console);
    let curve = probe.run(&bed.model, &bed.state, bed.sleeper, &mut progress).map_err(failed)?;
    progress.meter.finish();
    write_curve(common.out.as_deref(), ["load_N", "settlement_m"], &curve.points)?;
    let title = format!("support of {} up to {} N", bed.name, figure(*max_load, 4));
    let header = ["loading (kN/mm)", "unloading (kN/mm)", "settlement (mm)", "rest (mm)"];
    let mut table = TextTable::new(&title, header);
    for (k, cycle) in curve.cycles.iter().enumerate() {
        let stiffness = [cycle.loading, cycle.unloading].map(|k| figure(1e-6 * k, 4));
        let settlements = [cycle.settlement, cycle.rest].map(|s| figure(1e3 * s, 4));
        let cells = stiffness.into_iter().chain(settlements);
        table.row(std::iter::once(format!("cycle {}", k + 1)).chain(cells));
    }
    console.result(&table.text());
    let cycles: Vec<Value> = curve
        .cycles
        .iter()
        .map(|c| {
            json!({ "loading_N_per_m": c.loading, "unloading_N_per_m": c.unloading,
                    "settlement_m": c.settlement, "rest_m": c.rest })
        })
        .collect();
    console.event("support_stiffness", json!({ "sleeper": bed.name, "cycles": cycles }));
    Ok(())
}

fn push(args: &PushArgs, console: Console) -> Result {
    let PushArgs { probe: common, displacement, speed } = args;
    let probe = PushProbe { displacement: *displacement, speed: *speed, ..PushProbe::default() };
    let bed = ProbedBed::open(common, console)?;
    let mut progress = ProbeProgress::start(&bed.name, probe.duration(), console);
    let curve = probe.run(&bed.model, &bed.state, bed.sleeper, &mut progress).map_err(failed)?;
    progress.meter.finish();
    write_curve(common.out.as_deref(), ["force_N", "displacement_m"], &curve.points)?;
    let largest = curve.points.iter().map(|p| p.force).fold(0.0, f64::max);
    let at_reference = curve.force_at(PushCurve::REFERENCE_DISPLACEMENT);
    let title = format!("push of {} to {} mm", bed.name, figure(1e3 * displacement, 4));
    let mut table = TextTable::new(&title, ["force (N)", "force / weight"]);
    let mut row = |what: &str, force: Option<f64>| {
        let cells = [force, force.map(|f| f / curve.weight)];
        let cells = cells.map(|value| value.map_or("-".into(), |value| figure(value, 4)));
        table.row(std::iter::once(what.to_string()).chain(cells));
    };
    row("at 2 mm", at_reference);
    row("largest", Some(largest));
    console.result(&table.text());
    let fields = json!({ "sleeper": bed.name, "force_at_2_mm_N": at_reference,
                         "largest_force_N": largest, "weight_N": curve.weight });
    console.event("lateral_resistance", fields);
    Ok(())
}

/// Bed with the sleeper to probe.
struct ProbedBed {
    model: Model,
    state: State,
    /// Number among the driven bodies.
    sleeper: usize,
    name: String,
}

impl ProbedBed {
    fn open(args: &ProbeArgs, console: Console) -> Result<Self> {
        if let Some(out) = &args.out {
            check_writable(out)?;
        }
        let is_case = args.from.extension().is_some_and(|e| e == "toml");
        let (model, state) = if is_case {
            let case = case::load(&args.from, &CaseOverrides::default(), &console)?;
            beds::scene(&case, &args.beds.bed_cache, &console)?
        } else {
            let saved = checkpoint::read(ExpectedFile::Checkpoint.find(&args.from)?)?;
            (saved.model, saved.state)
        };
        let sleeper = find_sleeper(&model, args.sleeper.as_deref());
        let known: Vec<&str> = sleepers(&model).map(|d| &model.driven[d].name[..]).collect();
        let Some(sleeper) = sleeper else {
            let found = args.sleeper.as_deref().unwrap_or("none");
            let text = format!("--sleeper: expected one of {known:?}, found {found:?}");
            return Err(Failure::Usage(text));
        };
        if model.is_rigid() {
            console.note(
                "all contacts are rigid: the bed has no stiffness but that of its rearrangement; see `bed.stiffness`",
            );
        }
        let name = model.driven[sleeper].name.clone();
        Ok(Self { model, state, sleeper, name })
    }
}

/// Writes the curve of a probe as CSV, if a file is given.
fn write_curve(out: Option<&Path>, names: [&str; 2], points: &[ProbePoint]) -> Result {
    let Some(out) = out else { return Ok(()) };
    let rows = points.iter().map(|p| [p.time, p.force, p.displacement].map(|x| x.to_string()));
    replace_text(out, &csv_text(&["time_s", names[0], names[1]], rows))
}

fn failed(refusal: Refusal) -> Failure {
    match refusal {
        Refusal::Cancelled => {
            Failure::Interrupted("the probe was stopped; nothing was written".into())
        }
        other => Failure::Failed(other.to_string()),
    }
}

/// Display of a running probe, which a signal ends.
struct ProbeProgress {
    meter: Box<dyn ProgressMeter>,
    /// Simulated duration, s.
    duration: f64,
}

impl ProbeProgress {
    fn start(sleeper: &str, duration: f64, console: Console) -> Self {
        Self { meter: console.start_progress(&format!("probe of {sleeper}")), duration }
    }
}

impl StepObserver for ProbeProgress {
    fn step_finished(&mut self, state: &State, _report: &StepReport) -> ControlFlow<StopReason> {
        self.meter.advance((state.time() / self.duration).min(1.0), &ProbeTime(state.time()));
        ControlFlow::Continue(())
    }

    fn cancelled(&mut self) -> Option<StopReason> {
        interrupt::requested().then_some(StopReason::Cancel)
    }
}

/// Simulated time of a probe, s.
struct ProbeTime(f64);

impl ProgressLabel for ProbeTime {
    fn text(&self) -> String {
        format!("{:.3} s", self.0)
    }

    fn fields(&self) -> Value {
        json!({ "time_s": self.0 })
    }
}
