//! What a component says of itself.

use crate::lockstep::Lockstep;
use crate::messages::{Point, Quaternion, SolverParameters, Twist};
use ballast::component::Component;
use ballast::model::{DofMode, Model, Schedule};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Major version of the messages.
pub const PROTOCOL_VERSION: u32 = 1;

/// Everything a partner has to know before the first window.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ComponentDescription {
    /// `site/id`.
    pub key: String,
    /// Of the program.
    pub version: String,
    /// Major version of the messages.
    pub protocol_version: u32,
    /// Windows are whole numbers of these, ns.
    pub step_ns: u64,
    pub grains: usize,
    pub bodies: Vec<BodyDescription>,
    /// How closely a window has to join the one before it.
    pub continuity: ContinuityTolerance,
    /// What the same inputs give.
    pub determinism: String,
    pub units: String,
    pub frame: String,
    pub wrench_convention: String,
    /// Where pictures are sent from, endpoints.
    #[serde(default)]
    pub viewer_endpoints: Vec<String>,
    /// What is set now; 0: no tolerance, no limit of the penetration (m), as `param` takes them.
    pub parameters: BTreeMap<String, serde_json::Value>,
}

/// How far apart two windows may be where they join.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ContinuityTolerance {
    pub distance_m: f64,
    pub angle_rad: f64,
    #[serde(rename = "speed_m_per_s")]
    pub speed: f64,
    #[serde(rename = "spin_rad_per_s")]
    pub angular_velocity: f64,
}

/// A driven body.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct BodyDescription {
    pub name: String,
    /// `tine`, `sleeper`, `boundary`.
    pub role: String,
    /// Modes of x, y, z and of the rotations about them: `prescribed`, `free` or `spring`.
    pub dof_modes: [String; 6],
    /// Stiffness of the springs, in the same order: N/m, N s/m, of rotations N m/rad, N m s/rad; elsewhere 0.
    pub stiffness: [f64; 6],
    pub damping: [f64; 6],
    /// That moves with it, kg; none of a body whose motion is imposed.
    pub mass_kg: Option<f64>,
    /// Where the reference point is, m, and how the body is turned, after the last window: what its motion goes on
    /// from. Of a body on springs that is where its mount is.
    pub position: Point,
    pub orientation: Quaternion,
    /// Velocity (m/s) and spin (rad/s) with which its next cubic motion begins: as the last one ended, or zero where it
    /// had no motion. Null, any, after a held or linear one.
    #[serde(default)]
    pub twist: Option<Twist>,
}

impl ComponentDescription {
    /// Of the component `site/id` as it is now.
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
            bodies: model.driven.iter().map(body).collect(),
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
        this.follow(lockstep);
        this
    }

    /// Puts the bodies where they are now, and as they move.
    pub fn follow(&mut self, lockstep: &Lockstep) {
        let component = lockstep.component();
        let (model, state) = (component.model(), component.state());
        for (d, body) in self.bodies.iter_mut().enumerate() {
            let pose = state.imposed(model, d);
            (body.position, body.orientation) = (pose.position.into(), pose.orientation.into());
            body.twist = component.twist(d).map(Into::into);
        }
    }
}

/// What decides how a window is computed.
fn parameters(component: &Component) -> BTreeMap<String, serde_json::Value> {
    let model = component.model();
    // As they are set: 0 is none.
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
