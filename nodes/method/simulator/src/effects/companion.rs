//! Companions: effects that do nothing alone, and set where, how fast, from which size on or in which shape others act.

use super::effect::{About, Effect, Hook, log_uniform, uniform};
use crate::episode_model::{Companions, EpisodeModel};

/// Companion: it sets one value of an episode.
pub(super) struct Companion {
    about: About,
    if_absent: f64,
    value: fn(&mut EpisodeModel) -> &mut f64,
}

impl Companion {
    /// Makes a companion of the given description, which has the value `if_absent` where nothing names it.
    pub fn new(about: About, if_absent: f64, value: fn(&mut EpisodeModel) -> &mut f64) -> Self {
        Self { about, if_absent, value }
    }

    /// Makes the companion `name` that sets a place, as a fraction of the length from the grip.
    pub fn place(name: &'static str, value: fn(&mut EpisodeModel) -> &mut f64) -> Self {
        let about = About {
            name,
            title: "place",
            description: "place of effects that act at one place, as a fraction of the length from the grip; nothing alone",
            unit: "1",
            hook: Hook::Material,
            prior: uniform(0.0, 1.0),
            range: [0.0, 1.0],
        };
        Self { about, if_absent: Companions::default().place, value }
    }

    /// Makes the companion `name` that sets a frequency in Hz.
    pub fn frequency(name: &'static str, value: fn(&mut EpisodeModel) -> &mut f64) -> Self {
        let about = About {
            name,
            title: "frequency",
            description: "frequency of effects that swing with time; nothing alone",
            unit: "Hz",
            hook: Hook::Force,
            // From a swing in an episode of some seconds to the frame rate of a slow camera.
            prior: log_uniform(0.1, 10.0),
            range: [0.0, 50.0],
        };
        Self { about, if_absent: Companions::default().frequency_hz, value }
    }
}

impl Effect for Companion {
    fn about(&self) -> About {
        self.about.clone()
    }

    fn apply(&self, magnitude: f64, episode: &mut EpisodeModel) -> Result<(), &'static str> {
        *(self.value)(episode) = magnitude;
        Ok(())
    }

    fn if_absent(&self) -> f64 {
        self.if_absent
    }
}
