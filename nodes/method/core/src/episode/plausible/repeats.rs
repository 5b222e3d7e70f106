//! Repeated values in a stream of frames, and the motion that contradicts them.
//!
//! A tracker that loses the object, a camera that is slower than its publisher, and a fit that is updated only after a
//! large motion all publish their last value again. A held value is no observation at its time: the object has moved on,
//! and the error of the first reading comes again in every repetition, where a simulator draws a new one for each frame.
//! A repetition alone proves nothing, as an object at rest repeats its place, and coordinates in whole pixels or
//! millimetres repeat themselves in a slow motion. A run of repetitions counts as held if the motion around it
//! contradicts it.

use super::hand::PANDA_M_S2;
use crate::GripPose;
use crate::grip::POSE_LEVER_M;
use crate::statistics::{QuantileMethod, quantile};

/// Greatest difference in m between coordinates of equal values: the rounding of point, hand and pitch in tables with six
/// decimals, in both frames that are compared.
const EQUAL_M: f64 = 5e-6;
/// Motion of the hand in m beyond which a shape that stays equal relative to the hand counts as held: twenty times
/// [`EQUAL_M`]. Grips that are meant to stand still drift and jitter by millimetres, and a soft object answers each jolt.
const HAND_MOVES_M: f64 = 1e-4;
/// Motion of the hand in m beyond which points that stay in place count as held: three times the noise of motion capture.
const HAND_LEAVES_M: f64 = 1e-3;
/// Change of the shape in m below which an object counts as rigid: it keeps its shape in the hand without being held.
const RIGID_M: f64 = 2e-3;
/// Rank of the usual slow step among all steps of all keypoints. A repetition is compared with steps of a slow motion.
const SLOW: f64 = 0.05;
/// Step in units of the least step of a stream above which a keypoint cannot rest in the next two frames. Around a turning
/// point, three equal coordinates that are rounded to a step have neighbours at most four steps off.
const STEPS: f64 = 6.0;
/// Least number of repetitions that show a rest. Two equal frames may lie on both sides of a turning point.
const REST: usize = 2;
/// Factor between the step out of a run and the next steps. An object that begins to move accelerates, so that its second
/// step is three times the first. A value that was held jumps to the present place.
const JUMP: f64 = 1.5;
/// Time in s in which a soft object follows its hand and settles, a quarter of a swing of 1 Hz.
const SETTLED_S: f64 = 0.25;
/// Share of the hand's motion by which an object may bend as it stops together with the hand.
const BEND: f64 = 0.3;
/// Deflections of the keypoints of a clamped beam in its first mode, in deflections of the largest of the others. They
/// stand in for a keypoint that is held throughout.
const FIRST_MODE: [f64; 4] = [0.05, 0.2, 0.4, 0.8];
/// Repetitions during which the hand's motion can cancel the object's at one keypoint.
const CANCELLED: usize = 6;

/// Frame of an object in a hand, in the plane of motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlacedFrame {
    /// Time in s.
    pub time_s: f64,
    /// Four keypoints (x, z) in m.
    pub points_m: [[f64; 2]; 4],
    /// Pose of the hand at that time.
    pub grip: GripPose,
}

/// Run of frames that hold a value: the frame that has it first, and its repetitions.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct HeldRun {
    /// Index of the frame that has the value first.
    pub first: usize,
    /// Index of the last frame that repeats it.
    pub last: usize,
    /// Index of the only keypoint that is held, 0 to 3; none if all are.
    pub keypoint: Option<usize>,
}

impl HeldRun {
    /// Number of repetitions.
    pub fn count(&self) -> usize {
        self.last - self.first
    }
}

/// Runs that hold the same keypoints.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct HeldSummary {
    /// Index of the only keypoint that is held, 0 to 3; none if all are.
    pub keypoint: Option<usize>,
    /// Number of repetitions in all runs.
    pub count: usize,
    /// Longest run.
    pub longest: HeldRun,
}

/// Summaries of `runs`: that of all keypoints first, then those of single ones; none where nothing is held.
pub fn held_summaries(runs: &[HeldRun]) -> Vec<HeldSummary> {
    let summary = |keypoint| {
        let own = || runs.iter().filter(move |run| run.keypoint == keypoint);
        let longest = *own().max_by_key(|run| run.count())?;
        Some(HeldSummary { keypoint, count: own().map(HeldRun::count).sum(), longest })
    };
    [None, Some(0), Some(1), Some(2), Some(3)].into_iter().filter_map(summary).collect()
}

