//! Allowed dependencies of each package, read from the manifests.

use crate::tree;
use std::collections::BTreeSet;
use std::process::Command;
use toml::Table;

/// All that the core may depend on. Each further crate is a decision, not an accident.
const CORE_MAY_USE: [&str; 7] =
    ["libm", "nalgebra", "parry3d-f64", "rayon", "thiserror", "rand", "rand_pcg"];

/// The packages that bring interfaces together: what people and programs see.
const FACES: [&str; 2] = ["ballast-cli", "ballast-python"];

/// The packages between the interfaces and the faces, each with the packages of this workspace that it may use.
const SHARED: [(&str, &[&str]); 7] = [
    ("ballast-fmi", &["ballast-scenario", "ballast-zenoh"]),
    ("ballast-coupling", &["ballast-zenoh"]),
    ("ballast-beds", &["ballast-scenario", "ballast-hdf5"]),
    (
        "ballast-session",
        &["ballast-scenario", "ballast-hdf5", "ballast-mcap", "ballast-zenoh", "ballast-beds"],
    ),
    ("ballast-report", &["ballast-hdf5", "ballast-session"]),
    ("ballast-validation", &["ballast-scenario", "ballast-session", "ballast-report"]),
    ("ballast-benches", &["ballast-scenario", "ballast-hdf5", "ballast-session"]),
];

/// The words that several interfaces speak, in messages and in files: packages that all of them may use.
const WORDS: [&str; 2] = ["ballast-protocol", "ballast-columns"];

fn parse(text: &str) -> Table {
    text.parse().expect("a manifest is TOML")
}

fn name(manifest: &Table) -> &str {
    manifest["package"]["name"].as_str().expect("a package has a name")
}

/// Names in a table of dependencies, tables for single targets included.
fn dependencies(manifest: &Table, kind: &str) -> Vec<String> {
    let keys = |t: &Table| -> Vec<String> {
        t.get(kind).and_then(|d| d.as_table()).map_or(vec![], |d| d.keys().cloned().collect())
    };
    let mut names = keys(manifest);
    if let Some(targets) = manifest.get("target").and_then(|t| t.as_table()) {
        names.extend(targets.values().filter_map(|t| t.as_table()).flat_map(keys));
    }
    names
}

fn core_objections(manifest: &Table) -> Vec<String> {
    let mut used = dependencies(manifest, "dependencies");
    used.extend(dependencies(manifest, "build-dependencies"));
    used.retain(|d| !CORE_MAY_USE.contains(&d.as_str()));
    used.into_iter().map(|d| format!("Cargo.toml: the core may not depend on `{d}`")).collect()
}

fn interface_objections(manifest: &Table) -> Vec<String> {
    let package = name(manifest);
    if FACES.contains(&package) {
        return vec![];
    }
    let shared = SHARED.iter().find(|(name, _)| *name == package);
    let may_use = |d: &str| WORDS.contains(&d) || shared.is_some_and(|(_, used)| used.contains(&d));
    ["dependencies", "dev-dependencies", "build-dependencies"]
        .iter()
        .flat_map(|kind| dependencies(manifest, kind))
        .filter(|d| d.starts_with("ballast-") && !may_use(d))
        .map(|d| format!("{package} depends on {d}: interfaces do not see each other"))
        .collect()
}

#[test]
fn a_wrong_dependency_is_found() {
    let core = parse("[package]\nname = 'ballast'\n[dependencies]\nrayon = '1'\nserde = '1'");
    assert_eq!(core_objections(&core).len(), 1);
    let hidden = "[target.'cfg(unix)'.dependencies]\nlibc = '0.2'";
    assert_eq!(core_objections(&parse(hidden)).len(), 1);
    let a = "[package]\nname = 'ballast-a'\n[dependencies]\nballast = '0'\nballast-b = '0'";
    assert_eq!(interface_objections(&parse(a)).len(), 1);
    assert!(interface_objections(&parse(&a.replace("ballast-a", FACES[0]))).is_empty());
    for (package, used) in SHARED {
        assert_eq!(interface_objections(&parse(&a.replace("ballast-a", package))).len(), 1);
        let allowed = a.replace("ballast-b", used[0]).replace("ballast-a", package);
        assert!(interface_objections(&parse(&allowed)).is_empty());
    }
    for words in WORDS {
        assert!(interface_objections(&parse(&a.replace("ballast-b", words))).is_empty());
    }
}

#[test]
fn the_core_depends_on_little() {
    crate::none(core_objections(&parse(&tree::read("Cargo.toml"))));
}

#[test]
fn interfaces_do_not_see_each_other() {
    let manifests: Vec<_> =
        tree::around(&["toml"]).into_iter().filter(|f| f.path.ends_with("/Cargo.toml")).collect();
    assert!(manifests.len() >= 3, "the interfaces were not found");
    crate::none(manifests.iter().flat_map(|f| interface_objections(&parse(&f.text))).collect());
}

/// Crates with their features, as cargo would compile them.
fn compiled(arguments: &[&str]) -> BTreeSet<String> {
    let tree =
        ["tree", "--offline", "--locked", "--prefix", "none", "--no-dedupe", "--format", "{p} {f}"];
    let done = Command::new(env!("CARGO"))
        .args(tree)
        .args(arguments)
        .current_dir(tree::root())
        .output()
        .expect("cargo");
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let text = String::from_utf8(done.stdout).expect("names");
    text.lines().map(|line| line.trim_end_matches(" (*)").to_string()).collect()
}

#[test]
fn the_python_package_shares_all_compiled_crates() {
    let objections = |first: BTreeSet<String>, second: &BTreeSet<String>| {
        let names: BTreeSet<_> = second.iter().map(|line| name_and_version(line)).collect();
        first
            .into_iter()
            .filter(|line| names.contains(&name_and_version(line)) && !second.contains(line))
            .map(|line| format!("bindings/shared-features/Cargo.toml: {line} is compiled twice"))
            .collect::<Vec<_>>()
    };
    let edges = ["--edges", "normal,build"];
    let package = compiled(&[&["--package", "ballast-python"][..], &edges].concat());
    let demo = compiled(&[&["--no-default-features"][..], &edges].concat());
    let program = compiled(&edges);
    let tests = compiled(&["--workspace", "--edges", "normal,build,dev"]);
    // Small, and different with and without the network.
    let network = ["ballast-shared-features ", "ballast-session ", "ballast-fmi ", "ballast-cli "];
    let own = |line: &String| !network.iter().any(|name| line.starts_with(name));
    let without_own = |lines: BTreeSet<String>| lines.into_iter().filter(own).collect();
    crate::none(objections(without_own(demo.clone()), &package));
    crate::none(objections(without_own(demo), &tests));
    crate::none(objections(without_own(program), &package));
    crate::none(objections(without_own(package), &tests));
}

#[test]
fn ordinary_builds_take_the_hdf5_of_the_system() {
    let tests = compiled(&["--workspace", "--edges", "normal,build,dev"]);
    let built = |name: &str| tests.iter().any(|line| line.starts_with(name));
    assert!(built("hdf5-metno-sys ") && !built("hdf5-metno-src "), "HDF5 is built from source");
}

/// Returns a line of [`compiled`] without the features.
fn name_and_version(line: &str) -> String {
    line.split(' ').take(2).collect::<Vec<_>>().join(" ")
}
