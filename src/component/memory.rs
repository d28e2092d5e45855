//! What the component remembers from window to window, kept in the state as the memory of its drive.
//!
//! Contract: a state that some other drive has left, or none, is read as nothing remembered.

use super::waveform::Twist;
use crate::math::Vec3;
use crate::observe::{SqueezeMeter, SqueezeRule};
use crate::state::State;
use crate::step::Reaction;
use std::collections::VecDeque;
use std::sync::Arc;

/// How long the moving mean of forces looks back, ns: over half a vibration a single force says little,
/// beyond it the mean comes too late.
const MOVING_AVERAGE_NS: u64 = 4_000_000;
/// Begins the numbers, so that those of another drive are not taken for them: no quantity has this value.
const MARK: f64 = f64::from_bits(0x0000_ba11_a57c_0de2);
/// Numbers per body: whether its twist is known, and the twist.
const TWIST: usize = 7;
/// Numbers per body and step: impulse and angular impulse.
const REACTION: usize = 6;

/// What the ballast did to the driven bodies in the last 4 ms.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ReactionHistory {
    /// Impulse and angular impulse on each body, oldest step first `[steps][nd]`.
    steps: VecDeque<Vec<[Vec3; 2]>>,
}

impl ReactionHistory {
    /// Takes what a step did to the bodies `[nd]`; `step_ns` is its length.
    pub fn take(&mut self, reactions: &[Reaction], step_ns: u64) {
        let most = (MOVING_AVERAGE_NS / step_ns).max(1) as usize;
        while self.steps.len() >= most {
            self.steps.pop_front();
        }
        self.steps.push_back(reactions.iter().map(|r| [r.impulse, r.angular_impulse]).collect());
    }

    /// Mean force (N) and torque (N m) on body `d` over the last steps, of `h` seconds; zero without any.
    pub fn mean_wrench(&self, d: usize, h: f64) -> [Vec3; 2] {
        let sum = self.steps.iter().fold([Vec3::zeros(); 2], |[f, t], step| {
            let [impulse, angular] = step[d];
            [f + impulse, t + angular]
        });
        sum.map(|s| s / (h * self.steps.len().max(1) as f64))
    }
}

/// What a component remembers in `state` of the last steps and of squeezes, for who goes on beside one.
pub fn remembered(
    state: &State,
    bodies: usize,
    rule: &Arc<SqueezeRule>,
) -> (ReactionHistory, SqueezeMeter) {
    let WindowMemory { recent, squeezes, .. } = WindowMemory::read(state, bodies, rule);
    (recent, squeezes)
}

/// With which twist the last window has left driven body `d`, or its mount, in `state`: that of its cubic motion, or
/// none where it had no motion. The next cubic motion has to begin with it. `None`, any twist, after a held or linear
/// motion, and where `state` is of no component.
pub fn left_twist(state: &State, d: usize) -> Option<Twist> {
    let Some((_, rest)) = parts(&state.drive) else { return first_twist(state) };
    rest.as_chunks().0.get(d).and_then(read_twist)
}

/// Whether a component has left in `state` what it remembers: a drive of another kind does not go on from there.
pub fn is_remembered(state: &State) -> bool {
    parts(&state.drive).is_some()
}

/// Before the first step everything is at rest; what other drives have left moving is not known.
fn first_twist(state: &State) -> Option<Twist> {
    (state.step == 0).then(Twist::default)
}

/// The numbers of squeezes, and those of twists and steps, where a component has left them.
fn parts(drive: &[f64]) -> Option<(&[f64], &[f64])> {
    let ([mark, length], rest) = drive.split_first_chunk()?;
    if *mark != MARK || *length > rest.len() as f64 {
        return None;
    }
    rest.split_at_checked(*length as usize)
}

fn read_twist(n: &[f64; TWIST]) -> Option<Twist> {
    let vector = |n: &[f64]| Vec3::new(n[0], n[1], n[2]);
    (n[0] == 1.0).then(|| Twist { velocity: vector(&n[1..4]), angular_velocity: vector(&n[4..7]) })
}

