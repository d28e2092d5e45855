//! C functions of FMI 2.0, co-simulation.
//!
//! Names, arguments and meaning are those of the standard, version 2.0.4. Functions of model exchange and derivatives are in
//! a module of their kind and return an error.

use crate::abi::{self, ANY, BEFORE_END, SOUND, array, array_mut};
use crate::bed_backend::PartialStep;
use crate::logger::{LogFunction2, LogReceiver};
use crate::status::{Complaint, Status, UnitPhase};
use crate::variables::ValueType;
use percent_encoding::percent_decode_str;
use std::ffi::{c_char, c_int, c_void};

pub use crate::fmi2_unsupported::*;

/// Functions of the importer (`fmi2CallbackFunctions`).
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct CallbackFunctions2 {
    /// Receives messages.
    pub logger: Option<LogFunction2>,
    /// Unused: the library allocates its own memory.
    pub allocate_memory: Option<unsafe extern "C" fn(usize, usize) -> *mut c_void>,
    /// Unused.
    pub free_memory: Option<unsafe extern "C" fn(*mut c_void)>,
    /// Unused: steps are synchronous.
    pub step_finished: Option<unsafe extern "C" fn(*mut c_void, c_int)>,
    /// Environment of the logger.
    pub environment: *mut c_void,
}

/// Returns the path of a `file` URI.
fn path_of_uri(uri: &str) -> Result<String, String> {
    let expected = || format!("resources: expected a URI file:///…, found {uri:?}");
    let rest = uri.strip_prefix("file:").ok_or_else(expected)?;
    let path = match rest.strip_prefix("//") {
        Some(authority) => &authority[authority.find('/').ok_or_else(expected)?..],
        None => rest,
    };
    let path = percent_decode_str(path).decode_utf8().map_err(|_| expected())?;
    // A drive of Windows stands behind the first slash.
    let is_drive = path.as_bytes().get(2) == Some(&b':');
    Ok(if is_drive { path[1..].into() } else { path.into_owned() })
}

/// Returns the platform of the binary.
#[unsafe(no_mangle)]
pub extern "C" fn fmi2GetTypesPlatform() -> *const c_char {
    c"default".as_ptr()
}

/// Returns the version of the standard.
#[unsafe(no_mangle)]
pub extern "C" fn fmi2GetVersion() -> *const c_char {
    c"2.0".as_ptr()
}

/// Creates an instance; null, with a message, if that fails.
///
/// # Safety
/// The arguments follow the standard.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2Instantiate(
    name: *const c_char,
    kind: c_int,
    guid: *const c_char,
    resources: *const c_char,
    functions: *const CallbackFunctions2,
    _visible: c_int,
    logging_on: c_int,
) -> *mut c_void {
    // SAFETY: the importer gives its functions, or null.
    let functions = unsafe { functions.as_ref() };
    let receiver = functions.and_then(|f| Some(LogReceiver::Fmi2(f.logger?, f.environment)));
    // SAFETY: the importer's text ends with NUL.
    let uri = unsafe { abi::text_or_empty(resources) }.to_string_lossy();
    let refusal = (kind != 1).then_some("fmi2Instantiate: expected co-simulation (1)");
    // SAFETY: the importer's texts end with NUL.
    unsafe {
        abi::instantiate(
            [name, guid],
            || path_of_uri(&uri),
            receiver.unwrap_or(LogReceiver::Nobody),
            logging_on != 0,
            refusal,
        )
    }
}

/// Frees an instance.
///
/// # Safety
/// The pointer is null or comes from [`fmi2Instantiate`] and is not used again.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2FreeInstance(c: *mut c_void) {
    abi::free(c);
}

