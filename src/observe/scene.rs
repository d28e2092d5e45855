//! Small scenes for the tests of observables.

use crate::geometry::cuboid;
use crate::math::{Pose, Vec3};
use crate::model::{ContactStiffness, DrivenBody, Grains, Model, Part, Role, Solver, Stepping};
use crate::state::State;
use crate::workspace::Workspace;

pub const DENSITY: f64 = 2000.0;

/// A model of unit cubes, no driven bodies; step 1 ms, θ = 1/2.
pub fn cubes(count: usize) -> Model {
    let shape = cuboid(Vec3::repeat(0.5));
    let mut grains = Grains::default();
    (0..count).for_each(|_| grains.push(0, &shape, DENSITY));
    Model {
        shapes: vec![shape],
        grains,
        driven: Vec::new(),
        gravity: Vec3::new(0.0, 0.0, -10.0),
        grain_friction: 0.5,
        grain_stiffness: ContactStiffness::RIGID,
        restitution: 0.0,
        stepping: Stepping { step_ns: 1_000_000, theta: 0.5, detection_distance: 1e-3 },
        solver: Solver::default(),
    }
}

pub fn driven(name: &str, role: Role, parts: Vec<Part>) -> DrivenBody {
    DrivenBody {
        name: name.into(),
        role,
        friction: 0.5,
        stiffness: ContactStiffness::RIGID,
        parts,
        mount: None,
    }
}

/// All bodies at rest at the given places.
pub fn at(positions: &[[f64; 3]]) -> State {
    let mut state = State::default();
    positions.iter().for_each(|&p| state.push(Pose::at(p.into())));
    state
}

/// Lets a contact carry an impulse in world axes.
pub fn carry(state: &mut State, bodies: [u32; 2], point: [f64; 3], impulse: [f64; 3]) {
    let local = state.pose(bodies[0] as usize).inverse_point(&point.into());
    let contacts = &mut state.contacts;
    contacts.feature.push(contacts.feature.len() as u64);
    contacts.bodies.push(bodies);
    contacts.local_point.push(local);
    contacts.impulse.push(impulse.into());
    contacts.overlap.push(0.0);
}

/// Adds a contact with an impulse in world axes.
pub fn touch(
    w: &mut Workspace,
    bodies: [u32; 2],
    point: [f64; 3],
    normal: [f64; 3],
    gap: f64,
    impulse: [f64; 3],
) {
    w.contacts.push(bodies, w.contacts.len() as u64, point.into(), normal.into(), gap);
    w.impulse.push(impulse.into());
}
