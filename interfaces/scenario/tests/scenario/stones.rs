//! Sieve curves and walls of a case.

use crate::{BASE, changed};
use ballast::model::ContactStiffness;
use ballast::track::plan::{BedPlan, SieveFraction};
use ballast_scenario::{CaseErrors, content_key, read_case};

const CLASSES: &str = "classes = [{ size_m = 0.025, number_fraction = 0.7 }, { size_m = 0.05, number_fraction = 0.3 }]";

fn bed(text: &str) -> BedPlan {
    read_case(text, "case.toml").unwrap_or_else(|e| panic!("{e}")).plan.bed
}

fn key(text: &str) -> String {
    content_key(&read_case(text, "case.toml").unwrap_or_else(|e| panic!("{e}")).plan)
}

fn refused(text: &str) -> String {
    let errors: CaseErrors = read_case(text, "case.toml").expect_err("a wrong case");
    errors.to_string()
}

fn with_grading(points: &str) -> String {
    changed(CLASSES, &format!("grading = [{points}]"))
}

const CURVE: &str = "{ sieve_m = 22.4e-3, passing = 0 }, { sieve_m = 0.0315, passing = 0.2 }, \
                     { sieve_m = 0.04, passing = 0.2 }, { sieve_m = 0.05, passing = 1 }";

#[test]
fn a_sieve_curve_becomes_fractions_by_mass() {
    let grains = bed(&with_grading(CURVE)).grains;
    let fractions: Vec<SieveFraction> = grains.classes.iter().filter_map(|c| c.fraction).collect();
    assert_eq!(fractions.len(), 2, "no class between sieves that pass the same");
    assert_eq!([fractions[0].sieves, fractions[1].sieves], [[0.0224, 0.0315], [0.04, 0.05]]);
    assert_eq!((fractions[0].mass_share, fractions[1].mass_share), (0.2, 0.8));
    let shares: Vec<f64> = grains.classes.iter().map(|c| c.share).collect();
    assert!((shares.iter().sum::<f64>() - 1.0).abs() < 1e-12);
    assert!(shares[0] > shares[1], "by number there are more of the small ones: {shares:?}");
}

#[test]
fn sieve_curves_that_are_none_are_refused_with_their_line() {
    let rising = CURVE.replace("0.0315, passing = 0.2", "0.0315, passing = 0.3");
    for (points, parts) in [
        (
            rising.as_str(),
            ["bed.grains.grading[2].passing", "the sieve curve falls", "0.2 after 0.3"],
        ),
        (
            &CURVE.replace("0.0315", "0.02"),
            ["bed.grains.grading[1].sieve_m", "the sieves do not ascend", "0.02 after 0.0224"],
        ),
        (
            &CURVE.replace("passing = 0 }", "passing = 0.02 }"),
            ["bed.grains.grading[0].passing", "does not start at 0", "that retains all stones"],
        ),
        (
            &CURVE.replace("passing = 1 }", "passing = 0.98 }"),
            ["bed.grains.grading[3].passing", "does not end at 1", "that passes all stones"],
        ),
        ("{ sieve_m = 0.03, passing = 0 }", ["bed.grains.grading", "a list of", "case.toml:9"]),
    ] {
        let message = refused(&with_grading(points));
        assert!(message.contains("case.toml:9:"), "{message}");
        for part in parts {
            assert!(message.contains(part), "{part:?} in {message}");
        }
    }
    let both = changed(CLASSES, &format!("{CLASSES}\ngrading = [{CURVE}]"));
    let message = refused(&both);
    assert!(message.contains("given twice") && message.contains("case.toml:10"), "{message}");
}

#[test]
fn walls_differ_from_the_other_boundaries() {
    let walls = "[bed.friction]\nboundary = 0.7\n[bed.stiffness]\ngrain_N_per_m = 1e7\n\
                 boundary_N_per_m = 2e7\n[bed.walls]\nfloor = { friction = 0.9, stiffness_N_per_m = inf }\n\
                 y_min = { friction = 0 }\ny_max = { friction = 0.0, stiffness_N_per_m = 5e6 }\n\n[sleepers]";
    let bed = bed(&changed("[sleepers]", walls));
    assert_eq!(bed.friction.boundary, [0.9, 0.7, 0.7, 0.0, 0.0]);
    let normal = bed.stiffness.boundary.map(|s: ContactStiffness| s.normal);
    assert_eq!(normal, [f64::INFINITY, 2e7, 2e7, 2e7, 5e6]);
    assert!(bed.stiffness.boundary[0].is_rigid());
}

#[test]
fn wrong_walls_are_refused() {
    for (key, part) in [
        ("z_min = { friction = 0 }", "unknown key `z_min`"),
        ("x_min = { friction = -1 }", "`friction` is out of range"),
        ("x_min = { stifness_N_per_m = 1e6 }", "did you mean `stiffness_N_per_m`?"),
        ("x_min = 0", "wrong type"),
    ] {
        let message = refused(&changed("[sleepers]", &format!("[bed.walls]\n{key}\n[sleepers]")));
        assert!(message.contains(part) && message.contains("case.toml:16"), "{message}");
    }
    let slope = changed("[sleepers]", "[bed.walls]\nx_min = { friction = 30 }\n[sleepers]");
    let warnings = read_case(&slope, "case.toml").expect("a case").warnings;
    assert!(warnings.iter().any(|w| w.key == "bed.walls.x_min.friction"), "{warnings:?}");
}

#[test]
fn the_key_depends_on_walls_and_grading_where_they_are_used() {
    let walls =
        |text: &str| key(&changed("[sleepers]", &format!("[bed.walls]\n{text}\n[sleepers]")));
    assert_eq!(walls("floor = { friction = 0.8 }"), key(BASE), "as all boundaries");
    let mut keys = std::collections::BTreeSet::from([key(BASE)]);
    for text in [
        "floor = { friction = 0.5 }",
        "x_min = { friction = 0.5 }",
        "y_max = { friction = 0 }",
        "y_max = { stiffness_N_per_m = 1e6 }",
        "y_min = { stiffness_N_per_m = 1e6 }",
    ] {
        assert!(keys.insert(walls(text)), "{text}");
    }
    assert!(keys.insert(key(&with_grading(CURVE))));
    assert!(keys.insert(key(&with_grading(&CURVE.replace("passing = 0.2", "passing = 0.25")))));
}
