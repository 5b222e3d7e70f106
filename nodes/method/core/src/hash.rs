//! Hash of bytes that is the same in every program and on every machine.

/// FNV-1a hash of 64 bits (Fowler, Noll and Vo).
pub fn fnv1a(bytes: impl IntoIterator<Item = u8>) -> u64 {
    // Offset basis and prime are the authors' own for 64 bits.
    let step = |hash: u64, byte: u8| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
    bytes.into_iter().fold(0xcbf2_9ce4_8422_2325, step)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Expected values: the authors' test vectors.
    #[test]
    fn the_hash_is_that_of_its_authors() {
        let of = |text: &str| fnv1a(text.bytes());
        assert_eq!([of(""), of("a"), of("foobar")], [0xcbf29ce484222325, 0xaf63dc4c8601ec8c, 0x85944171f73967e8]);
    }
}
