//! Cases: reading, changing, writing and pickling.

use crate::errors;
use crate::inputs::{out_of_range, whole};
use crate::toml_values;
use ballast_scenario::{CaseOverrides, MAX_CASE_BYTES, ReadError, read_text, sweep};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyMapping, PyTuple};
use std::borrow::Cow;
use std::fs::File;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use toml::{Table, Value};

#[doc = stub!("Case")]
#[pyclass(frozen, module = "ballast", name = "Case", from_py_object)]
#[derive(Clone)]
pub struct PyCase(pub Arc<ballast_beds::Case>);

/// Reads a case from its text; `name` is the text's name in messages.
///
/// # Errors
/// `CaseError` with diagnostics.
pub fn read(py: Python<'_>, text: String, name: &str) -> PyResult<ballast_beds::Case> {
    ballast_beds::Case::parse(text, name).map_err(|faults| {
        let error = errors::case(py, &faults);
        let diagnostics = faults.errors.iter().map(|fault| to_dict(py, fault));
        let diagnostics = diagnostics.collect::<PyResult<Vec<_>>>();
        let diagnostics = diagnostics.and_then(|all| PyTuple::new(py, all));
        match diagnostics.and_then(|all| error.value(py).setattr("diagnostics", all)) {
            Ok(()) => error,
            Err(other) => other,
        }
    })
}

impl PyCase {
    fn read(py: Python<'_>, text: String, name: &str) -> PyResult<Self> {
        Ok(Self(Arc::new(read(py, text, name)?)))
    }

    fn with_overrides(&self, choices: CaseOverrides) -> Self {
        Self(Arc::new(ballast_beds::Case::clone(&self.0).with_overrides(choices)))
    }

    /// Returns what equality and hash compare.
    fn identity(&self) -> (&str, u64, &'static str) {
        (&self.0.text, self.seed(), self.schedule())
    }

    /// Returns the text with the chosen seed and schedule.
    fn chosen_text(&self, py: Python<'_>) -> PyResult<Cow<'_, str>> {
        let ballast_beds::Case { plan, text, overrides, .. } = &*self.0;
        if *overrides == CaseOverrides::default() {
            return Ok(Cow::Borrowed(text));
        }
        let original = read(py, text.clone(), &plan.name)?.plan;
        let mut changes = sweep::SweepPoint::new();
        let seed = plan.bed.seed;
        if seed != original.bed.seed {
            let value = i64::try_from(seed).map_err(|_| {
                let expected = format!("at most {} (the largest integer of TOML)", i64::MAX);
                errors::case(py, format!("bed.seed: expected {expected}, found {seed}"))
            })?;
            changes.push(("bed.seed".into(), value.into()));
        }
        let schedule = plan.run.solver.schedule;
        if schedule != original.run.solver.schedule {
            changes.push(("solver.schedule".into(), schedule.name().into()));
        }
        if changes.is_empty() {
            return Ok(Cow::Borrowed(text));
        }
        let changed = sweep::set_values(text, &changes, &plan.name);
        changed.map(Cow::Owned).map_err(|e| errors::case(py, e))
    }
}

#[pymethods]
impl PyCase {
    #[new]
    #[pyo3(signature = (text, name="case"))]
    fn new(py: Python<'_>, text: String, name: &str) -> PyResult<Self> {
        Self::read(py, text, name)
    }

    #[doc = stub!("Case.load")]
    #[staticmethod]
    fn load(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        let name = path.display().to_string();
        let text = File::open(&path)
            .map_err(ReadError::Io)
            .and_then(|file| read_text(file, MAX_CASE_BYTES))
            .map_err(|e| errors::file(py, format!("{name}: {e}")))?;
        Self::read(py, text, &name)
    }

    #[doc = stub!("Case.from_dict")]
    #[staticmethod]
    fn from_dict(py: Python<'_>, values: &Bound<'_, PyDict>) -> PyResult<Self> {
        let table = toml_values::to_table(values.as_mapping(), "")?;
        let text = toml::to_string_pretty(&table).map_err(|e| errors::case(py, e))?;
        Self::read(py, text, "case")
    }

    #[doc = stub!("Case.to_dict")]
    fn to_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        _parse_toml(py, &self.chosen_text(py)?)
    }

    #[doc = stub!("Case.write")]
    fn write(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        let text = self.chosen_text(py)?;
        write_toml(py, &path, "a case", &text, |_| true)
    }

    #[doc = stub!("Case.with_values")]
    fn with_values(&self, py: Python<'_>, values: &Bound<'_, PyDict>) -> PyResult<Self> {
        let table = toml_values::to_table(values.as_mapping(), "")?;
        let changes: sweep::SweepPoint = table.into_iter().collect();
        let text = sweep::set_values(&self.0.text, &changes, &self.0.plan.name)
            .map_err(|e| errors::case(py, e))?;
        // The last choice wins, made by `choose` or by this call.
        let is_set = |table: &str, key: &str| {
            let path = format!("{table}.{key}");
            changes.iter().any(|(p, value)| *p == path || p == table && value.get(key).is_some())
        };
        let choices = CaseOverrides {
            seed: self.0.overrides.seed.filter(|_| !is_set("bed", "seed")),
            schedule: self.0.overrides.schedule.filter(|_| !is_set("solver", "schedule")),
        };
        Ok(Self::read(py, text, "case")?.with_overrides(choices))
    }

