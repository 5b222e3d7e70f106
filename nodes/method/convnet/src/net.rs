//! Networks as lists of layers.

use rand::Rng;
use rand_distr::{Distribution, StandardNormal};
use std::ops::Range;
use thiserror::Error;

/// Pixels that a kernel takes at once: widths are multiples of it.
pub(crate) const LANES: usize = 16;
/// Output channels that a kernel computes at once: channels of a convolution are multiples of it.
pub(crate) const BLOCK: usize = 4;

/// Size of a value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shape {
    /// Number of planes.
    pub channels: usize,
    /// Rows of a plane.
    pub height: usize,
    /// Columns of a plane.
    pub width: usize,
}

impl Shape {
    /// Numbers from one row to the next, with the border.
    #[must_use]
    pub fn step(&self) -> usize {
        self.width + 2
    }

    /// Numbers of a plane, with the border.
    #[must_use]
    pub fn plane(&self) -> usize {
        (self.height + 2) * self.step()
    }

    /// Numbers of the value, with the borders.
    #[must_use]
    pub fn len(&self) -> usize {
        self.channels * self.plane()
    }

    /// Always false: a network has no empty value.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Place of row `v` of a channel, without its border.
    #[must_use]
    pub fn row(&self, channel: usize, v: usize) -> Range<usize> {
        let start = channel * self.plane() + (v + 1) * self.step() + 1;
        start..start + self.width
    }
}

/// Layer of a network. `from`, `a` and `b` are numbers of earlier values: 0 is the input, k the result of the k-th layer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Layer {
    /// Convolution with a bias, of the same height and width.
    Conv {
        /// Value that it takes.
        from: usize,
        /// Number of its output channels, a multiple of 4.
        channels: usize,
        /// Side of its kernel, 1 or 3.
        side: usize,
        /// True: negative results become 0.
        rectified: bool,
    },
    /// Mean 0 and variance 1 over all channels, then scale and shift by channel, then negative results become 0.
    Norm {
        /// Value that it takes.
        from: usize,
    },
    /// Channels of both values.
    Join {
        /// First value.
        a: usize,
        /// Second value.
        b: usize,
    },
    /// Sum of both values.
    Add {
        /// First value.
        a: usize,
        /// Second value.
        b: usize,
    },
    /// 2 x 2 pixels of a channel become four channels.
    Pack {
        /// Value that it takes.
        from: usize,
    },
    /// Four channels become 2 x 2 pixels of one.
    Unpack {
        /// Value that it takes.
        from: usize,
    },
}

/// Reason for which a list of layers is no network.
#[derive(Debug, Error, Clone, PartialEq, Eq)]
#[error("layer {layer}: expected {expected}, got {got}")]
pub struct NetError {
    /// Number of the layer, from 1; 0 for the input.
    pub layer: usize,
    /// What the layer needs.
    pub expected: &'static str,
    /// What it has.
    pub got: String,
}

/// Network: layers with their shapes and the places of their weights.
#[derive(Debug, Clone)]
pub struct Net {
    layers: Vec<Layer>,
    shapes: Vec<Shape>,
    places: Vec<Range<usize>>,
}

