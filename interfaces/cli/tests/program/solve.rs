//! `ballast solve`: what it says and writes, and how it ends.

use crate::setup::Place;
use serde_json::Value;
use std::path::{Path, PathBuf};

fn pile() -> PathBuf {
    let file = "../hdf5/tests/data/GrainPile500-nc818.hdf5";
    Path::new(env!("CARGO_MANIFEST_DIR")).join(file)
}

/// A place with the grain pile in a folder, beside a file that is no problem.
fn place(broken: bool) -> Place {
    let place = Place::new();
    std::fs::create_dir(place.path("problems")).unwrap();
    std::fs::copy(pile(), place.path("problems/pile.hdf5")).unwrap();
    std::fs::write(place.path("problems/notes.txt"), "no problem").unwrap();
    if broken {
        std::fs::write(place.path("problems/broken.hdf5"), "no problem").unwrap();
    }
    place
}

#[test]
fn one_problem_is_reported_with_all_errors_by_name() {
    let place = place(false);
    let call = "solve problems/pile.hdf5 --tolerance 1e-4 --write-solution solved.hdf5";
    let text = place.call(call).with_code(0).stdout();
    for word in ["pile: 818 contacts", "ABH", "Siconos", "FCLIB", "unit-free", "sweeps", "CPU time"]
    {
        assert!(text.contains(word), "{word} in\n{text}");
    }
    // The copy is a problem like the first one.
    let events = place.call("solve solved.hdf5 --tolerance 1e-4 --json").with_code(0).events();
    assert_eq!(events[0]["event"], "solution");
    assert_eq!(events[0]["converged"], true);
    let abh = events[0]["errors"]["abh"].as_f64().unwrap();
    assert!(abh > 0.0 && abh <= 1e-4, "{abh}");
    for measure in ["siconos", "fclib", "unit_free"] {
        assert!(events[0]["errors"][measure].as_f64().unwrap() > 0.0, "{measure}");
    }
}

#[test]
fn what_is_not_solved_ends_with_1_and_still_has_its_figures() {
    let place = place(false);
    let call = "solve problems/pile.hdf5 --max-sweeps 3 --method nlgs --json";
    let ended = place.call(call).with_code(1);
    let events = ended.events();
    assert_eq!((&events[0]["sweeps"], &events[0]["converged"]), (&3.into(), &Value::Bool(false)));
    assert_eq!(events.last().unwrap()["event"], "error");
    assert!(ended.stderr().contains("not solved") && ended.stderr().contains("3 sweeps"));
}

#[test]
fn a_folder_gives_a_table_and_files_that_cannot_be_read_are_told() {
    let place = place(false);
    let call = "solve problems --tolerance 1e-3 --method auto,nlgs --csv t.csv --profile p.csv";
    let text = place.call(call).with_code(0).stdout();
    assert_eq!(text.lines().filter(|l| l.starts_with("pile")).count(), 2, "{text}");
    assert_eq!(place.text("t.csv").lines().count(), 3);
    let profile = place.text("p.csv");
    assert!(profile.contains("1e-3,auto,") && profile.contains("1e-3,nlgs,"), "{profile}");
    place.call("solve problems --tolerance 1e-3 --profile p.html").with_code(0);
    assert!(place.text("p.html").contains("<svg"));

    let broken = self::place(true);
    let ended = broken.call("solve problems --tolerance 1e-2").with_code(1);
    assert!(ended.stdout().contains("pile") && ended.stderr().contains("broken.hdf5"));
    assert!(ended.stderr().contains("1 of 2 files"), "{}", ended.stderr());
}

#[test]
fn a_folder_is_solved_to_three_tolerances() {
    let place = place(false);
    // Few sweeps: what counts here is which tolerances are tried.
    let call = "solve problems --max-sweeps 5 --method nlgs --json";
    let events = place.call(call).with_code(0).events();
    let tolerances: Vec<f64> = events.iter().filter_map(|e| e["tolerance"].as_f64()).collect();
    assert_eq!(tolerances, [1e-4, 1e-6, 1e-8]);
    assert_eq!(events.last().unwrap()["converged"], 0);
}

