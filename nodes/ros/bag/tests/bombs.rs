//! Files of a few kilobytes that unpack to gigabytes: one line with file, size and limit, and little memory. Recordings of any
//! length: memory that does not grow with them. Alone in its process: tests beside it would be measured, too.
#![allow(clippy::disallowed_methods, clippy::unwrap_used, reason = "a test reads /proc, and a failure is a panic")]

use catenary_bag::{BagReader, BagWriter, Compression, WriterOptions, episode_notes, read_measured, reindex};
use catenary_core::Model;
use catenary_msgs::geometry_msgs::msg::PoseStamped;
use catenary_msgs::msg::{EpisodeEvent, Keypoints};
use catenary_shell::{Qos, Time, stamp};
use std::collections::BTreeMap;
use std::io::Cursor;
use std::path::Path;

/// Greatest resident memory of this process since the last call, kB.
fn peak_kb() -> usize {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find(|line| line.starts_with("VmHWM:")).unwrap();
    let peak = line.split_whitespace().nth(1).unwrap().parse().unwrap();
    std::fs::write("/proc/self/clear_refs", "5").unwrap();
    peak
}

/// zstd frame of `size` zeros in blocks of one repeated byte: 4 bytes for 128 KiB.
fn zeros(size: u64, is_size_stated: bool) -> Vec<u8> {
    const BLOCK: u64 = 128 << 10;
    let mut frame = vec![0x28, 0xb5, 0x2f, 0xfd];
    // Descriptor of the frame, and a window of 128 KiB (2^(10 + 7)).
    frame.extend([if is_size_stated { 0b1100_0000 } else { 0 }, 7 << 3]);
    if is_size_stated {
        frame.extend(size.to_le_bytes());
    }
    let count = size.div_ceil(BLOCK);
    for i in 0..count {
        let (is_last, len) = (i + 1 == count, BLOCK.min(size - i * BLOCK));
        let head = u32::try_from(len << 3 | 1 << 1 | u64::from(is_last)).unwrap();
        frame.extend(&head.to_le_bytes()[..3]);
        frame.push(0);
    }
    frame
}

/// Bag of poses at 1 kHz for `seconds`, with an episode of three seconds in each minute.
fn long_bag(path: &Path, seconds: i64) {
    let options = WriterOptions { compression: Compression::Lz4, ..WriterOptions::default() };
    let mut bag = BagWriter::create(path, &options).unwrap();
    let poses = bag.add_topic_of::<PoseStamped>("/panda/current_pose", Qos::DEFAULT).unwrap();
    let keypoints = bag.add_topic_of::<Keypoints>("/dlo/keypoints", Qos::DEFAULT).unwrap();
    let events = bag.add_topic_of::<EpisodeEvent>("/episode/event", Qos::DEFAULT).unwrap();
    for i in 0..1000 * seconds {
        let at_ns = 1_700_000_000_000_000_000 + 1_000_000 * i;
        let header = stamp::header(Time::from_nanos(at_ns), "panda_link0");
        let mut pose = PoseStamped { header: header.clone(), ..PoseStamped::default() };
        (pose.pose.position.x, pose.pose.position.z) = (0.4 + 0.01 * (0.01 * i as f64).sin(), 0.5);
        pose.pose.orientation.x = 1.0;
        bag.write(poses, at_ns, at_ns, &pose).unwrap();
        if i % 33 == 0 {
            let seen = Keypoints {
                header: header.clone(),
                image_width: 256,
                image_height: 256,
                dlo_u: [100.0, 105.0, 110.0, 115.0],
                dlo_v: [100.0, 120.0, 140.0, 160.0],
                dlo_scores: [1.0; 4],
                ..Keypoints::default()
            };
            bag.write(keypoints, at_ns, at_ns, &seen).unwrap();
        }
        let number = u32::try_from(i / 60_000).unwrap();
        let mut event = EpisodeEvent { header, episode: number, step_period: 0.5, ..EpisodeEvent::default() };
        match i % 60_000 {
            2000 => bag.write(events, at_ns, at_ns, &event).unwrap(),
            5000 => {
                (event.event, event.reason) = (EpisodeEvent::ENDED, "step_limit".to_owned());
                bag.write(events, at_ns, at_ns, &event).unwrap();
            }
            _ => {}
        }
    }
    bag.finish().unwrap();
}

/// Bag with chunks or without of messages of the topic /a.
fn bag_of(chunked: bool, messages: impl Iterator<Item = Vec<u8>>) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    let options = mcap::WriteOptions::new().use_chunks(chunked).compression(None).chunk_size(Some(1 << 26));
    let mut writer = options.create(&mut bytes).unwrap();
    let schema = writer.add_schema("std_msgs/msg/String", "ros2msg", b"string data").unwrap();
    let channel = writer.add_channel(schema, "/a", "cdr", &BTreeMap::new()).unwrap();
    for (i, data) in (0_u32..).zip(messages) {
        let time = 1_700_000_000_000_000_000 + u64::from(i);
        let header =
            mcap::records::MessageHeader { channel_id: channel, sequence: i, log_time: time, publish_time: time };
        writer.write_to_known_channel(&header, &data).unwrap();
    }
    writer.finish().unwrap();
    drop(writer);
    bytes.into_inner()
}

