//! Functions of FMI 2.0 that a unit without derivatives and model exchange does not support.
//!
//! They exist, because importers look all functions up, and return an error.

use std::ffi::{c_int, c_void};

/// Defines functions that log and return an error.
macro_rules! unsupported {
    ($($name:ident($($type:ty),*);)*) => {$(
        /// Returns an error: the unit does not support it.
        ///
        /// # Safety
        /// The pointer is null or an instance.
        #[unsafe(no_mangle)]
        pub unsafe extern "C" fn $name(c: *mut std::ffi::c_void $(, _: $type)*) -> std::ffi::c_int {
            $crate::abi::call(c, stringify!($name), $crate::abi::ANY, |_| {
                Err($crate::status::Complaint::error("expected a unit that supports it, found one that does not"))
            })
        }
    )*};
}
pub(crate) use unsupported;

unsupported! {
    fmi2GetDirectionalDerivative(*const u32, usize, *const u32, usize, *const f64, *mut f64);
    fmi2SetRealInputDerivatives(*const u32, usize, *const c_int, *const f64);
    fmi2GetRealOutputDerivatives(*const u32, usize, *const c_int, *mut f64);
    fmi2EnterEventMode();
    fmi2NewDiscreteStates(*mut c_void);
    fmi2EnterContinuousTimeMode();
    fmi2CompletedIntegratorStep(c_int, *mut c_int, *mut c_int);
    fmi2SetTime(f64);
    fmi2SetContinuousStates(*const f64, usize);
    fmi2GetDerivatives(*mut f64, usize);
    fmi2GetEventIndicators(*mut f64, usize);
    fmi2GetContinuousStates(*mut f64, usize);
    fmi2GetNominalsOfContinuousStates(*mut f64, usize);
}
