//! Cartesian compliance settings and their limits.

use thiserror::Error;

/// Stiffness, damping and error clip of a Cartesian impedance law, frame panda_link0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Compliance {
    /// Stiffness: N/m along x, y, z, then N m/rad about x, y, z.
    pub stiffness: [f64; 6],
    /// Damping: N s/m along x, y, z, then N m s/rad about x, y, z.
    pub damping: [f64; 6],
    /// Limit of the position error in the law, m.
    pub error_clip_m: f64,
}

/// Maximum stiffness of a Panda's Cartesian impedance: translation in N/m, rotation in N m/rad (libfranka, `setCartesianImpedance`).
const MAX_STIFFNESS: [f64; 2] = [3000.0, 300.0];
/// Maximum damping: translation in N s/m, rotation in N m s/rad. No published source: 2.2 times the default of translation,
/// 4.3 times that of rotation.
const MAX_DAMPING: [f64; 2] = [200.0, 30.0];
/// Maximum error clip, m. Chosen, ten times the default: at the maximum stiffness the spring then pulls with 300 N.
const MAX_CLIP_M: f64 = 0.1;

impl Default for Compliance {
    fn default() -> Self {
        Self {
            // The defaults of SERL's Cartesian impedance controller. Its steady force is at most 2000 N/m * 0.01 m = 20 N per axis.
            stiffness: [2000.0, 2000.0, 2000.0, 150.0, 150.0, 150.0],
            damping: [89.0, 89.0, 89.0, 7.0, 7.0, 7.0],
            error_clip_m: 0.01,
        }
    }
}

/// Value outside the limits of the arm.
#[derive(Debug, Error, PartialEq)]
#[error("{field}: expected more than 0 and at most {limit}, got {got}")]
pub struct ComplianceError {
    /// Field with its index.
    pub field: String,
    /// Maximum value.
    pub limit: f64,
    /// Requested value.
    pub got: f64,
}

impl Compliance {
    /// Checks all values.
    ///
    /// # Errors
    /// [`ComplianceError`] for the first value that is not positive or exceeds its limit.
    pub fn check(&self) -> Result<(), ComplianceError> {
        let within = |field: String, got: f64, limit: f64| {
            if got > 0.0 && got <= limit { Ok(()) } else { Err(ComplianceError { field, limit, got }) }
        };
        for i in 0..6 {
            within(format!("stiffness[{i}]"), self.stiffness[i], MAX_STIFFNESS[i / 3])?;
            within(format!("damping[{i}]"), self.damping[i], MAX_DAMPING[i / 3])?;
        }
        within("error_clip".to_owned(), self.error_clip_m, MAX_CLIP_M)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_beyond_the_limits_are_named() {
        assert_eq!(Compliance::default().check(), Ok(()));
        let mut c = Compliance::default();
        c.stiffness[4] = 400.0;
        assert_eq!(c.check().unwrap_err().to_string(), "stiffness[4]: expected more than 0 and at most 300, got 400");
        let c = Compliance { error_clip_m: f64::NAN, ..Compliance::default() };
        assert!(c.check().is_err());
    }
}
