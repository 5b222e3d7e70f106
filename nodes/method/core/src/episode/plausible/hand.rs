//! Plausible poses and observations of the hand.

use super::chain::{MOST_LEFT_OUT, Plausible, at, kept, left_out, longest_chain, take_out};
use super::edges::edge_faults;
use super::spikes::spikes;
use crate::model::ArmLaw;
use crate::statistics::median_high;
use crate::{GripPose, GripTrajectory, Model, Observation};

/// Topic of the hand's poses.
pub(crate) const POSES: &str = "/panda/current_pose";

/// Cartesian limits of the Panda's hand: m/s, rad/s, m/s^2 and rad/s^2 ("Limits for Panda" in Franka's documentation,
/// https://frankaemika.github.io/docs/control_parameters.html).
pub(super) const PANDA_M_S: f64 = 1.7;
pub(super) const PANDA_RAD_S: f64 = 2.5;
pub(super) const PANDA_M_S2: f64 = 13.0;
pub(super) const PANDA_RAD_S2: f64 = 25.0;
/// Factor on the limits. It covers other arms, and joint motions that exceed the Cartesian limits.
const MARGIN: f64 = 2.0;
/// Distance that is allowed in no time, in m and rad: a jitter of the stamps of 10 ms moves a pose at the limits by it.
const SLACK_M: f64 = 0.02;
const SLACK_RAD: f64 = 0.03;
/// Departure of the first or the last pose from its neighbours' path below which it is no fault, in m and rad. A policy
/// moves the hand by at most 0.06 m within a step, so a pose of a slow stream may depart by as much.
const EDGE_M: f64 = 0.1;
const EDGE_RAD: f64 = 0.3;
/// Age in s of the pose in an observation, at the greatest speed. At the speeds of a policy it may be three times as
/// old.
const OBSERVATION_AGE_S: f64 = 0.05;
/// Reach of a Panda from the origin of panda_link0 in m: 0.855 m from the shoulder at 0.333 m, and 0.21 m of flange and
/// hand.
const REACH_M: f64 = 1.4;
/// Distance in m of the hand from the plane y = 0 above which a warning is given. At a camera distance of 1.15 m, 2 cm
/// change lengths by 2 %; the position jitter of a camera, 5 mm, changes them by less.
const OFF_PLANE_M: f64 = 0.02;
/// Distance in m from the plane above which a recording is refused: lengths in the image are wrong by 9 %.
const FAR_OFF_PLANE_M: f64 = 0.1;
/// Time in s at the start of a run of poses that a chain may skip to reach the run.
const RUN_ENTRY_S: f64 = 0.05;

/// Measured pose of the hand: its pose in the plane of motion, and its distance from the plane.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct MeasuredPose {
    /// Pose in the plane.
    pub grip: GripPose,
    /// y in m, frame panda_link0: the signed distance from the plane.
    pub y_m: f64,
}

impl From<GripPose> for MeasuredPose {
    fn from(grip: GripPose) -> Self {
        Self { grip, y_m: 0.0 }
    }
}

impl MeasuredPose {
    /// Distance in m between the positions.
    fn distance(&self, other: &Self) -> f64 {
        let (a, b) = (&self.grip, &other.grip);
        (a.x_m - b.x_m).hypot(a.z_m - b.z_m).hypot(self.y_m - other.y_m)
    }

    /// Angle in rad between the orientations, the shorter way round.
    fn turn(&self, other: &Self) -> f64 {
        turn_rad(self, other).abs()
    }
}

/// Position (x, z, y) in m.
fn position(p: &MeasuredPose) -> [f64; 3] {
    [p.grip.x_m, p.grip.z_m, p.y_m]
}

/// Signed angle in rad from `b` to `a`, the shorter way round.
fn turn_rad(a: &MeasuredPose, b: &MeasuredPose) -> f64 {
    let turn = a.grip.pitch_rad - b.grip.pitch_rad;
    turn - std::f64::consts::TAU * (turn / std::f64::consts::TAU).round()
}

/// Physical limits of a hand.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct HandLimits {
    /// Greatest speed in m/s.
    speed_m_s: f64,
    /// Greatest speed in m/s at which it may reverse at once: the speed limit of a model arm with a lag, or 0.
    turn_back_m_s: f64,
    /// Greatest distance in m of a hand from the origin of panda_link0.
    reach_m: f64,
}

impl Default for HandLimits {
    /// Limits of a Panda, with a margin.
    fn default() -> Self {
        Self { speed_m_s: MARGIN * PANDA_M_S, turn_back_m_s: 0.0, reach_m: MARGIN * REACH_M }
    }
}

