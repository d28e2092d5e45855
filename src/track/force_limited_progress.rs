//! A clock of a motion that waits while it meets too much force.
//!
//! Reads: forces, one per step. Writes: its own piece of the memory in
//! [`State::drive`](crate::state::State::drive).
//! Contract: everything that later steps depend on is in that memory, so a restored run continues
//! bit for bit; an empty memory is that of a run that has not begun.
//!
//! Memory, `2 + window` entries:
//! * `[0]` elapsed time of the motion, s: stands still while the motion is held;
//! * `[1]` brake, 0 (full rate) to 1 (held), so that a motion never stops nor starts with a jump;
//! * `[2..]` the force of each of the last `window` steps, N, at index `step % window`.

/// Entries of the memory before the ring of forces.
const HEAD: usize = 2;

/// Runs at its rate, and is held while the mean force over a window exceeds the limit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ForceLimitedProgress {
    /// Steps over which the force is averaged.
    pub window: usize,
    /// N; infinite: never held.
    pub force_limit: f64,
    /// Time in which the motion comes to a halt, s.
    pub braking: f64,
    /// Length of the motion when nothing holds it, s.
    pub duration: f64,
    /// How long after its beginning the motion ends where it is, s.
    pub open: f64,
}

impl ForceLimitedProgress {
    /// Length of the memory.
    pub fn memory_len(&self) -> usize {
        HEAD + self.window
    }

    /// Elapsed time of the motion, s.
    pub fn elapsed(&self, memory: &[f64]) -> f64 {
        memory.first().copied().unwrap_or(0.0)
    }

    /// Mean force over the window, N.
    pub fn mean_force(&self, memory: &[f64]) -> f64 {
        memory.get(HEAD..).unwrap_or(&[]).iter().sum::<f64>() / self.window as f64
    }

    /// Elapsed time and brake after a step of `h` that ends `since_start` seconds after the motion's
    /// beginning.
    pub fn advanced(&self, memory: &[f64], since_start: f64, h: f64) -> (f64, f64) {
        let elapsed = self.elapsed(memory);
        let brake = memory.get(1).copied().unwrap_or(0.0);
        let within = since_start.min(h);
        if within <= 0.0 {
            return (elapsed, brake);
        }
        let over = since_start - within >= self.open;
        let held = over || self.mean_force(memory) > self.force_limit;
        let change = h / self.braking;
        let brake = (brake + if held { change } else { -change }).clamp(0.0, 1.0);
        ((elapsed + within * (1.0 - brake)).min(self.duration), brake)
    }

    /// Takes a step that ended at step number `step` with this force into the memory.
    pub fn observe(&self, memory: &mut [f64], force: f64, step: u64, since_start: f64, h: f64) {
        let (elapsed, brake) = self.advanced(memory, since_start, h);
        memory[0] = elapsed;
        memory[1] = brake;
        memory[HEAD + (step % self.window as u64) as usize] = force;
    }
}
