//! Measured track of an episode, as a model's simulator would return it.

use super::complete::Episode;
use super::coverage::{few_warning, frame_warning, path_coverage, start_warning};
use super::error::EpisodeError;
use super::plausible::{self, HandLimits, KEYPOINTS, POSES, WRENCHES};
use super::rate::{interval_doubt, slow_doubt};
use super::start::measured_start;
use super::view::view_warning;
use crate::model::{DriveKind, StartKind};
use crate::simulator::StartShape;
use crate::statistics::median_place;
use crate::track::End;
use crate::{Camera, Frame, GripTrajectory, Keypoints, Model, Observation, Track};
use serde::Serialize;

/// Distance of the target from its median place, from -1 to 1 over the mask, that no noise explains: 8 pixels of 256.
const TARGET_APART: f64 = 0.0625;
/// Share of the frames with the target elsewhere that deserves a warning.
const TARGET_DOUBT: f64 = 0.05;

/// Measured track with the inputs that a simulator needs to reproduce it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MeasuredTrack {
    /// Name of the episode in sentences. It is no part of the data: fingerprints leave it out.
    #[serde(skip)]
    pub name: String,
    /// Observed frames and end.
    pub track: Track,
    /// Measured path of the clamped end.
    pub grip: GripTrajectory,
    /// Actions (dx, dz) in m, one for each step; empty if the measured path drives the simulator.
    pub actions: Vec<[f64; 2]>,
    /// Shape of the object at the start.
    pub start: StartShape,
    /// (x, z) in m of the target in the plane of motion; none if the camera cannot place it.
    pub target_m: Option<[f64; 2]>,
    /// Doubts about the track, one sentence each.
    pub warnings: Vec<String>,
}

impl Episode {
    /// Builds the measured track in the form in which the model's simulator returns tracks.
    ///
    /// # Errors
    /// [`EpisodeError`] if streams are missing, impossible or too short for the model's drive.
    pub fn measured(&self, model: &Model) -> Result<MeasuredTrack, EpisodeError> {
        let missing = |needed: &str| self.missing(needed);
        if self.poses.is_empty() {
            return Err(missing("poses on /panda/current_pose"));
        }
        let impossible = |reason| EpisodeError::Impossible { episode: self.number, reason };
        if let Some(reason) = &self.mixed {
            return Err(impossible(reason.clone()));
        }
        // A path with such gaps drives no simulation: its unit is the cause, and lost poses are not.
        if let Some(doubt) = slow_doubt(&sample_times_s(&self.poses), model) {
            return Err(impossible(format!("{POSES}: header.stamp: {doubt}")));
        }
        let hand = plausible::poses(&self.poses, &HandLimits::of(model), self.start_ns).map_err(impossible)?;
        let seen = plausible::keypoints(&self.keypoints, &model.camera.view, self.start_ns).map_err(impossible)?;
        let (times_s, path) = hand.kept.iter().map(|(time_s, pose)| (*time_s, pose.grip)).unzip();
        let grip = GripTrajectory::new(times_s, path)?;
        let mut warnings = self.notes.clone();
        warnings.extend(self.fault_warning());
        warnings.extend(self.namesake_warning());
        warnings.extend(hand.warnings);
        warnings.extend(seen.warnings);
        let camera = &model.camera.view;
        let doubt = interval_doubt(&sample_times_s(&seen.kept), model);
        warnings.extend(doubt.map(|doubt| format!("{KEYPOINTS}: header.stamp: {doubt}")));
        warnings.extend(self.view_warning(&seen.kept, camera));
        // Held values are found in the whole stream: a frame that is left out for another reason would hide a run.
        let mut with_held = seen.kept;
        let seen = plausible::without_held(&with_held, camera, &grip).map_err(impossible)?;
        warnings.extend(seen.warnings);
        // A held keypoint makes a wrong length, too, so that lengths come last.
        let seen = plausible::of_usual_length(&seen.kept, camera, self.start_ns);
        warnings.extend(seen.warnings);
        let mut seen = seen.kept;
        let is_path = model.observation.drive == DriveKind::Grip;
        // Held values are told by the path as it was measured; a simulation follows it without its noise.
        let noise = &model.observation;
        let smooth = if is_path { grip.smoothed(noise.grip_position_sd_m, noise.grip_pitch_sd_rad) } else { grip };
        let (mut grip, mut begin_s) = (smooth, 0.0);
        let start = match model.observation.start {
            StartKind::HangingAtRest => StartShape::HangingAtRest,
            StartKind::Measured => {
                let shown = measured_start(&seen, camera, &grip);
                let shown = shown.ok_or_else(|| missing("two first frames that the camera can place"))?;
                warnings.extend(start_warning(shown.frames_s, shown.frames));
                // A path may begin anywhere; the steps of a policy are counted from the start of the episode.
                if is_path {
                    begin_s = shown.time_s;
                    for samples in [&mut seen, &mut with_held] {
                        samples.iter_mut().for_each(|(time_s, _)| *time_s -= begin_s);
                    }
                    grip = grip.shifted(-begin_s)?;
                }
                shown.shape
            }
        };
        let duration_s = self.duration_s - begin_s;
        let (mut frames, actions) = match model.observation.drive {
            DriveKind::Grip => {
                let covered = path_coverage(grip.times_s(), duration_s);
                let frames = sampled_frames(&seen, model, &grip, covered.until_s);
                let room = room(model, duration_s, covered.until_s);
                warnings.extend(covered.warning);
                // Held frames have a warning of their own: they do not count as lost images.
                let shown = sampled_frames(&with_held, model, &grip, covered.until_s).len();
                warnings.extend(frame_warning(shown, room));
                (frames, Vec::new())
            }
            // A policy's observations are its frames: the simulator is compared at the steps of the policy.
            DriveKind::Actions | DriveKind::Policy => {
                let (actions, observations) = self.steps(model)?;
                plausible::observations(&observations, &grip, self.start.step_period_s, &HandLimits::of(model))
                    .map_err(impossible)?;
                (self.policy_frames(&grip, &actions, &observations), actions)
            }
        };
        // A single frame shows no motion to compare.
        if frames.len() < 2 {
            let needed = "at least two frames with all four keypoints, at times when the grip's pose is known";
            return Err(self.missing_because(&warnings, needed));
        }
        warnings.extend(few_warning(&frames, model));
        warnings = self.with_wrench(model, &mut frames, begin_s, warnings)?;
        // The target stands still, in the simulator too: the median drops frames that mistake something else for it. A target that jumps is unlike
        // any simulation, and would count for more in the inference than the object does.
        let target = median_place(frames.iter().map(|frame| frame.target));
        if let Some(target) = target {
            warnings.extend(target_warning(&frames, target));
            frames.iter_mut().for_each(|frame| frame.target = target);
        }
        // Ends by the user or by a fault have no name among the task's ends.
        let end = End::from_name(&self.end).unwrap_or(End::Complete);
        Ok(MeasuredTrack {
            name: format!("episode {}", self.number),
            track: Track { frames, end },
            grip,
            actions,
            start,
            target_m: target.and_then(|t| camera.plane_from_scaled(t)),
            warnings,
        })
    }

