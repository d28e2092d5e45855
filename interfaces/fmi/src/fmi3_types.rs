//! Functions of FMI 3.0 that read and set variables, one pair for each type.

use crate::abi::{self, BEFORE_END, SOUND, array, array_mut};
use crate::fmi2::functions;
use crate::status::Status;
use crate::variables::ValueType;
use std::ffi::{c_char, c_void};

functions! {
    /// Reads real variables.
    fmi3GetFloat64(i, SOUND, vr: *const u32, n: usize, values: *mut f64, count: usize) {
        let (vr, values) = (array(vr, n)?, array_mut(values, count)?);
        i.get(vr, &[ValueType::Real], count, |k, value| values[k] = value)?;
        Ok(Status::Ok)
    }

    /// Sets real variables.
    fmi3SetFloat64(i, BEFORE_END, vr: *const u32, n: usize, values: *const f64, count: usize) {
        i.set(array(vr, n)?, &[ValueType::Real], array(values, count)?)?;
        Ok(Status::Ok)
    }

    /// Reads whole numbers.
    fmi3GetInt32(i, SOUND, vr: *const u32, n: usize, values: *mut i32, count: usize) {
        let (vr, values) = (array(vr, n)?, array_mut(values, count)?);
        i.get(vr, &[ValueType::Integer], count, |k, value| values[k] = value as i32)?;
        Ok(Status::Ok)
    }

    /// Sets whole numbers.
    fmi3SetInt32(i, BEFORE_END, vr: *const u32, n: usize, values: *const i32, count: usize) {
        let values: Vec<f64> = array(values, count)?.iter().map(|&v| f64::from(v)).collect();
        i.set(array(vr, n)?, &[ValueType::Integer], &values)?;
        Ok(Status::Ok)
    }

    /// Reads enumerations.
    fmi3GetInt64(i, SOUND, vr: *const u32, n: usize, values: *mut i64, count: usize) {
        let (vr, values) = (array(vr, n)?, array_mut(values, count)?);
        i.get(vr, &[ValueType::InputTime], count, |k, value| values[k] = value as i64)?;
        Ok(Status::Ok)
    }

    /// Sets enumerations.
    fmi3SetInt64(i, BEFORE_END, vr: *const u32, n: usize, values: *const i64, count: usize) {
        let values: Vec<f64> = array(values, count)?.iter().map(|&v| v as f64).collect();
        i.set(array(vr, n)?, &[ValueType::InputTime], &values)?;
        Ok(Status::Ok)
    }

    /// Reads texts, which live until the next call.
    fmi3GetString(i, SOUND, vr: *const u32, n: usize, values: *mut *const c_char, count: usize) {
        let (vr, values) = (array(vr, n)?, array_mut(values, count)?);
        i.expect_count(vr.len(), count)?;
        for (value, &vr) in values.iter_mut().zip(vr) {
            *value = i.text(vr)?;
        }
        Ok(Status::Ok)
    }

    /// Reads binary variables, of which there are none.
    fmi3GetBinary(i, SOUND, vr: *const u32, n: usize, _sizes: *mut usize, _values: *mut *const u8, count: usize) {
        i.get(array(vr, n)?, &[], count, |_, _| ())?;
        Ok(Status::Ok)
    }

    /// Sets binary variables, of which there are none.
    fmi3SetBinary(i, BEFORE_END, vr: *const u32, n: usize, _sizes: *const usize, _values: *const *const u8, count: usize) {
        i.expect_count(0, count)?;
        i.set(array(vr, n)?, &[], &[])?;
        Ok(Status::Ok)
    }

    /// Reads clocks, of which there are none.
    fmi3GetClock(i, SOUND, vr: *const u32, n: usize, _values: *mut u8) {
        i.get(array(vr, n)?, &[], 0, |_, _| ())?;
        Ok(Status::Ok)
    }

    /// Sets clocks, of which there are none.
    fmi3SetClock(i, BEFORE_END, vr: *const u32, n: usize, _values: *const u8) {
        i.set(array(vr, n)?, &[], &[])?;
        Ok(Status::Ok)
    }
}

/// Defines the functions of types that no variable has.
macro_rules! without_variables {
    ($($get:ident, $set:ident: $type:ty;)*) => {
        functions! {$(
            /// Reads variables of a type that the unit does not use.
            $get(i, SOUND, vr: *const u32, n: usize, _values: *mut $type, count: usize) {
                i.get(array(vr, n)?, &[], count, |_, _| ())?;
                Ok(Status::Ok)
            }

            /// Sets variables of a type that the unit does not use.
            $set(i, BEFORE_END, vr: *const u32, n: usize, _values: *const $type, count: usize) {
                i.expect_count(0, count)?;
                i.set(array(vr, n)?, &[], &[])?;
                Ok(Status::Ok)
            }
        )*}
    };
}

without_variables! {
    fmi3GetFloat32, fmi3SetFloat32: f32;
    fmi3GetInt8, fmi3SetInt8: i8;
    fmi3GetUInt8, fmi3SetUInt8: u8;
    fmi3GetInt16, fmi3SetInt16: i16;
    fmi3GetUInt16, fmi3SetUInt16: u16;
    fmi3GetUInt32, fmi3SetUInt32: u32;
    fmi3GetUInt64, fmi3SetUInt64: u64;
    fmi3GetBoolean, fmi3SetBoolean: u8;
}

functions! {
    /// Sets texts, of which none can be set.
    fmi3SetString(i, BEFORE_END, vr: *const u32, n: usize, _values: *const *const c_char, count: usize) {
        i.expect_count(0, count)?;
        i.set(array(vr, n)?, &[], &[])?;
        Ok(Status::Ok)
    }

    /// Saves the state.
    fmi3GetFMUState(i, SOUND, state: *mut *mut c_void) {
        abi::get_state(i, state)
    }

    /// Restores a state.
    fmi3SetFMUState(i, abi::ANY, state: *mut c_void) {
        abi::set_state(i, state)
    }

    /// Frees a state.
    fmi3FreeFMUState(_i, abi::ANY, state: *mut *mut c_void) {
        abi::free_state(state)
    }

    /// Returns the size of a serialised state, bytes.
    fmi3SerializedFMUStateSize(_i, abi::ANY, state: *mut c_void, size: *mut usize) {
        abi::state_size(state, size)
    }

    /// Serialises a state.
    fmi3SerializeFMUState(_i, abi::ANY, state: *mut c_void, bytes: *mut u8, size: usize) {
        abi::write_state(state, bytes, size)
    }

    /// Reads a serialised state.
    fmi3DeserializeFMUState(i, abi::ANY, bytes: *const u8, size: usize, state: *mut *mut c_void) {
        abi::read_state(i, bytes, size, state)
    }
}
