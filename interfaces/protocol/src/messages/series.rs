//! Series of the steps of a window.

use super::ros::{Vector3, message};
use super::time::ns;
use ballast::model::Model;
use ballast::state::State;
use ballast::step::StepReport;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Maximum number of steps times bodies of a series: about 9 MB of JSON, 3 MB of CDR.
pub const MAX_SERIES_ENTRIES: u64 = 50_000;

message!(
    /// Impulses by the ballast on a body in each step, about its reference point, world axes.
    BodySeries {
        /// Name of the body.
        body: String,
        /// Impulse of each step, N s.
        impulse: Vec<Vector3>,
        /// Angular impulse of each step, N m s.
        angular_impulse: Vec<Vector3>,
    }
);

message!(
    /// Series of the steps of a window; empty unless requested.
    StepSeries {
        /// Times at the end of each step, ns.
        time_ns: Vec<i64>,
        /// Number of iterations of each step.
        iterations: Vec<u32>,
        /// Residual QM/16 of each step.
        residual_qm16: Vec<f64>,
        /// Series of each driven body.
        bodies: Vec<BodySeries>,
    }
);

impl StepSeries {
    /// Creates the series of a window of `model`, without steps.
    pub fn new(model: &Model) -> Self {
        let body = |d: &ballast::model::DrivenBody| BodySeries {
            body: d.name.clone(),
            ..BodySeries::default()
        };
        Self { bodies: model.driven.iter().map(body).collect(), ..Self::default() }
    }

    /// Appends the step that has led to `state`.
    pub fn push(&mut self, state: &State, report: &StepReport) {
        self.time_ns.push(ns(state.time_ns));
        self.iterations.push(report.iterations);
        self.residual_qm16.push(report.residuals.qm16());
        for (body, reaction) in self.bodies.iter_mut().zip(&report.reactions) {
            body.impulse.push(reaction.impulse.into());
            body.angular_impulse.push(reaction.angular_impulse.into());
        }
    }
}
