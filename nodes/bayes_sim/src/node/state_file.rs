//! The state of an inference in a file, for a process that may be killed.

use crate::sequential::State;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

/// States of other inferences that a folder keeps however old they are.
const KEPT: usize = 8;
/// Age below which none is removed: it may be that of an inference that runs.
const YOUNG: Duration = Duration::from_secs(7 * 24 * 3600);

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
            std::fs::rename(&draft, &self.path)
        };
        if let Err(error) = write() {
            tracing::warn!(
                "{}: {error}; the inference cannot go on from here if its process dies",
                self.path.display()
            );
        }
    }

    /// Removes old states that inferences left in `folder` which were cancelled and never asked again, but for the newest.
    pub fn tidy(folder: &Path) {
        let Ok(entries) = std::fs::read_dir(folder) else { return };
        let paths = entries.filter_map(|entry| Some(entry.ok()?.path())).filter(|path| is_state(path));
        let mut states: Vec<(SystemTime, PathBuf)> =
            paths.filter_map(|path| Some((path.metadata().ok()?.modified().ok()?, path))).collect();
        states.sort();
        let surplus = states.len().saturating_sub(KEPT);
        let is_old = |at: &SystemTime| at.elapsed().is_ok_and(|age| age > YOUNG);
        for (_, path) in states.iter().take(surplus).filter(|(at, _)| is_old(at)) {
            if let Err(error) = std::fs::remove_file(path)
                && error.kind() != std::io::ErrorKind::NotFound
            {
                tracing::warn!("{}: an old state that cannot be removed: {error}", path.display());
            }
        }
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
    path.extension().is_some_and(|e| e == "json")
        && stem.len() == 16
        && stem.bytes().all(|b| matches!(b, b'0'..=b'9' | b'a'..=b'f'))
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
    fn old_states_go_but_for_a_few_and_other_files_are_left_alone() {
        let folder = std::env::temp_dir().join(format!("catenary_states_{}", std::process::id()));
        let state = |question| State::new(question, Samples::new(3, 2));
        std::fs::create_dir_all(&folder).unwrap();
        let age = |path: &Path, days: u64| {
            let at = SystemTime::now() - Duration::from_secs(days * 24 * 3600);
            std::fs::File::options().append(true).open(path).unwrap().set_modified(at).unwrap();
        };
        let mine = ["notes.json", "0123456789ABCDEF.json"].map(|name| folder.join(name));
        for path in &mine {
            std::fs::write(path, "{}").unwrap();
            age(path, 100);
        }
        // Twelve young ones, and twenty old ones.
        let file = |question| StateFile::in_folder(&folder, question);
        for question in 0..32 {
            file(question).write(&state(question));
            age(file(question).path(), if question < 12 { question / 2 } else { question });
        }
        let left = |of: std::ops::Range<u64>| of.filter(|q| file(*q).path().exists()).count();
        StateFile::tidy(&folder);
        assert_eq!((left(0..12), left(12..32)), (12, 0));
        (0..8).for_each(|question| file(question).remove());
        (12..32).for_each(|question| file(question).write(&state(question)));
        (12..32).for_each(|question| age(file(question).path(), question));
        StateFile::tidy(&folder);
        assert_eq!((left(8..12), left(12..16), left(16..32)), (4, 4, 0));
        assert!(mine.iter().all(|path| path.exists()));
        StateFile::tidy(&folder.join("nowhere"));
        std::fs::remove_dir_all(folder).unwrap();
    }
}
