//! Addresses of live views for Foxglove. The Python tests read what viewers see.

use crate::serve::{KEY, endpoint};
use crate::setup::Place;
use std::net::TcpListener;

#[test]
fn a_live_view_without_an_address_is_refused_before_the_bed_is_prepared() {
    let place = Place::new();
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let taken = listener.local_addr().unwrap();
    let serve = format!("serve tiny.toml --key {KEY} --listen {} --bed-cache none", endpoint());
    for (address, code, expected) in [
        ("nowhere".to_string(), 2, "expected HOST:PORT or PORT"),
        ("ws://127.0.0.1:8765".to_string(), 2, "expected HOST:PORT or PORT"),
        (taken.to_string(), 4, "expected an address that is free"),
        (taken.port().to_string(), 4, "expected an address that is free"),
        ("192.0.2.1:8765".to_string(), 4, "expected an address that is free"),
    ] {
        let message = place.call(&format!("{serve} --foxglove {address}")).with_code(code).stderr();
        assert!(message.contains(expected) && message.contains(&address), "{message}");
        assert!(!place.path("none").exists(), "{address}");
    }
}
