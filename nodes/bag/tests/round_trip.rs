//! What is written is read back: messages, order, topics, metadata; and what is no bag is called by its name.
#![allow(clippy::disallowed_methods, clippy::unwrap_used, reason = "a test of files reads files")]

use catenary_bag::{BagError, BagReader, BagWriter, Compression, WriterOptions, reindex};
use catenary_msgs::geometry_msgs::msg::{PoseStamped, TwistStamped};
use catenary_msgs::sensor_msgs::msg::Image;
use catenary_shell::Qos;
use std::path::Path;
use std::time::Duration;

fn pose(x: f64) -> PoseStamped {
    let mut pose = PoseStamped::default();
    pose.header.frame_id = "panda_link0".into();
    pose.pose.position.x = x;
    pose
}

fn image(value: u8) -> Image {
    Image { width: 64, height: 64, step: 64, encoding: "mono8".into(), data: vec![value; 4096], ..Image::default() }
}

/// A bag of 200 poses and 20 images whose log times run against the order of writing within each ten.
fn write(folder: &Path, compression: Compression) {
    let options = WriterOptions { compression, chunk_bytes: 3000, ..WriterOptions::default() };
    let mut bag = BagWriter::create(folder, &options).unwrap();
    let poses = bag.add_topic_of::<PoseStamped>("/pose", Qos::BestEffort { depth: 1 }).unwrap();
    let images = bag.add_topic_of::<Image>("/image", Qos::ReliableTransientLocal { depth: 16 }).unwrap();
    for i in 0..200_i64 {
        let time = 1_000_000 * (10 * (i / 10) + 9 - i % 10);
        bag.write(poses, time, time - 5, &pose(time as f64)).unwrap();
        if i % 10 == 0 {
            bag.write(images, time, time - 5, &image((i / 10) as u8)).unwrap();
        }
    }
    let summary = bag.finish().unwrap();
    assert_eq!((summary.messages, summary.span_ns), (220, Some((0, 199_000_000))));
}

#[test]
fn messages_come_back_in_order_of_time() {
    let folder = tempfile::tempdir().unwrap();
    for compression in [Compression::None, Compression::Zstd] {
        let path = folder.path().join(compression.name());
        write(&path, compression);
        let bag = BagReader::open(&path).unwrap();
        assert_eq!(bag.notes(), [] as [String; 0]);
        assert_eq!((bag.message_count(), bag.span_ns()), (220, Some((0, 199_000_000))));
        let all: Vec<_> = bag.messages().map(Result::unwrap).collect();
        assert_eq!(all.len(), 220);
        assert!(all.windows(2).all(|w| w[0].log_time_ns <= w[1].log_time_ns));
        let poses: Vec<f64> =
            bag.messages_of(&["/pose"]).map(|m| m.unwrap().decode::<PoseStamped>().unwrap().pose.position.x).collect();
        assert_eq!(poses, (0..200).map(|i| f64::from(i) * 1e6).collect::<Vec<_>>());
        let images: Vec<Image> = bag.messages_of(&["/image"]).map(|m| m.unwrap().decode().unwrap()).collect();
        assert_eq!(images, (0..20).map(image).collect::<Vec<_>>());
    }
}

#[test]
fn topics_keep_type_hash_and_profile() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("swing");
    write(&path, Compression::Zstd);
    let bag = BagReader::open(&path).unwrap();
    assert_eq!(bag.describe_topics(), "/image [sensor_msgs/msg/Image] 20, /pose [geometry_msgs/msg/PoseStamped] 200");
    let pose = &bag.topic("/pose").unwrap().topic;
    assert_eq!(pose.qos, [Qos::BestEffort { depth: 1 }]);
    assert_eq!(
        pose.type_hash.as_deref(),
        Some("RIHS01_10f3786d7d40fd2b54367835614bff85d4ad3b5dab62bf8bca0cc232d73b4cd8")
    );
    let error = bag.messages().next().unwrap().unwrap().decode::<TwistStamped>().unwrap_err().to_string();
    assert_eq!(error, "topic /pose: expected geometry_msgs/msg/TwistStamped, found geometry_msgs/msg/PoseStamped");
    let text = std::fs::read_to_string(path.join("metadata.yaml")).unwrap();
    for part in ["message_count: 220", "nanoseconds: 199000000", "- swing_0.mcap", "name: /image", "version: 9"] {
        assert!(text.contains(part), "{part} in {text}");
    }
    assert_eq!(std::fs::read_dir(&path).unwrap().count(), 2);
}

#[test]
fn metadata_is_written_at_once_and_can_be_made_anew() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bag");
    write(&path, Compression::Zstd);
    let file = path.join("metadata.yaml");
    let written = std::fs::read_to_string(&file).unwrap();
    std::fs::remove_file(&file).unwrap();
    let bag = BagReader::open(&path).unwrap();
    assert_eq!(bag.message_count(), 220);
    assert!(bag.notes()[0].contains("metadata.yaml is missing"), "{:?}", bag.notes());
    reindex(&path).unwrap();
    let anew = std::fs::read_to_string(&file).unwrap();
    let sorted = |text: &str| {
        let mut lines: Vec<&str> = text.lines().collect();
        lines.sort_unstable();
        lines.join("\n")
    };
    assert_eq!(sorted(&anew), sorted(&written));

    let open = folder.path().join("open");
    let _writer = BagWriter::create(&open, &WriterOptions::default()).unwrap();
    assert!(std::fs::read_to_string(open.join("metadata.yaml")).unwrap().contains("open_0.mcap"));
    let empty = BagReader::open(&open).unwrap();
    assert_eq!((empty.message_count(), empty.span_ns(), empty.messages().count()), (0, None, 0));
}

