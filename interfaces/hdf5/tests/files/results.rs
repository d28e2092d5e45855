//! Results: what is written is read, by us and by VTK; killed and resumed runs keep their frames.

use crate::damage::instead;
use crate::{left_out, scene};
use ballast::math::{Pose, Vec3};
use ballast::model::Model;
use ballast::state::State;
use ballast::workspace::Workspace;
use ballast_hdf5::Error;
use ballast_hdf5::export::export;
use ballast_hdf5::results::{
    BackgroundWriter, BlockFrame, ResultsMetadata, ResultsReader, ResultsWriter,
};
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

const COLUMNS: [(&str, &str); 2] = [("iterations", "1"), ("kinetic energy", "J")];

/// Grains that rise by 1 cm a frame, frames 10 steps apart; `frame % 20` contacts carry a force.
fn frame(model: &Model, frame: u64) -> (State, Workspace) {
    let mut state = scene::state(model);
    state.step = 10 * frame;
    state.time_ns = 1_000_000 * frame;
    for g in 0..model.grains.len() {
        state.position[g].z += 0.01 * frame as f64;
        state.velocity[g] = Vec3::new(3.0, 4.0, 0.0) * g as f64;
    }
    let mut workspace = Workspace::default();
    let carry = frame as u32 % 20;
    for k in 0..=carry {
        let point = Vec3::new(0.0, 0.0, f64::from(k));
        workspace.contacts.push([k, k + 1], 0, point, Vec3::z(), -1e-4);
        // The last one carries nothing and is left out.
        let newtons = if k == carry { 0.0 } else { 2.0 };
        workspace.impulse.push(Vec3::new(0.0, 1.5, newtons) * (newtons * 1e-4));
    }
    (state, workspace)
}

fn poses(model: &Model, state: &State) -> Vec<Pose> {
    (0..model.body_count()).map(|b| state.pose(b)).collect()
}

fn meta() -> ResultsMetadata {
    ResultsMetadata {
        case_name: "Stück".into(),
        program: "test".into(),
        ..ResultsMetadata::default()
    }
}

fn write_frames(path: &Path, frames: std::ops::Range<u64>) -> ResultsWriter {
    let model = scene::model();
    let mut writer = ResultsWriter::create(path, &model, &meta()).unwrap();
    writer.table("solver", &COLUMNS).unwrap();
    add_frames(&mut writer, &model, frames);
    writer
}

fn add_frames(writer: &mut ResultsWriter, model: &Model, frames: std::ops::Range<u64>) {
    for f in frames {
        for step in 10 * f..10 * f + 10 {
            writer.append("solver", step, &[step as f64, 0.1 * step as f64]).unwrap();
        }
        let (state, workspace) = frame(model, f);
        writer.frame(model, &state, &workspace).unwrap();
    }
}

#[test]
fn frames_and_tables_come_back() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("results.h5");
    write_frames(&path, 0..4).close().unwrap();
    let reader = ResultsReader::open(&path).unwrap();
    assert_eq!(reader.steps(), [0, 10, 20, 30]);
    assert_eq!(reader.times().unwrap()[3], 3_000_000.0 * 1e-9);
    assert_eq!(reader.blocks().unwrap(), ["grains", "sleepers", "tines", "boundary", "contacts"]);
    assert_eq!(reader.metadata("case_name").unwrap(), "Stück");
    let model = scene::model();
    let (state, _) = frame(&model, 2);
    assert_eq!(reader.poses(2).unwrap(), poses(&model, &state));
    let grains = reader.block("grains", 2).unwrap();
    assert_eq!((grains.points.len(), grains.polygon_ends.len()), (27 * 8, 27 * 6));
    let corner = state.pose(26).point(&model.shapes[0].vertices[7]);
    let drawn = grains.points[27 * 8 - 1];
    assert_eq!(drawn, [corner.x as f32, corner.y as f32, corner.z as f32]);
    let of = |name: &str| grains.cell_data.iter().find(|a| a.name == name).unwrap();
    assert_eq!(of("body").values[6 * 7 + 1], 7.0);
    assert_eq!(of("speed").values[6 * 7 + 1], 35.0);
    // 3 N aside and 4 N up; grain 1 has such a contact on either side.
    assert!((of("load").values[6] - 10.0).abs() < 1e-5, "{}", of("load").values[6]);
    let contacts = reader.block("contacts", 3).unwrap();
    assert_eq!(contacts.points, [[0., 0., 0.], [0., 0., 1.], [0., 0., 2.]]);
    let table = reader.table("solver").unwrap();
    assert_eq!(table.columns[1], ("kinetic energy".into(), "J".into()));
    assert_eq!(table.steps, (0..40).collect::<Vec<u64>>());
    assert_eq!(table.rows[2 * 37 + 1], 0.1 * 37.0);
}

