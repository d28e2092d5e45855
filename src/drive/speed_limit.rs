//! Limit of the displacement of driven bodies per step: a faster tool would pass through grains undetected.

use crate::error::{Cause, Error, Result};
use crate::math::{Pose, Vec3, rotation};
use crate::model::{Model, Part};
use crate::state::State;

/// Maximum displacement of a point of a driven body in a step.
#[derive(Debug, Clone, PartialEq)]
pub struct SpeedLimit {
    /// Half of the smallest grain's nominal diameter, m; infinite without grains.
    pub max_displacement: f64,
    /// Largest distance of a point of each driven body from its reference point `[nd]`, m; infinite with half-spaces.
    radii: Vec<f64>,
}

impl SpeedLimit {
    /// Returns the limit of a model.
    pub fn new(model: &Model) -> Self {
        let diameter = |s: &u32| model.shapes[*s as usize].nominal_diameter();
        let smallest = model.grains.shape.iter().map(diameter).fold(f64::INFINITY, f64::min);
        let radii = model.driven.iter().map(|d| radii(model, &d.parts)).collect();
        Self { max_displacement: 0.5 * smallest, radii }
    }

    /// Returns the time in which body `d` reaches the limit at this velocity (m/s) and angular velocity (rad/s), s.
    ///
    /// Infinite at rest.
    pub fn time(
        &self,
        model: &Model,
        state: &State,
        d: usize,
        velocity: &Vec3,
        angular_velocity: &Vec3,
    ) -> f64 {
        let turning = angular_velocity.norm();
        let lever = self.lever(model, state, d, turning);
        self.max_displacement / (velocity.norm() + turning * lever)
    }

    /// Returns the largest distance from its reference point at which grains can touch body `d`, m; 0 if `turn` is 0.
    fn lever(&self, model: &Model, state: &State, d: usize, turn: f64) -> f64 {
        if turn == 0.0 {
            return 0.0;
        }
        if self.radii[d].is_finite() {
            return self.radii[d];
        }
        // A wall is infinite, but grains touch it only where they are.
        let centre = state.imposed(model, d).position;
        let far = |i: usize| (state.position[i] - centre).norm() + model.grain_radius(i);
        (0..model.grains.len()).map(far).fold(0.0, f64::max)
    }

    /// Refuses targets (`[nd]`) that move a body too far in the step from `state`.
    ///
    /// # Errors
    /// [`Error::Step`] with the first such body.
    pub fn check(&self, model: &Model, state: &State, targets: &[Pose]) -> Result<()> {
        (targets.iter().enumerate()).try_for_each(|(d, target)| {
            self.check_displacement(model, state, d, [&state.imposed(model, d), target])
        })
    }

    /// Refuses a step from `state` to `next` in which excessive loads or springs moved a mounted body too far.
    ///
    /// # Errors
    /// [`Error::Step`] with the first such body.
    pub fn check_moved(&self, model: &Model, state: &State, next: &State) -> Result<()> {
        let ng = model.grains.len();
        (0..model.mounted_count()).try_for_each(|d| {
            self.check_displacement(model, state, d, [&state.pose(ng + d), &next.pose(ng + d)])
        })
    }

    /// Refuses the displacement of body `d` from one pose to another if it is too large for a step.
    fn check_displacement(
        &self,
        model: &Model,
        state: &State,
        d: usize,
        [from, to]: [&Pose; 2],
    ) -> Result<()> {
        let turn = rotation::log(&(to.orientation * from.orientation.inverse())).norm();
        let lever = self.lever(model, state, d, turn);
        let displacement = (to.position - from.position).norm() + turn * lever;
        if displacement <= self.max_displacement {
            return Ok(());
        }
        Err(Error::Step {
            cause: Cause::OverSpeed,
            time_s: state.time(),
            place: format!("{:?}", model.driven[d].name),
            expected: format!(
                "at most {:.3e} m in a step, half of the smallest grain",
                self.max_displacement
            ),
            found: match turn {
                0.0 => format!("{displacement:.3e} m"),
                _ => format!(
                    "{displacement:.3e} m, with a rotation by {turn:.3e} rad at {lever:.3e} m from its reference point"
                ),
            },
        })
    }
}

/// Returns the largest distance of a point of a body's parts from its origin, m.
fn radii(model: &Model, parts: &[Part]) -> f64 {
    let corners = parts.iter().flat_map(|part| match part {
        Part::Convex { shape, pose } => {
            let vertices = &model.shapes[*shape as usize].vertices;
            vertices.iter().map(|v| pose.point(v).norm()).collect::<Vec<_>>()
        }
        Part::HalfSpace { .. } => vec![f64::INFINITY],
    });
    corners.fold(0.0, f64::max)
}
