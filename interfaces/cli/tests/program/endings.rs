//! Exit codes and messages.

use crate::setup::{CASE, Place};
use ballast::state::State;
use ballast_hdf5::checkpoint::{self, Checkpoint};

#[test]
fn missing_files_fail_and_are_named() {
    let place = Place::new();
    for arguments in [
        "run none.toml",
        "check none.toml",
        "resume none.h5",
        "inspect none.h5",
        "bench sample none.json",
    ] {
        let ended = place.call(arguments).with_code(1);
        assert!(ended.stderr().contains("none."), "{arguments}: {}", ended.stderr());
    }
}

#[test]
fn wrong_usage_ends_with_2() {
    let place = Place::new();
    for (arguments, says) in [
        ("", "Usage"),
        ("tamp", "tamp"),
        ("run", "CASE"),
        ("run tiny.toml --threads 0", "1..=1024"),
        // They would be started for minutes.
        ("run tiny.toml --threads 100000", "1..=1024"),
        ("sweep plan.toml --threads-per-run 20000", "1..=1024"),
        ("run tiny.toml --dump-problems d --dump-every 0", "number would be zero"),
        ("run tiny.toml --schedule x", "sequential"),
        // Not after the run.
        ("run tiny.toml --expect-hash zz", "32 hexadecimal digits"),
    ] {
        let said = place.call(arguments).with_code(2).stderr();
        assert!(said.contains(says), "{arguments}: {said}");
    }
}

#[test]
fn what_cannot_be_written_to_stdout_fails_and_a_reader_that_has_enough_does_not() {
    let place = Place::new();
    let shell = |script: &str| {
        let program = env!("CARGO_BIN_EXE_ballast");
        let mut bash = std::process::Command::new("bash");
        bash.current_dir(place.path("")).args(["-o", "pipefail", "-c"]);
        crate::setup::Ended(bash.arg(script.replace("ballast", program)).output().unwrap())
    };
    let calls = [
        "schema",
        "completions bash",
        "check tiny.toml",
        "check tiny.toml --json",
        "--help",
        "--version",
    ];
    for call in calls {
        let ended = shell(&format!("ballast {call} > /dev/full")).with_code(1);
        let said = ended.stderr();
        assert_eq!(said.matches("cannot write to standard output").count(), 1, "{call}: {said}");
    }
    shell("ballast schema | head -n 1").with_code(0);
}

#[test]
fn with_json_every_line_is_an_event() {
    use std::os::unix::ffi::OsStrExt;
    let place = Place::new();
    for (call, code, event) in [
        ("schema --json", 0, "schema"),
        ("schema --protocol --json", 0, "schema"),
        ("completions bash --json", 0, "completions"),
        ("--json run tiny.toml --steps x", 2, "error"),
        ("--json run", 2, "error"),
        ("validate --only samples --json", 2, "error"),
    ] {
        let events = place.call(call).with_code(code).events();
        assert_eq!(events.len(), 1, "{call}");
        assert_eq!(events[0]["event"], event, "{call}");
        assert!(code == 0 || events[0]["exit_code"] == code, "{events:?}");
    }
    // Names stand in texts.
    let mut odd = place.command("sweep --json");
    let ended = odd.arg(std::ffi::OsStr::from_bytes(b"p\xff.toml")).output().unwrap();
    let ended = crate::setup::Ended(ended).with_code(2);
    assert!(ended.events()[0]["message"].as_str().unwrap().contains("UTF-8"));
}

#[test]
fn a_pipe_is_not_waited_for() {
    let place = Place::new();
    let made = std::process::Command::new("mkfifo").arg(place.path("pipe")).status().unwrap();
    assert!(made.success());
    for command in ["resume pipe", "inspect pipe", "verify pipe", "export pipe --out csv"] {
        let said = place.call(command).with_code(1).stderr();
        assert!(said.contains("pipe: ") && said.contains("expected a file"), "{command}: {said}");
    }
}

#[test]
fn broken_cases_end_with_3_and_name_the_place() {
    let place = Place::new();
    let broken = CASE.replace("shape_count = 6", "shape_count = 6\nangularty = 0.5");
    std::fs::write(place.path("broken.toml"), broken).unwrap();
    for command in ["check", "run", "prepare"] {
        let ended = place.call(&format!("{command} broken.toml")).with_code(3);
        assert!(ended.stderr().contains("broken.toml:14:1"), "{}", ended.stderr());
        assert!(ended.stderr().contains("angularity"), "{}", ended.stderr());
    }
    std::fs::write(place.path("broken.toml"), b"name = \"b\"\n# \xff\n").unwrap();
    let said = place.call("check broken.toml").with_code(3).stderr();
    assert!(said.contains("broken.toml:2") && said.contains("UTF-8"), "{said}");
    assert!(!place.path("runs").exists(), "a refused case leaves nothing behind");
}

