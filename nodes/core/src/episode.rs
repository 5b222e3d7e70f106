//! Episodes, put together from the stamped records of the topics.
//!
//! A bag reader and a live subscription feed the same [`EpisodeLog`], in whatever order records arrive; what comes out
//! depends on the records alone.

mod coverage;
mod log;
mod plausible;
mod spikes;

use crate::grip::GripError;
use crate::model::{DriveKind, StartKind};
use crate::simulator::StartShape;
use crate::track::End;
use crate::{Camera, Frame, GripTrajectory, Keypoints, Model, Observation, Track};
use coverage::{frame_warning, path_coverage, start_warning};
pub use log::{EpisodeLog, EpisodeStart, RecordKind, is_base_frame};
use plausible::HandLimits;
pub use plausible::MeasuredPose;
use thiserror::Error;

/// Why there is no episode, or no track in it.
#[derive(Debug, Error, PartialEq)]
pub enum EpisodeError {
    /// No episode that both started and ended.
    #[error(
        "{cause}no complete episode: found {found}; needed are /episode/event, /dlo/keypoints and /panda/current_pose, and /policy/observation and /policy/action where a policy drives"
    )]
    NoEpisode {
        /// What is wrong with the records, with a trailing separator; empty where nothing is but their absence.
        cause: String,
        /// Records that there are.
        found: String,
    },
    /// All complete episodes ended with a fault, and none of them was asked for.
    #[error("{0}: ask for it by its number to use it all the same")]
    Fault(String),
    /// A stream of the episode that cannot be what was measured.
    #[error("episode {episode}: {reason}")]
    Impossible {
        /// Number of the episode.
        episode: u32,
        /// Topic, field, value and what was expected.
        reason: String,
    },
    /// There are complete episodes, and the one that was asked for is none of them.
    #[error("episode {number}: expected one of the complete episodes {complete:?}")]
    NoSuchEpisode {
        /// The number that was asked for.
        number: u32,
        /// Numbers of the complete episodes.
        complete: Vec<u32>,
    },
    /// The episode lacks what the model's drive needs.
    #[error("episode {episode}: {cause}needs {needed}, found {found}")]
    Missing {
        /// Number of the episode.
        episode: u32,
        /// What is known to be wrong with the recording, with a trailing separator; empty where nothing is.
        cause: String,
        /// What the track needs.
        needed: String,
        /// What there is.
        found: String,
    },
    /// The measured path is none.
    #[error(transparent)]
    Grip(#[from] GripError),
}

/// One complete episode. Times are s since its start.
#[derive(Debug, Clone, PartialEq)]
pub struct Episode {
    /// Its number in the recording.
    pub number: u32,
    /// Other complete episodes that bear its number.
    pub namesakes: usize,
    /// How it started.
    pub start: EpisodeStart,
    /// Stamp of the start, ns.
    pub start_ns: i64,
    /// Length in s.
    pub duration_s: f64,
    /// Why it ended.
    pub end: String,
    /// Keypoints with their times, in order.
    pub keypoints: Vec<(f64, Keypoints)>,
    /// Poses of the hand with their times, in order.
    pub poses: Vec<(f64, MeasuredPose)>,
    /// Actions (dx, dz) in m with the numbers of their steps, in order.
    pub actions: Vec<(u32, [f64; 2])>,
    /// Observations with the numbers of their steps, in order; one more than actions where the episode ended in order.
    pub observations: Vec<(u32, Observation)>,
    /// What is doubtful about the recording that it comes from, in words.
    pub notes: Vec<String>,
}

/// A measured track with what the simulator needs to reproduce it.
#[derive(Debug, Clone, PartialEq)]
pub struct MeasuredTrack {
    /// What was seen.
    pub track: Track,
    /// The measured path of the clamped end.
    pub grip: GripTrajectory,
    /// The actions that were taken, step by step; empty where the measured path drives the simulator.
    pub actions: Vec<[f64; 2]>,
    /// The shape at the start.
    pub start: StartShape,
    /// (x, z) in m of the target in the plane of motion, where it was seen.
    pub target_m: Option<[f64; 2]>,
    /// What of the recording should make one doubt the track.
    pub warnings: Vec<String>,
}

