//! State of a simulation: everything needed to resume it bit for bit, and nothing else.
//!
//! Checkpoints, snapshots and `redo` are all this one thing.

use crate::error::{Error, Result};
use crate::math::{Pose, Quat, Vec3, is_unit};
use crate::model::Model;
use crate::window_memory::{Twist, WindowMemory};
use std::sync::Arc;

/// The state at the end of a step. Body arrays are numbered as in [`crate::model`].
#[derive(Debug, Clone, Default, PartialEq)]
pub struct State {
    /// Completed steps since the start of the run.
    pub step: u64,
    /// Simulated time since the start of the run, ns.
    pub time_ns: u64,
    /// Position of the body frames' origins `[nb]`, m.
    pub position: Vec<Vec3>,
    /// Orientation, body to world `[nb]`.
    pub orientation: Vec<Quat>,
    /// Velocity of the body frames' origins `[nb]`, m/s.
    pub velocity: Vec<Vec3>,
    /// Angular velocity, world axes `[nb]`, rad/s.
    pub angular_velocity: Vec<Vec3>,
    /// Contacts of the last step with their impulses, from which the next solve starts.
    pub contacts: ContactMemory,
    /// Poses of the mounts of mounted bodies `[nm]`.
    pub mount: Vec<Pose>,
    /// Memory of the component between windows; not part of the state's hash.
    pub window: Arc<WindowMemory>,
    /// State of the driver that moves the driven bodies; not part of the state's hash.
    pub driver: Arc<DriverState>,
    /// Energies since the start of the run.
    pub energy: EnergyLedger,
}

/// State of a driver in its encoding; the default is that of no driver.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct DriverState {
    /// Name of the encoding; empty: none.
    pub kind: String,
    /// Version of the encoding.
    pub version: u32,
    /// Encoded values.
    pub values: Vec<f64>,
}

impl DriverState {
    /// Returns the values of an encoding; `None` if no driver has left any.
    ///
    /// # Errors
    /// [`Error::State`] for values of another encoding.
    pub fn values_of(&self, kind: &str, version: u32) -> Result<Option<&[f64]>> {
        if self.kind.is_empty() {
            return Ok(None);
        }
        if (&self.kind[..], self.version) == (kind, version) {
            return Ok(Some(&self.values));
        }
        Err(Error::State {
            place: "driver state".into(),
            expected: format!("{kind} {version}, or none"),
            found: format!("{} {}", self.kind, self.version),
        })
    }
}

/// Contacts of a step for the warm start of the next one, sorted by bodies.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ContactMemory {
    /// Candidate and antagonist `[nc]`.
    pub bodies: Vec<[u32; 2]>,
    /// Identity of the point inside its pair `[nc]`.
    pub feature: Vec<u64>,
    /// The point in the candidate's body frame `[nc]`, m.
    pub local_point: Vec<Vec3>,
    /// Impulse on the candidate, world axes `[nc]`, N s.
    pub impulse: Vec<Vec3>,
    /// Overlap of the point's spring where the step ended `[nc]`, m; zero where the contact is rigid (T-42).
    pub overlap: Vec<f64>,
}

/// Energies since the start of the run, J (T-14).
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct EnergyLedger {
    /// Kinetic energy of the grains at the start of the run.
    pub initial_kinetic: f64,
    /// Potential energy of the grains at the start of the run.
    pub initial_potential: f64,
    /// Energy of the contacts' springs at the start of the run.
    pub initial_elastic: f64,
    /// Kinetic energy of the grains now.
    pub kinetic: f64,
    /// Potential energy of the grains in gravity now, zero at the world's origin.
    pub potential: f64,
    /// Energy of the contacts' springs now (T-42).
    pub elastic: f64,
    /// Work done on the grains by driven bodies.
    pub work_in: f64,
    /// Energy lost in contacts.
    pub dissipated: f64,
}

impl EnergyLedger {
    /// Returns the energy that the ledger cannot account for, J: zero for an exact integrator.
    pub fn balance_error(&self) -> f64 {
        (self.kinetic + self.potential + self.elastic)
            - (self.initial_kinetic + self.initial_potential + self.initial_elastic)
            - self.work_in
            + self.dissipated
    }
}

impl State {
    /// Pose of body `b`.
    pub fn pose(&self, b: usize) -> Pose {
        Pose { position: self.position[b], orientation: self.orientation[b] }
    }

    /// Returns the poses that were last imposed on the driven bodies `[nd]`, or on their mounts.
    pub fn imposed_poses(&self, model: &Model) -> Vec<Pose> {
        (0..model.driven.len()).map(|d| self.imposed(model, d)).collect()
    }

    /// Returns the pose that was last imposed on driven body `d`, or on its mount.
    pub fn imposed(&self, model: &Model, d: usize) -> Pose {
        self.mount.get(d).copied().unwrap_or_else(|| self.pose(model.grains.len() + d))
    }

    /// Twist with which the last window left driven body `d`, or its mount; the next cubic motion has to begin with it.
    ///
    /// `None`, any twist, after a held or linear motion, and where no window led to this state.
    pub fn end_twist(&self, d: usize) -> Option<Twist> {
        match &self.window.twists[..] {
            // Before the first step everything is at rest.
            [] => (self.step == 0).then(Twist::default),
            twists => twists.get(d).copied().flatten(),
        }
    }

