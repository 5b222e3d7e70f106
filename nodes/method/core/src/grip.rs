//! Pose of the clamped end of the object, and its path over time.

mod smoothing;

use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Lever in m that converts the noise of the hand's position into that of its pitch, in simulated recordings and in residuals
/// alike. It is about the length of a Panda's hand, 0.1034 m from flange to fingertips.
pub const POSE_LEVER_M: f64 = 0.1;

/// Pose of the clamped end in the plane of motion.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct GripPose {
    /// x in m, frame panda_link0.
    pub x_m: f64,
    /// z in m, frame panda_link0, up.
    pub z_m: f64,
    /// Rotation about +y in rad. At 0 the clamped tangent has the model's grip angle; positive turns a hanging object
    /// towards -x.
    pub pitch_rad: f64,
}

impl GripPose {
    /// Orientation (x, y, z, w) of panda_hand_tcp in panda_link0. The tool points down at pitch 0 and turns about +y.
    pub fn quaternion_xyzw(&self) -> [f64; 4] {
        // A half turn about x points the tool down; the pitch about y follows it.
        let (s, c) = (0.5 * self.pitch_rad).sin_cos();
        [c, 0.0, -s, 0.0]
    }

    /// Pitch in rad of a tool whose orientation in panda_link0 is the unit quaternion (x, y, z, w): the angle about +y
    /// between its approach axis and straight down.
    pub fn pitch_from_quaternion([x, y, z, w]: [f64; 4]) -> f64 {
        // The third column of the rotation matrix: the tool's own z axis, of which only the part in the plane counts.
        let approach_x = 2.0 * (x * z + w * y);
        let approach_z = 1.0 - 2.0 * (x * x + y * y);
        (-approach_x).atan2(-approach_z)
    }
}

/// Path of the clamped end: poses at increasing times. It is linear between them, and constant before the first and
/// after the last.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct GripTrajectory {
    times_s: Vec<f64>,
    poses: Vec<GripPose>,
}

/// Reason for which a path is refused.
#[derive(Debug, Error, PartialEq)]
pub enum GripError {
    /// No poses, or numbers of poses and times that differ.
    #[error("a grip trajectory needs as many poses as times, and at least one: got {poses} poses, {times} times")]
    Length {
        /// Number of poses.
        poses: usize,
        /// Number of times.
        times: usize,
    },
    /// Times that are not strictly increasing, or not finite.
    #[error("grip trajectory: time {index} is {time_s} s, not after {previous_s} s")]
    Order {
        /// Index of the offending time.
        index: usize,
        /// Offending time in s.
        time_s: f64,
        /// Time before it in s.
        previous_s: f64,
    },
    /// A pose that is not finite.
    #[error("grip trajectory: pose {0} is not finite")]
    NotFinite(usize),
}

impl GripTrajectory {
    /// Builds a path from strictly increasing times in s and one pose for each.
    ///
    /// # Errors
    /// [`GripError`] if lengths, order or finiteness are wrong.
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

    /// Path with all times later by `by_s` in s.
    ///
    /// # Errors
    /// [`GripError`] if two times fall together.
    pub fn shifted(self, by_s: f64) -> Result<Self, GripError> {
        Self::new(self.times_s.into_iter().map(|time_s| time_s + by_s).collect(), self.poses)
    }

    /// Sampled times in s.
    pub fn times_s(&self) -> &[f64] {
        &self.times_s
    }

    /// Sampled poses.
    pub fn poses(&self) -> &[GripPose] {
        &self.poses
    }

    /// Pose at `time_s`: linear between samples, constant outside them.
    pub fn at(&self, time_s: f64) -> GripPose {
        // Index of the first sample after `time_s`.
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
