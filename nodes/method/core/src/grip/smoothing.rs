//! Smoothing of a measured path by its stated noise.
//!
//! Each coordinate moves with a velocity that is a random walk of intensity q in m^2/s^3, and is measured with white noise of a
//! known standard deviation. Kalman filter and Rauch-Tung-Striebel smoother give its position and velocity at the samples: a
//! cubic smoothing spline (Wahba 1978). q is that of the greatest likelihood, so that a hand at rest is held still and a fast one
//! is followed.

use super::{GripPose, GripTrajectory};

/// Intensities q that are tried, as powers of ten of q in units of noise^2 / s^3: from a standstill to motions that no noise
/// hides, in quarters of a decade.
const EXPONENTS: (i32, i32) = (-8, 40);
const PER_DECADE: f64 = 4.0;
/// Standard deviations of position and velocity before the first sample, in units of the noise. They are so wide that they say
/// nothing, and not so wide that rounding shows.
const FIRST_SDS: [f64; 2] = [1e4, 1e6];
/// Longest time in s between two poses of a smoothed path, which is linear between them: about two steps of the simulator, in
/// which a hand at 1 m/s^2 leaves a chord by 3 micrometres.
const SPACING_S: f64 = 5e-3;

/// Position and velocity with the lower half of their covariance: variance of the position, covariance, variance of the
/// velocity.
#[derive(Debug, Clone, Copy, Default)]
struct Belief {
    position: f64,
    velocity: f64,
    covariance: [f64; 3],
}

impl Belief {
    /// Belief `dt` s later.
    fn after(&self, dt: f64, q: f64) -> Self {
        let [pp, pv, vv] = self.covariance;
        Self {
            position: self.position + dt * self.velocity,
            velocity: self.velocity,
            covariance: [
                pp + 2.0 * dt * pv + dt * dt * vv + q * dt.powi(3) / 3.0,
                pv + dt * vv + 0.5 * q * dt * dt,
                vv + q * dt,
            ],
        }
    }

    /// Belief after a measurement with unit noise.
    fn given(&self, measured: f64) -> Self {
        let [pp, pv, vv] = self.covariance;
        let (gain, surprise) = ([pp / (pp + 1.0), pv / (pp + 1.0)], measured - self.position);
        Self {
            position: self.position + gain[0] * surprise,
            velocity: self.velocity + gain[1] * surprise,
            covariance: [pp - gain[0] * pp, pv - gain[0] * pv, vv - gain[1] * pv],
        }
    }

    /// Belief that also knows what followed: `later` is the smoothed belief `dt` s later.
    fn smoothed(&self, later: &Self, dt: f64, q: f64) -> Self {
        let ahead = self.after(dt, q);
        let [pp, pv, vv] = self.covariance;
        let [a, b, c] = ahead.covariance;
        let determinant = a * c - b * b;
        // Covariance of now with later, times the inverse of the covariance ahead.
        let gain = |to_position: f64, to_velocity: f64| {
            [(to_position * c - to_velocity * b) / determinant, (to_velocity * a - to_position * b) / determinant]
        };
        let (of_position, of_velocity) = (gain(pp + dt * pv, pv), gain(pv + dt * vv, vv));
        let (by, faster) = (later.position - ahead.position, later.velocity - ahead.velocity);
        Self {
            position: self.position + of_position[0] * by + of_position[1] * faster,
            velocity: self.velocity + of_velocity[0] * by + of_velocity[1] * faster,
            covariance: self.covariance,
        }
    }
}

/// Filters values with unit noise at these times. Returns the beliefs after each value, and the log likelihood of all values
/// but the first two, which say where the motion begins.
fn filtered(times_s: &[f64], values: &[f64], q: f64) -> (Vec<Belief>, f64) {
    let [sd, speed_sd] = FIRST_SDS;
    let mut belief = Belief { position: values[0], velocity: 0.0, covariance: [sd * sd, 0.0, speed_sd * speed_sd] };
    let (mut beliefs, mut log_likelihood) = (Vec::with_capacity(values.len()), 0.0);
    for (i, value) in values.iter().enumerate() {
        if i > 0 {
            belief = belief.after(times_s[i] - times_s[i - 1], q);
        }
        if i > 1 {
            let variance = belief.covariance[0] + 1.0;
            log_likelihood -= 0.5 * (variance.ln() + (value - belief.position).powi(2) / variance);
        }
        belief = belief.given(*value);
        beliefs.push(belief);
    }
    (beliefs, log_likelihood)
}

/// Returns positions and velocities at the samples, smoothed by the noise `sd`.
fn smoothed_coordinate(times_s: &[f64], values: &[f64], sd: f64) -> Vec<[f64; 2]> {
    let first = values[0];
    let scaled: Vec<f64> = values.iter().map(|v| (v - first) / sd).collect();
    let intensities = (EXPONENTS.0..=EXPONENTS.1).map(|k| 10f64.powf(f64::from(k) / PER_DECADE));
    let likelihood = |q: &f64| filtered(times_s, &scaled, *q).1;
    let best = intensities.max_by(|a, b| likelihood(a).total_cmp(&likelihood(b))).unwrap_or(1.0);
    let mut beliefs = filtered(times_s, &scaled, best).0;
    for i in (0..beliefs.len().saturating_sub(1)).rev() {
        beliefs[i] = beliefs[i].smoothed(&beliefs[i + 1], times_s[i + 1] - times_s[i], best);
    }
    beliefs.iter().map(|b| [first + sd * b.position, sd * b.velocity]).collect()
}

