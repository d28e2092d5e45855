//! `ballast bench sample FILE`: timings of a neutral sample that other programs can run, too.
//!
//! Measures the steps only, not reading and writing of files.

use super::args::SampleArgs;
use super::machine_info::MachineInfo;
use super::result_sheet::{ResultSheet, SheetValue};
use super::stop_rule::check_tolerance;
use super::variant::DETECTION;
use ballast::drive::StepInputs;
use ballast::model::{Model, PartitionRule};
use ballast::observe::{lost_grains, mean_speed};
use ballast::state::State;
use ballast::step::{Phase, StepReport, step};
use ballast::workspace::Workspace;
use ballast_scenario::sample::{self, Sample};
use ballast_session::files::{expect_different, read_sample, replace_text};
use ballast_session::profile::{PhaseTime, Profile};
use ballast_session::statistics::Statistics;
use ballast_session::{Failure, Reporter, Result};
use serde_json::{Value, json};

/// Columns of the table, each with the JSON pointer of its value.
const FIGURES: [(&str, &str); 20] = [
    ("sample", "/sample"),
    ("grains", "/grains"),
    ("steps", "/steps"),
    ("detection_distance_m", "/detection_distance_m"),
    ("threads", "/threads"),
    ("schedule", "/schedule"),
    ("subdomains", "/subdomains"),
    ("contacts", "/contacts/mean"),
    ("active_contacts", "/active_contacts/mean"),
    ("iterations", "/sweeps/mean"),
    ("visits", "/visits"),
    ("residual_qm16", "/residual_qm16/mean"),
    ("steps_not_converged", "/steps_not_converged"),
    ("detection_cpu_us_per_grain_step", "/detection_us_per_grain_step/cpu"),
    ("cpu_ns_per_visit", "/ns_per_visit/cpu"),
    ("wall_ms_per_step", "/ms_per_step/wall"),
    ("cpu_ms_per_step", "/ms_per_step/cpu"),
    ("mean_penetration_m", "/penetration_m/mean_end"),
    ("max_penetration_m", "/penetration_m/max_end"),
    ("state_hash", "/state_hash"),
];
const COLUMNS: [&str; FIGURES.len()] = {
    let mut names = [""; FIGURES.len()];
    let mut k = 0;
    while k < names.len() {
        names[k] = FIGURES[k].0;
        k += 1;
    }
    names
};

/// Runs a sample and prints its timings as one line of JSON.
///
/// # Errors
/// A file that cannot be read or written, or a step that fails.
pub fn sample(args: SampleArgs, console: &dyn Reporter) -> Result {
    let csv = args.csv.csv.as_deref();
    let save = args.save.as_deref();
    expect_different(&[("the sample", Some(&args.file)), ("--csv", csv), ("--save", save)])?;
    let machine = MachineInfo::observe();
    let mut sample = read_sample(&args.file)?;
    apply_options(&args, &mut sample)?;
    let steps = args.steps.unwrap_or(sample.steps);
    let mut trial = SampleTrial::default();
    let mut profile = Profile::start();
    run(&mut sample, steps, &mut trial, &mut profile)?;
    let mut figures = figures(&sample, steps, &trial, &profile);
    figures["sample"] = json!(args.file.display().to_string());
    console.line(&figures.to_string());
    if let Some(path) = csv {
        let mut sheet = ResultSheet::new(&COLUMNS);
        let of = |(_, place)| figures.pointer(place).map_or(SheetValue::Nothing, SheetValue::from);
        sheet.row(FIGURES.map(of).into());
        sheet.write(&machine, path)?;
    }
    if let Some(path) = save {
        let text = sample::write(&sample.model, &sample.state, sample.steps, &sample.meta);
        replace_text(path, &text)?;
    }
    Ok(())
}

/// Applies the options of the command line to the sample.
fn apply_options(args: &SampleArgs, sample: &mut Sample) -> Result {
    args.detection.apply(&mut sample.model.stepping)?;
    let solver = &mut sample.model.solver;
    solver.schedule = args.schedule.into();
    if let Some(iterations) = args.iterations {
        solver.max_iterations = iterations.get();
        solver.tolerance = None;
    }
    if let Some(tolerance) = args.tolerance {
        check_tolerance(tolerance)?;
        // A sample with a fixed number of sweeps has no maximum.
        if solver.tolerance.is_none() {
            solver.max_iterations = 10_000;
        }
        solver.tolerance = Some(tolerance);
    }
    if let Some(subdomains) = args.subdomains {
        let rule = PartitionRule::Balanced(subdomains.get());
        let max = PartitionRule::MAX_SUBDOMAINS;
        if rule.requested_subdomains() > max {
            let text = format!("--subdomains: expected 1 to {max}, found {subdomains}");
            return Err(Failure::Usage(text));
        }
        solver.partition = rule;
    }
    Ok(())
}

