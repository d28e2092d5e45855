//! A wire that is cut, or falls silent, at random moments.

use crate::common::scene::Random;
use crate::proxy::Proxy;
use crate::setup::{
    KEY, Served, WINDOW, attach, knot, once_free, patient, shaking, step, times, undisturbed,
    wait_until,
};
use ballast_protocol::lockstep::{ErrorCode, ParameterUpdate, RunPosition};
use ballast_protocol::messages::InterpolationMode;
use ballast_protocol::real_time::RealTimeMode;
use ballast_zenoh::{Client, Connection, DISCONNECT_TIMEOUT, Error, SessionConfig, Timeouts};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

#[test]
fn a_wire_that_is_cut_and_restored_changes_no_state() {
    let served = Served::new();
    let proxy = Arc::new(Proxy::before(&served.endpoint));
    let mut client = attach(&SessionConfig::connect_to(&proxy.endpoint)).unwrap();
    let done = Arc::new(AtomicBool::new(false));
    let cutter = std::thread::spawn({
        let (proxy, done) = (Arc::clone(&proxy), Arc::clone(&done));
        move || {
            let mut random = Random(23);
            for _ in 0..times(25) {
                std::thread::sleep(Duration::from_secs_f64(0.1 * random.next()));
                proxy.cut();
                std::thread::sleep(Duration::from_secs_f64(0.1 * random.next()));
                proxy.restore();
                // Time to come together again, or not quite.
                std::thread::sleep(Duration::from_secs_f64(0.3 * random.next()));
            }
            done.store(true, Ordering::SeqCst);
        }
    });
    let mut windows = 0;
    while !done.load(Ordering::SeqCst) || windows == 0 {
        step(&mut client).unwrap();
        windows += 1;
        // Enough windows to be hit in, few enough to be fast.
        std::thread::sleep(Duration::from_millis(10));
    }
    cutter.join().unwrap();
    step(&mut client).unwrap();
    windows += 1;
    assert_eq!(client.position().hash, undisturbed(windows)[windows as usize - 1]);
    client.detach().unwrap();
    assert_eq!(served.stop().computed_windows(), windows);
}

#[test]
fn a_large_request_may_take_its_time_on_a_slow_wire() {
    let (_served, proxy, mut client) = cuttable(patient());
    step(&mut client).unwrap();
    proxy.slow_down(Duration::from_secs(1));
    let t0 = client.position().now_ns;
    let mut motions = shaking(t0, t0 + WINDOW);
    // Some 6 MB, more than buffers on the way take.
    let at = (0..=50_000).map(|k| t0 + k * WINDOW / 50_000);
    motions[0].knots = at.map(knot).collect();
    let begin = Instant::now();
    client.advance_to(t0 + WINDOW, motions, vec![]).unwrap();
    assert!(begin.elapsed() > Duration::from_secs(2), "the wire is not slow");
    assert_eq!(proxy.connections(), 1);
    proxy.slow_down(Duration::ZERO);
    step(&mut client).unwrap();
}

#[test]
fn a_call_on_a_wire_that_takes_nothing_ends_in_time() {
    let served = Served::new();
    let proxy = Proxy::before(&served.endpoint);
    let folder = tempfile::tempdir().unwrap();
    let patience = folder.path().join("client.json5");
    // The component waits for signs of life of this client.
    std::fs::write(&patience, "{ transport: { link: { tx: { lease: 60000 } } } }").unwrap();
    let connect = vec![proxy.endpoint.clone()];
    let link = SessionConfig { connect, ..SessionConfig::from_file(patience) };
    let second = Duration::from_secs(1);
    let timeouts = Timeouts { control: second, window: second, ..Timeouts::default() };
    let mut client = Client::attach(KEY, &link, "first", None, timeouts).unwrap();
    step(&mut client).unwrap();
    proxy.fill_up();
    let t0 = client.position().now_ns;
    let mut motions = shaking(t0, t0 + WINDOW);
    // More than buffers on the way take.
    let at = (0..=130_000).map(|k| t0 + k * WINDOW / 130_000);
    motions[0].knots = at.map(knot).collect();
    let in_time = |what: &str, call: &mut dyn FnMut() -> Error| {
        let begin = Instant::now();
        let error = call();
        assert!(matches!(error, Error::Timeout { .. }), "{what}: {error}");
        let took = begin.elapsed();
        assert!(took > second / 2 && took < 3 * second, "{what}: {took:?}");
    };
    for _ in 0..2 {
        let motions = motions.clone();
        in_time("window", &mut || {
            client.advance_to(t0 + WINDOW, motions.clone(), vec![]).unwrap_err()
        });
        in_time("status", &mut || client.status().unwrap_err());
        in_time("motion", &mut || client.put_motion("floor", &knot(t0)).unwrap_err());
    }
    // The window is computed once, as if nothing had been.
    let restored = Instant::now();
    proxy.restore();
    while let Err(error) = client.advance_to(t0 + WINDOW, motions.clone(), vec![]) {
        assert!(matches!(error, Error::Timeout { .. }), "{error}");
        assert!(restored.elapsed() < 30 * second, "it does not come back");
    }
    proxy.fill_up();
    let begin = Instant::now();
    drop(client);
    assert!(begin.elapsed() < 3 * second, "{:?}", begin.elapsed());
    proxy.cut();
    assert_eq!(served.stop().computed_windows(), 2);
}

