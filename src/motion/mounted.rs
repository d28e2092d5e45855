//! Mounted bodies: where they are, how they move without contacts, and how they answer to impulses (T-28).
//!
//! A body whose translations are alike stands in the contact problem like a grain: an effective mass, at
//! a point that is not its centre of mass if springs hold it, and an effective inertia about that point.
//! Any other one has up to three degrees of freedom, which take the place of the grain's whitened spin.

use super::tumbling::{Inertia, Tensor, Tumbling};
use super::{Motion, held};
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
#[derive(Debug, Clone, Copy, PartialEq, Default)]
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
    /// Spin that a body free to turn in all directions would have without springs, loads and contacts, rad/s.
    pub own_spin: Vec3,
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
        let body = Body::of(model, state, d, mount, target, load);
        if !load.is_finite() {
            return Err(Error::Input {
                place: format!("load on {:?}", model.driven[d].name),
                expected: "finite force and torque".into(),
                found: format!("{load:?}"),
            });
        }
        let turn = rotation::log(&(target.orientation * body.from.orientation.inverse()));
        let imposed = only(mount.rotations(), Freedom::is_held, &turn);
        let is_turned = imposed.norm() > STILL;
        if is_turned && !mount.moves_alike() {
            return Err(Error::Input {
                place: format!("target of {:?}", model.driven[d].name),
                expected: "no turn of a held rotation: the mount has other freedoms than a grain"
                    .into(),
                found: format!("{imposed:?} rad"),
            });
        }
        let middle = body.middle(&(imposed / model.stepping.h()), is_turned);
        let response = match (mount.moves_alike(), mount.turns() || is_turned) {
            (true, false) => body.as_mass(&middle),
            (true, true) => body.as_solid(&middle, &(turn / model.stepping.h())),
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

    /// Where mounted body `d` is at the end of the step, and its velocity and spin there; `v` and `w` are the solved ones at
    /// configuration m. What is held is where the target says: rounding must not add up over steps.
    pub fn end_of_mounted(
        &self,
        model: &Model,
        state: &State,
        d: usize,
        mount: &Mount,
        target: &Pose,
        [v, w]: [&Vec3; 2],
    ) -> (Pose, [Vec3; 2]) {
        let b = model.grains.len() + d;
        let body = Body::of(model, state, d, mount, target, Load::zero());
        let middle = Pose { position: self.position[b], orientation: self.orientation[b] };
        body.end(&middle, &self.responses[d].own_spin, [v, w])
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

impl<'a> Body<'a> {
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
            spin: state.spin[b],
            from: state.mount[d],
            target,
            load,
        }
    }

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
        let (mount, start) = (self.mount, &self.start);
        let before = self.h() * (1.0 - self.stepping.theta);
        let mut orientation = start.orientation;
        if is_turned || mount.turns() {
            let spin = free(mount.rotations(), &self.spin) + spin;
            orientation = rotation::advance(&orientation, &(spin * before));
            orientation = held::put(mount, &self.target_at_middle(), &orientation);
        }
        if !mount.moves_alike() {
            let velocity = free(mount.translations(), &self.velocity) + self.held_velocity();
            return Pose { position: start.position + velocity * before, orientation };
        }
        // The centre of mass goes straight on, and the reference point round it.
        let around = start.orientation * mount.centre - orientation * mount.centre;
        let position = start.position + around + self.velocity_of_centre() * before;
        Pose { position, orientation }
    }

    /// What held rotations follow, at configuration m.
    fn target_at_middle(&self) -> Quat {
        let turn = self.turn() * (1.0 - self.stepping.theta);
        rotation::advance(&self.from.orientation, &turn)
    }

    /// Turn of the mount during the step, rad.
    fn turn(&self) -> Vec3 {
        rotation::log(&(self.target.orientation * self.from.orientation.inverse()))
    }

    /// Velocity of the centre of mass at the start.
    fn velocity_of_centre(&self) -> Vec3 {
        self.velocity + self.spin.cross(&(self.start.orientation * self.mount.centre))
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
        let carried = self.velocity_of_centre() * self.mount.mass;
        let momentum = carried + self.pull(&middle.position) + load;
        Response { velocity: momentum / mass, inverse_mass: 1.0 / mass, ..Response::default() }
    }

    /// Spin that the body would have at the end of the step without springs, loads and contacts; of one that is free to
    /// turn in all directions.
    fn own_spin(&self, middle: &Quat) -> Option<Vec3> {
        let free_spin = || self.tumbling(&own_inertia(self.mount)).free_spin(middle, self.stepping);
        tumbles(self.mount).then(free_spin)
    }

    fn tumbling<'b>(&'b self, inertia: &'b Tensor) -> Tumbling<'b, Tensor> {
        Tumbling { inertia, start: &self.start.orientation, spin: &self.spin }
    }

    /// What momentum and angular momentum about the reference point would be at the end of the step, but for
    /// what springs and dampers add by the velocity of the end; `d` is from there to the centre of mass.
    fn momenta(&self, middle: &Pose, d: &Vec3, own_spin: Option<Vec3>) -> [Vec3; 2] {
        let (w, q, m) = (self.spin, &middle.orientation, self.mount.mass);
        let v = self.velocity - self.held_velocity();
        let carried = match own_spin {
            _ if self.mount.moves_alike() => self.velocity_of_centre() * m,
            // What goes round the reference point belongs to the inertia about it.
            Some(_) => v * m,
            None => {
                let around = w.cross(d);
                (v + around - w.cross(&around) * self.h()) * m
            }
        };
        let inertia = own_inertia(self.mount);
        let own = own_spin.map_or_else(
            || {
                // What holds it takes the rest of the gyroscopic term.
                let momentum = inertia.momentum_at(q, &w);
                momentum - w.cross(&momentum) * self.h()
            },
            |spin| inertia.momentum_at(q, &spin),
        );
        let [load, torque] = self.loads(d);
        [
            carried + self.pull(&middle.position) + load,
            d.cross(&carried) + own + self.twist_pull(q) + torque,
        ]
    }

    /// A body that turns and moves alike in all directions; `target` is the spin of what held rotations follow.
    fn as_solid(&self, middle: &Pose, target: &Vec3) -> Response {
        let mount = self.mount;
        let (d, inertia) = self.inertia(&middle.orientation);
        let m = mount.mass;
        let mass = m + mount.freedoms[0].added_inertia(self.stepping);
        let own_spin = self.own_spin(&middle.orientation);
        let [momentum, mut angular] = self.momenta(middle, &d, own_spin);
        let added = Vec3::from_fn(|k, _| mount.freedoms[3 + k].added_inertia(self.stepping));
        // The point where momentum and angular momentum part: there the mass counts with its springs.
        let centre = d * (m / mass);
        let mut about = inertia + Mat3::from_diagonal(&added) - arm(&centre) * mass;
        // The mass counts at 1 m.
        let stiff = HELD * (inertia.trace() + m);
        let turn = middle.orientation * self.target_at_middle().inverse();
        for (_, n) in held::conditions(mount, &turn) {
            about += n * n.transpose() * stiff;
            angular += n * (n.dot(&(turn * target)) * stiff);
        }
        let (turn, whitened) = whiten(&about, &(angular - centre.cross(&momentum)));
        Response {
            velocity: momentum / mass,
            whitened,
            inverse_mass: 1.0 / mass,
            centre,
            turn,
            own_spin: own_spin.unwrap_or_default(),
            ..Response::default()
        }
    }

    /// Pose, velocity and spin where the step ends, from those that were solved at configuration m.
    fn end(&self, middle: &Pose, own_spin: &Vec3, [v, w]: [&Vec3; 2]) -> (Pose, [Vec3; 2]) {
        let (mount, after) = (self.mount, self.h() * self.stepping.theta);
        let orientation = rotation::advance(&middle.orientation, &(w * after));
        let orientation = held::put(mount, &self.target.orientation, &orientation);
        let spin = if tumbles(mount) {
            let inertia = own_inertia(mount);
            self.tumbling(&inertia).spin_at_end(&middle.orientation, [own_spin, w], &orientation)
        } else {
            *w
        };
        if !mount.moves_alike() {
            let free = middle.position + v * after;
            let is_held = mount.translations().map(Freedom::is_held);
            let put = |k, _| if is_held[k] { self.target.position[k] } else { free[k] };
            return (Pose { position: Vec3::from_fn(put), orientation }, [*v, spin]);
        }
        let (d, d_end) = (middle.orientation * mount.centre, orientation * mount.centre);
        let of_centre = v + w.cross(&d);
        let position = middle.position + (d - d_end) + of_centre * after;
        (Pose { position, orientation }, [of_centre - spin.cross(&d_end), spin])
    }

    /// Up to three degrees of freedom of any kind.
    fn by_freedoms(&self, middle: &Pose) -> Response {
        let (mount, m) = (self.mount, self.mount.mass);
        let (d, inertia) = self.inertia(&middle.orientation);
        let own_spin = self.own_spin(&middle.orientation);
        let [momentum, angular] = self.momenta(middle, &d, own_spin);
        let turn = middle.orientation * self.target_at_middle().inverse();
        let conditions = held::conditions(mount, &turn);
        // Unit twists of the degrees of freedom: velocity and spin. One that is not there has none, and
        // an inertia of 1.
        let mut twists = [(Vec3::zeros(), Vec3::zeros()); 3];
        let mut added = Vec3::repeat(1.0);
        for (column, k) in mount.free().enumerate() {
            let (velocity, spin) = &mut twists[column];
            if k < 3 {
                velocity[k] = 1.0
            } else {
                *spin = held::beside(&conditions, k - 3);
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
            velocity: self.held_velocity(),
            whitened,
            turn: Mat3::from_columns(&twists.map(|t| t.1)) * root,
            shift: Mat3::from_columns(&twists.map(|t| t.0)) * root,
            own_spin: own_spin.unwrap_or_default(),
            ..Response::default()
        }
    }
}