/// The resumed file must be as if the run had never stopped.
#[test]
fn a_resumed_run_forgets_what_came_after_the_checkpoint() {
    let folder = tempfile::tempdir().unwrap();
    let (path, whole) = (folder.path().join("results.h5"), folder.path().join("whole.h5"));
    write_frames(&whole, 0..6).close().unwrap();
    let model = scene::model();
    for kept in [0_u64, 1, 3, 5] {
        write_frames(&path, 0..5).close().unwrap();
        let at_step = (10 * kept).saturating_sub(1);
        let mut writer = if kept == 0 {
            // Before the first frame: the row of step 0 goes too.
            drop(write_frames(&path, 1..5));
            ResultsWriter::append_to(&path, &model, 0).unwrap()
        } else {
            ResultsWriter::append_to(&path, &model, at_step).unwrap()
        };
        assert_eq!(writer.last_step(), kept.checked_sub(1).map(|k| 10 * k));
        writer.table("solver", &COLUMNS).unwrap();
        add_frames(&mut writer, &model, kept..6);
        writer.close().unwrap();
        let (a, b) = (ResultsReader::open(&path).unwrap(), ResultsReader::open(&whole).unwrap());
        assert_eq!(a.steps(), b.steps(), "kept {kept}");
        assert_eq!(a.times().unwrap(), b.times().unwrap());
        assert_eq!(a.table("solver").unwrap(), b.table("solver").unwrap());
        for f in 0..6 {
            assert_eq!(a.poses(f).unwrap(), b.poses(f).unwrap());
            for block in b.blocks().unwrap() {
                let (a, b) = (a.block(&block, f).unwrap(), b.block(&block, f).unwrap());
                assert_eq!(a, b, "kept {kept}, frame {f}, {block}");
            }
        }
    }
}

#[test]
fn misuse_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("results.h5");
    let mut writer = write_frames(&path, 0..2);
    let mut model = scene::model();
    let (state, workspace) = frame(&model, 1);
    let message = |r: Result<(), Error>| match r {
        Err(e @ Error::Refused { .. }) => e.to_string(),
        other => panic!("{other:?}"),
    };
    let again = message(writer.frame(&model, &state, &workspace));
    assert!(again.contains("expected a step after 10, found 10"), "{again}");
    assert!(message(writer.append("solver", 20, &[1.0])).contains("expected 2 values, found 1"));
    assert!(message(writer.append("solvr", 20, &[1.0])).contains("solvr"));
    assert!(message(writer.table("solver", &[("x", "m")])).contains("iterations"));
    assert!(message(writer.table("a/b", &[("x", "m")])).contains("a/b"));
    writer.close().unwrap();
    model.grains.mass[0] *= 2.0;
    let other = message(ResultsWriter::append_to(&path, &model, 10).map(drop));
    assert!(other.contains("bodies"), "{other}");
    assert!(matches!(
        ResultsWriter::create(folder.path().join("no/r.h5"), &model, &meta()),
        Err(Error::Io { .. })
    ));
    assert!(ResultsReader::open(folder.path().join("none.h5")).is_err());
}

