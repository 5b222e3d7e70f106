//! `metadata.yaml`, version 9, as rosbag2 of ROS 2 Jazzy writes it.

use crate::error::BagError;
use crate::format::profile::Profile;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;

/// Name of the file.
pub(crate) const FILE_NAME: &str = "metadata.yaml";
/// Version that is written.
const VERSION: u32 = 9;
/// Start that rosbag2 writes for a bag without messages.
const NO_START_NS: i64 = i64::MAX;

#[derive(Debug, Serialize)]
struct Duration {
    nanoseconds: i64,
}

#[derive(Debug, Serialize)]
struct Start {
    nanoseconds_since_epoch: i64,
}

/// Topic with the number of its messages.
#[derive(Debug, Serialize)]
struct TopicEntry<'a> {
    topic_metadata: TopicMetadata<'a>,
    message_count: u64,
}

#[derive(Debug, Serialize)]
struct TopicMetadata<'a> {
    name: &'a str,
    #[serde(rename = "type")]
    type_name: &'a str,
    serialization_format: &'a str,
    offered_qos_profiles: &'a [Profile],
    type_description_hash: &'a str,
}

#[derive(Debug, Serialize)]
struct FileEntry<'a> {
    path: &'a str,
    starting_time: Start,
    duration: Duration,
    message_count: u64,
}

#[derive(Debug, Serialize)]
struct Information<'a> {
    version: u32,
    storage_identifier: &'static str,
    duration: Duration,
    starting_time: Start,
    message_count: u64,
    topics_with_message_count: Vec<TopicEntry<'a>>,
    compression_format: &'static str,
    compression_mode: &'static str,
    relative_file_paths: Vec<&'a str>,
    files: Vec<FileEntry<'a>>,
    custom_data: &'a BTreeMap<String, String>,
    ros_distro: &'a str,
}

#[derive(Debug, Serialize)]
struct Document<'a> {
    rosbag2_bagfile_information: Information<'a>,
}

/// Entry of one topic.
#[derive(Debug, Clone)]
pub(crate) struct TopicFacts {
    pub(crate) name: String,
    pub(crate) type_name: String,
    pub(crate) encoding: String,
    pub(crate) type_hash: String,
    pub(crate) profiles: Vec<Profile>,
    pub(crate) messages: u64,
}

/// Entry of one file.
#[derive(Debug, Clone)]
pub(crate) struct FileFacts {
    /// Name within the folder.
    pub(crate) name: String,
    /// First and last log time in ns; none for a file without messages.
    pub(crate) span_ns: Option<(i64, i64)>,
    pub(crate) messages: u64,
}

/// Entries about the recording as a whole.
#[derive(Debug, Clone)]
pub(crate) struct Origin {
    /// Entries that users added, by name.
    pub(crate) custom_data: BTreeMap<String, String>,
    /// ROS 2 distribution that recorded the bag; empty if unknown.
    pub(crate) ros_distro: String,
}

impl Default for Origin {
    /// Origin of a bag that this crate writes.
    fn default() -> Self {
        Self { custom_data: BTreeMap::new(), ros_distro: "jazzy".to_owned() }
    }
}

fn start(span_ns: Option<(i64, i64)>) -> Start {
    Start { nanoseconds_since_epoch: span_ns.map_or(NO_START_NS, |s| s.0) }
}

fn duration(span_ns: Option<(i64, i64)>) -> Duration {
    Duration { nanoseconds: span_ns.map_or(0, |s| s.1.saturating_sub(s.0)) }
}

/// Earliest start and latest end of several spans; none if all are none.
pub(crate) fn joined(spans: impl IntoIterator<Item = Option<(i64, i64)>>) -> Option<(i64, i64)> {
    spans.into_iter().flatten().reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)))
}

