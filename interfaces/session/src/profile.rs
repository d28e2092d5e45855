//! Profile of a run: wall and CPU time per phase of the step.
//!
//! CPU time is that of the whole process. With several threads it exceeds wall time; the ratio shows how well a phase
//! uses them.

use crate::interrupt;
use ballast::cancel::StopReason;
use ballast::step::{Phase, StepObserver};
use nix::time::{ClockId, clock_gettime};
use serde_json::{Value, json};
use std::iter::Sum;
use std::ops::AddAssign;
use std::time::{Duration, Instant};

/// Wall and CPU time.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct PhaseTime {
    /// Wall time.
    pub wall: Duration,
    /// CPU time of all threads.
    pub cpu: Duration,
}

impl AddAssign for PhaseTime {
    fn add_assign(&mut self, other: Self) {
        self.wall += other.wall;
        self.cpu += other.cpu;
    }
}

impl Sum for PhaseTime {
    fn sum<I: Iterator<Item = Self>>(all: I) -> Self {
        let mut sum = Self::default();
        all.for_each(|spent| sum += spent);
        sum
    }
}

/// Time per phase of the step, and of what the program does between steps.
#[derive(Debug)]
pub struct Profile {
    phases: [PhaseTime; Phase::ALL.len()],
    output: PhaseTime,
    mark: Instant,
    cpu_mark: Duration,
}

impl Profile {
    /// Starts the clocks.
    pub fn start() -> Self {
        Self {
            phases: Default::default(),
            output: PhaseTime::default(),
            mark: Instant::now(),
            cpu_mark: cpu_time(),
        }
    }

    /// Counts the time since the last mark as output: observation, writing, reporting.
    pub fn output(&mut self) {
        let spent = self.since_mark();
        self.output += spent;
    }

    fn since_mark(&mut self) -> PhaseTime {
        let (now, cpu) = (Instant::now(), cpu_time());
        let spent = PhaseTime { wall: now - self.mark, cpu: cpu.saturating_sub(self.cpu_mark) };
        self.mark = now;
        self.cpu_mark = cpu;
        spent
    }

    /// Returns name and time of each phase in the order of the step, then of the output between steps.
    pub fn lines(&self) -> impl Iterator<Item = (&'static str, PhaseTime)> + '_ {
        Phase::ALL
            .iter()
            .zip(&self.phases)
            .map(|(phase, spent)| (phase.name(), *spent))
            .chain([("output", self.output)])
    }

    /// Returns the time of one phase.
    pub fn of(&self, phase: Phase) -> PhaseTime {
        self.phases[phase as usize]
    }

    /// Returns the time of all phases, without the output between steps.
    pub fn steps(&self) -> PhaseTime {
        self.phases.iter().copied().sum()
    }

    /// Returns the seconds per phase, by name.
    pub fn json(&self) -> Value {
        self.lines()
            .map(|(name, spent)| {
                let seconds =
                    json!({"wall_s": spent.wall.as_secs_f64(), "cpu_s": spent.cpu.as_secs_f64()});
                (name.to_string(), seconds)
            })
            .collect::<serde_json::Map<_, _>>()
            .into()
    }
}

impl StepObserver for Profile {
    fn phase_finished(&mut self, phase: Phase) {
        let spent = self.since_mark();
        let sum = &mut self.phases[phase as usize];
        sum.wall += spent.wall;
        sum.cpu += spent.cpu;
    }

    /// Cancels the step after an interrupt.
    fn cancelled(&mut self) -> Option<StopReason> {
        interrupt::requested().then_some(StopReason::Early)
    }
}

/// Returns the CPU time of all threads of this process; zero on systems without that clock.
pub fn cpu_time() -> Duration {
    clock_gettime(ClockId::CLOCK_PROCESS_CPUTIME_ID).map(Duration::from).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_is_added_to_the_finished_phase() {
        let mut profile = Profile::start();
        std::thread::sleep(Duration::from_millis(20));
        profile.phase_finished(Phase::Solve);
        profile.output();
        assert!(profile.of(Phase::Solve).wall >= Duration::from_millis(20));
        assert!(profile.of(Phase::Predict).wall.is_zero());
        assert_eq!(profile.steps(), profile.of(Phase::Solve));
        let json = profile.json();
        assert!(json["solve"]["wall_s"].as_f64().unwrap() >= 0.02);
        assert_eq!(json.as_object().unwrap().len(), Phase::ALL.len() + 1);
    }
}
