//! Templates: forms of what a model may miss where no effect explains the data.

use serde::Serialize;

/// Further value that a template needs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub enum Companion {
    /// Place along the object, as a fraction of its length from the grip.
    Place,
    /// Frequency in Hz.
    Frequency,
}

/// Template: a form of what a model may miss. It says in which part of the simulator, where and how fast something acts,
/// and not what it is.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Template {
    /// Name of its size, as in simulation requests.
    pub name: String,
    /// Name in sentences; the part before the first comma is common to the templates that act together.
    pub title: String,
    /// Unit of its size.
    pub unit: String,
    /// Part of the simulator in which it acts: `force`, `material`, `boundary`, `actuation` or `observation`.
    pub hook: String,
    /// Largest size that its prior allows, in its unit.
    pub most: f64,
    /// Smallest and largest meaningful size, in its unit.
    pub range: [f64; 2],
    /// True for an effect of the library. It has been tried as an explanation by itself, and stands here only for what its part
    /// of the simulator can do.
    pub is_known: bool,
    /// Further value that it needs, with its name in simulation requests; none if it acts everywhere and always.
    pub companion: Option<(Companion, String)>,
}

impl Template {
    /// Returns whether two templates act together, as the phases of a wave and the axes of the image do.
    pub fn is_with(&self, other: &Self) -> bool {
        let together = |t: &Self| match t.companion {
            // Each place is a model of its own.
            Some((Companion::Place, _)) => Some(t.name.clone()),
            _ => None,
        };
        self.hook == other.hook
            && self.is_known == other.is_known
            && self.companion == other.companion
            && together(self) == together(other)
    }

    /// Returns whether its size cannot be negative.
    pub fn is_positive(&self) -> bool {
        self.range[0] >= 0.0
    }

    /// Title without the words that tell templates apart that act together.
    pub fn common_title(&self) -> &str {
        self.title.split(',').next().unwrap_or(&self.title)
    }
}
