//! Sensor of the wrench on the hand, with bias, delay and noise.

use crate::episode_model::WrenchSettings;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use std::collections::VecDeque;

/// Wrench in the order of [`catenary_core::Frame::wrench`], N, N and N m.
type Wrench = [f64; 3];

/// Sensor of one episode.
#[derive(Debug)]
pub struct WrenchSensor {
    settings: WrenchSettings,
    /// True wrenches at the ends of the newest time steps, oldest first.
    past: VecDeque<(f64, Wrench)>,
    noise: Option<ChaCha8Rng>,
}

impl WrenchSensor {
    /// Makes a sensor. `noise` is the random source of its noise; without a source there is none.
    pub fn new(settings: WrenchSettings, noise: Option<ChaCha8Rng>) -> Self {
        Self { settings, past: VecDeque::new(), noise }
    }

    /// Stores the true wrench at `time_s`, the end of a time step.
    pub fn remember(&mut self, time_s: f64, wrench: Wrench) {
        // A frame lies within the newest step, so that two steps before the delay are needed.
        let oldest_s = time_s - self.settings.delay_s;
        while self.past.len() > 2 && self.past[2].0 <= oldest_s {
            self.past.pop_front();
        }
        if self.past.back().is_none_or(|(t, _)| *t < time_s) {
            self.past.push_back((time_s, wrench));
        }
    }

    /// Returns the measured wrench stamped `time_s`; none before the first step of a beam that starts in motion.
    pub fn read(&mut self, time_s: f64) -> Option<Wrench> {
        let truth = self.at(time_s - self.settings.delay_s)?;
        let WrenchSettings { bias, noise_sd, .. } = self.settings;
        let mut measured: Wrench = std::array::from_fn(|i| truth[i] + bias[i]);
        if let Some(rng) = &mut self.noise {
            (0..3).for_each(|i| measured[i] += noise_sd[i] * rng.sample::<f64, _>(StandardNormal));
        }
        Some(measured)
    }

    /// True wrench at `time_s`: linear between steps, constant before and after them.
    fn at(&self, time_s: f64) -> Option<Wrench> {
        let later = self.past.partition_point(|(t, _)| *t < time_s);
        let (t1, new) = self.past.get(later).or(self.past.back())?;
        if later == 0 || *t1 <= time_s {
            return Some(*new);
        }
        let (t0, old) = &self.past[later - 1];
        let share = (time_s - t0) / (t1 - t0);
        Some(std::array::from_fn(|i| old[i] + share * (new[i] - old[i])))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use catenary_core::seed;

    /// Wrench read at 0.503 s from one that grows by (1, 2, 3) a second, in steps of 4 ms.
    fn read(settings: WrenchSettings) -> Wrench {
        let mut sensor = WrenchSensor::new(settings, None);
        for i in 0..=126 {
            let t = 4e-3 * f64::from(i);
            sensor.remember(t, [t, 2.0 * t, 3.0 * t]);
        }
        sensor.read(0.503).unwrap()
    }

    #[test]
    fn a_wrench_is_that_of_its_time_less_the_delay_plus_the_bias() {
        let base = WrenchSettings::new([1.0; 3]);
        let close = |a: Wrench, b: Wrench| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-12);
        assert!(close(read(base), [0.503, 1.006, 1.509]));
        assert!(close(read(WrenchSettings { delay_s: 0.1, ..base }), [0.403, 0.806, 1.209]));
        assert!(close(read(WrenchSettings { bias: [1.0, -1.0, 0.5], ..base }), [1.503, 0.006, 2.009]));
        assert_eq!(WrenchSensor::new(base, None).read(0.0), None);
    }

    #[test]
    fn noise_has_the_stated_standard_deviations() {
        let mut sensor = WrenchSensor::new(WrenchSettings::new([0.5, 0.1, 0.02]), Some(seed::rng(1, 0)));
        sensor.remember(0.0, [0.0; 3]);
        let mut squares = [0.0; 3];
        for _ in 0..2000 {
            let wrench = sensor.read(0.0).unwrap();
            (0..3).for_each(|i| squares[i] += wrench[i] * wrench[i] / 2000.0);
        }
        // The standard error of a standard deviation of 2000 draws is 1.6 %.
        let ratios = [squares[0].sqrt() / 0.5, squares[1].sqrt() / 0.1, squares[2].sqrt() / 0.02];
        assert!(ratios.iter().all(|ratio| (ratio - 1.0).abs() < 0.06), "{ratios:?}");
    }
}
