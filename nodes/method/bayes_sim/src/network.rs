//! Mixture density network (Bishop 1994): embedding of every frame, dense layers and mixture head, with a hand-written
//! gradient.
//!
//! Shapes: B tracks of F frames; C columns in a frame (features, then channels). The first dense layer has I inputs: all
//! F x C columns or their P leading principal components, and X plain numbers. All parameters lie in one vector: those of the
//! embedding, then the weights (outputs x inputs, row-major) and biases of each layer, then the weights of the linear path.

mod conformal;
mod ensemble;
pub mod head;
mod inflation;
mod packed;
mod projection;
mod restart;
mod samples;
mod shape;
mod standard;
#[cfg(test)]
mod tests;
pub mod train;
pub mod truncation;

pub use ensemble::{Ensemble, IntervalFactors, Outcome, Training};
pub use head::MixtureHead;
pub use projection::Projection;
pub use samples::Samples;
pub use shape::Shape;
pub use standard::Standardisation;
pub use train::{Epoch, Trained, TrainingError, train};

use crate::unit_map::UnitMap;
use catenary_core::matrix::{Transpose, gemm, tanh};
use head::Parts;
use rand::{Rng, RngExt};
use rand_distr::StandardNormal;
use serde::{Deserialize, Serialize};
use standard::Affine;
use truncation::Lattice;

/// Lattice points for the mass inside of the unit cube of a mixture that is returned.
const MASS_POINTS: usize = 1024;
/// Lattice points for the mass inside of the unit cube of each held-out track's mixture, of which there are many.
const WATCH_POINTS: usize = 16;

/// Mixture density network over the unit coordinates of theta.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Network {
    shape: Shape,
    standard: Standardisation,
    projection: Option<Projection>,
    #[serde(with = "packed")]
    parameters: Vec<f32>,
}

/// Activations of a forward pass, for the backward pass.
#[derive(Debug, Default)]
pub struct Activations {
    /// B x units of each hidden layer.
    hidden: Vec<Vec<f32>>,
    /// B x outputs of the head.
    raw: Vec<f32>,
}

impl Network {
    /// Network with random parameters, standardised by all `samples` with `weights`.
    pub fn new<R: Rng>(shape: Shape, length_scale: f64, samples: &Samples, weights: &[f64], rng: &mut R) -> Self {
        let mut parameters = shape.embedding.initial(length_scale, rng);
        let last = shape.hidden.len();
        for (layer, (inputs, outputs)) in shape.layers().into_iter().enumerate() {
            // A smaller spread in the head: the initial mixture depends little on the track.
            let spread = if layer == last { 0.3 } else { 1.0 } / (inputs as f32).sqrt();
            parameters.extend((0..inputs * outputs).map(|_| spread * rng.sample::<f32, _>(StandardNormal)));
            parameters.extend(std::iter::repeat_n(0.0, outputs));
        }
        let [means, diagonals, _] = shape.head.offsets();
        let biases = parameters.len() - shape.head.outputs();
        // Different means break the symmetry between the components.
        for mean in &mut parameters[biases + means..biases + diagonals] {
            *mean = 0.5 * rng.sample::<f32, _>(StandardNormal);
        }
        parameters.extend(std::iter::repeat_n(0.0, shape.skip_count()));
        let standard = Standardisation::of_points(&shape, samples);
        let mut network = Self { shape, standard, projection: None, parameters };
        network.standardise(samples, weights, rng);
        network
    }

    /// Standardises everything except the keypoints by `samples`: the embedding's parameters belong to the old scale of these.
    fn standardise<R: Rng>(&mut self, samples: &Samples, weights: &[f64], rng: &mut R) {
        self.standard.fit_theta(samples, weights);
        let (columns, presence) = (self.raw_columns(samples), self.standard.presence);
        self.standard.columns = Affine::of_columns(&columns, samples, weights, &self.shape, presence);
        self.standard.plain = Affine::of_plain(samples, weights, &self.shape);
        if let Some(components) = self.shape.projection.filter(|_| self.shape.frames > 0) {
            self.projection = Some(Projection::fit(&self.columns(samples), weights, components, rng));
        }
    }

