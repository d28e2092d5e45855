//! The program as a component: driven by another process, interrupted, killed, taken up again.

use crate::setup::{CASE, Ended, Place};
use ballast_mcap::messages::MessageReader;
use ballast_mcap::recording::WindowReader;
use ballast_protocol::from_cdr;
use ballast_protocol::lockstep::{
    ComponentState, ErrorCode, InitRequest, ParameterUpdate, WindowKind,
};
use ballast_protocol::messages::{
    AdvanceRequest, BodyMotion, InterpolationMode, MotionKnot, Point, Pose, Quaternion,
    SqueezeReport, Twist, Vector3,
};
use ballast_zenoh::{Client, Connection, Error, SessionConfig, Timeouts};
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use serde_json::Value;
use std::f64::consts::TAU;
use std::io::{BufRead, BufReader, Write};
use std::process::{Child, Command, Stdio};
use std::sync::OnceLock;
use std::time::{Duration, Instant};

#[allow(dead_code, reason = "its `main` is for people")]
#[path = "../../../../examples/controller_loop.rs"]
mod controller_loop;

pub const KEY: &str = "yard/bed";
const MS: u64 = 1_000_000;

/// Returns the number of repetitions of a fault: `BALLAST_FAULTS`, or `normally` without that variable.
fn times(normally: u64) -> u64 {
    let asked = std::env::var("BALLAST_FAULTS").ok().and_then(|f| f.parse().ok());
    normally.max(asked.unwrap_or(0))
}

/// An endpoint that was free a moment ago; a component that is started again needs the same one.
pub fn endpoint() -> String {
    ballast_zenoh::session::free_endpoint().unwrap()
}

/// `ballast serve tiny.toml`, running.
pub struct Serving {
    pub child: Child,
    run_id: String,
}

impl Serving {
    /// Waits until it is ready.
    pub fn start(place: &Place, endpoint: &str, arguments: &str) -> Self {
        let arguments =
            format!("serve tiny.toml --json --key {KEY} --listen {endpoint} {arguments}");
        let mut command = place.with_beds_command(&arguments);
        let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
        let ready = lines.by_ref().map_while(Result::ok).find(|l| l.contains("\"ready\""));
        let Some(ready) = ready else {
            panic!("{}", Ended(child.wait_with_output().unwrap()).stderr());
        };
        let ready: Value = serde_json::from_str(&ready).unwrap();
        let run_id = ready["run_id"].as_str().unwrap().to_string();
        // Read to the end: a full pipe would block the program.
        std::thread::spawn(move || lines.for_each(drop));
        Self { child, run_id }
    }

    fn signal(&self, signal: Signal) {
        kill(Pid::from_raw(self.child.id() as i32), signal).unwrap();
    }

    pub fn end(mut self) -> Ended {
        // What it has written to stdout is read by the thread.
        let stderr = self.child.stderr.take();
        let status = self.child.wait().unwrap();
        let mut text = Vec::new();
        std::io::Read::read_to_end(&mut stderr.unwrap(), &mut text).unwrap();
        Ended(std::process::Output { status, stdout: vec![], stderr: text })
    }
}

