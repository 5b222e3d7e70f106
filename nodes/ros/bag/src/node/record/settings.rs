//! Settings of a recording.

use crate::error::BagError;
use crate::filter::TopicFilter;
use crate::node::overrides::QosOverrides;
use crate::writer::{Compression, Split, WriterOptions};
use catenary_shell::contract::{self, Topic};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// Least limit in bytes of a file, as in rosbag2.
const LEAST_SIZE: u64 = 1024;

/// Settings of a recording: topics, output and splitting.
#[derive(Debug, Clone)]
pub struct RecordSettings {
    /// Folder of the bag; it must not exist yet.
    pub out: PathBuf,
    /// Topics of the whole graph. A filter that chooses none means those of the contract without `/clock`, the camera's
    /// images, and excluded topics.
    pub filter: TopicFilter,
    /// True to record the camera's images, too, if the filter chooses nothing.
    pub images: bool,
    /// Compression of the chunks.
    pub compression: Compression,
    /// Limits of a file.
    pub split: Split,
    /// Overrides of the profiles of subscriptions.
    pub overrides: QosOverrides,
}

impl RecordSettings {
    /// Settings that record the contract's topics without images and `/clock`, compressed, into one file.
    #[must_use]
    pub fn new(out: PathBuf) -> Self {
        Self {
            out,
            filter: TopicFilter::default(),
            images: false,
            compression: Compression::default(),
            split: Split::default(),
            overrides: QosOverrides::default(),
        }
    }

    /// Rejects impossible names and limits, and a folder that exists or cannot be created.
    ///
    /// # Errors
    /// [`BagError::Setting`], [`BagError::Exists`], [`BagError::Io`].
    pub fn check(&self) -> Result<(), BagError> {
        self.filter.check()?;
        if let Some(bytes) = self.split.bytes.filter(|bytes| *bytes < LEAST_SIZE) {
            let expected = format!("0 for no limit, or at least {LEAST_SIZE} bytes");
            return Err(BagError::Setting { name: "max_bag_size", expected, got: bytes.to_string() });
        }
        if self.out.exists() {
            return Err(BagError::Exists { path: self.out.clone() });
        }
        let parents = self.out.ancestors().skip(1).map(|p| if p.as_os_str().is_empty() { Path::new(".") } else { p });
        // The nearest existing parent decides if the folder can be created.
        let Some(nearest) = parents.into_iter().find(|p| p.exists()) else { return Ok(()) };
        let refuse = |kind: ErrorKind| Err(BagError::io("make the folder", &self.out)(kind.into()));
        match std::fs::metadata(nearest) {
            Ok(found) if !found.is_dir() => refuse(ErrorKind::NotADirectory),
            Ok(found) if found.permissions().readonly() => refuse(ErrorKind::PermissionDenied),
            Ok(_) => Ok(()),
            Err(e) => Err(BagError::io("look at", nearest)(e)),
        }
    }

    /// True if a topic with these names, before and after remapping, is recorded.
    pub(super) fn takes(&self, names: &[&str], type_name: &str) -> bool {
        if self.filter.chooses() {
            return self.filter.takes(names, type_name);
        }
        let is_usual = |topic: &Topic| *topic != contract::CLOCK && (self.images || *topic != contract::IMAGE);
        names.iter().any(|name| contract::topic(name).is_some_and(is_usual)) && !self.filter.excludes(names, type_name)
    }

    /// Topics of the contract that are subscribed to before anybody publishes them. `resolve` applies the remapping.
    /// With `all`, `/clock` is subscribed to only when it is published.
    pub(super) fn agreed(&self, resolve: impl Fn(&str) -> String) -> Vec<&'static Topic> {
        let taken = |topic: &&Topic| {
            self.takes(&[topic.name, &resolve(topic.name)], topic.type_name)
                && !(self.filter.all && **topic == contract::CLOCK)
        };
        contract::TOPICS.iter().filter(taken).collect()
    }

    pub(super) fn writer_options(&self) -> WriterOptions {
        WriterOptions { compression: self.compression, split: self.split, ..WriterOptions::default() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn agreed(settings: &RecordSettings) -> Vec<&'static str> {
        settings.agreed(|name| format!("/{name}").replace("//", "/")).iter().map(|t| t.name).collect()
    }

    #[test]
    fn all_but_clock_and_images_are_recorded_unless_told_otherwise() {
        let usual = RecordSettings::new("bag".into());
        assert_eq!(agreed(&usual).len(), contract::TOPICS.len() - 2);
        assert!(!agreed(&usual).contains(&contract::CLOCK.name) && !agreed(&usual).contains(&contract::IMAGE.name));
        assert!(agreed(&RecordSettings { images: true, ..usual.clone() }).contains(&contract::IMAGE.name));
        assert!(!usual.takes(&["/lab/notes"], "std_msgs/msg/String"));
        let filter = TopicFilter { exclude_topics: vec!["/tf*".into()], ..TopicFilter::default() };
        assert_eq!(agreed(&RecordSettings { filter, ..usual.clone() }).len(), contract::TOPICS.len() - 4);
        let all = TopicFilter { all: true, ..TopicFilter::default() };
        assert_eq!(agreed(&RecordSettings { filter: all, ..usual }).len(), contract::TOPICS.len() - 1);
    }

    #[test]
    fn topics_are_chosen_by_name_or_beginning() {
        let chosen = |names: &[&str]| {
            agreed(&RecordSettings { filter: TopicFilter::of(names), ..RecordSettings::new("bag".into()) })
        };
        assert_eq!(chosen(&["/policy/*", "policy/action"]), ["policy/action", "policy/observation"]);
        assert_eq!(chosen(&["clock"]), ["/clock"]);
        assert_eq!(chosen(&["/policy/acton"]), [] as [&str; 0]);
    }

    #[test]
    fn a_folder_that_cannot_be_made_is_refused_beforehand() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("file");
        std::fs::write(&file, "").unwrap();
        let words = |out: PathBuf| RecordSettings::new(out).check().map_err(|e| e.to_string());
        assert!(words(file.join("bag")).unwrap_err().contains("cannot make the folder: not a directory"));
        assert!(words(file).unwrap_err().contains("expected a folder that does not exist yet"));
        assert_eq!(words(folder.path().join("a/b/bag")), Ok(()));
        assert_eq!(words("bag".into()), Ok(()));
        let split = Split { bytes: Some(1000), duration: None };
        let error = RecordSettings { split, ..RecordSettings::new("bag".into()) }.check().unwrap_err().to_string();
        assert_eq!(error, "max_bag_size: expected 0 for no limit, or at least 1024 bytes, got 1000");
    }
}
