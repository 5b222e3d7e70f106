//! File with the state of an inference, for a process that may be killed.

use crate::sequential::State;
use catenary_shell::{files, remove_state, state_file};
use std::path::{Path, PathBuf};

/// Extension of the files in a folder of states.
pub const EXTENSION: &str = "json";

/// File that holds the state of one inference while it runs.
#[derive(Debug, Clone)]
pub struct StateFile {
    path: PathBuf,
    fingerprint: u64,
}

impl StateFile {
    /// File at `path` of the inference identified by `fingerprint`.
    pub fn new(path: PathBuf, fingerprint: u64) -> Self {
        Self { path, fingerprint }
    }

    /// File in `folder` whose name contains `fingerprint`.
    pub fn in_folder(folder: &Path, fingerprint: u64) -> Self {
        Self::new(state_file(folder, fingerprint, EXTENSION), fingerprint)
    }

    /// Path of the file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// State of an earlier process. None if there is none; none with a warning if it belongs to another inference or cannot be
    /// read.
    pub fn read(&self) -> Option<State> {
        let bytes = match std::fs::read(&self.path) {
            Ok(bytes) => bytes,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => return None,
            Err(error) => {
                tracing::warn!("{}: {error}; the inference starts over", self.path.display());
                return None;
            }
        };
        match serde_json::from_slice::<State>(&bytes) {
            Ok(state) if state.belongs_to(self.fingerprint) => Some(state),
            Ok(_) => {
                tracing::warn!("{}: the state of another inference; this one starts over", self.path.display());
                None
            }
            Err(error) => {
                tracing::warn!("{}: {error}; the inference starts over", self.path.display());
                None
            }
        }
    }

    /// Replaces the file's contents by `state`. A process that is killed meanwhile leaves the old or the new contents. A failure
    /// is a warning: the inference continues without a saved state.
    pub fn write(&self, state: &State) {
        let write = || -> std::io::Result<()> {
            if let Some(folder) = self.path.parent() {
                std::fs::create_dir_all(folder)?;
            }
            files::replace(&self.path, &serde_json::to_vec(state)?)
        };
        if let Err(error) = write() {
            tracing::warn!(
                "{}: {error}; if the process is killed, the inference cannot continue from here",
                self.path.display()
            );
        }
    }

    /// Removes the file of an inference that has ended.
    pub fn remove(&self) {
        remove_state(&self.path);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::network::Samples;

    #[test]
    fn a_state_is_read_back_until_its_file_is_removed() {
        let folder = std::env::temp_dir().join(format!("catenary_state_{}", std::process::id()));
        let (file, other) = (StateFile::in_folder(&folder, 7), StateFile::in_folder(&folder, 8));
        assert_eq!(file.read(), None);
        let state = State::new(7, Samples::new(3, 2));
        file.write(&state);
        assert_eq!((file.read(), other.read()), (Some(state.clone()), None));
        let stranger = StateFile::new(file.path().to_owned(), 8);
        assert_eq!(stranger.read(), None, "the state of another inference");
        std::fs::write(file.path(), "{\"version\": 1").unwrap();
        assert_eq!(file.read(), None, "a truncated file");
        file.write(&state);
        file.remove();
        file.remove();
        assert_eq!(file.read(), None);
        std::fs::remove_dir_all(folder).unwrap();
    }
}