    #[doc = stub!("Case.choose")]
    #[pyo3(signature = (*, seed=None, schedule=None))]
    fn choose(
        &self,
        py: Python<'_>,
        seed: Option<&Bound<'_, PyAny>>,
        schedule: Option<&str>,
    ) -> PyResult<Self> {
        let kind = "a whole number";
        let seed = seed.map(|seed| whole(seed, kind, "seed", "0 to 2^64 - 1", out_of_range));
        let choices = CaseOverrides::from_names(seed.transpose()?, schedule)
            .map_err(|e| errors::case(py, e))?;
        Ok(self.with_overrides(choices))
    }

    #[doc = stub!("Case.name")]
    #[getter]
    fn name(&self) -> &str {
        &self.0.plan.name
    }

    #[doc = stub!("Case.text")]
    #[getter]
    fn text(&self, py: Python<'_>) -> PyResult<Cow<'_, str>> {
        self.chosen_text(py)
    }

    #[doc = stub!("Case.seed")]
    #[getter]
    fn seed(&self) -> u64 {
        self.0.plan.bed.seed
    }

    #[doc = stub!("Case.schedule")]
    #[getter]
    fn schedule(&self) -> &'static str {
        self.0.plan.run.solver.schedule.name()
    }

    #[doc = stub!("Case.step_ns")]
    #[getter]
    fn step_ns(&self) -> u64 {
        self.0.plan.run.stepping.step_ns
    }

    #[doc = stub!("Case.duration_ns")]
    #[getter]
    fn duration_ns(&self) -> u64 {
        self.0.plan.run.duration_ns
    }

    #[doc = stub!("Case.warnings")]
    #[getter]
    fn warnings(&self) -> Vec<String> {
        self.0.warnings.iter().map(ToString::to_string).collect()
    }

    #[doc = stub!("Case.bed_key")]
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

    /// Pickles the original text and the choices: TOML cannot hold every seed, and a changed text has lost its comments.
    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, PickledCase)> {
        let CaseOverrides { seed, schedule } = self.0.overrides;
        let unpickle = py.import("ballast._ballast")?.getattr("_unpickle_case")?;
        Ok((unpickle, (self.0.text.clone(), seed, schedule.map(|s| s.name().to_string()))))
    }
}

/// Text, chosen seed and chosen schedule.
type PickledCase = (String, Option<u64>, Option<String>);

/// Returns the values of a TOML text as nested dictionaries.
///
/// Accepts what cases accept, such as TOML 1.1 and a byte order mark, which `tomllib` refuses.
#[pyfunction]
pub fn _parse_toml<'py>(py: Python<'py>, text: &str) -> PyResult<Bound<'py, PyDict>> {
    let table: Table = text.parse().map_err(|e: toml::de::Error| errors::case(py, e))?;
    toml_values::to_dict(py, table)
}

/// Returns a pickled case.
#[pyfunction]
pub fn _unpickle_case(
    py: Python<'_>,
    text: String,
    seed: Option<u64>,
    schedule: Option<&str>,
) -> PyResult<PyCase> {
    let choices = CaseOverrides::from_names(seed, schedule).map_err(|e| errors::case(py, e))?;
    Ok(PyCase::read(py, text, "case")?.with_overrides(choices))
}

/// Writes a plan of `ballast sweep`; an existing file is replaced only if it is one.
#[pyfunction]
pub fn _write_sweep_plan(
    py: Python<'_>,
    case: &str,
    points: Vec<Bound<'_, PyMapping>>,
    path: PathBuf,
) -> PyResult<()> {
    let points = points.iter().enumerate();
    let points = points.map(|(i, point)| toml_values::to_table(point, &format!("points[{i}].")));
    let points = points.map(|table| table.map(Value::Table)).collect::<PyResult<Vec<_>>>()?;
    let plan = Table::from_iter([
        ("case".to_string(), Value::from(case)),
        ("points".to_string(), Value::Array(points)),
    ]);
    let text = toml::to_string(&plan).map_err(|e| errors::case(py, e))?;
    let is_plan = |table: &Table| {
        table.contains_key("case") && ["points", "grid"].iter().any(|key| table.contains_key(*key))
    };
    write_toml(py, &path, "a plan", &text, is_plan)
}

/// Writes a TOML text; an existing file is replaced only if `is_same_kind`, which `kind` names.
fn write_toml(
    py: Python<'_>,
    path: &Path,
    kind: &str,
    text: &str,
    is_same_kind: impl FnOnce(&Table) -> bool,
) -> PyResult<()> {
    let is_ours = |file| {
        let found = read_text(file, MAX_CASE_BYTES).ok().and_then(|found| found.parse().ok());
        found.is_some_and(|table| is_same_kind(&table))
    };
    ballast_hdf5::check_file_kind(path, kind, is_ours)
        .and_then(|()| ballast_hdf5::replace(path, &[text.as_bytes()]))
        .map_err(|e| errors::file(py, e))
}

/// Converts a value that serialises as an object to a Python dictionary.
pub fn to_dict<'py>(py: Python<'py>, value: &impl serde::Serialize) -> PyResult<Bound<'py, PyAny>> {
    let json = serde_json::to_string(value)
        .map_err(|e| pyo3::exceptions::PyValueError::new_err(e.to_string()))?;
    py.import("json")?.call_method1("loads", (json,))
}