fn information<'a>(topics: &'a [TopicFacts], files: &'a [FileFacts], origin: &'a Origin) -> Information<'a> {
    let span_ns = joined(files.iter().map(|f| f.span_ns));
    let topic = |t: &'a TopicFacts| TopicEntry {
        topic_metadata: TopicMetadata {
            name: &t.name,
            type_name: &t.type_name,
            serialization_format: &t.encoding,
            offered_qos_profiles: &t.profiles,
            type_description_hash: &t.type_hash,
        },
        message_count: t.messages,
    };
    let file = |f: &'a FileFacts| FileEntry {
        path: &f.name,
        starting_time: start(f.span_ns),
        duration: duration(f.span_ns),
        message_count: f.messages,
    };
    Information {
        version: VERSION,
        storage_identifier: "mcap",
        duration: duration(span_ns),
        starting_time: start(span_ns),
        message_count: files.iter().map(|f| f.messages).sum(),
        topics_with_message_count: topics.iter().map(topic).collect(),
        compression_format: "",
        compression_mode: "",
        relative_file_paths: files.iter().map(|f| f.name.as_str()).collect(),
        files: files.iter().map(file).collect(),
        custom_data: &origin.custom_data,
        ros_distro: &origin.ros_distro,
    }
}

fn yaml(value: &impl Serialize) -> Result<String, String> {
    serde_saphyr::to_string(value).map_err(|e| e.to_string())
}

/// Text that rosbag2 stores inside the MCAP file: the information without its enclosing key.
pub(crate) fn embedded_text(topics: &[TopicFacts], files: &[FileFacts]) -> Result<String, String> {
    yaml(&information(topics, files, &Origin::default()))
}

/// Text of the file.
pub(crate) fn text(topics: &[TopicFacts], files: &[FileFacts], origin: &Origin) -> Result<String, String> {
    yaml(&Document { rosbag2_bagfile_information: information(topics, files, origin) })
}

/// Writes the file into `folder`. An existing file is replaced atomically.
#[allow(clippy::disallowed_methods, reason = "bags are files")]
pub(crate) fn write(
    folder: &Path,
    topics: &[TopicFacts],
    files: &[FileFacts],
    origin: &Origin,
) -> Result<(), BagError> {
    let path = folder.join(FILE_NAME);
    let text = text(topics, files, origin).map_err(|e| BagError::Io {
        action: "put its text together",
        path: path.clone(),
        reason: std::io::Error::other(e),
    })?;
    catenary_shell::files::replace(&path, text.as_bytes()).map_err(BagError::io("write", &path))
}

/// Parts of the file, of any version, that reading and finishing a bag need.
#[derive(Debug, Deserialize)]
pub(crate) struct Layout {
    /// Names of the bag files, in order.
    pub(crate) relative_file_paths: Vec<String>,
    #[serde(default)]
    custom_data: Option<BTreeMap<String, String>>,
    #[serde(default)]
    ros_distro: Option<String>,
    #[serde(default)]
    files: Option<Vec<ListedFile>>,
    #[serde(default)]
    topics_with_message_count: Option<Vec<ListedTopic>>,
    /// `message` or `file` if the recorder compressed single messages or whole files; empty or `none` otherwise.
    #[serde(default)]
    pub(crate) compression_mode: String,
}

#[derive(Debug, Deserialize)]
struct ListedFile {
    path: String,
    message_count: u64,
}

#[derive(Debug, Deserialize)]
struct ListedTopic {
    topic_metadata: ListedType,
}

#[derive(Debug, Deserialize)]
struct ListedType {
    name: String,
    #[serde(rename = "type")]
    type_name: String,
    #[serde(default)]
    type_description_hash: Option<String>,
}

/// Prefix of custom-data entries about missing files. The rest of the key is the name of a file that was listed but
/// missing when the bag was finished.
const MISSING: &str = "missing_file ";

impl Layout {
    /// Entries about the recording. Files in `missing` get an entry in the custom data; files in `present` lose theirs.
    pub(crate) fn origin(&self, missing: &[String], present: &[String]) -> Origin {
        let mut custom_data = self.custom_data.clone().unwrap_or_default();
        let messages = |name: &String| {
            let is_it = |f: &&ListedFile| Path::new(&f.path).file_name().is_some_and(|n| n == name.as_str());
            let listed = self.files.iter().flatten().find(is_it);
            listed
                .map_or_else(|| "its messages were not counted".to_owned(), |f| format!("{} messages", f.message_count))
        };
        custom_data.extend(missing.iter().map(|name| (format!("{MISSING}{name}"), messages(name))));
        custom_data.retain(|key, _| key.strip_prefix(MISSING).is_none_or(|name| !present.iter().any(|p| p == name)));
        Origin { custom_data, ros_distro: self.ros_distro.clone().unwrap_or_default() }
    }

