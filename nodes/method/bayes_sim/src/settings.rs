//! Settings of an inference.

use crate::embedding::{Embedding, Fourier};
use crate::prior_support::PriorSupport;
use catenary_core::Fidelity;
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Setting out of range.
#[derive(Debug, Error, Clone, PartialEq)]
#[error("settings: `{field}`: expected {expected}, got {got}")]
pub struct SettingsError {
    /// Name of the field.
    pub field: &'static str,
    /// Expected values.
    pub expected: String,
    /// Value received.
    pub got: String,
}

/// Proposal distribution of theta from the second iteration on.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum ProposalKind {
    /// Prior restricted to the highest-density region of the newest posterior (Deistler, Goncalves and Macke 2022,
    /// "Truncated proposals for scalable and hassle-free simulation-based inference"). The ratio of prior to proposal is
    /// then equal for all tracks of one iteration.
    Truncated {
        /// Posterior mass outside of the region. Smaller is safer and spends more simulations on the tails: with 1e-3, 90 %
        /// intervals of the soft bar's length held 81 % of 126 truths when damping and friction were inferred as well.
        tail: f64,
        /// Least volume of the region as a share of the previous region's volume. Larger rules out less in one iteration.
        least_shrink: f64,
    },
    /// Mixture of the prior and the newest posterior, truncated to the prior's support.
    Posterior {
        /// Share of the draws that come from the prior. Its inverse bounds the importance weights.
        prior_share: f64,
    },
}

/// Schedule of the training of one network.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Schedule {
    /// Adam's step size. Larger learns faster until the loss becomes unstable.
    pub learning_rate: f64,
    /// Decoupled decay of the dense weights and biases in each step, as a share of the learning rate. Beyond
    /// [`DECAYED_TRACKS`] tracks it falls in inverse proportion to their number. Larger trusts few tracks less.
    pub weight_decay: f64,
    /// True to train the embedding with the rest; false to leave it random.
    pub train_embedding: bool,
    /// Number of tracks in a step.
    pub batch_size: usize,
    /// Largest number of passes over the training tracks.
    pub max_epochs: usize,
    /// Number of passes without a better held-out loss after which the training stops. The best parameters are kept.
    pub patience_epochs: usize,
    /// Number of steps over which parameters are averaged with exponentially falling weights. Early in a training it is a
    /// tenth of the steps so far. 1 for no averaging.
    pub averaged_steps: usize,
    /// Largest Euclidean norm of the whole gradient.
    pub max_gradient_norm: f64,
}

/// Number of tracks beyond which weights decay less: the influence of a prior over weights falls with the number of data.
pub const DECAYED_TRACKS: usize = 3_000;

/// Settings of an inference. The documentation of a field says what larger and smaller values do.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// Number of iterations: each one draws thetas, simulates them and trains the networks.
    pub iterations: usize,
    /// Number of thetas drawn in each iteration.
    pub simulations: usize,
    /// Proposal distribution of theta after the first iteration.
    pub proposal: ProposalKind,
    /// Treatment of the prior's support: fixed, or moved where the posterior presses on an edge that physics does not set.
    pub prior_support: PriorSupport,
    /// Embedding of a frame: number of random frequencies and the features of each.
    pub embedding: Embedding,
    /// Initial length scale of the frequencies, in standard deviations of the keypoints. Training changes it.
    pub length_scale: f64,
    /// P, number of principal components of the embedding that enter the dense layers; none for the whole embedding.
    pub projection: Option<usize>,
    /// Number of units of each hidden layer.
    pub hidden: Vec<usize>,
    /// True to add a linear path from the inputs of the dense layers to the mixture's parameters.
    pub skip: bool,
    /// K, number of Gaussians in the mixture of each network.
    pub components: usize,
    /// Number of networks, each with its own held-out tracks. The posterior is the mean of their mixtures. More networks are
    /// better calibrated and cost in proportion.
    pub ensemble: usize,
    /// True for a warm start: each iteration continues the training of the previous networks instead of random ones.
    pub warm_start: bool,
    /// Share of the tracks that each network holds out for early stopping.
    pub held_out_share: f64,
    /// Schedule of the training of each network.
    pub schedule: Schedule,
    /// Fidelity of the simulations.
    pub fidelity: Fidelity,
    /// True to refine the networks' posterior with the simulator as the likelihood; false for the networks alone. A model
    /// without keypoint noise has no likelihood and is not refined.
    pub refine: bool,
    /// Number of posterior draws that are simulated for the posterior predictive check; 0 for no check.
    pub predictive_draws: usize,
    /// Seed of all random streams.
    pub seed: u64,
}

