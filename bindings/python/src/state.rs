//! A state that was saved: looked at without a copy, restored, written to a file.

use crate::arrays::{self, Matrix, Packed, Vector};
use crate::case;
use crate::errors;
use crate::machine::Machine;
use crate::there::Kept;
use ballast::component::{Twist, left_twist};
use ballast::math::Pose;
use ballast::model::Model;
use ballast::state;
use ballast_beds::Case;
use ballast_hdf5::checkpoint::{self, Checkpoint, Kind};
use ballast_scenario::Choices;
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A state that was saved. Arrays are read-only and not copied; they keep their values while the
/// simulation goes on, and stay valid as long as somebody holds them. It can be copied, which takes nothing, and pickled.
///
/// A state of a simulation that another process computes is kept there until nobody here holds it any more: it has
/// `time_ns`, `hash`, `target` and `target_twist`, `restore` takes it, and it cannot be pickled.
#[pyclass(frozen, module = "ballast")]
pub struct State(pub Saved);

/// Position and orientation, or velocity and spin.
type Two<'py> = (Vector<'py>, Vector<'py>);

/// Position, orientation, velocity and spin.
type Body<'py> = (Vector<'py>, Vector<'py>, Vector<'py>, Vector<'py>);

/// Where a state is.
pub enum Saved {
    Here(Snapshot),
    There(Kept),
}

/// A state of this process.
pub struct Snapshot {
    pub model: Arc<Model>,
    pub state: Arc<state::State>,
    pub case: Arc<Case>,
    pub machine: Machine,
    /// Limit of the penetration, m, where a simulation of this process has saved it; files have none.
    pub penetration: Option<f64>,
}

/// The note of a checkpoint that holds what the machine remembers: numbers as text that reads back to the
/// same bits.
const MACHINE: &str = "machine";
/// Note of how deep a step may press bodies into each other, m; infinite: any.
const LIMIT: &str = "max_penetration";

impl Snapshot {
    fn read(py: Python<'_>, path: &Path) -> PyResult<Self> {
        let kept = py.detach(|| checkpoint::read(path)).map_err(|e| errors::file(py, e))?;
        Self::of(py, kept, &path.display().to_string())
    }

    /// Of the bytes of such a file; `name` is what they are part of.
    pub fn from_bytes(py: Python<'_>, bytes: &[u8], name: &str) -> PyResult<Self> {
        let kept = py.detach(|| checkpoint::from_bytes(bytes));
        Self::of(py, kept.map_err(|e| errors::file(py, format!("{name}: {e}")))?, name)
    }

    fn of(py: Python<'_>, kept: Checkpoint, name: &str) -> PyResult<Self> {
        if kept.kind != Kind::Run {
            let text = format!(
                "{name}: it is a {}, not the state of a run; `ballast.open` starts a case from its bed",
                kept.kind.name()
            );
            return Err(errors::file(py, text));
        }
        let choices = Choices::from_notes(&kept.extra)
            .map_err(|e| errors::file(py, format!("{name}: {e}")))?;
        let case = case::read(py, kept.case_text, name)?.chosen(choices);
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
        let limit = |text: &String| match text.parse() {
            Ok(most) if most > 0.0 => Ok(most),
            _ => Err(errors::file(
                py,
                format!("{name}: note {LIMIT:?}: expected a length above 0 m, found {text}"),
            )),
        };
        let penetration = kept.extra.get(LIMIT).map(limit).transpose()?;
        let (model, state) = (Arc::new(kept.model), Arc::new(kept.state));
        Ok(Self { model, state, case: Arc::new(case), machine, penetration })
    }

    /// Writes what it is as a file by `put`.
    fn put<T: Send>(
        &self,
        py: Python<'_>,
        put: impl FnOnce(&Checkpoint) -> ballast_hdf5::Result<T> + Send,
    ) -> PyResult<T> {
        let memory = serde_json::to_string(self.machine.memory());
        let memory = memory.map_err(|e| errors::file(py, format!("note {MACHINE:?}: {e}")))?;
        let limit = self.penetration.map(|most| (LIMIT.into(), format!("{most:e}")));
        let notes = [(MACHINE.into(), memory)].into_iter().chain(limit).collect();
        let put = || put(&self.case.checkpoint(&self.model, &self.state, notes));
        py.detach(put).map_err(|e| errors::file(py, e))
    }

