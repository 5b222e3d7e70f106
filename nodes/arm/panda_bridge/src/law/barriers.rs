//! Barriers around the law: limits of torque, torque rate, joint velocity and joint position.

use super::Joints;
use crate::kinematics::{JOINTS, LIMITS_RAD};

/// Share of a joint's velocity limit from which torque along the motion fades out. DROID's value on the same arm.
const FADE_FROM: f64 = 0.7;
/// Share of a joint's velocity limit from which a damping brakes the joint. DROID's value.
const BRAKE_FROM: f64 = 0.85;
/// Damping above [`BRAKE_FROM`], N m s/rad. DROID's value.
const BRAKE_N_M_S: f64 = 20.0;
/// Distance from a joint's position limit at which a spring begins, rad. DROID's value.
const MARGIN_RAD: f64 = 0.05;
/// Share of the torque limit that the spring has at the limit itself. Chosen: it outweighs the law, whose torques are mostly smaller.
const SPRING_SHARE: f64 = 0.5;
/// Share of the limits of torque that is used, so that rounding never exceeds them.
const TORQUE_SHARE: f64 = 0.99;
/// Torque change of a cycle, N m: the limit of the robot is 1 N m a cycle, and libfranka's own limiter stays 1e-6 below it.
const MAX_CHANGE_N_M: f64 = 1.0 - 1e-6;
/// Period of a cycle, s.
const CYCLE_S: f64 = 1e-3;

/// Limits of the joints.
#[derive(Debug, Clone, PartialEq)]
pub struct JointLimits {
    /// Least and greatest angles, rad.
    pub position_rad: [[f64; 2]; JOINTS],
    /// Greatest speeds, rad/s.
    pub velocity_rad_s: Joints,
    /// Greatest torques, N m.
    pub torque_n_m: Joints,
    /// The robot sends back the accepted torques in single precision, so that their rate is known only to half a unit in the last place.
    pub in_single_precision: bool,
}

impl Default for JointLimits {
    /// Limits of a Panda (Franka Emika, "Robot and interface specifications").
    fn default() -> Self {
        Self {
            position_rad: LIMITS_RAD,
            velocity_rad_s: Joints::from([2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61]),
            torque_n_m: Joints::from([87.0, 87.0, 87.0, 87.0, 12.0, 12.0, 12.0]),
            in_single_precision: false,
        }
    }
}

impl JointLimits {
    /// Limits of a Franka Research 3 (Franka Robotics, "Robot and interface specifications"). The speed limits are the fixed ones that its
    /// maker gives for a smaller range of positions; near a position limit the robot allows less, and the spring of the barriers brakes.
    #[must_use]
    pub fn fr3() -> Self {
        Self {
            position_rad: [
                [-2.7437, 2.7437],
                [-1.7837, 1.7837],
                [-2.9007, 2.9007],
                [-3.0421, -0.1518],
                [-2.8065, 2.8065],
                [0.5445, 4.5169],
                [-3.0159, 3.0159],
            ],
            velocity_rad_s: Joints::from([2.0, 1.0, 1.5, 1.25, 3.0, 1.5, 3.0]),
            in_single_precision: true,
            ..Self::default()
        }
    }

    /// Returns the first joint (from 1) that is nearer to a position limit than the barriers' margin, and its distance from that limit,
    /// rad. A motion that began there would push the arm away.
    #[must_use]
    pub fn pressed(&self, q: &Joints) -> Option<(usize, f64)> {
        let distance = |i: usize| (q[i] - self.position_rad[i][0]).min(self.position_rad[i][1] - q[i]);
        (0..JOINTS).find(|i| distance(*i) < MARGIN_RAD).map(|i| (i + 1, distance(i)))
    }
}

/// Barriers with their low-pass.
#[derive(Debug, Clone)]
pub struct Barriers {
    limits: JointLimits,
    /// Share of a new torque that a cycle takes over.
    gain: f64,
}

impl Barriers {
    /// Creates barriers with a first-order low-pass of this cut-off frequency, Hz; 1000 Hz and more switch it off.
    #[must_use]
    pub fn new(limits: JointLimits, cutoff_hz: f64) -> Self {
        let gain = if cutoff_hz >= 1.0 / CYCLE_S {
            1.0
        } else {
            // First-order low-pass in backward Euler: dt / (dt + 1 / (2 pi f)), as libfranka filters.
            CYCLE_S / (CYCLE_S + 1.0 / (std::f64::consts::TAU * cutoff_hz))
        };
        Self { limits, gain }
    }

    /// Returns the torques to send, N m: `wanted` behind all barriers. `last`: the torques that the robot accepted last.
    #[must_use]
    pub fn shape(&self, wanted: &Joints, q: &Joints, dq: &Joints, last: &Joints) -> Joints {
        Joints::from_fn(|i, _| {
            let limit = self.limits.torque_n_m[i] * TORQUE_SHARE;
            let braked = self.at_speed(i, wanted[i], dq[i]) + self.at_position(i, q[i]);
            let smooth = last[i] + self.gain * (braked.clamp(-limit, limit) - last[i]);
            // The rate comes last: the robot aborts for it at once, and for nothing else.
            let blur = if self.limits.in_single_precision { f64::from(f32::EPSILON) * last[i].abs() } else { 0.0 };
            let change = MAX_CHANGE_N_M - blur;
            smooth.clamp(last[i] - change, last[i] + change)
        })
    }

