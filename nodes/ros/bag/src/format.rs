//! Format of a bag folder: `metadata.yaml`, QoS profiles, MCAP records, and the reserve file.

pub(crate) mod metadata;
pub(crate) mod profile;
pub(crate) mod records;
pub(crate) mod reserve;
