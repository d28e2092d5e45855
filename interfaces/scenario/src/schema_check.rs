//! Comparison of a document with the schema: keys, types and ranges, all diagnostics at once.
//!
//! The schema is the one that editors use, so what an editor accepts is accepted here.

use crate::diagnostic::{DiagnosticText, quoted};
use crate::document::find;
use crate::nearest::{did_you_mean, nearest};
use crate::renamed;
use crate::report::DiagnosticReport;
use serde_json::{Map, Value};
use std::ops::Range;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// Adds everything in the document that does not fit `schema` to `report`.
pub fn check(report: &mut DiagnosticReport, schema: &Value) {
    let document = report.document;
    SchemaChecker { report, schema }.table(schema, &document.root, 0..0, "");
}

struct SchemaChecker<'r, 'a, 't, 's> {
    report: &'r mut DiagnosticReport<'a, 't>,
    schema: &'s Value,
}

impl<'s> SchemaChecker<'_, '_, '_, 's> {
    fn table(&mut self, schema: &'s Value, table: &DeTable, span: Range<usize>, path: &str) {
        let Some(properties) = schema["properties"].as_object() else { return };
        let mut misspelt = Vec::new();
        for (name, value) in table {
            // Looking for similar keys is slow.
            if self.report.is_full() {
                return;
            }
            let key = name.get_ref().as_ref();
            match properties.get(key) {
                Some(inner) => self.value(inner, value, name.span(), &join(path, key)),
                None => misspelt.extend(self.unknown_key(key, name.span(), properties, path)),
            }
        }
        for key in schema["required"].as_array().into_iter().flatten().filter_map(Value::as_str) {
            if find(table, key).is_none() && !misspelt.iter().any(|k| k == key) {
                let inner = &properties[key];
                let kind = kind(self.schema, inner);
                let text = DiagnosticText {
                    problem: format!("missing key `{key}`"),
                    expected: format!("`{key}`: {kind}{}", self.meaning(inner)),
                    ..DiagnosticText::default()
                };
                self.report.error_at(span.clone(), join(path, key), text);
            }
        }
    }

    /// Reports an unknown key; returns the known key that was probably meant.
    fn unknown_key(
        &mut self,
        key: &str,
        span: Range<usize>,
        properties: &Map<String, Value>,
        path: &str,
    ) -> Option<String> {
        let known = || properties.keys().map(String::as_str);
        let list: Vec<String> = known().map(|k| format!("`{k}`")).collect();
        let path_of_key = join(path, key);
        let (hint, meant) = match (renamed::key(&path_of_key), self.sections_with(key).as_slice()) {
            (Some(new), _) => {
                let old = renamed::without_indices(&path_of_key);
                (Some(format!("`{old}` is now `{new}`")), Some(last(&new).to_string()))
            }
            (None, []) => (did_you_mean(key, known()), None),
            // A key of another section is hardly a misspelling of one here.
            (None, homes) => (Some(format!("`{key}` belongs in {}", homes.join(" or "))), None),
        };
        let text = DiagnosticText {
            problem: format!("unknown key {}", quoted(key)),
            found: String::new(),
            expected: format!("one of {}", list.join(", ")),
            hint,
        };
        self.report.error_at(span, join(path, &quoted(key).replace('`', "")), text);
        meant.or_else(|| nearest(key, known()).map(str::to_string))
    }

    /// Returns the sections of a case that have `key`.
    fn sections_with(&self, key: &str) -> Vec<String> {
        let mut sections = Vec::new();
        let mut open = vec![(String::new(), self.schema)];
        while let Some((path, schema)) = open.pop() {
            for (name, inner) in schema["properties"].as_object().into_iter().flatten() {
                if name == key {
                    sections.push(match path.as_str() {
                        "" => "the top of the file".to_string(),
                        path => format!("`[{path}]`"),
                    });
                }
                open.push((join(&path, name), resolve(self.schema, inner)));
            }
        }
        sections.sort();
        sections
    }

    fn value(
        &mut self,
        schema: &'s Value,
        value: &Spanned<DeValue>,
        name: Range<usize>,
        path: &str,
    ) {
        if self.report.is_full() {
            return;
        }
        let resolved = resolve(self.schema, schema);
        let span = value.span();
        match (resolved["type"].as_str(), value.get_ref()) {
            (Some("object"), DeValue::Table(table)) => self.table(resolved, table, name, path),
            (Some("array"), DeValue::Array(items)) => {
                let limit = |key: &str| resolved[key].as_u64().map(|n| n as usize);
                if limit("minItems").is_some_and(|n| items.len() < n)
                    || limit("maxItems").is_some_and(|n| items.len() > n)
                {
                    self.wrong(schema, value, path, "has the wrong number of entries");
                    return;
                }
                for (i, item) in items.iter().enumerate() {
                    let path = format!("{path}[{i}]");
                    self.value(&resolved["items"], item, item.span(), &path);
                }
            }
            (Some("number"), DeValue::Integer(_) | DeValue::Float(_)) => {
                self.number(schema, value, path);
            }
            (Some("integer"), DeValue::Integer(_)) => self.number(schema, value, path),
            (Some("boolean"), DeValue::Boolean(_)) => {}
            (Some("string"), DeValue::String(_)) => {}
            (None, DeValue::String(word)) => {
                let words = choices(resolved);
                if !words.is_empty() && !words.contains(&word.as_ref()) {
                    let present = renamed::value(word).filter(|new| words.contains(new));
                    let text = DiagnosticText {
                        problem: format!("unknown value of `{}`", last(path)),
                        found: self.report.document.quote(span.clone()),
                        expected: one_of(&words),
                        hint: present
                            .map(|new| format!("`\"{word}\"` is now `\"{new}\"`"))
                            .or_else(|| did_you_mean(word, words)),
                    };
                    self.report.error_at(span, path.to_string(), text);
                }
            }
            _ => self.wrong(schema, value, path, "has the wrong type"),
        }
    }

    fn number(&mut self, schema: &'s Value, value: &Spanned<DeValue>, path: &str) {
        let resolved = resolve(self.schema, schema);
        let number = match value.get_ref() {
            DeValue::Integer(i) => {
                i64::from_str_radix(i.as_str(), i.radix()).map(|i| i as f64).ok()
            }
            DeValue::Float(f) => f.as_str().parse::<f64>().ok(),
            _ => None,
        };
        let limit = |key: &str| resolved[key].as_f64();
        let may_be_infinite = resolved["x-infinite"].as_bool().unwrap_or(false);
        let fits = number.is_some_and(|x| {
            let is_within = x.is_finite()
                && limit("minimum").is_none_or(|m| x >= m)
                && limit("exclusiveMinimum").is_none_or(|m| x > m)
                && limit("maximum").is_none_or(|m| x <= m);
            is_within || may_be_infinite && x == f64::INFINITY
        });
        if !fits {
            // Limits that `limits` does not show.
            let problem = match (number, limit("maximum")) {
                (Some(f64::INFINITY), None) => "is not finite".into(),
                (Some(x), Some(max)) if x > max && max >= MIN_STORAGE_LIMIT => {
                    format!("is more than {max}")
                }
                // TOML's own integers end there.
                (None, Some(max)) if max >= MIN_STORAGE_LIMIT => {
                    format!("is no number up to {}", resolved["maximum"])
                }
                _ => "is out of range".to_string(),
            };
            self.wrong(schema, value, path, &problem);
        }
    }

    fn wrong(&mut self, schema: &'s Value, value: &Spanned<DeValue>, path: &str, problem: &str) {
        let quote = self.report.document.quote(value.span());
        let found = match value.get_ref() {
            DeValue::Table(_) => "a table".to_string(),
            DeValue::Array(items) => format!("a list of {}", items.len()),
            DeValue::String(_) => format!("the text {quote}"),
            _ => quote,
        };
        let is_quoted_number = matches!(value.get_ref(), DeValue::String(s)
            if s.trim_start().starts_with(|c: char| c.is_ascii_digit() || "+-.".contains(c)));
        let text = DiagnosticText {
            problem: format!("`{}` {problem}", last(path)),
            found,
            expected: format!("{}{}", kind(self.schema, schema), self.meaning(schema)),
            hint: is_quoted_number
                .then(|| "write the number without quotes; the key's name has its unit".into()),
        };
        self.report.error_at(value.span(), path.to_string(), text);
    }

    /// Returns the first sentence of a key's description.
    fn meaning(&self, schema: &Value) -> String {
        let text = schema["description"].as_str().unwrap_or_default().replace('\n', " ");
        match text.split(". ").next().map(|s| s.trim_end_matches('.')) {
            None | Some("") => String::new(),
            Some(sentence) => format!(" — {sentence}"),
        }
    }
}

