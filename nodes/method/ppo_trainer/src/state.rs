//! State of a training between two updates. A training that goes on from it ends with the bits of an uninterrupted one.

use crate::adam::Adam;
use crate::curve::CurvePoint;
use crate::network::Network;
use crate::normaliser::Normaliser;
use crate::schedule::Schedule;
use catenary_core::mlp::{Layer, MlpError};
use catenary_core::policy::Memory;
use catenary_core::{Mlp, Observation};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Part of a state that does not belong to the training that shall go on.
#[derive(Debug, Error, PartialEq)]
#[error("state of a training: `{part}`: expected {expected}, got {got}")]
pub struct StateError {
    /// Name of the part.
    pub part: &'static str,
    /// Expected content.
    pub expected: String,
    /// Given content.
    pub got: String,
}

/// State of a training after an update: networks, optimiser, random generator, and the episodes that run. The environments have a state of their
/// own, which the caller keeps.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct State {
    pub(crate) actor: Vec<Weights>,
    pub(crate) critic: Vec<Weights>,
    pub(crate) log_std: [f32; 2],
    pub(crate) adam: Adam,
    pub(crate) normaliser: Normaliser,
    /// Observations that each environment's networks have taken in its present episode.
    pub(crate) memories: Vec<Memory>,
    /// Observation that they take next.
    pub(crate) next: Vec<Observation>,
    pub(crate) random: Random,
    pub(crate) steps: u64,
    pub(crate) schedule: Schedule,
    /// Return of each environment's present episode, and true if it succeeded.
    pub(crate) running: Vec<(f64, bool)>,
    /// Return and success of the last episodes.
    pub(crate) recent: Vec<(f64, bool)>,
    /// Learning curve so far.
    pub(crate) curve: Vec<CurvePoint>,
}

impl State {
    /// Environment steps taken.
    pub fn steps(&self) -> u64 {
        self.steps
    }
}

/// Layer of a network.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Weights {
    inputs: usize,
    outputs: usize,
    weight: Vec<f32>,
    bias: Vec<f32>,
}

impl Weights {
    /// Layers of a network.
    pub(crate) fn of(network: &Network) -> Vec<Self> {
        let weights =
            |l: &Layer| Self { inputs: l.inputs, outputs: l.outputs, weight: l.weight.clone(), bias: l.bias.clone() };
        network.mlp.layers().iter().map(weights).collect()
    }

    /// Network of these layers, which must have the sizes of `like`.
    pub(crate) fn network(part: &'static str, layers: &[Self], like: &Network) -> Result<Network, StateError> {
        let sizes = |layers: &[Layer]| layers.iter().map(|l| (l.inputs, l.outputs)).collect::<Vec<_>>();
        let layer =
            |w: &Self| Layer { inputs: w.inputs, outputs: w.outputs, weight: w.weight.clone(), bias: w.bias.clone() };
        let layers: Vec<Layer> = layers.iter().map(layer).collect();
        let (expected, got) = (sizes(like.mlp.layers()), sizes(&layers));
        let broken = |got: String| StateError { part, expected: format!("layers of {expected:?}"), got };
        if expected != got {
            return Err(broken(format!("{got:?}")));
        }
        let mlp = Mlp::new(layers).map_err(|e: MlpError| broken(e.to_string()))?;
        let mut network = like.clone();
        network.mlp = mlp;
        Ok(network)
    }
}

/// Random generator at a place of its stream.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Random {
    seed: [u8; 32],
    stream: u64,
    /// Number of words of 32 bits that were drawn.
    word: u128,
}

impl Random {
    pub(crate) fn of(rng: &ChaCha8Rng) -> Self {
        Self { seed: rng.get_seed(), stream: rng.get_stream(), word: rng.get_word_pos() }
    }

    pub(crate) fn rng(&self) -> ChaCha8Rng {
        let mut rng = ChaCha8Rng::from_seed(self.seed);
        rng.set_stream(self.stream);
        rng.set_word_pos(self.word);
        rng
    }
}