impl Drop for Serving {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

pub fn attach(endpoint: &str, resume: Option<&str>) -> Result<Client, Error> {
    let timeouts = Timeouts { disconnect: Duration::from_secs(30), ..Timeouts::default() };
    Client::attach(KEY, &SessionConfig::connect_to(endpoint), "test", resume, timeouts)
}

/// The first tine, and where it stands before the first window.
struct Tine {
    name: String,
    position: Point,
    orientation: Quaternion,
}

static TINE: OnceLock<Tine> = OnceLock::new();

/// Returns displacement (m) and velocity (m/s) of the tine at a time: 1 mm at 20 Hz.
fn shaking(time_ns: u64) -> [f64; 2] {
    let (t, w) = (time_ns as f64 * 1e-9, TAU * 20.0);
    [1e-3 * (1.0 - (w * t).cos()), 1e-3 * w * (w * t).sin()]
}

/// The motion of the first tine until `t1`, a knot per millisecond.
fn motion(client: &Client, t1: u64) -> Vec<BodyMotion> {
    let t0 = client.position().now_ns;
    let tine = TINE.get_or_init(|| {
        let description = client.describe().unwrap();
        let body = description.bodies.into_iter().find(|b| b.role == "tine").expect("a tine");
        // It is described as it is; whole nanometres, so that every process finds the same numbers.
        let whole = |x: f64| (x * 1e9).round() * 1e-9;
        let Point { x, y, z } = body.position;
        let position = Point { x: whole(x - shaking(t0)[0]), y: whole(y), z: whole(z) };
        Tine { name: body.name, position, orientation: body.orientation }
    });
    let knot = |t: u64| {
        let [way, speed] = shaking(t);
        let position = Point { x: tine.position.x + way, ..tine.position };
        let linear = Vector3 { x: speed, ..Vector3::default() };
        let pose = Pose { position, orientation: tine.orientation };
        MotionKnot { time_ns: t as i64, pose, twist: Twist { linear, ..Twist::default() } }
    };
    let knots = (t0 / MS..=t1 / MS).map(|ms| knot(ms * MS)).collect();
    let (body, interpolation) = (tine.name.clone(), InterpolationMode::Hermite);
    vec![BodyMotion { body, interpolation, allow_jump: false, knots }]
}

/// A window of 1 ms.
fn step(client: &mut Client) -> Result<(), Error> {
    let t1 = client.position().now_ns + MS;
    client.advance_to(t1, motion(client, t1), vec![]).map(drop)
}

/// Returns the state hash after a number of undisturbed windows.
fn undisturbed(windows: u64) -> String {
    let place = Place::new();
    let endpoint = endpoint();
    let serving = Serving::start(&place, &endpoint, "--out u");
    let mut client = attach(&endpoint, None).unwrap();
    for _ in 0..windows {
        step(&mut client).unwrap();
    }
    let hash = client.position().hash.clone();
    client.shut_down().unwrap();
    serving.end().with_code(0);
    hash
}

#[test]
fn what_two_processes_compute_is_what_one_computes_and_its_recording_verifies() {
    let place = Place::new();
    let endpoint = endpoint();
    let serving = Serving::start(&place, &endpoint, "--out s --record s.mcap");
    let mut client = attach(&endpoint, None).unwrap();
    for k in 0..40 {
        let inputs = motion(&client, (k + 1) * MS);
        step(&mut client).unwrap();
        if k % 10 == 5 {
            // A window that is redone stands in the recording as it was in the end.
            let mut other = inputs.clone();
            other[0].knots[1].pose.position.z += 1e-4;
            let first = client.position().hash.clone();
            for (inputs, same) in [(other, false), (inputs, true)] {
                client.redo([k * MS, (k + 1) * MS], inputs, vec![]).unwrap();
                assert_eq!(client.position().hash == first, same);
            }
        }
    }
    let hash = client.position().hash.clone();
    client.shut_down().unwrap();
    serving.end().with_code(0);
    let verified = place.with_beds("verify s.mcap --json").with_code(0);
    let events = verified.events();
    let verdict = events.iter().find(|e| e["event"] == "verified").expect("a verdict");
    assert_eq!(verdict["windows"], 40);
    assert_eq!(hash, undisturbed(40));
    // A tenth of the pictures of points are beside one of polyhedra; the case wants one in 10 ms.
    let mut pictures = std::collections::BTreeMap::<String, Vec<u64>>::new();
    let mut messages = MessageReader::open(&place.path("s.mcap")).unwrap();
    while let Some(message) = messages.next().unwrap() {
        pictures.entry(message.channel.topic.clone()).or_default().push(message.log_time);
    }
    assert_eq!(pictures["/stones"], [0, 10, 20, 30, 40].map(|ms| ms * MS));
    assert_eq!(pictures["/scene"], [0]);
    let refused = place.call("resume s/checkpoint.h5").with_code(1);
    assert!(refused.stderr().contains("serve"), "{}", refused.stderr());
}

#[test]
fn a_component_that_waits_is_prepared_by_its_partner_and_can_be_prepared_anew() {
    let place = Place::new();
    let endpoint = endpoint();
    let serving = Serving::start(&place, &endpoint, "--out s --defer-init --record s.mcap");
    let mut client = attach(&endpoint, None).unwrap();
    assert_eq!(client.status().unwrap().state, ComponentState::Unconfigured);
    let refused = client.advance_to(MS, vec![], vec![]).unwrap_err();
    assert_eq!(refused.request_error().map(|f| f.code), Some(ErrorCode::Unconfigured), "{refused}");
    let prepared = client.init(&InitRequest::default()).unwrap().clone();
    assert_eq!((prepared.seq, client.status().unwrap().state), (0, ComponentState::Idle));
    for _ in 0..3 {
        step(&mut client).unwrap();
    }
    assert_eq!(client.position().hash, undisturbed(3));
    let before = client.position().clone();
    let odd = InitRequest { schedule: Some("random".into()), ..InitRequest::default() };
    let refused = client.init(&odd).unwrap_err();
    assert_eq!(refused.request_error().map(|f| f.code), Some(ErrorCode::InitFailed), "{refused}");
    assert!(refused.to_string().contains("random"), "{refused}");
    assert_eq!((client.position(), client.status().unwrap().position), (&before, before.clone()));
    let other = InitRequest { schedule: Some("sequential".into()), ..InitRequest::default() };
    let again = client.init(&other).unwrap().clone();
    assert!(again.run_id != prepared.run_id && again.seq == 0, "{again:?}");
    assert_eq!(client.describe().unwrap().parameters["schedule"], "sequential");
    step(&mut client).unwrap();
    client.shut_down().unwrap();
    serving.end().with_code(0);
    for (file, windows) in [("s.mcap", 3), ("s.2.mcap", 1)] {
        let verified = place.with_beds(&format!("verify {file}")).with_code(0);
        assert!(verified.stdout().contains(&format!("{windows} windows")), "{}", verified.stdout());
    }
}

#[test]
fn a_run_with_parameters_and_restores_is_recorded_resumed_and_verified() {
    let place = Place::new();
    let endpoint = endpoint();
    let arguments = "--out s --record s.mcap --schedule sequential";
    let serving = Serving::start(&place, &endpoint, arguments);
    let mut client = attach(&endpoint, None).unwrap();
    step(&mut client).unwrap();
    let before = client.position().hash.clone();
    let hasty = ParameterUpdate {
        max_iterations: Some(4),
        tolerance: Some(0.0),
        max_penetration: Some(0.1),
        ..Default::default()
    };
    client.set_parameters(&hasty).unwrap();
    assert_ne!(client.position().hash, before, "it decides how the run continues");
    assert_eq!(client.describe().unwrap().parameters["max_iterations"], 4);
    step(&mut client).unwrap();
    client.save("hasty").unwrap();
    let kept = client.position().hash.clone();
    // Killed: it comes back with the parameters.
    serving.signal(Signal::SIGKILL);
    drop(serving);
    let serving = Serving::start(&place, &endpoint, "--out s --resume --record s.mcap");
    step(&mut client).unwrap();
    client.save("hasty").unwrap();
    let before = client.position().hash.clone();
    let usual = ParameterUpdate { max_iterations: Some(30), ..ParameterUpdate::default() };
    client.set_parameters(&usual).unwrap();
    step(&mut client).unwrap();
    client.restore("hasty").unwrap();
    assert_eq!(client.position().hash, before, "with its parameters");
    step(&mut client).unwrap();
    step(&mut client).unwrap();
    let last = client.position().clone();
    client.shut_down().unwrap();
    serving.end().with_code(0);
    assert_ne!(kept, last.hash);
    // The file of the killed process stays; one that continues from another state holds its start.
    // The second window was lost with the process, and computed again.
    assert!(place.path("s.mcap").exists());
    for (file, windows) in [("s.2.mcap", 3), ("s.3.mcap", 2)] {
        let verified = place.with_beds(&format!("verify {file}")).with_code(0);
        assert!(
            verified.stdout().contains(&format!(" {windows} windows")),
            "{}",
            verified.stdout()
        );
    }
    let hash = &last.hash;
    let replayed = format!("replay s.3.mcap --out r --expect-hash {hash} --record again.mcap");
    place.with_beds(&replayed).with_code(0);
    // Its recording begins where it began, too.
    let verified = place.with_beds("verify again.mcap").with_code(0).stdout();
    assert!(verified.contains("all equal"), "{verified}");
    // To end before it begins is a slip that costs nothing.
    let slip = "replay s.3.mcap --out r --record again.mcap --steps 0";
    let message = place.with_beds(slip).with_code(2).stderr();
    assert!(message.contains("--steps 0: expected at least"), "{message}");
    assert_eq!(&place.hash("r"), hash);
    let verified = place.with_beds("verify again.mcap").with_code(0).stdout();
    assert!(verified.contains("all equal"), "{verified}");
    let start = WindowReader::open(&place.path("again.mcap")).unwrap();
    let start = ballast_hdf5::checkpoint::from_bytes(start.start().unwrap()).unwrap();
    assert_eq!(start.extra["schedule"], "sequential", "as it was chosen");
    // Where the start is damaged there is nothing to compare with.
    let mut bytes = std::fs::read(place.path("s.3.mcap")).unwrap();
    let name = b"start.h5";
    let at = bytes.windows(name.len()).position(|w| w == name).unwrap();
    bytes[at + 2000] ^= 1;
    std::fs::write(place.path("damaged.mcap"), bytes).unwrap();
    for call in ["verify damaged.mcap", "replay damaged.mcap --out d"] {
        let message = place.with_beds(call).with_code(1).stderr();
        assert!(message.contains("it is damaged before its first window"), "{call}: {message}");
    }
    // It cannot continue in another case.
    std::fs::write(place.path("other.toml"), CASE.replace("seed = 7", "seed = 8")).unwrap();
    let refused = place.with_beds("verify s.3.mcap --case other.toml").with_code(5);
    assert!(refused.stderr().contains("s.3.mcap"), "{}", refused.stderr());
    let replay = "replay s.3.mcap --case other.toml --out other --bed-cache unpoured";
    let refused = place.call(replay).with_code(5).stderr();
    assert!(refused.contains("another case") && !place.path("unpoured").exists(), "{refused}");
}

#[test]
fn a_signal_of_a_scheduler_stops_a_component_at_a_checkpoint() {
    let place = Place::new();
    let serving = Serving::start(&place, &endpoint(), "--out s");
    serving.signal(Signal::SIGUSR1);
    serving.end().with_code(130);
    assert!(place.path("s/checkpoint.h5").exists());
}

#[test]
fn ctrl_c_in_a_window_takes_it_back_and_the_run_goes_on_later() {
    // A tenth of a second for a step of any processor, ten for the window.
    let place =
        Place::with(&CASE.replace(
            "max_iterations = 30\ntolerance = 1e-3",
            "max_iterations = 20000\ntolerance = 0",
        ));
    let endpoint = endpoint();
    let serving = Serving::start(&place, &endpoint, "--out s");
    let mut client = attach(&endpoint, None).unwrap();
    step(&mut client).unwrap();
    let before = client.position().clone();
    let t1 = before.now_ns + 100 * MS;
    let request = AdvanceRequest { motions: motion(&client, t1), ..client.next_request(t1) };
    let computing = std::thread::spawn(move || client.send(WindowKind::Advance, request));
    std::thread::sleep(Duration::from_millis(300));
    serving.signal(Signal::SIGINT);
    let refused = computing.join().unwrap().unwrap_err();
    assert_eq!(refused.request_error().map(|f| f.code), Some(ErrorCode::ShuttingDown), "{refused}");
    let ended = serving.end().with_code(130);
    assert!(ended.stderr().contains("--resume"), "{}", ended.stderr());
    let refused = place.with_beds(&format!("serve tiny.toml --key {KEY} --out s"));
    let refused = refused.with_code(2);
    assert!(refused.stderr().contains(&before.run_id), "{}", refused.stderr());
    let serving = Serving::start(&place, &endpoint, "--out s --resume");
    assert_eq!(serving.run_id, before.run_id);
    let mut client = attach(&endpoint, Some(&before.run_id)).unwrap();
    assert_eq!(*client.position(), before);
    step(&mut client).unwrap();
    client.shut_down().unwrap();
    serving.end().with_code(0);
}

#[test]
fn a_component_that_is_killed_comes_back_from_its_checkpoint_to_the_same_end() {
    let place = Place::new();
    let endpoint = endpoint();
    // Checkpoints of every window, and of none but the first.
    for (k, arguments) in
        ["--checkpoint-interval 0", "--checkpoint-interval 1000"].iter().enumerate()
    {
        let arguments = format!("--out s{k} {arguments}");
        let mut serving = Serving::start(&place, &endpoint, &arguments);
        let mut client = attach(&endpoint, None).unwrap();
        let mut windows = 0;
        for kills in 0..times(6) {
            let process = Pid::from_raw(serving.child.id() as i32);
            let wait = Duration::from_millis(5 + 37 * kills % 90);
            let killer = std::thread::spawn(move || {
                std::thread::sleep(wait);
                kill(process, Signal::SIGKILL).unwrap();
            });
            for _ in 0..3 {
                step_in_spite(&mut client, &mut serving, &place, &endpoint, &arguments);
                windows += 1;
            }
            killer.join().unwrap();
            if serving.child.id() as i32 == process.as_raw() {
                serving.child.wait().unwrap();
                serving = Serving::start(&place, &endpoint, &format!("{arguments} --resume"));
            }
        }
        step(&mut client).unwrap();
        windows += 1;
        assert_eq!(client.position().seq, windows);
        assert_eq!(client.position().hash, undisturbed(windows), "{arguments}");
        client.shut_down().unwrap();
        serving.end().with_code(0);
    }
}

/// A window; a component that dies meanwhile is started again beside it.
fn step_in_spite(
    client: &mut Client,
    serving: &mut Serving,
    place: &Place,
    endpoint: &str,
    arguments: &str,
) {
    std::thread::scope(|scope| {
        let stepping = scope.spawn(|| step(client));
        while !stepping.is_finished() {
            if serving.child.try_wait().unwrap().is_some() {
                *serving = Serving::start(place, endpoint, &format!("{arguments} --resume"));
            }
            std::thread::sleep(Duration::from_millis(2));
        }
        stepping.join().unwrap().unwrap();
    });
}

#[test]
fn a_run_that_rests_is_kept_when_the_time_has_come() {
    let place = Place::new();
    let endpoint = endpoint();
    let _serving = Serving::start(&place, &endpoint, "--out s --checkpoint-interval 1");
    let mut client = attach(&endpoint, None).unwrap();
    (0..3).for_each(|_| step(&mut client).unwrap());
    let begin = Instant::now();
    // No client requests another window.
    while client.connection().status().unwrap().durable_seq < 3 {
        assert!(begin.elapsed() < Duration::from_secs(20), "no checkpoint");
        std::thread::sleep(Duration::from_millis(50));
    }
}

/// Runs the driver that the next test kills; this is no check.
#[test]
#[ignore = "the process that another test kills"]
fn drives_until_it_is_killed() {
    let endpoint = std::env::var("BALLAST_TEST_ENDPOINT").unwrap();
    let begin = Instant::now();
    let mut client = loop {
        match attach(&endpoint, None) {
            Ok(client) => break client,
            // The one before may not be gone yet.
            Err(error) => assert!(begin.elapsed() < Duration::from_secs(10), "{error}"),
        }
    };
    loop {
        step(&mut client).unwrap();
    }
}

#[test]
fn when_a_client_is_killed_the_run_holds_and_the_next_one_goes_on() {
    let place = Place::new();
    let endpoint = endpoint();
    let serving = Serving::start(&place, &endpoint, "--out s");
    let looks = Timeouts { disconnect: Duration::from_secs(30), ..Timeouts::default() };
    let line = Connection::open(KEY, &SessionConfig::connect_to(&endpoint), looks).unwrap();
    line.status().unwrap();
    for k in 0..times(8) {
        let before = line.status().unwrap().position.seq;
        let mut driver = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "serve::drives_until_it_is_killed", "--ignored"])
            .env("BALLAST_TEST_ENDPOINT", &endpoint)
            .stdout(Stdio::null())
            .spawn()
            .unwrap();
        let begin = Instant::now();
        while line.status().unwrap().position.seq <= before + 1 {
            assert!(begin.elapsed() < Duration::from_secs(20), "no client drives");
            std::thread::sleep(Duration::from_millis(5));
        }
        std::thread::sleep(Duration::from_millis(13 * k % 50));
        driver.kill().unwrap();
        driver.wait().unwrap();
        let begin = Instant::now();
        while line.status().unwrap().owner.is_some() {
            assert!(begin.elapsed() < Duration::from_secs(5), "the owner never goes");
            std::thread::sleep(Duration::from_millis(5));
        }
        // What it has computed is in the checkpoint.
        let status = line.status().unwrap();
        assert_eq!(status.durable_seq, status.position.seq);
    }
    let run = line.status().unwrap().position.run_id;
    let mut client = attach(&endpoint, Some(&run)).unwrap();
    step(&mut client).unwrap();
    let last = client.position().clone();
    client.shut_down().unwrap();
    serving.end().with_code(0);
    assert_eq!(last.hash, undisturbed(last.seq));
}

