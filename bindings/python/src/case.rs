//! Cases: read, changed, checked, written; their beds.

use crate::compute::{Crew, compute};
use crate::errors::{self, CaseError};
use crate::inputs::{refused, whole};
use crate::machine::Machine;
use crate::simulation::Simulation;
use crate::state::Snapshot;
use ballast::component::Limits;
use ballast_beds::{Beds, Pace};
use ballast_scenario::{Choices, LONGEST_CASE, NoText, read_text, sweep};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};
use std::borrow::Cow;
use std::fs::File;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A case that was read and found sound.
///
/// `Case(text)` reads it from its text (TOML); `name` stands for it in messages. Raises CaseError. Cases that were read
/// from the same text and have the same seed and schedule are equal; they can be copied and pickled.
#[pyclass(frozen, module = "ballast", from_py_object)]
#[derive(Clone)]
pub struct Case(pub Arc<ballast_beds::Case>);

/// Reads a case from its text.
pub fn read(py: Python<'_>, text: String, name: &str) -> PyResult<ballast_beds::Case> {
    ballast_beds::Case::read(text, name).map_err(|faults| {
        let error = errors::error::<CaseError>(py, "case", &faults);
        let told = faults.errors.iter().map(|fault| as_dict(py, fault));
        let told = told.collect::<PyResult<Vec<_>>>().and_then(|all| PyTuple::new(py, all));
        match told.and_then(|all| error.value(py).setattr("diagnostics", all)) {
            Ok(()) => error,
            Err(other) => other,
        }
    })
}

impl Case {
    fn read(py: Python<'_>, text: String, name: &str) -> PyResult<Self> {
        Ok(Self(Arc::new(read(py, text, name)?)))
    }

    fn chosen(&self, choices: Choices) -> Self {
        Self(Arc::new(ballast_beds::Case::clone(&self.0).chosen(choices)))
    }

    /// What tells it from others.
    fn identity(&self) -> (&str, u64, &'static str) {
        (&self.0.text, self.seed(), self.schedule())
    }

