//! Everything that inference can be told, in one place.

use crate::embedding::{Embedding, Fourier};
use crate::error::InferenceError;
use crate::network::train::Schedule;
use catenary_core::Fidelity;
use serde::{Deserialize, Serialize};

/// Where the thetas of the second iteration and of all later ones are drawn from.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum ProposalKind {
    /// The prior, restricted to the region of highest density of the newest posterior (Deistler, Goncalves and Macke
    /// 2022, "Truncated proposals for scalable and hassle-free simulation-based inference"). Prior over proposal is then
    /// the same for all tracks of one iteration.
    Truncated {
        /// Posterior mass that the region leaves out. Smaller is safer, and spends more simulations on the tails: of 1e-3, 90 %
        /// intervals of the soft bar's length held 81 % of 126 truths where damping and friction are inferred, too.
        tail: f64,
        /// Least volume of the region as a share of the last one's: how much one iteration may rule out.
        least_shrink: f64,
    },
    /// The newest posterior, truncated to the prior's support, mixed with the prior.
    Posterior {
        /// Share of the draws from the prior. It bounds the importance weights by its inverse.
        prior_share: f64,
    },
}

/// Settings of an inference. The doc of each field says what larger and smaller do.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// Iterations of Algorithm 1: simulate, train, draw anew.
    pub iterations: usize,
    /// Simulations of each.
    pub simulations: usize,
    /// Where thetas are drawn from after the first iteration.
    pub proposal: ProposalKind,
    /// Embedding of a frame: number of random frequencies, and the features of each.
    pub embedding: Embedding,
    /// Length scale that the frequencies start from, in standard deviations of the keypoints; trained from there.
    pub length_scale: f64,
    /// P, principal components of the embedding that the dense layers see; none: they see all of it.
    pub projection: Option<usize>,
    /// Units of each hidden layer.
    pub hidden: Vec<usize>,
    /// Whether the embedding also acts on the mixture's parameters directly, linearly.
    pub skip: bool,
    /// K, Gaussians of each network's mixture.
    pub components: usize,
    /// Networks that are trained side by side, each with its own held-out tracks; the posterior is their mean. More are
    /// better calibrated, and cost in proportion.
    pub ensemble: usize,
    /// Whether the training of each iteration goes on from the last one's networks, and not from random ones.
    pub warm_start: bool,
    /// Share of the tracks that each network holds out to know when to stop.
    pub held_out_share: f64,
    /// Adam and its limits.
    pub schedule: Schedule,
    /// Fidelity of the simulations.
    pub fidelity: Fidelity,
    /// Posterior draws that are simulated at the end to check the posterior; 0: none.
    pub predictive_draws: usize,
    /// Seed of everything that is random.
    pub seed: u64,
}

impl Default for Settings {
    /// Small, fast, and calibrated on a linear-Gaussian model: see the tests.
    fn default() -> Self {
        Self {
            iterations: 15,
            simulations: 100,
            proposal: ProposalKind::Truncated { tail: 5e-4, least_shrink: 0.25 },
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
            predictive_draws: 99,
            seed: 0,
        }
    }
}

impl Settings {
    /// The sizes and the step size of the paper: 500 cosines, three layers of 1024 units, learning rate 1e-6.
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
            ..Self::default()
        }
    }

    /// The preset called `name`: `default` or `paper`.
    pub fn preset(name: &str) -> Result<Self, InferenceError> {
        match name {
            "default" => Ok(Self::default()),
            "paper" => Ok(Self::paper()),
            other => Err(InferenceError::Setting {
                field: "preset",
                expected: "default or paper".into(),
                got: other.to_owned(),
            }),
        }
    }

    /// Rejects values that make no inference; names the field.
    pub fn check(&self) -> Result<(), InferenceError> {
        let refuse = |field, expected: &str, got: String| {
            Err(InferenceError::Setting { field, expected: expected.to_owned(), got })
        };
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

/// Fewest tracks that a network is trained on.
pub const LEAST_TRACKS: usize = 10;
/// Most iterations.
pub const MOST_ITERATIONS: usize = 1_000;
/// Most simulations in all iterations together: their tracks are kept, and take a gigabyte where they are long.
pub const MOST_TRACKS: usize = 100_000;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_presets_are_sound_and_others_are_refused() {
        for (name, settings) in [("default", Settings::default()), ("paper", Settings::paper())] {
            assert_eq!(Settings::preset(name).unwrap(), settings);
            settings.check().unwrap();
        }
        let other = Settings::preset("fast").unwrap_err().to_string();
        assert_eq!(other, "settings: `preset`: expected default or paper, got fast");
    }

    #[test]
    fn check_names_the_field_what_was_expected_and_what_came() {
        type Change = fn(&mut Settings);
        let truncated = |tail, least_shrink| ProposalKind::Truncated { tail, least_shrink };
        let (tail, shrink) = (truncated(0.0, 0.5), truncated(0.1, 1.0));
        let cases: [(&str, &str, &str, Change); 21] = [
            ("iterations", "at least 1", "0", |s| s.iterations = 0),
            ("simulations", "at least 10", "9", |s| s.simulations = 9),
            ("iterations", "at most 1000", "1001", |s| s.iterations = 1001),
            ("simulations", "at most 6666 in each of 15 iterations", "6667", |s| s.simulations = 6667),
            ("simulations", "at most 6666 in each of 15 iterations", "18446744073709551615", |s| {
                s.simulations = usize::MAX;
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
