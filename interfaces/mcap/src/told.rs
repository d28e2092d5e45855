//! What a file says of its messages behind them, without reading them.
//!
//! Contract: a hint. A file that was cut short says nothing, and a damaged one may say anything. Source of the layout:
//! the MCAP specification, "Footer" and "Statistics" (mcap.dev/spec).

use mcap::MAGIC;
use mcap::records::op;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

/// Kind and length, before every record.
const HEAD: usize = 9;
const FOOTER: usize = 20;
/// Statistics up to the latest time, which is the last of it.
const STATISTICS: usize = 42;
/// Records that are looked at before the statistics.
const MOST: usize = 10_000;

/// Latest time of a message, ns.
pub(crate) fn end_ns(path: &Path) -> Option<u64> {
    let mut file = File::open(path).ok()?;
    let end: [u8; HEAD + FOOTER + MAGIC.len()] = {
        file.seek(SeekFrom::End(-((HEAD + FOOTER + MAGIC.len()) as i64))).ok()?;
        bytes(&mut file)?
    };
    // Where what follows the messages begins; 0: nothing does.
    let at = number(&end[HEAD..])?;
    if end[0] != op::FOOTER || at == 0 {
        return None;
    }
    file.seek(SeekFrom::Start(at)).ok()?;
    for _ in 0..MOST {
        let head: [u8; HEAD] = bytes(&mut file)?;
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
