//! Measured episode and the request that simulates it.

use crate::error::FitError;
use crate::settings::Settings;
use catenary_core::camera::HALF_MASK_PX;
use catenary_core::episode::MeasuredTrack;
use catenary_core::model::DriveKind;
use catenary_core::simulator::StartShape;
use catenary_core::track::End;
use catenary_core::{Drive, Fidelity, Frame, GripTrajectory, KeypointOrder, Model, SimulationRequest, Track};
use serde::Serialize;

/// Measured episode with the request that simulates it.
#[derive(Debug, Clone)]
pub struct MeasuredEpisode {
    /// Simulation request with thetas and effects still empty, and without noise.
    pub template: SimulationRequest,
    /// Measured track.
    pub measured: Track,
    /// Ambiguity of the keypoints' order.
    pub order: KeypointOrder,
    /// Standard deviation of a scaled keypoint coordinate.
    pub(super) keypoint_sd: f64,
    /// Standard deviation of an end effector coordinate, m; none if the simulation follows the measured path of the
    /// arm.
    pub(super) pose_sd_m: Option<f64>,
    /// True if the keypoints are compared.
    pub(super) is_seen: bool,
    /// Standard deviations of the wrench on the hand, N, N and N m; none if it is not compared.
    pub(super) wrench_sd: Option<[f64; 3]>,
    /// Fidelity correction, a row a frame, that is added to every simulated track; empty: none.
    pub(super) correction: Vec<Correction>,
}

/// Difference between a finer and a coarse simulation in one frame.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(super) struct Correction {
    pub(super) dlo: [[f64; 2]; 4],
    pub(super) eef: [f64; 3],
    pub(super) wrench: [f64; 3],
}

impl MeasuredEpisode {
    /// Episode driven as the model says. A model driven by a policy replays the policy's actions.
    ///
    /// # Errors
    /// [`FitError::Drive`] if actions are needed and there are none, [`FitError::Nothing`] if the model observes the wrench alone and the
    /// episode has none, [`FitError::Noise`] if the model's camera
    /// has no noise, [`FitError::PoseNoise`] if its predicted arm has none.
    pub fn new(model: &Model, measured: &MeasuredTrack, settings: &Settings) -> Result<Self, FitError> {
        let noise_px = model.camera.keypoint_noise_px;
        if !(noise_px > 0.0 && noise_px.is_finite()) {
            return Err(FitError::Noise { got: noise_px });
        }
        let kind = model.observation.drive;
        // A simulation that follows the measured path of the hand predicts no arm pose.
        let is_path = kind == DriveKind::Grip;
        let pose_noise_m = model.arm.pose_noise_m;
        let is_noise = pose_noise_m > 0.0 && pose_noise_m.is_finite();
        if !is_path && !is_noise {
            return Err(FitError::PoseNoise { got: pose_noise_m });
        }
        let drive = match kind {
            DriveKind::Grip => Drive::Grip(measured.grip.clone()),
            _ if measured.actions.is_empty() => {
                return Err(FitError::Drive { episode: measured.name.clone(), drive: kind.name() });
            }
            _ => Drive::Actions(measured.actions.clone()),
        };
        // A recording may lack the wrench that the model observes: it is compared by its keypoints alone.
        let is_felt = measured.track.frames.iter().any(|frame| frame.wrench.is_some());
        if !model.observation.keypoints && !is_felt {
            return Err(FitError::Nothing { episode: measured.name.clone() });
        }
        let times = || measured.track.frames.iter().map(|f| f.time_s).collect();
        let template = SimulationRequest {
            thetas: Vec::new(),
            effects: Vec::new(),
            drive,
            start: measured.start.clone(),
            frame_times_s: if is_path { times() } else { Vec::new() },
            target_m: measured.target_m,
            fidelity: settings.fidelity,
            seed: settings.seed,
            first_episode: 0,
            noise: false,
        };
        Ok(Self {
            template,
            measured: measured.track.clone(),
            order: KeypointOrder::of(kind),
            keypoint_sd: noise_px / HALF_MASK_PX,
            pose_sd_m: (!is_path).then_some(model.arm.pose_noise_m),
            is_seen: model.observation.keypoints,
            wrench_sd: model.observation.wrench.filter(|_| is_felt).map(|noise| noise.sds()),
            correction: Vec::new(),
        })
    }

    /// Planned episode of some actions from the model's start pose, without measurements.
    pub fn planned(model: &Model, actions: &[[f64; 2]], settings: &Settings) -> Self {
        let duration_s = model.task.map_or(0.0, |t| t.step_period_s) * actions.len() as f64;
        let is_path = model.observation.drive == DriveKind::Grip;
        let frames = (duration_s / model.observation.frame_period_s).floor() as usize;
        let times = (0..=frames).map(|i| i as f64 * model.observation.frame_period_s).collect();
        let template = SimulationRequest {
            thetas: Vec::new(),
            effects: Vec::new(),
            drive: Drive::Actions(actions.to_vec()),
            start: StartShape::HangingAtRest,
            frame_times_s: if is_path { times } else { Vec::new() },
            target_m: None,
            fidelity: settings.fidelity,
            seed: settings.seed,
            first_episode: 0,
            noise: false,
        };
        Self {
            template,
            measured: Track { frames: Vec::new(), end: End::Complete },
            order: KeypointOrder::of(model.observation.drive),
            keypoint_sd: model.camera.keypoint_noise_px / HALF_MASK_PX,
            pose_sd_m: (!is_path).then_some(model.arm.pose_noise_m),
            is_seen: model.observation.keypoints,
            wrench_sd: model.observation.wrench.map(|noise| noise.sds()),
            correction: Vec::new(),
        }
    }

