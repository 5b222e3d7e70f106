//! Terms from outside: forces, materials and grips that are added to a beam.

use super::grip::{GripReaction, GripState};
use std::fmt;
use std::ops::Range;
use std::sync::Arc;

/// State of a piece of the beam in motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PointState {
    /// Time since the start in s.
    pub time_s: f64,
    /// Material coordinate: fraction of the rest length from the grip (0) to the tip (1).
    pub fraction: f64,
    /// Rest length of the piece in m.
    pub length_m: f64,
    /// (x, z) in m.
    pub position_m: [f64; 2],
    /// (x, z) in m/s.
    pub velocity_m_s: [f64; 2],
    /// Angle of the section from +x in rad, counter-clockwise.
    pub angle_rad: f64,
}

/// Force on every piece of the beam. It is evaluated at the predicted state at the end of a time step. Within the step it
/// changes by its [stiffness](Self::stiffness_n_m) alone: a force without one must not change much within a step.
pub trait ForceTerm: Send + Sync {
    /// Returns the force (x, z) in N on a piece.
    fn force_n(&self, at: &PointState) -> [f64; 2];

    /// Returns the couple in N m on a piece, counter-clockwise in the x-z plane.
    fn couple_n_m(&self, at: &PointState) -> f64 {
        let _ = at;
        0.0
    }

    /// Returns minus the symmetric derivative (xx, xz, zz) in N/m of the force by the position at the end of the step, where
    /// velocities follow positions at `rate_per_s`. It must have no negative eigenvalue. The step is then linearly implicit in the
    /// force, so that a stiff one, such as that of a wall, stays stable.
    fn stiffness_n_m(&self, at: &PointState, rate_per_s: f64) -> [f64; 3] {
        let _ = (at, rate_per_s);
        [0.0; 3]
    }
}

/// Place of one element along the beam.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ElementPlace {
    /// Ends, as fractions of the rest length from the grip (0) to the tip (1). Both are 0 behind the grip.
    pub span: [f64; 2],
    /// Rest length in m.
    pub length_m: f64,
}

impl ElementPlace {
    /// Returns the middle, as a fraction of the rest length.
    pub fn middle(&self) -> f64 {
        0.5 * (self.span[0] + self.span[1])
    }

    /// Returns whether the element holds the point at a fraction of the rest length. Exactly one element in front of the
    /// grip holds a point.
    pub fn holds(&self, fraction: f64) -> bool {
        let [from, to] = self.span;
        // The last element holds the tip itself.
        (from..to).contains(&fraction) || (fraction >= 1.0 && to >= 1.0)
    }

    /// Returns the share of the element that lies within a stretch of the beam.
    pub fn share_within(&self, stretch: &Range<f64>) -> f64 {
        let [from, to] = self.span;
        if to > from { self.overlap(stretch) / (to - from) } else { 0.0 }
    }

    /// Returns the share of a stretch of the beam that lies in the element. The shares of all elements add up to 1.
    pub fn share_of(&self, stretch: &Range<f64>) -> f64 {
        self.overlap(stretch) / (stretch.end - stretch.start)
    }

    fn overlap(&self, stretch: &Range<f64>) -> f64 {
        (self.span[1].min(stretch.end) - self.span[0].max(stretch.start)).max(0.0)
    }
}

/// Material of one element.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ElementMaterial {
    /// Axial stiffness EA in N, shear stiffness GA in N and bending stiffness EI in N m^2.
    pub stiffness: [f64; 3],
    /// Curvature at rest in 1/m.
    pub rest_curvature_per_m: f64,
    /// Mass per rest length in kg/m.
    pub mass_per_length_kg_m: f64,
}

/// Change of the material along the beam.
pub trait MaterialTerm: Send + Sync {
    /// Changes the element at `place`.
    fn change(&self, place: &ElementPlace, element: &mut ElementMaterial);
}

/// Change of the stiffness with time.
pub trait AgeingTerm: Send + Sync {
    /// Returns the factor on all stiffnesses at `time_s` since the start.
    fn stiffness_factor(&self, time_s: f64) -> f64;
}

/// Reply of a hysteretic moment to a change of curvature.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Reply {
    /// Integral of the moment over the change, in J/m.
    pub energy_j_m: f64,
    /// Moment in N m after the change.
    pub moment_n_m: f64,
    /// Derivative in N m^2 of the moment by the change. It must not be negative.
    pub stiffness_n_m2: f64,
}

/// Bending moment with memory, in addition to the elastic one. Each element remembers its moment; at the start and at rest
/// there is none.
pub trait HystereticTerm: Send + Sync {
    /// Returns the reply to a change of curvature in 1/m within a step that begins with `moment_n_m`.
    fn reply(&self, moment_n_m: f64, change_per_m: f64) -> Reply;
}

/// State of a section of the beam in motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BendState {
    /// Time since the start in s; 0 at rest.
    pub time_s: f64,
    /// Material coordinate: fraction of the rest length from the grip (0) to the tip (1).
    pub fraction: f64,
    /// Curvature less the rest curvature, in 1/m.
    pub curvature_per_m: f64,
    /// Its mean rate over the time step, in 1/(m s); 0 at rest.
    pub curvature_rate_per_m_s: f64,
}

/// Bending moment without memory, in addition to the elastic one. It acts at rest, too.
pub trait MomentTerm: Send + Sync {
    /// Returns the moment in N m with which a section resists: positive against a growing curvature. It must be smooth.
    fn moment_n_m(&self, at: &BendState) -> f64;
}

/// Change of the grip.
pub trait GripTerm: Send + Sync {
    /// Changes the state of the clamped section at `time_s`. `reaction` is its load at the end of the last step; there is none
    /// at the start.
    fn change(&self, time_s: f64, reaction: &GripReaction, grip: &mut GripState);
}

/// Terms from outside of one beam, in the order in which they act.
#[derive(Clone, Default)]
pub struct Terms {
    /// Forces along the beam. They add up.
    pub forces: Vec<Arc<dyn ForceTerm>>,
    /// Changes of the material.
    pub materials: Vec<Arc<dyn MaterialTerm>>,
    /// Changes of the grip.
    pub grips: Vec<Arc<dyn GripTerm>>,
    /// Changes of the stiffness with time. Their factors multiply.
    pub ageings: Vec<Arc<dyn AgeingTerm>>,
    /// Bending moments with memory. They add up.
    pub hystereses: Vec<Arc<dyn HystereticTerm>>,
    /// Bending moments without memory. They add up.
    pub moments: Vec<Arc<dyn MomentTerm>>,
}

impl fmt::Debug for Terms {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { forces, materials, grips, ageings, hystereses, moments } = self;
        let [forces, materials, grips] = [forces.len(), materials.len(), grips.len()];
        let [ageings, hystereses, moments] = [ageings.len(), hystereses.len(), moments.len()];
        write!(
            f,
            "{forces} forces, {materials} materials, {grips} grips, {ageings} ageings, {hystereses} hystereses, {moments} moments"
        )
    }
}
