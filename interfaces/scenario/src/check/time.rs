//! Checks of `[run]` and `[solver]`, and conversion of times to whole nanoseconds.

use crate::case_file::{CaseFile, PartitionMethod, SolverSection};
use crate::diagnostic::DiagnosticText;
use crate::report::DiagnosticReport;
use crate::resolve;
use ballast::model::{self, PartitionRule, Stepping};
use ballast::track::plan::RunPlan;

/// Tolerance above which a step moves as if it had hardly been solved.
const MAX_USEFUL_TOLERANCE: f64 = 1e-2;

/// Maximum time step that resolves contacts of stones, s.
const MAX_USEFUL_STEP: f64 = 5e-3;

/// Converts seconds to whole nanoseconds, at least 1; `None` if they are not whole.
fn whole_ns(seconds: f64) -> Option<u64> {
    let ns = seconds * 1e9;
    let whole = ns.round();
    ((1.0..1e16).contains(&whole) && (ns - whole).abs() <= 1e-3 + 1e-15 * whole)
        .then_some(whole as u64)
}

/// Returns the time step at `key`, ns; 1 ns if it is invalid.
pub fn step_ns(seconds: f64, key: &str, report: &mut DiagnosticReport) -> u64 {
    let ns = whole_ns(seconds);
    if ns.is_none() && report.is_clean(&[key]) {
        let text = DiagnosticText {
            problem: "a time step is a whole number of nanoseconds".into(),
            found: format!("{seconds:?} s"),
            expected: format!("for example {:e} s", (seconds * 1e9).round().max(1.0) / 1e9),
            hint: None,
        };
        report.error(key, text);
    }
    ns.unwrap_or(1)
}

/// Returns the time at `key`, ns, which must be whole steps of `step` ns.
fn whole_steps(seconds: f64, step: u64, key: &str, report: &mut DiagnosticReport) -> u64 {
    if seconds == 0.0 || !report.is_clean(&["run.step_s", key]) {
        return 0;
    }
    if let Some(ns) = whole_ns(seconds).filter(|ns| ns % step == 0) {
        return ns;
    }
    let below = (seconds * 1e9 / step as f64).floor();
    let time = |n: f64| format!("{}", (n * step as f64).round() / 1e9);
    let choices = match below >= 1.0 {
        true => format!("{} or {} s", time(below), time(below + 1.0)),
        false => format!("{} s", time(1.0)),
    };
    let text = DiagnosticText {
        problem: format!(
            "`{}` is not a whole number of time steps",
            key.trim_start_matches("run.")
        ),
        found: format!(
            "{seconds:?} s, {:.3} steps of {} s",
            seconds * 1e9 / step as f64,
            time(1.0)
        ),
        expected: choices,
        hint: None,
    };
    report.error(key, text);
    step
}

/// Returns the plan of the run.
pub fn run(case: &CaseFile, report: &mut DiagnosticReport) -> RunPlan {
    let run = &case.run;
    let step = step_ns(run.step_s, "run.step_s", report);
    let output_ns = match run.output_interval_s {
        Some(every) => whole_steps(every, step, "run.output_interval_s", report),
        None => step * ((10_000_000 + step / 2) / step).max(1),
    };
    let distance = run.detection_distance_m.unwrap_or(Stepping::default_detection_distance(step));
    check_detection_distance(distance, case, report);
    step_length(case, report);
    let duration_ns = whole_steps(run.duration_s, step, "run.duration_s", report);
    let checkpoint_ns =
        whole_steps(run.checkpoint_interval_s, step, "run.checkpoint_interval_s", report);
    let what = "frames only before the first step and at the end";
    interval_within_run(output_ns, duration_ns, "run.output_interval_s", what, report);
    let what = "no checkpoint by simulated time before the end";
    interval_within_run(checkpoint_ns, duration_ns, "run.checkpoint_interval_s", what, report);
    RunPlan {
        stepping: Stepping { step_ns: step, theta: run.theta, detection_distance: distance },
        solver: solver(&case.solver, report),
        restitution: run.restitution,
        duration_ns,
        output_ns,
        checkpoint_ns,
    }
}

