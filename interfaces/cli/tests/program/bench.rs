//! Measurements: that they run and that their figures fit each other. How long anything takes is not tested.

use crate::setup::Place;
use serde_json::Value;

/// Rows of the events of a call, and the notes at its end.
fn rows(place: &Place, arguments: &str) -> (Vec<Value>, Value) {
    let ended = place.with_beds(&format!("{arguments} --json")).with_code(0);
    sorted(ended.events())
}

fn sorted(events: Vec<Value>) -> (Vec<Value>, Value) {
    let done = events.iter().find(|e| e["event"] == "done").expect("done").clone();
    (events.into_iter().filter(|e| e["event"] == "row").collect(), done["notes"].clone())
}

#[track_caller]
fn number(row: &Value, key: &str) -> f64 {
    row[key].as_f64().unwrap_or_else(|| panic!("{key} of {row}"))
}

/// Header and rows of a CSV file; every row is as long as the header.
fn csv(place: &Place, name: &str) -> (Vec<String>, Vec<Vec<String>>) {
    let text = place.text(name);
    let comments: Vec<&str> = text.lines().filter(|line| line.starts_with("# ")).collect();
    assert!(comments[0].starts_with("# command: ballast bench "), "{comments:?}");
    for word in ["processor", "caches", "cores", "instructions", "threads", "compiler profile"] {
        assert!(comments.iter().any(|line| line.contains(word)), "{word} in {comments:?}");
    }
    // Commas between quotation marks are part of a field.
    let split = |line: &str| {
        let mut fields = vec![String::new()];
        let mut is_quoted = false;
        for c in line.chars() {
            match c {
                '"' => is_quoted = !is_quoted,
                ',' if !is_quoted => fields.push(String::new()),
                _ => fields.last_mut().expect("a field").push(c),
            }
        }
        fields
    };
    let mut lines = text.lines().filter(|line| !line.starts_with('#')).map(split);
    let header = lines.next().expect("a header");
    let rows: Vec<Vec<String>> = lines.collect();
    assert!(rows.iter().all(|row| row.len() == header.len()), "{text}");
    (header, rows)
}

fn sample() -> &'static str {
    concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/rested500.json")
}

#[test]
fn sweeps_are_held_against_a_roofline_and_count_their_bytes() {
    let place = Place::new();
    let ended = place.call(
        "bench kernel --edge 6 --rounds 3 --seconds 0.002 --threads-up-to 6 --csv k.csv --json",
    );
    let (rows, _) = sorted(ended.with_code(0).events());
    let instructions = rows.iter().filter(|r| r["instructions"] == "portable").count();
    // The small lattice and the subdomains on one to four threads and six, the large lattice on one.
    assert_eq!(instructions, 11);
    assert!(rows.len().is_multiple_of(11));
    for row in &rows {
        // How large they are depends on what else the machine does.
        for key in ["of_roof_percent", "of_peak_percent", "roof_mvisits_per_s", "mvisits_per_s"] {
            assert!(number(row, key) > 0.0, "{key} of {row}");
        }
        let [low, middle, high] = ["low", "mvisits_per_s", "high"].map(|key| number(row, key));
        assert!(low <= middle && middle <= high, "{row}");
        let streamed = number(row, "bytes_per_visit");
        assert!((150.0..400.0).contains(&streamed), "{row}");
        assert!(number(row, "core_bytes_per_visit") > streamed, "{row}");
        assert!((150.0..1500.0).contains(&number(row, "flops_per_visit")), "{row}");
        let threads = number(row, "threads");
        assert!(row["form"] != "one set per thread" || number(row, "contacts") % threads == 0.0);
    }
    // 36 grains of 3 x 3 x 4: their neighbours and the floor.
    assert!(rows.iter().any(|row| row["contacts"] == 120 && row["threads"] == 1));
    let (header, lines) = csv(&place, "k.csv");
    assert_eq!(lines.len(), rows.len());
    assert_eq!(header[0], "lattice");
}

