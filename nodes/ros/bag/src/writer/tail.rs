//! End of a file that grows by whole chunks alone.

use std::fs::File;
use std::io::{self, Seek, SeekFrom, Write};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

/// Output that is written from front to back and can be truncated.
pub(super) trait Target: Write {
    /// Truncates it to `len` bytes.
    fn cut(&mut self, len: u64) -> io::Result<()>;
    /// Syncs the written bytes to the disk.
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

/// Records that the next flush writes behind the chunk, shared with the code that adds them.
pub(super) type TrailingRecords = Arc<Mutex<Vec<u8>>>;

/// Writer that holds bytes back until a flush, so the file ends with a complete chunk at any time. A flush that fails
/// half way, for example on a full disk, truncates the file to its length before.
pub(super) struct Tail<F: Target> {
    target: F,
    held_back: Vec<u8>,
    trailing: TrailingRecords,
    written: Arc<AtomicU64>,
    broken: bool,
}

impl<F: Target> Tail<F> {
    pub(super) fn new(target: F) -> Self {
        Self {
            target,
            held_back: Vec::new(),
            trailing: TrailingRecords::default(),
            written: Arc::default(),
            broken: false,
        }
    }

    /// Shared counter of the bytes in the file.
    pub(super) fn written(&self) -> Arc<AtomicU64> {
        Arc::clone(&self.written)
    }

    /// Shared list of whole records that the next flush appends. A flush must not happen within a chunk.
    pub(super) fn trailing(&self) -> TrailingRecords {
        Arc::clone(&self.trailing)
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
        self.held_back.append(&mut self.trailing.lock().unwrap_or_else(PoisonError::into_inner));
        if let Err(error) = self.target.write_all(&self.held_back).and_then(|()| self.target.flush()) {
            self.broken = true;
            // If this fails, too, the file ends within a record. Readers recover from that.
            let _ends_within_a_record = self.target.cut(self.position());
            return Err(error);
        }
        self.written.fetch_add(self.held_back.len() as u64, Ordering::Relaxed);
        self.held_back.clear();
        Ok(())
    }
}

impl<F: Target> Seek for Tail<F> {
    /// Returns the position. Other seeks are refused.
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        match to {
            SeekFrom::Current(0) => Ok(self.position() + self.held_back.len() as u64),
            _ => Err(io::Error::new(io::ErrorKind::Unsupported, "this file only grows")),
        }
    }
}
