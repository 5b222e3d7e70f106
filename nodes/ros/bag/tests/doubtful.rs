//! Recordings with bad data: each defect is named with topic, time, value and expectation, and nothing else is lost.
#![allow(clippy::disallowed_methods, clippy::unwrap_used, reason = "a test of files reads files")]

use catenary_bag::{
    BagMessage, BagReader, BagWriter, EpisodeTopics, WriterOptions, episode_notes, read_measured, visit_episodes,
};
use catenary_core::Model;
use catenary_core::episode::MeasuredTrack;
use catenary_msgs::geometry_msgs::msg::PoseStamped;
use catenary_msgs::msg::{EpisodeEvent, Keypoints};
use catenary_msgs::std_msgs::msg::Header;
use catenary_msgs::{Interface, from_cdr};
use catenary_shell::stamp;
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::path::Path;

const POSE: &str = "/panda/current_pose";
const KEYPOINTS: &str = "/dlo/keypoints";
const EVENT: &str = "/episode/event";

/// Message that a test may change before it is written. The number is its index among the messages of its topic.
enum Change<'a> {
    Pose(usize, &'a mut PoseStamped),
    Keypoints(usize, &'a mut Keypoints),
    Event(&'a mut EpisodeEvent),
}

impl Change<'_> {
    fn header(&mut self) -> &mut Header {
        match self {
            Change::Pose(_, m) => &mut m.header,
            Change::Keypoints(_, m) => &mut m.header,
            Change::Event(m) => &mut m.header,
        }
    }

    /// Shifts the stamp by `by_ns`.
    fn shift(&mut self, by_ns: i64) {
        let header = self.header();
        header.stamp = stamp::to_msg(catenary_shell::Time::from_nanos(stamp::from_msg(&header.stamp).nanos() + by_ns));
    }
}

fn sample() -> BagReader {
    BagReader::open(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../bags/swing")).unwrap()
}

fn model() -> Model {
    Model::from_yaml(include_str!("../../../../launch_configs/models/soft_bar.yaml")).unwrap()
}

fn decoded<T: Interface + DeserializeOwned>(message: &BagMessage) -> T {
    from_cdr(&message.data).unwrap()
}

/// Sample bag with changed messages. The caller must keep the folder.
fn changed(folder: &Path, mut change: impl FnMut(Change<'_>)) -> BagReader {
    let path = folder.join("bag");
    let mut bag = BagWriter::create(&path, &WriterOptions::default()).unwrap();
    let (mut poses, mut keypoints) = (0, 0);
    fn write<T: Interface + Serialize>(bag: &mut BagWriter, message: &BagMessage, changed: &T) {
        let topic = bag.add_topic_of::<T>(&message.topic.name, message.topic.qos[0]).unwrap();
        bag.write(topic, message.log_time_ns, message.publish_time_ns, changed).unwrap();
    }
    for message in sample().messages_of(&[POSE, KEYPOINTS, EVENT]).map(Result::unwrap) {
        match message.topic.name.as_str() {
            POSE => {
                let mut pose = decoded::<PoseStamped>(&message);
                change(Change::Pose(poses, &mut pose));
                poses += 1;
                write(&mut bag, &message, &pose);
            }
            KEYPOINTS => {
                let mut seen = decoded::<Keypoints>(&message);
                change(Change::Keypoints(keypoints, &mut seen));
                keypoints += 1;
                write(&mut bag, &message, &seen);
            }
            _ => {
                let mut event = decoded::<EpisodeEvent>(&message);
                change(Change::Event(&mut event));
                write(&mut bag, &message, &event);
            }
        }
    }
    bag.finish().unwrap();
    BagReader::open(&path).unwrap()
}

/// Result for the sample bag with changed messages: the track, and the notes of `catenary info`.
fn outcome(change: impl FnMut(Change<'_>)) -> (Result<MeasuredTrack, String>, Vec<String>) {
    let folder = tempfile::tempdir().unwrap();
    let bag = changed(folder.path(), change);
    let measured = read_measured(&[bag.path().to_owned()], &[], &model()).map(|mut all| all.remove(0));
    (measured.map_err(|e| e.to_string()), episode_notes(&bag))
}

fn whole() -> MeasuredTrack {
    let (measured, notes) = outcome(|_| ());
    assert_eq!(notes, [] as [String; 0], "the sample is in order");
    measured.unwrap()
}

#[test]
fn poses_that_are_impossible_or_no_numbers_are_left_out_with_topic_time_and_value() {
    let (measured, notes) = outcome(|change| {
        if let Change::Pose(70, pose) = change {
            pose.pose = Default::default();
            pose.pose.orientation.w = 1.0;
        }
    });
    let measured = measured.unwrap();
    assert_eq!(measured.track.frames.len(), whole().track.frames.len());
    let warning = measured.warnings.iter().find(|w| w.starts_with(POSE)).unwrap();
    assert!(warning.contains("1 of 206 poses left out") && warning.contains("position (0, 0, 0) m"), "{warning}");
    assert!(warning.contains("stamp ") && warning.contains("3.4 m/s"), "{warning}");
    assert!(notes.iter().any(|n| n.contains(warning.as_str())), "{notes:?}");
    let (measured, _) = outcome(|change| {
        if let Change::Pose(70 | 90, pose) = change {
            pose.pose.position.x = f64::NAN;
        }
    });
    let warnings = measured.unwrap().warnings;
    assert!(warnings[0].starts_with("/panda/current_pose: 2 messages left out, the first: stamp "), "{warnings:?}");
    assert!(warnings[0].contains("NaN") && warnings[0].contains("finite"), "{warnings:?}");
}

#[test]
fn streams_in_other_units_frames_and_planes_are_named_with_the_field() {
    let of = |each: fn(&mut PoseStamped)| {
        outcome(move |change| {
            if let Change::Pose(_, pose) = change {
                each(pose);
            }
        })
    };
    let (refused, notes) = of(|p| {
        p.pose.position.x *= 1e3;
        p.pose.position.z *= 1e3;
    });
    let e = refused.unwrap_err();
    assert!(e.contains("bag: episode 7: /panda/current_pose: pose.position: expected m") && e.contains("mm"), "{e}");
    assert!(notes[0].contains("as if in mm"), "{notes:?}");
    let (refused, _) = of(|p| p.pose.position.y = 0.5);
    assert!(refused.unwrap_err().contains("pose.position.y: expected 0 m"));
    let (measured, notes) = of(|p| p.header.frame_id = "world".into());
    let warnings = measured.unwrap().warnings;
    assert!(
        warnings[0].contains("header.frame_id: expected \"panda_link0\", got \"world\" in 206 poses"),
        "{warnings:?}"
    );
    assert!(notes[0] == warnings[0]);
}

#[test]
fn missing_stepping_and_differing_stamps_are_named() {
    let (refused, notes) = outcome(|mut change| change.header().stamp = Default::default());
    let e = refused.unwrap_err();
    assert!(e.contains("bag: 83 keypoints and 206 poses have the stamp 0"), "{e}");
    assert!(e.find("stamp 0").unwrap() < e.find("no complete episode").unwrap(), "the cause comes first: {e}");
    assert!(notes.len() == 1 && notes[0].contains("206 poses have the stamp 0"), "{notes:?}");
    // Within the episode the clock is set back by an hour or half a second, or ahead by ten minutes.
    for (by_ns, words) in
        [(-3_600_000_000_000_i64, "back by 3600"), (-500_000_000, "back by 0.5"), (600_000_000_000, "ahead by 600")]
    {
        let (mut poses, mut keypoints, mut events) = (0, 0, 0);
        let (outcome, notes) = outcome(|mut change| {
            let late = match &change {
                Change::Pose(n, _) => (poses = *n, *n > 100).1,
                Change::Keypoints(n, _) => (keypoints = *n, *n > 40).1,
                Change::Event(_) => (events += 1, events > 1).1,
            };
            if late {
                change.shift(by_ns);
            }
        });
        let said = outcome.map_or_else(|e| e, |m| m.warnings.join("; "));
        assert!(said.contains("header.stamp: expected a clock that runs on") && said.contains(words), "{said}");
        assert!(said.contains(POSE) && said.contains(KEYPOINTS), "{said}");
        assert!(notes.iter().any(|n| n.contains(words)), "{notes:?}");
        assert_eq!(by_ns < -1_000_000_000, said.contains("s before its start"), "{said}");
    }
    // The camera stamps with its own clock.
    for (by_ns, words) in [(-1_000_000_000_i64, "1.0"), (300_000_000, "0.3"), (86_400_000_000_000, "86400.")] {
        let (outcome, notes) = outcome(|mut change| {
            if let Change::Keypoints(..) = change {
                change.shift(by_ns);
            }
        });
        let said = outcome.map_or_else(|e| e, |m| m.warnings.join("; "));
        assert!(said.contains("/dlo/keypoints: header.stamp: expected the clock of /panda/current_pose"), "{said}");
        assert!(said.contains(&format!("got stamps {words}")), "{said}");
        assert!(notes.iter().any(|n| n.contains("two clocks that differ")), "{notes:?}");
    }
}

#[test]
fn latched_events_of_an_earlier_episode_are_no_clock_that_was_set() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bag");
    let mut bag = BagWriter::create(&path, &WriterOptions::default()).unwrap();
    let messages: Vec<BagMessage> = sample().messages_of(&[POSE, KEYPOINTS, EVENT]).map(Result::unwrap).collect();
    let logged_ns = messages[0].log_time_ns;
    // A recorder that starts an hour after an episode receives its latched events first.
    for message in messages.iter().filter(|m| m.topic.name == EVENT) {
        let mut event = decoded::<EpisodeEvent>(message);
        Change::Event(&mut event).shift(-3_600_000_000_000);
        event.episode -= 1;
        let topic = bag.add_topic_of::<EpisodeEvent>(EVENT, message.topic.qos[0]).unwrap();
        bag.write(topic, logged_ns, logged_ns, &event).unwrap();
    }
    for message in &messages {
        match message.topic.name.as_str() {
            POSE => copy::<PoseStamped>(&mut bag, message),
            KEYPOINTS => copy::<Keypoints>(&mut bag, message),
            _ => copy::<EpisodeEvent>(&mut bag, message),
        }
    }
    bag.finish().unwrap();
    assert_eq!(episode_notes(&BagReader::open(&path).unwrap()), [] as [String; 0]);
    let measured = read_measured(&[path], &[], &model()).unwrap().remove(0);
    assert_eq!(measured, whole());
}

/// Copies a message into a bag as it is.
fn copy<T: Interface + Serialize + DeserializeOwned>(bag: &mut BagWriter, message: &BagMessage) {
    let topic = bag.add_topic_of::<T>(&message.topic.name, message.topic.qos[0]).unwrap();
    bag.write(topic, message.log_time_ns, message.publish_time_ns, &decoded::<T>(message)).unwrap();
}

/// Copy of the sample bag behind the 16 newest latched events of earlier episodes, which a late recorder receives at once. `own`
/// chooses the sample's own events.
fn after_earlier_episodes(folder: &Path, restarted: bool, own: impl Fn(&EpisodeEvent) -> bool) -> BagReader {
    let path = folder.join("late");
    let mut bag = BagWriter::create(&path, &WriterOptions::default()).unwrap();
    let messages: Vec<BagMessage> = sample().messages_of(&[POSE, KEYPOINTS, EVENT]).map(Result::unwrap).collect();
    let logged_ns = messages[0].log_time_ns;
    let events: Vec<&BagMessage> = messages.iter().filter(|m| m.topic.name == EVENT).collect();
    let topic = bag.add_topic_of::<EpisodeEvent>(EVENT, events[0].topic.qos[0]).unwrap();
    // Nine episodes; the start of the oldest one was pushed out, and the last one was left open by a node that died.
    for i in 0..17_u32 {
        let mut event = decoded::<EpisodeEvent>(events[usize::from(i % 2 == 0)]);
        Change::Event(&mut event).shift((i64::from(i.div_ceil(2)) - 20) * 60_000_000_000);
        // A node that was started anew counts from the sample's own number on.
        event.episode = if restarted { 7 } else { 0 } + i.div_ceil(2);
        bag.write(topic, logged_ns + i64::from(i), logged_ns + i64::from(i), &event).unwrap();
    }
    for message in &messages {
        match message.topic.name.as_str() {
            POSE => copy::<PoseStamped>(&mut bag, message),
            KEYPOINTS => copy::<Keypoints>(&mut bag, message),
            _ if own(&decoded(message)) => copy::<EpisodeEvent>(&mut bag, message),
            _ => {}
        }
    }
    bag.finish().unwrap();
    BagReader::open(&path).unwrap()
}

#[test]
fn latched_events_of_many_earlier_episodes_are_passed_over() {
    for restarted in [false, true] {
        let folder = tempfile::tempdir().unwrap();
        let bag = after_earlier_episodes(folder.path(), restarted, |_| true);
        assert_eq!(episode_notes(&bag), [] as [String; 0]);
        let measured = read_measured(&[bag.path().to_owned()], &[], &model()).unwrap().remove(0);
        assert_eq!(measured, whole());
        let mut visited = Vec::new();
        visit_episodes(&bag, &EpisodeTopics::default(), |episode| visited.push(episode)).unwrap();
        assert_eq!(visited.iter().map(|e| (e.number, e.notes.len())).collect::<Vec<_>>(), [(7, 0)]);
    }
}

#[test]
fn an_open_episode_behind_latched_events_is_named_and_not_a_clock() {
    for restarted in [false, true] {
        let folder = tempfile::tempdir().unwrap();
        let bag = after_earlier_episodes(folder.path(), restarted, |event| event.event == EpisodeEvent::STARTED);
        let error = read_measured(&[bag.path().to_owned()], &[], &model()).unwrap_err().to_string();
        assert!(error.contains("episode 7 has no end: the recording, or the node") || restarted, "{error}");
        assert!(error.contains("the latched events of 8 episodes before the recording"), "{error}");
        assert!(!error.contains("clock"), "{error}");
    }
}

#[test]
fn an_episode_that_ended_with_a_fault_is_refused_unless_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let bag = changed(folder.path(), |change| {
        if let Change::Event(event) = change
            && event.event == EpisodeEvent::ENDED
        {
            event.reason = "fault: cartesian_reflex".into();
        }
    });
    let read = |numbers: &[u32]| read_measured(&[bag.path().to_owned()], numbers, &model());
    let e = read(&[]).unwrap_err().to_string();
    assert!(e.contains("bag: /episode/event: episode 7 ended with \"fault: cartesian_reflex\""), "{e}");
    let asked = read(&[7]).unwrap().remove(0);
    assert!(asked.warnings[0].contains("cartesian_reflex"), "{:?}", asked.warnings);
    assert!(episode_notes(&bag)[0].contains("cartesian_reflex"), "{:?}", episode_notes(&bag));
}