#[test]
fn wrong_calls_end_with_2_and_missing_problems_with_1() {
    let place = place(false);
    for call in [
        "solve",
        "solve problems/pile.hdf5 --tolerance 0",
        "solve problems/pile.hdf5 --tolerance nan",
        "solve problems/pile.hdf5 --method fast",
        "solve problems --write-solution out.hdf5",
        "solve problems/pile.hdf5 --method auto,nlgs --write-solution out.hdf5",
    ] {
        place.call(call).with_code(2);
    }
    std::fs::create_dir(place.path("empty")).unwrap();
    let told = |call: &str| place.call(call).with_code(1).stderr();
    assert!(told("solve none.hdf5").contains("none.hdf5"));
    assert!(told("solve problems/notes.txt").contains("HDF5"));
    assert!(told("solve empty").contains("expected problems"));
}

#[test]
fn problems_of_a_run_are_read_back_and_solved() {
    let place = Place::new();
    place.run("--out plain").with_code(0);
    place.run("--out dumped --dump-problems kept --dump-every 40").with_code(0);
    assert_eq!(place.summary("dumped"), place.summary("plain"), "dumping changed the run");
    // Stones that jam between tines and sleeper make hard problems; this is about reading them back.
    let call = "solve kept --tolerance 2e-2 --max-sweeps 3000 --json";
    let events = place.call(call).with_code(0).events();
    let solved: Vec<&Value> = events.iter().filter(|e| e["event"] == "solution").collect();
    assert!(solved.len() >= 4, "{} problems", solved.len());
    for event in &solved {
        let name = event["problem"].as_str().unwrap();
        assert!(name.starts_with("tiny-") && event["contacts"].as_u64().unwrap() > 20, "{event}");
        assert_eq!(event["converged"], true, "{event}");
    }

    let call =
        "--out squeeze --steps 130 --dump-problems squeeze --dump-every 10 --dump-phases squeeze";
    place.run(call).with_code(0);
    let names: Vec<String> = std::fs::read_dir(place.path("squeeze"))
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .filter(|name| name.ends_with(".hdf5"))
        .collect();
    assert!(!names.is_empty() && names.iter().all(|n| n.contains("-squeeze-i")), "{names:?}");
    place.run("--dump-every 3").with_code(2);
}

#[test]
fn files_that_are_one_or_cannot_be_written_are_told_before_anything_is_solved() {
    let place = place(false);
    std::os::unix::fs::symlink(place.path("problems"), place.path("link")).unwrap();
    std::fs::write(place.path("old.csv"), "").unwrap();
    std::fs::hard_link(place.path("old.csv"), place.path("older.csv")).unwrap();
    for (options, says) in [
        (
            "--write-solution new.csv --csv new.csv",
            "--write-solution and --csv: expected two files",
        ),
        ("--csv new.csv --profile ./new.csv", "--csv and --profile: expected two files"),
        ("--csv problems/a.csv --profile link/a.csv", "--csv and --profile: expected two files"),
        ("--csv old.csv --profile older.csv", "--csv and --profile: expected two files"),
        ("--csv nodir/s.csv", "expected a folder that files can be made in, found nodir"),
    ] {
        let said = place.call(&format!("solve problems/pile.hdf5 {options}")).with_code(2).stderr();
        assert!(said.contains(says), "{options}: {said}");
    }
    let said = place.call("solve problems/pile.hdf5 --write-solution /proc/s.hdf5").with_code(1);
    assert!(said.stderr().contains("files can be made in, found /proc"), "{}", said.stderr());
    let kept = std::fs::read_dir(place.path("")).unwrap().count();
    assert_eq!(kept, 5, "nothing was left behind");
}
