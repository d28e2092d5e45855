//! Scenes built by hand, and stepped.

use super::heed_interrupts;
use ballast::drive::StepInputs;
use ballast::geometry::{Polyhedron, random_rotation};
use ballast::math::{Pose, Quat, Vec3};
use ballast::model::{
    DrivenBody, Grains, Model, Norm, Part, PartitionRule, Role, Schedule, Solver, Stepping,
};
use ballast::observe;
use ballast::state::State;
use ballast::step::{StepReport, step};
use ballast::workspace::Workspace;
use ballast_session::Outcome;
use rand::RngExt;
use rand_pcg::Pcg64;

pub const GRAVITY: f64 = 9.81;
const DENSITY: f64 = 2700.0;
/// Nominal diameter of grains, m.
pub const D: f64 = 0.04;
/// Speed that grains reach while they settle, m/s.
pub const FALL: f64 = 0.8;

/// A model that is stepped, and where its driven bodies are told to be.
pub struct World {
    pub model: Model,
    pub state: State,
    pub workspace: Workspace,
    pub targets: Vec<Pose>,
}

impl World {
    /// An empty world under gravity; θ = 1/2, no restitution, solved far below what checks look at.
    pub fn new(step_ns: u64, friction: f64, alert: f64) -> Self {
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
            restitution: 0.0,
            stepping: Stepping { step_ns, theta: 0.5, detection_distance: alert },
            solver,
        };
        Self { model, state: State::default(), workspace: Workspace::default(), targets: vec![] }
    }

    /// As loosely solved as beds are while they are poured, on all cores.
    pub fn pouring(mut self, iterations: u32) -> Self {
        self.model.solver = Solver {
            max_iterations: iterations,
            tolerance: Some(1e-3),
            partition: PartitionRule::ContactsPer(1000),
            ..Solver::default()
        };
        self
    }

    pub fn shape(&mut self, polyhedron: Polyhedron) -> u32 {
        self.model.shapes.push(polyhedron);
        self.model.shapes.len() as u32 - 1
    }

    /// Adds a grain at rest; grains come before driven bodies.
    pub fn grain(&mut self, shape: u32, pose: Pose) {
        self.model.grains.push(shape, &self.model.shapes[shape as usize], DENSITY);
        self.state.push(pose);
    }

    /// Adds a half-space through `at`, solid behind its normal; its number among the driven bodies.
    pub fn wall(&mut self, name: &str, at: Vec3, normal: Vec3, friction: f64) -> usize {
        let normal = normal.normalize();
        self.model.driven.push(DrivenBody {
            name: name.into(),
            role: Role::Boundary,
            friction,
            parts: vec![Part::HalfSpace { normal, offset: 0.0 }],
            mount: None,
        });
        self.state.push(Pose::at(at));
        self.targets.push(Pose::at(at));
        self.targets.len() - 1
    }

    /// Floor and four walls of a box whose corner is the origin.
    pub fn container(&mut self, [x, y]: [f64; 2], floor: f64, walls: f64) {
        self.wall("floor", Vec3::zeros(), Vec3::z(), floor);
        self.wall("west", Vec3::zeros(), Vec3::x(), walls);
        self.wall("east", Vec3::x() * x, -Vec3::x(), walls);
        self.wall("south", Vec3::zeros(), Vec3::y(), walls);
        self.wall("north", Vec3::y() * y, -Vec3::y(), walls);
    }

    /// Removes all driven bodies and what was remembered of contacts with them.
    pub fn without_walls(&mut self) {
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

    pub fn step(&mut self) -> Outcome<StepReport> {
        heed_interrupts()?;
        let inputs = StepInputs::from_targets(&self.targets);
        Ok(step(&self.model, &mut self.state, &inputs, &mut self.workspace, &mut ())?)
    }

    /// Steps for `seconds`.
    pub fn run(&mut self, seconds: f64) -> Outcome {
        for _ in 0..(seconds / self.model.stepping.h()).round() as usize {
            self.step()?;
        }
        Ok(())
    }

    /// Lets grains fall no faster than `speed` (m/s), as through a fluid, until the uppermost has had the time to
    /// come down, then freely until their mean speed is below `rest`, at most 1.5 s.
    pub fn settle(&mut self, speed: f64, rest: f64) -> Outcome {
        let h = self.model.stepping.h();
        let keep = 1.0 - GRAVITY * h / speed;
        let falling = (0.8 * self.top() / speed / h) as usize;
        let most = falling + (1.5 / h) as usize;
        for k in 0..most {
            self.step()?;
            if k < falling {
                self.slow_down(keep);
            } else if self.mean_speed() < rest {
                break;
            }
        }
        Ok(())
    }

    /// Brings grains that hang together until they take the share `fraction` of the column over `area` (m²), as they
    /// float in a fluidised bed: without weight, carried down each in proportion to its height.
    pub fn suspend(&mut self, area: f64, fraction: f64) -> Outcome {
        // Slow enough (1/s) that neighbours touch gently, and how fast grains take on the stream and lose their spin.
        let (rate, takes_on, spins_on) = (1.0, 0.2, 0.95);
        let n = self.model.grains.len();
        let aim = self.weight() / (GRAVITY * DENSITY * area * fraction);
        let gravity = std::mem::replace(&mut self.model.gravity, Vec3::zeros());
        // A column a thousand times too high would have come together by then.
        let most = (7.0 / (rate * self.model.stepping.h())) as usize;
        for _ in 0..most {
            if 2.0 * self.height() < aim {
                break;
            }
            self.step()?;
            let State { position, velocity, angular_velocity, .. } = &mut self.state;
            for ((p, v), w) in position[..n].iter().zip(velocity).zip(angular_velocity) {
                *v += (Vec3::z() * (-rate * p.z) - *v) * takes_on;
                *w *= spins_on;
            }
        }
        self.model.gravity = gravity;
        self.state.velocity[..n].fill(Vec3::zeros());
        Ok(())
    }

    /// Lets grains sink no faster than `speed` (m/s) through a liquid whose drag stays, until none of them has moved
    /// for 50 steps, at most 3 s after the uppermost has had the time to come down.
    pub fn sink(&mut self, speed: f64) -> Outcome {
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

    /// Leaves grains the share `keep` of their velocity and spin.
    fn slow_down(&mut self, keep: f64) {
        let n = self.model.grains.len();
        self.state.velocity[..n].iter_mut().for_each(|v| *v *= keep);
        self.state.angular_velocity[..n].iter_mut().for_each(|w| *w *= keep);
    }

    /// Height of the uppermost grain's centre, m.
    pub fn top(&self) -> f64 {
        let n = self.model.grains.len();
        self.state.position[..n].iter().map(|p| p.z).fold(0.0, f64::max)
    }

    pub fn mean_speed(&self) -> f64 {
        observe::mean_speed(&self.model, &self.state)
    }

    pub fn weight(&self) -> f64 {
        GRAVITY * self.model.grains.mass.iter().sum::<f64>()
    }

    /// Height of the centre of mass, m.
    pub fn height(&self) -> f64 {
        let mass = &self.model.grains.mass;
        let moment: f64 = mass.iter().zip(&self.state.position).map(|(m, p)| m * p.z).sum();
        moment / mass.iter().sum::<f64>()
    }

    /// Corners of a grain, m.
    pub fn corners(&self, grain: usize) -> impl Iterator<Item = Vec3> + '_ {
        let (shape, pose) = (self.model.grains.shape[grain], self.state.pose(grain));
        self.model.shapes[shape as usize].vertices.iter().map(move |v| pose.point(v))
    }
}

