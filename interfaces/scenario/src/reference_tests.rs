//! The reference page of case keys in the book, generated from the JSON Schema.

use crate::schema::schema;
use crate::schema_check::{kind, resolve};
use serde_json::{Map, Value};

const PAGE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/src/reference/cases.md");
/// Lines of the page around the generated part.
const MARKS: [&str; 2] = [
    "<!-- Generated from the schema; BALLAST_WRITE_DOCS=1 cargo test -p ballast-scenario rewrites it. -->\n",
    "<!-- End of the generated part. -->\n",
];
/// Tables in the order in which a case is usually written; the schema has them in alphabetical order.
const TABLES: [&str; 9] =
    ["bed", "sleepers", "sleeper", "tines", "tine", "plate", "tamping", "run", "solver"];

#[test]
fn the_reference_page_matches_the_schema() {
    let page = std::fs::read_to_string(PAGE).expect(PAGE);
    let [begin, end] = MARKS.map(|mark| page.find(mark).expect(mark));
    let (before, after) = (&page[..begin + MARKS[0].len()], &page[end..]);
    let expected = format!("{before}\n{}{after}", reference(&schema()));
    if std::env::var_os("BALLAST_WRITE_DOCS").is_some() {
        std::fs::write(PAGE, expected).expect(PAGE);
    } else {
        assert!(
            page == expected,
            "docs/src/reference/cases.md differs from the schema: set BALLAST_WRITE_DOCS=1"
        );
    }
}

/// Table of a case file: all its names, and its schema.
struct ReferenceTable<'s> {
    headings: Vec<String>,
    schema: &'s Value,
}

fn reference(root: &Value) -> String {
    let top = ReferenceTable { headings: vec!["Top of the file".into()], schema: root };
    let mut tables = vec![top];
    collect(root, root, "", &mut tables);
    tables.iter().map(|table| section(root, table)).collect()
}

/// Adds the tables inside `schema`, which is at `path`; a table that is known already gets another name.
fn collect<'s>(
    root: &'s Value,
    schema: &'s Value,
    path: &str,
    tables: &mut Vec<ReferenceTable<'s>>,
) {
    for (key, inner) in keys(root, schema) {
        let Some((heading, schema)) = table_at(root, inner, path, key) else { continue };
        match tables.iter_mut().find(|known| std::ptr::eq(known.schema, schema)) {
            Some(known) => known.headings.push(heading),
            None => tables.push(ReferenceTable { headings: vec![heading], schema }),
        }
        collect(root, schema, &join(path, key), tables);
    }
}

/// Returns name and schema of the table, or of each table of the list, under `key`.
fn table_at<'s>(
    root: &'s Value,
    inner: &'s Value,
    path: &str,
    key: &str,
) -> Option<(String, &'s Value)> {
    let (value, path) = (resolve(root, inner), join(path, key));
    let item = resolve(root, &value["items"]);
    let is_table = |schema: &Value| schema["properties"].is_object();
    if is_table(value) {
        return Some((format!("`[{path}]`"), value));
    }
    is_table(item).then(|| (format!("`[[{path}]]`"), item))
}

fn join(path: &str, key: &str) -> String {
    if path.is_empty() { key.into() } else { format!("{path}.{key}") }
}

/// Returns keys and their schemas: required ones first, top-level tables last in their order.
fn keys<'s>(root: &Value, schema: &'s Value) -> Vec<(&'s str, &'s Value)> {
    let properties: &Map<String, Value> = schema["properties"].as_object().expect("a table");
    let mut keys: Vec<(&str, &Value)> = properties.iter().map(|(k, v)| (k.as_str(), v)).collect();
    let is_top = std::ptr::eq(root, schema);
    keys.sort_by_key(|(key, _)| {
        let table = TABLES.iter().position(|table| is_top && table == key);
        (table, !is_needed(schema, key))
    });
    keys
}

fn is_needed(schema: &Value, key: &str) -> bool {
    schema["required"].as_array().into_iter().flatten().any(|k| k == key)
}

/// Returns heading, description, keys, and the meaning of enumerated values.
fn section(root: &Value, table: &ReferenceTable) -> String {
    let ReferenceTable { headings, schema } = table;
    let mut text = format!("## {}\n\n{}\n\n", headings.join(" and "), described(schema));
    text += "| key | takes | default | meaning |\n|---|---|---|---|\n";
    let mut words: Vec<(&Value, Vec<String>)> = Vec::new();
    let path = headings[0].trim_matches(['`', '[', ']']);
    let path = if std::ptr::eq(*schema, root) { "" } else { path };
    for (key, inner) in keys(root, schema) {
        let inside = table_at(root, inner, path, key);
        let name = inside.as_ref().map(|(heading, _)| format!(": {heading}")).unwrap_or_default();
        let takes = format!("{}{name}", kind(root, inner));
        let default = match &inner["default"] {
            _ if is_needed(schema, key) => "needed".into(),
            Value::Object(_) => "its defaults".into(),
            Value::Array(items) if items.is_empty() => "none".into(),
            Value::Null => "absent".into(),
            value => format!("`{}`", toml::Value::try_from(value).expect("a value of TOML")),
        };
        let meaning = described(inner).replace('\n', " ").replace('|', "\\|");
        text += &format!("| `{key}` | {takes} | {default} | {meaning} |\n");
        let resolved = resolve(root, inner);
        if resolved["oneOf"].is_array() {
            match words.iter_mut().find(|(known, _)| std::ptr::eq(*known, resolved)) {
                Some((_, keys)) => keys.push(format!("`{key}`")),
                None => words.push((resolved, vec![format!("`{key}`")])),
            }
        }
    }
    for (words, keys) in words {
        text += &format!("\n{}:\n\n", keys.join(", "));
        for word in words["oneOf"].as_array().into_iter().flatten() {
            text += &format!("* `{}`: {}\n", word["const"], described(word));
        }
    }
    text + "\n"
}

fn described(schema: &Value) -> &str {
    schema["description"].as_str().unwrap_or_default()
}