#[test]
fn a_served_component_is_described_watched_and_examined() {
    let place = Place::new();
    let endpoint = endpoint();
    let serving = Serving::start(&place, &endpoint, "--out s");
    let output = place.call(&format!("describe {KEY} --connect {endpoint}")).with_code(0).stdout();
    assert!(
        output.contains("1 ms") && output.contains("closes +1 x") && output.contains("synchronous"),
        "{output}"
    );
    let mut client = attach(&endpoint, None).unwrap();
    step(&mut client).unwrap();
    let table =
        place.call(&format!("top {KEY} --connect {endpoint} --count 2")).with_code(0).stdout();
    let waits = format!("window 2 from {}", client.id());
    for word in ["IDLE", &waits, &client.position().hash[..], "Fx (N)", &serving.run_id] {
        assert!(table.contains(word), "{word}: {table}");
    }
    let well = place.with_beds(&format!("doctor tiny.toml --key {KEY} --connect {endpoint}"));
    let well = well.with_code(0).stdout();
    assert!(well.contains("bed prepared") && well.contains("window 2"), "{well}");
    // The port is taken now: by doctor's word and by serve's.
    let ill = place.with_beds(&format!("doctor --listen {endpoint}")).with_code(1).stdout();
    assert!(ill.contains("FAILED") && ill.contains(&endpoint), "{ill}");
    let taken =
        place.with_beds(&format!("serve tiny.toml --key {KEY} --listen {endpoint} --out t"));
    assert!(taken.with_code(4).stderr().contains(&endpoint));
    client.shut_down().unwrap();
    serving.end().with_code(0);
    let lost = place.call(&format!("describe {KEY} --connect {endpoint}")).with_code(4).stderr();
    assert!(lost.contains(KEY) && lost.contains("disconnected"), "{lost}");
    assert!(place.call("describe nonsense").with_code(2).stderr().contains("SITE/ID"));
}

