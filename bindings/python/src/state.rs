//! Saved states: views of their arrays, files and pickling.

use crate::arrays::{self, Matrix, Packed, Vector};
use crate::case;
use crate::errors;
use crate::lock::lock;
use ballast::component::Twist;
use ballast::math::{Pose, Quat};
use ballast::model::Model;
use ballast::state;
use ballast_beds::Case;
use ballast_hdf5::checkpoint::{self, Checkpoint, Kind};
use ballast_protocol::MessageError;
use ballast_protocol::lockstep::RunPosition;
use ballast_protocol::messages::Quaternion;
use ballast_scenario::CaseOverrides;
use ballast_zenoh::StoredStates;
use pyo3::IntoPyObjectExt;
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

#[doc = stub!("State")]
#[pyclass(frozen, module = "ballast", name = "State")]
pub struct PyState(pub StateStorage);

/// Position and orientation, or linear and angular velocity.
type VectorPair<'py> = (Vector<'py>, Vector<'py>);

/// Position, orientation, velocity and angular velocity.
type BodyArrays<'py> = (Vector<'py>, Vector<'py>, Vector<'py>, Vector<'py>);

/// Location of a state's data.
pub enum StateStorage {
    Local(LocalState),
    Remote(RemoteState),
}

/// A state of a simulation of this process.
pub struct LocalState {
    pub model: Arc<Model>,
    pub state: Arc<state::State>,
    pub case: Arc<Case>,
    /// Penetration limit of the simulation that saved the state, m; files of `ballast run` have none.
    pub max_penetration: Option<f64>,
}

/// Commanded pose of each driven body `[nd]`, and its commanded twist if the next motion must continue it.
pub type CommandedMotion = Arc<[(Pose, Option<Twist>)]>;

/// A state that a remote component stores.
///
/// It is released there when the last reference is dropped. Pickled, it outlives the simulation that saved it.
pub struct RemoteState {
    pub component: String,
    pub place: RunPosition,
    /// Name of the state at the component.
    pub name: String,
    /// Names of the driven bodies `[nd]`.
    pub bodies: Arc<[String]>,
    pub commanded: CommandedMotion,
    /// Stored states of the simulation that saved or restored this one; `None` after unpickling.
    pub stored: Mutex<Option<StoredStates>>,
}

impl Drop for RemoteState {
    fn drop(&mut self) {
        if let Some(stored) = lock(&self.stored).take() {
            stored.release(std::mem::take(&mut self.name));
        }
    }
}

impl RemoteState {
    /// Returns what another process needs to restore the state, which the component keeps from now on.
    fn to_reference(&self) -> StateReference {
        if let Some(stored) = &*lock(&self.stored) {
            stored.keep(&self.name);
        }
        let RunPosition { run_id, seq, now_ns, hash } = self.place.clone();
        let body = |(name, (pose, twist)): (&String, &(Pose, Option<Twist>))| {
            let q = &pose.orientation;
            let pose = (pose.position.into(), [q.i, q.j, q.k, q.w]);
            let twist = twist.map(|t| (t.velocity.into(), t.angular_velocity.into()));
            (name.clone(), (pose, twist))
        };
        let bodies = self.bodies.iter().zip(self.commanded.iter()).map(body).collect();
        (self.component.clone(), self.name.clone(), (run_id, seq, now_ns, hash), bodies)
    }

    fn from_reference(
        (component, name, place, bodies): StateReference,
    ) -> Result<Self, MessageError> {
        let (run_id, seq, now_ns, hash) = place;
        let commanded = |((position, [x, y, z, w]), last_twist): CommandedReference| {
            let orientation = Quat::try_from(Quaternion { x, y, z, w })?;
            let twist = |(velocity, angular_velocity): ([f64; 3], [f64; 3])| Twist {
                velocity: velocity.into(),
                angular_velocity: angular_velocity.into(),
            };
            Ok((Pose { position: position.into(), orientation }, last_twist.map(twist)))
        };
        let (bodies, motions): (Vec<String>, Vec<_>) = bodies.into_iter().unzip();
        let commanded: Result<_, MessageError> = motions.into_iter().map(commanded).collect();
        Ok(Self {
            component,
            place: RunPosition { run_id, seq, now_ns, hash },
            name,
            bodies: bodies.into(),
            commanded: commanded?,
            stored: Mutex::default(),
        })
    }
}

