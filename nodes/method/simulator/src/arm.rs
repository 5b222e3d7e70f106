//! Arm: motion towards targets by a law, with delay and faults as the episode's settings prescribe.

use crate::episode_model::ArmSettings;
use catenary_core::model::{ArmLaw, Impedance};
use catenary_core::{DeltaAnchor, GripPose};
use std::collections::VecDeque;

/// Period in s of the arm's control loop.
// A Franka arm is controlled at 1 kHz.
const TICK_S: f64 = 1e-3;

/// Planar motion of the end effector.
///
/// The arm moves in a loop of 1 kHz, as a real arm's controller does. Between two ticks its position is linear in time. The
/// motion does not depend on the times at which `run_to` is called.
#[derive(Debug, Clone)]
pub struct ArmModel {
    settings: ArmSettings,
    /// Target commanded last, (x, z) in m.
    target_m: [f64; 2],
    /// Way (x, z) in m by which the arm exceeds its target, from the excess of its displacements.
    excess_m: [f64; 2],
    /// Targets that the loop follows later, with their due times in s.
    pending: VecDeque<(f64, [f64; 2])>,
    /// Target that the loop follows, (x, z) in m.
    followed_m: [f64; 2],
    /// Reference of the impedance law, (x, z) in m.
    reference_m: [f64; 2],
    velocity_m_s: [f64; 2],
    /// Velocity and reference before the newest tick.
    before: [[f64; 2]; 2],
    /// Positions at the ticks from `first_tick` on. The last one belongs to the newest tick.
    path_m: Vec<[f64; 2]>,
    first_tick: u64,
}

impl ArmModel {
    /// Makes an arm at rest at `position_m` (x, z) at time 0.
    pub fn new(settings: &ArmSettings, position_m: [f64; 2]) -> Self {
        Self {
            settings: settings.clone(),
            target_m: position_m,
            excess_m: [0.0; 2],
            pending: VecDeque::new(),
            followed_m: position_m,
            reference_m: position_m,
            velocity_m_s: [0.0; 2],
            before: [[0.0; 2], position_m],
            path_m: vec![position_m],
            first_tick: 0,
        }
    }

    /// Returns the target (x, z) in m that was commanded last.
    pub fn target_m(&self) -> [f64; 2] {
        self.target_m
    }

    /// Commands the target `target_m` (x, z) at `time_s`, which must not lie before the time of [`Self::run_to`].
    pub fn set_target(&mut self, time_s: f64, target_m: [f64; 2]) {
        let displacement_m = [0, 1].map(|i| target_m[i] - self.target_m[i]);
        self.command(time_s, target_m, displacement_m, 1.0);
    }

    /// Commands the target `target_m` at `time_s` by a displacement. `kept` is the share of the earlier excess that the arm
    /// keeps: all of it if displacements start at the last target, none if they start at the measured pose, which holds it.
    fn command(&mut self, time_s: f64, target_m: [f64; 2], displacement_m: [f64; 2], kept: f64) {
        self.run_to(time_s);
        self.target_m = target_m;
        let mut executed = target_m;
        if !self.settings.displacements.is_empty() {
            self.excess_m = self.excess_m.map(|e| kept * e);
            for term in &self.settings.displacements {
                let more = term.excess_m(displacement_m);
                self.excess_m = [0, 1].map(|i| self.excess_m[i] + more[i]);
            }
            executed = [0, 1].map(|i| target_m[i] + self.excess_m[i]);
        }
        let followed = self.settings.terms.iter().fold(executed, |target, term| term.target(time_s, target));
        let due_s = time_s + self.settings.delay_s;
        self.pending.push_back((due_s, followed));
        // The loop has run to the end of the tick. A target that comes within the tick counts for the rest of it, so
        // that the tick is undone and run again.
        if self.newest_tick() as f64 - due_s / TICK_S > 1e-6 && self.path_m.len() > 1 {
            self.path_m.pop();
            [self.velocity_m_s, self.reference_m] = self.before;
        }
    }