/// Twists in which bodies left the last window, what the ballast did to them in the last steps, and how far
/// squeezes are.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct WindowMemory {
    /// As [`left_twist`] tells `[nd]`.
    pub twist: Vec<Option<Twist>>,
    pub recent: ReactionHistory,
    pub squeezes: SqueezeMeter,
}

impl WindowMemory {
    /// Reads what [`WindowMemory::write`] left for `bodies` driven bodies and the pairs of `rule`.
    pub fn read(state: &State, bodies: usize, rule: &Arc<SqueezeRule>) -> Self {
        Self::written(&state.drive, bodies, rule).unwrap_or_else(|| Self {
            twist: vec![first_twist(state); bodies],
            recent: ReactionHistory::default(),
            squeezes: SqueezeMeter::new(Arc::clone(rule)),
        })
    }

    fn written(drive: &[f64], bodies: usize, rule: &Arc<SqueezeRule>) -> Option<Self> {
        let row = REACTION * bodies;
        let (squeezes, rest) = parts(drive).filter(|_| row > 0)?;
        // Another rule follows its own squeezes from here on; what the ballast and the tools did is the same.
        let squeezes = SqueezeMeter::read(Arc::clone(rule), squeezes)
            .unwrap_or_else(|| SqueezeMeter::new(Arc::clone(rule)));
        let (twists, steps) = rest.split_at_checked(TWIST * bodies)?;
        if !steps.len().is_multiple_of(row) {
            return None;
        }
        let vector = |n: &[f64]| Vec3::new(n[0], n[1], n[2]);
        let reaction = |n: &[f64; REACTION]| [vector(&n[..3]), vector(&n[3..])];
        Some(Self {
            squeezes,
            twist: twists.as_chunks().0.iter().map(read_twist).collect(),
            recent: ReactionHistory {
                steps: steps
                    .chunks_exact(row)
                    .map(|step| step.as_chunks().0.iter().map(reaction).collect())
                    .collect(),
            },
        })
    }

    pub fn write(&self, drive: &mut Vec<f64>) {
        drive.clear();
        drive.extend([MARK, 0.0]);
        self.squeezes.write(drive);
        drive[1] = (drive.len() - 2) as f64;
        for twist in &self.twist {
            drive.push(f64::from(u8::from(twist.is_some())));
            let Twist { velocity, angular_velocity } = twist.unwrap_or_default();
            drive.extend(velocity.iter().chain(&angular_velocity));
        }
        for [impulse, angular] in self.recent.steps.iter().flatten() {
            drive.extend(impulse.iter().chain(angular));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::observe::SqueezePair;

    #[test]
    fn another_rule_of_squeezes_knows_what_the_tools_did() {
        let pair = SqueezePair { name: "pair".into(), tines: vec![(0, 1.0)] };
        let rule = Arc::new(SqueezeRule::new(vec![pair], 5).unwrap());
        let mut recent = ReactionHistory::default();
        let impulse = Vec3::new(1.0, 2.0, 3.0);
        let push = Reaction { impulse, angular_impulse: -impulse, work: 0.0, contacts: 1 };
        recent.take(&[push], 1_000_000);
        let twist = Twist { velocity: Vec3::new(0.0, 0.0, -0.5), angular_velocity: Vec3::zeros() };
        let twist = vec![Some(twist)];
        let written =
            WindowMemory { twist, recent, squeezes: SqueezeMeter::new(Arc::clone(&rule)) };
        let mut state = State { step: 7, ..State::default() };
        written.write(&mut state.drive);
        assert!(is_remembered(&state) && !is_remembered(&State::default()));
        assert_eq!(WindowMemory::read(&state, 1, &rule), written);
        let none = Arc::new(SqueezeRule::default());
        let read = WindowMemory::read(&state, 1, &none);
        assert_eq!(read.twist, [left_twist(&state, 0)]);
        assert_eq!(read, WindowMemory { squeezes: SqueezeMeter::new(none), ..written });
    }
}
