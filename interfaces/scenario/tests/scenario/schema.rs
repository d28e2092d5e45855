//! JSON Schema of case files.

use ballast_scenario::schema;
use serde_json::Value;

/// Calls `with` for every schema object inside `value`, with its path.
fn visit(value: &Value, path: &str, with: &mut impl FnMut(&str, &Value)) {
    with(path, value);
    match value {
        Value::Object(map) => map.iter().for_each(|(k, v)| visit(v, &format!("{path}/{k}"), with)),
        Value::Array(items) => items.iter().for_each(|v| visit(v, path, with)),
        _ => {}
    }
}

#[test]
fn every_key_is_described_and_has_a_type_or_a_definition() {
    let schema = schema();
    let mut keys = 0;
    visit(&schema, "", &mut |path, value| {
        for (key, inner) in value["properties"].as_object().into_iter().flatten() {
            keys += 1;
            assert!(inner["description"].is_string(), "{path}/{key} has no description");
            let typed = inner["type"].is_string() || inner["$ref"].is_string();
            assert!(typed, "{path}/{key}: {inner}");
            if let Some(target) = inner["$ref"].as_str() {
                assert!(schema.pointer(target.trim_start_matches('#')).is_some(), "{target}");
            }
        }
    });
    assert!(keys > 70, "{keys}");
}

#[test]
fn no_object_takes_unknown_keys_and_nothing_may_be_null() {
    visit(&schema(), "", &mut |path, value| {
        if value["properties"].is_object() && value["type"] == "object" {
            assert_eq!(value["additionalProperties"], false, "{path}");
        }
        assert!(!value.is_null(), "{path}");
    });
}

#[test]
fn every_key_is_required_or_has_a_default_or_a_meaning_of_its_absence() {
    let schema = schema();
    visit(&schema, "", &mut |path, value| {
        let required: Vec<&str> =
            value["required"].as_array().into_iter().flatten().filter_map(Value::as_str).collect();
        for (key, inner) in value["properties"].as_object().into_iter().flatten() {
            let description = inner["description"].as_str().unwrap_or_default();
            let has_meaning =
                ["Absent", "Without", "Needed"].iter().any(|w| description.contains(w));
            assert!(
                required.contains(&key.as_str()) || inner.get("default").is_some() || has_meaning,
                "{path}/{key}: {inner}"
            );
        }
    });
}
