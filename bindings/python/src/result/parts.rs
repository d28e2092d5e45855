//! Parts of a window's result: bodies, zones, squeezes, solver and energy.

use super::{PickleReduction, malformed, private_function};
use crate::arrays::{self, Matrix, Vector};
use ballast_protocol::messages::{
    EnergyBalance, Message, SolverStats, SqueezeReport, Vector3, WrenchImpulse, ZoneMeasurement,
};
use ballast_protocol::{from_cdr, to_cdr};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};

type PickledPart<'py> = (&'static str, Bound<'py, PyBytes>);

/// Pickles a part as its message in CDR.
fn reduce<'py, M: Message>(
    py: Python<'py>,
    kind: &'static str,
    message: &M,
) -> PyResult<PickleReduction<'py, PickledPart<'py>>> {
    let bytes = to_cdr(message).map_err(malformed)?;
    Ok((private_function(py, "_unpickle_part")?, (kind, PyBytes::new(py, &bytes))))
}

/// Returns a pickled part; `kind` is the name of its class.
#[pyfunction]
pub fn _unpickle_part<'py>(
    py: Python<'py>,
    kind: &str,
    bytes: &[u8],
) -> PyResult<Bound<'py, PyAny>> {
    fn message<M: Message>(bytes: &[u8]) -> PyResult<M> {
        from_cdr(bytes).map_err(malformed)
    }
    Ok(match kind {
        "BodyResult" => PyBodyResult(message(bytes)?).into_pyobject(py)?.into_any(),
        "EnergyLedger" => PyEnergyLedger(message(bytes)?).into_pyobject(py)?.into_any(),
        "SolverResult" => PySolverResult(message(bytes)?).into_pyobject(py)?.into_any(),
        "Squeeze" => PySqueeze(message(bytes)?).into_pyobject(py)?.into_any(),
        "ZoneResult" => PyZoneResult(message(bytes)?).into_pyobject(py)?.into_any(),
        _ => return Err(PyValueError::new_err(format!("expected a result, found {kind:?}"))),
    })
}

/// Implements getters of a class that wraps a message, its pickling, and the methods after the semicolon.
macro_rules! message_class {
    ($class:ident($kind:literal): $($(#[$doc:meta])* $name:ident: $type:ty = |$this:pat_param, $py:pat_param| $value:expr,)*; $($more:item)*) => {
        #[pymethods]
        impl $class {
            $($(#[$doc])*
            #[getter]
            fn $name<'py>(&self, py: Python<'py>) -> $type {
                let ($this, $py) = (&self.0, py);
                $value
            })*

            fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<PickleReduction<'py, PickledPart<'py>>> {
                reduce(py, $kind, &self.0)
            }

            $($more)*
        }
    };
}

fn vector<'py>(py: Python<'py>, v: Vector3) -> Vector<'py> {
    arrays::column(py, &[v.x, v.y, v.z])
}

/// Action of the ballast on a driven body during a window, about its reference point, world axes.
#[pyclass(frozen, module = "ballast", name = "BodyResult")]
pub struct PyBodyResult(pub WrenchImpulse);

