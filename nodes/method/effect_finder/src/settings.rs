//! Settings of a search.

use crate::error::FinderError;
use catenary_core::Fidelity;
use serde::{Deserialize, Serialize};

/// Settings of a search.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// Draws of the prior among which a fit chooses its starts. More draws find the best of several local minima.
    pub draws: usize,
    /// Number of draws from which a fit starts.
    pub starts: usize,
    /// Number of null data sets (B), simulated from the fitted model and fitted again. The least p-value is 1 / (1 +
    /// B).
    pub null_sets: usize,
    /// Level of the test, and of the localisation.
    pub level: f64,
    /// Log Bayes factor in nats under which two models are not told apart (3: twenty to one).
    pub least_log_bayes_factor: f64,
    /// Cosine between the changes of two effects, orthogonal to those of the parameters, above which they are not told
    /// apart.
    pub greatest_cosine: f64,
    /// Prior probability of a discrepancy.
    pub discrepancy_share: f64,
    /// Prior odds of a further effect beside one that is present.
    pub further_effect: f64,
    /// Most effects in one model.
    pub most_effects: usize,
    /// Number of the most promising models with a further effect that are fitted. The others are judged by their
    /// linearised minimum.
    pub extensions: usize,
    /// Least share of the excess residual energy that effects must explain to be told as the nearest ones.
    pub least_share: f64,
    /// Level of the test of a repaired model. It is lower than `level`, so that a true repair is rarely rejected.
    pub repaired_level: f64,
    /// Most rounds of a fit.
    pub rounds: usize,
    /// Fidelity of the simulations. A coarse one suffices if a finer one corrects it.
    pub fidelity: Fidelity,
    /// Fallback fidelity when the discretisation error exceeds 20 % of the noise variance, too much for a correction;
    /// none: no fallback. JSON files call it `fallback_fidelity`.
    #[serde(rename = "in_need")]
    pub fallback_fidelity: Option<Fidelity>,
    /// Finer fidelity that corrects the discretisation error of the simulations; none: no correction.
    pub finer_fidelity: Option<Fidelity>,
    /// Seed of all random draws.
    pub seed: u64,
}

impl Default for Settings {
    fn default() -> Self {
        let track_fit::Settings { draws, starts, fidelity, fallback_fidelity, finer_fidelity, seed } =
            track_fit::Settings::default();
        Self {
            draws,
            starts,
            // Least p-value: 0.005.
            null_sets: 199,
            level: 0.05,
            // Strong evidence begins at 3 nats (Kass and Raftery 1995).
            least_log_bayes_factor: 3.0,
            greatest_cosine: 0.95,
            discrepancy_share: 0.2,
            further_effect: 0.5,
            most_effects: 3,
            extensions: 10,
            least_share: 0.5,
            repaired_level: 0.01,
            rounds: 40,
            fidelity,
            fallback_fidelity,
            finer_fidelity,
            seed,
        }
    }
}

impl Settings {
    /// Settings of the search's fits.
    pub fn of_fits(&self) -> track_fit::Settings {
        let Self { draws, starts, fidelity, fallback_fidelity, finer_fidelity, seed, .. } = *self;
        track_fit::Settings { draws, starts, fidelity, fallback_fidelity, finer_fidelity, seed }
    }

    /// Rejects invalid settings, by field.
    ///
    /// # Errors
    /// [`FinderError::Setting`].
    pub fn check(&self) -> Result<(), FinderError> {
        let bad = |field, expected: &str, got: &dyn std::fmt::Display| {
            Err(FinderError::Setting { field, expected: expected.to_owned(), got: got.to_string() })
        };
        if self.starts == 0 || self.draws < self.starts {
            let got = format!("{} and {}", self.draws, self.starts);
            return bad("draws", "at least one start, and at least as many draws as starts", &got);
        }
        if !(self.level > 0.0 && self.level < 1.0) {
            return bad("level", "a number between 0 and 1", &self.level);
        }
        // With fewer null sets no p-value could reach the level.
        if self.null_sets == 0 || 1.0 / (1.0 + self.null_sets as f64) > self.level {
            return bad("null_sets", "enough sets B for a p-value 1 / (1 + B) within the level", &self.null_sets);
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
            return bad("most_effects", "at least 1, and at least 1 extension", &got);
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
    fn invalid_settings_are_refused_by_name() {
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
