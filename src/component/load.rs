//! The load on a body through a window.

use super::refusal::Refusal;
use crate::drive::Load;

/// Load at a time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LoadKnot {
    /// Time since the start of the run, ns.
    pub time_ns: u64,
    /// Load on the body.
    pub load: Load,
}

/// A load through time: linear between knots, or held from each knot on.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct LoadWaveform {
    /// True if a knot's load holds until the next knot.
    pub is_held: bool,
    /// In order of time.
    pub knots: Vec<LoadKnot>,
}

impl LoadWaveform {
    /// The load at a time for which there are knots.
    pub fn load(&self, time_ns: u64) -> Load {
        let after = self.knots.partition_point(|k| k.time_ns <= time_ns);
        let before = after.checked_sub(1).map(|k| &self.knots[k]);
        match (before, self.knots.get(after)) {
            (Some(a), Some(b)) if !self.is_held => {
                let share = (time_ns - a.time_ns) as f64 / (b.time_ns - a.time_ns) as f64;
                Load {
                    force: a.load.force + (b.load.force - a.load.force) * share,
                    torque: a.load.torque + (b.load.torque - a.load.torque) * share,
                }
            }
            (Some(a), _) => a.load,
            (None, first) => first.map_or_else(Load::zero, |k| k.load),
        }
    }

    /// Refuses a waveform that does not define a load through the whole window.
    pub(super) fn check(&self, body: &str, t0_ns: u64, t1_ns: u64) -> Result<(), Refusal> {
        let (Some(first), Some(last)) = (self.knots.first(), self.knots.last()) else {
            return Err(Refusal::input(body, "at least one knot of its load", "none"));
        };
        if let Some(i) = self.knots.iter().position(|k| !k.load.is_finite()) {
            let Load { force, torque } = &self.knots[i].load;
            let (force, torque) = (force.as_slice(), torque.as_slice());
            let found = format!("force {force:?} N, torque {torque:?} N m (knot {i})");
            return Err(Refusal::input(body, "finite loads", found));
        }
        let late = |k: &[LoadKnot]| k[0].time_ns >= k[1].time_ns;
        if let Some(i) = self.knots.windows(2).position(late) {
            let found = format!(
                "{} ns before {} ns (knot {i})",
                self.knots[i].time_ns,
                self.knots[i + 1].time_ns
            );
            return Err(Refusal::input(body, "knots of its load in order of time", found));
        }
        if first.time_ns <= t0_ns && (self.is_held || last.time_ns >= t1_ns) {
            return Ok(());
        }
        Err(Refusal::Gap {
            body: body.into(),
            expected: format!("knots of its load from {t0_ns} to {t1_ns} ns"),
            found: format!("from {} to {} ns", first.time_ns, last.time_ns),
        })
    }
}