/// SIGKILL at any moment: all frames that were reported are there, and the run can continue.
#[cfg(unix)]
#[test]
fn a_killed_run_leaves_its_frames() {
    const NAME: &str = "results::a_killed_run_leaves_its_frames";
    if let Ok(path) = std::env::var("BALLAST_TEST_KILLED") {
        let model = scene::model();
        let mut writer = ResultsWriter::create(path, &model, &meta()).unwrap();
        writer.table("solver", &COLUMNS).unwrap();
        for f in 0.. {
            let (state, workspace) = frame(&model, f);
            writer.append("solver", 10 * f, &[0.0, 0.0]).unwrap();
            writer.frame(&model, &state, &workspace).unwrap();
            println!("written {f}");
        }
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("results.h5");
    for round in 0..12 {
        let mut child = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", NAME, "--nocapture"])
            .env("BALLAST_TEST_KILLED", &path)
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let lines = BufReader::new(child.stdout.take().unwrap()).lines();
        let written = lines.map_while(Result::ok).filter(|l| l.starts_with("written"));
        assert!(written.take(3 + 5 * round).count() > 0);
        std::thread::sleep(std::time::Duration::from_micros(137 * round as u64));
        child.kill().unwrap();
        child.wait().unwrap();
        let reader = ResultsReader::open(&path).unwrap();
        let frames = reader.steps().len();
        assert!(frames >= 3 + 5 * round, "{frames} frames in round {round}");
        reader.block("grains", frames - 1).unwrap();
        reader.block("contacts", frames - 1).unwrap();
        drop(reader);
        let model = scene::model();
        let writer = ResultsWriter::append_to(&path, &model, 20).unwrap();
        assert_eq!(writer.last_step(), Some(20));
        writer.close().unwrap();
        assert_eq!(ResultsReader::open(&path).unwrap().table("solver").unwrap().steps, [0, 10, 20]);
    }
}

/// A flush is many writes: killed among them, a program leaves any part of the file's pages new and the others old.
#[test]
fn a_flush_that_was_cut_short_costs_no_frame_of_before_the_checkpoint() {
    let folder = tempfile::tempdir().unwrap();
    let (path, whole) = (folder.path().join("results.h5"), folder.path().join("whole.h5"));
    write_frames(&whole, 0..60).close().unwrap();
    let whole = all_of(&whole).unwrap();
    let model = scene::model();
    let mut writer = write_frames(&path, 0..40);
    writer.secure().unwrap();
    let old = std::fs::read(&path).unwrap();
    add_frames(&mut writer, &model, 40..50);
    let new = std::fs::read(&path).unwrap();
    let spare = std::fs::read(folder.path().join("results.h5.index-backup")).unwrap();
    std::mem::forget(writer);

    let mut unreadable = 0;
    for round in 0..24_u64 {
        let path = folder.path().join(format!("torn{round}.h5"));
        std::fs::write(&path, torn(&old, &new, round)).unwrap();
        let as_it_is = all_of(&path);
        unreadable += u32::from(as_it_is.is_none_or(|found| found[..40] != whole[..40]));
        std::fs::write(folder.path().join(format!("torn{round}.h5.index-backup")), &spare).unwrap();
        let mut writer = ResultsWriter::append_to(&path, &model, 395).unwrap();
        assert_eq!(writer.last_step(), Some(390));
        writer.table("solver", &COLUMNS).unwrap();
        add_frames(&mut writer, &model, 40..60);
        writer.close().unwrap();
        assert!(all_of(&path).unwrap() == whole, "round {round}");
        assert!(!folder.path().join(format!("torn{round}.h5.index-backup")).exists());
    }
    assert!(unreadable > 0, "no file was torn where it hurts");
}

/// Killed while it cuts a file for a continued run, a program leaves the whole file or a backup to repair it from.
#[cfg(unix)]
#[test]
fn a_cut_that_was_interrupted_is_made_again() {
    const NAME: &str = "results::a_cut_that_was_interrupted_is_made_again";
    let model = scene::model();
    if let Ok(path) = std::env::var("BALLAST_TEST_CUT") {
        ResultsWriter::append_to(path, &model, 395).unwrap();
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    write_frames(&at("whole.h5"), 0..60).close().unwrap();
    let whole = all_of(&at("whole.h5")).unwrap();
    write_frames(&at("sealed.h5"), 0..50).close().unwrap();
    let sealed = all_of(&at("sealed.h5"));
    // The file without its seal, with its backup, and the file after the cut.
    std::fs::copy(at("sealed.h5"), at("model.h5")).unwrap();
    std::mem::forget(ResultsWriter::append_to(at("model.h5"), &model, u64::MAX).unwrap());
    let old = std::fs::read(at("model.h5")).unwrap();
    let spare = std::fs::read(at("model.h5.index-backup")).unwrap();
    std::mem::forget(ResultsWriter::append_to(at("model.h5"), &model, 395).unwrap());
    let new = std::fs::read(at("model.h5")).unwrap();
    let continues = |path: &Path, round: usize| {
        let mut writer = ResultsWriter::append_to(path, &model, 395).unwrap();
        assert_eq!(writer.last_step(), Some(390), "round {round}");
        writer.table("solver", &COLUMNS).unwrap();
        add_frames(&mut writer, &model, 40..60);
        writer.close().unwrap();
        assert!(all_of(path).unwrap() == whole, "round {round}");
    };

    // The system kills a process that writes beyond a limit.
    let test = format!("exec '{}' --exact {NAME}", std::env::current_exe().unwrap().display());
    let mut changed = 0;
    for round in 0..=8 {
        let (path, backup) = (at("killed.h5"), at("killed.h5.index-backup"));
        let _ = std::fs::remove_file(&backup);
        std::fs::copy(at("sealed.h5"), &path).unwrap();
        let kilobytes = round * old.len() / 8 / 1024;
        let script = format!("ulimit -c 0; ulimit -f {kilobytes}; {test}");
        let mut child = Command::new("bash");
        child.args(["-c", &script]).env("BALLAST_TEST_CUT", &path);
        child.output().unwrap();
        let is_uncut = all_of(&path) == sealed;
        changed += u32::from(!is_uncut && std::fs::read(&path).unwrap() != new);
        assert!(is_uncut || backup.exists(), "round {round}");
        continues(&path, round);
    }
    assert!(changed > 0, "no kill was inside the cut");

    for round in 0..8 {
        let path = at(&format!("torn{round}.h5"));
        let mut mixed = torn(&old, &new, round as u64);
        // The cut may have shortened the file already.
        mixed.truncate(if round % 2 == 0 { new.len() } else { usize::MAX });
        std::fs::write(&path, mixed).unwrap();
        std::fs::write(at(&format!("torn{round}.h5.index-backup")), &spare).unwrap();
        continues(&path, round);
    }
}

/// The old file with some of its pages, and some of those behind its end, new.
fn torn(old: &[u8], new: &[u8], seed: u64) -> Vec<u8> {
    const PAGE: usize = 512;
    let mut mixed = old.to_vec();
    for (page, bytes) in new.chunks(PAGE).enumerate() {
        let chance =
            (page as u64 + 1).wrapping_mul(2 * seed + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        if chance >> 62 == 0 {
            continue;
        }
        let at = page * PAGE;
        mixed.resize(mixed.len().max(at + bytes.len()), 0);
        mixed[at..at + bytes.len()].copy_from_slice(bytes);
    }
    mixed
}

/// Every frame of a file: `None` if it cannot be read.
fn all_of(path: &Path) -> Option<Vec<(Vec<Pose>, Vec<BlockFrame>)>> {
    let reader = ResultsReader::open(path).ok()?;
    let blocks = reader.blocks().ok()?;
    let frame = |f: usize| -> Option<_> {
        let blocks = blocks.iter().map(|name| reader.block(name, f).ok()).collect::<Option<_>>()?;
        Some((reader.poses(f).ok()?, blocks))
    };
    (0..reader.steps().len()).map(frame).collect()
}

#[test]
fn a_damaged_copy_is_refused_and_nothing_changed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("results.h5");
    let mut writer = write_frames(&path, 0..3);
    writer.secure().unwrap();
    std::mem::forget(writer);
    let spare = folder.path().join("results.h5.index-backup");
    let (was, mut kept) = (std::fs::read(&path).unwrap(), std::fs::read(&spare).unwrap());
    *kept.last_mut().unwrap() ^= 1;
    std::fs::write(&spare, kept).unwrap();
    let error = ResultsWriter::append_to(&path, &scene::model(), 20).unwrap_err().to_string();
    assert!(error.contains("results.h5.index-backup: checksum"), "{error}");
    assert!(std::fs::read(&path).unwrap() == was);
}

#[test]
fn a_checkpoint_is_no_results_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("checkpoint.h5");
    ballast_hdf5::checkpoint::write(&path, &scene::checkpoint()).unwrap();
    let message = ResultsReader::open(&path).unwrap_err().to_string();
    assert!(message.contains("expected ballast-results, found ballast-checkpoint"), "{message}");
}

/// The HDF5 library reads outside of its memory in some damaged files: it must not see any.
#[test]
fn a_changed_byte_of_complete_results_is_noticed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("results.h5");
    write_frames(&path, 0..3).close().unwrap();
    let whole = std::fs::read(&path).unwrap();
    let content = whole.len() - 512;
    assert!(whole[content..].starts_with(b"ballast-results-end 1\nbytes "));
    let mut damaged = whole.clone();
    for at in (0..2000).chain((2000..content).step_by(997)).chain([content - 1, content + 40]) {
        damaged[at] ^= 1 << (at % 8);
        std::fs::write(&path, &damaged).unwrap();
        let error = ResultsReader::open(&path).expect_err("opened");
        let message = matches!(&error, Error::Damaged { place, .. } if place == "checksum");
        assert!(message, "byte {at}: {error}");
        damaged[at] = whole[at];
    }
    // Without the seal it is a file that is not complete.
    std::fs::write(&path, &whole[..content]).unwrap();
    assert_eq!(ResultsReader::open(&path).unwrap().steps(), [0, 10, 20]);
}

