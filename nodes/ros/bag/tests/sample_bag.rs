//! The sample bag in the repository equals the output of its example program, and contains a readable episode.
#![allow(clippy::disallowed_methods, clippy::unwrap_used, reason = "a test of files reads files")]

#[path = "../examples/make_sample_bag/swing.rs"]
mod swing;

use catenary_bag::{BagMessage, BagReader, EpisodeTopics, read_episodes, read_measured};
use catenary_core::Model;
use std::path::{Path, PathBuf};

fn sample() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../bags/swing")
}

fn messages(bag: &BagReader) -> Vec<BagMessage> {
    bag.messages().map(Result::unwrap).collect()
}

#[test]
fn the_committed_bag_equals_the_output_of_the_example() {
    let folder = tempfile::tempdir().unwrap();
    let fresh = folder.path().join("swing");
    swing::write_bag(&fresh).unwrap();
    let (fresh, committed) = (BagReader::open(&fresh).unwrap(), BagReader::open(&sample()).unwrap());
    assert_eq!(committed.notes(), [] as [String; 0]);
    assert_eq!(committed.topics(), fresh.topics());
    let (fresh, committed) = (messages(&fresh), messages(&committed));
    assert_eq!(committed.len(), fresh.len());
    assert!(committed == fresh, "the sample bag is stale: write it anew with the example make_sample_bag");
}

#[test]
fn episodes_are_chosen_by_bag_and_number() {
    let model = Model::from_yaml(include_str!("../../../../launch_configs/models/soft_bar.yaml")).unwrap();
    let read = |bags: usize, numbers: &[u32]| read_measured(&vec![sample(); bags], numbers, &model);
    let last = read(1, &[]).unwrap();
    assert_eq!((last.len(), &read(1, &[0]).unwrap(), &read(1, &[swing::EPISODE]).unwrap()), (1, &last, &last));
    let refusals: [(usize, &[u32], &str); 5] = [
        (0, &[], "bags: expected at least one bag, got none"),
        (2, &[], "each episode once"),
        (1, &[0, swing::EPISODE], "swing twice"),
        (2, &[0, 0, 0], "episodes: expected one for each bag, or none, got 3 episodes of 2 bags"),
        (1, &[99], "swing: episode 99: expected one of the complete episodes [7]"),
    ];
    for (bags, numbers, words) in refusals {
        let said = read(bags, numbers).unwrap_err().to_string();
        assert!(said.contains(words), "{bags}, {numbers:?}: {said}");
    }
}

#[test]
fn an_episode_comes_out_of_it() {
    let bag = BagReader::open(&sample()).unwrap();
    let log = read_episodes(&bag, &EpisodeTopics::default()).unwrap();
    let episode = log.episode(None).unwrap();
    assert_eq!((episode.number, episode.start_ns), (swing::EPISODE, swing::START_NS));
    assert_eq!((episode.start.policy.as_str(), episode.end.as_str()), ("to and fro", "step_limit"));
    assert_eq!(episode.duration_s, f64::from(swing::STEPS) * swing::STEP_PERIOD_S);
    assert_eq!((episode.actions.len(), episode.observations.len()), (8, 9));
    assert_eq!((episode.keypoints.len(), episode.poses.len()), (83, 206));
    let mut model = swing::model();
    model.observation.drive = catenary_core::model::DriveKind::Grip;
    let measured = episode.measured(&model).unwrap();
    assert!(measured.track.frames.len() >= 16, "{}", measured.track.frames.len());
    let target = model.task.unwrap().target_m;
    let seen = measured.target_m.unwrap();
    assert!((0..2).all(|i| (seen[i] - target[i]).abs() < 1e-9), "{seen:?} for {target:?}");
}

#[test]
fn it_is_tiny() {
    let size: u64 = std::fs::read_dir(sample()).unwrap().map(|e| e.unwrap().metadata().unwrap().len()).sum();
    // Everybody who clones the repository downloads it.
    assert!(size < 100_000, "{size} bytes");
}
