//! Conversion between Python objects and TOML values; numpy scalars and arrays are accepted.

use crate::errors::{self, CaseError};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::{
    PyBool, PyByteArray, PyBytes, PyDict, PyFloat, PyFrozenSet, PyInt, PyMapping, PyMemoryView,
    PySet, PyString,
};
use toml::{Table, Value};

/// Converts a Python mapping to a TOML table; `place` is the prefix of its keys in error messages.
pub fn to_table(values: &Bound<'_, PyMapping>, place: &str) -> PyResult<Table> {
    let entry = |item: Bound<'_, PyAny>| {
        let (key, value): (Bound<'_, PyAny>, Bound<'_, PyAny>) = item.extract()?;
        let key = key.str()?.to_string();
        let value = to_value(&value, &format!("{place}{key}"))?;
        Ok((key, value))
    };
    values.items()?.iter().map(entry).collect()
}

/// Converts a Python object to a TOML value; `place` names it in error messages.
fn to_value(value: &Bound<'_, PyAny>, place: &str) -> PyResult<Value> {
    // Sets have no order, and lists of byte values are never meant.
    let is_unordered = value.is_instance_of::<PySet>() || value.is_instance_of::<PyFrozenSet>();
    let is_binary = value.is_instance_of::<PyBytes>()
        || value.is_instance_of::<PyByteArray>()
        || value.is_instance_of::<PyMemoryView>();
    if is_unordered || is_binary {
        return Err(unsupported(value, place));
    }
    if let Ok(value) = value.cast::<PyBool>() {
        return Ok(Value::Boolean(value.is_true()));
    }
    if let Ok(value) = value.cast::<PyString>() {
        return Ok(Value::String(value.to_string()));
    }
    if let Ok(value) = value.cast::<PyInt>() {
        return value.extract().map(Value::Integer).map_err(|_| {
            let limits = format!("{} to {}", i64::MIN, i64::MAX);
            let text = format!("{place}: expected a whole number from {limits}, found {value}");
            errors::error::<CaseError>(value.py(), "case", text)
        });
    }
    if let Ok(value) = value.cast::<PyFloat>() {
        return Ok(Value::Float(value.value()));
    }
    if let Some(to_list) = value.getattr_opt("tolist")? {
        return to_value(&to_list.call0()?, place);
    }
    if let Ok(values) = value.cast::<PyMapping>() {
        return to_table(values, &format!("{place}.")).map(Value::Table);
    }
    let Ok(items) = value.try_iter() else { return Err(unsupported(value, place)) };
    items.map(|item| to_value(&item?, place)).collect::<PyResult<_>>().map(Value::Array)
}

fn unsupported(value: &Bound<'_, PyAny>, place: &str) -> PyErr {
    let expected = "a string, number, boolean, list or dictionary";
    let kind = value.get_type();
    let found = match (value.repr(), kind.name()) {
        (Ok(value), Ok(kind)) => format!("{value} ({kind})"),
        _ => kind.to_string(),
    };
    PyTypeError::new_err(format!("{place}: expected {expected}, found {found}"))
}

/// Converts a TOML table to a Python dictionary; dates become strings.
pub fn to_dict<'py>(py: Python<'py>, table: Table) -> PyResult<Bound<'py, PyDict>> {
    let values = PyDict::new(py);
    for (key, value) in table {
        values.set_item(key, to_object(py, value)?)?;
    }
    Ok(values)
}

fn to_object(py: Python<'_>, value: Value) -> PyResult<Bound<'_, PyAny>> {
    Ok(match value {
        Value::String(value) => value.into_pyobject(py)?.into_any(),
        Value::Integer(value) => value.into_pyobject(py)?.into_any(),
        Value::Float(value) => value.into_pyobject(py)?.into_any(),
        Value::Boolean(value) => value.into_pyobject(py)?.to_owned().into_any(),
        Value::Datetime(value) => value.to_string().into_pyobject(py)?.into_any(),
        Value::Array(values) => {
            let values = values.into_iter().map(|value| to_object(py, value));
            values.collect::<PyResult<Vec<_>>>()?.into_pyobject(py)?
        }
        Value::Table(values) => to_dict(py, values)?.into_any(),
    })
}