/// Pickled state of a remote simulation: component, name there, run position, and the driven bodies with their commanded
/// motion.
type StateReference =
    (String, String, (String, u64, u64, String), Vec<(String, CommandedReference)>);

/// Position and orientation, and velocity and angular velocity.
type CommandedReference = (([f64; 3], [f64; 4]), Option<([f64; 3], [f64; 3])>);

/// Checkpoint note with the penetration limit, m; infinite: no limit.
const PENETRATION_NOTE: &str = "max_penetration";

impl LocalState {
    fn read(py: Python<'_>, path: &Path) -> PyResult<Self> {
        let checkpoint = py.detach(|| checkpoint::read(path)).map_err(|e| errors::file(py, e))?;
        Self::from_checkpoint(py, checkpoint, &path.display().to_string())
    }

    /// Reads the bytes of a checkpoint; `name` is their name in messages.
    pub fn from_bytes(py: Python<'_>, bytes: &[u8], name: &str) -> PyResult<Self> {
        let checkpoint = py.detach(|| checkpoint::from_bytes(bytes));
        let checkpoint = checkpoint.map_err(|e| errors::file(py, format!("{name}: {e}")))?;
        Self::from_checkpoint(py, checkpoint, name)
    }

    fn from_checkpoint(py: Python<'_>, checkpoint: Checkpoint, name: &str) -> PyResult<Self> {
        if checkpoint.kind != Kind::Run {
            let kind = checkpoint.kind.name();
            let text = format!(
                "{name}: expected the state of a run, found a {kind}; `ballast.open` starts a case from its bed"
            );
            return Err(errors::file(py, text));
        }
        let choices = CaseOverrides::from_notes(&checkpoint.extra)
            .map_err(|e| errors::file(py, format!("{name}: {e}")))?;
        let case = case::read(py, checkpoint.case_text, name)?.with_overrides(choices);
        let limit = |text: &String| match text.parse() {
            Ok(limit) if limit > 0.0 => Ok(limit),
            _ => {
                let place = format!("{name}: note {PENETRATION_NOTE:?}");
                let text = format!("{place}: expected a length above 0 m, found {text}");
                Err(errors::file(py, text))
            }
        };
        Ok(Self {
            max_penetration: checkpoint.extra.get(PENETRATION_NOTE).map(limit).transpose()?,
            model: Arc::new(checkpoint.model),
            state: Arc::new(checkpoint.state),
            case: Arc::new(case),
        })
    }

    /// Calls `write` with the state as a checkpoint.
    fn write_with<T: Send>(
        &self,
        py: Python<'_>,
        write: impl FnOnce(&Checkpoint) -> ballast_hdf5::Result<T> + Send,
    ) -> PyResult<T> {
        let limit =
            self.max_penetration.map(|limit| (PENETRATION_NOTE.into(), format!("{limit:e}")));
        let notes = limit.into_iter().collect();
        let write = || write(&self.case.checkpoint(&self.model, &self.state, notes));
        py.detach(write).map_err(|e| errors::file(py, e))
    }

    /// Returns rows of the grains `[ng]`.
    fn grain_rows<'py, T: Packed>(
        &self,
        py: Python<'py>,
        pick: impl FnOnce(&state::State) -> &[T],
    ) -> PyResult<Matrix<'py, T::Number>> {
        arrays::rows(py, &self.state, |s| &pick(s)[..self.model.grains.len()])
    }

    /// Returns the index of a driven body.
    fn driven(&self, py: Python<'_>, name: &str) -> PyResult<usize> {
        body_index(py, self.model.driven.iter().map(|d| &d.name), name)
    }
}

impl PyState {
    /// Returns the data of a local state.
    ///
    /// # Errors
    /// `RequestError` with the code "remote_unsupported".
    pub fn local(&self, py: Python<'_>, operation: &str) -> PyResult<&LocalState> {
        match &self.0 {
            StateStorage::Local(state) => Ok(state),
            StateStorage::Remote(_) => Err(errors::remote_unsupported(py, operation)),
        }
    }

