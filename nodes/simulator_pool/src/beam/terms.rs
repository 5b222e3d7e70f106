//! What may be added to a beam from outside: forces, materials and ways of holding that it does not know itself.

use super::body::GripState;
use super::forces::GripReaction;
use std::fmt;
use std::sync::Arc;

/// A piece of the beam in motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PointState {
    /// Time since the start in s.
    pub time_s: f64,
    /// Its place as a fraction of the rest length, from the grip (0) to the tip (1).
    pub fraction: f64,
    /// Rest length in m that it stands for.
    pub length_m: f64,
    /// (x, z) in m.
    pub position_m: [f64; 2],
    /// (x, z) in m/s.
    pub velocity_m_s: [f64; 2],
}

/// A force on every piece of the beam. It is taken where the piece is expected to be at the end of a time step, so it
/// must not be so stiff that it changes much within one.
pub trait ForceTerm: Send + Sync {
    /// Force (x, z) in N on a piece.
    fn force_n(&self, at: &PointState) -> [f64; 2];
}

/// What one element is made of.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ElementMaterial {
    /// EA in N, GA in N and EI in N m^2.
    pub stiffness: [f64; 3],
    /// Curvature at rest in 1/m.
    pub rest_curvature_per_m: f64,
    /// Mass per rest length in kg/m.
    pub mass_per_length_kg_m: f64,
}

/// A change of the material along the beam.
pub trait MaterialTerm: Send + Sync {
    /// Changes the element whose middle lies at `fraction` of the rest length, from the grip (0) to the tip (1).
    fn change(&self, fraction: f64, element: &mut ElementMaterial);
}

/// A change of how the beam is held.
pub trait GripTerm: Send + Sync {
    /// Changes the state of the clamped section at `time_s`, which bore `reaction` at the end of the last step.
    fn change(&self, time_s: f64, reaction: &GripReaction, grip: &mut GripState);
}

/// All that is added to one beam, in the order in which it acts.
#[derive(Clone, Default)]
pub struct Terms {
    /// Forces along the beam; they add up.
    pub forces: Vec<Arc<dyn ForceTerm>>,
    /// Changes of the material.
    pub materials: Vec<Arc<dyn MaterialTerm>>,
    /// Changes of the grip.
    pub grips: Vec<Arc<dyn GripTerm>>,
}

impl fmt::Debug for Terms {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { forces, materials, grips } = self;
        write!(f, "{} forces, {} materials, {} grips", forces.len(), materials.len(), grips.len())
    }
}
