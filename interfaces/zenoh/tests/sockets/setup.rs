//! A heap of stones on a floor that is shaken, served on the loopback, and how its runs must end.

use crate::{common, shaken};
use ballast::component::{Component, Limits};
use ballast::model::{Model, Schedule};
use ballast::state::State;
use ballast_protocol::lockstep::{ComponentState, ErrorCode, Lockstep, StatusReport};
use ballast_protocol::messages::{BodyMotion, Digest, MotionKnot};
use ballast_zenoh::session::free_endpoint;
use ballast_zenoh::{Client, Server, ServerHooks, SessionConfig, Timeouts};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

pub const KEY: &str = "yard/bed";
pub const MS: u64 = 1_000_000;
/// Length of a window, ns: five steps.
pub const WINDOW: u64 = MS;

/// Returns the number of repetitions of a fault: `normally`, or more by `BALLAST_FAULTS`.
pub fn times(normally: u64) -> u64 {
    let asked = std::env::var("BALLAST_FAULTS").ok().and_then(|f| f.parse().ok());
    normally.max(asked.unwrap_or(0))
}

pub fn hash(model: &Model, state: &State) -> u128 {
    u128::from_be_bytes(Digest::of(format!("{:?} {state:?}", model.solver).as_bytes()).0)
}

pub fn component() -> Component {
    let mut scene =
        common::heap::falling(2, WINDOW / 5).scheduled(Schedule::Synchronous, [2, 1, 1]);
    scene.model.solver.max_iterations = 30;
    scene.model.solver.tolerance = Some(1e-3);
    Component::new(Arc::new(scene.model), scene.state, Limits::default()).expect("a scene")
}

pub fn lockstep() -> Lockstep {
    Lockstep::new(component(), "run-1", hash)
}

/// The floor at a time.
pub fn knot(time_ns: u64) -> MotionKnot {
    shaken::floor(time_ns as i64)
}

/// The floor's motion through a window.
pub fn shaking(t0_ns: u64, t1_ns: u64) -> Vec<BodyMotion> {
    shaken::through(t0_ns as i64, t1_ns as i64)
}

/// The next window of a client, of the usual length.
pub fn step(client: &mut Client) -> Result<(), ballast_zenoh::Error> {
    let t0 = client.position().now_ns;
    client.advance_to(t0 + WINDOW, shaking(t0, t0 + WINDOW), vec![]).map(drop)
}

/// Returns the state hashes after each window, computed in this process without any transport.
pub fn undisturbed(windows: u64) -> Vec<String> {
    use ballast_protocol::messages::AdvanceRequest;
    let mut component = component();
    (0..windows)
        .map(|k| {
            let (t0, t1) = (k * WINDOW, (k + 1) * WINDOW);
            let (t0_ns, t1_ns) = (t0 as i64, t1 as i64);
            let motions = shaking(t0, t1);
            let request = AdvanceRequest { t0_ns, t1_ns, motions, ..AdvanceRequest::default() };
            let inputs = request.inputs().expect("good inputs");
            component.advance_to(t1, &inputs.motions[..]).expect("a window");
            format!("{:032x}", hash(component.model(), component.state()))
        })
        .collect()
}

/// A component served by a thread of this process.
pub struct Served {
    pub endpoint: String,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<Lockstep>>,
}

struct Until(Arc<AtomicBool>);

impl ServerHooks for Until {
    fn is_stopped(&self) -> bool {
        self.0.load(Ordering::SeqCst)
    }
}

/// Takes its time between two steps until it is let go: a window lasts as long as a test wants.
struct Dawdles {
    stop: Until,
    is_let_go: Arc<AtomicBool>,
}

impl ServerHooks for Dawdles {
    fn is_stopped(&self) -> bool {
        if !self.is_let_go.load(Ordering::SeqCst) {
            std::thread::sleep(Duration::from_millis(10));
        }
        self.stop.is_stopped()
    }
}

impl Served {
    pub fn new() -> Self {
        Self::at(&SessionConfig::listen_on(free_endpoint().unwrap()), lockstep())
    }