impl Net {
    /// Builds a network for inputs of a shape.
    ///
    /// # Errors
    /// [`NetError`] if a layer takes a value that does not exist or does not fit.
    pub fn new(input: Shape, layers: Vec<Layer>) -> Result<Self, NetError> {
        let mut shapes = vec![input];
        let mut places: Vec<Range<usize>> = Vec::new();
        let fault = |layer, expected, got: String| Err(NetError { layer, expected, got });
        if input.is_empty() || input.channels == 0 || !input.width.is_multiple_of(LANES) {
            return fault(0, "a width that is a multiple of 16", format!("{input:?}"));
        }
        for (k, layer) in layers.iter().enumerate() {
            let number = k + 1;
            let from = match *layer {
                Layer::Conv { from, .. } | Layer::Norm { from } | Layer::Pack { from } | Layer::Unpack { from } => {
                    [from; 2]
                }
                Layer::Join { a, b } | Layer::Add { a, b } => [a, b],
            };
            let [Some(&s), Some(&other)] = from.map(|f| shapes.get(f)) else {
                return fault(number, "the number of an earlier value", format!("{from:?}"));
            };
            let (shape, weights) = match *layer {
                Layer::Conv { channels, side, .. } => {
                    if channels % BLOCK != 0 || channels == 0 || !(side == 1 || side == 3) {
                        return fault(
                            number,
                            "channels in a multiple of 4, and a side of 1 or 3",
                            format!("{layer:?}"),
                        );
                    }
                    (Shape { channels, ..s }, channels * (s.channels * side * side + 1))
                }
                Layer::Norm { .. } => (s, 2 * s.channels),
                Layer::Join { .. } if [s.height, s.width] == [other.height, other.width] => {
                    (Shape { channels: s.channels + other.channels, ..s }, 0)
                }
                Layer::Add { .. } if s == other => (s, 0),
                Layer::Pack { .. } if s.height % 2 == 0 && s.width % (2 * LANES) == 0 => {
                    (Shape { channels: 4 * s.channels, height: s.height / 2, width: s.width / 2 }, 0)
                }
                Layer::Unpack { .. } if s.channels % 4 == 0 => {
                    (Shape { channels: s.channels / 4, height: 2 * s.height, width: 2 * s.width }, 0)
                }
                _ => return fault(number, "values of fitting shapes", format!("{s:?} and {other:?}")),
            };
            let start = places.last().map_or(0, |place| place.end);
            places.push(start..start + weights);
            shapes.push(shape);
        }
        Ok(Self { layers, shapes, places })
    }

    /// Layers in order.
    #[must_use]
    pub fn layers(&self) -> &[Layer] {
        &self.layers
    }

    /// Shape of value `k`; 0 is the input.
    #[must_use]
    pub fn shape(&self, k: usize) -> Shape {
        self.shapes[k]
    }

    /// Shape of the last value.
    #[must_use]
    pub fn output(&self) -> Shape {
        self.shapes[self.layers.len()]
    }

    /// Number of weights.
    #[must_use]
    pub fn weights(&self) -> usize {
        self.places.last().map_or(0, |place| place.end)
    }

    /// Place of the weights of layer `k`, from 0.
    pub(crate) fn place(&self, k: usize) -> Range<usize> {
        self.places[k].clone()
    }

    /// Weights before training: normal with variance 2 / inputs of a neuron (He et al. 2015), biases 0, scales 1.
    pub fn initial(&self, rng: &mut impl Rng) -> Vec<f32> {
        let mut weights = vec![0.0; self.weights()];
        for (k, layer) in self.layers.iter().enumerate() {
            let part = &mut weights[self.places[k].clone()];
            match *layer {
                Layer::Conv { from, channels, side, .. } => {
                    let inputs = self.shapes[from].channels * side * side;
                    let deviation = (2.0 / inputs as f32).sqrt();
                    for weight in &mut part[..channels * inputs] {
                        let draw: f32 = StandardNormal.sample(rng);
                        *weight = deviation * draw;
                    }
                }
                Layer::Norm { .. } => {
                    let half = part.len() / 2;
                    part[..half].fill(1.0);
                }
                _ => {}
            }
        }
        weights
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_layer_that_does_not_fit_is_refused_with_its_number() {
        let input = Shape { channels: 3, height: 32, width: 32 };
        let conv = |from, channels, side| Layer::Conv { from, channels, side, rectified: true };
        let fault = |layers: Vec<Layer>| Net::new(input, layers).unwrap_err().layer;
        assert_eq!(fault(vec![conv(1, 4, 3)]), 1);
        assert_eq!(fault(vec![conv(0, 4, 3), conv(1, 6, 3)]), 2);
        assert_eq!(fault(vec![conv(0, 4, 2)]), 1);
        assert_eq!(fault(vec![Layer::Pack { from: 0 }, Layer::Add { a: 0, b: 1 }]), 2);
        assert_eq!(fault(vec![Layer::Pack { from: 0 }, Layer::Pack { from: 1 }]), 2);
        assert_eq!(fault(vec![Layer::Unpack { from: 0 }]), 1);
        assert_eq!(Net::new(Shape { width: 20, ..input }, vec![]).unwrap_err().layer, 0);
        let net = Net::new(input, vec![conv(0, 4, 3), Layer::Norm { from: 1 }, Layer::Pack { from: 2 }]).unwrap();
        assert_eq!((net.weights(), net.output().channels, net.output().width), (4 * 28 + 8, 16, 16));
    }
}
