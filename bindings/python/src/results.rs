//! Results files of runs, as arrays.

use crate::arrays::{self, Matrix, Vector};
use crate::errors;
use crate::inputs;
use crate::lock::lock;
use ballast_hdf5::results::{ResultsReader, ResultsTable};
use pyo3::exceptions::PyKeyError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::PathBuf;
use std::sync::Mutex;

#[doc = stub!("Results")]
#[pyclass(frozen, module = "ballast", name = "Results")]
pub struct PyResults {
    reader: Mutex<ResultsReader>,
}

impl PyResults {
    fn read<T: Send>(
        &self,
        py: Python<'_>,
        read: impl FnOnce(&ResultsReader) -> ballast_hdf5::Result<T> + Send,
    ) -> PyResult<T> {
        py.detach(|| read(&lock(&self.reader))).map_err(|e| errors::file(py, e))
    }

    /// Returns a table.
    ///
    /// # Errors
    /// `KeyError` if there is none of this name.
    fn read_table(&self, py: Python<'_>, name: &str) -> PyResult<ResultsTable> {
        let read = |r: &ResultsReader| {
            let names = r.table_names()?;
            let table = names.iter().any(|known| known == name).then(|| r.table(name));
            Ok((table.transpose()?, names))
        };
        let (table, names) = self.read(py, read)?;
        table.ok_or_else(|| {
            let names = names.join(", ");
            PyKeyError::new_err(format!("table: expected one of {names}, found {name}"))
        })
    }
}

#[pymethods]
impl PyResults {
    #[new]
    fn new(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        let reader = py.detach(|| ResultsReader::open(path)).map_err(|e| errors::file(py, e))?;
        Ok(Self { reader: Mutex::new(reader) })
    }

    #[doc = stub!("Results.is_closed")]
    #[getter]
    fn is_closed(&self) -> bool {
        lock(&self.reader).is_closed()
    }

    #[doc = stub!("Results.case_name")]
    #[getter]
    fn case_name(&self, py: Python<'_>) -> PyResult<String> {
        self.read(py, |r| r.metadata("case_name"))
    }

    #[doc = stub!("Results.case_text")]
    #[getter]
    fn case_text(&self, py: Python<'_>) -> PyResult<String> {
        self.read(py, |r| r.metadata("case_text"))
    }

    #[doc = stub!("Results.grain_count")]
    #[getter]
    fn grain_count(&self, py: Python<'_>) -> PyResult<u64> {
        Ok(self.read(py, ResultsReader::bodies)?.0)
    }

    #[doc = stub!("Results.bodies")]
    #[getter]
    fn bodies(&self, py: Python<'_>) -> PyResult<Vec<String>> {
        Ok(self.read(py, ResultsReader::bodies)?.1)
    }

    #[doc = stub!("Results.roles")]
    #[getter]
    fn roles<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let roles = PyDict::new(py);
        for (name, role) in self.bodies(py)?.iter().zip(self.read(py, ResultsReader::roles)?) {
            roles.set_item(name, role)?;
        }
        Ok(roles)
    }

    #[doc = stub!("Results.steps")]
    #[getter]
    fn steps<'py>(&self, py: Python<'py>) -> PyResult<Vector<'py, u64>> {
        let steps = self.read(py, |r| Ok(r.steps().to_vec()))?;
        Ok(arrays::column(py, &steps))
    }

    #[doc = stub!("Results.times")]
    #[getter]
    fn times<'py>(&self, py: Python<'py>) -> PyResult<Vector<'py>> {
        let times = self.read(py, ResultsReader::times)?;
        Ok(arrays::column(py, &times))
    }

    #[doc = stub!("Results.poses")]
    fn poses<'py>(
        &self,
        py: Python<'py>,
        frame: &Bound<'py, PyAny>,
    ) -> PyResult<(Matrix<'py>, Matrix<'py>)> {
        let frames = self.read(py, |r| Ok(r.steps().len()))?;
        let frame = inputs::index(frame, "frame", frames)?;
        let poses = self.read(py, |r| r.poses(frame))?;
        let positions = poses.iter().flat_map(|p| <[f64; 3]>::from(p.position));
        let positions: Vec<f64> = positions.collect();
        let orientations = poses.iter().flat_map(|p| <[f64; 4]>::from(p.orientation.coords));
        let orientations: Vec<f64> = orientations.collect();
        Ok((arrays::table(py, &positions, 3), arrays::table(py, &orientations, 4)))
    }

    #[doc = stub!("Results.tables")]
    #[getter]
    fn tables(&self, py: Python<'_>) -> PyResult<Vec<String>> {
        self.read(py, ResultsReader::table_names)
    }

    #[doc = stub!("Results.table")]
    fn table<'py>(&self, py: Python<'py>, name: &str) -> PyResult<Bound<'py, PyDict>> {
        let table = self.read_table(py, name)?;
        let columns = PyDict::new(py);
        columns.set_item("step", arrays::column(py, &table.steps))?;
        for (i, (column, _)) in table.columns.iter().enumerate() {
            let values = table.rows.iter().skip(i).step_by(table.columns.len());
            let values: Vec<f64> = values.copied().collect();
            columns.set_item(column, arrays::column(py, &values))?;
        }
        Ok(columns)
    }

    #[doc = stub!("Results.units")]
    fn units<'py>(&self, py: Python<'py>, name: &str) -> PyResult<Bound<'py, PyDict>> {
        let table = self.read_table(py, name)?;
        let units = PyDict::new(py);
        for (column, unit) in &table.columns {
            units.set_item(column, unit)?;
        }
        Ok(units)
    }

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let (name, frames) = self.read(py, |r| Ok((r.metadata("case_name")?, r.steps().len())))?;
        let so_far = if self.is_closed() { "" } else { ", not closed" };
        Ok(format!("Results({name:?}, {frames} frames{so_far})"))
    }
}
