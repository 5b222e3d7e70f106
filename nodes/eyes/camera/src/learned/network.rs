//! Network from an image and two clicked colours to two masks.

use convnet::{Builder, Layer, Net, Pass, Shape};

use super::size::SIDE;
use crate::Error;

/// Channels of the input: the image, and its difference from the object's and from the target's colour.
const CHANNELS: usize = 9;
/// Number of the result's planes: object and target. Two more are there because kernels compute four at once before the last unpacking.
pub(crate) const MASKS: usize = 2;

/// Colours of the object and of the target at a click, RGB, 0 to 1.
pub type Clicked = [[f32; 3]; 2];

/// Trained weights.
pub type Weights = Vec<f32>;

/// Weights that `catenary train-segmenter` wrote with its defaults.
static SHIPPED: &[u8] = include_bytes!("../../weights/segmenter.bin");

/// Weights that are shipped.
///
/// # Panics
/// Never: a test reads them.
#[must_use]
pub fn shipped_weights() -> Weights {
    weights_of(SHIPPED).expect("the shipped weights are those of the network")
}

/// Weights of the bytes of a file.
///
/// # Errors
/// [`Error::Weights`] for another number of them, or for one that is not finite.
pub fn weights_of(bytes: &[u8]) -> Result<Weights, Error> {
    Ok(convnet::weights_of(&network(), bytes)?)
}

/// The network: a U-Net (Ronneberger et al. 2015) on blocks of 2 x 2 pixels, down to 16 x 16 places. Its result holds, for each pixel,
/// the log odds of object and target.
///
/// # Panics
/// Never: the layers fit one another.
#[must_use]
pub fn network() -> Net {
    let mut b = Builder::default();
    let input = b.add(Layer::Pack { from: 0 });
    let mixed = b.block(input, 12, 1);
    let fine = b.block(mixed, 12, 3);
    let down = b.add(Layer::Pack { from: fine });
    let mixed = b.block(down, 24, 1);
    let middle = b.block(mixed, 24, 3);
    let down = b.add(Layer::Pack { from: middle });
    let mixed = b.block(down, 40, 1);
    let coarse = b.block(mixed, 40, 3);
    let down = b.add(Layer::Pack { from: coarse });
    let mixed = b.block(down, 64, 1);
    let whole = b.block(mixed, 64, 3);
    let whole = b.block(whole, 64, 3);
    let up = b.up(whole, 24);
    let joined = b.add(Layer::Join { a: up, b: coarse });
    let joined = b.block(joined, 40, 3);
    let up = b.up(joined, 16);
    let joined = b.add(Layer::Join { a: up, b: middle });
    let joined = b.block(joined, 24, 3);
    let up = b.up(joined, 8);
    let joined = b.add(Layer::Join { a: up, b: fine });
    let joined = b.block(joined, 12, 3);
    b.up(joined, MASKS);
    b.net(Shape { channels: CHANNELS, height: SIDE, width: SIDE })
}

/// Writes the input of the network. `pixel` gives the colour of a pixel by its index.
pub(crate) fn fill(net: &Net, input: &mut [f32], clicked: &Clicked, pixel: impl Fn(usize) -> [f32; 3]) {
    let shape = net.shape(0);
    for v in 0..SIDE {
        let start = shape.row(0, v).start;
        for u in 0..SIDE {
            let rgb = pixel(v * SIDE + u);
            for c in 0..3 {
                let at = start + u;
                input[at + c * shape.plane()] = 2.0 * rgb[c] - 1.0;
                input[at + (3 + c) * shape.plane()] = 2.0 * (rgb[c] - clicked[0][c]);
                input[at + (6 + c) * shape.plane()] = 2.0 * (rgb[c] - clicked[1][c]);
            }
        }
    }
}

/// Log odds of a mask (0: object, 1: target) in row `v`.
pub(crate) fn row<'a>(net: &Net, pass: &'a Pass, mask: usize, v: usize) -> &'a [f32] {
    &pass.output()[net.output().row(mask, v)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shipped_weights_are_those_of_the_network_and_others_are_refused() {
        assert_eq!(shipped_weights().len(), network().weights());
        let message = weights_of(&[0; 8]).unwrap_err().to_string();
        assert!(message.contains("train-segmenter") && message.ends_with("got 8 bytes"), "{message}");
    }
}
