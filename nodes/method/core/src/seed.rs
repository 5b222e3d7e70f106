//! Seeds of random streams. Each stream is derived from one seed and its own index, so results do not depend on the
//! order or the number of workers.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

/// Seed of stream `index` under `seed`: one round of SplitMix64 (Steele, Lea and Flood 2014) over both.
///
/// Different indices give unrelated streams. A pair gives the same seed on every machine.
pub fn derive(seed: u64, index: u64) -> u64 {
    // The factor of the index is large and odd: with a factor of 1, seed 3 index 1 would be seed 2 index 2.
    let mut z = seed.wrapping_add(0x9e37_79b9_7f4a_7c15).wrapping_add(index.wrapping_mul(0xd1b5_4a32_d192_ed03));
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// Random generator (ChaCha8) of stream `index` under `seed`. Every crate draws from this one.
pub fn rng(seed: u64, index: u64) -> ChaCha8Rng {
    ChaCha8Rng::seed_from_u64(derive(seed, index))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbouring_streams_differ_and_repeat() {
        let seeds: std::collections::HashSet<u64> =
            (0..1000).flat_map(|s| (0..100).map(move |i| derive(s, i))).collect();
        assert_eq!(seeds.len(), 100_000);
        assert_eq!(derive(7, 3), derive(7, 3));
    }
}
