//! State of interrupted work in a file, from which the same command goes on.

use crate::exit::WrongInput;
use anyhow::Result;
use catenary_core::hash::fnv1a;
use catenary_shell::{files, remove_state, state_file, state_folder};
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::path::{Path, PathBuf};

/// First bytes of a file.
const MAGIC: &[u8; 8] = b"catkept1";
/// Bytes before the state: those of [`MAGIC`], the fingerprint of the work, and the checksum of the state.
const HEAD: usize = 24;
/// Size limit of a file, bytes.
const MOST_BYTES: u64 = 1 << 30;
/// Extension of the files.
pub const EXTENSION: &str = "state";

/// File with the state of work that Ctrl-C ended.
#[derive(Debug, Clone)]
pub struct Kept {
    path: PathBuf,
    fingerprint: u64,
    /// Further reason in words for which a state may be of other work.
    reason: Option<String>,
}

impl Kept {
    /// File beside the result `out` of the work identified by `fingerprint`: its name with `.state` behind it.
    pub fn beside(out: &Path, fingerprint: u64) -> Self {
        let mut name = out.as_os_str().to_owned();
        name.push(format!(".{EXTENSION}"));
        Self { path: name.into(), fingerprint, reason: None }
    }

    /// File of a command whose results have no folder: in that of the command's states, `catenary/COMMAND` in ROS_HOME or ~/.ros. None
    /// without a home folder.
    pub fn of_command(command: &str, fingerprint: u64) -> Option<Self> {
        let folder = state_folder("", command)?;
        Some(Self { path: state_file(&folder, fingerprint, EXTENSION), fingerprint, reason: None })
    }

    /// The file with a reason beside command line, files and program for which its state may be of other work.
    pub fn with_reason(self, reason: String) -> Self {
        Self { reason: Some(reason), ..self }
    }

    /// Path of the file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Writes the state, with the file's folder.
    ///
    /// # Errors
    /// Errors of the operating system.
    pub fn write<T: Serialize>(&self, state: &T) -> Result<()> {
        if let Some(folder) = self.path.parent().filter(|folder| !folder.as_os_str().is_empty()) {
            std::fs::create_dir_all(folder)?;
        }
        let state = postcard::to_stdvec(state)?;
        let numbers = [self.fingerprint, fnv1a(state.iter().copied())].map(u64::to_le_bytes);
        files::write(&self.path, [MAGIC.as_slice(), &numbers.concat(), &state].concat())
    }

    /// State of interrupted work. None if there is no file.
    ///
    /// # Errors
    /// A file that cannot be read, is damaged, or belongs to other work: another command line, other files, or another program.
    pub fn read<T: DeserializeOwned>(&self) -> Result<Option<T>> {
        if !self.path.exists() {
            return Ok(None);
        }
        let bytes = files::read_at_most("state", &self.path, MOST_BYTES)?;
        let refuse = |what: &str| Err(WrongInput::error(format!("state {}: {what}", self.path.display())));
        let Some((head, state)) = bytes.split_at_checked(HEAD).filter(|(head, _)| head.starts_with(MAGIC)) else {
            return refuse("expected the state of interrupted work, as Ctrl-C leaves it, got another file");
        };
        let number = |at: usize| u64::from_le_bytes(std::array::from_fn(|i| head[at + i]));
        if number(16) != fnv1a(state.iter().copied()) {
            return refuse("it is damaged: remove it to begin again");
        }
        if number(8) != self.fingerprint {
            let reason = self.reason.as_ref().map_or_else(String::new, |reason| format!("; {reason}"));
            return refuse(&format!(
                "it is of other work: expected the command line, the files and the program that it was made with{reason}"
            ));
        }
        match postcard::from_bytes(state) {
            Ok(state) => Ok(Some(state)),
            Err(error) => refuse(&error.to_string()),
        }
    }

    /// Removes the file of finished work.
    pub fn remove(&self) {
        remove_state(&self.path);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_state_is_read_back_and_a_damaged_one_or_that_of_other_work_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let kept = Kept::beside(&folder.path().join("policy"), 7);
        assert!(kept.path().ends_with("policy.state") && kept.read::<Vec<f32>>().unwrap().is_none());
        let state = vec![0.1_f32, f32::MIN_POSITIVE, -0.0];
        kept.write(&state).unwrap();
        assert_eq!(kept.read::<Vec<f32>>().unwrap(), Some(state));
        let words = |kept: &Kept| {
            let error = kept.read::<Vec<f32>>().unwrap_err();
            assert!(WrongInput::is(&error), "{error:#}");
            error.to_string()
        };
        let other = Kept { fingerprint: 8, ..kept.clone() };
        assert!(words(&other).contains("policy.state: it is of other work"), "{}", words(&other));
        let other = other.with_reason("another arm may be the reason".to_owned());
        assert!(words(&other).ends_with("made with; another arm may be the reason"), "{}", words(&other));
        let mut bytes = std::fs::read(kept.path()).unwrap();
        *bytes.last_mut().unwrap() ^= 1;
        std::fs::write(kept.path(), &bytes).unwrap();
        assert!(words(&kept).ends_with("it is damaged: remove it to begin again"));
        for cut in [0, 7, 20, bytes.len() - 1] {
            std::fs::write(kept.path(), &bytes[..cut]).unwrap();
            assert!(words(&kept).starts_with("state "), "{cut}");
        }
        kept.remove();
        assert!(!kept.path().exists());
    }
}
