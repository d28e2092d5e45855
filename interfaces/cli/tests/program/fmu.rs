//! `ballast export fmu`: units of a case.

use crate::setup::{Ended, Place};
use ballast_fmu::package::LIBRARY_FILE;
use std::process::Command;

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
fn the_library_is_found_in_the_layout_of_an_installation() {
    let place = Place::new();
    // A link, which needs one file system: a copy that another test forks away with cannot be run.
    let installed = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap();
    let at = |name: &str| installed.path().join(name);
    for folder in ["bin", "lib/ballast"] {
        std::fs::create_dir_all(at(folder)).unwrap();
    }
    std::fs::hard_link(env!("CARGO_BIN_EXE_ballast"), at("bin/ballast")).unwrap();
    let mut export = Command::new(at("bin/ballast"));
    let arguments = place.with_beds_command("export fmu tiny.toml --out bed.fmu");
    export.args(arguments.get_args()).current_dir(place.path(""));
    let missing = Ended(export.output().unwrap()).with_code(1);
    assert!(missing.stderr().contains("expected the library of units at"));
    // Its bytes do not matter to the export.
    std::fs::write(at("lib/ballast").join(LIBRARY_FILE), "library").unwrap();
    Ended(export.output().unwrap()).with_code(0);
    assert!(std::fs::read(place.path("bed.fmu")).unwrap().starts_with(b"PK"));
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

#[cfg(feature = "zenoh")]
#[test]
fn a_unit_for_a_served_component_has_no_bed() {
    let place = Place::new();
    let export = |arguments: &str| place.with_beds(&format!("export fmu tiny.toml {arguments}"));
    export("-o served.fmu --served yard/bed --connect tcp/127.0.0.1:7551").with_code(0);
    let archive = std::fs::read(place.path("served.fmu")).unwrap();
    let has = |name: &str| archive.windows(name.len()).any(|part| part == name.as_bytes());
    assert!(has("resources/served.json") && !has("bed.ballast"));
    for (arguments, code, reason) in [
        ("--connect tcp/127.0.0.1:7551", 2, "expected --served SITE/ID"),
        ("--served bed", 2, "expected SITE/ID"),
        ("--served yard/bed --connect 127.0.0.1", 4, "expected PROTOCOL/ADDRESS"),
    ] {
        let refused = export(&format!("-o other.fmu {arguments}")).with_code(code);
        assert!(refused.stderr().contains(reason), "{}", refused.stderr());
    }
    assert!(!place.path("other.fmu").exists());
}
