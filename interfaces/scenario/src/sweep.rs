//! Sweep plans: a case and the values that each point changes.
//!
//! ```toml
//! case = "laptop.toml"                              # relative to the plan
//!
//! [grid]                                            # all combinations, keys in alphabetical order
//! "tamping.vibration.frequency_Hz" = [20, 30, 40]
//! "bed.seed" = [1, 2, 3]
//!
//! [[points]]                                        # single points in addition
//! "tamping.vibration.frequency_Hz" = 35
//! ```
//!
//! A table stands for the paths of its keys: the plan without quotes is the same.

use crate::diagnostic::CaseErrors;
use crate::document::CaseDocument;
use crate::read_case::read_case;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Display;
use toml::{Table, Value};

/// Maximum number of points of a sweep: more are a mistake in a grid, which would fill a disk.
const MAX_POINTS: usize = 1_000_000;

/// Maximum number of segments of a key.
const MAX_SEGMENTS: usize = 16;

/// Expectation that a path given twice violates.
const ONCE: &str = "each key once";

/// Changed keys of a case, as dotted paths, and their values.
pub type SweepPoint = Vec<(String, Value)>;

/// Case and points of a sweep.
#[derive(Debug, Clone, PartialEq)]
pub struct SweepPlan {
    /// Path of the case file, relative to the plan.
    pub case: String,
    /// Points of the grid, then single points; at least one.
    pub points: Vec<SweepPoint>,
}

impl SweepPlan {
    /// Parses a sweep plan; `name` stands for it in messages.
    ///
    /// # Errors
    /// A message with the position, the expected and the found value.
    pub fn parse(text: &str, name: &str) -> Result<Self, String> {
        let plan = parse_table(text, name)?;
        Self::read(&plan).map_err(|error| format!("{name}: {error}"))
    }

    fn read(plan: &Table) -> Result<Self, String> {
        if let Some(key) = plan.keys().find(|k| !["case", "grid", "points"].contains(&k.as_str())) {
            return Err(mismatch(key, "one of case, grid, points", &format!("{key:?}")));
        }
        let case = match plan.get("case") {
            Some(Value::String(path)) => path.clone(),
            Some(other) => return Err(mismatch("case", "the path of a case file", other)),
            None => return Err(mismatch("case", "the path of a case file", &"nothing")),
        };
        let mut points = match plan.get("grid") {
            None => Vec::new(),
            Some(Value::Table(axes)) => grid_points(axes)?,
            Some(other) => return Err(mismatch("grid", "a table of lists", other)),
        };
        match plan.get("points") {
            None => {}
            Some(Value::Array(tables)) => {
                for (i, table) in tables.iter().enumerate() {
                    let place = format!("points[{i}]");
                    let Value::Table(table) = table else {
                        return Err(mismatch(&place, "a table", table));
                    };
                    points.push(flatten(table, &place)?.into_iter().collect());
                }
            }
            Some(other) => return Err(mismatch("points", "a list of tables", other)),
        }
        if points.is_empty() {
            return Err(mismatch("grid, points", "at least one point", &"none"));
        }
        Ok(Self { case, points })
    }

    /// Returns the text of the case of each point, after checking all of them. `case_name` and `plan_name` stand for the
    /// files in messages.
    ///
    /// # Errors
    /// A case that is not TOML; all errors of the first changed case that is invalid.
    pub fn case_texts(
        &self,
        case: &str,
        case_name: &str,
        plan_name: &str,
    ) -> Result<Vec<String>, String> {
        let case = parse_table(case, case_name)?;
        let text = |(number, point): (usize, &SweepPoint)| {
            checked_text(case.clone(), point, &format!("{plan_name}, point {number}"))
        };
        (1..).zip(&self.points).map(text).collect()
    }
}

/// Parses a file in TOML; `name` stands for it in messages.
fn parse_table(text: &str, name: &str) -> Result<Table, String> {
    let document = CaseDocument::parse(text, name);
    document.map_err(|errors| CaseErrors { errors }.to_string())?;
    text.parse().map_err(|e: toml::de::Error| format!("{name}: {}", e.message().trim()))
}

fn mismatch(place: &str, expected: &str, found: &dyn Display) -> String {
    format!("{place}: expected {expected}, found {found}")
}

