//! What a component says of itself.

use ballast::model::{Freedom, Model, Role, Schedule};
use ballast_protocol::lockstep::Lockstep;
use ballast_protocol::messages::{Point, Quaternion};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Everything a partner has to know before the first window.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Description {
    /// `site/id`.
    pub key: String,
    /// Of the program.
    pub version: String,
    /// Major version of the messages.
    pub wire: u32,
    /// Windows are whole numbers of these, ns.
    pub step_ns: u64,
    pub grains: usize,
    pub bodies: Vec<Body>,
    /// What the same inputs give.
    pub determinism: String,
    pub units: String,
    pub frame: String,
    pub wrench: String,
    /// What the case has set.
    pub parameters: BTreeMap<String, serde_json::Value>,
}

/// A driven body.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Body {
    pub name: String,
    /// `tine`, `sleeper`, `boundary`.
    pub role: String,
    /// Of x, y, z, and of the rotations about them: `held` (its motion is imposed), `loaded`, `sprung`.
    pub freedoms: [String; 6],
    /// Where the reference point was, m, and how the body was turned, when a client last attached: what its
    /// motion goes on from. Of a body on springs that is where its mount was.
    pub position: Point,
    pub orientation: Quaternion,
}

impl Description {
    /// Of the component `site/id` as it is now.
    pub fn of(key: &str, lockstep: &Lockstep) -> Self {
        let component = lockstep.component();
        let (model, state) = (component.model(), component.state());
        let body = |(d, body): (usize, &ballast::model::DrivenBody)| {
            let pose = state.imposed(model, d);
            Body {
                name: body.name.clone(),
                role: role(body.role).into(),
                freedoms: std::array::from_fn(|k| {
                    body.mount.map_or("held", |m| mode(m.freedoms[k])).into()
                }),
                position: pose.position.into(),
                orientation: pose.orientation.into(),
            }
        };
        Self {
            key: key.into(),
            version: env!("CARGO_PKG_VERSION").into(),
            wire: crate::keys::VERSION,
            step_ns: model.stepping.step_ns,
            grains: model.grains.len(),
            bodies: model.driven.iter().enumerate().map(body).collect(),
            determinism: determinism(model).into(),
            units: "SI: m, s, kg, N, N s, rad".into(),
            frame: "world, right-handed, z up; quaternions x, y, z, w, body to world".into(),
            wrench: "by the ballast on the body, world axes, about the body's reference point"
                .into(),
            parameters: parameters(model),
        }
    }
}

/// What decides how a window is computed.
fn parameters(model: &Model) -> BTreeMap<String, serde_json::Value> {
    let solver = &model.solver;
    let schedule = format!("{:?}", solver.schedule).to_lowercase();
    [
        ("step_ns", serde_json::json!(model.stepping.step_ns)),
        ("iterations", serde_json::json!(solver.iterations)),
        ("tolerance", serde_json::json!(solver.tolerance)),
        ("schedule", serde_json::json!(schedule)),
    ]
    .map(|(name, value)| (name.to_string(), value))
    .into()
}

fn role(role: Role) -> &'static str {
    match role {
        Role::Boundary => "boundary",
        Role::Sleeper => "sleeper",
        Role::Tine => "tine",
    }
}

fn mode(freedom: Freedom) -> &'static str {
    match freedom {
        Freedom::Held => "held",
        Freedom::Loaded => "loaded",
        Freedom::Sprung { .. } => "sprung",
    }
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
