//! Configuration that a client sets: thresholds, impedances, frames, load, filters.

use super::chain::Frame;
use super::rigid_body::greatest_principal_inertia;
use super::settings::Settings;
use crate::fci::{CYCLE_S, CollisionThresholds, IDENTITY, Load, Request, SetterStatus};

/// Range of the joint stiffness, N m/rad (libfranka's documentation of `setJointImpedance`).
const JOINT_STIFFNESS: std::ops::RangeInclusive<f64> = 0.0..=14250.0;
/// Range of the Cartesian stiffness of the translation, N/m (libfranka's documentation of `setCartesianImpedance`).
const TRANSLATION_STIFFNESS: std::ops::RangeInclusive<f64> = 10.0..=3000.0;
/// Range of the Cartesian stiffness of the rotation, N m/rad (likewise).
const ROTATION_STIFFNESS: std::ops::RangeInclusive<f64> = 1.0..=300.0;
/// Range of the cut-off frequencies, Hz. The upper end turns a filter off.
const CUTOFF_HZ: std::ops::RangeInclusive<f64> = 1.0..=1000.0;

/// Inertia that a load may have beyond that of its mass, kg m^2. Chosen: clients set a load back with a mass of 0 and a small inertia.
const SPARE_INERTIA_KG_M2: f64 = 0.01;

/// Configuration of the control box.
#[derive(Debug, Clone)]
pub struct Configuration {
    /// Thresholds of contact and collision.
    pub collision: CollisionThresholds,
    /// Stiffness of the internal joint impedance, N m/rad.
    pub joint_impedance: [f64; 7],
    /// Stiffness of the internal Cartesian impedance, N/m and N m/rad.
    pub cartesian_impedance: [f64; 6],
    /// Axes that are free while the arm is guided by hand.
    pub free_axes: [bool; 6],
    /// Nominal end effector in the flange, column-major.
    pub f_t_ne: [f64; 16],
    /// End effector in the nominal one, column-major.
    pub ne_t_ee: [f64; 16],
    /// Stiffness frame in the end effector, column-major.
    pub ee_t_k: [f64; 16],
    /// Load.
    pub load: Load,
    /// Cut-off frequencies, Hz: joint position, joint velocity, Cartesian position, Cartesian velocity, controller.
    pub filters_hz: [f64; 5],
    /// Greatest mass of a load, kg.
    payload_kg: f64,
    /// Greatest distance of a frame or a load, m.
    lever_m: f64,
}

impl Configuration {
    /// Configuration at power-up.
    pub fn new(settings: &Settings) -> Self {
        Self {
            collision: settings.collision,
            joint_impedance: settings.joint_impedance_n_m_per_rad,
            cartesian_impedance: settings.cartesian_impedance,
            free_axes: [true; 6],
            f_t_ne: settings.end_effector.pose_in_flange,
            ne_t_ee: IDENTITY,
            ee_t_k: IDENTITY,
            load: super::rigid_body::NO_LOAD,
            filters_hz: [1000.0; 5],
            payload_kg: settings.payload_kg,
            lever_m: settings.lever_m,
        }
    }

    /// End effector in the flange.
    pub fn tool(&self) -> Frame {
        Frame::from_array(&self.f_t_ne).then(&Frame::from_array(&self.ne_t_ee))
    }

    /// Gain of a first-order filter with index `filter`; 1 = off.
    pub fn gain(&self, filter: usize) -> f64 {
        gain(self.filters_hz[filter])
    }

    /// Applies a setter. Requests that set nothing are refused.
    pub fn apply(&mut self, request: &Request) -> SetterStatus {
        let valid = match request {
            Request::SetCollisionBehavior(thresholds) => {
                let valid = thresholds_are_valid(thresholds);
                if valid {
                    self.collision = *thresholds;
                }
                valid
            }
            Request::SetJointImpedance(k) => assign(&mut self.joint_impedance, k, |_, v| JOINT_STIFFNESS.contains(&v)),
            Request::SetCartesianImpedance(k) => assign(&mut self.cartesian_impedance, k, |i, v| {
                if i < 3 { TRANSLATION_STIFFNESS.contains(&v) } else { ROTATION_STIFFNESS.contains(&v) }
            }),
            Request::SetGuidingMode(axes, _) => {
                self.free_axes = *axes;
                true
            }
            Request::SetEeToK(frame) => set_frame(&mut self.ee_t_k, frame, self.lever_m),
            Request::SetNeToEe(frame) => set_frame(&mut self.ne_t_ee, frame, self.lever_m),
            Request::SetLoad(load) => {
                let valid = self.carries(load);
                if valid {
                    self.load = *load;
                }
                valid
            }
            Request::SetFilters(f) => assign(&mut self.filters_hz, f, |_, v| CUTOFF_HZ.contains(&v)),
            _ => false,
        };
        if valid { SetterStatus::Success } else { SetterStatus::InvalidArgumentRejected }
    }

    /// Returns true for a load that a body on the arm's flange can be. Comparisons with NaN are false.
    fn carries(&self, load: &Load) -> bool {
        let greatest = load.mass_kg * self.lever_m * self.lever_m + SPARE_INERTIA_KG_M2;
        (0.0..=self.payload_kg).contains(&load.mass_kg)
            && nalgebra::Vector3::from(load.centre_m).norm() <= self.lever_m
            && greatest_principal_inertia(&load.inertia).is_some_and(|inertia| inertia <= greatest)
    }
}

/// Gain of a first-order filter with a cut-off frequency; 1000 Hz and more is off.
pub fn gain(cutoff_hz: f64) -> f64 {
    if cutoff_hz >= 1000.0 { 1.0 } else { CYCLE_S / (CYCLE_S + 1.0 / (std::f64::consts::TAU * cutoff_hz)) }
}

fn assign<const N: usize>(to: &mut [f64; N], from: &[f64; N], valid: impl Fn(usize, f64) -> bool) -> bool {
    let all = from.iter().enumerate().all(|(i, v)| valid(i, *v));
    if all {
        *to = *from;
    }
    all
}

fn set_frame(to: &mut [f64; 16], from: &[f64; 16], lever_m: f64) -> bool {
    let valid = Frame::is_valid(from) && Frame::from_array(from).origin.norm() <= lever_m;
    if valid {
        *to = *from;
    }
    valid
}

fn thresholds_are_valid(t: &CollisionThresholds) -> bool {
    let pairs =
        |lower: &[f64], upper: &[f64]| lower.iter().zip(upper).all(|(l, u)| *l >= 0.0 && l <= u && u.is_finite());
    pairs(&t.lower_torques_acceleration, &t.upper_torques_acceleration)
        && pairs(&t.lower_torques_nominal, &t.upper_torques_nominal)
        && pairs(&t.lower_forces_acceleration, &t.upper_forces_acceleration)
        && pairs(&t.lower_forces_nominal, &t.upper_forces_nominal)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gain_of_100_hz_is_the_one_that_libfranka_shows() {
        assert!((gain(100.0) - 0.385_869_5).abs() < 1e-6, "{}", gain(100.0));
    }

    #[test]
    fn values_out_of_range_are_refused_and_change_nothing() {
        let mut configuration = Configuration::new(&Settings::default());
        let before = configuration.joint_impedance;
        let refused = configuration.apply(&Request::SetJointImpedance([20_000.0; 7]));
        assert_eq!((refused, configuration.joint_impedance), (SetterStatus::InvalidArgumentRejected, before));
        assert_eq!(configuration.apply(&Request::SetCartesianImpedance([100.0; 6])), SetterStatus::Success);
        assert_eq!(configuration.cartesian_impedance, [100.0; 6]);
    }
}
