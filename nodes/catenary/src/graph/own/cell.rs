//! Robot cells of a command's own graph, with their shipped launch files and parameters.

use crate::inputs::shipped::LAUNCH_CONFIGS;
use anyhow::{Context, Result};
use clap::ValueEnum;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Robot cell.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Cell {
    /// Arm with a lag and a speed limit, without forces
    #[default]
    Sim,
    /// Emulated Panda that the bridge drives by torques, as it drives a real one
    Emulated,
}

impl Cell {
    /// Name in paths of files and messages.
    pub fn name(self) -> &'static str {
        match self {
            Self::Sim => "sim",
            Self::Emulated => "emulated",
        }
    }

    /// True if the cell's time waits for the graph: the same seed then gives the same bits. An emulated arm keeps real time.
    pub fn is_in_lock_step(self) -> bool {
        self == Self::Sim
    }

    /// Writes the cell's launch file, its parameters and a model into `folder`, with the layout of `launch_configs`. Returns the paths of the
    /// launch file and of the model.
    pub fn write(self, folder: &Path, model: &str, model_yaml: &str) -> Result<[PathBuf; 2]> {
        let launch = format!("{}.launch.xml", self.name());
        let model = format!("models/{model}.yaml");
        let shipped = |name: &str| -> Result<&[u8]> {
            let found = LAUNCH_CONFIGS.iter().find(|(known, _)| *known == name);
            Ok(found.with_context(|| format!("{name} is compiled into the program"))?.1)
        };
        let parameters = format!("params/{}.yaml", self.name());
        let files =
            [(&launch, shipped(&launch)?), (&parameters, shipped(&parameters)?), (&model, model_yaml.as_bytes())];
        for (name, bytes) in files {
            let path = folder.join(name);
            if let Some(parent) = path.parent() {
                std::fs::create_dir_all(parent).with_context(|| parent.display().to_string())?;
            }
            std::fs::write(&path, bytes).with_context(|| path.display().to_string())?;
        }
        Ok([folder.join(launch), folder.join(model)])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_carried_launch_files_read() {
        let folder = tempfile::tempdir().unwrap();
        for (cell, processes) in [(Cell::Sim, 8), (Cell::Emulated, 10)] {
            let [launch, model] = cell.write(folder.path(), "bar", "name: bar").unwrap();
            let description = crate::launch::read(&launch, &[], &|_| None).unwrap();
            assert_eq!(description.processes.len(), processes, "{cell:?}");
            assert_eq!(std::fs::read_to_string(model).unwrap(), "name: bar");
        }
    }
}
