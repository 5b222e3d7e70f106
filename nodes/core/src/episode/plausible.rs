//! Samples that cannot be true: a hand and an object move at finite speeds, in metres, near the arm.

use super::spikes::spikes;
use crate::keypoints::KeypointOrder;
use crate::model::ArmLaw;
use crate::{Camera, GripPose, GripTrajectory, Keypoints, Model, Observation};

/// Topic of the poses.
pub(super) const POSES: &str = "/panda/current_pose";
/// Topic of the keypoints.
pub(super) const KEYPOINTS: &str = "/dlo/keypoints";

/// Cartesian limits of the Panda's hand: m/s, rad/s, m/s^2 and rad/s^2 ("Limits for Panda" in Franka's documentation,
/// https://frankaemika.github.io/docs/control_parameters.html).
const PANDA_M_S: f64 = 1.7;
const PANDA_RAD_S: f64 = 2.5;
const PANDA_M_S2: f64 = 13.0;
const PANDA_RAD_S2: f64 = 25.0;
/// Factor on the limits: another arm, and speeds that joint motions reach beyond the Cartesian limits.
const MARGIN: f64 = 2.0;
/// Distance that needs no time, m and rad: stamps that jitter by 10 ms move a pose at the limits by as much.
const SLACK_M: f64 = 0.02;
const SLACK_RAD: f64 = 0.03;
/// Greatest speed of a keypoint, m/s: five times that of the fastest end among recordings of cables that two arms swing.
const KEYPOINT_M_S: f64 = 10.0;
/// Greatest acceleration of a keypoint, m/s^2: twice that of the fastest such end, 2 m/s, on a circle of 0.1 m.
const KEYPOINT_M_S2: f64 = 80.0;
/// Distance that a keypoint may move in no time, m: trackers slide along the object, and find it anew.
const KEYPOINT_SLACK_M: f64 = 0.05;
/// Age of the pose in an observation, s, at the greatest speed: at those of a policy it may be three times as old.
const OBSERVATION_AGE_S: f64 = 0.05;
/// Reach of a Panda from the origin of panda_link0, m: 0.855 m from the shoulder at 0.333 m, and 0.21 m of flange and hand.
const REACH_M: f64 = 1.4;
/// Share of the poses, or frames, that may be left out: of more, nobody knows which ones are right.
const MOST_LEFT_OUT: f64 = 0.2;
/// Distance of the hand from the plane y = 0, m, from which it is worth a warning: the position jitter of a camera is 5 mm,
/// and 2 cm at a distance of 1.15 m change lengths by 2 %.
const OFF_PLANE_M: f64 = 0.02;
/// Distance from the plane from which nothing that the camera sees has its true size, m.
const FAR_OFF_PLANE_M: f64 = 0.1;
/// Time at the start of a run of poses that a chain may leave out to reach it, s.
const HURRY_S: f64 = 0.05;
/// Runs that a chain may leap back over. Data with more faults in a row are refused anyway.
const LEAP: usize = 512;

/// Measured pose of the hand: that in the plane of motion, and how far from the plane it is.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct MeasuredPose {
    /// The pose in the plane.
    pub grip: GripPose,
    /// y in m, frame panda_link0: the distance from the plane.
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

    /// Turn in rad between the orientations, the shorter way round.
    fn turn(&self, other: &Self) -> f64 {
        turn_rad(self, other).abs()
    }
}

/// Turn in rad from `b` to `a`, the shorter way round.
fn turn_rad(a: &MeasuredPose, b: &MeasuredPose) -> f64 {
    let turn = a.grip.pitch_rad - b.grip.pitch_rad;
    turn - std::f64::consts::TAU * (turn / std::f64::consts::TAU).round()
}

/// Samples that can be used, with what to say of the others.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Plausible<T> {
    /// Samples with their times in s.
    pub(super) kept: Vec<(f64, T)>,
    /// What was left out, and what is doubtful about the rest.
    pub(super) warnings: Vec<String>,
}

