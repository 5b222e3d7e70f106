//! Collects the launch files, parameters and models, so that the program can install them without its sources.

#![allow(clippy::disallowed_methods, clippy::print_stdout, reason = "a build script speaks to cargo and reads files")]

use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Every file below `folder`, by path.
fn files(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).expect("launch_configs lies beside nodes");
    let mut paths: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).collect();
    paths.sort();
    paths.into_iter().flat_map(|path| if path.is_dir() { files(&path) } else { vec![path] }).collect()
}

fn main() {
    let folder = Path::new(&std::env::var("CARGO_MANIFEST_DIR").expect("cargo sets it")).join("../../launch_configs");
    println!("cargo::rerun-if-changed={}", folder.display());
    let mut table = String::from("&[\n");
    let is_picture = |path: &PathBuf| path.extension().is_some_and(|ending| ending == "png");
    for path in files(&folder).into_iter().filter(|path| !is_picture(path)) {
        let name = path.strip_prefix(&folder).expect("it lies below").display().to_string();
        writeln!(table, "    ({name:?}, include_bytes!({:?})),", path.display().to_string()).expect("a string grows");
    }
    table.push_str("]\n");
    let out = Path::new(&std::env::var("OUT_DIR").expect("cargo sets it")).join("launch_configs.rs");
    std::fs::write(out, table).expect("cargo's folder can be written");
}
