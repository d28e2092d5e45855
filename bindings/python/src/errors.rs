//! Exceptions. Each says where, what was expected, what was found; `code` is that of the interface contract.

use ballast::component::Refusal;
use ballast_protocol::lockstep::{Code, Fault, Finding};
use pyo3::create_exception;
use pyo3::exceptions::{PyException, PyRuntimeWarning};
use pyo3::prelude::*;
use std::ffi::CString;
use std::fmt::Display;

create_exception!(
    ballast,
    Error,
    PyException,
    "Anything that goes wrong in Ballast; `code` names it."
);
create_exception!(
    ballast,
    CaseError,
    Error,
    "A case that describes no run; `diagnostics` lists every fault with its line."
);
create_exception!(
    ballast,
    Refused,
    Error,
    "A request that makes no sense; nothing has changed. Where the message has parts, `place` (a field, or the body whose \
     input it is), `expected` and `found` are they, and `nearest_ns` the times at which a window may end. `code`: time_grid, input_gap, input_jump, \
     input_invalid, unknown_body, nothing_to_redo, state_invalid, parameter_invalid, recording, elsewhere; of a component \
     elsewhere also busy, unknown_state, too_many_states, and others of the control plane."
);
create_exception!(ballast, FileError, Error, "A file that cannot be read or written.");
create_exception!(
    ballast,
    Lost,
    Error,
    "The program failed inside, and the simulation with it. `restore` of a saved state goes on."
);
create_exception!(
    ballast,
    Unreachable,
    Error,
    "A component that another process computes has not answered as it should. The same call may be made again:\n\
     a window counts once, however often it is asked for. Only after `diverged` nothing but `restore` goes on.\n\n\
     `code`: name, it cannot be one; slow, it is there; peer_lost, it is not; diverged, its run went on without this\n\
     simulation; link, how to reach it; answer, what it says cannot be read; abandoned, `stop` or `close` has ended the wait."
);

/// An exception of class `T` with the attribute `code`.
pub fn error<T: pyo3::PyTypeInfo>(py: Python<'_>, code: &str, text: impl Display) -> PyErr {
    let error = PyErr::new::<T, _>(text.to_string());
    match error.value(py).setattr("code", code) {
        Ok(()) => error,
        Err(other) => other,
    }
}

/// What goes wrong with files.
pub fn file(py: Python<'_>, what: impl Display) -> PyErr {
    error::<FileError>(py, "file", what)
}

/// Tells, as a RuntimeWarning, what is no reason to end a call; who makes errors of warnings gets one.
pub fn warn(py: Python<'_>, text: String) -> PyResult<()> {
    let text = CString::new(text).unwrap_or_default();
    PyErr::warn(py, &py.get_type::<PyRuntimeWarning>(), &text, 1)
}

/// A request that makes no sense, in parts.
pub fn refused(
    py: Python<'_>,
    code: &str,
    place: &str,
    expected: impl Display,
    found: impl Display,
) -> PyErr {
    let [expected, found] = [expected.to_string(), found.to_string()];
    let message = format!("{place}: expected {expected}, found {found}");
    let finding = Finding { place: place.into(), expected, found, nearest_ns: None };
    in_parts(py, code, &message, Some(&finding))
}

/// An input that cannot be used.
pub fn invalid(py: Python<'_>, place: &str, expected: impl Display, found: impl Display) -> PyErr {
    fault(py, &Fault::expected(Code::InputInvalid, place, expected, found))
}

/// The same with a code of the contract.
pub fn fault(py: Python<'_>, fault: &Fault) -> PyErr {
    in_parts(py, &fault.code.to_string(), &fault.message, fault.finding.as_deref())
}

fn in_parts(py: Python<'_>, code: &str, message: &str, finding: Option<&Finding>) -> PyErr {
    let error = error::<Refused>(py, code, message);
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

/// What a component of this process refuses.
pub fn refusal(py: Python<'_>, refusal: Refusal) -> PyErr {
    fault(py, &refusal.into())
}

/// What only a simulation, or a state, of this process has.
pub fn elsewhere(py: Python<'_>, what: &str) -> PyErr {
    let expected = "a simulation of this process";
    refused(py, "elsewhere", what, expected, "one that another computes")
}

pub fn beds(py: Python<'_>, failure: ballast_beds::Error) -> PyErr {
    use ballast_beds::Error as Beds;
    match failure {
        Beds::Scene { .. } | Beds::Preparation { .. } => error::<CaseError>(py, "case", failure),
        Beds::Kept(_) | Beds::AnotherBed { .. } => {
            let way_out =
                "prepare it again with `ballast.prepare(case, again=True)`, or delete the file";
            file(py, format!("{failure}; {way_out}"))
        }
        _ => file(py, failure),
    }
}

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    let py = module.py();
    // The attributes that stubs promise, also where nobody has set them.
    py.get_type::<Error>().setattr("code", "failed")?;
    py.get_type::<CaseError>().setattr("diagnostics", pyo3::types::PyTuple::empty(py))?;
    for part in ["place", "expected", "found", "nearest_ns"] {
        py.get_type::<Refused>().setattr(part, py.None())?;
    }
    module.add("Error", py.get_type::<Error>())?;
    module.add("CaseError", py.get_type::<CaseError>())?;
    module.add("Refused", py.get_type::<Refused>())?;
    module.add("FileError", py.get_type::<FileError>())?;
    module.add("Lost", py.get_type::<Lost>())?;
    module.add("Unreachable", py.get_type::<Unreachable>())
}
