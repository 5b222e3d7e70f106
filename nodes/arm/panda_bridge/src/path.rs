//! Path to the start pose: a straight line with a minimum-jerk profile in time.

use crate::pose::ArmPose;

/// Peak speed of a minimum-jerk profile over its mean speed (Flash and Hogan 1985).
const PEAK_OVER_MEAN: f64 = 1.875;
/// Minimum duration, s. Chosen: very short paths would have large accelerations.
const MIN_DURATION_S: f64 = 0.5;

/// Path between two poses, from rest to rest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StartPath {
    from: ArmPose,
    to: ArmPose,
    duration_s: f64,
}

impl StartPath {
    /// Plans a path with at most these speeds.
    pub fn new(from: ArmPose, to: ArmPose, max_speed_m_s: f64, max_turn_rad_s: f64) -> Self {
        let mean_time_s = (from.distance_m(&to) / max_speed_m_s).max(from.angle_rad(&to) / max_turn_rad_s);
        Self { from, to, duration_s: (PEAK_OVER_MEAN * mean_time_s).max(MIN_DURATION_S) }
    }

    /// Returns the duration, s.
    pub fn duration_s(&self) -> f64 {
        self.duration_s
    }

    /// Makes the path last long enough for a distance of its own, at no more than this speed; both in one unit, e.g. rad and rad/s.
    #[must_use]
    pub fn lasting_for(self, distance: f64, max_speed: f64) -> Self {
        Self { duration_s: self.duration_s.max(PEAK_OVER_MEAN * distance / max_speed), ..self }
    }

    /// Returns the share of the way after `elapsed_s`, 0 to 1.
    pub fn share(&self, elapsed_s: f64) -> f64 {
        let s = (elapsed_s / self.duration_s).clamp(0.0, 1.0);
        // Minimum-jerk polynomial 10 s^3 - 15 s^4 + 6 s^5 (Flash and Hogan 1985).
        s * s * s * (10.0 - 15.0 * s + 6.0 * s * s)
    }

    /// Returns the pose after `elapsed_s`; before the start and after the end, the pose of that end.
    pub fn at(&self, elapsed_s: f64) -> ArmPose {
        let share = self.share(elapsed_s);
        let position = std::array::from_fn(|i| {
            self.from.position_m[i] + share * (self.to.position_m[i] - self.from.position_m[i])
        });
        // Slerp fails only for orientations half a turn apart, because no shortest rotation exists. The path then has the
        // final orientation from its first instant.
        let turned = self.from.rotation().try_slerp(&self.to.rotation(), share, 1e-9);
        ArmPose::from_parts(position, &turned.unwrap_or_else(|| self.to.rotation()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn begins_and_ends_at_rest_and_keeps_to_its_speed() {
        let from = ArmPose { position_m: [0.3, 0.0, 0.2], quaternion_xyzw: [1.0, 0.0, 0.0, 0.0] };
        let to = ArmPose { position_m: [0.5, 0.05, 0.45], quaternion_xyzw: [1.0, 0.0, 0.0, 0.0] };
        let path = StartPath::new(from, to, 0.1, 0.5);
        assert_eq!(path.at(0.0), from);
        assert!(path.at(path.duration_s()).distance_m(&to) < 1e-12);
        let h = 1e-3;
        let speed = |t: f64| path.at(t + h).distance_m(&path.at(t)) / h;
        let fastest = (0..1000).map(|i| speed(path.duration_s() * f64::from(i) / 1000.0)).fold(0.0, f64::max);
        assert!(fastest <= 0.1001 && fastest > 0.099, "{fastest} m/s");
        assert!(speed(0.0) < 1e-4);
    }
}
