//! Sizes of a network.

use super::head::MixtureHead;
use super::samples::Samples;
use crate::embedding::Embedding;
use crate::settings::Settings;
use serde::{Deserialize, Serialize};

/// Sizes of a network.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Shape {
    /// F, number of frames.
    pub frames: usize,
    /// X, number of plain numbers of a sample beside its frames.
    pub plain: usize,
    /// Channels of [`crate::embedding::input`] that enter the network.
    pub channels: Vec<usize>,
    /// Embedding of a frame.
    pub embedding: Embedding,
    /// P, number of principal components that enter the dense layers; none for all columns.
    pub projection: Option<usize>,
    /// Number of units of each hidden layer.
    pub hidden: Vec<usize>,
    /// True for a linear path from the inputs of the first dense layer to the raw outputs.
    pub skip: bool,
    /// Mixture head.
    pub head: MixtureHead,
}

impl Shape {
    /// Shape of networks that learn from `samples`: from their tracks, their rows of plain numbers, or both.
    pub fn of_samples(samples: &Samples, settings: &Settings) -> Self {
        let (frames, dimension) = (samples.frames(), samples.dimension());
        Self {
            frames,
            plain: samples.plain(),
            channels: samples.varying_channels(),
            embedding: settings.embedding,
            projection: settings.projection.filter(|_| frames > 0),
            hidden: settings.hidden.clone(),
            skip: settings.skip,
            head: MixtureHead { components: settings.components, dimension },
        }
    }

    /// C, number of columns of a frame.
    pub fn columns(&self) -> usize {
        self.embedding.features() + self.channels.len()
    }

    /// Number of inputs of the first dense layer that come from the frames.
    pub(super) fn framed(&self) -> usize {
        if self.frames == 0 { 0 } else { self.projection.unwrap_or(self.frames * self.columns()) }
    }

    /// I, number of inputs of the first dense layer.
    pub fn inputs(&self) -> usize {
        self.framed() + self.plain
    }

    /// Numbers of inputs and outputs of each dense layer.
    pub fn layers(&self) -> Vec<(usize, usize)> {
        let mut inputs = self.inputs();
        let mut layers = Vec::with_capacity(self.hidden.len() + 1);
        for outputs in self.hidden.iter().copied().chain([self.head.outputs()]) {
            layers.push((inputs, outputs));
            inputs = outputs;
        }
        layers
    }

    /// Number of parameters of the whole network.
    pub fn parameter_count(&self) -> usize {
        let dense: usize = self.layers().iter().map(|(inputs, outputs)| (inputs + 1) * outputs).sum();
        self.embedding.parameter_count() + dense + self.skip_count()
    }

    /// Number of weights of the linear path (outputs x inputs), which come last.
    pub(super) fn skip_count(&self) -> usize {
        if self.skip { self.inputs() * self.head.outputs() } else { 0 }
    }

    /// Indices of the first weight and of the first bias of each layer.
    pub(super) fn offsets(&self) -> Vec<(usize, usize)> {
        let mut next = self.embedding.parameter_count();
        let mut offsets = Vec::new();
        for (inputs, outputs) in self.layers() {
            offsets.push((next, next + inputs * outputs));
            next += (inputs + 1) * outputs;
        }
        offsets
    }
}