impl PlacedFrame {
    /// Keypoints in the frame of the hand, which stands upright at pitch 0.
    fn in_hand(&self) -> [[f64; 2]; 4] {
        let (sine, cosine) = self.grip.pitch_rad.sin_cos();
        self.points_m.map(|[x, z]| {
            let (x, z) = (x - self.grip.x_m, z - self.grip.z_m);
            // A positive pitch turns a hanging object towards -x; this turns it back.
            [cosine * x - sine * z, sine * x + cosine * z]
        })
    }

    /// Distance in m that the hand moved, with its rotation at a lever.
    fn hand_moved_m(&self, other: &Self) -> f64 {
        let (a, b) = (&self.grip, &other.grip);
        (a.x_m - b.x_m).hypot(a.z_m - b.z_m).hypot(POSE_LEVER_M * (a.pitch_rad - b.pitch_rad))
    }
}

/// Finds the runs of frames that hold a value, in the plane or in the frame of the hand: a fit of the shape relative to the
/// hand repeats the shape alone. Runs of all keypoints come first, then those of single keypoints.
///
/// A run of all keypoints is held
/// - if the hand leaves, and the points do not move;
/// - if the hand moves, and an object that bends at other times keeps its shape as if it were rigid and without weight;
/// - if a keypoint moves into the run, and on in the same direction out of it. At a turning point it comes back;
/// - if the motion before it stops dead, or the motion after it begins with a jump, and the hand does not.
///
/// A run of one keypoint is held if the object bends meanwhile, so that the keypoint had to move.
pub fn held_runs(frames: &[PlacedFrame]) -> Vec<HeldRun> {
    let stream = Stream::new(frames);
    (0..4).fold(stream.whole_runs(), |runs, k| runs.into_iter().chain(stream.keypoint_runs(k)).collect())
}

/// Frames with the figures that all runs are compared with.
struct Stream<'a> {
    frames: &'a [PlacedFrame],
    /// Keypoints in the frame of the hand, in m.
    in_hand: Vec<[[f64; 2]; 4]>,
    /// Step in m of a keypoint in a slow motion: the noise of the points, or their rounding if it is coarser.
    slow_step_m: f64,
    /// Least step in m other than none: at most the rounding of the points.
    least_step_m: f64,
    /// Least difference in m of two values of one coordinate: the rounding of a table.
    lattice_m: f64,
    /// True if the object changes its shape at some time.
    bends: bool,
    /// Greatest motion in m of each keypoint in the frame of the hand.
    reach_m: [f64; 4],
}

