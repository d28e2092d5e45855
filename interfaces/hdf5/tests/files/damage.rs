//! Damaged files are refused with the place, what was expected and what was found; never a panic.

use crate::scene;
use ballast_hdf5::Error;
use ballast_hdf5::checkpoint::{read, reseal, write};
use hdf5::File;
use std::path::{Path, PathBuf};

fn good_file(folder: &Path) -> PathBuf {
    let path = folder.join("run.h5");
    write(&path, &scene::checkpoint()).unwrap();
    path
}

#[test]
fn every_truncation_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = good_file(folder.path());
    let whole = std::fs::read(&path).unwrap();
    let cut = folder.path().join("cut.h5");
    let offsets = (0..600).chain((600..whole.len()).step_by(97)).chain([whole.len() - 1]);
    for length in offsets {
        std::fs::write(&cut, &whole[..length]).unwrap();
        let error = read(&cut).expect_err(&format!("cut to {length}"));
        let clear = matches!(error, Error::Damaged { .. } | Error::Version { .. });
        assert!(clear, "cut to {length}: {error}");
    }
    let mut longer = whole.clone();
    longer.push(0);
    std::fs::write(&cut, &longer).unwrap();
    assert!(read(&cut).unwrap_err().to_string().contains("size"));
}

#[test]
fn every_flipped_bit_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = good_file(folder.path());
    let mut bytes = std::fs::read(&path).unwrap();
    let bad = folder.path().join("bad.h5");
    for at in (0..512).chain((512..bytes.len()).step_by(41)) {
        let bit = 1 << (at % 8);
        bytes[at] ^= bit;
        std::fs::write(&bad, &bytes).unwrap();
        assert!(read(&bad).is_err(), "bit {bit} of byte {at}");
        bytes[at] ^= bit;
    }
}

#[test]
fn other_files_are_told_apart() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("other.h5");
    for (content, word) in [
        (&b""[..], "empty"),
        (b"solid cube\n", "solid cube"),
        (b"\x89HDF\r\n\x1a\n and more", "HDF5 file without"),
        (b"ballast-checkpoint 1\nbytes 0\n", "ballast-checkpoint 1"),
        (b"ballast-checkpointer 1\n", "ballast-checkpointer"),
        (b"ballast-checkpoint 3\n", "expected ballast-checkpoint 4"),
        (b"ballast-checkpoint 4\n", "21 bytes"),
    ] {
        std::fs::write(&path, content).unwrap();
        let message = read(&path).unwrap_err().to_string();
        assert!(message.contains(word) && message.contains("other.h5"), "{word}: {message}");
    }
}

/// Sets one number of a dataset.
fn set<T: hdf5::H5Type>(file: &File, name: &str, index: usize, value: T) {
    let dataset = file.dataset(name).unwrap();
    let mut values: Vec<T> = dataset.read_raw().unwrap();
    values[index] = value;
    dataset.write_raw(&values).unwrap();
}

/// Puts another dataset in the place of `name`.
pub fn instead<T: hdf5::H5Type>(file: &File, name: &str, shape: &[usize], values: &[T]) {
    file.unlink(name).unwrap();
    let dataset = file.new_dataset::<T>().shape(shape).create(name).unwrap();
    dataset.write_raw(values).unwrap();
}

fn text(value: &str) -> hdf5::types::VarLenUnicode {
    value.parse().unwrap()
}

