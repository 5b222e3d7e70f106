//! Geometry of a cross-section.

use catenary_core::model::Section;
use std::f64::consts::PI;

/// Section properties that a beam needs.
pub trait SectionProperties {
    /// Area A in m^2.
    fn area_m2(&self) -> f64;
    /// Second moment of area I about the axis across the plane of motion, in m^4.
    fn second_moment_m4(&self) -> f64;
    /// Distance from the centre line to the surface in the plane of motion, in m.
    fn half_height_m(&self) -> f64;
    /// Timoshenko's shear coefficient: effective share of the area in shear.
    fn shear_coefficient(&self) -> f64;
}

impl SectionProperties for Section {
    fn area_m2(&self) -> f64 {
        match *self {
            Section::Square { side_m } => side_m * side_m,
            Section::Round { diameter_m } => PI / 4.0 * diameter_m * diameter_m,
        }
    }

    fn second_moment_m4(&self) -> f64 {
        match *self {
            Section::Square { side_m } => side_m.powi(4) / 12.0,
            Section::Round { diameter_m } => PI / 64.0 * diameter_m.powi(4),
        }
    }

    fn half_height_m(&self) -> f64 {
        let (Section::Square { side_m: height_m } | Section::Round { diameter_m: height_m }) = *self;
        0.5 * height_m
    }

    fn shear_coefficient(&self) -> f64 {
        match self {
            // Energetic coefficients: 5/6 for a rectangle, 9/10 for a circle.
            Section::Square { .. } => 5.0 / 6.0,
            Section::Round { .. } => 9.0 / 10.0,
        }
    }
}