/// Results that are not closed have no seal: the library reads them, and says what it finds.
#[test]
fn rows_of_another_width_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("results.h5");
    write_frames(&path, 0..3).close().unwrap();
    assert!(ResultsReader::open(&path).unwrap().is_closed());
    let mut whole = std::fs::read(&path).unwrap();
    whole.truncate(whole.len() - 512);
    let of_all = |path: &Path| -> ballast_hdf5::Result<()> {
        let reader = ResultsReader::open(path)?;
        assert!(!reader.is_closed());
        reader.times()?;
        reader.table("solver")?;
        for frame in 0..reader.steps().len() {
            reader.poses(frame)?;
            reader.blocks()?.iter().try_for_each(|b| reader.block(b, frame).map(drop))?;
        }
        Ok(())
    };
    std::fs::write(&path, &whole).unwrap();
    of_all(&path).unwrap();
    for (name, shape) in [
        ("frames/step", vec![3, 0]),
        ("frames/position", vec![3, 0]),
        ("tables/solver/step", vec![30, 0]),
        ("tables/solver/rows", vec![30, 1]),
        ("VTKHDF/grains/Steps/Values", vec![3, 0]),
        ("VTKHDF/grains/NumberOfPoints", vec![3, 0]),
        ("VTKHDF/grains/CellData/speed", vec![27 * 6, 0]),
        ("VTKHDF/grains/Points", vec![27 * 8 * 3]),
    ] {
        std::fs::write(&path, &whole).unwrap();
        let file = hdf5::File::open_rw(&path).unwrap();
        let values = vec![0_u64; shape.iter().product()];
        instead(&file, name, &shape, &values);
        drop(file);
        let said = of_all(&path).unwrap_err().to_string();
        assert!(said.contains(name) && said.contains("found shape"), "{name}: {said}");
    }
}

