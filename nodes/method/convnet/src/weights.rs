//! Weights as bytes.

use crate::net::Net;
use thiserror::Error;

/// Reason for which bytes are not the weights of a network.
#[derive(Debug, Error, Clone, PartialEq, Eq)]
#[error("expected {expected} finite numbers of 4 bytes, got {got}")]
pub struct WeightsError {
    /// Number of the network's weights.
    pub expected: usize,
    /// Bytes or number that were given.
    pub got: String,
}

/// Weights as little-endian numbers of 32 bits.
#[must_use]
pub fn bytes_of(weights: &[f32]) -> Vec<u8> {
    weights.iter().flat_map(|w| w.to_le_bytes()).collect()
}

/// Weights of a network from the bytes of a file.
///
/// # Errors
/// [`WeightsError`] for another number of them, or for one that is not finite.
pub fn weights_of(net: &Net, bytes: &[u8]) -> Result<Vec<f32>, WeightsError> {
    let expected = net.weights();
    let (numbers, rest) = bytes.as_chunks::<4>();
    if numbers.len() != expected || !rest.is_empty() {
        return Err(WeightsError { expected, got: format!("{} bytes", bytes.len()) });
    }
    let weights: Vec<f32> = numbers.iter().map(|b| f32::from_le_bytes(*b)).collect();
    match weights.iter().position(|w| !w.is_finite()) {
        Some(at) => Err(WeightsError { expected, got: format!("{} as number {}", weights[at], at + 1) }),
        None => Ok(weights),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::net::{Layer, Shape};

    #[test]
    fn weights_survive_their_bytes_and_wrong_ones_are_refused() {
        let conv = Layer::Conv { from: 0, channels: 4, side: 1, rectified: false };
        let net = Net::new(Shape { channels: 1, height: 2, width: 16 }, vec![conv]).unwrap();
        let weights: Vec<f32> = (0..net.weights()).map(|k| k as f32 - 2.5).collect();
        assert_eq!(weights_of(&net, &bytes_of(&weights)), Ok(weights.clone()));
        let message = weights_of(&net, &[0; 6]).unwrap_err().to_string();
        assert!(message.starts_with("expected 8 finite") && message.ends_with("got 6 bytes"), "{message}");
        let mut bytes = bytes_of(&weights);
        bytes[4..8].copy_from_slice(&f32::NAN.to_le_bytes());
        let message = weights_of(&net, &bytes).unwrap_err().to_string();
        assert!(message.ends_with("NaN as number 2"), "{message}");
    }
}