#[test]
fn a_controller_squeezes_until_its_force_in_rust_and_in_python_alike() {
    let place = Place::new();
    let endpoint = endpoint();
    let serving = Serving::start(&place, &endpoint, "--out s");
    let mut client = attach(&endpoint, None).unwrap();
    // More than this bed pushes back at first, less than before its tines are closed.
    let force = 2500.0;
    let done = controller_loop::squeeze(&mut client, force, 0.01).unwrap();
    assert!(done.force >= force && done.closing > 0.0 && done.closing < 0.04, "{done:?}");
    // No message announced the squeeze; the component detected it.
    let messages = client.connection().last_messages().unwrap();
    let key = client.connection().keys().out_squeeze("pair_0");
    let squeeze = messages.into_iter().find(|(name, ..)| *name == key).expect("a squeeze").2;
    let squeeze: SqueezeReport = from_cdr(&squeeze).unwrap();
    assert!((squeeze.pair.as_str(), squeeze.number) == ("pair_0", 1), "{squeeze:?}");
    assert!(squeeze.peak_force > 0.0 && squeeze.closing > 2e-3, "{squeeze:?}");
    client.reset().unwrap();
    client.detach().unwrap();
    if let Some(output) = partner("controller_zenoh.py", [&force.to_string(), "0.01", &endpoint]) {
        assert!(output.contains(&done.hash), "{done:?}: {output}");
    }
    let client = attach(&endpoint, None).unwrap();
    client.shut_down().unwrap();
    serving.end().with_code(0);
}