/// Whether a body turns in all directions, so that its angular momentum is its own.
fn tumbles(mount: &Mount) -> bool {
    !mount.rotations().iter().any(|m| m.is_held())
}

/// Inertia about the point that goes its own way: the centre of mass, or the reference point of a body that tumbles in its
/// place.
fn own_inertia(mount: &Mount) -> Tensor {
    let mut inertia = Mat3::from_diagonal(&mount.inertia);
    if tumbles(mount) && !mount.moves_alike() {
        inertia += arm(&mount.centre) * mount.mass;
    }
    Tensor(inertia, inertia.try_inverse().unwrap_or_else(|| Mat3::repeat(f64::NAN)))
}

/// `B` with `B Bᵀ = M⁻¹`, and the whitened coordinates `ŵ` of the momentum: the velocity is `B ŵ`.
fn whiten(mass: &Mat3, momentum: &Vec3) -> (Mat3, Vec3) {
    // Positive definite for a mount that has been checked; anything else becomes NaN, which the step
    // refuses by name.
    let lower = mass.cholesky().map_or_else(|| Mat3::repeat(f64::NAN), |c| c.l());
    let inverse = lower.try_inverse().unwrap_or_else(|| Mat3::repeat(f64::NAN));
    (inverse.transpose(), inverse * momentum)
}
