//! Settings of the emulator: everything that the documents of the FCI do not fix.

use super::chain::Frame;
use super::rigid_body::{NO_LOAD, greatest_principal_inertia};
use crate::fci::{CollisionThresholds, Generation, JOINTS, Load};
use std::f64::consts::{FRAC_1_SQRT_2, FRAC_PI_2, FRAC_PI_4};

/// Maximum delay of a torque command, cycles.
pub const MAX_DELAY_CYCLES: usize = 10;

/// Greatest distance of a body's centre from the flange, m. Chosen: far beyond what an arm holds.
const GREATEST_LEVER_M: f64 = 10.0;
/// Greatest principal inertia of a body on the flange, kg m^2. Chosen: 100 kg within a metre.
const GREATEST_INERTIA_KG_M2: f64 = 100.0;

/// Ready pose of Franka Emika, rad.
pub const READY_RAD: [f64; JOINTS] = [0.0, -FRAC_PI_4, 0.0, -3.0 * FRAC_PI_4, 0.0, FRAC_PI_2, FRAC_PI_4];

/// End effector as configured in Desk. The control box and the arm agree about it.
#[derive(Debug, Clone, PartialEq)]
pub struct EndEffector {
    /// Mass, kg.
    pub mass_kg: f64,
    /// Centre of mass in F, m.
    pub centre_m: [f64; 3],
    /// Inertia about the centre of mass, column-major, kg m^2.
    pub inertia: [f64; 9],
    /// Pose of the nominal end effector (NE) in F, column-major.
    pub pose_in_flange: [f64; 16],
    /// The end effector is a Franka Hand, which takes part in the check for self-collision.
    pub is_hand: bool,
}

impl EndEffector {
    /// Franka Hand, with the values that a Panda reports: they are rounded to 32 bits.
    pub fn hand() -> Self {
        let f = |v: f64| f64::from(v as f32);
        let c = f(FRAC_1_SQRT_2);
        Self {
            mass_kg: f(0.73),
            centre_m: [f(-0.01), 0.0, f(0.03)],
            inertia: [f(0.001), 0.0, 0.0, 0.0, f(0.0025), 0.0, 0.0, 0.0, f(0.0017)],
            pose_in_flange: [c, -c, 0.0, 0.0, c, c, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, f(0.1034), 1.0],
            is_hand: true,
        }
    }

    /// Bare flange.
    pub fn none() -> Self {
        Self {
            mass_kg: 0.0,
            centre_m: [0.0; 3],
            inertia: [0.0; 9],
            pose_in_flange: crate::fci::IDENTITY,
            is_hand: false,
        }
    }

    /// Body on the flange.
    pub fn load(&self) -> Load {
        Load { mass_kg: self.mass_kg, centre_m: self.centre_m, inertia: self.inertia }
    }
}