    /// Rows of the grains `[ng]`.
    fn of_grains<'py, T: Packed>(
        &self,
        py: Python<'py>,
        pick: impl FnOnce(&state::State) -> &[T],
    ) -> PyResult<Matrix<'py, T::Number>> {
        arrays::rows(py, &self.state, |s| &pick(s)[..self.model.grains.len()])
    }
}

impl State {
    /// The state, of this process.
    pub fn here(&self, py: Python<'_>, what: &str) -> PyResult<&Snapshot> {
        match &self.0 {
            Saved::Here(snapshot) => Ok(snapshot),
            Saved::There(_) => Err(errors::elsewhere(py, what)),
        }
    }

    /// Where the next motion of a driven body begins, and with which twist, if that is not free.
    fn goal(&self, py: Python<'_>, name: &str) -> PyResult<(Pose, Option<Twist>)> {
        match &self.0 {
            Saved::Here(Snapshot { model, state, .. }) => {
                let d = driven(py, model.driven.iter().map(|d| &d.name), name)?;
                Ok((state.imposed(model, d), left_twist(state, d)))
            }
            Saved::There(kept) => Ok(kept.targets[driven(py, kept.names.iter(), name)?]),
        }
    }
}

#[pymethods]
impl State {
    /// Reads what `write` has written, or a checkpoint of `ballast run`. Raises FileError.
    #[staticmethod]
    fn read(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        Ok(Self(Saved::Here(Snapshot::read(py, &path)?)))
    }

    /// Writes the state to a file from which it goes on to the same bytes, also in another process. Of what lies there
    /// only such a file, a bed or a checkpoint is replaced. Raises FileError.
    fn write(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        self.here(py, "write")?.put(py, |kept| {
            checkpoint::may_become_a_checkpoint(&path)?;
            checkpoint::write(path, kept)
        })
    }

