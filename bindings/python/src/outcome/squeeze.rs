//! Squeezes.

use crate::arrays::{self, Matrix};
use ballast::observe::SqueezeOutcome;
use pyo3::prelude::*;

/// What a pair of facing tines has done in a squeeze, up to the last whole vibration period.
#[pyclass(frozen, module = "ballast")]
pub struct Squeeze(pub(super) SqueezeOutcome);

#[pymethods]
impl Squeeze {
    /// Of the pair, from 1 on.
    #[getter]
    fn number(&self) -> u32 {
        self.0.record.number
    }

    /// The pair has opened again.
    #[getter]
    fn is_over(&self) -> bool {
        self.0.is_over
    }

    /// When the pair was at its widest, ns; closings are counted from there.
    #[getter]
    fn began_ns(&self) -> u64 {
        self.0.record.began_ns
    }

    /// End of the period since which the ballast resists, or did so last, ns.
    #[getter]
    fn onset_ns(&self) -> Option<u64> {
        self.0.record.onset_ns
    }

    /// Of a side, mean over the last period, m.
    #[getter]
    fn closing(&self) -> f64 {
        self.0.record.closing
    }

    /// Largest mean force of a side over a period, N.
    #[getter]
    fn peak_force(&self) -> f64 {
        self.0.record.peak_force
    }

    /// Largest force of a single step, N.
    #[getter]
    fn peak_step_force(&self) -> f64 {
        self.0.record.peak_step_force
    }

    /// Of the pair's tines on the ballast since it had closed by 2 mm, vibration included, J.
    #[getter]
    fn work(&self) -> f64 {
        self.0.record.work
    }

    /// Work of the mean force along the closing as far as it came, both sides, J.
    #[getter]
    fn compaction_energy(&self) -> f64 {
        self.0.record.compaction_energy
    }

    /// (n, 2) closing (m) and mean force (N) of a side, one row per period or per few of them.
    #[getter]
    fn r#loop<'py>(&self, py: Python<'py>) -> Matrix<'py> {
        arrays::table(py, self.0.record.loop_points.as_flattened(), 2)
    }

    fn __repr__(&self) -> String {
        let record = &self.0.record;
        format!(
            "Squeeze({:?}, number {}, closing={:.4} m, peak_force={:.3e} N)",
            self.0.name, record.number, record.closing, record.peak_force
        )
    }
}