    /// Returns the commanded motion of a driven body.
    fn commanded(&self, py: Python<'_>, name: &str) -> PyResult<(Pose, Option<Twist>)> {
        match &self.0 {
            StateStorage::Local(local) => {
                let d = local.driven(py, name)?;
                Ok((local.state.imposed(&local.model, d), local.state.end_twist(d)))
            }
            StateStorage::Remote(remote) => {
                Ok(remote.commanded[body_index(py, remote.bodies.iter(), name)?])
            }
        }
    }
}

#[pymethods]
impl PyState {
    #[doc = stub!("State.read")]
    #[staticmethod]
    fn read(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        Ok(Self(StateStorage::Local(LocalState::read(py, &path)?)))
    }

    #[doc = stub!("State.write")]
    fn write(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        self.local(py, "write")?.write_with(py, |state| {
            checkpoint::may_become_a_checkpoint(&path)?;
            checkpoint::write(path, state)
        })
    }

    #[doc = stub!("State.__reduce__")]
    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<PickledState<'py>> {
        let module = py.import("ballast._ballast")?;
        match &self.0 {
            StateStorage::Local(state) => {
                let write = |state: &Checkpoint| checkpoint::to_bytes(PICKLE_NAME, state);
                let bytes = PyBytes::new(py, &state.write_with(py, write)?);
                Ok((module.getattr("_unpickle_state")?, (bytes.into_any(),)))
            }
            StateStorage::Remote(state) => {
                let reference = state.to_reference().into_bound_py_any(py)?;
                Ok((module.getattr("_unpickle_remote_state")?, (reference,)))
            }
        }
    }

    #[doc = stub!("State.__copy__")]
    fn __copy__(this: PyRef<'_, Self>) -> PyRef<'_, Self> {
        this
    }

    fn __deepcopy__<'py>(this: PyRef<'py, Self>, _memo: &Bound<'py, PyAny>) -> PyRef<'py, Self> {
        this
    }

    #[doc = stub!("State.time_ns")]
    #[getter]
    fn time_ns(&self) -> u64 {
        match &self.0 {
            StateStorage::Local(local) => local.state.time_ns,
            StateStorage::Remote(remote) => remote.place.now_ns,
        }
    }

    #[doc = stub!("State.step")]
    #[getter]
    fn step(&self, py: Python<'_>) -> PyResult<u64> {
        Ok(self.local(py, "step")?.state.step)
    }

    #[doc = stub!("State.hash")]
    #[getter]
    fn hash(&self, py: Python<'_>) -> String {
        match &self.0 {
            StateStorage::Local(LocalState { model, state, .. }) => {
                py.detach(|| format!("{:032x}", ballast_hdf5::state_hash(model, state)))
            }
            StateStorage::Remote(remote) => remote.place.hash.clone(),
        }
    }

    #[doc = stub!("State.positions")]
    #[getter]
    fn positions<'py>(&self, py: Python<'py>) -> PyResult<Matrix<'py>> {
        self.local(py, "positions")?.grain_rows(py, |s| &s.position)
    }

    #[doc = stub!("State.orientations")]
    #[getter]
    fn orientations<'py>(&self, py: Python<'py>) -> PyResult<Matrix<'py>> {
        self.local(py, "orientations")?.grain_rows(py, |s| &s.orientation)
    }

    #[doc = stub!("State.velocities")]
    #[getter]
    fn velocities<'py>(&self, py: Python<'py>) -> PyResult<Matrix<'py>> {
        self.local(py, "velocities")?.grain_rows(py, |s| &s.velocity)
    }

    #[doc = stub!("State.angular_velocities")]
    #[getter]
    fn angular_velocities<'py>(&self, py: Python<'py>) -> PyResult<Matrix<'py>> {
        self.local(py, "angular_velocities")?.grain_rows(py, |s| &s.angular_velocity)
    }

    #[doc = stub!("State.contact_bodies")]
    #[getter]
    fn contact_bodies<'py>(&self, py: Python<'py>) -> PyResult<Matrix<'py, u32>> {
        arrays::rows(py, &self.local(py, "contact_bodies")?.state, |s| &s.contacts.bodies)
    }

    #[doc = stub!("State.contact_impulses")]
    #[getter]
    fn contact_impulses<'py>(&self, py: Python<'py>) -> PyResult<Matrix<'py>> {
        arrays::rows(py, &self.local(py, "contact_impulses")?.state, |s| &s.contacts.impulse)
    }

    #[doc = stub!("State.contact_points")]
    #[getter]
    fn contact_points<'py>(&self, py: Python<'py>) -> PyResult<Matrix<'py>> {
        let state = &self.local(py, "contact_points")?.state;
        let contacts = &state.contacts;
        let mut points = Vec::with_capacity(3 * contacts.bodies.len());
        for ([body, _], local_point) in contacts.bodies.iter().zip(&contacts.local_point) {
            points.extend(<[f64; 3]>::from(state.pose(*body as usize).point(local_point)));
        }
        Ok(arrays::table(py, &points, 3))
    }

    #[doc = stub!("State.body")]
    fn body<'py>(&self, py: Python<'py>, name: &str) -> PyResult<BodyArrays<'py>> {
        let local = self.local(py, "body")?;
        let state = &local.state;
        let b = local.model.grains.len() + local.driven(py, name)?;
        Ok((
            arrays::vector(py, &state.position[b]),
            arrays::quaternion(py, &state.orientation[b]),
            arrays::vector(py, &state.velocity[b]),
            arrays::vector(py, &state.angular_velocity[b]),
        ))
    }

    #[doc = stub!("State.commanded_pose")]
    fn commanded_pose<'py>(&self, py: Python<'py>, name: &str) -> PyResult<VectorPair<'py>> {
        let (pose, _) = self.commanded(py, name)?;
        Ok((arrays::vector(py, &pose.position), arrays::quaternion(py, &pose.orientation)))
    }

    #[doc = stub!("State.commanded_twist")]
    fn commanded_twist<'py>(
        &self,
        py: Python<'py>,
        name: &str,
    ) -> PyResult<Option<VectorPair<'py>>> {
        let (_, twist) = self.commanded(py, name)?;
        let vectors =
            |t: Twist| (arrays::vector(py, &t.velocity), arrays::vector(py, &t.angular_velocity));
        Ok(twist.map(vectors))
    }

    fn __repr__(&self) -> String {
        match &self.0 {
            StateStorage::Local(LocalState { case, state, .. }) => {
                format!("State({:?}, step {}, {} ns)", case.plan.name, state.step, state.time_ns)
            }
            StateStorage::Remote(remote) => {
                format!("State(\"zenoh:{}\", {} ns)", remote.component, remote.place.now_ns)
            }
        }
    }
}