impl GripTrajectory {
    /// Path without the noise of its samples, whose standard deviations are stated: of x and z in m, and of the pitch in rad. A
    /// coordinate of no noise stays as it was measured. The path gets further poses between its samples, with continuous velocities.
    #[must_use]
    pub fn smoothed(&self, position_sd_m: f64, pitch_sd_rad: f64) -> GripTrajectory {
        // Two samples leave no noise to tell from motion.
        if self.poses.len() < 3 || (position_sd_m <= 0.0 && pitch_sd_rad <= 0.0) {
            return self.clone();
        }
        let coordinate = |of: fn(&GripPose) -> f64, sd: f64| {
            let values: Vec<f64> = self.poses.iter().map(of).collect();
            (sd > 0.0).then(|| smoothed_coordinate(&self.times_s, &values, sd))
        };
        let x = coordinate(|p| p.x_m, position_sd_m);
        let z = coordinate(|p| p.z_m, position_sd_m);
        let pitch = coordinate(|p| p.pitch_rad, pitch_sd_rad);
        let (mut times_s, mut poses) = (Vec::new(), Vec::new());
        for (i, pair) in self.times_s.windows(2).enumerate() {
            let span_s = pair[1] - pair[0];
            let pieces = (span_s / SPACING_S).ceil().max(1.0) as usize;
            // The last sample ends the path.
            let count = if i + 2 == self.times_s.len() { pieces + 1 } else { pieces };
            for piece in 0..count {
                let share = piece as f64 / pieces as f64;
                let linear = self.at(pair[0] + share * span_s);
                let value = |of: &Option<Vec<[f64; 2]>>, measured: f64| {
                    of.as_ref().map_or(measured, |states| between(&states[i], &states[i + 1], share, span_s))
                };
                times_s.push(if piece == pieces { pair[1] } else { pair[0] + share * span_s });
                poses.push(GripPose {
                    x_m: value(&x, linear.x_m),
                    z_m: value(&z, linear.z_m),
                    pitch_rad: value(&pitch, linear.pitch_rad),
                });
            }
        }
        GripTrajectory { times_s, poses }
    }
}

/// Cubic Hermite interpolation between two states (position, velocity) that lie `span_s` apart.
fn between(from: &[f64; 2], to: &[f64; 2], share: f64, span_s: f64) -> f64 {
    let (s, rest) = (share, 1.0 - share);
    let newer = s * s * (3.0 - 2.0 * s);
    (1.0 - newer) * from[0] + newer * to[0] + span_s * s * rest * (rest * from[1] - s * to[1])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::seed;
    use rand::Rng;
    use rand_distr::{Distribution, StandardNormal};

    const SD_M: f64 = 8e-4;

    /// Path sampled at 30 Hz with noise of `SD_M` on a true x.
    fn noisy(truth: impl Fn(f64) -> f64, samples: usize, rng: &mut impl Rng) -> GripTrajectory {
        let times_s: Vec<f64> = (0..samples).map(|i| i as f64 / 30.0).collect();
        let mut measured = |t: f64| truth(t) + SD_M * Distribution::<f64>::sample(&StandardNormal, rng);
        let poses = times_s.iter().map(|t| GripPose { x_m: measured(*t), z_m: 0.7, pitch_rad: 0.1 }).collect();
        GripTrajectory::new(times_s, poses).unwrap()
    }

    /// Root mean square error in m of x at 1000 times within the path.
    fn error_m(path: &GripTrajectory, truth: impl Fn(f64) -> f64) -> f64 {
        let last = path.times_s()[path.times_s().len() - 1];
        let square = |i: usize| (path.at(last * i as f64 / 999.0).x_m - truth(last * i as f64 / 999.0)).powi(2);
        ((0..1000).map(square).sum::<f64>() / 1000.0).sqrt()
    }

    #[test]
    fn noise_goes_and_the_motion_stays() {
        let still = |_: f64| 0.4;
        let sweep = |t: f64| 0.4 + 0.05 * (4.0 * t).sin();
        let stop = |t: f64| 0.4 + 0.3 * t.min(1.0);
        for (seed_number, truth, most_m) in
            [(1, &still as &dyn Fn(f64) -> f64, 2.5e-4), (2, &sweep, 5e-4), (3, &stop, 6e-4)]
        {
            let path = noisy(truth, 90, &mut seed::rng(9, seed_number));
            let smooth = path.smoothed(SD_M, 0.0);
            assert!(error_m(&smooth, truth) < most_m, "{seed_number}: {} m", error_m(&smooth, truth));
            assert!(error_m(&path, truth) > 6e-4);
        }
    }

    #[test]
    fn samples_of_no_noise_stay() {
        let path = noisy(|t| t.sin(), 40, &mut seed::rng(9, 4));
        assert_eq!(path.smoothed(0.0, 0.0), path);
        let smooth = path.smoothed(SD_M, 0.0);
        assert!(smooth.poses().iter().all(|p| (p.z_m - 0.7).abs() < 1e-9 && p.pitch_rad == 0.1));
        let times = smooth.times_s();
        assert_eq!([times[0], times[times.len() - 1]], [path.times_s()[0], path.times_s()[39]]);
        assert!(times.windows(2).all(|t| t[1] > t[0] && t[1] - t[0] < 1.01 * SPACING_S));
    }

    #[test]
    fn a_stated_noise_far_below_that_of_the_samples_follows_them() {
        let path = noisy(|_| 0.4, 60, &mut seed::rng(9, 5));
        let followed = path.smoothed(1e-7, 0.0);
        let most = path.times_s().iter().map(|t| (followed.at(*t).x_m - path.at(*t).x_m).abs()).fold(0.0, f64::max);
        assert!(most < 1e-5, "{most} m");
    }
}
