//! The compiled module `ballast._ballast` of the Python package.
//!
//! Contract: equal inputs give the same bytes as in the program and over the network. The interpreter is released while
//! steps are computed. A panic becomes an exception. Docstrings are those of `python/ballast/_ballast.pyi` (`build.rs`).
//!
//! Layers: `case` <- `state` <- `backend` <- `local`, `remote` <- `simulation` <- `factory`.

include!(concat!(env!("OUT_DIR"), "/stub.rs"));

mod arrays;
mod backend;
mod bodies;
mod calls;
mod case;
mod errors;
mod factory;
mod info;
mod inputs;
mod local;
mod lock;
mod probe;
mod recording;
mod remote;
mod result;
mod results;
mod simulation;
mod state;
mod threads;
mod toml_values;

use pyo3::prelude::*;
use pyo3::types::PyCFunction;

#[doc = stub!("schema")]
#[pyfunction]
fn schema(py: Python<'_>) -> PyResult<Bound<'_, PyAny>> {
    case::to_dict(py, &ballast_scenario::schema())
}

/// Replaces the content of a file atomically.
#[pyfunction]
fn _replace_file(py: Python<'_>, path: std::path::PathBuf, text: &str) -> PyResult<()> {
    ballast_hdf5::replace(&path, &[text.as_bytes()]).map_err(|e| errors::file(py, e))
}

#[pymodule]
fn _ballast(module: &Bound<'_, PyModule>) -> PyResult<()> {
    errors::register(module)?;
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add_class::<bodies::PyMount>()?;
    module.add_class::<bodies::PyTine>()?;
    module.add_class::<case::PyCase>()?;
    module.add_class::<inputs::PyLoad>()?;
    module.add_class::<inputs::PyMotion>()?;
    module.add_class::<result::PyBodyResult>()?;
    module.add_class::<result::PyEnergyLedger>()?;
    module.add_class::<result::PySolverResult>()?;
    module.add_class::<result::PySqueeze>()?;
    module.add_class::<result::PyStepSeries>()?;
    module.add_class::<result::PyWindowResult>()?;
    module.add_class::<result::PyZoneResult>()?;
    module.add_class::<recording::PyRecording>()?;
    module.add_class::<results::PyResults>()?;
    module.add_class::<simulation::PySimulation>()?;
    module.add_class::<state::PyState>()?;
    module.add_function(wrap_pyfunction!(schema, module)?)?;
    // Not in `__all__`: the package and `pickle` call these.
    let private: [Bound<'_, PyCFunction>; 13] = [
        wrap_pyfunction!(_replace_file, module)?,
        wrap_pyfunction!(case::_parse_toml, module)?,
        wrap_pyfunction!(case::_unpickle_case, module)?,
        wrap_pyfunction!(case::_write_sweep_plan, module)?,
        wrap_pyfunction!(factory::_attach, module)?,
        wrap_pyfunction!(factory::_open, module)?,
        wrap_pyfunction!(factory::_prepare, module)?,
        wrap_pyfunction!(factory::_resume, module)?,
        wrap_pyfunction!(result::_unpickle_part, module)?,
        wrap_pyfunction!(result::_unpickle_step_series, module)?,
        wrap_pyfunction!(result::_unpickle_window_result, module)?,
        wrap_pyfunction!(state::_unpickle_state, module)?,
        wrap_pyfunction!(state::_unpickle_remote_state, module)?,
    ];
    private.into_iter().try_for_each(|function| {
        let name: String = function.getattr("__name__")?.extract()?;
        module.setattr(name, function)
    })
}
