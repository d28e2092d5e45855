//! `ballast sweep`: many runs, one table, resumable.

use crate::setup::Place;
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use serde_json::Value;
use std::time::{Duration, Instant};

const PLAN: &str = "case = 'tiny.toml'\n[grid]\n'tamping.vibration.frequency_Hz' = [30, 60]\n\
                    'solver.max_iterations' = [20, 30]\n[[points]]\n'run.duration_s' = 0.15\n";

fn place(plan: &str) -> Place {
    let place = Place::new();
    std::fs::write(place.path("plan.toml"), plan).unwrap();
    place
}

/// Rows of the table by the names of its columns.
fn table(place: &Place) -> Vec<Vec<(String, String)>> {
    let text = std::fs::read_to_string(place.path("runs/plan/table.csv")).unwrap();
    let mut lines = text.lines();
    let names: Vec<_> = lines.next().unwrap().split(',').collect();
    let row = |line: &str| {
        let cells: Vec<_> = line.split(',').collect();
        assert_eq!(cells.len(), names.len(), "{line}");
        names.iter().zip(cells).map(|(n, c)| ((*n).to_string(), c.to_string())).collect()
    };
    lines.map(row).collect()
}

fn cell(row: &[(String, String)], name: &str) -> String {
    row.iter().find(|(n, _)| n == name).unwrap_or_else(|| panic!("no column {name:?}")).1.clone()
}

