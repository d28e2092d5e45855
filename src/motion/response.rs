//! Motion of mounted bodies without contacts, and their response to impulses (T-28).
//!
//! A body with isotropic translations enters the contact problem like a grain: an effective mass, at a point that is
//! not its centre of mass if springs hold it, and an effective inertia about that point. Any other body has up to
//! three degrees of freedom, which replace the grain's whitened angular velocity.

use super::free_rotation::Inertia;
use super::mounted::{MountedBody, free, inertia_about_free_point, only, point_inertia};
use super::prescribed_rotation;
use crate::math::{Mat3, Pose, Quat, Vec3, rotation};
use crate::model::DofMode;

/// Factor of the inertia of a prescribed rotation over the natural one, if others are free.
const PRESCRIBED_INERTIA_FACTOR: f64 = 1e9;

/// Motion of a mounted body without contacts, and its response to impulses.
///
/// In whitened coordinates `ŵ`, whose inertia is the identity, the body's angular velocity is `angular_map ŵ`, and
/// its point at `centre` has the velocity `velocity + linear_map ŵ`.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct MountResponse {
    /// Velocity of the point at `centre` for `ŵ = 0`, m/s.
    pub velocity: Vec3,
    /// Whitened coordinates without contacts, kg^(1/2) m/s.
    pub whitened_velocity: Vec3,
    /// Inverse mass, the response of `velocity` to an impulse, 1/kg; zero if translations are not isotropic.
    pub inverse_mass: f64,
    /// Vector from the body's reference point to the effective centre, world axes, m.
    pub centre: Vec3,
    /// Map from whitened coordinates to angular velocity.
    pub angular_map: Mat3,
    /// Map from whitened coordinates to velocity.
    pub linear_map: Mat3,
    /// Angular velocity without springs, loads and contacts, rad/s; zero unless all rotations are free.
    pub free_angular_velocity: Vec3,
}

impl MountResponse {
    /// Returns velocity of the reference point (m/s) and angular velocity (rad/s).
    pub fn twist(&self, velocity: &Vec3, whitened: &Vec3) -> (Vec3, Vec3) {
        let angular_velocity = self.angular_map * whitened;
        (
            velocity + self.linear_map * whitened - angular_velocity.cross(&self.centre),
            angular_velocity,
        )
    }
}

