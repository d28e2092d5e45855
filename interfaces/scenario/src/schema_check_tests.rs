//! Differential test of [`crate::schema_check`] against an independent validator of JSON Schemas.

use crate::document::CaseDocument;
use crate::report::DiagnosticReport;
use crate::schema::schema;
use crate::schema_check::check;
use boon::{Compiler, Schemas};
use toml::{Table, Value};

const CASES: [&str; 4] = [
    include_str!("../../../examples/first.toml"),
    include_str!("../../../examples/laptop.toml"),
    include_str!("../../../examples/seven_sleepers.toml"),
    "name = \"single\"\n[bed]\nsize_m = [1, 1, 1]\nsleeper_underside_z_m = 0.3\n[run]\nduration_s = 0.1\n\
     [[sleeper]]\nname = \"a\"\nx_m = 0.3\ny_m = 0.3\nblocks = [{ size_m = [0.2, 0.2, 0.2] }]\n\
     mount = { z = \"spring\", stiffness_N_per_m = 1e7, ry = \"free\" }\n\
     [[tine]]\nname = \"b\"\nx_m = 0.1\ny_m = 0.3\nsqueeze_direction = \"+x\"\npair = 1\n",
];

/// Number of mutated cases.
const MUTANTS: usize = 10_000;

/// Linear congruential generator: the same mutants on every machine.
struct MutationRng(u64);

impl MutationRng {
    fn below(&mut self, n: usize) -> usize {
        self.0 =
            self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) as usize % n
    }
}

/// Returns a random value. Floats are not whole, because JSON does not distinguish whole ones from integers.
fn random_value(rng: &mut MutationRng) -> Value {
    const INTEGERS: [i64; 8] = [i64::MIN, -1, 0, 1, 3, 200, 5_000_000_000, i64::MAX];
    const NUMBERS: [f64; 6] = [-0.25, 1e-300, 0.005, 0.5, 0.999, 1234.5];
    const WORDS: [&str; 8] = ["", "x", "+x", "free", "boxes", "nncg", "qm16", "synchronous"];
    match rng.below(7) {
        0 | 1 => INTEGERS[rng.below(INTEGERS.len())].into(),
        2 | 3 => NUMBERS[rng.below(NUMBERS.len())].into(),
        4 => WORDS[rng.below(WORDS.len())].into(),
        5 => (rng.below(2) == 0).into(),
        _ => Value::Array((0..rng.below(5)).map(|_| random_value(rng)).collect()),
    }
}

/// Changes one random place of a table or of the values in it; `keys` are keys of any section.
fn mutate_table(table: &mut Table, keys: &[String], rng: &mut MutationRng) {
    let present: Vec<String> = table.keys().cloned().collect();
    if present.is_empty() || rng.below(6) == 0 {
        let key = keys[rng.below(keys.len())].clone();
        let value = if rng.below(3) == 0 { Table::new().into() } else { random_value(rng) };
        table.insert(key, value);
        return;
    }
    let key = &present[rng.below(present.len())];
    match rng.below(8) {
        0 => {
            table.remove(key);
        }
        1 => {
            let value = table.remove(key).expect("a present key");
            table.insert(keys[rng.below(keys.len())].clone(), value);
        }
        _ => mutate_value(table.get_mut(key).expect("a present key"), keys, rng),
    }
}

fn mutate_value(value: &mut Value, keys: &[String], rng: &mut MutationRng) {
    match value {
        Value::Table(table) if rng.below(8) > 0 => mutate_table(table, keys, rng),
        Value::Array(items) if !items.is_empty() && rng.below(8) > 0 => {
            let i = rng.below(items.len());
            match rng.below(4) {
                0 => {
                    items.remove(i);
                }
                1 => items.push(items[i].clone()),
                _ => mutate_value(&mut items[i], keys, rng),
            }
        }
        _ => *value = random_value(rng),
    }
}

/// Collects the keys of all sections.
fn collect_keys(schema: &serde_json::Value, keys: &mut Vec<String>) {
    if let Some(map) = schema.as_object() {
        keys.extend(
            map.get("properties")
                .and_then(|p| p.as_object())
                .into_iter()
                .flat_map(|p| p.keys().cloned()),
        );
        map.values().for_each(|inner| collect_keys(inner, keys));
    }
}

#[test]
fn mutated_cases_have_the_verdict_of_an_independent_validator() {
    let schema = schema();
    let mut keys = vec!["unknown".to_string()];
    collect_keys(&schema, &mut keys);
    let (mut compiler, mut schemas) = (Compiler::new(), Schemas::new());
    compiler.add_resource("case.json", schema.clone()).expect("a schema");
    let index = compiler.compile("case.json", &mut schemas).expect("a schema");
    let mut rng = MutationRng(1);
    let mut valid_mutants = 0;
    for i in 0..MUTANTS {
        let mut case: Table = CASES[i % CASES.len()].parse().expect("a case");
        (0..=rng.below(3)).for_each(|_| mutate_table(&mut case, &keys, &mut rng));
        let text = toml::to_string(&case).expect("TOML");
        let document = CaseDocument::parse(&text, "mutant").unwrap_or_else(|_| panic!("{text}"));
        let mut report = DiagnosticReport::new(&document);
        check(&mut report, &schema);
        let json = serde_json::to_value(&case).expect("JSON");
        let expected = schemas.validate(&json, index);
        let found: Vec<String> = report.errors.iter().map(|e| e.to_string()).collect();
        assert_eq!(
            expected.is_ok(),
            found.is_empty(),
            "mutant {i}: {:?}\n{}\n{text}",
            expected.err().map(|e| e.to_string()),
            found.join("\n")
        );
        valid_mutants += usize::from(found.is_empty());
    }
    assert!(valid_mutants > MUTANTS / 20, "hardly a mutant is valid: {valid_mutants}");
}