    /// Returns true if all parts have the lengths that the shape requires. Those from a file may not.
    pub(crate) fn is_whole(&self) -> bool {
        let columns = self.shape.frames * self.shape.columns();
        let projects = self.shape.projection.filter(|_| self.shape.frames > 0);
        self.parameters.len() == self.shape.parameter_count()
            && self.standard.is_whole(&self.shape)
            && self.projection.as_ref().map(Projection::shape) == projects.map(|p| (columns, p))
            && self.projection.as_ref().is_none_or(Projection::is_whole)
    }

    /// Returns true if every number that a file holds in binary form is finite.
    pub(crate) fn is_finite(&self) -> bool {
        self.parameters.iter().all(|v| v.is_finite()) && self.projection.as_ref().is_none_or(Projection::is_finite)
    }

    /// Sizes of the network.
    pub fn shape(&self) -> &Shape {
        &self.shape
    }

    /// All parameters.
    pub fn parameters(&self) -> &[f32] {
        &self.parameters
    }

    /// All parameters, for training in place.
    pub fn parameters_mut(&mut self) -> &mut [f32] {
        &mut self.parameters
    }

    /// Centres and scales.
    pub fn standard(&self) -> &Standardisation {
        &self.standard
    }

    /// Converts the mixture to other unit coordinates. The mass inside of the unit cube changes with the cube.
    fn map_thetas(&mut self, map: &UnitMap) {
        self.standard.map_theta(map);
    }

    /// B x F x C columns of `batch`, not standardised; zeros in absent frames.
    fn raw_columns(&self, batch: &Samples) -> Vec<f32> {
        let columns = self.shape.columns();
        let mut out = vec![0.0; batch.len() * self.shape.frames * columns];
        let embedding = &self.parameters[..self.shape.embedding.parameter_count()];
        let points = self.standard.points(batch);
        self.shape.embedding.forward(embedding, &points, &mut out, columns);
        let features = self.shape.embedding.features();
        for (i, row) in out.chunks_exact_mut(columns).enumerate() {
            if batch.present(i) {
                let channels = batch.channels(i);
                row[features..].iter_mut().zip(&self.shape.channels).for_each(|(slot, &c)| *slot = channels[c]);
            } else {
                row.fill(0.0);
            }
        }
        out
    }

    /// B x F x C standardised columns of `batch`.
    pub fn columns(&self, batch: &Samples) -> Vec<f32> {
        let mut columns = self.raw_columns(batch);
        self.standard.standardise_columns(batch, &mut columns);
        columns
    }

    /// B x I inputs of the dense layers for `batch`.
    pub fn inputs(&self, batch: &Samples) -> Vec<f32> {
        let columns = self.columns(batch);
        let framed = match &self.projection {
            Some(projection) => projection.apply(&columns),
            None => columns,
        };
        if self.shape.plain == 0 {
            return framed;
        }
        let (width, affine) = (self.shape.framed(), &self.standard.plain);
        let mut out = Vec::with_capacity(batch.len() * self.shape.inputs());
        for (i, row) in batch.rows().chunks_exact(self.shape.plain).enumerate() {
            out.extend_from_slice(&framed[i * width..(i + 1) * width]);
            let scaled = row.iter().zip(&affine.centre).zip(&affine.inverse_scale);
            out.extend(scaled.map(|((v, c), s)| (v - c) * s));
        }
        out
    }

