//! Reindex of a bag: finishing its files and writing its `metadata.yaml` anew.

mod finish;

use crate::error::BagError;
use crate::format::metadata::{self, FileFacts, Origin, TopicFacts};
use crate::format::reserve;
use crate::reader::folder::layout_of;
use crate::reader::index::IndexedFile;
use crate::reader::{BagReader, TopicCount};
use std::path::Path;

/// Finishes the files of a bag whose recorder was killed, so every reader of MCAP can read them.
///
/// The `metadata.yaml` of a folder is written anew, with all bag files in the folder. A single file is finished alone.
/// No readable message is lost. An intact bag is left unchanged. Returns the notes of the bag before.
///
/// # Errors
/// As [`BagReader::open`], and [`BagError::Io`]; [`BagError::Unsupported`] for files other than MCAP, and for bags
/// whose messages or files were compressed one by one.
pub fn reindex(path: &Path) -> Result<Vec<String>, BagError> {
    let folder = if path.is_dir() { path } else { path.parent().unwrap_or(Path::new("")) };
    reserve::check(folder).map_err(BagError::io("finish", path))?;
    // The reserve of a killed recorder may hold the disk space that the index needs.
    if path.is_dir() {
        reserve::free(path);
    }
    let before = BagReader::open_files(path, true)?;
    if before.notes().is_empty() && before.indexed().iter().all(|f| f.is_finished) {
        return Ok(Vec::new());
    }
    let layout = layout_of(path).ok().flatten();
    let mode = layout.as_ref().map(|layout| layout.compression_mode.to_lowercase());
    if let Some(mode) = mode.filter(|mode| !["", "none"].contains(&mode.as_str())) {
        return Err(BagError::Unsupported {
            path: path.to_owned(),
            found: format!("finishing a bag of compression mode {mode} is"),
            remedy: "`ros2 bag reindex` does it",
        });
    }
    if let Some(file) = before.indexed().iter().find(|f| f.source.extension().is_none_or(|e| e != "mcap")) {
        return Err(BagError::Unsupported {
            path: file.path.clone(),
            found: "writing indexes of other files than .mcap is".to_owned(),
            remedy: "`ros2 bag reindex` does it",
        });
    }
    for file in before.indexed().iter().filter(|f| !f.is_finished) {
        finish::finish(&file.path)?;
    }
    if path.is_dir() {
        write_metadata(path, layout.as_ref())?;
    }
    Ok(before.notes().to_vec())
}

/// Writes the `metadata.yaml` of a folder anew. Facts that only the file before holds are kept.
fn write_metadata(folder: &Path, before: Option<&metadata::Layout>) -> Result<(), BagError> {
    let bag = BagReader::open_files(folder, true)?;
    let name = |path: &Path| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let file = |f: &IndexedFile| FileFacts { name: name(&f.path), span_ns: f.span_ns(), messages: f.messages() };
    let topic = |t: &TopicCount| {
        let hash = t.topic.type_hash.as_deref();
        let hash = hash.or_else(|| before?.type_hash(&t.topic.name, &t.topic.type_name));
        TopicFacts {
            name: t.topic.name.clone(),
            type_name: t.topic.type_name.clone(),
            encoding: t.topic.encoding.clone(),
            type_hash: hash.unwrap_or_default().to_owned(),
            profiles: t.topic.profiles.clone(),
            messages: t.messages,
        }
    };
    let files: Vec<FileFacts> = bag.indexed().iter().map(file).collect();
    let topics: Vec<TopicFacts> = bag.topics().iter().map(topic).collect();
    let origin = before.map_or_else(Origin::default, |before| {
        let listed = before.relative_file_paths.iter().map(|p| name(Path::new(p)));
        let missing: Vec<String> = listed.filter(|n| !folder.join(n).exists()).collect();
        before.origin(&missing, &files.iter().map(|f| f.name.clone()).collect::<Vec<_>>())
    });
    metadata::write(folder, &topics, &files, &origin)
}
