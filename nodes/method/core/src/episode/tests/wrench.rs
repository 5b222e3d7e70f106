//! Wrenches of an episode at the times of its frames.

use super::*;
use crate::model::WrenchNoise;

fn observing() -> Model {
    let mut model = model();
    model.observation.wrench = Some(WrenchNoise { force_sd_n: [1.0, 0.1], torque_sd_n_m: 0.05 });
    model
}

/// Log with a wrench that grows by (1, 2) N and 0.5 N m a second from the start on, up to `until_s`.
fn with_wrench(until_s: f64) -> EpisodeLog {
    let mut log = log();
    let samples = (until_s / 0.005) as i64;
    for i in 0..samples {
        let s = 0.005 * i as f64;
        log.push_wrench(1_000_000_000 + 5_000_000 * i, [s, 2.0 * s, 0.5 * s]);
    }
    log
}

#[test]
fn frames_have_the_wrench_at_their_times_if_the_model_observes_it() {
    let episode = with_wrench(9.0).episode(None).unwrap();
    let measured = episode.measured(&observing()).unwrap();
    for frame in &measured.track.frames {
        let [x, z, y] = frame.wrench.unwrap();
        let t = frame.time_s;
        assert!((x - t).abs() < 1e-9 && (z - 2.0 * t).abs() < 1e-9 && (y - 0.5 * t).abs() < 1e-9, "{frame:?}");
    }
    // A model that observes the keypoints alone reads the same track from both recordings.
    assert_eq!(episode.measured(&model()).unwrap(), log().episode(None).unwrap().measured(&model()).unwrap());
}

#[test]
fn an_episode_without_the_wrench_has_its_keypoints_and_a_warning() {
    let measured = log().episode(None).unwrap().measured(&observing()).unwrap();
    assert!(measured.track.frames.iter().all(|frame| frame.wrench.is_none()));
    let told = measured.warnings.iter().find(|w| w.contains("external_wrench")).unwrap();
    assert!(told.contains("keypoints alone"), "{told}");
    let mut alone = observing();
    alone.observation.keypoints = false;
    let refused = log().episode(None).unwrap().measured(&alone).unwrap_err().to_string();
    assert!(refused.contains("a wrench on /panda/external_wrench"), "{refused}");
    assert!(with_wrench(9.0).episode(None).unwrap().measured(&alone).is_ok());
}

#[test]
fn a_stream_that_breaks_off_leaves_frames_without_it() {
    let missing = |until_s: f64| {
        let measured = with_wrench(until_s).episode(None).unwrap().measured(&observing()).unwrap();
        let none = measured.track.frames.iter().filter(|frame| frame.wrench.is_none()).count();
        (none, measured.warnings.iter().any(|w| w.contains("external_wrench")))
    };
    assert_eq!((missing(9.0), missing(6.01), missing(2.0)), ((0, false), (8, true), (33, true)));
}
