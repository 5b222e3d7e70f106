//! The workspace, as cargo describes it to the tests of the architecture.

use serde_json::Value;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Root of the workspace.
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// String of a JSON value.
pub fn text(value: &Value) -> String {
    value.as_str().unwrap().to_owned()
}

/// Packages of the workspace.
pub fn packages() -> Vec<Value> {
    let output = Command::new(env!("CARGO"))
        .args(["metadata", "--no-deps", "--format-version", "1"])
        .current_dir(root())
        .output()
        .unwrap();
    let metadata: Value = serde_json::from_slice(&output.stdout).unwrap();
    metadata["packages"].as_array().unwrap().clone()
}

/// Folder of each crate below `nodes/`: "method/core", or "catenary".
pub fn places() -> BTreeMap<String, String> {
    let place = |package: &Value| {
        let manifest = text(&package["manifest_path"]);
        let folder = Path::new(&manifest).parent().unwrap().to_str().unwrap();
        folder.rsplit_once("/nodes/").map(|(_, place)| (text(&package["name"]), place.to_owned()))
    };
    packages().iter().filter_map(place).collect()
}