/// Returns all combinations of the values of a grid.
fn grid_points(axes: &Table) -> Result<Vec<SweepPoint>, String> {
    let axes = flatten(axes, "grid")?;
    if axes.is_empty() {
        return Ok(Vec::new());
    }
    let mut points: Vec<SweepPoint> = vec![vec![]];
    let mut keys = BTreeSet::new();
    for (key, values) in &axes {
        let place = format!("grid.{key:?}");
        let Value::Array(values) = values else {
            return Err(mismatch(&place, "a list of values", values));
        };
        if values.is_empty() {
            return Err(mismatch(&place, "at least one value", &"none"));
        }
        if points.len().saturating_mul(values.len()) > MAX_POINTS {
            return Err(mismatch(&place, &format!("at most {MAX_POINTS} points in all"), &"more"));
        }
        let flat_value = |value: &Value| {
            let mut flat = BTreeMap::new();
            insert_flat(value, key.clone(), &place, &mut flat).map(|()| flat)
        };
        let choices = values.iter().map(flat_value).collect::<Result<Vec<_>, _>>()?;
        let axis_keys: BTreeSet<String> = choices.iter().flat_map(|c| c.keys().cloned()).collect();
        if let Some(key) = keys.intersection(&axis_keys).next() {
            return Err(mismatch("grid", ONCE, &format!("{key:?} twice")));
        }
        keys.extend(axis_keys);
        let extend = |point: &SweepPoint, choice: &BTreeMap<String, Value>| {
            let mut point = point.clone();
            point.extend(choice.clone());
            point
        };
        points = points.iter().flat_map(|p| choices.iter().map(|c| extend(p, c))).collect();
    }
    Ok(points)
}

/// Returns the values of a table under the paths of their keys, in alphabetical order.
fn flatten(table: &Table, place: &str) -> Result<BTreeMap<String, Value>, String> {
    let mut flat = BTreeMap::new();
    table.iter().try_for_each(|(key, value)| insert_flat(value, key.clone(), place, &mut flat))?;
    Ok(flat)
}

/// Inserts a value under its path, and a table value by value. A whole table would replace that of the case, with keys
/// that the plan does not have.
fn insert_flat(
    value: &Value,
    path: String,
    place: &str,
    flat: &mut BTreeMap<String, Value>,
) -> Result<(), String> {
    match value {
        Value::Table(table) if table.is_empty() => {
            Err(mismatch(place, "keys with values", &format!("none in {path:?}")))
        }
        Value::Table(table) => table
            .iter()
            .try_for_each(|(key, value)| insert_flat(value, format!("{path}.{key}"), place, flat)),
        _ if flat.contains_key(&path) => Err(mismatch(place, ONCE, &format!("{path:?} twice"))),
        _ => {
            flat.insert(path, value.clone());
            Ok(())
        }
    }
}

/// Returns the text of a case with the values of `point`, after checking the case.
fn checked_text(case: Table, point: &SweepPoint, name: &str) -> Result<String, String> {
    let text = text_with(case, point, name)?;
    // The lines of this text are in no file.
    read_case(&text, name).map_err(|case| {
        let errors = case.errors.iter().map(|e| format!("{name}: {}", e.without_position()));
        errors.collect::<Vec<_>>().join("\n")
    })?;
    Ok(text)
}

/// Returns the text of a case with the values of `point`, without checking it; `name` stands for it in messages.
///
/// # Errors
/// A text that is not TOML; a key with a segment that is no table, or with too many segments.
pub fn set_values(text: &str, point: &SweepPoint, name: &str) -> Result<String, String> {
    text_with(parse_table(text, name)?, point, name)
}

fn text_with(mut case: Table, point: &SweepPoint, name: &str) -> Result<String, String> {
    for (path, value) in point {
        let segments = path.split('.').count();
        if segments > MAX_SEGMENTS {
            let start: String = path.chars().take(40).collect();
            let expected = format!("a key of at most {MAX_SEGMENTS} parts");
            return Err(format!("{name}: {start}…: expected {expected}, found {segments}"));
        }
        set_value(&mut case, path, value.clone()).map_err(|key| {
            format!("{name}: {path}: expected a table at {key:?}, found something else")
        })?;
    }
    toml::to_string(&case).map_err(|e| format!("{name}: {e}"))
}