/// Defines C functions that act on an instance: name, legal phases, arguments, result.
macro_rules! functions {
    ($($(#[$doc:meta])* $name:ident($instance:ident, $phases:expr $(, $arg:ident: $type:ty)*) $act:block)*) => {$(
        $(#[$doc])*
        ///
        /// # Safety
        /// The arguments follow the standard.
        #[unsafe(no_mangle)]
        pub unsafe extern "C" fn $name(c: *mut std::ffi::c_void $(, $arg: $type)*) -> std::ffi::c_int {
            $crate::abi::call(c, stringify!($name), $phases, |$instance| $act)
        }
    )*};
}
pub(crate) use functions;

const BEFORE: u8 = UnitPhase::Instantiated as u8;

functions! {
    /// Selects categories of messages.
    fmi2SetDebugLogging(i, ANY, on: c_int, n: usize, categories: *const *const c_char) {
        abi::set_logging(i, on != 0, categories, n)
    }

    /// Sets the start time; tolerance and stop time have no effect.
    fmi2SetupExperiment(i, BEFORE, _defined: c_int, _tolerance: f64, start: f64, _stops: c_int, _stop: f64) {
        i.set_start(start)?;
        Ok(Status::Ok)
    }

    /// Enters the initialisation.
    fmi2EnterInitializationMode(i, BEFORE) {
        i.enter_initialization();
        Ok(Status::Ok)
    }

    /// Leaves the initialisation.
    fmi2ExitInitializationMode(i, UnitPhase::Initialization as u8) {
        i.exit_initialization()?;
        Ok(Status::Ok)
    }

    /// Ends the simulation.
    fmi2Terminate(i, UnitPhase::Step as u8) {
        i.terminate();
        Ok(Status::Ok)
    }

    /// Returns to the state after the instantiation.
    fmi2Reset(i, ANY) {
        i.reset()?;
        Ok(Status::Ok)
    }

    /// Reads real variables.
    fmi2GetReal(i, SOUND, vr: *const u32, n: usize, values: *mut f64) {
        let (vr, values) = (array(vr, n)?, array_mut(values, n)?);
        i.get(vr, &[ValueType::Real], n, |k, value| values[k] = value)?;
        Ok(Status::Ok)
    }

    /// Reads whole numbers and enumerations.
    fmi2GetInteger(i, SOUND, vr: *const u32, n: usize, values: *mut c_int) {
        let (vr, values) = (array(vr, n)?, array_mut(values, n)?);
        let kinds = [ValueType::Integer, ValueType::InputTime];
        i.get(vr, &kinds, n, |k, value| values[k] = value as c_int)?;
        Ok(Status::Ok)
    }

    /// Reads truth values, of which there are none.
    fmi2GetBoolean(i, SOUND, vr: *const u32, n: usize, _values: *mut c_int) {
        i.get(array(vr, n)?, &[], 0, |_, _| ())?;
        Ok(Status::Ok)
    }

    /// Reads texts, which live until the next call.
    fmi2GetString(i, SOUND, vr: *const u32, n: usize, values: *mut *const c_char) {
        let values = array_mut(values, n)?;
        for (value, &vr) in values.iter_mut().zip(array(vr, n)?) {
            *value = i.text(vr)?;
        }
        Ok(Status::Ok)
    }

    /// Sets real variables.
    fmi2SetReal(i, BEFORE_END, vr: *const u32, n: usize, values: *const f64) {
        i.set(array(vr, n)?, &[ValueType::Real], array(values, n)?)?;
        Ok(Status::Ok)
    }

    /// Sets whole numbers and enumerations.
    fmi2SetInteger(i, BEFORE_END, vr: *const u32, n: usize, values: *const c_int) {
        let values: Vec<f64> = array(values, n)?.iter().map(|&v| f64::from(v)).collect();
        i.set(array(vr, n)?, &[ValueType::Integer, ValueType::InputTime], &values)?;
        Ok(Status::Ok)
    }

    /// Sets truth values, of which there are none.
    fmi2SetBoolean(i, BEFORE_END, vr: *const u32, n: usize, _values: *const c_int) {
        i.set(array(vr, n)?, &[], &[])?;
        Ok(Status::Ok)
    }

    /// Sets texts, of which none can be set.
    fmi2SetString(i, BEFORE_END, vr: *const u32, n: usize, _values: *const *const c_char) {
        i.set(array(vr, n)?, &[], &[])?;
        Ok(Status::Ok)
    }

    /// Saves the state.
    fmi2GetFMUstate(i, SOUND, state: *mut *mut c_void) {
        abi::get_state(i, state)
    }

    /// Restores a state.
    fmi2SetFMUstate(i, ANY, state: *mut c_void) {
        abi::set_state(i, state)
    }

    /// Frees a state.
    fmi2FreeFMUstate(_i, ANY, state: *mut *mut c_void) {
        abi::free_state(state)
    }

    /// Returns the size of a serialised state, bytes.
    fmi2SerializedFMUstateSize(_i, ANY, state: *mut c_void, size: *mut usize) {
        abi::state_size(state, size)
    }

    /// Serialises a state.
    fmi2SerializeFMUstate(_i, ANY, state: *mut c_void, bytes: *mut u8, size: usize) {
        abi::write_state(state, bytes, size)
    }

    /// Reads a serialised state.
    fmi2DeSerializeFMUstate(i, ANY, bytes: *const u8, size: usize, state: *mut *mut c_void) {
        abi::read_state(i, bytes, size, state)
    }

    /// Advances by a step.
    ///
    /// A step that ends early is discarded; its complete time steps stay, up to the last successful time.
    fmi2DoStep(i, UnitPhase::Step as u8, time: f64, length: f64, _no_set_state: c_int) {
        let outcome = i.do_step(time, length, PartialStep::Keep)?;
        Ok(if outcome.is_early { Status::Discard } else { outcome.status })
    }

    /// Cancels a step, of which none is asynchronous.
    fmi2CancelStep(_i, ANY) {
        Err(Complaint::error("expected an asynchronous step, found none"))
    }

    /// Returns a status: no step is pending.
    fmi2GetStatus(_i, ANY, _kind: c_int, _value: *mut c_int) {
        Ok(Status::Discard)
    }

    /// Returns the last successful time (2).
    fmi2GetRealStatus(i, ANY, kind: c_int, value: *mut f64) {
        if kind != 2 {
            return Ok(Status::Discard);
        }
        abi::put(value, i.time());
        Ok(Status::Ok)
    }

    /// Returns a status, of which there is none.
    fmi2GetIntegerStatus(_i, ANY, _kind: c_int, _value: *mut c_int) {
        Ok(Status::Discard)
    }

    /// Returns false for the question whether the instance wants to terminate (3).
    fmi2GetBooleanStatus(_i, ANY, kind: c_int, value: *mut c_int) {
        if kind != 3 {
            return Ok(Status::Discard);
        }
        abi::put(value, 0);
        Ok(Status::Ok)
    }

    /// Returns a status, of which there is none.
    fmi2GetStringStatus(_i, ANY, _kind: c_int, _value: *mut *const c_char) {
        Ok(Status::Discard)
    }
}

#[cfg(test)]
mod tests {
    use super::path_of_uri;

    #[test]
    fn uris_of_all_importers_are_read() {
        for (uri, path) in [
            ("file:///tmp/a%20b/resources", "/tmp/a b/resources"),
            ("file:/tmp/resources/", "/tmp/resources/"),
            ("file://localhost/tmp/r", "/tmp/r"),
            ("file:///C:/temp/r", "C:/temp/r"),
        ] {
            assert_eq!(path_of_uri(uri).as_deref(), Ok(path));
        }
        for uri in ["", "/tmp/resources", "http://a/b", "file://host", "file:///%ff"] {
            assert!(path_of_uri(uri).is_err(), "{uri}");
        }
    }
}
