//! No two files import each other, directly or through others.

use crate::tree::{self, File};
use std::collections::{BTreeMap, BTreeSet};
use syn::{Item, UseTree, Visibility};

/// Path of a module or item from the root of its crate.
type ItemPath = Vec<String>;

/// A source file as a module: names that it defines, names that it hands on, paths that it imports.
#[derive(Default)]
struct SourceModule {
    defined: BTreeSet<String>,
    handed_on: BTreeMap<String, ItemPath>,
    imported: Vec<ItemPath>,
}

/// Crate folder and module path of a file, `None` for what is no module of a library or program.
fn module_path(path: &str) -> Option<(&str, ItemPath)> {
    let (folder, inside) = match path.strip_prefix("src/") {
        Some(inside) => ("", inside),
        None => path.split_once("/src/")?,
    };
    let inside = inside.strip_suffix(".rs")?;
    let parts = inside.split('/').map(str::to_owned);
    Some((folder, parts.filter(|p| !["mod", "lib", "main"].contains(&p.as_str())).collect()))
}

/// All paths of a `use`, each with the name that it has here.
fn flatten(tree: &UseTree, prefix: &mut ItemPath, found: &mut Vec<(ItemPath, String)>) {
    match tree {
        UseTree::Path(path) => {
            prefix.push(path.ident.to_string());
            flatten(&path.tree, prefix, found);
            prefix.pop();
        }
        UseTree::Group(group) => group.items.iter().for_each(|tree| flatten(tree, prefix, found)),
        UseTree::Glob(_) => found.push((prefix.clone(), "*".into())),
        UseTree::Name(name) => {
            let name = name.ident.to_string();
            let mut path = prefix.clone();
            if name != "self" {
                path.push(name.clone());
            }
            let here = path.last().cloned().unwrap_or(name);
            found.push((path, here));
        }
        UseTree::Rename(name) => {
            let mut path = prefix.clone();
            path.push(name.ident.to_string());
            found.push((path, name.rename.to_string()));
        }
    }
}

/// The path from the crate's root, for a path that stands in module `here`; `None` for other crates.
fn absolute(
    path: &[String],
    here: &[String],
    modules: &BTreeMap<ItemPath, String>,
) -> Option<ItemPath> {
    let mut base = here.to_vec();
    let mut rest = path;
    match path.first()?.as_str() {
        "crate" => {
            base.clear();
            rest = &path[1..];
        }
        "self" => rest = &path[1..],
        "super" => {
            while rest.first().is_some_and(|p| p == "super") {
                base.pop()?;
                rest = &rest[1..];
            }
        }
        child => {
            let is_child = modules.contains_key(&[here, &[child.to_owned()]].concat());
            if !is_child {
                return None;
            }
        }
    }
    base.extend(rest.iter().cloned());
    Some(base)
}

impl SourceModule {
    fn read(source: &str, here: &[String], modules: &BTreeMap<ItemPath, String>) -> Self {
        let file = syn::parse_file(source).expect("source of the workspace is Rust");
        let mut found = Self::default();
        for item in &file.items {
            let name = match item {
                Item::Use(item) => {
                    let mut paths = Vec::new();
                    flatten(&item.tree, &mut Vec::new(), &mut paths);
                    for (path, name) in paths {
                        let Some(path) = absolute(&path, here, modules) else { continue };
                        if matches!(item.vis, Visibility::Inherited) {
                            found.imported.push(path);
                        } else {
                            found.handed_on.insert(name, path);
                        }
                    }
                    continue;
                }
                Item::Struct(i) => &i.ident,
                Item::Enum(i) => &i.ident,
                Item::Trait(i) => &i.ident,
                Item::Type(i) => &i.ident,
                Item::Fn(i) => &i.sig.ident,
                Item::Const(i) => &i.ident,
                Item::Static(i) => &i.ident,
                _ => continue,
            };
            found.defined.insert(name.to_string());
        }
        found
    }
}

