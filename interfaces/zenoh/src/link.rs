//! How processes find each other: Zenoh's own configuration, with defaults that keep to this machine.

use crate::Error;
use std::path::PathBuf;
use zenoh::{Config, Wait};

/// Where a process listens, what it connects to, and anything else that Zenoh can be told.
///
/// Nothing given: a peer that neither listens nor looks around.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Link {
    /// A Zenoh configuration file (JSON5), for routers, TLS, users, and all else.
    pub config: Option<PathBuf>,
    /// Endpoints to listen on: `tcp/127.0.0.1:7447`.
    pub listen: Vec<String>,
    /// Endpoints to connect to.
    pub connect: Vec<String>,
}

/// Largest message that is taken, bytes: a window of many knots has a few.
pub const LARGEST_MESSAGE: usize = 64 << 20;

impl Link {
    /// Listens on one endpoint.
    pub fn listening(endpoint: impl Into<String>) -> Self {
        Self { listen: vec![endpoint.into()], ..Self::default() }
    }

    /// Connects to one endpoint.
    pub fn to(endpoint: impl Into<String>) -> Self {
        Self { connect: vec![endpoint.into()], ..Self::default() }
    }

    /// Opens the session.
    ///
    /// # Errors
    /// A configuration that Zenoh does not take, an endpoint that cannot be listened on.
    pub fn open(&self) -> Result<zenoh::Session, Error> {
        zenoh::open(self.configuration()?).wait().map_err(|e| Error::link("zenoh", e))
    }

    fn configuration(&self) -> Result<Config, Error> {
        let mut config = match &self.config {
            Some(path) => {
                Config::from_file(path).map_err(|e| Error::link(path.display().to_string(), e))?
            }
            None => {
                let mut config = Config::default();
                // Scouting would find, and be found by, strangers on the network; without an endpoint of
                // its own a Zenoh peer listens on all interfaces.
                set(&mut config, "scouting/multicast/enabled", "false")?;
                set(&mut config, "scouting/gossip/enabled", "false")?;
                set(&mut config, "listen/endpoints", "[]")?;
                // A partner that has died is noticed after this time, ms.
                set(&mut config, "transport/link/tx/lease", "2000")?;
                set(&mut config, "transport/link/rx/max_message_size", &LARGEST_MESSAGE.to_string())?;
                config
            }
        };
        if !self.listen.is_empty() {
            set(&mut config, "listen/endpoints", &list(&self.listen))?;
        }
        if !self.connect.is_empty() {
            set(&mut config, "connect/endpoints", &list(&self.connect))?;
            // Keeps trying: partners start in any order.
            if self.config.is_none() {
                set(&mut config, "connect/timeout_ms", "-1")?;
                set(&mut config, "connect/exit_on_failure", "false")?;
            }
        }
        Ok(config)
    }
}

fn set(config: &mut Config, key: &str, value: &str) -> Result<(), Error> {
    config.insert_json5(key, value).map_err(|e| Error::link(key, e))
}

fn list(endpoints: &[String]) -> String {
    serde_json::Value::from(endpoints.to_vec()).to_string()
}