#[test]
fn tines_follow_a_stick_in_python_while_time_runs_by_itself() {
    let place = Place::new();
    let endpoint = endpoint();
    let serving = Serving::start(&place, &endpoint, "--out s");
    if let Some(output) = partner("operator_freely.py", ["0.2", "0.01", &endpoint]) {
        // On a slow machine not as far as the stick.
        let deep = output.lines().last().and_then(|l| l.split(' ').next()?.parse::<f64>().ok());
        assert!(deep.is_some_and(|deep| 0.0 < deep && deep <= 0.0101), "{output}");
    }
    let client = attach(&endpoint, None).unwrap();
    client.shut_down().unwrap();
    serving.end().with_code(0);
}

/// Returns the output of a Python example that acts as the client; `None` if Python has no Zenoh.
fn partner(script: &str, [first, second, endpoint]: [&str; 3]) -> Option<String> {
    let root = concat!(env!("CARGO_MANIFEST_DIR"), "/../..");
    let python =
        std::env::var("BALLAST_PYTHON").unwrap_or(format!("{root}/target/python/bin/python"));
    let has_zenoh = Command::new(&python).args(["-c", "import zenoh"]).output();
    if !has_zenoh.is_ok_and(|o| o.status.success()) {
        // Past the test harness, which would keep it to itself.
        let why = format!("no eclipse-zenoh in {python}; scripts/python.sh gets it");
        let _ = writeln!(std::io::stderr(), "LEFT OUT: {script}: {why}");
        return None;
    }
    let script = format!("{root}/examples/python/{script}");
    let output = Command::new(&python).args([&script[..], KEY, first, second, endpoint]).output();
    Some(Ended(output.unwrap()).with_code(0).stdout())
}