/// What a hand can do.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct HandLimits {
    /// Greatest speed in m/s.
    speed_m_s: f64,
    /// Greatest speed in m/s from which it turns back at once, as the model's arm does.
    turn_back_m_s: f64,
    /// Greatest distance from the origin of panda_link0 that any hand is at, m.
    reach_m: f64,
}

impl Default for HandLimits {
    /// A Panda, with a margin.
    fn default() -> Self {
        Self { speed_m_s: MARGIN * PANDA_M_S, turn_back_m_s: 0.0, reach_m: MARGIN * REACH_M }
    }
}

impl HandLimits {
    /// A Panda or the model's arm, whichever is faster, and from where the model starts.
    pub(super) fn of(model: &Model) -> Self {
        let own_m_s = match model.arm.law {
            ArmLaw::Lag { max_speed_m_s, .. } => max_speed_m_s,
            ArmLaw::Impedance(_) => 0.0,
        };
        let start = &model.arm.start;
        Self {
            speed_m_s: MARGIN * PANDA_M_S.max(own_m_s),
            turn_back_m_s: own_m_s,
            reach_m: MARGIN * REACH_M + start.x_m.hypot(start.z_m),
        }
    }

    /// Whether a hand can be at `b` so long after it was at `a`, s.
    fn allow(&self, a: &MeasuredPose, b: &MeasuredPose, time_s: f64) -> bool {
        self.allow_distance(a.distance(b), time_s) && a.turn(b) <= turn_limit_rad(time_s)
    }

    fn allow_distance(&self, distance_m: f64, time_s: f64) -> bool {
        distance_m <= self.distance_limit_m(time_s)
    }

    fn distance_limit_m(&self, time_s: f64) -> f64 {
        self.speed_m_s * time_s + SLACK_M
    }

    /// Flags of poses that leave the path of their neighbours and come back faster than it can.
    fn spikes(&self, samples: &[(f64, MeasuredPose)]) -> Vec<bool> {
        let position = |p: &MeasuredPose| [p.grip.x_m, p.grip.z_m, p.y_m];
        let moved =
            spikes(samples, [MARGIN * PANDA_M_S2, self.turn_back_m_s, SLACK_M], |poses| vec![poses.map(position)]);
        // A measured attitude jitters: it may turn back at once.
        let turned = spikes(samples, [MARGIN * PANDA_RAD_S2, PANDA_RAD_S, SLACK_RAD], |[a, b, c]| {
            vec![[[turn_rad(a, b)], [0.0], [turn_rad(c, b)]]]
        });
        moved.into_iter().zip(turned).map(|(m, t)| m || t).collect()
    }
}

/// Greatest turn of a hand in a time, rad.
fn turn_limit_rad(time_s: f64) -> f64 {
    MARGIN * PANDA_RAD_S * time_s + SLACK_RAD
}

/// Takes `also` out of the samples that `flags` keeps, one flag for each of those.
fn take_out(flags: &mut [bool], also: &[bool]) {
    let kept = flags.iter_mut().filter(|flag| **flag);
    kept.zip(also).for_each(|(flag, out)| *flag = !out);
}

/// Samples that are kept.
fn kept<T: Copy>(samples: &[(f64, T)], flags: &[bool]) -> Vec<(f64, T)> {
    samples.iter().zip(flags).filter(|(_, flag)| **flag).map(|(sample, _)| *sample).collect()
}

