//! Prediction of a step: configuration of contact detection, and velocities without contacts (T-1 to T-4).
//!
//! Reads: model, state, inputs. Writes: [`Motion`]. Cost: O(bodies).

mod free_rotation;
mod mounted;
mod prescribed_rotation;
mod response;

pub use response::MountResponse;

use crate::drive::{Load, StepInputs};
use crate::error::{Error, Result};
use crate::math::{Pose, Quat, Vec3, rotation};
use crate::model::{DofMode, Model};
use crate::state::State;
use free_rotation::FreeRotation;
pub use free_rotation::turns_far;
use rayon::prelude::*;

/// Prediction of a step; arrays over all bodies, grains first `[nb]`.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Motion {
    /// Positions at configuration m, m.
    pub position: Vec<Vec3>,
    /// Orientations at configuration m, body to world.
    pub orientation: Vec<Quat>,
    /// Free velocity of mobile bodies, imposed velocity of the others, m/s.
    pub velocity: Vec<Vec3>,
    /// Free and imposed angular velocity, world axes, rad/s.
    pub angular_velocity: Vec<Vec3>,
    /// Responses of the mounted bodies to impulses `[nm]`.
    pub responses: Vec<MountResponse>,
}

impl Motion {
    /// Returns the pose of body `b` at configuration m.
    pub fn pose(&self, b: usize) -> Pose {
        Pose { position: self.position[b], orientation: self.orientation[b] }
    }

    /// Predicts the step that starts at `state`.
    ///
    /// # Errors
    /// [`Error::Input`] for the wrong number of inputs, [`Error::State`] for values that are not finite.
    pub fn predict(&mut self, model: &Model, state: &State, inputs: &StepInputs) -> Result<()> {
        let (ng, nd) = (model.grains.len(), model.driven.len());
        if inputs.targets.len() != nd {
            return Err(Error::Input {
                place: "targets".into(),
                expected: format!("{nd} poses, one per driven body"),
                found: inputs.targets.len().to_string(),
            });
        }
        let mounted = model.mounted_count();
        if !inputs.loads.is_empty() && inputs.loads.len() != mounted {
            return Err(Error::Input {
                place: "loads".into(),
                expected: format!("{mounted}, one per mounted body, or none"),
                found: inputs.loads.len().to_string(),
            });
        }
        self.responses.clear();
        self.position.resize(ng + nd, Vec3::zeros());
        self.orientation.resize(ng + nd, Quat::identity());
        self.velocity.resize(ng + nd, Vec3::zeros());
        self.angular_velocity.resize(ng + nd, Vec3::zeros());
        self.predict_grains(model, state);
        self.check_grains(ng)?;
        self.predict_driven(model, state, inputs)
    }

    /// Returns velocity (m/s) and angular velocity (rad/s) of body `b` at the end of the step.
    ///
    /// `velocity` and `angular_velocity` are the solved ones of the mobile bodies.
    pub fn twist(&self, velocity: &[Vec3], angular_velocity: &[Vec3], b: usize) -> (Vec3, Vec3) {
        let solved = velocity.get(b).zip(angular_velocity.get(b));
        let (v, w) = solved.unwrap_or((&self.velocity[b], &self.angular_velocity[b]));
        (*v, *w)
    }

    /// Returns velocity (m/s) and angular velocity (rad/s) of body `b` at the start of the step.
    ///
    /// Imposed components have those of this step throughout (T-4, T-14). Where a prescribed rotation starts or
    /// stops, the centre of mass keeps its velocity (T-28).
    pub fn initial_twist(&self, model: &Model, state: &State, b: usize) -> (Vec3, Vec3) {
        let had = (state.velocity[b], state.angular_velocity[b]);
        let Some(d) = b.checked_sub(model.grains.len()) else { return had };
        let imposed = (self.velocity[b], self.angular_velocity[b]);
        let Some(mount) = &model.driven[d].mount else { return imposed };
        let choose = |modes: [DofMode; 3], imposed: Vec3, had: Vec3| {
            Vec3::from_fn(|k, _| if modes[k].is_prescribed() { imposed[k] } else { had[k] })
        };
        let angular_velocity = choose(mount.rotations(), imposed.1, had.1);
        let around = (had.1 - angular_velocity).cross(&(state.orientation[b] * mount.centre));
        (choose(mount.translations(), imposed.0, had.0 + around), angular_velocity)
    }

