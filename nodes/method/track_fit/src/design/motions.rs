//! Motions of a hand that a laboratory can make with any arm: steps, turns, shakes and slow turns.

use catenary_core::{GripPose, GripTrajectory};
use std::f64::consts::TAU;

/// Time in s between two poses of a path.
const SAMPLE_S: f64 = 0.01;
/// Greatest speed in m/s and acceleration in m/s^2 of a motion: a third of what a Panda's hand may do.
const SPEED_M_S: f64 = 0.6;
const ACCELERATION_M_S2: f64 = 4.0;
/// Greatest rate of a turn in rad/s, half of what a Panda's last joint may do.
const TURN_RAD_S: f64 = 1.3;

/// Motion of the hand.
#[derive(Debug, Clone, PartialEq)]
pub struct Motion {
    /// Motion in words.
    pub words: String,
    /// Path, from the start pose on.
    pub path: GripTrajectory,
}

impl Motion {
    /// Duration in s.
    pub fn duration_s(&self) -> f64 {
        self.path.times_s().last().copied().unwrap_or(0.0)
    }

    /// Makes the motion of `seconds` whose pose differs by `offset` (x and z in m, pitch in rad) from the start.
    fn new(words: String, start: GripPose, seconds: f64, offset: impl Fn(f64) -> [f64; 3]) -> Option<Self> {
        let count = (seconds / SAMPLE_S).round() as usize;
        let times_s: Vec<f64> = (0..=count).map(|i| SAMPLE_S * i as f64).collect();
        let pose = |t: &f64| {
            let [x, z, pitch] = offset(*t);
            GripPose { x_m: start.x_m + x, z_m: start.z_m + z, pitch_rad: start.pitch_rad + pitch }
        };
        let poses = times_s.iter().map(pose).collect();
        GripTrajectory::new(times_s, poses).ok().map(|path| Self { words, path })
    }

    /// Returns true if the path stays within these limits of x and z in m.
    fn is_within(&self, limits_m: [[f64; 2]; 2]) -> bool {
        let within = |v: f64, [low, high]: [f64; 2]| (low..=high).contains(&v);
        self.path.poses().iter().all(|p| within(p.x_m, limits_m[0]) && within(p.z_m, limits_m[1]))
    }
}

/// Share, 0 to 1, of a move of minimum jerk after the share `s` of its time.
fn eased(s: f64) -> f64 {
    let s = s.clamp(0.0, 1.0);
    s * s * s * (10.0 + s * (6.0 * s - 15.0))
}

/// Returns motions from `start` that stay within `limits_m` of x and z. A step is followed by a rest in which the object swings.
pub fn motions(start: GripPose, limits_m: [[f64; 2]; 2]) -> Vec<Motion> {
    let mut all = Vec::new();
    // A move of minimum jerk has 1.9 times its mean speed, and 5.8 times distance over time squared as acceleration.
    let move_s = |distance: f64| (1.9 * distance / SPEED_M_S).max((5.8 * distance / ACCELERATION_M_S2).sqrt());
    for rest_s in [1.5, 3.0] {
        for by_m in [-0.2, -0.1, -0.05, 0.05, 0.1, 0.2] {
            let seconds = move_s(f64::abs(by_m));
            for (axis, word) in [(0, "x"), (1, "z")] {
                let words = format!("{:+.0} mm along {word} in {seconds:.2} s, then {rest_s} s of rest", 1e3 * by_m);
                all.push(Motion::new(words, start, seconds + rest_s, |t| {
                    std::array::from_fn(|i| if i == axis { by_m * eased(t / seconds) } else { 0.0 })
                }));
            }
        }
        for by_rad in [-0.8, -0.4, 0.4, 0.8] {
            let seconds = 1.9 * f64::abs(by_rad) / TURN_RAD_S;
            let words = format!("turn by {by_rad:+.1} rad in {seconds:.2} s, then {rest_s} s of rest");
            all.push(Motion::new(words, start, seconds + rest_s, |t| [0.0, 0.0, by_rad * eased(t / seconds)]));
        }
    }
    for frequency_hz in [0.5, 1.0, 2.0] {
        let omega = TAU * frequency_hz;
        // An amplitude that grows adds up to half of the acceleration and a tenth of the speed.
        let amplitude_m = (0.9 * SPEED_M_S / omega).min(ACCELERATION_M_S2 / (1.5 * omega * omega)).min(0.1);
        let words =
            format!("3 s of shaking along x by {:.0} mm at {frequency_hz} Hz, then 1 s of rest", 1e3 * amplitude_m);
        // The amplitude grows over the first half second, and falls over the last.
        let grown = move |t: f64| eased(2.0 * t).min(eased(2.0 * (3.0 - t)));
        all.push(Motion::new(words, start, 4.0, |t| [amplitude_m * grown(t) * (omega * t).sin(), 0.0, 0.0]));
    }
    let slow = |t: f64| 0.8 * (eased(t / 2.0) - 2.0 * eased((t - 2.0) / 3.0) + eased((t - 5.0) / 2.0));
    let words = "slow turn to +0.8 rad, to -0.8 rad and back in 7 s".to_owned();
    all.push(Motion::new(words, start, 7.0, |t| [0.0, 0.0, slow(t)]));
    all.into_iter().flatten().filter(|motion| motion.is_within(limits_m)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn motions_are_gentle_begin_at_the_start_and_keep_their_limits() {
        let start = GripPose { x_m: 0.4, z_m: 0.5, pitch_rad: 0.1 };
        let all = motions(start, [[0.0, 1.0], [0.0, 1.0]]);
        assert!(all.len() > 30);
        for motion in &all {
            let poses = motion.path.poses();
            assert_eq!(poses[0], start, "{}", motion.words);
            let rate = |pair: &[GripPose]| {
                let [dx, dz] = [pair[1].x_m - pair[0].x_m, pair[1].z_m - pair[0].z_m];
                [dx.hypot(dz) / SAMPLE_S, (pair[1].pitch_rad - pair[0].pitch_rad).abs() / SAMPLE_S]
            };
            let rates: Vec<[f64; 2]> = poses.windows(2).map(rate).collect();
            assert!(rates.iter().all(|[v, w]| *v < 1.1 * SPEED_M_S && *w < 1.1 * TURN_RAD_S), "{}", motion.words);
            let fastest = rates.windows(2).map(|pair| (pair[1][0] - pair[0][0]).abs() / SAMPLE_S).fold(0.0, f64::max);
            assert!(fastest < 1.2 * ACCELERATION_M_S2, "{}: {fastest} m/s^2", motion.words);
        }
        let narrow = motions(start, [[0.35, 0.45], [0.49, 0.51]]);
        assert!(!narrow.is_empty() && narrow.len() < all.len());
        assert!(narrow.iter().all(|m| m.path.poses().iter().all(|p| (0.35..=0.45).contains(&p.x_m))));
    }
}