    pub fn at(link: &SessionConfig, lockstep: Lockstep) -> Self {
        let stop = Arc::new(AtomicBool::new(false));
        Self::with(link, lockstep, Until(Arc::clone(&stop)), stop)
    }

    /// Such that takes 10 ms and more for each step until it is let go.
    pub fn dawdling() -> (Self, Arc<AtomicBool>) {
        let (stop, is_let_go) = <(Arc<AtomicBool>, Arc<AtomicBool>)>::default();
        let host = Dawdles { stop: Until(Arc::clone(&stop)), is_let_go: Arc::clone(&is_let_go) };
        (Self::hosted(host, stop), is_let_go)
    }

    /// Serves with hooks that end on `stop`.
    pub fn hosted(host: impl ServerHooks + 'static, stop: Arc<AtomicBool>) -> Self {
        Self::with(&SessionConfig::listen_on(free_endpoint().unwrap()), lockstep(), host, stop)
    }

    fn with(
        link: &SessionConfig,
        lockstep: Lockstep,
        host: impl ServerHooks + 'static,
        stop: Arc<AtomicBool>,
    ) -> Self {
        let server = Server::open(KEY, link).expect("a free port");
        Self::run(server, lockstep, host, stop)
    }

    /// By a server that is open already.
    pub fn by(server: Server) -> Self {
        let stop = Arc::new(AtomicBool::new(false));
        Self::run(server, lockstep(), Until(Arc::clone(&stop)), stop)
    }

    fn run(
        server: Server,
        lockstep: Lockstep,
        mut host: impl ServerHooks + 'static,
        stop: Arc<AtomicBool>,
    ) -> Self {
        let endpoint = server.endpoints().first().cloned().unwrap_or_default();
        let thread = std::thread::spawn(move || server.run(lockstep, &mut host).expect("serves"));
        Self { endpoint, stop, thread: Some(thread) }
    }

    pub fn link(&self) -> SessionConfig {
        SessionConfig::connect_to(&self.endpoint)
    }

    pub fn client(&self) -> Client {
        attach(&self.link()).expect("there is no owner")
    }

    /// Ends the component and gives back its lockstep.
    pub fn stop(mut self) -> Lockstep {
        self.stop.store(true, Ordering::SeqCst);
        self.thread.take().expect("stopped once").join().expect("no panic")
    }
}

impl Drop for Served {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::SeqCst);
        if let Some(thread) = self.thread.take() {
            let ended = thread.join();
            assert!(ended.is_ok() || std::thread::panicking(), "the server failed");
        }
    }
}

/// The first status, asked for again and again, with this state.
pub fn wait_for(
    ask: impl Fn() -> Result<StatusReport, ballast_zenoh::Error>,
    state: ComponentState,
) -> StatusReport {
    wait_until(ask, |status| status.state == state)
}

/// The first status, asked for again and again, that is as it should be.
pub fn wait_until(
    ask: impl Fn() -> Result<StatusReport, ballast_zenoh::Error>,
    is_it: impl Fn(&StatusReport) -> bool,
) -> StatusReport {
    let begin = Instant::now();
    loop {
        let status = ask().unwrap();
        if is_it(&status) {
            return status;
        }
        assert!(begin.elapsed() < Duration::from_secs(20), "{status:?}");
        std::thread::sleep(Duration::from_millis(20));
    }
}

pub fn attach(link: &SessionConfig) -> Result<Client, ballast_zenoh::Error> {
    Client::attach(KEY, link, "test", None, patient())
}

/// The client that gets in when the one before is gone, which takes less than `most`.
pub fn once_free(
    attach: impl Fn() -> Result<Client, ballast_zenoh::Error>,
    most: Duration,
) -> Client {
    let begin = Instant::now();
    loop {
        match attach() {
            Ok(client) => return client,
            Err(error) => {
                let is_busy =
                    error.request_error().is_some_and(|fault| fault.code == ErrorCode::Busy);
                assert!(is_busy, "{error}");
            }
        }
        assert!(begin.elapsed() < most, "the owner never goes");
    }
}

/// Waits longer than usual for partners that are on their way: the machine may be busy.
pub fn patient() -> Timeouts {
    Timeouts { disconnect: Duration::from_secs(20), ..Timeouts::default() }
}