/// Returns the definition that a `$ref` names, or `schema` itself.
pub fn resolve<'s>(root: &'s Value, schema: &'s Value) -> &'s Value {
    schema["$ref"].as_str().and_then(|r| root.pointer(r.trim_start_matches('#'))).unwrap_or(schema)
}

/// Describes the values that `schema` accepts.
pub fn kind(root: &Value, schema: &Value) -> String {
    let schema = resolve(root, schema);
    let words = choices(schema);
    match schema["type"].as_str() {
        None if !words.is_empty() => one_of(&words),
        Some("object") => "a table".into(),
        Some("boolean") => "true or false".into(),
        Some("string") => "a text in quotes".into(),
        Some("array") => {
            let count = match (schema["minItems"].as_u64(), schema["maxItems"].as_u64()) {
                (Some(a), Some(b)) if a == b => format!("{a} "),
                (Some(a), Some(b)) => format!("{a} to {b} "),
                (None, Some(b)) => format!("up to {b} "),
                _ => String::new(),
            };
            format!("a list of {count}entries, each {}", kind(root, &schema["items"]))
        }
        Some("integer") => format!("a whole number{}", limits(schema)),
        Some("number") => format!("a number{}", limits(schema)),
        _ => "another value".into(),
    }
}

/// Smallest maximum that only keeps a number storable. Descriptions omit such maxima.
const MIN_STORAGE_LIMIT: f64 = 4e9;

