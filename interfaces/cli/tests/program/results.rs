//! docs/src/guide/results.md names all that a run leaves.

use crate::setup::Place;
use ballast_hdf5::results::ResultsReader;
use serde_json::Value;
use std::collections::BTreeSet;

const PAGE: &str = include_str!("../../../../docs/src/guide/results.md");

/// Names of what is in the files, with the unit where there is one.
type Named = (String, Option<String>);

/// `a_{b,c}` as `a_b` and `a_c`, wherever braces stand.
fn expanded(text: &str) -> Vec<String> {
    let braces =
        text.split_once('{').and_then(|(before, rest)| Some((before, rest.split_once('}')?)));
    let Some((before, (choices, after))) = braces else { return vec![text.to_string()] };
    choices.split(',').flat_map(|choice| expanded(&format!("{before}{choice}{after}"))).collect()
}

/// The names in the first cells of the page's tables, and the second cells beside them.
fn told(page: &str) -> BTreeSet<(String, String)> {
    let rows = page.lines().filter_map(|line| line.strip_prefix('|')?.split_once('|'));
    let names =
        |cell: &str| cell.split('`').skip(1).step_by(2).flat_map(expanded).collect::<Vec<_>>();
    let second = |rest: &str| rest.split('|').next().unwrap_or_default().trim().to_string();
    rows.flat_map(|(cell, rest)| names(cell).into_iter().map(move |name| (name, second(rest))))
        .collect()
}

/// Returns names that the page lacks, or has without their unit.
fn missing(page: &str, wanted: &BTreeSet<Named>) -> Vec<String> {
    let told = told(page);
    let is_told = |(name, unit): &&Named| match unit {
        Some(unit) => told.contains(&(name.clone(), unit.clone())),
        None => told.iter().any(|(known, _)| known == name),
    };
    let without = wanted.iter().filter(|named| !is_told(named));
    without
        .map(|(name, unit)| match unit.as_deref() {
            Some(unit) => {
                format!("docs/src/guide/results.md: no row for `{name}` with the unit `{unit}`")
            }
            None => format!("docs/src/guide/results.md: no row for `{name}`"),
        })
        .collect()
}

/// Dotted paths of the values, with a word in the place of names that depend on the case.
fn keys(path: &str, value: &Value, found: &mut BTreeSet<Named>) {
    let Value::Object(map) = value else {
        found.insert((path.to_string(), None));
        return;
    };
    for (key, value) in map {
        let key = match path {
            "compactness" => "ZONE",
            "tines" | "sleepers" | "plates" => "BODY",
            "timing.phases" => "PHASE",
            _ => key.as_str(),
        };
        let dot = if path.is_empty() { "" } else { "." };
        keys(&format!("{path}{dot}{key}"), value, found);
    }
}

/// Tables with their columns and blocks with their arrays.
fn content(results: &ResultsReader) -> BTreeSet<Named> {
    let (_, bodies) = results.bodies().unwrap();
    let general = |column: &str| {
        for body in &bodies {
            let role = if body.starts_with("tine") { "TINE" } else { "SLEEPER" };
            if let Some(rest) = column.strip_prefix(&format!("{body}_")) {
                return format!("BODY_{rest}");
            }
            if let Some(zone) = column.strip_suffix(&format!("/{body}")) {
                return format!("{zone}/{role}");
            }
        }
        column.to_string()
    };
    let mut found = BTreeSet::new();
    for table in results.table_names().unwrap() {
        found.insert((format!("{table}.csv"), None));
        let columns = results.table(&table).unwrap().columns;
        found.extend(columns.into_iter().map(|(name, unit)| (general(&name), Some(unit))));
    }
    for block in results.blocks().unwrap() {
        let frame = results.block(&block, 1).unwrap();
        found.insert((block, None));
        let arrays = frame.cell_data.into_iter().chain(frame.point_data);
        found.extend(arrays.map(|array| (array.name, None)));
    }
    found
}

#[test]
fn the_page_names_all_that_a_run_leaves() {
    let place = Place::new();
    place.run("--out run --steps 20").with_code(0);
    let mut wanted = content(&ResultsReader::open(place.path("run/results.vtkhdf")).unwrap());
    keys("", &serde_json::from_str(&place.text("run/summary.json")).unwrap(), &mut wanted);
    for file in std::fs::read_dir(place.path("run")).unwrap() {
        let name = file.unwrap().file_name().into_string().unwrap();
        wanted.extend((name != ".lock").then_some((name, None)));
    }
    for name in ["BODY_force_x", "insertion/TINE", "gap", "solver.visits", "checkpoint.h5"] {
        assert!(wanted.iter().any(|(known, _)| known == name), "{name} in {wanted:?}");
    }
    let objections = missing(PAGE, &wanted);
    assert!(objections.is_empty(), "\n{}", objections.join("\n"));

    // It does object.
    let page =
        PAGE.replace("| `rattlers` |", "| |").replace("| `kinetic` | J |", "| `kinetic` | N |");
    let page = page.replace("minimum.{value,time_s,phase}", "minimum.{value,phase}");
    let row = |of: &str| format!("docs/src/guide/results.md: no row for {of}");
    let objections = [
        "`coordination.minimum.time_s`",
        "`kinetic` with the unit `J`",
        "`rattlers` with the unit ``",
    ];
    assert_eq!(missing(&page, &wanted), objections.map(row));
}
