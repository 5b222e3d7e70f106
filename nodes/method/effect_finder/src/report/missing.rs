//! Missing thing that no effect of the library is: in which part of the simulator, where, when and how fast it acts.

use crate::template::Template;
use serde::{Deserialize, Serialize};

/// Missing thing, in the form of a template.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Missing {
    /// Part of the simulator in which it acts: `force`, `material`, `boundary`, `actuation` or `observation`.
    pub hook: String,
    /// Probability of this part, among the parts for which there is a template.
    pub probability: f64,
    /// Likeliest template of this part.
    #[serde(flatten)]
    pub form: Form,
    /// Index of the episode in which it shows most.
    pub episode: usize,
    /// Times in s since the start of that episode between which it shows most: the shortest with four fifths of the energy
    /// of the change.
    pub phase_s: [f64; 2],
    /// Likeliest template of each other part with a probability of at least a hundredth, the most probable first.
    pub alternatives: Vec<Alternative>,
}

/// Template with its values.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Form {
    /// Name of the template. Several that act together, as the phases of a wave, have the name of the largest.
    pub template: String,
    /// Name in sentences.
    pub title: String,
    /// Size in `unit`; of several that act together, the root of the sum of squares.
    pub size: f64,
    /// Unit of the size.
    pub unit: String,
    /// Place along the object as a fraction of its length from the grip; none if it acts everywhere.
    pub place: Option<f64>,
    /// Frequency in Hz; none if it does not swing.
    pub frequency_hz: Option<f64>,
}

/// Another part in which the missing thing may act.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Alternative {
    /// Part of the simulator.
    pub hook: String,
    /// Probability of the part.
    pub probability: f64,
    /// Likeliest template of the part.
    #[serde(flatten)]
    pub form: Form,
}

impl Form {
    /// Form of `templates` that act together with `sizes` at a place or with a frequency.
    pub fn of(templates: &[&Template], sizes: &[f64], place: Option<f64>, frequency_hz: Option<f64>) -> Self {
        let largest = (0..sizes.len()).max_by(|a, b| sizes[*a].abs().total_cmp(&sizes[*b].abs())).unwrap_or(0);
        let template = templates[largest];
        let size = match sizes {
            [one] => *one,
            several => several.iter().map(|s| s * s).sum::<f64>().sqrt(),
        };
        let (title, unit) = (template.common_title().to_owned(), template.unit.clone());
        Self { template: template.name.clone(), title, size, unit, place, frequency_hz }
    }

    /// Words such as "bend at a place (0.35 of the length from the grip)".
    pub fn words(&self) -> String {
        let place = self.place.map(|place| format!(" ({place:.2} of the length from the grip)"));
        let frequency = self.frequency_hz.map(|hz| format!(" ({hz:.2} Hz)"));
        format!("{}{}{}", self.title, place.unwrap_or_default(), frequency.unwrap_or_default())
    }
}

/// Words for a part of the simulator.
pub fn part_in_words(hook: &str) -> &'static str {
    match hook {
        "force" => "the forces on the object",
        "material" => "the material",
        "boundary" => "the grip",
        "actuation" => "the arm",
        "observation" => "the camera",
        _ => "another part",
    }
}