impl HandLimits {
    /// Limits of a Panda or of the model's arm, whichever is faster, reachable from the model's start pose.
    pub(crate) fn of(model: &Model) -> Self {
        let own_m_s = match model.arm.law {
            ArmLaw::Lag { max_speed_m_s, .. } => max_speed_m_s,
            ArmLaw::Impedance(_) => 0.0,
        };
        let start = &model.arm.start;
        Self {
            speed_m_s: MARGIN * PANDA_M_S.max(own_m_s),
            // A lag has no mass: the model's arm reverses at once.
            turn_back_m_s: own_m_s,
            reach_m: MARGIN * REACH_M + start.x_m.hypot(start.z_m),
        }
    }

    /// True if a hand can move from `a` to `b` in `time_s`.
    fn allow(&self, a: &MeasuredPose, b: &MeasuredPose, time_s: f64) -> bool {
        self.allow_distance(a.distance(b), time_s) && a.turn(b) <= turn_limit_rad(time_s)
    }

    fn allow_distance(&self, distance_m: f64, time_s: f64) -> bool {
        distance_m <= self.distance_limit_m(time_s)
    }

    fn distance_limit_m(&self, time_s: f64) -> f64 {
        self.speed_m_s * time_s + SLACK_M
    }

    /// Flags the poses that leave the path of their neighbours and come back faster than the hand can.
    fn spikes(&self, samples: &[(f64, MeasuredPose)]) -> Vec<bool> {
        let moved =
            spikes(samples, [MARGIN * PANDA_M_S2, self.turn_back_m_s, SLACK_M], |poses| vec![poses.map(position)]);
        // A measured attitude jitters, so it may reverse at once.
        let turned = spikes(samples, [MARGIN * PANDA_RAD_S2, PANDA_RAD_S, SLACK_RAD], |[a, b, c]| {
            vec![[[turn_rad(a, b)], [0.0], [turn_rad(c, b)]]]
        });
        moved.into_iter().zip(turned).map(|(m, t)| m || t).collect()
    }
}

/// Greatest rotation of a hand in `time_s`, in rad.
fn turn_limit_rad(time_s: f64) -> f64 {
    MARGIN * PANDA_RAD_S * time_s + SLACK_RAD
}

/// Keeps the poses that an arm can reach one after the other, near its base and in the plane of motion. `start_ns` is
/// the stamp of time 0.
///
/// # Errors
/// A sentence that names the defect that makes the whole stream unusable.
pub(crate) fn poses(
    samples: &[(f64, MeasuredPose)],
    limits: &HandLimits,
    start_ns: i64,
) -> Result<Plausible<MeasuredPose>, String> {
    check_unit(samples, limits)?;
    let mut flags = longest_chain(samples, RUN_ENTRY_S, |a, b| limits.allow(&a.1, &b.1, b.0 - a.0));
    // Spikes are found among the kept samples alone: a fault beside them would hide them.
    let out_and_back = limits.spikes(&kept(samples, &flags));
    take_out(&mut flags, &out_and_back);
    let out = flags.iter().filter(|f| !**f).count();
    let mut warnings = Vec::new();
    if out > 0 {
        let one = |((time_s, p), (other_s, q)): &((f64, MeasuredPose), (f64, MeasuredPose))| {
            let (apart_m, turn_rad, between_s) = (p.distance(q), p.turn(q), (time_s - other_s).abs());
            // The sentence states the limit that is exceeded by the greater factor.
            let is_far = apart_m / limits.distance_limit_m(between_s) >= turn_rad / turn_limit_rad(between_s);
            let what = match is_far {
                true => format!("{apart_m:.3} m from the pose"),
                false => format!("turned by {turn_rad:.2} rad from the pose"),
            };
            format!(
                "{} with position ({}, {}, {}) m and pitch {:.2} rad, {what} {:.0} ms away",
                at(*time_s, start_ns),
                p.grip.x_m,
                p.y_m,
                p.grip.z_m,
                p.grip.pitch_rad,
                1e3 * between_s
            )
        };
        let places: Vec<String> = left_out(samples, &flags).iter().map(one).collect();
        let speeds = format!(
            "{:.1} m/s and {:.1} rad/s, {:.0} m/s^2 and {:.0} rad/s^2",
            limits.speed_m_s,
            MARGIN * PANDA_RAD_S,
            MARGIN * PANDA_M_S2,
            MARGIN * PANDA_RAD_S2
        );
        let of = samples.len();
        if out as f64 > MOST_LEFT_OUT * of as f64 {
            return Err(format!(
                "{POSES}: {out} of {of} poses contradict the others: expected a path of at most {speeds}, got {}: check units, frame and clock of its publisher",
                places.join(" to ")
            ));
        }
        warnings.push(format!(
            "{POSES}: {out} of {of} poses left out, because no arm reaches them at {speeds}: {}",
            places.join(" to ")
        ));
    }
    let mut kept = kept(samples, &flags);
    warnings.extend(take_out_edges(&mut kept, start_ns));
    warnings.extend(off_plane(&kept)?);
    Ok(Plausible { kept, warnings })
}

