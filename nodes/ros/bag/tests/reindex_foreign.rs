//! `reindex` on bags of other recorders: a bag that it cannot improve is left unchanged.
#![allow(clippy::unwrap_used, clippy::disallowed_methods, reason = "a test of files")]

use catenary_bag::{BagReader, reindex};
use catenary_shell::Qos;
use mcap::records::MessageHeader;
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::io::Cursor;
use std::path::{Path, PathBuf};

/// Copy of the sample bag in its own folder.
fn swing() -> (tempfile::TempDir, PathBuf) {
    let (folder, sample) =
        (tempfile::tempdir().unwrap(), Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../bags/swing"));
    let bag = folder.path().join("swing");
    std::fs::create_dir(&bag).unwrap();
    for name in ["metadata.yaml", "swing_0.mcap"] {
        std::fs::copy(sample.join(name), bag.join(name)).unwrap();
    }
    (folder, bag)
}

fn metadata(bag: &Path) -> String {
    std::fs::read_to_string(bag.join("metadata.yaml")).unwrap()
}

#[test]
fn a_bag_that_misses_nothing_stays_as_it_is() {
    let (_folder, bag) = swing();
    let own = metadata(&bag).replace("custom_data: {}", "custom_data: {operator: me}");
    std::fs::write(bag.join("metadata.yaml"), &own).unwrap();
    assert_eq!(reindex(&bag).unwrap(), [] as [String; 0]);
    assert_eq!(metadata(&bag), own);
}

#[test]
fn a_bag_of_compressed_messages_is_refused_where_something_is_amiss() {
    let (_folder, bag) = swing();
    let own =
        metadata(&bag).replace("compression_mode: \"\"", "compression_mode: MESSAGE").replace("swing_0", "gone_0");
    std::fs::write(bag.join("metadata.yaml"), &own).unwrap();
    let error = reindex(&bag).unwrap_err().to_string();
    assert!(error.contains("compression mode message"), "{error}");
    assert_eq!(metadata(&bag), own);
}

#[test]
fn a_file_that_nobody_listed_is_noted_and_taken_in() {
    let (_folder, bag) = swing();
    std::fs::copy(bag.join("swing_0.mcap"), bag.join("swing_1.mcap")).unwrap();
    let before = BagReader::open(&bag).unwrap();
    assert!(before.notes().iter().any(|n| n.contains("swing_1.mcap: not listed")), "{:?}", before.notes());
    let count = before.message_count();
    reindex(&bag).unwrap();
    let after = BagReader::open(&bag).unwrap();
    assert_eq!((after.message_count(), after.notes().len()), (2 * count, 0));
}

/// Profile in the form of rosbag2, with policies that this crate stores but does not apply.
const PROFILE: &str = "- history: keep_all\n  depth: 0\n  reliability: reliable\n  durability: volatile\n  \
    deadline:\n    sec: 1\n    nsec: 500\n  lifespan:\n    sec: 2\n    nsec: 0\n  liveliness: manual_by_topic\n  \
    liveliness_lease_duration:\n    sec: 3\n    nsec: 0\n  avoid_ros_namespace_conventions: false\n";

/// Bag folder with an unfinished file of another recorder: three messages, an attachment and metadata.
fn unfinished(chunked: bool) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let bag = folder.path().join("lab");
    std::fs::create_dir(&bag).unwrap();
    let mut bytes = Cursor::new(Vec::new());
    let options = mcap::WriteOptions::new().chunk_size(None).use_chunks(chunked);
    let mut writer = options.create(&mut bytes).unwrap();
    let schema = writer.add_schema("std_msgs/msg/Int32", "ros2msg", b"int32 data\n").unwrap();
    let metadata = BTreeMap::from([("offered_qos_profiles".to_owned(), PROFILE.to_owned())]);
    let channel = writer.add_channel(schema, "/lab/number", "cdr", &metadata).unwrap();
    for log_time in 1..=3 {
        let header = MessageHeader { channel_id: channel, sequence: 0, log_time, publish_time: log_time };
        writer.write_to_known_channel(&header, &[0, 1, 0, 0, 7, 0, 0, 0]).unwrap();
    }
    writer.flush().unwrap();
    let data = Cow::Borrowed(&b"0.7 0.1"[..]);
    let (name, media_type) = ("camera.txt".to_owned(), "text/plain".to_owned());
    writer.attach(&mcap::Attachment { log_time: 1, create_time: 2, name, media_type, data }).unwrap();
    let metadata = BTreeMap::from([("operator".to_owned(), "me".to_owned())]);
    writer.write_metadata(&mcap::records::Metadata { name: "lab".to_owned(), metadata }).unwrap();
    let len = writer.into_inner().position() as usize;
    std::fs::write(bag.join("lab_0.mcap"), &bytes.into_inner()[..len]).unwrap();
    let text = "rosbag2_bagfile_information:\n  version: 8\n  storage_identifier: mcap\n  topics_with_message_count:\n    \
        - topic_metadata:\n        name: /lab/number\n        type: std_msgs/msg/Int32\n        \
        serialization_format: cdr\n        offered_qos_profiles: \"\"\n        type_description_hash: RIHS01_77\n      \
        message_count: 3\n  relative_file_paths:\n    - lab_0.mcap\n    - lab_1.mcap\n  files:\n    - path: lab_1.mcap\n      \
        starting_time:\n        nanoseconds_since_epoch: 4\n      duration:\n        nanoseconds: 9\n      message_count: 12\n  \
        custom_data:\n    operator: me\n    run: 5\n  ros_distro: humble\n";
    std::fs::write(bag.join("metadata.yaml"), text).unwrap();
    (folder, bag)
}