/// Warns of a time step that is far too long for contacts of stones.
fn step_length(case: &CaseFile, report: &mut DiagnosticReport) {
    let (key, step) = ("run.step_s", case.run.step_s);
    if report.is_clean(&["run"]) && step > MAX_USEFUL_STEP {
        let text = DiagnosticText {
            problem: "the time step is far too long for contacts of stones".into(),
            found: format!("{step} s"),
            expected: format!("at most {MAX_USEFUL_STEP} s; 2e-4 to 1e-3 are usual"),
            hint: None,
        };
        report.warn(key, text);
    }
}

/// Warns of an interval, ns, at `key` that is longer than the run.
fn interval_within_run(
    interval: u64,
    duration: u64,
    key: &str,
    consequence: &str,
    report: &mut DiagnosticReport,
) {
    if interval <= duration || !report.document.has(key) || !report.is_clean(&["run"]) {
        return;
    }
    let seconds = |ns: u64| ns as f64 / 1e9;
    let text = DiagnosticText {
        problem: "the interval is longer than the run".into(),
        found: format!("{} s: {consequence}", seconds(interval)),
        expected: format!("less than `duration_s`, {} s; 0 for none", seconds(duration)),
        hint: None,
    };
    report.warn(key, text);
}

fn check_detection_distance(distance: f64, case: &CaseFile, report: &mut DiagnosticReport) {
    let grains = resolve::grains(&case.bed.grains);
    let (smallest, largest) = (grains.min_size(), grains.max_size());
    let keys =
        ["run.detection_distance_m", "run.step_s", "bed.grains.classes", "bed.grains.grading"];
    if !report.is_clean(&keys) || distance <= 0.25 * smallest {
        return;
    }
    let key = report.written_key(&keys);
    // The number of contacts grows with the third power of the distance.
    let is_error = distance > largest;
    let (limit, what) = match is_error {
        true => (largest, "the largest grain"),
        false => (0.25 * smallest, "a quarter of the smallest grain"),
    };
    let text = if key == "run.step_s" {
        let step = case.run.step_s;
        DiagnosticText {
            problem: "the time step is too long for the grains".into(),
            found: format!("{step:?} s, with contacts detected from {distance:?} m"),
            expected: format!(
                "at most {:.4} s: contacts are detected from {:?} m/s times the step, at most {what}",
                limit * step / distance,
                distance / step
            ),
            hint: Some("`detection_distance_m` sets the distance independently of the step".into()),
        }
    } else {
        DiagnosticText {
            problem: "contacts are detected from very far away".into(),
            found: format!("{distance:?} m"),
            expected: format!("at most {what}, {limit} m"),
            hint: Some("most of these contacts cost time and carry no force".into()),
        }
    };
    match is_error {
        true => report.error(key, text),
        false => report.warn(key, text),
    }
}

fn solver(solver: &SolverSection, report: &mut DiagnosticReport) -> model::Solver {
    unused(solver, report);
    if report.is_clean(&["solver.tolerance"]) && solver.tolerance > MAX_USEFUL_TOLERANCE {
        let text = DiagnosticText {
            problem: "a tolerance this large leaves the step nearly unsolved".into(),
            found: solver.tolerance.to_string(),
            expected: format!("at most {MAX_USEFUL_TOLERANCE}; 1.666e-4 is usual"),
            hint: None,
        };
        report.warn("solver.tolerance", text);
    }
    model::Solver {
        schedule: solver.schedule,
        partition: partition(solver, report),
        max_iterations: solver.max_iterations,
        subdomain_sweeps: solver.subdomain_sweeps,
        interface_sweeps: solver.interface_sweeps,
        tolerance: (solver.tolerance > 0.0).then_some(solver.tolerance),
        norm: solver.norm,
        convergence_check_interval: solver.convergence_check_interval,
        force_check_interval: solver.force_check_interval,
        relaxation: solver.relaxation,
        warm_start_factor: solver.warm_start_factor,
        acceleration: solver.acceleration,
        skip_converged_subdomains: solver.skip_converged_subdomains,
        penetration_correction: solver.penetration_correction.map(|c| {
            model::PenetrationCorrection {
                factor: c.factor,
                slop: c.slop_m,
                iterations: c.iterations,
            }
        }),
    }
}

