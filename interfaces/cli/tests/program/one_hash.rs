//! One state hash for one motion, whatever drives it.

use crate::serve::{Serving, attach, endpoint};
use crate::setup::Place;
use ballast_mcap::recording::WindowReader;

#[test]
fn a_partner_that_sends_the_motion_of_a_run_ends_with_its_hash() {
    let place = Place::new();
    place.run("--out run --record run.mcap").with_code(0);
    let mut windows = WindowReader::open(&place.path("run.mcap")).unwrap();
    let endpoint = endpoint();
    let serving = Serving::start(&place, &endpoint, "--out served");
    let mut client = attach(&endpoint, None).unwrap();
    while let Some(window) = windows.next().unwrap() {
        let request = window.record.request;
        let end_ns = u64::try_from(request.t1_ns).unwrap();
        client.advance_to(end_ns, request.motions, request.loads).unwrap();
    }
    assert_eq!(client.position().hash.to_string(), place.hash("run"));
    client.shut_down().unwrap();
    drop(serving);
}
