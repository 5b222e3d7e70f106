//! Files of a bag folder.

use crate::error::BagError;
use crate::format::metadata;
use std::path::{Path, PathBuf};

/// True if a file belongs to a bag by its name.
fn is_bag_file(name: &str) -> bool {
    let name = name.strip_suffix(".zstd").unwrap_or(name);
    name.ends_with(".mcap") || name.ends_with(".db3")
}

/// Files of a bag folder, in order, with notes about files that are missing or not listed.
pub(super) fn files_of(folder: &Path, all: bool, notes: &mut Vec<String>) -> Result<Vec<PathBuf>, BagError> {
    let present = listing(folder)?;
    let bag_files: Vec<PathBuf> = present.iter().filter(|n| is_bag_file(n)).map(|n| folder.join(n)).collect();
    let layout = layout_of(folder).and_then(|layout| layout.ok_or_else(|| "metadata.yaml is missing".to_owned()));
    let listed: Vec<PathBuf> = match layout {
        Ok(layout) => {
            for (name, known) in layout.missing_before().filter(|(name, _)| !folder.join(name).exists()) {
                let path = folder.join(name).display().to_string();
                notes.push(format!("{path}: missing since the bag was reindexed without it ({known})"));
            }
            // Early versions of rosbag2 list paths that begin with the folder's name at that time.
            let name = |p: &String| Path::new(p).file_name().map(|n| folder.join(n));
            layout.relative_file_paths.iter().filter_map(name).collect()
        }
        Err(note) => {
            notes.push(format!("{}: {note}", folder.display()));
            bag_files.clone()
        }
    };
    let (mut found, missing): (Vec<PathBuf>, Vec<PathBuf>) = listed.into_iter().partition(|p| p.exists());
    for path in missing {
        notes.push(format!("{}: listed in metadata.yaml, and missing", path.display()));
    }
    for path in bag_files.iter().filter(|path| !found.contains(path)) {
        notes.push(format!("{}: not listed in metadata.yaml", path.display()));
    }
    if all {
        found.clone_from(&bag_files);
    }
    if found.is_empty() {
        found = bag_files;
    }
    if found.is_empty() {
        let found = match &present[..] {
            [] => "an empty folder".to_owned(),
            [a, b, c, d, _, ..] => {
                format!("a folder without .mcap or .db3 files that holds {a}, {b}, {c}, {d} and more")
            }
            few => format!("a folder without .mcap or .db3 files that holds {}", few.join(", ")),
        };
        return Err(BagError::NotABag { path: folder.to_owned(), found });
    }
    Ok(found)
}

/// Parses a folder's metadata.yaml; none if there is no such file.
#[allow(clippy::disallowed_methods, reason = "bags are files")]
pub(crate) fn layout_of(folder: &Path) -> Result<Option<metadata::Layout>, String> {
    let unreadable = |e: &dyn std::fmt::Display| format!("metadata.yaml is not readable ({e})");
    match std::fs::read_to_string(folder.join(metadata::FILE_NAME)) {
        Ok(text) => metadata::parse(&text).map(Some).map_err(|e| unreadable(&e)),
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => Ok(None),
        Err(e) => Err(unreadable(&e)),
    }
}

/// Names in a folder, with split files in the order of their numbers.
fn listing(folder: &Path) -> Result<Vec<String>, BagError> {
    let entries = std::fs::read_dir(folder).map_err(BagError::io("list", folder))?;
    let mut names: Vec<String> = entries.flatten().map(|e| e.file_name().to_string_lossy().into_owned()).collect();
    // Sorted as text, part 10 would come before part 2.
    let number = |name: &str| {
        let stem = name.split('.').next().unwrap_or_default();
        stem.rsplit('_').next().and_then(|n| n.parse::<u64>().ok()).unwrap_or(u64::MAX)
    };
    names.sort_by(|a, b| number(a).cmp(&number(b)).then_with(|| a.cmp(b)));
    Ok(names)
}
