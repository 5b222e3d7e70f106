//! Recordings that pass through the same times twice: the records of two episodes are never taken for those of one.
#![allow(clippy::unwrap_used, reason = "a test of files reads files")]

use catenary_bag::{BagMessage, BagReader, BagWriter, WriterOptions, episode_notes, read_measured};
use catenary_core::Model;
use catenary_core::episode::MeasuredTrack;
use catenary_msgs::geometry_msgs::msg::PoseStamped;
use catenary_msgs::msg::{EpisodeEvent, Keypoints};
use catenary_shell::{Time, stamp};
use std::path::{Path, PathBuf};

/// Log time in ns between the two recordings: longer than the sample.
const APART_NS: i64 = 10_000_000_000;

/// Second recording of the joined ones: how its records differ from the first.
#[derive(Clone, Copy)]
struct Second {
    /// Number of its episode beyond that of the first.
    number: u32,
    /// Shift of its stamps.
    later_ns: i64,
    /// Shift of its keypoints in px.
    aside_px: f64,
}

/// Joins the sample bag with a copy of itself.
fn joined(folder: &Path, second: Second) -> PathBuf {
    let path = folder.join("joined");
    let mut bag = BagWriter::create(&path, &WriterOptions::default()).unwrap();
    let sample = BagReader::open(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../bags/swing")).unwrap();
    for (pass, changes) in [(0, Second { number: 0, later_ns: 0, aside_px: 0.0 }), (1, second)] {
        for message in sample.messages().map(Result::unwrap) {
            write(&mut bag, &message, pass * APART_NS, changes);
        }
    }
    bag.finish().unwrap();
    path
}

fn write(bag: &mut BagWriter, message: &BagMessage, log_later_ns: i64, changes: Second) {
    let (qos, log_ns) = (message.topic.qos[0], message.log_time_ns + log_later_ns);
    let name = &message.topic.name;
    let moved = |at| stamp::to_msg(Time::from_nanos(stamp::from_msg(&at).nanos() + changes.later_ns));
    match name.as_str() {
        "/panda/current_pose" => {
            let mut pose: PoseStamped = message.decode().unwrap();
            pose.header.stamp = moved(pose.header.stamp);
            let topic = bag.add_topic_of::<PoseStamped>(name, qos).unwrap();
            bag.write(topic, log_ns, log_ns, &pose).unwrap();
        }
        "/dlo/keypoints" => {
            let mut seen: Keypoints = message.decode().unwrap();
            seen.header.stamp = moved(seen.header.stamp);
            seen.dlo_u.iter_mut().for_each(|u| *u += changes.aside_px);
            let topic = bag.add_topic_of::<Keypoints>(name, qos).unwrap();
            bag.write(topic, log_ns, log_ns, &seen).unwrap();
        }
        "/episode/event" => {
            let mut event: EpisodeEvent = message.decode().unwrap();
            event.header.stamp = moved(event.header.stamp);
            event.episode += changes.number;
            let topic = bag.add_topic_of::<EpisodeEvent>(name, qos).unwrap();
            bag.write(topic, log_ns, log_ns, &event).unwrap();
        }
        _ => {}
    }
}

fn measured(bag: &Path, numbers: &[u32]) -> Result<MeasuredTrack, String> {
    let model = Model::from_yaml(include_str!("../../../../launch_configs/models/soft_bar.yaml")).unwrap();
    let mut all = read_measured(&[bag.to_owned()], numbers, &model).map_err(|e| e.to_string())?;
    Ok(all.remove(0))
}

/// Number of the sample's episode.
fn number() -> u32 {
    let sample = BagReader::open(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../bags/swing")).unwrap();
    sample.messages_of(&["/episode/event"]).next().unwrap().unwrap().decode::<EpisodeEvent>().unwrap().episode
}

#[test]
fn episodes_whose_stamps_begin_anew_are_refused_with_the_reason() {
    let first = number();
    // The stamps of the second recording are the same, lie between those of the first, or overlap them in half.
    for later_ns in [0, 1_000_000, 2_000_000_000] {
        for second in [0, 1] {
            let folder = tempfile::tempdir().unwrap();
            let bag = joined(folder.path(), Second { number: second, later_ns, aside_px: 3.0 });
            for asked in [&[][..], &[first], &[first + second]] {
                let e = measured(&bag, asked).unwrap_err();
                assert!(e.contains("header.stamp: expected that a recording passes through a time once"), "{e}");
                assert!(e.contains("put each episode into a bag of its own"), "{e}");
            }
            let notes = episode_notes(&bag_reader(&bag));
            assert!(notes.iter().any(|note| note.contains("in a second pass")), "{notes:?}");
        }
    }
}

fn bag_reader(path: &Path) -> BagReader {
    BagReader::open(path).unwrap()
}

#[test]
fn a_recorded_loop_and_recordings_apart_are_used() {
    let (first, folder) = (number(), tempfile::tempdir().unwrap());
    let alone = joined(folder.path(), Second { number: 1, later_ns: APART_NS, aside_px: 3.0 });
    let [one, two] = [first, first + 1].map(|number| measured(&alone, &[number]).unwrap());
    assert!(one.warnings.is_empty() && two.warnings.is_empty(), "{:?} {:?}", one.warnings, two.warnings);
    assert_ne!(one.track, two.track);
    let folder = tempfile::tempdir().unwrap();
    let looped = joined(folder.path(), Second { number: 0, later_ns: 0, aside_px: 0.0 });
    assert_eq!(measured(&looped, &[]).unwrap().track, one.track);
}
