//! Scratch files for bag files that were compressed as a whole: without a name, limited, and interruptible.
//!
//! A summary at the end of a file and messages in order of time need random access, which a stream of zstd does not give.

use super::zstd_data::ZSTD_MAGIC;
use crate::error::BagError;
use rustix::fs::{AtFlags, CWD};
use std::fs::File;
use std::io::{Error, ErrorKind, Read, Write};
use std::os::fd::AsRawFd;
use std::path::{Path, PathBuf};

/// Size in bytes up to which every file may be decompressed: 2 GiB.
const LEAST: u64 = 2 << 30;
/// Factor by which a file may grow beyond [`LEAST`]. Joint states and poses shrink to a third, masks to a hundredth; zeros
/// shrink to a thirty thousandth.
const RATIO: u64 = 200;
/// Share of the free space that stays free: one eighth.
const SPARED: u64 = 8;
/// Number of bytes that are decompressed between two looks at the free space and at Ctrl-C.
const BLOCK: usize = 1 << 20;

/// Decompressed copy of a file. It has no name, so nothing is left of it at any end of the process.
#[derive(Debug)]
pub(crate) struct Scratch(File);

impl Scratch {
    /// Path by which this process opens the copy again.
    pub(super) fn path(&self) -> PathBuf {
        PathBuf::from(format!("/proc/self/fd/{}", self.0.as_raw_fd()))
    }

    /// Calls `open` with a name of the copy, which is gone when this returns: a library that resolves links cannot use
    /// [`Self::path`].
    pub(super) fn named<T>(&self, path: &Path, open: impl FnOnce(&Path) -> Result<T, BagError>) -> Result<T, BagError> {
        let io = || BagError::io("make a scratch file for", path);
        let folder = tempfile::tempdir().map_err(io())?;
        let name = folder.path().join("bag.db3");
        rustix::fs::linkat(CWD, self.path(), CWD, &name, AtFlags::SYMLINK_FOLLOW).map_err(Error::from).map_err(io())?;
        open(&name)
    }
}

/// Limit of the size of a scratch file.
#[derive(Debug, Clone, PartialEq)]
struct Limit {
    bytes: u64,
    reason: String,
    /// True if the disk sets the limit, and not the file.
    is_of_disk: bool,
    /// Free space in bytes below which others have filled the file system meanwhile.
    least_free: u64,
}

impl Limit {
    /// Limit for a file of `packed` bytes, in a file system with `free` bytes.
    fn new(packed: u64, free: u64, folder: &Path) -> Self {
        let (grown, spared) = (packed.saturating_mul(RATIO).max(LEAST), free - free / SPARED);
        let is_of_disk = spared < grown;
        let reason = match is_of_disk {
            true => format!("seven eighths of the {free} bytes that are free in {}", folder.display()),
            false => format!("{RATIO} times the {packed} bytes of the file, and at least {LEAST}"),
        };
        Self { bytes: spared.min(grown), reason, is_of_disk, least_free: free / SPARED / 2 }
    }

    /// Error for the file at `path`, whose decompressed size is `got`.
    fn exceeded(&self, path: &Path, got: String) -> BagError {
        let (path, reason) = (path.to_owned(), self.reason.clone());
        BagError::Scratch { path, limit: self.bytes, reason, got, is_of_disk: self.is_of_disk }
    }
}

/// Decompresses a file into a scratch file. A truncated file is decompressed up to its cut.
///
/// # Errors
/// [`BagError::Scratch`] if the file is larger than the limit, [`BagError::Interrupted`], [`BagError::Io`].
pub(super) fn unpack(path: &Path) -> Result<Scratch, BagError> {
    let io = || BagError::io("unpack", path);
    let mut packed = File::open(path).map_err(io())?;
    let len = packed.metadata().map_err(io())?.len();
    let mut start = Vec::new();
    (&mut packed).take(32).read_to_end(&mut start).map_err(io())?;
    let folder = std::env::temp_dir();
    let scratch = tempfile::tempfile_in(&folder).map_err(BagError::io("make a scratch file in", &folder))?;
    let limit = Limit::new(len, free_bytes(&scratch).map_err(io())?, &folder);
    // A size that the frame states is refused before a byte is written.
    if let Ok(Some(size)) = zstd::zstd_safe::get_frame_content_size(&start)
        && start.starts_with(&ZSTD_MAGIC)
        && size > limit.bytes
    {
        return Err(limit.exceeded(path, size.to_string()));
    }
    let packed = File::open(path).and_then(zstd::Decoder::new).map_err(io())?;
    copy(packed, &scratch, &limit, path)?;
    Ok(Scratch(scratch))
}

