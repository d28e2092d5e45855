//! Units whose bed is on a server, on the loopback: the states of units with their bed inside, and clear refusals.

use crate::driver::{
    Importer, Unpacked, VERSIONS, Version, set_motion, unpacked, unpacked_with_free_sleeper,
};
use ballast::component::{Component, Limits};
use ballast_fmu::bed::{UnitBed, instantiation_token};
use ballast_fmu::fmi3;
use ballast_fmu::package::{FmiVersion, served_unit_bytes, unit_bytes};
use ballast_fmu::served_unit::{SERVED_FILE, ServedEndpoints, ServedUnit};
use ballast_fmu::variable_table::VariableTable;
use ballast_fmu::variables::ValueType;
use ballast_protocol::lockstep::Lockstep;
use ballast_zenoh::session::free_endpoint;
use ballast_zenoh::{Server, ServerHooks, SessionConfig};
use std::ffi::{CStr, CString, c_char, c_int, c_void};
use std::ptr::{null, null_mut};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

const KEY: &str = "yard/bed";
const STEP: f64 = 0.004;

/// Component of a bed, served by a thread.
struct TestServer {
    endpoint: String,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<Lockstep>>,
}

struct StopFlagHooks(Arc<AtomicBool>);

impl ServerHooks for StopFlagHooks {
    fn is_stopped(&self) -> bool {
        self.0.load(Ordering::SeqCst)
    }
}

impl TestServer {
    fn start(bed: &UnitBed) -> Self {
        Self::start_run(bed, "run-1", &free_endpoint().unwrap())
    }

    fn start_run(bed: &UnitBed, run_id: &str, endpoint: &str) -> Self {
        let server = Server::open(KEY, &SessionConfig::listen_on(endpoint)).unwrap();
        let (model, state) = (Arc::clone(&bed.model), Arc::clone(&bed.state));
        // As `ballast serve` does.
        let component = Component::new(model, state, Limits::default()).unwrap();
        let component = component.with_zones(bed.zones.clone());
        let lockstep = Lockstep::new(component, run_id, ballast_columns::state_hash);
        let stop = Arc::<AtomicBool>::default();
        let mut hooks = StopFlagHooks(Arc::clone(&stop));
        let endpoint = server.endpoints()[0].clone();
        let thread = std::thread::spawn(move || server.run(lockstep, &mut hooks).unwrap());
        Self { endpoint, stop, thread: Some(thread) }
    }

    /// Ends the server; returns the number of windows that it computed.
    fn end(mut self) -> u64 {
        self.stop.store(true, Ordering::SeqCst);
        self.thread.take().unwrap().join().unwrap().computed_windows()
    }
}

/// Returns the unit of a bed that is served at an endpoint.
fn served_unit(bed: &UnitBed, endpoint: &str) -> &'static Unpacked {
    let connect = vec![endpoint.to_string()];
    let endpoints = ServedEndpoints { connect, ..ServedEndpoints::default() };
    let bytes = ServedUnit::new(bed, KEY, endpoints).to_bytes().unwrap();
    let resources = tempfile::tempdir().unwrap();
    std::fs::write(resources.path().join(SERVED_FILE), &bytes).unwrap();
    let token = CString::new(instantiation_token(&bytes)).unwrap();
    // Importers live as long as the process.
    Box::leak(Box::new(Unpacked {
        table: VariableTable::new(bed),
        bed: bed.clone(),
        resources,
        token,
    }))
}

/// Returns the bits of all real variables, and the hash.
fn all_values(importer: &Importer) -> (Vec<(String, Vec<u64>)>, String) {
    let table = VariableTable::new(&unpacked().bed);
    let reals = table.variables.iter().filter(|v| v.kind == ValueType::Real);
    let bits = |name: &str| importer.get(name).into_iter().map(f64::to_bits).collect();
    (reals.map(|v| (v.name.clone(), bits(&v.name))).collect(), importer.hash())
}

