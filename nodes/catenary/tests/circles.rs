//! No circle of files: a file imports no other that, directly or through others, imports it. Files in a circle can be neither
//! read nor tested one after the other. An import is a name in a file: paths of `use` items, types and expressions, followed
//! through re-exports to the file that defines the name. Tests inside a file are left out, and so are bodies of macros.
#![allow(
    clippy::disallowed_methods,
    clippy::unwrap_used,
    reason = "a test reads the workspace, and a failure is a panic"
)]

mod workspace;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use syn::visit::{self, Visit};

/// Path from the root of the crate to a module, or to an item in it.
type Names = Vec<String>;

/// Items and imports of one file.
#[derive(Default)]
struct Room {
    file: PathBuf,
    module: Names,
    defined: BTreeSet<String>,
    /// Absolute path behind each imported name.
    imported: BTreeMap<String, Names>,
    /// Imported names that the file only hands on (`pub use`). They are no need of the file itself.
    handed_on: BTreeSet<String>,
    /// Modules of which everything is imported.
    globs: Vec<Names>,
    /// Paths that the file names from `crate`, `self` or `super` on, made absolute.
    mentioned: Vec<Names>,
    /// Other paths that the file names. They begin with an imported name, a module of the file, or another crate.
    relative: Vec<Names>,
}

impl Room {
    fn absolute(&self, path: &[String]) -> Option<Names> {
        let mut at = match path.first()?.as_str() {
            "crate" => Names::new(),
            "self" => self.module.clone(),
            "super" => {
                let mut at = self.module.clone();
                at.pop();
                at
            }
            _ => return None,
        };
        for name in &path[1..] {
            match name.as_str() {
                "super" => drop(at.pop()),
                _ => at.push(name.clone()),
            }
        }
        Some(at)
    }

    fn import(&mut self, before: &Names, tree: &syn::UseTree) {
        let with = |name: &syn::Ident| {
            let mut path = before.clone();
            path.push(name.to_string());
            path
        };
        let (path, name) = match tree {
            syn::UseTree::Path(part) => return self.import(&with(&part.ident), &part.tree),
            syn::UseTree::Group(group) => return group.items.iter().for_each(|tree| self.import(before, tree)),
            syn::UseTree::Glob(_) => {
                self.globs.extend(self.absolute(before));
                return;
            }
            syn::UseTree::Name(name) if name.ident == "self" => {
                (before.clone(), before.last().cloned().unwrap_or_default())
            }
            syn::UseTree::Name(name) => (with(&name.ident), name.ident.to_string()),
            syn::UseTree::Rename(name) => (with(&name.ident), name.rename.to_string()),
        };
        // `use child::Name` in the file that declares `mod child` begins with no keyword.
        let path = self.absolute(&path).or_else(|| {
            let child = self.defined.contains(&format!("mod {}", path.first()?));
            child.then(|| self.module.iter().chain(&path).cloned().collect())
        });
        if let Some(path) = path {
            self.imported.insert(name, path);
        }
    }
}

fn of_tests(attributes: &[syn::Attribute]) -> bool {
    let words = |a: &syn::Attribute| a.meta.require_list().map(|list| list.tokens.to_string()).unwrap_or_default();
    attributes
        .iter()
        .any(|a| a.path().is_ident("cfg") && words(a).split(|c: char| !c.is_alphanumeric()).any(|w| w == "test"))
}

impl<'a> Visit<'a> for Room {
    fn visit_item(&mut self, item: &'a syn::Item) {
        let (attributes, name) = match item {
            syn::Item::Mod(item) if item.content.is_none() => (&item.attrs, Some(format!("mod {}", item.ident))),
            syn::Item::Mod(item) => (&item.attrs, Some(item.ident.to_string())),
            syn::Item::Fn(item) => (&item.attrs, Some(item.sig.ident.to_string())),
            syn::Item::Struct(item) => (&item.attrs, Some(item.ident.to_string())),
            syn::Item::Enum(item) => (&item.attrs, Some(item.ident.to_string())),
            syn::Item::Trait(item) => (&item.attrs, Some(item.ident.to_string())),
            syn::Item::Type(item) => (&item.attrs, Some(item.ident.to_string())),
            syn::Item::Const(item) => (&item.attrs, Some(item.ident.to_string())),
            syn::Item::Static(item) => (&item.attrs, Some(item.ident.to_string())),
            syn::Item::Impl(item) => (&item.attrs, None),
            syn::Item::Use(item) => (&item.attrs, None),
            _ => return,
        };
        if !of_tests(attributes) {
            self.defined.extend(name);
            visit::visit_item(self, item);
        }
    }

