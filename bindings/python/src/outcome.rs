//! What a window did.

use crate::arrays::{self, Matrix, Vector};
use ballast::component::{self, BodyOutcome, SolverOutcome, ZoneOutcome};
use ballast::observe::SqueezeOutcome;
use ballast::state::{EnergyLedger, State};
use ballast::step::StepReport;
use ballast_protocol::messages::{StepSeries, core_ns};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::sync::Arc;

/// What ended a window, for programs and for people.
pub struct Trouble {
    pub code: String,
    pub text: String,
}

/// The result of a window; `outcome[name]` is what the ballast did to a body.
#[pyclass(frozen, module = "ballast")]
pub struct Outcome {
    pub inner: component::Outcome,
    /// What ended the window, where something did.
    pub trouble: Option<Trouble>,
    /// How long the window took, s: to compute, or elsewhere until it was answered.
    pub wall_s: f64,
    /// Of the driven bodies `[nd]`.
    pub names: Arc<[String]>,
    pub series: Option<Py<Series>>,
}

impl Outcome {
    /// The number of a driven body.
    fn body(&self, name: &str) -> Option<usize> {
        self.names.iter().position(|known| known == name)
    }
}

#[pymethods]
impl Outcome {
    /// "ok"; "warn": a step stopped at its cap of iterations; "early": ended before its end, in a valid
    /// state; "discard": nothing was kept.
    #[getter]
    fn status(&self) -> &'static str {
        self.inner.status.name()
    }

    /// What ended the window, where something did.
    #[getter]
    fn trouble(&self) -> Option<&str> {
        self.trouble.as_ref().map(|trouble| &trouble.text[..])
    }

    /// What ended the window, for programs: "over_speed", "penetration", "not_finite", "step_failed"; of
    /// a component elsewhere also "deadline".
    #[getter]
    fn code(&self) -> Option<&str> {
        self.trouble.as_ref().map(|trouble| &trouble.code[..])
    }

    /// Where it began, ns since the start of the run.
    #[getter]
    fn t0_ns(&self) -> u64 {
        self.inner.t0_ns
    }

    /// As far as it was computed, ns.
    #[getter]
    fn t1_ns(&self) -> u64 {
        self.inner.t1_ns
    }

    /// How many were computed.
    #[getter]
    fn steps(&self) -> u64 {
        self.inner.steps
    }

    /// What the ballast did to each driven body, by name.
    #[getter]
    fn bodies<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let all = PyDict::new(py);
        for (name, body) in self.names.iter().zip(&self.inner.bodies) {
            all.set_item(name, Body(*body))?;
        }
        Ok(all)
    }

    /// At the end of the window, where `zones=True` asked for them.
    #[getter]
    fn zones<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        zones(py, &self.inner.zones)
    }

    /// Squeezes that were in progress, by pair of tines ("pair_0"); of two of a pair the later one. How they are told
    /// apart: docs/coupling.md.
    #[getter]
    fn squeezes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let all = PyDict::new(py);
        for squeeze in &self.inner.squeezes {
            all.set_item(&squeeze.name, Squeeze(squeeze.clone()))?;
        }
        Ok(all)
    }

    /// How it was solved.
    #[getter]
    fn solver(&self) -> Solver {
        Solver(self.inner.solver)
    }

    /// Since the start of the run.
    #[getter]
    fn energy(&self) -> Energy {
        Energy(self.inner.energy)
    }

    /// How far apart knots may be for no body to move too far between them at its speed now, ns;
    /// 0 where nothing moves.
    #[getter]
    fn hint_max_step_ns(&self) -> u64 {
        self.inner.hint_max_step_ns
    }

    /// How long the window took to compute, s of wall time; elsewhere: until it was answered.
    #[getter]
    fn wall_s(&self) -> f64 {
        self.wall_s
    }

    /// Step by step, where `series=True` asked for it.
    #[getter]
    fn series(&self, py: Python<'_>) -> Option<Py<Series>> {
        self.series.as_ref().map(|s| s.clone_ref(py))
    }

    fn __getitem__(&self, name: &str) -> PyResult<Body> {
        let body = self.body(name).map(|d| Body(self.inner.bodies[d]));
        // Python quotes the text of a KeyError, with whatever it has of quotes.
        body.ok_or_else(|| {
            let text = format!("body: expected one of {}, found {name}", self.names.join(", "));
            pyo3::exceptions::PyKeyError::new_err(text)
        })
    }

    fn __contains__(&self, name: &Bound<'_, PyAny>) -> bool {
        name.extract().is_ok_and(|name: &str| self.body(name).is_some())
    }

    fn __repr__(&self) -> String {
        let component::Outcome { t0_ns, t1_ns, steps, .. } = self.inner;
        format!("Outcome({}, {t0_ns} to {t1_ns} ns, {steps} steps)", self.status())
    }
}

/// Zones by name.
pub fn zones<'py>(py: Python<'py>, measured: &[ZoneOutcome]) -> PyResult<Bound<'py, PyDict>> {
    let all = PyDict::new(py);
    for zone in measured {
        all.set_item(&zone.name, ZoneMeasure(zone.clone()))?;
    }
    Ok(all)
}

/// What the ballast did to a driven body during a window, about its reference point.
#[pyclass(frozen, module = "ballast", name = "BodyOutcome")]
#[derive(Clone)]
pub struct Body(BodyOutcome);

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
        arrays::vector(py, &self.0.moving_force)
    }

    /// (3,) mean over the same steps, N m.
    #[getter]
    fn moving_torque<'py>(&self, py: Python<'py>) -> Vector<'py> {
        arrays::vector(py, &self.0.moving_torque)
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
    fn spin<'py>(&self, py: Python<'py>) -> Vector<'py> {
        arrays::vector(py, &self.0.spin)
    }

    fn __repr__(&self) -> String {
        let f = self.0.mean_force;
        format!(
            "BodyOutcome(mean_force=[{:.3e}, {:.3e}, {:.3e}] N, work={:.3e} J)",
            f.x, f.y, f.z, self.0.work
        )
    }
}

