//! Guards of the C functions: pointers, phases and panics, checked in one place.

use crate::instance::Instance;
use crate::logger::{LogReceiver, UnitLogger};
use crate::status::{Complaint, Status, UnitPhase};
use crate::unit_state::UnitState;
use std::ffi::{CStr, c_char, c_int, c_void};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

/// Phases in which a call is legal, as a sum of [`UnitPhase`]s.
pub(crate) type Phases = u8;

pub(crate) const ANY: Phases = 31;
/// Phases in which the component is usable.
pub(crate) const SOUND: Phases = ANY - UnitPhase::Failed as u8;
/// Phases before the end of the initialisation, and between steps.
pub(crate) const BEFORE_END: Phases = SOUND - UnitPhase::Terminated as u8;

/// Result of a call.
pub(crate) type CallResult = Result<Status, Complaint>;

/// Calls `act` on the instance behind `pointer`; returns the number of the status.
///
/// A null pointer, a call in another phase, and a panic become errors.
pub(crate) fn call(
    pointer: *mut c_void,
    function: &str,
    allowed: Phases,
    act: impl FnOnce(&mut Instance) -> CallResult,
) -> c_int {
    // SAFETY: the importer passes what `instantiate` returned, and no two calls on one instance at a time.
    let Some(instance) = (unsafe { pointer.cast::<Instance>().as_mut() }) else {
        return Status::Error as c_int;
    };
    let phase = instance.phase();
    if allowed & phase as u8 == 0 {
        let text = format!("{function}: expected another phase, found {}", phase.name());
        instance.logger.log(Status::Error, &text);
        return Status::Error as c_int;
    }
    let done = catch_unwind(AssertUnwindSafe(|| act(instance)));
    let status = match done {
        Ok(Ok(status)) => status,
        Ok(Err(Complaint { status, text })) => {
            instance.logger.log(status, &format!("{function}: {text}"));
            status
        }
        Err(panic) => {
            instance.fail();
            let text = panic.downcast_ref::<String>().map(String::as_str);
            let text = text.or(panic.downcast_ref::<&str>().copied()).unwrap_or("unknown");
            instance.logger.log(Status::Error, &format!("{function}: internal error: {text}"));
            Status::Error
        }
    };
    status as c_int
}

/// Creates an instance; returns null, with a message, if that fails.
///
/// # Safety
/// The texts are null or end with NUL; the receiver's function can be called.
pub(crate) unsafe fn instantiate(
    [name, token]: [*const c_char; 2],
    resources: impl FnOnce() -> Result<String, String>,
    receiver: LogReceiver,
    logging_on: bool,
    refusal: Option<&str>,
) -> *mut c_void {
    // SAFETY: as promised by the caller.
    let [name, token] = [name, token].map(|text| unsafe { text_or_empty(text) });
    let logger = UnitLogger::new(receiver, name, logging_on);
    if let Some(refusal) = refusal {
        logger.log(Status::Error, refusal);
        return std::ptr::null_mut();
    }
    let path = match resources() {
        Ok(path) => path,
        Err(text) => {
            logger.log(Status::Error, &text);
            return std::ptr::null_mut();
        }
    };
    let token = token.to_string_lossy();
    let made =
        catch_unwind(AssertUnwindSafe(|| Instance::new(Path::new(&path), &token, logger.clone())));
    match made {
        Ok(Ok(instance)) => Box::into_raw(Box::new(instance)).cast(),
        Ok(Err(error)) => {
            logger.log(Status::Error, &error.to_string());
            std::ptr::null_mut()
        }
        Err(_) => std::ptr::null_mut(),
    }
}

/// Frees an instance; ignores null.
pub(crate) fn free(pointer: *mut c_void) {
    if !pointer.is_null() {
        // SAFETY: the importer passes what `instantiate` returned, once.
        let instance = unsafe { Box::from_raw(pointer.cast::<Instance>()) };
        // A panic must not leave the function.
        let _ = catch_unwind(AssertUnwindSafe(|| drop(instance)));
    }
}

/// Returns a text, or an empty one for null.
///
/// # Safety
/// The text is null or ends with NUL, and lives as long as the result.
pub(crate) unsafe fn text_or_empty<'a>(text: *const c_char) -> &'a CStr {
    if text.is_null() {
        return c"";
    }
    // SAFETY: as promised by the caller.
    unsafe { CStr::from_ptr(text) }
}

fn expect_length<T>(len: usize) -> Result<(), Complaint> {
    if len <= isize::MAX as usize / size_of::<T>().max(1) {
        return Ok(());
    }
    Err(Complaint::error(format!("array: expected a length in memory, found {len}")))
}

