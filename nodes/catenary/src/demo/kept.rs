//! Results of stages that an interrupted demo left behind, each with a fingerprint of its inputs.

use super::summary::{Evaluation, Stage};
use anyhow::{Context, Result};
use catenary_core::identity;
use catenary_msgs::action::{InferResult, TrainResult};
use catenary_msgs::{from_cdr, to_cdr};
use catenary_shell::files;
use serde::{Deserialize, Serialize};
use std::fs::{File, TryLockError};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::UNIX_EPOCH;

/// Folder of the results, in the demo's folder.
const FOLDER: &str = "stages";
/// File that names the demo to which the results belong. A running demo holds a lock on it.
const OWNER: &str = "demo.json";

/// Settings of a demo. Results are reused by a demo of equal settings alone.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Owner {
    /// Seed of every random draw.
    pub seed: u64,
    /// Name of the preset.
    pub preset: String,
    /// Name of the cell.
    pub cell: String,
    /// Fingerprint of program and machine, which may change the last bits of every result.
    pub program: String,
}

impl Owner {
    /// Settings of a demo of this program.
    pub fn new(seed: u64, preset: &str, cell: &str, model: &catenary_core::Model) -> Self {
        let build = std::env::current_exe().and_then(|program| program.metadata()).ok().map(|m| {
            let modified = m.modified().ok().and_then(|time| time.duration_since(UNIX_EPOCH).ok());
            (m.len(), modified)
        });
        let program = identity::fingerprint(&(build, catenary_simulator::fingerprint(model)));
        Self { seed, preset: preset.to_owned(), cell: cell.to_owned(), program: format!("{program:016x}") }
    }
}

/// Folder of a demo, new or of an interrupted one.
#[derive(Debug)]
pub struct Kept {
    folder: PathBuf,
    owner: Owner,
    /// True if an interrupted demo left the folder.
    pub is_resumed: bool,
    // The lock ends with the file.
    _lock: File,
}

/// First line of a result's file.
#[derive(Debug, Serialize, Deserialize)]
struct Head {
    fingerprint: String,
    stage: Stage,
}

/// Result of a stage as bytes.
pub trait StageResult: Sized {
    /// Bytes of the result.
    ///
    /// # Errors
    /// A value without an encoding.
    fn encode(&self) -> Result<Vec<u8>>;
    /// Result of such bytes.
    ///
    /// # Errors
    /// Bytes of another program.
    fn decode(bytes: &[u8]) -> Result<Self>;
}

macro_rules! message_results {
    ($($kind:ty),*) => {
        $(impl StageResult for $kind {
            fn encode(&self) -> Result<Vec<u8>> {
                Ok(to_cdr(self)?)
            }
            fn decode(bytes: &[u8]) -> Result<Self> {
                Ok(from_cdr(bytes)?)
            }
        })*
    };
}

message_results!(TrainResult, InferResult);

impl StageResult for Evaluation {
    fn encode(&self) -> Result<Vec<u8>> {
        Ok(serde_json::to_vec(self)?)
    }
    fn decode(bytes: &[u8]) -> Result<Self> {
        Ok(serde_json::from_slice(bytes)?)
    }
}

impl Kept {
    /// Opens the folder `wanted`, or the first of `wanted-2`, `wanted-3`, ... that is free, or that an interrupted demo of equal settings left. No
    /// finished result is overwritten.
    ///
    /// # Errors
    /// A folder that cannot be made or written.
    pub fn open(wanted: &Path, owner: Owner) -> Result<(PathBuf, Self)> {
        let name = wanted.file_name().with_context(|| format!("{} names no folder", wanted.display()))?;
        let name = name.to_string_lossy().into_owned();
        for n in 1u32.. {
            let path = if n == 1 { wanted.to_path_buf() } else { wanted.with_file_name(format!("{name}-{n}")) };
            let is_resumed = path.exists();
            if is_resumed && !is_left_by(&path, &owner) {
                continue;
            }
            let folder = path.join(FOLDER);
            std::fs::create_dir_all(&folder).with_context(|| folder.display().to_string())?;
            if let Some(lock) = take(&folder.join(OWNER), &owner)? {
                return Ok((path, Self { folder, owner, is_resumed, _lock: lock }));
            }
        }
        unreachable!("there are more numbers than folders")
    }

    fn file(&self, name: &str) -> PathBuf {
        self.folder.join(format!("{}.stage", name.replace(' ', "_")))
    }

    /// Fingerprint of a stage: its inputs, and the settings of the demo.
    pub fn fingerprint(&self, inputs: &impl Serialize) -> String {
        format!("{:016x}", identity::fingerprint(&(&self.owner, inputs)))
    }