    /// Raw outputs of the head (B x outputs) for `x` (B x I).
    pub fn forward<'a>(&self, x: &[f32], work: &'a mut Activations) -> &'a [f32] {
        work.hidden.resize(self.shape.hidden.len(), Vec::new());
        let rows = x.len() / self.shape.inputs();
        let layers = self.shape.layers();
        let last = layers.len() - 1;
        for (layer, ((inputs, outputs), (weights, biases))) in layers.into_iter().zip(self.shape.offsets()).enumerate()
        {
            let mut out = std::mem::take(if layer == last { &mut work.raw } else { &mut work.hidden[layer] });
            out.clear();
            let bias = &self.parameters[biases..biases + outputs];
            (0..rows).for_each(|_| out.extend_from_slice(bias));
            let below = if layer == 0 { x } else { &work.hidden[layer - 1] };
            let w = &self.parameters[weights..biases];
            gemm((rows, inputs, outputs), 1.0, below, Transpose::No, w, Transpose::Yes, 1.0, &mut out);
            if layer == last {
                if self.shape.skip {
                    let w = &self.parameters[biases + outputs..];
                    let shape = (rows, self.shape.inputs(), outputs);
                    gemm(shape, 1.0, x, Transpose::No, w, Transpose::Yes, 1.0, &mut out);
                }
                work.raw = out;
            } else {
                tanh(&mut out);
                work.hidden[layer] = out;
            }
        }
        &work.raw
    }

    /// Mean over the batch of weight times negative log density, in whitened coordinates, at `theta` (B x D, unit
    /// coordinates). Writes its gradient to `gradient`, one value for each parameter and zero for the embedding's. Returns the
    /// loss and its derivatives with respect to `x` (B x I).
    pub fn loss_and_gradient(
        &self,
        x: &[f32],
        theta: &[f64],
        weights: &[f64],
        work: &mut Activations,
        gradient: &mut [f32],
    ) -> (f64, Vec<f32>) {
        assert_eq!(gradient.len(), self.parameters.len(), "gradient of the network");
        self.forward(x, work);
        gradient.fill(0.0);
        let outputs = self.shape.head.outputs();
        let rows = weights.len();
        let mut by_raw = vec![0.0; rows * outputs];
        let mut total = 0.0;
        let d = self.shape.head.dimension;
        for (i, (raw, slot)) in work.raw.chunks_exact(outputs).zip(by_raw.chunks_exact_mut(outputs)).enumerate() {
            let weight = weights[i] / rows as f64;
            let v = self.standard.whiten(&theta[i * d..(i + 1) * d]);
            total += weight * self.shape.head.loss(raw, &v, weight, Some(slot));
        }
        (total, self.backward(x, work, by_raw, gradient))
    }

    /// Mixture over unit coordinates at the one track in `batch`. The sum of its weights is the inverse of its mass inside of
    /// the unit cube: the mean over networks is then a mean of truncated densities.
    pub fn mixture_parts(&self, batch: &Samples) -> Parts {
        let mut work = Activations::default();
        self.truncated_parts(self.forward(&self.inputs(batch), &mut work))
    }

    /// Mixture as [`Self::mixture_parts`], with the standard deviations of its components multiplied by `factors` (D) along the
    /// axes.
    fn widened_parts(&self, batch: &Samples, factors: &[f64]) -> Parts {
        let mut work = Activations::default();
        let raw = self.forward(&self.inputs(batch), &mut work);
        let own: Vec<f64> = raw.iter().map(|v| f64::from(*v)).collect();
        let shrink: Vec<f64> = factors.iter().map(|f| 1.0 / f).collect();
        // Linearised about the outputs themselves, the change is exact up to the bound of the bend.
        let changes = self.shape.head.scaled(&own, &shrink);
        let widened: Vec<f32> = own.iter().zip(changes).map(|(v, (factor, term))| (v * factor + term) as f32).collect();
        self.truncated_parts(&widened)
    }

    /// Mixture over unit coordinates for the raw outputs `raw` of one track, not truncated.
    fn parts(&self, raw: &[f32]) -> Parts {
        let (centre, scale) = self.standard.theta();
        self.shape.head.parts(raw, centre, scale)
    }

    /// Mixture over unit coordinates for the raw outputs `raw` of one track, with weights as in [`Self::mixture_parts`].
    fn truncated_parts(&self, raw: &[f32]) -> Parts {
        let lattice = Lattice::new(MASS_POINTS, self.shape.head.dimension);
        let (mut weights, means, covariances) = self.parts(raw);
        let mass = self.shape.head.log_mass(raw, &self.standard.support(), &lattice).exp();
        weights.iter_mut().for_each(|w| *w /= mass);
        (weights, means, covariances)
    }

    /// Writes the gradient of the dense layers and returns the derivatives with respect to `x`.
    fn backward(&self, x: &[f32], work: &Activations, by_raw: Vec<f32>, gradient: &mut [f32]) -> Vec<f32> {
        let inputs = self.shape.inputs();
        let rows = x.len() / inputs;
        let outputs = self.shape.head.outputs();
        let mut by_skip = vec![0.0; if self.shape.skip { rows * inputs } else { 0 }];
        if self.shape.skip {
            let first = self.parameters.len() - self.shape.skip_count();
            let by_weight = &mut gradient[first..];
            gemm((outputs, rows, inputs), 1.0, &by_raw, Transpose::Yes, x, Transpose::No, 0.0, by_weight);
            let w = &self.parameters[first..];
            gemm((rows, outputs, inputs), 1.0, &by_raw, Transpose::No, w, Transpose::No, 0.0, &mut by_skip);
        }
        let mut by_output = by_raw;
        let layers = self.shape.layers().into_iter().zip(self.shape.offsets()).enumerate();
        for (layer, ((inputs, outputs), (weights, biases))) in layers.rev() {
            let x = if layer == 0 { x } else { &work.hidden[layer - 1] };
            let by_weight = &mut gradient[weights..biases];
            gemm((outputs, rows, inputs), 1.0, &by_output, Transpose::Yes, x, Transpose::No, 0.0, by_weight);
            let by_bias = &mut gradient[biases..biases + outputs];
            for row in by_output.chunks_exact(outputs) {
                by_bias.iter_mut().zip(row).for_each(|(g, d)| *g += d);
            }
            let w = &self.parameters[weights..biases];
            let mut by_input = vec![0.0; rows * inputs];
            gemm((rows, outputs, inputs), 1.0, &by_output, Transpose::No, w, Transpose::No, 0.0, &mut by_input);
            if layer > 0 {
                // Derivative of tanh from its output.
                by_input.iter_mut().zip(x).for_each(|(d, y)| *d *= 1.0 - y * y);
            }
            by_output = by_input;
        }
        by_output.iter_mut().zip(&by_skip).for_each(|(d, s)| *d += s);
        by_output
    }

    /// Adds the gradient of the embedding's parameters to `gradient`, from the derivatives with respect to the inputs (B x I).
    pub fn embedding_gradient(&self, batch: &Samples, by_input: Vec<f32>, gradient: &mut [f32]) {
        let width = self.shape.framed();
        if width == 0 {
            return;
        }
        let rows = by_input.chunks_exact(self.shape.inputs());
        let framed = if self.shape.plain == 0 { by_input } else { rows.flat_map(|r| &r[..width]).copied().collect() };
        let mut by_column = match &self.projection {
            Some(projection) => projection.apply_transposed(&framed),
            None => framed,
        };
        self.standard.scale_gradient(batch, &mut by_column);
        let count = self.shape.embedding.parameter_count();
        let points = self.standard.points(batch);
        let columns = self.shape.columns();
        let parameters = &self.parameters[..count];
        self.shape.embedding.backward(parameters, &points, &by_column, columns, &mut gradient[..count]);
    }

    /// Weighted mean of the negative log density in nat, in unit coordinates, at `theta` (B x D) for `x` (B x I).
    pub fn loss(&self, x: &[f32], theta: &[f64], weights: &[f64], work: &mut Activations) -> f64 {
        let raw = self.forward(x, work);
        self.mean_loss(raw, theta, weights, |raw, v| self.shape.head.loss(raw, v, 1.0, None))
    }

    /// Weighted mean of the negative log density truncated to the unit cube in nat, for raw outputs of the head (B x outputs).
    pub fn truncated_loss(&self, raw: &[f32], theta: &[f64], weights: &[f64]) -> f64 {
        let (head, support) = (self.shape.head, self.standard.support());
        let lattice = Lattice::new(WATCH_POINTS, head.dimension);
        let loss = |raw: &[f32], v: &[f64]| head.loss(raw, v, 1.0, None) + head.log_mass(raw, &support, &lattice);
        self.mean_loss(raw, theta, weights, loss)
    }

    /// Weighted mean of `loss(raw outputs, whitened theta)`, converted to unit coordinates.
    fn mean_loss(&self, raw: &[f32], theta: &[f64], weights: &[f64], loss: impl Fn(&[f32], &[f64]) -> f64) -> f64 {
        let outputs = self.shape.head.outputs();
        let d = self.shape.head.dimension;
        let (mut sum, mut total) = (0.0, 0.0);
        for (i, raw) in raw.chunks_exact(outputs).enumerate() {
            sum += weights[i] * loss(raw, &self.standard.whiten(&theta[i * d..(i + 1) * d]));
            total += weights[i];
        }
        sum / total + self.standard.log_scale()
    }
}
