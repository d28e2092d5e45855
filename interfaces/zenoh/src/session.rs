//! Zenoh sessions: endpoints and configuration, with defaults that stay on the local machine.

use crate::{DISCONNECT_TIMEOUT, Error, MAX_MESSAGE_BYTES};
use serde_json::Value;
use std::net::{Ipv4Addr, TcpListener};
use std::ops::Range;
use std::path::PathBuf;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};
use zenoh::{Config, Wait};

/// Default endpoint, on which components listen and to which clients connect.
pub const DEFAULT_ENDPOINT: &str = "tcp/127.0.0.1:7447";
/// Zenoh key: maximum time to send a blocking message before the connection is closed, µs.
const WAIT_BEFORE_CLOSE: &str =
    "transport/link/tx/queue/congestion_control/block/wait_before_close";
/// Zenoh keys: maximum time to send a droppable message before it is dropped, for its first fragment and in total, µs.
const WAIT_BEFORE_DROP: [&str; 2] = [
    "transport/link/tx/queue/congestion_control/drop/wait_before_drop",
    "transport/link/tx/queue/congestion_control/drop/max_wait_before_drop_fragments",
];

/// Purpose of a session, which decides how long it waits for slow connections.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash)]
pub enum Purpose {
    /// Serves a component. A peer that does not accept messages is disconnected after a second, so that others need not
    /// wait and the peer notices the loss.
    #[default]
    Component,
    /// Sends requests to a component. Large requests may take long on a slow connection.
    Client,
    /// Sends visualizations, which may be dropped.
    Viewer,
}

impl Purpose {
    fn settings(self) -> &'static [(&'static str, &'static str)] {
        match self {
            Self::Component => &[(WAIT_BEFORE_CLOSE, "1000000")],
            Self::Client => &[(WAIT_BEFORE_CLOSE, "60000000")],
            Self::Viewer => &[(WAIT_BEFORE_DROP[0], "100000"), (WAIT_BEFORE_DROP[1], "5000000")],
        }
    }
}

const LISTEN: &str = "listen/endpoints";
const CONNECT: &str = "connect/endpoints";

/// Maximum time to find the router of a session in mode `client`, ms.
const ROUTER_TIMEOUT: &str = "5000";
/// Intervals between connection attempts, ms.
const RETRY: &str = "{ period_init_ms: 100, period_max_ms: 500, period_increase_factor: 2 }";

/// Configuration of a Zenoh session: endpoints, router and configuration file.
///
/// The default is a peer that neither listens nor connects.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct SessionConfig {
    /// Zenoh configuration file (JSON5) for TLS, users and other settings.
    ///
    /// Settings that it leaves at Zenoh's defaults are as without a file: no scouting, no endpoint, bounded messages.
    pub config: Option<PathBuf>,
    /// Endpoints to listen on, such as `tcp/127.0.0.1:7447`.
    pub listen: Vec<String>,
    /// Endpoints to connect to.
    pub connect: Vec<String>,
    /// Endpoint of a router, to which the session connects in mode `client`.
    ///
    /// Routers forward nothing between two peers, so that at least one partner must be a client. The router must run
    /// when the session is opened.
    pub router: Option<String>,
    /// Use of [`DEFAULT_ENDPOINT`] if neither the fields nor the file name an endpoint.
    pub default_endpoint: DefaultEndpoint,
}

/// Use of the default endpoint by a session without endpoints.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash)]
pub enum DefaultEndpoint {
    /// Neither listens nor connects.
    #[default]
    None,
    /// Listens on the default endpoint.
    Listen,
    /// Connects to the default endpoint.
    Connect,
}

impl SessionConfig {
    /// Creates a session that listens on one endpoint.
    pub fn listen_on(endpoint: impl Into<String>) -> Self {
        Self { listen: vec![endpoint.into()], ..Self::default() }
    }

    /// Creates a session that connects to one endpoint.
    pub fn connect_to(endpoint: impl Into<String>) -> Self {
        Self { connect: vec![endpoint.into()], ..Self::default() }
    }

    /// Creates a session that is a client of one router.
    pub fn via_router(router: impl Into<String>) -> Self {
        Self { router: Some(router.into()), ..Self::default() }
    }

    /// Creates a session with a Zenoh configuration file.
    pub fn from_file(path: impl Into<PathBuf>) -> Self {
        Self { config: Some(path.into()), ..Self::default() }
    }

    /// Makes a session without endpoints listen on the default one.
    pub fn or_listen_on_default(self) -> Self {
        Self { default_endpoint: DefaultEndpoint::Listen, ..self }
    }

    /// Makes a session without endpoints connect to the default one.
    pub fn or_connect_to_default(self) -> Self {
        Self { default_endpoint: DefaultEndpoint::Connect, ..self }
    }

    /// Opens the session. It does not wait for its peers, so that partners can start in any order.
    ///
    /// # Errors
    /// An invalid configuration, an endpoint that is in use, or a router that does not run.
    pub fn open(&self) -> Result<zenoh::Session, Error> {
        self.open_for(Purpose::default())
    }

