//! Texts in the notation of other programs: each is named, with its place and the right notation.

use crate::changed;
use ballast_scenario::{CaseDiagnostic, read_case};

fn errors(text: &str) -> Vec<CaseDiagnostic> {
    read_case(text, "case.toml").expect_err("foreign notation").errors
}

/// Reads the only error of a text.
#[track_caller]
fn only_error(text: &str) -> CaseDiagnostic {
    let mut errors = errors(text);
    assert_eq!(errors.len(), 1, "{errors:#?}");
    errors.remove(0)
}

#[test]
fn reported_files_have_one_error_with_its_correction() {
    let smart = only_error(include_str!("../data/smart.toml"));
    assert_eq!((smart.line, smart.column), (1, 8));
    assert!(smart.problem.contains("typographic quotation marks"), "{smart}");
    assert!(smart.expected.ends_with("\"rest\""), "{smart}");
    let unit = only_error(include_str!("../data/unit.toml"));
    assert_eq!((unit.line, unit.column), (8, 14));
    assert!(unit.problem.contains("value with a unit"), "{unit}");
    assert_eq!(unit.found, "`0.1 s`");
    assert!(unit.expected.ends_with(": 0.1"), "{unit}");
}

#[test]
fn quotation_marks_of_word_processors_are_named() {
    for name in ["“base”", "„base“", "«base»", "‘base’", "“base\"", "\"base”", "`base`", "’base’"]
    {
        let error = only_error(&changed("\"base\"", name));
        assert!(error.problem.contains("typographic quotation marks"), "{name}: {error}");
        assert!(error.expected.ends_with("\"base\""), "{name}: {error}");
        assert_eq!((error.line, error.column), (1, 8), "{name}");
    }
    // In strings and comments they are text.
    assert!(read_case(&changed("name =", "# “a” ‘b’\nname ="), "case.toml").is_ok());
}

#[test]
fn foreign_values_are_named_and_rewritten() {
    for (from, value, problem, expected) in [
        ("= 1.764", "= 1.764 s", "value with a unit", ": 1.764"),
        ("= 1.764", "= 1764ms # ms", "value with a unit", ": 1.764"),
        ("= 1.764", "= 1,764 s", "decimal comma and value with a unit", ": 1.764"),
        ("= 1.764", "= 1,764", "decimal comma", "a decimal point: 1.764"),
        ("= 1.764", "= 1.764;", "semicolon", ": 1.764"),
        ("= 1.764", "= 1.764 furlongs", "value with a unit", "in the unit of the key"),
        ("= 0.28", "= 28 cm", "value with a unit", ": 0.28"),
        ("= 2700", "= 2700 kg/m³", "value with a unit", ": 2700"),
        ("= 2700", "= 2,7 t/m^3", "value with a unit", ": 2700"),
        ("= 0.06", "= .06", "point without digits", ": 0.06"),
        ("= 0.06", "= 60 mm", "value with a unit", ": 0.06"),
        ("[-0.1, 0.1]", "[−0.1, 0.1]", "dash before a number", ": [-0.1, 0.1]"),
        ("[-0.1, 0.1]", "[-0,1; 0,1]", "decimal comma and semicolon", ": [-0.1, 0.1]"),
        ("[-0.1, 0.1]", "[-0.1; 0.1]", "semicolon", ": [-0.1, 0.1]"),
        ("[-0.1, 0.1]", "[-0.1 m, 0.1 m]", "value with a unit", ": [-0.1, 0.1]"),
        ("[0.60, 0.70, 0.45]", "[0,60, 0,70, 0,05]", "decimal comma", ": [0.60, 0.70, 0.05]"),
        (
            "[{ size_m = 0.025, number_fraction = 0.7 }",
            "[{ size_m = 25 mm, number_fraction = 0.7 }",
            "value with a unit",
            ": [{ size_m = 0.025, number_fraction = 0.7 }, { size_m = 0.05, number_fraction = 0.3 }]",
        ),
        (
            "{ stroke_m = 0.05, force_limit_N = 7800 }",
            "{ stroke_m = 0,05, force_limit_N = 7.8 kN }",
            "decimal comma and value with a unit",
            ": { stroke_m = 0.05, force_limit_N = 7800 }",
        ),
        ("\"synchronous\"", "synchronous", "text without quotes", ": \"synchronous\""),
        ("restitution = 0", "restitution = 0 %", "value with a unit", "in the unit of the key"),
    ] {
        let error = only_error(&changed(from, value));
        assert!(error.problem.contains(problem), "{value}: {error}");
        assert!(error.expected.ends_with(expected), "{value}: {error}");
    }
}

#[test]
fn invisible_characters_are_named() {
    for (c, name) in [
        ('\u{a0}', "no-break space"),
        ('\u{202f}', "narrow no-break space"),
        ('\u{2003}', "Unicode space"),
        ('\u{3000}', "Unicode space"),
        ('\u{200b}', "zero-width space"),
        ('\u{feff}', "byte order mark"),
        ('\u{200e}', "invisible character"),
    ] {
        let error = only_error(&changed("duration_s = 1.764", &format!("duration_s ={c}1.764")));
        assert!(error.problem.contains(name), "{c:?}: {error}");
        assert_eq!(error.found, format!("U+{:04X}", u32::from(c)));
        assert!(error.to_string().contains("duration_s =\u{fffd}1.764"), "{error}");
    }
    // Of one kind the first is reported, with their number.
    let error =
        only_error(&changed("[run]\nduration_s = 1.764", "[run]\nduration_s\u{a0}=\u{a0}1.764"));
    assert!(error.hint.is_some_and(|hint| hint.contains('2')));
    // A byte order mark at the start, and spaces in comments and strings, are text.
    let text = changed("name =", "\u{feff}# a\u{a0}b\nname =");
    assert!(read_case(&text, "case.toml").is_ok());
    let word = errors(&changed("\"synchronous\"", "\"synchronous\u{200b}\"")).remove(0).to_string();
    assert!(word.contains("synchronous\u{fffd}"), "{word}");
}

#[test]
fn other_errors_of_a_text_remain() {
    let text = changed("\"base\"", "“base”").replace("[solver]", "[solver");
    let problems: Vec<String> = errors(&text).into_iter().map(|e| e.problem).collect();
    assert!(problems.len() >= 2 && problems[0].contains("typographic"), "{problems:?}");
}

#[test]
fn an_expression_is_no_text() {
    for value in ["1/2", "[1 2]"] {
        let error = only_error(&changed("= 0.28", &format!("= {value}")));
        assert!(error.problem.contains("not a number"), "{error}");
    }
}
