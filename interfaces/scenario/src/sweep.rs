//! Plans of sweeps: a case and what is changed in it, point by point. Text in, points out.
//!
//! ```toml
//! case = "laptop.toml"                              # relative to the plan
//!
//! [grid]                                            # all combinations, keys in alphabetical order
//! "tamping.vibration.frequency_Hz" = [20, 30, 40]
//! "bed.seed" = [1, 2, 3]
//!
//! [[points]]                                        # and these
//! "tamping.vibration.frequency_Hz" = 35
//! ```
//!
//! A table stands for the paths of its keys: without the quotes it is the same plan.

use crate::read::read_case;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Display;
use toml::{Table, Value};

/// No sweep has as many points: a slip in a grid, which would fill a disk.
const MOST_POINTS: usize = 1_000_000;

/// No key of a case has as many parts.
const MOST_PARTS: usize = 16;

/// What is expected where a path is found twice.
const ONCE: &str = "each key once";

/// Keys of a case, joined by points, and what they become.
pub type Point = Vec<(String, Value)>;

/// Says what is wrong: the place, what was expected, what was found.
type Wrong<'a> = dyn Fn(&str, &str, &dyn Display) -> String + 'a;

/// A sweep that was read.
#[derive(Debug, Clone, PartialEq)]
pub struct Sweep {
    /// Path of the case file, relative to the plan.
    pub case: String,
    pub points: Vec<Point>,
}

impl Sweep {
    /// Reads a plan; `name` stands for it in messages.
    ///
    /// # Errors
    /// What is wrong, with the place, what was expected and what was found.
    pub fn read(text: &str, name: &str) -> Result<Self, String> {
        let wrong = |place: &str, expected: &str, found: &dyn Display| {
            format!("{name}: {place}: expected {expected}, found {found}")
        };
        let plan: Table = text
            .parse()
            .map_err(|e: toml::de::Error| format!("{name}: {}", e.to_string().trim()))?;
        if let Some(key) = plan.keys().find(|k| !["case", "grid", "points"].contains(&k.as_str())) {
            return Err(wrong(key, "one of case, grid, points", &format!("{key:?}")));
        }
        let case = match plan.get("case") {
            Some(Value::String(path)) => path.clone(),
            Some(other) => return Err(wrong("case", "the path of a case file", other)),
            None => return Err(wrong("case", "the path of a case file", &"nothing")),
        };
        let mut points = Vec::new();
        match plan.get("grid") {
            None => {}
            Some(Value::Table(axes)) => points = grid(axes, &wrong)?,
            Some(other) => return Err(wrong("grid", "a table of lists", other)),
        }
        match plan.get("points") {
            None => {}
            Some(Value::Array(given)) => {
                for (i, point) in given.iter().enumerate() {
                    let place = format!("points[{i}]");
                    let Value::Table(point) = point else {
                        return Err(wrong(&place, "a table", point));
                    };
                    points.push(flat(point, &place, &wrong)?.into_iter().collect());
                }
            }
            Some(other) => return Err(wrong("points", "a list of tables", other)),
        }
        if points.is_empty() {
            return Err(wrong("grid, points", "at least one point", &"none"));
        }
        Ok(Self { case, points })
    }
}

fn grid(axes: &Table, wrong: &Wrong) -> Result<Vec<Point>, String> {
    let axes = flat(axes, "grid", wrong)?;
    let mut points: Vec<Point> = vec![vec![]];
    let mut keys = BTreeSet::new();
    for (key, values) in &axes {
        let place = format!("grid.{key:?}");
        let Value::Array(values) = values else {
            return Err(wrong(&place, "a list of values", values));
        };
        if values.is_empty() {
            return Err(wrong(&place, "at least one value", &"none"));
        }
        if points.len().saturating_mul(values.len()) > MOST_POINTS {
            return Err(wrong(&place, &format!("at most {MOST_POINTS} points in all"), &"more"));
        }
        let choice = |value: &Value| {
            let mut found = BTreeMap::new();
            put(value, key.clone(), &place, &mut found, wrong).map(|()| found)
        };
        let choices = values.iter().map(choice).collect::<Result<Vec<_>, _>>()?;
        let of_axis: BTreeSet<String> = choices.iter().flat_map(|c| c.keys().cloned()).collect();
        if let Some(key) = keys.intersection(&of_axis).next() {
            return Err(wrong("grid", ONCE, &format!("{key:?} twice")));
        }
        keys.extend(of_axis);
        let with = |point: &Point, choice: &BTreeMap<String, Value>| {
            let mut point = point.clone();
            point.extend(choice.clone());
            point
        };
        points = points.iter().flat_map(|p| choices.iter().map(|c| with(p, c))).collect();
    }
    Ok(if axes.is_empty() { vec![] } else { points })
}

