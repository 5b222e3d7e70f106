//! Episodes, put together from the stamped records of the topics.
//!
//! A bag reader and a live subscription feed the same [`EpisodeLog`], in whatever order records arrive; what comes out
//! depends on the records alone.

use crate::grip::GripError;
use crate::model::{DriveKind, StartKind};
use crate::simulator::StartShape;
use crate::task::DeltaAnchor;
use crate::track::End;
use crate::{Camera, Frame, GripPose, GripTrajectory, Keypoints, Model, Observation, Track};
use std::collections::BTreeMap;
use thiserror::Error;

/// Time before an episode's start from which records still belong to it, ns: the pose and the frame that it starts from.
const LEAD_NS: i64 = 200_000_000;

/// The start of an episode, as `/episode/event` reports it.
#[derive(Debug, Clone, PartialEq)]
pub struct EpisodeStart {
    /// Name of the policy that runs; `recorded` where a path was recorded without one.
    pub policy: String,
    /// Seed of the episode.
    pub seed: u64,
    /// s between two actions.
    pub step_period_s: f64,
    /// What a delta is added to.
    pub delta_anchor: DeltaAnchor,
}

/// Stamped records of the topics that inference needs. Stamps are ns of one clock.
#[derive(Debug, Clone, Default)]
pub struct EpisodeLog {
    keypoints: BTreeMap<i64, Keypoints>,
    poses: BTreeMap<i64, GripPose>,
    actions: BTreeMap<(u32, u32), [f64; 2]>,
    observations: BTreeMap<(u32, u32), Observation>,
    starts: BTreeMap<u32, (i64, EpisodeStart)>,
    ends: BTreeMap<u32, (i64, String)>,
}

/// Why there is no episode, or no track in it.
#[derive(Debug, Error, PartialEq)]
pub enum EpisodeError {
    /// No episode that both started and ended.
    #[error(
        "no complete episode: found {0}; needed are /episode/event, /dlo/keypoints and /panda/current_pose, and /policy/observation and /policy/action where a policy drives"
    )]
    NoEpisode(String),
    /// There are complete episodes, and the one that was asked for is none of them.
    #[error("episode {number}: expected one of the complete episodes {complete:?}")]
    NoSuchEpisode {
        /// The number that was asked for.
        number: u32,
        /// Numbers of the complete episodes.
        complete: Vec<u32>,
    },
    /// The episode lacks what the model's drive needs.
    #[error("episode {episode}: needs {needed}, found {found}")]
    Missing {
        /// Number of the episode.
        episode: u32,
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
    /// Poses of the grip with their times, in order.
    pub poses: Vec<(f64, GripPose)>,
    /// Actions (dx, dz) in m, in order of their steps.
    pub actions: Vec<[f64; 2]>,
    /// Observations, in order of their steps; one more than actions where the episode ended in order.
    pub observations: Vec<Observation>,
}

/// A measured track with what the simulator needs to reproduce it.
#[derive(Debug, Clone, PartialEq)]
pub struct MeasuredTrack {
    /// What was seen.
    pub track: Track,
    /// The measured path of the clamped end.
    pub grip: GripTrajectory,
    /// The actions that were taken.
    pub actions: Vec<[f64; 2]>,
    /// The shape at the start.
    pub start: StartShape,
    /// (x, z) in m of the target in the plane of motion, where it was seen.
    pub target_m: Option<[f64; 2]>,
}

impl EpisodeLog {
    /// Records the keypoints of the image stamped `stamp_ns`.
    pub fn push_keypoints(&mut self, stamp_ns: i64, keypoints: Keypoints) {
        self.keypoints.insert(stamp_ns, keypoints);
    }

    /// Records the pose of the grip at `stamp_ns`.
    pub fn push_pose(&mut self, stamp_ns: i64, pose: GripPose) {
        self.poses.insert(stamp_ns, pose);
    }

    /// Records action `step` (dx, dz in m) of an episode.
    pub fn push_action(&mut self, episode: u32, step: u32, delta_m: [f64; 2]) {
        self.actions.insert((episode, step), delta_m);
    }

    /// Records observation `step` of an episode.
    pub fn push_observation(&mut self, episode: u32, step: u32, observation: Observation) {
        self.observations.insert((episode, step), observation);
    }

    /// Records the start of an episode.
    pub fn push_start(&mut self, stamp_ns: i64, episode: u32, start: EpisodeStart) {
        self.starts.insert(episode, (stamp_ns, start));
    }

    /// Records the end of an episode.
    pub fn push_end(&mut self, stamp_ns: i64, episode: u32, reason: String) {
        self.ends.insert(episode, (stamp_ns, reason));
    }

    /// Numbers of the episodes that both started and ended, in order of their starts.
    pub fn complete(&self) -> Vec<u32> {
        let mut numbers: Vec<(i64, u32)> = self
            .starts
            .iter()
            .filter(|(n, (start, _))| self.ends.get(n).is_some_and(|(end, _)| end > start))
            .map(|(n, (start, _))| (*start, *n))
            .collect();
        numbers.sort_unstable();
        numbers.into_iter().map(|(_, n)| n).collect()
    }

