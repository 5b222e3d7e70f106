//! How carefully to look.

use crate::error::FinderError;
use catenary_core::Fidelity;
use serde::{Deserialize, Serialize};

/// How carefully to look.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// Draws from the prior among which a fit looks for its starts. More find the best fit of a model with several valleys.
    pub draws: usize,
    /// Best draws from which a fit starts.
    pub starts: usize,
    /// Data sets simulated from the fitted model, each fitted again (B). The least p-value is 1 / (1 + B).
    pub null_sets: usize,
    /// Level of the test, and of the localisation's.
    pub level: f64,
    /// Log Bayes factor under which two effects are not told apart (3: twenty to one).
    pub least_log_bayes_factor: f64,
    /// Cosine between what two effects change, beyond what parameters can, over which they are not told apart.
    pub greatest_cosine: f64,
    /// How likely it is beforehand that something is present which no candidate is.
    pub discrepancy_share: f64,
    /// How likely a further effect is beforehand, beside one that is present.
    pub further_effect: f64,
    /// Most effects that are looked for together.
    pub most_effects: usize,
    /// Models with one effect more that are fitted, of all the most promising; the others are judged as if the simulator were
    /// linear.
    pub extensions: usize,
    /// Share of the squared deviations beyond noise that effects must explain to be named where something is left.
    pub least_share: f64,
    /// Level of the test of a repaired model. Lower than that of the present one: a true repair shall be refused rarely.
    pub repaired_level: f64,
    /// Rounds of a fit.
    pub rounds: usize,
    /// Fidelity of the simulations. Coarse ones will do where a finer one corrects them.
    pub fidelity: Fidelity,
    /// Fidelity in its place where its error at the best fit that was found would be plain in the data: where it is more than a
    /// correction can take out; none: there is no other.
    pub in_need: Option<Fidelity>,
    /// Finer fidelity, by which the error of the simulations' division of time and object is taken out; none: it is not.
    pub finer_fidelity: Option<Fidelity>,
    /// Seed of everything drawn.
    pub seed: u64,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            draws: 400,
            starts: 8,
            null_sets: 199,
            level: 0.05,
            least_log_bayes_factor: 3.0,
            greatest_cosine: 0.95,
            discrepancy_share: 0.2,
            further_effect: 0.5,
            most_effects: 3,
            extensions: 10,
            least_share: 0.5,
            repaired_level: 0.01,
            rounds: 40,
            fidelity: Fidelity::Fast,
            in_need: Some(Fidelity::FineMesh),
            finer_fidelity: Some(Fidelity::Reference),
            seed: 0,
        }
    }
}

impl Settings {
    /// Rejects settings that make no sense, by field.
    ///
    /// # Errors
    /// [`FinderError::Setting`].
    pub fn check(&self) -> Result<(), FinderError> {
        let bad = |field, expected: &str, got: &dyn std::fmt::Display| {
            Err(FinderError::Setting { field, expected: expected.to_owned(), got: got.to_string() })
        };
        if self.starts == 0 || self.draws < self.starts {
            let got = format!("{} and {}", self.draws, self.starts);
            return bad("draws", "at least as many as starts, and a start", &got);
        }
        if !(self.level > 0.0 && self.level < 1.0) {
            return bad("level", "a number between 0 and 1", &self.level);
        }
        if self.null_sets == 0 || 1.0 / (1.0 + self.null_sets as f64) > self.level {
            return bad("null_sets", "enough for a p-value below the level, 1 / (1 + B)", &self.null_sets);
        }
        if !(self.greatest_cosine > 0.0 && self.greatest_cosine <= 1.0) {
            return bad("greatest_cosine", "a number above 0, at most 1", &self.greatest_cosine);
        }
        if !(self.least_log_bayes_factor >= 0.0 && self.least_log_bayes_factor.is_finite()) {
            return bad("least_log_bayes_factor", "a number of at least 0", &self.least_log_bayes_factor);
        }
        let shares = [
            ("discrepancy_share", self.discrepancy_share),
            ("further_effect", self.further_effect),
            ("least_share", self.least_share),
            ("repaired_level", self.repaired_level),
        ];
        for (field, value) in shares {
            if !(value > 0.0 && value < 1.0) {
                return bad(field, "a number between 0 and 1", &value);
            }
        }
        if self.most_effects == 0 || self.extensions == 0 {
            let got = format!("{} and {}", self.most_effects, self.extensions);
            return bad("most_effects", "at least 1, and as many extensions", &got);
        }
        if self.rounds == 0 {
            return bad("rounds", "at least 1", &self.rounds);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_that_make_no_sense_are_named() {
        assert!(Settings::default().check().is_ok());
        let refusal = |s: Settings| s.check().unwrap_err().to_string();
        let base = Settings::default;
        assert!(refusal(Settings { null_sets: 10, ..base() }).contains("`null_sets`"));
        assert!(refusal(Settings { level: 0.0, ..base() }).contains("`level`"));
        assert!(refusal(Settings { draws: 2, ..base() }).contains("got 2 and 8"));
        assert!(refusal(Settings { further_effect: 1.5, ..base() }).contains("`further_effect`"));
        assert!(refusal(Settings { most_effects: 0, ..base() }).contains("`most_effects`"));
    }
}