/// What a table holds under the paths of its keys, in alphabetical order.
fn flat(table: &Table, place: &str, wrong: &Wrong) -> Result<BTreeMap<String, Value>, String> {
    let mut found = BTreeMap::new();
    table.iter().try_for_each(|(key, value)| put(value, key.clone(), place, &mut found, wrong))?;
    Ok(found)
}

/// Adds a value under its path, or what it holds, where it is a table: put in whole, it would take the place of the
/// case's own, with keys that the plan does not name.
fn put(
    value: &Value,
    path: String,
    place: &str,
    found: &mut BTreeMap<String, Value>,
    wrong: &Wrong,
) -> Result<(), String> {
    match value {
        Value::Table(table) if table.is_empty() => {
            Err(wrong(place, "keys with values", &format!("none in {path:?}")))
        }
        Value::Table(table) => table
            .iter()
            .try_for_each(|(key, value)| put(value, format!("{path}.{key}"), place, found, wrong)),
        _ if found.contains_key(&path) => Err(wrong(place, ONCE, &format!("{path:?} twice"))),
        _ => {
            found.insert(path, value.clone());
            Ok(())
        }
    }
}

/// The text of a case with other values; it describes a run.
///
/// # Errors
/// As for [`with_values`]; what is then wrong with the case.
pub fn changed(text: &str, point: &Point, name: &str) -> Result<String, String> {
    let text = with_values(text, point, name)?;
    // Lines of the text that is read here are those of no file.
    read_case(&text, name).map_err(|wrong| {
        let told = wrong.errors.iter().map(|e| format!("{name}: {}", e.without_place()));
        told.collect::<Vec<_>>().join("\n")
    })?;
    Ok(text)
}

/// The text of a case with other values, whatever it then describes; `name` stands for it in messages.
///
/// # Errors
/// A key that leads through something which is no table, or has more parts than any.
pub fn with_values(text: &str, point: &Point, name: &str) -> Result<String, String> {
    let mut case: Table =
        text.parse().map_err(|e: toml::de::Error| format!("{name}: {}", e.to_string().trim()))?;
    for (path, value) in point {
        let parts = path.split('.').count();
        if parts > MOST_PARTS {
            let start: String = path.chars().take(40).collect();
            let expected = format!("a key of at most {MOST_PARTS} parts");
            return Err(format!("{name}: {start}…: expected {expected}, found {parts}"));
        }
        set(&mut case, path, value.clone()).map_err(|key| {
            format!("{name}: {path}: expected a table at {key:?}, found something else")
        })?;
    }
    toml::to_string(&case).map_err(|e| format!("{name}: {e}"))
}

