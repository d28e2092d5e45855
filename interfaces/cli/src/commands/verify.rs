//! `ballast verify FILE`: recomputes a recording and compares.

use crate::args::VerifyArgs;
use crate::case::{self, Case, CaseOverrides, first_other_line};
use crate::console::Console;
use crate::progress::ConsoleProgress;
use crate::{beds, interrupt, recording_start};
use ballast::model::Schedule;
use ballast::track;
use ballast_mcap::RecordingMetadata;
use ballast_mcap::recording::WindowReader;
use ballast_mcap::verify::{Difference, VerificationResult};
use ballast_session::{Failure, ProgressLabel, ProgressMeter, Reporter, Result};
use serde_json::{Value, json};
use std::sync::Arc;

pub fn verify(args: VerifyArgs, console: Console) -> Result {
    interrupt::install()?;
    let mut windows = WindowReader::open(&args.file)?;
    let meta = windows.meta().clone();
    if meta.schedule == Schedule::Asynchronous.name() {
        let what = "expected the sequential or the synchronous schedule, found the asynchronous one, whose order of operations \
                    cannot be repeated";
        return Err(Failure::at(&args.file, what));
    }
    let case = case::recorded(&windows, args.case.as_deref(), CaseOverrides::default(), &console)?;
    let (model, state) = beds::scene(&case, &args.beds.bed_cache, &console)?;
    let (model, state) = recording_start::initial_scene(&windows, &case, model, state)?;
    let mut component = case::component(&case, Arc::new(model), state)?;
    let mut progress = ConsoleProgress::start(console, "verify");
    let begin_ns = component.now_ns();
    let end_ns = windows.end_time_hint_ns().unwrap_or(case.plan.run.duration_ns);
    let whole = end_ns.saturating_sub(begin_ns).max(1) as f64;
    let mut watch = |now_ns: u64| {
        progress.advance(
            (now_ns.saturating_sub(begin_ns) as f64 / whole).min(1.0),
            &VerifyLabel(now_ns),
        );
        interrupt::flow()
    };
    let zones = track::zones(&case.plan);
    let verdict = ballast_mcap::verify(
        &mut windows,
        &mut component,
        &zones,
        ballast_hdf5::state_hash,
        &mut watch,
    )?;
    progress.finish();
    let file = args.file.display();
    match verdict {
        VerificationResult::Identical { windows: count } => {
            match windows.truncation() {
                Some(lost) if !lost.is_cut => {
                    let text =
                        format!("{file}: {count} windows are equal, the rest is damaged: {lost}");
                    return Err(Failure::Failed(text));
                }
                Some(lost) => console.warning(&format!("{file}: {lost}")),
                None => {}
            }
            if count == 0 {
                return Err(Failure::Failed(format!(
                    "{file}: expected windows to compare, found none"
                )));
            }
            let now = component.state().time();
            let lost = windows.truncation().map(|lost| lost.reason.clone());
            console.event("verified", json!({ "windows": count, "time_s": now, "lost": lost }));
            console.result(&format!("{file}: {count} windows up to {now:.4} s, all equal"));
            Ok(())
        }
        VerificationResult::Different(difference) => Err(Failure::Mismatch(format!(
            "{file}: {difference}{}",
            hint(&difference, &meta, &case)
        ))),
        VerificationResult::Stopped { windows: count } => {
            Err(Failure::Interrupted(format!("stopped after {count} equal windows")))
        }
    }
}

/// Returns possible reasons of a difference.
fn hint(difference: &Difference, meta: &RecordingMetadata, case: &Case) -> String {
    let pairs = [
        ("case", meta.case_name.clone(), case.plan.name.clone()),
        ("bed", meta.case_key.clone(), case.bed_key()),
        ("step (ns)", meta.step_ns.to_string(), case.plan.run.stepping.step_ns.to_string()),
        ("schedule", meta.schedule.clone(), case.plan.run.solver.schedule.name().to_string()),
        ("program", meta.program.clone(), concat!("ballast ", env!("CARGO_PKG_VERSION")).into()),
    ];
    let mut differ: Vec<String> = pairs
        .iter()
        .filter(|(_, recorded, here)| recorded != here)
        .map(|(what, recorded, here)| format!("{what}: recorded {recorded}, here {here}"))
        .collect();
    differ.extend(first_other_line(&meta.case_text, &case.text));
    if differ.is_empty() && difference.seq > 0 {
        return String::new();
    }
    if differ.is_empty() {
        let text = "case and program are the recorded ones; the bed may come from another build: prepare it again with \
                    `ballast prepare CASE --force` (and the same `--bed-cache`)";
        differ.push(text.into());
    }
    format!("; {}", differ.join("; "))
}

/// Label of the time that a verification has reached, ns.
struct VerifyLabel(u64);

impl ProgressLabel for VerifyLabel {
    fn text(&self) -> String {
        format!("{:.4} s", self.0 as f64 * 1e-9)
    }

    fn fields(&self) -> Value {
        json!({ "time_s": self.0 as f64 / 1e9 })
    }
}