#[test]
fn a_failed_recording_is_reported_at_the_end_of_the_run() {
    let place = Place::new();
    let endpoint = endpoint();
    // Where the second part of the recording would be.
    std::fs::create_dir(place.path("s.2.mcap")).unwrap();
    let arguments =
        format!("serve tiny.toml --key {KEY} --listen {endpoint} --out s --record s.mcap");
    let mut command = place.with_beds_command(&arguments);
    let child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let mut client = attach(&endpoint, None).unwrap();
    client.save("here").unwrap();
    step(&mut client).unwrap();
    client.restore("here").unwrap();
    step(&mut client).unwrap();
    let hash = client.position().hash.clone();
    client.shut_down().unwrap();
    let ended = Ended(child.wait_with_output().unwrap()).with_code(1);
    assert!(ended.stdout().contains(&hash), "{}", ended.stdout());
    let message = ended.stderr();
    assert_eq!(message.matches("warning: recording: s.2.mcap").count(), 1, "{message}");
    assert!(
        message.contains("failed: s.2.mcap") && message.contains("continued without it"),
        "{message}"
    );
    place.with_beds("verify s.mcap").with_code(0);
}

#[test]
fn an_endpoint_that_is_none_costs_not_even_a_folder() {
    let place = Place::new();
    for how in ["--listen nowhere", "--router nowhere"] {
        let arguments = format!("serve tiny.toml --key {KEY} --out s {how}");
        let message = place.call(&arguments).with_code(4).stderr();
        assert!(
            message.contains("expected PROTOCOL/ADDRESS") && message.contains("nowhere"),
            "{message}"
        );
        assert!(!place.path("s").exists());
    }
}

