//! Log messages of Zenoh on standard error.

use std::io::IsTerminal;
use tracing_subscriber::EnvFilter;

/// Installs a subscriber that prints the messages selected by `RUST_LOG`, for example `RUST_LOG=zenoh=debug`.
///
/// Prints nothing by default: errors of Zenoh that matter are part of the program's messages.
pub fn install() {
    let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new("off"));
    let subscriber = tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(std::io::stderr)
        .with_ansi(std::io::stderr().is_terminal());
    // Fails only if a subscriber is already installed.
    let _ = subscriber.try_init();
}