impl<'a> Stream<'a> {
    fn new(frames: &'a [PlacedFrame]) -> Self {
        let in_hand: Vec<[[f64; 2]; 4]> = frames.iter().map(PlacedFrame::in_hand).collect();
        let steps = frames.windows(2).flat_map(|w| (0..4).map(|k| distance(w[1].points_m[k], w[0].points_m[k])));
        let mut steps: Vec<f64> = steps.filter(|step| *step > EQUAL_M).collect();
        steps.sort_by(f64::total_cmp);
        let least_step_m = steps.first().copied().unwrap_or(EQUAL_M);
        let slow_step_m = if steps.is_empty() { EQUAL_M } else { quantile(&steps, SLOW, QuantileMethod::Lower) };
        let reach_m = std::array::from_fn(|k| {
            let ends = |axis: usize| {
                let values = in_hand.iter().map(|points| points[k][axis]);
                values.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], v| [low.min(v), high.max(v)])
            };
            let ([left, right], [low, high]) = (ends(0), ends(1));
            (right - left).hypot(high - low)
        });
        let bends = reach_m.iter().any(|reach| *reach > RIGID_M);
        Self { frames, slow_step_m, least_step_m, lattice_m: lattice_m(frames), bends, reach_m, in_hand }
    }

    fn whole_runs(&self) -> Vec<HeldRun> {
        let mut runs = Vec::new();
        let mut first = 0;
        while first < self.frames.len() {
            let in_plane = |i: &usize| are_equal(&self.frames[*i].points_m, &self.frames[first].points_m);
            let is_repeat = |i: &usize| in_plane(i) || are_equal(&self.in_hand[*i], &self.in_hand[first]);
            let last = first + (first + 1..self.frames.len()).take_while(is_repeat).count();
            let run = HeldRun { first, last, keypoint: None };
            if last > first && self.is_held(run, (first..=last).all(|i| in_plane(&i))) {
                runs.push(run);
            }
            first = last + 1;
        }
        runs
    }

    /// True if the motion contradicts a run of all keypoints, which repeats in the plane, or else in the hand.
    fn is_held(&self, run: HeldRun, in_plane: bool) -> bool {
        let moved_m = self.hand_moved_m(run);
        let leaves_m = match in_plane {
            true => HAND_LEAVES_M.max(4.0 * self.slow_step_m),
            // Rounded points of a hand that moves by their rounding keep the shape by chance.
            false => HAND_MOVES_M.max(10.0 * self.lattice_m),
        };
        if moved_m > leaves_m && (in_plane || self.bends) {
            return true;
        }
        let paths = (0..4).map(|k| Path { stream: self, k, in_plane });
        paths.into_iter().any(|path| path.passes(run) || path.stops(run) || path.jumps(run))
    }

    /// Greatest distance in m of the hand from its place at the start of a run.
    fn hand_moved_m(&self, run: HeldRun) -> f64 {
        let start = &self.frames[run.first];
        self.frames[run.first..=run.last].iter().map(|f| f.hand_moved_m(start)).fold(0.0, f64::max)
    }

    /// Runs in which the keypoint `k` alone is held.
    fn keypoint_runs(&self, k: usize) -> Vec<HeldRun> {
        let mut runs = Vec::new();
        let mut first = 0;
        while first < self.frames.len() {
            let start = self.frames[first].points_m[k];
            let stays = |f: &&PlacedFrame| is_equal(f.points_m[k], start);
            let last = first + self.frames[first + 1..].iter().take_while(stays).count();
            let run = HeldRun { first, last, keypoint: Some(k) };
            if run.count() >= REST && self.had_to_move(run, k) {
                runs.push(run);
            }
            first = last + 1;
        }
        runs
    }

    /// True if the others move so far in a run that the keypoint `k` had to move.
    fn had_to_move(&self, run: HeldRun, k: usize) -> bool {
        let others = || (0..4).filter(move |j| *j != k);
        // Points that stay in place in a hand that moves bend in the hand's frame only: they are a run of all keypoints.
        let moved_m = |i: usize, j: usize| {
            let in_plane_m = distance(self.frames[i].points_m[j], self.frames[run.first].points_m[j]);
            distance(self.in_hand[i][j], self.in_hand[run.first][j]).min(in_plane_m)
        };
        let moved = (run.first..=run.last).flat_map(|i| others().map(move |j| (i, j)));
        let bent_m = moved.map(|(i, j)| moved_m(i, j)).fold(0.0, f64::max);
        let farthest_m = others().map(|j| self.reach_m[j]).fold(0.0, f64::max);
        let share = if farthest_m > 0.0 { self.reach_m[k] / farthest_m } else { 0.0 };
        let share = share.max(FIRST_MODE[k]);
        let least_m = STEPS * self.least_step_m;
        // Noise of the others is no motion; a hand that goes the other way may cancel the motion for a moment.
        share * (bent_m - STEPS * self.slow_step_m) > least_m
            && (run.count() >= CANCELLED || share * bent_m - self.hand_moved_m(run) > least_m)
    }
}

/// Path of the keypoint `k` into a run and out of it, in the plane or in the frame of the hand.
struct Path<'a> {
    stream: &'a Stream<'a>,
    k: usize,
    in_plane: bool,
}

