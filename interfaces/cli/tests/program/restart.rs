//! Interrupted and resumed runs equal uninterrupted ones; so do runs with other numbers of threads.

use crate::setup::{CASE, Ended, Place, STEPS};
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};
use std::sync::mpsc::RecvTimeoutError;
use std::time::Duration;

#[test]
fn a_run_in_parts_leaves_the_files_of_a_run_in_one_go() {
    let place = Place::new();
    place.run("--out whole").with_code(0);
    place.run("--out parts --steps 47").with_code(0);
    assert_eq!(place.summary("parts")["complete"], false);
    assert_ne!(place.hash("parts"), place.hash("whole"));
    place.call("resume parts/checkpoint.h5 --steps 101").with_code(0);
    let said = place.call("resume parts/checkpoint.h5 --steps 100").with_code(2).stderr();
    assert!(said.contains("expected at least 101"), "{said}");
    place.call("resume parts/checkpoint.h5").with_code(0);

    assert_eq!(place.summary("parts"), place.summary("whole"));
    assert_eq!(place.summary("whole")["steps"], STEPS);
    assert_eq!(records(&place, "parts"), records(&place, "whole"));
}

/// The examples whose beds are poured within a minute; `scripts/check_restart.sh` does it with any.
#[test]
fn examples_go_on_in_another_process_with_other_threads() {
    let place = Place::new();
    for case in ["first", "slice"] {
        let file = format!("{}/../../examples/{case}.toml", env!("CARGO_MANIFEST_DIR"));
        let run = |more: &str| place.with_beds(&format!("run {file} {more}")).with_code(0);
        run(&format!("--steps 8 --threads 1 --out {case}"));
        run(&format!("--steps 4 --threads 2 --out {case}_parts"));
        let hash = place.hash(case);
        let resume =
            format!("resume {case}_parts/checkpoint.h5 --steps 8 --threads 2 --expect-hash {hash}");
        place.call(&resume).with_code(0);
    }
}

/// Everything that the results of a run hold, frame by frame and row by row.
fn records(place: &Place, folder: &str) -> Vec<(String, String)> {
    let tables = format!("{folder}_exported");
    place.call(&format!("export {folder}/results.vtkhdf --out {tables}")).with_code(0);
    let mut files: Vec<(String, String)> = std::fs::read_dir(place.path(&tables))
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .map(|name| (name.clone(), place.text(&format!("{tables}/{name}"))))
        .collect();
    files.sort();
    assert!(files.iter().any(|(name, _)| name == "steps.csv"));
    assert!(files.iter().filter(|(name, _)| name.ends_with(".vtp")).count() > 5);
    files
}

#[test]
fn a_resume_that_would_end_before_its_checkpoint_cuts_nothing() {
    let place = Place::new();
    place.run("--out run --steps 20").with_code(0);
    std::fs::copy(place.path("run/checkpoint.h5"), place.path("run/earlier.h5")).unwrap();
    place.call("resume run/checkpoint.h5 --steps 40").with_code(0);
    let results = || std::fs::read(place.path("run/results.vtkhdf")).unwrap();
    let (before, summary) = (results(), place.summary("run"));
    let said = place.call("resume run/earlier.h5 --steps 10").with_code(2).stderr();
    assert!(said.contains("--steps 10: expected at least 20"), "{said}");
    assert!(results() == before, "the rows behind the checkpoint are there");
    assert_eq!(place.summary("run"), summary);
}

#[test]
fn what_was_written_after_the_checkpoint_is_written_again() {
    let place = Place::new();
    place.run("--out whole").with_code(0);
    place.run("--out torn --steps 40").with_code(0);
    std::fs::copy(place.path("torn/checkpoint.h5"), place.path("early.h5")).unwrap();
    place.call("resume torn/checkpoint.h5 --steps 90").with_code(0);
    // As after a crash: tables and results are ahead of the checkpoint.
    std::fs::copy(place.path("early.h5"), place.path("torn/checkpoint.h5")).unwrap();
    place.call("resume torn/checkpoint.h5").with_code(0);
    assert_eq!(place.summary("torn"), place.summary("whole"));
    assert_eq!(records(&place, "torn"), records(&place, "whole"));
}

/// The small case, solved so hard.
fn solved(how: &str) -> Place {
    Place::with(&CASE.replace("max_iterations = 30\ntolerance = 1e-3", how))
}

