//! Compares a document with the schema: keys, types and ranges, all findings at once.
//!
//! The schema is the one that editors use, so what an editor accepts is accepted here.

use crate::diagnostic::quoted;
use crate::document::find;
use crate::nearest::{did_you_mean, nearest};
use crate::renamed;
use crate::report::{Finding, MOST, Report};
use serde_json::{Map, Value};
use std::ops::Range;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// Adds everything in the document that does not fit `schema` to `report`.
pub fn check(report: &mut Report, schema: &Value) {
    let document = report.document;
    let mut walker = Walker { report, schema };
    walker.table(schema, &document.root, 0..0, "");
}

struct Walker<'r, 'a, 't, 's> {
    report: &'r mut Report<'a, 't>,
    schema: &'s Value,
}

impl<'s> Walker<'_, '_, '_, 's> {
    fn table(&mut self, schema: &'s Value, table: &DeTable, place: Range<usize>, path: &str) {
        let Some(properties) = schema["properties"].as_object() else { return };
        let mut misspelt = Vec::new();
        for (name, value) in table {
            // To look for what may be meant takes its time.
            if self.report.is_full() {
                return;
            }
            let key = name.get_ref().as_ref();
            match properties.get(key) {
                Some(inner) => self.value(inner, value, name.span(), &join(path, key)),
                None => {
                    let renamed = renamed::key(&join(path, key));
                    let meant =
                        renamed.as_deref().map(last).and_then(|k| properties.get_key_value(k));
                    let meant = meant.map(|(k, _)| k.as_str());
                    misspelt.extend(
                        meant.or_else(|| nearest(key, properties.keys().map(String::as_str))),
                    );
                    self.unknown(key, name.span(), properties, path);
                }
            }
        }
        for key in schema["required"].as_array().into_iter().flatten().filter_map(Value::as_str) {
            if find(table, key).is_none() && !misspelt.contains(&key) {
                let inner = &properties[key];
                let finding = Finding {
                    problem: format!("missing key `{key}`"),
                    expected: format!(
                        "`{key}`: {}{}",
                        kind(self.schema, inner),
                        self.meaning(inner)
                    ),
                    ..Finding::default()
                };
                self.at(place.clone(), join(path, key), finding);
            }
        }
    }

    fn unknown(
        &mut self,
        key: &str,
        place: Range<usize>,
        properties: &Map<String, Value>,
        path: &str,
    ) {
        let known = properties.keys().map(String::as_str);
        let list: Vec<String> = known.clone().map(|k| format!("`{k}`")).collect();
        let old = join(path, key);
        let hint = match (renamed::key(&old), self.homes(key).as_slice()) {
            (Some(new), _) => Some(format!("`{}` is now `{new}`", renamed::without_indices(&old))),
            (None, []) => did_you_mean(key, known),
            // A key of another section is hardly a misspelling of one here.
            (None, homes) => Some(format!("`{key}` belongs in {}", homes.join(" or "))),
        };
        let finding = Finding {
            problem: format!("unknown key {}", quoted(key)),
            found: String::new(),
            expected: format!("one of {}", list.join(", ")),
            hint,
        };
        self.at(place, join(path, &quoted(key).replace('`', "")), finding);
    }

    /// Sections that know `key`.
    fn homes(&self, key: &str) -> Vec<String> {
        let mut homes = Vec::new();
        let mut open = vec![(String::new(), self.schema)];
        while let Some((path, schema)) = open.pop() {
            for (name, inner) in schema["properties"].as_object().into_iter().flatten() {
                if name == key {
                    homes.push(match path.as_str() {
                        "" => "the top of the file".to_string(),
                        path => format!("`[{path}]`"),
                    });
                }
                open.push((join(&path, name), resolve(self.schema, inner)));
            }
        }
        homes.sort();
        homes
    }

    fn value(
        &mut self,
        schema: &'s Value,
        value: &Spanned<DeValue>,
        name: Range<usize>,
        path: &str,
    ) {
        if self.report.errors.len() >= MOST {
            return;
        }
        let resolved = resolve(self.schema, schema);
        let span = value.span();
        match (resolved["type"].as_str(), value.get_ref()) {
            (Some("object"), DeValue::Table(table)) => self.table(resolved, table, name, path),
            (Some("array"), DeValue::Array(items)) => {
                let limit = |key: &str| resolved[key].as_u64().map(|n| n as usize);
                let (least, most) = (limit("minItems"), limit("maxItems"));
                if least.is_some_and(|n| items.len() < n) || most.is_some_and(|n| items.len() > n) {
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
                    let list: Vec<String> = words.iter().map(|w| format!("\"{w}\"")).collect();
                    let finding = Finding {
                        problem: format!("unknown value of `{}`", last(path)),
                        found: self.report.document.quote(span.clone()),
                        expected: format!("one of {}", list.join(", ")),
                        hint: renamed::value(word)
                            .filter(|new| words.contains(new))
                            .map(|new| format!("`\"{word}\"` is now `\"{new}\"`"))
                            .or_else(|| did_you_mean(word, words)),
                    };
                    self.at(span, path.to_string(), finding);
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
        let infinite = resolved["x-infinite"].as_bool().unwrap_or(false);
        let fits = number.is_some_and(|x| {
            (x.is_finite() || infinite && x == f64::INFINITY)
                && limit("minimum").is_none_or(|m| x >= m)
                && limit("exclusiveMinimum").is_none_or(|m| x > m)
                && limit("maximum").is_none_or(|m| x <= m)
        });
        if !fits {
            // What `limits` does not tell.
            let what = match (number, limit("maximum")) {
                (Some(f64::INFINITY), None) => "is not finite".into(),
                (Some(x), Some(most)) if x > most && most >= STORABLE => {
                    format!("is more than {most}")
                }
                // TOML's own numbers end there.
                (None, Some(most)) if most >= STORABLE => {
                    format!("is no number up to {}", resolved["maximum"])
                }
                _ => "is out of range".to_string(),
            };
            self.wrong(schema, value, path, &what);
        }
    }

    fn wrong(&mut self, schema: &'s Value, value: &Spanned<DeValue>, path: &str, what: &str) {
        let quote = self.report.document.quote(value.span());
        let found = match value.get_ref() {
            DeValue::Table(_) => "a table".to_string(),
            DeValue::Array(items) => format!("a list of {}", items.len()),
            DeValue::String(_) => format!("the text {quote}"),
            _ => quote,
        };
        let is_text = matches!(value.get_ref(), DeValue::String(s)
            if s.trim_start().starts_with(|c: char| c.is_ascii_digit() || "+-.".contains(c)));
        let finding = Finding {
            problem: format!("`{}` {what}", last(path)),
            found,
            expected: format!("{}{}", kind(self.schema, schema), self.meaning(schema)),
            hint: is_text
                .then(|| "write the number without quotes; the key's name says its unit".into()),
        };
        self.at(value.span(), path.to_string(), finding);
    }

    fn at(&mut self, span: Range<usize>, key: String, finding: Finding) {
        if self.report.errors.len() >= MOST {
            return;
        }
        let mut d = self.report.document.diagnostic(span, key);
        d.problem = finding.problem;
        d.found = finding.found;
        d.expected = finding.expected;
        d.hint = finding.hint;
        self.report.errors.push(d);
    }

    /// The first sentence of what a key means.
    fn meaning(&self, schema: &Value) -> String {
        let text = schema["description"].as_str().unwrap_or_default().replace('\n', " ");
        match text.split(". ").next().map(|s| s.trim_end_matches('.')) {
            None | Some("") => String::new(),
            Some(sentence) => format!(" — {sentence}"),
        }
    }
}

/// The definition that a `$ref` names.
pub fn resolve<'s>(root: &'s Value, schema: &'s Value) -> &'s Value {
    schema["$ref"].as_str().and_then(|r| root.pointer(r.trim_start_matches('#'))).unwrap_or(schema)
}

/// What a value must be, in words.
pub fn kind(root: &Value, schema: &Value) -> String {
    let schema = resolve(root, schema);
    let words = choices(schema);
    match schema["type"].as_str() {
        None if !words.is_empty() => {
            let list: Vec<String> = words.iter().map(|w| format!("\"{w}\"")).collect();
            format!("one of {}", list.join(", "))
        }
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

/// A limit from here on only keeps a number storable: it says nothing to people who do not meet it.
const STORABLE: f64 = 4e9;

fn limits(schema: &Value) -> String {
    let bound = |key: &str| schema.get(key).filter(|v| v.is_number()).map(Value::to_string);
    let most = bound("maximum").filter(|_| schema["maximum"].as_f64() < Some(STORABLE));
    match (bound("exclusiveMinimum"), bound("minimum"), most) {
        (Some(a), _, Some(b)) => format!(" above {a} and up to {b}"),
        (Some(a), _, None) => format!(" above {a}"),
        (None, Some(a), Some(b)) => format!(" from {a} to {b}"),
        (None, Some(a), None) => format!(", {a} or more"),
        _ => String::new(),
    }
}

/// The words of an enumeration.
fn choices(schema: &Value) -> Vec<&str> {
    let plain = schema["enum"].as_array().into_iter().flatten();
    let described = schema["oneOf"].as_array().into_iter().flatten().map(|c| &c["const"]);
    plain.chain(described).filter_map(Value::as_str).collect()
}

fn join(path: &str, key: &str) -> String {
    if path.is_empty() { key.to_string() } else { format!("{path}.{key}") }
}

fn last(path: &str) -> &str {
    path.rsplit('.').next().unwrap_or(path)
}