/// Sets a value; where a key on the way is no table, that key.
fn set(table: &mut Table, path: &str, value: Value) -> Result<(), String> {
    match path.split_once('.') {
        None => {
            table.insert(path.to_string(), value);
            Ok(())
        }
        Some((key, rest)) => {
            let below = table.entry(key).or_insert_with(|| Value::Table(Table::new()));
            match below {
                Value::Table(below) => set(below, rest, value),
                _ => Err(key.to_string()),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CASE: &str = include_str!("../../../examples/first.toml");

    #[test]
    fn a_grid_is_all_combinations() {
        let text = "case = 'a.toml'\n[grid]\n'bed.seed' = [1, 2]\n'solver.max_iterations' = [10, 20, 30]\n\
                    [[points]]\n'bed.seed' = 9";
        let sweep = Sweep::read(text, "plan").unwrap();
        assert_eq!((sweep.case.as_str(), sweep.points.len()), ("a.toml", 7));
        let values =
            |i: usize| sweep.points[i].iter().map(|(_, v)| v.to_string()).collect::<Vec<_>>();
        assert_eq!(
            (values(0), values(1), values(6)),
            (vec!["1".into(), "10".into()], vec!["1".into(), "20".into()], vec!["9".into()],)
        );
    }

    #[test]
    fn keys_without_quotes_are_the_same_paths() {
        let read = |points: &str| Sweep::read(&format!("case = 'a'\n{points}"), "plan").unwrap();
        let quoted = read(
            "[grid]\n'bed.seed' = [1]\n'solver.partition.boxes' = [[1, 1, 1]]\n[[points]]\n'solver.partition.boxes' = [2, 1, 1]\n\
             'solver.max_iterations' = 800",
        );
        for other in [
            "[grid]\nsolver.partition.boxes = [[1, 1, 1]]\nbed.seed = [1]\n[[points]]\nsolver.max_iterations = 800\n\
             'solver.partition.boxes' = [2, 1, 1]",
            "[grid]\nsolver = [{ partition = { boxes = [1, 1, 1] } }]\n'bed' = [{ seed = 1 }]\n[[points]]\n\
             [points.solver]\nmax_iterations = 800\npartition.boxes = [2, 1, 1]",
        ] {
            assert_eq!(read(other), quoted, "{other}");
        }
        // The rest of the case's table stays.
        let text =
            with_values(CASE, &read("[[points]]\nsolver.max_iterations = 800").points[0], "point");
        let text = text.unwrap();
        assert!(
            text.contains("max_iterations = 800")
                && text.contains("[solver.penetration_correction]"),
            "{text}"
        );
    }

    #[test]
    fn wrong_plans_are_told() {
        for (text, expected) in [
            ("", "case: expected the path"),
            ("case = 3", "case: expected the path"),
            ("case = 'a'", "at least one point"),
            ("case = 'a'\ncases = 1", "one of case, grid, points"),
            ("case = 'a'\ngrid = 1", "a table of lists"),
            ("case = 'a'\n[grid]\nx = 1", "a list of values"),
            (
                "case = 'a'\n[grid]\nx = []\n[[points]]\nx = 1",
                "grid.\"x\": expected at least one value",
            ),
            ("case = 'a'\npoints = [1]", "points[0]: expected a table"),
            (
                "case = 'a'\n[[points]]\na.b = 1\n'a.b' = 2",
                "points[0]: expected each key once, found \"a.b\" twice",
            ),
            ("case = 'a'\n[grid]\na.b = [1]\n'a.b' = [2]", "grid: expected each key once"),
            ("case = 'a'\n[grid]\na = [{ b = 1 }]\n'a.b' = [2]", "grid: expected each key once"),
            ("case = 'a'\n[grid]\na.b = 1", "grid.\"a.b\": expected a list of values"),
            ("case = 'a'\n[[points]]\na.b = {}", "points[0]: expected keys with values"),
            ("case = 'a", "plan: "),
        ] {
            let told = Sweep::read(text, "plan").unwrap_err();
            assert!(told.contains(expected), "{text:?}: {told}");
        }
        let many: Vec<String> = (0..7).map(|i| format!("a{i} = {:?}", [0; 10])).collect();
        let told = Sweep::read(&format!("case = 'a'\n[grid]\n{}", many.join("\n")), "plan");
        assert!(told.unwrap_err().contains("at most 1000000 points"));
    }

    #[test]
    fn a_point_changes_a_case() {
        let point = vec![("tamping.vibration.frequency_Hz".to_string(), Value::Integer(42))];
        let text = changed(CASE, &point, "point 1").unwrap();
        let plan = read_case(&text, "changed").unwrap().plan;
        assert_eq!(plan.tamping.unwrap().vibration.frequency, 42.0);
        for (key, value, expected) in [
            ("tamping.vibration.frequency_Hz", Value::Integer(-1), "frequency_Hz"),
            ("solver.iteration", Value::Integer(1), "iteration"),
            ("name.first", Value::Integer(1), "expected a table at \"name\""),
        ] {
            let told = changed(CASE, &vec![(key.to_string(), value)], "point 1").unwrap_err();
            assert!(told.contains(expected) && told.starts_with("point 1: "), "{told}");
            assert!(!told.contains("-->") && told.lines().count() == 1, "{told}");
        }
        // More than any stack holds.
        let deep = vec![(["a"; 300_000].join("."), Value::Integer(1))];
        let told = changed(CASE, &deep, "point 1").unwrap_err();
        assert!(told.ends_with("expected a key of at most 16 parts, found 300000"), "{told}");
        assert!(told.len() < 200, "{told}");
        let deep = format!("case = 'a'\n[[points]]\n{} = 1", ["a"; 300_000].join("."));
        assert!(Sweep::read(&deep, "plan").is_err());
    }
}