message_class!(PyBodyResult("BodyResult"):
    /// Impulse of the ballast on the body over the window (3,), N s.
    impulse: Vector<'py> = |m, py| vector(py, m.impulse),
    /// Angular impulse of the ballast on the body over the window (3,), N m s.
    angular_impulse: Vector<'py> = |m, py| vector(py, m.angular_impulse),
    /// Mean force over the window (3,), N: the impulse divided by the length of the window.
    mean_force: Vector<'py> = |m, py| vector(py, m.mean.force),
    /// Mean torque over the window (3,), N m.
    mean_torque: Vector<'py> = |m, py| vector(py, m.mean.torque),
    /// Mean force over the last 4 ms in whole steps, at least one (3,), N; may include steps before the window.
    moving_average_force: Vector<'py> = |m, py| vector(py, m.moving_average.force),
    /// Mean torque over the last 4 ms in whole steps, at least one (3,), N m; may include steps before the window.
    moving_average_torque: Vector<'py> = |m, py| vector(py, m.moving_average.torque),
    /// Largest mean force of a single step (3,), N.
    peak_force: Vector<'py> = |m, py| vector(py, m.peak_force),
    /// Mean torque of the step with the peak force (3,), N m.
    peak_torque: Vector<'py> = |m, py| vector(py, m.peak_torque),
    /// End of the step with the peak force, ns since the start of the run; the window's start if no force acted.
    peak_time_ns: i64 = |m, _| m.peak_time_ns,
    /// Work of the body on the ballast, J.
    work: f64 = |m, _| m.work,
    /// Number of contact points with an impulse in the last step.
    contacts: u32 = |m, _| m.contacts,
    /// Position at the end of the window (3,), m.
    position: Vector<'py> = |m, py| {
        let p = m.pose.position;
        arrays::column(py, &[p.x, p.y, p.z])
    },
    /// Orientation at the end of the window (4,), x, y, z, w.
    orientation: Vector<'py> = |m, py| {
        let q = m.pose.orientation;
        arrays::column(py, &[q.x, q.y, q.z, q.w])
    },
    /// Velocity at the end of the window (3,), m/s.
    velocity: Vector<'py> = |m, py| vector(py, m.twist.linear),
    /// Angular velocity at the end of the window (3,), rad/s.
    angular_velocity: Vector<'py> = |m, py| vector(py, m.twist.angular),;

    fn __repr__(&self) -> String {
        let f = self.0.mean.force;
        format!(
            "BodyResult(mean_force=[{:.3e}, {:.3e}, {:.3e}] N, work={:.3e} J)",
            f.x, f.y, f.z, self.0.work
        )
    }
);

/// Returns a dictionary of zones by name.
pub fn zones(
    py: Python<'_>,
    zones: impl Iterator<Item = ZoneMeasurement>,
) -> PyResult<Bound<'_, PyDict>> {
    let by_name = PyDict::new(py);
    for zone in zones {
        by_name.set_item(zone.zone.clone(), PyZoneResult(zone))?;
    }
    Ok(by_name)
}

/// Returns a measured value; messages have NaN for values that cannot be measured.
fn measured(value: f64) -> Option<f64> {
    (!value.is_nan()).then_some(value)
}

/// Measurements of a zone at the end of a window; values that cannot be measured are None.
#[pyclass(frozen, module = "ballast", name = "ZoneResult")]
pub struct PyZoneResult(ZoneMeasurement);

message_class!(PyZoneResult("ZoneResult"):
    /// Lowest corner of the zone (3,), m.
    low: Vector<'py> = |m, py| arrays::column(py, &[m.low.x, m.low.y, m.low.z]),
    /// Highest corner of the zone (3,), m.
    high: Vector<'py> = |m, py| arrays::column(py, &[m.high.x, m.high.y, m.high.z]),
    /// Compactness: solid volume divided by accessible volume, 0 to 1.
    compactness: Option<f64> = |m, _| measured(m.compactness),
    /// Mean number of touching neighbours per grain.
    coordination: Option<f64> = |m, _| measured(m.coordination),
    /// Inertial number of the granular flow (T-22), dimensionless.
    inertial_number: Option<f64> = |m, _| measured(m.inertial_number),
    /// Mean pressure in the last step, Pa.
    pressure: f64 = |m, _| m.mean_pressure,;

    fn __repr__(&self) -> String {
        let compactness = measured(self.0.compactness);
        let compactness = compactness.map_or("None".into(), |c| format!("{c:.4}"));
        format!("ZoneResult({:?}, compactness={compactness})", self.0.zone)
    }
);

/// Squeeze of a pair of facing tines, measured up to the last complete vibration period.
#[pyclass(frozen, module = "ballast", name = "Squeeze")]
pub struct PySqueeze(pub SqueezeReport);