#[test]
fn a_recording_that_would_lie_in_a_file_of_the_run_is_refused() {
    let place = Place::new();
    for own in ["checkpoint.h5", "summary.json"] {
        let arguments = format!("serve tiny.toml --key {KEY} --out s --record s/{own}");
        let message = place.with_beds(&arguments).with_code(2).stderr();
        assert!(
            message.contains(own) && message.contains("does not belong to the run"),
            "{message}"
        );
    }
}

#[test]
fn a_recording_that_could_not_be_written_is_refused_before_the_bed_is_prepared() {
    let place = Place::new();
    let endpoint = endpoint();
    let serve = format!("serve tiny.toml --key {KEY} --listen {endpoint} --bed-cache none --out s");
    let refuses = |arguments: &str, says: &str| {
        let message = place.call(&format!("{serve} {arguments}")).with_code(1).stderr();
        assert!(message.contains(says), "{arguments}: {message}");
        assert!(!place.path("none").exists(), "{arguments}");
    };
    std::fs::write(place.path("words.mcap"), "not a recording").unwrap();
    std::fs::create_dir(place.path("folder.mcap")).unwrap();
    refuses("--record no/such/folder.mcap", "folder.mcap");
    refuses("--record words.mcap", "words.mcap: recording: expected a new file");
    refuses("--record folder.mcap", "found a folder");
    let serving = Serving::start(&place, &endpoint, "--out s");
    attach(&endpoint, None).unwrap().shut_down().unwrap();
    serving.end().with_code(0);
    refuses("--resume --record no/such/folder.mcap", "folder.mcap");
}