    /// Refuses a grain without a finite position, which would find no contact.
    fn check_grains(&self, ng: usize) -> Result<()> {
        let is_finite = |i: usize| {
            let sum = self.position[i] + self.velocity[i] + self.angular_velocity[i];
            (sum.sum() + self.orientation[i].coords.sum()).is_finite()
        };
        let lost = (0..ng).into_par_iter().with_min_len(4096).find_first(|&i| !is_finite(i));
        lost.map_or(Ok(()), |i| {
            Err(Error::State {
                place: format!("grain {i}"),
                expected: "finite position, orientation and velocities".into(),
                found: format!(
                    "x = {:?} m, v = {:?} m/s, w = {:?} rad/s",
                    self.position[i].as_slice(),
                    self.velocity[i].as_slice(),
                    self.angular_velocity[i].as_slice()
                ),
            })
        })
    }

    fn predict_grains(&mut self, model: &Model, state: &State) {
        let ng = model.grains.len();
        let h = model.stepping.h();
        let before = h * (1.0 - model.stepping.theta);
        (&mut self.position[..ng], &mut self.orientation[..ng])
            .into_par_iter()
            .zip((&mut self.velocity[..ng], &mut self.angular_velocity[..ng]))
            .enumerate()
            .with_min_len(1024)
            .for_each(|(i, ((x, q), (v, w)))| {
                *x = state.position[i] + state.velocity[i] * before;
                *v = state.velocity[i] + model.gravity * h;
                (*q, *w) = grain(model, state, i).predict(&model.stepping);
            });
    }

    /// Returns the angular velocity of grain `i` at the end of the step, at the orientation `end`.
    ///
    /// `solved` is the one at configuration m.
    pub fn angular_velocity_at_end(
        &self,
        model: &Model,
        state: &State,
        i: usize,
        solved: &Vec3,
        end: &Quat,
    ) -> Vec3 {
        grain(model, state, i).angular_velocity_at_end(
            &self.orientation[i],
            [&self.angular_velocity[i], solved],
            end,
        )
    }

    fn predict_driven(&mut self, model: &Model, state: &State, inputs: &StepInputs) -> Result<()> {
        let ng = model.grains.len();
        let h = model.stepping.h();
        let before = h * (1.0 - model.stepping.theta);
        for (d, target) in inputs.targets.iter().enumerate() {
            let b = ng + d;
            if !target.is_sound() {
                return Err(Error::Input {
                    place: format!("target of {:?}", model.driven[d].name),
                    expected: "finite position and a unit quaternion".into(),
                    found: format!("{target:?}"),
                });
            }
            if let Some(mount) = &model.driven[d].mount {
                let load = inputs.loads.get(d).copied().unwrap_or_else(Load::zero);
                self.predict_mounted(model, state, d, mount, target, load)?;
                continue;
            }
            let turn = target.orientation * state.orientation[b].inverse();
            self.velocity[b] = (target.position - state.position[b]) / h;
            self.angular_velocity[b] = rotation::log(&turn) / h;
            self.position[b] = state.position[b] + self.velocity[b] * before;
            self.orientation[b] =
                rotation::advance(&state.orientation[b], &(self.angular_velocity[b] * before));
        }
        Ok(())
    }
}

/// Returns grain `i` at the start of the step.
fn grain<'a>(model: &'a Model, state: &'a State, i: usize) -> FreeRotation<'a, Vec3> {
    let (start, angular_velocity) = (&state.orientation[i], &state.angular_velocity[i]);
    FreeRotation { inertia: &model.grains.inertia[i], start, angular_velocity }
}
