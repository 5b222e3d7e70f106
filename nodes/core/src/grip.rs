//! The pose of the clamped end and its measured path.

use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Pose of the clamped end in the plane of motion.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct GripPose {
    /// x in m, frame panda_link0.
    pub x_m: f64,
    /// z in m, frame panda_link0, up.
    pub z_m: f64,
    /// Rotation about +y in rad from the pose in which the model's grip angle holds; positive turns a hanging
    /// object towards -x.
    pub pitch_rad: f64,
}

impl GripPose {
    /// Orientation (x, y, z, w) of panda_hand_tcp in panda_link0: the tool points down at pitch 0, turned about +y by the pitch.
    pub fn quaternion_xyzw(&self) -> [f64; 4] {
        let (s, c) = (0.5 * self.pitch_rad).sin_cos();
        [c, 0.0, -s, 0.0]
    }

    /// The pitch of a tool whose orientation in panda_link0 is the unit quaternion (x, y, z, w): the angle by which its
    /// approach axis has turned from straight down, about +y.
    pub fn pitch_from_quaternion([x, y, z, w]: [f64; 4]) -> f64 {
        let approach_x = 2.0 * (x * z + w * y);
        let approach_z = 1.0 - 2.0 * (x * x + y * y);
        (-approach_x).atan2(-approach_z)
    }
}

/// A path of the clamped end: poses at increasing times, linear between them, held before the first and after the last.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct GripTrajectory {
    times_s: Vec<f64>,
    poses: Vec<GripPose>,
}

/// Why a path was refused.
#[derive(Debug, Error, PartialEq)]
pub enum GripError {
    /// No pose, or another number of poses than of times.
    #[error("a grip trajectory needs as many poses as times, and at least one: got {poses} poses, {times} times")]
    Length {
        /// Number of poses.
        poses: usize,
        /// Number of times.
        times: usize,
    },
    /// Times that stand still, run back, or are not finite.
    #[error("grip trajectory: time {index} is {time_s} s, not after {previous_s} s")]
    Order {
        /// Index of the offending time.
        index: usize,
        /// Its value.
        time_s: f64,
        /// The one before.
        previous_s: f64,
    },
    /// A pose that is not finite.
    #[error("grip trajectory: pose {0} is not finite")]
    NotFinite(usize),
}

impl GripTrajectory {
    /// Checks lengths, order and finiteness. `times_s` in s, strictly increasing.
    pub fn new(times_s: Vec<f64>, poses: Vec<GripPose>) -> Result<Self, GripError> {
        if times_s.is_empty() || times_s.len() != poses.len() {
            return Err(GripError::Length { poses: poses.len(), times: times_s.len() });
        }
        for (index, &time_s) in times_s.iter().enumerate() {
            let previous_s = if index == 0 { f64::NEG_INFINITY } else { times_s[index - 1] };
            if !time_s.is_finite() || time_s <= previous_s {
                return Err(GripError::Order { index, time_s, previous_s });
            }
        }
        let finite = |p: &GripPose| p.x_m.is_finite() && p.z_m.is_finite() && p.pitch_rad.is_finite();
        if let Some(index) = poses.iter().position(|p| !finite(p)) {
            return Err(GripError::NotFinite(index));
        }
        Ok(Self { times_s, poses })
    }

    /// The sampled times in s.
    pub fn times_s(&self) -> &[f64] {
        &self.times_s
    }

    /// The sampled poses.
    pub fn poses(&self) -> &[GripPose] {
        &self.poses
    }

    /// The pose at `time_s`, linear between samples and held outside them.
    pub fn at(&self, time_s: f64) -> GripPose {
        let next = self.times_s.partition_point(|&t| t <= time_s);
        if next == 0 {
            return self.poses[0];
        }
        let before = self.poses[next - 1];
        let Some(after) = self.poses.get(next) else { return before };
        let (t0, t1) = (self.times_s[next - 1], self.times_s[next]);
        let w = (time_s - t0) / (t1 - t0);
        let mix = |a: f64, b: f64| a + w * (b - a);
        GripPose {
            x_m: mix(before.x_m, after.x_m),
            z_m: mix(before.z_m, after.z_m),
            pitch_rad: mix(before.pitch_rad, after.pitch_rad),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pitch_survives_the_quaternion() {
        for pitch_rad in [-1.2, -0.1, 0.0, 0.3, 1.5] {
            let pose = GripPose { pitch_rad, ..GripPose::default() };
            let back = GripPose::pitch_from_quaternion(pose.quaternion_xyzw());
            assert!((back - pitch_rad).abs() < 1e-12, "{pitch_rad} became {back}");
        }
        assert_eq!(GripPose::pitch_from_quaternion([1.0, 0.0, 0.0, 0.0]), 0.0);
    }

    #[test]
    fn is_linear_between_samples_and_held_outside() {
        let pose = |x_m| GripPose { x_m, ..GripPose::default() };
        let path = GripTrajectory::new(vec![1.0, 2.0, 4.0], vec![pose(0.0), pose(1.0), pose(5.0)]).unwrap();
        let x: Vec<f64> = [0.0, 1.0, 1.5, 2.0, 3.0, 9.0].iter().map(|&t| path.at(t).x_m).collect();
        assert_eq!(x, [0.0, 0.0, 0.5, 1.0, 3.0, 5.0]);
        assert!(GripTrajectory::new(vec![1.0, 1.0], vec![pose(0.0); 2]).is_err());
        assert!(GripTrajectory::new(vec![1.0], vec![pose(f64::NAN)]).is_err());
    }
}
