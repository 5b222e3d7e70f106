//! The patches for RustDDS fit the version that is used. A new version of RustDDS fails here: look which faults it still has, and remove the
//! measures against the others (`src/dds/system_calls.rs`, `own_machine.rs`, `datagram.rs`, `large_reply.rs`) with their patches.

#![allow(clippy::disallowed_methods, reason = "the test copies files and starts programs")]

use std::path::{Path, PathBuf};
use std::process::Command;

/// Returns the folder of the RustDDS that this workspace uses.
fn rustdds() -> PathBuf {
    let cargo = std::env::var_os("CARGO").expect("cargo sets it");
    let arguments = ["metadata", "--format-version", "1", "--offline", "--filter-platform", "x86_64-unknown-linux-gnu"];
    let output =
        Command::new(cargo).args(arguments).current_dir(env!("CARGO_MANIFEST_DIR")).output().expect("cargo runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let metadata: serde_json::Value = serde_json::from_slice(&output.stdout).expect("cargo prints JSON");
    let packages = metadata["packages"].as_array().expect("the packages of the workspace");
    let package = packages.iter().find(|package| package["name"] == "rustdds").expect("rustdds is a dependency");
    let manifest = Path::new(package["manifest_path"].as_str().expect("each package has a manifest"));
    manifest.parent().expect("a manifest is in a folder").to_owned()
}

#[test]
fn every_patch_fits_the_rustdds_in_use_alone_and_with_the_others() {
    let source = rustdds();
    let version = source.file_name().unwrap().to_str().unwrap().to_owned();
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("patches");
    let mut patches: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    patches.sort();
    assert_eq!(patches.len(), 4);
    let scratch = Path::new(env!("CARGO_TARGET_TMPDIR")).join("rustdds_patched");
    for set in patches.iter().map(|patch| vec![patch]).chain([patches.iter().collect()]) {
        let _none = std::fs::remove_dir_all(&scratch);
        std::fs::create_dir_all(&scratch).unwrap();
        assert!(Command::new("cp").arg("-R").arg(source.join("src")).arg(&scratch).status().unwrap().success());
        for patch in set {
            let name = patch.file_name().unwrap().to_str().unwrap();
            assert!(name.starts_with(&format!("{version}-")), "{name} is for another version than {version}");
            // Inside of a repository git passes over files that it does not track.
            let outside = scratch.parent().unwrap();
            let mut git = Command::new("git");
            git.arg("apply").arg(patch).current_dir(&scratch).env("GIT_CEILING_DIRECTORIES", outside);
            let git = git.output().unwrap();
            assert!(git.status.success(), "{name}: {}", String::from_utf8_lossy(&git.stderr));
            let first = std::fs::read_to_string(patch).unwrap();
            let changed = first.lines().find_map(|line| line.strip_prefix("+++ b/")).unwrap();
            assert_ne!(
                std::fs::read(scratch.join(changed)).unwrap(),
                std::fs::read(source.join(changed)).unwrap(),
                "{name}"
            );
        }
    }
}
