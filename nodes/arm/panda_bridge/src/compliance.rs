//! Cartesian compliance settings and their limits.

use crate::kinematics::JOINTS;
use crate::speed::{REFERENCE_TIME_S, SpeedLimit};
use catenary_core::model::{ArmLaw, Impedance};
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
/// Limit of the rotation error in the law: the sine of half the angle, so that 0.05 is 0.1 rad (SERL).
pub const ROTATION_CLIP: f64 = 0.05;
/// Share of a collision threshold that the steady force may reach. Chosen: the robot's estimate of the force in free air is off by a few
/// newtons, and counts the force that accelerates the arm.
const THRESHOLD_SHARE: f64 = 0.8;
/// Lever of a force at the hand about the first four joints, m: a Panda reaches 0.855 m.
const LEVER_M: f64 = 0.8;
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

/// Spring that could pull harder than a collision threshold allows.
#[derive(Debug, Error, PartialEq)]
#[error(
    "{field} exert up to {got:.1} {unit}: expected at most {limit:.1} {unit}, {share} of the collision threshold of {threshold} {unit} ({parameter}). The arm would stop by a reflex in free air: lower the stiffness or the clip, or raise the threshold",
    share = THRESHOLD_SHARE
)]
pub struct BeyondThreshold {
    /// Fields whose product is too large.
    pub field: String,
    /// Greatest steady force (N), moment or torque (N m).
    pub got: f64,
    /// Maximum.
    pub limit: f64,
    /// Threshold of the robot.
    pub threshold: f64,
    /// Parameter of that threshold.
    pub parameter: String,
    /// Unit of the numbers.
    pub unit: &'static str,
}

impl Compliance {
    /// Law in the terms of a model, for motions in the plane of x and z, of an arm that follows targets at most at `speed`. The model has one
    /// stiffness and one damping: those along x. Mass and friction of the arm are unknown here: they keep the model's defaults.
    #[must_use]
    pub fn arm_law(&self, speed: &SpeedLimit) -> ArmLaw {
        ArmLaw::Impedance(Impedance {
            stiffness_n_m: self.stiffness[0],
            damping_n_s_m: self.damping[0],
            clip_m: self.error_clip_m,
            reference_time_constant_s: REFERENCE_TIME_S,
            // A model states no infinite limit.
            max_speed_m_s: Some(speed.linear_m_s).filter(|limit| limit.is_finite()),
            ..Impedance::default()
        })
    }

    /// Checks that the spring cannot pull as hard as the thresholds at which the robot stops by a reflex: force and moment at the hand
    /// (N, N m), and joint torques (N m). One axis at its clip is assumed: a hand that is held back along a diagonal may load the first
    /// joints by up to 1.7 times as much.
    ///
    /// # Errors
    /// [`BeyondThreshold`] for the first axis or joint that exceeds 0.8 of its threshold.
    pub fn check_thresholds(&self, wrench: &[f64; 6], torque_n_m: &[f64; JOINTS]) -> Result<(), BeyondThreshold> {
        let within = |field: String, got: f64, threshold: f64, parameter: String, unit: &'static str| {
            let limit = THRESHOLD_SHARE * threshold;
            if got <= limit { Ok(()) } else { Err(BeyondThreshold { field, got, limit, threshold, parameter, unit }) }
        };
        let mut greatest_n = 0.0_f64;
        for i in 0..6 {
            let (clip, unit) = if i < 3 { (self.error_clip_m, "N") } else { (ROTATION_CLIP, "N m") };
            let (got, parameter) = (self.stiffness[i] * clip, format!("fci.collision_wrench[{i}]"));
            within(format!("stiffness[{i}] and an error clip of {clip}"), got, wrench[i], parameter, unit)?;
            greatest_n = if i < 3 { greatest_n.max(got) } else { greatest_n };
        }
        for (i, threshold) in torque_n_m.iter().take(4).enumerate() {
            let field = format!("stiffness and an error clip of {} m at a lever of {LEVER_M} m", self.error_clip_m);
            within(field, LEVER_M * greatest_n, *threshold, format!("fci.collision_torque[{i}]"), "N m")?;
        }
        Ok(())
    }

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
    fn gains_are_a_models_law_along_x() {
        let clipped = Compliance { error_clip_m: 0.02, ..Compliance::default() };
        let slow = SpeedLimit { linear_m_s: 0.1, ..SpeedLimit::default() };
        let law = |speed: &SpeedLimit| {
            let ArmLaw::Impedance(law) = clipped.arm_law(speed) else { panic!("the bridge has an impedance law") };
            law
        };
        let expected = Impedance { clip_m: 0.02, stiffness_n_m: 2000.0, damping_n_s_m: 89.0, ..Impedance::default() };
        let expected = Impedance { reference_time_constant_s: 0.2, ..expected };
        assert_eq!(law(&slow), Impedance { max_speed_m_s: Some(0.1), ..expected });
        assert_eq!(law(&SpeedLimit::NONE), expected);
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
        // The values of the first day with an arm, with the thresholds of that day.
        let soft = Compliance {
            stiffness: [400.0, 400.0, 400.0, 30.0, 30.0, 30.0],
            damping: [40.0, 40.0, 40.0, 3.0, 3.0, 3.0],
            error_clip_m: 0.03,
        };
        assert_eq!(soft.check(), Ok(()));
        let torques = [15.0, 15.0, 15.0, 15.0, 10.0, 10.0, 8.0];
        assert_eq!(soft.check_thresholds(&[20.0, 20.0, 20.0, 10.0, 10.0, 10.0], &torques), Ok(()));
    }

    #[test]
    fn a_spring_that_reaches_a_collision_threshold_is_refused_with_the_numbers() {
        let (wrench, torques) = ([40.0, 40.0, 40.0, 20.0, 20.0, 20.0], [32.0, 32.0, 32.0, 32.0, 16.0, 16.0, 12.0]);
        assert_eq!(Compliance::default().check_thresholds(&wrench, &torques), Ok(()));
        let hard = Compliance { error_clip_m: 0.04, ..Compliance::default() };
        assert_eq!(hard.check(), Ok(()), "80 N are within the arm's own limits");
        let words = hard.check_thresholds(&wrench, &torques).unwrap_err().to_string();
        for part in ["stiffness[0]", "up to 80.0 N", "at most 32.0 N", "threshold of 40 N", "fci.collision_wrench[0]"] {
            assert!(words.contains(part), "{words}");
        }
        let turning = Compliance { stiffness: [2000.0, 2000.0, 2000.0, 150.0, 150.0, 300.0], ..Compliance::default() };
        let words = turning.check_thresholds(&[40.0, 40.0, 40.0, 20.0, 20.0, 15.0], &torques).unwrap_err().to_string();
        assert!(words.contains("stiffness[5]") && words.contains("up to 15.0 N m"), "{words}");
        // 20 N at 0.8 m are 16 N m.
        let words = Compliance::default().check_thresholds(&wrench, &[18.0; 7]).unwrap_err().to_string();
        assert!(words.contains("16.0 N m") && words.contains("fci.collision_torque[0]"), "{words}");
    }
}