    /// The text, in which what was chosen otherwise is said, too.
    fn told(&self, py: Python<'_>) -> PyResult<Cow<'_, str>> {
        let ballast_beds::Case { plan, text, choices, .. } = &*self.0;
        if *choices == Choices::default() {
            return Ok(Cow::Borrowed(text));
        }
        let read = read(py, text.clone(), &plan.name)?.plan;
        let mut point = sweep::Point::new();
        let seed = plan.bed.seed;
        if seed != read.bed.seed {
            let held = i64::try_from(seed).map_err(|_| {
                let expected = format!("one up to {}, as a text (TOML) holds no greater", i64::MAX);
                let wrong = format!("bed.seed: expected {expected}, found {seed}");
                errors::error::<CaseError>(py, "case", wrong)
            })?;
            point.push(("bed.seed".into(), held.into()));
        }
        let schedule = plan.run.solver.schedule;
        if schedule != read.run.solver.schedule {
            point.push(("solver.schedule".into(), schedule.name().into()));
        }
        if point.is_empty() {
            return Ok(Cow::Borrowed(text));
        }
        let told = sweep::with_values(text, &point, &plan.name);
        told.map(Cow::Owned).map_err(|e| errors::error::<CaseError>(py, "case", e))
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

    /// Reads a case file. Raises CaseError with every fault and its line, FileError.
    #[staticmethod]
    fn load(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        let name = path.display().to_string();
        let text = File::open(&path)
            .map_err(NoText::Unreadable)
            .and_then(|file| read_text(file, LONGEST_CASE))
            .map_err(|e| errors::file(py, format!("{name}: {e}")))?;
        Self::read(py, text, &name)
    }

    /// A case from nested dictionaries. Raises CaseError.
    #[staticmethod]
    fn from_dict(py: Python<'_>, values: &Bound<'_, PyDict>) -> PyResult<Self> {
        let text = toml::to_string_pretty(&table(py, values)?)
            .map_err(|e| errors::error::<CaseError>(py, "case", format!("no case: {e}")))?;
        Self::read(py, text, "case")
    }

    /// The text's values as nested dictionaries; what the text leaves to defaults is not in them.
    fn to_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        values(py, &self.told(py)?)
    }

    /// Writes the case's text to a file. Of what lies there only a text in TOML is replaced. Raises FileError.
    fn write(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        let text = self.told(py)?;
        write_toml(py, &path, "a case", &text, |_| true)
    }

    /// The same case with other values: paths of keys joined by points, and what they become, such as
    /// `{"tamping.vibration.frequency_Hz": 40.0}`. Raises CaseError.
    fn with_values(&self, py: Python<'_>, values: &Bound<'_, PyDict>) -> PyResult<Self> {
        let point: sweep::Point = table(py, values)?.into_iter().collect();
        let text = sweep::with_values(&self.0.text, &point, &self.0.plan.name)
            .map_err(|e| errors::error::<CaseError>(py, "case", e))?;
        // What is said last holds.
        let is_said = |table: &str, key: &str| {
            let path = format!("{table}.{key}");
            point.iter().any(|(p, value)| *p == path || p == table && value.get(key).is_some())
        };
        let choices = Choices {
            seed: self.0.choices.seed.filter(|_| !is_said("bed", "seed")),
            schedule: self.0.choices.schedule.filter(|_| !is_said("solver", "schedule")),
        };
        Ok(Self::read(py, text, "case")?.chosen(choices))
    }

    /// The same case with another seed of the bed, or another schedule of the solver.
    #[pyo3(signature = (*, seed=None, schedule=None))]
    fn choose(
        &self,
        py: Python<'_>,
        seed: Option<&Bound<'_, PyAny>>,
        schedule: Option<&str>,
    ) -> PyResult<Self> {
        let kind = "a whole number";
        let whole = |seed| whole(seed, kind, "seed", "one from 0 to 2^64 - 1", refused);
        let seed = seed.map(whole).transpose()?;
        let choices = Choices::named(seed, schedule)
            .map_err(|e| errors::error::<CaseError>(py, "case", e))?;
        Ok(self.chosen(choices))
    }

    /// As the case calls itself.
    #[getter]
    fn name(&self) -> &str {
        &self.0.plan.name
    }

    /// TOML, as it was read; where `choose` has changed the seed or the schedule, with these. Raises CaseError where
    /// TOML cannot hold the seed (above 2^63 - 1).
    #[getter]
    fn text(&self, py: Python<'_>) -> PyResult<Cow<'_, str>> {
        self.told(py)
    }

    /// Of the bed: the case's, or that of `choose`.
    #[getter]
    fn seed(&self) -> u64 {
        self.0.plan.bed.seed
    }

    /// Of the solver: "sequential", "synchronous" or "asynchronous".
    #[getter]
    fn schedule(&self) -> &'static str {
        self.0.plan.run.solver.schedule.name()
    }

    /// Length of a step, ns.
    #[getter]
    fn step_ns(&self) -> u64 {
        self.0.plan.run.stepping.step_ns
    }

    /// Length of the run that the case describes, ns.
    #[getter]
    fn duration_ns(&self) -> u64 {
        self.0.plan.run.duration_ns
    }

    /// What is allowed but looks like a slip.
    #[getter]
    fn warnings(&self) -> Vec<String> {
        self.0.warnings.iter().map(ToString::to_string).collect()
    }

    /// What the prepared bed depends on, as a short text.
    #[getter]
    fn bed_key(&self) -> String {
        self.0.bed_key()
    }

    fn __repr__(&self) -> String {
        format!("Case({:?})", self.0.plan.name)
    }

    fn __eq__(&self, other: &Self) -> bool {
        self.identity() == other.identity()
    }

    fn __hash__(&self) -> u64 {
        let mut hasher = DefaultHasher::new();
        self.identity().hash(&mut hasher);
        hasher.finish()
    }

    /// The text alone could not hold every seed, and has comments that a changed one loses.
    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, PickledCase)> {
        let Choices { seed, schedule } = self.0.choices;
        let again = py.import("ballast._ballast")?.getattr("case_again")?;
        Ok((again, (self.0.text.clone(), seed, schedule.map(|s| s.name().to_string()))))
    }
}

/// Text, and what was chosen: seed and schedule.
type PickledCase = (String, Option<u64>, Option<String>);

/// The values of a text in TOML as nested dictionaries.
///
/// Written anew before Python reads it: `tomllib` takes no text of TOML 1.1, and none that begins with a mark of its order
/// of bytes, as cases may.
#[pyfunction]
pub fn values<'py>(py: Python<'py>, text: &str) -> PyResult<Bound<'py, PyAny>> {
    let wrong = |e: &dyn std::fmt::Display| errors::error::<CaseError>(py, "case", e.to_string());
    let table: toml::Table = text.parse().map_err(|e: toml::de::Error| wrong(&e))?;
    let plain = toml::to_string(&table).map_err(|e| wrong(&e))?;
    py.import("tomllib")?.call_method1("loads", (plain,))
}

/// A case that was copied or pickled.
#[pyfunction]
pub fn case_again(
    py: Python<'_>,
    text: String,
    seed: Option<u64>,
    schedule: Option<&str>,
) -> PyResult<Case> {
    let choices =
        Choices::named(seed, schedule).map_err(|e| errors::error::<CaseError>(py, "case", e))?;
    Ok(Case::read(py, text, "case")?.chosen(choices))
}

