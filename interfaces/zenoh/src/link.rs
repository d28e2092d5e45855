//! How processes find each other: Zenoh's own configuration, with defaults that keep to this machine.

use crate::{DISCONNECT_TIMEOUT, Error, MAX_MESSAGE_BYTES};
use serde_json::Value;
use std::net::{Ipv4Addr, TcpListener};
use std::ops::Range;
use std::path::PathBuf;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};
use zenoh::{Config, Wait};

/// Where a component listens when nobody says otherwise, and where its clients look for it.
pub const DEFAULT_ENDPOINT: &str = "tcp/127.0.0.1:7447";
/// For how long Zenoh waits until a message has gone out, all of it, before it closes the connection, µs.
const WAIT_BEFORE_CLOSE: &str =
    "transport/link/tx/queue/congestion_control/block/wait_before_close";
/// The same of one that may be dropped, before it is: where the first piece of it does not go out, and in all.
const WAIT_BEFORE_DROP: [&str; 2] = [
    "transport/link/tx/queue/congestion_control/drop/wait_before_drop",
    "transport/link/tx/queue/congestion_control/drop/max_wait_before_drop_fragments",
];

/// What a session is for: how long it waits for slow lines.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash)]
pub enum Purpose {
    /// A component, or anything else. A peer that does not take what it is told is cut off after a second: others must
    /// not wait for it, and it must not miss something without noticing.
    #[default]
    Component,
    /// Asks a component, and has nobody else to tell anything: large requests may take their time. That a component is
    /// gone is noticed by its silence.
    Client,
    /// Sends pictures, which nobody has to take, and nobody waits for.
    Pictures,
}

impl Purpose {
    fn settings(self) -> &'static [(&'static str, &'static str)] {
        match self {
            Self::Component => &[(WAIT_BEFORE_CLOSE, "1000000")],
            Self::Client => &[(WAIT_BEFORE_CLOSE, "60000000")],
            Self::Pictures => &[(WAIT_BEFORE_DROP[0], "100000"), (WAIT_BEFORE_DROP[1], "5000000")],
        }
    }
}

const LISTEN: &str = "listen/endpoints";
const CONNECT: &str = "connect/endpoints";

/// How long a session that lives by a router alone looks for it before it is given up, ms.
const ROUTER_TIMEOUT: &str = "5000";
/// How often a connection is tried, ms.
const RETRY: &str = "{ period_init_ms: 100, period_max_ms: 500, period_increase_factor: 2 }";

/// Where a process listens, what it connects to, and anything else that Zenoh can be told.
///
/// Nothing given: a peer that neither listens nor looks around.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct SessionConfig {
    /// A Zenoh configuration file (JSON5), for routers, TLS, users, and all else. What it does not say is
    /// as without it: no scouting, no endpoint but those that are named, bounded messages.
    pub config: Option<PathBuf>,
    /// Endpoints to listen on: `tcp/127.0.0.1:7447`.
    pub listen: Vec<String>,
    /// Endpoints to connect to.
    pub connect: Vec<String>,
    /// A router to be a client of: routers pass on nothing between two peers, so one of two partners has to be more
    /// than that. It has to be there when the session is opened.
    pub router: Option<String>,
    /// What is done at [`DEFAULT_ENDPOINT`] where nobody names an endpoint, the file neither.
    pub default_endpoint: DefaultEndpoint,
}

/// What a process does that nobody gave an endpoint.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash)]
pub enum DefaultEndpoint {
    #[default]
    Nothing,
    Listen,
    Connect,
}

impl SessionConfig {
    /// Listens on one endpoint.
    pub fn listen_on(endpoint: impl Into<String>) -> Self {
        Self { listen: vec![endpoint.into()], ..Self::default() }
    }

    /// Connects to one endpoint.
    pub fn connect_to(endpoint: impl Into<String>) -> Self {
        Self { connect: vec![endpoint.into()], ..Self::default() }
    }

    /// A client of one router.
    pub fn via_router(router: impl Into<String>) -> Self {
        Self { router: Some(router.into()), ..Self::default() }
    }

    /// A Zenoh configuration file.
    pub fn from_file(path: impl Into<PathBuf>) -> Self {
        Self { config: Some(path.into()), ..Self::default() }
    }

    /// The same, for one who is looked for: without an endpoint, at the default one.
    pub fn or_listen_on_default(self) -> Self {
        Self { default_endpoint: DefaultEndpoint::Listen, ..self }
    }

    /// The same, for one who looks: without an endpoint, at the default one.
    pub fn or_connect_to_default(self) -> Self {
        Self { default_endpoint: DefaultEndpoint::Connect, ..self }
    }