impl Path<'_> {
    fn at(&self, i: usize) -> [f64; 2] {
        match self.in_plane {
            true => self.stream.frames[i].points_m[self.k],
            false => self.stream.in_hand[i][self.k],
        }
    }

    /// Step from the frame before `i` to `i`; none at the ends of the stream.
    fn step(&self, i: usize) -> Option<[f64; 2]> {
        (1..self.stream.frames.len()).contains(&i).then(|| {
            let (a, b) = (self.at(i - 1), self.at(i));
            [b[0] - a[0], b[1] - a[1]]
        })
    }

    fn step_m(&self, i: usize) -> Option<f64> {
        self.step(i).map(|[x, z]| x.hypot(z))
    }

    /// True if the keypoint moves into the run, and on in the same direction out of it.
    fn passes(&self, run: HeldRun) -> bool {
        let (Some(into), Some(out)) = (self.step(run.first), self.step(run.last + 1)) else { return false };
        // Three quarters of the steps into a rest: a single repetition is no rest, but the direction tells.
        let is_far = |step: [f64; 2]| step[0].hypot(step[1]) > 4.0 * self.stream.least_step_m;
        is_far(into)
            && is_far(out)
            && into[0] * out[0] + into[1] * out[1] > 0.0
            && !(self.is_carried(run, run.first) && self.is_carried(run, run.last + 1))
    }

    /// True if the keypoint moves into a run, or would turn there, faster than it can come to rest.
    fn stops(&self, run: HeldRun) -> bool {
        let Some(into) = self.step(run.first).filter(|_| run.count() >= REST) else { return false };
        // Place at the second repetition on the parabola through the last three frames.
        let ahead = self.step(run.first - 1).map(|before| [0, 1].map(|i| 5.0 * into[i] - 3.0 * before[i]));
        let least_m = STEPS * self.stream.least_step_m;
        let is_far = into[0].hypot(into[1]) > least_m || ahead.is_some_and(|[x, z]| x.hypot(z) > 2.0 * least_m);
        is_far && !self.is_carried(run, run.first)
    }

    /// True if the step out of a run is larger than the next steps.
    fn jumps(&self, run: HeldRun) -> bool {
        let after = run.last + 1;
        let Some(out_m) = self.step_m(after).filter(|_| run.count() >= REST) else { return false };
        let next_m = (after + 1..after + 4).filter_map(|i| self.step_m(i)).reduce(f64::max);
        out_m > STEPS * self.stream.least_step_m
            && next_m.is_some_and(|next_m| out_m > JUMP * next_m)
            && !self.is_carried(run, after)
            && !self.is_dragged(run, after)
    }

    /// True if the hand rests in the run and starts in the step to the frame `i`, in which it moves farther than the keypoint: a soft object
    /// starts as its hand does, and its far end waits.
    fn is_dragged(&self, run: HeldRun, i: usize) -> bool {
        let hand_m = self.stream.frames[i].hand_moved_m(&self.stream.frames[i - 1]);
        let rests = self.stream.hand_moved_m(run) < 0.25 * hand_m;
        self.in_plane && rests && hand_m > HAND_MOVES_M && self.step_m(i).is_some_and(|step_m| step_m <= hand_m)
    }

    /// True if the hand carries the keypoint to the frame `i`, and rests in the run: an object moves and rests with its hand,
    /// if it has the time to settle.
    fn is_carried(&self, run: HeldRun, i: usize) -> bool {
        let frames = self.stream.frames;
        let (before, after) = (&frames[i - 1], &frames[i]);
        let (hand_m, period_s) = (after.hand_moved_m(before), after.time_s - before.time_s);
        let inside = frames[run.first..=run.last].windows(2).map(|w| w[1].hand_moved_m(&w[0])).fold(0.0, f64::max);
        let bent_m = distance(self.stream.in_hand[i][self.k], self.stream.in_hand[i - 1][self.k]);
        // An arm cannot stop from such a speed within a frame: then the hand's values are held, too.
        let can_stop = hand_m < PANDA_M_S2 * period_s.powi(2);
        self.in_plane
            && self.step_m(i).is_some_and(|step_m| hand_m > 0.1 * step_m)
            && inside < 0.25 * hand_m
            && can_stop
            && (bent_m <= BEND * hand_m || period_s > SETTLED_S)
    }
}

/// Least difference in m above the tolerance of equal values between two values of one coordinate.
fn lattice_m(frames: &[PlacedFrame]) -> f64 {
    let column = |k: usize, axis: usize| {
        let mut values: Vec<f64> = frames.iter().map(|f| f.points_m[k][axis]).collect();
        values.sort_by(f64::total_cmp);
        // Conversions to pixels and back round by far less than the last digit of a table.
        values.windows(2).map(|w| w[1] - w[0]).filter(|gap| *gap > 0.2 * EQUAL_M).reduce(f64::min)
    };
    let columns = (0..4).flat_map(|k| [0, 1].map(|axis| column(k, axis)));
    columns.flatten().reduce(f64::min).unwrap_or(EQUAL_M)
}

fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

fn is_equal(a: [f64; 2], b: [f64; 2]) -> bool {
    (0..2).all(|i| (a[i] - b[i]).abs() <= EQUAL_M)
}

fn are_equal(a: &[[f64; 2]; 4], b: &[[f64; 2]; 4]) -> bool {
    (0..4).all(|k| is_equal(a[k], b[k]))
}