/// Settings of the emulator. The defaults are a Panda with the Franka Hand.
///
/// "Guess" marks a value that no document states; it is plausible, and a measurement of a real arm should replace it.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Generation of the robot.
    pub generation: Generation,
    /// Joint angles at power-up, rad.
    pub start_joints_rad: [f64; JOINTS],
    /// End effector, known to arm and control box.
    pub end_effector: EndEffector,
    /// True load on the flange, which the control box does not know. `SetLoad` changes the configured load alone.
    pub true_load: Load,
    /// Scale of the joint friction that the motor control leaves over. 1 = friction that Gaz et al. 2019 identified.
    pub friction_ratio: f64,
    /// Stiction of each joint, N m. It vanishes while the joint moves. Guess, 0.1 to 0.5.
    pub stiction_n_m: [f64; JOINTS],
    /// Share of the rotor inertia that the torque control does not hide. Guess: with less than 0.2, joint damping of
    /// 15 N m s/rad, which works on a real wrist, is unstable at 1 kHz.
    pub rotor_inertia_ratio: f64,
    /// Constant error of each torque sensor, N m. Chosen below the 0.85 N m that two recorded states of a Panda differ from the
    /// gravity torque at most.
    pub torque_bias_n_m: [f64; JOINTS],
    /// Step of the torque sensors, N m, read off recorded states of a Panda. 0 = continuous.
    pub torque_step_n_m: f64,
    /// Standard deviation of the measured joint speeds, rad/s. Guess.
    pub joint_speed_noise_rad_s: f64,
    /// Cut-off frequency of the estimate of external torques, Hz. Guess, 10 to 30.
    pub external_torque_cutoff_hz: f64,
    /// Share of the inertial torques that the estimate of external torques takes into account. Chosen: with 0, a motion in free air
    /// shows 9 N at 0.25 m/s and 19 N at 1.5 m/s^2; a recorded Panda passed 10 N at 0.25 m/s and 20 N above 1 m/s^2.
    pub inertial_torque_ratio: f64,
    /// Stiffness of the gears, N m/rad, which moves `theta` away from `q`. Guess.
    pub gear_stiffness_n_m_per_rad: f64,
    /// Delay of a torque command, cycles. 0 = the torque acts in the cycle after the state that it answers. Guess.
    pub command_delay_cycles: usize,
    /// Number of consecutive lost commands that aborts a motion. The documents say 20 and "more than 20".
    pub lost_command_horizon: u32,
    /// Number of cycles after the start of a motion within which its first command must arrive. Guess.
    pub first_command_horizon: u32,
    /// Maximum measured speed of the end effector, m/s, also for commanded poses and twists.
    pub hand_speed_m_s: f64,
    /// Margin of the measured speed of the end effector, m/s: a motion at the limit is no error. Guess.
    pub hand_speed_margin_m_s: f64,
    /// Margin of the measured joint speeds beyond the limits of commands, rad/s. Guess.
    pub joint_speed_margin_rad_s: f64,
    /// Maximum mechanical power of all joints together, W. Guess.
    pub power_limit_w: f64,
    /// Check commanded and measured torques against the range of the sensors (error 34).
    pub checks_torque_range: bool,
    /// Refuse motions after the user stop is released until `AutomaticErrorRecovery`. Systems differ.
    pub user_stop_needs_recovery: bool,
    /// Answer `AutomaticErrorRecovery` with `ManualErrorRecoveryRequiredRejected` after joint position limits or self-collision.
    pub limits_need_manual_recovery: bool,
    /// Duration of the stop after a reflex, s. Guess, 0.05 to 0.15.
    pub stop_time_s: f64,
    /// Duration of `AutomaticErrorRecovery`, s. Guess, 0.5 to 1.
    pub recovery_time_s: f64,
    /// Joint speed below which the arm is at rest when a motion finishes, rad/s. Guess.
    pub rest_speed_rad_s: f64,
    /// Maximum difference of the first commanded position from the arm's desired one, rad and m. Guess.
    pub start_tolerance: f64,
    /// Desired joint acceleration above which the thresholds "while accelerating" hold, rad/s^2. Guess.
    pub acceleration_phase_rad_s2: f64,
    /// Desired change of torque above which the thresholds "while accelerating" hold, N m/s. Guess.
    pub acceleration_phase_n_m_s: f64,
    /// Thresholds of contact and collision at power-up: those of the file `default_controllers.yaml` of franka_ros. Guess.
    pub collision: CollisionThresholds,
    /// Stiffness of the internal joint impedance at power-up, N m/rad: that of libfranka's examples.
    pub joint_impedance_n_m_per_rad: [f64; JOINTS],
    /// Stiffness of the internal Cartesian impedance at power-up, N/m and N m/rad: that of libfranka's examples.
    pub cartesian_impedance: [f64; 6],
    /// Greatest mass that `SetLoad` accepts, kg: the payload of the data sheet. Guess: no document states a range.
    pub payload_kg: f64,
    /// Greatest distance that `SetNEToEE`, `SetEEToK` and the centre of `SetLoad` accept, m; a load's radius of gyration has the same
    /// bound. Guess: no document states a range; the arm reaches 0.855 m.
    pub lever_m: f64,
    /// Cuboid that the end effector must not leave: size (m) and pose of its centre in O. The limit with identifier 0.
    pub workspace_box: Option<([f64; 3], [f64; 16])>,
    /// Steps of the simulated arm in a cycle.
    pub substeps: usize,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            generation: Generation::Panda,
            start_joints_rad: READY_RAD,
            end_effector: EndEffector::hand(),
            true_load: NO_LOAD,
            friction_ratio: 1.0,
            stiction_n_m: [0.2; JOINTS],
            rotor_inertia_ratio: 0.5,
            torque_bias_n_m: [0.15, -0.1, 0.1, 0.4, 0.15, -0.05, 0.05],
            torque_step_n_m: 0.05,
            joint_speed_noise_rad_s: 2e-4,
            external_torque_cutoff_hz: 20.0,
            inertial_torque_ratio: 0.0,
            gear_stiffness_n_m_per_rad: 1e4,
            command_delay_cycles: 1,
            lost_command_horizon: 20,
            first_command_horizon: 1000,
            hand_speed_m_s: 1.7,
            hand_speed_margin_m_s: 0.05,
            joint_speed_margin_rad_s: 0.1,
            power_limit_w: 500.0,
            checks_torque_range: true,
            user_stop_needs_recovery: true,
            limits_need_manual_recovery: false,
            stop_time_s: 0.1,
            recovery_time_s: 0.6,
            rest_speed_rad_s: 0.03,
            start_tolerance: 1e-3,
            acceleration_phase_rad_s2: 1.0,
            acceleration_phase_n_m_s: 200.0,
            collision: power_up_thresholds(),
            joint_impedance_n_m_per_rad: [3000.0, 3000.0, 3000.0, 2500.0, 2500.0, 2000.0, 2000.0],
            cartesian_impedance: [3000.0, 3000.0, 3000.0, 300.0, 300.0, 300.0],
            payload_kg: 3.0,
            lever_m: 1.0,
            workspace_box: None,
            substeps: 4,
        }
    }
}

