//! A window step by step.

use crate::arrays::{self, Matrix, Vector};
use ballast_protocol::messages::StepSeries;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::sync::Arc;

/// A window step by step.
#[pyclass(frozen, module = "ballast")]
pub struct Series {
    steps: StepSeries,
    /// Of the driven bodies `[nd]`, also where the window has no step.
    names: Arc<[String]>,
}

impl Series {
    pub fn new(steps: StepSeries, names: &Arc<[String]>) -> Self {
        Self { steps, names: Arc::clone(names) }
    }
}

#[pymethods]
impl Series {
    /// (n,) end of each step, ns.
    #[getter]
    fn time_ns<'py>(&self, py: Python<'py>) -> Vector<'py, u64> {
        let times = self.steps.time_ns.iter().map(|t| u64::try_from(*t).unwrap_or(0));
        arrays::column(py, &times.collect::<Vec<_>>())
    }

    /// (n,) of each step.
    #[getter]
    fn iterations<'py>(&self, py: Python<'py>) -> Vector<'py, u32> {
        arrays::column(py, &self.steps.iterations)
    }

    /// (n,) at the end of each step, without unit.
    #[getter]
    fn residual_qm16<'py>(&self, py: Python<'py>) -> Vector<'py> {
        arrays::column(py, &self.steps.residual_qm16)
    }

    /// (n, 6) per body: impulse (N s) and angular impulse (N m s) of each step.
    #[getter]
    fn impulses<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let all = PyDict::new(py);
        for name in self.names.iter() {
            let bodies = self.steps.bodies.iter().filter(|body| body.body == *name);
            let rows = bodies.flat_map(|body| body.impulse.iter().zip(&body.angular_impulse));
            let numbers = rows.flat_map(|(p, l)| [p.x, p.y, p.z, l.x, l.y, l.z]);
            let table: Matrix<'py> = arrays::table(py, &numbers.collect::<Vec<_>>(), 6);
            all.set_item(name, table)?;
        }
        Ok(all)
    }

    fn __len__(&self) -> usize {
        self.steps.time_ns.len()
    }
    fn __repr__(&self) -> String {
        format!("Series({} steps)", self.steps.time_ns.len())
    }
}