    /// Opens the session with the settings of a purpose.
    ///
    /// # Errors
    /// An invalid configuration, an endpoint that is in use, or a router that does not run.
    pub fn open_for(&self, purpose: Purpose) -> Result<zenoh::Session, Error> {
        let endpoint = self.router.as_ref().or(self.listen.first()).or(self.connect.first());
        let place = match (&self.config, endpoint) {
            (Some(path), _) => path.display().to_string(),
            (None, Some(endpoint)) => endpoint.clone(),
            (None, None) => "zenoh".into(),
        };
        zenoh::open(self.configuration(purpose)?).wait().map_err(|e| match &self.router {
            Some(_) => Error::transport(place, format!("expected a Zenoh router, found none: {e}")),
            None => Error::transport(place, e),
        })
    }

    /// Returns the endpoints that the session listens on.
    ///
    /// # Errors
    /// An invalid configuration.
    pub fn listen_endpoints(&self) -> Result<Vec<String>, Error> {
        let config = self.configuration(Purpose::default())?;
        let json =
            |key: &str| -> Option<Value> { serde_json::from_str(&config.get_json(key).ok()?).ok() };
        let endpoints = json(LISTEN).unwrap_or_default();
        // Each mode may have a separate list.
        let listed = endpoints.as_array().or_else(|| endpoints[mode(&config)].as_array());
        let texts = listed.into_iter().flatten().filter_map(Value::as_str);
        Ok(texts.map(String::from).collect())
    }

    /// Returns true if `session`, opened with this configuration, is a peer of a router, which forwards nothing to peers.
    pub(crate) fn is_isolated_by_router(&self, session: &zenoh::Session) -> bool {
        let is_peer = self.configuration(Purpose::default()).is_ok_and(|c| mode(&c) == "peer");
        is_peer && session.info().routers_zid().wait().next().is_some()
    }

    fn configuration(&self, purpose: Purpose) -> Result<Config, Error> {
        let mut config = match &self.config {
            Some(path) => Config::from_file(path)
                .map_err(|e| Error::transport(path.display().to_string(), e))?,
            None => Config::default(),
        };
        let named = self.listen.iter().chain(&self.connect).chain(&self.router);
        named.into_iter().try_for_each(|endpoint| check_endpoint(endpoint))?;
        if let Some(router) = &self.router {
            set(&mut config, "mode", "\"client\"")?;
            set(&mut config, CONNECT, &list(std::slice::from_ref(router)))?;
        }
        apply_defaults(&mut config, purpose)?;
        if !self.listen.is_empty() {
            set(&mut config, LISTEN, &list(&self.listen))?;
        }
        if !self.connect.is_empty() {
            set(&mut config, CONNECT, &list(&self.connect))?;
        }
        let is_named = [LISTEN, CONNECT].iter().any(|key| has_endpoint(&config, key));
        let default = list(&[DEFAULT_ENDPOINT.into()]);
        match self.default_endpoint {
            DefaultEndpoint::Listen if !is_named => set(&mut config, LISTEN, &default)?,
            DefaultEndpoint::Connect if !is_named => set(&mut config, CONNECT, &default)?,
            _ => {}
        }
        Ok(config)
    }
}

/// Ports below those that systems assign to outgoing connections.
const UNASSIGNED_PORTS: Range<u16> = 20_000..32_000;

/// Returns an endpoint on the loopback with a free port, a different one in each call.
///
/// A port that the system assigns as free could become that of an outgoing connection.
///
/// # Errors
/// No port of the range is free.
pub fn free_endpoint() -> Result<String, Error> {
    static TRIED: AtomicU32 = AtomicU32::new(0);
    let count = UNASSIGNED_PORTS.len() as u32;
    // Parallel processes start at different ports.
    let begin = std::process::id().wrapping_mul(101) % count;
    let mut last = None;
    for _ in 0..count {
        let place = (begin + TRIED.fetch_add(1, Relaxed) % count) % count;
        match TcpListener::bind((Ipv4Addr::LOCALHOST, UNASSIGNED_PORTS.start + place as u16)) {
            Ok(listener) => {
                let at = listener.local_addr().map_err(|e| Error::transport("loopback", e))?;
                return Ok(format!("tcp/{at}"));
            }
            Err(e) => last = Some(e),
        }
    }
    Err(Error::transport("loopback", last.map_or("no port is free".into(), |e| e.to_string())))
}

/// Returns an error unless an endpoint has the form PROTOCOL/ADDRESS; the message of Zenoh would name a place in JSON.
fn check_endpoint(endpoint: &str) -> Result<(), Error> {
    let is_whole = |(protocol, address): (&str, &str)| !protocol.is_empty() && !address.is_empty();
    if endpoint.split_once('/').is_some_and(is_whole) {
        return Ok(());
    }
    let text = format!("expected PROTOCOL/ADDRESS, such as {DEFAULT_ENDPOINT}, found {endpoint:?}");
    Err(Error::transport("endpoint", text))
}