/// Prepares the bed of a case unless it is there, and tells where it is kept. `progress(share, text)` is
/// called a few times a second.
#[pyfunction]
#[pyo3(signature = (case, beds, threads=None, progress=None, again=false))]
pub fn prepare(
    py: Python<'_>,
    case: &Case,
    beds: PathBuf,
    threads: Option<&Bound<'_, PyAny>>,
    progress: Option<Py<PyAny>>,
    again: bool,
) -> PyResult<PathBuf> {
    let beds = Beds::in_folder(beds);
    let path = beds.path(&case.0.plan);
    let kept = py.detach(|| beds.find(&case.0.plan)).map_err(|e| errors::beds(py, e));
    if again || kept?.is_none() {
        make(py, case, &beds, threads, progress)?;
    }
    Ok(path)
}

fn make(
    py: Python<'_>,
    case: &Case,
    beds: &Beds,
    threads: Option<&Bound<'_, PyAny>>,
    progress: Option<Py<PyAny>>,
) -> PyResult<ballast::track::Bed> {
    let crew = Crew::new(py, threads)?;
    let done = compute(py, &crew, progress.as_ref(), |turn| {
        let mut pace = Pace::default();
        beds.prepare(&case.0, &mut |at| {
            turn.tell(pace.share(at), || at.stage.name().to_string());
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
    threads: Option<&Bound<'_, PyAny>>,
    progress: Option<Py<PyAny>>,
    max_penetration: Option<f64>,
    keep_early: bool,
) -> PyResult<Simulation> {
    let limits = limits(py, max_penetration, keep_early)?;
    let beds = Beds::in_folder(beds);
    let kept = py.detach(|| beds.find(&case.0.plan)).map_err(|e| errors::beds(py, e))?;
    let bed = match kept {
        Some(bed) => bed,
        None => make(py, case, &beds, threads, progress)?,
    };
    let scene = py.detach(|| ballast_beds::scene(&case.0.plan, bed));
    let (model, state) = scene.map_err(|e| errors::beds(py, e))?;
    let machine = Machine::new(&case.0.plan, &model)
        .map_err(|e| errors::error::<CaseError>(py, "case", e))?;
    let start = Snapshot {
        model: Arc::new(model),
        state: Arc::new(state),
        case: Arc::clone(&case.0),
        machine,
        penetration: None,
    };
    let crew = Crew::new(py, threads)?;
    Simulation::here(py, &start, limits, crew)
}

pub fn limits(py: Python<'_>, max_penetration: Option<f64>, keep_early: bool) -> PyResult<Limits> {
    let penetration = max_penetration.unwrap_or(f64::INFINITY);
    if penetration.is_nan() || penetration <= 0.0 {
        return Err(errors::invalid(py, "max_penetration", "a length above 0 m", penetration));
    }
    Ok(Limits { penetration, keep_partial_window: keep_early, ..Limits::default() })
}

/// A dictionary as a table of TOML.
fn table(py: Python<'_>, values: &Bound<'_, PyDict>) -> PyResult<toml::Table> {
    let text: String = py.import("ballast._toml")?.call_method1("dumps", (values,))?.extract()?;
    text.parse().map_err(|e: toml::de::Error| {
        errors::error::<CaseError>(py, "case", format!("values: {}", e.to_string().trim()))
    })
}

/// Writes a plan of `ballast sweep`. Of what lies there only another one is replaced. Raises FileError.
#[pyfunction]
pub fn write_plan(py: Python<'_>, path: PathBuf, text: &str) -> PyResult<()> {
    let is_plan = |table: &toml::Table| {
        table.contains_key("case") && ["points", "grid"].iter().any(|key| table.contains_key(*key))
    };
    write_toml(py, &path, "a plan", text, is_plan)
}

/// Writes a text in TOML where nothing lies, or another one that `is_its_kind`: `kind`, in words.
fn write_toml(
    py: Python<'_>,
    path: &Path,
    kind: &str,
    text: &str,
    is_its_kind: impl FnOnce(&toml::Table) -> bool,
) -> PyResult<()> {
    let is_ours = |file| {
        let found = read_text(file, LONGEST_CASE).ok().and_then(|found| found.parse().ok());
        found.is_some_and(|table| is_its_kind(&table))
    };
    ballast_hdf5::expect_ours(path, kind, is_ours)
        .and_then(|()| ballast_hdf5::replace(path, &[text.as_bytes()]))
        .map_err(|e| errors::file(py, e))
}

/// What serialises as an object, as a dictionary.
pub fn as_dict<'py>(py: Python<'py>, value: &impl serde::Serialize) -> PyResult<Bound<'py, PyAny>> {
    let json = serde_json::to_string(value)
        .map_err(|e| pyo3::exceptions::PyValueError::new_err(e.to_string()))?;
    py.import("json")?.call_method1("loads", (json,))
}