    /// Commands at `time_s` the target at the delta (dx, dz) in m from the arm's anchor.
    pub fn set_delta(&mut self, time_s: f64, delta_m: [f64; 2]) {
        self.run_to(time_s);
        let ArmSettings { anchor, other_anchor_share, .. } = self.settings;
        let (target_m, delta_m) = anchor.limited(delta_m, self.position_m(time_s), self.target_m, other_anchor_share);
        let kept = match anchor {
            DeltaAnchor::LastTarget => 1.0 - other_anchor_share,
            DeltaAnchor::Measured => other_anchor_share,
        };
        self.command(time_s, target_m, delta_m, kept);
    }

    fn newest_tick(&self) -> u64 {
        self.first_tick + self.path_m.len() as u64 - 1
    }

    /// Runs the loop until the position at `time_s` is known. Positions before the last call's time are dropped.
    pub fn run_to(&mut self, time_s: f64) {
        // A time that is a multiple of the tick up to rounding needs no further tick.
        let wanted = (time_s / TICK_S - 1e-6).ceil().max(0.0) as u64;
        let newest = self.newest_tick();
        if wanted <= newest {
            return;
        }
        // The last two positions are kept, because the present time lies between them.
        let forgotten = self.path_m.len().saturating_sub(2);
        self.path_m.drain(..forgotten);
        self.first_tick += forgotten as u64;
        let mut position_m = self.path_m[self.path_m.len() - 1];
        for tick in newest..wanted {
            let now_s = tick as f64 * TICK_S;
            while self.pending.front().is_some_and(|(t, _)| *t <= now_s) {
                self.followed_m = self.pending.pop_front().map_or(self.followed_m, |(_, target)| target);
            }
            // A target that comes within the tick is followed for the rest of it.
            let coming = self.pending.front().map(|(time_s, target)| ((tick + 1) as f64 - time_s / TICK_S, *target));
            let (share, coming_m) = coming.filter(|(share, _)| *share > 0.0).unwrap_or((0.0, self.followed_m));
            let mixed = |a: [f64; 2], b: [f64; 2]| [0, 1].map(|i| a[i] + share * (b[i] - a[i]));
            self.before = [self.velocity_m_s, self.reference_m];
            position_m = match self.settings.law {
                ArmLaw::Lag { time_constant_s, max_speed_m_s } => {
                    let towards = |target| self.lag(position_m, target, time_constant_s, max_speed_m_s);
                    let settled_m = towards(self.followed_m);
                    let next_m = if share > 0.0 { mixed(settled_m, towards(coming_m)) } else { settled_m };
                    self.velocity_m_s = [0, 1].map(|i| (next_m[i] - position_m[i]) / TICK_S);
                    next_m
                }
                ArmLaw::Impedance(law) => self.impedance(position_m, mixed(self.followed_m, coming_m), &law),
            };
            self.path_m.push(position_m);
        }
    }

    /// Makes one tick of the lag law along the straight line to the target. d is the distance to the target less the
    /// standing error. It follows d' = -min(d / time constant, largest speed), which has a closed solution.
    fn lag(&self, position_m: [f64; 2], target_m: [f64; 2], time_constant_s: f64, max_speed_m_s: f64) -> [f64; 2] {
        let way = [target_m[0] - position_m[0], target_m[1] - position_m[1]];
        let distance_m = way[0].hypot(way[1]);
        let left_m = distance_m - self.settings.standing_error_m;
        if left_m <= 0.0 {
            return position_m;
        }
        let tau_s = time_constant_s + self.settings.extra_lag_s;
        let share = 1.0 - distance_left_m(left_m, TICK_S, tau_s, max_speed_m_s) / left_m;
        let step_m = share * left_m / distance_m;
        [0, 1].map(|i| position_m[i] + step_m * way[i])
    }

