//! Architecture of the workspace: dependency arrows run one way, and wire types stay in node shells. An algorithm that
//! starts to depend on another one, on DDS or on message types could no longer be tested or replaced by itself.
#![allow(
    clippy::disallowed_methods,
    clippy::unwrap_used,
    reason = "a test reads the workspace, and a failure is a panic"
)]

mod workspace;

use serde_json::Value;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;
use workspace::{packages, places, root, text};

const ALGORITHMS: [&str; 12] = [
    "camera",
    "keypoint_tracker",
    "catenary_simulator",
    "simulated_cell",
    "simulator_pool",
    "track_fit",
    "bayes_sim",
    "ppo_trainer",
    "policy_runner",
    "panda_bridge",
    "panda_emulator",
    "effect_finder",
];
/// Libraries that are built on the simulator: the cell draws its object, and the pool keeps its environments.
const ON_THE_SIMULATOR: [&str; 2] = ["simulated_cell", "simulator_pool"];

/// Libraries that run and train networks of the workspace's own kind.
const ON_NETWORKS: [&str; 2] = ["camera", "keypoint_tracker"];
/// Libraries that fit a simulator to tracks.
const ON_FITS: [&str; 2] = ["bayes_sim", "effect_finder"];

/// Groups of crates below `nodes/`, each with the groups or crates that its libraries may import besides those of the group itself:
/// "one/crate" or "group". Their node shells may import `ros`, too.
const STREET: [(&str, &[&str]); 5] = [
    ("method", &[]),
    ("eyes", &["method/core", "method/convnet"]),
    ("cell", &["method"]),
    ("arm", &["method/core"]),
    ("ros", &["method/core"]),
];
/// Imports of node shells beyond the street: the cell's arm passes the gate of the bridge, so that simulated and real targets are
/// refused alike.
const LANES: [(&str, &str); 1] = [("cell/simulated_cell", "arm/panda_bridge")];

/// Dependencies of each workspace crate on other workspace crates: name, and true if optional. Dev-dependencies do not
/// count, because they reach no shipped code.
fn arrows() -> BTreeMap<String, Vec<(String, bool)>> {
    let packages = packages();
    let ours: Vec<String> = packages.iter().map(|p| text(&p["name"])).collect();
    let of = |p: &Value| {
        let dependencies = p["dependencies"].as_array().unwrap().iter().filter(|d| d["kind"].is_null());
        dependencies
            .map(|d| (text(&d["name"]), d["optional"].as_bool().unwrap()))
            .filter(|(name, _)| ours.contains(name))
            .collect()
    };
    packages.iter().map(|p| (text(&p["name"]), of(p))).collect()
}

#[test]
fn dependency_arrows_run_one_way() {
    let arrows = arrows();
    assert!(arrows["catenary_core"].is_empty(), "core depends on {:?}", arrows["catenary_core"]);
    for name in ALGORITHMS {
        let firm: Vec<&String> = arrows[name].iter().filter(|(_, optional)| !optional).map(|(n, _)| n).collect();
        let allowed: &[&str] = if ON_THE_SIMULATOR.contains(&name) {
            &["catenary_core", "catenary_simulator"]
        } else if ON_NETWORKS.contains(&name) {
            &["catenary_core", "convnet"]
        } else if ON_FITS.contains(&name) {
            &["catenary_core", "track_fit"]
        } else {
            &["catenary_core"]
        };
        assert_eq!(firm, allowed, "the pure library of {name} may depend on no other library");
    }
    assert!(arrows["convnet"].is_empty(), "convnet depends on {:?}", arrows["convnet"]);
    for name in ["catenary_core", "catenary_msgs", "catenary_shell", "catenary_bag"] {
        let up: Vec<&(String, bool)> =
            arrows[name].iter().filter(|(n, _)| ALGORITHMS.contains(&n.as_str()) || n == "catenary").collect();
        assert!(up.is_empty(), "{name} depends on {up:?}");
    }
}

