//! `ballast export fmu`: units of a case.

use crate::setup::Place;

#[test]
fn units_of_both_versions_are_written_and_replaced() {
    let place = Place::new();
    let export = |arguments: &str| place.with_beds(&format!("export fmu tiny.toml {arguments}"));
    let events = export("--out bed.fmu --fmi both --json").with_code(0).events();
    let files = &events.iter().find(|e| e["event"] == "exported").expect("the result")["files"];
    assert_eq!(*files, serde_json::json!(["bed_fmi2.fmu", "bed_fmi3.fmu"]));
    let read = |name: &str| std::fs::read(place.path(name)).unwrap();
    let written = read("bed_fmi3.fmu");
    assert!(written.starts_with(b"PK") && read("bed_fmi2.fmu").starts_with(b"PK"));
    // Equal content gives equal bytes.
    export("-o bed_fmi3.fmu --fmi 3").with_code(0);
    assert!(read("bed_fmi3.fmu") == written);
}

#[test]
fn impossible_exports_are_refused() {
    let place = Place::new();
    let export = |arguments: &str| place.with_beds(&format!("export fmu {arguments}"));
    let other = export("tiny.toml --out tiny.toml").with_code(1);
    assert!(other.stderr().contains("expected a new file or a unit (.fmu) to replace"));
    export("tiny.toml --out bed.fmu --library none.so").with_code(1);
    export("missing.toml --out bed.fmu").with_code(1);
    export("tiny.toml").with_code(2);
    assert!(!place.path("bed.fmu").exists());
}