    /// Adds the wrench to frames whose times are counted from `begin_s`, if the model observes it. Returns `warnings` with the doubts about it.
    fn with_wrench(
        &self,
        model: &Model,
        frames: &mut [Frame],
        begin_s: f64,
        mut warnings: Vec<String>,
    ) -> Result<Vec<String>, EpisodeError> {
        if model.observation.wrench.is_some() {
            warnings.extend(self.add_wrench(frames, begin_s));
            if !model.observation.keypoints && frames.iter().all(|frame| frame.wrench.is_none()) {
                let needed = "a wrench on /panda/external_wrench, for a model that observes nothing else (observation.keypoints: false)";
                return Err(self.missing_because(&warnings, needed));
            }
        }
        Ok(warnings)
    }

    /// Adds the wrench to frames whose times are counted from `begin_s`. Returns the doubts about it.
    fn add_wrench(&self, frames: &mut [Frame], begin_s: f64) -> Vec<String> {
        let felt = plausible::wrenches(&self.wrenches);
        let wrenches: Vec<_> = frames.iter().map(|frame| felt.at(frame.time_s + begin_s)).collect();
        let (got, of) = (wrenches.iter().flatten().count(), frames.len());
        let mut warnings = felt.warnings;
        if 2 * got < of {
            let found = self.wrenches.len();
            warnings.push(format!("{WRENCHES}: expected the wrench at the times of the {of} frames, got it at {got} ({found} records in all): this episode is compared by its keypoints alone"));
            return warnings;
        }
        if got < of {
            warnings.push(format!(
                "{WRENCHES}: {} of {of} frames have no wrench near them, and are compared without it",
                of - got
            ));
        }
        frames.iter_mut().zip(wrenches).for_each(|(frame, wrench)| frame.wrench = wrench);
        warnings
    }