/// The file that an absolute path leads to, followed through names that are handed on.
fn target<'a>(
    path: &[String],
    modules: &'a BTreeMap<ItemPath, String>,
    sources: &BTreeMap<ItemPath, SourceModule>,
    depth: usize,
) -> Option<&'a str> {
    let length = (0..=path.len()).rev().find(|&n| modules.contains_key(&path[..n]))?;
    let (module, rest) = path.split_at(length);
    let file = modules[module].as_str();
    let Some(name) = rest.first() else { return Some(file) };
    let source = &sources[module];
    match source.handed_on.get(name) {
        Some(path) if !source.defined.contains(name) && depth < 8 => {
            target(path, modules, sources, depth + 1)
        }
        _ => source.defined.contains(name).then_some(file),
    }
}

/// Groups of files of one crate that import each other.
fn circles(files: &[File]) -> Vec<Vec<String>> {
    let mut crates: BTreeMap<&str, Vec<(&File, ItemPath)>> = BTreeMap::new();
    for file in files {
        if let Some((folder, path)) = module_path(&file.path) {
            crates.entry(folder).or_default().push((file, path));
        }
    }
    let mut found = Vec::new();
    for files in crates.values() {
        let modules: BTreeMap<ItemPath, String> =
            files.iter().map(|(file, path)| (path.clone(), file.path.clone())).collect();
        let sources: BTreeMap<ItemPath, SourceModule> = files
            .iter()
            .map(|(file, path)| (path.clone(), SourceModule::read(&file.text, path, &modules)))
            .collect();
        let mut arrows: BTreeMap<&str, BTreeSet<&str>> = BTreeMap::new();
        for (path, source) in &sources {
            let from = modules[path].as_str();
            let to = source.imported.iter().filter_map(|p| target(p, &modules, &sources, 0));
            arrows.entry(from).or_default().extend(to.filter(|&to| to != from));
        }
        found.extend(loops(&arrows));
    }
    found
}

/// Files reachable from `start`.
fn reachable<'a>(start: &str, arrows: &BTreeMap<&'a str, BTreeSet<&'a str>>) -> BTreeSet<&'a str> {
    let mut seen = BTreeSet::new();
    let mut open = vec![start];
    while let Some(file) = open.pop() {
        for &next in arrows.get(file).into_iter().flatten() {
            if seen.insert(next) {
                open.push(next);
            }
        }
    }
    seen
}

fn loops(arrows: &BTreeMap<&str, BTreeSet<&str>>) -> Vec<Vec<String>> {
    let reach: BTreeMap<&str, BTreeSet<&str>> =
        arrows.keys().map(|&file| (file, reachable(file, arrows))).collect();
    let mut found = BTreeSet::new();
    for (file, to) in &reach {
        if to.contains(file) {
            let ring =
                to.iter().filter(|other| reach.get(*other).is_some_and(|r| r.contains(file)));
            found.insert(ring.map(|&f| f.to_owned()).collect::<Vec<_>>());
        }
    }
    found.into_iter().collect()
}

#[test]
fn a_circle_is_found() {
    let file = |path: &str, text: &str| File { path: path.into(), text: text.into() };
    let lib = file("src/lib.rs", "mod a; mod b;");
    let a = file("src/a/mod.rs", "mod c; pub use c::C; pub struct A;");
    let c = file("src/a/c.rs", "use crate::b::B; pub struct C;");
    let turned = file("src/b.rs", "use crate::a::C; pub struct B;");
    let straight = file("src/b.rs", "use crate::a::A; pub struct B;");
    let names = vec!["src/a/c.rs".to_owned(), "src/b.rs".to_owned()];
    assert_eq!(circles(&[lib, a, c, turned]), [names]);
    let lib = file("src/lib.rs", "mod a; mod b;");
    let a = file("src/a/mod.rs", "mod c; pub use c::C; pub struct A;");
    let c = file("src/a/c.rs", "use crate::b::B; pub struct C;");
    assert!(circles(&[lib, a, c, straight]).is_empty());
}

#[test]
fn files_do_not_import_each_other() {
    let say = |ring: Vec<String>| format!("these files import each other: {}", ring.join(", "));
    crate::none(circles(&tree::sources()).into_iter().map(say).collect());
}
