//! Encoding of MCAP records, for places at which the crate `mcap` cannot write them.

use std::collections::BTreeMap;

/// Appends a record: opcode, length, and the parts of its body.
pub(crate) fn record(out: &mut Vec<u8>, opcode: u8, parts: &[&[u8]]) {
    let body = parts.concat();
    out.push(opcode);
    out.extend_from_slice(&(body.len() as u64).to_le_bytes());
    out.extend_from_slice(&body);
}

/// Encodes bytes or text with their length in front.
pub(crate) fn list(bytes: impl AsRef<[u8]>) -> Vec<u8> {
    let bytes = bytes.as_ref();
    [&u32::try_from(bytes.len()).unwrap_or(u32::MAX).to_le_bytes(), bytes].concat()
}

/// Encodes a map from names to texts.
pub(crate) fn map(texts: &BTreeMap<String, String>) -> Vec<u8> {
    list(texts.iter().flat_map(|(key, text)| [list(key), list(text)].concat()).collect::<Vec<u8>>())
}