#[test]
fn a_wire_that_stays_cut_is_a_lost_peer_and_one_that_comes_back_goes_on() {
    let (_served, proxy, mut client) = cuttable(Timeouts::default());
    for silent in [false, true] {
        step(&mut client).unwrap();
        let before = client.position().clone();
        if silent {
            proxy.fall_silent()
        } else {
            proxy.cut()
        }
        let begin = Instant::now();
        let error = step(&mut client).unwrap_err();
        assert!(matches!(error, Error::Disconnected { .. }), "{error}");
        // A wire that falls silent is noticed first, then waited for.
        assert!(
            begin.elapsed() < 2 * DISCONNECT_TIMEOUT + Duration::from_secs(2),
            "{:?}",
            begin.elapsed()
        );
        assert_eq!(client.position(), &before);
        proxy.cut();
        proxy.restore();
        step_once_back(&mut client);
    }
    let windows = client.position().seq;
    assert_eq!(windows, 4);
    assert_eq!(client.position().hash, undisturbed(4)[3]);
}

#[test]
fn someone_else_who_has_driven_on_meanwhile_is_noticed() {
    let (served, proxy, mut client) = cuttable(patient());
    step(&mut client).unwrap();
    proxy.cut();
    let mut other = once_free(|| attach(&served.link()), Duration::from_secs(5));
    for _ in 0..3 {
        step(&mut other).unwrap();
    }
    proxy.restore();
    let busy = step(&mut client).unwrap_err();
    assert!(busy.request_error().is_some_and(|f| f.owner.as_deref() == Some(other.id())), "{busy}");
    other.detach().unwrap();
    let error = step(&mut client).unwrap_err();
    assert!(matches!(error, Error::Diverged { .. }), "{error}");
    assert!(error.to_string().contains("window 4"), "{error}");
}

/// A component, a wire to it that can be cut, and the client at its end.
fn cuttable(timeouts: Timeouts) -> (Served, Proxy, Client) {
    let served = Served::new();
    let proxy = Proxy::before(&served.endpoint);
    let client =
        Client::attach(KEY, &SessionConfig::connect_to(&proxy.endpoint), "first", None, timeouts)
            .unwrap();
    (served, proxy, client)
}

/// Action of another client while the connection of the first one is cut.
fn meanwhile(served: &Served, proxy: &Proxy, act: &mut dyn FnMut(&mut Client)) -> RunPosition {
    proxy.cut();
    let mut other = once_free(|| attach(&served.link()), Duration::from_secs(5));
    act(&mut other);
    let place = other.detach().unwrap();
    proxy.restore();
    place
}

/// Steps once the wire is back.
fn step_once_back(client: &mut Client) {
    let begin = Instant::now();
    while let Err(error) = step(client) {
        assert!(matches!(error, Error::Disconnected { .. }), "{error}");
        assert!(begin.elapsed() < Duration::from_secs(20), "it does not come back");
    }
}

fn iterations(most: u32) -> ParameterUpdate {
    ParameterUpdate { max_iterations: Some(most), ..ParameterUpdate::default() }
}