#[test]
fn a_chunk_ends_after_a_second_of_log_time() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("slow");
    let mut bag = BagWriter::create(&path, &WriterOptions::default()).unwrap();
    let topic = bag.add_topic_of::<PoseStamped>("/pose", Qos::DEFAULT).unwrap();
    let seen = |expected: usize| {
        let bag = BagReader::open(&path).unwrap();
        assert_eq!(bag.messages().map(Result::unwrap).count(), expected);
        assert!(bag.notes()[0].contains("was not finished"), "{:?}", bag.notes());
    };
    for i in 0..7_i64 {
        bag.write(topic, i * 300_000_000, 0, &pose(0.0)).unwrap();
    }
    seen(5);
    bag.flush().unwrap();
    seen(7);
    let at_once = WriterOptions { chunk_period: Duration::ZERO, ..WriterOptions::default() };
    let mut bag = BagWriter::create(&folder.path().join("at_once"), &at_once).unwrap();
    let topic = bag.add_topic_of::<PoseStamped>("/pose", Qos::DEFAULT).unwrap();
    bag.write(topic, 0, 0, &pose(0.0)).unwrap();
    assert_eq!(BagReader::open(&folder.path().join("at_once")).unwrap().message_count(), 1);
}

#[test]
fn a_bag_is_never_written_over() {
    let folder = tempfile::tempdir().unwrap();
    let error = BagWriter::create(folder.path(), &WriterOptions::default()).err().unwrap();
    assert!(matches!(error, BagError::Exists { .. }), "{error}");
}

#[test]
fn a_topic_keeps_its_type() {
    let folder = tempfile::tempdir().unwrap();
    let mut bag = BagWriter::create(&folder.path().join("bag"), &WriterOptions::default()).unwrap();
    let first = bag.add_topic_of::<PoseStamped>("/pose", Qos::DEFAULT).unwrap();
    assert_eq!(bag.add_topic_of::<PoseStamped>("/pose", Qos::DEFAULT).unwrap(), first);
    let error = bag.add_topic_of::<TwistStamped>("/pose", Qos::DEFAULT).unwrap_err().to_string();
    assert!(error.contains("/pose") && error.contains("TwistStamped") && error.contains("PoseStamped"), "{error}");
}

#[test]
fn split_files_are_read_as_one_bag() {
    let folder = tempfile::tempdir().unwrap();
    let (one, two, both) = (folder.path().join("one"), folder.path().join("two"), folder.path().join("both"));
    write(&one, Compression::Zstd);
    write(&two, Compression::None);
    std::fs::create_dir(&both).unwrap();
    std::fs::copy(one.join("one_0.mcap"), both.join("part_2.mcap")).unwrap();
    std::fs::copy(two.join("two_0.mcap"), both.join("part_10.mcap")).unwrap();
    reindex(&both).unwrap();
    let text = std::fs::read_to_string(both.join("metadata.yaml")).unwrap();
    assert!(text.contains("relative_file_paths:\n  - part_2.mcap\n  - part_10.mcap\n"), "{text}");
    std::fs::write(both.join("part_10.mcap"), b"").unwrap();
    let half = BagReader::open(&both).unwrap();
    assert_eq!((half.message_count(), half.notes().len()), (220, 1));
    assert!(half.notes()[0].contains("part_10.mcap") && half.notes()[0].contains("an empty file"));
    std::fs::copy(two.join("two_0.mcap"), both.join("part_10.mcap")).unwrap();
    let bag = BagReader::open(&both).unwrap();
    assert_eq!((bag.message_count(), bag.topics().len()), (440, 2));
    let times: Vec<i64> = bag.messages().map(|m| m.unwrap().log_time_ns).collect();
    assert!(times.len() == 440 && times.is_sorted());
}

#[test]
fn what_is_no_bag_is_called_by_its_name() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("thing");
    let error = |path: &Path| BagReader::open(path).unwrap_err().to_string();
    assert!(error(&path).contains("found nothing"), "{}", error(&path));
    assert!(error(folder.path()).contains("an empty folder"));
    std::fs::write(&path, b"").unwrap();
    assert!(error(&path).contains("an empty file"));
    std::fs::write(&path, b"hello").unwrap();
    assert!(error(&path).contains("a file of 5 bytes"));
    assert!(error(folder.path()).contains("a folder without .mcap files that holds thing"));
    std::fs::write(&path, b"SQLite format 3\0....").unwrap();
    assert!(error(&path).contains("not supported yet") && error(&path).contains("ros2 bag convert"));
    std::fs::write(folder.path().join("old_0.db3"), b"SQLite format 3\0").unwrap();
    assert!(error(folder.path()).contains("ros2 bag convert"));
    let old = "rosbag2_bagfile_information:\n  version: 4\n  storage_identifier: sqlite3\n  relative_file_paths:\n    - a.db3\n";
    std::fs::write(folder.path().join("metadata.yaml"), old).unwrap();
    assert!(error(folder.path()).contains("ros2 bag convert"));
    std::fs::write(&path, [0x28, 0xb5, 0x2f, 0xfd, 0, 0]).unwrap();
    assert!(error(&path).contains("zstd -d"));
}
