//! Broken friction-contact problems are refused with the place; never a panic, never memory without bound.

use crate::fclib::{edit, global_file, put, small};
use ballast_hdf5::Error;
use ballast_hdf5::fclib::{Storage, read, write_local};
use hdf5::File;
use std::path::Path;

/// Returns the error of reading after `change`.
fn message(storage: Storage, change: impl Fn(&File)) -> String {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("broken.hdf5");
    write_local(&path, &small(), storage).unwrap();
    said(&path, change)
}

fn said(path: &Path, change: impl Fn(&File)) -> String {
    let file = edit(path);
    change(&file);
    file.close().unwrap();
    let error = read(path).expect_err("a broken problem");
    assert!(matches!(error, Error::Damaged { .. }), "{error}");
    error.to_string()
}

#[track_caller]
fn has(text: &str, words: &[&str]) {
    for word in words {
        assert!(text.contains(word), "{word} in: {text}");
    }
}

#[test]
fn missing_parts_are_named() {
    let parts = ["W/m", "W/n", "W/nz", "W/p", "W/i", "W/x", "vectors/q", "vectors/mu", "spacedim"];
    for part in parts {
        let name = format!("fclib_local/{part}");
        has(&message(Storage::Rows, |f| f.unlink(&name).unwrap()), &[&name, "nothing"]);
    }
    let gone = message(Storage::Rows, |f| f.unlink("fclib_local/W").unwrap());
    has(&gone, &["fclib_local/W", "nothing"]);
    has(
        &message(Storage::Rows, |f| f.unlink("fclib_local").unwrap()),
        &["fclib_local or fclib_global"],
    );
    let instead = message(Storage::Rows, |f| {
        f.unlink("fclib_local/W").unwrap();
        put(f, "fclib_local/W", &[1_i32]);
    });
    has(&instead, &["fclib_local/W"]);
}

#[test]
fn sizes_that_do_not_fit_are_refused() {
    for (part, value) in [("m", 7_i32), ("n", 3), ("m", -6), ("n", i32::MAX)] {
        let name = format!("fclib_local/W/{part}");
        has(&message(Storage::Rows, |f| put(f, &name, &[value])), &[&name, &value.to_string()]);
    }
    has(&message(Storage::Rows, |f| put(f, "fclib_local/W/m", &[6_i32, 6])), &["2 numbers"]);
    has(&message(Storage::Rows, |f| put(f, "fclib_local/vectors/q", &[0.0; 7])), &["three", "7"]);
    has(
        &message(Storage::Rows, |f| put(f, "fclib_local/vectors/mu", &[0.5])),
        &["mu", "[2]", "[1]"],
    );
    has(&message(Storage::Rows, |f| put(f, "fclib_local/spacedim", &[2_i32])), &["spacedim", "2"]);
    has(&message(Storage::Rows, |f| put(f, "fclib_local/vectors/q", &[1_i32; 6])), &["type"]);
    for nz in [11_i32, i32::MAX] {
        let text = message(Storage::Triplets, |f| put(f, "fclib_local/W/nz", &[nz]));
        has(&text, &["as nz says", &nz.to_string()]);
    }
    has(&message(Storage::Rows, |f| put(f, "fclib_local/W/nz", &[-3_i32])), &["nz", "-3"]);
}

#[test]
fn indices_out_of_range_are_refused() {
    for storage in [Storage::Rows, Storage::Columns, Storage::Triplets] {
        for index in [-1_i32, 6, i32::MAX, i32::MIN] {
            let text = message(storage, |f| put(f, "fclib_local/W/i", &[index; 10]));
            has(&text, &["W/i", &format!("{index} at 0")]);
        }
    }
    has(&message(Storage::Triplets, |f| put(f, "fclib_local/W/p", &[9_i32; 10])), &["9 at 0"]);
    for starts in [
        [0_i32, 9, 4, 6, 8, 9, 10],
        [0, 2, 4, 6, 8, 9, 11],
        [0, 2, 4, 6, 8, 9, i32::MAX],
        [1, 2, 4, 6, 8, 9, 10],
        [-5, 2, 4, 6, 8, 9, 10],
    ] {
        has(&message(Storage::Rows, |f| put(f, "fclib_local/W/p", &starts)), &["W/p", "7 starts"]);
    }
    has(
        &message(Storage::Columns, |f| put(f, "fclib_local/W/p", &[0_i32, 10])),
        &["W/p", "7 starts"],
    );
}