#[test]
fn groups_keep_to_the_street() {
    let (places, arrows) = (places(), arrows());
    let mut crossings = 0;
    for (name, place) in places.iter().filter(|(_, place)| *place != "catenary") {
        let group = place.split('/').next().unwrap();
        let (_, allowed) = STREET.iter().find(|(of, _)| *of == group).unwrap_or_else(|| panic!("{place}: no group"));
        for (other, is_shell) in &arrows[name] {
            // The interface files lie beside the nodes.
            let Some(to) = places.get(other) else {
                assert!(*is_shell || group == "ros", "{place} imports {other} beyond its shell");
                continue;
            };
            let their = to.split('/').next().unwrap();
            let is_known = their == group || allowed.contains(&their) || allowed.contains(&to.as_str());
            let is_of_shell = *is_shell && (their == "ros" || LANES.contains(&(place, to)));
            assert!(is_known || is_of_shell, "{place} imports {to}: {group} may import {allowed:?} alone");
            crossings += usize::from(their != group);
        }
    }
    // Guards against a search that finds nothing and therefore passes.
    assert!(crossings > 20, "found {crossings} imports across groups: the search is broken");
}

#[test]
fn wire_types_stay_in_shells() {
    let places = places();
    for name in ALGORITHMS {
        for file in rust_files(&root().join("nodes").join(&places[name]).join("src")) {
            let path = file.strip_prefix(root()).unwrap().display().to_string();
            let shell = ["/node.rs", "/node/", "/convert.rs", "/convert/", "/main.rs", "/bin/"]
                .iter()
                .any(|s| path.contains(s));
            let text = std::fs::read_to_string(&file).unwrap();
            for word in ["catenary_msgs", "catenary_shell", "ros2_client", "rustdds"] {
                assert!(shell || !text.contains(word), "{path} names {word}");
            }
        }
    }
}

#[test]
fn the_top_level_is_fixed() {
    let output = Command::new("git").args(["ls-files"]).current_dir(root()).output().unwrap();
    let listing = String::from_utf8(output.stdout).unwrap();
    let allowed =
        ["Cargo.toml", "Cargo.lock", "README.md", "LICENSE", "msgs", "nodes", "launch_configs", "bags", "tests"];
    for file in listing.lines() {
        let top = file.split('/').next().unwrap();
        assert!(top.starts_with('.') || allowed.contains(&top), "{file} lies outside the fixed top level");
    }
}

/// Name endings that state a unit.
const UNITS: [&str; 20] = [
    "_m", "_mm", "_s", "_ns", "_px", "_rad", "_deg", "_hz", "_kg", "_n", "_pa", "_m_s", "_m3", "_m2", "_per_m", "_n_m",
    "_n_m2", "_n_s_m2", "_n_s2_m3", "_scaled",
];
/// Words for quantities with a dimension.
const DIMENSIONED: [&str; 18] = [
    "length",
    "period",
    "time",
    "duration",
    "speed",
    "velocity",
    "position",
    "distance",
    "height",
    "width",
    "depth",
    "angle",
    "pitch",
    "mass",
    "density",
    "force",
    "moment",
    "stiffness",
];
/// Name endings of dimensionless physical parameters.
const PLAIN: [&str; 2] = ["_ratio", "_friction"];

#[test]
fn quantities_carry_their_units() {
    let has_unit = |name: &str| UNITS.iter().any(|unit| name.ends_with(unit));
    for parameter in catenary_simulator::parameters::CATALOGUE {
        let name = parameter.name;
        assert!(
            has_unit(name) || PLAIN.iter().any(|p| name.ends_with(p)),
            "model parameter {name} has no unit in its name"
        );
        assert_eq!(has_unit(name), parameter.unit != "1", "model parameter {name} of unit {}", parameter.unit);
    }
    for about in catenary_simulator::Registry::shipped().effects().map(|e| e.about()) {
        assert_eq!(has_unit(about.name), about.unit != "1", "effect {} of unit {}", about.name, about.unit);
    }
    let mut quantities = 0;
    for file in rust_files(&root().join("nodes/method/core/src")) {
        let text = std::fs::read_to_string(&file).unwrap();
        for line in text.lines() {
            let Some((name, kind)) = line.trim().strip_prefix("pub ").and_then(|field| field.split_once(": ")) else {
                continue;
            };
            if !name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_') {
                continue;
            }
            let is_quantity =
                kind.contains("f64") && DIMENSIONED.iter().any(|word| name.split('_').any(|part| part == *word));
            quantities += usize::from(is_quantity);
            assert!(!is_quantity || has_unit(name), "{}: {name} has no unit in its name", file.display());
        }
    }
    // Guards against a search that finds nothing and therefore passes.
    assert!(quantities > 5, "found {quantities} quantities: the search is broken");
}

fn rust_files(folder: &Path) -> Vec<PathBuf> {
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            files.extend(rust_files(&path));
        } else if path.extension().is_some_and(|e| e == "rs") {
            files.push(path);
        }
    }
    files
}
