//! No measurement is lost: a file that was truncated anywhere gives every complete chunk, and damage is an error, never
//! a panic. A failure here would lose the data of a recorder that is killed in the middle of an episode.
#![allow(clippy::disallowed_methods, clippy::unwrap_used, reason = "a test of files reads files")]

use catenary_bag::{BagReader, BagWriter, Compression, Verified, WriterOptions, reindex};
use catenary_msgs::Interface;
use catenary_msgs::geometry_msgs::msg::PoseStamped;
use catenary_shell::Qos;
use proptest::prelude::*;
use std::path::Path;
use std::sync::OnceLock;

/// Bytes of a bag's file, and for each complete chunk its end and the number of messages up to it.
type Bag = (Vec<u8>, Vec<(usize, usize)>);

fn bag(compression: Compression) -> &'static Bag {
    static BAGS: [OnceLock<Bag>; 3] = [OnceLock::new(), OnceLock::new(), OnceLock::new()];
    let place = Compression::ALL.iter().position(|c| *c == compression).unwrap();
    BAGS[place].get_or_init(|| write(compression))
}

fn write(compression: Compression) -> Bag {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bag");
    let file = path.join("bag_0.mcap");
    let options = WriterOptions { compression, ..WriterOptions::default() };
    let mut bag = BagWriter::create(&path, &options).unwrap();
    let topic = bag.add_topic_of::<PoseStamped>("/pose", Qos::DEFAULT).unwrap();
    let size = || std::fs::metadata(&file).unwrap().len() as usize;
    let mut ends = vec![(size(), 0)];
    for i in 0..60_usize {
        let mut pose = PoseStamped::default();
        pose.pose.position.x = i as f64;
        bag.write(topic, i as i64 + 1, 0, &pose).unwrap();
        // Chunks of six messages, so a test knows the number of messages before each cut.
        if i % 6 == 5 {
            bag.flush().unwrap();
            ends.push((size(), i + 1));
        }
    }
    bag.finish().unwrap();
    (std::fs::read(file).unwrap(), ends)
}

/// Opens `bytes` as a file and reads every readable message: positions x, number of errors, and notes.
fn read(path: &Path, bytes: &[u8]) -> Option<(Vec<f64>, usize, Vec<String>)> {
    std::fs::write(path, bytes).unwrap();
    let bag = BagReader::open(path).ok()?;
    let (good, bad): (Vec<_>, Vec<_>) = bag.messages().partition(Result::is_ok);
    let x = good.into_iter().filter_map(|m| m.unwrap().decode::<PoseStamped>().ok()).map(|p| p.pose.position.x);
    Some((x.collect(), bad.len(), bag.notes().to_vec()))
}

#[test]
fn every_complete_chunk_of_a_file_cut_off_anywhere_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cut.mcap");
    for compression in Compression::ALL {
        let (bytes, ends) = bag(compression);
        let near_ends = ends.iter().flat_map(|(end, _)| end - 3..end + 4);
        // Every 7th byte takes seconds, and the bytes around each chunk's end are the critical ones.
        for cut in (8..bytes.len()).step_by(7).chain(near_ends) {
            // A chunk is readable from its own end on; `ends` holds the ends of its message index.
            let whole = ends.iter().filter(|(end, _)| *end <= cut).map(|(_, n)| *n).next_back().unwrap_or(0);
            let (x, errors, notes) = read(&path, &bytes[..cut]).unwrap();
            assert!(x.len() == whole || x.len() == whole + 6, "{} of {whole} at {cut}", x.len());
            assert!(x.iter().enumerate().all(|(i, x)| *x == i as f64), "{x:?}");
            assert_eq!(errors, 0, "at {cut}");
            assert!(notes[0].contains("summary"), "{notes:?}");
            assert!(notes[0].contains(&format!("{} messages", x.len())), "{notes:?}");
        }
        let (x, errors, notes) = read(&path, bytes).unwrap();
        assert_eq!((x.len(), errors, notes.len()), (60, 0, 0));
    }
}

#[test]
fn a_file_cut_off_anywhere_is_finished_without_a_loss() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cut.mcap");
    for compression in Compression::ALL {
        let (bytes, ends) = bag(compression);
        // Each cut syncs a file to the disk, hence the long step.
        for cut in (8..bytes.len() - 1).step_by(301).chain(ends.iter().map(|(end, _)| *end)) {
            let before = read(&path, &bytes[..cut]).unwrap();
            let notes = reindex(&path).unwrap();
            assert_eq!(notes, before.2, "at {cut}");
            let bag = BagReader::open(&path).unwrap();
            assert_eq!((bag.notes(), bag.message_count()), (&[] as &[String], before.0.len() as u64), "at {cut}");
            let after = read(&path, &std::fs::read(&path).unwrap()).unwrap();
            assert_eq!((after.0, after.1), (before.0, 0), "at {cut}");
            assert_eq!(reindex(&path).unwrap(), [] as [String; 0]);
        }
    }
}

#[test]
fn one_damaged_chunk_costs_its_own_messages_alone() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("damaged.mcap");
    for compression in Compression::ALL {
        let (whole, ends) = bag(compression);
        let mut bytes = whole.clone();
        // A byte in the middle of the third chunk's messages.
        bytes[ends[2].0 + 120] ^= 0x55;
        let (x, errors, notes) = read(&path, &bytes).unwrap();
        assert_eq!((x.len(), errors, notes.len()), (54, 1, 0), "{compression:?}");
        let Verified { readable, damaged, damage } = BagReader::open(&path).unwrap().verify();
        assert_eq!((readable, damaged, damage.len()), (54, 1, 1), "{damage:?}");
        assert!(damage[0].contains("damaged.mcap: damaged at byte"), "{damage:?}");
        assert_eq!((x[11], x[12]), (11.0, 18.0));
        let (x, errors, notes) = read(&path, &bytes[..ends[9].0]).unwrap();
        assert_eq!((x.len(), errors), (48, 0), "{compression:?}");
        assert!(notes.iter().any(|n| n.contains("damaged at byte")), "{notes:?}");
    }
}