/// A command that is interrupted once it has said `word`, and has to end in good order.
fn interrupted(mut command: Command, word: &str) -> Ended {
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
    let under_way = lines.any(|line| line.unwrap().contains(word));
    assert!(under_way, "the run ended before it could be interrupted");
    // Twice within an instant, as who stops a group of processes does.
    for signal in [Signal::SIGINT, Signal::SIGTERM] {
        kill(Pid::from_raw(child.id() as i32), signal).unwrap();
    }
    // A process that does not stop fails the test here.
    let id = Pid::from_raw(child.id() as i32);
    let (ended, is_late) = std::sync::mpsc::channel::<()>();
    let watchdog = std::thread::spawn(move || {
        let late = is_late.recv_timeout(Duration::from_secs(120)) == Err(RecvTimeoutError::Timeout);
        late.then(|| kill(id, Signal::SIGKILL))
    });
    // Read to the end: a full pipe would block the program.
    lines.for_each(drop);
    let output = child.wait_with_output().unwrap();
    drop(ended);
    watchdog.join().unwrap();
    let ended = Ended(output).with_code(130);
    assert!(ended.stderr().contains("ballast resume"), "{}", ended.stderr());
    ended
}

#[test]
fn ctrl_c_leaves_a_checkpoint_that_goes_on_to_the_same_end() {
    // Slow enough that the run is still going when the signal arrives.
    let place = solved("max_iterations = 1000\ntolerance = 0");
    place.run("--out whole").with_code(0);
    interrupted(place.run_command("--out stopped --json"), "\"progress\"");
    assert!(!place.path("stopped/summary.json").exists());

    place.call("resume stopped/checkpoint.h5").with_code(0);
    assert_eq!(place.summary("stopped"), place.summary("whole"));
}

#[test]
fn ctrl_c_breaks_off_a_step_without_end() {
    let place = solved("max_iterations = 4000000000\ntolerance = 1e-300");
    let ended = interrupted(place.run_command("--out run --json"), "\"start\"");
    assert!(ended.stderr().contains("after step 0 of"), "{}", ended.stderr());
    // The files are complete, also for a run that continues.
    let resume = place.command("resume run/checkpoint.h5 --json");
    assert!(interrupted(resume, "\"start\"").stderr().contains("after step 0 of"));
}

/// Number of killed runs, or `BALLAST_KILLS`.
fn kills() -> u32 {
    std::env::var("BALLAST_KILLS").ok().and_then(|n| n.parse().ok()).unwrap_or(4)
}

#[test]
fn runs_killed_at_any_instant_go_on_to_the_same_end() {
    let place = Place::new();
    let begun = std::time::Instant::now();
    place.run("--out whole").with_code(0);
    let whole = begun.elapsed();
    let (summary, kept) = (place.summary("whole"), records(&place, "whole"));
    let (mut resumed, mut early) = (0, 0);
    for k in 0..kills() {
        let mut child = place
            .run_command("--out killed --force")
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        // Spread over the run without a pattern: multiples of the golden ratio.
        std::thread::sleep(whole.mul_f64(f64::from(k + 1) * 0.618_034 % 1.0));
        child.kill().unwrap();
        child.wait().unwrap();
        if place.path("killed/summary.json").exists() {
            // It had ended before.
        } else if place.path("killed/checkpoint.h5").exists() {
            place.call("resume killed/checkpoint.h5").with_code(0);
            resumed += 1;
        } else {
            place.run("--out killed --force").with_code(0);
            early += 1;
        }
        assert_eq!(place.summary("killed"), summary, "kill {k}");
        assert_eq!(records(&place, "killed"), kept, "kill {k}");
    }
    assert!(resumed + early > 0, "no run was killed before its end");
}

