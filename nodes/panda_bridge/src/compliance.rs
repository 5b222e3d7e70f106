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
/// Maximum error clip, m. Chosen, ten times the default.
const MAX_CLIP_M: f64 = 0.1;
/// Maximum steady force along an axis, stiffness times error clip, N. Chosen: twice the default threshold of a collision.
const MAX_FORCE_N: f64 = 80.0;
/// Minimum damping in square roots of the stiffness: a quarter of the default's 2 (critical for 1 kg, or 1 kg m^2). With less the arm
/// swings about its target.
const LEAST_DAMPING: f64 = 0.5;

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
#[error("{field}: expected more than {least} and at most {limit}, got {got}")]
pub struct ComplianceError {
    /// Field with its index.
    pub field: String,
    /// Value that is too small.
    pub least: f64,
    /// Maximum value.
    pub limit: f64,
    /// Requested value.
    pub got: f64,
}

impl Compliance {
    /// Checks all values.
    ///
    /// # Errors
    /// [`ComplianceError`] for the first value that is not positive or exceeds its limit, a damping that is too small for its
    /// stiffness, or a stiffness that pulls too hard with its error clip.
    pub fn check(&self) -> Result<(), ComplianceError> {
        let within = |field: String, got: f64, least: f64, limit: f64| {
            if got > least && got <= limit { Ok(()) } else { Err(ComplianceError { field, least, limit, got }) }
        };
        for i in 0..6 {
            within(format!("stiffness[{i}]"), self.stiffness[i], 0.0, MAX_STIFFNESS[i / 3])?;
            let least = LEAST_DAMPING * self.stiffness[i].sqrt();
            within(format!("damping[{i}]"), self.damping[i], least, MAX_DAMPING[i / 3])?;
        }
        within("error_clip".to_owned(), self.error_clip_m, 0.0, MAX_CLIP_M)?;
        for i in 0..3 {
            let force_n = self.stiffness[i] * self.error_clip_m;
            within(format!("stiffness[{i}] times error_clip"), force_n, 0.0, MAX_FORCE_N)?;
        }
        Ok(())
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

    #[test]
    fn a_spring_without_damping_and_one_that_pulls_too_hard_are_refused() {
        let mut c = Compliance::default();
        c.damping[1] = 1.0;
        assert!(c.check().unwrap_err().to_string().starts_with("damping[1]: expected more than 22.3"));
        let c = Compliance { error_clip_m: 0.05, ..Compliance::default() };
        assert_eq!(
            c.check().unwrap_err().to_string(),
            "stiffness[0] times error_clip: expected more than 0 and at most 80, got 100"
        );
        // The values of the first day with an arm.
        let soft = Compliance {
            stiffness: [400.0, 400.0, 400.0, 30.0, 30.0, 30.0],
            damping: [40.0, 40.0, 40.0, 3.0, 3.0, 3.0],
            error_clip_m: 0.03,
        };
        assert_eq!(soft.check(), Ok(()));
    }
}