#[test]
fn a_damaged_checkpoint_is_refused() {
    let place = Place::new();
    place.run("--out run --steps 10").with_code(0);
    let path = place.path("run/checkpoint.h5");
    let whole = std::fs::read(&path).unwrap();

    let mut flipped = whole.clone();
    let middle = flipped.len() / 2;
    flipped[middle] ^= 1;
    for bytes in [&flipped[..], &whole[..whole.len() / 2], b"", b"not a checkpoint"] {
        std::fs::write(&path, bytes).unwrap();
        let ended = place.call("resume run/checkpoint.h5").with_code(1);
        assert!(ended.stderr().contains("checkpoint.h5"), "{}", ended.stderr());
    }
    // The records of the run are not touched by a refused resume.
    assert_eq!(place.summary("run")["steps"], 10);
    std::fs::write(&path, whole).unwrap();
    place.call("resume run/checkpoint.h5 --steps 12").with_code(0);
}

#[test]
fn a_checkpoint_of_another_version_ends_with_6() {
    let place = Place::new();
    place.run("--out run --steps 3").with_code(0);
    let path = place.path("run/checkpoint.h5");
    let mut bytes = std::fs::read(&path).unwrap();
    let name = b"ballast-checkpoint ";
    assert!(bytes.starts_with(name), "the format's name and version come first");
    bytes[name.len()] = b'9';
    std::fs::write(&path, bytes).unwrap();
    let ended = place.call("resume run/checkpoint.h5").with_code(6);
    assert!(ended.stderr().contains('9'), "{}", ended.stderr());
    place.call("inspect run/checkpoint.h5").with_code(6);
}

#[test]
fn a_bed_cannot_be_resumed() {
    let place = Place::new();
    place.call("prepare tiny.toml --bed-cache beds").with_code(0);
    let bed = std::fs::read_dir(place.path("beds")).unwrap().next().unwrap().unwrap().path();
    let ended = place.call(&format!("resume {}", bed.display())).with_code(1);
    assert!(ended.stderr().contains("ballast run"), "{}", ended.stderr());
    place.call("resume tiny.toml").with_code(1);
    assert!(!place.path("beds/.lock").exists() && !place.path(".lock").exists());
    // Nor can a damaged one be begun from.
    let whole = std::fs::read(&bed).unwrap();
    std::fs::write(&bed, &whole[..whole.len() / 2]).unwrap();
    let said = place.call("run tiny.toml --bed-cache beds").with_code(1).stderr();
    assert!(said.contains("--force` (and the same `--bed-cache`)"), "{said}");
}

#[test]
fn a_state_that_the_cycle_has_not_moved_is_not_handed_to_it() {
    let place = Place::new();
    place.run("--out run --steps 3").with_code(0);
    let kept = checkpoint::read(place.path("run/checkpoint.h5")).unwrap();
    let state = State { driver: Default::default(), ..kept.state.clone() };
    let other = Checkpoint { state, ..kept };
    std::fs::create_dir(place.path("python")).unwrap();
    checkpoint::write(place.path("python/state.h5"), &other).unwrap();
    let said = place.call("resume python/state.h5").with_code(1).stderr();
    assert!(said.contains("in Python with `ballast.resume(\"python/state.h5\")`"), "{said}");
    assert!(!place.path("python/.lock").exists());
}

#[test]
fn an_unexpected_hash_ends_with_5() {
    let place = Place::new();
    place.run("--out run --steps 5").with_code(0);
    let hash = place.hash("run");
    place.run(&format!("--out run --force --steps 5 --expect-hash {hash}")).with_code(0);
    let other = "0".repeat(32);
    let ended =
        place.run(&format!("--out run --force --steps 5 --expect-hash {other}")).with_code(5);
    assert!(ended.stderr().contains(&hash), "{}", ended.stderr());
}

#[test]
fn a_folder_that_cannot_be_made_fails() {
    let place = Place::new();
    std::fs::write(place.path("taken"), "a file").unwrap();
    let ended = place.run("--out taken/run --steps 5").with_code(1);
    assert!(ended.stderr().contains("taken"), "{}", ended.stderr());
}

#[test]
fn a_full_disk_fails_with_the_file_and_keeps_what_was_there() {
    // A limit on the size of files stands in for a full disk.
    let place = Place::new();
    place.run("--out run --steps 10").with_code(0);
    let checkpoint = std::fs::read(place.path("run/checkpoint.h5")).unwrap();
    let program = env!("CARGO_BIN_EXE_ballast");
    let script =
        format!("trap '' XFSZ; ulimit -f 16; exec {program} resume run/checkpoint.h5 --steps 20");
    let output = std::process::Command::new("bash")
        .current_dir(place.path(""))
        .args(["-c", &script])
        .output()
        .unwrap();
    let ended = crate::setup::Ended(output).with_code(1);
    assert!(ended.stderr().contains("run/"), "{}", ended.stderr());
    assert_eq!(std::fs::read(place.path("run/checkpoint.h5")).unwrap(), checkpoint);
    place.call("resume run/checkpoint.h5 --steps 20").with_code(0);
}

