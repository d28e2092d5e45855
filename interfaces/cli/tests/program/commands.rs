//! Output of the commands.

use crate::setup::{CASE, Place, STEPS};
use serde_json::Value;

#[test]
fn events_are_json_lines_from_start_to_done() {
    let place = Place::new();
    let ended = place.run("--out run --json").with_code(0);
    let events = ended.events();
    let names: Vec<&str> = events.iter().map(|e| e["event"].as_str().unwrap()).collect();
    assert!(names.contains(&"start") && names.contains(&"checkpoint"), "{names:?}");
    assert_eq!(names.last(), Some(&"done"));
    let progress: Vec<&Value> = events.iter().filter(|e| e["event"] == "progress").collect();
    assert!(progress.len() >= 50, "{}", progress.len());
    let shares: Vec<f64> = progress.iter().map(|e| e["fraction"].as_f64().unwrap()).collect();
    assert!(shares.is_sorted());
    assert!(progress.iter().any(|e| e["phase"] == "squeeze"));
    let done = events.last().unwrap();
    assert_eq!(done["steps"], STEPS);
    assert_eq!(done["state_hash"], place.summary("run")["state_hash"]);

    let failed = place.call("check none.toml --json").with_code(1);
    let events = failed.events();
    assert_eq!(events[0]["event"], "error");
    assert_eq!(events[0]["exit_code"], 1);

    let place = Place::with(&CASE.replace("step_s", "stepp_s"));
    let events = place.call("check tiny.toml --json").with_code(3).events();
    let found = &events[0]["errors"][0];
    assert_eq!(found["key"], "run.stepp_s", "{events:?}");
    assert!(found["line"].as_u64() > Some(1) && found["column"] == 1, "{found}");
}

/// Its bytes depend on who was faster, its physics do not.
#[test]
fn an_asynchronous_run_is_as_sound_as_a_synchronous_one() {
    let place = Place::new();
    for schedule in ["synchronous", "asynchronous"] {
        place.run(&format!("--out {schedule} --threads 2 --schedule {schedule}")).with_code(0);
        let summary = place.summary(schedule);
        let number = |at: &str| summary.pointer(at).and_then(Value::as_f64).expect(at);
        assert_eq!((&summary["complete"], &summary["steps"]), (&true.into(), &STEPS.into()));
        let error = number("/energy_J/balance_error") / number("/energy_J/external_work");
        assert!(error.abs() < 1e-3, "{schedule}: energy balance {error}");
    }
    let grains = ["synchronous", "asynchronous"].map(|s| place.summary(s)["grains"].clone());
    assert_eq!(grains[0], grains[1]);
}

#[test]
fn the_summary_tells_the_figures_of_a_tamping_run() {
    let place = Place::new();
    let ended = place.run("--out run").with_code(0);
    let text = ended.stdout();
    for word in [
        "compactness",
        "coordination",
        "force on tine",
        "penetration",
        "dissipated",
        "narrow phase",
        "not converged",
        "grains lost",
        "state hash",
        "results.vtkhdf",
        "ParaView",
    ] {
        assert!(text.contains(word), "{word} in\n{text}");
    }
    let summary = place.summary("run");
    assert_eq!((&summary["complete"], &summary["grains_lost"]), (&true.into(), &0.into()));
    let tines = summary["tines"].as_object().unwrap();
    assert_eq!(tines.len(), 2);
    let worked = |tine: &&Value| tine["peak_force_N"]["value"].as_f64().unwrap() > 0.0;
    assert!(tines.values().any(|tine| worked(&tine)), "no tine met the ballast: {summary:#}");
    for (zone, values) in summary["compactness"].as_object().unwrap() {
        for when in ["before", "after"] {
            let value = values[when].as_f64().unwrap();
            assert!((0.0..1.0).contains(&value), "{zone} {when}: {value}");
        }
    }
    // Energy: what went in is either there or dissipated; what is left over is the time step's.
    let energy = &summary["energy_J"];
    let value = |key: &str| energy[key].as_f64().unwrap();
    assert!(value("dissipated") > 0.0);
    assert!(value("balance_error").abs() < 1e-4 * value("dissipated"), "{energy}");
    // Thirty iterations are too few for stones that jam: some steps fling.
    assert!(
        value("spurious_contact_energy") > 0.0
            && value("spurious_contact_energy") < 0.3 * value("dissipated"),
        "{energy}"
    );
}

#[test]
fn progress_goes_to_stderr_in_tenths() {
    let place = Place::new();
    let ended = place.run("--out run").with_code(0);
    let text = ended.stderr();
    // On a slow machine there may be more lines: one in half a minute at least.
    let shares = text.lines().filter(|line| line.starts_with("tiny") && line.contains(" % "));
    let tenths =
        (1..=10).filter(|k| shares.clone().any(|l| l.contains(&format!(" {} % ", 10 * k))));
    assert_eq!(tenths.count(), 10, "{text}");
    assert!(!ended.stdout().contains(" left"));
}

