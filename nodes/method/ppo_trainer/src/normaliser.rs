//! Normalisation of observations by their running mean and standard deviation.

use catenary_core::Observation;
use serde::{Deserialize, Serialize};

/// Least standard deviation by which an observation is divided: a component that hardly varies is not amplified.
const MIN_SCALE: f64 = 1e-3;

/// Running moments of each component (Chan, Golub and LeVeque 1983).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Normaliser {
    count: f64,
    mean: [f64; Observation::LEN],
    squares: [f64; Observation::LEN],
    enabled: bool,
}

impl Normaliser {
    /// Builds a normaliser without observations. The mean of a disabled one stays 0 and its scale 1.
    pub fn new(enabled: bool) -> Self {
        Self { count: 0.0, mean: [0.0; Observation::LEN], squares: [0.0; Observation::LEN], enabled }
    }

    /// Adds one observation.
    pub fn update(&mut self, observation: &Observation) {
        if !self.enabled {
            return;
        }
        self.count += 1.0;
        for i in 0..Observation::LEN {
            let before = observation.0[i] - self.mean[i];
            self.mean[i] += before / self.count;
            self.squares[i] += before * (observation.0[i] - self.mean[i]);
        }
    }

    /// Mean of each component.
    pub fn mean(&self) -> [f32; Observation::LEN] {
        self.mean.map(|v| v as f32)
    }

    /// Standard deviation of each component; 1 before the second observation.
    pub fn scale(&self) -> [f32; Observation::LEN] {
        if self.count < 2.0 {
            return [1.0; Observation::LEN];
        }
        self.squares.map(|s| (s / self.count).sqrt().max(MIN_SCALE) as f32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moments_are_those_of_the_data() {
        let mut n = Normaliser::new(true);
        for v in [1.0, 2.0, 3.0, 6.0] {
            n.update(&Observation([v; 12]));
        }
        assert!((n.mean()[3] - 3.0).abs() < 1e-6);
        assert!((n.scale()[3] - 3.5f32.sqrt()).abs() < 1e-6);
        let mut off = Normaliser::new(false);
        off.update(&Observation([5.0; 12]));
        assert_eq!((off.mean()[0], off.scale()[0]), (0.0, 1.0));
    }
}