/// Replaces defaults of Zenoh, which would scout the network, listen on all interfaces and accept messages of any size.
fn apply_defaults(config: &mut Config, purpose: Purpose) -> Result<(), Error> {
    let zenoh_defaults = Config::default();
    // Requests above the limit are refused with a message up to this size; beyond it, Zenoh drops them.
    let (largest, lease) = (4 * MAX_MESSAGE_BYTES, DISCONNECT_TIMEOUT.as_millis());
    // Zenoh waits for the connection in mode `client` only.
    let connect_timeout = if mode(config) == "client" { ROUTER_TIMEOUT } else { "-1" };
    let settings = [
        ("mode", "\"peer\"".to_string()),
        ("scouting/multicast/enabled", "false".into()),
        ("scouting/gossip/enabled", "false".into()),
        (LISTEN, "[]".into()),
        ("listen/exit_on_failure", "true".into()),
        ("listen/timeout_ms", "0".into()),
        ("connect/timeout_ms", connect_timeout.into()),
        ("connect/exit_on_failure", "false".into()),
        ("connect/retry", RETRY.into()),
        // A silent partner is noticed after this time, ms, also while the session is opened.
        ("transport/link/tx/lease", lease.to_string()),
        ("transport/unicast/open_timeout", lease.to_string()),
        ("transport/link/rx/max_message_size", largest.to_string()),
    ];
    let of_purpose = purpose.settings().iter().map(|(key, value)| (*key, value.to_string()));
    for (key, value) in settings.into_iter().chain(of_purpose) {
        if config.get_json(key).ok() == zenoh_defaults.get_json(key).ok() {
            set(config, key, &value)?;
        }
    }
    Ok(())
}

/// Returns the mode of a session.
fn mode(config: &Config) -> &'static str {
    match config.get_json("mode").as_deref() {
        Ok("\"client\"") => "client",
        Ok("\"router\"") => "router",
        _ => "peer",
    }
}

/// Returns true if a list of endpoints, of any mode, is not empty.
fn has_endpoint(config: &Config, key: &str) -> bool {
    config.get_json(key).is_ok_and(|endpoints| endpoints.contains('/'))
}

fn set(config: &mut Config, key: &str, value: &str) -> Result<(), Error> {
    config.insert_json5(key, value).map_err(|e| Error::transport(key, e))
}

fn list(endpoints: &[String]) -> String {
    serde_json::Value::from(endpoints.to_vec()).to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn with(text: &str, link: impl Fn(PathBuf) -> SessionConfig) -> Config {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.json5");
        std::fs::write(&path, text).unwrap();
        link(path).configuration(Purpose::default()).unwrap()
    }

    fn endpoints(config: &Config) -> [bool; 2] {
        [LISTEN, CONNECT].map(|key| config.get_json(key).unwrap().contains(DEFAULT_ENDPOINT))
    }

    #[test]
    fn a_short_file_keeps_the_defaults() {
        let without = SessionConfig::default()
            .or_listen_on_default()
            .configuration(Purpose::default())
            .unwrap();
        let config =
            with("{ mode: 'peer' }", |path| SessionConfig::from_file(path).or_listen_on_default());
        for key in [
            LISTEN,
            "scouting/multicast/enabled",
            "transport/link/rx/max_message_size",
            "transport/link/tx/lease",
        ] {
            assert_eq!(config.get_json(key).unwrap(), without.get_json(key).unwrap(), "{key}");
        }
        assert_eq!(endpoints(&config), [true, false]);
        let config =
            with("{ mode: 'peer' }", |path| SessionConfig::from_file(path).or_connect_to_default());
        assert_eq!(endpoints(&config), [false, true]);
        assert_eq!(config.get_json(LISTEN).unwrap(), "[]");
    }

    #[test]
    fn an_endpoint_without_a_protocol_is_refused() {
        for endpoint in ["", "127.0.0.1:7551", "tcp/", "/127.0.0.1:7551"] {
            for link in [SessionConfig::connect_to(endpoint), SessionConfig::listen_on(endpoint)] {
                let message = link.configuration(Purpose::default()).unwrap_err().to_string();
                let expected = "endpoint: expected PROTOCOL/ADDRESS, such as tcp/127.0.0.1:7447";
                assert_eq!(message, format!("{expected}, found {endpoint:?}"));
            }
        }
    }

    #[test]
    fn settings_of_a_file_stay() {
        let text = "{ scouting: { multicast: { enabled: true } }, connect: { endpoints: ['tcp/router:7447'] }, \
                    transport: { link: { rx: { max_message_size: 4096 } } } }";
        let config = with(text, |path| SessionConfig::from_file(path).or_listen_on_default());
        assert_eq!(config.get_json("scouting/multicast/enabled").unwrap(), "true");
        assert_eq!(config.get_json("transport/link/rx/max_message_size").unwrap(), "4096");
        // A session with a router needs no other endpoint.
        assert_eq!(endpoints(&config), [false, false]);
        assert!(has_endpoint(&config, CONNECT));
    }
}