/// Figures of the steps.
#[derive(Default)]
struct SampleTrial {
    contacts: Statistics,
    active: Statistics,
    iterations: Statistics,
    residual: Statistics,
    visits: u64,
    not_converged: u64,
    fallback: u64,
    resolved: u64,
    first: Option<StepReport>,
    last: StepReport,
}

impl SampleTrial {
    fn take(&mut self, report: StepReport) {
        self.contacts.take(report.contacts as f64);
        self.active.take(report.active_contacts as f64);
        self.iterations.take(f64::from(report.iterations));
        self.residual.take(report.residuals.qm16());
        self.visits += report.visits;
        self.not_converged += u64::from(!report.converged);
        self.fallback += u64::from(report.sync_fallback);
        self.resolved += u64::from(report.solve_passes > 1);
        self.first.get_or_insert_with(|| report.clone());
        self.last = report;
    }
}

fn run(sample: &mut Sample, steps: u64, trial: &mut SampleTrial, profile: &mut Profile) -> Result {
    let Sample { model, state, .. } = sample;
    let still = state.imposed_poses(model);
    let mut workspace = Workspace::default();
    for _ in 0..steps {
        profile.output();
        let inputs = StepInputs::from_targets(&still);
        let report = step(model, state, &inputs, &mut workspace, profile)?;
        trial.take(report);
    }
    Ok(())
}

fn figures(sample: &Sample, steps: u64, trial: &SampleTrial, profile: &Profile) -> Value {
    let Sample { model, state, .. } = sample;
    let grains = model.grains.len();
    let spent = profile.steps();
    let detection = DETECTION.map(|phase| profile.of(phase)).into_iter().sum();
    let grain_steps = grains as f64 * steps as f64;
    let start = trial.first.as_ref();
    json!({
        "grains": grains,
        "steps": steps,
        "detection_distance_m": model.stepping.detection_distance,
        "threads": rayon::current_num_threads(),
        "schedule": format!("{:?}", model.solver.schedule).to_lowercase(),
        "subdomains": trial.last.subdomains,
        "interface_contacts": trial.last.interface_contacts,
        "contacts": trial.contacts.json(),
        "active_contacts": trial.active.json(),
        "sweeps": trial.iterations.json(),
        "visits": trial.visits,
        "residual_qm16": trial.residual.json(),
        "last_residuals": {
            "quad": trial.last.residuals.quad, "max16": trial.last.residuals.max16,
            "weighted": trial.last.residuals.weighted,
            "natural_map": trial.last.residuals.natural_map,
        },
        // Undefined without a tolerance.
        "steps_not_converged": model.solver.tolerance.map(|_| trial.not_converged),
        "steps_sync_fallback": trial.fallback,
        "steps_resolved": trial.resolved,
        "phases": profile.json(),
        "detection_us_per_grain_step": per(detection, 1e6, grain_steps),
        "ns_per_visit": per(profile.of(Phase::Solve), 1e9, trial.visits as f64),
        "ms_per_step": per(spent, 1e3, steps as f64),
        "penetration_m": {
            "max_start": start.map(|r| r.max_penetration),
            "mean_start": start.map(|r| r.mean_penetration),
            "max_end": trial.last.max_penetration, "mean_end": trial.last.mean_penetration,
        },
        "mean_speed_m_per_s": mean_speed(model, state),
        "kinetic_energy_j": state.energy.kinetic,
        "centre_of_mass_height_m": centre_of_mass_height(model, state),
        "grains_lost": lost_grains(model, state),
        "state_hash": format!("{:032x}", ballast_hdf5::state_hash(model, state)),
    })
}

/// Returns wall and CPU time per item in units of `1 / scale` s.
fn per(spent: PhaseTime, scale: f64, count: f64) -> Value {
    let each = |seconds: f64| if count > 0.0 { scale * seconds / count } else { 0.0 };
    json!({ "wall": each(spent.wall.as_secs_f64()), "cpu": each(spent.cpu.as_secs_f64()) })
}

fn centre_of_mass_height(model: &Model, state: &State) -> f64 {
    let mass: f64 = model.grains.mass.iter().sum();
    let moment: f64 = model.grains.mass.iter().zip(&state.position).map(|(m, p)| m * p.z).sum();
    if mass > 0.0 { moment / mass } else { 0.0 }
}
