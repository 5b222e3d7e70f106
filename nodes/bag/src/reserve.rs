//! Room on the disk that is kept free until it is needed.
#![allow(clippy::disallowed_methods, reason = "room on a disk is a file")]

use std::fs::{File, OpenOptions};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Name of the file.
const FILE_NAME: &str = ".reserve";
/// Bytes by which it grows.
const STEP: usize = 64 * 1024;

/// A file in a bag's folder that takes the room which the end of the bag will need, so that a full disk does not keep the
/// bag from being finished. Whoever finishes the bag removes it first.
pub(crate) struct Reserve {
    path: PathBuf,
    bytes: usize,
}

impl Reserve {
    pub(crate) fn new(folder: &Path) -> io::Result<Self> {
        let path = folder.join(FILE_NAME);
        File::create(&path)?;
        Ok(Self { path, bytes: 0 })
    }

    /// Makes room for `needed` bytes.
    pub(crate) fn grow(&mut self, needed: usize) -> io::Result<()> {
        while self.bytes < needed {
            OpenOptions::new().append(true).open(&self.path)?.write_all(&[0x5a; STEP])?;
            self.bytes += STEP;
        }
        Ok(())
    }
}

/// Frees the room in a bag's folder.
pub(crate) fn free(folder: &Path) {
    let _there_is_none = std::fs::remove_file(folder.join(FILE_NAME));
}