#[test]
fn a_thread_writes_the_same_file() {
    let folder = tempfile::tempdir().unwrap();
    let (path, direct) = (folder.path().join("thread.h5"), folder.path().join("direct.h5"));
    write_frames(&direct, 0..5).close().unwrap();
    let model = scene::model();
    let writer = ResultsWriter::create(&path, &model, &meta()).unwrap();
    let mut background = BackgroundWriter::new(writer, 2);
    background.table("solver", &COLUMNS).unwrap();
    for f in 0..5 {
        for step in 10 * f..10 * f + 10 {
            background.append("solver", step, &[step as f64, 0.1 * step as f64]).unwrap();
        }
        let (state, workspace) = frame(&model, f);
        background.frame(&model, &state, &workspace).unwrap();
    }
    background.secure().unwrap();
    background.close().unwrap();
    let (a, b) = (ResultsReader::open(&path).unwrap(), ResultsReader::open(&direct).unwrap());
    assert_eq!(a.steps(), b.steps());
    assert_eq!(a.table("solver").unwrap(), b.table("solver").unwrap());
    assert_eq!(a.block("grains", 4).unwrap(), b.block("grains", 4).unwrap());
}

#[test]
fn an_error_on_the_thread_reaches_the_caller() {
    let folder = tempfile::tempdir().unwrap();
    let model = scene::model();
    let writer = ResultsWriter::create(folder.path().join("r.h5"), &model, &meta()).unwrap();
    let mut background = BackgroundWriter::new(writer, 1);
    background.append("nothing", 0, &[1.0]).unwrap();
    let error = background.secure().unwrap_err();
    assert!(error.to_string().contains("nothing"), "{error}");
    assert!(matches!(background.secure(), Err(Error::WriterGone { .. })));
}

