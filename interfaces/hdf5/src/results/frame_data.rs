//! Data of a frame, collected from model, state and workspace on the simulating thread.
//!
//! Reads: model, state, workspace. Writes: nothing. Cost: O(bodies + contacts), no vertices yet.

use ballast::math::{Pose, Vec3};
use ballast::model::Model;
use ballast::state::State;
use ballast::workspace::Workspace;

/// Data of one frame, before its vertices are computed.
#[derive(Debug, Clone)]
pub struct FrameData {
    pub(crate) step: u64,
    pub(crate) time: f64,
    /// Poses of the bodies `[nb]`.
    pub(crate) poses: Vec<Pose>,
    /// Speed of the body frame's origin `[nb]`, m/s.
    pub(crate) speed: Vec<f32>,
    /// Sum of the contact forces' magnitudes on each body `[nb]`, N.
    pub(crate) load: Vec<f32>,
    pub(crate) contacts: ContactCloud,
}

/// Active contacts `[na]`.
#[derive(Debug, Clone, Default)]
pub(crate) struct ContactCloud {
    pub point: Vec<[f32; 3]>,
    /// Force on the candidate, mean over the step, N.
    pub force: Vec<[f32; 3]>,
    /// Component of the force along the normal, N.
    pub normal_force: Vec<f32>,
    /// Unit normal from antagonist to candidate.
    pub normal: Vec<[f32; 3]>,
    /// Gap, m; negative for penetration.
    pub gap: Vec<f32>,
    pub candidate: Vec<i32>,
    pub antagonist: Vec<i32>,
}

impl FrameData {
    /// Collects the data of a frame after a step; contacts are those of `workspace`, none before the first step.
    pub fn take(model: &Model, state: &State, workspace: &Workspace) -> Self {
        let nb = model.body_count().min(state.position.len());
        let mut load = vec![0.0; nb];
        let contacts = forces(model, workspace, &mut load);
        Self {
            step: state.step,
            time: state.time(),
            poses: (0..nb).map(|b| state.pose(b)).collect(),
            speed: state.velocity.iter().map(|v| v.norm() as f32).collect(),
            load: load.into_iter().map(|f| f as f32).collect(),
            contacts,
        }
    }
}

fn forces(model: &Model, workspace: &Workspace, load: &mut [f64]) -> ContactCloud {
    let mut cloud = ContactCloud::default();
    let contacts = &workspace.contacts;
    let per_second = 1.0 / model.stepping.h();
    for (k, impulse) in workspace.impulse.iter().enumerate().take(contacts.len()) {
        if impulse.norm_squared() == 0.0 {
            continue;
        }
        let force = impulse * per_second;
        let [candidate, antagonist] = contacts.bodies[k];
        for body in [candidate, antagonist] {
            load[body as usize] += force.norm();
        }
        cloud.point.push(single(&contacts.point[k]));
        cloud.force.push(single(&force));
        cloud.normal_force.push(force.dot(&contacts.normal[k]) as f32);
        cloud.normal.push(single(&contacts.normal[k]));
        cloud.gap.push(contacts.gap[k] as f32);
        cloud.candidate.push(candidate as i32);
        cloud.antagonist.push(antagonist as i32);
    }
    cloud
}

pub(crate) fn single(v: &Vec3) -> [f32; 3] {
    [v.x as f32, v.y as f32, v.z as f32]
}
