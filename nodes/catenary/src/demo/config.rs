//! Files of the demo: the shipped launch file, parameters and model, compiled into the program.

use super::args::DemoCell;
use anyhow::{Context, Result};
use std::path::{Path, PathBuf};

/// Model that the demo infers, trains and simulates with.
pub const MODEL: &str = include_str!("../../../../launch_configs/models/soft_bar_place.yaml");
/// Path of the model relative to the launch file.
pub const MODEL_FILE: &str = "models/soft_bar_place.yaml";

const FILES: [(&str, &str); 5] = [
    ("sim.launch.xml", include_str!("../../../../launch_configs/sim.launch.xml")),
    ("params/sim.yaml", include_str!("../../../../launch_configs/params/sim.yaml")),
    ("emulated.launch.xml", include_str!("../../../../launch_configs/emulated.launch.xml")),
    ("params/emulated.yaml", include_str!("../../../../launch_configs/params/emulated.yaml")),
    (MODEL_FILE, MODEL),
];

/// Writes the files into `folder`, with the layout of `launch_configs`. Returns the path of the cell's launch file.
pub fn write(folder: &Path, cell: DemoCell) -> Result<PathBuf> {
    for (name, text) in FILES {
        let path = folder.join(name);
        if let Some(parent) = path.parent() {
            std::fs::create_dir_all(parent).with_context(|| parent.display().to_string())?;
        }
        std::fs::write(&path, text).with_context(|| path.display().to_string())?;
    }
    Ok(folder.join(match cell {
        DemoCell::Sim => "sim.launch.xml",
        DemoCell::Emulated => "emulated.launch.xml",
    }))
}

/// Creates `wanted`, or the first of `wanted-2`, `wanted-3`, ... that does not exist, so that no earlier result is
/// overwritten.
pub fn fresh_folder(wanted: &Path) -> Result<PathBuf> {
    let name = wanted.file_name().with_context(|| format!("{} names no folder", wanted.display()))?.to_string_lossy();
    let free = |n: u32| if n == 1 { wanted.to_path_buf() } else { wanted.with_file_name(format!("{name}-{n}")) };
    let path = (1..).map(free).find(|p| !p.exists()).expect("there are more numbers than folders");
    std::fs::create_dir_all(&path).with_context(|| path.display().to_string())?;
    Ok(path)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_earlier_demo_is_kept() {
        let folder = tempfile::tempdir().unwrap();
        let wanted = folder.path().join("demo");
        assert_eq!(fresh_folder(&wanted).unwrap(), wanted);
        assert_eq!(fresh_folder(&wanted).unwrap(), folder.path().join("demo-2"));
    }

    #[test]
    fn the_carried_launch_files_read() {
        let folder = tempfile::tempdir().unwrap();
        for (cell, processes) in [(DemoCell::Sim, 8), (DemoCell::Emulated, 10)] {
            let launch = write(folder.path(), cell).unwrap();
            let description = crate::launch::read(&launch, &[], &|_| None).unwrap();
            assert_eq!(description.processes.len(), processes, "{cell:?}");
        }
    }
}
