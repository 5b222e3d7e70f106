//! Multilayer perceptron with a hand-written gradient.

use catenary_core::Mlp;
use catenary_core::matrix::{Transpose, gemm, tanh};
use catenary_core::mlp::Layer;
use nalgebra::DMatrix;
use rand::{Rng, RngExt};
use rand_distr::StandardNormal;

/// Multilayer perceptron with the activations and gradients of its last batch.
#[derive(Debug, Clone)]
pub struct Network {
    /// Layers of the perceptron.
    pub mlp: Mlp,
    /// Gradient of each layer, in the layer's own shape.
    pub gradients: Vec<Layer>,
    /// Input of each layer (`batch` x inputs) and output of the last layer.
    activations: Vec<Vec<f32>>,
    /// Derivatives by the outputs of the current layer of a backward pass.
    delta: Vec<f32>,
    /// Derivatives with respect to the inputs of the current layer.
    next_delta: Vec<f32>,
}

impl Network {
    /// Builds a network with the layer sizes `sizes`. Weights are orthogonal (Saxe et al. 2014) with a gain of sqrt(2) in
    /// hidden layers and of `output_gain` in the last. Biases are zero.
    pub fn new<R: Rng>(sizes: &[usize], output_gain: f32, rng: &mut R) -> Self {
        let last = sizes.len() - 2;
        let layers: Vec<Layer> = sizes
            .windows(2)
            .enumerate()
            .map(|(i, pair)| {
                let gain = if i == last { output_gain } else { std::f32::consts::SQRT_2 };
                Layer {
                    inputs: pair[0],
                    outputs: pair[1],
                    weight: orthogonal(pair[1], pair[0], gain, rng),
                    bias: vec![0.0; pair[1]],
                }
            })
            .collect();
        let gradients = layers.clone();
        let activations = vec![Vec::new(); layers.len() + 1];
        let mlp = Mlp::new(layers).expect("sizes fit by construction and orthogonal weights are finite");
        Self { mlp, gradients, activations, delta: Vec::new(), next_delta: Vec::new() }
    }

    /// Outputs (`batch` x outputs, row-major) for `x` (`batch` x inputs). Keeps the activations for [`Network::backward`].
    pub fn forward(&mut self, x: &[f32], batch: usize) -> &[f32] {
        self.activations[0].clear();
        self.activations[0].extend_from_slice(x);
        let count = self.mlp.layers().len();
        for (i, layer) in self.mlp.layers().iter().enumerate() {
            let (before, after) = self.activations.split_at_mut(i + 1);
            let output = &mut after[0];
            output.clear();
            for _ in 0..batch {
                output.extend_from_slice(&layer.bias);
            }
            let shape = (batch, layer.inputs, layer.outputs);
            gemm(shape, 1.0, &before[i], Transpose::No, &layer.weight, Transpose::Yes, 1.0, output);
            if i + 1 < count {
                tanh(output);
            }
        }
        &self.activations[count]
    }

    /// Writes the gradients of a loss whose derivatives by the last outputs are `d_output` (`batch` x outputs).
    pub fn backward(&mut self, d_output: &[f32], batch: usize) {
        self.delta.clear();
        self.delta.extend_from_slice(d_output);
        for i in (0..self.mlp.layers().len()).rev() {
            let layer = &self.mlp.layers()[i];
            let gradient = &mut self.gradients[i];
            let shape = (layer.outputs, batch, layer.inputs);
            gemm(
                shape,
                1.0,
                &self.delta,
                Transpose::Yes,
                &self.activations[i],
                Transpose::No,
                0.0,
                &mut gradient.weight,
            );
            gradient.bias.fill(0.0);
            for row in self.delta.chunks_exact(layer.outputs) {
                for (g, d) in gradient.bias.iter_mut().zip(row) {
                    *g += d;
                }
            }
            // Nobody needs the derivative by the observations.
            if i == 0 {
                return;
            }
            self.next_delta.clear();
            self.next_delta.resize(batch * layer.inputs, 0.0);
            let shape = (batch, layer.outputs, layer.inputs);
            gemm(shape, 1.0, &self.delta, Transpose::No, &layer.weight, Transpose::No, 0.0, &mut self.next_delta);
            for (d, a) in self.next_delta.iter_mut().zip(&self.activations[i]) {
                // Derivative of tanh by its input, from its output.
                *d *= 1.0 - a * a;
            }
            std::mem::swap(&mut self.delta, &mut self.next_delta);
        }
    }
}

