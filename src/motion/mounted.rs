//! Mounted bodies: where they are, how they move without contacts, and how they answer to impulses (T-28).
//!
//! A body whose translations are alike stands in the contact problem like a grain: an effective mass, at
//! a point that is not its centre of mass if springs hold it, and an effective inertia about that point.
//! Any other one has up to three degrees of freedom, which take the place of the grain's whitened spin.

use super::Motion;
use super::tumbling::free_spin;
use crate::drive::Load;
use crate::error::{Error, Result};
use crate::math::{Mat3, Pose, Quat, Vec3, rotation};
use crate::model::{Freedom, Model, Mount};
use crate::state::State;

/// A held rotation that is imposed beside free ones is an inertia this many times the natural one.
const HELD: f64 = 1e9;
/// Turn of a mount that counts as none, rad.
const STILL: f64 = 1e-12;

/// How a mounted body moves without contacts, and how it answers to impulses.
///
/// In whitened coordinates `ŵ`, whose inertia is the identity, the body's spin is `turn ŵ`, and its point
/// at `centre` has the velocity `velocity + shift ŵ`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Response {
    /// m/s.
    pub velocity: Vec3,
    /// kg^(1/2) m/s.
    pub whitened: Vec3,
    /// Of `velocity` to an impulse, 1/kg; zero where translations are not alike.
    pub inverse_mass: f64,
    /// From the body's reference point, world axes, m.
    pub centre: Vec3,
    pub turn: Mat3,
    pub shift: Mat3,
}

impl Response {
    /// Velocity of the reference point (m/s) and spin (rad/s).
    pub fn twist(&self, velocity: &Vec3, whitened: &Vec3) -> (Vec3, Vec3) {
        let spin = self.turn * whitened;
        (velocity + self.shift * whitened - spin.cross(&self.centre), spin)
    }
}

/// A mounted body at the start of the step, and what acts on it during the step.
struct Body<'a> {
    mount: &'a Mount,
    stepping: &'a crate::model::Stepping,
    gravity: &'a Vec3,
    start: Pose,
    velocity: Vec3,
    spin: Vec3,
    /// Where the mount was and will be.
    from: Pose,
    target: &'a Pose,
    load: Load,
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
        let body = Body {
            mount,
            stepping: &model.stepping,
            gravity: &model.gravity,
            start: state.pose(b),
            velocity: state.velocity[b],
            spin: state.spin[b],
            from: state.mount[d],
            target,
            load,
        };
        if !load.is_finite() {
            return Err(Error::Input {
                place: format!("load on {:?}", model.driven[d].name),
                expected: "finite force and torque".into(),
                found: format!("{load:?}"),
            });
        }
        let imposed = rotation::log(&(target.orientation * body.from.orientation.inverse()));
        let imposed = only(mount.rotations(), Freedom::is_held, &imposed);
        let is_turned = imposed.norm() > STILL;
        if is_turned && !mount.moves_alike() {
            return Err(Error::Input {
                place: format!("target of {:?}", model.driven[d].name),
                expected: "no turn of a held rotation: the mount has other freedoms than a grain"
                    .into(),
                found: format!("{imposed:?} rad"),
            });
        }
        let spin = imposed / model.stepping.h();
        let middle = body.middle(&spin, is_turned);
        let response = match (mount.moves_alike(), mount.turns() || is_turned) {
            (true, false) => body.as_mass(&middle),
            (true, true) => body.as_solid(&middle, &spin),
            (false, _) => body.by_freedoms(&middle),
        };
        let (velocity, spin) = response.twist(&response.velocity, &response.whitened);
        self.position[b] = middle.position;
        self.orientation[b] = middle.orientation;
        self.velocity[b] = velocity;
        self.spin[b] = spin;
        self.responses.push(response);
        Ok(())
    }
}

/// The components whose modes are chosen; zero elsewhere.
pub(crate) fn only(modes: [Freedom; 3], chosen: impl Fn(Freedom) -> bool, v: &Vec3) -> Vec3 {
    Vec3::from_fn(|k, _| if chosen(modes[k]) { v[k] } else { 0.0 })
}

