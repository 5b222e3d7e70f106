//! Model and folder of the demo.

use anyhow::{Context, Result};
use std::path::{Path, PathBuf};

/// Model that the demo infers, trains and simulates with.
pub const MODEL: &str = include_str!("../../../../launch_configs/models/soft_bar_place.yaml");
/// Name of the model.
pub const MODEL_NAME: &str = "soft_bar_place";

/// Creates `wanted`, or the first of `wanted-2`, `wanted-3`, ... that does not exist, so that no earlier result is
/// overwritten.
pub fn fresh_folder(wanted: &Path) -> Result<PathBuf> {
    let name = wanted.file_name().with_context(|| format!("{} names no folder", wanted.display()))?.to_string_lossy();
    let free = |n: u32| if n == 1 { wanted.to_path_buf() } else { wanted.with_file_name(format!("{name}-{n}")) };
    let path = (1..).map(free).find(|p| !p.exists()).expect("there are more numbers than folders");
    std::fs::create_dir_all(&path).with_context(|| path.display().to_string())?;
    Ok(path)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_earlier_demo_is_kept() {
        let folder = tempfile::tempdir().unwrap();
        let wanted = folder.path().join("demo");
        assert_eq!(fresh_folder(&wanted).unwrap(), wanted);
        assert_eq!(fresh_folder(&wanted).unwrap(), folder.path().join("demo-2"));
    }
}
