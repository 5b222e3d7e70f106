//! Lists of layers, one after the other.

use crate::net::{Layer, Net, Shape};

/// Layers of a network that is being built.
#[derive(Debug, Clone, Default)]
pub struct Builder {
    layers: Vec<Layer>,
}

impl Builder {
    /// Adds a layer; returns the number of its value.
    pub fn add(&mut self, layer: Layer) -> usize {
        self.layers.push(layer);
        self.layers.len()
    }

    /// Adds a convolution that is normalised and rectified.
    pub fn block(&mut self, from: usize, channels: usize, side: usize) -> usize {
        let linear = self.add(Layer::Conv { from, channels, side, rectified: false });
        self.add(Layer::Norm { from: linear })
    }

    /// Adds twice the resolution, with `channels` channels.
    pub fn up(&mut self, from: usize, channels: usize) -> usize {
        let wide = self.add(Layer::Conv { from, channels: 4 * channels, side: 1, rectified: false });
        self.add(Layer::Unpack { from: wide })
    }

    /// Network of the layers.
    ///
    /// # Panics
    /// If the layers do not fit one another: lists of layers are written by hand.
    #[must_use]
    pub fn net(self, input: Shape) -> Net {
        Net::new(input, self.layers).expect("the layers fit one another")
    }
}
