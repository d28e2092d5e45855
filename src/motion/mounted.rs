//! Mounted bodies: prediction at configuration m, and pose at the end of the step (T-28).

use super::free_rotation::{FreeRotation, InertiaTensor};
use super::{Motion, prescribed_rotation};
use crate::drive::Load;
use crate::error::{Error, Result};
use crate::math::{Mat3, Pose, Quat, Vec3, rotation};
use crate::model::{DofMode, Model, Mount, Stepping};
use crate::state::State;

/// Maximum rotation of a mount that counts as none, rad.
const MAX_NEGLECTED_ROTATION: f64 = 1e-12;

/// Mounted body at the start of the step, and the inputs of the step.
pub(super) struct MountedBody<'a> {
    pub mount: &'a Mount,
    pub stepping: &'a Stepping,
    pub gravity: &'a Vec3,
    pub start: Pose,
    pub velocity: Vec3,
    pub angular_velocity: Vec3,
    /// Pose of the mount at the start of the step.
    pub from: Pose,
    pub target: &'a Pose,
    pub load: Load,
}

impl Motion {
    /// Predicts mounted body `d`.
    pub(super) fn predict_mounted(
        &mut self,
        model: &Model,
        state: &State,
        d: usize,
        mount: &Mount,
        target: &Pose,
        load: Load,
    ) -> Result<()> {
        let b = model.grains.len() + d;
        let body = MountedBody::of(model, state, d, mount, target, load);
        if !load.is_finite() {
            return Err(Error::Input {
                place: format!("load on {:?}", model.driven[d].name),
                expected: "finite force and torque".into(),
                found: format!("{load:?}"),
            });
        }
        let turn = body.turn();
        let imposed = only(mount.rotations(), DofMode::is_prescribed, &turn);
        let is_turned = imposed.norm() > MAX_NEGLECTED_ROTATION;
        if is_turned && !mount.has_isotropic_translations() {
            return Err(Error::Input {
                place: format!("target of {:?}", model.driven[d].name),
                expected: "no rotation about a prescribed axis, as the translations are not alike"
                    .into(),
                found: format!("{imposed:?} rad"),
            });
        }
        let middle = body.middle(&(imposed / model.stepping.h()), is_turned);
        let response = match (mount.has_isotropic_translations(), mount.can_rotate() || is_turned) {
            (true, false) => body.mass_response(&middle),
            (true, true) => body.rigid_body_response(&middle, &(turn / model.stepping.h())),
            (false, _) => body.dof_response(&middle),
        };
        let (velocity, angular_velocity) =
            response.twist(&response.velocity, &response.whitened_velocity);
        self.position[b] = middle.position;
        self.orientation[b] = middle.orientation;
        self.velocity[b] = velocity;
        self.angular_velocity[b] = angular_velocity;
        self.responses.push(response);
        Ok(())
    }

    /// Returns pose, velocity and angular velocity of mounted body `d` at the end of the step.
    ///
    /// `v` and `w` are the solved ones at configuration m. Prescribed components equal the target, so that rounding
    /// does not accumulate.
    pub fn mounted_end_state(
        &self,
        model: &Model,
        state: &State,
        d: usize,
        mount: &Mount,
        target: &Pose,
        [v, w]: [&Vec3; 2],
    ) -> (Pose, [Vec3; 2]) {
        let b = model.grains.len() + d;
        let body = MountedBody::of(model, state, d, mount, target, Load::zero());
        body.end(&self.pose(b), &self.responses[d].free_angular_velocity, [v, w])
    }
}

/// Returns the components with chosen modes, and zero elsewhere.
pub(super) fn only(modes: [DofMode; 3], chosen: impl Fn(DofMode) -> bool, v: &Vec3) -> Vec3 {
    Vec3::from_fn(|k, _| if chosen(modes[k]) { v[k] } else { 0.0 })
}

/// Returns the components with modes that are not prescribed.
pub(super) fn free(modes: [DofMode; 3], v: &Vec3) -> Vec3 {
    only(modes, |m| !m.is_prescribed(), v)
}

impl<'a> MountedBody<'a> {
    fn of(
        model: &'a Model,
        state: &State,
        d: usize,
        mount: &'a Mount,
        target: &'a Pose,
        load: Load,
    ) -> Self {
        let b = model.grains.len() + d;
        Self {
            mount,
            stepping: &model.stepping,
            gravity: &model.gravity,
            start: state.pose(b),
            velocity: state.velocity[b],
            angular_velocity: state.angular_velocity[b],
            from: state.mount[d],
            target,
            load,
        }
    }

    pub fn h(&self) -> f64 {
        self.stepping.h()
    }

    /// Returns the velocity of prescribed translations: the constant one that ends at the target.
    pub fn held_velocity(&self) -> Vec3 {
        let velocity = (self.target.position - self.start.position) / self.h();
        only(self.mount.translations(), DofMode::is_prescribed, &velocity)
    }

