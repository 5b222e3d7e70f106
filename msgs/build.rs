//! Generates the Rust side of every interface from its .msg, .srv or .action file.

#[path = "generate/describe.rs"]
mod describe;
#[path = "generate/parse.rs"]
mod parse;
#[path = "generate/rust.rs"]
mod rust;

use describe::Catalogue;
use parse::{Base, Section};
use std::collections::BTreeMap;
use std::error::Error;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Package with its files in this folder; the files of every other package are in `ros_interfaces/PACKAGE`.
const OWN: &str = "catenary_msgs";

/// Interface file.
struct Interface {
    package: String,
    kind: String,
    name: String,
    /// Text of the file.
    text: String,
    /// Text of each section, unchanged.
    texts: Vec<String>,
    sections: Vec<Section>,
}

impl Interface {
    fn full_name(&self) -> String {
        format!("{}/{}/{}", self.package, self.kind, self.name)
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let root = PathBuf::from(std::env::var("CARGO_MANIFEST_DIR")?);
    for watched in ["msg", "srv", "action", "ros_interfaces", "generate", "build.rs"] {
        println!("cargo:rerun-if-changed={watched}");
    }
    let mut interfaces = Vec::new();
    read_package(&root, OWN, &mut interfaces)?;
    for package in sorted(&root.join("ros_interfaces"))? {
        if package.is_dir() {
            read_package(&package, &file_stem(&package), &mut interfaces)?;
        }
    }
    let catalogue = catalogue(&interfaces);
    let source = source(&interfaces, &catalogue)?;
    std::fs::write(PathBuf::from(std::env::var("OUT_DIR")?).join("interfaces.rs"), source)?;
    Ok(())
}

fn sorted(folder: &Path) -> Result<Vec<PathBuf>, Box<dyn Error>> {
    let mut paths = std::fs::read_dir(folder)?.map(|e| e.map(|e| e.path())).collect::<Result<Vec<_>, _>>()?;
    paths.sort();
    Ok(paths)
}

fn file_stem(path: &Path) -> String {
    path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default()
}

fn read_package(folder: &Path, package: &str, into: &mut Vec<Interface>) -> Result<(), Box<dyn Error>> {
    for kind in ["msg", "srv", "action"] {
        let folder = folder.join(kind);
        if !folder.is_dir() {
            continue;
        }
        for path in sorted(&folder)? {
            if path.extension().is_none_or(|e| e != kind) {
                continue;
            }
            let text = std::fs::read_to_string(&path)?;
            let sections = parse::sections(&text, package).map_err(|e| format!("{}: {e}", path.display()))?;
            let expected = match kind {
                "msg" => 1,
                "srv" => 2,
                _ => 3,
            };
            if sections.len() != expected {
                return Err(format!("{}: expected {expected} sections, got {}", path.display(), sections.len()).into());
            }
            let texts = texts(&text);
            into.push(Interface {
                package: package.into(),
                kind: kind.into(),
                name: file_stem(&path),
                text,
                texts,
                sections,
            });
        }
    }
    Ok(())
}

/// Returns the text of each section, without the `---` lines.
fn texts(text: &str) -> Vec<String> {
    let lines: Vec<&str> = text.lines().collect();
    lines.split(|line| line.trim() == "---").map(|section| section.iter().map(|l| format!("{l}\n")).collect()).collect()
}

fn catalogue(interfaces: &[Interface]) -> Catalogue {
    let mut catalogue = Catalogue::default();
    for i in interfaces {
        match &i.sections[..] {
            [message] => catalogue.message(&i.package, "msg", &i.name, message),
            [request, response] => {
                catalogue.service(&i.package, "srv", &i.name, request.fields.clone(), response.fields.clone());
            }
            [goal, result, feedback] => catalogue.action(&i.package, &i.name, goal, result, feedback),
            _ => unreachable!("the number of sections was checked"),
        }
    }
    catalogue
}

/// Returns the ros2msg text: `text`, then every nested definition after a line of 80 `=` and its name, as rosbag2 writes it.
fn definition(text: &str, section: &Section, interfaces: &[Interface]) -> Result<String, String> {
    let mut out = text.to_owned();
    // Breadth first and each type once: the order and the form of rosbag2, which other readers parse.
    let mut done: Vec<(String, String)> = Vec::new();
    let mut open: Vec<(String, String)> = nested(section);
    while !open.is_empty() {
        let (package, name) = open.remove(0);
        if done.contains(&(package.clone(), name.clone())) {
            continue;
        }
        let inner = interfaces
            .iter()
            .find(|i| i.package == package && i.kind == "msg" && i.name == name)
            .ok_or_else(|| format!("no definition of `{package}/msg/{name}`"))?;
        let _ = write!(out, "\n{}\nMSG: {package}/{name}\n{}", "=".repeat(80), inner.texts[0]);
        open.extend(nested(&inner.sections[0]));
        done.push((package, name));
    }
    Ok(out)
}

fn nested(section: &Section) -> Vec<(String, String)> {
    let message = |base: &Base| match base {
        Base::Message(package, name) => Some((package.clone(), name.clone())),
        Base::Primitive(_) => None,
    };
    section.fields.iter().filter_map(|f| message(&f.base)).collect()
}

fn source(interfaces: &[Interface], catalogue: &Catalogue) -> Result<String, Box<dyn Error>> {
    let mut modules: BTreeMap<(String, String), String> = BTreeMap::new();
    let mut messages = String::new();
    let mut structures = String::new();
    let mut markers = String::new();
    let mut sources = String::new();
    for i in interfaces {
        let _ = writeln!(sources, "    ({:?}, {:?}, {:?}),", i.full_name(), i.kind, i.text);
        let out = modules.entry((i.package.clone(), i.kind.clone())).or_default();
        out.push_str(&interface(i, interfaces, catalogue)?);
        let path = format!("{}::{}::{}", i.package, i.kind, i.name);
        if i.kind == "msg" {
            let _ = writeln!(messages, "    InterfaceInfo::of::<crate::{path}>(),");
        } else {
            let _ = writeln!(markers, "    ({:?}, {:?}),", i.full_name(), catalogue.hash(&i.full_name())?);
        }
        for suffix in suffixes(&i.kind) {
            let _ = writeln!(structures, "            $row::<$crate::{path}{suffix}>(),");
        }
    }
    let mut out = String::new();
    let packages: std::collections::BTreeSet<&String> = modules.keys().map(|(p, _)| p).collect();
    for package in packages {
        let _ = writeln!(out, "/// Interfaces of the package `{package}`.\npub mod {package} {{");
        for ((_, kind), body) in modules.iter().filter(|((p, _), _)| p == package) {
            let _ = writeln!(out, "/// Its .{kind} files.\npub mod {kind} {{\n{body}}}");
        }
        out.push_str("}\n");
    }
    let _ = writeln!(out, "static MESSAGES: &[InterfaceInfo] = &[\n{messages}];");
    let _ = writeln!(out, "static STRUCTURES: &[StructureInfo] = &[\n{}];", catalogue.rows()?);
    let _ = writeln!(out, "static SOURCES: &[(&str, &str, &str)] = &[\n{sources}];");
    let _ = writeln!(out, "static MARKERS: &[(&str, &str)] = &[\n{markers}];");
    let _ = writeln!(
        out,
        "/// A vector of `$row::<T>()` for every structure: messages, requests, responses, goals, results and feedbacks.\n#[cfg(feature = \"filled\")]\n#[macro_export]\nmacro_rules! for_each_structure {{\n    ($row:ident) => {{\n        vec![\n{structures}        ]\n    }};\n}}"
    );
    Ok(out)
}

/// Suffixes of the Rust type names of an interface.
fn suffixes(kind: &str) -> &'static [&'static str] {
    match kind {
        "msg" => &[""],
        "srv" => &["Request", "Response"],
        _ => &["Goal", "Result", "Feedback"],
    }
}

