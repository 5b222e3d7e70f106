//! Size of the network's input.

/// Side of the input, of a training picture and of its mask in pixels.
pub const SIDE: usize = 256;
