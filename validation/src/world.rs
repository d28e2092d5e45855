//! Scenes of the checks: grains and walls that are stepped.

use super::check_interrupt;
use ballast::drive::{Load, StepInputs};
use ballast::geometry::{Polyhedron, random_rotation};
use ballast::math::{Pose, Quat, Vec3};
use ballast::model::{
    ContactStiffness, DrivenBody, Grains, Model, Mount, Norm, Part, PartitionRule, Role, Schedule,
    Solver, Stepping,
};
use ballast::observe;
use ballast::state::State;
use ballast::step::{StepReport, step};
use ballast::workspace::Workspace;
use ballast_session::Result;
use rand::RngExt;
use rand_pcg::Pcg64;

/// Gravity, m/s².
pub const GRAVITY: f64 = 9.81;
/// Density of the grains, kg/m³.
const DENSITY: f64 = 2700.0;
/// Nominal diameter of grains, m.
pub const D: f64 = 0.04;
/// Maximum speed of settling grains, m/s.
pub const SETTLING_SPEED: f64 = 0.8;

/// Model with its state and the prescribed poses of its driven bodies.
pub struct World {
    pub model: Model,
    pub state: State,
    pub workspace: Workspace,
    /// Prescribed poses of the driven bodies `[nd]`.
    pub targets: Vec<Pose>,
    /// Forces on the mounted bodies in addition to gravity, N `[nm]`.
    pub forces: Vec<Vec3>,
    /// Stiffness of the contacts of driven bodies that are added.
    pub wall_stiffness: ContactStiffness,
}

impl World {
    /// Creates an empty scene under gravity, with θ = 1/2, no restitution and a tolerance far below that of the checks.
    pub fn new(step_ns: u64, friction: f64, detection_distance: f64) -> Self {
        let solver = Solver {
            schedule: Schedule::Sequential,
            partition: PartitionRule::Balanced(1),
            max_iterations: 2000,
            tolerance: Some(1e-8),
            norm: Norm::Qm16,
            convergence_check_interval: 5,
            ..Solver::default()
        };
        let model = Model {
            shapes: vec![],
            grains: Grains::default(),
            driven: vec![],
            gravity: Vec3::new(0.0, 0.0, -GRAVITY),
            grain_friction: friction,
            grain_stiffness: ContactStiffness::RIGID,
            restitution: 0.0,
            stepping: Stepping { step_ns, theta: 0.5, detection_distance },
            solver,
        };
        Self {
            model,
            state: State::default(),
            workspace: Workspace::default(),
            targets: vec![],
            forces: vec![],
            wall_stiffness: ContactStiffness::RIGID,
        }
    }

    /// Returns the scene with the coarse solver of bed preparation, on all cores.
    pub fn pouring(mut self, iterations: u32) -> Self {
        self.model.solver = Solver {
            max_iterations: iterations,
            tolerance: Some(1e-3),
            partition: PartitionRule::ContactsPer(1000),
            ..Solver::default()
        };
        self
    }

    /// Adds a shape and returns its index.
    pub fn shape(&mut self, polyhedron: Polyhedron) -> u32 {
        self.model.shapes.push(polyhedron);
        self.model.shapes.len() as u32 - 1
    }

    /// Adds a grain at rest; grains come before driven bodies.
    pub fn grain(&mut self, shape: u32, pose: Pose) {
        self.model.grains.push(shape, &self.model.shapes[shape as usize], DENSITY);
        self.state.push(pose);
    }

    /// Adds a half-space through `at`, solid behind its normal, and returns its index among the driven bodies.
    pub fn wall(&mut self, name: &str, at: Vec3, normal: Vec3, friction: f64) -> usize {
        let parts = vec![Part::HalfSpace { normal: normal.normalize(), offset: 0.0 }];
        self.driven(name, parts, at, friction, None)
    }

    /// Adds a driven body at a place, and returns its index among the driven bodies; mounted bodies come before others.
    pub fn driven(
        &mut self,
        name: &str,
        parts: Vec<Part>,
        at: Vec3,
        friction: f64,
        mount: Option<Mount>,
    ) -> usize {
        self.model.driven.push(DrivenBody {
            name: name.into(),
            role: Role::Boundary,
            friction,
            stiffness: self.wall_stiffness,
            parts,
            mount,
        });
        self.state.push(Pose::at(at));
        self.targets.push(Pose::at(at));
        if mount.is_some() {
            self.state.mount.push(Pose::at(at));
            self.forces.push(Vec3::zeros());
        }
        self.targets.len() - 1
    }

