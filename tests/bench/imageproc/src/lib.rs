//! Comparison of the mask operations with those of imageproc; see `benches/masks.rs`.
