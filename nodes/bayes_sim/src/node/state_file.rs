//! The state of an inference in a file, for a process that may be killed.

use crate::sequential::State;
use catenary_shell::{remove_state, state_file};
use std::path::{Path, PathBuf};

/// Of the files of a folder of states.
pub const EXTENSION: &str = "json";

/// A file that holds the state of one inference while it runs.
#[derive(Debug, Clone)]
pub struct StateFile {
    path: PathBuf,
    question: u64,
}

impl StateFile {
    /// The file at `path`, of the inference that `question` stands for.
    pub fn new(path: PathBuf, question: u64) -> Self {
        Self { path, question }
    }

    /// A file of its own in `folder`.
    pub fn in_folder(folder: &Path, question: u64) -> Self {
        Self::new(state_file(folder, question, EXTENSION), question)
    }

    /// Where it lies.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The state that an earlier process left behind; none where there is none, it is of another inference, or it cannot be
    /// read, which is said.
    pub fn read(&self) -> Option<State> {
        let bytes = match std::fs::read(&self.path) {
            Ok(bytes) => bytes,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => return None,
            Err(error) => {
                tracing::warn!("{}: {error}; begun anew", self.path.display());
                return None;
            }
        };
        match serde_json::from_slice::<State>(&bytes) {
            Ok(state) if state.answers(self.question) => Some(state),
            Ok(_) => {
                tracing::warn!("{}: of another inference; begun anew", self.path.display());
                None
            }
            Err(error) => {
                tracing::warn!("{}: {error}; begun anew", self.path.display());
                None
            }
        }
    }

    /// Puts `state` in the place of what is there; a process that is killed meanwhile leaves one of the two. What fails is
    /// said, and the inference goes on without.
    pub fn write(&self, state: &State) {
        let draft = self.path.with_extension(format!("{}.draft", std::process::id()));
        let write = || -> std::io::Result<()> {
            if let Some(folder) = self.path.parent() {
                std::fs::create_dir_all(folder)?;
            }
            std::fs::write(&draft, serde_json::to_vec(state)?)?;
            std::fs::rename(&draft, &self.path)
        };
        if let Err(error) = write() {
            tracing::warn!(
                "{}: {error}; the inference cannot go on from here if its process dies",
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
    fn a_state_is_read_back_until_its_inference_has_ended() {
        let folder = std::env::temp_dir().join(format!("catenary_state_{}", std::process::id()));
        let (file, other) = (StateFile::in_folder(&folder, 7), StateFile::in_folder(&folder, 8));
        assert_eq!(file.read(), None);
        let state = State::new(7, Samples::new(3, 2));
        file.write(&state);
        assert_eq!((file.read(), other.read()), (Some(state.clone()), None));
        let stranger = StateFile::new(file.path().to_owned(), 8);
        assert_eq!(stranger.read(), None, "another inference's");
        std::fs::write(file.path(), "{\"version\": 1").unwrap();
        assert_eq!(file.read(), None, "half a file");
        file.write(&state);
        file.remove();
        file.remove();
        assert_eq!(file.read(), None);
        std::fs::remove_dir_all(folder).unwrap();
    }
}
