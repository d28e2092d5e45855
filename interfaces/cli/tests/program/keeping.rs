//! Protection of files: no mistyped command destroys files, and one process writes a run.

use crate::setup::{Place, STEPS};
use serde_json::Value;
use std::fs::File;
use std::os::unix::fs::{FileTypeExt, symlink};

#[test]
fn one_process_writes_a_run() {
    let place = Place::new();
    place.run("--out run --steps 20").with_code(0);
    let lock = File::options().write(true).open(place.path("run/.lock")).unwrap();
    lock.try_lock().unwrap();
    let hash = place.hash("run");
    // Of that process, which may be about to give it its name.
    let new = place.path("run/checkpoint.h5.AbCd12.tmp");
    std::fs::write(&new, "").unwrap();
    for ended in [place.call("resume run/checkpoint.h5"), place.run("--out run --force")] {
        let said = ended.with_code(1).stderr();
        assert!(said.contains("another process writes a run there"), "{said}");
    }
    assert_eq!(place.hash("run"), hash);
    // Reading needs no lock.
    place.call("inspect run/results.vtkhdf").with_code(0);
    place.call("report run").with_code(0);
    assert!(new.exists());
    drop(lock);
    place.call("resume run/checkpoint.h5 --steps 30").with_code(0);
    assert!(!new.exists(), "what a killed process has left is still there");
    place.call("resume nowhere/checkpoint.h5").with_code(1);
    assert!(!place.path("nowhere").exists());
}

#[test]
fn what_cannot_be_begun_costs_nothing() {
    let place = Place::new();
    place.run("--out run").with_code(0);
    let (summary, hash) = (place.text("run/summary.json"), place.hash("run"));
    let made = std::process::Command::new("mkfifo").arg(place.path("pipe")).status().unwrap();
    assert!(made.success());
    for (more, says) in [
        ("--record nowhere/x.mcap", "nowhere"),
        ("--record pipe", "a device or a pipe"),
        ("--record /dev/null", "a device or a pipe"),
        ("--record run/summary.json", "does not belong to the run"),
        ("--record run/checkpoint.h5", "does not belong to the run"),
        ("--record run/results.vtkhdf.index-backup", "does not belong to the run"),
        ("--record run/report.html", "does not belong to the run"),
        ("--dump-problems tiny.toml", "tiny.toml"),
    ] {
        let ended = place.run(&format!("--out run {more}"));
        assert!(ended.code() != 0 && ended.stderr().contains(says), "{more}: {}", ended.stderr());
        assert_eq!(place.text("run/summary.json"), summary, "{more}");
        place.call(&format!("resume run/checkpoint.h5 --expect-hash {hash}")).with_code(0);
    }
    // A look at the first steps of a run that is there.
    let said = place.run("--out run --steps 5").with_code(2).stderr();
    let longer = format!("finished run of {STEPS} steps");
    assert!(said.contains(&longer) && said.contains("--force"), "{said}");
    assert_eq!((place.text("run/summary.json"), place.hash("run")), (summary, hash.clone()));
    // Stopped by --steps, to be continued.
    place.run("--out part --steps 20").with_code(0);
    let said = place.run("--out part --steps 30").with_code(2).stderr();
    assert!(said.contains("unfinished run") && said.contains("ballast resume"), "{said}");
    place.call("resume part/checkpoint.h5").with_code(0);
    assert_eq!(place.hash("part"), hash);
    place.run("--out part --steps 20 --force").with_code(0);
    place.run("--out part --steps 30 --force").with_code(0);
    // A recording is written by one process.
    let lock = File::create(place.path("taken.mcap")).unwrap();
    lock.try_lock().unwrap();
    let said = place.run("--out other --record taken.mcap").with_code(1).stderr();
    assert!(said.contains("no other process writes"), "{said}");
}

#[test]
fn tables_replace_tables_only() {
    let place = Place::new();
    place.run("--out run --steps 20 --dump-problems problems --dump-every 10").with_code(0);
    let problem =
        std::fs::read_dir(place.path("problems")).unwrap().next().unwrap().unwrap().path();
    let solve = format!("solve {} --tolerance 0.1", problem.display());
    let case = place.text("tiny.toml");
    let said = place.call(&format!("{solve} --csv tiny.toml")).with_code(2).stderr();
    assert!(said.contains("tiny.toml") && said.contains("(.csv) to replace"), "{said}");
    assert_eq!(place.text("tiny.toml"), case);
    let checkpoint = std::fs::read(place.path("run/checkpoint.h5")).unwrap();
    let said = place.call(&format!("{solve} --write-solution run/checkpoint.h5")).with_code(1);
    assert!(said.stderr().contains("a problem to replace"), "{}", said.stderr());
    assert_eq!(std::fs::read(place.path("run/checkpoint.h5")).unwrap(), checkpoint);
    let said = place.call(&format!("{solve} --csv t.csv --profile t.csv")).with_code(2).stderr();
    assert!(said.contains("expected two files"), "{said}");

    // A link's target is written, and the link stays; a pipe is not replaced.
    std::fs::write(place.path("table.csv"), "old").unwrap();
    symlink("table.csv", place.path("link.csv")).unwrap();
    place.call(&format!("{solve} --csv link.csv")).with_code(0);
    assert!(place.path("link.csv").is_symlink() && place.text("table.csv").contains("problem"));
    let made = std::process::Command::new("mkfifo").arg(place.path("pipe.csv")).status().unwrap();
    assert!(made.success());
    let said = place.call(&format!("{solve} --csv pipe.csv")).with_code(2).stderr();
    assert!(said.contains("a device or a pipe"), "{said}");
    assert!(place.path("pipe.csv").symlink_metadata().unwrap().file_type().is_fifo());
}

