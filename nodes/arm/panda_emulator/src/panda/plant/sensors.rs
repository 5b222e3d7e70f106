//! Sensors of the arm: angles, speeds and torques with their errors.

use crate::panda::chain::Joints;
use crate::panda::settings::Settings;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// Readings of a cycle.
#[derive(Debug, Clone, Copy)]
pub struct Readings {
    /// Joint angles, rad.
    pub q: Joints,
    /// Joint speeds, rad/s.
    pub dq: Joints,
    /// Torques between gear and link, N m.
    pub tau: Joints,
}

/// Sensors of the joints.
#[derive(Debug, Clone)]
pub struct Sensors {
    bias: Joints,
    torque_step_n_m: f64,
    speed_noise_rad_s: f64,
    random: ChaCha8Rng,
}

impl Sensors {
    /// Sensors with the errors of the settings.
    pub fn new(settings: &Settings, seed: u64) -> Self {
        Self {
            bias: Joints::from(settings.torque_bias_n_m),
            torque_step_n_m: settings.torque_step_n_m,
            speed_noise_rad_s: settings.joint_speed_noise_rad_s,
            random: ChaCha8Rng::seed_from_u64(seed),
        }
    }

    /// Reads true angles, speeds and torques.
    pub fn read(&mut self, q: &Joints, dq: &Joints, link_torque: &Joints) -> Readings {
        let mut speeds = *dq;
        if self.speed_noise_rad_s > 0.0 {
            for speed in &mut speeds {
                let sample: f64 = StandardNormal.sample(&mut self.random);
                *speed += self.speed_noise_rad_s * sample;
            }
        }
        let step = self.torque_step_n_m;
        let stepped = |t: f64| if step > 0.0 { (t / step).round() * step } else { t };
        Readings { q: *q, dq: speeds, tau: (link_torque + self.bias).map(stepped) }
    }
}
