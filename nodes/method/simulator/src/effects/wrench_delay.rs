//! Delay of the wrench.

use super::effect::{About, Effect, Hook, log_uniform};
use crate::episode_model::{EpisodeModel, NO_WRENCH};
use catenary_core::Model;

/// Effect `wrench_delay_s`: delay of the wrench behind the poses and the frames.
pub(super) struct WrenchDelay;

impl Effect for WrenchDelay {
    fn about(&self) -> About {
        About {
            name: "wrench_delay_s",
            title: "delay of the wrench",
            description: "age of a wrench at its stamp, by the filter of its estimate or by its way to the recorder",
            unit: "s",
            hook: Hook::Observation,
            // Low-pass filters of estimated wrenches begin at some milliseconds; 0.1 s are three frames of a camera at 30 Hz.
            prior: log_uniform(3e-3, 0.1),
            range: [0.0, 1.0],
        }
    }

    fn apply(&self, magnitude: f64, episode: &mut EpisodeModel) -> Result<(), &'static str> {
        episode.wrench.as_mut().ok_or(NO_WRENCH)?.delay_s += magnitude;
        Ok(())
    }

    fn concerns(&self, model: &Model) -> bool {
        model.observation.wrench.is_some()
    }
}

#[cfg(test)]
mod tests {
    use super::super::fixtures;
    use super::WrenchDelay;

    #[test]
    fn zero_is_the_base_to_the_bit() {
        fixtures::zero_is_the_base_of_a_wrench(&WrenchDelay);
    }

    /// Frames are 0.1 s apart, so that a delay of 0.1 s shows the wrench of the frame before.
    #[test]
    fn a_wrench_is_that_of_an_earlier_time() {
        let wrenches = |m: f64| fixtures::wrenches(&[("wrench_delay_s", m)]);
        let (now, late) = (wrenches(0.0), wrenches(0.1));
        for (now, late) in now.iter().zip(&late[1..]) {
            (0..3).for_each(|i| assert!((now[i] - late[i]).abs() < 1e-9, "{now:?} {late:?}"));
        }
    }
}
