//! `ballast sweep PLAN`: many runs of a case in parallel, resumable, with one table.

use crate::args::SweepArgs;
use crate::case::{self, CaseOverrides};
use crate::console::Console;
use crate::files::{create_folder, csv_text, read_case, read_text, replace_text};
use crate::interrupt;
use crate::lock::enter;
use ballast_scenario::MAX_CASE_BYTES;
use ballast_scenario::sweep::{SweepPlan, SweepPoint};
use ballast_session::run_files::RunFiles;
use ballast_session::{Failure, Reporter, Result};
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use serde_json::{Map, Value, json};
use std::collections::{BTreeSet, VecDeque};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Mutex;
use std::time::Duration;

/// Interval between two checks of a running process.
const POLL_INTERVAL: Duration = Duration::from_millis(50);

pub fn sweep(args: SweepArgs, console: Console) -> Result {
    interrupt::install()?;
    let name = args.plan.display().to_string();
    let text = read_case(&args.plan, MAX_CASE_BYTES)?;
    let sweep = SweepPlan::parse(&text, &name).map_err(Failure::InvalidCase)?;
    let case = args.plan.parent().unwrap_or(Path::new("")).join(&sweep.case);
    let case_text = read_case(&case, MAX_CASE_BYTES)?;
    let case_name = case.display().to_string();
    let texts = sweep.case_texts(&case_text, &case_name, &name).map_err(Failure::InvalidCase)?;
    let folder = args.out.clone().unwrap_or_else(|| {
        Path::new("runs").join(args.plan.file_stem().unwrap_or(std::ffi::OsStr::new("sweep")))
    });
    let directory = SweepDirectory { folder, sweep };
    if args.list {
        for (number, point) in directory.points() {
            console.result(&format!("{number}  {}", description(point)));
            console.event("point", json!({ "number": number, "values": values(point) }));
        }
        return Ok(());
    }
    let numbers = match args.point {
        None => (1..=directory.sweep.points.len()).collect(),
        Some(number) if directory.sweep.points.get(number.wrapping_sub(1)).is_some() => {
            vec![number]
        }
        Some(number) => {
            let all = directory.sweep.points.len();
            return Err(Failure::Usage(format!("--point: expected 1 to {all}, found {number}")));
        }
    };
    directory.write(&case, &texts)?;
    let failed = directory.compute(&numbers, &args, console)?;
    directory.table()?;
    if interrupt::requested() {
        let text = "stopped; run the same command again to continue";
        return Err(Failure::Interrupted(text.into()));
    }
    let table = directory.folder.join("table.csv");
    console.result(&table.display().to_string());
    console.event("done", json!({ "table": table, "failed": failed }));
    if failed.is_empty() {
        return Ok(());
    }
    let logs: Vec<_> = failed
        .iter()
        .map(|n| directory.point_folder(*n).join("log").display().to_string())
        .collect();
    Err(Failure::Failed(format!(
        "{} of {} failed: {}",
        failed.len(),
        numbers.len(),
        logs.join(", ")
    )))
}

/// Files of a sweep: a manifest, a folder per point, a table.
struct SweepDirectory {
    folder: PathBuf,
    sweep: SweepPlan,
}

impl SweepDirectory {
    /// Returns the points with their indices, from 1.
    fn points(&self) -> impl Iterator<Item = (usize, &SweepPoint)> {
        (1..).zip(&self.sweep.points)
    }

    /// Returns the folder of a point.
    fn point_folder(&self, number: usize) -> PathBuf {
        self.folder.join(name(number))
    }

    fn case(&self, number: usize) -> PathBuf {
        self.point_folder(number).join("case.toml")
    }

    /// Writes manifest and cases.
    ///
    /// # Errors
    /// A folder with the cases of another sweep.
    fn write(&self, case: &Path, texts: &[String]) -> Result {
        create_folder(&self.folder)?;
        for ((number, point), text) in self.points().zip(texts) {
            let path = self.case(number);
            if path.exists() {
                if read_text(&path, MAX_CASE_BYTES)? != *text {
                    return Err(Failure::Usage(format!(
                        "{}: expected point {number} of this plan ({}), found another case; choose another folder with --out",
                        path.display(),
                        description(point)
                    )));
                }
                continue;
            }
            create_folder(&self.point_folder(number))?;
            replace_text(&path, text)?;
        }
        let point = |(number, point): (usize, &SweepPoint)| {
            // Relative to the manifest: a sweep may be moved as a whole.
            json!({ "number": number, "folder": name(number), "values": values(point) })
        };
        let manifest =
            json!({ "case": case, "points": self.points().map(point).collect::<Vec<_>>() });
        replace_text(&self.folder.join("manifest.json"), &format!("{manifest:#}\n"))
    }