/// Returns the rule of `[solver.partition]`; reports a missing key of its method and each key of another method.
fn partition(solver: &SolverSection, report: &mut DiagnosticReport) -> PartitionRule {
    let section = &solver.partition;
    let (method, key) = match section.method {
        PartitionMethod::TargetSize => ("target_size", "contacts_per_subdomain"),
        PartitionMethod::Balanced => ("balanced", "subdomains"),
        PartitionMethod::Boxes => ("boxes", "boxes"),
    };
    for (other, is_written) in [
        ("boxes", section.boxes.is_some()),
        ("subdomains", section.subdomains.is_some()),
        ("contacts_per_subdomain", section.contacts_per_subdomain.is_some()),
    ] {
        if is_written && other != key {
            let text = DiagnosticText {
                problem: format!("`{other}` contradicts the method \"{method}\""),
                found: "a key of another method".into(),
                expected: format!("`{key}` or another `method`"),
                hint: Some(format!("remove `{other}`")),
            };
            report.error(&format!("solver.partition.{other}"), text);
        }
    }
    let default = model::Solver::default().partition;
    let rule = match section.method {
        PartitionMethod::TargetSize => section
            .contacts_per_subdomain
            .map_or(Some(default), |n| Some(PartitionRule::ContactsPer(n))),
        PartitionMethod::Balanced => section.subdomains.map(PartitionRule::Balanced),
        PartitionMethod::Boxes => section.boxes.map(PartitionRule::Boxes),
    };
    let path = format!("solver.partition.{key}");
    let Some(rule) = rule else {
        let text = DiagnosticText {
            problem: format!("missing key `{key}`"),
            found: format!("the method \"{method}\""),
            expected: format!("`{key}` in `[solver.partition]`"),
            hint: None,
        };
        report.error(&path, text);
        return default;
    };
    let count = rule.requested_subdomains();
    if count > PartitionRule::MAX_SUBDOMAINS {
        let text = DiagnosticText {
            problem: "too many subdomains".into(),
            found: count.to_string(),
            expected: format!("at most {}", PartitionRule::MAX_SUBDOMAINS),
            hint: None,
        };
        report.error(&path, text);
    }
    rule
}

/// Warns of keys that are written but have no effect.
fn unused(solver: &SolverSection, report: &mut DiagnosticReport) {
    const SKIP: &str = "skip_converged_subdomains";
    let keys: &[&str] = match (solver.tolerance > 0.0, solver.schedule) {
        (false, model::Schedule::Sequential) => {
            &["norm", "acceleration", "partition", "interface_sweeps", SKIP]
        }
        (false, _) => &["norm", "acceleration", SKIP],
        (true, model::Schedule::Asynchronous) => &["acceleration", SKIP],
        (true, model::Schedule::Sequential) => &["partition", "interface_sweeps", SKIP],
        _ if solver.acceleration == model::Acceleration::None => &[SKIP],
        _ => &[],
    };
    for key in keys {
        let path = format!("solver.{key}");
        if report.document.has(&path) {
            let text = DiagnosticText {
                problem: format!("`{key}` has no effect"),
                found: match *key {
                    "norm" => "a norm without a tolerance",
                    "acceleration" => {
                        "acceleration without a tolerance, or with the asynchronous schedule"
                    }
                    SKIP => "skipped subdomains without tolerance, acceleration or the synchronous schedule",
                    _ => "a division of the bed with the sequential schedule",
                }
                .into(),
                ..DiagnosticText::default()
            };
            report.warn(&path, text);
        }
    }
}
