//! Cross-check of the physics: the object as a finite-element soft body of rapier, a solid of linear tetrahedra in
//! double precision, behind the beam's trait.
//!
//! Does: simulate requests of the plain soft bar (a solid square section), on paths of the grip and on actions, from
//! the hanging start, over the table. Does not: simulate drag, tip mass, rest curvature, strands or overhang, start
//! from a measured shape, execute policies, or add camera noise. Such requests are refused.
//!
//! In tension, swing, damping and friction the solid agrees with the beam. In bending it does not. A linear tetrahedron
//! has one strain throughout, so that a layer of tetrahedra follows a bend only by shearing. The energy of this shear
//! counts as stiffness: shear locking. Locking falls slowly with the mesh and is equally strong at any Young's modulus.
//! A stretched bar has none, so that no other Young's modulus repairs both.
//!
//! Comparisons need Poisson's ratio 0 and the linear law. At a ratio of 0.45 the tetrahedra resist the change of
//! section along a bar that hangs at twice its length, by 8 % of its elongation. rapier's neo-Hookean law differs from
//! the beam's at such stretches: 15 % less elongation at that ratio.

mod bar;
mod mesh;
mod simulator;
#[cfg(test)]
mod tests;

pub use bar::{FemBar, FemDiscretisation, FemError};
pub use simulator::RapierFemSimulator;
