//! Harmonic motion at the frequency of the companion, by its two phases.

use crate::episode_model::Companions;
use std::f64::consts::TAU;

/// Phase of a harmonic template: any phase is a sum of both.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Phase {
    /// Zero at the start.
    Sine,
    /// Largest at the start.
    Cosine,
}

impl Phase {
    /// Value of a wave of amplitude 1 after an angle in rad.
    pub fn at(self, angle_rad: f64) -> f64 {
        match self {
            Phase::Sine => angle_rad.sin(),
            Phase::Cosine => angle_rad.cos(),
        }
    }
}

/// Harmonic motion of a given amplitude.
#[derive(Debug, Clone, Copy)]
pub struct Wave {
    amplitude: f64,
    angular_frequency_rad_s: f64,
    phase: Phase,
}

impl Wave {
    /// Makes a wave of the companions' frequency.
    pub fn new(amplitude: f64, companions: &Companions, phase: Phase) -> Self {
        Self { amplitude, angular_frequency_rad_s: TAU * companions.frequency_hz, phase }
    }

    /// Value at `time_s` since the start.
    pub fn at(&self, time_s: f64) -> f64 {
        self.amplitude * self.phase.at(self.angular_frequency_rad_s * time_s)
    }
}