fn power_up_thresholds() -> CollisionThresholds {
    let torques = [20.0, 20.0, 18.0, 18.0, 16.0, 14.0, 12.0];
    let forces = [20.0, 20.0, 20.0, 25.0, 25.0, 25.0];
    CollisionThresholds {
        lower_torques_acceleration: torques,
        upper_torques_acceleration: torques,
        lower_torques_nominal: torques,
        upper_torques_nominal: torques,
        lower_forces_acceleration: forces,
        upper_forces_acceleration: forces,
        lower_forces_nominal: forces,
        upper_forces_nominal: forces,
    }
}

/// Setting out of range.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("panda_emulator: setting {field} is {value}; expected {expected}")]
pub struct SettingsError {
    /// Name of the field.
    pub field: &'static str,
    /// Value that was given.
    pub value: String,
    /// Range that is allowed.
    pub expected: &'static str,
}

impl Settings {
    /// Settings of a generation.
    #[must_use]
    pub fn of(generation: Generation) -> Self {
        match generation {
            Generation::Panda => Self::default(),
            Generation::Fr3 => Self { generation, hand_speed_m_s: 3.0, ..Self::default() },
        }
    }

    /// Checks every field.
    ///
    /// # Errors
    /// [`SettingsError`] for the first field out of its range.
    pub fn check(&self) -> Result<(), SettingsError> {
        self.check_scalars()?;
        self.check_counts()?;
        for (field, list) in [
            ("start_joints_rad", &self.start_joints_rad),
            ("torque_bias_n_m", &self.torque_bias_n_m),
            ("stiction_n_m", &self.stiction_n_m),
            ("joint_impedance_n_m_per_rad", &self.joint_impedance_n_m_per_rad),
        ] {
            check(field, list.iter().all(|v| v.is_finite()), list, "seven finite numbers")?;
        }
        let stiction = &self.stiction_n_m;
        check("stiction_n_m", stiction.iter().all(|v| *v >= 0.0), stiction, "seven numbers of 0 or more")?;
        check_body("end_effector", &self.end_effector.load())?;
        check_body("true_load", &self.true_load)?;
        let pose = &self.end_effector.pose_in_flange;
        check("end_effector.pose_in_flange", Frame::is_valid(pose), pose, "a column-major rigid frame")?;
        let frame_is_valid = self
            .workspace_box
            .is_none_or(|(size, frame)| size.iter().all(|v| v.is_finite() && *v > 0.0) && Frame::is_valid(&frame));
        check("workspace_box", frame_is_valid, &self.workspace_box, "positive sizes and a column-major rigid frame")
    }

