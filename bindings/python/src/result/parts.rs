//! Parts of a window's result: bodies, zones, squeezes, solver and energy.

use super::{PickleReduction, malformed, private_function};
use crate::arrays::{self, Matrix, Vector};
use ballast_protocol::messages::{
    EnergyLedger, Message, SolverStats, SqueezeReport, Vector3, WrenchImpulse, ZoneMeasurement,
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

#[doc = stub!("BodyResult")]
#[pyclass(frozen, module = "ballast", name = "BodyResult")]
pub struct PyBodyResult(pub WrenchImpulse);

message_class!(PyBodyResult("BodyResult"):
    #[doc = stub!("BodyResult.impulse")]
    impulse: Vector<'py> = |m, py| vector(py, m.impulse),
    #[doc = stub!("BodyResult.angular_impulse")]
    angular_impulse: Vector<'py> = |m, py| vector(py, m.angular_impulse),
    #[doc = stub!("BodyResult.mean_force")]
    mean_force: Vector<'py> = |m, py| vector(py, m.mean.force),
    #[doc = stub!("BodyResult.mean_torque")]
    mean_torque: Vector<'py> = |m, py| vector(py, m.mean.torque),
    #[doc = stub!("BodyResult.moving_average_force")]
    moving_average_force: Vector<'py> = |m, py| vector(py, m.moving_average.force),
    #[doc = stub!("BodyResult.moving_average_torque")]
    moving_average_torque: Vector<'py> = |m, py| vector(py, m.moving_average.torque),
    #[doc = stub!("BodyResult.peak_force")]
    peak_force: Vector<'py> = |m, py| vector(py, m.peak_force),
    #[doc = stub!("BodyResult.peak_torque")]
    peak_torque: Vector<'py> = |m, py| vector(py, m.peak_torque),
    #[doc = stub!("BodyResult.peak_time_ns")]
    peak_time_ns: i64 = |m, _| m.peak_time_ns,
    #[doc = stub!("BodyResult.work")]
    work: f64 = |m, _| m.work,
    #[doc = stub!("BodyResult.contacts")]
    contacts: u32 = |m, _| m.contacts,
    #[doc = stub!("BodyResult.position")]
    position: Vector<'py> = |m, py| {
        let p = m.pose.position;
        arrays::column(py, &[p.x, p.y, p.z])
    },
    #[doc = stub!("BodyResult.orientation")]
    orientation: Vector<'py> = |m, py| {
        let q = m.pose.orientation;
        arrays::column(py, &[q.x, q.y, q.z, q.w])
    },
    #[doc = stub!("BodyResult.velocity")]
    velocity: Vector<'py> = |m, py| vector(py, m.twist.linear),
    #[doc = stub!("BodyResult.angular_velocity")]
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

#[doc = stub!("ZoneResult")]
#[pyclass(frozen, module = "ballast", name = "ZoneResult")]
pub struct PyZoneResult(ZoneMeasurement);

message_class!(PyZoneResult("ZoneResult"):
    #[doc = stub!("ZoneResult.low")]
    low: Vector<'py> = |m, py| arrays::column(py, &[m.low.x, m.low.y, m.low.z]),
    #[doc = stub!("ZoneResult.high")]
    high: Vector<'py> = |m, py| arrays::column(py, &[m.high.x, m.high.y, m.high.z]),
    #[doc = stub!("ZoneResult.compactness")]
    compactness: Option<f64> = |m, _| measured(m.compactness),
    #[doc = stub!("ZoneResult.coordination")]
    coordination: Option<f64> = |m, _| measured(m.coordination),
    #[doc = stub!("ZoneResult.inertial_number")]
    inertial_number: Option<f64> = |m, _| measured(m.inertial_number),
    #[doc = stub!("ZoneResult.pressure")]
    pressure: f64 = |m, _| m.mean_pressure,;

    fn __repr__(&self) -> String {
        let compactness = measured(self.0.compactness);
        let compactness = compactness.map_or("None".into(), |c| format!("{c:.4}"));
        format!("ZoneResult({:?}, compactness={compactness})", self.0.zone)
    }
);

#[doc = stub!("Squeeze")]
#[pyclass(frozen, module = "ballast", name = "Squeeze")]
pub struct PySqueeze(pub SqueezeReport);

