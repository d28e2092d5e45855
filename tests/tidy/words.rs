//! Forbidden words of source, places of `unsafe`, and the length of files.

use crate::rust_text::{lines_with_word, without_comments_and_literals, without_tests};
use crate::tree;

/// Unfinished or left over from debugging: nowhere.
const LEFTOVERS: [&str; 4] = ["dbg!", "todo!", "unimplemented!", "FIXME"];

/// Files, network, clock, environment, terminal: not in what is pure.
const OUTSIDE_WORLD: [&str; 9] = [
    "std::fs",
    "std::net",
    "std::env",
    "Instant",
    "SystemTime",
    "print!",
    "println!",
    "eprint!",
    "eprintln!",
];

/// Interfaces that turn bytes into meaning and back, and reach for nothing else.
const PURE_INTERFACES: [&str; 3] =
    ["interfaces/scenario/", "interfaces/protocol/", "interfaces/columns/"];

/// Not in the core: iteration in an order of chance, panics without a reason.
const UNORDERED_OR_CURT: [&str; 3] = ["HashMap", "HashSet", ".unwrap()"];

/// Places in which `unsafe` is allowed: lanes and the kernel on them, a call into the C library of HDF5, the C functions of FMI with
/// their importer in the tests, and arrays that look at memory of the core.
const UNSAFE_PLACES: [&str; 6] = [
    "src/lanes/",
    "src/nlgs/kernel/",
    "interfaces/hdf5/src/image.rs",
    "interfaces/fmi/src/",
    "interfaces/fmi/tests/units/",
    "bindings/python/src/arrays.rs",
];

/// Not in the core either: what the system's mathematical library computes, whose last bits are of that system. `libm` has them.
const OF_THE_SYSTEM: [&str; 18] = [
    ".sin()",
    ".cos()",
    ".sin_cos()",
    ".tan()",
    ".asin()",
    ".acos()",
    ".atan()",
    ".atan2(",
    ".exp()",
    ".ln()",
    ".log10()",
    ".powf(",
    ".cbrt()",
    ".hypot(",
    ".angle()",
    "from_scaled_axis(",
    "from_axis_angle(",
    "from_euler_angles(",
];

const MAX_FILE_LINES: usize = 500;

fn forbidden(path: &str) -> Vec<&'static str> {
    let core = path.starts_with("src/");
    let pure = core || PURE_INTERFACES.iter().any(|place| path.starts_with(place));
    let mut words = LEFTOVERS.to_vec();
    if pure {
        words.extend(OUTSIDE_WORLD);
    }
    if core {
        words.extend(UNORDERED_OR_CURT);
        words.extend(OF_THE_SYSTEM);
    }
    words
}

fn objections(path: &str, source: &str) -> Vec<String> {
    let code = without_comments_and_literals(source);
    let shipped = without_tests(&code);
    let mut out = Vec::new();
    for word in forbidden(path) {
        for line in lines_with_word(&shipped, word) {
            out.push(format!("{path}:{line}: `{word}` has no place here"));
        }
    }
    if !UNSAFE_PLACES.iter().any(|place| path.starts_with(place)) {
        for line in lines_with_word(&code, "unsafe") {
            out.push(format!("{path}:{line}: `unsafe` has no place here"));
        }
    }
    let length = source.lines().count();
    if length > MAX_FILE_LINES {
        out.push(format!("{path}: {length} lines, at most {MAX_FILE_LINES}"));
    }
    out
}

#[test]
fn each_rule_objects() {
    for (path, source, wrong) in [
        ("src/a.rs", "use std::fs;", true),
        ("src/a.rs", "// std::fs", false),
        ("src/a.rs", "x.unwrap();", true),
        ("src/a.rs", "#[cfg(test)] mod t { fn f() { x.unwrap(); } }", false),
        ("src/a.rs", "let t = Instant::now();", true),
        ("src/a.rs", "let y = x.sin();", true),
        ("src/a.rs", "let y = libm::sin(x);", false),
        ("interfaces/cli/src/main.rs", "let y = x.sin();", false),
        ("src/a.rs", "let m: HashMap<u32, u32>;", true),
        ("src/a.rs", "unsafe { f() }", true),
        ("src/nlgs/kernel/mod.rs", "unsafe { f() }", false),
        ("src/nlgs/visit.rs", "unsafe { f() }", true),
        ("interfaces/scenario/src/lib.rs", "std::env::var(x)", true),
        ("interfaces/protocol/src/lib.rs", "std::env::var(x)", true),
        ("interfaces/cli/src/main.rs", "std::env::var(x)", false),
        ("interfaces/cli/src/main.rs", "todo!()", true),
        ("interfaces/cli/src/main.rs", "unsafe { f() }", true),
        ("interfaces/hdf5/src/image.rs", "unsafe { f() }", false),
        ("interfaces/hdf5/src/lib.rs", "unsafe { f() }", true),
    ] {
        let found = objections(path, source);
        assert_eq!(!found.is_empty(), wrong, "{path}: {source}: {found:?}");
    }
    assert!(objections("src/a.rs", &"x\n".repeat(MAX_FILE_LINES)).is_empty());
    assert!(!objections("src/a.rs", &"x\n".repeat(MAX_FILE_LINES + 1)).is_empty());
}

#[test]
fn sources_are_pure_safe_finished_and_short() {
    crate::none(tree::sources().iter().flat_map(|f| objections(&f.path, &f.text)).collect());
}

/// Names that phases of a step have in profiles, read from the `name` of `Phase`.
fn phase_names(step: &str) -> Vec<&str> {
    let body = step.split_once("pub fn name(self)").map_or("", |(_, rest)| rest);
    let body = body.split_once("\n    }").map_or(body, |(body, _)| body);
    body.split("=> \"").skip(1).filter_map(|arm| arm.split('"').next()).collect()
}

#[test]
fn the_glossary_knows_every_phase() {
    let glossary = tree::read("docs/src/developer/glossary.md");
    let row = glossary.lines().find(|l| l.starts_with("| phase (of a step)")).unwrap_or_default();
    let step = tree::read("src/step.rs");
    let names = phase_names(&step);
    assert!(names.len() > 5, "the phases were not found: {names:?}");
    let missing = names
        .into_iter()
        .filter(|name| !row.contains(name))
        .map(|name| format!("docs/src/developer/glossary.md does not list the phase `{name}`"))
        .collect();
    crate::none(missing);
}

/// Head words of a glossary's table that stand there more than once.
fn repeated_head_words(glossary: &str) -> Vec<String> {
    let mut words: Vec<&str> = glossary
        .lines()
        .filter_map(|line| line.strip_prefix("| ")?.split_once(" |"))
        .map(|(word, _)| word)
        .collect();
    words.sort_unstable();
    let pairs = words.windows(2).filter(|pair| pair[0] == pair[1]);
    pairs
        .map(|pair| format!("docs/src/developer/glossary.md: `{}` stands there twice", pair[0]))
        .collect()
}

#[test]
fn head_words_of_the_glossary_are_unique() {
    assert_eq!(repeated_head_words("| a | x |\n| b | y |\n| a | z |").len(), 1);
    crate::none(repeated_head_words(&tree::read("docs/src/developer/glossary.md")));
}
