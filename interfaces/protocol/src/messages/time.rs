//! Times: `i64` nanoseconds on the wire, `u64` in the core.

use crate::MessageError;

/// Converts a time on the wire to one of the core, ns.
pub(super) fn checked_core_ns(place: &str, ns: i64) -> Result<u64, MessageError> {
    u64::try_from(ns).map_err(|_| MessageError::new(place, "a time from 0 ns on", ns))
}

/// Converts a time of the core to one on the wire, ns; times beyond 292 years become the last one.
pub fn ns(time_ns: u64) -> i64 {
    i64::try_from(time_ns).unwrap_or(i64::MAX)
}

/// Converts a time on the wire to one of the core, ns; times before the start of the run become 0.
pub fn core_ns(time_ns: i64) -> u64 {
    u64::try_from(time_ns).unwrap_or(0)
}