    /// Drops the keypoints and poses from before `stamp_ns`, so that a log that runs for days stays small.
    pub fn forget_before(&mut self, stamp_ns: i64) {
        self.keypoints = self.keypoints.split_off(&stamp_ns);
        self.poses = self.poses.split_off(&stamp_ns);
    }

    /// What the log holds, in words.
    pub fn summary(&self) -> String {
        format!(
            "{} keypoints, {} poses, {} observations, {} actions, {} episode starts, {} episode ends",
            self.keypoints.len(),
            self.poses.len(),
            self.observations.len(),
            self.actions.len(),
            self.starts.len(),
            self.ends.len()
        )
    }

    /// The complete episode called `number`; none: the last one.
    pub fn episode(&self, number: Option<u32>) -> Result<Episode, EpisodeError> {
        let missing = || EpisodeError::NoEpisode(self.summary());
        let complete = self.complete();
        let number = match number {
            Some(n) if complete.contains(&n) => n,
            Some(n) if !complete.is_empty() => return Err(EpisodeError::NoSuchEpisode { number: n, complete }),
            Some(_) => return Err(missing()),
            None => *complete.last().ok_or_else(missing)?,
        };
        let (start_ns, start) = &self.starts[&number];
        let (end_ns, end) = &self.ends[&number];
        let seconds = |ns: i64| (ns - start_ns) as f64 * 1e-9;
        let span = start_ns - LEAD_NS..=*end_ns;
        let steps = (number, 0)..=(number, u32::MAX);
        Ok(Episode {
            number,
            start: start.clone(),
            start_ns: *start_ns,
            duration_s: seconds(*end_ns),
            end: end.clone(),
            keypoints: self.keypoints.range(span.clone()).map(|(t, k)| (seconds(*t), *k)).collect(),
            poses: self.poses.range(span).map(|(t, p)| (seconds(*t), *p)).collect(),
            actions: self.actions.range(steps.clone()).map(|(_, a)| *a).collect(),
            observations: self.observations.range(steps).map(|(_, o)| *o).collect(),
        })
    }
}

impl Episode {
    /// The measured track as the model's simulator would give it, with what reproduces it.
    pub fn measured(&self, model: &Model) -> Result<MeasuredTrack, EpisodeError> {
        let missing = |needed: &str| EpisodeError::Missing {
            episode: self.number,
            needed: needed.to_owned(),
            found: format!(
                "{} keypoint frames, {} poses, {} observations, {} actions in {:.2} s",
                self.keypoints.len(),
                self.poses.len(),
                self.observations.len(),
                self.actions.len(),
                self.duration_s
            ),
        };
        if self.poses.is_empty() {
            return Err(missing("poses on /panda/current_pose"));
        }
        let grip =
            GripTrajectory::new(self.poses.iter().map(|p| p.0).collect(), self.poses.iter().map(|p| p.1).collect())?;
        let frames = match model.observation.drive {
            DriveKind::Grip => self.sampled_frames(model, &grip),
            DriveKind::Actions | DriveKind::Policy => self.policy_frames(&grip),
        };
        if frames.len() < 2 {
            return Err(missing("at least two frames with all four keypoints"));
        }
        let camera = &model.camera.view;
        let target = median_target(&frames);
        let start = match model.observation.start {
            StartKind::HangingAtRest => StartShape::HangingAtRest,
            StartKind::Measured => {
                self.start_shape(camera, &grip).ok_or_else(|| missing("two first frames that the camera can place"))?
            }
        };
        let end = End::from_name(&self.end).unwrap_or(End::Complete);
        Ok(MeasuredTrack {
            track: Track { frames, end },
            grip,
            actions: self.actions.clone(),
            start,
            target_m: target.and_then(|t| camera.plane_from_scaled(t)),
        })
    }

