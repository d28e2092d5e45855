//! How fast driven bodies may be led: a faster tool would pass through grains unseen.

use crate::error::{Cause, Error, Result};
use crate::math::{Pose, Vec3, rotation};
use crate::model::{Model, Part};
use crate::state::State;

/// The farthest that a point of a driven body may be led in a step.
#[derive(Debug, Clone, PartialEq)]
pub struct SpeedLimit {
    /// Half of the smallest grain, m; infinite without grains.
    pub way: f64,
    /// Largest distance of a point of each driven body from its reference point `[nd]`, m; infinite with half-spaces.
    reach: Vec<f64>,
}

impl SpeedLimit {
    pub fn of(model: &Model) -> Self {
        let diameter = |s: &u32| model.shapes[*s as usize].nominal_diameter();
        let smallest = model.grains.shape.iter().map(diameter).fold(f64::INFINITY, f64::min);
        let reach = model.driven.iter().map(|d| reach(model, &d.parts)).collect();
        Self { way: 0.5 * smallest, reach }
    }

    /// In which time body `d` is led so far at this velocity (m/s) and spin (rad/s), s; infinite at rest.
    pub fn time(
        &self,
        model: &Model,
        state: &State,
        d: usize,
        velocity: &Vec3,
        spin: &Vec3,
    ) -> f64 {
        let turning = self.led(model, state, d, &state.imposed(model, d).position, spin.norm());
        self.way / (velocity.norm() + turning)
    }

    /// How far a turn by `angle` about `centre`, the reference point of body `d`, leads its points that grains can meet.
    fn led(&self, model: &Model, state: &State, d: usize, centre: &Vec3, angle: f64) -> f64 {
        if angle == 0.0 {
            return 0.0;
        }
        if self.reach[d].is_finite() {
            return angle * self.reach[d];
        }
        // A wall has no end, but it is met where grains are.
        let far = |i: usize| (state.position[i] - centre).norm() + model.grain_radius(i);
        angle * (0..model.grains.len()).map(far).fold(0.0, f64::max)
    }

    /// Refuses targets (`[nd]`) that lead a body too far in the step from `state`.
    ///
    /// # Errors
    /// [`Error::Step`] with the first such body.
    pub fn check(&self, model: &Model, state: &State, targets: &[Pose]) -> Result<()> {
        for (d, target) in targets.iter().enumerate() {
            let from = state.imposed(model, d);
            let turn = rotation::log(&(target.orientation * from.orientation.inverse())).norm();
            let turned = self.led(model, state, d, &from.position, turn);
            let way = (target.position - from.position).norm() + turned;
            if way > self.way {
                return Err(Error::Step {
                    cause: Cause::OverSpeed,
                    time_s: state.time(),
                    place: format!("{:?}", model.driven[d].name),
                    expected: format!(
                        "at most {:.3e} m in a step, half of the smallest grain",
                        self.way
                    ),
                    found: format!("{way:.3e} m"),
                });
            }
        }
        Ok(())
    }
}

/// Largest distance of a point of a body's parts from its origin, m.
fn reach(model: &Model, parts: &[Part]) -> f64 {
    let corners = parts.iter().flat_map(|part| match part {
        Part::Convex { shape, pose } => {
            let vertices = &model.shapes[*shape as usize].vertices;
            vertices.iter().map(|v| pose.point(v).norm()).collect::<Vec<_>>()
        }
        Part::HalfSpace { .. } => vec![f64::INFINITY],
    });
    corners.fold(0.0, f64::max)
}