    /// Adds floor and four walls of a box with a corner at the origin.
    pub fn container(&mut self, [x, y]: [f64; 2], floor: f64, walls: f64) {
        self.wall("floor", Vec3::zeros(), Vec3::z(), floor);
        self.wall("west", Vec3::zeros(), Vec3::x(), walls);
        self.wall("east", Vec3::x() * x, -Vec3::x(), walls);
        self.wall("south", Vec3::zeros(), Vec3::y(), walls);
        self.wall("north", Vec3::y() * y, -Vec3::y(), walls);
    }

    /// Places a driven body, at rest.
    pub fn place(&mut self, body: usize, at: Vec3) {
        let n = self.model.grains.len();
        self.state.position[n + body] = at;
        self.targets[body] = Pose::at(at);
        if let Some(mount) = self.state.mount.get_mut(body) {
            *mount = Pose::at(at);
        }
    }

    /// Removes all driven bodies and the memory of all contacts.
    pub fn remove_walls(&mut self) {
        let n = self.model.grains.len();
        self.model.driven.clear();
        self.targets.clear();
        let State { position, orientation, velocity, angular_velocity, contacts, .. } =
            &mut self.state;
        position.truncate(n);
        orientation.truncate(n);
        velocity.truncate(n);
        angular_velocity.truncate(n);
        *contacts = Default::default();
    }

    /// Takes a step.
    pub fn step(&mut self) -> Result<StepReport> {
        check_interrupt()?;
        let load = |force: &Vec3| Load { force: *force, torque: Vec3::zeros() };
        let loads: Vec<Load> = self.forces.iter().map(load).collect();
        let inputs = StepInputs { loads: &loads, ..StepInputs::from_targets(&self.targets) };
        Ok(step(&self.model, &mut self.state, &inputs, &mut self.workspace, &mut ())?)
    }

    /// Takes steps for `seconds` of simulated time.
    pub fn run(&mut self, seconds: f64) -> Result {
        for _ in 0..(seconds / self.model.stepping.h()).round() as usize {
            self.step()?;
        }
        Ok(())
    }

    /// Lets grains settle: at most at `speed` (m/s), as in a fluid, for the time that the uppermost grain needs, then
    /// freely until their mean speed is below `rest` (m/s), at most 1.5 s.
    pub fn settle(&mut self, speed: f64, rest: f64) -> Result {
        let h = self.model.stepping.h();
        let keep = 1.0 - GRAVITY * h / speed;
        let falling = (0.8 * self.top() / speed / h) as usize;
        let max_steps = falling + (1.5 / h) as usize;
        for k in 0..max_steps {
            self.step()?;
            if k < falling {
                self.slow_down(keep);
            } else if self.mean_speed() < rest {
                break;
            }
        }
        Ok(())
    }

    /// Compacts a loose column of cross-section `area` (m²) to a solid fraction, as in a fluidised bed: without weight, each
    /// grain is carried down in proportion to its height.
    pub fn suspend(&mut self, area: f64, fraction: f64) -> Result {
        // Contraction rate in 1/s, low enough for gentle contacts.
        let rate = 1.0;
        // Fraction of the velocity difference to the stream that a step removes.
        let drag = 0.2;
        // Fraction of the angular velocity that a step keeps.
        let rotation_kept = 0.95;
        let n = self.model.grains.len();
        let target_height = self.weight() / (GRAVITY * DENSITY * area * fraction);
        let gravity = std::mem::replace(&mut self.model.gravity, Vec3::zeros());
        // Enough for a column a thousand times too high.
        let max_steps = (7.0 / (rate * self.model.stepping.h())) as usize;
        for _ in 0..max_steps {
            if 2.0 * self.height() < target_height {
                break;
            }
            self.step()?;
            let State { position, velocity, angular_velocity, .. } = &mut self.state;
            for ((p, v), w) in position[..n].iter().zip(velocity).zip(angular_velocity) {
                *v += (Vec3::z() * (-rate * p.z) - *v) * drag;
                *w *= rotation_kept;
            }
        }
        self.model.gravity = gravity;
        self.state.velocity[..n].fill(Vec3::zeros());
        Ok(())
    }

