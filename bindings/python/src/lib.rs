//! The ballast model as a Python package: what `import ballast` is made of.
//!
//! Contract: the same inputs give the same bytes as on every other face. The interpreter is released while
//! steps are computed; a failure inside is an exception. Types are in `python/ballast/_ballast.pyi`; what `help` says of
//! classes and their members is what is said there, word by word.

mod arrays;
mod bodies;
mod case;
mod compute;
mod errors;
mod here;
mod inputs;
mod lock;
mod machine;
mod outcome;
mod recorder;
mod recording;
mod results;
mod simulation;
mod state;
mod there;
mod work;

use pyo3::prelude::*;

/// A simulation that goes on from a saved state.
#[pyfunction]
#[pyo3(signature = (state, threads=None, max_penetration=None, keep_early=false))]
fn resume(
    py: Python<'_>,
    state: &state::State,
    threads: Option<&Bound<'_, PyAny>>,
    max_penetration: Option<f64>,
    keep_early: bool,
) -> PyResult<simulation::Simulation> {
    let start = state.here(py, "resume")?;
    let limits = case::limits(py, max_penetration.or(start.penetration), keep_early)?;
    let crew = compute::Crew::new(py, threads)?;
    simulation::Simulation::here(py, start, limits, crew)
}

/// The JSON Schema of case files.
#[pyfunction]
fn schema(py: Python<'_>) -> PyResult<Bound<'_, PyAny>> {
    case::as_dict(py, &ballast_scenario::schema())
}

/// Replaces a file by a text, at once or not at all.
#[pyfunction]
fn replace(py: Python<'_>, path: std::path::PathBuf, text: &str) -> PyResult<()> {
    ballast_hdf5::replace(&path, &[text.as_bytes()]).map_err(|e| errors::file(py, e))
}

#[pymodule]
fn _ballast(module: &Bound<'_, PyModule>) -> PyResult<()> {
    errors::register(module)?;
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add_class::<bodies::Mount>()?;
    module.add_class::<bodies::Tine>()?;
    module.add_class::<case::Case>()?;
    module.add_class::<inputs::Load>()?;
    module.add_class::<inputs::Motion>()?;
    module.add_class::<outcome::Body>()?;
    module.add_class::<outcome::Energy>()?;
    module.add_class::<outcome::Outcome>()?;
    module.add_class::<outcome::Series>()?;
    module.add_class::<outcome::Solver>()?;
    module.add_class::<outcome::Squeeze>()?;
    module.add_class::<outcome::ZoneMeasure>()?;
    module.add_class::<recording::Recording>()?;
    module.add_class::<results::Results>()?;
    module.add_class::<simulation::Simulation>()?;
    module.add_class::<state::State>()?;
    module.add_function(wrap_pyfunction!(case::begin, module)?)?;
    module.add_function(wrap_pyfunction!(case::case_again, module)?)?;
    module.add_function(wrap_pyfunction!(case::prepare, module)?)?;
    module.add_function(wrap_pyfunction!(case::values, module)?)?;
    module.add_function(wrap_pyfunction!(case::write_plan, module)?)?;
    module.add_function(wrap_pyfunction!(state::state_again, module)?)?;
    module.add_function(wrap_pyfunction!(there::attach, module)?)?;
    module.add_function(wrap_pyfunction!(replace, module)?)?;
    module.add_function(wrap_pyfunction!(resume, module)?)?;
    module.add_function(wrap_pyfunction!(schema, module)?)
}