fn limits(schema: &Value) -> String {
    let bound = |key: &str| schema.get(key).filter(|v| v.is_number()).map(Value::to_string);
    let max = bound("maximum").filter(|_| schema["maximum"].as_f64() < Some(MIN_STORAGE_LIMIT));
    match (bound("exclusiveMinimum"), bound("minimum"), max) {
        (Some(a), _, Some(b)) => format!(" above {a} and up to {b}"),
        (Some(a), _, None) => format!(" above {a}"),
        (None, Some(a), Some(b)) => format!(" from {a} to {b}"),
        (None, Some(a), None) => format!(", {a} or more"),
        _ => String::new(),
    }
}

/// Returns the words of an enumeration.
fn choices(schema: &Value) -> Vec<&str> {
    let plain = schema["enum"].as_array().into_iter().flatten();
    let described = schema["oneOf"].as_array().into_iter().flatten().map(|c| &c["const"]);
    plain.chain(described).filter_map(Value::as_str).collect()
}

fn one_of(words: &[&str]) -> String {
    let list: Vec<String> = words.iter().map(|w| format!("\"{w}\"")).collect();
    format!("one of {}", list.join(", "))
}

fn join(path: &str, key: &str) -> String {
    if path.is_empty() { key.to_string() } else { format!("{path}.{key}") }
}

fn last(path: &str) -> &str {
    path.rsplit('.').next().unwrap_or(path)
}
