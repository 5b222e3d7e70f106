//! The other anchor of deltas.

use super::effect::{About, Effect, Hook, uniform};
use crate::episode_model::EpisodeModel;

/// Effect `delta_anchor_change`: the other anchor of deltas.
pub(super) struct DeltaAnchorChange;

impl Effect for DeltaAnchorChange {
    fn about(&self) -> About {
        About {
            name: "delta_anchor_change",
            title: "delta anchor",
            description: "share of the anchor other than the task's: measured pose if the task has last target, and the reverse",
            unit: "1",
            hook: Hook::Actuation,
            // A share: every mixture of the two anchors is as likely.
            prior: uniform(0.0, 1.0),
            range: [0.0, 1.0],
        }
    }

    fn apply(&self, magnitude: f64, episode: &mut EpisodeModel) -> Result<(), &'static str> {
        episode.arm.other_anchor_share += magnitude;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::fixtures;
    use super::DeltaAnchorChange;
    use crate::arm::ArmModel;

    #[test]
    fn zero_is_the_base_to_the_bit() {
        fixtures::zero_is_the_base(&DeltaAnchorChange);
    }

    /// The shipped bar's deltas are added to the last target.
    #[test]
    fn a_delta_is_added_between_the_two_anchors() {
        let target_m = |m| {
            let mut arm = ArmModel::new(&fixtures::episode_model(&DeltaAnchorChange, m).arm, [0.4, 0.4]);
            arm.set_delta(0.0, [0.05, 0.0]);
            arm.set_delta(0.1, [0.05, 0.0]);
            (arm.target_m()[0], arm.position_m(0.1)[0])
        };
        fixtures::close(target_m(0.0).0, 0.5, 1e-12);
        let (target, measured) = target_m(1.0);
        fixtures::close(target, measured + 0.05, 1e-12);
        fixtures::close(target_m(0.5).0, 0.5 * (0.5 + target), 1e-12);
    }
}