    fn visit_item_use(&mut self, item: &'a syn::ItemUse) {
        let before: BTreeSet<String> = self.imported.keys().cloned().collect();
        self.import(&Names::new(), &item.tree);
        if !matches!(item.vis, syn::Visibility::Inherited) {
            self.handed_on.extend(self.imported.keys().filter(|name| !before.contains(*name)).cloned());
        }
    }

    fn visit_path(&mut self, path: &'a syn::Path) {
        let names: Names = path.segments.iter().map(|s| s.ident.to_string()).collect();
        match self.absolute(&names) {
            Some(absolute) => self.mentioned.push(absolute),
            None => self.relative.push(names),
        }
        visit::visit_path(self, path);
    }
}

fn read(file: &Path, src: &Path) -> Room {
    let inside = file.strip_prefix(src).unwrap().with_extension("");
    let mut module: Names = inside.iter().map(|part| part.to_str().unwrap().to_owned()).collect();
    if matches!(module.last().map(String::as_str), Some("mod" | "lib" | "main")) {
        module.pop();
    }
    let text = std::fs::read_to_string(file).unwrap();
    let parsed = syn::parse_file(&text).unwrap_or_else(|e| panic!("{}: {e}", file.display()));
    let mut room = Room { file: file.to_owned(), module, ..Room::default() };
    // Declared modules first, so that `use child::Name` is understood whatever the order.
    for item in &parsed.items {
        if let syn::Item::Mod(item) = item {
            room.defined.insert(format!("mod {}", item.ident));
        }
    }
    room.visit_file(&parsed);
    room
}

/// Rooms of one crate by their modules.
struct House(BTreeMap<Names, Room>);

impl House {
    /// File that defines an absolute path, followed through re-exports; none for a module as a whole.
    fn home(&self, path: &[String], steps: usize) -> Option<&Room> {
        let depth = (0..=path.len()).rev().find(|n| self.0.contains_key(&path[..*n]))?;
        let room = &self.0[&path[..depth]];
        let name = path.get(depth)?;
        // Re-exports are few: eight steps end a circle of them.
        if steps == 8 || room.defined.contains(name) {
            return Some(room);
        }
        if let Some(origin) = room.imported.get(name) {
            let rest = origin.iter().chain(&path[depth + 1..]).cloned().collect::<Names>();
            return self.home(&rest, steps + 1);
        }
        let globbed = room.globs.iter().map(|g| g.iter().chain(&path[depth..]).cloned().collect::<Names>());
        globbed.filter_map(|g| self.home(&g, steps + 1)).find(|r| r.defined.contains(name)).or(Some(room))
    }

    /// Files that a room needs.
    fn needs(&self, room: &Room) -> BTreeSet<&Path> {
        let local = |path: &Names| match path.first() {
            Some(first) if room.imported.contains_key(first) => {
                Some(room.imported[first].iter().chain(&path[1..]).cloned().collect())
            }
            Some(first) if path.len() > 1 && room.defined.contains(&format!("mod {first}")) => {
                Some(room.module.iter().chain(path).cloned().collect::<Names>())
            }
            _ => None,
        };
        let mentioned = room.mentioned.iter().cloned().chain(room.relative.iter().filter_map(local));
        let imported = room.imported.iter().filter(|(name, _)| !room.handed_on.contains(*name));
        let named = mentioned.chain(imported.map(|(_, path)| path.clone()));
        let homes = named.filter_map(|path| self.home(&path, 0).map(|r| r.file.as_path()));
        homes.filter(|file| *file != room.file && !is_face(file)).collect()
    }