message_class!(PySqueeze("Squeeze"):
    #[doc = stub!("Squeeze.number")]
    number: u32 = |m, _| m.number,
    #[doc = stub!("Squeeze.is_finished")]
    is_finished: bool = |m, _| m.is_finished,
    #[doc = stub!("Squeeze.start_ns")]
    start_ns: i64 = |m, _| m.start_ns,
    #[doc = stub!("Squeeze.onset_ns")]
    onset_ns: Option<i64> = |m, _| (m.onset_ns != -1).then_some(m.onset_ns),
    #[doc = stub!("Squeeze.closing")]
    closing: f64 = |m, _| m.closing,
    #[doc = stub!("Squeeze.peak_force")]
    peak_force: f64 = |m, _| m.peak_force,
    #[doc = stub!("Squeeze.peak_step_force")]
    peak_step_force: f64 = |m, _| m.peak_step_force,
    #[doc = stub!("Squeeze.work")]
    work: f64 = |m, _| m.work,
    #[doc = stub!("Squeeze.compaction_energy")]
    compaction_energy: f64 = |m, _| m.compaction_energy,
    #[doc = stub!("Squeeze.loop")]
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

#[doc = stub!("SolverResult")]
#[pyclass(frozen, module = "ballast", name = "SolverResult")]
pub struct PySolverResult(pub SolverStats);

message_class!(PySolverResult("SolverResult"):
    #[doc = stub!("SolverResult.iterations")]
    iterations: u64 = |m, _| m.iterations,
    #[doc = stub!("SolverResult.visits")]
    visits: u64 = |m, _| m.visits,
    #[doc = stub!("SolverResult.steps_not_converged")]
    steps_not_converged: u64 = |m, _| m.steps_not_converged,
    #[doc = stub!("SolverResult.residual_qm16")]
    residual_qm16: f64 = |m, _| m.residual_qm16,
    #[doc = stub!("SolverResult.residual_natural_map")]
    residual_natural_map: f64 = |m, _| m.residual_natural_map,
    #[doc = stub!("SolverResult.contacts")]
    contacts: u64 = |m, _| m.contacts,
    #[doc = stub!("SolverResult.active_contacts")]
    active_contacts: u64 = |m, _| m.active_contacts,
    #[doc = stub!("SolverResult.mean_penetration")]
    mean_penetration: f64 = |m, _| m.mean_penetration,
    #[doc = stub!("SolverResult.max_penetration")]
    max_penetration: f64 = |m, _| m.max_penetration,
    #[doc = stub!("SolverResult.force_difference")]
    force_difference: f64 = |m, _| m.force_difference,
    #[doc = stub!("SolverResult.force_compared")]
    force_compared: f64 = |m, _| m.force_compared,
    #[doc = stub!("SolverResult.force_error")]
    force_error: Option<f64> =
        |m, _| (m.force_compared > 0.0).then(|| m.force_difference / m.force_compared),
    #[doc = stub!("SolverResult.complementarity_gap")]
    complementarity_gap: f64 = |m, _| m.complementarity_gap,
    #[doc = stub!("SolverResult.infeasible_work")]
    infeasible_work: f64 = |m, _| m.infeasible_work,
    #[doc = stub!("SolverResult.dissipated")]
    dissipated: f64 = |m, _| m.dissipated,
    #[doc = stub!("SolverResult.complementarity_error")]
    complementarity_error: Option<f64> = |m, _| {
        (m.dissipated > 0.0).then(|| (m.complementarity_gap + m.infeasible_work) / m.dissipated)
    },;

    fn __repr__(&self) -> String {
        let SolverStats { iterations, steps_not_converged, residual_qm16, max_penetration, .. } = self.0;
        format!(
            "SolverResult({iterations} iterations, {steps_not_converged} steps not converged, \
             residual_qm16={residual_qm16:.1e}, max_penetration={max_penetration:.1e} m)"
        )
    }
);

#[doc = stub!("EnergyLedger")]
#[pyclass(frozen, module = "ballast", name = "EnergyLedger")]
pub struct PyEnergyLedger(pub EnergyLedger);

message_class!(PyEnergyLedger("EnergyLedger"):
    #[doc = stub!("EnergyLedger.initial_kinetic")]
    initial_kinetic: f64 = |m, _| m.initial_kinetic,
    #[doc = stub!("EnergyLedger.initial_potential")]
    initial_potential: f64 = |m, _| m.initial_potential,
    #[doc = stub!("EnergyLedger.initial_elastic")]
    initial_elastic: f64 = |m, _| m.initial_elastic,
    #[doc = stub!("EnergyLedger.kinetic")]
    kinetic: f64 = |m, _| m.kinetic,
    #[doc = stub!("EnergyLedger.potential")]
    potential: f64 = |m, _| m.potential,
    #[doc = stub!("EnergyLedger.elastic")]
    elastic: f64 = |m, _| m.elastic,
    #[doc = stub!("EnergyLedger.external_work")]
    external_work: f64 = |m, _| m.external_work,
    #[doc = stub!("EnergyLedger.dissipated")]
    dissipated: f64 = |m, _| m.dissipated,
    #[doc = stub!("EnergyLedger.balance_error")]
    balance_error: f64 = |m, _| m.balance_error,;

    fn __repr__(&self) -> String {
        let EnergyLedger { kinetic, potential, external_work, dissipated, .. } = self.0;
        format!(
            "EnergyLedger(kinetic={kinetic:.3e} J, potential={potential:.3e} J, \
             external_work={external_work:.3e} J, dissipated={dissipated:.3e} J)"
        )
    }
);