#[test]
fn detection_finds_the_same_contacts_from_nothing_and_again() {
    let place = Place::new();
    let call = format!(
        "bench detection {} --steps 3 --warm-up 1 --threads-up-to 2 --iterations 10",
        sample()
    );
    let (rows, notes) = rows(&place, &call);
    assert!(notes["scene"].as_str().unwrap().contains("500 grains"), "{notes}");
    let ways: Vec<&str> = rows.iter().map(|row| row["way"].as_str().unwrap()).collect();
    let twice = ["from nothing", "nearly still", "in a run"].map(|way| [way; 2]);
    assert_eq!(ways, twice.concat());
    let contacts: Vec<f64> = rows.iter().map(|row| number(row, "contacts")).collect();
    assert_eq!(contacts[0], contacts[1], "one thread and two");
    assert_eq!(contacts[0], contacts[2], "from nothing and nearly still");
    for row in &rows {
        let [broad, narrow, whole] =
            ["broad_us", "narrow_us", "whole_high_us"].map(|key| number(row, key));
        assert!(broad >= 0.0 && narrow > 0.0 && whole > 0.0, "{row}");
    }
}

#[test]
fn a_step_is_the_sum_of_its_phases_and_the_same_on_every_number_of_threads() {
    let place = Place::new();
    let (rows, notes) =
        rows(&place, "bench step tiny.toml --steps 4 --warm-up 2 --threads-up-to 3 --csv s.csv");
    assert_eq!(notes["same bytes for every number of threads"], "yes");
    let hashes: Vec<&str> =
        notes["state hash"].as_str().unwrap().split(", ").map(|h| &h[..32]).collect();
    assert_eq!(hashes.len(), 3);
    // The same steps by `run`.
    place.run("--out run --steps 6").with_code(0);
    assert!(hashes.iter().all(|hash| *hash == place.hash("run")), "{hashes:?}");
    for threads in 1..=3 {
        let of: Vec<&Value> = rows.iter().filter(|row| row["threads"] == threads).collect();
        assert_eq!(of.len(), 11);
        let wall = |row: &&Value| number(row, "wall_mean_ms");
        let (whole, parts) = of.split_last().unwrap();
        let sum: f64 = parts.iter().map(wall).sum();
        assert!((sum - wall(whole)).abs() < 1e-6 * sum, "{sum} of {whole}");
        let shares: f64 = parts.iter().map(|row| number(row, "share_percent")).sum();
        assert!((shares - 100.0).abs() < 1e-6, "{shares}");
        for row in &of {
            let efficiency = number(row, "efficiency_percent");
            let expected = 100.0 * number(row, "speedup") / f64::from(threads);
            assert!((efficiency - expected).abs() < 1e-9 * expected.max(1.0), "{row}");
        }
    }
    assert_eq!(csv(&place, "s.csv").1.len(), 33);
}

#[test]
fn a_step_is_measured_from_a_checkpoint_of_its_case_only() {
    let place = Place::new();
    place.run("--out run --steps 20").with_code(0);
    let call = "bench step tiny.toml --steps 1 --warm-up 0 --threads-up-to 1";
    let (_, notes) = rows(&place, &format!("{call} --from-checkpoint run/checkpoint.h5"));
    assert!(notes["scene"].as_str().unwrap().contains("from step 20 of 180"), "{notes}");
    place.run("--out longer --steps 21").with_code(0);
    assert!(notes["state hash"].as_str().unwrap().starts_with(&place.hash("longer")), "{notes}");
    let other = place
        .with_beds(&format!("{call} --from-checkpoint run/checkpoint.h5 --seed 8"))
        .with_code(5);
    assert!(other.stderr().contains("expected a checkpoint of"), "{}", other.stderr());
    // It is solved as the case says, and moved as it was.
    let case = place.text("tiny.toml");
    let changed = case
        .replace("max_iterations = 30", "max_iterations = 41")
        .replace("tolerance = 1e-3", "tolerance = 0");
    assert_ne!(changed, case);
    std::fs::write(place.path("tiny.toml"), changed).unwrap();
    let (_, notes) = rows(&place, &format!("{call} --from-checkpoint run/checkpoint.h5"));
    assert!(notes["iterations"].as_str().unwrap().starts_with("mean 41"), "{notes}");
    let changed = case.replace("gap_to_sleeper_m = 0.04", "gap_to_sleeper_m = 0.041");
    assert_ne!(changed, case);
    std::fs::write(place.path("tiny.toml"), changed).unwrap();
    let other =
        place.with_beds(&format!("{call} --from-checkpoint run/checkpoint.h5")).with_code(5);
    assert!(other.stderr().contains("expected a run with the machine"), "{}", other.stderr());
}