impl Episode {
    /// The measured track as the model's simulator would give it, with what reproduces it.
    pub fn measured(&self, model: &Model) -> Result<MeasuredTrack, EpisodeError> {
        let missing = |needed: &str| self.missing(needed);
        if self.poses.is_empty() {
            return Err(missing("poses on /panda/current_pose"));
        }
        let impossible = |reason| EpisodeError::Impossible { episode: self.number, reason };
        let hand = plausible::poses(&self.poses, &HandLimits::of(model), self.start_ns).map_err(impossible)?;
        let seen = plausible::keypoints(&self.keypoints, &model.camera.view, self.start_ns).map_err(impossible)?;
        let (times_s, path) = hand.kept.iter().map(|(time_s, pose)| (*time_s, pose.grip)).unzip();
        let grip = GripTrajectory::new(times_s, path)?;
        let mut warnings = self.notes.clone();
        warnings.extend(self.fault_warning());
        warnings.extend(self.namesake_warning());
        warnings.extend(hand.warnings);
        warnings.extend(seen.warnings);
        let seen = seen.kept;
        let (frames, actions) = match model.observation.drive {
            DriveKind::Grip => {
                let covered = path_coverage(grip.times_s(), self.duration_s);
                let frames = sampled_frames(&seen, model, &grip, covered.until_s);
                let room = self.room(model, covered.until_s);
                warnings.extend(covered.warning);
                warnings.extend(frame_warning(frames.len(), room, model.observation.frames));
                (frames, Vec::new())
            }
            DriveKind::Actions | DriveKind::Policy => {
                let (actions, observations) = self.steps()?;
                plausible::observations(&observations, &grip, self.start.step_period_s, &HandLimits::of(model))
                    .map_err(impossible)?;
                (self.policy_frames(&grip, &actions, &observations), actions)
            }
        };
        if frames.len() < 2 {
            return Err(missing("at least two frames with all four keypoints, at times when the grip's pose is known"));
        }
        let camera = &model.camera.view;
        let target = median_target(&frames);
        let start = match model.observation.start {
            StartKind::HangingAtRest => StartShape::HangingAtRest,
            StartKind::Measured => {
                let shown = start_shape(&seen, camera, &grip);
                let (shape, times_s) = shown.ok_or_else(|| missing("two first frames that the camera can place"))?;
                warnings.extend(start_warning(times_s));
                shape
            }
        };
        let end = End::from_name(&self.end).unwrap_or(End::Complete);
        Ok(MeasuredTrack {
            track: Track { frames, end },
            grip,
            actions,
            start,
            target_m: target.and_then(|t| camera.plane_from_scaled(t)),
            warnings,
        })
    }

    /// The error of an episode that lacks what is `needed`.
    fn missing(&self, needed: &str) -> EpisodeError {
        EpisodeError::Missing {
            episode: self.number,
            cause: self.cause(),
            needed: needed.to_owned(),
            found: format!(
                "{} keypoint frames, {} poses, {} observations, {} actions in {:.2} s",
                self.keypoints.len(),
                self.poses.len(),
                self.observations.len(),
                self.actions.len(),
                self.duration_s
            ),
        }
    }

    /// What is doubtful about it whatever the model, in words: its end, and poses that no Panda reaches.
    pub fn doubts(&self) -> Vec<String> {
        let poses = plausible::poses(&self.poses, &HandLimits::default(), self.start_ns);
        let poses = poses.map_or_else(|reason| vec![reason], |plausible| plausible.warnings);
        self.fault_warning().into_iter().chain(poses).collect()
    }

    /// Whether it was ended by a fault instead of the task or the user.
    pub fn is_faulty(&self) -> bool {
        log::is_fault(&self.end)
    }

    /// What to say of an episode that a fault ended.
    pub fn fault_warning(&self) -> Option<String> {
        self.is_faulty().then(|| {
            format!(
                "/episode/event: episode {} ended with \"{}\": the arm may not have done what it was told",
                self.number, self.end
            )
        })
    }

    /// What is known to be wrong, in front of an error.
    fn cause(&self) -> String {
        self.notes.iter().map(|note| format!("{note}: ")).collect()
    }

    fn namesake_warning(&self) -> Option<String> {
        (self.namesakes > 0).then(|| {
            format!(
                "the recording has {} complete episodes called {}, and this is one of them: from {:.3} s on, ended by {}",
                self.namesakes + 1,
                self.number,
                self.start_ns as f64 * 1e-9,
                self.end
            )
        })
    }

    /// How many of the model's frame times lie within the episode, and not after `until_s`.
    fn room(&self, model: &Model, until_s: f64) -> usize {
        let last_s = self.duration_s.min(until_s);
        (0..model.observation.frames).take_while(|i| *i as f64 * model.observation.frame_period_s <= last_s).count()
    }

    /// Actions and observations of all steps from 0 on: a lost one would shift those after it in time.
    fn steps(&self) -> Result<(Vec<[f64; 2]>, Vec<Observation>), EpisodeError> {
        let missing = |needed: &str, found: String| EpisodeError::Missing {
            episode: self.number,
            cause: self.cause(),
            needed: needed.to_owned(),
            found,
        };
        let actions = each_once(&self.actions)
            .map_err(|found| missing("the actions of all steps from 0 on, each once, on /policy/action", found))?;
        let observations = each_once(&self.observations).map_err(|found| {
            missing("the observations of all steps from 0 on, each once, on /policy/observation", found)
        })?;
        if !(actions.len()..=actions.len() + 1).contains(&observations.len()) {
            let found = format!("{} observations, {} actions", observations.len(), actions.len());
            return Err(missing("an observation before each action, and at most one after the last", found));
        }
        Ok((actions, observations))
    }

    /// Frames at the steps of the policy, as it saw them.
    fn policy_frames(&self, grip: &GripTrajectory, actions: &[[f64; 2]], observations: &[Observation]) -> Vec<Frame> {
        let frame = |(i, o): (usize, &Observation)| {
            let time_s = i as f64 * self.start.step_period_s;
            let [x, z] = o.eef_m();
            let action = actions.get(i).copied().unwrap_or_default();
            Frame { time_s, dlo: o.dlo(), target: o.target(), eef: [x, z, grip.at(time_s).pitch_rad], action }
        };
        observations.iter().enumerate().map(frame).collect()
    }
}

