//! Python exceptions. Each message names the argument, the expected and the found value; `code` is that of the protocol.

use ballast::component::Refusal;
use ballast_protocol::lockstep::{self, ErrorCode, ErrorDetails};
use pyo3::create_exception;
use pyo3::exceptions::{PyException, PyRuntimeWarning};
use pyo3::prelude::*;
use std::ffi::CString;
use std::fmt::Display;

create_exception!(ballast, Error, PyException, stub!("Error"));
create_exception!(ballast, CaseError, Error, stub!("CaseError"));
create_exception!(ballast, RequestError, Error, stub!("RequestError"));
create_exception!(ballast, RemoteError, Error, stub!("RemoteError"));
create_exception!(ballast, FileError, Error, stub!("FileError"));
create_exception!(ballast, InternalError, Error, stub!("InternalError"));

/// Returns an exception of class `T` with the attribute `code`.
pub fn error<T: pyo3::PyTypeInfo>(py: Python<'_>, code: &str, text: impl Display) -> PyErr {
    let error = PyErr::new::<T, _>(text.to_string());
    match error.value(py).setattr("code", code) {
        Ok(()) => error,
        Err(other) => other,
    }
}

/// Returns a `FileError`.
pub fn file(py: Python<'_>, text: impl Display) -> PyErr {
    error::<FileError>(py, "file", text)
}

/// Returns a `CaseError` without diagnostics.
pub fn case(py: Python<'_>, text: impl Display) -> PyErr {
    error::<CaseError>(py, "case", text)
}

/// Returns an `InternalError`.
pub fn internal(py: Python<'_>, text: impl Display) -> PyErr {
    error::<InternalError>(py, "internal", text)
}

/// Issues a RuntimeWarning.
///
/// # Errors
/// The warning, if Python's filters turn it into an exception.
pub fn warn(py: Python<'_>, text: String) -> PyResult<()> {
    let text = CString::new(text).unwrap_or_default();
    PyErr::warn(py, &py.get_type::<PyRuntimeWarning>(), &text, 1)
}

/// Returns a `RequestError` with a code of this package.
pub fn request(
    py: Python<'_>,
    code: &str,
    place: &str,
    expected: impl Display,
    found: impl Display,
) -> PyErr {
    let expected = expected.to_string();
    let found = found.to_string();
    let message = format!("{place}: expected {expected}, found {found}");
    let finding = ErrorDetails { place: place.into(), expected, found, nearest_ns: None };
    with_parts(py, code, &message, Some(&finding))
}

/// Returns a `RequestError` with the code "input_invalid".
pub fn invalid(py: Python<'_>, place: &str, expected: impl Display, found: impl Display) -> PyErr {
    fault(py, &lockstep::RequestError::expected(ErrorCode::InputInvalid, place, expected, found))
}

/// Returns the `RequestError` for an error of the protocol.
pub fn fault(py: Python<'_>, fault: &lockstep::RequestError) -> PyErr {
    with_parts(py, &fault.code.to_string(), &fault.message, fault.details.as_deref())
}

fn with_parts(py: Python<'_>, code: &str, message: &str, finding: Option<&ErrorDetails>) -> PyErr {
    let error = error::<RequestError>(py, code, message);
    let Some(finding) = finding else { return error };
    let value = error.value(py);
    let set = value
        .setattr("place", &finding.place)
        .and_then(|()| value.setattr("expected", &finding.expected))
        .and_then(|()| value.setattr("found", &finding.found))
        .and_then(|()| value.setattr("nearest_ns", finding.nearest_ns.map(|[a, b]| (a, b))));
    match set {
        Ok(()) => error,
        Err(other) => other,
    }
}

/// Returns the `RequestError` for a request that the component of this process has refused.
pub fn refusal(py: Python<'_>, refusal: Refusal) -> PyErr {
    fault(py, &refusal.into())
}

/// Returns the `RequestError` for an operation that remote simulations and their states do not support.
pub fn remote_unsupported(py: Python<'_>, operation: &str) -> PyErr {
    let expected = "a simulation of this process";
    request(py, "remote_unsupported", operation, expected, "a remote one")
}

/// Returns the exception for a failed preparation of a bed.
pub fn bed(py: Python<'_>, failure: ballast_beds::Error) -> PyErr {
    use ballast_beds::Error as BedError;
    match failure {
        BedError::Scene { .. } | BedError::Preparation { .. } => case(py, failure),
        BedError::Read(_) | BedError::Mismatch { .. } => {
            let hint =
                "prepare it again with `ballast.prepare(case, rebuild=True)`, or delete the file";
            file(py, format!("{failure}; {hint}"))
        }
        _ => file(py, failure),
    }
}

/// Adds the exceptions to the module.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    let py = module.py();
    // Class attributes, so that every instance has the attributes that the stub declares.
    py.get_type::<Error>().setattr("code", "failed")?;
    py.get_type::<CaseError>().setattr("diagnostics", pyo3::types::PyTuple::empty(py))?;
    for part in ["place", "expected", "found", "nearest_ns"] {
        py.get_type::<RequestError>().setattr(part, py.None())?;
    }
    module.add("Error", py.get_type::<Error>())?;
    module.add("CaseError", py.get_type::<CaseError>())?;
    module.add("RequestError", py.get_type::<RequestError>())?;
    module.add("FileError", py.get_type::<FileError>())?;
    module.add("InternalError", py.get_type::<InternalError>())?;
    module.add("RemoteError", py.get_type::<RemoteError>())
}
