//! Definitions of message types: built in, or from the ROS 2 packages on `AMENT_PREFIX_PATH`.
#![allow(clippy::disallowed_methods, reason = "installed packages are found by the environment, and are files")]

use crate::writer::TopicType;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Message type with its RIHS01 hash and its ros2msg text.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Definition {
    pub(crate) name: String,
    pub(crate) hash: String,
    pub(crate) text: String,
}

impl Definition {
    pub(crate) fn topic_type(&self) -> TopicType<'_> {
        TopicType { name: &self.name, hash: &self.hash, definition: &self.text }
    }
}

/// Definition of the type called `name`; none if it is neither built in nor installed.
pub(crate) fn find(name: &str) -> Option<Definition> {
    if let Some(info) = catenary_msgs::find(name) {
        let (hash, text) = (info.type_hash.to_owned(), info.definition.to_owned());
        return Some(Definition { name: name.to_owned(), hash, text });
    }
    let prefixes = std::env::var_os("AMENT_PREFIX_PATH")?;
    let prefixes: Vec<PathBuf> = std::env::split_paths(&prefixes).collect();
    find_installed(name, &prefixes)
}

fn find_installed(name: &str, prefixes: &[PathBuf]) -> Option<Definition> {
    let file = |(package, name): (&str, &str), ending: &str| {
        let inside = Path::new("share").join(package).join("msg").join(format!("{name}.{ending}"));
        prefixes.iter().find_map(|prefix| std::fs::read_to_string(prefix.join(&inside)).ok())
    };
    let root = split(name)?;
    let mut text = file(root, "msg")?.trim_end().to_owned();
    // A ros2msg text holds the definitions of all nested types behind the type itself, each of them once.
    let mut waiting: Vec<String> = nested(&text, root.0);
    let mut known = BTreeSet::from([name.to_owned()]);
    while !waiting.is_empty() {
        for kind in std::mem::take(&mut waiting) {
            if !known.insert(kind.clone()) {
                continue;
            }
            let (package, short) = split(&kind)?;
            let body = file((package, short), "msg")?;
            text.push_str(&format!("\n{}\nMSG: {package}/{short}\n{}", "=".repeat(80), body.trim_end()));
            waiting.extend(nested(&body, package));
        }
    }
    let hash = file(root, "json").and_then(|json| hash(&json, name)).unwrap_or_default();
    Some(Definition { name: name.to_owned(), hash, text: format!("{text}\n") })
}

/// Splits `package/msg/Type` into package and type.
fn split(name: &str) -> Option<(&str, &str)> {
    let mut parts = name.split('/');
    match (parts.next()?, parts.next()?, parts.next()?, parts.next()) {
        (package, "msg", name, None) => Some((package, name)),
        _ => None,
    }
}

/// Message types of the fields of a .msg text. Primitive types are left out.
fn nested(text: &str, package: &str) -> Vec<String> {
    let fields = text.lines().filter_map(|line| line.split('#').next()?.split_whitespace().next());
    // Bounds of arrays and strings (`[3]`, `[<=8]`, `<=5`) follow the name of the type.
    let kinds = fields.map(|field| field.split(['[', '<']).next().unwrap_or_default());
    let is_message = |kind: &&str| kind.contains('/') || kind.starts_with(|c: char| c.is_ascii_uppercase());
    kinds
        .filter(is_message)
        .map(|kind| match kind.split('/').collect::<Vec<_>>()[..] {
            [package, _, name] | [package, name] => format!("{package}/msg/{name}"),
            _ => format!("{package}/msg/{kind}"),
        })
        .collect()
}

/// RIHS01 hash in the .json file that rosidl installs beside a type.
fn hash(json: &str, name: &str) -> Option<String> {
    let document: serde_json::Value = serde_json::from_str(json).ok()?;
    let row = document["type_hashes"].as_array()?.iter().find(|row| row["type_name"] == name)?.clone();
    Some(row["hash_string"].as_str()?.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_installed_type_comes_with_the_types_of_its_fields() {
        let folder = tempfile::tempdir().unwrap();
        let put = |path: &str, text: &str| {
            let path = folder.path().join("share").join(path);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, text).unwrap();
        };
        put(
            "lab_msgs/msg/Scan.msg",
            "std_msgs/Header header\nBin[<=8] bins  # of Nothing\nuint8 KIND=1\nstring<=5 name\n",
        );
        put("lab_msgs/msg/Bin.msg", "float64[3] edges\nstd_msgs/msg/Header header\n");
        put(
            "lab_msgs/msg/Scan.json",
            r#"{"type_hashes": [{"type_name": "lab_msgs/msg/Scan", "hash_string": "RIHS01_0"}]}"#,
        );
        let prefixes = [folder.path().join("none"), folder.path().to_owned()];
        assert_eq!(find_installed("lab_msgs/msg/Scan", &prefixes), None, "std_msgs/Header is missing");
        put("std_msgs/msg/Header.msg", "builtin_interfaces/Time stamp\nstring frame_id\n");
        put("builtin_interfaces/msg/Time.msg", "int32 sec\nuint32 nanosec\n");
        let found = find_installed("lab_msgs/msg/Scan", &prefixes).unwrap();
        assert_eq!(found.hash, "RIHS01_0");
        let titles: Vec<&str> = found.text.lines().filter(|l| l.starts_with("MSG: ")).collect();
        assert_eq!(titles, ["MSG: std_msgs/Header", "MSG: lab_msgs/Bin", "MSG: builtin_interfaces/Time"]);
        assert_eq!(find_installed("lab_msgs/srv/Scan", &prefixes), None);
    }

    #[test]
    fn built_in_types_need_no_installation() {
        let found = find("geometry_msgs/msg/PoseStamped").unwrap();
        assert!(found.hash.starts_with("RIHS01_") && found.text.contains("MSG: geometry_msgs/Quaternion"));
    }
}