    /// Opens the session. One that connects does not wait for the other side: partners start in any order.
    ///
    /// # Errors
    /// A configuration that Zenoh does not take, an endpoint that cannot be listened on, no router to be a client of.
    pub fn open(&self) -> Result<zenoh::Session, Error> {
        self.open_for(Purpose::default())
    }

    /// The same, for a purpose.
    ///
    /// # Errors
    /// As for [`SessionConfig::open`].
    pub fn open_for(&self, purpose: Purpose) -> Result<zenoh::Session, Error> {
        let endpoint = self.router.as_ref().or(self.listen.first()).or(self.connect.first());
        let place = match (&self.config, endpoint) {
            (Some(path), _) => path.display().to_string(),
            (None, Some(endpoint)) => endpoint.clone(),
            (None, None) => "zenoh".into(),
        };
        zenoh::open(self.configuration(purpose)?).wait().map_err(|e| match &self.router {
            Some(_) => Error::link(place, format!("expected a Zenoh router, found none: {e}")),
            None => Error::link(place, e),
        })
    }

    /// The endpoints that a session of it listens on.
    ///
    /// # Errors
    /// A configuration that Zenoh does not take.
    pub fn listen_endpoints(&self) -> Result<Vec<String>, Error> {
        let config = self.configuration(Purpose::default())?;
        let json =
            |key: &str| -> Option<Value> { serde_json::from_str(&config.get_json(key).ok()?).ok() };
        let endpoints = json(LISTEN).unwrap_or_default();
        // Each mode may have a list of its own.
        let listed = endpoints.as_array().or_else(|| endpoints[mode(&config)].as_array());
        let texts = listed.into_iter().flatten().filter_map(Value::as_str);
        Ok(texts.map(String::from).collect())
    }

    /// Whether `session`, which is one of this link's, has a router and is a peer, to which routers pass on nothing of other
    /// peers.
    pub(crate) fn is_isolated_by_router(&self, session: &zenoh::Session) -> bool {
        let is_peer = self.configuration(Purpose::default()).is_ok_and(|c| mode(&c) == "peer");
        is_peer && session.info().routers_zid().wait().next().is_some()
    }

    fn configuration(&self, purpose: Purpose) -> Result<Config, Error> {
        let mut config = match &self.config {
            Some(path) => {
                Config::from_file(path).map_err(|e| Error::link(path.display().to_string(), e))?
            }
            None => Config::default(),
        };
        let named = self.listen.iter().chain(&self.connect).chain(&self.router);
        named.into_iter().try_for_each(|endpoint| well_formed(endpoint))?;
        if let Some(router) = &self.router {
            set(&mut config, "mode", "\"client\"")?;
            set(&mut config, CONNECT, &list(std::slice::from_ref(router)))?;
        }
        keep_to_this_machine(&mut config, purpose)?;
        if !self.listen.is_empty() {
            set(&mut config, LISTEN, &list(&self.listen))?;
        }
        if !self.connect.is_empty() {
            set(&mut config, CONNECT, &list(&self.connect))?;
        }
        let is_named = [LISTEN, CONNECT].iter().any(|key| names_some(&config, key));
        let default = list(&[DEFAULT_ENDPOINT.into()]);
        match self.default_endpoint {
            DefaultEndpoint::Listen if !is_named => set(&mut config, LISTEN, &default)?,
            DefaultEndpoint::Connect if !is_named => set(&mut config, CONNECT, &default)?,
            _ => {}
        }
        Ok(config)
    }
}

/// Ports from which systems take none by themselves: those of outgoing connections lie above.
const QUIET_PORTS: Range<u16> = 20_000..32_000;

/// An endpoint on the loopback whose port was free a moment ago, another one in each call.
///
/// A port that the system itself gives out as free may be that of an outgoing connection before anyone listens on it.
///
/// # Errors
/// No port of those that are tried is free.
pub fn free_endpoint() -> Result<String, Error> {
    static TRIED: AtomicU32 = AtomicU32::new(0);
    let many = QUIET_PORTS.len() as u32;
    // Processes beside each other begin at different places.
    let begin = std::process::id().wrapping_mul(101) % many;
    let mut last = None;
    for _ in 0..many {
        let place = (begin + TRIED.fetch_add(1, Relaxed) % many) % many;
        match TcpListener::bind((Ipv4Addr::LOCALHOST, QUIET_PORTS.start + place as u16)) {
            Ok(listener) => {
                let at = listener.local_addr().map_err(|e| Error::link("loopback", e))?;
                return Ok(format!("tcp/{at}"));
            }
            Err(e) => last = Some(e),
        }
    }
    Err(Error::link("loopback", last.map_or("no port is free".into(), |e| e.to_string())))
}