    /// Runs the unfinished points, each in a separate process, and returns the indices of those that failed.
    fn compute(&self, numbers: &[usize], args: &SweepArgs, console: Console) -> Result<Vec<usize>> {
        let program = std::env::current_exe()
            .map_err(|e| Failure::Failed(format!("cannot find this program: {e}")))?;
        let open =
            |n: &usize| RunFiles::in_folder(self.point_folder(*n)).complete_summary().is_none();
        let open: Vec<usize> = numbers.iter().copied().filter(open).collect();
        let done = numbers.len() - open.len();
        if done > 0 {
            console.note(&format!("{done} of {} already finished", numbers.len()));
        }
        let mut keys = BTreeSet::new();
        let mut first_of_bed = Vec::new();
        for number in &open {
            let case = case::load(&self.case(*number), &CaseOverrides::default(), &console)?;
            if keys.insert(case.bed_key()) {
                first_of_bed.push(*number);
            }
        }
        // Beds first: runs with the same bed would all prepare it.
        let prepare = |number: usize| {
            let mut command = Command::new(&program);
            command.arg("prepare").arg(self.case(number));
            Some(command)
        };
        let bad_beds =
            self.run_parallel(first_of_bed, args, console, &|_| false, &prepare, &|_, _| {});
        let run = |number: usize| {
            let files = RunFiles::in_folder(self.point_folder(number));
            // Another process may have finished it.
            if files.complete_summary().is_some() {
                return None;
            }
            let mut command = Command::new(&program);
            if files.is_resumable() {
                command.arg("resume").arg(files.checkpoint());
            } else {
                // A run killed before its first checkpoint starts over.
                command
                    .arg("run")
                    .arg(self.case(number))
                    .arg("--out")
                    .arg(&files.folder)
                    .arg("--force");
            }
            Some(command)
        };
        let left = Mutex::new(open.len());
        let on_end = |number: usize, is_done: bool| {
            let mut left = enter(&left);
            *left -= 1;
            let how = if is_done { "done" } else { "not done" };
            let point = &self.sweep.points[number - 1];
            console.note(&format!("{number} ({}) {how}, {left} to go", description(point)));
            console.event("point", json!({ "number": number, "done": is_done, "left": *left }));
        };
        if !bad_beds.is_empty() {
            console.warning(&format!("beds that could not be prepared: {}", bad_beds.len()));
        }
        let is_taken = |number: usize| RunFiles::in_folder(self.point_folder(number)).is_written();
        Ok(self.run_parallel(open, args, console, &is_taken, &run, &on_end))
    }

    /// Runs the command of each point, `jobs` at a time, until all have ended or Ctrl-C, and returns those that failed.
    ///
    /// Points that another process runs are postponed. Output goes to the file `log` of the point.
    fn run_parallel(
        &self,
        numbers: Vec<usize>,
        args: &SweepArgs,
        console: Console,
        is_taken: &(dyn Fn(usize) -> bool + Sync),
        command: &(dyn Fn(usize) -> Option<Command> + Sync),
        on_end: &(dyn Fn(usize, bool) + Sync),
    ) -> Vec<usize> {
        let jobs = args.jobs.min(numbers.len());
        let waiting = Mutex::new(VecDeque::from(numbers));
        let failed = Mutex::new(Vec::new());
        let work = || {
            while !interrupt::requested() {
                let next = enter(&waiting).pop_front();
                let Some(number) = next else { break };
                // Another process runs this point.
                if is_taken(number) {
                    enter(&waiting).push_back(number);
                    std::thread::sleep(POLL_INTERVAL);
                    continue;
                }
                let Some(mut command) = command(number) else {
                    on_end(number, true);
                    continue;
                };
                let threads = args.threads_per_run.to_string();
                if command.get_args().next() != Some("resume".as_ref()) {
                    command.arg("--bed-cache").arg(&args.beds.bed_cache);
                }
                let called = self.call(number, command.arg("--threads").arg(threads));
                let is_done = called.unwrap_or_else(|e| {
                    let path = self.point_folder(number);
                    console.warning(&format!("{}: cannot be run: {e}", path.display()));
                    false
                });
                if !is_done {
                    enter(&failed).push(number);
                }
                on_end(number, is_done);
            }
        };
        std::thread::scope(|scope| {
            for _ in 0..jobs {
                scope.spawn(work);
            }
        });
        let mut failed = std::mem::take(&mut *enter(&failed));
        failed.sort_unstable();
        failed
    }

