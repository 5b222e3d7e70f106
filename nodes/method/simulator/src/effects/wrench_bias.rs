//! Bias of the wrench's sensor along an axis.

use super::effect::{About, Effect, Hook, uniform};
use crate::episode_model::{EpisodeModel, NO_WRENCH};
use catenary_core::Model;

/// Effects `wrench_bias_x_n`, `wrench_bias_z_n` and `wrench_bias_y_n_m`: bias of the measured force along x and z, and of the torque about y.
pub(super) struct WrenchBias {
    /// Index of the axis in a frame's wrench.
    axis: usize,
}

impl WrenchBias {
    /// Returns the biases of all axes.
    pub(super) fn all() -> [Self; 3] {
        [0, 1, 2].map(|axis| Self { axis })
    }
}

impl Effect for WrenchBias {
    fn about(&self) -> About {
        let [name, title, description, unit] = [
            [
                "wrench_bias_x_n",
                "bias of the force along x",
                "measured less true force of the object on the hand along x",
                "N",
            ],
            [
                "wrench_bias_z_n",
                "bias of the force along z",
                "measured less true force of the object on the hand along z",
                "N",
            ],
            [
                "wrench_bias_y_n_m",
                "bias of the torque",
                "measured less true torque of the object on the hand about y",
                "N m",
            ],
        ][self.axis];
        // A bracket or a cable of 0.3 kg that the arm does not know of weighs 3 N; 0.3 N m is its torque at a hand's length.
        let (most, limit) = if self.axis < 2 { (3.0, 100.0) } else { (0.3, 30.0) };
        let (prior, range) = (uniform(-most, most), [-limit, limit]);
        About { name, title, description, unit, hook: Hook::Observation, prior, range }
    }

    fn apply(&self, magnitude: f64, episode: &mut EpisodeModel) -> Result<(), &'static str> {
        episode.wrench.as_mut().ok_or(NO_WRENCH)?.bias[self.axis] += magnitude;
        Ok(())
    }

    fn concerns(&self, model: &Model) -> bool {
        model.observation.wrench.is_some()
    }
}

#[cfg(test)]
mod tests {
    use super::super::fixtures;
    use super::WrenchBias;

    #[test]
    fn zero_is_the_base_to_the_bit_and_more_shifts_its_axis_alone() {
        for (axis, effect) in WrenchBias::all().into_iter().enumerate() {
            fixtures::zero_is_the_base_of_a_wrench(&effect);
            let shift = fixtures::wrench_changes(&effect, 0.2);
            for shift in shift {
                (0..3).for_each(|i| assert!((shift[i] - if i == axis { 0.2 } else { 0.0 }).abs() < 1e-12, "{shift:?}"));
            }
        }
    }
}