#[test]
fn a_damaged_first_chunk_costs_no_other_chunk_its_channels() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("damaged.mcap");
    for compression in Compression::ALL {
        let (whole, ends) = bag(compression);
        let mut bytes = whole[..ends[9].0].to_vec();
        bytes[ends[0].0 + 120] ^= 0x55;
        let (x, errors, notes) = read(&path, &bytes).unwrap();
        assert_eq!((x.len(), x[0], errors), (48, 6.0, 0), "{compression:?}: {notes:?}");
        reindex(&path).unwrap();
        let bag = BagReader::open(&path).unwrap();
        assert_eq!((bag.notes(), bag.message_count()), (&[] as &[String], 48));
    }
}

/// File of another writer that defines channels inside chunks alone: channel 1 in the first chunk, channel 2 in the
/// second.
fn foreign() -> (Vec<u8>, usize) {
    let mut bytes = std::io::Cursor::new(Vec::new());
    let mut writer = mcap::WriteOptions::new().chunk_size(None).compression(None).create(&mut bytes).unwrap();
    let cdr = catenary_msgs::to_cdr(&PoseStamped::default()).unwrap();
    let write = |writer: &mut mcap::Writer<_>, channel_id: u16, log_time: u64| {
        let header = mcap::records::MessageHeader { channel_id, sequence: 0, log_time, publish_time: 0 };
        writer.write_to_known_channel(&header, &cdr).unwrap();
    };
    let kind = "geometry_msgs/msg/PoseStamped";
    let schema = writer.add_schema(kind, "ros2msg", PoseStamped::DEFINITION.as_bytes()).unwrap();
    let none = std::collections::BTreeMap::new();
    let one = writer.add_channel(schema, "/one", "cdr", &none).unwrap();
    (1..=5).for_each(|i| write(&mut writer, one, i));
    writer.flush().unwrap();
    let two = writer.add_channel(schema, "/two", "cdr", &none).unwrap();
    (6..=9).for_each(|i| write(&mut writer, [one, two][i as usize % 2], i));
    writer.flush().unwrap();
    let len = writer.into_inner().position() as usize;
    (bytes.into_inner(), len)
}

#[test]
fn messages_of_channels_that_nothing_defines_are_left_out_and_counted() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("foreign.mcap");
    let (mut bytes, len) = foreign();
    bytes.truncate(len);
    let (x, errors, notes) = read(&path, &bytes).unwrap();
    assert_eq!((x.len(), errors, notes.len()), (9, 0, 1), "{notes:?}");
    // Byte 200 lies in the first chunk, whose channel the second chunk uses, too.
    bytes[200] ^= 0x55;
    let (_, errors, notes) = read(&path, &bytes).unwrap();
    let bag = BagReader::open(&path).unwrap();
    let left = (bag.message_count(), bag.messages().filter(|m| m.is_ok()).count(), errors);
    assert_eq!(left, (2, 2, 0), "{notes:?}");
    assert!(notes.iter().any(|n| n.contains("2 messages are left out")), "{notes:?}");
    reindex(&path).unwrap();
    let bag = BagReader::open(&path).unwrap();
    assert_eq!((bag.notes(), bag.message_count()), (&[] as &[String], 2));
}

/// Bytes of the bag with some bytes behind its magic replaced.
fn spoilt(compression: Compression, hits: Vec<(prop::sample::Index, u8)>) -> Vec<u8> {
    let mut bytes = bag(compression).0.clone();
    for (place, value) in hits {
        let place = place.index(bytes.len() - 8) + 8;
        bytes[place] = value;
    }
    bytes
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 500, ..ProptestConfig::default() })]

    #[test]
    fn damage_never_panics(
        compression in prop::sample::select(&Compression::ALL[..]),
        hits in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..12),
        cut in any::<prop::sample::Index>(),
    ) {
        let bytes = spoilt(compression, hits);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("bag.mcap");
        let _whole = read(&path, &bytes);
        let _cut = read(&path, &bytes[..cut.index(bytes.len())]);
    }

    #[test]
    fn garbage_never_panics(garbage in prop::collection::vec(any::<u8>(), 0..400), magic in any::<bool>()) {
        let folder = tempfile::tempdir().unwrap();
        let start: &[u8] = if magic { mcap_magic() } else { b"" };
        let _read = read(&folder.path().join("bag.mcap"), &[start, &garbage].concat());
    }
}

proptest! {
    // Few cases, because each of them syncs a file to the disk.
    #![proptest_config(ProptestConfig { cases: 50, ..ProptestConfig::default() })]

    #[test]
    fn a_damaged_file_that_was_cut_off_loses_nothing_by_being_finished(
        compression in prop::sample::select(&Compression::ALL[..]),
        hits in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
        cut in any::<prop::sample::Index>(),
    ) {
        let bytes = spoilt(compression, hits);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("bag.mcap");
        let before = read(&path, &bytes[..cut.index(bytes.len())]);
        if let (Some((x, _, _)), Ok(_)) = (before, reindex(&path)) {
            let finished = std::fs::read(&path).unwrap();
            prop_assert_eq!(read(&path, &finished).unwrap().0, x);
        }
    }
}

fn mcap_magic() -> &'static [u8] {
    b"\x89MCAP0\r\n"
}