    /// Runs a command; returns true if it succeeds.
    ///
    /// Ctrl-C reaches only this process, which forwards it once: a second signal would abort the run without a checkpoint.
    fn call(&self, number: usize, command: &mut Command) -> std::io::Result<bool> {
        let log = std::fs::File::options()
            .create(true)
            .append(true)
            .open(self.point_folder(number).join("log"))?;
        command.stdin(Stdio::null()).stderr(log.try_clone()?).stdout(log).process_group(0);
        let mut child = command.spawn()?;
        let mut is_forwarded = false;
        loop {
            if let Some(status) = child.try_wait()? {
                return Ok(status.success());
            }
            if interrupt::requested() && !is_forwarded {
                is_forwarded = true;
                let pid = Pid::from_raw(i32::try_from(child.id()).map_err(std::io::Error::other)?);
                kill(pid, Signal::SIGTERM)?;
            }
            std::thread::sleep(POLL_INTERVAL);
        }
    }

    /// Writes the table of all finished runs: the values of their points, then the figures of their summaries.
    fn table(&self) -> Result {
        // Array jobs may end at the same time.
        let _lock = RunFiles::in_folder(self.folder.clone()).lock_when_free()?;
        let mut columns = vec!["number".to_string()];
        let mut add = |name: &String| {
            if !columns.contains(name) {
                columns.push(name.clone());
            }
        };
        self.sweep.points.iter().flatten().for_each(|(key, _)| add(key));
        let mut rows = Vec::new();
        for (number, point) in self.points() {
            let files = RunFiles::in_folder(self.point_folder(number));
            let Some(summary) = files.complete_summary() else { continue };
            let mut row = vec![("number".to_string(), number.to_string())];
            row.extend(point.iter().map(|(key, value)| (key.clone(), plain(&json_value(value)))));
            figures("", &summary, &mut row);
            row.iter().for_each(|(name, _)| add(name));
            rows.push(row);
        }
        let rows = rows.iter().map(|row| {
            let cell = |column: &String| row.iter().find(|(name, _)| name == column);
            columns.iter().map(move |c| cell(c).map_or("", |(_, value)| value.as_str()))
        });
        replace_text(&self.folder.join("table.csv"), &csv_text(&columns, rows))
    }
}

/// Name of the folder of a point.
fn name(number: usize) -> String {
    format!("{number:05}")
}

/// Values of a point as JSON.
fn values(point: &SweepPoint) -> Map<String, Value> {
    point.iter().map(|(key, value)| (key.clone(), json_value(value))).collect()
}

/// Converts a value to JSON; numbers that are not finite become texts.
fn json_value(value: &toml::Value) -> Value {
    match value {
        toml::Value::Float(x) if !x.is_finite() => value.to_string().into(),
        toml::Value::Array(values) => values.iter().map(json_value).collect(),
        toml::Value::Table(table) => {
            table.iter().map(|(key, v)| (key.clone(), json_value(v))).collect()
        }
        _ => json!(value),
    }
}

/// Description of a point.
fn description(point: &SweepPoint) -> String {
    let word = |(key, value): &(String, toml::Value)| format!("{key} = {value}");
    point.iter().map(word).collect::<Vec<_>>().join(", ")
}

/// Collects the leaves of a summary with their paths, without timings.
fn figures(path: &str, value: &Value, row: &mut Vec<(String, String)>) {
    match value {
        Value::Object(map) => {
            for (key, value) in map.iter().filter(|(key, _)| *key != "timing") {
                let path = if path.is_empty() { key.clone() } else { format!("{path}.{key}") };
                figures(&path, value, row);
            }
        }
        leaf => row.push((path.to_string(), plain(leaf))),
    }
}

fn plain(value: &Value) -> String {
    if value.is_null() {
        return String::new();
    }
    value.as_str().map_or_else(|| value.to_string(), str::to_string)
}
