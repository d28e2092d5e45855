//! Pages about runs.

use crate::setup::{CASE, Place};
use ballast_hdf5::checkpoint;
use ballast_hdf5::results::ResultsReader;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde_json::Value;

#[test]
fn a_page_tells_a_whole_run_by_itself() {
    let place = Place::new();
    let said = place.run("--out run").with_code(0).stdout();
    assert!(said.contains("ParaView") && !said.contains("tables only"), "{said}");
    let said = place.call("report run").with_code(0);
    assert!(said.stdout().contains("report.html"));
    let page = place.text("run/report.html");
    assert!(page.len() < 1 << 20, "{} bytes", page.len());
    for word in ["<script", "http:", "https:", "src=", "NaN", "inf"] {
        assert!(!page.replace("infeasible", "").contains(word), "{word}");
    }
    for word in [
        "End of the squeeze",
        "Compactness under the sleepers",
        "Compactness of the cribs",
        "Compactness where the tines pass",
        "Force on tines",
        "Force against closing",
        "compaction energy (J)",
        "Penetration",
        "Residual of each step (QM/16)",
        "Iterations",
        "External work",
        "Wall time",
        "seed of the bed",
        "prefers-color-scheme:dark",
        "aria-label",
        "amplitude_m",
    ] {
        assert!(page.contains(word), "{word} is not in the page");
    }
    let hash = place.hash("run");
    assert!(page.contains(&hash), "the page does not name the state");
    // Grains, sleeper and tines are drawn.
    assert!(page.matches("class=\"grain ").count() > 30);
    assert!(page.matches("class=\"tool\"").count() >= 4 && page.contains("class=\"block\""));

    // The same files, the same page; any file of the run names it.
    let ended = place.call("report run/results.vtkhdf --out again.html --json").with_code(0);
    assert_eq!(ended.events().last().unwrap()["bytes"], page.len());
    assert_eq!(place.text("again.html"), page);

    // A new run removes the report, but no other page of that name.
    place.run("--out run --steps 3 --force").with_code(0);
    assert!(!place.path("run/report.html").exists());
    std::fs::write(place.path("run/report.html"), "mine").unwrap();
    place.run("--out run --steps 3 --force").with_code(0);
    assert_eq!(place.text("run/report.html"), "mine");
}

