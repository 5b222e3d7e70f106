//! Room on the disk that is kept free until it is needed.
#![allow(clippy::disallowed_methods, reason = "room on a disk is a file")]

use std::fs::{File, TryLockError};
use std::io::{self, Write};
use std::path::Path;

/// Name of the file.
const FILE_NAME: &str = ".reserve";
/// Bytes by which it grows.
const STEP: usize = 64 * 1024;

/// A file in a bag's folder that takes the room which the end of the bag will need, so that a full disk does not keep the
/// bag from being finished. Whoever finishes the bag removes it first. It is locked while the bag is written.
pub(crate) struct Reserve {
    file: File,
    bytes: usize,
}

impl Reserve {
    pub(crate) fn new(folder: &Path) -> io::Result<Self> {
        let file = File::create(folder.join(FILE_NAME))?;
        // File systems without locks are none the worse for it.
        let _unlocked = file.try_lock();
        Ok(Self { file, bytes: 0 })
    }

    /// Makes room for `needed` bytes.
    pub(crate) fn grow(&mut self, needed: usize) -> io::Result<()> {
        while self.bytes < needed {
            self.file.write_all(&[0x5a; STEP])?;
            self.bytes += STEP;
        }
        Ok(())
    }
}

/// Frees the room in a bag's folder, also what a killed recorder has left.
pub(crate) fn free(folder: &Path) {
    let _there_is_none = std::fs::remove_file(folder.join(FILE_NAME));
}

/// Fails where a recorder is still at work in a bag's folder.
///
/// # Errors
/// It is.
pub(crate) fn check(folder: &Path) -> io::Result<()> {
    if let Ok(file) = File::open(folder.join(FILE_NAME))
        && let Err(TryLockError::WouldBlock) = file.try_lock()
    {
        return Err(io::Error::new(io::ErrorKind::ResourceBusy, "a recorder writes to it"));
    }
    Ok(())
}