/// A child that may not write more: because its files may not grow, or because the disk is full.
#[cfg(unix)]
#[test]
fn no_room_is_an_error_and_not_an_end() {
    const NAME: &str = "results::no_room_is_an_error_and_not_an_end";
    if let Ok(folder) = std::env::var("BALLAST_TEST_NO_ROOM") {
        return meet_the_end_of_room(Path::new(&folder));
    }
    let folder = tempfile::tempdir().unwrap();
    let test =
        format!("exec '{}' --exact {NAME} --nocapture", std::env::current_exe().unwrap().display());
    let told_by = |command: &mut Command| {
        let child = command.env("BALLAST_TEST_NO_ROOM", folder.path()).output().unwrap();
        let message = String::from_utf8_lossy(&child.stdout).into_owned();
        assert!(child.status.success() && message.contains("lives on"), "{child:?}");
        message
    };
    told_by(Command::new("sh").args(["-c", &format!("trap '' XFSZ; ulimit -f 4000; {test}")]));
    // A separate disk, which is full, needs a separate mount namespace.
    let apart = |script: &str| {
        let mut command = Command::new("unshare");
        command.args(["--user", "--map-root-user", "--mount", "sh", "-c", script]);
        command
    };
    let disk = format!("mount -t tmpfs -o size=2m tmpfs '{}'", folder.path().display());
    if apart(&disk).output().is_ok_and(|o| o.status.success()) {
        let message = told_by(&mut apart(&format!("{disk} && {test}")));
        assert!(
            message.contains("frames are whole") && message.contains(": No space left on device\n"),
            "{message}"
        );
    } else {
        left_out("this system does not allow mounting a small disk");
    }
}