#[test]
fn who_may_not_serve_replaces_nothing_and_prepares_nothing() {
    let place = Place::new();
    let [first, second] = [endpoint(), endpoint()];
    let serving = Serving::start(&place, &first, "--out old --record old.mcap");
    let mut client = attach(&first, None).unwrap();
    step(&mut client).unwrap();
    client.shut_down().unwrap();
    serving.end().with_code(0);
    let files = ["old/checkpoint.h5", "old.mcap"].map(|name| place.path(name));
    let bytes = || files.each_ref().map(|path| std::fs::read(path).unwrap());
    let before = bytes();
    let serving = Serving::start(&place, &first, "--out s");
    for arguments in ["--force --record old.mcap", "--resume --record old.mcap"] {
        let refused = place.call(&format!(
            "serve tiny.toml --key {KEY} --listen {second} --connect {first} --bed-cache none --out old {arguments}"
        ));
        let message = refused.with_code(4).stderr();
        assert!(message.contains("key is already served"), "{message}");
        assert!(bytes() == before, "{arguments}");
        assert!(!place.path("none").exists() && !place.path("old.2.mcap").exists(), "{arguments}");
    }
    attach(&first, None).unwrap().shut_down().unwrap();
    serving.end().with_code(0);
}

#[test]
fn a_run_goes_on_in_its_own_case_only() {
    let place = Place::new();
    let endpoint = endpoint();
    let serving = Serving::start(&place, &endpoint, "--out s");
    let mut client = attach(&endpoint, None).unwrap();
    step(&mut client).unwrap();
    client.shut_down().unwrap();
    let run_id = serving.run_id.clone();
    serving.end().with_code(0);
    // Neither is in the model: over how long a squeeze is averaged, and how far the sleeper is lifted.
    for (from, to) in [
        ("amplitude_m = 0.002", "amplitude_m = 0.002\nfrequency_Hz = 10"),
        ("height_m = 0.004", "height_m = 0.003"),
    ] {
        std::fs::write(place.path("tiny.toml"), CASE.replace(from, to)).unwrap();
        let resume = format!("serve tiny.toml --key {KEY} --listen {endpoint} --out s --resume");
        let message = place.with_beds(&resume).with_code(1).stderr();
        let here = to.lines().last().unwrap();
        assert!(message.contains("s/checkpoint.h5: expected the case of its run"), "{message}");
        assert!(
            message.contains("line ") && message.contains(&format!("here {here:?}")),
            "{message}"
        );
    }
    std::fs::write(place.path("tiny.toml"), format!("# Its third day.\n{CASE}")).unwrap();
    let serving = Serving::start(&place, &endpoint, "--out s --resume");
    assert_eq!(serving.run_id, run_id);
    attach(&endpoint, None).unwrap().shut_down().unwrap();
    serving.end().with_code(0);
}
