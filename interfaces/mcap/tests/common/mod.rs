//! Records of a file, for tests that change single ones.

use mcap::records::op;

/// Returns the offsets of the records outside of chunks, and the end of the data section.
pub fn records(whole: &[u8]) -> (Vec<usize>, usize) {
    let mut at = mcap::MAGIC.len();
    let mut begins = vec![];
    while whole[at] != op::DATA_END {
        begins.push(at);
        at += 9 + u64::from_le_bytes(whole[at + 1..at + 9].try_into().unwrap()) as usize;
    }
    (begins, at)
}
