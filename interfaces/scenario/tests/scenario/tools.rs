//! Tines of convex parts.

use crate::{BASE, changed};
use ballast::track::plan::{Plan, TineShape};
use ballast::track::{swept_area, zones};
use ballast_scenario::{content_key, read_case};

/// Mount that parts need.
const MOUNT: &str = "mount = { stiffness_N_per_m = 7e5, mass_kg = 3 }";
const BLADE: [[f64; 3]; 2] = [[-0.011, -0.06, -0.07], [0.011, 0.06, 0.0]];
const SHAFT: [[f64; 3]; 2] = [[-0.015, -0.03, 0.0], [0.015, 0.03, 0.45]];

fn plan(text: &str) -> Plan {
    read_case(text, "case.toml").unwrap_or_else(|e| panic!("{e}")).plan
}

/// Part that is a box between two opposite corners.
fn part([low, high]: [[f64; 3]; 2]) -> String {
    let ends = [low, high];
    let at = |i: usize, k: usize| ends[i >> k & 1][k];
    let corners: Vec<[f64; 3]> = (0..8).map(|i| [at(i, 0), at(i, 1), at(i, 2)]).collect();
    format!("{{ corners = {corners:?} }}")
}

/// Returns the base with these keys of `[tines]`.
fn with_tines(keys: &str) -> String {
    changed("[tines]", &format!("[tines]\n{keys}"))
}

fn with_parts(parts: &[[[f64; 3]; 2]]) -> String {
    let parts: Vec<String> = parts.iter().map(|p| part(*p)).collect();
    with_tines(&format!("{MOUNT}\nparts = [{}]", parts.join(", ")))
}

#[test]
fn parts_stand_where_boxes_stand() {
    let (boxes, parts) = (plan(&with_tines(MOUNT)), plan(&with_parts(&[BLADE, SHAFT])));
    assert_eq!(boxes.tines.len(), parts.tines.len());
    for (a, b) in boxes.tines.iter().zip(&parts.tines) {
        assert!(matches!(a.shape, TineShape::Boxes { .. }));
        assert!(matches!(&b.shape, TineShape::Parts(parts) if parts.len() == 2));
        assert_eq!((a.position, a.mount), (b.position, b.mount));
        assert_eq!((a.bounds(), a.blade_bounds()), (b.bounds(), b.blade_bounds()));
    }
    assert_eq!(zones(&boxes), zones(&parts));
    assert_eq!(content_key(&boxes), content_key(&parts), "the bed is the same");
}

#[test]
fn facing_tines_are_mirror_images_at_the_gap_of_their_blades() {
    let foot = [[-0.004, -0.03, -0.06], [0.016, 0.05, 0.0]];
    let plan = plan(&with_parts(&[foot, SHAFT]));
    let [plus, minus] = [&plan.tines[0], &plan.tines[1]];
    // Half a block, the gap, and the blade in front of the reference point.
    let distance = 0.145 + 0.06 + 0.016;
    assert!((plus.position[0] - (0.3 - distance)).abs() < 1e-12, "{:?}", plus.position);
    assert!((minus.position[0] - (0.3 + distance)).abs() < 1e-12, "{:?}", minus.position);
    let [a, b] = [plus, minus].map(|tine| swept_area(tine, 0.05, 0.005));
    assert!((a.x[0] + b.x[1] - 0.6).abs() < 1e-12 && (a.x[1] + b.x[0] - 0.6).abs() < 1e-12);
    assert_eq!(a.y, b.y);
    let y = plus.position[1];
    assert!((a.y[0] - (y - 0.03)).abs() < 1e-12 && (a.y[1] - (y + 0.05)).abs() < 1e-12);
}

#[test]
fn a_single_tine_has_parts() {
    let single = format!(
        "[[tine]]\nname = \"lone\"\nx_m = 0.3\ny_m = 0.63\nsqueeze_direction = \"-x\"\npair = 7\n\
         mount = {{ rigid = true }}\n[[tine.parts]]\ncorners = {}\n[tamping]",
        part(BLADE).trim_start_matches("{ corners = ").trim_end_matches(" }")
    );
    let plan = plan(&changed("[tamping]", &single));
    let lone = &plan.tines[4];
    assert!(
        lone.mount.is_none() && matches!(&lone.shape, TineShape::Parts(parts) if parts.len() == 1)
    );
}

#[test]
fn parts_that_make_no_tine_are_refused_with_the_reason() {
    let parts = |list: &str| format!("{MOUNT}\nparts = [{list}]");
    let both = [part(BLADE), part(SHAFT)].join(", ");
    let inside = part(BLADE).replacen("[[", "[[0.0, 0.0, -0.01], [", 1);
    // It passes over the sleeper.
    let arm = part([[-0.01, -0.03, 0.1], [0.2, 0.03, 0.2]]);
    for (keys, expected) in [
        (
            format!("blade_size_m = [0.02, 0.1, 0.1]\n{}", parts(&both)),
            ["given twice", "remove `blade_size_m`"],
        ),
        (
            format!("shaft_size_m = [0.02, 0.1, 0.1]\n{}", parts(&both)),
            ["given twice", "remove `shaft_size_m`"],
        ),
        (format!("parts = [{both}]"), ["missing key `stiffness_N_per_m`", "or `rigid = true`"]),
        (
            format!("mount = {{ stiffness_N_per_m = 1e6 }}\nparts = [{both}]"),
            ["missing key `mass_kg`", "tines.mount.mass_kg"],
        ),
        (parts(&inside), ["tines.parts[0].corners", "1 of 9 that are none of its convex hull"]),
        (
            parts(&format!("{both}, {{ corners = [[0, 0, 0], [1, 0, 0], [0, 1, 0]] }}")),
            ["tines.parts[2].corners", "wrong number of entries"],
        ),
        (parts(&both.replace("0.45", "inf")), ["not finite", "tines.parts[1]"]),
        (parts(&part(SHAFT)), ["has no blade", "--origin"]),
        (parts(&format!("{both}, {arm}")), ["`tine_1_plus` is inserted into `sleeper_1`", "x"]),
        (parts(&both.replace("-0.07", "-0.4")), ["reaches the floor", "tine_1_plus"]),
    ] {
        let text = with_tines(&keys);
        let message = read_case(&text, "case.toml").expect_err(&keys).to_string();
        assert!(expected.iter().all(|part| message.contains(part)), "{keys}\n{message}");
    }
    let single = format!(
        "[[tine]]\nname = \"lone\"\nx_m = 0.3\ny_m = 0.63\nsqueeze_direction = \"-x\"\npair = 7\n\
         blade_size_m = [0.02, 0.1, 0.1]\n{}\n[tamping]",
        parts(&both)
    );
    let text = BASE.replace("[tamping]", &single);
    let message = read_case(&text, "case.toml").expect_err(&single).to_string();
    assert!(message.contains("tine[0].blade_size_m"), "{message}");
}