/// Zenoh's own word on one that is not names the place in a text of JSON that nobody has written.
fn well_formed(endpoint: &str) -> Result<(), Error> {
    let is_whole = |(protocol, address): (&str, &str)| !protocol.is_empty() && !address.is_empty();
    if endpoint.split_once('/').is_some_and(is_whole) {
        return Ok(());
    }
    let text = format!("expected PROTOCOL/ADDRESS, such as {DEFAULT_ENDPOINT}, found {endpoint:?}");
    Err(Error::link("endpoint", text))
}

/// Sets what a configuration leaves as Zenoh has it: scouting would find, and be found by, strangers on the
/// network; without an endpoint of its own a Zenoh peer would listen on all interfaces; messages would have any size.
fn keep_to_this_machine(config: &mut Config, purpose: Purpose) -> Result<(), Error> {
    let usual = Config::default();
    // What is larger than a request may be gets an answer that says so, up to here; beyond, Zenoh lets it fall.
    let (largest, lease) = (4 * MAX_MESSAGE_BYTES, DISCONNECT_TIMEOUT.as_millis());
    // Zenoh opens the session of a client only when it is connected, and of any other at once.
    let timeouts = if mode(config) == "client" { ROUTER_TIMEOUT } else { "-1" };
    let settings = [
        ("mode", "\"peer\"".to_string()),
        ("scouting/multicast/enabled", "false".into()),
        ("scouting/gossip/enabled", "false".into()),
        (LISTEN, "[]".into()),
        ("listen/exit_on_failure", "true".into()),
        ("listen/timeout_ms", "0".into()),
        ("connect/timeout_ms", timeouts.into()),
        ("connect/exit_on_failure", "false".into()),
        ("connect/retry", RETRY.into()),
        // A partner that has fallen silent is noticed after this time, ms; one that hangs from the first on, too.
        ("transport/link/tx/lease", lease.to_string()),
        ("transport/unicast/open_timeout", lease.to_string()),
        ("transport/link/rx/max_message_size", largest.to_string()),
    ];
    let of_purpose = purpose.settings().iter().map(|(key, value)| (*key, value.to_string()));
    for (key, value) in settings.into_iter().chain(of_purpose) {
        if config.get_json(key).ok() == usual.get_json(key).ok() {
            set(config, key, &value)?;
        }
    }
    Ok(())
}

/// What a session is among others.
fn mode(config: &Config) -> &'static str {
    match config.get_json("mode").as_deref() {
        Ok("\"client\"") => "client",
        Ok("\"router\"") => "router",
        _ => "peer",
    }
}

/// Whether a list of endpoints, of any mode, names one.
fn names_some(config: &Config, key: &str) -> bool {
    config.get_json(key).is_ok_and(|endpoints| endpoints.contains('/'))
}

fn set(config: &mut Config, key: &str, value: &str) -> Result<(), Error> {
    config.insert_json5(key, value).map_err(|e| Error::link(key, e))
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
    fn a_file_that_says_little_leaves_the_rest_as_it_is_without_one() {
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
    fn an_endpoint_without_a_protocol_is_told_in_plain_words() {
        for endpoint in ["", "127.0.0.1:7551", "tcp/", "/127.0.0.1:7551"] {
            for link in [SessionConfig::connect_to(endpoint), SessionConfig::listen_on(endpoint)] {
                let message = link.configuration(Purpose::default()).unwrap_err().to_string();
                let expected = "endpoint: expected PROTOCOL/ADDRESS, such as tcp/127.0.0.1:7447";
                assert_eq!(message, format!("{expected}, found {endpoint:?}"));
            }
        }
    }

    #[test]
    fn what_a_file_says_stays() {
        let text = "{ scouting: { multicast: { enabled: true } }, connect: { endpoints: ['tcp/router:7447'] }, \
                    transport: { link: { rx: { max_message_size: 4096 } } } }";
        let config = with(text, |path| SessionConfig::from_file(path).or_listen_on_default());
        assert_eq!(config.get_json("scouting/multicast/enabled").unwrap(), "true");
        assert_eq!(config.get_json("transport/link/rx/max_message_size").unwrap(), "4096");
        // Who reaches a router need not be reached.
        assert_eq!(endpoints(&config), [false, false]);
        assert!(names_some(&config, CONNECT));
    }
}
