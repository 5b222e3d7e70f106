//! Launch files, parameters and models that are compiled into the program.

use anyhow::{Result, anyhow};
use catenary_core::spelling::nearest;
use std::path::Path;

/// Contents of `launch_configs` without its pictures, by relative path.
pub const LAUNCH_CONFIGS: &[(&str, &[u8])] = include!(concat!(env!("OUT_DIR"), "/launch_configs.rs"));

/// Kind of a shipped file that an option may name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Model of an object.
    Model,
    /// Task.
    Task,
}

impl Kind {
    /// Name in messages.
    pub fn name(self) -> &'static str {
        match self {
            Self::Model => "model",
            Self::Task => "task",
        }
    }

    fn folder(self) -> &'static str {
        match self {
            Self::Model => "models/",
            Self::Task => "tasks/",
        }
    }

    /// Names and texts of the shipped files.
    pub fn all(self) -> impl Iterator<Item = (&'static str, &'static str)> {
        LAUNCH_CONFIGS.iter().filter_map(move |(path, bytes)| {
            let name = path.strip_prefix(self.folder())?.strip_suffix(".yaml")?;
            Some((name, std::str::from_utf8(bytes).ok()?))
        })
    }

    /// Text of the file with this name; `None` if `path` is more than a name, or if there is no such file.
    pub fn named(self, path: &Path) -> Option<&'static str> {
        let name = path.to_str()?;
        self.all().find(|(known, _)| *known == name).map(|(_, text)| text)
    }

    /// Text of the file at `path`, else of the shipped one of this name.
    pub fn text(self, path: &Path) -> Result<String> {
        match self.named(path) {
            // A file in the working folder has precedence over a shipped one of this name.
            Some(text) if !path.is_file() => Ok(text.to_owned()),
            _ => catenary_shell::files::read_text(self.name(), path).map_err(|error| self.with_names(path, error)),
        }
    }

    /// Adds the names of the shipped files to the error about a missing file, if the path has no folder.
    fn with_names(self, path: &Path, error: anyhow::Error) -> anyhow::Error {
        let plain = path.to_str().filter(|text| !text.contains('/') && !path.exists());
        let Some(name) = plain else { return error };
        let mut names: Vec<&str> = self.all().map(|(name, _)| name).collect();
        names.sort_unstable();
        // The error may already suggest a file nearby.
        let near = nearest(name, names.iter().copied()).filter(|_| !format!("{error:#}").contains("did you mean"));
        let near = near.map_or_else(String::new, |near| format!("; did you mean `{near}`?"));
        anyhow!("{error:#}; shipped {}s are {}{near}", self.name(), names.join(", "))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn models_and_tasks_are_found_by_their_names_alone() {
        let names: Vec<&str> = Kind::Model.all().map(|(name, _)| name).collect();
        assert!(names.contains(&"soft_bar") && names.contains(&"measured_cable"), "{names:?}");
        assert!(Kind::Model.named(Path::new("soft_bar")).unwrap().contains("name: soft_bar"));
        assert!(Kind::Task.named(Path::new("settle")).is_some() && Kind::Model.named(Path::new("settle")).is_none());
        for other in ["soft_bar.yaml", "models/soft_bar", "./soft_bar", "bar", ""] {
            assert!(Kind::Model.named(Path::new(other)).is_none(), "{other}");
        }
    }
}
