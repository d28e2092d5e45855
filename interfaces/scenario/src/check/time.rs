//! Checks of `[run]` and `[solver]`, and conversion of times to whole nanoseconds.

use crate::case_file::{CaseFile, PartitionMethod, SolverSection};
use crate::diagnostic::DiagnosticText;
use crate::report::DiagnosticReport;
use ballast::model::{self, PartitionRule, Stepping};
use ballast::track::plan::RunPlan;

/// Tolerance above which a step moves as if it had hardly been solved.
const MAX_USEFUL_TOLERANCE: f64 = 1e-2;

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
    RunPlan {
        stepping: Stepping { step_ns: step, theta: run.theta, detection_distance: distance },
        solver: solver(&case.solver, report),
        restitution: run.restitution,
        duration_ns: whole_steps(run.duration_s, step, "run.duration_s", report),
        output_ns,
        checkpoint_ns: whole_steps(
            run.checkpoint_interval_s,
            step,
            "run.checkpoint_interval_s",
            report,
        ),
    }
}

fn check_detection_distance(distance: f64, case: &CaseFile, report: &mut DiagnosticReport) {
    let classes = &case.bed.grains.classes;
    let sizes = || classes.iter().map(|c| c.size_m);
    let (smallest, largest) = (sizes().fold(f64::INFINITY, f64::min), sizes().fold(0.0, f64::max));
    if !report.is_clean(&["run.detection_distance_m", "bed.grains.classes"])
        || distance <= 0.25 * smallest
    {
        return;
    }
    let text = DiagnosticText {
        problem: "contacts are detected from very far away".into(),
        found: format!("{distance:?} m"),
        expected: format!("at most a quarter of the smallest grain, {} m", 0.25 * smallest),
        hint: Some("most of these contacts cost time and carry no force".into()),
    };
    // The number of contacts grows with the third power of the distance.
    if distance > largest {
        let expected = format!("at most the largest grain, {largest} m");
        report.error("run.detection_distance_m", DiagnosticText { expected, ..text });
    } else {
        report.warn("run.detection_distance_m", text);
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
        relaxation: solver.relaxation,
        warm_start_factor: solver.warm_start_factor,
        acceleration: solver.acceleration,
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
    let keys: &[&str] = match (solver.tolerance > 0.0, solver.schedule) {
        (false, model::Schedule::Sequential) => {
            &["norm", "acceleration", "partition", "interface_sweeps"]
        }
        (false, _) => &["norm", "acceleration"],
        (true, model::Schedule::Asynchronous) => &["acceleration"],
        (true, model::Schedule::Sequential) => &["partition", "interface_sweeps"],
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
                    _ => "a division of the bed with the sequential schedule",
                }
                .into(),
                ..DiagnosticText::default()
            };
            report.warn(&path, text);
        }
    }
}