/// Sets the value at `path`; returns the first key on the path that is no table as an error.
fn set_value(table: &mut Table, path: &str, value: Value) -> Result<(), String> {
    match path.split_once('.') {
        None => {
            table.insert(path.to_string(), value);
            Ok(())
        }
        Some((key, rest)) => match table.entry(key).or_insert_with(|| Value::Table(Table::new())) {
            Value::Table(below) => set_value(below, rest, value),
            _ => Err(key.to_string()),
        },
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
        let sweep = SweepPlan::parse(text, "plan").unwrap();
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
        let read =
            |points: &str| SweepPlan::parse(&format!("case = 'a'\n{points}"), "plan").unwrap();
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
            set_values(CASE, &read("[[points]]\nsolver.max_iterations = 800").points[0], "point");
        let text = text.unwrap();
        assert!(
            text.contains("max_iterations = 800")
                && text.contains("[solver.penetration_correction]"),
            "{text}"
        );
    }

    #[test]
    fn invalid_plans_are_refused() {
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
            ("case = 'a", "not TOML"),
        ] {
            let error = SweepPlan::parse(text, "plan").unwrap_err();
            assert!(error.contains(expected), "{text:?}: {error}");
        }
        let many: Vec<String> = (0..7).map(|i| format!("a{i} = {:?}", [0; 10])).collect();
        let error = SweepPlan::parse(&format!("case = 'a'\n[grid]\n{}", many.join("\n")), "plan");
        assert!(error.unwrap_err().contains("at most 1000000 points"));
    }

    #[test]
    fn foreign_notations_are_named() {
        let grid = |value: &str| format!("case = 'a'\n[grid]\n'bed.seed' = {value}\n");
        for (text, problem, expected) in [
            ("case = “a.toml”".into(), "quotation marks", "\"a.toml\""),
            (grid("[0.1 s]"), "value with a unit", "the number alone"),
            (grid("[0,3; 0,2]"), "decimal comma", "[0.3, 0.2]"),
            (grid("[1;2]"), "semicolon", "commas between entries"),
            ("case\u{a0}= 'a'".into(), "no-break space", ""),
        ] {
            let error = SweepPlan::parse(&text, "plan.toml").unwrap_err();
            assert!(error.contains(problem) && error.contains(expected), "{text}: {error}");
            assert!(error.contains("--> plan.toml:"), "{error}");
            assert!(!error.contains("TOML parse error"), "{error}");
        }
        let plan = SweepPlan::parse("case = 'a'\n[[points]]\nx = 1", "plan.toml").unwrap();
        let error = plan.case_texts("name = “a”", "a.toml", "plan.toml").unwrap_err();
        assert!(error.contains("--> a.toml:1:8"), "{error}");
    }

    /// Text of the first point of a plan with one point.
    fn apply_point(case: &str, point: SweepPoint) -> Result<String, String> {
        let plan = SweepPlan { case: "a.toml".into(), points: vec![point] };
        Ok(plan.case_texts(case, "a.toml", "plan")?.remove(0))
    }

    #[test]
    fn a_point_changes_a_case() {
        let point = vec![("tamping.vibration.frequency_Hz".to_string(), Value::Integer(42))];
        let text = apply_point(CASE, point).unwrap();
        let plan = read_case(&text, "point").unwrap().plan;
        assert_eq!(plan.tamping.unwrap().vibration.frequency, 42.0);
        for (key, value, expected) in [
            ("tamping.vibration.frequency_Hz", Value::Integer(-1), "frequency_Hz"),
            ("solver.iteration", Value::Integer(1), "iteration"),
            ("name.first", Value::Integer(1), "expected a table at \"name\""),
        ] {
            let error = apply_point(CASE, vec![(key.to_string(), value)]).unwrap_err();
            assert!(error.contains(expected) && error.starts_with("plan, point 1: "), "{error}");
            assert!(!error.contains("-->") && error.lines().count() == 1, "{error}");
        }
        // More than any stack holds.
        let deep = vec![(["a"; 300_000].join("."), Value::Integer(1))];
        let error = apply_point(CASE, deep).unwrap_err();
        assert!(error.ends_with("expected a key of at most 16 parts, found 300000"), "{error}");
        assert!(error.len() < 200, "{error}");
        let deep = format!("case = 'a'\n[[points]]\n{} = 1", ["a"; 300_000].join("."));
        assert!(SweepPlan::parse(&deep, "plan").is_err());
    }
}
