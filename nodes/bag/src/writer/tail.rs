//! The end of a file that only grows, and only by whole chunks.

use std::fs::File;
use std::io::{self, Seek, SeekFrom, Write};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

/// Something that is written from front to back and can be cut off.
pub(super) trait Target: Write {
    /// Makes it end after `len` bytes.
    fn cut(&mut self, len: u64) -> io::Result<()>;
    /// Brings what was written to the disk itself.
    fn sync(&mut self) -> io::Result<()>;
}

impl Target for File {
    fn cut(&mut self, len: u64) -> io::Result<()> {
        self.set_len(len)
    }

    fn sync(&mut self) -> io::Result<()> {
        self.sync_all()
    }
}

/// Records that come behind the next chunk, shared with whoever adds to them.
pub(super) type Behind = Arc<Mutex<Vec<u8>>>;

/// Holds back what is written until it is flushed, so that the file ends with a complete chunk at any moment: a flush that
/// fails half way, as on a full disk, cuts the file back to where it was.
pub(super) struct Tail<F: Target> {
    target: F,
    held_back: Vec<u8>,
    behind: Behind,
    written: Arc<AtomicU64>,
    broken: bool,
}

impl<F: Target> Tail<F> {
    pub(super) fn new(target: F) -> Self {
        Self { target, held_back: Vec::new(), behind: Behind::default(), written: Arc::default(), broken: false }
    }

    /// Bytes in the file so far, kept up to date.
    pub(super) fn written(&self) -> Arc<AtomicU64> {
        Arc::clone(&self.written)
    }

    /// Takes whole records; the next flush writes them behind what was written until then. There must be no chunk open.
    pub(super) fn behind(&self) -> Behind {
        Arc::clone(&self.behind)
    }

    fn position(&self) -> u64 {
        self.written.load(Ordering::Relaxed)
    }

    pub(super) fn sync(&mut self) -> io::Result<()> {
        self.target.sync()
    }

    fn check(&self) -> io::Result<()> {
        if self.broken { Err(io::Error::other("an earlier write failed")) } else { Ok(()) }
    }
}

impl<F: Target> Write for Tail<F> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.check()?;
        self.held_back.extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.check()?;
        self.held_back.append(&mut self.behind.lock().unwrap_or_else(PoisonError::into_inner));
        if let Err(error) = self.target.write_all(&self.held_back).and_then(|()| self.target.flush()) {
            self.broken = true;
            // Where even this fails the file ends within a record, which readers recover from.
            let _ends_within_a_record = self.target.cut(self.position());
            return Err(error);
        }
        self.written.fetch_add(self.held_back.len() as u64, Ordering::Relaxed);
        self.held_back.clear();
        Ok(())
    }
}

impl<F: Target> Seek for Tail<F> {
    /// Tells the position; goes nowhere.
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        match to {
            SeekFrom::Current(0) => Ok(self.position() + self.held_back.len() as u64),
            _ => Err(io::Error::new(io::ErrorKind::Unsupported, "this file only grows")),
        }
    }
}
