//! Creation of simulations: from a case and its bed, from a saved state, or of a remote component.

use crate::case::PyCase;
use crate::errors;
use crate::local::LocalBackend;
use crate::remote::RemoteBackend;
use crate::simulation::PySimulation;
use crate::state::{LocalState, PyState};
use crate::threads::{ThreadPoolHandle, run_interruptible};
use ballast::component::Limits;
use ballast_beds::{BedStore, PreparationProgress};
use ballast_zenoh::SessionConfig;
use pyo3::prelude::*;
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::Arc;

/// Prepares the bed of a case unless the cache has it; returns the path of its file.
#[pyfunction]
#[pyo3(signature = (case, bed_cache, threads=None, progress=None, rebuild=false))]
pub fn _prepare(
    py: Python<'_>,
    case: &PyCase,
    bed_cache: PathBuf,
    threads: Option<&Bound<'_, PyAny>>,
    progress: Option<Py<PyAny>>,
    rebuild: bool,
) -> PyResult<PathBuf> {
    let beds = BedStore::new(bed_cache);
    let path = beds.path(&case.0.plan);
    let cached = py.detach(|| beds.find(&case.0.plan)).map_err(|e| errors::bed(py, e));
    if rebuild || cached?.is_none() {
        prepare_bed(py, case, &beds, threads, progress)?;
    }
    Ok(path)
}

fn prepare_bed(
    py: Python<'_>,
    case: &PyCase,
    beds: &BedStore,
    threads: Option<&Bound<'_, PyAny>>,
    progress: Option<Py<PyAny>>,
) -> PyResult<ballast::track::Bed> {
    let threads = ThreadPoolHandle::new(py, threads)?;
    let result = run_interruptible(py, &threads, progress.as_ref(), |control| {
        let mut pace = PreparationProgress::default();
        beds.prepare(&case.0, &mut |at| {
            control.report(pace.update(at), || at.stage.name().to_string());
            if control.is_cancelled() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        })
    });
    match result? {
        (_, Some(raised)) => Err(raised),
        (Ok(Some(bed)), None) => Ok(bed),
        (Ok(None), None) => Err(pyo3::exceptions::PyKeyboardInterrupt::new_err(())),
        (Err(failure), None) => Err(errors::bed(py, failure)),
    }
}

/// Returns a simulation at the start of a case; its bed is prepared unless the cache has it.
#[pyfunction]
#[pyo3(signature = (case, bed_cache, threads=None, progress=None, max_penetration=None, keep_partial_window=false))]
pub fn _open(
    py: Python<'_>,
    case: &PyCase,
    bed_cache: PathBuf,
    threads: Option<&Bound<'_, PyAny>>,
    progress: Option<Py<PyAny>>,
    max_penetration: Option<f64>,
    keep_partial_window: bool,
) -> PyResult<PySimulation> {
    let limits = limits(py, max_penetration, keep_partial_window)?;
    let beds = BedStore::new(bed_cache);
    let cached = py.detach(|| beds.find(&case.0.plan)).map_err(|e| errors::bed(py, e))?;
    let bed = match cached {
        Some(bed) => bed,
        None => prepare_bed(py, case, &beds, threads, progress)?,
    };
    let scene = py.detach(|| ballast_beds::scene(&case.0.plan, bed));
    let (model, state) = scene.map_err(|e| errors::bed(py, e))?;
    let start = LocalState {
        model: Arc::new(model),
        state: Arc::new(state),
        case: Arc::clone(&case.0),
        max_penetration: None,
    };
    let threads = ThreadPoolHandle::new(py, threads)?;
    Ok(PySimulation::local(LocalBackend::new(py, &start, limits, threads)?))
}

/// Returns a simulation that continues from a saved state.
#[pyfunction]
#[pyo3(signature = (state, threads=None, max_penetration=None, keep_partial_window=false))]
pub fn _resume(
    py: Python<'_>,
    state: &PyState,
    threads: Option<&Bound<'_, PyAny>>,
    max_penetration: Option<f64>,
    keep_partial_window: bool,
) -> PyResult<PySimulation> {
    let start = state.local(py, "resume")?;
    let limits = limits(py, max_penetration.or(start.max_penetration), keep_partial_window)?;
    let threads = ThreadPoolHandle::new(py, threads)?;
    Ok(PySimulation::local(LocalBackend::new(py, start, limits, threads)?))
}

/// Returns a simulation of the remote component `site/id`.
#[pyfunction]
pub fn _attach(
    py: Python<'_>,
    component: &str,
    connect: Option<Vec<String>>,
    listen: Option<Vec<String>>,
    config: Option<PathBuf>,
) -> PyResult<PySimulation> {
    let connect = connect.unwrap_or_default();
    let listen = listen.unwrap_or_default();
    let link = SessionConfig { config, listen, connect, ..SessionConfig::default() }
        .or_connect_to_default();
    let (backend, description) = RemoteBackend::attach(py, component, link)?;
    Ok(PySimulation::remote(backend, description))
}

fn limits(
    py: Python<'_>,
    max_penetration: Option<f64>,
    keep_partial_window: bool,
) -> PyResult<Limits> {
    let penetration = max_penetration.unwrap_or(f64::INFINITY);
    if penetration.is_nan() || penetration <= 0.0 {
        return Err(errors::invalid(py, "max_penetration", "a length above 0 m", penetration));
    }
    Ok(Limits { penetration, keep_partial_window, ..Limits::default() })
}