    fn check_scalars(&self) -> Result<(), SettingsError> {
        let zero_or_more = "a finite number of 0 or more";
        for (field, value, least, most, expected) in [
            ("friction_ratio", self.friction_ratio, 0.0, 100.0, "0 to 100"),
            ("rotor_inertia_ratio", self.rotor_inertia_ratio, 0.0, 1.0, "0 to 1"),
            ("torque_step_n_m", self.torque_step_n_m, 0.0, 10.0, "0 to 10"),
            ("joint_speed_noise_rad_s", self.joint_speed_noise_rad_s, 0.0, 1.0, "0 to 1"),
            ("external_torque_cutoff_hz", self.external_torque_cutoff_hz, 0.1, 1000.0, "0.1 to 1000"),
            ("inertial_torque_ratio", self.inertial_torque_ratio, 0.0, 1.0, "0 to 1"),
            ("gear_stiffness_n_m_per_rad", self.gear_stiffness_n_m_per_rad, 100.0, 1e9, "100 to 1e9"),
            ("hand_speed_m_s", self.hand_speed_m_s, 0.01, 100.0, "0.01 to 100"),
            ("hand_speed_margin_m_s", self.hand_speed_margin_m_s, 0.0, 100.0, "0 to 100"),
            ("joint_speed_margin_rad_s", self.joint_speed_margin_rad_s, 0.0, 100.0, "0 to 100"),
            ("power_limit_w", self.power_limit_w, 1.0, 1e9, "1 to 1e9"),
            ("stop_time_s", self.stop_time_s, 1e-3, 10.0, "0.001 to 10"),
            ("recovery_time_s", self.recovery_time_s, 0.0, 60.0, "0 to 60"),
            ("rest_speed_rad_s", self.rest_speed_rad_s, 0.0, 10.0, "0 to 10"),
            ("start_tolerance", self.start_tolerance, 0.0, 10.0, "0 to 10"),
            ("payload_kg", self.payload_kg, 0.0, 100.0, "0 to 100"),
            ("lever_m", self.lever_m, 0.0, 10.0, "0 to 10"),
            ("acceleration_phase_rad_s2", self.acceleration_phase_rad_s2, 0.0, f64::MAX, zero_or_more),
            ("acceleration_phase_n_m_s", self.acceleration_phase_n_m_s, 0.0, f64::MAX, zero_or_more),
        ] {
            check(field, (least..=most).contains(&value), &value, expected)?;
        }
        Ok(())
    }

    fn check_counts(&self) -> Result<(), SettingsError> {
        check("substeps", (4..=100).contains(&self.substeps), &self.substeps, "4 to 100")?;
        let delay = self.command_delay_cycles;
        check("command_delay_cycles", delay <= MAX_DELAY_CYCLES, &delay, "0 to 10")?;
        check("lost_command_horizon", self.lost_command_horizon > 0, &self.lost_command_horizon, "1 or more")?;
        check("first_command_horizon", self.first_command_horizon > 0, &self.first_command_horizon, "1 or more")
    }
}

fn check_body(field: &'static str, load: &Load) -> Result<(), SettingsError> {
    let holds = (0.0..=100.0).contains(&load.mass_kg)
        && load.centre_m.iter().all(|v| v.abs() <= GREATEST_LEVER_M)
        && greatest_principal_inertia(&load.inertia).is_some_and(|i| i <= GREATEST_INERTIA_KG_M2);
    let expected = "0 to 100 kg, a centre within 10 m, and an inertia that a body can have, up to 100 kg m^2";
    check(field, holds, load, expected)
}

fn check(
    field: &'static str,
    holds: bool,
    value: &impl std::fmt::Debug,
    expected: &'static str,
) -> Result<(), SettingsError> {
    if holds { Ok(()) } else { Err(SettingsError { field, value: format!("{value:?}"), expected }) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn defaults_pass_and_a_wrong_field_is_named_with_value_and_range() {
        assert_eq!(Settings::default().check(), Ok(()));
        assert_eq!(Settings::of(Generation::Fr3).check(), Ok(()));
        let error = Settings { substeps: 3, ..Settings::default() }.check().unwrap_err();
        assert_eq!(error.to_string(), "panda_emulator: setting substeps is 3; expected 4 to 100");
        let error = Settings { friction_ratio: f64::NAN, ..Settings::default() }.check().unwrap_err();
        assert_eq!(error.field, "friction_ratio");
    }
}
