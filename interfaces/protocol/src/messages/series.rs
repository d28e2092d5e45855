//! A window step by step.

use super::ns;
use super::stock::{Vector3, message};
use ballast::model::Model;
use ballast::state::State;
use ballast::step::StepReport;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Most steps times bodies of a series: about 9 MB of JSON, 3 MB of CDR.
pub const MAX_SERIES_ENTRIES: u64 = 50_000;

message!(
    /// What the ballast did to a body step by step, about its reference point, world axes.
    BodySeries {
        body: String,
        /// N s, N m s.
        impulse: Vec<Vector3>,
        angular_impulse: Vec<Vector3>,
    }
);

message!(
    /// A window step by step; empty unless it was asked for.
    StepSeries {
        /// End of each step, ns.
        time_ns: Vec<i64>,
        iterations: Vec<u32>,
        residual_qm16: Vec<f64>,
        bodies: Vec<BodySeries>,
    }
);

impl StepSeries {
    /// Of a window of `model` that has no step yet.
    pub fn begin(model: &Model) -> Self {
        let body = |d: &ballast::model::DrivenBody| BodySeries {
            body: d.name.clone(),
            ..BodySeries::default()
        };
        Self { bodies: model.driven.iter().map(body).collect(), ..Self::default() }
    }

    /// Takes the step that has led to `state`.
    pub fn take(&mut self, state: &State, report: &StepReport) {
        self.time_ns.push(ns(state.time_ns));
        self.iterations.push(report.iterations);
        self.residual_qm16.push(report.residuals.qm16());
        for (body, reaction) in self.bodies.iter_mut().zip(&report.reactions) {
            body.impulse.push(reaction.impulse.into());
            body.angular_impulse.push(reaction.angular_impulse.into());
        }
    }
}