/// Flags of the samples in the longest chain in which each can follow the one before. A fault cannot be told from its
/// neighbours by looking at two samples: the first one may be wrong, or a hundred in a row. Most samples agree. Of a
/// run, its first `hurry_s` may be left out to reach it.
fn longest_chain<T>(samples: &[(f64, T)], hurry_s: f64, follows: impl Fn(&(f64, T), &(f64, T)) -> bool) -> Vec<bool> {
    // Runs of neighbours that agree; a chain takes whole runs, but for the first moments of one.
    let mut runs: Vec<(usize, usize)> = Vec::new();
    for i in 0..samples.len() {
        match runs.last_mut() {
            Some(run) if follows(&samples[run.1], &samples[i]) => run.1 = i,
            _ => runs.push((i, i)),
        }
    }
    // The first sample of a run that can follow an earlier run: one that moved at once, as no arm but an ideal one does, is
    // taken for one that hurried.
    let entry = |from: usize, (first, last): (usize, usize)| {
        let early = |k: &usize| samples[*k].0 - samples[first].0 <= hurry_s;
        (first..=last).take_while(early).find(|k| follows(&samples[from], &samples[*k]))
    };
    // For each run: samples of the longest chain up to its end, where that enters the run, and the run before.
    let mut longest: Vec<(usize, usize, Option<usize>)> = Vec::with_capacity(runs.len());
    for (i, run) in runs.iter().enumerate() {
        let after =
            |j: usize| Some((longest[j].0 + run.1 + 1 - entry(runs[j].1, *run)?, entry(runs[j].1, *run)?, Some(j)));
        let best = (i.saturating_sub(LEAP)..i).filter_map(after).max_by_key(|(length, ..)| *length);
        let alone = (run.1 + 1 - run.0, run.0, None);
        longest.push(best.filter(|(length, ..)| *length >= alone.0).unwrap_or(alone));
    }
    let mut flags = vec![false; samples.len()];
    let mut next = (0..runs.len()).max_by_key(|i| longest[*i].0);
    while let Some(i) = next {
        flags[longest[i].1..=runs[i].1].fill(true);
        next = longest[i].2;
    }
    flags
}

/// First and last sample that was left out, each with the kept one that it contradicts.
fn left_out<T: Copy>(samples: &[(f64, T)], flags: &[bool]) -> Vec<((f64, T), (f64, T))> {
    let witness = |i: usize| {
        let before = (0..i).rev().find(|j| flags[*j]);
        let after = (i + 1..samples.len()).find(|j| flags[*j]);
        before.or(after).map(|j| (samples[i], samples[j]))
    };
    let out: Vec<usize> = (0..samples.len()).filter(|i| !flags[*i]).collect();
    let ends = match out.as_slice() {
        [] => vec![],
        [only] => vec![*only],
        [first, .., last] => vec![*first, *last],
    };
    ends.into_iter().filter_map(witness).collect()
}

/// Poses that an arm can have reached one after the other, near its base and in the plane of motion. `start_ns` is the stamp
/// of time 0.
///
/// # Errors
/// What makes the whole stream unusable, in words.
pub(super) fn poses(
    samples: &[(f64, MeasuredPose)],
    limits: &HandLimits,
    start_ns: i64,
) -> Result<Plausible<MeasuredPose>, String> {
    check_unit(samples, limits)?;
    let mut flags = longest_chain(samples, HURRY_S, |a, b| limits.allow(&a.1, &b.1, b.0 - a.0));
    let out_and_back = limits.spikes(&kept(samples, &flags));
    take_out(&mut flags, &out_and_back);
    let out = flags.iter().filter(|f| !**f).count();
    let mut warnings = Vec::new();
    if out > 0 {
        let one = |((time_s, p), (other_s, q)): &((f64, MeasuredPose), (f64, MeasuredPose))| {
            let (apart_m, turn_rad, between_s) = (p.distance(q), p.turn(q), (time_s - other_s).abs());
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
                "{POSES}: {out} of {of} poses contradict the others: expected a path of at most {speeds}, got {}: check units, frame and clock of whoever publishes it",
                places.join(" to ")
            ));
        }
        warnings.push(format!(
            "{POSES}: {out} of {of} poses left out, which no arm reaches at {speeds}: {}",
            places.join(" to ")
        ));
    }
    let kept = kept(samples, &flags);
    warnings.extend(off_plane(&kept)?);
    Ok(Plausible { kept, warnings })
}

/// A time of an episode, with its stamp.
fn at(time_s: f64, start_ns: i64) -> String {
    let stamp_ns = start_ns.saturating_add((time_s * 1e9).round() as i64);
    format!("at {time_s:.3} s (stamp {})", seconds(stamp_ns))
}