    /// Fades out a torque that drives a fast joint on, and brakes a faster one.
    fn at_speed(&self, joint: usize, torque: f64, dq: f64) -> f64 {
        let limit = self.limits.velocity_rad_s[joint];
        let share = dq.abs() / limit;
        let drives = torque * dq > 0.0;
        let kept = if drives { ((BRAKE_FROM - share) / (BRAKE_FROM - FADE_FROM)).clamp(0.0, 1.0) } else { 1.0 };
        let over = (dq.abs() - BRAKE_FROM * limit).max(0.0);
        torque * kept - BRAKE_N_M_S * over * dq.signum()
    }

    /// Torque of the spring near a position limit.
    fn at_position(&self, joint: usize, q: f64) -> f64 {
        let [low, high] = self.limits.position_rad[joint];
        let stiffness = SPRING_SHARE * self.limits.torque_n_m[joint] / MARGIN_RAD;
        stiffness * ((low + MARGIN_RAD - q).max(0.0) - (q - (high - MARGIN_RAD)).max(0.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kinematics::READY_RAD;

    fn barriers() -> Barriers {
        Barriers::new(JointLimits::default(), 1000.0)
    }

    /// Torque of one joint after as many cycles as the rate limit needs.
    fn settled(joint: usize, wanted: f64, q: Joints, dq: Joints) -> f64 {
        let mut wanted_all = Joints::zeros();
        wanted_all[joint] = wanted;
        let mut last = Joints::zeros();
        for _ in 0..200 {
            last = barriers().shape(&wanted_all, &q, &dq, &last);
        }
        last[joint]
    }

    #[test]
    fn a_quiet_arm_gets_what_the_law_wants() {
        let wanted = Joints::from([0.5, -0.9, 0.1, 0.0, -0.3, 0.2, 0.7]);
        let got = barriers().shape(&wanted, &READY_RAD.into(), &Joints::zeros(), &Joints::zeros());
        assert_eq!(got, wanted);
    }

    #[test]
    fn torque_changes_by_less_than_one_newton_metre_a_cycle() {
        let wanted = Joints::from([50.0; JOINTS]);
        let mut last = Joints::from([-3.0; JOINTS]);
        for _ in 0..20 {
            let next = barriers().shape(&wanted, &READY_RAD.into(), &Joints::zeros(), &last);
            assert!((next - last).amax() < 1.0, "{next}");
            last = next;
        }
    }

    #[test]
    fn torque_stays_below_the_limit_of_the_joint() {
        for (joint, limit) in [(0, 87.0), (6, 12.0)] {
            let got = settled(joint, 500.0, READY_RAD.into(), Joints::zeros());
            assert!(got < limit && got > 0.98 * limit, "{got}");
        }
    }

    #[test]
    fn a_fast_joint_is_not_driven_on_and_a_faster_one_is_braked() {
        let at = |share: f64, torque: f64| {
            let mut dq = Joints::zeros();
            dq[1] = share * 2.175;
            settled(1, torque, READY_RAD.into(), dq)
        };
        assert!((at(0.69, 10.0) - 10.0).abs() < 1e-9);
        assert!((at(0.775, 10.0) - 5.0).abs() < 1e-9, "{}", at(0.775, 10.0));
        assert!(at(0.85, 10.0).abs() < 1e-9);
        assert!((at(1.0, 10.0) + 20.0 * 0.15 * 2.175).abs() < 1e-9, "{}", at(1.0, 10.0));
        assert!((at(0.84, -10.0) + 10.0).abs() < 1e-9, "a torque against the motion passes");
    }

    #[test]
    fn a_spring_pushes_off_a_position_limit() {
        let mut q = Joints::from(READY_RAD);
        q[3] = -3.0718 + 0.02;
        // Half the torque limit at the limit itself, from 0.05 rad before it.
        let got = settled(3, 0.0, q, Joints::zeros());
        assert!((got - 0.5 * 87.0 * 0.6).abs() < 1e-9, "{got}");
    }

    #[test]
    fn a_ramp_in_single_precision_stays_below_the_rate_of_the_robot() {
        let barriers = Barriers::new(JointLimits::fr3(), 1000.0);
        let (wanted, mut accepted) = (Joints::from([86.0; JOINTS]), Joints::zeros());
        for _ in 0..90 {
            // The robot judges by what it received, and sends that back rounded.
            let told = accepted.map(|v| f64::from(v as f32));
            let next = barriers.shape(&wanted, &READY_RAD.into(), &Joints::zeros(), &told);
            assert!((next - accepted).amax() <= 1.0, "{}", (next - accepted).amax());
            accepted = next;
        }
    }

    #[test]
    fn a_joint_near_its_limit_is_named() {
        let limits = JointLimits::default();
        assert_eq!(limits.pressed(&READY_RAD.into()), None);
        let mut q = Joints::from(READY_RAD);
        q[3] = -3.06;
        let (joint, distance_rad) = limits.pressed(&q).unwrap();
        assert_eq!(joint, 4);
        assert!((distance_rad - 0.0118).abs() < 1e-9);
    }

    #[test]
    fn the_low_pass_is_libfrankas() {
        let wanted = Joints::from([0.1; JOINTS]);
        let low_pass = Barriers::new(JointLimits::default(), 100.0);
        let got = low_pass.shape(&wanted, &READY_RAD.into(), &Joints::zeros(), &Joints::zeros());
        // Measured of libfranka 0.9.2: the first of a 0.1 N m step.
        assert!((got[0] - 0.038_587_0).abs() < 1e-7, "{}", got[0]);
    }
}
