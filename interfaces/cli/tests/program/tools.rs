//! Tines from surface meshes: from the mesh to the run.

use crate::setup::{CASE, Place};
use serde_json::Value;

/// Sizes of blade and shaft in the case of the tests.
const BOXES: &str = "blade_size_m = [0.012, 0.04, 0.02]\nshaft_size_m = [0.012, 0.02, 0.10]\n";
/// Mount of tines of parts.
const MOUNT: &str = "mount = { stiffness_N_per_m = 1e5, mass_kg = 0.2 }\n";

/// OBJ of boxes in mm, given by opposite corners.
fn boxes(ends: &[[[f64; 3]; 2]]) -> String {
    const FACES: [[usize; 4]; 6] =
        [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    let mut text = String::new();
    for (k, ends) in ends.iter().enumerate() {
        let at = |i: usize, axis: usize| ends[i >> axis & 1][axis];
        text.extend((0..8).map(|i| format!("v {} {} {}\n", at(i, 0), at(i, 1), at(i, 2))));
        let face = |f: [usize; 4]| {
            let [a, b, c, d] = f.map(|corner| 8 * k + corner + 1);
            format!("f {a} {b} {c} {d}\n")
        };
        text.extend(FACES.map(face));
    }
    text
}

/// Returns the case with the parts of `mesh`, whose reference point is 20 mm over its origin.
fn case_of_mesh(place: &Place, mesh: &str) -> String {
    std::fs::write(place.path("tine.obj"), mesh).unwrap();
    place.call("tool tine.obj --origin 0,0,20 --out tine.toml").with_code(0);
    CASE.replace(BOXES, MOUNT) + &place.text("tine.toml")
}

/// Largest force on each tine in `folder`, N.
fn peak_forces(place: &Place, folder: &str) -> [f64; 2] {
    let summary = place.summary(folder);
    ["tine_1_plus", "tine_1_minus"].map(|tine| {
        let at = format!("/tines/{tine}/peak_force_N/value");
        summary.pointer(&at).and_then(Value::as_f64).expect(&at)
    })
}

#[test]
fn a_mesh_of_blade_and_shaft_tamps_as_the_boxes() {
    let place = Place::with(&CASE.replace(BOXES, &format!("{BOXES}{MOUNT}")));
    place.run("--out boxes --steps 60").with_code(0);
    let mesh = boxes(&[[[-6., -20., 0.], [6., 20., 20.]], [[-6., -10., 20.], [6., 10., 120.]]]);
    let case = case_of_mesh(&place, &mesh);
    std::fs::write(place.path("tiny.toml"), case).unwrap();
    place.call("check tiny.toml").with_code(0);
    place.run("--out parts --steps 60").with_code(0);
    let [expected, found] = ["boxes", "parts"].map(|folder| peak_forces(&place, folder));
    for (a, b) in expected.iter().zip(&found) {
        assert!(*a > 1.0 && (a - b).abs() < 1e-6 * a, "{expected:?} N, {found:?} N");
    }
}

#[test]
fn tines_of_parts_are_resumed_exported_and_inspected() {
    let place = Place::new();
    // A foot in front of the shaft.
    let mesh = boxes(&[[[-4., -20., 0.], [12., 14., 20.]], [[-6., -10., 20.], [6., 10., 120.]]]);
    let case = case_of_mesh(&place, &mesh);
    std::fs::write(place.path("tiny.toml"), case).unwrap();
    place.run("--out whole --steps 60").with_code(0);
    place.run("--out cut --steps 45").with_code(0);
    place.call("resume cut --steps 60").with_code(0);
    assert_eq!(place.hash("cut"), place.hash("whole"));
    place.call("inspect whole").with_code(0);
    place.call("export whole/results.vtkhdf --out frames").with_code(0);
    let frame = place.text("frames/tines_0000.vtp");
    assert!(frame.contains("NumberOfPoints=\"32\""), "two tines of two boxes: {frame}");
}

#[test]
fn tools_are_placed_by_unit_origin_and_axes() {
    let place = Place::new();
    // Centimetres, forward along -y and up along x.
    std::fs::write(place.path("tine.obj"), boxes(&[[[0., -1., -2.], [9., 1., 4.]]])).unwrap();
    let call = "tool tine.obj --unit cm --origin 2,0,0 --forward -y --up +x --json";
    let event = &place.call(call).with_code(0).events()[0];
    // y, which is up × forward, is -z of the mesh.
    assert_eq!(event["low_m"], serde_json::json!([-0.01, -0.04, -0.02]), "{event}");
    assert_eq!(event["high_m"], serde_json::json!([0.01, 0.02, 0.07]), "{event}");
    assert_eq!(event["parts"].as_array().map(Vec::len), Some(1));
    let message = place.call("tool tine.obj --unit m").with_code(0).stderr();
    assert!(message.contains("found one of 9.000 m; see --unit"), "{message}");
    let message = place.call("tool tine.obj --forward -x --up +x").with_code(2).stderr();
    assert!(message.contains("two different axes"), "{message}");
    place.call("tool tine.obj --origin 1,2").with_code(2);
    place.call("tool tine.obj --tolerance nan").with_code(2);
    let message = place.call("tool tine.obj --out tiny.toml").with_code(1).stderr();
    assert!(message.contains("tiny.toml") && message.contains("another file"), "{message}");
}