#[test]
fn a_run_that_went_on_without_its_client_is_gone_on_with_from_a_kept_state_only() {
    let (served, proxy, mut client) = cuttable(patient());
    // Parameters that another client has set, and one window that another client has computed with other inputs.
    for windows in [0, 1] {
        step(&mut client).unwrap();
        client.save("here").unwrap();
        let left = client.position().clone();
        meanwhile(&served, &proxy, &mut |other| {
            other.set_parameters(&iterations(3 + windows as u32)).unwrap();
            for _ in 0..windows {
                let (begin, end) = (other.position().now_ns, other.position().now_ns + 2 * WINDOW);
                other.advance_to(end, shaking(begin, end), vec![]).unwrap();
            }
        });
        for _ in 0..2 {
            let error = step(&mut client).unwrap_err();
            assert!(matches!(error, Error::Diverged { .. }), "{error}");
            assert!(matches!(client.save("there").unwrap_err(), Error::Diverged { .. }));
            assert_eq!(client.position(), &left);
        }
        client.restore("here").unwrap();
        assert_eq!(client.position().hash, left.hash);
        step(&mut client).unwrap();
    }
    client.detach().unwrap();
}

/// Makes a call whose answer is lost: what it asks is done, then the wire is cut, and is restored when there is no owner any more.
/// The result of the call, and where the run was when the wire was cut.
fn unheard<T>(served: &Served, proxy: &Proxy, call: impl FnOnce() -> T) -> (T, RunPosition) {
    let line = Connection::open(KEY, &served.link(), patient()).unwrap();
    let before = line.status().unwrap().position;
    proxy.lose_answers();
    std::thread::scope(|scope| {
        let wire = scope.spawn(|| {
            let done = wait_until(|| line.status(), |status| status.position != before);
            proxy.cut();
            wait_until(|| line.status(), |status| status.owner.is_none());
            proxy.restore();
            done.position
        });
        (call(), wire.join().unwrap())
    })
}

#[test]
fn what_was_done_before_the_wire_was_cut_is_done_once() {
    let (served, proxy, mut client) = cuttable(patient());
    let before = client.position().now_ns;
    step(&mut client).unwrap();
    let ends = [before, client.position().now_ns];
    let mut otherwise = shaking(ends[0], ends[1]);
    otherwise[0].interpolation = InterpolationMode::Linear;
    let redo = || client.redo(ends, otherwise, vec![]).unwrap();
    let (reply, redone) = unheard(&served, &proxy, redo);
    assert_eq!((reply.hash.to_string(), reply.seq), (redone.hash, redone.seq));
    let (place, set) =
        unheard(&served, &proxy, || client.set_parameters(&iterations(7)).unwrap().clone());
    assert_eq!(place, set);
    let (place, reset) = unheard(&served, &proxy, || client.reset().unwrap().clone());
    assert_eq!((&place.hash, place.seq), (&reset.hash, 0));
    step(&mut client).unwrap();
    client.detach().unwrap();
    // One window, one redo of it, and one of the new run.
    assert_eq!(served.stop().computed_windows(), 3);
}

#[test]
fn parameters_whose_answer_was_lost_are_asked_for_again_before_what_comes_next() {
    let (served, proxy, mut client) = cuttable(Timeouts::default());
    step(&mut client).unwrap();
    // Once they have been set over there, and once not.
    proxy.lose_answers();
    for most in [9, 8] {
        let error = client.set_parameters(&iterations(most)).unwrap_err();
        assert!(matches!(error, Error::Disconnected { .. }) && client.has_pending(), "{error}");
        proxy.cut();
        proxy.restore();
        step_once_back(&mut client);
        assert!(!client.has_pending());
        proxy.cut();
    }
    proxy.restore();
    assert_eq!(client.position().seq, 3);
    step_once_back(&mut client);
    client.detach().unwrap();
    let lockstep = served.stop();
    assert_eq!(lockstep.component().parameters().iterations, 8);
}