message_class!(PySqueeze("Squeeze"):
    /// Number of the squeeze for its pair, from 1.
    number: u32 = |m, _| m.number,
    /// True when the pair has opened again.
    is_finished: bool = |m, _| m.is_finished,
    /// Time of the pair's widest opening, ns since the start of the run; closings are measured from there.
    start_ns: i64 = |m, _| m.start_ns,
    /// Time at which ballast resistance starts: end of the first vibration period with sustained force, ns; `None` before.
    onset_ns: Option<i64> = |m, _| (m.onset_ns != -1).then_some(m.onset_ns),
    /// Closing of one side, averaged over the last vibration period, m.
    closing: f64 = |m, _| m.closing,
    /// Largest force of one side, averaged over a vibration period, N.
    peak_force: f64 = |m, _| m.peak_force,
    /// Largest force of one side in a single step, N.
    peak_step_force: f64 = |m, _| m.peak_step_force,
    /// Work of both tines on the ballast after the first 2 mm of closing, including vibration, J.
    work: f64 = |m, _| m.work,
    /// Work of the period-averaged force along the largest closing, both sides, J.
    compaction_energy: f64 = |m, _| m.compaction_energy,
    /// Force-displacement loop (n, 2): closing (m) and period-averaged force (N) of one side.
    r#loop: Matrix<'py> = |m, py| {
        let points = m.loop_closing.iter().zip(&m.loop_force);
        let numbers: Vec<f64> = points.flat_map(|(closing, force)| [*closing, *force]).collect();
        arrays::table(py, &numbers, 2)
    },;

    fn __repr__(&self) -> String {
        let SqueezeReport { pair, number, closing, peak_force, .. } = &self.0;
        format!(
            "Squeeze({pair:?}, number {number}, closing={closing:.4} m, peak_force={peak_force:.3e} N)"
        )
    }
);

/// Result of the contact solver in a window.
#[pyclass(frozen, module = "ballast", name = "SolverResult")]
pub struct PySolverResult(pub SolverStats);

message_class!(PySolverResult("SolverResult"):
    /// Number of iterations over all steps.
    iterations: u64 = |m, _| m.iterations,
    /// Number of local contact solves over all steps.
    visits: u64 = |m, _| m.visits,
    /// Number of steps that stopped at their iteration cap above the tolerance; 0 without a tolerance.
    steps_not_converged: u64 = |m, _| m.steps_not_converged,
    /// Largest QM/16 residual of a step, dimensionless.
    residual_qm16: f64 = |m, _| m.residual_qm16,
    /// Largest natural-map residual of a step, dimensionless.
    residual_natural_map: f64 = |m, _| m.residual_natural_map,
    /// Number of contacts in the last step.
    contacts: u64 = |m, _| m.contacts,
    /// Number of active contacts in the last step.
    active_contacts: u64 = |m, _| m.active_contacts,
    /// Mean penetration in the last step, m.
    mean_penetration: f64 = |m, _| m.mean_penetration,
    /// Largest penetration of all steps, m.
    max_penetration: f64 = |m, _| m.max_penetration,;

    fn __repr__(&self) -> String {
        let SolverStats { iterations, steps_not_converged, residual_qm16, max_penetration, .. } = self.0;
        format!(
            "SolverResult({iterations} iterations, {steps_not_converged} steps not converged, \
             residual_qm16={residual_qm16:.1e}, max_penetration={max_penetration:.1e} m)"
        )
    }
);

/// Energies of the grains since the start of the run, J.
#[pyclass(frozen, module = "ballast", name = "EnergyLedger")]
pub struct PyEnergyLedger(pub EnergyBalance);

message_class!(PyEnergyLedger("EnergyLedger"):
    /// Kinetic energy at the start of the run, J.
    initial_kinetic: f64 = |m, _| m.initial_kinetic,
    /// Potential energy at the start of the run, J.
    initial_potential: f64 = |m, _| m.initial_potential,
    /// Current kinetic energy, J.
    kinetic: f64 = |m, _| m.kinetic,
    /// Current potential energy, J.
    potential: f64 = |m, _| m.potential,
    /// Work of the driven bodies on the grains, J.
    external_work: f64 = |m, _| m.external_work,
    /// Energy dissipated by friction and impacts, J.
    dissipated: f64 = |m, _| m.dissipated,
    /// Energy that the ledger cannot account for, J.
    balance_error: f64 = |m, _| m.balance_error,;

    fn __repr__(&self) -> String {
        let EnergyBalance { kinetic, potential, external_work, dissipated, .. } = self.0;
        format!(
            "EnergyLedger(kinetic={kinetic:.3e} J, potential={potential:.3e} J, \
             external_work={external_work:.3e} J, dissipated={dissipated:.3e} J)"
        )
    }
);