    /// Files from which `file` is reached, and that it reaches.
    fn circle(&self, file: &Path, arrows: &BTreeMap<&Path, BTreeSet<&Path>>) -> BTreeSet<PathBuf> {
        let reach = |from: &Path| {
            let mut seen = BTreeSet::new();
            let mut open: Vec<PathBuf> = vec![from.to_owned()];
            while let Some(at) = open.pop() {
                for next in &arrows[at.as_path()] {
                    if seen.insert(next.to_path_buf()) {
                        open.push(next.to_path_buf());
                    }
                }
            }
            seen
        };
        reach(file).into_iter().filter(|other| reach(other).contains(file)).collect()
    }
}

/// The file of a crate that only hands names on.
fn is_face(file: &Path) -> bool {
    file.ends_with("src/lib.rs") || file.ends_with("src/main.rs")
}

fn circles(src: &Path) -> BTreeSet<BTreeSet<PathBuf>> {
    let files = rust_files(src);
    let rooms = files.iter().filter(|f| !f.strip_prefix(src).unwrap().starts_with("bin")).map(|f| read(f, src));
    // A crate with both faces has one root: what lib.rs declares is what others name.
    let mut house = House(BTreeMap::new());
    for room in rooms {
        if !(room.file.ends_with("main.rs") && src.join("lib.rs").exists()) {
            house.0.insert(room.module.clone(), room);
        }
    }
    let arrows: BTreeMap<&Path, BTreeSet<&Path>> = house
        .0
        .values()
        .map(|room| (room.file.as_path(), if is_face(&room.file) { BTreeSet::new() } else { house.needs(room) }))
        .collect();
    arrows.keys().map(|file| house.circle(file, &arrows)).filter(|circle| !circle.is_empty()).collect()
}

fn rust_files(folder: &Path) -> Vec<PathBuf> {
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let test = path.file_stem().is_some_and(|s| s == "tests");
        if path.is_dir() && !test {
            files.extend(rust_files(&path));
        } else if path.extension().is_some_and(|e| e == "rs") && !test {
            files.push(path);
        }
    }
    files.sort();
    files
}

#[test]
fn no_file_imports_one_that_imports_it() {
    let nodes = workspace::root().join("nodes");
    let crates = workspace::places();
    // Guards against a search that finds nothing and therefore passes.
    assert!(crates.len() > 15, "found {} crates: the search is broken", crates.len());
    let mut found = Vec::new();
    for place in crates.values() {
        for circle in circles(&nodes.join(place).join("src")) {
            let names: Vec<String> =
                circle.iter().map(|f| f.strip_prefix(&nodes).unwrap().display().to_string()).collect();
            found.push(names.join(", "));
        }
    }
    assert!(found.is_empty(), "circles of files:\n{}", found.join("\n"));
}

#[test]
fn a_circle_through_a_re_export_is_found() {
    let folder = tempfile::tempdir().unwrap();
    let src = folder.path().join("src");
    std::fs::create_dir_all(src.join("upper")).unwrap();
    let write = |name: &str, text: &str| std::fs::write(src.join(name), text).unwrap();
    write("lib.rs", "pub mod upper; pub mod lower;");
    write("upper.rs", "mod part; pub use part::Part; pub struct Whole(Part);");
    write("upper/part.rs", "pub struct Part;");
    write("lower.rs", "pub fn f(_: crate::upper::Part) {} #[cfg(test)] mod tests { use crate::upper::Whole; }");
    assert!(circles(&src).is_empty());
    write("upper/part.rs", "use crate::lower; pub struct Part; fn g() { lower::f(Part) }");
    let circle = circles(&src).pop_first().unwrap();
    assert_eq!(circle.len(), 2, "{circle:?}");
    assert!(circle.contains(&src.join("lower.rs")) && circle.contains(&src.join("upper/part.rs")));
}
