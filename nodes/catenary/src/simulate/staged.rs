//! Files that appear under their names when they are whole.

use anyhow::{Context, Result};
use std::path::{Path, PathBuf};

/// A file or folder that is being made in a hidden folder beside its final place. Dropped before [`Staged::commit`], it
/// leaves nothing.
pub struct Staged {
    folder: PathBuf,
    last: PathBuf,
}

impl Staged {
    /// Makes the hidden folder, and the folders above it.
    pub fn new(last: &Path) -> Result<Self> {
        let name =
            last.file_name().with_context(|| format!("{}: expected the name of a file or folder", last.display()))?;
        let folder = last.with_file_name(format!(".{}.{}", name.to_string_lossy(), std::process::id()));
        std::fs::create_dir_all(&folder).with_context(|| folder.display().to_string())?;
        Ok(Self { folder, last: last.to_path_buf() })
    }

    /// Where it is made; of the final name.
    pub fn path(&self) -> PathBuf {
        self.folder.join(self.last.file_name().unwrap_or_default())
    }

    /// Gives it its final place.
    pub fn commit(self) -> Result<PathBuf> {
        let last = self.last.clone();
        std::fs::rename(self.path(), &last).with_context(|| last.display().to_string())?;
        Ok(last)
    }
}

impl Drop for Staged {
    fn drop(&mut self) {
        if let Err(e) = std::fs::remove_dir_all(&self.folder) {
            tracing::warn!("{}: {e}", self.folder.display());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_not_committed_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let last = folder.path().join("out/video.gif");
        let staged = Staged::new(&last).unwrap();
        std::fs::write(staged.path(), "half").unwrap();
        drop(staged);
        assert_eq!(std::fs::read_dir(last.parent().unwrap()).unwrap().count(), 0);
        let staged = Staged::new(&last).unwrap();
        std::fs::write(staged.path(), "whole").unwrap();
        assert_eq!(staged.commit().unwrap(), last);
        assert_eq!(std::fs::read_to_string(&last).unwrap(), "whole");
        assert_eq!(std::fs::read_dir(last.parent().unwrap()).unwrap().count(), 1);
    }
}
