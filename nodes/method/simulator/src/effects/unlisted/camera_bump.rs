//! A camera that is bumped.

use super::super::effect::{Hook, log_uniform};
use super::super::term_effect::TermEffect;
use super::about;
use crate::episode_model::ObservationTerm;
use std::sync::Arc;

/// Time of the bump in s since the start.
const AT_S: f64 = 2.2;
/// Way of the picture across and down, for a magnitude of 1.
const WAY: [f64; 2] = [1.0, 0.5];

/// Size of the jump in half images.
struct Jump(f64);

impl ObservationTerm for Jump {
    fn change(&self, time_s: f64, keypoints: &mut [[f64; 2]; 4]) {
        if time_s >= AT_S {
            keypoints.iter_mut().for_each(|p| *p = [0, 1].map(|i| p[i] + self.0 * WAY[i]));
        }
    }
}

/// Effect `camera_bump`: the picture jumps once, mid-way, and stays there.
pub fn effect() -> TermEffect {
    TermEffect::new(
        about("camera_bump", "bump of the camera", "1", Hook::Observation, log_uniform(1e-3, 0.3), 1.0),
        &[],
        |magnitude, episode| episode.camera.terms.push(Arc::new(Jump(magnitude))),
    )
}
