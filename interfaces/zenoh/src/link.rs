//! How processes find each other: Zenoh's own configuration, with defaults that keep to this machine.

use crate::{Error, LARGEST_MESSAGE, SILENCE};
use std::net::TcpListener;
use std::path::PathBuf;
use zenoh::{Config, Wait};

/// Where a component listens when nobody says otherwise, and where its clients look for it.
pub const DEFAULT_ENDPOINT: &str = "tcp/127.0.0.1:7447";
/// A peer that does not take what it is told is cut off after so long, µs: others must not wait for it, and
/// it must not miss something without noticing.
const PATIENCE_WITH_OBSERVERS_US: u32 = 1_000_000;

/// How often a connection is tried, ms.
const RETRY: &str = "{ period_init_ms: 100, period_max_ms: 500, period_increase_factor: 2 }";

/// Where a process listens, what it connects to, and anything else that Zenoh can be told.
///
/// Nothing given: a peer that neither listens nor looks around.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Link {
    /// A Zenoh configuration file (JSON5), for routers, TLS, users, and all else. What it does not say is
    /// as Zenoh has it, not as below.
    pub config: Option<PathBuf>,
    /// Endpoints to listen on: `tcp/127.0.0.1:7447`.
    pub listen: Vec<String>,
    /// Endpoints to connect to.
    pub connect: Vec<String>,
}

impl Link {
    /// Listens on one endpoint.
    pub fn listening(endpoint: impl Into<String>) -> Self {
        Self { listen: vec![endpoint.into()], ..Self::default() }
    }

    /// Connects to one endpoint.
    pub fn to(endpoint: impl Into<String>) -> Self {
        Self { connect: vec![endpoint.into()], ..Self::default() }
    }

    /// A Zenoh configuration file.
    pub fn configured(path: impl Into<PathBuf>) -> Self {
        Self { config: Some(path.into()), ..Self::default() }
    }

    /// Whether nothing at all was said.
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }

    /// Opens the session. One that connects does not wait for the other side: partners start in any order.
    ///
    /// # Errors
    /// A configuration that Zenoh does not take, an endpoint that cannot be listened on.
    pub fn open(&self) -> Result<zenoh::Session, Error> {
        let place = match (&self.config, self.listen.first(), self.connect.first()) {
            (Some(path), ..) => path.display().to_string(),
            (None, Some(endpoint), _) | (None, None, Some(endpoint)) => endpoint.clone(),
            (None, None, None) => "zenoh".into(),
        };
        zenoh::open(self.configuration()?).wait().map_err(|e| Error::link(place, e))
    }

    fn configuration(&self) -> Result<Config, Error> {
        let mut config = match &self.config {
            Some(path) => {
                Config::from_file(path).map_err(|e| Error::link(path.display().to_string(), e))?
            }
            None => local()?,
        };
        if !self.listen.is_empty() {
            set(&mut config, "listen/endpoints", &list(&self.listen))?;
        }
        if !self.connect.is_empty() {
            set(&mut config, "connect/endpoints", &list(&self.connect))?;
        }
        Ok(config)
    }
}

/// An endpoint on the loopback whose port was free a moment ago.
///
/// # Errors
/// The system gives none.
pub fn free_endpoint() -> Result<String, Error> {
    let socket = TcpListener::bind("127.0.0.1:0").and_then(|listener| listener.local_addr());
    socket.map(|at| format!("tcp/{at}")).map_err(|e| Error::link("loopback", e))
}

/// Scouting would find, and be found by, strangers on the network; without an endpoint of its own a Zenoh
/// peer would listen on all interfaces.
fn local() -> Result<Config, Error> {
    let mut config = Config::default();
    let (largest, lease) = (LARGEST_MESSAGE + (1 << 16), SILENCE.as_millis());
    for (key, value) in [
        ("mode", "\"peer\"".to_string()),
        ("scouting/multicast/enabled", "false".into()),
        ("scouting/gossip/enabled", "false".into()),
        ("listen/endpoints", "[]".into()),
        ("listen/exit_on_failure", "true".into()),
        ("listen/timeout_ms", "0".into()),
        ("connect/timeout_ms", "-1".into()),
        ("connect/exit_on_failure", "false".into()),
        ("connect/retry", RETRY.into()),
        // A partner that has fallen silent is noticed after this time, ms.
        ("transport/link/tx/lease", lease.to_string()),
        ("transport/link/rx/max_message_size", largest.to_string()),
        (
            "transport/link/tx/queue/congestion_control/block/wait_before_close",
            PATIENCE_WITH_OBSERVERS_US.to_string(),
        ),
    ] {
        set(&mut config, key, &value)?;
    }
    Ok(config)
}

fn set(config: &mut Config, key: &str, value: &str) -> Result<(), Error> {
    config.insert_json5(key, value).map_err(|e| Error::link(key, e))
}

fn list(endpoints: &[String]) -> String {
    serde_json::Value::from(endpoints.to_vec()).to_string()
}