impl Default for Settings {
    /// Small and fast settings, calibrated on a linear-Gaussian model (see the tests of `sequential`).
    fn default() -> Self {
        Self {
            iterations: 15,
            simulations: 100,
            proposal: ProposalKind::Truncated { tail: 5e-4, least_shrink: 0.25 },
            prior_support: PriorSupport::Fixed,
            embedding: Embedding { frequencies: 32, fourier: Fourier::CosOnly },
            length_scale: 1.0,
            projection: Some(32),
            hidden: vec![64, 64],
            skip: true,
            components: 4,
            ensemble: 3,
            warm_start: true,
            held_out_share: 0.2,
            schedule: Schedule {
                learning_rate: 1e-3,
                weight_decay: 1.0,
                train_embedding: true,
                batch_size: 50,
                max_epochs: 100,
                patience_epochs: 10,
                averaged_steps: 50,
                max_gradient_norm: 5.0,
            },
            fidelity: Fidelity::Standard,
            refine: true,
            // With 199 draws and the measurement, p values are multiples of 0.5 %.
            predictive_draws: 199,
            seed: 0,
        }
    }
}

impl Settings {
    /// Sizes and learning rate of Kamaras and Ramamoorthy: 500 cosines, three layers of 1024 units, learning rate 1e-6.
    pub fn paper() -> Self {
        Self {
            embedding: Embedding { frequencies: 500, fourier: Fourier::CosOnly },
            projection: None,
            hidden: vec![1024; 3],
            skip: false,
            ensemble: 1,
            schedule: Schedule {
                learning_rate: 1e-6,
                weight_decay: 0.0,
                train_embedding: true,
                batch_size: 100,
                max_epochs: 100,
                patience_epochs: 100,
                averaged_steps: 1,
                max_gradient_norm: 5.0,
            },
            refine: false,
            ..Self::default()
        }
    }

    /// Default networks without a refinement.
    pub fn networks() -> Self {
        Self { refine: false, ..Self::default() }
    }

    /// Preset with the name `default`, `networks` or `paper`.
    ///
    /// # Errors
    /// [`SettingsError`] for any other name.
    pub fn preset(name: &str) -> Result<Self, SettingsError> {
        match name {
            "default" => Ok(Self::default()),
            "networks" => Ok(Self::networks()),
            "paper" => Ok(Self::paper()),
            other => {
                let expected = "default, networks or paper".into();
                Err(SettingsError { field: "preset", expected, got: other.to_owned() })
            }
        }
    }

    /// Checks all ranges.
    ///
    /// # Errors
    /// [`SettingsError`] with the field that is out of range.
    pub fn check(&self) -> Result<(), SettingsError> {
        let refuse =
            |field, expected: &str, got: String| Err(SettingsError { field, expected: expected.to_owned(), got });
        let counts = [
            ("iterations", self.iterations),
            ("embedding.frequencies", self.embedding.frequencies),
            ("projection", self.projection.unwrap_or(1)),
            ("hidden", self.hidden.iter().copied().min().unwrap_or(0)),
            ("components", self.components),
            ("ensemble", self.ensemble),
            ("schedule.batch_size", self.schedule.batch_size),
            ("schedule.max_epochs", self.schedule.max_epochs),
            ("schedule.patience_epochs", self.schedule.patience_epochs),
            ("schedule.averaged_steps", self.schedule.averaged_steps),
        ];
        if let Some((field, got)) = counts.into_iter().find(|(_, n)| *n == 0) {
            return refuse(field, "at least 1", got.to_string());
        }
        if self.simulations < LEAST_TRACKS {
            return refuse("simulations", &format!("at least {LEAST_TRACKS}"), self.simulations.to_string());
        }
        if self.iterations > MOST_ITERATIONS {
            return refuse("iterations", &format!("at most {MOST_ITERATIONS}"), self.iterations.to_string());
        }
        if self.iterations < 2 && self.prior_support != PriorSupport::Fixed {
            return refuse(
                "prior_support",
                "fixed for one iteration: the support moves between iterations",
                "adaptive".into(),
            );
        }
        // By division: the product of the two may overflow.
        if self.simulations > MOST_TRACKS / self.iterations {
            let most = format!("at most {} in each of {} iterations", MOST_TRACKS / self.iterations, self.iterations);
            return refuse("simulations", &most, self.simulations.to_string());
        }
        let positive = [
            ("length_scale", self.length_scale),
            ("schedule.learning_rate", self.schedule.learning_rate),
            ("schedule.max_gradient_norm", self.schedule.max_gradient_norm),
        ];
        if let Some((field, v)) = positive.into_iter().find(|(_, v)| !(v.is_finite() && *v > 0.0)) {
            return refuse(field, "a positive number", v.to_string());
        }
        if !(self.schedule.weight_decay.is_finite() && self.schedule.weight_decay >= 0.0) {
            return refuse(
                "schedule.weight_decay",
                "a number of at least zero",
                self.schedule.weight_decay.to_string(),
            );
        }
        let shares = match self.proposal {
            ProposalKind::Truncated { tail, least_shrink } => {
                vec![("proposal.truncated.tail", tail), ("proposal.truncated.least_shrink", least_shrink)]
            }
            ProposalKind::Posterior { prior_share } => vec![("proposal.posterior.prior_share", prior_share)],
        };
        let mut shares = shares.into_iter().chain([("held_out_share", self.held_out_share)]);
        match shares.find(|(_, v)| !(*v > 0.0 && *v < 1.0)) {
            Some((field, v)) => refuse(field, "a number between 0 and 1", v.to_string()),
            None => Ok(()),
        }
    }
}

