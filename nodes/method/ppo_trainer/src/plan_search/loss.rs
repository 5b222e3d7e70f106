//! Loss of an episode.

use catenary_core::task::Goal;
use catenary_core::track::End;
use catenary_core::{Judge, Track};

/// Loss of an episode that leaves the workspace: more than any distance, m.
const LEFT: f64 = 10.0;

/// Loss of an episode: smaller is better. Unlike the reward it has a slope far from the goal, too.
pub fn loss(judge: &Judge, track: &Track) -> f64 {
    let score = judge.score(track);
    let left = if track.end == End::LeftWorkspace { LEFT } else { 0.0 };
    left + match judge.task().goal {
        Goal::Reach => -score.rewards.iter().sum::<f64>() / judge.task().steps as f64,
        _ => score.distance_m,
    }
}
