//! The arm: a first-order lag towards its target, with a speed limit.

use catenary_core::model::Arm;
use catenary_core::task::DeltaAnchor;

/// Where the end effector is on its way from one target to the next, in the plane. Times are s.
///
/// Along the straight line to the target the distance d follows d' = -min(d / time constant, greatest speed), whose
/// solution is closed, so that a position does not depend on how time is divided.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArmModel {
    time_constant_s: f64,
    max_speed_m_s: f64,
    start_m: [f64; 2],
    start_s: f64,
    target_m: [f64; 2],
}

impl ArmModel {
    /// An arm at rest at `position_m` (x, z).
    pub fn new(arm: &Arm, position_m: [f64; 2]) -> Self {
        Self {
            time_constant_s: arm.time_constant_s,
            max_speed_m_s: arm.max_speed_m_s,
            start_m: position_m,
            start_s: 0.0,
            target_m: position_m,
        }
    }

    /// The target (x, z) in m.
    pub fn target_m(&self) -> [f64; 2] {
        self.target_m
    }

    /// From `time_s` on the arm goes to `target_m`.
    pub fn set_target(&mut self, time_s: f64, target_m: [f64; 2]) {
        self.start_m = self.position_m(time_s);
        self.start_s = time_s;
        self.target_m = target_m;
    }

    /// From `time_s` on the arm goes to the delta (dx, dz) in m from its anchor.
    pub fn set_delta(&mut self, time_s: f64, delta_m: [f64; 2], anchor: DeltaAnchor) {
        let from = match anchor {
            DeltaAnchor::Measured => self.position_m(time_s),
            DeltaAnchor::LastTarget => self.target_m,
        };
        self.set_target(time_s, [from[0] + delta_m[0], from[1] + delta_m[1]]);
    }

    /// Position (x, z) in m at `time_s`, which must not be before the last target was set.
    pub fn position_m(&self, time_s: f64) -> [f64; 2] {
        let way = [self.target_m[0] - self.start_m[0], self.target_m[1] - self.start_m[1]];
        let distance_m = way[0].hypot(way[1]);
        if distance_m == 0.0 {
            return self.target_m;
        }
        let share_left = self.distance_left_m(distance_m, (time_s - self.start_s).max(0.0)) / distance_m;
        std::array::from_fn(|i| self.target_m[i] - share_left * way[i])
    }

    fn distance_left_m(&self, distance_m: f64, elapsed_s: f64) -> f64 {
        let (tau_s, speed) = (self.time_constant_s, self.max_speed_m_s);
        let lag_m = speed * tau_s;
        let full_speed_s = ((distance_m - lag_m) / speed).max(0.0);
        if elapsed_s <= full_speed_s {
            return distance_m - speed * elapsed_s;
        }
        if tau_s == 0.0 {
            return 0.0;
        }
        distance_m.min(lag_m) * (-(elapsed_s - full_speed_s) / tau_s).exp()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use catenary_core::GripPose;
    use proptest::prelude::*;

    fn arm(time_constant_s: f64) -> Arm {
        Arm { time_constant_s, max_speed_m_s: 0.5, start: GripPose::default() }
    }

    #[test]
    fn a_small_step_is_an_exponential_and_a_large_one_begins_at_full_speed() {
        let mut a = ArmModel::new(&arm(0.2), [0.0, 0.0]);
        a.set_target(1.0, [0.06, 0.0]);
        let expected = 0.06 * (1.0 - (-0.5f64).exp());
        assert!((a.position_m(1.1)[0] - expected).abs() < 1e-12);
        let mut a = ArmModel::new(&arm(0.2), [0.0, 0.0]);
        a.set_target(0.0, [1.0, 0.0]);
        assert!((a.position_m(1.0)[0] - 0.5).abs() < 1e-12);
        assert!((a.position_m(2.0)[0] - (1.0 - 0.1 * (-1.0f64).exp())).abs() < 1e-12);
    }

    #[test]
    fn ninety_percent_of_six_centimetres_take_the_measured_time() {
        let model = crate::parameters::tests::soft_bar();
        let mut a = ArmModel::new(&model.arm, [0.4, 0.4]);
        a.set_delta(0.0, [0.06, 0.0], DeltaAnchor::LastTarget);
        let share = (a.position_m(0.45)[0] - 0.4) / 0.06;
        assert!((share - 0.9).abs() < 0.05, "{share}");
    }

    #[test]
    fn deltas_add_up_on_the_last_target_and_fall_short_on_the_measured_pose() {
        let total = |anchor| {
            let mut a = ArmModel::new(&arm(0.2), [0.0, 0.0]);
            (0..10).for_each(|k| a.set_delta(0.1 * f64::from(k), [0.02, 0.0], anchor));
            a.position_m(10.0)[0]
        };
        assert!((total(DeltaAnchor::LastTarget) - 0.2).abs() < 1e-9);
        assert!(total(DeltaAnchor::Measured) < 0.12, "{}", total(DeltaAnchor::Measured));
    }

    proptest! {
        #[test]
        fn positions_do_not_depend_on_how_time_is_divided(tau in 0.0f64..0.5, t in 0.0f64..2.0, x in -0.5f64..0.5) {
            let mut whole = ArmModel::new(&arm(tau), [0.0, 0.1]);
            whole.set_target(0.0, [x, 0.0]);
            let mut parts = whole;
            parts.set_target(0.5 * t, [x, 0.0]);
            let (a, b) = (whole.position_m(t), parts.position_m(t));
            prop_assert!((a[0] - b[0]).abs() < 1e-12 && (a[1] - b[1]).abs() < 1e-12);
        }
    }
}
