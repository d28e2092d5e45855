//! Hostile texts give errors, never a panic.

use crate::BASE;
use ballast_scenario::{read_case, sample};
use proptest::prelude::*;

/// Words of the format, to get past the first error.
const WORDS: [&str; 24] = [
    "nan",
    "inf",
    "-1",
    "0",
    "1e308",
    "1e-308",
    "9223372036854775807",
    "4294967295",
    "[",
    "]",
    "{}",
    "\"",
    "'''",
    "\n",
    "[[sleepers]]",
    "[tines]",
    "count = 1000\n",
    "true",
    "=",
    ".",
    "é",
    "\u{0}",
    "1979-05-27",
    "#",
];

proptest! {
    #![proptest_config(ProptestConfig::with_cases(512))]

    #[test]
    fn random_bytes_do_not_panic(bytes in proptest::collection::vec(any::<u8>(), 0..400)) {
        let text = String::from_utf8_lossy(&bytes);
        if let Err(errors) = read_case(&text, "random.toml") {
            prop_assert!(!errors.errors.is_empty());
            prop_assert!(!errors.to_string().is_empty());
        }
        prop_assert!(sample::read(&text, "random.json").is_err());
    }

    #[test]
    fn mutated_cases_do_not_panic(
        changes in proptest::collection::vec((0usize..1200, 0usize..12, 0usize..WORDS.len()), 1..5)
    ) {
        let mut text: Vec<char> = BASE.chars().collect();
        for (at, length, word) in changes {
            let at = at.min(text.len());
            let end = (at + length).min(text.len());
            text.splice(at..end, WORDS[word].chars());
        }
        let text: String = text.into_iter().collect();
        match read_case(&text, "mutated.toml") {
            Ok(case) => prop_assert!(case.plan.run.stepping.step_ns > 0),
            Err(errors) => {
                prop_assert!(!errors.errors.is_empty());
                for e in &errors.errors {
                    prop_assert!(e.line >= 1 && e.column >= 1);
                    prop_assert!(e.line <= text.lines().count().max(1) + 1, "{e}");
                }
            }
        }
    }

    #[test]
    fn any_number_in_any_place_is_refused_or_used(number in any::<f64>(), place in 0usize..40) {
        // The place-th number of the base.
        let spots: Vec<_> = BASE.match_indices(|c: char| c.is_ascii_digit()).collect();
        let at = spots[place * spots.len() / 40].0;
        let text = format!("{}{number:?}{}", &BASE[..at], &BASE[at + 1..]);
        if let Err(errors) = read_case(&text, "numbers.toml") {
            prop_assert!(!errors.to_string().is_empty());
        }
    }
}

#[test]
fn deep_nesting_is_refused() {
    for text in [
        format!("a = {}", "[".repeat(100_000)),
        format!("a = {}{}", "[".repeat(5_000), "]".repeat(5_000)),
        "a.".repeat(50_000),
        "a = { b = ".repeat(20_000),
    ] {
        assert!(read_case(&text, "deep.toml").is_err());
        assert!(sample::read(&text, "deep.json").is_err());
    }
    let text = format!("{}{}", "[".repeat(100_000), "]".repeat(100_000));
    assert!(sample::read(&text, "deep.json").is_err());
}

#[test]
fn a_long_list_of_wrong_entries_gives_a_short_answer() {
    let text = BASE.replace("[-0.1, 0.1]", &format!("[{}0]", "nan, ".repeat(63)));
    let many = read_case(&text, "long.toml").unwrap_err();
    assert_eq!(many.errors.len(), 63);
    let text = BASE.replace("tamped = [1]", &format!("tamped = [{}1]", "0, ".repeat(900)));
    let many = read_case(&text, "long.toml").unwrap_err();
    assert!(many.errors.len() <= 100, "{}", many.errors.len());
}

#[test]
fn too_many_bodies_are_refused_before_pairs_are_compared() {
    let one = "[[sleeper]]\nname = \"s\"\nx_m = 0.3\ny_m = 0.3\n\
               blocks = [{ size_m = [0.1, 0.1, 0.1] }]\n";
    let text = format!("{BASE}{}", one.repeat(20_000));
    let errors = read_case(&text, "many.toml").unwrap_err().to_string();
    assert!(errors.contains("at most 2000"), "{errors}");
}

#[test]
fn each_body_is_counted_once() {
    let errors_of =
        |text: &str| read_case(text, "many.toml").expect_err("they overlap").to_string();
    // A row and single tines, without tines beside the row: before all pairs are compared.
    let tine = |i: usize| {
        format!(
            "[[tine]]\nname = \"t{i}\"\nx_m = 0.1\ny_m = 0.1\nsqueeze_direction = \"+x\"\npair = {i}\n"
        )
    };
    let (before, after) = BASE.split_once("[tines]").expect("there are tines");
    let (_, after) = after.split_once("[tamping]").expect("and a machine");
    let row = before.replace("tamped = [1]", "count = 1000\npitch_m = 0.0005\ntamped = []");
    let tines: String = (1..=1001).map(tine).collect();
    let text = errors_of(&format!("{row}{tines}[tamping]{after}"));
    assert!(text.contains("2001") && text.contains("at most 2000 together"), "{text}");

    let sleeper = |i: usize| {
        format!(
            "[[sleeper]]\nname = \"s{i}\"\nx_m = 0.1\ny_m = 0.1\nblocks = [{{ size_m = [0.1, 0.1, 0.1] }}]\n"
        )
    };
    let sleepers: String = (1..=1000).map(sleeper).collect();
    let text = errors_of(&BASE.replace("[tines]", &format!("{sleepers}[tines]")));
    assert!(text.contains("overlap") && !text.contains("together"), "{text}");
}
