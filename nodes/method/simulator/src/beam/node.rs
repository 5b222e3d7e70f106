//! Node of a beam.

/// Node: x in m, z in m and section angle in rad, or their rates.
pub(super) type Node = [f64; 3];
