//! Small scenes built by hand: grains, half-spaces, moved bodies, and a tight solver.

use ballast::drive::{Load, StepInputs};
use ballast::error::Result;
use ballast::geometry::Polyhedron;
use ballast::math::{Pose, Quat, Vec3};
use ballast::model::{
    ContactStiffness, DrivenBody, Grains, Model, Mount, Part, PartitionRule, Role, Schedule,
    Solver, Stepping,
};
use ballast::state::State;
use ballast::step::{StepReport, step};
use ballast::workspace::Workspace;

pub const GRAVITY: f64 = 9.81;
pub const DENSITY: f64 = 2700.0;
pub const SCHEDULES: [Schedule; 3] = Schedule::ALL;

/// Model with its state and the targets of its driven bodies.
pub struct Scene {
    pub model: Model,
    pub state: State,
    pub workspace: Workspace,
    pub targets: Vec<Pose>,
    /// Loads on the mounted bodies; none if empty.
    pub loads: Vec<Load>,
}

impl Scene {
    /// An empty world under gravity with this time step, θ = 1/2, no restitution.
    pub fn new(step_ns: u64, friction: f64) -> Self {
        let model = Model {
            shapes: vec![],
            grains: Grains::default(),
            driven: vec![],
            gravity: Vec3::new(0.0, 0.0, -GRAVITY),
            grain_friction: friction,
            grain_stiffness: ContactStiffness::RIGID,
            restitution: 0.0,
            stepping: Stepping { step_ns, theta: 0.5, detection_distance: 2e-3 },
            solver: tight(Schedule::Sequential, PartitionRule::Balanced(1)),
        };
        Self {
            model,
            state: State::default(),
            workspace: Workspace::default(),
            targets: vec![],
            loads: vec![],
        }
    }

    /// Solves with `schedule` on boxes `[nx, ny, nz]`.
    pub fn scheduled(mut self, schedule: Schedule, boxes: [u32; 3]) -> Self {
        self.model.solver = tight(schedule, PartitionRule::Boxes(boxes));
        self
    }

    pub fn shape(&mut self, polyhedron: Polyhedron) -> u32 {
        self.model.shapes.push(polyhedron);
        self.model.shapes.len() as u32 - 1
    }

    /// Adds a grain at rest; grains come before driven bodies.
    pub fn grain(&mut self, shape: u32, pose: Pose) -> usize {
        assert!(self.model.driven.is_empty(), "grains are numbered first");
        self.model.grains.push(shape, &self.model.shapes[shape as usize], DENSITY);
        self.state.push(pose);
        self.model.grains.len() - 1
    }

    /// Adds a half-space through `pose`, solid below its z, and returns its number among the driven.
    pub fn plane(&mut self, name: &str, pose: Pose, friction: f64) -> usize {
        let part = Part::HalfSpace { normal: Vec3::z(), offset: 0.0 };
        self.driven(name, part, pose, friction)
    }

    pub fn driven(&mut self, name: &str, part: Part, pose: Pose, friction: f64) -> usize {
        self.model.driven.push(DrivenBody {
            name: name.into(),
            role: Role::Boundary,
            friction,
            stiffness: ContactStiffness::RIGID,
            parts: vec![part],
            mount: None,
        });
        self.state.push(pose);
        self.targets.push(pose);
        self.targets.len() - 1
    }

    /// Gives the body that was added last, before any that is not mounted, a mount.
    pub fn mount(&mut self, mount: Mount) {
        let body = self.model.driven.last_mut().expect("a driven body");
        body.mount = Some(mount);
        self.state.mount.extend(self.targets.last());
    }

    /// An open box on the floor z = 0 with inner size `size`, its corner at the origin.
    pub fn container(&mut self, size: f64, friction: f64) {
        let facing =
            |normal: Vec3| Quat::rotation_between(&Vec3::z(), &normal).expect("no half turn");
        let at = |x: f64, y: f64, normal: Vec3| Pose {
            position: Vec3::new(x, y, 0.0),
            orientation: facing(normal),
        };
        self.plane("floor", at(0.0, 0.0, Vec3::z()), friction);
        self.plane("west", at(0.0, 0.0, Vec3::x()), friction);
        self.plane("east", at(size, 0.0, -Vec3::x()), friction);
        self.plane("south", at(0.0, 0.0, Vec3::y()), friction);
        self.plane("north", at(0.0, size, -Vec3::y()), friction);
    }

    /// One step that must be accepted.
    pub fn step(&mut self) -> StepReport {
        self.try_step().expect("a good step")
    }

    pub fn try_step(&mut self) -> Result<StepReport> {
        let inputs = StepInputs { loads: &self.loads, ..StepInputs::from_targets(&self.targets) };
        step(&self.model, &mut self.state, &inputs, &mut self.workspace, &mut ())
    }

    /// Steps until `seconds` more have passed; the last report.
    pub fn run(&mut self, seconds: f64) -> StepReport {
        let steps = (seconds / self.model.stepping.h()).round() as usize;
        let mut last = StepReport::default();
        for _ in 0..steps {
            last = self.step();
        }
        last
    }

    pub fn h(&self) -> f64 {
        self.model.stepping.h()
    }

    /// Largest speed of a grain, spin times radius included, m/s.
    pub fn fastest(&self) -> f64 {
        (0..self.model.grains.len())
            .map(|i| {
                let radius = self.model.shapes[self.model.grains.shape[i] as usize].radius;
                self.state.velocity[i].norm() + radius * self.state.angular_velocity[i].norm()
            })
            .fold(0.0, f64::max)
    }
}

/// Converged far below what the checks look at.
pub fn tight(schedule: Schedule, partition: PartitionRule) -> Solver {
    Solver { schedule, partition, max_iterations: 2000, tolerance: Some(1e-8), ..Solver::default() }
}

/// A plane turned by `angle` about y: downhill is +x.
pub fn slope(angle: f64) -> Pose {
    Pose { position: Vec3::zeros(), orientation: Quat::from_axis_angle(&Vec3::y_axis(), angle) }
}

/// Numbers between 0 and 1 from a linear congruential generator: the same on every machine.
pub struct Random(pub u64);

impl Random {
    pub fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }

    pub fn direction(&mut self) -> Vec3 {
        loop {
            let v = Vec3::from_fn(|_, _| 2.0 * self.next() - 1.0);
            if (0.01..=1.0).contains(&v.norm_squared()) {
                return v.normalize();
            }
        }
    }

    pub fn orientation(&mut self) -> Quat {
        let angle = 6.0 * self.next();
        Quat::from_scaled_axis(self.direction() * angle)
    }
}