#[test]
fn values_that_make_no_sense_are_refused() {
    for (name, size) in [("W/x", 10), ("vectors/q", 6), ("vectors/mu", 2)] {
        let name = format!("fclib_local/{name}");
        for value in [f64::NAN, f64::INFINITY] {
            has(&message(Storage::Rows, |f| put(f, &name, &vec![value; size])), &[&name, "finite"]);
        }
    }
    has(&message(Storage::Rows, |f| put(f, "fclib_local/vectors/mu", &[0.5, -0.1])), &["-0.1"]);
    // A contact that nothing can move.
    has(&message(Storage::Rows, |f| put(f, "fclib_local/W/x", &[0.0; 10])), &["W_nn"]);
    has(&message(Storage::Rows, |f| put(f, "solution/r", &[f64::NAN; 6])), &["solution/r"]);
    has(&message(Storage::Rows, |f| put(f, "guesses/1/r", &[0.0; 5])), &["guesses/1/r"]);
}

#[test]
fn joints_are_refused_not_left_out() {
    has(
        &message(Storage::Rows, |f| put(f, "fclib_local/R/m", &[1_i32])),
        &["fclib_local/R", "joints"],
    );
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("global.hdf5");
    global_file(&path);
    has(&said(&path, |f| put(f, "fclib_global/G/m", &[1_i32])), &["fclib_global/G", "joints"]);
}

#[test]
fn bodies_that_make_no_sense_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("global.hdf5");
    let after = |name: &str, values: &[f64]| {
        global_file(&path);
        said(&path, |f| put(f, &format!("fclib_global/{name}"), values))
    };
    has(&after("M/x", &[2.0, 2.0, 0.0, 4.0, 4.0, 4.0]), &["M", "singular", "at 2"]);
    has(&after("vectors/f", &[0.0; 5]), &["fclib_global/M/m", "5"]);
    has(&after("vectors/w", &[0.0; 4]), &["three", "4"]);
    has(&after("H/x", &[0.0; 6]), &["W_nn"]);
}

#[test]
fn claims_far_beyond_the_file_are_refused_at_once() {
    let chunked = |f: &File, rows: usize, chunk: usize| {
        f.unlink("fclib_local/W/x").unwrap();
        let builder = f.new_dataset::<f64>().chunk(chunk).deflate(9).shape(rows..);
        builder.create("fclib_local/W/x").unwrap();
    };
    // No chunk of it is stored.
    has(&message(Storage::Rows, |f| chunked(f, 1 << 50, 1 << 10)), &["W/x", "at most"]);
    // One small dataset in a huge chunk.
    has(&message(Storage::Rows, |f| chunked(f, 10, 1 << 28)), &["W/x", "at most"]);
}

#[test]
fn other_files_and_cut_ones_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cut.hdf5");
    std::fs::write(&path, "W = 1").unwrap();
    has(&read(&path).unwrap_err().to_string(), &["an HDF5 file"]);
    assert!(matches!(read(folder.path().join("none")).unwrap_err(), Error::Io { .. }));
    write_local(&path, &small(), Storage::Rows).unwrap();
    let whole = std::fs::read(&path).unwrap();
    for length in (0..whole.len() / 2).step_by(61) {
        std::fs::write(&path, &whole[..length]).unwrap();
        assert!(read(&path).is_err(), "cut to {length}");
    }
}

/// Bits anywhere: what is read then is a problem or a typed error, in bounded time and memory.
#[test]
fn flipped_bits_end_in_a_problem_or_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("flipped.hdf5");
    write_local(&path, &small(), Storage::Rows).unwrap();
    let whole = std::fs::read(&path).unwrap();
    let (mut refused, mut accepted) = (0, 0);
    for k in 0..400_u64 {
        let mut bytes = whole.clone();
        // A linear congruential generator: the same bits in every run.
        let random = k.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407) >> 20;
        let at = random as usize % bytes.len();
        bytes[at] ^= 1 << (random >> 40 & 7);
        std::fs::write(&path, &bytes).unwrap();
        match read(&path) {
            Ok(problem) => {
                assert!(
                    problem.local.q.iter().all(|q| q.iter().all(|x| x.is_finite())),
                    "byte {at}"
                );
                accepted += 1;
            }
            Err(error) => {
                assert!(error.to_string().contains("flipped.hdf5"), "byte {at}: {error}");
                refused += 1;
            }
        }
    }
    assert!(refused > 20 && accepted > 20, "{refused} refused, {accepted} accepted");
}