/// A zone at the end of a window; what cannot be measured there is None.
#[pyclass(frozen, module = "ballast", name = "ZoneOutcome")]
pub struct ZoneMeasure(ZoneOutcome);

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

/// What a pair of facing tines has done in a squeeze, up to the last whole vibration period.
#[pyclass(frozen, module = "ballast")]
pub struct Squeeze(SqueezeOutcome);

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

/// Getters of plain numbers.
macro_rules! numbers {
    ($class:ident: $($(#[$doc:meta])* $name:ident: $kind:ty),* $(,)?; $($more:item)*) => {
        #[pymethods]
        impl $class {
            $($(#[$doc])*
            #[getter]
            fn $name(&self) -> $kind {
                self.0.$name
            })*
            $($more)*
        }
    };
}

/// How a window was solved.
#[pyclass(frozen, module = "ballast", name = "SolverOutcome")]
pub struct Solver(SolverOutcome);

numbers!(Solver:
    /// Over all steps.
    iterations: u64,
    /// Of contacts, over all steps.
    visits: u64,
    /// Steps that stopped at their cap of iterations.
    steps_not_converged: u64,
    /// Largest of a step, without unit.
    residual_qm16: f64,
    /// Largest of a step, without unit.
    residual_natural_map: f64,
    /// In the last step.
    contacts: usize,
    /// Those that carry, in the last step.
    active_contacts: usize,
    /// Of the last step, m.
    mean_penetration: f64,
    /// Largest of all steps, m.
    max_penetration: f64;
);

/// Energies of the grains since the start of the run, J.
#[pyclass(frozen, module = "ballast", name = "EnergyLedger")]
pub struct Energy(EnergyLedger);

numbers!(Energy:
    /// At the start of the run, J.
    initial_kinetic: f64,
    /// At the start of the run, J.
    initial_potential: f64,
    /// Now, J.
    kinetic: f64,
    /// Now, J.
    potential: f64,
    /// Work of driven bodies on the grains, J.
    work_in: f64,
    /// By friction and in impacts, J.
    dissipated: f64;

    /// What the ledger cannot account for, J.
    #[getter]
    fn balance_error(&self) -> f64 {
        self.0.balance_error()
    }
);

/// A window step by step.
#[pyclass(frozen, module = "ballast")]
#[derive(Default)]
pub struct Series {
    time_ns: Vec<u64>,
    iterations: Vec<u32>,
    residual_qm16: Vec<f64>,
    /// Impulse and angular impulse per body and step `[steps][nd]`.
    impulses: Vec<[f64; 6]>,
    names: Arc<[String]>,
}

impl Series {
    pub fn new(names: &Arc<[String]>) -> Self {
        Self { names: Arc::clone(names), ..Self::default() }
    }

    pub fn take(&mut self, state: &State, report: &StepReport) {
        self.time_ns.push(state.time_ns);
        self.iterations.push(report.iterations);
        self.residual_qm16.push(report.residuals.qm16());
        for reaction in &report.reactions {
            let (p, l) = (reaction.impulse, reaction.angular_impulse);
            self.impulses.push([p.x, p.y, p.z, l.x, l.y, l.z]);
        }
    }

    /// As a component elsewhere tells it.
    pub fn told(names: &Arc<[String]>, series: &StepSeries) -> Self {
        let row = |step: usize, name: &String| {
            let body = series.bodies.iter().find(|b| b.body == *name)?;
            let (p, l) = (body.impulse.get(step)?, body.angular_impulse.get(step)?);
            Some([p.x, p.y, p.z, l.x, l.y, l.z])
        };
        let steps = 0..series.time_ns.len();
        let rows = steps.flat_map(|step| names.iter().map(move |name| (step, name)));
        Self {
            time_ns: series.time_ns.iter().map(|t| core_ns(*t)).collect(),
            iterations: series.iterations.clone(),
            residual_qm16: series.residual_qm16.clone(),
            impulses: rows.map(|(step, name)| row(step, name).unwrap_or([f64::NAN; 6])).collect(),
            names: Arc::clone(names),
        }
    }
}

#[pymethods]
impl Series {
    /// (n,) end of each step, ns.
    #[getter]
    fn time_ns<'py>(&self, py: Python<'py>) -> Vector<'py, u64> {
        arrays::column(py, &self.time_ns)
    }

    /// (n,) of each step.
    #[getter]
    fn iterations<'py>(&self, py: Python<'py>) -> Vector<'py, u32> {
        arrays::column(py, &self.iterations)
    }

    /// (n,) at the end of each step, without unit.
    #[getter]
    fn residual_qm16<'py>(&self, py: Python<'py>) -> Vector<'py> {
        arrays::column(py, &self.residual_qm16)
    }

    /// (n, 6) per body: impulse (N s) and angular impulse (N m s) of each step.
    #[getter]
    fn impulses<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let all = PyDict::new(py);
        let bodies = self.names.len();
        for (d, name) in self.names.iter().enumerate() {
            let rows = self.impulses.iter().skip(d).step_by(bodies);
            let numbers: Vec<f64> = rows.flatten().copied().collect();
            let table: Matrix<'py> = arrays::table(py, &numbers, 6);
            all.set_item(name, table)?;
        }
        Ok(all)
    }

    fn __len__(&self) -> usize {
        self.time_ns.len()
    }
}