#[test]
fn a_served_unit_gives_the_values_of_one_with_its_bed_inside() {
    let bed = &unpacked().bed;
    let server = TestServer::start(bed);
    let unit = served_unit(bed, &server.endpoint);
    // The second instance finds the run where the first one left it.
    for version in VERSIONS {
        let importers = [unpacked(), unit].map(|unit| Importer::new(version, unit));
        let [local, served] = &importers;
        assert_eq!(all_values(served), all_values(local), "before the first step");
        importers.iter().for_each(Importer::initialize);
        for k in 0..7 {
            let time = f64::from(k) * STEP;
            for importer in &importers {
                if k == 4 {
                    importer.set_whole("solver.max_iterations", 12);
                    importer.set("solver.tolerance", &[1e-2]);
                }
                // Without an input in between, the tine stands still.
                if k != 2 {
                    set_motion(importer, time + STEP);
                }
                importer.step(time, STEP);
            }
            assert_eq!(all_values(served), all_values(local), "after step {k}");
        }
        let refused = importers.each_ref().map(|i| i.step_status(7.0 * STEP, 0.0015));
        assert_eq!(refused[0], refused[1]);
        assert_eq!(refused[1].0, 2);
        for importer in &importers {
            unsafe {
                match version {
                    Version::Two => assert_eq!(ballast_fmu::fmi2::fmi2Reset(importer.instance), 0),
                    Version::Three => assert_eq!(fmi3::fmi3Reset(importer.instance), 0),
                }
            }
        }
        assert_eq!(all_values(served), all_values(local), "after the reset");
        importers.iter().for_each(Importer::initialize);
        for importer in &importers {
            set_motion(importer, STEP);
            importer.step(0.0, STEP);
        }
        assert_eq!(all_values(served), all_values(local), "after a step from the reset");
    }
    assert_eq!(server.end(), 16);
}

#[test]
fn loads_reach_a_served_bed() {
    let bed = &unpacked_with_free_sleeper().bed;
    let server = TestServer::start(bed);
    let units = [unpacked_with_free_sleeper(), served_unit(bed, &server.endpoint)];
    let sleeper = bed.model.driven.iter().find(|d| d.mount.is_some()).unwrap().name.clone();
    let hashes = units.map(|unit| {
        let importer = Importer::ready(Version::Three, unit, |_| ());
        let height = || importer.get(&format!("{sleeper}.body_position"))[2];
        let start = height();
        importer.set(&format!("{sleeper}.load_force"), &[0.0, 0.0, -500.0]);
        (0..5).for_each(|k| importer.step(f64::from(k) * STEP, STEP));
        assert!(height() < start - 1e-3, "{} m after {start} m", height());
        importer.hash()
    });
    assert_eq!(hashes[0], hashes[1]);
    server.end();
}

#[test]
fn a_step_of_a_served_bed_is_repeated_to_the_bit() {
    let bed = &unpacked().bed;
    let server = TestServer::start(bed);
    let importer = Importer::ready(Version::Two, served_unit(bed, &server.endpoint), |_| ());
    let advance = |steps: std::ops::Range<u32>| {
        for k in steps {
            set_motion(&importer, f64::from(k + 1) * STEP);
            importer.step(f64::from(k) * STEP, STEP);
        }
    };
    advance(0..2);
    let mut state = null_mut();
    // A second save replaces the first one, which is deleted at the server.
    (0..100).for_each(|_| importer.save(&mut state));
    let ends: Vec<_> = (0..2)
        .map(|_| {
            assert_eq!(importer.restore_status(state), 0);
            importer.set_whole("solver.max_iterations", 3);
            importer.step(2.0 * STEP, STEP);
            assert_eq!(importer.restore_status(state), 0);
            advance(2..4);
            all_values(&importer)
        })
        .collect();
    let local = Importer::ready(Version::Two, unpacked(), |_| ());
    for k in 0..4 {
        set_motion(&local, f64::from(k + 1) * STEP);
        local.step(f64::from(k) * STEP, STEP);
    }
    assert_eq!([&ends[0], &ends[1]], [&all_values(&local); 2]);
    // The server has no bytes of states.
    let mut size = 0;
    unsafe {
        let status =
            ballast_fmu::fmi2::fmi2SerializedFMUstateSize(importer.instance, state, &mut size);
        assert_eq!((status, size), (3, 0));
    }
    let mut other = null_mut();
    assert_eq!(importer.deserialize(b"bytes", &mut other), 3);
    // States of other units are refused, with and without a server.
    let mut foreign = null_mut();
    local.save(&mut foreign);
    assert_eq!(importer.restore_status(foreign), 3);
    assert_eq!(local.restore_status(state), 3);
    importer.drop_state(state);
    local.drop_state(foreign);
    drop(importer);
    server.end();
}

unsafe extern "C" fn keep_text(
    texts: *mut c_void,
    _: c_int,
    _: *const c_char,
    text: *const c_char,
) {
    let (texts, text) = unsafe { (&*texts.cast::<Mutex<String>>(), CStr::from_ptr(text)) };
    *texts.lock().unwrap() += &text.to_string_lossy();
}