    /// Returns the pose at configuration m; `angular_velocity` is that of prescribed rotations.
    fn middle(&self, angular_velocity: &Vec3, is_turned: bool) -> Pose {
        let (mount, start) = (self.mount, &self.start);
        let before = self.h() * (1.0 - self.stepping.theta);
        let mut orientation = start.orientation;
        if is_turned || mount.can_rotate() {
            let angular_velocity =
                free(mount.rotations(), &self.angular_velocity) + angular_velocity;
            orientation = rotation::advance(&orientation, &(angular_velocity * before));
            orientation =
                prescribed_rotation::project(mount, &self.target_at_middle(), &orientation);
        }
        if !mount.has_isotropic_translations() {
            let velocity = free(mount.translations(), &self.velocity) + self.held_velocity();
            return Pose { position: start.position + velocity * before, orientation };
        }
        // The centre of mass moves on a straight line, the reference point around it.
        let around = start.orientation * mount.centre - orientation * mount.centre;
        let position = start.position + around + self.velocity_of_centre() * before;
        Pose { position, orientation }
    }

    /// Returns the target orientation of prescribed rotations at configuration m.
    fn target_at_middle(&self) -> Quat {
        let turn = self.turn() * (1.0 - self.stepping.theta);
        rotation::advance(&self.from.orientation, &turn)
    }

    /// Returns the rotation of a body of this orientation relative to its target, at configuration m.
    pub fn turn_from_target(&self, middle: &Quat) -> Quat {
        middle * self.target_at_middle().inverse()
    }

    /// Returns the rotation vector of the mount during the step, rad.
    pub fn turn(&self) -> Vec3 {
        rotation::log(&(self.target.orientation * self.from.orientation.inverse()))
    }

    /// Returns the velocity of the centre of mass at the start, m/s.
    pub fn velocity_of_centre(&self) -> Vec3 {
        self.velocity + self.angular_velocity.cross(&(self.start.orientation * self.mount.centre))
    }

    /// Returns the angular velocity at the end of the step without springs, loads and contacts, if all rotations are
    /// free.
    pub fn free_angular_velocity(&self, middle: &Quat) -> Option<Vec3> {
        let free_spin = || {
            self.free_rotation(&inertia_about_free_point(self.mount))
                .free_angular_velocity(middle, self.stepping)
        };
        self.mount.rotates_freely().then(free_spin)
    }

    fn free_rotation<'b>(&'b self, inertia: &'b InertiaTensor) -> FreeRotation<'b, InertiaTensor> {
        FreeRotation {
            inertia,
            start: &self.start.orientation,
            angular_velocity: &self.angular_velocity,
        }
    }

    /// Returns pose, velocity and angular velocity at the end of the step, from those solved at configuration m.
    fn end(
        &self,
        middle: &Pose,
        free_angular_velocity: &Vec3,
        [v, w]: [&Vec3; 2],
    ) -> (Pose, [Vec3; 2]) {
        let (mount, after) = (self.mount, self.h() * self.stepping.theta);
        let orientation = rotation::advance(&middle.orientation, &(w * after));
        let orientation =
            prescribed_rotation::project(mount, &self.target.orientation, &orientation);
        let angular_velocity = if mount.rotates_freely() {
            let inertia = inertia_about_free_point(mount);
            self.free_rotation(&inertia).angular_velocity_at_end(
                &middle.orientation,
                [free_angular_velocity, w],
                &orientation,
            )
        } else {
            *w
        };
        if !mount.has_isotropic_translations() {
            let free = middle.position + v * after;
            let is_held = mount.translations().map(DofMode::is_prescribed);
            let project = |k, _| if is_held[k] { self.target.position[k] } else { free[k] };
            return (
                Pose { position: Vec3::from_fn(project), orientation },
                [*v, angular_velocity],
            );
        }
        let (d, d_end) = (middle.orientation * mount.centre, orientation * mount.centre);
        let of_centre = v + w.cross(&d);
        let position = middle.position + (d - d_end) + of_centre * after;
        (
            Pose { position, orientation },
            [of_centre - angular_velocity.cross(&d_end), angular_velocity],
        )
    }
}

/// Returns the inertia about the centre of mass, or about the reference point if translations are not isotropic.
pub(super) fn inertia_about_free_point(mount: &Mount) -> InertiaTensor {
    let mut inertia = Mat3::from_diagonal(&mount.inertia);
    if mount.rotates_freely() && !mount.has_isotropic_translations() {
        inertia += point_inertia(&mount.centre) * mount.mass;
    }
    InertiaTensor(inertia, inertia.try_inverse().unwrap_or_else(|| Mat3::repeat(f64::NAN)))
}

/// Returns `-[v]²`: the moments of inertia of a point mass at `v`, over the mass.
pub(super) fn point_inertia(v: &Vec3) -> Mat3 {
    Mat3::from_diagonal_element(v.norm_squared()) - v * v.transpose()
}
