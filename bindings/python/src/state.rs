//! A state that was saved: looked at without a copy, restored, written to a file.

use crate::arrays::{self, Matrix, Vector};
use crate::case::Case;
use crate::errors;
use crate::machine::Machine;
use ballast::model::Model;
use ballast::state;
use ballast_hdf5::checkpoint::{self, Checkpoint, Kind};
use pyo3::prelude::*;
use std::path::PathBuf;
use std::sync::Arc;

/// Everything that the next window depends on.
#[pyclass(frozen, module = "ballast")]
pub struct State {
    pub model: Arc<Model>,
    pub state: Arc<state::State>,
    pub case: Arc<Case>,
    pub machine: Machine,
}

/// The note of a checkpoint that holds what the machine remembers: numbers as text that reads back to the
/// same bits.
const MACHINE: &str = "machine";

impl State {
    fn grains(&self) -> usize {
        self.model.grains.len()
    }
}

#[pymethods]
impl State {
    /// Reads what `write` has written, or a checkpoint of `ballast run`.
    #[staticmethod]
    fn read(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        let kept = py.detach(|| checkpoint::read(&path)).map_err(|e| errors::file(py, e))?;
        let name = path.display().to_string();
        let case = Case::restored(py, kept.case_text, &name, &kept.extra)?;
        let machine = match kept.extra.get(MACHINE) {
            None => Machine::new(&case.plan, &kept.model).map(|machine| {
                // `ballast run` keeps the memory in the state; what others keep there is none of the machine's.
                machine.clone().with_memory(kept.state.drive.clone()).unwrap_or(machine)
            }),
            Some(text) => {
                let memory = serde_json::from_str(text)
                    .map_err(|e| errors::file(py, format!("{name}: note {MACHINE:?}: {e}")))?;
                Machine::new(&case.plan, &kept.model).and_then(|m| m.with_memory(memory))
            }
        };
        let machine = machine.map_err(|e| errors::file(py, format!("{name}: {e}")))?;
        let (model, state) = (Arc::new(kept.model), Arc::new(kept.state));
        Ok(Self { model, state, case: Arc::new(case), machine })
    }

    /// Writes the state to a file from which it goes on to the same bytes, also in another process.
    fn write(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        let mut notes = self.case.choices.notes();
        let memory = serde_json::to_string(self.machine.memory())
            .map_err(|e| errors::file(py, format!("{}: {e}", path.display())))?;
        notes.insert(MACHINE.into(), memory);
        let kept = Checkpoint {
            model: Model::clone(&self.model),
            state: state::State::clone(&self.state),
            kind: Kind::Run,
            case_name: self.case.plan.name.clone(),
            case_text: self.case.text.clone(),
            key: ballast_scenario::content_key(&self.case.plan),
            extra: notes,
        };
        py.detach(|| checkpoint::write(path, &kept)).map_err(|e| errors::file(py, e))
    }

    #[getter]
    fn time_ns(&self) -> u64 {
        self.state.time_ns
    }

    #[getter]
    fn step(&self) -> u64 {
        self.state.step
    }

    #[getter]
    fn hash(&self, py: Python<'_>) -> String {
        py.detach(|| format!("{:032x}", ballast_hdf5::state_hash(&self.model, &self.state)))
    }

    #[getter]
    fn positions<'py>(&self, py: Python<'py>) -> PyResult<Matrix<'py>> {
        arrays::rows(py, &self.state, |s| &s.position[..self.grains()])
    }

    #[getter]
    fn orientations<'py>(&self, py: Python<'py>) -> PyResult<Matrix<'py>> {
        arrays::rows(py, &self.state, |s| &s.orientation[..self.grains()])
    }

    #[getter]
    fn velocities<'py>(&self, py: Python<'py>) -> PyResult<Matrix<'py>> {
        arrays::rows(py, &self.state, |s| &s.velocity[..self.grains()])
    }

    #[getter]
    fn spins<'py>(&self, py: Python<'py>) -> PyResult<Matrix<'py>> {
        arrays::rows(py, &self.state, |s| &s.spin[..self.grains()])
    }

    #[getter]
    fn contact_bodies<'py>(&self, py: Python<'py>) -> PyResult<Matrix<'py, u32>> {
        arrays::rows(py, &self.state, |s| &s.contacts.bodies)
    }

    #[getter]
    fn contact_impulses<'py>(&self, py: Python<'py>) -> PyResult<Matrix<'py>> {
        arrays::rows(py, &self.state, |s| &s.contacts.impulse)
    }

    #[getter]
    fn contact_points<'py>(&self, py: Python<'py>) -> Matrix<'py> {
        let contacts = &self.state.contacts;
        let point =
            |(pair, local)| self.state.pose(<[u32; 2]>::clone(pair)[0] as usize).point(local);
        let points: Vec<f64> = contacts
            .bodies
            .iter()
            .zip(&contacts.local_point)
            .flat_map(|at| <[f64; 3]>::from(point(at)))
            .collect();
        arrays::table(py, &points, 3)
    }

    /// Position, orientation (x, y, z, w), velocity and spin of a driven body.
    fn body<'py>(&self, py: Python<'py>, name: &str) -> PyResult<[Vector<'py>; 4]> {
        let d = self.model.driven_index(name).ok_or_else(|| unknown(py, &self.model, name))?;
        let (b, state) = (self.grains() + d, &self.state);
        Ok([
            arrays::vector(py, &state.position[b]),
            arrays::quaternion(py, &state.orientation[b]),
            arrays::vector(py, &state.velocity[b]),
            arrays::vector(py, &state.spin[b]),
        ])
    }

    /// Pose that was last asked of a driven body, or of its mount: where its next motion begins.
    fn target<'py>(&self, py: Python<'py>, name: &str) -> PyResult<[Vector<'py>; 2]> {
        let d = self.model.driven_index(name).ok_or_else(|| unknown(py, &self.model, name))?;
        let pose = self.state.imposed(&self.model, d);
        Ok([arrays::vector(py, &pose.position), arrays::quaternion(py, &pose.orientation)])
    }

    fn __repr__(&self) -> String {
        format!(
            "State({:?}, step {}, {} ns)",
            self.case.plan.name, self.state.step, self.state.time_ns
        )
    }
}

fn unknown(py: Python<'_>, model: &Model, name: &str) -> PyErr {
    let known: Vec<_> = model.driven.iter().map(|d| d.name.as_str()).collect();
    errors::refused(py, "unknown_body", format!("body: expected one of {known:?}, found {name:?}"))
}