#[test]
fn what_cannot_be_written_beside_a_run_is_told_once_and_the_run_goes_on() {
    let place = Place::new();
    // Without frames the results stay small beside the recording.
    std::fs::write(
        place.path("tiny.toml"),
        CASE.replace("output_interval_s = 0.01", "output_interval_s = 0.0"),
    )
    .unwrap();
    place
        .run("--out whole --record whole.mcap --dump-problems problems --dump-every 30")
        .with_code(0);
    let hash = place.hash("whole");
    let size = |name: &str| place.path(name).metadata().unwrap().len();
    let largest = size("whole/results.vtkhdf").max(size("whole/checkpoint.h5"));
    let room = 2 * largest / 1024;
    assert!(size("whole.mcap") > room * 1024, "{} {room}", size("whole.mcap"));
    let limited = |arguments: &str| {
        let command = place.run_command(arguments);
        let mut bash = std::process::Command::new("bash");
        bash.current_dir(place.path(""))
            .args(["-c", &format!("trap '' XFSZ; ulimit -f {room}; exec \"$@\""), "bash"])
            .arg(command.get_program())
            .args(command.get_args());
        crate::setup::Ended(bash.output().unwrap())
    };
    let ended = limited("--out part --record part.mcap").with_code(1);
    let said = ended.stderr();
    assert_eq!(said.matches("warning: recording: part.mcap: cannot write: ").count(), 1, "{said}");
    assert!(said.contains("failed: part.mcap") && said.contains("continued without it"), "{said}");
    assert!(ended.stdout().contains(&hash), "{}", ended.stdout());
    assert_eq!(
        (place.hash("part"), place.summary("part")["complete"].clone()),
        (hash.clone(), true.into())
    );
    place.call(&format!("resume part/checkpoint.h5 --expect-hash {hash}")).with_code(0);

    // A folder has the name of the third problem.
    let mut problems: Vec<_> = std::fs::read_dir(place.path("problems"))
        .unwrap()
        .map(|file| file.unwrap().path())
        .collect();
    problems.sort_by_key(|path| path.to_string_lossy().split("-i").last().map(String::from));
    problems.iter().for_each(|path| std::fs::remove_file(path).unwrap());
    std::fs::create_dir(&problems[2]).unwrap();
    let said =
        place.run("--out other --dump-problems problems --dump-every 30").with_code(1).stderr();
    assert_eq!(said.matches("warning: problems: problems/").count(), 1, "{said}");
    assert_eq!(place.hash("other"), hash);
    assert!(problems[1].is_file() && !problems[3].exists());
}

#[test]
fn nobody_who_reads_messages_is_no_end_of_a_run() {
    let place = Place::new();
    place.run("--out read --steps 20").with_code(0);
    let to_nobody = |arguments: &str| {
        let full = std::fs::File::options().write(true).open("/dev/full").unwrap();
        place.command(arguments).stderr(full).status().unwrap().code()
    };
    assert_eq!(to_nobody("check none.toml"), Some(1));
    assert_eq!(to_nobody("run none.toml"), Some(1));
    assert_eq!(to_nobody("tamp"), Some(2));
    assert_eq!(to_nobody("run tiny.toml --out unread --steps 20"), Some(0));
    assert_eq!(place.hash("unread"), place.hash("read"));
}

#[test]
fn closed_streams_end_no_run() {
    let place = Place::new();
    place.run("--out read --steps 20").with_code(0);
    let hash = place.hash("read");
    let program = env!("CARGO_BIN_EXE_ballast");
    for streams in ["2>&-", ">&-", ">&- 2>&-", "2>&1 | head -n 1", "2> >(true)", "| true"] {
        let command = place.run_command("--out closed --steps 20 --force --json");
        let words = command.get_args().map(|word| word.to_str().unwrap());
        let words = words.collect::<Vec<_>>().join(" ");
        let mut bash = std::process::Command::new("bash");
        bash.current_dir(place.path("")).args(["-o", "pipefail", "-c"]);
        let output = bash.arg(format!("{program} {words} {streams}")).output().unwrap();
        crate::setup::Ended(output).with_code(0);
        assert_eq!(place.hash("closed"), hash, "{streams}");
        std::fs::remove_dir_all(place.path("closed")).unwrap();
    }
}

#[test]
fn results_that_cannot_be_read_while_a_run_writes_them_are_told_as_that() {
    let place = Place::new();
    place.run("--out run --steps 3").with_code(0);
    std::fs::write(place.path("run/results.vtkhdf"), b"\x89HDF\r\n\x1a\nhalf a file").unwrap();
    let export = || place.call("export run/results.vtkhdf --out csv").with_code(1).stderr();
    let lock = std::fs::File::options().write(true).open(place.path("run/.lock")).unwrap();
    assert!(!export().contains("a run is writing"));
    lock.lock().unwrap();
    assert!(export().contains("a run is writing in run; try again when it has ended"));
}
