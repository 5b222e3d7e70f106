//! Messages whose log time is 0, 2^63 or 2^64 - 1, as recorders under load have written them (rosbag2 #2389): they are named,
//! and change neither the duration nor what is inferred.
#![allow(clippy::disallowed_methods, clippy::unwrap_used, reason = "a test of files reads files")]

use catenary_bag::{BagReader, episode_notes, read_measured, reindex};
use catenary_core::Model;
use std::collections::BTreeMap;
use std::io::Cursor;
use std::path::{Path, PathBuf};

fn sample() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../bags/swing/swing_0.mcap")
}

/// Time of the recording, ns: that of the sample is simulated and begins near 0, where 0 is not far.
const RECORDED_NS: u64 = 1_700_000_000_000_000_000;

fn model() -> Model {
    Model::from_yaml(include_str!("../../../../launch_configs/models/soft_bar.yaml")).unwrap()
}

/// Copy of the sample bag in chunks of `chunk_bytes` (0: without chunks). `time` gives the log time of each message from its
/// topic, its index among those of the topic, and its usual log time.
fn copy(path: &Path, chunk_bytes: u64, time: impl Fn(&str, usize, u64) -> u64) {
    let mut bytes = Cursor::new(Vec::new());
    let options = mcap::WriteOptions::new().use_chunks(chunk_bytes > 0).chunk_size(Some(chunk_bytes.max(1)));
    let mut writer = options.create(&mut bytes).unwrap();
    let mut counts: BTreeMap<String, usize> = BTreeMap::new();
    let file = std::fs::read(sample()).unwrap();
    for message in mcap::MessageStream::new(&file).unwrap() {
        let mut message = message.unwrap();
        let count = counts.entry(message.channel.topic.clone()).or_default();
        message.log_time = time(&message.channel.topic, *count, RECORDED_NS + message.log_time);
        *count += 1;
        writer.write(&message).unwrap();
    }
    writer.finish().unwrap();
    drop(writer);
    std::fs::write(path, bytes.into_inner()).unwrap();
}

fn rolled_over(topic: &str, index: usize, time: u64) -> u64 {
    match (topic, index) {
        ("/panda/current_pose", 50) => 0,
        ("/dlo/keypoints", 20) => 0,
        ("/dlo/keypoints", 30) => u64::MAX,
        ("/panda/current_pose", 120) => 1 << 63,
        _ => time,
    }
}

#[test]
fn far_log_times_are_named_and_change_neither_duration_nor_tracks() {
    let folder = tempfile::tempdir().unwrap();
    let (path, whole) = (folder.path().join("far.mcap"), folder.path().join("whole.mcap"));
    // One chunk for all, chunks of a few messages, and none.
    for chunk_bytes in [1 << 24, 600, 0] {
        copy(&path, chunk_bytes, rolled_over);
        copy(&whole, chunk_bytes, |_, _, time| time);
        let (bag, known) = (BagReader::open(&path).unwrap(), BagReader::open(&whole).unwrap());
        assert_eq!((bag.notes(), known.notes(), known.far_notes()), (&[][..], &[][..], &[][..]), "{chunk_bytes}");
        let [keypoints, poses] = bag.far_notes() else { panic!("{:?}", bag.far_notes()) };
        assert!(keypoints.contains("/dlo/keypoints: 2 messages are logged more than ten years away"), "{keypoints}");
        assert!(keypoints.contains("at 0 ns, 18446744073709551615 ns:"), "{keypoints}");
        assert!(
            poses.contains("/panda/current_pose: 2 messages") && poses.contains("9223372036854775808 ns"),
            "{poses}"
        );
        assert_eq!(bag.span_ns(), known.span_ns(), "{chunk_bytes}");
        assert_eq!((bag.message_count(), bag.verify()), (known.message_count(), known.verify()));
        assert!(bag.is_usual_time(bag.span_ns().unwrap().0) && !bag.is_usual_time(0) && !bag.is_usual_time(i64::MAX));
        assert_eq!(episode_notes(&bag), [] as [String; 0]);
        let tracks = [&path, &whole].map(|bag| read_measured(std::slice::from_ref(bag), &[], &model()).unwrap());
        assert_eq!(tracks[0], tracks[1], "{chunk_bytes}");
    }
}

#[test]
fn far_messages_stay_in_a_bag_that_is_reindexed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("far.mcap");
    copy(&path, 600, rolled_over);
    let (count, span) = {
        let bag = BagReader::open(&path).unwrap();
        (bag.message_count(), bag.span_ns())
    };
    let intact = std::fs::read(&path).unwrap();
    assert_eq!(reindex(&path).unwrap(), [] as [String; 0]);
    assert_eq!(std::fs::read(&path).unwrap(), intact, "a bag that misses nothing stays as it is");
    // Without its summary, the file counts as unfinished.
    std::fs::write(&path, &intact[..intact.len() - 300]).unwrap();
    assert!(!reindex(&path).unwrap().is_empty());
    let bag = BagReader::open(&path).unwrap();
    assert_eq!((bag.message_count(), bag.span_ns(), bag.far_notes().len()), (count, span, 2));
}

#[test]
fn a_message_at_zero_in_every_chunk_does_not_bring_the_whole_bag_into_memory_first() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("far.mcap");
    copy(&path, 600, |_, index, time| if index % 5 == 2 { 0 } else { time });
    let bag = BagReader::open(&path).unwrap();
    let times: Vec<i64> = bag.messages().map(|m| m.unwrap().log_time_ns).collect();
    assert_eq!(times.len() as u64, bag.message_count());
    // The far ones come with their neighbours, and not before all others.
    assert!(times[..20].iter().any(|t| *t > 0) && times[times.len() - 20..].contains(&0), "{times:?}");
    let usual: Vec<i64> = times.into_iter().filter(|t| *t > 0).collect();
    assert!(usual.is_sorted());
}

#[test]
fn times_after_the_year_2262_are_far_also_where_they_are_the_most() {
    let folder = tempfile::tempdir().unwrap();
    let (path, whole) = (folder.path().join("far.mcap"), folder.path().join("whole.mcap"));
    for chunk_bytes in [1 << 24, 600, 0] {
        copy(&path, chunk_bytes, |_, index, time| if index % 3 > 0 { u64::MAX - index as u64 } else { time });
        copy(&whole, chunk_bytes, |_, _, time| time);
        let (bag, known) = (BagReader::open(&path).unwrap(), BagReader::open(&whole).unwrap());
        let ((first, last), (begin, end)) = (bag.span_ns().unwrap(), known.span_ns().unwrap());
        assert!(begin <= first && last <= end && last - first > (end - begin) / 2, "{chunk_bytes}: {first} {last}");
        assert!(!bag.far_notes().is_empty());
    }
}