/// Frames nearest to the model's frame times and not before the start, where no simulation begins, nor after `until_s`;
/// a time without a frame within half a period is left out.
fn sampled_frames(keypoints: &[(f64, Keypoints)], model: &Model, grip: &GripTrajectory, until_s: f64) -> Vec<Frame> {
    let period_s = model.observation.frame_period_s;
    let usable = |(t, k): &&(f64, Keypoints)| (0.0..=until_s).contains(t) && k.dlo_seen();
    let seen: Vec<&(f64, Keypoints)> = keypoints.iter().filter(usable).collect();
    let mut target = seen.iter().find_map(|(_, k)| k.target_scaled()).unwrap_or([0.0, 0.0]);
    let mut frames: Vec<Frame> = Vec::new();
    for i in 0..model.observation.frames {
        let wanted_s = i as f64 * period_s;
        let next = seen.partition_point(|(t, _)| *t < wanted_s);
        let near = seen[next.saturating_sub(1)..seen.len().min(next + 1)]
            .iter()
            .min_by(|a, b| (a.0 - wanted_s).abs().total_cmp(&(b.0 - wanted_s).abs()));
        let Some((time_s, k)) = near.filter(|(t, _)| (t - wanted_s).abs() <= 0.5 * period_s) else { continue };
        if frames.last().is_some_and(|f| f.time_s >= *time_s) {
            continue;
        }
        target = k.target_scaled().unwrap_or(target);
        let p = grip.at(*time_s);
        let eef = [p.x_m, p.z_m, p.pitch_rad];
        frames.push(Frame { time_s: *time_s, dlo: k.dlo_scaled(), target, eef, action: [0.0; 2] });
    }
    frames
}

/// Points and velocities of the first frame at or after the start, ordered from the grip on, and the times in s of the two
/// frames that they come from.
fn start_shape(
    keypoints: &[(f64, Keypoints)],
    camera: &Camera,
    grip: &GripTrajectory,
) -> Option<(StartShape, [f64; 2])> {
    let mut seen = keypoints.iter().filter(|(t, k)| *t >= -1e-9 && k.dlo_seen());
    let mut placed = || {
        let (time_s, k) = seen.next()?;
        let points = k.dlo_scaled().map(|p| camera.plane_from_scaled(p));
        let [a, b, c, d] = points;
        let p = grip.at(*time_s);
        Some((*time_s, order_from([p.x_m, p.z_m], [a?, b?, c?, d?])))
    };
    let (t0, first) = placed()?;
    let (t1, second) = placed()?;
    let velocity = |i: usize, j: usize| (second[i][j] - first[i][j]) / (t1 - t0);
    let shape = StartShape::Measured {
        points_m: first,
        velocities_m_s: std::array::from_fn(|i| [velocity(i, 0), velocity(i, 1)]),
    };
    Some((shape, [t0, t1]))
}

/// The values of steps 0, 1, 2 and so on; in words what comes instead where one is missing or comes twice.
fn each_once<T: Copy>(steps: &[(u32, T)]) -> Result<Vec<T>, String> {
    match steps.iter().enumerate().find(|(i, (step, _))| *i as u64 != u64::from(*step)) {
        Some((i, (step, _))) => Err(format!("step {step} in place of step {i}, among {} in all", steps.len())),
        None => Ok(steps.iter().map(|(_, value)| *value).collect()),
    }
}

/// The order of four unordered points along the object: that of the shortest path from the grip through all of them.
pub fn order_from(grip_m: [f64; 2], points_m: [[f64; 2]; 4]) -> [[f64; 2]; 4] {
    let distance = |a: [f64; 2], b: [f64; 2]| (a[0] - b[0]).hypot(a[1] - b[1]);
    let length = |order: &[usize; 4]| {
        let path = std::iter::once(grip_m).chain(order.iter().map(|&i| points_m[i]));
        let points: Vec<[f64; 2]> = path.collect();
        points.windows(2).map(|w| distance(w[0], w[1])).sum::<f64>()
    };
    let orders = (0..256usize)
        .map(|code| std::array::from_fn(|i| (code >> (2 * i)) & 3))
        .filter(|o: &[usize; 4]| (0..4).all(|i| o.contains(&i)));
    let best = orders.min_by(|a, b| length(a).total_cmp(&length(b))).unwrap_or([0, 1, 2, 3]);
    best.map(|i| points_m[i])
}

/// The median of the target's position over the frames, by coordinate.
fn median_target(frames: &[Frame]) -> Option<[f64; 2]> {
    let median = |i: usize| {
        let mut values: Vec<f64> = frames.iter().map(|f| f.target[i]).collect();
        values.sort_by(f64::total_cmp);
        values.get(values.len() / 2).copied()
    };
    Some([median(0)?, median(1)?])
}

#[cfg(test)]
mod tests;