#[test]
fn subdomains_cost_an_interface_and_reach_the_same_residual() {
    let place = Place::new();
    let (rows, _) = rows(
        &place,
        "bench subdomains tiny.toml --max 4 --steps 2 --warm-up 1 --iterations 12 --tolerance 1e-2 \
         --max-iterations 5000 --csv d.csv",
    );
    assert_eq!(rows.len(), 2 * (1 + 2 + 2));
    for row in &rows {
        let alone = row["schedule"] == "sequential";
        assert_eq!(number(row, "interface_percent") == 0.0, alone, "{row}");
        assert_eq!(number(row, "subdomains") == 1.0, alone, "{row}");
        assert!(number(row, "over_sequential") > 0.0, "{row}");
        if row["rule"] == "fixed" {
            assert_eq!(number(row, "iterations"), 12.0, "{row}");
        } else if row["converged"] == "yes" {
            assert!(number(row, "residual_qm16") <= 1e-2, "{row}");
        }
    }
    assert!(rows.iter().any(|row| row["rule"] == "tolerance" && row["converged"] == "yes"));
    csv(&place, "d.csv");
}

#[test]
fn warm_start_and_nncg_save_iterations() {
    let place = Place::new();
    let (rows, notes) = rows(
        &place,
        "bench convergence tiny.toml --steps 3 --warm-up 2 --tolerance 1e-3 --max-iterations 5000 \
         --threads 2 --csv i.csv",
    );
    assert!(notes["ends"].as_str().unwrap().contains("at most 5000"), "{notes}");
    let ways: Vec<&str> = rows.iter().map(|row| row["way"].as_str().unwrap()).collect();
    assert_eq!(ways[0], "plain, from nothing");
    assert_eq!(ways[3], "NNCG, from the last step");
    assert!(ways[4..] == ["synchronous, subdomains of the case"; 2], "{ways:?}");
    for row in &rows {
        assert!(row["converged"] == "yes" && number(row, "residual_qm16") < 1e-3, "{row}");
    }
    let taken: Vec<f64> = rows.iter().map(|row| number(row, "iterations")).collect();
    assert!(taken[1] < taken[0] && taken[2] < taken[0] && taken[3] < taken[0], "{taken:?}");
    assert_eq!(taken[4], taken[5], "one thread and two");
    assert_eq!(number(&rows[0], "plain_over_solve"), 1.0);
    csv(&place, "i.csv");
}

#[test]
fn what_a_simulated_second_costs_is_told_for_every_step_recovery_and_number_of_iterations() {
    let place = Place::new();
    let call = format!("bench work-precision {} --time 0.02", sample());
    let call = format!(
        "{call} --step-ms 1,4 --iterations 2,40 --correction-factor 0,0.5 --csv c.csv --json"
    );
    let (rows, notes) = sorted(place.call(&call).with_code(0).events());
    assert!(notes["scene"].as_str().unwrap().contains("500 grains"), "{notes}");
    let of = |key: &str| rows.iter().map(|row| number(row, key)).collect::<Vec<_>>();
    assert_eq!(of("step_ms"), [1.0, 1.0, 1.0, 1.0, 4.0, 4.0, 4.0, 4.0]);
    assert_eq!(of("recovery"), [0.0, 0.0, 0.5, 0.5, 0.0, 0.0, 0.5, 0.5]);
    assert_eq!(of("iterations"), [2.0, 40.0, 2.0, 40.0, 2.0, 40.0, 2.0, 40.0]);
    assert_eq!(of("steps"), [20.0, 20.0, 20.0, 20.0, 5.0, 5.0, 5.0, 5.0]);
    for row in &rows {
        let [mean, p99] = ["mean_penetration_um", "p99_penetration_um"].map(|k| number(row, k));
        let most = 1e3 * number(row, "max_penetration_mm");
        assert!(0.0 < mean && mean < p99 && p99 <= most, "{row}");
        let [step, second] = ["cpu_ms_per_step", "cpu_s_per_simulated_s"].map(|k| number(row, k));
        assert!((second - step / number(row, "step_ms")).abs() < 1e-9 * second, "{row}");
    }
    let mean = of("mean_penetration_um");
    assert!(mean[1] < mean[0] && mean[5] < mean[4], "iterations help: {mean:?}");
    let most = of("max_penetration_mm");
    for (without, with) in [(0, 2), (1, 3), (4, 6), (5, 7)] {
        assert!(most[with] < 0.5 * most[without], "recovery helps: {most:?}");
    }
    assert_eq!(csv(&place, "c.csv").1.len(), 8);
}

