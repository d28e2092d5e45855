//! Messages that a partner on the network may send: requests and replies, binary and as text.
#![no_main]

use ballast_protocol::messages::{AdvanceReply, AdvanceRequest, Message};
use ballast_protocol::{from_cdr, from_json, to_cdr};
use libfuzzer_sys::fuzz_target;

/// Writes what was read and expects to read the same. Text may hold what has no place in the binary form.
fn read<T: Message>(data: &[u8]) {
    let binary =
        from_cdr::<T>(data).map(|value| to_cdr(&value).expect("what was read can be written"));
    let text = from_json::<T>(data).and_then(|value| to_cdr(&value));
    for bytes in [binary, text].into_iter().flatten() {
        let again = from_cdr::<T>(&bytes).expect("what was written can be read");
        assert_eq!(to_cdr(&again).expect("and written again"), bytes);
    }
}

fuzz_target!(|data: &[u8]| {
    read::<AdvanceRequest>(data);
    read::<AdvanceReply>(data);
});