#[test]
fn what_somebody_else_did_meanwhile_is_not_taken_for_what_was_asked() {
    let freely = RealTimeMode { bodies: vec!["floor".into()], ..RealTimeMode::default() };
    let ends = [0, WINDOW];
    for k in 0..3 {
        let (served, proxy, mut client) = cuttable(patient());
        client.save("start").unwrap();
        step(&mut client).unwrap();
        let left = client.position().clone();
        // As many windows as before, another state.
        let place = meanwhile(&served, &proxy, &mut |other| {
            other.restore("start").unwrap();
        });
        assert_eq!((place.seq, place.now_ns), (left.seq, 0));
        let error = match k {
            0 => client.set_parameters(&iterations(5)).map(drop),
            1 => client.start_real_time(&freely).map(drop),
            _ => client.redo(ends, shaking(0, WINDOW), vec![]).map(drop),
        };
        let error = error.unwrap_err();
        assert!(matches!(error, Error::Diverged { .. }), "{k}: {error}");
        assert!(matches!(step(&mut client).unwrap_err(), Error::Diverged { .. }), "{k}");
        client.restore("start").unwrap();
        step(&mut client).unwrap();
        client.detach().unwrap();
    }
}

#[test]
fn another_window_waits_for_the_answer_to_the_one_before() {
    let (served, proxy, mut client) = cuttable(Timeouts::default());
    proxy.lose_answers();
    let error = step(&mut client).unwrap_err();
    assert!(matches!(error, Error::Disconnected { .. }), "{error}");
    proxy.cut();
    proxy.restore();
    // The same time, other inputs: it was computed with the earlier ones, and the error says so.
    let begin = Instant::now();
    let error = loop {
        match client.advance_to(WINDOW, vec![], vec![]).unwrap_err() {
            Error::Disconnected { .. } => assert!(begin.elapsed() < Duration::from_secs(20)),
            error => break error,
        }
    };
    assert!(error.request_error().is_some_and(|f| f.code == ErrorCode::OutOfSequence), "{error}");
    assert_eq!((client.position().seq, &client.position().hash), (1, &undisturbed(1)[0]));
    step(&mut client).unwrap();
    assert_eq!(client.position().hash, undisturbed(2)[1]);
    // Nothing at all is set, and nothing is asked.
    client.set_parameters(&ParameterUpdate::default()).unwrap();
    client.detach().unwrap();
    assert_eq!(served.stop().computed_windows(), 2);
}

#[test]
fn a_restore_that_was_not_answered_is_asked_for_again_before_anything_goes_on() {
    let (_served, proxy, mut client) = cuttable(Timeouts::default());
    client.save("here").unwrap();
    // The same time over there, perhaps another state.
    client.set_parameters(&iterations(7)).unwrap();
    proxy.lose_answers();
    let error = client.restore("here").unwrap_err();
    assert!(matches!(error, Error::Disconnected { .. }), "{error}");
    proxy.cut();
    proxy.restore();
    for _ in 0..2 {
        let error = step(&mut client).unwrap_err();
        assert!(error.to_string().contains("`restore` without a reply"), "{error}");
        assert!(matches!(error, Error::Diverged { .. }));
    }
    let begin = Instant::now();
    while let Err(error) = client.restore("here").map(drop) {
        assert!(matches!(error, Error::Disconnected { .. }), "{error}");
        assert!(begin.elapsed() < Duration::from_secs(20), "it does not come back");
    }
    step(&mut client).unwrap();
    assert_eq!(client.position().hash, undisturbed(1)[0]);
    client.detach().unwrap();
}

#[test]
fn a_refused_restore_leads_nowhere() {
    let (served, proxy, mut client) = cuttable(patient());
    step(&mut client).unwrap();
    meanwhile(&served, &proxy, &mut |other| (0..2).for_each(|_| step(other).unwrap()));
    let error = client.restore("nowhere").unwrap_err();
    assert!(error.request_error().is_some_and(|f| f.code == ErrorCode::UnknownState), "{error}");
    // The run has gone on meanwhile: that is not forgotten for a request in between.
    let error = step(&mut client).unwrap_err();
    assert!(matches!(error, Error::Diverged { .. }), "{error}");
    client.reset().unwrap();
    step(&mut client).unwrap();
    client.detach().unwrap();
}

#[test]
fn a_component_that_hangs_when_it_is_looked_for_is_told_soon() {
    // The system accepts connections for it; it says nothing.
    let hangs = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let link = SessionConfig::connect_to(format!("tcp/{}", hangs.local_addr().unwrap()));
    let begin = Instant::now();
    let error = Client::attach(KEY, &link, "test", None, Timeouts::default()).err().unwrap();
    assert!(matches!(error, Error::Disconnected { .. }), "{error}");
    assert!(
        begin.elapsed() < 2 * DISCONNECT_TIMEOUT + Duration::from_secs(2),
        "{:?}",
        begin.elapsed()
    );
}
