//! Progress of a motion that pauses while it meets too much force.
//!
//! Reads: forces, one per step. Writes: its [`ProgressState`].
//! Contract: everything that later steps depend on is in that state, so a restored run continues bit for bit; the
//! default is the state of a run that has not begun.

/// State of a force-limited motion.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct ProgressState {
    /// Elapsed time of the motion, s: does not advance while the motion is held.
    pub elapsed: f64,
    /// Brake, 0 (full rate) to 1 (held), so that a motion never stops nor starts with a jump.
    pub brake: f64,
    /// Force of each of the last `window` steps, N, at index `step % window`; empty before the first step.
    pub forces: Vec<f64>,
}

impl ProgressState {
    /// Appends the state as `2 + window` numbers.
    pub fn encode(&self, values: &mut Vec<f64>) {
        values.extend([self.elapsed, self.brake]);
        values.extend(&self.forces);
    }

    /// Returns the state of `2 + window` numbers.
    pub fn decode(values: &[f64]) -> Self {
        Self { elapsed: values[0], brake: values[1], forces: values[2..].to_vec() }
    }
}

/// Motion that advances at its rate, and is held while the mean force over a window exceeds the limit.
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
    /// Time after its beginning at which the motion ends in any case, s.
    pub open: f64,
}

impl ForceLimitedProgress {
    /// Returns the number of values of an encoded state.
    pub fn encoded_len(&self) -> usize {
        2 + self.window
    }

    /// Returns the mean force over the window, N.
    pub fn mean_force(&self, state: &ProgressState) -> f64 {
        state.forces.iter().sum::<f64>() / self.window as f64
    }

    /// Returns elapsed time and brake after a step of `h` that ends `since_start` seconds after the motion's beginning.
    pub fn advanced(&self, state: &ProgressState, since_start: f64, h: f64) -> (f64, f64) {
        let &ProgressState { elapsed, brake, .. } = state;
        let within = since_start.min(h);
        if within <= 0.0 {
            return (elapsed, brake);
        }
        let over = since_start - within >= self.open;
        let held = over || self.mean_force(state) > self.force_limit;
        let change = h / self.braking;
        let brake = (brake + if held { change } else { -change }).clamp(0.0, 1.0);
        ((elapsed + within * (1.0 - brake)).min(self.duration), brake)
    }

    /// Takes a step with this force that ended at step number `step` into the state.
    pub fn observe(
        &self,
        state: &mut ProgressState,
        force: f64,
        step: u64,
        since_start: f64,
        h: f64,
    ) {
        (state.elapsed, state.brake) = self.advanced(state, since_start, h);
        state.forces.resize(self.window, 0.0);
        state.forces[(step % self.window as u64) as usize] = force;
    }
}
