//! Checks of commands, of the measured arm and of contacts, which end a motion in a reflex.

pub mod arm;
pub mod contact;
pub mod limits;
pub mod self_collision;
pub mod standing;