/// A careful forger seals the file again: the values themselves must be looked at.
#[test]
fn senseless_values_are_refused_with_their_place() {
    type Edit = fn(&File);
    let edits: &[(&str, Edit)] = &[
        ("state/position: expected finite", |f| set(f, "state/position", 4, f64::NAN)),
        ("state/angular_velocity: expected finite", |f| {
            set(f, "state/angular_velocity", 0, f64::INFINITY)
        }),
        ("expected a mass from 1e-30 to 1e30 kg", |f| set(f, "grains/mass", 2, -1.0)),
        ("expected a mass from 1e-30 to 1e30 kg", |f| set(f, "grains/mass", 2, 0.0)),
        ("expected finite moments of inertia above 0", |f| set(f, "grains/inertia", 5, -1e-9)),
        ("grain 0: expected a shape of the model, found 4", |f| set(f, "grains/shape", 0, 4_u32)),
        ("orientation of body 0", |f| set(f, "state/orientation", 0, 2.0)),
        ("found the pair", |f| set(f, "contacts/bodies", 1, 31_u32)),
        ("found the pair", |f| set(f, "contacts/bodies", 0, u32::MAX)),
        ("found pairs out of order", |f| {
            set(f, "contacts/bodies", 0, 2_u32);
            set(f, "contacts/bodies", 1, 5_u32)
        }),
        ("shapes/first_vertex: expected starts", |f| set(f, "shapes/first_vertex", 1, u64::MAX)),
        ("shapes/first_vertex: expected starts", |f| set(f, "shapes/first_vertex", 4, u64::MAX)),
        ("shapes/vertices: expected shape [31, 3]", |f| set(f, "shapes/first_vertex", 4, 31_u64)),
        ("shapes/face_vertices of shape 0: expected below 8", |f| {
            set(f, "shapes/face_vertices", 3, 8_u16)
        }),
        ("shapes/face_starts of shape 1: expected", |f| set(f, "shapes/face_starts", 8, 9999_u32)),
        ("shapes/face_starts of shape 0: expected", |f| set(f, "shapes/face_starts", 0, 1_u32)),
        ("shapes/face_normals of shape 0: expected unit", |f| {
            set(f, "shapes/face_normals", 0, 0.5)
        }),
        ("shapes/edges of shape 0", |f| set(f, "shapes/edges", 2, 6_u16)),
        ("shapes/radius of shape 0", |f| set(f, "shapes/radius", 0, 1.0)),
        ("shapes/volume of shape 0", |f| set(f, "shapes/volume", 0, -1.0)),
        ("model: stepping.step_ns: expected above 0, found 0", |f| {
            set(f, "stepping/step_ns", 0, 0_u64)
        }),
        ("model: stepping.theta", |f| set(f, "stepping/theta", 0, 0.0)),
        ("model: solver.relaxation", |f| set(f, "solver/relaxation", 0, 0.0)),
        ("model: solver.convergence_check_interval", |f| set(f, "solver/check_every", 0, 0_u32)),
        ("model: solver.warm_start_factor", |f| set(f, "solver/warm_start", 0, 2.0)),
        ("model: solver.penetration_correction.factor", |f| set(f, "solver/recovery", 0, 2.0)),
        ("model: solver.penetration_correction.slop", |f| set(f, "solver/recovery", 1, -1e-6)),
        ("solver/recovery_iterations: expected a dataset", |f| {
            f.unlink("solver/recovery_iterations").unwrap()
        }),
        // Without it there would be no recovery: another model.
        ("about/state_hash: expected", |f| f.unlink("solver/recovery").unwrap()),
        ("parts/kind: expected 0", |f| set(f, "parts/kind", 0, 7_u8)),
        ("expected a known shape", |f| set(f, "parts/shape", 2, 99_u32)),
        ("driven/role: expected", |f| set(f, "driven/role", 0, text("king"))),
        ("a unique name", |f| set(f, "driven/name", 1, text("floor"))),
        ("driven/mount: expected modes 0, 1 or 2, found 7", |f| set(f, "driven/mount", 7, 7.0)),
        ("solver/schedule: expected", |f| set(f, "solver/schedule", 0, text("fast"))),
        ("format: expected ballast-checkpoint 4, found ballast-checkpoint 9", |f| {
            set(f, "about/version", 0, 9_u32)
        }),
        ("about/state_hash: expected", |f| set(f, "state/velocity", 0, 0.25)),
        ("about/kind: expected", |f| set(f, "about/kind", 0, text("sofa"))),
        ("state/angular_velocity: expected a dataset, found nothing", |f| {
            f.unlink("state/angular_velocity").unwrap()
        }),
        ("expected a dataset, found nothing", |f| f.unlink("contacts").unwrap()),
        ("driver/kind: expected a dataset, found nothing", |f| f.unlink("driver").unwrap()),
        ("window/squeeze_version: expected 1, found 2", |f| {
            set(f, "window/squeeze_version", 0, 2_u32)
        }),
        ("window/reactions: expected finite", |f| set(f, "window/reactions", 0, f64::NAN)),
        ("window/reactions: expected rows of whole steps", |f| {
            instead(f, "window/reactions", &[3, 6], &[1_f64; 18])
        }),
        ("window/squeezes: expected whole records", |f| {
            instead(f, "window/squeezes", &[1], &[1_f64])
        }),
        ("driver/values: expected a dataset, found something else", |f| {
            f.unlink("driver/values").unwrap();
            f.create_group("driver/values").unwrap();
        }),
        ("grains/mass: expected type float64, found float32", |f| {
            instead(f, "grains/mass", &[27], &[1_f32; 27])
        }),
        ("grains/mass: expected shape [27], found [26]", |f| {
            instead(f, "grains/mass", &[26], &[1_f64; 26])
        }),
        ("grains/mass: expected shape [27], found [27, 1]", |f| {
            instead(f, "grains/mass", &[27, 1], &[1_f64; 27])
        }),
        ("state/position: expected shape [31, 3]", |f| {
            instead(f, "state/position", &[3, 31], &[1_f64; 93])
        }),
        ("driven/name: expected type", |f| instead(f, "driven/name", &[4], &[1_u8; 4])),
        // Petabytes that are not there: refused before memory is asked for.
        ("driver/values: expected plain data", |f| {
            f.unlink("driver/values").unwrap();
            let huge = f.new_dataset::<f64>().chunk(64).shape(1_usize << 50);
            huge.create("driver/values").unwrap();
        }),
        ("grains/shape: expected plain data", |f| {
            f.unlink("grains/shape").unwrap();
            let huge = f.new_dataset::<u32>().shape(1_usize << 40);
            huge.create("grains/shape").unwrap();
        }),
    ];
    let folder = tempfile::tempdir().unwrap();
    for (expected, edit) in edits {
        let path = good_file(folder.path());
        edit(&File::open_rw(&path).unwrap());
        reseal(&path).unwrap();
        let message = read(&path).expect_err(expected).to_string();
        assert!(message.contains(expected) && message.contains("run.h5"), "{expected}\n{message}");
    }
}

#[test]
fn a_resealed_file_without_damage_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = good_file(folder.path());
    reseal(&path).unwrap();
    assert_eq!(read(&path).unwrap(), scene::checkpoint());
}
