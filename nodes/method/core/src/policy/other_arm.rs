//! Check whether a policy was trained for the law of the arm that it is to run on.

use super::Policy;
use crate::model::{ArmLaw, LawGap};
use thiserror::Error;

/// Policy on an arm of another law than that of its training.
#[derive(Debug, Clone, PartialEq, Error)]
#[error("policy `{name}` was trained for {trained}; this arm is {met}: {gap}")]
pub struct OtherArm {
    /// Name of the policy.
    pub name: String,
    /// Law of the training.
    pub trained: ArmLaw,
    /// Law of the arm.
    pub met: ArmLaw,
    /// Difference of the two.
    pub gap: LawGap,
}

impl Policy {
    /// Compares the law of the training with that of an arm. None if they are alike ([`ArmLaw::gap`]), or if the policy's file does not say
    /// its law.
    #[must_use]
    pub fn other_arm(&self, met: &ArmLaw) -> Option<OtherArm> {
        let trained = self.arm?;
        let gap = trained.gap(met)?;
        Some(OtherArm { name: self.name.clone(), trained, met: *met, gap })
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::policy;
    use super::*;
    use crate::model::Impedance;

    #[test]
    fn a_policy_on_another_arm_names_both_laws_and_one_without_a_law_runs_on_any() {
        let bridge = ArmLaw::Impedance(Impedance { clip_m: 0.02, ..Impedance::default() });
        let fast = ArmLaw::Lag { time_constant_s: 0.08, max_speed_m_s: 0.5 };
        let lagging = Policy { arm: Some(fast), ..policy() };
        let words = lagging.other_arm(&bridge).expect("the laws differ").to_string();
        let start =
            "policy `pi0` was trained for a lag of 0.08 s with at most 0.5 m/s; this arm is an impedance of 2000 N/m";
        assert!(words.starts_with(start) && words.ends_with("after a step of 60 mm"), "{words}");
        for arm in [None, Some(bridge)] {
            assert_eq!(Policy { arm, ..policy() }.other_arm(&bridge), None);
        }
        assert_eq!(lagging.other_arm(&fast), None);
    }
}
