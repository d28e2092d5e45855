//! Files that may come from elsewhere: checkpoints, results, contact problems, recordings.
#![no_main]

use ballast_hdf5::{checkpoint, fclib, inspect, results};
use ballast_mcap::messages::MessageReader;
use libfuzzer_sys::fuzz_target;
use std::path::Path;

/// Reads all that a file has to give; errors are fine.
fn read(path: &Path) {
    let _ = checkpoint::read(path);
    let _ = fclib::read(path);
    let _ = inspect::inspect(path);
    if let Ok(reader) = results::ResultsReader::open(path) {
        let _ = reader.times();
        for frame in 0..reader.steps().len().min(4) {
            let _ = reader.poses(frame);
            for block in reader.blocks().unwrap_or_default() {
                let _ = reader.block(&block, frame);
            }
        }
        for name in reader.table_names().unwrap_or_default() {
            let _ = reader.table(&name);
        }
    }
    if let Ok(mut messages) = MessageReader::open(path) {
        while let Ok(Some(_)) = messages.next() {}
    }
}

fuzz_target!(|data: &[u8]| {
    let path = std::env::temp_dir().join(format!("ballast-fuzz-{}", std::process::id()));
    std::fs::write(&path, data).expect("room for a temporary file");
    read(&path);
});