/// Removes a fault in the first or the last pose, and returns a warning about each.
fn take_out_edges(kept: &mut Vec<(f64, MeasuredPose)>, start_ns: i64) -> Vec<String> {
    let moved = edge_faults(kept, EDGE_M, |poses| vec![poses.map(position)]).into_iter();
    let moved = moved.map(|e| (e.index, format!("{:.3} m", e.departure), format!("{:.3} m", e.usual)));
    let turned = edge_faults(kept, EDGE_RAD, |[a, b, c]| vec![[[turn_rad(a, b)], [0.0], [turn_rad(c, b)]]]).into_iter();
    let turned = turned.map(|e| (e.index, format!("{:.2} rad", e.departure), format!("{:.2} rad", e.usual)));
    let mut faults: Vec<(usize, String, String)> = moved.chain(turned).collect();
    // A pose that is wrong in both is named once. The last comes first, so the index of the first stays valid.
    faults.sort_by_key(|(index, ..)| std::cmp::Reverse(*index));
    faults.dedup_by_key(|(index, ..)| *index);
    let warning = |(index, departure, usual): (usize, String, String)| {
        let which = if index == 0 { "first" } else { "last" };
        let (time_s, p) = kept.remove(index);
        format!(
            "{POSES}: {which} pose left out, {} with position ({}, {}, {}) m and pitch {:.2} rad: it is {departure} from where its neighbours lead, and all others at most {usual}",
            at(time_s, start_ns),
            p.grip.x_m,
            p.y_m,
            p.grip.z_m,
            p.grip.pitch_rad
        )
    };
    faults.into_iter().map(warning).collect()
}

/// Refuses positions out of any hand's reach, such as positions in millimetres.
fn check_unit(samples: &[(f64, MeasuredPose)], limits: &HandLimits) -> Result<(), String> {
    let origin = MeasuredPose::default();
    let Some(median_m) = median_high(&mut samples.iter().map(|(_, p)| p.distance(&origin)).collect::<Vec<f64>>())
    else {
        return Ok(());
    };
    if median_m <= limits.reach_m {
        return Ok(());
    }
    let unit = [(1e2, "cm"), (1e3, "mm")].into_iter().find(|(in_1_m, _)| median_m / in_1_m <= REACH_M);
    let looks = unit.map_or_else(String::new, |(_, unit)| format!(", as if in {unit}"));
    Err(format!(
        "{POSES}: pose.position: expected m from the base within the {REACH_M} m that a Panda reaches, got {median_m:.1} (the median distance){looks}: convert the recording to m in panda_link0"
    ))
}

/// Refuses observations of the hand that are far from its measured path. Observation i belongs to time i `period_s`.
///
/// An observation cannot be left out as a pose can, because the policy acted on it.
///
/// # Errors
/// A sentence with step, value and expectation.
pub(crate) fn observations(
    steps: &[Observation],
    path: &GripTrajectory,
    period_s: f64,
    limits: &HandLimits,
) -> Result<(), String> {
    for (step, observation) in steps.iter().enumerate() {
        let ([x_m, z_m], then) = (observation.eef_m(), path.at(step as f64 * period_s));
        if !limits.allow_distance((x_m - then.x_m).hypot(z_m - then.z_m), OBSERVATION_AGE_S) {
            return Err(format!(
                "/policy/observation: values[0..2] of step {step}: expected (x, z) near the pose at that time, ({:.3}, {:.3}) m, got ({x_m}, {z_m}) m: use another episode, or a model with drive: grip, which needs no observations",
                then.x_m, then.z_m
            ));
        }
    }
    Ok(())
}

/// Warning about poses beside the plane y = 0; an error if they are too far from it.
fn off_plane(samples: &[(f64, MeasuredPose)]) -> Result<Option<String>, String> {
    let Some(median_m) = median_high(&mut samples.iter().map(|(_, p)| p.y_m).collect::<Vec<f64>>()) else {
        return Ok(None);
    };
    let what = format!(
        "{POSES}: pose.position.y: expected 0 m, the plane of motion that model and camera know, got {median_m:.3} m (the median)"
    );
    if median_m.abs() > FAR_OFF_PLANE_M {
        return Err(format!(
            "{what}: move the hand into the plane, or record in a frame whose plane y = 0 it moves in"
        ));
    }
    let most_m = samples.iter().map(|(_, p)| p.y_m.abs()).fold(0.0, f64::max);
    Ok((most_m > OFF_PLANE_M).then(|| {
        format!("{what} and at most {most_m:.3} m to either side: lengths in the image are too large or too small")
    }))
}
