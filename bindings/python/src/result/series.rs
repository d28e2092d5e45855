//! Values of every step of a window.

use super::{PickleReduction, malformed, private_function};
use crate::arrays::{self, Matrix, Vector};
use ballast_protocol::messages::StepSeries;
use ballast_protocol::{from_cdr, to_cdr};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};
use std::sync::Arc;

#[doc = stub!("StepSeries")]
#[pyclass(frozen, module = "ballast", name = "StepSeries")]
pub struct PyStepSeries {
    steps: StepSeries,
    /// Names of the driven bodies `[nd]`; the series of a window without steps has none.
    names: Arc<[String]>,
}

impl PyStepSeries {
    pub fn new(steps: StepSeries, names: &Arc<[String]>) -> Self {
        Self { steps, names: Arc::clone(names) }
    }

    pub fn steps(&self) -> &StepSeries {
        &self.steps
    }
}

#[pymethods]
impl PyStepSeries {
    #[doc = stub!("StepSeries.time_ns")]
    #[getter]
    fn time_ns<'py>(&self, py: Python<'py>) -> Vector<'py, u64> {
        let times = self.steps.time_ns.iter().map(|t| u64::try_from(*t).unwrap_or(0));
        arrays::column(py, &times.collect::<Vec<_>>())
    }

    #[doc = stub!("StepSeries.iterations")]
    #[getter]
    fn iterations<'py>(&self, py: Python<'py>) -> Vector<'py, u32> {
        arrays::column(py, &self.steps.iterations)
    }

    #[doc = stub!("StepSeries.residual_qm16")]
    #[getter]
    fn residual_qm16<'py>(&self, py: Python<'py>) -> Vector<'py> {
        arrays::column(py, &self.steps.residual_qm16)
    }

    #[doc = stub!("StepSeries.impulses")]
    #[getter]
    fn impulses<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let impulses = PyDict::new(py);
        for name in self.names.iter() {
            let bodies = self.steps.bodies.iter().filter(|body| body.body == *name);
            let rows = bodies.flat_map(|body| body.impulse.iter().zip(&body.angular_impulse));
            let numbers = rows.flat_map(|(p, l)| [p.x, p.y, p.z, l.x, l.y, l.z]);
            let table: Matrix<'py> = arrays::table(py, &numbers.collect::<Vec<_>>(), 6);
            impulses.set_item(name, table)?;
        }
        Ok(impulses)
    }

    fn __len__(&self) -> usize {
        self.steps.time_ns.len()
    }

    fn __reduce__<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<PickleReduction<'py, PickledSeries<'py>>> {
        let bytes = to_cdr(&self.steps).map_err(malformed)?;
        let arguments = (PyBytes::new(py, &bytes), self.names.to_vec());
        Ok((private_function(py, "_unpickle_step_series")?, arguments))
    }

    fn __repr__(&self) -> String {
        format!("StepSeries({} steps)", self.steps.time_ns.len())
    }
}

type PickledSeries<'py> = (Bound<'py, PyBytes>, Vec<String>);

/// Returns a pickled series of steps.
#[pyfunction]
pub fn _unpickle_step_series(bytes: &[u8], names: Vec<String>) -> PyResult<PyStepSeries> {
    let steps = from_cdr(bytes).map_err(malformed)?;
    Ok(PyStepSeries { steps, names: names.into() })
}