    /// Planned episode of a path of the hand, from the object at rest, seen at the model's frame period and without measurements.
    pub fn planned_along(model: &Model, path: GripTrajectory, settings: &Settings) -> Self {
        let duration_s = path.times_s().last().copied().unwrap_or(0.0);
        let period_s = model.observation.frame_period_s;
        // A last frame at the very end counts, whatever the rounding.
        let frames = (duration_s / period_s + 1e-9).floor() as usize;
        let planned = Self::planned(model, &[], settings);
        let template = SimulationRequest {
            drive: Drive::Grip(path),
            frame_times_s: (0..=frames).map(|i| i as f64 * period_s).collect(),
            ..planned.template
        };
        // The path of the hand is given, and not predicted.
        Self { template, pose_sd_m: None, order: KeypointOrder::of(DriveKind::Grip), ..planned }
    }

    /// Episode with another measured track.
    #[must_use]
    pub fn with_measured(&self, measured: Track) -> Self {
        Self { measured, ..self.clone() }
    }

    /// Episode with a fidelity correction: the difference between `fine` and `coarse`, two simulations of the same
    /// parameters. The correction is used for all parameters, because the discretisation error changes little between
    /// them.
    #[must_use]
    pub fn corrected_by(&self, fine: &Track, coarse: &Track) -> Self {
        let difference = |(f, c): (&Frame, &Frame)| Correction {
            dlo: std::array::from_fn(|k| std::array::from_fn(|i| f.dlo[k][i] - c.dlo[k][i])),
            eef: std::array::from_fn(|i| f.eef[i] - c.eef[i]),
            wrench: f.wrench.zip(c.wrench).map_or([0.0; 3], |(f, c)| std::array::from_fn(|i| f[i] - c[i])),
        };
        Self { correction: fine.frames.iter().zip(&coarse.frames).map(difference).collect(), ..self.clone() }
    }

    /// Episode at another fidelity, without correction.
    #[must_use]
    pub fn at(&self, fidelity: Fidelity) -> Self {
        let mut other = self.uncorrected();
        other.template.fidelity = fidelity;
        other
    }

    /// Episode without fidelity correction.
    #[must_use]
    pub fn uncorrected(&self) -> Self {
        Self { correction: Vec::new(), ..self.clone() }
    }

    /// Beginning of the episode: the first `share` of its frames.
    #[must_use]
    pub fn beginning(&self, share: f64) -> Self {
        let count = (share * self.measured.frames.len() as f64).ceil() as usize;
        let mut first = self.clone();
        first.measured.frames.truncate(count);
        // A path is cut by its frame times. There is one action fewer than frames: none follows the last frame.
        first.template.frame_times_s.truncate(count);
        if let Drive::Actions(actions) = &mut first.template.drive {
            actions.truncate(count.saturating_sub(1));
        }
        first
    }

    /// Episode with `factor` times the variance of the wrench's noise.
    #[must_use]
    pub fn with_wrench_variance(&self, factor: f64) -> Self {
        Self { wrench_sd: self.wrench_sd.map(|sds| sds.map(|sd| sd * factor.sqrt())), ..self.clone() }
    }

    /// Simulated track plus the fidelity correction.
    #[must_use]
    pub fn corrected(&self, mut track: Track) -> Track {
        for (frame, by) in track.frames.iter_mut().zip(&self.correction) {
            for k in 0..4 {
                (0..2).for_each(|i| frame.dlo[k][i] += by.dlo[k][i]);
            }
            (0..3).for_each(|i| frame.eef[i] += by.eef[i]);
            frame.wrench.iter_mut().for_each(|wrench| (0..3).for_each(|i| wrench[i] += by.wrench[i]));
        }
        track
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use catenary_core::GripTrajectory;

    pub fn frame(time_s: f64) -> Frame {
        let dlo = std::array::from_fn(|k| [0.1 * k as f64, 0.05 * time_s]);
        Frame { time_s, dlo, target: [0.0; 2], eef: [0.4, 0.3, 0.0], action: [0.0; 2], wrench: None }
    }

    /// Episode of a hanging bar, five frames long.
    pub fn bar_episode(drive: DriveKind) -> MeasuredEpisode {
        let mut model = Model::from_yaml(include_str!("../../../../../launch_configs/models/soft_bar.yaml")).unwrap();
        model.observation.drive = drive;
        let measured = MeasuredTrack {
            name: "episode of a bar".into(),
            track: Track { frames: (0..5).map(|i| frame(f64::from(i))).collect(), end: End::Complete },
            grip: GripTrajectory::new(vec![0.0, 5.0], vec![Default::default(); 2]).unwrap(),
            actions: vec![[0.0; 2]; 4],
            start: StartShape::HangingAtRest,
            target_m: None,
            warnings: Vec::new(),
        };
        MeasuredEpisode::new(&model, &measured, &Settings::default()).unwrap()
    }

    #[test]
    fn a_beginning_keeps_the_first_frames_and_their_actions() {
        let episode = bar_episode(DriveKind::Grip);
        let first = episode.beginning(0.5);
        assert_eq!(
            (first.measured.frames.len(), first.template.frame_times_s.as_slice()),
            (3, [0.0, 1.0, 2.0].as_slice())
        );
        assert_eq!(episode.beginning(1.0).measured, episode.measured);
        let acted = bar_episode(DriveKind::Actions);
        let driven = |episode: &MeasuredEpisode| match &episode.template.drive {
            Drive::Actions(actions) => actions.len(),
            _ => panic!("actions drive it"),
        };
        assert_eq!([driven(&acted), driven(&acted.beginning(0.5)), driven(&acted.beginning(0.1))], [4, 2, 0]);
    }
}
