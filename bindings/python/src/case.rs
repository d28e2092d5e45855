//! Cases: read, changed, checked, written; their beds.

use crate::compute::compute;
use crate::errors::{self, CaseError};
use crate::machine::Machine;
use crate::simulation::Simulation;
use crate::state::State;
use ballast::component::Limits;
use ballast::model::Schedule;
use ballast::track::plan::Plan;
use ballast_beds::Beds;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};
use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::Arc;

/// What differs from a case's text, as notes of a checkpoint or recording.
type Notes = BTreeMap<String, String>;

/// The schedules by name.
const SCHEDULES: [(&str, Schedule); 3] = [
    ("sequential", Schedule::Sequential),
    ("synchronous", Schedule::Synchronous),
    ("asynchronous", Schedule::Asynchronous),
];

/// A case that was read and found sound.
#[pyclass(frozen, module = "ballast", from_py_object)]
#[derive(Clone)]
pub struct Case {
    pub plan: Plan,
    pub text: String,
    schedule: Option<Schedule>,
    seed: Option<u64>,
    warnings: Vec<String>,
}

impl Case {
    /// The case of a checkpoint, with what its notes changed.
    pub fn restored(py: Python<'_>, text: String, name: &str, notes: &Notes) -> PyResult<Self> {
        let number = |text: &String| {
            text.parse().map_err(|_| {
                errors::file(
                    py,
                    format!("{name}: note \"seed\": expected a number, found {text:?}"),
                )
            })
        };
        let seed = notes.get("seed").map(number).transpose()?;
        Self::read(py, text, name)?.chosen(py, seed, notes.get("schedule").map(String::as_str))
    }

    /// What differs from the case's text, as notes of a checkpoint or recording.
    pub fn notes(&self) -> Notes {
        let schedule = self.schedule.map(|s| ("schedule".to_string(), name_of(s).to_string()));
        let seed = self.seed.map(|seed| ("seed".to_string(), seed.to_string()));
        schedule.into_iter().chain(seed).collect()
    }

    fn read(py: Python<'_>, text: String, name: &str) -> PyResult<Self> {
        let read = ballast_scenario::read_case(&text, name).map_err(|faults| {
            let error = errors::error::<CaseError>(py, "case", &faults);
            let told = faults.errors.iter().map(|fault| as_dict(py, fault));
            let told = told.collect::<PyResult<Vec<_>>>().and_then(|all| PyTuple::new(py, all));
            match told.and_then(|all| error.value(py).setattr("diagnostics", all)) {
                Ok(()) => error,
                Err(other) => other,
            }
        })?;
        let warnings = read.warnings.iter().map(ToString::to_string).collect();
        Ok(Self { plan: read.plan, text, schedule: None, seed: None, warnings })
    }

    /// The same case with another seed or schedule, where one is given.
    fn chosen(
        mut self,
        py: Python<'_>,
        seed: Option<u64>,
        schedule: Option<&str>,
    ) -> PyResult<Self> {
        if let Some(seed) = seed {
            self.plan.bed.seed = seed;
            self.seed = Some(seed);
        }
        if let Some(name) = schedule {
            let found = SCHEDULES.iter().find(|(known, _)| *known == name).ok_or_else(|| {
                let known = SCHEDULES.map(|(name, _)| name);
                let text = format!("schedule: expected one of {known:?}, found {name:?}");
                errors::error::<CaseError>(py, "case", text)
            })?;
            self.plan.run.solver.schedule = found.1;
            self.schedule = Some(found.1);
        }
        Ok(self)
    }
}

#[pymethods]
impl Case {
    /// Reads a case from its text; `name` stands for it in messages.
    #[new]
    #[pyo3(signature = (text, name="case"))]
    fn new(py: Python<'_>, text: String, name: &str) -> PyResult<Self> {
        Self::read(py, text, name)
    }

    /// Reads a case file.
    #[staticmethod]
    fn load(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        let name = path.display().to_string();
        let text = std::fs::read_to_string(&path)
            .map_err(|e| errors::file(py, format!("{name}: cannot be read: {e}")))?;
        Self::read(py, text, &name)
    }

    /// A case from nested dictionaries.
    #[staticmethod]
    fn from_dict(py: Python<'_>, values: &Bound<'_, PyDict>) -> PyResult<Self> {
        let json: String = py.import("json")?.call_method1("dumps", (values,))?.extract()?;
        let text = serde_json::from_str::<toml::Table>(&json)
            .map_err(|e| e.to_string())
            .and_then(|table| toml::to_string_pretty(&table).map_err(|e| e.to_string()))
            .map_err(|e| errors::error::<CaseError>(py, "case", format!("no case: {e}")))?;
        Self::read(py, text, "case")
    }

