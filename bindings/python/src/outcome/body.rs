//! What the ballast did to a body.

use crate::arrays::{self, Vector};
use ballast::component::BodyResult;
use pyo3::prelude::*;

/// What the ballast did to a driven body during a window, about its reference point.
#[pyclass(frozen, module = "ballast", name = "BodyOutcome")]
#[derive(Clone)]
pub struct Body(pub(super) BodyResult);

#[pymethods]
impl Body {
    /// (3,) over the window, N s.
    #[getter]
    fn impulse<'py>(&self, py: Python<'py>) -> Vector<'py> {
        arrays::vector(py, &self.0.impulse)
    }

    /// (3,) over the window, N m s.
    #[getter]
    fn angular_impulse<'py>(&self, py: Python<'py>) -> Vector<'py> {
        arrays::vector(py, &self.0.angular_impulse)
    }

    /// (3,) impulse over the length of the window, N.
    #[getter]
    fn mean_force<'py>(&self, py: Python<'py>) -> Vector<'py> {
        arrays::vector(py, &self.0.mean_force)
    }

    /// (3,) angular impulse over the length of the window, N m.
    #[getter]
    fn mean_torque<'py>(&self, py: Python<'py>) -> Vector<'py> {
        arrays::vector(py, &self.0.mean_torque)
    }

    /// (3,) mean over as many whole steps as 4 ms hold, one at least; may have begun before the window, N.
    #[getter]
    fn moving_force<'py>(&self, py: Python<'py>) -> Vector<'py> {
        arrays::vector(py, &self.0.moving_average_force)
    }

    /// (3,) mean over the same steps, N m.
    #[getter]
    fn moving_torque<'py>(&self, py: Python<'py>) -> Vector<'py> {
        arrays::vector(py, &self.0.moving_average_torque)
    }

    /// (3,) largest mean force of a step, N.
    #[getter]
    fn peak_force<'py>(&self, py: Python<'py>) -> Vector<'py> {
        arrays::vector(py, &self.0.peak_force)
    }

    /// (3,) mean torque of that step, N m.
    #[getter]
    fn peak_torque<'py>(&self, py: Python<'py>) -> Vector<'py> {
        arrays::vector(py, &self.0.peak_torque)
    }

    /// End of that step, ns since the start of the run; the beginning of the window where no force acted.
    #[getter]
    fn peak_time_ns(&self) -> u64 {
        self.0.peak_time_ns
    }

    /// Of the body on the ballast, J.
    #[getter]
    fn work(&self) -> f64 {
        self.0.work
    }

    /// Contact points that carried an impulse in the last step.
    #[getter]
    fn contacts(&self) -> u32 {
        self.0.contacts
    }

    /// (3,) at the end of the window, m.
    #[getter]
    fn position<'py>(&self, py: Python<'py>) -> Vector<'py> {
        arrays::vector(py, &self.0.pose.position)
    }

    /// (4,) at the end of the window, x, y, z, w.
    #[getter]
    fn orientation<'py>(&self, py: Python<'py>) -> Vector<'py> {
        arrays::quaternion(py, &self.0.pose.orientation)
    }

    /// (3,) at the end of the window, m/s.
    #[getter]
    fn velocity<'py>(&self, py: Python<'py>) -> Vector<'py> {
        arrays::vector(py, &self.0.velocity)
    }

    /// (3,) at the end of the window, rad/s.
    #[getter]
    fn angular_velocity<'py>(&self, py: Python<'py>) -> Vector<'py> {
        arrays::vector(py, &self.0.angular_velocity)
    }

    fn __repr__(&self) -> String {
        let f = self.0.mean_force;
        format!(
            "BodyOutcome(mean_force=[{:.3e}, {:.3e}, {:.3e}] N, work={:.3e} J)",
            f.x, f.y, f.z, self.0.work
        )
    }
}
