//! Coupling over Zenoh: a server that steps a component for another process, and the client of it.
//!
//! [`session`]: endpoints and Zenoh configuration, on the loopback by default. [`server`]: passes requests to the
//! lockstep of `ballast-protocol`. [`client`]: sends requests, with retries. [`keys`]: key expressions.

pub mod client;
pub mod error;
pub mod keys;
pub mod server;
pub mod session;

mod wire;

pub use ballast_protocol::description::ComponentDescription;
pub use client::{Client, Connection, StoredStates, Timeouts};
pub use error::Error;
pub use keys::Keys;
pub use server::{Server, ServerHooks};
pub use session::{Purpose, SessionConfig};

use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Time between two heartbeats of a component.
pub const HEARTBEAT_INTERVAL: Duration = Duration::from_millis(500);
/// Default time without heartbeat and liveliness token after which a component counts as disconnected.
pub const DISCONNECT_TIMEOUT: Duration =
    Duration::from_millis(3 * HEARTBEAT_INTERVAL.as_millis() as u64);
/// Maximum size of a message, bytes. A window of a hundred bodies with a thousand knots each has 11 MB.
pub const MAX_MESSAGE_BYTES: usize = 16 << 20;

/// Returns 128 random bits as hexadecimal digits.
///
/// # Errors
/// The system provides no random numbers.
pub fn random() -> Result<String, Error> {
    let mut bytes = [0; 16];
    getrandom::fill(&mut bytes).map_err(|e| Error::transport("random numbers", e))?;
    Ok(format!("{:032x}", u128::from_be_bytes(bytes)))
}

/// Locks a mutex, also after a panic of another thread: no value is ever partly written.
pub(crate) fn lock_unpoisoned<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