/// Returns the array of an importer.
pub(crate) fn array<'a, T>(first: *const T, len: usize) -> Result<&'a [T], Complaint> {
    expect_length::<T>(len)?;
    match (first.is_null(), len) {
        (_, 0) => Ok(&[]),
        (true, _) => Err(Complaint::error("array: expected a pointer, found null")),
        // SAFETY: the importer says that the values are there.
        (false, len) => Ok(unsafe { std::slice::from_raw_parts(first, len) }),
    }
}

/// Returns the array of an importer to write to.
pub(crate) fn array_mut<'a, T>(first: *mut T, len: usize) -> Result<&'a mut [T], Complaint> {
    expect_length::<T>(len)?;
    match (first.is_null(), len) {
        (_, 0) => Ok(&mut []),
        (true, _) => Err(Complaint::error("array: expected a pointer, found null")),
        // SAFETY: the importer says that the room is there.
        (false, len) => Ok(unsafe { std::slice::from_raw_parts_mut(first, len) }),
    }
}

/// Writes a result, unless the importer does not want it.
pub(crate) fn put<T>(place: *mut T, value: T) {
    if !place.is_null() {
        // SAFETY: the importer gives a place for the value.
        unsafe { place.write(value) }
    }
}

/// Returns a pointer that must not be null.
fn expect_pointer<'a, T>(pointer: *mut T, what: &str) -> Result<&'a mut T, Complaint> {
    // SAFETY: the importer gives a place for the value.
    let place = unsafe { pointer.as_mut() };
    place.ok_or_else(|| Complaint::error(format!("{what}: expected a pointer, found null")))
}

/// Saves the state of an instance; a state that is already there is replaced.
pub(crate) fn get_state(instance: &mut Instance, place: *mut *mut c_void) -> CallResult {
    let place = expect_pointer(place, "state")?;
    let saved = Box::into_raw(Box::new(instance.save()?)).cast();
    let old = std::mem::replace(place, saved);
    drop_state(old);
    Ok(Status::Ok)
}

/// Restores a saved state.
pub(crate) fn set_state(instance: &mut Instance, saved: *mut c_void) -> CallResult {
    instance.restore(expect_pointer(saved.cast::<UnitState>(), "state")?)?;
    Ok(Status::Ok)
}

/// Frees a saved state, and sets its pointer to null.
pub(crate) fn free_state(place: *mut *mut c_void) -> CallResult {
    // SAFETY: the importer gives the place of a state, or null.
    if let Some(place) = unsafe { place.as_mut() } {
        drop_state(std::mem::replace(place, std::ptr::null_mut()));
    }
    Ok(Status::Ok)
}

fn drop_state(saved: *mut c_void) {
    if !saved.is_null() {
        // SAFETY: the importer passes what `get_state` returned, once.
        drop(unsafe { Box::from_raw(saved.cast::<UnitState>()) });
    }
}

/// Returns the length of a serialised state.
pub(crate) fn state_size(saved: *mut c_void, size: *mut usize) -> CallResult {
    let saved = expect_pointer(saved.cast::<UnitState>(), "state")?;
    *expect_pointer(size, "size")? = saved.to_bytes()?.len();
    Ok(Status::Ok)
}

/// Serialises a state.
pub(crate) fn write_state(saved: *mut c_void, bytes: *mut u8, size: usize) -> CallResult {
    let saved = expect_pointer(saved.cast::<UnitState>(), "state")?.to_bytes()?;
    let Some(place) = array_mut(bytes, size)?.get_mut(..saved.len()) else {
        let text = format!("size: expected {} bytes, found {size}", saved.len());
        return Err(Complaint::error(text));
    };
    place.copy_from_slice(saved);
    Ok(Status::Ok)
}

/// Reads a serialised state.
pub(crate) fn read_state(
    instance: &Instance,
    bytes: *const u8,
    size: usize,
    place: *mut *mut c_void,
) -> CallResult {
    let place = expect_pointer(place, "state")?;
    let saved = instance.read_state(array(bytes, size)?)?;
    let old = std::mem::replace(place, Box::into_raw(Box::new(saved)).cast());
    drop_state(old);
    Ok(Status::Ok)
}

/// Selects categories of messages.
pub(crate) fn set_logging(
    instance: &mut Instance,
    logging_on: bool,
    categories: *const *const c_char,
    count: usize,
) -> CallResult {
    let categories = array(categories, count)?;
    // SAFETY: the importer's texts end with NUL.
    let categories: Vec<&CStr> = categories.iter().map(|&c| unsafe { text_or_empty(c) }).collect();
    if instance.logger.select(logging_on, &categories) {
        return Ok(Status::Ok);
    }
    Err(Complaint::error("categories: expected those of the description, found another"))
}
