//! Time of the last message, from the summary section of a file.
//!
//! Contract: a hint. A truncated file has no summary, and that of a damaged one may be wrong. Layout: MCAP specification,
//! "Footer" and "Statistics" (mcap.dev/spec). The library's reader of summaries is not used, because it allocates
//! whatever the lengths in a file claim.

use crate::record::RECORD_HEAD;
use mcap::MAGIC;
use mcap::records::op;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

/// Size of the content of a footer record, bytes.
const FOOTER: usize = 20;
/// Size of a statistics record up to the time of the last message, bytes.
const STATISTICS: usize = 42;
/// Maximum number of records before the statistics.
const MAX_RECORDS: usize = 10_000;

/// Returns the time of the last message, ns, if the file has a summary.
pub(crate) fn end_time_ns(path: &Path) -> Option<u64> {
    let mut file = File::open(path).ok()?;
    let end: [u8; RECORD_HEAD + FOOTER + MAGIC.len()] = {
        file.seek(SeekFrom::End(-((RECORD_HEAD + FOOTER + MAGIC.len()) as i64))).ok()?;
        bytes(&mut file)?
    };
    // Start of the summary section; 0 without one.
    let start = number(&end[RECORD_HEAD..])?;
    if end[0] != op::FOOTER || start == 0 {
        return None;
    }
    file.seek(SeekFrom::Start(start)).ok()?;
    for _ in 0..MAX_RECORDS {
        let head: [u8; RECORD_HEAD] = bytes(&mut file)?;
        if head[0] == op::STATISTICS {
            let content: [u8; STATISTICS] = bytes(&mut file)?;
            return number(&content[STATISTICS - 8..]);
        }
        let length = i64::try_from(number(&head[1..])?).ok()?;
        file.seek(SeekFrom::Current(length)).ok()?;
    }
    None
}

fn bytes<const N: usize>(file: &mut File) -> Option<[u8; N]> {
    let mut bytes = [0; N];
    file.read_exact(&mut bytes).ok()?;
    Some(bytes)
}

fn number(bytes: &[u8]) -> Option<u64> {
    Some(u64::from_le_bytes(*bytes.first_chunk()?))
}
