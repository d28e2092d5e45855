//! Partners on two sides of a router.

use crate::setup::{KEY, Served, attach, step, undisturbed};
use ballast_zenoh::session::free_endpoint;
use ballast_zenoh::{Connection, Server, SessionConfig, Timeouts};
use std::time::{Duration, Instant};
use zenoh::Wait;

/// Router with default settings except scouting.
fn router(endpoint: &str) -> zenoh::Session {
    let mut config = zenoh::Config::default();
    for (key, value) in [
        ("mode", "\"router\"".to_string()),
        ("listen/endpoints", format!("[{endpoint:?}]")),
        ("scouting/multicast/enabled", "false".into()),
    ] {
        config.insert_json5(key, &value).unwrap();
    }
    zenoh::open(config).wait().unwrap()
}

#[test]
fn a_client_of_a_router_is_found_through_it_and_has_its_key_alone() {
    let endpoint = free_endpoint().unwrap();
    let between = router(&endpoint);
    let served = Served::by(Server::open(KEY, &SessionConfig::via_router(&endpoint)).unwrap());
    let mut client = attach(&SessionConfig::connect_to(&endpoint)).unwrap();
    (0..3).for_each(|_| step(&mut client).unwrap());
    let second = Server::open(KEY, &SessionConfig::via_router(&endpoint)).unwrap();
    assert!(second.ensure_unique().is_err(), "two components have one key");
    drop(second);
    // A router that is gone for a while: both sides find it again, and the run continues.
    between.close().wait().unwrap();
    drop(between);
    std::thread::sleep(Duration::from_secs(1));
    let _between = router(&endpoint);
    let begin = Instant::now();
    while let Err(error) = step(&mut client) {
        assert!(begin.elapsed() < Duration::from_secs(30), "{error}");
    }
    step(&mut client).unwrap();
    assert_eq!(client.position().hash, undisturbed(5)[4]);
    drop(client);
    served.stop();
}

#[test]
fn peers_on_one_router_are_told_why_they_do_not_meet() {
    let endpoint = free_endpoint().unwrap();
    let _between = router(&endpoint);
    let server = Server::open(KEY, &SessionConfig::connect_to(&endpoint)).unwrap();
    let begin = Instant::now();
    while !server.is_isolated_by_router() {
        assert!(begin.elapsed() < Duration::from_secs(20), "the router is not noticed");
        std::thread::sleep(Duration::from_millis(20));
    }
    let _served = Served::by(server);
    let line =
        Connection::open(KEY, &SessionConfig::connect_to(&endpoint), Timeouts::default()).unwrap();
    let error = line.status().unwrap_err().to_string();
    assert!(error.contains("--router"), "{error}");
    // One that is the router's client is found by peers, and finds them.
    attach(&SessionConfig::via_router(&endpoint)).unwrap();
}

#[test]
fn a_client_of_no_router_does_not_wait_for_ever() {
    let endpoint = free_endpoint().unwrap();
    let begin = Instant::now();
    let error = SessionConfig::via_router(&endpoint).open().unwrap_err().to_string();
    assert!(error.contains(&endpoint) && begin.elapsed() < Duration::from_secs(30), "{error}");
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("client.json5");
    std::fs::write(&path, "{ mode: 'client' }").unwrap();
    let link = SessionConfig { connect: vec![endpoint], ..SessionConfig::from_file(&path) };
    assert!(link.open().is_err());
}
