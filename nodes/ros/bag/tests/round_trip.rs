//! Messages, order, topics and metadata of a written bag are read back, and errors name things that are no bags.
#![allow(clippy::disallowed_methods, clippy::unwrap_used, reason = "a test of files reads files")]

use catenary_bag::{
    BagError, BagReader, BagWriter, Compression, Split, WriterOptions, latched_elsewhere, read_measured, reindex,
};
use catenary_core::Model;
use catenary_msgs::geometry_msgs::msg::{PoseStamped, TwistStamped};
use catenary_msgs::msg::EpisodeEvent;
use catenary_msgs::sensor_msgs::msg::Image;
use catenary_shell::Qos;
use std::path::{Path, PathBuf};
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

/// Writes a bag of 200 poses and 20 images. Within each ten poses, the log times run against the order of writing.
fn write(folder: &Path, compression: Compression) {
    // Small chunks, so the reader has to merge chunks that overlap in time.
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
    for compression in Compression::ALL {
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
    let writer = BagWriter::create(&open, &WriterOptions::default()).unwrap();
    assert!(std::fs::read_to_string(open.join("metadata.yaml")).unwrap().contains("open_0.mcap"));
    let empty = BagReader::open(&open).unwrap();
    assert_eq!((empty.message_count(), empty.span_ns(), empty.messages().count()), (0, None, 0));
    for path in [open.clone(), open.join("open_0.mcap")] {
        let error = reindex(&path).unwrap_err().to_string();
        assert!(error.contains("cannot finish: a recorder writes to it"), "{error}");
    }
    drop(writer);
    reindex(&open).unwrap();
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

/// Writes 100 poses, ten a second, from 5 s on. Returns the first x and the number of messages of each file.
fn write_split(folder: &Path, split: Split) -> Vec<(f64, usize)> {
    let options = WriterOptions { compression: Compression::None, split, ..WriterOptions::default() };
    let mut bag = BagWriter::create(folder, &options).unwrap();
    let poses = bag.add_topic_of::<PoseStamped>("/pose", Qos::BestEffort { depth: 1 }).unwrap();
    let late = bag.add_topic_of::<TwistStamped>("/twist", Qos::DEFAULT).unwrap();
    for i in 0..100_i64 {
        bag.write(poses, 5_000_000_000 + i * 100_000_000, 0, &pose(i as f64)).unwrap();
    }
    bag.write(late, 14_900_000_000, 0, &TwistStamped::default()).unwrap();
    let summary = bag.finish().unwrap();
    assert_eq!((summary.messages, summary.span_ns), (101, Some((5_000_000_000, 14_900_000_000))));
    assert_eq!(summary.topics, [("/pose".to_owned(), 100), ("/twist".to_owned(), 1)]);
    let whole = BagReader::open(folder).unwrap();
    let x: Vec<f64> =
        whole.messages_of(&["/pose"]).map(|m| m.unwrap().decode::<PoseStamped>().unwrap().pose.position.x).collect();
    assert_eq!(x, (0..100).map(f64::from).collect::<Vec<_>>());
    assert_eq!((whole.notes().len(), whole.topic("/twist").unwrap().messages), (0, 1));
    assert_eq!(std::fs::read_dir(folder).unwrap().count(), summary.files.len() + 1);
    let read = |name: &String| {
        let bag = BagReader::open(&folder.join(name)).unwrap();
        let first: PoseStamped = bag.messages_of(&["/pose"]).next().unwrap().unwrap().decode().unwrap();
        (first.pose.position.x, bag.topic("/pose").unwrap().messages as usize)
    };
    summary.files.iter().map(read).collect()
}

#[test]
fn a_bag_is_split_by_time_before_the_message_that_is_too_late() {
    let folder = tempfile::tempdir().unwrap();
    let split = Split { bytes: None, duration: Some(Duration::from_secs(3)) };
    let files = write_split(&folder.path().join("long"), split);
    // A file lasts until more than three seconds have passed since its first message, as in rosbag2.
    assert_eq!(files, [(0.0, 31), (31.0, 31), (62.0, 31), (93.0, 7)]);
    let text = std::fs::read_to_string(folder.path().join("long/metadata.yaml")).unwrap();
    let listed = "relative_file_paths:\n  - long_0.mcap\n  - long_1.mcap\n  - long_2.mcap\n  - long_3.mcap\n";
    assert!(text.contains(listed) && text.contains("message_count: 101"), "{text}");
    assert!(text.contains("nanoseconds_since_epoch: 8100000000"), "{text}");
}

#[test]
fn a_bag_is_split_by_size_when_a_file_has_reached_it() {
    let folder = tempfile::tempdir().unwrap();
    let split = Split { bytes: Some(4000), duration: None };
    let path = folder.path().join("large");
    let files = write_split(&path, split);
    assert!(files.len() >= 4, "{files:?}");
    assert_eq!(files.iter().map(|(_, n)| n).sum::<usize>(), 100);
    for i in 0..files.len() - 1 {
        let size = std::fs::metadata(path.join(format!("large_{i}.mcap"))).unwrap().len();
        // A file may exceed the limit by a chunk of a quarter of it, the definitions behind the first chunk, and the
        // summary and metadata at its end.
        assert!((4000..20_000).contains(&size) && files[i].1 < 40, "{size} bytes, {files:?}");
    }
    assert_eq!(write_split(&folder.path().join("whole"), Split::default()), [(0.0, 100)]);
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
fn a_part_of_a_split_recording_names_the_latched_topics_that_it_lacks() {
    let folder = tempfile::tempdir().unwrap();
    let (whole, part) = (folder.path().join("whole"), folder.path().join("part"));
    let split = Split { duration: Some(Duration::from_secs(1)), ..Split::default() };
    let mut bag = BagWriter::create(&whole, &WriterOptions { split, ..WriterOptions::default() }).unwrap();
    let latched = Qos::ReliableTransientLocal { depth: 1 };
    let [once, often] = ["/once", "/often"].map(|name| bag.add_topic_of::<PoseStamped>(name, latched).unwrap());
    let events = bag.add_topic_of::<EpisodeEvent>("/episode/event", latched).unwrap();
    bag.write(once, 0, 0, &pose(0.0)).unwrap();
    bag.write(events, 0, 0, &EpisodeEvent::default()).unwrap();
    for i in 0..30 {
        let time_ns = 100_000_000 * i;
        bag.write(often, time_ns, time_ns, &pose(1.0)).unwrap();
    }
    assert_eq!(bag.finish().unwrap().files.len(), 3);
    std::fs::create_dir(&part).unwrap();
    std::fs::copy(whole.join("whole_2.mcap"), part.join("whole_2.mcap")).unwrap();
    assert_eq!(latched_elsewhere(&BagReader::open(&whole).unwrap()), None);
    let told = latched_elsewhere(&BagReader::open(&part).unwrap()).unwrap();
    let lacking = "before number 2: no message of the latched topics /episode/event, /once; they come once";
    assert!(told.contains(lacking), "{told}");
    let model = Model::from_yaml(include_str!("../../../../launch_configs/models/soft_bar.yaml")).unwrap();
    let refused = |bag: &PathBuf| read_measured(std::slice::from_ref(bag), &[], &model).unwrap_err().to_string();
    assert!(refused(&part).contains(lacking) && refused(&part).contains("no complete episode"), "{}", refused(&part));
    assert!(!refused(&whole).contains("latched"), "{}", refused(&whole));
}

#[test]
fn errors_name_things_that_are_no_bags() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("thing");
    let error = |path: &Path| BagReader::open(path).unwrap_err().to_string();
    assert!(error(&path).contains("found nothing"), "{}", error(&path));
    assert!(error(folder.path()).contains("an empty folder"));
    std::fs::write(&path, b"").unwrap();
    assert!(error(&path).contains("an empty file"));
    std::fs::write(&path, b"hello").unwrap();
    assert!(error(&path).contains("a file of 5 bytes"));
    assert!(error(folder.path()).contains("a folder without .mcap or .db3 files that holds thing"));
    std::fs::write(&path, b"#ROSBAG V2.0\n").unwrap();
    assert!(error(&path).contains("bags of ROS 1 are not supported yet; `rosbags-convert`"), "{}", error(&path));
    std::fs::write(&path, b"SQLite format 3\0....").unwrap();
    assert!(error(&path).contains("file is not a database"), "{}", error(&path));
    std::fs::write(&path, [0x28, 0xb5, 0x2f, 0xfd, 0, 0]).unwrap();
    assert!(error(&path).contains("cannot unpack"), "{}", error(&path));
}