#[test]
fn tables_stand_beside_what_was_published_and_say_that_they_extrapolate() {
    let place = Place::new();
    let call = "bench hoang2012 tiny.toml --steps 2 --warm-up 1 --threads-up-to 2 --iterations 10 \
                --tolerance 1e-2 --csv t.csv";
    let (rows, notes) = rows(&place, call);
    // Two numbers of threads and three versions, fixed and to a residual.
    assert_eq!(rows.len(), 2 * (2 + 3));
    assert!(notes["tiny"].as_str().unwrap().contains("extrapolates"), "{notes}");
    for row in &rows {
        let shares = ["solve_percent", "detection_percent", "rest_percent"];
        let sum: f64 = shares.map(|key| number(row, key)).iter().sum();
        assert!((sum - 100.0).abs() < 1e-6, "{row}");
        assert!(row["run_min_is"].as_str().unwrap().contains("2 steps"), "{row}");
    }
    assert_eq!(csv(&place, "t.csv").1.len(), 10);

    let named = Place::with(&crate::setup::CASE.replace("\"tiny\"", "\"one_sleeper\""));
    let call = call.replace("--csv t.csv", "--fixed-only");
    let (rows, _) = self::rows(&named, &call);
    assert_eq!(rows.len(), 4, "three versions, and one row that was published");
    assert_eq!(rows[3]["source"], "Hoang et al. 2012");
    assert_eq!(number(&rows[3], "solve_percent"), 80.5);
}

#[test]
fn tables_for_people_have_titles_units_and_the_machine() {
    let place = Place::new();
    let call = "bench step tiny.toml --steps 1 --warm-up 1 --threads-up-to 1 --iterations 5";
    let text = place.with_beds(call).with_code(0).stdout();
    for word in ["processor: ", "1 thread\n", "narrow phase", "wall mean ms", "whole step"] {
        assert!(text.contains(word), "{word} in\n{text}");
    }
}

#[test]
fn nonsense_is_refused() {
    let place = Place::new();
    for (call, code, says) in [
        ("bench kernel --seconds 0", 2, "--seconds"),
        ("bench kernel --edge 1000", 2, "at most"),
        ("bench kernel --rounds 0", 2, "--rounds"),
        ("bench step tiny.toml --steps 0", 2, "--steps"),
        ("bench step tiny.toml --threads-up-to 100000", 2, "1..=1024"),
        ("bench step none.toml", 1, "none.toml"),
        ("bench detection none.json", 1, "none.json"),
        ("bench subdomains tiny.toml --max 100000", 2, "per grain"),
        ("bench subdomains tiny.toml --tolerance 0", 2, "--tolerance"),
        ("bench convergence tiny.toml --tolerance 2", 2, "--tolerance"),
        ("bench hoang2012 tiny.toml --tolerance 7", 2, "--tolerance"),
        ("bench hoang2012", 2, "CASES"),
        ("bench work-precision none.json", 1, "none.json"),
        ("bench work-precision none.json --step-ms 0", 2, "--step-ms"),
        ("bench work-precision none.json --time inf", 2, "--time"),
        ("bench work-precision none.json --iterations 0", 2, "--iterations"),
        (
            "bench work-precision none.json --correction-factor 0.1,1.5",
            2,
            "--correction-factor 1.5",
        ),
        ("bench hoang2012 tiny.toml tiny.toml --from-checkpoint run.h5", 2, "--from-checkpoint"),
    ] {
        let beds = call.contains("tiny.toml");
        let ended = if beds { place.with_beds(call) } else { place.call(call) };
        let ended = ended.with_code(code);
        assert!(ended.stderr().contains(says), "{call}: {}", ended.stderr());
    }
    let seeded = place.call(&format!("bench step {} --seed 3", sample())).with_code(2);
    assert!(seeded.stderr().contains("--seed"), "{}", seeded.stderr());
}