/// Returns the source of all Rust types of one interface file.
fn interface(i: &Interface, all: &[Interface], catalogue: &Catalogue) -> Result<String, Box<dyn Error>> {
    let full_name = i.full_name();
    let comment = &i.sections[0].comment;
    let suffixes = suffixes(&i.kind);
    let mut out = String::new();
    for (k, suffix) in suffixes.iter().enumerate() {
        let type_name = if suffix.is_empty() { full_name.clone() } else { format!("{full_name}_{suffix}") };
        let hash = catalogue.hash(&type_name)?;
        let definition = definition(&i.texts[k], &i.sections[k], all)?;
        let part = [format!("{suffix} of `{}`.", i.name)];
        let emitted = rust::Emitted {
            name: &format!("{}{suffix}", i.name),
            type_name: &type_name,
            hash: &hash,
            definition: &definition,
            comment: if suffix.is_empty() { comment } else { &part },
        };
        out.push_str(&rust::structure(&emitted, &i.sections[k]));
    }
    if i.kind != "msg" {
        let trait_name = if i.kind == "srv" { "ServiceInterface" } else { "ActionInterface" };
        let parts: Vec<(&str, String)> = suffixes.iter().map(|s| (*s, format!("{}{s}", i.name))).collect();
        // Response of a service or result of an action.
        let refusal = rust::refusal(&parts[1].1, &i.sections[1].fields);
        let hash = catalogue.hash(&full_name)?;
        out.push_str(&rust::marker(&i.name, trait_name, &full_name, &hash, comment, &parts, &refusal));
    }
    Ok(out)
}
