//! Zones, measured.

use crate::arrays::{self, Vector};
use ballast::component::ZoneResult;
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// Zones by name.
pub fn zones<'py>(py: Python<'py>, measured: &[ZoneResult]) -> PyResult<Bound<'py, PyDict>> {
    let all = PyDict::new(py);
    for zone in measured {
        all.set_item(&zone.name, ZoneMeasure(zone.clone()))?;
    }
    Ok(all)
}

/// A zone at the end of a window; what cannot be measured there is None.
#[pyclass(frozen, module = "ballast", name = "ZoneOutcome")]
pub struct ZoneMeasure(ZoneResult);

#[pymethods]
impl ZoneMeasure {
    /// (3,) lowest corner, m.
    #[getter]
    fn low<'py>(&self, py: Python<'py>) -> Vector<'py> {
        arrays::vector(py, &self.0.region.low)
    }

    /// (3,) highest corner, m.
    #[getter]
    fn high<'py>(&self, py: Python<'py>) -> Vector<'py> {
        arrays::vector(py, &self.0.region.high)
    }

    /// Solid over accessible volume, 0 to 1.
    #[getter]
    fn compactness(&self) -> Option<f64> {
        self.0.compactness
    }

    /// Mean number of touching neighbours.
    #[getter]
    fn coordination(&self) -> Option<f64> {
        self.0.coordination
    }

    /// How fast it flows for its pressure and size of grains (T-22), without unit.
    #[getter]
    fn inertial_number(&self) -> Option<f64> {
        self.0.inertial_number
    }

    /// Mean over the last step, Pa.
    #[getter]
    fn pressure(&self) -> f64 {
        self.0.pressure
    }

    fn __repr__(&self) -> String {
        let compactness = self.0.compactness.map_or("None".into(), |c| format!("{c:.4}"));
        format!("ZoneOutcome({:?}, compactness={compactness})", self.0.name)
    }
}
