//! Checkpoints come back bit for bit, and replace earlier ones at once or not at all.

use crate::scene;
use ballast::model::{Acceleration, PartitionRule, PenetrationCorrection, Schedule};
use ballast::state::State;
use ballast_hdf5::checkpoint::{Kind, read, write};
use ballast_hdf5::{Error, state_hash};

/// Bit patterns: `==` does not distinguish 0.0 from -0.0.
fn bits(state: &State) -> Vec<u64> {
    let vectors =
        [&state.position, &state.velocity, &state.angular_velocity, &state.contacts.impulse];
    let mut bits: Vec<u64> =
        vectors.iter().flat_map(|v| v.iter()).flat_map(|v| v.iter()).map(|x| x.to_bits()).collect();
    bits.extend(state.orientation.iter().flat_map(|q| q.coords.iter()).map(|x| x.to_bits()));
    bits.extend(state.driver.values.iter().map(|x| x.to_bits()));
    bits
}

#[test]
fn everything_comes_back_bit_for_bit() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.h5");
    let mut written = scene::checkpoint();
    for (schedule, partition, tolerance, kind) in [
        (Schedule::Sequential, PartitionRule::Boxes([1, 2, 3]), Some(1e-4), Kind::Bed),
        (Schedule::Synchronous, PartitionRule::Balanced(7), None, Kind::Run),
        (Schedule::Asynchronous, PartitionRule::ContactsPer(9), Some(1e-300), Kind::Run),
    ] {
        let solver = &mut written.model.solver;
        (solver.schedule, solver.partition, solver.tolerance) = (schedule, partition, tolerance);
        solver.warm_start_factor = tolerance.map_or(1.0, |_| 0.25);
        solver.skip_converged_subdomains = kind == Kind::Bed;
        solver.acceleration =
            if tolerance.is_none() { Acceleration::Nncg } else { Acceleration::None };
        solver.penetration_correction =
            tolerance.map(|_| PenetrationCorrection { factor: 0.25, slop: 3e-6, iterations: 7 });
        written.kind = kind;
        write(&path, &written).unwrap();
        let back = read(&path).unwrap();
        assert_eq!(back, written);
        assert_eq!(bits(&back.state), bits(&written.state));
        assert_eq!(
            state_hash(&back.model, &back.state),
            state_hash(&written.model, &written.state)
        );
    }
}

#[test]
fn an_empty_model_comes_back() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("empty.h5");
    let mut written = scene::checkpoint();
    written.model.shapes.clear();
    written.model.grains = Default::default();
    written.model.driven.clear();
    written.state = State::default();
    written.extra.clear();
    write(&path, &written).unwrap();
    assert_eq!(read(&path).unwrap(), written);
}

/// The parent writes, a child process reads it and prints the hash.
#[test]
fn another_process_reads_the_same_bits() {
    if let Ok(path) = std::env::var("BALLAST_TEST_READ") {
        let back = read(path).unwrap();
        println!("fingerprint {:032x}", state_hash(&back.model, &back.state));
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.h5");
    let written = scene::checkpoint();
    write(&path, &written).unwrap();
    let child = std::process::Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "checkpoint::another_process_reads_the_same_bits", "--nocapture"])
        .env("BALLAST_TEST_READ", &path)
        .output()
        .unwrap();
    let expected = format!("fingerprint {:032x}", state_hash(&written.model, &written.state));
    let message = String::from_utf8_lossy(&child.stdout);
    assert!(child.status.success() && message.contains(&expected), "{expected}: {message}");
}

#[test]
fn the_fingerprint_sees_every_kind_of_change() {
    let written = scene::checkpoint();
    let hash = state_hash(&written.model, &written.state);
    let changed = |change: fn(&mut ballast_hdf5::checkpoint::Checkpoint)| {
        let mut other = written.clone();
        change(&mut other);
        state_hash(&other.model, &other.state) != hash
    };
    assert!(changed(|c| c.state.velocity[1].y = 0.0)); // from -0.0
    assert!(changed(|c| c.state.step += 1));
    // Memory and driver say nothing of where the bodies are.
    assert!(!changed(|c| c.state.driver = Default::default()));
    assert!(!changed(|c| c.state.window = Default::default()));
    assert!(changed(|c| c.state.contacts.feature[0] -= 1));
    assert!(changed(|c| c.model.solver.warm_start_factor = 0.5));
    assert!(changed(|c| c.model.solver.acceleration = Acceleration::None));
    assert!(changed(|c| c.model.solver.skip_converged_subdomains = true));
    assert!(changed(|c| c.model.solver.penetration_correction = None));
    assert!(changed(|c| c.model.driven[0].name.push('x')));
    assert!(changed(|c| c.model.shapes[3].edges.swap(0, 1)));
    assert!(changed(|c| c.model.grains.mass[0] = c.model.grains.mass[0].next_up()));
    assert!(!changed(|c| c.case_text.clear()));
}