#[test]
fn a_bed_is_prepared_once() {
    let place = Place::new();
    let first = place.call("prepare tiny.toml --bed-cache beds --json").with_code(0);
    let again = place.call("prepare tiny.toml --bed-cache beds --json").with_code(0);
    let made = |ended: &crate::setup::Ended| {
        ended.events().into_iter().find(|e| e["event"] == "bed").unwrap()
    };
    assert_eq!(made(&first)["prepared"], true);
    assert_eq!(made(&again)["prepared"], false);
    let stones = first.events().into_iter().find(|e| e["event"] == "stones").unwrap();
    assert_eq!(stones["grading"][2]["passing"], 1.0, "no stone is larger than 40 mm");
    assert!(stones["sphericity"]["mean"].as_f64().is_some_and(|mean| mean > 0.7 && mean < 1.0));
    let bed = place.path(made(&first)["path"].as_str().unwrap());
    // Equal keys, equal beds: where the hash changes, the version of the key is to be raised (`content_key`).
    let inspected = place.call(&format!("inspect {} --json", bed.display())).with_code(0).events();
    assert_eq!(
        [&inspected[0]["key"], &inspected[0]["hash"]],
        ["9a0a249d5de536dfc00a0ec68c872c10", "f44dbc27c5e2a3b30e143d120480b962"]
    );
    let bytes = std::fs::read(&bed).unwrap();
    place.call("prepare tiny.toml --bed-cache beds --force").with_code(0);
    assert_eq!(std::fs::read(&bed).unwrap(), bytes, "prepared again, same bytes");
    place.call("prepare tiny.toml --bed-cache beds --seed 8").with_code(0);
    assert_eq!(std::fs::read_dir(place.path("beds")).unwrap().count(), 2);
}

#[test]
fn files_that_cannot_be_written_cost_no_bed() {
    let place = Place::new();
    for option in ["--record nowhere/run.mcap", "--dump-problems tiny.toml/problems"] {
        let said =
            place.call(&format!("run tiny.toml --bed-cache beds {option}")).with_code(1).stderr();
        assert!(
            said.contains(option.split_once(' ').unwrap().1.split_once('/').unwrap().0),
            "{said}"
        );
        assert!(!place.path("beds").exists(), "{option}");
    }
}

#[test]
fn checks_tell_what_a_case_asks_for() {
    let place = Place::new();
    let text = place.call("check tiny.toml").with_code(0).stdout();
    assert!(text.contains("180 steps"), "{text}");
    let events = place.call("check tiny.toml --json").with_code(0).events();
    assert_eq!(events.last().unwrap()["steps"], STEPS);
    assert!(text.contains("0.01 to 0.07 s, 4 mm below the sleeper"), "{text}");
}

#[test]
fn files_can_be_inspected_and_exported() {
    let place = Place::new();
    place.run("--out run --steps 20").with_code(0);
    let text = place.call("inspect run/checkpoint.h5").with_code(0).stdout();
    assert!(text.contains("tiny") && text.contains("20"), "{text}");
    let hash = place.hash("run");
    assert!(text.contains(&hash), "{text}");
    // The zones are measured as at the end of the run.
    let told = place.call("inspect run/checkpoint.h5 --json").with_code(0).events();
    let summary: serde_json::Value = serde_json::from_str(&place.text("run/summary.json")).unwrap();
    let zones = told[0]["zones"].as_object().unwrap();
    assert_eq!(zones.len(), summary["compactness"].as_object().unwrap().len());
    for (name, zone) in zones {
        assert_eq!(zone["compactness"], summary["compactness"][name]["after"], "{name}");
        assert!(text.contains(name.as_str()), "{text}");
    }
    place.call("inspect run/results.vtkhdf").with_code(0);
    place.call("export run/results.vtkhdf --out tables").with_code(0);
    let steps = place.text("tables/steps.csv");
    assert_eq!(steps.lines().count(), 21, "a header and a row per step");
}

#[test]
fn schema_and_completions_are_printed() {
    let place = Place::new();
    let schema: Value = serde_json::from_str(&place.call("schema").with_code(0).stdout()).unwrap();
    assert!(schema["properties"]["bed"].is_object());
    for shell in ["bash", "zsh", "fish"] {
        let script = place.call(&format!("completions {shell}")).with_code(0).stdout();
        assert!(script.contains("resume"), "{shell}");
    }
    place.call("completions sh").with_code(2);
}

#[test]
fn stones_of_meshes_become_part_of_a_case() {
    let place = Place::new();
    let mesh = "v 0 0 0\nv 4 0 0\nv 0 3 0\nv 0 0 2\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n";
    std::fs::write(place.path("rock.obj"), mesh).unwrap();
    let printed = place.call("stones rock.obj --out stones.toml").with_code(0).stdout();
    assert!(printed.contains("rock.obj") && printed.contains("100.0 %"), "{printed}");
    let event = &place.call("stones rock.obj --json").with_code(0).events()[0];
    assert_eq!((&event["mesh_volume"], &event["volume"]), (&4.0.into(), &4.0.into()));
    let stones = place.text("stones.toml");
    let case = "name = \"rocks\"\n[bed]\nsize_m = [0.15, 0.15, 0.3]\nsleeper_underside_z_m = 0.1\n\
                [run]\nduration_s = 0.001\n";
    std::fs::write(place.path("rocks.toml"), format!("{case}{stones}")).unwrap();
    place.call("prepare rocks.toml --bed-cache beds").with_code(0);

    // Of stones, and of nothing else.
    place.call("stones rock.obj --out stones.toml").with_code(0);
    let message = place.call("stones rock.obj --out rocks.toml").with_code(1).stderr();
    assert!(message.contains("rocks.toml") && message.contains("another file"), "{message}");
    let message = place.call("stones rock.obj tiny.toml").with_code(1).stderr();
    assert!(message.contains("tiny.toml") && message.contains(".stl, .obj or .ply"), "{message}");
    assert_eq!(place.text("stones.toml"), stones);
}
