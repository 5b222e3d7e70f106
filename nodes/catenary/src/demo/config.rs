//! Model of the demo.

/// Model that the demo infers, trains and simulates with.
pub const MODEL: &str = include_str!("../../../../launch_configs/models/soft_bar_place.yaml");
/// Name of the model.
pub const MODEL_NAME: &str = "soft_bar_place";
