//! Multilayer perceptron with tanh hidden layers and a linear output.

use crate::matrix::{Transpose, gemm, tanh};
use serde::Serialize;
use thiserror::Error;

/// Dense layer: `y = x W^T + b`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Layer {
    /// Number of inputs.
    pub inputs: usize,
    /// Number of outputs.
    pub outputs: usize,
    /// Weights W, `outputs` x `inputs`, row-major.
    pub weight: Vec<f32>,
    /// Biases b, `outputs` values.
    pub bias: Vec<f32>,
}

/// Reason for which layers make no network.
#[derive(Debug, Error, PartialEq)]
pub enum MlpError {
    /// No layers.
    #[error("a network needs at least one layer")]
    Empty,
    /// Layer whose weights do not match its own sizes, or whose inputs do not match the outputs before it.
    #[error("layer {layer}: expected {expected}, got {got}")]
    Shape {
        /// Index of the layer.
        layer: usize,
        /// Expected shape.
        expected: String,
        /// Given shape.
        got: String,
    },
    /// Layer with a weight or bias that is not finite.
    #[error("layer {0} holds a weight that is not finite")]
    NotFinite(usize),
}

/// Multilayer perceptron with tanh after every layer but the last.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Mlp {
    layers: Vec<Layer>,
}

impl Mlp {
    /// Builds a network from its layers, from the input to the output.
    ///
    /// # Errors
    /// [`MlpError`] if shapes do not fit or a number is not finite.
    pub fn new(layers: Vec<Layer>) -> Result<Self, MlpError> {
        if layers.is_empty() {
            return Err(MlpError::Empty);
        }
        for (i, l) in layers.iter().enumerate() {
            let shape = |expected: String, got: String| MlpError::Shape { layer: i, expected, got };
            if l.weight.len() != l.inputs * l.outputs || l.bias.len() != l.outputs {
                return Err(shape(
                    format!("{} x {} weights and {} biases", l.outputs, l.inputs, l.outputs),
                    format!("{} weights and {} biases", l.weight.len(), l.bias.len()),
                ));
            }
            if i > 0 && layers[i - 1].outputs != l.inputs {
                return Err(shape(format!("{} inputs", layers[i - 1].outputs), format!("{}", l.inputs)));
            }
            if !l.weight.iter().chain(&l.bias).all(|v| v.is_finite()) {
                return Err(MlpError::NotFinite(i));
            }
        }
        Ok(Self { layers })
    }

    /// Layers from the input to the output.
    pub fn layers(&self) -> &[Layer] {
        &self.layers
    }

    /// Layers for training in place. The caller must keep their shapes.
    pub fn layers_mut(&mut self) -> &mut [Layer] {
        &mut self.layers
    }

    /// Number of inputs.
    pub fn inputs(&self) -> usize {
        self.layers[0].inputs
    }

    /// Number of outputs.
    pub fn outputs(&self) -> usize {
        self.layers[self.layers.len() - 1].outputs
    }

    /// Computes the outputs (`batch` x outputs, row-major) for `x` (`batch` x inputs, row-major).
    ///
    /// # Panics
    /// If the length of `x` is not `batch` x inputs.
    pub fn forward(&self, x: &[f32], batch: usize) -> Vec<f32> {
        let mut current = x.to_vec();
        for (i, layer) in self.layers.iter().enumerate() {
            // The product is added to the biases, so they are the initial value of each row.
            let mut next: Vec<f32> = layer.bias.iter().copied().cycle().take(batch * layer.outputs).collect();
            let shape = (batch, layer.inputs, layer.outputs);
            gemm(shape, 1.0, &current, Transpose::No, &layer.weight, Transpose::Yes, 1.0, &mut next);
            if i + 1 < self.layers.len() {
                tanh(&mut next);
            }
            current = next;
        }
        current
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn forward_is_tanh_then_linear() {
        let hidden = Layer { inputs: 2, outputs: 1, weight: vec![1.0, -1.0], bias: vec![0.5] };
        let output = Layer { inputs: 1, outputs: 2, weight: vec![2.0, 3.0], bias: vec![0.0, 1.0] };
        let net = Mlp::new(vec![hidden, output]).unwrap();
        let h = (0.5f32 + 1.0 - 2.0).tanh();
        assert_eq!(net.forward(&[1.0, 2.0], 1), [2.0 * h, 3.0 * h + 1.0]);
    }

    #[test]
    fn refuses_layers_that_do_not_fit() {
        let l =
            |inputs, outputs| Layer { inputs, outputs, weight: vec![0.0; inputs * outputs], bias: vec![0.0; outputs] };
        assert!(matches!(Mlp::new(vec![l(2, 3), l(4, 1)]), Err(MlpError::Shape { layer: 1, .. })));
        assert_eq!(Mlp::new(vec![]), Err(MlpError::Empty));
        let mut bad = l(1, 1);
        bad.weight[0] = f32::NAN;
        assert_eq!(Mlp::new(vec![bad]), Err(MlpError::NotFinite(0)));
    }
}