    /// Appends a body at rest.
    pub fn push(&mut self, pose: Pose) {
        self.position.push(pose.position);
        self.orientation.push(pose.orientation);
        self.velocity.push(Vec3::zeros());
        self.angular_velocity.push(Vec3::zeros());
    }

    /// Checks that the state fits `model` and that every number is finite.
    ///
    /// # Errors
    /// [`Error::State`] with the first offending place.
    pub fn check(&self, model: &Model) -> Result<()> {
        let refuse = |place: String, expected: String, found: String| {
            Err(Error::State { place, expected, found })
        };
        let bodies = model.body_count();
        let lengths = [
            self.position.len(),
            self.orientation.len(),
            self.velocity.len(),
            self.angular_velocity.len(),
        ];
        if lengths != [bodies; 4] {
            let expected = format!("{bodies} bodies, as in the model");
            return refuse("body arrays".into(), expected, format!("{lengths:?}"));
        }
        for b in 0..bodies {
            let fields = [
                ("position", self.position[b].iter().all(|x| x.is_finite())),
                ("orientation", is_unit(&self.orientation[b])),
                ("velocity", self.velocity[b].iter().all(|x| x.is_finite())),
                ("spin", self.angular_velocity[b].iter().all(|x| x.is_finite())),
            ];
            if let Some((field, _)) = fields.iter().find(|(_, good)| !good) {
                let expected = "finite components, a unit quaternion".into();
                let found = format!(
                    "x = {:?} m, q = {:?}, v = {:?} m/s, w = {:?} rad/s",
                    self.position[b].as_slice(),
                    self.orientation[b].coords.as_slice(),
                    self.velocity[b].as_slice(),
                    self.angular_velocity[b].as_slice()
                );
                return refuse(format!("{field} of body {b}"), expected, found);
            }
        }
        let mounted = model.mounted_count();
        if self.mount.len() != mounted || !self.mount.iter().all(Pose::is_sound) {
            let expected = format!("{mounted} finite poses, one per mounted body");
            return refuse("mounts".into(), expected, format!("{:?}", self.mount));
        }
        self.window.check(model.driven.len())?;
        if let Some(i) = self.driver.values.iter().position(|x| !x.is_finite()) {
            let found = format!("{:?} in row {i}", self.driver.values[i]);
            return refuse("driver state".into(), "finite numbers".into(), found);
        }
        let e = &self.energy;
        let energy = [
            e.initial_kinetic,
            e.initial_potential,
            e.kinetic,
            e.potential,
            e.work_in,
            e.dissipated,
        ];
        if !energy.iter().all(|x| x.is_finite()) {
            return refuse("energy".into(), "finite numbers, J".into(), format!("{e:?}"));
        }
        self.contacts.check(model)
    }

    /// Simulated time, s: the double nearest to it, which prints as it is counted.
    pub fn time(&self) -> f64 {
        self.time_ns as f64 / 1e9
    }
}

impl ContactMemory {
    /// Renumbers driven bodies.
    pub(crate) fn renumber(&mut self, number: impl Fn(usize) -> usize) {
        for [_, antagonist] in &mut self.bodies {
            *antagonist = number(*antagonist as usize) as u32;
        }
        if self.bodies.is_sorted() {
            return;
        }
        let mut order: Vec<usize> = (0..self.bodies.len()).collect();
        // Stable: points of a pair stay in their order.
        order.sort_by_key(|&i| self.bodies[i]);
        self.bodies = order.iter().map(|&i| self.bodies[i]).collect();
        self.feature = order.iter().map(|&i| self.feature[i]).collect();
        self.local_point = order.iter().map(|&i| self.local_point[i]).collect();
        self.impulse = order.iter().map(|&i| self.impulse[i]).collect();
        self.overlap = order.iter().map(|&i| self.overlap[i]).collect();
    }

    fn check(&self, model: &Model) -> Result<()> {
        let nc = self.bodies.len();
        let lengths =
            [self.feature.len(), self.local_point.len(), self.impulse.len(), self.overlap.len()];
        let in_range = |&[candidate, antagonist]: &[u32; 2]| {
            (candidate as usize) < model.grains.len()
                && candidate < antagonist
                && (antagonist as usize) < model.body_count()
        };
        let finite = |v: &Vec3| v.iter().all(|x| x.is_finite());
        let bad = if lengths != [nc; 4] {
            Some(format!("arrays of {nc}, {lengths:?}"))
        } else if let Some(pair) = self.bodies.iter().find(|&pair| !in_range(pair)) {
            Some(format!("the pair {pair:?}"))
        } else if !self.bodies.is_sorted() {
            Some("pairs out of order".into())
        } else if !self.impulse.iter().chain(&self.local_point).all(finite) {
            Some("a number that is not finite".into())
        } else {
            let bad = self.overlap.iter().find(|x| !(x.is_finite() && **x >= 0.0));
            bad.map(|overlap| format!("an overlap of {overlap} m"))
        };
        bad.map_or(Ok(()), |found| {
            Err(Error::State {
                place: "remembered contacts".into(),
                expected: "arrays of one length, sorted pairs of the model's bodies, finite".into(),
                found,
            })
        })
    }
}
