//! Limit of the speed of the hand: of the reference that the law follows, and of the force that drives the hand on.

use crate::pose::ArmPose;
use nalgebra::{Isometry3, Translation3, Vector3, Vector6};

/// Share of a new target and of new gains that a cycle of 1 ms takes over (SERL's `filter_params`).
pub const FILTER: f64 = 0.005;
/// Period of a cycle, s.
pub const CYCLE_S: f64 = 1e-3;
/// Time constant with which the reference of the law follows a new target, s.
pub const REFERENCE_TIME_S: f64 = CYCLE_S / FILTER;
/// Share of the limit from which a force along the motion fades out. Chosen, as for the joints.
const FADE_FROM: f64 = 0.85;
/// Damping of a hand that is faster than the limit: N s/m, then N m s/rad. Chosen: it stops the default steady force of 20 N within
/// 0.2 m/s, and stays far from instability at 1 kHz.
const BRAKE: [f64; 2] = [100.0, 5.0];

/// Greatest speed of the hand on the way to a target.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpeedLimit {
    /// Greatest speed, m/s.
    pub linear_m_s: f64,
    /// Greatest angular speed, rad/s.
    pub angular_rad_s: f64,
}

impl Default for SpeedLimit {
    /// Above the 0.45 m/s that the emulated cell's gains reach, and far below the 1.7 m/s and 2.5 rad/s of a Panda.
    fn default() -> Self {
        Self { linear_m_s: 0.5, angular_rad_s: 1.0 }
    }
}

impl SpeedLimit {
    /// No limit.
    pub const NONE: Self = Self { linear_m_s: f64::INFINITY, angular_rad_s: f64::INFINITY };

    /// Moves a reference by `share` of its way to `goal`, and no faster than the limit within `period_s`.
    #[must_use]
    pub fn advance(&self, from: &Isometry3<f64>, goal: &Isometry3<f64>, share: f64, period_s: f64) -> Isometry3<f64> {
        let way = goal.translation.vector - from.translation.vector;
        let (length_m, farthest_m) = (way.norm(), self.linear_m_s * period_s);
        let step = if share * length_m > farthest_m { way * (farthest_m / length_m) } else { way * share };
        let (angle_rad, largest_rad) = (from.rotation.angle_to(&goal.rotation), self.angular_rad_s * period_s);
        let turn = if share * angle_rad > largest_rad { largest_rad / angle_rad } else { share };
        // A slerp of orientations half a turn apart has no shortest way: the orientation then stays.
        let rotation = from.rotation.try_slerp(&goal.rotation, turn, 1e-9).unwrap_or(from.rotation);
        Isometry3::from_parts(Translation3::from(from.translation.vector + step), rotation)
    }

    /// Moves a reference to `goal`, no faster than the limit within `period_s`.
    #[must_use]
    pub fn toward(&self, from: &ArmPose, goal: &ArmPose, period_s: f64) -> ArmPose {
        if from.distance_m(goal) <= self.linear_m_s * period_s && from.angle_rad(goal) <= self.angular_rad_s * period_s
        {
            // The goal as it was given: a conversion would change its last digits, and the sign of its quaternion.
            return *goal;
        }
        let next = self.advance(&from.isometry(), &goal.isometry(), 1.0, period_s);
        ArmPose::from_parts(next.translation.vector.into(), &next.rotation)
    }

    /// Fades out the part of a force (N, N m) that drives a hand on whose twist (m/s, rad/s) nears the limit, and brakes a faster one.
    #[must_use]
    pub fn brake(&self, force: &Vector6<f64>, twist: &Vector6<f64>) -> Vector6<f64> {
        let part = |row: usize, limit: f64, brake: f64| -> Vector3<f64> {
            let (force, velocity) = (force.fixed_rows::<3>(row).into_owned(), twist.fixed_rows::<3>(row).into_owned());
            let speed = velocity.norm();
            let from = FADE_FROM * limit;
            // Also for a limit that is infinite.
            if speed.is_nan() || speed <= from {
                return force;
            }
            let along = velocity / speed;
            let drive = force.dot(&along).max(0.0);
            let kept = ((limit - speed) / (limit - from)).clamp(0.0, 1.0);
            force - along * (drive * (1.0 - kept) + brake * (speed - limit).max(0.0))
        };
        let (f, m) = (part(0, self.linear_m_s, BRAKE[0]), part(3, self.angular_rad_s, BRAKE[1]));
        Vector6::new(f.x, f.y, f.z, m.x, m.y, m.z)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pose(x_m: f64) -> ArmPose {
        ArmPose { position_m: [x_m, 0.0, 0.3], quaternion_xyzw: [1.0, 0.0, 0.0, 0.0] }
    }

    #[test]
    fn a_reference_keeps_to_its_speed_and_arrives_exactly() {
        let limit = SpeedLimit { linear_m_s: 0.2, angular_rad_s: 0.5 };
        let turned = nalgebra::UnitQuaternion::from_euler_angles(0.0, 0.0, 0.4) * pose(0.4).rotation();
        let (mut at, goal) = (pose(0.4), ArmPose::from_parts([0.5, 0.0, 0.3], &turned));
        let mut steps = 0;
        while at != goal {
            let next = limit.toward(&at, &goal, 0.02);
            assert!(next.distance_m(&at) <= 0.2 * 0.02 + 1e-9 && next.angle_rad(&at) <= 0.5 * 0.02 + 1e-9, "{next:?}");
            (at, steps) = (next, steps + 1);
            assert!(steps < 1000);
        }
        // 0.1 m at 0.2 m/s takes 0.5 s, 0.4 rad at 0.5 rad/s take 0.8 s: 40 steps of 20 ms.
        assert!((40..=41).contains(&steps), "{steps}");
        assert_eq!(SpeedLimit::NONE.toward(&pose(0.1), &goal, 1e-3), goal);
    }

    #[test]
    fn a_low_pass_within_the_limit_is_unchanged() {
        let (from, goal) = (pose(0.4).isometry(), pose(0.41).isometry());
        let next = SpeedLimit::default().advance(&from, &goal, 0.005, 1e-3);
        assert!((next.translation.x - 0.400_05).abs() < 1e-12, "{next}");
    }

    #[test]
    fn a_force_drives_no_hand_beyond_the_limit_and_may_always_brake_it() {
        let limit = SpeedLimit { linear_m_s: 1.0, angular_rad_s: 2.0 };
        let along = |speed: f64, force: f64| {
            limit.brake(&Vector6::new(0.0, force, 3.0, 0.0, 0.0, 0.0), &Vector6::new(0.0, speed, 0.0, 0.0, 0.0, 0.0))
        };
        assert_eq!(along(0.8, 40.0)[1], 40.0);
        assert!((along(0.925, 40.0)[1] - 20.0).abs() < 1e-9, "{}", along(0.925, 40.0));
        assert!(along(1.0, 40.0)[1].abs() < 1e-9);
        assert!((along(1.1, 40.0)[1] + 10.0).abs() < 1e-9, "{}", along(1.1, 40.0));
        assert_eq!((along(0.95, -40.0)[1], along(0.95, 40.0)[2]), (-40.0, 3.0), "only the drive fades");
        assert_eq!(SpeedLimit::NONE.brake(&Vector6::repeat(5.0), &Vector6::repeat(9.0)), Vector6::repeat(5.0));
    }
}
