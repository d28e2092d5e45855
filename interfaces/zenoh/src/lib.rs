//! Ballast over Zenoh: a component that is stepped from another process, and the client that steps it.
//!
//! [`link`]: how processes find each other, on the loopback unless told otherwise. [`server`]: carries
//! requests to the lockstep of `ballast-protocol` and its answers back. [`client`]: the other end, with
//! retries. [`keys`]: the names under which all this is found.

pub mod client;
pub mod error;
pub mod keys;
pub mod link;
pub mod server;

mod wire;

pub use ballast_protocol::description::ComponentDescription;
pub use client::{Client, Connection, Timeouts};
pub use error::Error;
pub use keys::Keys;
pub use link::{Purpose, SessionConfig};
pub use server::{Server, ServerHooks};

use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Between two signs of life of a component.
pub const HEARTBEAT_INTERVAL: Duration = Duration::from_millis(500);
/// A component that is not alive and silent for so long is lost: three heartbeats.
pub const DISCONNECT_TIMEOUT: Duration =
    Duration::from_millis(3 * HEARTBEAT_INTERVAL.as_millis() as u64);
/// Largest message that is taken, bytes. A window of a hundred bodies with a thousand knots each has 11 MB.
pub const MAX_MESSAGE_BYTES: usize = 16 << 20;

/// 128 random bits as hexadecimal digits.
///
/// # Errors
/// The system gives none.
pub fn random() -> Result<String, Error> {
    let mut bytes = [0; 16];
    getrandom::fill(&mut bytes).map_err(|e| Error::link("random numbers", e))?;
    Ok(format!("{:032x}", u128::from_be_bytes(bytes)))
}

/// What a panic elsewhere has left is as good as before: nothing here is half written.
pub(crate) fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