/// Unpickling function, and the bytes of a checkpoint or a reference to a state of a component.
type PickledState<'py> = (Bound<'py, PyAny>, (Bound<'py, PyAny>,));

/// Name of pickled bytes in messages.
const PICKLE_NAME: &str = "a pickled state";

/// Returns a pickled state.
#[pyfunction]
pub fn _unpickle_state(py: Python<'_>, bytes: &[u8]) -> PyResult<PyState> {
    Ok(PyState(StateStorage::Local(LocalState::from_bytes(py, bytes, PICKLE_NAME)?)))
}

/// Returns a pickled state of a remote simulation.
#[pyfunction]
pub fn _unpickle_remote_state(py: Python<'_>, reference: StateReference) -> PyResult<PyState> {
    let state = RemoteState::from_reference(reference);
    let state = state.map_err(|e| errors::invalid(py, PICKLE_NAME, e.expected, e.found))?;
    Ok(PyState(StateStorage::Remote(state)))
}

/// Returns the index of a driven body in a list of names.
///
/// # Errors
/// `RequestError` with the code "unknown_body".
fn body_index<'a>(
    py: Python<'_>,
    names: impl Iterator<Item = &'a String> + Clone,
    name: &str,
) -> PyResult<usize> {
    names.clone().position(|known| known == name).ok_or_else(|| {
        let expected = format!("one of {:?}", names.collect::<Vec<_>>());
        errors::request(py, "unknown_body", "body", expected, format!("{name:?}"))
    })
}