/// Copies `packed` to `scratch`, block by block.
fn copy(mut packed: impl Read, mut scratch: &File, limit: &Limit, path: &Path) -> Result<(), BagError> {
    let io = || BagError::io("unpack", path);
    let mut block = vec![0; BLOCK];
    let mut written = 0_u64;
    loop {
        if catenary_shell::is_signalled() {
            return Err(BagError::Interrupted { path: path.to_owned() });
        }
        let given = match packed.read(&mut block) {
            Ok(0) => return Ok(()),
            Ok(given) => given,
            Err(error) if error.kind() == ErrorKind::Interrupted => continue,
            // A file that is cut off is read up to there. One that is damaged from its beginning is none.
            Err(error) if written == 0 => return Err(io()(error)),
            Err(_damaged) => return Ok(()),
        };
        written += given as u64;
        if written > limit.bytes {
            return Err(limit.exceeded(path, "more".to_owned()));
        }
        scratch.write_all(&block[..given]).map_err(io())?;
        // Others write to the same file system meanwhile.
        if free_bytes(scratch).map_err(io())? < limit.least_free {
            let full = Error::new(ErrorKind::StorageFull, "the file system is almost full");
            return Err(io()(full));
        }
    }
}

/// Number of bytes that an unprivileged process may still write to the file system of `file`.
fn free_bytes(file: &File) -> std::io::Result<u64> {
    let found = rustix::fs::fstatvfs(file)?;
    Ok(found.f_bavail.saturating_mul(found.f_frsize))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn folder() -> PathBuf {
        PathBuf::from("/tmp")
    }

    #[test]
    fn a_limit_is_a_multiple_of_the_file_or_what_the_disk_can_spare() {
        assert_eq!(Limit::new(1000, 1 << 40, &folder()).bytes, LEAST);
        assert_eq!(Limit::new(LEAST, 1 << 40, &folder()).bytes, RATIO * LEAST);
        let spared = Limit::new(1000, 800, &folder());
        assert_eq!(spared.bytes, 700);
        assert!(spared.reason.contains("800 bytes that are free in /tmp"), "{spared:?}");
        assert_eq!(Limit::new(u64::MAX, u64::MAX, &folder()).bytes, u64::MAX - u64::MAX / SPARED);
    }

    #[test]
    fn a_copy_ends_at_its_limit_and_names_file_size_and_limit() {
        let limit = Limit { bytes: 3 * BLOCK as u64, reason: "a test".to_owned(), is_of_disk: false, least_free: 0 };
        let file = tempfile::tempfile().unwrap();
        copy(std::io::repeat(7).take(limit.bytes), &file, &limit, Path::new("a.mcap.zstd")).unwrap();
        assert_eq!(file.metadata().unwrap().len(), limit.bytes);
        let file = tempfile::tempfile().unwrap();
        let error = copy(std::io::repeat(7), &file, &limit, Path::new("a.mcap.zstd")).unwrap_err().to_string();
        assert!(
            error.starts_with("a.mcap.zstd: expected at most 3145728 bytes after decompression (a test), got more")
        );
        assert!(file.metadata().unwrap().len() <= limit.bytes && !error.contains('\n'), "{error}");
        let full = Limit { least_free: u64::MAX, ..limit };
        let error = copy(std::io::repeat(7), &file, &full, Path::new("a.mcap.zstd")).unwrap_err().to_string();
        assert_eq!(error, "a.mcap.zstd: cannot unpack: the file system is almost full");
    }

    #[test]
    fn a_scratch_file_has_no_name_and_is_opened_by_its_path() {
        let scratch = Scratch(tempfile::tempfile().unwrap());
        (&scratch.0).write_all(b"content").unwrap();
        assert_eq!(std::fs::read(scratch.path()).unwrap(), b"content");
        use std::os::unix::fs::MetadataExt;
        assert_eq!(scratch.0.metadata().unwrap().nlink(), 0);
        let named = |name: &Path| Ok((name.to_owned(), std::fs::read(name).unwrap()));
        let (name, content) = scratch.named(Path::new("a.db3.zstd"), named).unwrap();
        assert!(content == b"content" && !name.exists() && !name.parent().unwrap().exists());
        assert_eq!(scratch.0.metadata().unwrap().nlink(), 0);
    }
}
