//! The state of an inference in a file, for a process that may be killed.

use crate::sequential::State;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

/// States of other inferences that are kept in a folder; older ones, of inferences that were cancelled, go.
const KEPT: usize = 8;

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
        Self::new(folder.join(format!("{question:016x}.json")), question)
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
            std::fs::rename(&draft, &self.path)?;
            self.tidy()
        };
        if let Err(error) = write() {
            tracing::warn!(
                "{}: {error}; the inference cannot go on from here if its process dies",
                self.path.display()
            );
        }
    }

    /// Removes the oldest states of other inferences beside this one, but for [`KEPT`] of them.
    fn tidy(&self) -> std::io::Result<()> {
        let Some(folder) = self.path.parent() else { return Ok(()) };
        let mut others: Vec<(SystemTime, PathBuf)> = Vec::new();
        for entry in std::fs::read_dir(folder)? {
            let path = entry?.path();
            if path != self.path && is_state(&path) {
                others.push((path.metadata()?.modified()?, path));
            }
        }
        others.sort();
        let surplus = others.len().saturating_sub(KEPT);
        others.iter().take(surplus).try_for_each(|(_, path)| std::fs::remove_file(path))
    }

    /// Removes the file of an inference that has ended.
    pub fn remove(&self) {
        if let Err(error) = std::fs::remove_file(&self.path)
            && error.kind() != std::io::ErrorKind::NotFound
        {
            tracing::warn!("{}: {error}", self.path.display());
        }
    }
}

/// Whether a file is called as [`StateFile::in_folder`] calls them.
fn is_state(path: &Path) -> bool {
    let stem = path.file_stem().and_then(|s| s.to_str()).unwrap_or_default();
    path.extension().is_some_and(|e| e == "json") && stem.len() == 16 && stem.bytes().all(|b| b.is_ascii_hexdigit())
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

    #[test]
    fn states_of_others_are_kept_up_to_a_few_and_other_files_are_left_alone() {
        let folder = std::env::temp_dir().join(format!("catenary_states_{}", std::process::id()));
        let state = |question| State::new(question, Samples::new(3, 2));
        std::fs::create_dir_all(&folder).unwrap();
        std::fs::write(folder.join("notes.json"), "{}").unwrap();
        let start = SystemTime::now() - std::time::Duration::from_secs(1000);
        for question in 0..20 {
            let file = StateFile::in_folder(&folder, question);
            file.write(&state(question));
            let at = start + std::time::Duration::from_secs(question);
            std::fs::File::options().append(true).open(file.path()).unwrap().set_modified(at).unwrap();
        }
        let left: Vec<u64> = (0..20).filter(|q| StateFile::in_folder(&folder, *q).path().exists()).collect();
        assert_eq!(left, (11..20).collect::<Vec<_>>());
        assert!(folder.join("notes.json").exists());
        std::fs::remove_dir_all(folder).unwrap();
    }
}
