//! How mounted bodies move without contacts, and how they answer to impulses (T-28).
//!
//! A body whose translations are alike stands in the contact problem like a grain: an effective mass, at
//! a point that is not its centre of mass if springs hold it, and an effective inertia about that point.
//! Any other one has up to three degrees of freedom, which take the place of the grain's whitened angular velocity.

use super::free_rotation::Inertia;
use super::mounted::{MountedBody, free, inertia_about_free_point, only, point_inertia};
use super::prescribed_rotation;
use crate::math::{Mat3, Pose, Quat, Vec3, rotation};
use crate::model::DofMode;

/// A held rotation that is imposed beside free ones is an inertia this many times the natural one.
const PRESCRIBED_INERTIA_FACTOR: f64 = 1e9;

/// How a mounted body moves without contacts, and how it answers to impulses.
///
/// In whitened coordinates `ŵ`, whose inertia is the identity, the body's angular velocity is `turn ŵ`, and its point
/// at `centre` has the velocity `velocity + shift ŵ`.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct MountResponse {
    /// m/s.
    pub velocity: Vec3,
    /// kg^(1/2) m/s.
    pub whitened_velocity: Vec3,
    /// Of `velocity` to an impulse, 1/kg; zero where translations are not alike.
    pub inverse_mass: f64,
    /// From the body's reference point, world axes, m.
    pub centre: Vec3,
    pub angular_map: Mat3,
    pub linear_map: Mat3,
    /// Spin that a body free to turn in all directions would have without springs, loads and contacts, rad/s.
    pub free_angular_velocity: Vec3,
}

impl MountResponse {
    /// Velocity of the reference point (m/s) and angular velocity (rad/s).
    pub fn twist(&self, velocity: &Vec3, whitened: &Vec3) -> (Vec3, Vec3) {
        let angular_velocity = self.angular_map * whitened;
        (
            velocity + self.linear_map * whitened - angular_velocity.cross(&self.centre),
            angular_velocity,
        )
    }
}

impl MountedBody<'_> {
    /// Impulse (N s) of springs and dampers on translations, but for what the velocity of the end adds.
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

    /// The same on rotations, N m s. What is stored is `φ·K φ/2` of the rotation vector `φ` to the target, and its slope is
    /// not `K φ` where springs differ: that would drive the body round.
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

    /// Impulses of load and weight over the step, on degrees of freedom that take them; `d` is from the
    /// reference point to the centre of mass.
    fn loads(&self, d: &Vec3) -> [Vec3; 2] {
        let is_loaded = |m: DofMode| m == DofMode::Free;
        let (forward, turning) = (self.mount.translations(), self.mount.rotations());
        let force = free(forward, &self.load.force) + only(forward, is_loaded, &self.weight());
        let moment = only(turning, is_loaded, &d.cross(&self.weight()));
        [force * self.h(), (free(turning, &self.load.torque) + moment) * self.h()]
    }

    /// From the reference point to the centre of mass, and inertia about the reference point.
    fn inertia(&self, orientation: &Quat) -> (Vec3, Mat3) {
        let r = orientation.to_rotation_matrix().into_inner();
        let d = r * self.mount.centre;
        let about_centre = r * Mat3::from_diagonal(&self.mount.inertia) * r.transpose();
        (d, about_centre + point_inertia(&d) * self.mount.mass)
    }

    /// A body that does not turn: a mass. One that turned until now keeps the momentum of its centre of mass.
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

    /// What momentum and angular momentum about the reference point would be at the end of the step, but for
    /// what springs and dampers add by the velocity of the end; `d` is from there to the centre of mass.
    fn momenta(&self, middle: &Pose, d: &Vec3, free_angular_velocity: Option<Vec3>) -> [Vec3; 2] {
        let (w, q, m) = (self.angular_velocity, &middle.orientation, self.mount.mass);
        let v = self.velocity - self.held_velocity();
        let carried = match free_angular_velocity {
            _ if self.mount.has_isotropic_translations() => self.velocity_of_centre() * m,
            // What goes round the reference point belongs to the inertia about it.
            Some(_) => v * m,
            None => {
                let around = w.cross(d);
                (v + around - w.cross(&around) * self.h()) * m
            }
        };
        let inertia = inertia_about_free_point(self.mount);
        let own = free_angular_velocity.map_or_else(
            || {
                // What holds it takes the rest of the gyroscopic term.
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

    /// A body that turns and moves alike in all directions; `target` is the angular velocity of what held rotations follow.
    pub fn rigid_body_response(&self, middle: &Pose, target: &Vec3) -> MountResponse {
        let mount = self.mount;
        let (d, inertia) = self.inertia(&middle.orientation);
        let m = mount.mass;
        let mass = m + mount.added_inertia(0, self.stepping);
        let free_angular_velocity = self.free_angular_velocity(&middle.orientation);
        let [momentum, mut angular] = self.momenta(middle, &d, free_angular_velocity);
        let added = Vec3::from_fn(|k, _| mount.added_inertia(3 + k, self.stepping));
        // The point where momentum and angular momentum part: there the mass counts with its springs.
        let centre = d * (m / mass);
        let mut about = inertia + Mat3::from_diagonal(&added) - point_inertia(&centre) * mass;
        // The mass counts at 1 m.
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

    /// Up to three degrees of freedom of any kind.
    pub fn dof_response(&self, middle: &Pose) -> MountResponse {
        let (mount, m) = (self.mount, self.mount.mass);
        let (d, inertia) = self.inertia(&middle.orientation);
        let free_angular_velocity = self.free_angular_velocity(&middle.orientation);
        let [momentum, angular] = self.momenta(middle, &d, free_angular_velocity);
        let turn = self.turn_from_target(&middle.orientation);
        let constraints = prescribed_rotation::constraints(mount, &turn);
        // Unit twists of the degrees of freedom: velocity and angular velocity. One that is not there has none, and
        // an inertia of 1.
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

/// `B` with `B Bᵀ = M⁻¹`, and the whitened coordinates `ŵ` of the momentum: the velocity is `B ŵ`.
fn whiten(mass: &Mat3, momentum: &Vec3) -> (Mat3, Vec3) {
    // Positive definite for a mount that has been checked; anything else becomes NaN, which the step
    // refuses by name.
    let lower = mass.cholesky().map_or_else(|| Mat3::repeat(f64::NAN), |c| c.l());
    let inverse = lower.try_inverse().unwrap_or_else(|| Mat3::repeat(f64::NAN));
    (inverse.transpose(), inverse * momentum)
}
