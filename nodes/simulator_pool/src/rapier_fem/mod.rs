//! A second opinion on the physics: the object as a finite-element soft body of rapier, a solid of linear tetrahedra in
//! double precision, behind the same trait as the beam.
//!
//! Does: simulate requests of the plain soft bar (a solid square section) on paths of the grip and on actions, from the
//! hanging start, over the table.
//! Does not: have what the beam adds to a plain bar (drag, tip mass, rest curvature, strands, overhang), start from a
//! measured shape, execute policies, or add camera noise: such requests are refused.
//!
//! It stands and falls with its element. In tension, swinging, damping and friction it agrees with the beam; in bending it
//! does not. A linear tetrahedron has one strain throughout, so a layer of them can follow a bend only by shearing, and the
//! energy of that shear counts as stiffness. This locking fades slowly with the mesh and is as strong at any Young's modulus,
//! but a stretched bar has none of it: no other Young's modulus repairs both.
//!
//! Comparisons want Poisson's ratio 0 and the linear law. At a ratio of 0.45 the tetrahedra resist the change of section
//! along a bar that hangs at twice its length, by 8 % of its elongation; and rapier's neo-Hookean law is not the beam's at
//! such stretches: 15 % less elongation at that ratio.

mod bar;
mod mesh;
mod simulator;
#[cfg(test)]
mod tests;

pub use bar::{FemBar, FemDivision, FemError};
pub use simulator::RapierFemSimulator;