    /// Frames nearest to the model's frame times and not before the start, where no simulation begins; a time without a frame
    /// within half a period is left out.
    fn sampled_frames(&self, model: &Model, grip: &GripTrajectory) -> Vec<Frame> {
        let period_s = model.observation.frame_period_s;
        let seen: Vec<&(f64, Keypoints)> = self.keypoints.iter().filter(|(t, k)| *t >= 0.0 && k.dlo_seen()).collect();
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

    /// Frames at the steps of the policy, as it saw them.
    fn policy_frames(&self, grip: &GripTrajectory) -> Vec<Frame> {
        let frame = |(i, o): (usize, &Observation)| {
            let time_s = i as f64 * self.start.step_period_s;
            let [x, z] = o.eef_m();
            let action = self.actions.get(i).copied().unwrap_or_default();
            Frame { time_s, dlo: o.dlo(), target: o.target(), eef: [x, z, grip.at(time_s).pitch_rad], action }
        };
        self.observations.iter().enumerate().map(frame).collect()
    }

    /// Points and velocities of the first frame at or after the start, ordered from the grip on.
    fn start_shape(&self, camera: &Camera, grip: &GripTrajectory) -> Option<StartShape> {
        let mut seen = self.keypoints.iter().filter(|(t, k)| *t >= -1e-9 && k.dlo_seen());
        let mut placed = || {
            let (time_s, k) = seen.next()?;
            let points = k.dlo_px.map(|px| camera.plane_from_mask(px));
            let [a, b, c, d] = points;
            let p = grip.at(*time_s);
            Some((*time_s, order_from([p.x_m, p.z_m], [a?, b?, c?, d?])))
        };
        let (t0, first) = placed()?;
        let (t1, second) = placed()?;
        let velocity = |i: usize, j: usize| (second[i][j] - first[i][j]) / (t1 - t0);
        Some(StartShape::Measured {
            points_m: first,
            velocities_m_s: std::array::from_fn(|i| [velocity(i, 0), velocity(i, 1)]),
        })
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
mod tests {
    use super::*;

    fn keypoints(shift: f64, flip: bool) -> Keypoints {
        let mut dlo_px = [0.0, 1.0, 2.0, 3.0].map(|i: f64| [100.0 + shift, 100.0 + 10.0 * i]);
        if flip {
            dlo_px.reverse();
        }
        Keypoints {
            dlo_px,
            target_px: Some([150.0, 160.0]),
            scores: [1.0; 4],
            target_score: 1.0,
            image_width_px: 256,
            image_height_px: 256,
        }
    }

    fn log() -> EpisodeLog {
        let mut log = EpisodeLog::default();
        let start = EpisodeStart {
            policy: "recorded".into(),
            seed: 1,
            step_period_s: 0.5,
            delta_anchor: DeltaAnchor::LastTarget,
        };
        log.push_start(1_000_000_000, 4, start);
        for i in 0..300 {
            let stamp = 900_000_000 + i * 33_000_000;
            log.push_keypoints(stamp, keypoints(i as f64 * 0.1, i % 2 == 0));
            log.push_pose(stamp + 1, GripPose { x_m: 0.4, z_m: 0.4, pitch_rad: 0.0 });
        }
        log.push_end(9_100_000_000, 4, "complete".into());
        log
    }

    fn model() -> Model {
        Model::from_yaml(include_str!("../../../launch_configs/models/soft_bar.yaml")).unwrap()
    }

    #[test]
    fn track_takes_the_frames_nearest_to_the_models_times() {
        let measured = log().episode(None).unwrap().measured(&model()).unwrap();
        let frames = &measured.track.frames;
        assert_eq!(frames.len(), 33);
        let late_s = |i: usize| frames[i].time_s - 0.25 * i as f64;
        assert!((1..33).all(|i| late_s(i).abs() <= 0.0166), "{frames:?}");
        assert!((0.0..=0.033).contains(&late_s(0)), "a frame from before the start: {frames:?}");
        assert!(measured.target_m.is_some());
    }

    #[test]
    fn the_order_of_arrival_does_not_matter() {
        let forward = log();
        let mut backward = EpisodeLog::default();
        backward.push_end(9_100_000_000, 4, "complete".into());
        for (t, k) in forward.keypoints.iter().rev() {
            backward.push_keypoints(*t, *k);
        }
        for (t, p) in forward.poses.iter().rev() {
            backward.push_pose(*t, *p);
        }
        let (stamp, start) = forward.starts[&4].clone();
        backward.push_start(stamp, 4, start);
        assert_eq!(forward.episode(None).unwrap(), backward.episode(Some(4)).unwrap());
    }

    #[test]
    fn what_is_missing_is_named() {
        let empty = EpisodeLog::default().episode(None).unwrap_err().to_string();
        assert!(empty.contains("0 keypoints") && empty.contains("/episode/event"), "{empty}");
        let other = log().episode(Some(9)).unwrap_err();
        assert_eq!(other, EpisodeError::NoSuchEpisode { number: 9, complete: vec![4] });
        let mut no_pose = log();
        no_pose.poses.clear();
        let e = no_pose.episode(None).unwrap().measured(&model()).unwrap_err().to_string();
        assert!(e.contains("/panda/current_pose"), "{e}");
    }

    #[test]
    fn measured_start_is_ordered_from_the_grip_and_moves() {
        let mut m = model();
        m.observation.start = StartKind::Measured;
        let measured = log().episode(None).unwrap().measured(&m).unwrap();
        let StartShape::Measured { points_m, velocities_m_s } = measured.start else { panic!("{:?}", measured.start) };
        assert!(points_m.windows(2).all(|w| w[0][1] > w[1][1]), "{points_m:?}");
        assert!(velocities_m_s.iter().all(|v| v[0] > 0.0 && v[1].abs() < 1e-9), "{velocities_m_s:?}");
    }
}
