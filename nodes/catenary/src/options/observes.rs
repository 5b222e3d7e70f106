//! Options `--history` and `--newest-only`.

use clap::Args;
use ppo_trainer::Settings;

/// What a policy observes.
#[derive(Debug, Clone, Copy, Args)]
pub struct ObservesOptions {
    /// Observations before the newest that the policy takes, at most 64: with them it sees velocities, and finds out what one observation hides;
    /// default: the preset's; for none, --newest-only
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..))]
    pub history: Option<u32>,
    /// Let the policy take the newest observation alone, without the time, as in the paper
    #[arg(long, conflicts_with = "history")]
    pub newest_only: bool,
}

impl ObservesOptions {
    /// The settings with these options.
    pub fn applied_to(self, settings: Settings) -> Settings {
        let mut settings = if self.newest_only { settings.newest_only() } else { settings };
        if let Some(history) = self.history {
            settings.observes.history = history as usize;
        }
        settings
    }
}