#[test]
fn an_unfinished_run_is_not_overwritten_by_mistake() {
    let place = Place::new();
    place.run("--out here --steps 20 --record here.mcap").with_code(0);
    std::fs::remove_file(place.path("here/summary.json")).unwrap();
    let refused = place.with_beds("replay here.mcap --out here").with_code(2);
    assert!(refused.stderr().contains("resume"), "{}", refused.stderr());
    let said = place.run("--out here").with_code(2).stderr();
    assert!(said.contains("an unfinished run of `tiny`") && said.contains("resume"), "{said}");
    place.run("--out here --steps 10 --force").with_code(0);
    assert_eq!(place.summary("here")["steps"], 10);
    // As after a kill before the first checkpoint.
    std::fs::remove_file(place.path("here/checkpoint.h5")).unwrap();
    std::fs::remove_file(place.path("here/summary.json")).unwrap();
    let results = std::fs::read(place.path("here/results.vtkhdf")).unwrap();
    for refused in [place.run("--out here"), place.with_beds("replay here.mcap --out here")] {
        let said = refused.with_code(2).stderr();
        assert!(said.contains("a run or a replay that ended before"), "{said}");
        assert!(said.contains("export") && said.contains("--force"), "{said}");
    }
    assert_eq!(std::fs::read(place.path("here/results.vtkhdf")).unwrap(), results);
    place.call("export here/results.vtkhdf --out tables").with_code(0);
    place.with_beds("replay here.mcap --out here --force").with_code(0);
    assert_eq!(place.summary("here")["steps"], 20);
    // A finished one goes for the same case only.
    let case = std::fs::read_to_string(place.path("tiny.toml")).unwrap();
    std::fs::write(place.path("tiny.toml"), format!("{case}# changed\n")).unwrap();
    let refused = place.run("--out here --steps 10").with_code(2);
    assert!(refused.stderr().contains("another case"), "{}", refused.stderr());
    assert_eq!(place.summary("here")["steps"], 20);
    std::fs::write(place.path("tiny.toml"), case).unwrap();
    place.run("--out here --steps 10 --force").with_code(0);

    // Nor a case, nor results, by a recording.
    for (file, code, says) in [
        ("tiny.toml", 1, "a Ballast recording to replace"),
        ("here/results.vtkhdf", 2, "does not belong to the run"),
    ] {
        let before = std::fs::read(place.path(file)).unwrap();
        let refused = place.run(&format!("--out here --steps 10 --force --record {file}"));
        let refused = refused.with_code(code);
        assert!(refused.stderr().contains(says), "{}", refused.stderr());
        assert_eq!(std::fs::read(place.path(file)).unwrap(), before);
    }
}

#[test]
fn threads_change_no_byte() {
    for schedule in ["synchronous", "sequential"] {
        let place = Place::new();
        let summaries = ["1", "2", "4"].map(|threads| {
            place
                .run(&format!(
                    "--out t{threads} --threads {threads} --schedule {schedule} --steps 60"
                ))
                .with_code(0);
            place.summary(&format!("t{threads}"))
        });
        assert_eq!(summaries[0], summaries[1], "{schedule}");
        assert_eq!(summaries[0], summaries[2], "{schedule}");
    }
}

#[test]
fn a_resumed_run_keeps_the_choices_of_the_command_line() {
    let place = Place::new();
    place.run("--out whole --schedule sequential --steps 50").with_code(0);
    place.run("--out parts --schedule sequential --steps 20").with_code(0);
    place.call("resume parts/checkpoint.h5 --steps 50").with_code(0);
    assert_eq!(place.hash("parts"), place.hash("whole"));
    place.run("--out other --schedule synchronous --steps 50").with_code(0);
    assert_ne!(place.hash("other"), place.hash("whole"));
}

#[test]
fn a_checkpoint_is_not_joined_to_the_results_of_another_run() {
    let place = Place::new();
    place.run("--out mix --steps 10").with_code(0);
    std::fs::copy(place.path("mix/checkpoint.h5"), place.path("mix/old.h5")).unwrap();
    let refused = |says: &str| {
        let results = std::fs::read(place.path("mix/results.vtkhdf")).unwrap();
        let said = place.call("resume mix/old.h5 --steps 30").with_code(1).stderr();
        assert!(said.contains(says) && said.contains("another --out"), "{said}");
        assert_eq!(std::fs::read(place.path("mix/results.vtkhdf")).unwrap(), results);
    };
    place.run("--out mix --steps 20 --force --schedule sequential").with_code(0);
    refused("steps, step 10, kinetic: expected");
    std::fs::write(place.path("tiny.toml"), CASE.replace("height_m = 0.004", "height_m = 0.003"))
        .unwrap();
    place.run("--out mix --steps 20 --force").with_code(0);
    refused("metadata/case_text: expected");
    std::fs::write(place.path("tiny.toml"), CASE).unwrap();
    place.run("--out mix --steps 5 --force").with_code(0);
    refused("expected a row for each of 10 steps, found 5");

    // Nor to none.
    let path = place.path("mix/results.vtkhdf");
    let bytes = std::fs::read(&path).unwrap();
    std::fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
    refused("results.vtkhdf");
    std::fs::remove_file(&path).unwrap();
    let said = place.call("resume mix/old.h5 --steps 30").with_code(1).stderr();
    assert!(said.contains("results.vtkhdf") && said.contains("another --out"), "{said}");
}