    /// Lets grains sink at most at `speed` (m/s) in a liquid with permanent drag, until none has moved for 50 steps, at most
    /// 3 s longer than the uppermost grain needs.
    pub fn sink(&mut self, speed: f64) -> Result {
        let h = self.model.stepping.h();
        let keep = 1.0 / (1.0 + GRAVITY * h / speed);
        let n = self.model.grains.len();
        let mut quiet = 0;
        for _ in 0..((self.top() / speed + 3.0) / h) as usize {
            self.step()?;
            self.slow_down(keep);
            let fastest = self.state.velocity[..n].iter().map(|v| v.norm()).fold(0.0, f64::max);
            quiet = if fastest < 0.04 * speed { quiet + 1 } else { 0 };
            if quiet == 50 {
                break;
            }
        }
        Ok(())
    }

    /// Multiplies velocities and angular velocities of the grains by `keep`.
    fn slow_down(&mut self, keep: f64) {
        let n = self.model.grains.len();
        self.state.velocity[..n].iter_mut().for_each(|v| *v *= keep);
        self.state.angular_velocity[..n].iter_mut().for_each(|w| *w *= keep);
    }

    /// Returns the height of the uppermost grain's centre, m.
    pub fn top(&self) -> f64 {
        let n = self.model.grains.len();
        self.state.position[..n].iter().map(|p| p.z).fold(0.0, f64::max)
    }

    /// Returns the mean speed of the grains, m/s.
    pub fn mean_speed(&self) -> f64 {
        observe::mean_speed(&self.model, &self.state)
    }

    /// Returns the weight of the grains, N.
    pub fn weight(&self) -> f64 {
        GRAVITY * self.model.grains.mass.iter().sum::<f64>()
    }

    /// Returns the height of the centre of mass, m.
    pub fn height(&self) -> f64 {
        let mass = &self.model.grains.mass;
        let moment: f64 = mass.iter().zip(&self.state.position).map(|(m, p)| m * p.z).sum();
        moment / mass.iter().sum::<f64>()
    }

    /// Returns the corners of a grain, m.
    pub fn corners(&self, grain: usize) -> impl Iterator<Item = Vec3> + '_ {
        let (shape, pose) = (self.model.grains.shape[grain], self.state.pose(grain));
        self.model.shapes[shape as usize].vertices.iter().map(move |v| pose.point(v))
    }
}

/// Creates the random number generator of a check, equal in every run.
pub fn random(seed: u64) -> Pcg64 {
    Pcg64::new(u128::from(seed), 0x0a02_bdbf_7bb3_c0a7_ac28_fa16_a64a_bf96)
}

/// Adds `count` grains in random orientation as a loose column: each at the lowest of several random places, on top of the
/// bounding spheres of the grains before.
///
/// `place` returns a random place for a sphere of a radius (m); `places` is the number of tries.
pub fn stack_loosely(
    world: &mut World,
    rng: &mut Pcg64,
    shapes: &[u32],
    count: usize,
    places: usize,
    place: impl Fn(&mut Pcg64, f64) -> [f64; 2],
) {
    let radius = |s: &u32| world.model.shapes[*s as usize].radius;
    let reach = shapes.iter().map(radius).fold(0.0, f64::max);
    let stones: Vec<(u32, f64)> = shapes.iter().cycle().take(count).map(|s| (*s, reach)).collect();
    stack_spheres(world, rng, &stones, places, place);
}

/// Adds grains as [`stack_loosely`] does, each with the radius (m) of its bounding sphere.
pub fn stack_spheres(
    world: &mut World,
    rng: &mut Pcg64,
    stones: &[(u32, f64)],
    places: usize,
    place: impl Fn(&mut Pcg64, f64) -> [f64; 2],
) {
    for (k, &(shape, radius)) in stones.iter().enumerate() {
        let mut lowest = Vec3::repeat(f64::INFINITY);
        for _ in 0..places {
            let [x, y] = place(rng, radius);
            let over = |(p, other): (&Vec3, &(u32, f64))| {
                let distance = 1.01 * (radius + other.1);
                let square = distance * distance - (p.x - x).powi(2) - (p.y - y).powi(2);
                if square > 0.0 { p.z + square.sqrt() } else { 0.0 }
            };
            let below = world.state.position.iter().zip(&stones[..k]);
            let z = below.map(over).fold(1.05 * radius, f64::max);
            if z < lowest.z {
                lowest = Vec3::new(x, y, z);
            }
        }
        let orientation: Quat = random_rotation(rng);
        world.grain(shape, Pose { position: lowest, orientation });
    }
}

/// Returns a generator of random places in a box for a sphere of a radius (m).
pub fn in_box([x, y]: [f64; 2]) -> impl Fn(&mut Pcg64, f64) -> [f64; 2] {
    move |rng, reach| [x, y].map(|l| reach + (l - 2.0 * reach) * rng.random::<f64>())
}
