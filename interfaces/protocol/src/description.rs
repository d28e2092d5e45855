//! Description of a served component.

use crate::lockstep::Lockstep;
use crate::messages::{Point, Quaternion, SolverParameters, Twist};
use ballast::component::Component;
use ballast::model::{DofMode, Model, Schedule};
use ballast::track::TampingCycle;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Major version of the protocol.
pub const PROTOCOL_VERSION: u32 = 1;

/// Description of a component: all that a client needs before the first window.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ComponentDescription {
    /// Name of the component, `site/id`.
    pub key: String,
    /// Version of the program.
    pub version: String,
    /// Major version of the protocol.
    pub protocol_version: u32,
    /// Time step, ns; windows are whole numbers of steps.
    pub step_ns: u64,
    /// Number of grains.
    pub grains: usize,
    /// Hash of model and state at the start of the run, to which `reset` returns, hexadecimal: names the case and its bed.
    #[serde(default)]
    pub start_hash: String,
    /// Driven bodies.
    pub bodies: Vec<BodyDescription>,
    /// Tines of the tamping cycle of the case; empty without one.
    #[serde(default)]
    pub tines: Vec<TineDescription>,
    /// Maximum jump of a motion between two windows.
    pub continuity: ContinuityTolerance,
    /// Statement on reproducibility.
    pub determinism: String,
    /// Units of all quantities.
    pub units: String,
    /// Coordinate frame and order of quaternion components.
    pub frame: String,
    /// Sign, frame and reference point of wrenches.
    pub wrench_convention: String,
    /// Endpoints for viewers.
    #[serde(default)]
    pub viewer_endpoints: Vec<String>,
    /// Current parameters, in the units of `param`; a tolerance or penetration limit (m) of 0 means none.
    pub parameters: BTreeMap<String, serde_json::Value>,
}

/// Maximum jump of a motion between the end of a window and the start of the next.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ContinuityTolerance {
    /// Jump of the position, m.
    pub distance_m: f64,
    /// Jump of the orientation, rad.
    pub angle_rad: f64,
    /// Jump of the velocity, m/s.
    #[serde(rename = "speed_m_per_s")]
    pub speed: f64,
    /// Jump of the angular velocity, rad/s.
    #[serde(rename = "angular_velocity_rad_per_s")]
    pub angular_velocity: f64,
}

/// Description of a driven body.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct BodyDescription {
    /// Name of the body.
    pub name: String,
    /// Role of the body: `tine`, `sleeper`, `plate` or `boundary`.
    pub role: String,
    /// Modes of x, y, z and of the rotations about them: `prescribed`, `free` or `spring`.
    pub dof_modes: [String; 6],
    /// Stiffness of the springs, in the same order: N/m, of rotations N m/rad; elsewhere 0.
    pub stiffness: [f64; 6],
    /// Damping of the springs, in the same order: N s/m, of rotations N m s/rad; elsewhere 0.
    pub damping: [f64; 6],
    /// Mass that moves with the body, kg; `None` if all of its motion is prescribed.
    pub mass_kg: Option<f64>,
    /// Position of the reference point after the last window, m; for a body on springs, of its mount.
    pub position: Point,
    /// Orientation after the last window, body to world; for a body on springs, of its mount.
    pub orientation: Quaternion,
    /// Velocity (m/s) and angular velocity (rad/s) that the next cubic motion must start with.
    ///
    /// Zero for a body at rest; `None`, for any, after a held or linear motion.
    #[serde(default)]
    pub twist: Option<Twist>,
}

/// Path of a tine in the tamping cycle of a case.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct TineDescription {
    /// Name of the body.
    pub body: String,
    /// Number of its pair in the case.
    pub pair: u32,
    /// Direction in which it closes along x: 1 or -1.
    pub direction: f64,
    /// Position of the reference point before the cycle, m.
    pub start: Point,
    /// Height of the reference point at full depth, m.
    #[serde(rename = "full_depth_z_m")]
    pub full_depth_z: f64,
    /// Closing in the squeeze, m.
    #[serde(rename = "stroke_m")]
    pub stroke: f64,
}

