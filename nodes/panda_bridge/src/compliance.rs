//! Cartesian compliance settings.

use thiserror::Error;

/// Stiffness, damping and clip of a Cartesian impedance law, frame panda_link0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Compliance {
    /// N/m for x, y, z and N m/rad about x, y, z.
    pub stiffness: [f64; 6],
    /// N s/m and N m s/rad.
    pub damping: [f64; 6],
    /// Largest position error that the law acts on, m.
    pub error_clip_m: f64,
}

/// Limits of a Panda's impedance: translation in N/m, rotation in N m/rad.
const MAX_STIFFNESS: [f64; 2] = [3000.0, 300.0];
/// Limits of the damping: N s/m and N m s/rad.
const MAX_DAMPING: [f64; 2] = [200.0, 30.0];
/// Largest clip, m.
const MAX_CLIP_M: f64 = 0.1;

impl Default for Compliance {
    fn default() -> Self {
        Self {
            stiffness: [2000.0, 2000.0, 2000.0, 150.0, 150.0, 150.0],
            damping: [89.0, 89.0, 89.0, 7.0, 7.0, 7.0],
            error_clip_m: 0.01,
        }
    }
}

/// A value outside what the arm can do.
#[derive(Debug, Error, PartialEq)]
#[error("{field}: expected more than 0 and at most {limit}, got {got}")]
pub struct ComplianceError {
    /// The field with its index.
    pub field: String,
    /// Greatest value.
    pub limit: f64,
    /// The value.
    pub got: f64,
}

impl Compliance {
    /// Rejects values that are not positive or beyond the arm.
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
    fn what_the_arm_cannot_do_is_named() {
        assert_eq!(Compliance::default().check(), Ok(()));
        let mut c = Compliance::default();
        c.stiffness[4] = 400.0;
        assert_eq!(c.check().unwrap_err().to_string(), "stiffness[4]: expected more than 0 and at most 300, got 400");
        let c = Compliance { error_clip_m: f64::NAN, ..Compliance::default() };
        assert!(c.check().is_err());
    }
}
