//! Companions: effects that do nothing alone, and set where and how fast others act.

use super::effect::{About, Effect, Hook, log_uniform, uniform};
use crate::episode_model::{Companions, EpisodeModel};

/// Returns the values that a companion sets.
type Own = fn(&mut EpisodeModel) -> &mut Companions;

/// Companion that sets a place, as a fraction of the length from the grip.
pub(super) struct Place {
    /// Name in model files.
    pub name: &'static str,
    /// Values that it sets.
    pub own: Own,
}

impl Effect for Place {
    fn about(&self) -> About {
        About {
            name: self.name,
            title: "place",
            description: "place of effects that act at one place, as a fraction of the length from the grip; nothing alone",
            unit: "1",
            hook: Hook::Material,
            prior: uniform(0.0, 1.0),
            range: [0.0, 1.0],
        }
    }

    fn apply(&self, magnitude: f64, episode: &mut EpisodeModel) -> Result<(), &'static str> {
        (self.own)(episode).place = magnitude;
        Ok(())
    }

    fn if_absent(&self) -> f64 {
        Companions::default().place
    }
}

/// Companion that sets a frequency in Hz.
pub(super) struct Frequency {
    /// Name in model files.
    pub name: &'static str,
    /// Values that it sets.
    pub own: Own,
}

impl Effect for Frequency {
    fn about(&self) -> About {
        About {
            name: self.name,
            title: "frequency",
            description: "frequency of effects that swing with time; nothing alone",
            unit: "Hz",
            hook: Hook::Force,
            // From a swing in an episode of some seconds to the frame rate of a slow camera.
            prior: log_uniform(0.1, 10.0),
            range: [0.0, 50.0],
        }
    }

    fn apply(&self, magnitude: f64, episode: &mut EpisodeModel) -> Result<(), &'static str> {
        (self.own)(episode).frequency_hz = magnitude;
        Ok(())
    }

    fn if_absent(&self) -> f64 {
        Companions::default().frequency_hz
    }
}