    /// Warning about keypoints outside of the view of the model's camera.
    fn view_warning(&self, seen: &[(f64, Keypoints)], camera: &Camera) -> Option<String> {
        let frames: Vec<[[f64; 2]; 4]> = seen.iter().map(|(_, k)| k.dlo_scaled()).collect();
        // Keypoints that the camera cannot place were left out before.
        let placed = |f: &[[f64; 2]; 4]| f.map(|p| camera.plane_from_scaled(p).unwrap_or_default());
        let points_m: Vec<[[f64; 2]; 4]> = frames.iter().map(placed).collect();
        view_warning(KEYPOINTS, camera, &frames, &points_m, |i| plausible::at(seen[i].0, self.start_ns))
    }

    /// Error of an episode that lacks the records described by `needed`.
    fn missing(&self, needed: &str) -> EpisodeError {
        self.missing_because(&self.notes, needed)
    }

    /// Error of an episode that lacks the records described by `needed`, with the doubts that may be its cause.
    fn missing_because(&self, doubts: &[String], needed: &str) -> EpisodeError {
        EpisodeError::Missing {
            episode: self.number,
            cause: doubts.iter().map(|doubt| format!("{doubt}: ")).collect(),
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

    /// Actions and observations of all steps from 0 on. A lost step is an error: it would shift all later steps in
    /// time.
    fn steps(&self, model: &Model) -> Result<(Vec<[f64; 2]>, Vec<Observation>), EpisodeError> {
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
        let rest = model.task.map_or(0, |task| task.rest_after(actions.len()));
        if !(actions.len()..=actions.len() + 1 + rest).contains(&observations.len()) {
            let found = format!("{} observations, {} actions", observations.len(), actions.len());
            let needed = "an observation before each action, and at most one after the last and after each step of the task's rest";
            return Err(missing(needed, found));
        }
        Ok((actions, observations))
    }

    /// Frames at the steps of the policy, made from its observations.
    fn policy_frames(&self, grip: &GripTrajectory, actions: &[[f64; 2]], observations: &[Observation]) -> Vec<Frame> {
        let frame = |(i, o): (usize, &Observation)| {
            let time_s = i as f64 * self.start.step_period_s;
            let [x, z] = o.eef_m();
            let action = actions.get(i).copied().unwrap_or_default();
            Frame {
                time_s,
                dlo: o.dlo(),
                target: o.target(),
                eef: [x, z, grip.at(time_s).pitch_rad],
                action,
                wrench: None,
            }
        };
        observations.iter().enumerate().map(frame).collect()
    }
}

/// Number of the model's frame times within a track of `duration_s`, and not after `until_s`.
fn room(model: &Model, duration_s: f64, until_s: f64) -> usize {
    let last_s = duration_s.min(until_s);
    (0..model.observation.frames).take_while(|i| *i as f64 * model.observation.frame_period_s <= last_s).count()
}

/// Times in s of samples.
fn sample_times_s<T>(samples: &[(f64, T)]) -> Vec<f64> {
    samples.iter().map(|(time_s, _)| *time_s).collect()
}

/// Frames nearest to the model's frame times, between the start of the episode and `until_s`. A frame time without a
/// frame within half a period is skipped.
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
        // At a camera rate below the model's, one frame can be the nearest of two frame times.
        if frames.last().is_some_and(|f| f.time_s >= *time_s) {
            continue;
        }
        // The target does not move: a frame that misses it takes the last place seen.
        target = k.target_scaled().unwrap_or(target);
        let p = grip.at(*time_s);
        let eef = [p.x_m, p.z_m, p.pitch_rad];
        frames.push(Frame { time_s: *time_s, dlo: k.dlo_scaled(), target, eef, action: [0.0; 2], wrench: None });
    }
    frames
}

/// Values of steps 0, 1, 2 and so on. The error describes the first step that is missing or comes twice.
fn each_once<T: Copy>(steps: &[(u32, T)]) -> Result<Vec<T>, String> {
    match steps.iter().enumerate().find(|(i, (step, _))| *i as u64 != u64::from(*step)) {
        Some((i, (step, _))) => Err(format!("step {step} in place of step {i}, among {} in all", steps.len())),
        None => Ok(steps.iter().map(|(_, value)| *value).collect()),
    }
}

/// Warning about a target that many frames see at another place than `target`.
fn target_warning(frames: &[Frame], target: [f64; 2]) -> Option<String> {
    let is_elsewhere = |f: &&Frame| (f.target[0] - target[0]).hypot(f.target[1] - target[1]) > TARGET_APART;
    let share = frames.iter().filter(is_elsewhere).count() as f64 / frames.len().max(1) as f64;
    (share > TARGET_DOUBT).then(|| {
        format!(
            "{KEYPOINTS}: target_u, target_v: in {:.0} % of the frames the target lies elsewhere than in the others, where something else may be mistaken \
             for it or somebody moved it; the median place is used",
            100.0 * share
        )
    })
}