/// Creates an instance; returns it, or null, with the messages.
fn instantiate_with_log(unit: &Unpacked) -> (*mut c_void, String) {
    let texts: &Mutex<String> = Box::leak(Box::default());
    let path = CString::new(unit.resources.path().to_str().unwrap()).unwrap();
    let instance = unsafe {
        fmi3::fmi3InstantiateCoSimulation(
            c"unit".as_ptr(),
            unit.token.as_ptr(),
            path.as_ptr(),
            0,
            1,
            0,
            0,
            null(),
            0,
            std::ptr::from_ref(texts).cast_mut().cast(),
            Some(keep_text),
            null_mut(),
        )
    };
    (instance, texts.lock().unwrap().clone())
}

#[test]
fn servers_that_do_not_fit_are_refused_with_reason_and_remedy() {
    let refusal = |unit| {
        let (instance, text) = instantiate_with_log(unit);
        assert!(instance.is_null(), "{text}");
        text
    };
    let expect = |text: String, parts: &[&str]| {
        assert!(parts.iter().all(|part| text.contains(part)), "{text}");
    };
    let bed = &unpacked().bed;
    let absent = served_unit(bed, &free_endpoint().unwrap());
    let begin = Instant::now();
    expect(refusal(absent), &["yard/bed at tcp/127.0.0.1:", "ballast serve CASE --key yard/bed"]);
    assert!(begin.elapsed() < Duration::from_secs(15), "{:?}", begin.elapsed());

    let server = TestServer::start(bed);
    let other = served_unit(&unpacked_with_free_sleeper().bed, &server.endpoint);
    expect(refusal(other), &["yard/bed: expected the case \"tiny\"", "export the unit again"]);

    let unit = served_unit(bed, &server.endpoint);
    let owner = Importer::new(Version::Three, unit);
    expect(refusal(unit), &["owned by \"fmu-", "another name"]);
    drop(owner);

    let (instance, text) = instantiate_with_log(unit);
    assert!(!instance.is_null() && text.is_empty(), "{text}");
    unsafe { fmi3::fmi3FreeInstance(instance) };
    assert_eq!(server.end(), 0);
}

#[test]
fn a_server_that_ends_leaves_calls_with_a_status_and_another_run_is_reset() {
    let bed = &unpacked().bed;
    let server = TestServer::start(bed);
    let importer = Importer::ready(Version::Two, served_unit(bed, &server.endpoint), |_| ());
    importer.step(0.0, STEP);
    let (hash, mut state) = (importer.hash(), null_mut());
    importer.save(&mut state);
    let endpoint = server.endpoint.clone();
    server.end();
    let begin = Instant::now();
    let (status, early, last) = importer.step_status(STEP, STEP);
    assert!((2..=3).contains(&status) && !early, "{status}");
    assert_eq!((last, importer.hash()), (STEP, hash.clone()));
    let reset = || unsafe { ballast_fmu::fmi2::fmi2Reset(importer.instance) };
    // Another bed under the same name is refused, also by the steps after.
    let server = TestServer::start_run(&unpacked_with_free_sleeper().bed, "run-2", &endpoint);
    assert_eq!(importer.step_status(STEP, STEP).0, 3);
    assert_eq!(importer.restore_status(state), 3);
    assert_eq!(reset(), 3);
    assert_eq!(importer.step_status(0.0, STEP).0, 3);
    assert_eq!(server.end(), 0);
    let server = TestServer::start_run(bed, "run-3", &endpoint);
    assert_eq!(reset(), 0);
    importer.initialize();
    importer.step(0.0, STEP);
    assert_eq!(importer.hash(), hash);
    importer.drop_state(state);
    drop(importer);
    assert_eq!(server.end(), 1);
    assert!(begin.elapsed() < Duration::from_secs(60), "{:?}", begin.elapsed());
}

#[test]
fn an_archive_of_a_served_unit_has_no_bed() {
    let bed = &unpacked().bed;
    let served = ServedUnit::new(bed, KEY, ServedEndpoints::default());
    for version in [FmiVersion::Two, FmiVersion::Three] {
        let archive = served_unit_bytes(bed, &served, b"library", version).unwrap();
        assert!(archive == served_unit_bytes(bed, &served, b"library", version).unwrap());
        assert!(archive.len() < unit_bytes(bed, b"library", version).unwrap().len());
        let names = |name: &str| archive.windows(name.len()).any(|part| part == name.as_bytes());
        assert!(names("resources/served.json") && !names("bed.ballast"));
    }
}