/// Waits until a file is there.
fn wait_for(place: &Place, file: &str) {
    let begun = Instant::now();
    while !place.path(file).exists() {
        assert!(begun.elapsed() < Duration::from_secs(120), "no {file}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

#[test]
fn a_sweep_is_a_table_of_runs_and_is_not_run_twice() {
    let place = place(PLAN);
    place.with_beds("sweep plan.toml --jobs 2").with_code(0);
    let rows = table(&place);
    assert_eq!(rows.len(), 5);
    let values: Vec<_> = rows
        .iter()
        .map(|r| (cell(r, "tamping.vibration.frequency_Hz"), cell(r, "solver.max_iterations")))
        .collect();
    assert_eq!(values[1], ("60".to_string(), "20".to_string()));
    assert_eq!(values[4], (String::new(), String::new()));
    // What only a later point sets is beside the other values.
    let mut first: Vec<_> = rows[0][..4].iter().map(|(name, _)| &name[..]).collect();
    first.sort_unstable();
    let values = ["run.duration_s", "solver.max_iterations", "tamping.vibration.frequency_Hz"];
    assert_eq!(first, [&["number"][..], &values].concat());
    assert_eq!([&rows[0], &rows[4]].map(|row| cell(row, "run.duration_s")), ["", "0.15"]);
    assert_eq!(cell(&rows[4], "steps"), "150");
    // A point is the run of its case.
    place.with_beds("run runs/plan/00002/case.toml --out alone").with_code(0);
    assert_eq!(place.summary("alone")["state_hash"], Value::from(cell(&rows[1], "state_hash")));
    let manifest: Value = serde_json::from_str(
        &std::fs::read_to_string(place.path("runs/plan/manifest.json")).unwrap(),
    )
    .unwrap();
    assert_eq!(manifest["points"][3]["values"]["solver.max_iterations"], 30);
    // Wherever the sweep is moved.
    assert_eq!(manifest["points"][3]["folder"], "00004");
    let stamp = |n: usize| {
        let path = place.path(format!("runs/plan/{n:05}/summary.json"));
        std::fs::metadata(path).unwrap().modified().unwrap()
    };
    let before: Vec<_> = (1..=5).map(stamp).collect();
    let more = format!("{PLAN}[[points]]\n'run.duration_s' = 0.16\n");
    std::fs::write(place.path("plan.toml"), more).unwrap();
    place.with_beds("sweep plan.toml").with_code(0);
    assert_eq!((1..=5).map(stamp).collect::<Vec<_>>(), before, "what is done stays");
    assert_eq!(table(&place).len(), 6);
}

#[test]
fn one_point_of_a_scheduler_is_run_alone() {
    let place = place(PLAN);
    place.with_beds("sweep plan.toml --point 5").with_code(0);
    assert_eq!(table(&place).len(), 1);
    // As after a kill before its first checkpoint.
    for file in ["summary.json", "checkpoint.h5"] {
        std::fs::remove_file(place.path("runs/plan/00005").join(file)).unwrap();
    }
    place.with_beds("sweep plan.toml --point 5").with_code(0);
    assert_eq!(table(&place).len(), 1);
    let listed = place.with_beds("sweep plan.toml --list").with_code(0);
    assert!(
        listed
            .stdout()
            .contains("3  solver.max_iterations = 30, tamping.vibration.frequency_Hz = 30"),
        "{}",
        listed.stdout()
    );
    let listed = place.with_beds("sweep plan.toml --list --json").with_code(0).events();
    assert_eq!((listed.len(), &listed[2]["number"]), (5, &3.into()));
    assert_eq!(listed[2]["values"]["solver.max_iterations"], 30);
    let again = place.with_beds("sweep plan.toml --point 5 --json").with_code(0).events();
    assert_eq!(again.last().unwrap()["event"], "done", "{again:?}");
    let wrong = place.with_beds("sweep plan.toml --point 6");
    assert_eq!(wrong.code(), 2);
    assert!(wrong.stderr().contains("expected 1 to 5, found 6"), "{}", wrong.stderr());
}

#[test]
fn plans_and_points_that_make_no_sense_are_reported_before_anything_runs() {
    for (plan, code, expected) in [
        ("case = 'tiny.toml'", 3, "at least one point"),
        ("case = 'nowhere.toml'\n[[points]]\n'bed.seed' = 1", 1, "nowhere.toml"),
        (
            "case = “tiny.toml”\n[[points]]\n'bed.seed' = 1",
            3,
            "straight quotation marks: \"tiny.toml\"",
        ),
        ("case = 'tiny.toml'\n[grid]\n'bed.seed' = [1; 2]", 3, "not TOML: semicolon"),
        ("case = 'tiny.toml'\n[grid]\n'solver.max_iterations' = [20, -1]", 3, "point 2"),
        ("case = 'tiny.toml'\n[[points]]\n'solver.itterations' = 1", 3, "iterations"),
    ] {
        let place = place(plan);
        let ended = place.with_beds("sweep plan.toml");
        assert_eq!(ended.code(), code, "{plan}: {}", ended.stderr());
        assert!(ended.stderr().contains(expected), "{plan}: {}", ended.stderr());
        assert!(!place.path("runs/plan").exists(), "{plan}");
    }
    let place = place("case = 'tiny.toml'\n[[points]]\n'solver.max_iterations' = 10");
    place.with_beds("sweep plan.toml").with_code(0);
    std::fs::write(
        place.path("plan.toml"),
        "case = 'tiny.toml'\n[[points]]\n'solver.max_iterations' = 12",
    )
    .unwrap();
    let other = place.with_beds("sweep plan.toml");
    assert_eq!(other.code(), 2);
    assert!(other.stderr().contains("another folder with --out"), "{}", other.stderr());
}

#[test]
fn a_point_that_ended_before_its_end_is_no_result_and_goes_on() {
    let place = place("case = 'tiny.toml'\n[grid]\n'solver.max_iterations' = [20, 30]");
    place.with_beds("sweep plan.toml").with_code(0);
    let whole = place.text("runs/plan/table.csv");
    place
        .with_beds("run runs/plan/00001/case.toml --out runs/plan/00001 --steps 40 --force")
        .with_code(0);
    place.with_beds("sweep plan.toml --point 2").with_code(0);
    assert_eq!(table(&place).iter().map(|r| cell(r, "number")).collect::<Vec<_>>(), ["2"]);
    let again = place.with_beds("sweep plan.toml").with_code(0);
    assert!(again.stderr().contains("1 of 2 already finished"), "{}", again.stderr());
    assert_eq!(place.text("runs/plan/table.csv"), whole);
}

#[test]
fn values_that_json_has_no_number_for_are_texts() {
    let place =
        place("case = 'tiny.toml'\n[grid]\n'tamping.squeeze.force_limit_N' = [7800.0, inf]");
    let events = place.with_beds("sweep plan.toml --list --json").with_code(0).events();
    assert_eq!(events[1]["values"]["tamping.squeeze.force_limit_N"], "inf", "{events:?}");
    place.with_beds("sweep plan.toml --point 2").with_code(0);
    assert_eq!(cell(&table(&place)[0], "tamping.squeeze.force_limit_N"), "inf");
    let manifest: Value = serde_json::from_str(&place.text("runs/plan/manifest.json")).unwrap();
    assert_eq!(manifest["points"][1]["values"]["tamping.squeeze.force_limit_N"], "inf");
}

#[test]
fn jobs_of_an_array_write_the_table_in_turn() {
    let place = place(PLAN);
    place.with_beds("sweep plan.toml --point 1").with_code(0);
    let lock = std::fs::File::options().write(true).open(place.path("runs/plan/.lock")).unwrap();
    lock.lock().unwrap();
    let mut waiting = place.with_beds_command("sweep plan.toml --point 2").spawn().unwrap();
    wait_for(&place, "runs/plan/00002/summary.json");
    std::thread::sleep(Duration::from_millis(300));
    assert!(waiting.try_wait().unwrap().is_none() && table(&place).len() == 1);
    drop(lock);
    assert!(waiting.wait().unwrap().success());
    assert_eq!(table(&place).len(), 2);
}

#[test]
fn a_point_that_another_process_computes_is_waited_for() {
    let place = place(PLAN);
    place.with_beds("sweep plan.toml --point 2").with_code(0);
    std::fs::create_dir_all(place.path("runs/plan/00001")).unwrap();
    let lock = std::fs::File::create(place.path("runs/plan/00001/.lock")).unwrap();
    lock.lock().unwrap();
    let mut sweep = place.with_beds_command("sweep plan.toml").spawn().unwrap();
    wait_for(&place, "runs/plan/00005/summary.json");
    std::thread::sleep(Duration::from_millis(300));
    assert!(sweep.try_wait().unwrap().is_none(), "it did not wait");
    assert!(!place.path("runs/plan/00001/summary.json").exists());
    drop(lock);
    assert!(sweep.wait().unwrap().success());
    assert_eq!(table(&place).len(), 5);
}

#[test]
fn more_runs_at_a_time_than_threads_can_be_started_are_refused() {
    let ended = place(PLAN).with_beds("sweep plan.toml --list --jobs 4000000000");
    assert_eq!(ended.code(), 2);
    assert!(ended.stderr().contains("1..=1024"), "{}", ended.stderr());
}

#[test]
fn a_stopped_sweep_goes_on_where_its_runs_are() {
    let place = place(PLAN);
    place.with_beds("sweep plan.toml --out whole --jobs 2").with_code(0);
    let mut command = place.with_beds_command("sweep plan.toml");
    let mut child = command.spawn().unwrap();
    // In the middle of some run.
    wait_for(&place, "runs/plan/00002/results.vtkhdf");
    kill(Pid::from_raw(child.id() as i32), Signal::SIGINT).unwrap();
    assert_eq!(child.wait().unwrap().code(), Some(130));
    place.with_beds("sweep plan.toml").with_code(0);
    let read =
        |folder: &str| std::fs::read_to_string(place.path(folder).join("table.csv")).unwrap();
    assert_eq!(read("runs/plan"), read("whole"));
}