#[test]
fn memory_and_disk_stay_small() {
    let folder = tempfile::tempdir().unwrap();
    let place = |name: &str| folder.path().join(name);
    assert_eq!(zstd_len(&zeros(300_000, false)), 300_000, "the frames of this test are what they say");

    // A file that states its size is refused before a byte is written.
    let bomb = place("file.mcap.zstd");
    std::fs::write(&bomb, zeros(8 << 30, true)).unwrap();
    let error = BagReader::open(&bomb).unwrap_err().to_string();
    assert!(error.contains("file.mcap.zstd: expected at most 2147483648 bytes after decompression"), "{error}");
    assert!(error.contains("got 8589934592") && !error.contains('\n'), "{error}");

    // 300 messages of 250 MiB in one chunk, or in none: one at a time is decompressed.
    let message = zeros(250 << 20, true);
    for chunked in [true, false] {
        std::fs::write(place("messages.mcap"), bag_of(chunked, std::iter::repeat_n(message.clone(), 300))).unwrap();
        let bag = BagReader::open(&place("messages.mcap")).unwrap();
        let _before = peak_kb();
        assert_eq!(bag.messages().take(8).map(|m| m.unwrap().data.len()).sum::<usize>(), 8 * (250 << 20));
        let peak = peak_kb();
        assert!(peak < 700_000, "{peak} kB, chunked: {chunked}");
    }

    // A chunk that unpacks to more than its header says, or says that it is larger than any.
    let plain = bag_of(true, std::iter::repeat_n(vec![0; 100], 3));
    for (says, holds) in [(1000_u64, 4 << 30), (4 << 30, 4 << 30), (1 << 28, 4 << 30)] {
        std::fs::write(place("chunk.mcap"), with_chunk(&plain, says, &zeros(holds, true))).unwrap();
        let _before = peak_kb();
        let bag = BagReader::open(&place("chunk.mcap")).unwrap();
        assert_eq!((bag.message_count(), bag.messages().filter(Result::is_ok).count()), (0, 0));
        assert!(bag.notes().iter().any(|note| note.contains("damaged at byte")), "{:?}", bag.notes());
        let peak = peak_kb();
        assert!(peak < 1_500_000, "{peak} kB for a chunk that says {says}");
    }

    // Four times the length takes no more memory, in all that reads a bag.
    let peaks = [60, 240].map(|seconds| {
        let path = place(&format!("long_{seconds}"));
        long_bag(&path, seconds);
        let model = Model::from_yaml(include_str!("../../../../launch_configs/models/soft_bar.yaml")).unwrap();
        let _before = peak_kb();
        let bag = BagReader::open(&path).unwrap();
        assert_eq!(bag.verify().readable, bag.message_count());
        assert_eq!(episode_notes(&bag), [] as [String; 0]);
        // The still object tells nothing; its records are read all the same.
        if let Err(error) = read_measured(std::slice::from_ref(&path), &[], &model) {
            assert!(error.to_string().contains("episode"), "{error}");
        }
        drop(bag);
        let file = path.join(format!("long_{seconds}_0.mcap"));
        let bytes = std::fs::read(&file).unwrap();
        std::fs::write(&file, &bytes[..bytes.len() - 1000]).unwrap();
        drop(bytes);
        let _before = peak_kb();
        reindex(&path).unwrap();
        peak_kb()
    });
    assert!(peaks[1] < peaks[0] + 12_000, "{peaks:?} kB");
}

fn zstd_len(frame: &[u8]) -> usize {
    zstd::decode_all(frame).unwrap().len()
}

/// The file with its chunk replaced by one that says a size, and without what follows it.
fn with_chunk(file: &[u8], says: u64, data: &[u8]) -> Vec<u8> {
    let mut offset = 8;
    while file[offset] != mcap::records::op::CHUNK {
        offset += 9 + usize::try_from(u64::from_le_bytes(file[offset + 1..offset + 9].try_into().unwrap())).unwrap();
    }
    let text = [&4_u32.to_le_bytes()[..], b"zstd"].concat();
    let sizes = [&says.to_le_bytes()[..], &0_u32.to_le_bytes(), &text, &(data.len() as u64).to_le_bytes()].concat();
    let body = [&[0; 16][..], &sizes, data].concat();
    [&file[..offset], &[mcap::records::op::CHUNK], &(body.len() as u64).to_le_bytes(), &body].concat()
}