/// A stamp in s, with all its digits.
pub(super) fn seconds(stamp_ns: i64) -> String {
    let (sign, magnitude) = (if stamp_ns < 0 { "-" } else { "" }, stamp_ns.unsigned_abs());
    format!("{sign}{}.{:09}", magnitude / 1_000_000_000, magnitude % 1_000_000_000)
}

/// Refuses positions that lie where no hand can be, as those in millimetres do.
fn check_unit(samples: &[(f64, MeasuredPose)], limits: &HandLimits) -> Result<(), String> {
    let origin = MeasuredPose::default();
    let Some(median_m) = median(samples.iter().map(|(_, p)| p.distance(&origin))) else { return Ok(()) };
    if median_m <= limits.reach_m {
        return Ok(());
    }
    let unit = [(1e2, "cm"), (1e3, "mm")].into_iter().find(|(in_1_m, _)| median_m / in_1_m <= REACH_M);
    let looks = unit.map_or_else(String::new, |(_, unit)| format!(", as if in {unit}"));
    Err(format!(
        "{POSES}: pose.position: expected m from the base within the {REACH_M} m that a Panda reaches, got {median_m:.1} (the median distance){looks}: convert the recording to m in panda_link0"
    ))
}

/// Refuses observations of the hand, one a step of `period_s`, where no pose of its path is. They cannot be left out as poses
/// can: the policy acted on them.
///
/// # Errors
/// Step, value and what was expected, in words.
pub(super) fn observations(
    steps: &[Observation],
    path: &GripTrajectory,
    period_s: f64,
    limits: &HandLimits,
) -> Result<(), String> {
    for (step, observation) in steps.iter().enumerate() {
        let ([x_m, z_m], then) = (observation.eef_m(), path.at(step as f64 * period_s));
        if !limits.allow_distance((x_m - then.x_m).hypot(z_m - then.z_m), OBSERVATION_AGE_S) {
            return Err(format!(
                "/policy/observation: values[0..2] of step {step}: expected (x, z) near the pose of then, ({:.3}, {:.3}) m, got ({x_m}, {z_m}) m: use another episode, or a model with drive: grip, which needs no observations",
                then.x_m, then.z_m
            ));
        }
    }
    Ok(())
}

/// What to say of poses beside the plane y = 0.
fn off_plane(samples: &[(f64, MeasuredPose)]) -> Result<Option<String>, String> {
    let Some(median_m) = median(samples.iter().map(|(_, p)| p.y_m)) else { return Ok(None) };
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
        format!("{what} and at most {most_m:.3} m to either side: lengths are seen too large or too small by that")
    }))
}

fn median(values: impl Iterator<Item = f64>) -> Option<f64> {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}