    /// Pickled as the bytes of the file that `write` would leave.
    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<PickledState<'py>> {
        let bytes = self.here(py, "pickle")?.put(py, |kept| checkpoint::to_bytes(PICKLED, kept))?;
        let again = py.import("ballast._ballast")?.getattr("state_again")?;
        Ok((again, (PyBytes::new(py, &bytes),)))
    }

    /// Nothing changes a state.
    fn __copy__(this: PyRef<'_, Self>) -> PyRef<'_, Self> {
        this
    }

    fn __deepcopy__<'py>(this: PyRef<'py, Self>, _memo: &Bound<'py, PyAny>) -> PyRef<'py, Self> {
        this
    }

    /// Simulated time, ns since the start of the run.
    #[getter]
    fn time_ns(&self) -> u64 {
        match &self.0 {
            Saved::Here(snapshot) => snapshot.state.time_ns,
            Saved::There(kept) => kept.place.now_ns,
        }
    }

    /// Steps since the start of the run.
    #[getter]
    fn step(&self, py: Python<'_>) -> PyResult<u64> {
        Ok(self.here(py, "step")?.state.step)
    }

    /// 128 bits that tell states apart, as 32 hexadecimal digits: `ballast serve` has the same, and so have recordings
    /// of either. `ballast run`, which remembers its machine instead of windows, has others of the same bodies, in its
    /// files and recordings, too.
    #[getter]
    fn hash(&self, py: Python<'_>) -> String {
        match &self.0 {
            Saved::Here(Snapshot { model, state, .. }) => {
                py.detach(|| format!("{:032x}", ballast_hdf5::state_hash(model, state)))
            }
            Saved::There(kept) => kept.place.hash.clone(),
        }
    }

    /// (ng, 3) of the grains, m.
    #[getter]
    fn positions<'py>(&self, py: Python<'py>) -> PyResult<Matrix<'py>> {
        self.here(py, "positions")?.of_grains(py, |s| &s.position)
    }

    /// (ng, 4) of the grains, x, y, z, w.
    #[getter]
    fn orientations<'py>(&self, py: Python<'py>) -> PyResult<Matrix<'py>> {
        self.here(py, "orientations")?.of_grains(py, |s| &s.orientation)
    }

    /// (ng, 3) of the grains, m/s.
    #[getter]
    fn velocities<'py>(&self, py: Python<'py>) -> PyResult<Matrix<'py>> {
        self.here(py, "velocities")?.of_grains(py, |s| &s.velocity)
    }

    /// (ng, 3) of the grains, rad/s.
    #[getter]
    fn spins<'py>(&self, py: Python<'py>) -> PyResult<Matrix<'py>> {
        self.here(py, "spins")?.of_grains(py, |s| &s.angular_velocity)
    }

    /// (nc, 2) bodies of each contact point; driven bodies are numbered after the grains.
    #[getter]
    fn contact_bodies<'py>(&self, py: Python<'py>) -> PyResult<Matrix<'py, u32>> {
        arrays::rows(py, &self.here(py, "contact_bodies")?.state, |s| &s.contacts.bodies)
    }

    /// (nc, 3) impulse of the last step on the first body, N s.
    #[getter]
    fn contact_impulses<'py>(&self, py: Python<'py>) -> PyResult<Matrix<'py>> {
        arrays::rows(py, &self.here(py, "contact_impulses")?.state, |s| &s.contacts.impulse)
    }

    /// (nc, 3) where the contacts are, m; a copy.
    #[getter]
    fn contact_points<'py>(&self, py: Python<'py>) -> PyResult<Matrix<'py>> {
        let state = &self.here(py, "contact_points")?.state;
        let contacts = &state.contacts;
        let point = |(pair, local)| state.pose(<[u32; 2]>::clone(pair)[0] as usize).point(local);
        let points: Vec<f64> = contacts
            .bodies
            .iter()
            .zip(&contacts.local_point)
            .flat_map(|at| <[f64; 3]>::from(point(at)))
            .collect();
        Ok(arrays::table(py, &points, 3))
    }

    /// Position (m), orientation (x, y, z, w), velocity (m/s) and spin (rad/s) of a driven body.
    fn body<'py>(&self, py: Python<'py>, name: &str) -> PyResult<Body<'py>> {
        let Snapshot { model, state, .. } = self.here(py, "body")?;
        let b = model.grains.len() + driven(py, model.driven.iter().map(|d| &d.name), name)?;
        Ok((
            arrays::vector(py, &state.position[b]),
            arrays::quaternion(py, &state.orientation[b]),
            arrays::vector(py, &state.velocity[b]),
            arrays::vector(py, &state.angular_velocity[b]),
        ))
    }

    /// Position (m) and orientation (x, y, z, w) that were last asked of a driven body, or of the mount that
    /// holds it: where its next motion has to begin.
    fn target<'py>(&self, py: Python<'py>, name: &str) -> PyResult<Two<'py>> {
        let (pose, _) = self.goal(py, name)?;
        Ok((arrays::vector(py, &pose.position), arrays::quaternion(py, &pose.orientation)))
    }

    /// Velocity (m/s) and spin (rad/s) with which the next cubic motion of a driven body, or of the mount that holds
    /// it, begins: as the last one ended, or zero where the body had no motion. None, any, after a held or linear one.
    fn target_twist<'py>(&self, py: Python<'py>, name: &str) -> PyResult<Option<Two<'py>>> {
        let (_, twist) = self.goal(py, name)?;
        let vectors =
            |t: Twist| (arrays::vector(py, &t.velocity), arrays::vector(py, &t.angular_velocity));
        Ok(twist.map(vectors))
    }

    fn __repr__(&self) -> String {
        match &self.0 {
            Saved::Here(Snapshot { case, state, .. }) => {
                format!("State({:?}, step {}, {} ns)", case.plan.name, state.step, state.time_ns)
            }
            Saved::There(kept) => {
                format!("State(\"zenoh:{}\", {} ns)", kept.component, kept.place.now_ns)
            }
        }
    }
}

/// What makes a state of bytes, and these.
type PickledState<'py> = (Bound<'py, PyAny>, (Bound<'py, PyBytes>,));

/// What messages call a state that was pickled.
const PICKLED: &str = "a pickled state";

/// A state that was pickled.
#[pyfunction]
pub fn state_again(py: Python<'_>, bytes: &[u8]) -> PyResult<State> {
    Ok(State(Saved::Here(Snapshot::from_bytes(py, bytes, PICKLED)?)))
}

/// The number of a driven body.
fn driven<'a>(
    py: Python<'_>,
    names: impl Iterator<Item = &'a String> + Clone,
    name: &str,
) -> PyResult<usize> {
    names.clone().position(|known| known == name).ok_or_else(|| {
        let known: Vec<_> = names.collect();
        errors::refused(
            py,
            "unknown_body",
            "body",
            format!("one of {known:?}"),
            format!("{name:?}"),
        )
    })
}