    /// Makes one tick of the impedance law m x'' = K clip(r - x) - D x' - friction. The reference r lags behind the
    /// target, and keeps to its greatest speed along the way.
    fn impedance(&mut self, position_m: [f64; 2], target_m: [f64; 2], law: &Impedance) -> [f64; 2] {
        let tau_s = law.reference_time_constant_s + self.settings.extra_lag_s;
        let nearer = if tau_s > 0.0 { -(-TICK_S / tau_s).exp_m1() } else { 1.0 };
        let per_mass = TICK_S / law.mass_kg;
        // Damping is implicit, so that a stiff law stays stable at 1 ms.
        let damped = 1.0 / (1.0 + per_mass * law.damping_n_s_m);
        let mut velocity = [0.0; 2];
        let mut way_m = [0, 1].map(|i| nearer * (target_m[i] - self.reference_m[i]));
        if let Some(limit) = law.max_speed_m_s {
            let (length_m, farthest_m) = (way_m[0].hypot(way_m[1]), TICK_S * limit);
            // A slower reference keeps its way to the bit.
            if length_m > farthest_m {
                way_m = way_m.map(|v| v * (farthest_m / length_m));
            }
        }
        for i in 0..2 {
            self.reference_m[i] += way_m[i];
            let error_m = (self.reference_m[i] - position_m[i]).clamp(-law.clip_m, law.clip_m);
            velocity[i] = damped * (self.velocity_m_s[i] + per_mass * law.stiffness_n_m * error_m);
        }
        // Coulomb friction reduces the speed, at most to zero. A standing error e is modelled as an additional friction K
        // e. The spring force of the law equals it at the distance e, where the arm stops.
        let friction_n = law.friction_n + law.stiffness_n_m * self.settings.standing_error_m;
        let speed = velocity[0].hypot(velocity[1]);
        let kept = if speed > 0.0 { (1.0 - damped * per_mass * friction_n / speed).max(0.0) } else { 0.0 };
        self.velocity_m_s = velocity.map(|v| kept * v);
        [0, 1].map(|i| position_m[i] + TICK_S * self.velocity_m_s[i])
    }

    /// Returns the position (x, z) in m at `time_s`. `time_s` must not be earlier than the time of the second-last call of
    /// [`Self::run_to`]. After the newest tick the position is constant.
    pub fn position_m(&self, time_s: f64) -> [f64; 2] {
        let tick = (time_s / TICK_S - self.first_tick as f64).max(0.0);
        let (k, last) = (tick.floor() as usize, self.path_m.len() - 1);
        if k >= last {
            return self.path_m[last];
        }
        let share = tick - k as f64;
        let (from, to) = (self.path_m[k], self.path_m[k + 1]);
        [0, 1].map(|i| from[i] + share * (to[i] - from[i]))
    }

    /// Returns the hand's pose at `time_s`, for a hand of constant pitch.
    pub fn grip(&self, time_s: f64, pitch_rad: f64) -> GripPose {
        let [x_m, z_m] = self.position_m(time_s);
        GripPose { x_m, z_m, pitch_rad }
    }

    /// Returns the velocity (x, z) in m/s at the newest tick.
    pub fn velocity_m_s(&self) -> [f64; 2] {
        self.velocity_m_s
    }
}

