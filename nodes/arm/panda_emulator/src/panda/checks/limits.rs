//! Limits of commands and of the arm, as Franka Emika publishes them.

use crate::fci::Generation;
use crate::panda::chain::Joints;
use crate::panda::settings::Settings;

/// Tolerance of every comparison: a client that commands exactly a limit must not fail by rounding.
const TOLERANCE: f64 = 1.0 + 1e-9;

/// Returns true if the magnitude exceeds the limit by more than rounding. NaN exceeds every limit.
pub fn exceeds(value: f64, limit: f64) -> bool {
    value.is_nan() || value.abs() > limit * TOLERANCE
}

/// Limits of speed, acceleration and jerk.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rates {
    /// Speed, m/s or rad/s.
    pub speed: f64,
    /// Acceleration, m/s^2 or rad/s^2.
    pub acceleration: f64,
    /// Jerk, m/s^3 or rad/s^3.
    pub jerk: f64,
}

/// Joint speed limit that falls towards the ends of the range (Franka Research 3).
#[derive(Debug, Clone, Copy)]
struct Braking {
    offset_rad_s: f64,
    deceleration_rad_s2: f64,
}

/// Limits of a generation.
#[derive(Debug, Clone)]
pub struct Limits {
    /// Lower joint limits, rad.
    pub lowest: [f64; 7],
    /// Upper joint limits, rad.
    pub highest: [f64; 7],
    /// Limits of the joints' motion.
    pub joints: [Rates; 7],
    /// Limits of the joint torques, N m.
    pub torque_n_m: [f64; 7],
    /// Limit of the change of a torque command in a cycle, N m.
    pub torque_step_n_m: f64,
    /// Limits of the translation of the end effector.
    pub translation: Rates,
    /// Limits of the rotation of the end effector.
    pub rotation: Rates,
    /// Limits of the elbow.
    pub elbow: Rates,
    braking: Option<[Braking; 7]>,
}

impl Limits {
    /// Limits of the generation that the settings name, with their speed of the end effector.
    pub fn of(settings: &Settings) -> Self {
        let mut limits = match settings.generation {
            Generation::Panda => panda(),
            Generation::Fr3 => fr3(),
        };
        limits.translation.speed = settings.hand_speed_m_s;
        limits
    }

    /// Speed limits of a joint at `angle_rad`: towards the lower (negative) and towards the upper end, rad/s.
    pub fn speeds(&self, joint: usize, angle_rad: f64) -> (f64, f64) {
        let most = self.joints[joint].speed;
        let Some(braking) = &self.braking else { return (-most, most) };
        let Braking { offset_rad_s, deceleration_rad_s2 } = braking[joint];
        let towards = |left_rad: f64| {
            let brake = (2.0 * deceleration_rad_s2 * left_rad.max(0.0)).sqrt() - offset_rad_s;
            brake.clamp(0.0, most)
        };
        (-towards(angle_rad - self.lowest[joint]), towards(self.highest[joint] - angle_rad))
    }

    /// Returns true if a torque command changes too much in a cycle.
    pub fn torque_jumps(&self, before: &Joints, after: &Joints) -> bool {
        (after - before).iter().any(|change| exceeds(*change, self.torque_step_n_m))
    }

    /// Returns true if a torque exceeds the range of its joint.
    pub fn torque_is_outside(&self, torque: &Joints) -> bool {
        torque.iter().zip(self.torque_n_m).any(|(t, limit)| exceeds(*t, limit))
    }
}

fn rates(speed: [f64; 7], acceleration: [f64; 7], jerk: [f64; 7]) -> [Rates; 7] {
    std::array::from_fn(|i| Rates { speed: speed[i], acceleration: acceleration[i], jerk: jerk[i] })
}

/// Panda: frankaemika/docs, "Robot and interface specifications".
fn panda() -> Limits {
    Limits {
        lowest: [-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973],
        highest: [2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973],
        joints: rates(
            [2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61],
            [15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0],
            [7500.0, 3750.0, 5000.0, 6250.0, 7500.0, 10000.0, 10000.0],
        ),
        torque_n_m: [87.0, 87.0, 87.0, 87.0, 12.0, 12.0, 12.0],
        torque_step_n_m: 1.0,
        translation: Rates { speed: 1.7, acceleration: 13.0, jerk: 6500.0 },
        rotation: Rates { speed: 2.5, acceleration: 25.0, jerk: 12500.0 },
        elbow: Rates { speed: 2.175, acceleration: 10.0, jerk: 5000.0 },
        braking: None,
    }
}

/// Franka Research 3: frankarobotics/docs, and the joint ranges and braking curves of franka_description's `fr3`.
///
/// Rotation speed and elbow are those of the Panda's table: only its acceleration and jerk differ between the generations.
fn fr3() -> Limits {
    let braking = [(0.30, 6.0), (0.20, 2.585), (0.20, 3.5), (0.30, 4.0), (0.35, 17.0), (0.35, 5.5), (0.35, 17.0)];
    Limits {
        lowest: [-2.7501, -1.7918, -2.9065, -3.0481, -2.8101, 0.54092, -3.0196],
        highest: [2.7501, 1.7918, 2.9065, -0.1458, 2.8101, 4.5205, 3.0196],
        joints: rates([2.62, 2.62, 2.62, 2.62, 5.26, 4.18, 5.26], [10.0; 7], [5000.0; 7]),
        translation: Rates { speed: 3.0, acceleration: 9.0, jerk: 4500.0 },
        rotation: Rates { speed: 2.5, acceleration: 17.0, jerk: 8500.0 },
        elbow: Rates { speed: 2.62, acceleration: 10.0, jerk: 5000.0 },
        braking: Some(braking.map(|(offset_rad_s, deceleration_rad_s2)| Braking { offset_rad_s, deceleration_rad_s2 })),
        ..panda()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fr3_slows_down_towards_the_ends_of_its_range() {
        let limits = Limits::of(&Settings::of(Generation::Fr3));
        assert_eq!(limits.speeds(0, 0.0), (-2.62, 2.62));
        let (low, high) = limits.speeds(0, 2.7);
        let expected = (2.0_f64 * 6.0 * 0.0501).sqrt() - 0.30;
        assert!((high - expected).abs() < 1e-12 && low == -2.62, "{low} {high}");
        assert_eq!(Limits::of(&Settings::default()).speeds(0, 2.89), (-2.175, 2.175));
    }

    #[test]
    fn a_value_at_the_limit_passes_and_nan_does_not() {
        assert!(!exceeds(0.1 + 0.2, 0.3));
        assert!(exceeds(1.000_001, 1.0) && exceeds(f64::NAN, 1.0));
    }
}
