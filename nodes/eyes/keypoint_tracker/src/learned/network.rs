//! Networks of the trackers.

use super::grid::{KEYPOINTS, SIDE};
use crate::Error;
use convnet::{Builder, Layer, Net, Shape};

/// Channels of the first convolution. Deeper ones have two and four times as many.
const WIDTH: usize = 8;
/// Further convolutions of the ordered tracker, which must see the whole object to know a place along it.
const FURTHER: usize = 4;

/// Trained weights.
pub type Weights = Vec<f32>;

/// Network that finds the keypoints.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NetworkKind {
    /// Keypoints that a training without labels chose (Transporter, Kulkarni et al. 2019), as in the paper.
    Transporter,
    /// Keypoints at fixed fractions of the length, from the held end on.
    Ordered,
}

impl NetworkKind {
    /// Name in parameters and arguments.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Transporter => "transporter",
            Self::Ordered => "ordered",
        }
    }

    /// The network from a mask to heat maps.
    pub(super) fn heat_network(self) -> Net {
        let mut b = Builder::default();
        let mut last = encoder(&mut b);
        if self == Self::Ordered {
            for _ in 0..FURTHER {
                last = b.block(last, 4 * WIDTH, 3);
            }
        }
        b.add(Layer::Conv { from: last, channels: KEYPOINTS, side: 1, rectified: false });
        b.net(Shape { channels: 1, height: SIDE, width: SIDE })
    }
}

/// Weights that `catenary train-tracker` wrote with its defaults.
///
/// # Panics
/// Never: a test reads them.
#[must_use]
pub fn shipped_weights(kind: NetworkKind) -> Weights {
    let bytes: &[u8] = match kind {
        NetworkKind::Transporter => include_bytes!("../../weights/transporter.bin"),
        NetworkKind::Ordered => include_bytes!("../../weights/ordered.bin"),
    };
    weights_of(kind, bytes).expect("the shipped weights are those of the network")
}

/// Weights of the bytes of a file.
///
/// # Errors
/// [`Error::Weights`] for another number of them, or for one that is not finite.
pub fn weights_of(kind: NetworkKind, bytes: &[u8]) -> Result<Weights, Error> {
    convnet::weights_of(&kind.heat_network(), bytes).map_err(|fault| Error::Weights { network: kind.name(), fault })
}

/// Network from a mask to features of its cells.
pub(super) fn feature_network() -> Net {
    let mut b = Builder::default();
    encoder(&mut b);
    b.net(Shape { channels: 1, height: SIDE, width: SIDE })
}

/// Network from features of the cells back to the mask, in the first of its channels.
pub(super) fn decoder_network(features: Shape) -> Net {
    let mut b = Builder::default();
    let first = b.block(0, 4 * WIDTH, 3);
    let up = b.up(first, 2 * WIDTH);
    let middle = b.block(up, 2 * WIDTH, 3);
    let up = b.up(middle, WIDTH);
    let fine = b.block(up, WIDTH, 3);
    b.add(Layer::Conv { from: fine, channels: 4, side: 3, rectified: false });
    b.net(features)
}

/// Adds five convolutions from 64 x 64 pixels to 16 x 16 cells, as in the Transporter of Li et al. 2020 (v-cdn).
fn encoder(b: &mut Builder) -> usize {
    let fine = b.block(0, WIDTH, 3);
    let fine = b.block(fine, WIDTH, 3);
    let down = b.add(Layer::Pack { from: fine });
    let middle = b.block(down, 2 * WIDTH, 3);
    let middle = b.block(middle, 2 * WIDTH, 3);
    let down = b.add(Layer::Pack { from: middle });
    b.block(down, 4 * WIDTH, 3)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shipped_weights_are_those_of_the_networks() {
        for kind in [NetworkKind::Transporter, NetworkKind::Ordered] {
            assert_eq!(shipped_weights(kind).len(), kind.heat_network().weights());
            let message = weights_of(kind, &[0; 8]).unwrap_err().to_string();
            assert!(message.contains(kind.name()) && message.ends_with("got 8 bytes"), "{message}");
        }
        let features = feature_network().output();
        let picture = decoder_network(features).output();
        assert_eq!((features.width, picture.width), (16, 64));
    }
}
