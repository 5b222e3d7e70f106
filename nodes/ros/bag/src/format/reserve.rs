//! Reserve file: disk space that is held until the end of a bag is written.
#![allow(clippy::disallowed_methods, reason = "the reserve is a file")]

use std::fs::{File, TryLockError};
use std::io::{self, Write};
use std::path::Path;

/// Name of the reserve file.
const FILE_NAME: &str = ".reserve";
/// Bytes by which the reserve grows.
const STEP: usize = 64 * 1024;

/// File in a bag's folder that occupies the disk space which the end of the bag will need. It is removed before the end
/// is written, so a bag can be finished on a full disk. It is locked while a recorder writes the bag.
pub(crate) struct Reserve {
    file: File,
    bytes: usize,
}

impl Reserve {
    pub(crate) fn new(folder: &Path) -> io::Result<Self> {
        let file = File::create(folder.join(FILE_NAME))?;
        // Some file systems have no locks. The lock only protects against a reindex of a bag that is being written.
        let _unlocked = file.try_lock();
        Ok(Self { file, bytes: 0 })
    }

    /// Grows the reserve to at least `needed` bytes.
    pub(crate) fn grow(&mut self, needed: usize) -> io::Result<()> {
        // A byte other than zero: file systems may store zeros without occupying blocks.
        while self.bytes < needed {
            self.file.write_all(&[0x5a; STEP])?;
            self.bytes += STEP;
        }
        Ok(())
    }
}

/// Removes the reserve from a bag's folder, also one left by a killed recorder.
pub(crate) fn free(folder: &Path) {
    let _there_is_none = std::fs::remove_file(folder.join(FILE_NAME));
}

/// Fails if a recorder is writing to a bag's folder.
///
/// # Errors
/// [`io::ErrorKind::ResourceBusy`] if the reserve is locked.
pub(crate) fn check(folder: &Path) -> io::Result<()> {
    if let Ok(file) = File::open(folder.join(FILE_NAME))
        && let Err(TryLockError::WouldBlock) = file.try_lock()
    {
        return Err(io::Error::new(io::ErrorKind::ResourceBusy, "a recorder writes to it"));
    }
    Ok(())
}
