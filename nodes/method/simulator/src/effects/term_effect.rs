//! Effect that consists of terms from outside.

use super::effect::{About, Effect};
use crate::episode_model::EpisodeModel;

/// Function that adds the terms of a magnitude to an episode.
type Add = Box<dyn Fn(f64, &mut EpisodeModel) + Send + Sync>;

/// Effect that adds terms to an episode. Nothing can refuse it.
pub(super) struct TermEffect {
    about: About,
    companions: &'static [&'static str],
    add: Add,
}

impl TermEffect {
    /// Makes an effect of the given description and companions. `add` adds the terms of a magnitude.
    pub fn new(
        about: About,
        companions: &'static [&'static str],
        add: impl Fn(f64, &mut EpisodeModel) + Send + Sync + 'static,
    ) -> Self {
        Self { about, companions, add: Box::new(add) }
    }
}

impl Effect for TermEffect {
    fn about(&self) -> About {
        self.about.clone()
    }

    fn apply(&self, magnitude: f64, episode: &mut EpisodeModel) -> Result<(), &'static str> {
        (self.add)(magnitude, episode);
        Ok(())
    }

    fn companions(&self) -> &'static [&'static str] {
        self.companions
    }
}