    /// Returns the result of a stage with this fingerprint, if an earlier run kept it.
    pub fn read<T: StageResult>(&self, name: &str, fingerprint: &str) -> Option<(Stage, T)> {
        let bytes = std::fs::read(self.file(name)).ok()?;
        let end = bytes.iter().position(|b| *b == b'\n')?;
        let head: Head = serde_json::from_slice(&bytes[..end]).ok()?;
        // A result of other inputs, or a damaged one, is made again.
        (head.fingerprint == fingerprint).then(|| Some((head.stage, T::decode(&bytes[end + 1..]).ok()?)))?
    }

    /// Keeps the result of a stage.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn write<T: StageResult>(&self, stage: &Stage, fingerprint: String, result: &T) -> Result<()> {
        let path = self.file(&stage.name);
        let mut bytes = serde_json::to_vec(&Head { fingerprint, stage: stage.clone() })?;
        bytes.push(b'\n');
        bytes.extend(result.encode()?);
        files::write(&path, bytes)
    }
}

/// True if a demo of these settings left the folder before its end.
fn is_left_by(path: &Path, owner: &Owner) -> bool {
    let left = std::fs::read(path.join(FOLDER).join(OWNER)).ok().and_then(|b| serde_json::from_slice::<Owner>(&b).ok());
    left.as_ref() == Some(owner) && !path.join(super::summary::FILE).exists()
}

/// Locks the file and writes the owner into it; `None` if a running demo holds the lock.
fn take(path: &Path, owner: &Owner) -> Result<Option<File>> {
    let shown = || path.display().to_string();
    let mut file = File::options().create(true).truncate(false).write(true).open(path).with_context(shown)?;
    match file.try_lock() {
        Ok(()) => {}
        Err(TryLockError::WouldBlock) => return Ok(None),
        // A file system without locks: two demos at once in one folder are then not noticed.
        Err(TryLockError::Error(_)) => {}
    }
    file.set_len(0).with_context(shown)?;
    file.write_all(&serde_json::to_vec(owner)?).with_context(shown)?;
    Ok(Some(file))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn owner(seed: u64) -> Owner {
        Owner { seed, preset: "default".into(), cell: "sim".into(), program: "p".into() }
    }

    #[test]
    fn an_interrupted_demo_of_equal_settings_is_resumed_and_any_other_is_kept() {
        let folder = tempfile::tempdir().unwrap();
        let wanted = folder.path().join("demo");
        let open = |seed| Kept::open(&wanted, owner(seed)).unwrap();
        let (first, running) = open(1);
        assert_eq!((first.as_path(), running.is_resumed), (wanted.as_path(), false));
        // While it runs, a second one of equal settings has a folder of its own.
        assert_eq!(open(1).0, folder.path().join("demo-2"));
        drop(running);
        let (resumed, kept) = open(1);
        assert_eq!((resumed, kept.is_resumed), (wanted.clone(), true));
        drop(kept);
        assert_eq!(open(2).0, folder.path().join("demo-3"));
        // A finished demo is never taken up.
        std::fs::write(wanted.join(crate::demo::summary::FILE), "{}").unwrap();
        assert_eq!(open(1).0, folder.path().join("demo-2"));
    }

    #[test]
    fn a_result_is_reused_for_its_own_inputs_alone() {
        let folder = tempfile::tempdir().unwrap();
        let (_, kept) = Kept::open(&folder.path().join("demo"), owner(1)).unwrap();
        let stage = Stage { name: "train pi0".into(), wall_s: 2.0, cpu_s: 3.0 };
        let result = TrainResult { success: true, policy: vec![10, 13, 0], ..TrainResult::default() };
        let [own, other] = [7, 8].map(|inputs| kept.fingerprint(&inputs));
        assert!(kept.read::<TrainResult>("train pi0", &own).is_none());
        kept.write(&stage, own.clone(), &result).unwrap();
        let (read_stage, read) = kept.read::<TrainResult>("train pi0", &own).unwrap();
        assert_eq!((read_stage.wall_s, read.policy), (2.0, result.policy));
        assert!(kept.read::<TrainResult>("train pi0", &other).is_none());
        // A result that was cut off is made again.
        let path = kept.file("train pi0");
        let bytes = std::fs::read(&path).unwrap();
        std::fs::write(&path, &bytes[..bytes.len() - 9]).unwrap();
        assert!(kept.read::<TrainResult>("train pi0", &own).is_none());
    }
}
