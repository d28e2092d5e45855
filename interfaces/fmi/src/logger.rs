//! Messages to the importer.

use crate::status::Status;
use std::ffi::{CStr, CString, c_char, c_int, c_void};

/// Function of an importer that receives messages after FMI 2.0, as `printf` does.
pub type LogFunction2 =
    unsafe extern "C" fn(*mut c_void, *const c_char, c_int, *const c_char, *const c_char, ...);
/// Function of an importer that receives messages after FMI 3.0.
pub type LogFunction3 = unsafe extern "C" fn(*mut c_void, c_int, *const c_char, *const c_char);

/// Categories of messages, one for each status but `OK`.
pub const CATEGORIES: [&CStr; 3] = [c"logStatusWarning", c"logStatusDiscard", c"logStatusError"];

/// Receiver of messages.
#[derive(Debug, Clone, Copy)]
pub enum LogReceiver {
    /// Importer that gave no function.
    Nobody,
    /// Function and environment of an importer after FMI 2.0.
    Fmi2(LogFunction2, *mut c_void),
    /// Function and environment of an importer after FMI 3.0.
    Fmi3(LogFunction3, *mut c_void),
}

/// Logger of an instance.
#[derive(Debug, Clone)]
pub struct UnitLogger {
    receiver: LogReceiver,
    name: CString,
    /// Categories that are passed on; errors and discarded steps always are.
    selected: Vec<&'static CStr>,
}

impl UnitLogger {
    /// Creates the logger of the instance `name`, with warnings if `logging_on`.
    pub fn new(receiver: LogReceiver, name: &CStr, logging_on: bool) -> Self {
        let mut logger = Self { receiver, name: name.into(), selected: Vec::new() };
        logger.select(logging_on, &[]);
        logger
    }

    /// Selects categories; all if the list is empty. Returns false for a category that does not exist.
    pub fn select(&mut self, logging_on: bool, categories: &[&CStr]) -> bool {
        let known = |wanted: &&CStr| CATEGORIES.iter().any(|known| known == wanted);
        let wanted = |known: &&CStr| categories.is_empty() || categories.contains(known);
        self.selected.clear();
        if logging_on {
            self.selected.extend(CATEGORIES.into_iter().filter(wanted));
        }
        categories.iter().all(known)
    }

    /// Passes a message on.
    pub fn log(&self, status: Status, text: &str) {
        let category = match status {
            Status::Ok | Status::Warning => CATEGORIES[0],
            Status::Discard => CATEGORIES[1],
            Status::Error => CATEGORIES[2],
        };
        let is_selected = self.selected.contains(&category);
        if matches!(status, Status::Ok | Status::Warning) && !is_selected {
            return;
        }
        let text = CString::new(text.replace('\0', " ")).unwrap_or_default();
        let category = category.as_ptr();
        match self.receiver {
            LogReceiver::Nobody => {}
            LogReceiver::Fmi2(log, environment) => {
                // The message is data, not a format: it may contain per cent signs.
                // SAFETY: the function and its environment come from the importer, which keeps them as long as the
                // instance; all texts end with NUL and outlive the call.
                unsafe {
                    log(
                        environment,
                        self.name.as_ptr(),
                        status as c_int,
                        category,
                        c"%s".as_ptr(),
                        text.as_ptr(),
                    );
                }
            }
            LogReceiver::Fmi3(log, environment) => {
                // SAFETY: as above.
                unsafe { log(environment, status as c_int, category, text.as_ptr()) }
            }
        }
    }
}
