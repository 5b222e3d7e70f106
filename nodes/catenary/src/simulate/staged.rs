//! Output files that appear under their names only when they are complete.

use crate::exit::{Given, WrongInput};
use anyhow::{Context, Error, Result, anyhow};
use std::path::{Path, PathBuf};

/// File or folder under construction in a hidden folder beside its final place. Dropped without [`Staged::commit`], it
/// leaves nothing behind.
pub struct Staged {
    folder: PathBuf,
    last: PathBuf,
}

impl Staged {
    /// Creates the hidden folder and its parents.
    pub fn new(last: &Path) -> Result<Self> {
        let expected = || format!("{}: expected the name of a file or folder", last.display());
        let folder = hidden(last).with_context(expected).given()?;
        std::fs::create_dir_all(&folder).with_context(|| format!("{}: it cannot be written", last.display()))?;
        Ok(Self { folder, last: last.to_path_buf() })
    }

    /// Path during the construction, with the final name.
    pub fn path(&self) -> PathBuf {
        self.folder.join(self.last.file_name().unwrap_or_default())
    }

    /// Moves the file or folder to its final place.
    pub fn commit(self) -> Result<PathBuf> {
        let last = self.last.clone();
        // Some file systems notice a full disk only now, and a loss of power after the rename must not leave an empty file.
        if self.path().is_file() {
            std::fs::File::open(self.path()).and_then(|f| f.sync_all()).with_context(|| last.display().to_string())?;
        }
        std::fs::rename(self.path(), &last).with_context(|| last.display().to_string())?;
        Ok(last)
    }
}

impl Drop for Staged {
    fn drop(&mut self) {
        if let Err(e) = std::fs::remove_dir_all(&self.folder) {
            tracing::warn!("temporary folder {} cannot be removed: {e}", self.folder.display());
        }
    }
}

/// Hidden folder beside `last`.
fn hidden(last: &Path) -> Option<PathBuf> {
    let name = last.file_name()?.to_string_lossy();
    Some(last.with_file_name(format!(".{name}.{}", std::process::id())))
}

/// Replaces temporary paths in an error by the shown paths of their final places `last`, which the user knows.
pub fn with_final_names(error: Error, places: &[(&Path, &str)]) -> Error {
    let text = format!("{error:#}");
    let named = places.iter().fold(text.clone(), |text, (last, shown)| {
        let draft = hidden(last).and_then(|folder| Some(folder.join(last.file_name()?)));
        draft.map_or(text.clone(), |draft| text.replace(&draft.display().to_string(), shown))
    });
    // An untouched error keeps its type and its causes.
    match named == text {
        true => error,
        false if WrongInput::is(&error) => WrongInput::error(named),
        false => anyhow!(named),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_name_the_place_that_was_asked_for() {
        let last = Path::new("out/bag");
        let staged = hidden(last).unwrap().join("bag");
        let error = anyhow!("{}/bag_0.mcap: no space left", staged.display()).context("--out");
        let named = with_final_names(error, &[(last, "out/bag")]);
        assert_eq!(named.to_string(), "--out: out/bag/bag_0.mcap: no space left");
        let wrong =
            with_final_names(WrongInput::error(format!("{}: is it a track?", staged.display())), &[(last, "t.csv")]);
        assert!(WrongInput::is(&wrong) && wrong.to_string() == "t.csv: is it a track?", "{wrong}");
        assert_eq!(with_final_names(anyhow!("other"), &[(last, "x")]).to_string(), "other");
    }

    #[test]
    fn an_uncommitted_file_leaves_nothing() {
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
