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

pub use client::Client;
pub use error::Error;
pub use keys::Keys;
pub use link::Link;
pub use server::Server;
