//! C functions of FMI 3.0, co-simulation.
//!
//! Names, arguments and meaning are those of the standard, version 3.0.2.

use crate::abi::{self, ANY};
use crate::bed_backend::PartialStep;
use crate::fmi2::functions;
use crate::logger::{LogFunction3, LogReceiver};
use crate::status::{Status, UnitPhase};
use std::ffi::{c_char, c_void};

pub use crate::fmi3_types::*;
pub use crate::fmi3_unsupported::*;

/// Returns the version of the standard.
#[unsafe(no_mangle)]
pub extern "C" fn fmi3GetVersion() -> *const c_char {
    c"3.0".as_ptr()
}

/// Creates an instance; null, with a message, if that fails.
///
/// # Safety
/// The arguments follow the standard.
#[unsafe(no_mangle)]
#[allow(clippy::too_many_arguments)]
pub unsafe extern "C" fn fmi3InstantiateCoSimulation(
    name: *const c_char,
    token: *const c_char,
    resources: *const c_char,
    _visible: u8,
    logging_on: u8,
    event_mode_used: u8,
    early_return_allowed: u8,
    _intermediate: *const u32,
    _intermediate_count: usize,
    environment: *mut c_void,
    log: Option<LogFunction3>,
    _intermediate_update: *mut c_void,
) -> *mut c_void {
    let receiver = log.map_or(LogReceiver::Nobody, |log| LogReceiver::Fmi3(log, environment));
    let refusal = (event_mode_used != 0)
        .then_some("fmi3InstantiateCoSimulation: expected no event mode, which the unit lacks");
    // SAFETY: the importer's texts end with NUL.
    let instance = unsafe {
        let path = || Ok(abi::text_or_empty(resources).to_string_lossy().into_owned());
        abi::instantiate([name, token], path, receiver, logging_on != 0, refusal)
    };
    if !instance.is_null() {
        abi::call(instance, "fmi3InstantiateCoSimulation", ANY, |i| {
            i.accepts_early_return = early_return_allowed != 0;
            Ok(Status::Ok)
        });
    }
    instance
}

/// Frees an instance.
///
/// # Safety
/// The pointer is null or comes from [`fmi3InstantiateCoSimulation`] and is not used again.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3FreeInstance(instance: *mut c_void) {
    abi::free(instance);
}

functions! {
    /// Selects categories of messages.
    fmi3SetDebugLogging(i, ANY, on: u8, n: usize, categories: *const *const c_char) {
        abi::set_logging(i, on != 0, categories, n)
    }

    /// Sets the start time and enters the initialisation; tolerance and stop time have no effect.
    fmi3EnterInitializationMode(i, UnitPhase::Instantiated as u8, _defined: u8, _tolerance: f64, start: f64, _stops: u8, _stop: f64) {
        i.set_start(start)?;
        i.enter_initialization();
        Ok(Status::Ok)
    }

    /// Leaves the initialisation.
    fmi3ExitInitializationMode(i, UnitPhase::Initialization as u8) {
        i.exit_initialization()?;
        Ok(Status::Ok)
    }

    /// Ends the simulation.
    fmi3Terminate(i, UnitPhase::Step as u8) {
        i.terminate();
        Ok(Status::Ok)
    }

    /// Returns to the state after the instantiation.
    fmi3Reset(i, ANY) {
        i.reset()?;
        Ok(Status::Ok)
    }

    /// Advances by a step; one that fails ends early where the importer allows it, and is discarded elsewhere.
    fmi3DoStep(
        i, UnitPhase::Step as u8, time: f64, length: f64, _no_set_state: u8, event_needed: *mut u8, terminate: *mut u8,
        early: *mut u8, last_time: *mut f64
    ) {
        abi::put(event_needed, 0);
        abi::put(terminate, 0);
        abi::put(early, 0);
        abi::put(last_time, i.time());
        let partial =
            if i.accepts_early_return { PartialStep::Keep } else { PartialStep::RollBack };
        let outcome = i.do_step(time, length, partial)?;
        abi::put(early, u8::from(outcome.is_early));
        abi::put(last_time, i.time());
        Ok(outcome.status)
    }
}