/// Returns the rest of a distance in m after `elapsed_s`: full speed first, then an exponential of time constant
/// `tau_s`.
fn distance_left_m(distance_m: f64, elapsed_s: f64, tau_s: f64, max_speed_m_s: f64) -> f64 {
    let lag_m = max_speed_m_s * tau_s;
    // The speed limit acts while d / tau exceeds it, that is beyond d = max_speed * tau.
    let full_speed_s = ((distance_m - lag_m) / max_speed_m_s).max(0.0);
    if elapsed_s <= full_speed_s {
        return distance_m - max_speed_m_s * elapsed_s;
    }
    if tau_s == 0.0 {
        return 0.0;
    }
    distance_m.min(lag_m) * (-(elapsed_s - full_speed_s) / tau_s).exp()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::episode_model::DisplacementTerm;
    use proptest::prelude::*;

    fn lag(time_constant_s: f64) -> ArmSettings {
        ArmSettings::new(ArmLaw::Lag { time_constant_s, max_speed_m_s: 0.5 }, DeltaAnchor::LastTarget)
    }

    fn impedance(change: impl FnOnce(&mut Impedance)) -> ArmSettings {
        let mut law = Impedance::default();
        change(&mut law);
        ArmSettings::new(ArmLaw::Impedance(law), DeltaAnchor::LastTarget)
    }

    /// Distances covered along x in m at the given times, after a step of 6 cm.
    fn after_six_centimetres(settings: &ArmSettings, times_s: &[f64]) -> Vec<f64> {
        let mut arm = ArmModel::new(settings, [0.4, 0.4]);
        arm.set_target(0.0, [0.46, 0.4]);
        let x = |t: &f64| {
            arm.run_to(*t);
            arm.position_m(*t)[0] - 0.4
        };
        times_s.iter().map(x).collect()
    }

    /// Rise time in s: 90 % of 6 cm are covered.
    fn rise_s(settings: &ArmSettings) -> f64 {
        let times: Vec<f64> = (1..3000).map(|i| 1e-3 * f64::from(i)).collect();
        let covered = after_six_centimetres(settings, &times);
        times[covered.iter().position(|x| *x >= 0.054).expect("the arm arrives")]
    }

    #[test]
    fn a_small_step_is_an_exponential_and_a_large_one_begins_at_full_speed() {
        let expected = 0.06 * (1.0 - (-0.5f64).exp());
        assert!((after_six_centimetres(&lag(0.2), &[0.1])[0] - expected).abs() < 1e-12);
        let mut arm = ArmModel::new(&lag(0.2), [0.0, 0.0]);
        arm.set_target(0.0, [1.0, 0.0]);
        for (time_s, expected) in [(1.0, 0.5), (2.0, 1.0 - 0.1 * (-1.0f64).exp())] {
            arm.run_to(time_s);
            assert!((arm.position_m(time_s)[0] - expected).abs() < 1e-9, "{:?}", arm.position_m(time_s));
        }
    }

    #[test]
    fn shipped_arm_covers_six_centimetres_in_the_measured_time() {
        let model = crate::parameters::tests::soft_bar();
        let rise = rise_s(&ArmSettings::new(model.arm.law, DeltaAnchor::LastTarget));
        assert!((rise - 0.45).abs() < 0.1, "{rise} s");
    }

    // Measured on an emulated arm with a Cartesian impedance law, step of 6 cm in x. Stiffness 2000 N/m: 90 % after
    // 0.45 s. Error clipped at 3 mm: 1.16 s. Stiffness 150 to 200 N/m with Coulomb friction: 10 to 13 mm short for
    // ever.
    #[test]
    fn stiff_impedance_law_rises_in_the_measured_time_and_arrives() {
        let settings = impedance(|_| ());
        assert!((rise_s(&settings) - 0.45).abs() < 0.07, "{} s", rise_s(&settings));
        assert!((after_six_centimetres(&settings, &[5.0])[0] - 0.06).abs() < 1e-4);
    }

    #[test]
    fn the_response_by_which_laws_are_compared_is_that_of_the_simulated_arm() {
        let times: Vec<f64> = (1..=1500).map(|i| 1e-3 * f64::from(i)).collect();
        let slow = impedance(|law| (law.clip_m, law.max_speed_m_s) = (0.02, Some(0.1)));
        for settings in [lag(0.16), lag(0.0), impedance(|law| (law.clip_m, law.friction_n) = (0.02, 2.0)), slow] {
            let simulated = after_six_centimetres(&settings, &times);
            let compared = settings.law.step_response_m();
            let apart = simulated.iter().zip(&compared).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(simulated.len() == compared.len() && apart < 2e-4, "{apart} m apart with {}", settings.law);
        }
    }

    #[test]
    fn a_reference_that_is_slower_than_its_limit_keeps_every_bit_and_a_faster_one_keeps_to_it() {
        let path = |max_speed_m_s, delta_m: [f64; 2]| {
            let mut arm =
                ArmModel::new(&impedance(|law| (law.clip_m, law.max_speed_m_s) = (0.02, max_speed_m_s)), [0.4, 0.4]);
            let step = |k: u32| {
                arm.set_delta(0.25 * f64::from(k), delta_m);
                arm.run_to(0.25 * f64::from(k + 1));
                arm.position_m(0.25 * f64::from(k + 1))
            };
            (0..8).map(step).collect::<Vec<[f64; 2]>>()
        };
        // A target leads the hand by at most 90 mm: 0.45 m/s.
        assert_eq!(path(Some(0.5), [0.06, 0.0]), path(None, [0.06, 0.0]));
        assert_eq!(path(Some(0.5), [0.06, -0.06]), path(None, [0.06, -0.06]));
        assert_ne!(path(Some(0.4), [0.06, -0.06]), path(None, [0.06, -0.06]));
        let mut slow = ArmModel::new(&impedance(|law| law.max_speed_m_s = Some(0.1)), [0.0, 0.0]);
        slow.set_target(0.0, [0.3, 0.4]);
        slow.run_to(2.0);
        let [x, z] = slow.reference_m;
        assert!((x.hypot(z) - 0.2).abs() < 1e-9 && (z / x - 4.0 / 3.0).abs() < 1e-9, "({x}, {z})");
    }

    #[test]
    fn impedance_law_with_a_tight_clip_is_slow() {
        let settings = impedance(|law| (law.clip_m, law.friction_n) = (0.003, 1.9));
        assert!((rise_s(&settings) - 1.16).abs() < 0.2, "{} s", rise_s(&settings));
    }

    #[test]
    fn soft_impedance_law_with_friction_stays_a_centimetre_short() {
        for stiffness in [150.0f64, 200.0] {
            let settings = impedance(|law| {
                (law.stiffness_n_m, law.damping_n_s_m, law.friction_n) = (stiffness, 2.0 * stiffness.sqrt(), 1.9);
                law.clip_m = 0.1;
            });
            let short_m = 0.06 - after_six_centimetres(&settings, &[10.0])[0];
            assert!((0.008..=0.014).contains(&short_m), "{short_m} m at {stiffness} N/m");
        }
    }

    #[test]
    fn deltas_add_up_on_the_last_target_and_fall_short_on_the_measured_pose() {
        let total = |anchor, share| {
            let settings = ArmSettings { anchor, other_anchor_share: share, ..lag(0.2) };
            let mut arm = ArmModel::new(&settings, [0.0, 0.0]);
            (0..10).for_each(|k| arm.set_delta(0.1 * f64::from(k), [0.02, 0.0]));
            arm.run_to(10.0);
            arm.position_m(10.0)[0]
        };
        // Ten deltas of 2 cm, one every 0.1 s, faster than the arm's time constant of 0.2 s.
        let (target, measured) = (total(DeltaAnchor::LastTarget, 0.0), total(DeltaAnchor::Measured, 0.0));
        assert!((target - 0.2).abs() < 1e-9 && measured < 0.12, "{target} {measured}");
        assert!((total(DeltaAnchor::LastTarget, 1.0) - measured).abs() < 1e-12);
    }

    /// Excess of a tenth of each displacement.
    struct Tenth;

    impl DisplacementTerm for Tenth {
        fn excess_m(&self, displacement_m: [f64; 2]) -> [f64; 2] {
            displacement_m.map(|d| 0.1 * d)
        }
    }

    #[test]
    fn excesses_add_up_on_the_last_target_and_are_part_of_a_measured_pose() {
        let arrives_m = |anchor, share, by_target: bool| {
            let mut arm = ArmModel::new(
                &ArmSettings {
                    anchor,
                    other_anchor_share: share,
                    displacements: vec![std::sync::Arc::new(Tenth)],
                    ..lag(0.02)
                },
                [0.0, 0.0],
            );
            for k in 0..3 {
                let time_s = 5.0 * f64::from(k);
                if by_target {
                    arm.set_target(time_s, [0.02 * f64::from(k + 1), 0.0]);
                } else {
                    arm.set_delta(time_s, [0.02, 0.0]);
                }
            }
            arm.run_to(20.0);
            arm.position_m(20.0)[0]
        };
        // Three displacements of 2 cm, each executed with 2.2 cm before the next.
        for (anchor, share) in
            [(DeltaAnchor::LastTarget, 0.0), (DeltaAnchor::Measured, 0.0), (DeltaAnchor::Measured, 1.0)]
        {
            assert!((arrives_m(anchor, share, false) - 0.066).abs() < 1e-9, "{anchor:?} {share}");
        }
        assert!((arrives_m(DeltaAnchor::LastTarget, 0.0, true) - 0.066).abs() < 1e-9);
    }

    #[test]
    fn delay_and_standing_error_have_their_stated_size() {
        let late = ArmSettings { delay_s: 0.05, ..lag(0.1) };
        let (on_time, delayed) =
            (after_six_centimetres(&lag(0.1), &[0.2]), after_six_centimetres(&late, &[0.05, 0.25]));
        assert_eq!(delayed[0], 0.0);
        assert!((delayed[1] - on_time[0]).abs() < 1e-12);
        let sticking = ArmSettings { standing_error_m: 0.004, ..lag(0.1) };
        assert!((after_six_centimetres(&sticking, &[5.0])[0] - 0.056).abs() < 1e-9);
        let soft = ArmSettings { standing_error_m: 0.004, ..impedance(|law| law.clip_m = 1.0) };
        assert!((after_six_centimetres(&soft, &[5.0])[0] - 0.056).abs() < 5e-4);
    }

    #[test]
    fn a_delay_acts_within_a_tick_wherever_the_command_comes() {
        let laws = [ArmLaw::Lag { time_constant_s: 0.1, max_speed_m_s: 0.5 }, ArmLaw::Impedance(Impedance::default())];
        for (law, commanded_s) in laws.into_iter().flat_map(|law| [(law, 0.1), (law, 0.0995), (law, 0.1003)]) {
            let x = |delay_s: f64| {
                let mut arm = ArmModel::new(
                    &ArmSettings { delay_s, ..ArmSettings::new(law, DeltaAnchor::LastTarget) },
                    [0.4, 0.4],
                );
                arm.run_to(commanded_s);
                arm.set_target(commanded_s, [0.46, 0.4]);
                arm.run_to(0.25);
                arm.position_m(0.25)[0]
            };
            let slope = |from: f64, to: f64| (x(to) - x(from)) / (to - from);
            for delay_s in [0.0, 0.02, 0.0203] {
                let (whole, part) = (slope(delay_s, delay_s + 2e-3), slope(delay_s, delay_s + 1e-9));
                assert!(
                    (part / whole - 1.0).abs() < 0.05,
                    "{law:?}, {commanded_s} s, {delay_s} s: {part}, {whole} m/s"
                );
            }
        }
    }

    proptest! {
        #[test]
        fn positions_do_not_depend_on_how_time_is_divided(tau in 0.0f64..0.5, t in 0.0f64..2.0, x in -0.5f64..0.5) {
            let mut whole = ArmModel::new(&lag(tau), [0.0, 0.1]);
            whole.set_target(0.0, [x, 0.0]);
            let mut parts = whole.clone();
            parts.run_to(0.3 * t);
            parts.run_to(0.5 * t);
            whole.run_to(t);
            parts.run_to(t);
            prop_assert_eq!(whole.position_m(t), parts.position_m(t));
        }
    }
}