impl MountedBody<'_> {
    /// Returns the impulse (N s) of translational springs and dampers without the contribution of the end velocity.
    fn pull(&self, position: &Vec3) -> Vec3 {
        let (h, shift) = (self.h(), self.target.position - self.from.position);
        let end = self.mount.end_weight(self.stepping);
        let modes = self.mount.translations();
        let before = (self.from.position - self.start.position) * (1.0 - end);
        let way = before + (self.target.position - position) * end;
        let shift = shift - self.velocity * (h * (1.0 - end));
        Vec3::from_fn(|k, _| {
            let [stiffness, damping] = modes[k].spring();
            way[k] * (h * stiffness) + shift[k] * damping
        })
    }

    /// Returns the impulse (N m s) of rotational springs and dampers without the contribution of the end velocity.
    ///
    /// The stored energy is `φ·K φ/2` of the rotation vector `φ` to the target. Its gradient is not `K φ` if
    /// stiffnesses differ: that torque would feed energy in.
    fn twist_pull(&self, orientation: &Quat) -> Vec3 {
        let way = rotation::log(&(self.target.orientation * orientation.inverse()));
        let (shift, modes) = (self.turn(), self.mount.rotations());
        let pull = Vec3::from_fn(|k, _| way[k] * modes[k].spring()[0]);
        let drag = Vec3::from_fn(|k, _| shift[k] * modes[k].spring()[1]);
        rotation::rotation_vector_rate(&way, &pull) * self.h() + drag
    }

    fn weight(&self) -> Vec3 {
        self.gravity * self.mount.mass
    }

    /// Returns the impulses of load and weight over the step on the degrees of freedom that take them.
    ///
    /// `d` is the vector from the reference point to the centre of mass.
    fn loads(&self, d: &Vec3) -> [Vec3; 2] {
        let is_loaded = |m: DofMode| m == DofMode::Free;
        let (forward, turning) = (self.mount.translations(), self.mount.rotations());
        let force = free(forward, &self.load.force) + only(forward, is_loaded, &self.weight());
        let moment = only(turning, is_loaded, &d.cross(&self.weight()));
        [force * self.h(), (free(turning, &self.load.torque) + moment) * self.h()]
    }

    /// Returns the vector from the reference point to the centre of mass, and the inertia about the reference point.
    fn inertia(&self, orientation: &Quat) -> (Vec3, Mat3) {
        let r = orientation.to_rotation_matrix().into_inner();
        let d = r * self.mount.centre;
        let about_centre = r * Mat3::from_diagonal(&self.mount.inertia) * r.transpose();
        (d, about_centre + point_inertia(&d) * self.mount.mass)
    }

    /// Returns the response of a body that does not rotate.
    ///
    /// One that rotated until now keeps the momentum of its centre of mass.
    pub fn mass_response(&self, middle: &Pose) -> MountResponse {
        let mass = self.mount.mass + self.mount.added_inertia(0, self.stepping);
        let [load, _] = self.loads(&Vec3::zeros());
        let carried = self.velocity_of_centre() * self.mount.mass;
        let momentum = carried + self.pull(&middle.position) + load;
        MountResponse {
            velocity: momentum / mass,
            inverse_mass: 1.0 / mass,
            ..MountResponse::default()
        }
    }

    /// Returns linear and angular momentum about the reference point at the end of the step.
    ///
    /// Without the contribution of the end velocity to springs and dampers; `d` is the vector from there to the
    /// centre of mass.
    fn momenta(&self, middle: &Pose, d: &Vec3, free_angular_velocity: Option<Vec3>) -> [Vec3; 2] {
        let (w, q, m) = (self.angular_velocity, &middle.orientation, self.mount.mass);
        let v = self.velocity - self.held_velocity();
        let carried = match free_angular_velocity {
            _ if self.mount.has_isotropic_translations() => self.velocity_of_centre() * m,
            // Motion around the reference point belongs to the inertia about it.
            Some(_) => v * m,
            None => {
                let around = w.cross(d);
                (v + around - w.cross(&around) * self.h()) * m
            }
        };
        let inertia = inertia_about_free_point(self.mount);
        let own = free_angular_velocity.map_or_else(
            || {
                // The prescribed rotations take the rest of the gyroscopic term.
                let momentum = inertia.momentum_at(q, &w);
                momentum - w.cross(&momentum) * self.h()
            },
            |angular_velocity| inertia.momentum_at(q, &angular_velocity),
        );
        let [load, torque] = self.loads(d);
        [
            carried + self.pull(&middle.position) + load,
            d.cross(&carried) + own + self.twist_pull(q) + torque,
        ]
    }

    /// Returns the response of a rotating body with isotropic translations.
    ///
    /// `target` is the angular velocity of the target of prescribed rotations.
    pub fn rigid_body_response(&self, middle: &Pose, target: &Vec3) -> MountResponse {
        let mount = self.mount;
        let (d, inertia) = self.inertia(&middle.orientation);
        let m = mount.mass;
        let mass = m + mount.added_inertia(0, self.stepping);
        let free_angular_velocity = self.free_angular_velocity(&middle.orientation);
        let [momentum, mut angular] = self.momenta(middle, &d, free_angular_velocity);
        let added = Vec3::from_fn(|k, _| mount.added_inertia(3 + k, self.stepping));
        // At this point linear and angular momentum decouple: there the mass includes its springs.
        let centre = d * (m / mass);
        let mut about = inertia + Mat3::from_diagonal(&added) - point_inertia(&centre) * mass;
        // The mass is taken at a distance of 1 m.
        let stiff = PRESCRIBED_INERTIA_FACTOR * (inertia.trace() + m);
        let turn = self.turn_from_target(&middle.orientation);
        for (_, n) in prescribed_rotation::constraints(mount, &turn) {
            about += n * n.transpose() * stiff;
            angular += n * (n.dot(&(turn * target)) * stiff);
        }
        let (turn, whitened) = whiten(&about, &(angular - centre.cross(&momentum)));
        MountResponse {
            velocity: momentum / mass,
            whitened_velocity: whitened,
            inverse_mass: 1.0 / mass,
            centre,
            angular_map: turn,
            free_angular_velocity: free_angular_velocity.unwrap_or_default(),
            ..MountResponse::default()
        }
    }

    /// Returns the response of a body with up to three degrees of freedom of any kind.
    pub fn dof_response(&self, middle: &Pose) -> MountResponse {
        let (mount, m) = (self.mount, self.mount.mass);
        let (d, inertia) = self.inertia(&middle.orientation);
        let free_angular_velocity = self.free_angular_velocity(&middle.orientation);
        let [momentum, angular] = self.momenta(middle, &d, free_angular_velocity);
        let turn = self.turn_from_target(&middle.orientation);
        let constraints = prescribed_rotation::constraints(mount, &turn);
        // Unit twists of the degrees of freedom: velocity and angular velocity. Unused columns are zero, with an
        // inertia of 1.
        let mut twists = [(Vec3::zeros(), Vec3::zeros()); 3];
        let mut added = Vec3::repeat(1.0);
        for (column, k) in mount.free_dofs().enumerate() {
            let (velocity, angular_velocity) = &mut twists[column];
            if k < 3 {
                velocity[k] = 1.0
            } else {
                *angular_velocity = prescribed_rotation::constrained_rotation(&constraints, k - 3);
            }
            added[column] = mount.added_inertia(k, self.stepping);
        }
        let mass = Mat3::from_fn(|i, j| {
            let (v, w) = twists[j];
            twists[i].0.dot(&((v + w.cross(&d)) * m))
                + twists[i].1.dot(&(d.cross(&v) * m + inertia * w))
        });
        let rate = Vec3::from_fn(|i, _| twists[i].0.dot(&momentum) + twists[i].1.dot(&angular));
        let (root, whitened) = whiten(&(mass + Mat3::from_diagonal(&added)), &rate);
        MountResponse {
            velocity: self.held_velocity(),
            whitened_velocity: whitened,
            angular_map: Mat3::from_columns(&twists.map(|t| t.1)) * root,
            linear_map: Mat3::from_columns(&twists.map(|t| t.0)) * root,
            free_angular_velocity: free_angular_velocity.unwrap_or_default(),
            ..MountResponse::default()
        }
    }
}

/// Returns `B` with `B Bᵀ = M⁻¹`, and the whitened coordinates `ŵ` of the momentum: the velocity is `B ŵ`.
fn whiten(mass: &Mat3, momentum: &Vec3) -> (Mat3, Vec3) {
    // Positive definite for a valid mount; anything else becomes NaN, which the step refuses by name.
    let lower = mass.cholesky().map_or_else(|| Mat3::repeat(f64::NAN), |c| c.l());
    let inverse = lower.try_inverse().unwrap_or_else(|| Mat3::repeat(f64::NAN));
    (inverse.transpose(), inverse * momentum)
}
