//! `ballast sweep PLAN`: many runs of a case, side by side, resumable, one table.

use crate::args;
use crate::case::{self, CaseOverrides};
use crate::console::Console;
use crate::exit::{Failure, Outcome};
use crate::files::{RunFiles, create_folder, read_case, read_text, replace_text};
use crate::interrupt;
use crate::lock::enter;
use ballast_hdf5::export::quoted;
use ballast_scenario::MAX_CASE_BYTES;
use ballast_scenario::sweep::{SweepPlan, SweepPoint, apply_point};
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use serde_json::{Map, Value, json};
use std::collections::{BTreeSet, VecDeque};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Mutex;
use std::time::Duration;

/// How often a run is looked after.
const LOOK: Duration = Duration::from_millis(50);

pub fn sweep(args: args::Sweep, console: Console) -> Outcome {
    interrupt::install()?;
    let name = args.plan.display().to_string();
    let text = read_case(&args.plan, MAX_CASE_BYTES)?;
    let sweep = SweepPlan::parse(&text, &name).map_err(Failure::InvalidCase)?;
    let case = args.plan.parent().unwrap_or(Path::new("")).join(&sweep.case);
    let case_text = read_case(&case, MAX_CASE_BYTES)?;
    let texts = texts(&sweep, &case_text, &name)?;
    let folder = args.out.clone().unwrap_or_else(|| {
        Path::new("runs").join(args.plan.file_stem().unwrap_or(std::ffi::OsStr::new("sweep")))
    });
    let place = Place { folder, sweep };
    if args.list {
        for (number, point) in place.points() {
            console.result(&format!("{number}  {}", words(point)));
            console.event("point", json!({ "number": number, "values": values(point) }));
        }
        return Ok(());
    }
    let numbers = match args.case {
        None => (1..=place.sweep.points.len()).collect(),
        Some(number) if place.sweep.points.get(number.wrapping_sub(1)).is_some() => vec![number],
        Some(number) => {
            let all = place.sweep.points.len();
            return Err(Failure::Usage(format!("--case: expected 1 to {all}, found {number}")));
        }
    };
    place.write(&case, &texts)?;
    let failed = place.compute(&numbers, &args, console)?;
    place.table()?;
    if interrupt::requested() {
        let text = "stopped; the same call goes on where each run is";
        return Err(Failure::Interrupted(text.into()));
    }
    let table = place.folder.join("table.csv");
    console.result(&table.display().to_string());
    console.event("done", json!({ "table": table, "failed": failed }));
    if failed.is_empty() {
        return Ok(());
    }
    let logs: Vec<_> =
        failed.iter().map(|n| place.of(*n).join("log").display().to_string()).collect();
    Err(Failure::Failed(format!(
        "{} of {} failed: {}",
        failed.len(),
        numbers.len(),
        logs.join(", ")
    )))
}

/// The case of each point; all are checked before any is run.
fn texts(sweep: &SweepPlan, case: &str, plan: &str) -> Outcome<Vec<String>> {
    let text = |(i, point): (usize, &SweepPoint)| {
        apply_point(case, point, &format!("{plan}, point {}", i + 1))
    };
    let texts: Result<_, _> = sweep.points.iter().enumerate().map(text).collect();
    texts.map_err(Failure::InvalidCase)
}

/// The files of a sweep: a manifest, a folder per point, a table.
struct Place {
    folder: PathBuf,
    sweep: SweepPlan,
}

impl Place {
    /// Points with their numbers, from 1.
    fn points(&self) -> impl Iterator<Item = (usize, &SweepPoint)> {
        (1..).zip(&self.sweep.points)
    }

    fn of(&self, number: usize) -> PathBuf {
        self.folder.join(name(number))
    }

    fn case(&self, number: usize) -> PathBuf {
        self.of(number).join("case.toml")
    }

