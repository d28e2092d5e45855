//! JSON Schema of case files, generated from the types that read them.

use crate::case_file::CaseFile;
use serde_json::Value;

/// Returns the JSON Schema (2020-12) of case files, for editors and for the reader's own checks.
pub fn schema() -> Value {
    let mut schema = schemars::schema_for!(CaseFile).to_value();
    remove_null(&mut schema);
    schema
}

/// Removes `null` from types and defaults: TOML has no null, an optional key is absent.
fn remove_null(value: &mut Value) {
    match value {
        Value::Object(map) => {
            if map.get("default").is_some_and(Value::is_null) {
                map.remove("default");
            }
            if let Some(Value::Array(types)) = map.get_mut("type") {
                types.retain(|t| t != "null");
                if let [only] = types.as_slice() {
                    let only = only.clone();
                    map.insert("type".into(), only);
                }
            }
            if let Some(Value::Array(choices)) = map.get_mut("anyOf") {
                choices.retain(|c| c.get("type").is_none_or(|t| t != "null"));
                if choices.len() == 1
                    && let Some(Value::Object(only)) = choices.pop()
                {
                    map.remove("anyOf");
                    map.extend(only);
                }
            }
            if let Some(Value::Object(default)) = map.get_mut("default") {
                default.retain(|_, v| !v.is_null());
            }
            map.values_mut().for_each(remove_null);
        }
        Value::Array(items) => items.iter_mut().for_each(remove_null),
        _ => {}
    }
}