#[test]
fn resuming_what_is_done_keeps_its_times_and_goes_by_the_state() {
    let place = Place::new();
    place.run("--out run").with_code(0);
    let summary = place.text("run/summary.json");
    let ended = place.call("resume run/checkpoint.h5").with_code(0);
    assert!(ended.stderr().contains("nothing was left to be computed"), "{}", ended.stderr());
    assert!(ended.stdout().contains(&place.hash("run")) && !ended.stdout().contains("ms per step"));
    assert_eq!(place.text("run/summary.json"), summary);
    let told = place.call("inspect run/results.vtkhdf --json").with_code(0).events();
    assert_eq!(told[0]["step"], STEPS);

    // A checkpoint from before: the run is there again, as far as that.
    place.run("--out early --steps 20").with_code(0);
    std::fs::copy(place.path("early/checkpoint.h5"), place.path("run/old.h5")).unwrap();
    place.call("resume run/old.h5 --steps 20").with_code(0);
    let figures = |folder: &str| {
        let mut summary: Value =
            serde_json::from_str(&place.text(&format!("{folder}/summary.json"))).unwrap();
        // It took no time to be there.
        summary.as_object_mut().unwrap().remove("timing");
        summary
    };
    assert_eq!(figures("run"), figures("early"));
    // A summary from before it, as a kill between the two leaves it.
    place.call("resume run/checkpoint.h5 --steps 30").with_code(0);
    std::fs::write(place.path("run/summary.json"), &summary).unwrap();
    place.call("resume run/checkpoint.h5 --steps 30").with_code(0);
    assert_eq!(figures("run")["steps"], 30);
    place.call("resume run/checkpoint.h5").with_code(0);
    place.run("--out whole").with_code(0);
    assert_eq!(place.summary("run"), place.summary("whole"));
}

#[test]
fn a_replay_takes_the_place_of_a_replay_only() {
    let place = Place::new();
    place.run("--out run --record run.mcap").with_code(0);
    let hash = place.hash("run");
    let said = place.with_beds("replay run.mcap --out run").with_code(2).stderr();
    assert!(said.contains("found a finished run") && said.contains("--force"), "{said}");
    assert!(place.path("run/checkpoint.h5").exists() && place.hash("run") == hash);
    place.with_beds("replay run.mcap --out again --steps 20").with_code(0);
    place.with_beds("replay run.mcap --out again").with_code(0);
    place.with_beds("replay run.mcap --out again").with_code(0);
    place.with_beds("replay run.mcap --out run --force").with_code(0);
    assert!(!place.path("run/checkpoint.h5").exists());
}

#[test]
fn a_run_that_goes_on_has_no_page_about_its_half() {
    let place = Place::new();
    place.run("--out run --steps 20").with_code(0);
    place.call("report run").with_code(0);
    place.call("resume run --steps 30").with_code(0);
    assert!(!place.path("run/report.html").exists());
}

#[test]
fn an_export_leaves_no_frames_of_the_one_before() {
    let place = Place::new();
    place.run("--out long").with_code(0);
    place.run("--out short --steps 20").with_code(0);
    let frames = |folder: &str| {
        place.call(&format!("export {folder}/results.vtkhdf --out shapes")).with_code(0);
        let names = std::fs::read_dir(place.path("shapes")).unwrap();
        let mut names: Vec<String> =
            names.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    };
    let short = frames("short");
    std::fs::write(place.path("shapes/grains_9999.vtp"), "other").unwrap();
    assert!(frames("long").len() > short.len() + 1);
    let again = frames("short");
    assert!(again.contains(&"grains_9999.vtp".to_string()), "it was listed by no export");
    assert_eq!(again.len(), short.len() + 1);
    // A run without frames leaves no list of frames either.
    let case =
        place.text("tiny.toml").replace("output_interval_s = 0.01", "output_interval_s = 0.0");
    std::fs::write(place.path("still.toml"), case).unwrap();
    place.with_beds("run still.toml --out still --steps 3").with_code(0);
    assert!(frames("still").iter().all(|name| name.ends_with(".csv") || name.contains("9999")));
    // What another program has listed is not ours to remove.
    std::fs::write(place.path("shapes/mine.vtp"), "other").unwrap();
    let list = "<Collection><DataSet file=\"mine.vtp\"/></Collection>";
    std::fs::write(place.path("shapes/frames.pvd"), list).unwrap();
    assert!(frames("short").contains(&"mine.vtp".to_string()));
}

#[test]
fn what_is_inspected_or_reported_is_what_was_named() {
    let place = Place::new();
    place.run("--out run --steps 20").with_code(0);
    // There are fewer frames than steps.
    let told = place.call("inspect run/results.vtkhdf --json").with_code(0).events();
    assert_eq!((&told[0]["step"], told[0]["time_s"].as_f64()), (&20.into(), Some(0.02)));
    let said = place.call("inspect run/summary.json").with_code(1).stderr();
    assert!(said.contains("found text (JSON)"), "{said}");
    std::fs::copy(place.path("run/results.vtkhdf"), place.path("run/other.vtkhdf")).unwrap();
    for named in ["run/other.vtkhdf", "tiny.toml", "nowhere"] {
        let said = place.call(&format!("report {named}")).with_code(1).stderr();
        assert!(said.contains(&format!("{named}: expected the folder of a run")), "{said}");
    }
    // The folder of runs is none, and one in it is named.
    for command in ["report .", "inspect .", "resume .", "export . --out csv"] {
        let said = place.call(command).with_code(1).stderr();
        assert!(said.contains(".: expected the folder of a run"), "{said}");
        assert!(said.contains("; ./run is one"), "{said}");
    }
}
