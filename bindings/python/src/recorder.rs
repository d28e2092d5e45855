//! The recording of a simulation: windows that stand.

use crate::case::{Case, name_of};
use crate::errors;
use ballast::component::{Component, Input, LoadInput, Outcome, Status};
use ballast::model::Model;
use ballast::state::State;
use ballast_mcap::{Drive, Meta, Tape};
use ballast_protocol::messages::{AdvanceReply, AdvanceRequest};
use pyo3::prelude::*;
use std::path::PathBuf;

/// An open recording. The last window waits until the next one begins: it may be redone until then.
pub struct Recorder {
    tape: Tape,
    last: Option<(AdvanceRequest, Outcome)>,
}

impl Recorder {
    pub fn create(
        py: Python<'_>,
        path: PathBuf,
        case: &Case,
        component: &Component,
    ) -> PyResult<Self> {
        let (model, state) = (component.model(), component.state());
        let meta = Meta {
            program: concat!("ballast ", env!("CARGO_PKG_VERSION")).into(),
            case_name: case.plan.name.clone(),
            case_key: ballast_scenario::content_key(&case.plan),
            step_ns: model.stepping.step_ns,
            schedule: name_of(model.solver.schedule).into(),
            drive: Drive::Inputs,
            choices: case.notes(),
            initial_hash: ballast_hdf5::state_hash(model, state).into(),
        };
        let tape = Tape::create(&path, &meta, model, state).map_err(|e| errors::file(py, e))?;
        Ok(Self { tape, last: None })
    }

    /// Keeps a window that may still be redone; one that nothing came of is forgotten.
    pub fn keep(&mut self, motions: &[Input], loads: &[LoadInput], outcome: &Outcome) {
        self.last = None;
        if outcome.status == Status::Discard {
            return;
        }
        let motions = motions.iter().map(Into::into).collect();
        let mut request = self.tape.request(outcome.t0_ns, outcome.t1_ns, motions);
        request.loads = loads.iter().map(Into::into).collect();
        self.last = Some((request, outcome.clone()));
    }

    /// Writes the last window, which has led to `state`.
    pub fn commit(&mut self, py: Python<'_>, model: &Model, state: &State) -> PyResult<()> {
        let Some((request, outcome)) = self.last.take() else { return Ok(()) };
        let hash = ballast_hdf5::state_hash(model, state).into();
        let reply = AdvanceReply::of(&request, model, &outcome, hash);
        self.tape.window(model, state, &request, &reply).map_err(|e| errors::file(py, e))
    }

    pub fn finish(self, py: Python<'_>) -> PyResult<()> {
        self.tape.finish().map_err(|e| errors::file(py, e))
    }
}
