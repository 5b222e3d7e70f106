//! Build script: it collects the launch files, parameters and models, which the program installs without its sources,
//! and determines the commit that the program is built from.

#![allow(clippy::disallowed_methods, clippy::print_stdout, reason = "a build script speaks to cargo and reads files")]

use std::fmt::Write;
use std::path::{Path, PathBuf};

/// All files below `folder`, sorted by path.
fn files(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).expect("launch_configs lies beside nodes");
    let mut paths: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).collect();
    paths.sort();
    paths.into_iter().flat_map(|path| if path.is_dir() { files(&path) } else { vec![path] }).collect()
}

/// Sources of the program relative to the workspace's root. A change in them marks the commit as dirty.
const SOURCES: [&str; 5] = ["nodes", "msgs", "launch_configs", "Cargo.toml", "Cargo.lock"];

/// Output of git in `root`; `None` if git is missing or fails.
fn git(root: &Path, arguments: &[&str]) -> Option<String> {
    // Without optional locks, because `git status` writes to the index otherwise.
    let mut command = std::process::Command::new("git");
    let done = command.arg("-C").arg(root).args(arguments).env("GIT_OPTIONAL_LOCKS", "0").output().ok()?;
    done.status.success().then(|| String::from_utf8_lossy(&done.stdout).trim().to_owned())
}

/// Commit of the checkout at `root`, with `-dirty` if sources differ from it; `None` outside a checkout of this
/// project.
fn commit(root: &Path) -> Option<String> {
    // Sources unpacked inside another project's checkout do not belong to its commit.
    let top = std::fs::canonicalize(git(root, &["rev-parse", "--show-toplevel"])?).ok()?;
    if top != std::fs::canonicalize(root).ok()? {
        return None;
    }
    let commit = git(root, &["rev-parse", "--short=10", "HEAD"])?;
    let status = ["status", "--porcelain", "--untracked-files=no", "--"];
    let changed = git(root, &[&status[..], &SOURCES[..]].concat())?;
    Some(if changed.is_empty() { commit } else { commit + "-dirty" })
}

/// Entries of a folder; none if it cannot be read.
fn below(folder: &Path) -> Vec<PathBuf> {
    std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path()).collect()
}

/// Makes cargo run this script again when the commit or the sources change, and only then.
fn watch(root: &Path) {
    let log = git(root, &["rev-parse", "--git-path", "logs/HEAD"]).map(|path| root.join(path));
    let sources = SOURCES.iter().flat_map(|source| match *source {
        // Tests and benches are not part of the program.
        "nodes" => {
            // The program itself, and the crates in their groups.
            let groups = below(&root.join("nodes"));
            groups.iter().cloned().chain(groups.iter().flat_map(|group| below(group))).map(|p| p.join("src")).collect()
        }
        source => vec![root.join(source)],
    });
    // Cargo would treat a missing file as a change and run the script at every build.
    for path in sources.chain(log).filter(|path| path.exists()) {
        println!("cargo::rerun-if-changed={}", path.display());
    }
}

fn main() {
    let root = Path::new(&std::env::var("CARGO_MANIFEST_DIR").expect("cargo sets it")).join("../..");
    let folder = root.join("launch_configs");
    watch(&root);
    let version = std::env::var("CARGO_PKG_VERSION").expect("cargo sets it");
    let version = commit(&root).map_or(version.clone(), |commit| format!("{version} ({commit})"));
    println!("cargo::rustc-env=CATENARY_VERSION={version}");
    let mut table = String::from("&[\n");
    let is_picture = |path: &PathBuf| path.extension().is_some_and(|ending| ending == "png");
    // Stand-ins serve a checkout only: an installation has the nodes themselves.
    let is_stand_in = |path: &PathBuf| path.starts_with(folder.join("bin"));
    for path in files(&folder).into_iter().filter(|path| !is_picture(path) && !is_stand_in(path)) {
        let name = path.strip_prefix(&folder).expect("it lies below").display().to_string();
        writeln!(table, "    ({name:?}, include_bytes!({:?})),", path.display().to_string()).expect("a string grows");
    }
    table.push_str("]\n");
    let out = Path::new(&std::env::var("OUT_DIR").expect("cargo sets it")).join("launch_configs.rs");
    std::fs::write(out, table).expect("cargo's folder can be written");
}
