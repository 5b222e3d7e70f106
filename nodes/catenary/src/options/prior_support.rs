//! Option `--prior-support`.

use bayes_sim::PriorSupport;
use clap::ValueEnum;

/// Treatment of the prior's support.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum PriorSupportName {
    /// Support of the model file
    Fixed,
    /// Grows where the posterior presses on an edge that physics does not set
    Adaptive,
}

impl PriorSupportName {
    /// Setting of the inference.
    pub fn setting(self) -> PriorSupport {
        match self {
            PriorSupportName::Fixed => PriorSupport::Fixed,
            PriorSupportName::Adaptive => PriorSupport::ADAPTIVE,
        }
    }

    /// Name in goals.
    pub fn name(self) -> &'static str {
        let [fixed, adaptive] = PriorSupport::NAMES;
        match self {
            PriorSupportName::Fixed => fixed,
            PriorSupportName::Adaptive => adaptive,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_goal_gets_the_setting_of_the_option() {
        for option in PriorSupportName::value_variants() {
            assert_eq!(PriorSupport::from_name(option.name()), Some(option.setting()));
        }
    }
}