    /// Entries about the recording that users or programs added.
    pub(crate) fn added_data(&self) -> BTreeMap<String, String> {
        let all = self.custom_data.iter().flatten().filter(|(key, _)| !key.starts_with(MISSING));
        all.map(|(key, text)| (key.clone(), text.clone())).collect()
    }

    /// Files that were missing when the bag was finished, each with the number of its messages as text.
    pub(crate) fn missing_before(&self) -> impl Iterator<Item = (&str, &str)> {
        self.custom_data.iter().flatten().filter_map(|(key, known)| Some((key.strip_prefix(MISSING)?, known.as_str())))
    }

    /// RIHS01 hash of a topic's type.
    pub(crate) fn type_hash(&self, name: &str, type_name: &str) -> Option<&str> {
        let mut topics = self.topics_with_message_count.iter().flatten().map(|t| &t.topic_metadata);
        topics.find(|t| t.name == name && t.type_name == type_name)?.type_description_hash.as_deref()
    }
}

#[derive(Debug, Deserialize)]
struct LayoutDocument {
    rosbag2_bagfile_information: Layout,
}

/// Parses the text of the file. The error is the first line of the parser's message.
pub(crate) fn parse(text: &str) -> Result<Layout, String> {
    serde_saphyr::from_str::<LayoutDocument>(text)
        .map(|d| d.rosbag2_bagfile_information)
        .map_err(|e| e.to_string().lines().next().unwrap_or_default().to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use catenary_shell::Qos;

    #[test]
    fn text_is_that_of_rosbag2() {
        let topic = TopicFacts {
            name: "/panda/current_pose".into(),
            type_name: "geometry_msgs/msg/PoseStamped".into(),
            type_hash: "RIHS01_10f3786d7d40fd2b54367835614bff85d4ad3b5dab62bf8bca0cc232d73b4cd8".into(),
            encoding: "cdr".into(),
            profiles: vec![Profile::from(Qos::BestEffort { depth: 1 })],
            messages: 3,
        };
        let file = FileFacts { name: "swing_0.mcap".into(), span_ns: Some((1_000, 5_000)), messages: 3 };
        let expected = "\
rosbag2_bagfile_information:
  version: 9
  storage_identifier: mcap
  duration:
    nanoseconds: 4000
  starting_time:
    nanoseconds_since_epoch: 1000
  message_count: 3
  topics_with_message_count:
  - topic_metadata:
      name: /panda/current_pose
      type: geometry_msgs/msg/PoseStamped
      serialization_format: cdr
      offered_qos_profiles:
      - history: keep_last
        depth: 1
        reliability: best_effort
        durability: volatile
        deadline:
          sec: 9223372036
          nsec: 854775807
        lifespan:
          sec: 9223372036
          nsec: 854775807
        liveliness: automatic
        liveliness_lease_duration:
          sec: 9223372036
          nsec: 854775807
        avoid_ros_namespace_conventions: false
      type_description_hash: RIHS01_10f3786d7d40fd2b54367835614bff85d4ad3b5dab62bf8bca0cc232d73b4cd8
    message_count: 3
  compression_format: \"\"
  compression_mode: \"\"
  relative_file_paths:
  - swing_0.mcap
  files:
  - path: swing_0.mcap
    starting_time:
      nanoseconds_since_epoch: 1000
    duration:
      nanoseconds: 4000
    message_count: 3
  custom_data: {}
  ros_distro: jazzy
";
        let written = text(&[topic], &[file], &Origin::default()).unwrap();
        assert_eq!(written, expected);
        assert_eq!(parse(&written).unwrap().relative_file_paths, ["swing_0.mcap"]);
    }

    #[test]
    fn a_bag_without_messages_starts_where_rosbag2_says() {
        let file = FileFacts { name: "a_0.mcap".into(), span_ns: None, messages: 0 };
        let written = text(&[], &[file], &Origin::default()).unwrap();
        assert!(written.contains("nanoseconds_since_epoch: 9223372036854775807"), "{written}");
        assert!(written.contains("topics_with_message_count: []"), "{written}");
    }
}