/// Least number of tracks of a training.
pub const LEAST_TRACKS: usize = 10;
/// Largest number of iterations.
pub const MOST_ITERATIONS: usize = 1_000;
/// Largest number of simulations in all iterations together. Their tracks stay in memory: 100,000 long ones take a gigabyte.
pub const MOST_TRACKS: usize = 100_000;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_presets_are_valid_and_other_names_are_refused() {
        for (name, settings) in [("default", Settings::default()), ("paper", Settings::paper())] {
            assert_eq!(Settings::preset(name).unwrap(), settings);
            settings.check().unwrap();
        }
        let other = Settings::preset("fast").unwrap_err().to_string();
        assert_eq!(other, "settings: `preset`: expected default, networks or paper, got fast");
    }

    #[test]
    fn a_refusal_has_the_field_the_expected_and_the_received_value() {
        type Change = fn(&mut Settings);
        let truncated = |tail, least_shrink| ProposalKind::Truncated { tail, least_shrink };
        let (tail, shrink) = (truncated(0.0, 0.5), truncated(0.1, 1.0));
        let cases: [(&str, &str, &str, Change); 22] = [
            ("iterations", "at least 1", "0", |s| s.iterations = 0),
            ("simulations", "at least 10", "9", |s| s.simulations = 9),
            ("iterations", "at most 1000", "1001", |s| s.iterations = 1001),
            ("simulations", "at most 6666 in each of 15 iterations", "6667", |s| s.simulations = 6667),
            ("simulations", "at most 6666 in each of 15 iterations", "18446744073709551615", |s| {
                s.simulations = usize::MAX;
            }),
            ("prior_support", "fixed for one iteration: the support moves between iterations", "adaptive", |s| {
                (s.iterations, s.prior_support) = (1, PriorSupport::ADAPTIVE);
            }),
            ("embedding.frequencies", "at least 1", "0", |s| s.embedding.frequencies = 0),
            ("length_scale", "a positive number", "-1", |s| s.length_scale = -1.0),
            ("projection", "at least 1", "0", |s| s.projection = Some(0)),
            ("hidden", "at least 1", "0", |s| s.hidden = vec![8, 0]),
            ("hidden", "at least 1", "0", |s| s.hidden.clear()),
            ("components", "at least 1", "0", |s| s.components = 0),
            ("ensemble", "at least 1", "0", |s| s.ensemble = 0),
            ("held_out_share", "a number between 0 and 1", "NaN", |s| s.held_out_share = f64::NAN),
            ("schedule.learning_rate", "a positive number", "inf", |s| s.schedule.learning_rate = f64::INFINITY),
            ("schedule.weight_decay", "a number of at least zero", "-0.1", |s| s.schedule.weight_decay = -0.1),
            ("schedule.batch_size", "at least 1", "0", |s| s.schedule.batch_size = 0),
            ("schedule.max_epochs", "at least 1", "0", |s| s.schedule.max_epochs = 0),
            ("schedule.patience_epochs", "at least 1", "0", |s| s.schedule.patience_epochs = 0),
            ("schedule.averaged_steps", "at least 1", "0", |s| s.schedule.averaged_steps = 0),
            ("schedule.max_gradient_norm", "a positive number", "0", |s| s.schedule.max_gradient_norm = 0.0),
            ("proposal.posterior.prior_share", "a number between 0 and 1", "0", |s| {
                s.proposal = ProposalKind::Posterior { prior_share: 0.0 };
            }),
        ];
        let refusal = |s: &Settings| s.check().unwrap_err().to_string();
        for (field, expected, got, change) in cases {
            let mut settings = Settings::default();
            change(&mut settings);
            assert_eq!(refusal(&settings), format!("settings: `{field}`: expected {expected}, got {got}"));
        }
        for (proposal, field) in [(tail, "proposal.truncated.tail"), (shrink, "proposal.truncated.least_shrink")] {
            let settings = Settings { proposal, ..Settings::default() };
            assert!(refusal(&settings).contains(&format!("`{field}`: expected a number between 0 and 1")), "{field}");
        }
    }

    #[test]
    fn settings_survive_json_and_unknown_fields_do_not() {
        let settings = Settings { proposal: ProposalKind::Posterior { prior_share: 0.2 }, ..Settings::paper() };
        let text = serde_json::to_string(&settings).unwrap();
        assert_eq!(serde_json::from_str::<Settings>(&text).unwrap(), settings);
        let other = text.replacen("{", "{\"depth\": 3, ", 1);
        assert!(serde_json::from_str::<Settings>(&other).unwrap_err().to_string().contains("depth"));
    }
}
