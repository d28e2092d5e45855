//! Probes of a sleeper as dictionaries of numbers and arrays.

use crate::arrays;
use crate::errors;
use ballast::component::{self, ProbePoint, PushCurve, StiffnessCurve, sleepers};
use ballast::model::Model;
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// Returns the number of a sleeper among the driven bodies; the first if no name is given.
pub fn find_sleeper(py: Python<'_>, model: &Model, name: Option<&str>) -> PyResult<usize> {
    component::find_sleeper(model, name).ok_or_else(|| {
        let known: Vec<&str> = sleepers(model).map(|d| &model.driven[d].name[..]).collect();
        let expected = format!("one of {known:?}");
        errors::request(py, "unknown_body", "sleeper", expected, name.unwrap_or("none"))
    })
}

/// Returns the columns of a curve, and their names.
fn curve<'py>(
    py: Python<'py>,
    points: &[ProbePoint],
    names: [&str; 2],
) -> PyResult<Bound<'py, PyDict>> {
    let column = |of: fn(&ProbePoint) -> f64| {
        arrays::column(py, &points.iter().map(of).collect::<Vec<f64>>())
    };
    let dict = PyDict::new(py);
    dict.set_item("time", column(|p| p.time))?;
    dict.set_item(names[0], column(|p| p.force))?;
    dict.set_item(names[1], column(|p| p.displacement))?;
    Ok(dict)
}

/// Returns curve and cycles of a stiffness probe.
pub fn stiffness<'py>(py: Python<'py>, probed: &StiffnessCurve) -> PyResult<Bound<'py, PyDict>> {
    let dict = curve(py, &probed.points, ["load", "settlement"])?;
    let cycles = probed.cycles.iter().map(|cycle| {
        let of = PyDict::new(py);
        of.set_item("loading", cycle.loading)?;
        of.set_item("unloading", cycle.unloading)?;
        of.set_item("settlement", cycle.settlement)?;
        of.set_item("rest", cycle.rest)?;
        Ok(of)
    });
    dict.set_item("cycles", cycles.collect::<PyResult<Vec<_>>>()?)?;
    Ok(dict)
}

/// Returns curve and reference force of a push.
pub fn push<'py>(py: Python<'py>, probed: &PushCurve) -> PyResult<Bound<'py, PyDict>> {
    let dict = curve(py, &probed.points, ["force", "displacement"])?;
    dict.set_item("weight", probed.weight)?;
    dict.set_item("force_at_2_mm", probed.force_at(PushCurve::REFERENCE_DISPLACEMENT))?;
    Ok(dict)
}