/// Random numbers of a check: the same in every run.
pub fn random(seed: u64) -> Pcg64 {
    Pcg64::new(u128::from(seed), 0x0a02_bdbf_7bb3_c0a7_ac28_fa16_a64a_bf96)
}

/// Hangs `count` grains of the shapes, turned at random, each as low as the spheres around those before let it, at the
/// lowest of so many `places` that `place` finds for spheres of a radius (m).
pub fn hang(
    world: &mut World,
    rng: &mut Pcg64,
    shapes: &[u32],
    count: usize,
    places: usize,
    place: impl Fn(&mut Pcg64, f64) -> [f64; 2],
) {
    let radius = |s: &u32| world.model.shapes[*s as usize].radius;
    let reach = shapes.iter().map(radius).fold(0.0, f64::max);
    let apart = 2.02 * reach;
    for k in 0..count {
        let mut lowest = Vec3::repeat(f64::INFINITY);
        for _ in 0..places {
            let [x, y] = place(rng, reach);
            let over = |p: &Vec3| {
                let square = apart * apart - (p.x - x).powi(2) - (p.y - y).powi(2);
                if square > 0.0 { p.z + square.sqrt() } else { 0.0 }
            };
            let z = world.state.position.iter().map(over).fold(1.05 * reach, f64::max);
            if z < lowest.z {
                lowest = Vec3::new(x, y, z);
            }
        }
        let orientation: Quat = random_rotation(rng);
        world.grain(shapes[k % shapes.len()], Pose { position: lowest, orientation });
    }
}

/// Any place in a box for a sphere of a radius (m).
pub fn in_box([x, y]: [f64; 2]) -> impl Fn(&mut Pcg64, f64) -> [f64; 2] {
    move |rng, reach| [x, y].map(|l| reach + (l - 2.0 * reach) * rng.random::<f64>())
}