impl TineDescription {
    /// Returns the tines of a cycle.
    pub fn of(cycle: &TampingCycle, model: &Model) -> Vec<Self> {
        let tines = cycle.tines().iter().map(|path| Self {
            body: model.driven[path.body].name.clone(),
            pair: cycle.pairs()[path.pair].number,
            direction: path.direction,
            start: path.start.into(),
            full_depth_z: path.deep,
            stroke: path.stroke,
        });
        tines.collect()
    }
}

impl ComponentDescription {
    /// Describes the component `site/id` in its current state.
    pub fn of(key: &str, lockstep: &Lockstep) -> Self {
        let component = lockstep.component();
        let model = component.model();
        let limits = component.limits();
        let body = |body: &ballast::model::DrivenBody| {
            let dof_modes = body.mount.map_or([DofMode::Prescribed; 6], |m| m.dof_modes);
            BodyDescription {
                name: body.name.clone(),
                role: body.role.name().into(),
                dof_modes: dof_modes.map(|f| f.name().into()),
                stiffness: dof_modes.map(|f| f.spring()[0]),
                damping: dof_modes.map(|f| f.spring()[1]),
                mass_kg: body.mount.map(|m| m.mass),
                position: Point::default(),
                orientation: Quaternion::default(),
                twist: None,
            }
        };
        let mut this = Self {
            key: key.into(),
            version: env!("CARGO_PKG_VERSION").into(),
            protocol_version: PROTOCOL_VERSION,
            step_ns: model.stepping.step_ns,
            grains: model.grains.len(),
            start_hash: lockstep.start_hash().to_string(),
            bodies: model.driven.iter().map(body).collect(),
            tines: Vec::new(),
            continuity: ContinuityTolerance {
                distance_m: limits.join_distance,
                angle_rad: limits.join_angle,
                speed: limits.join_speed,
                angular_velocity: limits.join_angular_velocity,
            },
            determinism: determinism(model).into(),
            units: "SI: m, s, kg, N, N s, rad".into(),
            frame: "world, right-handed, z up; quaternions x, y, z, w, body to world".into(),
            wrench_convention:
                "by the ballast on the body, world axes, about the body's reference point".into(),
            viewer_endpoints: Vec::new(),
            parameters: parameters(component),
        };
        this.update(lockstep);
        this
    }

    /// Updates poses and velocities of the bodies.
    pub fn update(&mut self, lockstep: &Lockstep) {
        let component = lockstep.component();
        let (model, state) = (component.model(), component.state());
        for (d, body) in self.bodies.iter_mut().enumerate() {
            let pose = state.imposed(model, d);
            (body.position, body.orientation) = (pose.position.into(), pose.orientation.into());
            body.twist = component.twist(d).map(Into::into);
        }
    }
}

/// Returns the parameters of the solver by name.
fn parameters(component: &Component) -> BTreeMap<String, serde_json::Value> {
    let model = component.model();
    // In the units of `param`: 0 means none.
    let SolverParameters { max_iterations, tolerance, max_penetration } =
        component.parameters().into();
    [
        ("step_ns", serde_json::json!(model.stepping.step_ns)),
        ("max_iterations", serde_json::json!(max_iterations)),
        ("tolerance", serde_json::json!(tolerance)),
        ("schedule", serde_json::json!(model.solver.schedule.name())),
        ("max_penetration", serde_json::json!(max_penetration)),
    ]
    .map(|(name, value)| (name.to_string(), value))
    .into()
}

fn determinism(model: &Model) -> &'static str {
    match model.solver.schedule {
        Schedule::Sequential | Schedule::Synchronous => {
            "same program, same case: the same bytes for any number of threads and any cutting into windows"
        }
        Schedule::Asynchronous => {
            "the same physics within the solver's tolerance; state hashes are not comparable"
        }
    }
}