    /// Writes manifest and cases. What is there must be the same sweep, or its beginning.
    fn write(&self, case: &Path, texts: &[String]) -> Outcome {
        create_folder(&self.folder)?;
        for ((number, point), text) in self.points().zip(texts) {
            let path = self.case(number);
            if path.exists() {
                if read_text(&path, MAX_CASE_BYTES)? != *text {
                    return Err(Failure::Usage(format!(
                        "{}: expected point {number} of this plan ({}), found that of another one; choose \
                         another folder with --out",
                        path.display(),
                        words(point)
                    )));
                }
                continue;
            }
            create_folder(&self.of(number))?;
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

    /// Runs what is not done yet, each in a process of its own; gives the numbers of those that failed.
    fn compute(
        &self,
        numbers: &[usize],
        args: &args::Sweep,
        console: Console,
    ) -> Outcome<Vec<usize>> {
        let program = std::env::current_exe()
            .map_err(|e| Failure::Failed(format!("cannot find this program: {e}")))?;
        let open = |n: &usize| RunFiles::in_folder(self.of(*n)).whole_summary().is_none();
        let open: Vec<usize> = numbers.iter().copied().filter(open).collect();
        let done = numbers.len() - open.len();
        if done > 0 {
            console.note(&format!("{done} of {} done before", numbers.len()));
        }
        let mut keys = BTreeSet::new();
        let mut first_of_bed = Vec::new();
        for number in &open {
            let case = case::load(&self.case(*number), &CaseOverrides::default(), &console)?;
            if keys.insert(case.bed_key()) {
                first_of_bed.push(*number);
            }
        }
        // Beds first, each once: runs that share one would all prepare it.
        let prepare = |number: usize| {
            let mut command = Command::new(&program);
            command.arg("prepare").arg(self.case(number));
            Some(command)
        };
        let bad_beds =
            self.side_by_side(first_of_bed, args, console, &|_| false, &prepare, &|_, _| {});
        let run = |number: usize| {
            let files = RunFiles::in_folder(self.of(number));
            // Another call may have come to it first.
            if files.whole_summary().is_some() {
                return None;
            }
            let mut command = Command::new(&program);
            if files.is_resumable() {
                command.arg("resume").arg(files.checkpoint());
            } else {
                // Killed before its first checkpoint, it begins anew.
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
        let tell = |number: usize, is_done: bool| {
            let mut left = enter(&left);
            *left -= 1;
            let how = if is_done { "done" } else { "not done" };
            let point = &self.sweep.points[number - 1];
            console.note(&format!("{number} ({}) {how}, {left} to go", words(point)));
            console.event("point", json!({ "number": number, "done": is_done, "left": *left }));
        };
        if !bad_beds.is_empty() {
            console.warning(&format!("beds that could not be prepared: {}", bad_beds.len()));
        }
        let is_taken = |number: usize| RunFiles::in_folder(self.of(number)).is_written();
        Ok(self.side_by_side(open, args, console, &is_taken, &run, &tell))
    }

    /// Calls the program for each number that it has a command for, `jobs` at a time, until all are done or Ctrl-C;
    /// gives those that failed. One that is taken is put off until it is free. What a call says goes to the file `log`
    /// of its point.
    fn side_by_side(
        &self,
        numbers: Vec<usize>,
        args: &args::Sweep,
        console: Console,
        is_taken: &(dyn Fn(usize) -> bool + Sync),
        command: &(dyn Fn(usize) -> Option<Command> + Sync),
        tell: &(dyn Fn(usize, bool) + Sync),
    ) -> Vec<usize> {
        let jobs = args.jobs.get().min(numbers.len());
        let waiting = Mutex::new(VecDeque::from(numbers));
        let failed = Mutex::new(Vec::new());
        let work = || {
            while !interrupt::requested() {
                let next = enter(&waiting).pop_front();
                let Some(number) = next else { break };
                // By another call on the same folder: others first.
                if is_taken(number) {
                    enter(&waiting).push_back(number);
                    std::thread::sleep(LOOK);
                    continue;
                }
                let Some(mut command) = command(number) else {
                    tell(number, true);
                    continue;
                };
                let threads = args.threads_each.to_string();
                if command.get_args().next() != Some("resume".as_ref()) {
                    command.arg("--beds").arg(&args.beds.beds);
                }
                let called = self.call(number, command.arg("--threads").arg(threads));
                let is_done = called.unwrap_or_else(|e| {
                    let path = self.of(number);
                    console.warning(&format!("{}: cannot be run: {e}", path.display()));
                    false
                });
                if !is_done {
                    enter(&failed).push(number);
                }
                tell(number, is_done);
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

    /// Whether a call of the program ends well. Ctrl-C reaches this process alone, which passes it on once: a
    /// second one would end the run without a checkpoint.
    fn call(&self, number: usize, command: &mut Command) -> std::io::Result<bool> {
        let log =
            std::fs::File::options().create(true).append(true).open(self.of(number).join("log"))?;
        command.stdin(Stdio::null()).stderr(log.try_clone()?).stdout(log).process_group(0);
        let mut child = command.spawn()?;
        let mut is_told = false;
        loop {
            if let Some(status) = child.try_wait()? {
                return Ok(status.success());
            }
            if interrupt::requested() && !is_told {
                is_told = true;
                let pid = Pid::from_raw(i32::try_from(child.id()).map_err(std::io::Error::other)?);
                kill(pid, Signal::SIGTERM)?;
            }
            std::thread::sleep(LOOK);
        }
    }

    /// Writes the table of all runs that are done: the values of all points, whether set in each or not, and then every
    /// figure of their summaries.
    fn table(&self) -> Outcome {
        // Of array jobs that end together none may write what it read before another was done.
        let _claim = RunFiles::in_folder(self.folder.clone()).claimed_in_turn()?;
        let mut columns = vec!["number".to_string()];
        let mut add = |name: &String| {
            if !columns.contains(name) {
                columns.push(name.clone());
            }
        };
        self.sweep.points.iter().flatten().for_each(|(key, _)| add(key));
        let mut rows = Vec::new();
        for (number, point) in self.points() {
            let files = RunFiles::in_folder(self.of(number));
            let Some(summary) = files.whole_summary() else { continue };
            let mut row = vec![("number".to_string(), number.to_string())];
            row.extend(point.iter().map(|(key, value)| (key.clone(), plain(&told(value)))));
            figures("", &summary, &mut row);
            row.iter().for_each(|(name, _)| add(name));
            rows.push(row);
        }
        let mut text = columns.iter().map(|c| quoted(c)).collect::<Vec<_>>().join(",");
        for row in rows {
            let cell = |column: &String| {
                let found = row.iter().find(|(name, _)| name == column);
                found.map_or(String::new(), |(_, value)| quoted(value))
            };
            text += "\n";
            text += &columns.iter().map(cell).collect::<Vec<_>>().join(",");
        }
        replace_text(&self.folder.join("table.csv"), &(text + "\n"))
    }
}

/// The folder of a point, within that of the sweep.
fn name(number: usize) -> String {
    format!("{number:05}")
}

/// A point for programs.
fn values(point: &SweepPoint) -> Map<String, Value> {
    point.iter().map(|(key, value)| (key.clone(), told(value))).collect()
}

/// A value of a point; JSON has no number for one that is not finite, which is told as its text.
fn told(value: &toml::Value) -> Value {
    match value {
        toml::Value::Float(x) if !x.is_finite() => value.to_string().into(),
        toml::Value::Array(values) => values.iter().map(told).collect(),
        toml::Value::Table(table) => table.iter().map(|(key, v)| (key.clone(), told(v))).collect(),
        _ => json!(value),
    }
}

/// A point for a person.
fn words(point: &SweepPoint) -> String {
    let word = |(key, value): &(String, toml::Value)| format!("{key} = {value}");
    point.iter().map(word).collect::<Vec<_>>().join(", ")
}

/// The leaves of a summary under the paths of their keys, but for what differs between equal runs.
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