#[test]
fn a_scene_has_the_bodies_of_every_frame_and_needs_nothing_from_outside() {
    let place = Place::new();
    place.run("--out run").with_code(0);
    place.call("report run --scene").with_code(0);
    let page = place.text("run/report.html");
    for word in ["http:", "https:", "src=", "import"] {
        assert!(!page.contains(word), "{word}");
    }
    let (_, data) = page.split_once("showScene({").expect("a call with data");
    let (data, _) = data.split_once("}, document").expect("the end of the data");
    let data: Value = serde_json::from_str(&format!("{{{data}}}")).unwrap();
    let bytes = |key: &str| STANDARD.decode(data[key].as_str().unwrap()).unwrap();
    let floats = |key: &str| -> Vec<f32> {
        bytes(key).chunks_exact(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect()
    };
    let results = ResultsReader::open(place.path("run/results.vtkhdf")).unwrap();
    let stored = checkpoint::read(place.path("run/checkpoint.h5")).unwrap();
    let (grains, frames) = (stored.model.grains.len(), results.times().unwrap().len());
    assert!(frames > 2);
    assert_eq!(data["frames"].as_array().unwrap().len(), frames);
    // Shape and kind of each body: grains, a block, and two tines of blade and shaft.
    let items = bytes("items").len() / 8;
    assert_eq!(items, grains + 1 + 4);
    let poses = floats("poses");
    assert_eq!(poses.len(), 7 * items * frames);
    for frame in [0, frames - 1] {
        for (grain, pose) in results.poses(frame).unwrap()[..grains].iter().enumerate() {
            let p = pose.position;
            let found = &poses[7 * (frame * items + grain)..][..3];
            assert_eq!(found, [p.x as f32, p.y as f32, p.z as f32]);
        }
    }
    let count = |k: usize| -> u64 {
        data["shapes"].as_array().unwrap().iter().map(|s| s[k].as_u64().unwrap()).sum()
    };
    assert_eq!(floats("corners").len() as u64, 3 * count(0));
    assert_eq!(bytes("triangles").len() as u64, 6 * count(1));

    // Without frames there is nothing to show.
    let place = Place::with(&CASE.replace("output_interval_s = 0.01", "output_interval_s = 0"));
    place.run("--out run --steps 3").with_code(0);
    let said = place.call("report run --scene").with_code(1).stderr();
    assert!(said.contains("--scene") && said.contains("run.output_interval_s"), "{said}");
}

#[test]
fn a_zone_that_a_blade_fills_has_no_compactness_for_that_long() {
    // Without vibration a rigid blade that goes as deep as the sleeper is lifted fills its insertion zone.
    let case = [
        ("[tamping]\n", "mount = { rigid = true }\n[tamping]\n"),
        ("amplitude_m = 0.002", "amplitude_m = 0.0"),
        ("height_m = 0.004", "height_m = 0.012"),
        ("depth_m = 0.004", "depth_m = 0.004\nforce_limit_N = inf"),
    ];
    let place = Place::with(&case.iter().fold(CASE.into(), |text: String, (from, to)| {
        assert!(text.contains(from), "{from}");
        text.replace(from, to)
    }));
    place.run("--out run").with_code(0);
    let zones =
        ResultsReader::open(place.path("run/results.vtkhdf")).unwrap().table("zones").unwrap();
    assert!(zones.rows.iter().any(|value| value.is_nan()));
    let said = place.run("--out part --steps 70").with_code(0).stdout();
    assert!(said.contains("insertion/tine_1_plus") && !said.contains("NaN"), "{said}");
    assert!(place.summary("part")["compactness"]["insertion/tine_1_plus"]["after"].is_null());
    for folder in ["run", "part"] {
        place.call(&format!("report {folder}")).with_code(0);
        assert!(!place.text(&format!("{folder}/report.html")).contains("NaN"));
    }
}

#[test]
fn times_of_another_state_are_not_told() {
    let place = Place::new();
    place.run("--out run --steps 60").with_code(0);
    let earlier = place.text("run/summary.json");
    let tells_time = || {
        place.call("report run").with_code(0);
        place.text("run/report.html").contains("Wall time, ")
    };
    assert!(tells_time());
    place.call("resume run --steps 90").with_code(0);
    assert!(tells_time());
    std::fs::write(place.path("run/summary.json"), earlier).unwrap();
    assert!(!tells_time());
}

#[test]
fn a_served_run_has_no_results_to_make_a_page_of() {
    let place = Place::new();
    place.run("--out run --steps 5").with_code(0);
    std::fs::remove_file(place.path("run/results.vtkhdf")).unwrap();
    let said = place.call("report run").with_code(1).stderr();
    assert!(said.contains("results.vtkhdf") && !said.contains("served"), "{said}");
    let path = place.path("run/checkpoint.h5");
    let mut kept = checkpoint::read(&path).unwrap();
    kept.extra.insert("run_id".into(), "1".into());
    checkpoint::write(&path, &kept).unwrap();
    let said = place.call("report run").with_code(1).stderr();
    for word in ["results.vtkhdf", "a served run writes no results", "--record", "ballast replay"] {
        assert!(said.contains(word), "{word}: {said}");
    }
}

#[test]
fn a_run_in_parts_has_a_page_too_and_strange_folders_have_none() {
    let place = Place::new();
    place.run("--out part --steps 60").with_code(0);
    std::fs::remove_file(place.path("part/summary.json")).unwrap();
    place.call("report part").with_code(0);
    // A page is replaced; anything else is not.
    place.call("report part --out part/report.html").with_code(0);
    let others = [
        ("part/results.vtkhdf", "a page to replace"),
        ("part", "found a folder"),
        ("/dev/null", "found a device"),
    ];
    for (taken, words) in others {
        let said = place.call(&format!("report part --out {taken}")).with_code(1).stderr();
        assert!(said.contains(taken) && said.contains(words), "{said}");
    }
    let page = place.text("part/report.html");
    assert!(page.contains("run is unfinished") && page.contains("No profile"));
    assert!(!page.contains("End of the squeeze"), "it had not ended");

    // Rows beyond the checkpoint are those of a run that was killed; other rows are of another run.
    place.run("--out early --steps 30").with_code(0);
    let kept = std::fs::read(place.path("part/checkpoint.h5")).unwrap();
    std::fs::copy(place.path("early/checkpoint.h5"), place.path("part/checkpoint.h5")).unwrap();
    place.call("report part").with_code(0);
    std::fs::write(place.path("early/checkpoint.h5"), kept).unwrap();
    place.run("--out other --steps 60 --schedule sequential").with_code(0);
    std::fs::copy(place.path("other/checkpoint.h5"), place.path("part/checkpoint.h5")).unwrap();
    for (folder, says) in [
        ("early", "steps: expected a row for each of 60 steps, found 30"),
        ("part", "steps, step 60, kinetic: expected that of the checkpoint"),
    ] {
        let said = place.call(&format!("report {folder}")).with_code(1).stderr();
        assert!(said.contains(says) && said.contains("its own run's results"), "{said}");
    }

    std::fs::remove_file(place.path("part/checkpoint.h5")).unwrap();
    let refused = place.call("report part").with_code(1);
    assert!(refused.stderr().contains("checkpoint.h5"), "{}", refused.stderr());
    place.call("report nowhere").with_code(1);

    // Figures are those of the end, whenever pictures were asked for.
    let rare = CASE.replace("output_interval_s = 0.01", "output_interval_s = 0");
    assert_ne!(rare, CASE);
    let rare = Place::with(&rare);
    let said = rare.run("--out rare --steps 120").with_code(0).stdout();
    assert!(said.contains("tables only") && said.contains("output_interval_s"), "{said}");
    assert!(!said.contains("ParaView"), "there is no geometry: {said}");
    rare.call("report rare").with_code(0);
    let page = rare.text("rare/report.html");
    let summary = rare.summary("rare");
    let zones = summary["compactness"].as_object().unwrap();
    for (name, zone) in zones.iter().filter(|(name, _)| name.starts_with("under")) {
        let [before, after] = ["before", "after"].map(|when| zone[when].as_f64().unwrap());
        assert!((after - before).abs() > 1e-3, "{name} has not changed");
        let card = format!("{before:.3} before, {:+.1} %", 100.0 * (after / before - 1.0));
        assert!(page.contains(&card), "{card}");
    }

    // Shorter than the period of the vibration: forces are shown as they are.
    place.run("--out short --steps 20").with_code(0);
    place.call("report short").with_code(0);
    let page = place.text("short/report.html");
    assert!(page.contains("shorter than a vibration period"));
    let chart = page.split("<svg").find(|plot| plot.contains("Force on tines"));
    let lines = chart.expect("a plot of forces").matches("class=\"line c").count();
    // Those of two tines, and their marks in the legend.
    assert_eq!(lines, 4);
}