#[test]
fn what_others_say_of_a_bag_is_kept() {
    let (_folder, bag) = unfinished(true);
    assert_eq!(BagReader::open(&bag).unwrap().topics()[0].topic.qos, [Qos::Reliable { depth: 4096 }]);
    reindex(&bag).unwrap();
    let text = metadata(&bag);
    let indented: String = PROFILE.lines().map(|line| format!("      {line}\n")).collect();
    for part in ["    operator: me\n", "run: ", "ros_distro: humble", "type_description_hash: RIHS01_77", &indented] {
        assert!(text.contains(part), "{part} in {text}");
    }
}

#[test]
fn attachments_and_metadata_behind_the_last_chunk_are_kept() {
    let (_folder, bag) = unfinished(true);
    reindex(&bag).unwrap();
    let bytes = std::fs::read(bag.join("lab_0.mcap")).unwrap();
    let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
    let attachment = mcap::read::attachment(&bytes, &summary.attachment_indexes[0]).unwrap();
    assert_eq!((attachment.name.as_str(), &*attachment.data), ("camera.txt", &b"0.7 0.1"[..]));
    assert_eq!(mcap::read::metadata(&bytes, &summary.metadata_indexes[0]).unwrap().metadata["operator"], "me");
    let counts = summary.stats.unwrap();
    assert_eq!((counts.message_count, counts.attachment_count, counts.metadata_count), (3, 1, 1));
    assert_eq!(mcap::MessageStream::new(&bytes).unwrap().map(Result::unwrap).count(), 3);
}

#[test]
fn a_listed_file_that_is_missing_is_remembered_until_it_is_back() {
    let (_folder, bag) = unfinished(true);
    reindex(&bag).unwrap();
    let notes = BagReader::open(&bag).unwrap().notes().to_vec();
    assert_eq!(notes.len(), 1, "{notes:?}");
    assert!(notes[0].contains("lab_1.mcap: missing since") && notes[0].contains("12 messages"), "{notes:?}");
    // Readers of ROS 2 refuse a bag that lists a missing file.
    assert!(metadata(&bag).contains("relative_file_paths:\n  - lab_0.mcap\n  files"), "{}", metadata(&bag));
    assert_eq!(reindex(&bag).unwrap(), notes);
    assert_eq!(BagReader::open(&bag).unwrap().notes(), notes);
    std::fs::copy(bag.join("lab_0.mcap"), bag.join("lab_1.mcap")).unwrap();
    reindex(&bag).unwrap();
    let whole = BagReader::open(&bag).unwrap();
    assert_eq!((whole.notes(), whole.message_count()), (&[] as &[String], 6));
    assert!(!metadata(&bag).contains("missing_file"), "{}", metadata(&bag));
}

#[test]
fn a_file_without_chunks_is_noted_and_left_unchanged() {
    let (_folder, bag) = unfinished(false);
    let file = bag.join("lab_0.mcap");
    let before = std::fs::read(&file).unwrap();
    let notes = reindex(&file).unwrap();
    assert!(notes[0].contains("3 messages were found outside of chunks; reindex cannot finish"), "{notes:?}");
    assert_eq!(std::fs::read(&file).unwrap(), before);
}