/// Random `rows` x `columns` matrix, row-major, whose rows or columns are orthonormal times `gain`: the QR decomposition of
/// a Gaussian matrix, uniformly distributed (Mezzadri 2007).
fn orthogonal<R: Rng>(rows: usize, columns: usize, gain: f32, rng: &mut R) -> Vec<f32> {
    let (tall, short) = (rows.max(columns), rows.min(columns));
    let normal = DMatrix::<f64>::from_fn(tall, short, |_, _| rng.sample(StandardNormal));
    let qr = normal.qr();
    let (mut q, r) = (qr.q(), qr.r());
    for j in 0..short {
        // A positive diagonal of R makes the decomposition unique and the distribution uniform.
        let sign = r[(j, j)].signum();
        q.column_mut(j).iter_mut().for_each(|v| *v *= sign);
    }
    let at = |i: usize, j: usize| if rows >= columns { q[(i, j)] } else { q[(j, i)] };
    (0..rows * columns).map(|k| gain * at(k / columns, k % columns) as f32).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use catenary_core::seed;

    #[test]
    fn gradients_agree_with_finite_differences() {
        let mut net = Network::new(&[3, 5, 4, 2], 1.0, &mut seed::rng(1, 0));
        let x: Vec<f32> = (0..12).map(|i| (i as f32 * 0.7).sin()).collect();
        let loss = |net: &mut Network| -> f32 {
            net.forward(&x, 4).iter().enumerate().map(|(i, y)| (i as f32 + 1.0) * y * y).sum()
        };
        loss(&mut net);
        let y = net.forward(&x, 4).to_vec();
        let d: Vec<f32> = y.iter().enumerate().map(|(i, y)| 2.0 * (i as f32 + 1.0) * y).collect();
        net.backward(&d, 4);
        let gradients = net.gradients.clone();
        for layer in 0..3 {
            for k in 0..gradients[layer].weight.len() {
                let h = 1e-2;
                let mut shifted = net.clone();
                shifted.mlp.layers_mut()[layer].weight[k] += h;
                let up = loss(&mut shifted);
                shifted.mlp.layers_mut()[layer].weight[k] -= 2.0 * h;
                let numeric = (up - loss(&mut shifted)) / (2.0 * h);
                let analytic = gradients[layer].weight[k];
                assert!(
                    (numeric - analytic).abs() < 2e-2 * (1.0 + analytic.abs()),
                    "layer {layer}, weight {k}: {numeric} against {analytic}"
                );
            }
        }
    }

    #[test]
    fn initial_weights_are_orthogonal() {
        let w = orthogonal(3, 5, 2.0, &mut seed::rng(2, 0));
        for i in 0..3 {
            for j in 0..3 {
                let dot: f32 = (0..5).map(|k| w[5 * i + k] * w[5 * j + k]).sum();
                let expected = if i == j { 4.0 } else { 0.0 };
                assert!((dot - expected).abs() < 1e-5, "rows {i} and {j}: {dot}");
            }
        }
    }

    #[test]
    fn forward_agrees_with_the_policy_that_is_saved() {
        let mut net = Network::new(&[12, 8, 2], 0.5, &mut seed::rng(3, 0));
        let x: Vec<f32> = (0..24).map(|i| i as f32 * 0.1).collect();
        let trained = net.forward(&x, 2).to_vec();
        assert_eq!(trained, net.mlp.forward(&x, 2));
    }
}