/// Writes frames until one is refused: those before the last checkpoint come back whole, and the program can still write
/// elsewhere.
#[cfg(unix)]
fn meet_the_end_of_room(folder: &Path) {
    let (path, model) = (folder.join("results.h5"), scene::model());
    let mut writer = ResultsWriter::create(&path, &model, &meta()).unwrap();
    let (mut kept, mut last) = (0, 0);
    let mut write = |f: u64| {
        last = f;
        let (state, _) = frame(&model, f);
        writer.frame(&model, &state, &Workspace::default())?;
        if f == 19 {
            writer.secure()?;
            kept = f + 1;
        }
        Ok(())
    };
    // Some 300 fit: a write with a lost error would continue.
    let error: Error = (0..400).find_map(|f| write(f).err()).expect("no limit met");
    println!("refused at {last}: {error}");
    drop(writer);
    let elsewhere = tempfile::tempdir().unwrap();
    let files = ["results.h5", "results.h5.index-backup"];
    // Files that may not grow may not be copied either.
    let copied = files.map(|name| std::fs::copy(folder.join(name), elsewhere.path().join(name)));
    if copied.iter().all(|result| result.is_ok()) {
        let path = elsewhere.path().join(files[0]);
        ResultsWriter::append_to(&path, &model, 10 * kept - 1).unwrap().close().unwrap();
        all_are_whole(&path, &model, kept);
    }
    let other = elsewhere.path().join("checkpoint.h5");
    ballast_hdf5::checkpoint::write(other, &scene::checkpoint()).unwrap();
    println!("lives on");
}

#[cfg(unix)]
fn all_are_whole(path: &Path, model: &Model, count: u64) {
    let reader = ResultsReader::open(path).unwrap();
    assert_eq!(reader.steps(), (0..count).map(|f| 10 * f).collect::<Vec<_>>());
    for f in 0..count {
        let (state, _) = frame(model, f);
        assert_eq!(reader.poses(f as usize).unwrap(), poses(model, &state), "frame {f}");
        let corner = state.pose(26).point(&model.shapes[0].vertices[7]).cast::<f32>();
        let grains = reader.block("grains", f as usize).unwrap();
        assert_eq!(grains.points[27 * 8 - 1], [corner.x, corner.y, corner.z], "frame {f}");
    }
    println!("{count} frames are whole");
}

/// Returns facts that VTK reports about `files`; `None` without VTK.
fn told_by_vtk(files: &[&Path]) -> Option<Vec<String>> {
    let own = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../target/python/bin/python");
    let python = std::env::var_os("BALLAST_TEST_PYTHON").map_or(own, PathBuf::from);
    let has_vtk = Command::new(&python).args(["-c", "import vtk"]).output();
    if !has_vtk.is_ok_and(|o| o.status.success()) {
        left_out(&format!("{python:?} cannot import vtk (scripts/python.sh gets it)"));
        return None;
    }
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/files/read_frames.py");
    let output = Command::new(python).arg(script).args(files).output().unwrap();
    let (message, errors) =
        (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert!(output.status.success() && !errors.contains("ERR"), "{message}\n{errors}");
    Some(message.lines().map(str::to_string).collect())
}

fn has(facts: &[String], fact: &str) {
    assert!(facts.iter().any(|f| f.starts_with(fact)), "{fact}\n{}", facts.join("\n"));
}

#[test]
fn vtk_reads_frames_and_exports() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("results.vtkhdf");
    write_frames(&path, 0..4).close().unwrap();
    let Some(facts) = told_by_vtk(&[&path]) else { return };
    for fact in [
        "steps 4",
        "3 time 0.003",
        "0 grains points 216 polygons 162 vertices 0",
        "3 grains points 216 polygons 162 vertices 0",
        "3 sleepers points 16 polygons 12",
        "3 tines points 8 polygons 6",
        "3 boundary points 8 polygons 2",
        "0 contacts points 0 polygons 0 vertices 0",
        "3 contacts points 3 polygons 0 vertices 3",
        "3 contacts last 0.0 0.0 2.0",
        "3 grains speed 162 10530.0",
        "3 grains body 162 2106.0",
        "0 grains body 162 2106.0",
    ] {
        has(&facts, fact);
    }
    // Closed and turned outwards: the volume is that of the shapes.
    let model = scene::model();
    let expected: f64 = model.grains.shape.iter().map(|&s| model.shapes[s as usize].volume).sum();
    let volume = facts.iter().find_map(|f| f.strip_prefix("2 grains volume ")).unwrap();
    assert!((volume.parse::<f64>().unwrap() / expected - 1.0).abs() < 1e-4, "{volume}");

    let files = export(&path, folder.path().join("out")).unwrap();
    assert_eq!(files.len(), 4 * 5 + 2);
    let file = |name: &str| files.iter().find(|f| f.ends_with(name)).unwrap().as_path();
    let facts = told_by_vtk(&[file("grains_0003.vtp"), file("contacts_0003.vtp")]).unwrap();
    has(&facts, "0 file points 216 polygons 162 vertices 0");
    has(&facts, "0 file speed 162 10530.0");
    has(&facts, "0 file points 3 polygons 0 vertices 3");
    has(&facts, "0 file normal_force 3 ");
}

