//! Synthetic problems for tests and benchmarks: a lattice of grains of random mass, inertia and orientation
//! over a moving floor, with several contact points per neighbour pair.
//!
//! Contract: the same seed gives the same problem. Contacts are generated, not detected: the grains have no
//! shapes, so the scene can be solved but not stepped.

use crate::detection::{ContactHistory, Contacts};
use crate::local_problem::LocalProblem;
use crate::math::{Pose, Vec3, rotation};
use crate::model::{
    ContactStiffness, DrivenBody, Model, PartitionRule, Role, Schedule, Solver, Stepping,
};
use crate::motion::Motion;
use crate::state::State;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// Contact problem of a lattice of grains, with the data from which it was built.
#[derive(Debug)]
pub struct LatticeScene {
    /// Grains without shapes, and a floor without parts.
    pub model: Model,
    /// State at the beginning of the step.
    pub state: State,
    /// Configuration and free velocities of the step.
    pub motion: Motion,
    /// Contacts `[nc]`.
    pub contacts: Contacts,
    /// Initial impulses on the candidates, world axes, N s `[nc]`.
    pub warm: Vec<Vec3>,
    /// Contact problem.
    pub problem: LocalProblem,
}

/// Returns a random unit vector.
pub fn random_direction(rng: &mut Pcg64) -> Vec3 {
    loop {
        let v = Vec3::from_fn(|_, _| rng.random_range(-1.0..1.0));
        if v.norm() > 0.1 && v.norm() < 1.0 {
            return v.normalize();
        }
    }
}

fn empty_model(restitution: f64) -> Model {
    let floor = DrivenBody {
        name: "floor".into(),
        role: Role::Boundary,
        friction: 0.4,
        stiffness: ContactStiffness::RIGID,
        parts: Vec::new(),
        mount: None,
    };
    Model {
        shapes: Vec::new(),
        grains: Default::default(),
        driven: vec![floor],
        gravity: Vec3::new(0.0, 0.0, -9.81),
        grain_friction: 0.7,
        grain_stiffness: ContactStiffness::RIGID,
        restitution,
        stepping: Stepping { step_ns: 500_000, theta: 0.5, detection_distance: 1e-3 },
        solver: Solver {
            schedule: Schedule::Sequential,
            partition: PartitionRule::Boxes([1, 1, 1]),
            ..Solver::default()
        },
    }
}

impl LatticeScene {
    /// Creates `size[0] * size[1] * size[2]` grains of 2 cm in a cubic lattice, each a neighbour of up to ten
    /// others, the lowest ones of the floor too; `points` contact points per neighbour pair.
    pub fn grid(size: [usize; 3], points: usize, restitution: f64, seed: u64) -> Self {
        let mut rng = Pcg64::seed_from_u64(seed);
        let mut model = empty_model(restitution);
        let mut state = State::default();
        let [nx, ny, nz] = size;
        let ng = nx * ny * nz;
        let index = |x: usize, y: usize, z: usize| (x * ny + y) * nz + z;
        for x in 0..nx {
            for y in 0..ny {
                for z in 0..nz {
                    let jitter = random_direction(&mut rng) * 0.002;
                    let at = Vec3::new(x as f64, y as f64, z as f64 + 0.5) * 0.02 + jitter;
                    let mass = 0.02 * rng.random_range(0.3..3.0);
                    let inertia =
                        Vec3::from_fn(|_, _| 0.4 * mass * 1e-4 * rng.random_range(0.4..2.0));
                    model.grains.shape.push(0);
                    model.grains.mass.push(mass);
                    model.grains.inertia.push(inertia);
                    let axis = random_direction(&mut rng).normalize();
                    let orientation = rotation::exp(&(axis * rng.random_range(0.0..3.0)));
                    state.push(Pose { position: at, orientation });
                }
            }
        }
        state.push(Pose::identity());
        for b in 0..ng {
            state.velocity[b] = random_direction(&mut rng) * 0.05;
            state.angular_velocity[b] = random_direction(&mut rng) * 2.0;
        }
        let mut motion = Motion {
            position: state.position.clone(),
            orientation: state.orientation.clone(),
            velocity: state.velocity.clone(),
            angular_velocity: state.angular_velocity.clone(),
            responses: vec![],
        };
        for b in 0..ng {
            motion.velocity[b] += model.gravity * model.stepping.h();
        }
        motion.velocity[ng] = Vec3::new(0.02, 0.0, 0.01);
        motion.angular_velocity[ng] = Vec3::new(0.0, 0.05, 0.1);
        let mut contacts = Contacts::default();
        for x in 0..nx {
            for y in 0..ny {
                for z in 0..nz {
                    let c = index(x, y, z);
                    let mut others = Vec::new();
                    for (dx, dy, dz) in [(0, 0, 1), (0, 1, 0), (0, 1, 1), (1, 0, 0), (1, 0, 1)] {
                        if x + dx < nx && y + dy < ny && z + dz < nz {
                            others.push(index(x + dx, y + dy, z + dz));
                        }
                    }
                    if z == 0 {
                        others.push(ng);
                    }
                    for a in others {
                        let apart = if a == ng {
                            Vec3::z() * 0.01
                        } else {
                            (state.position[c] - state.position[a]) * 0.5
                        };
                        let normal =
                            (apart.normalize() + random_direction(&mut rng) * 0.1).normalize();
                        for feature in 0..points {
                            let point =
                                state.position[c] - apart + random_direction(&mut rng) * 0.005;
                            let gap = rng.random_range(-2e-4..1e-5);
                            contacts.push([c as u32, a as u32], feature as u64, point, normal, gap);
                        }
                    }
                }
            }
        }
        let warm = (contacts.normal.iter())
            .map(|n| (n + random_direction(&mut rng) * 0.3) * rng.random_range(0.0..1e-4))
            .collect();
        let mut scene =
            Self { model, state, motion, contacts, warm, problem: LocalProblem::default() };
        scene.build();
        scene
    }

    /// Rebuilds the problem after its data have changed.
    pub fn build(&mut self) {
        let Self { model, state, motion, contacts, warm, problem } = self;
        let overlap = contacts.gap.iter().map(|gap| -gap.min(0.0)).collect();
        let history = ContactHistory { impulse: warm.clone(), overlap };
        problem.build(model, state, motion, contacts, warm, &history);
    }
}