#[test]
fn what_could_not_be_stepped_is_not_written() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.h5");
    write(&path, &scene::checkpoint()).unwrap();
    let before = std::fs::read(&path).unwrap();
    let mut bad = scene::checkpoint();
    bad.state.velocity[3].x = f64::NAN;
    let error = write(&path, &bad).unwrap_err();
    assert!(matches!(error, Error::Refused { .. }), "{error}");
    assert!(error.to_string().contains("velocity of body 3"), "{error}");
    assert_eq!(std::fs::read(&path).unwrap(), before);
}

#[test]
fn the_same_content_gives_the_same_file() {
    let folder = tempfile::tempdir().unwrap();
    let (a, b) = (folder.path().join("a.h5"), folder.path().join("b.h5"));
    write(&a, &scene::checkpoint()).unwrap();
    std::thread::sleep(std::time::Duration::from_millis(1100));
    write(&b, &scene::checkpoint()).unwrap();
    assert!(std::fs::read(&a).unwrap() == std::fs::read(&b).unwrap());
}

/// A child whose files may not grow beyond a limit meets what a full disk does to a write.
#[cfg(unix)]
#[test]
fn no_room_leaves_the_earlier_file_and_no_rest() {
    if let Ok(path) = std::env::var("BALLAST_TEST_NO_ROOM") {
        let mut larger = scene::checkpoint();
        larger.case_text = "larger".repeat(100_000);
        match write(path, &larger) {
            Err(e @ Error::Io { .. }) => println!("refused: {e}"),
            other => panic!("{other:?}"),
        }
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.h5");
    write(&path, &scene::checkpoint()).unwrap();
    let before = std::fs::read(&path).unwrap();
    let exe = std::env::current_exe().unwrap();
    // SIGXFSZ ignored, as on a full disk there is no signal: the write itself fails.
    let script = format!(
        "trap '' XFSZ; ulimit -f 100; exec '{}' --exact \
         checkpoint::no_room_leaves_the_earlier_file_and_no_rest --nocapture",
        exe.display()
    );
    let child = std::process::Command::new("sh")
        .args(["-c", &script])
        .env("BALLAST_TEST_NO_ROOM", &path)
        .output()
        .unwrap();
    let message = String::from_utf8_lossy(&child.stdout);
    assert!(child.status.success() && message.contains("refused: "), "{child:?}");
    assert!(std::fs::read(&path).unwrap() == before);
    let left: Vec<_> = std::fs::read_dir(folder.path()).unwrap().collect();
    assert_eq!(left.len(), 1, "{left:?}");
}

#[cfg(unix)]
#[test]
fn a_link_stays_and_what_is_no_file_is_not_replaced() {
    let folder = tempfile::tempdir().unwrap();
    let [file, link, pipe] = ["file.h5", "link.h5", "pipe"].map(|name| folder.path().join(name));
    write(&file, &scene::checkpoint()).unwrap();
    std::os::unix::fs::symlink("file.h5", &link).unwrap();
    let mut other = scene::checkpoint();
    other.case_name = "other".into();
    write(&link, &other).unwrap();
    assert!(link.is_symlink());
    assert_eq!(read(&file).unwrap().case_name, "other");
    assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    let lost = folder.path().join("lost");
    std::os::unix::fs::symlink("nowhere", &lost).unwrap();
    for (path, found) in [(&pipe, "a device or a pipe"), (&lost, "a link to nothing")] {
        let error = write(path, &other).unwrap_err().to_string();
        assert!(error.contains(found), "{error}");
    }
    assert!(write(folder.path(), &other).unwrap_err().to_string().contains("a folder"));
    assert!(pipe.exists() && lost.is_symlink());
}

#[test]
fn no_folder_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let error = write(folder.path().join("none/run.h5"), &scene::checkpoint()).unwrap_err();
    assert!(matches!(error, Error::Io { .. }), "{error}");
    assert!(matches!(read(folder.path().join("none.h5")), Err(Error::Io { .. })));
}
