//! Description of the machine that made a measurement, and its load by other programs.

use ballast::lanes::InstructionSet;
use ballast_session::files::shell_word;
use ballast_session::profile::cpu_time;
use std::ffi::OsString;
use std::time::{Duration, Instant};

/// Ticks per second in `/proc/stat`.
const TICKS_PER_SECOND: f64 = 100.0;

/// CycleStepper of a measurement, observed since its start.
pub struct MachineInfo {
    start: Instant,
    /// CPU time of this process at the start.
    own_cpu: Duration,
    /// CPU time of all processes at the start, s.
    busy: Option<f64>,
}

impl MachineInfo {
    /// Starts to observe the machine.
    pub fn observe() -> Self {
        Self { start: Instant::now(), own_cpu: cpu_time(), busy: busy_seconds() }
    }

    /// Returns pairs of a property and its value.
    pub fn lines(&self) -> Vec<(String, String)> {
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        let instructions: Vec<&str> =
            InstructionSet::available().into_iter().map(InstructionSet::name).collect();
        let compiled = if cfg!(debug_assertions) { "dev" } else { "release" };
        let (os, arch) = (std::env::consts::OS, std::env::consts::ARCH);
        let mut lines = vec![
            ("command", command(std::env::args_os().skip(1))),
            ("processor", processor()),
            ("caches of a core", caches()),
            ("cores", cores.to_string()),
            ("instructions", format!("{} of {}", instructions[0], instructions.join(", "))),
            ("threads", rayon::current_num_threads().to_string()),
            ("compiler profile", compiled.to_string()),
            ("system", format!("{os} on {arch}")),
            ("version", env!("CARGO_PKG_VERSION").to_string()),
        ];
        if let Some(others) = self.busy_by_others() {
            lines.push((
                "other programs",
                format!("{others:.2} cores busy on average during the measurement"),
            ));
        }
        lines.into_iter().map(|(word, text)| (word.to_string(), text)).collect()
    }

    /// Returns the mean number of cores that other programs kept busy since the start.
    fn busy_by_others(&self) -> Option<f64> {
        let wall = self.start.elapsed().as_secs_f64();
        let own = cpu_time().saturating_sub(self.own_cpu).as_secs_f64();
        let all = busy_seconds()? - self.busy?;
        (wall > 0.0).then(|| ((all - own) / wall).max(0.0))
    }
}

/// Returns the command line as typed in a shell, with the plain name of the program.
fn command(arguments: impl Iterator<Item = OsString>) -> String {
    let words = std::iter::once("ballast".to_string()).chain(arguments.map(shell_word));
    words.collect::<Vec<_>>().join(" ")
}

fn read(path: &str) -> Option<String> {
    Some(std::fs::read_to_string(path).ok()?.trim().to_string())
}

fn processor() -> String {
    let name = read("/proc/cpuinfo").and_then(|text| {
        let line = text.lines().find(|line| line.starts_with("model name"))?;
        Some(line.split_once(':')?.1.trim().to_string())
    });
    name.unwrap_or_else(|| "unknown".into())
}

fn caches() -> String {
    let cache = |i: usize| {
        let of = |what: &str| read(&format!("/sys/devices/system/cpu/cpu0/cache/index{i}/{what}"));
        let kind = match of("type")?.as_str() {
            "Data" => "d",
            "Instruction" => "i",
            _ => "",
        };
        Some(format!("L{}{kind} {}", of("level")?, of("size")?))
    };
    let all: Vec<String> = (0..8).map_while(cache).collect();
    if all.is_empty() { "unknown".into() } else { all.join(", ") }
}

/// Returns the busy time of all processors since the machine started, s.
fn busy_seconds() -> Option<f64> {
    let text = read("/proc/stat")?;
    let ticks: Vec<f64> = (text.lines().next()?.split_whitespace().skip(1))
        .filter_map(|word| word.parse().ok())
        .collect();
    // user, nice, system, idle, waiting, interrupts, soft interrupts
    (ticks.len() >= 7)
        .then(|| (ticks[0] + ticks[1] + ticks[2] + ticks[5] + ticks[6]) / TICKS_PER_SECOND)
}
