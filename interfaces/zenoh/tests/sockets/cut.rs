//! A wire that is cut, or falls silent, at random moments.

use crate::common::scene::Random;
use crate::proxy::Proxy;
use crate::setup::{KEY, Served, attach, once_free, patient, step, times, undisturbed};
use ballast_zenoh::{Client, Error, Link, Patience, SILENCE};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

#[test]
fn a_wire_that_is_cut_and_restored_changes_no_state() {
    let served = Served::new();
    let proxy = Arc::new(Proxy::before(&served.endpoint));
    let mut client = attach(&Link::to(&proxy.endpoint)).unwrap();
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
        // Enough windows to be hit in, not so many that it takes long.
        std::thread::sleep(Duration::from_millis(10));
    }
    cutter.join().unwrap();
    step(&mut client).unwrap();
    windows += 1;
    assert_eq!(client.place().hash, undisturbed(windows)[windows as usize - 1]);
    client.detach().unwrap();
    assert_eq!(served.stop().answered_count(), windows);
}

#[test]
fn a_wire_that_stays_cut_is_a_lost_peer_and_one_that_comes_back_goes_on() {
    let served = Served::new();
    let proxy = Proxy::before(&served.endpoint);
    let patience = Patience::default();
    let link = Link::to(&proxy.endpoint);
    let mut client = Client::attach(KEY, &link, "test", None, patience).unwrap();
    for silent in [false, true] {
        step(&mut client).unwrap();
        let before = client.place().clone();
        if silent {
            proxy.fall_silent()
        } else {
            proxy.cut()
        }
        let begin = Instant::now();
        let error = step(&mut client).unwrap_err();
        assert!(matches!(error, Error::PeerLost { .. }), "{error}");
        // A wire that falls silent is noticed first, then waited for.
        assert!(begin.elapsed() < 2 * SILENCE + Duration::from_secs(2), "{:?}", begin.elapsed());
        assert_eq!(client.place(), &before);
        proxy.cut();
        proxy.restore();
        let begin = Instant::now();
        while let Err(error) = step(&mut client) {
            assert!(matches!(error, Error::PeerLost { .. }), "{error}");
            assert!(begin.elapsed() < Duration::from_secs(20), "it does not come back");
        }
    }
    let windows = client.place().seq;
    assert_eq!(windows, 4);
    assert_eq!(client.place().hash, undisturbed(4)[3]);
}

#[test]
fn someone_else_who_has_driven_on_meanwhile_is_noticed() {
    let served = Served::new();
    let proxy = Proxy::before(&served.endpoint);
    let mut client =
        Client::attach(KEY, &Link::to(&proxy.endpoint), "first", None, patient()).unwrap();
    step(&mut client).unwrap();
    proxy.cut();
    let mut other = once_free(|| attach(&served.link()), Duration::from_secs(5));
    for _ in 0..3 {
        step(&mut other).unwrap();
    }
    proxy.restore();
    let busy = step(&mut client).unwrap_err();
    assert!(busy.fault().is_some_and(|f| f.owner.as_deref() == Some(other.id())), "{busy}");
    other.detach().unwrap();
    let error = step(&mut client).unwrap_err();
    assert!(matches!(error, Error::Diverged { .. }), "{error}");
    assert!(error.to_string().contains("window 4"), "{error}");
}