    /// The text's values as nested dictionaries; what the text leaves to defaults is not in them.
    fn to_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let table: toml::Table = self
            .text
            .parse()
            .map_err(|e: toml::de::Error| errors::error::<CaseError>(py, "case", e.message()))?;
        as_dict(py, &table)
    }

    /// Writes the case's text to a file.
    fn write(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        std::fs::write(&path, &self.text)
            .map_err(|e| errors::file(py, format!("{}: cannot be written: {e}", path.display())))
    }

    /// The same case with other values: paths of keys joined by points, and what they become.
    fn with_values(&self, py: Python<'_>, values: &Bound<'_, PyDict>) -> PyResult<Self> {
        let all = self.to_dict(py)?.cast_into::<PyDict>()?;
        for (path, value) in values.iter() {
            let path: String = path.extract()?;
            let mut table = all.clone();
            let mut keys = path.split('.').peekable();
            while let Some(key) = keys.next() {
                if keys.peek().is_none() {
                    table.set_item(key, &value)?;
                    break;
                }
                if !table.contains(key)? {
                    table.set_item(key, PyDict::new(py))?;
                }
                let next = table.get_item(key)?;
                table = next.and_then(|t| t.cast_into::<PyDict>().ok()).ok_or_else(|| {
                    let text = format!("{path}: expected a table at {key:?}, found something else");
                    errors::error::<CaseError>(py, "case", text)
                })?;
            }
        }
        let chosen = self.schedule.map(name_of);
        Self::from_dict(py, &all)?.chosen(py, self.seed, chosen)
    }

    /// The same case with another seed of the bed, or another schedule of the solver.
    #[pyo3(signature = (*, seed=None, schedule=None))]
    fn choose(&self, py: Python<'_>, seed: Option<u64>, schedule: Option<&str>) -> PyResult<Self> {
        self.clone().chosen(py, seed, schedule)
    }

    #[getter]
    fn name(&self) -> &str {
        &self.plan.name
    }

    #[getter]
    fn text(&self) -> &str {
        &self.text
    }

    #[getter]
    fn seed(&self) -> u64 {
        self.plan.bed.seed
    }

    #[getter]
    fn schedule(&self) -> &'static str {
        name_of(self.plan.run.solver.schedule)
    }

    #[getter]
    fn step_ns(&self) -> u64 {
        self.plan.run.stepping.step_ns
    }

    #[getter]
    fn duration_ns(&self) -> u64 {
        self.plan.run.duration_ns
    }

    #[getter]
    fn warnings(&self) -> Vec<String> {
        self.warnings.clone()
    }

    #[getter]
    fn bed_key(&self) -> String {
        ballast_scenario::content_key(&self.plan)
    }

    fn __repr__(&self) -> String {
        format!("Case({:?})", self.plan.name)
    }
}

/// Prepares the bed of a case unless it is there, and tells where it is kept. `progress(share, text)` is
/// called a few times a second.
#[pyfunction]
#[pyo3(signature = (case, beds, threads=None, progress=None, again=false))]
pub fn prepare(
    py: Python<'_>,
    case: &Case,
    beds: PathBuf,
    threads: Option<usize>,
    progress: Option<Py<PyAny>>,
    again: bool,
) -> PyResult<PathBuf> {
    let beds = Beds::in_folder(beds);
    let path = beds.path(&case.plan);
    let kept = py.detach(|| beds.find(&case.plan)).map_err(|e| errors::beds(py, e));
    if again || kept?.is_none() {
        make(py, case, &beds, threads, progress)?;
    }
    Ok(path)
}

fn make(
    py: Python<'_>,
    case: &Case,
    beds: &Beds,
    threads: Option<usize>,
    progress: Option<Py<PyAny>>,
) -> PyResult<ballast::track::Bed> {
    let pool = crate::compute::pool(py, threads)?;
    let done = compute(py, &pool, progress.as_ref(), |turn| {
        beds.prepare(&case.plan, &case.text, &mut |at| {
            turn.tell(ballast_beds::share(at), || at.stage.name().to_string());
            if turn.is_over() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        })
    });
    match done? {
        (_, Some(raised)) => Err(raised),
        (Ok(Some(bed)), None) => Ok(bed),
        (Ok(None), None) => Err(pyo3::exceptions::PyKeyboardInterrupt::new_err(())),
        (Err(failure), None) => Err(errors::beds(py, failure)),
    }
}

/// A simulation of a case at its start; its bed is prepared if it is not in the folder `beds`.
#[pyfunction]
#[pyo3(signature = (case, beds, threads=None, progress=None, max_penetration=None, keep_early=false))]
pub fn begin(
    py: Python<'_>,
    case: &Case,
    beds: PathBuf,
    threads: Option<usize>,
    progress: Option<Py<PyAny>>,
    max_penetration: Option<f64>,
    keep_early: bool,
) -> PyResult<Simulation> {
    let beds = Beds::in_folder(beds);
    let kept = py.detach(|| beds.find(&case.plan)).map_err(|e| errors::beds(py, e))?;
    let bed = match kept {
        Some(bed) => bed,
        None => make(py, case, &beds, threads, progress)?,
    };
    let (model, state) = ballast_beds::scene(&case.plan, bed).map_err(|e| errors::beds(py, e))?;
    let machine =
        Machine::new(&case.plan, &model).map_err(|e| errors::error::<CaseError>(py, "case", e))?;
    let start = State {
        model: Arc::new(model),
        state: Arc::new(state),
        case: Arc::new(case.clone()),
        machine,
    };
    let pool = crate::compute::pool(py, threads)?;
    Simulation::new(py, &start, limits(max_penetration, keep_early), pool)
}

pub fn limits(max_penetration: Option<f64>, keep_early: bool) -> Limits {
    let on_trouble = if keep_early {
        ballast::component::OnTrouble::Early
    } else {
        ballast::component::OnTrouble::Discard
    };
    Limits {
        penetration: max_penetration.unwrap_or(f64::INFINITY),
        on_trouble,
        ..Limits::default()
    }
}

pub fn name_of(schedule: Schedule) -> &'static str {
    SCHEDULES.iter().find(|(_, known)| *known == schedule).map_or("", |(name, _)| name)
}

/// What serialises as an object, as a dictionary.
pub fn as_dict<'py>(py: Python<'py>, value: &impl serde::Serialize) -> PyResult<Bound<'py, PyAny>> {
    let json = serde_json::to_string(value)
        .map_err(|e| pyo3::exceptions::PyValueError::new_err(e.to_string()))?;
    py.import("json")?.call_method1("loads", (json,))
}
