//! Planar, geometrically exact, extensible beam, held at one place by a gripper, over a table.
//!
//! Plane of motion: x to the right, z up, angles counter-clockwise from +x. SI units throughout.
//!
//! Each node carries x, z and the section's angle. Each element has two nodes and one integration point, with the
//! strains of [`BeamParameters`]. Time runs in fixed steps; each step minimises an incremental potential. The code is
//! pure `f64`: equal inputs give equal bits. Nothing is allocated after [`Beam::new`].
mod backward_difference;
mod block_tridiagonal;
mod body;
mod contact;
mod discretisation;
mod element;
mod error;
mod forces;
mod grip;
mod hysteresis;
mod material;
mod mesh;
mod neighbour;
mod node;
mod parameters;
mod potential;
mod section;
mod section_moment;
mod shape;
mod start;
mod state;
mod statics;
mod stepper;
mod strand_friction;
mod terms;
#[cfg(test)]
mod tests;
mod tip_load;

pub use body::{Beam, Counters};
pub use discretisation::{Discretisation, Scheme};
pub use error::BeamError;
pub use forces::{Energy, TableForce};
pub use grip::{GripReaction, GripState};
pub use parameters::{BeamParameters, Table};
pub use section::SectionProperties;
pub use start::StartChange;
pub use statics::{Equilibrium, MeasuredPoint};
pub use terms::{
    AgeingTerm, BendState, ElementMaterial, ElementPlace, ForceTerm, GripTerm, HystereticTerm, MaterialTerm,
    MomentTerm, PointState, Reply, Terms,
};
pub use tip_load::TipLoad;
