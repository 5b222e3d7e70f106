//! Fingerprints: numbers that identify values in caches, journals and saved states.

use serde::Serialize;
use sha2::{Digest, Sha256};

/// Fingerprint of `value`: the first eight bytes, little-endian, of the SHA-256 hash of its `postcard`
/// encoding.
///
/// Equal values have equal fingerprints in every program and on every machine. The encoding holds every bit of a
/// number, the order of fields and the number of a variant, and no names. Adding, removing or reordering fields
/// therefore changes the fingerprints of a type; a saved fingerprint is then no longer found, which is safe.
///
/// Pass a tuple to identify several values together. The encoding does not show which field was left out by
/// `skip_serializing_if`: pass such fields beside the value, those of a model by [`crate::Model::left_out`].
///
/// # Panics
/// If `Serialize` fails for the value, as for an iterator of unknown length. The types of this crate never do.
pub fn fingerprint<T: Serialize + ?Sized>(value: &T) -> u64 {
    let encoded = postcard::to_stdvec(value).expect("the value can be serialised, by the contract of this function");
    let digest = Sha256::digest(&encoded);
    u64::from_le_bytes(std::array::from_fn(|i| digest[i]))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Expected value: the hash of the empty encoding, which starts with e3b0c44298fc1c14.
    #[test]
    fn the_fingerprint_of_nothing_is_the_hash_of_no_bytes() {
        assert_eq!(fingerprint(&()), 0x141c_fc98_42c4_b0e3);
    }

    #[test]
    fn every_bit_and_every_boundary_counts() {
        let different = [
            fingerprint(&(0.0, 1.0)),
            fingerprint(&(-0.0, 1.0)),
            fingerprint(&(0.0, 1.0 + f64::EPSILON)),
            fingerprint(&(vec![0.0], vec![1.0])),
            fingerprint(&(vec![0.0, 1.0], Vec::<f64>::new())),
            fingerprint(&("ab", "c")),
            fingerprint(&("a", "bc")),
        ];
        let known: std::collections::HashSet<u64> = different.into_iter().collect();
        assert_eq!(known.len(), different.len());
    }
}