#[test]
fn exported_tables_are_plain_csv() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("results.h5");
    write_frames(&path, 0..2).close().unwrap();
    let files = export(&path, folder.path().join("out")).unwrap();
    let csv = std::fs::read_to_string(files.last().unwrap()).unwrap();
    let lines: Vec<_> = csv.lines().collect();
    assert_eq!(lines[0], "step,iterations [1],kinetic energy [J]");
    assert_eq!(lines[4], "3,3,0.30000000000000004");
    let pvd = std::fs::read_to_string(&files[files.len() - 2]).unwrap();
    assert!(pvd.contains("timestep=\"0.001\" part=\"0\" name=\"grains\" file=\"grains_0001.vtp\""));
    // Replaced in one go: another name of the old file keeps it as it was.
    let old = folder.path().join("old.csv");
    std::fs::hard_link(files.last().unwrap(), &old).unwrap();
    std::fs::write(&old, "old").unwrap();
    export(&path, folder.path().join("out")).unwrap();
    assert_eq!(std::fs::read_to_string(&old).unwrap(), "old");
    assert_eq!(std::fs::read_to_string(files.last().unwrap()).unwrap(), csv);
    let left = std::fs::read_dir(folder.path().join("out")).unwrap().count();
    assert_eq!(left, files.len(), "nothing beside them");
}

/// The library does not survive every damage of a heap.
#[test]
fn nothing_lies_in_a_heap_and_a_heap_is_damage() {
    use hdf5::types::VarLenUnicode;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("results.h5");
    let has_heap = || std::fs::read(&path).unwrap().windows(4).any(|w| w == b"GCOL");
    drop(write_frames(&path, 0..3));
    assert!(!has_heap());
    let file = hdf5::File::open_rw(&path).unwrap();
    let about = file.group("metadata").unwrap();
    about.delete_attr("format").unwrap();
    let attribute = about.new_attr::<VarLenUnicode>().shape(1).create("format").unwrap();
    attribute.write_raw(&["ballast-results".parse::<VarLenUnicode>().unwrap()]).unwrap();
    drop((attribute, about, file));
    assert!(has_heap());
    let said = ResultsReader::open(&path).unwrap_err().to_string();
    assert!(said.contains("expected texts of up to"), "{said}");
}

#[test]
fn tables_may_have_many_columns_with_long_names() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("results.h5");
    let names: Vec<String> = (0..2000).map(|i| format!("{i}{}", "ü".repeat(60))).collect();
    let columns: Vec<(&str, &str)> = names.iter().map(|name| (&name[..], "")).collect();
    let mut writer = ResultsWriter::create(&path, &scene::model(), &meta()).unwrap();
    writer.table("wide", &columns).unwrap();
    writer.close().unwrap();
    let message = ResultsReader::open(&path).unwrap().table("wide").unwrap().columns;
    assert!(message.iter().map(|(name, unit)| (&name[..], &unit[..])).eq(columns));
}

#[test]
fn equal_runs_leave_equal_files_whenever_they_are_made() {
    let folder = tempfile::tempdir().unwrap();
    let [one, other] = ["one", "other"].map(|name| folder.path().join(name));
    write_frames(&one, 0..3).close().unwrap();
    // The library keeps times of day in whole seconds.
    std::thread::sleep(std::time::Duration::from_millis(1100));
    write_frames(&other, 0..3).close().unwrap();
    let bytes = std::fs::read(&one).unwrap();
    assert!(bytes.len() > 1000 && bytes == std::fs::read(&other).unwrap());
}