/// The components in modes that are not held.
fn free(modes: [Freedom; 3], v: &Vec3) -> Vec3 {
    only(modes, |m| !m.is_held(), v)
}

/// `-[v]²`: the moments of inertia of a point mass at `v`, over the mass.
fn arm(v: &Vec3) -> Mat3 {
    Mat3::from_diagonal_element(v.norm_squared()) - v * v.transpose()
}

impl Body<'_> {
    fn h(&self) -> f64 {
        self.stepping.h()
    }

    /// Velocity of held translations: the constant one that ends at the target.
    fn held_velocity(&self) -> Vec3 {
        let velocity = (self.target.position - self.start.position) / self.h();
        only(self.mount.translations(), Freedom::is_held, &velocity)
    }

    /// Configuration m; `spin` is that of held rotations.
    fn middle(&self, spin: &Vec3, is_turned: bool) -> Pose {
        let before = self.h() * (1.0 - self.stepping.theta);
        let velocity = free(self.mount.translations(), &self.velocity) + self.held_velocity();
        let position = self.start.position + velocity * before;
        if !is_turned && !self.mount.turns() {
            return Pose { position, orientation: self.start.orientation };
        }
        let spin = free(self.mount.rotations(), &self.spin) + spin;
        let orientation = rotation::advance(&self.start.orientation, &(spin * before));
        Pose { position, orientation }
    }

    /// Impulse (N s) of springs and dampers on translations, but for what the velocity of the end adds.
    fn pull(&self, position: &Vec3) -> Vec3 {
        let (h, shift) = (self.h(), self.target.position - self.from.position);
        let modes = self.mount.translations();
        Vec3::from_fn(|k, _| {
            let [stiffness, damping] = modes[k].spring();
            (self.target.position[k] - position[k]) * (h * stiffness) + shift[k] * damping
        })
    }

    /// The same on rotations, N m s. What is stored is `φ·K φ/2` of the rotation vector `φ` to the target, and its slope is
    /// not `K φ` where springs differ: that would drive the body round.
    fn twist_pull(&self, orientation: &Quat) -> Vec3 {
        let way = rotation::log(&(self.target.orientation * orientation.inverse()));
        let shift = rotation::log(&(self.target.orientation * self.from.orientation.inverse()));
        let modes = self.mount.rotations();
        let pull = Vec3::from_fn(|k, _| way[k] * modes[k].spring()[0]);
        let drag = Vec3::from_fn(|k, _| shift[k] * modes[k].spring()[1]);
        rotation::rate_of_log(&way, &pull) * self.h() + drag
    }

    fn weight(&self) -> Vec3 {
        self.gravity * self.mount.mass
    }

    /// Impulses of load and weight over the step, on degrees of freedom that take them; `d` is from the
    /// reference point to the centre of mass.
    fn loads(&self, d: &Vec3) -> [Vec3; 2] {
        let is_loaded = |m: Freedom| m == Freedom::Loaded;
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
        (d, about_centre + arm(&d) * self.mount.mass)
    }

    /// A body that does not turn: a mass. One that turned until now keeps the momentum of its centre of mass.
    fn as_mass(&self, middle: &Pose) -> Response {
        let mass = self.mount.mass + self.mount.freedoms[0].added_inertia(self.stepping);
        let [load, _] = self.loads(&Vec3::zeros());
        let carried =
            self.velocity + self.spin.cross(&(self.start.orientation * self.mount.centre));
        let momentum = carried * self.mount.mass + self.pull(&middle.position) + load;
        Response {
            velocity: momentum / mass,
            whitened: Vec3::zeros(),
            inverse_mass: 1.0 / mass,
            centre: Vec3::zeros(),
            turn: Mat3::zeros(),
            shift: Mat3::zeros(),
        }
    }

    /// Angular momentum about the centre of mass that the body would have without springs and loads.
    fn own_momentum(&self, q: &Quat) -> Vec3 {
        let inertia = &self.mount.inertia;
        let own = |w: &Vec3| q * (q.inverse() * w).component_mul(inertia);
        if self.mount.rotations().iter().any(|m| m.is_held()) {
            // What holds it takes the rest of the gyroscopic term.
            let momentum = own(&self.spin);
            return momentum - self.spin.cross(&momentum) * self.h();
        }
        own(&free_spin(inertia, &self.start.orientation, q, &self.spin, self.stepping))
    }

    /// What momentum and angular momentum about the reference point would be at the end of the step, but for
    /// what springs and dampers add by the velocity of the end: of a body with the velocity `v` at its start,
    /// whose centre of mass is at `d` from the reference point.
    fn momenta(&self, middle: &Pose, v: &Vec3, d: &Vec3) -> [Vec3; 2] {
        let (w, q) = (self.spin, &middle.orientation);
        let [load, torque] = self.loads(d);
        let around = w.cross(d);
        let carried = (v + around - w.cross(&around) * self.h()) * self.mount.mass;
        [
            carried + self.pull(&middle.position) + load,
            d.cross(&carried) + self.own_momentum(q) + self.twist_pull(q) + torque,
        ]
    }

    /// A body that turns and moves alike in all directions; `held` is the spin of held rotations.
    fn as_solid(&self, middle: &Pose, held: &Vec3) -> Response {
        let mount = self.mount;
        let (d, inertia) = self.inertia(&middle.orientation);
        let m = mount.mass;
        let mass = m + mount.freedoms[0].added_inertia(self.stepping);
        let [momentum, angular] = self.momenta(middle, &self.velocity, &d);
        // The mass counts at 1 m.
        let stiff = HELD * (inertia.trace() + m);
        let modes = mount.rotations();
        let added = Vec3::from_fn(|k, _| match modes[k] {
            Freedom::Held => stiff,
            mode => mode.added_inertia(self.stepping),
        });
        let angular = angular + held * stiff;
        // The point where momentum and angular momentum part: there the mass counts with its springs.
        let centre = d * (m / mass);
        let about = inertia + Mat3::from_diagonal(&added) - arm(&centre) * mass;
        let (turn, whitened) = whiten(&about, &(angular - centre.cross(&momentum)));
        Response {
            velocity: momentum / mass,
            whitened,
            inverse_mass: 1.0 / mass,
            centre,
            turn,
            shift: Mat3::zeros(),
        }
    }

    /// Up to three degrees of freedom of any kind.
    fn by_freedoms(&self, middle: &Pose) -> Response {
        let (mount, m) = (self.mount, self.mount.mass);
        let (d, inertia) = self.inertia(&middle.orientation);
        let held = self.held_velocity();
        let [momentum, angular] = self.momenta(middle, &(self.velocity - held), &d);
        // Unit twists of the degrees of freedom: velocity and spin. One that is not there has none, and
        // an inertia of 1.
        let mut twists = [(Vec3::zeros(), Vec3::zeros()); 3];
        let mut added = Vec3::repeat(1.0);
        for (column, k) in mount.free().enumerate() {
            let (velocity, spin) = &mut twists[column];
            if k < 3 {
                velocity[k] = 1.0
            } else {
                spin[k - 3] = 1.0
            }
            added[column] = mount.freedoms[k].added_inertia(self.stepping);
        }
        let mass = Mat3::from_fn(|i, j| {
            let (v, w) = twists[j];
            twists[i].0.dot(&((v + w.cross(&d)) * m))
                + twists[i].1.dot(&(d.cross(&v) * m + inertia * w))
        });
        let rate = Vec3::from_fn(|i, _| twists[i].0.dot(&momentum) + twists[i].1.dot(&angular));
        let (root, whitened) = whiten(&(mass + Mat3::from_diagonal(&added)), &rate);
        Response {
            velocity: held,
            whitened,
            inverse_mass: 0.0,
            centre: Vec3::zeros(),
            turn: Mat3::from_columns(&twists.map(|t| t.1)) * root,
            shift: Mat3::from_columns(&twists.map(|t| t.0)) * root,
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