/// Frames with all four keypoints whose points an object can have reached one after the other. `start_ns` is the stamp of
/// time 0.
///
/// # Errors
/// What makes the whole stream unusable, in words.
pub(super) fn keypoints(
    samples: &[(f64, Keypoints)],
    camera: &Camera,
    start_ns: i64,
) -> Result<Plausible<Keypoints>, String> {
    let seen: Vec<(f64, Keypoints)> = samples.iter().filter(|(_, k)| k.dlo_seen()).copied().collect();
    check_pixels(&seen)?;
    let mut placed = Vec::new();
    let mut behind = Vec::new();
    for (time_s, k) in &seen {
        let [a, b, c, d] = k.dlo_scaled().map(|p| camera.plane_from_scaled(p));
        match (a, b, c, d) {
            (Some(a), Some(b), Some(c), Some(d)) => placed.push((*time_s, ([a, b, c, d], *k))),
            _ => behind.push((*time_s, *k)),
        }
    }
    type Placed = (f64, ([[f64; 2]; 4], Keypoints));
    let follows = |a: &Placed, b: &Placed| farthest_m(&a.1.0, &b.1.0) <= KEYPOINT_M_S * (b.0 - a.0) + KEYPOINT_SLACK_M;
    let mut flags = longest_chain(&placed, 0.0, follows);
    let out_and_back =
        spikes(&kept(&placed, &flags), [KEYPOINT_M_S2, 0.0, KEYPOINT_SLACK_M], |[(a, _), (b, _), (c, _)]| {
            matched([a, b, c])
        });
    take_out(&mut flags, &out_and_back);
    let out = flags.iter().filter(|f| !**f).count() + behind.len();
    let mut warnings = Vec::new();
    if out > 0 {
        let value = |k: &Keypoints| k.dlo_px.map(|[u, v]| format!("({u:.1}, {v:.1})")).join(" ");
        let mut places: Vec<String> = left_out(&placed, &flags)
            .iter()
            .map(|((time_s, (points, k)), (other_s, (others, _)))| {
                let (apart_m, between_s) = (farthest_m(points, others), (time_s - other_s).abs());
                let at = at(*time_s, start_ns);
                format!(
                    "{at} with (u, v) {} px, {apart_m:.2} m from the frame {:.0} ms away",
                    value(k),
                    1e3 * between_s
                )
            })
            .collect();
        places.extend(
            behind.first().map(|(t, k)| format!("{} with (u, v) {} px, behind the camera", at(*t, start_ns), value(k))),
        );
        let speeds = format!("{KEYPOINT_M_S} m/s and {KEYPOINT_M_S2} m/s^2");
        let (of, places) = (seen.len(), places.join(" to "));
        if out as f64 > MOST_LEFT_OUT * of as f64 {
            return Err(format!(
                "{KEYPOINTS}: {out} of {of} frames contradict the others: expected keypoints that move at most at {speeds}, got {places}: check tracker, camera and clock of whoever publishes them"
            ));
        }
        warnings.push(format!(
            "{KEYPOINTS}: {out} of {of} frames left out, whose keypoints nothing reaches at {speeds}: {places}"
        ));
    }
    let kept = kept(&placed, &flags).into_iter().map(|(t, (_, k))| (t, k)).collect();
    Ok(Plausible { kept, warnings })
}

/// Each point of three frames, matched as sets: the third to the first, and the second to the middle of both.
fn matched([a, b, c]: [&[[f64; 2]; 4]; 3]) -> Vec<[[f64; 2]; 3]> {
    let order = KeypointOrder::Unknown.closest(c, a);
    let c = order.map(|k| c[k]);
    let middle = std::array::from_fn(|k| [0.5 * (a[k][0] + c[k][0]), 0.5 * (a[k][1] + c[k][1])]);
    let order = KeypointOrder::Unknown.closest(b, &middle);
    (0..4).map(|k| [a[k], b[order[k]], c[k]]).collect()
}

/// Greatest distance in m between points of two frames, matched as sets.
fn farthest_m(a: &[[f64; 2]; 4], b: &[[f64; 2]; 4]) -> f64 {
    let order = KeypointOrder::Unknown.closest(b, a);
    let apart = |k: usize| (a[k][0] - b[order[k]][0]).hypot(a[k][1] - b[order[k]][1]);
    (0..4).map(apart).fold(0.0, f64::max)
}

/// Refuses coordinates that are no pixels: fractions of the image.
fn check_pixels(seen: &[(f64, Keypoints)]) -> Result<(), String> {
    let largest = |k: &Keypoints| k.dlo_px.as_flattened().iter().fold(0.0_f64, |a, v| a.max(v.abs()));
    let Some((_, first)) = seen.first() else { return Ok(()) };
    if seen.iter().any(|(_, k)| largest(k) > 1.0 || k.image_width_px.min(k.image_height_px) < 16) {
        return Ok(());
    }
    let [u, v] = first.dlo_px[0];
    Err(format!(
        "{KEYPOINTS}: dlo_u, dlo_v: expected pixels of an image of {} x {}, got numbers within -1 to 1 in all {} frames, the first ({u}, {v}), as if in fractions of the image: multiply them by its size",
        first.image_width_px,
        first.image_height_px,
        seen.len()
    ))
}

#[cfg(test)]
mod tests;
