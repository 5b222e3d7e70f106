//! A measured episode, what reproduces it, and how far a simulated track lies from it.

use crate::error::FinderError;
use crate::settings::Settings;
use catenary_core::episode::MeasuredTrack;
use catenary_core::hash::fnv1a;
use catenary_core::model::DriveKind;
use catenary_core::simulator::{FrameDerivative, StartShape, TrackSensitivities};
use catenary_core::track::End;
use catenary_core::{Camera, Drive, Fidelity, Frame, KeypointOrder, Model, SimulationRequest, Track};
use nalgebra::{DMatrix, DVector};
use rand::Rng;
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};

/// Half the side of a mask, in pixels: keypoints are scaled to -1 .. 1 over 256.
const HALF_MASK_PX: f64 = 128.0;
/// Lever by which an angle of the end effector is compared with its place, m.
const LEVER_M: f64 = 0.1;

/// Most times that the cost of an episode is looked at while it is simulated.
const LOOKS: usize = 20;

/// What a row of residuals is a difference of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Quantity {
    /// Coordinate `axis` (0: x to the right, 1: y down) of keypoint `point` in the image, from the grip on.
    Keypoint {
        /// Place along the object, 0 to 3.
        point: usize,
        /// 0: x, 1: y.
        axis: usize,
    },
    /// Coordinate of the end effector: 0: x, 1: z, 2: pitch.
    Pose {
        /// 0: x, 1: z, 2: pitch.
        axis: usize,
    },
}

impl Quantity {
    /// Its number among the keypoints and the coordinates of the end effector of a frame, or of a frame's derivative.
    fn of(self, dlo: &[[f64; 2]; 4], eef: &[f64; 3]) -> f64 {
        match self {
            Quantity::Keypoint { point, axis } => dlo[point][axis],
            Quantity::Pose { axis } => eef[axis],
        }
    }
}

/// What a row of residuals is a difference of, and where.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Channel {
    /// Place of the episode.
    pub episode: usize,
    /// Place of the frame.
    pub frame: usize,
    /// s since the start.
    pub time_s: f64,
    /// What was measured.
    pub quantity: Quantity,
}

/// A measured episode with what reproduces it.
#[derive(Debug, Clone)]
pub struct Case {
    /// The request that reproduces it, without thetas, effects, seed and noise.
    pub template: SimulationRequest,
    /// What was measured.
    pub measured: Track,
    /// What is known of the order of its keypoints.
    pub order: KeypointOrder,
    /// Standard deviation of a scaled keypoint coordinate.
    keypoint_sd: f64,
    /// Standard deviation of a coordinate of the end effector in m, where the arm's path is a prediction.
    pose_sd_m: Option<f64>,
    /// What is added to every simulated track, a row a frame; none: nothing.
    correction: Vec<Correction>,
}

/// What a finer simulation shows otherwise in a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Correction {
    dlo: [[f64; 2]; 4],
    eef: [f64; 3],
}

impl Case {
    /// The episode at place `episode`, as the model drives it; a model that is driven by a policy gets the actions that the
    /// policy took.
    ///
    /// # Errors
    /// [`FinderError::Drive`] where actions are needed and there are none, [`FinderError::Noise`] where the model's camera
    /// has no noise to measure a disagreement by, or [`FinderError::PoseNoise`] where its arm has none and is a prediction.
    pub fn new(
        model: &Model,
        measured: &MeasuredTrack,
        episode: usize,
        settings: &Settings,
    ) -> Result<Self, FinderError> {
        let noise_px = model.camera.keypoint_noise_px;
        if !(noise_px > 0.0 && noise_px.is_finite()) {
            return Err(FinderError::Noise { got: noise_px });
        }
        let kind = model.observation.drive;
        let is_path = kind == DriveKind::Grip;
        let pose_noise_m = model.arm.pose_noise_m;
        let is_noise = pose_noise_m > 0.0 && pose_noise_m.is_finite();
        if !is_path && !is_noise {
            return Err(FinderError::PoseNoise { got: pose_noise_m });
        }
        let drive = match kind {
            DriveKind::Grip => Drive::Grip(measured.grip.clone()),
            _ if measured.actions.is_empty() => return Err(FinderError::Drive { episode, drive: kind.name() }),
            _ => Drive::Actions(measured.actions.clone()),
        };
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
            correction: Vec::new(),
        })
    }

    /// An episode of actions that was not run yet, from the model's start pose; nothing is measured of it.
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
            correction: Vec::new(),
        }
    }

    /// The same with another track measured.
    #[must_use]
    pub fn with_measured(&self, measured: Track) -> Self {
        Self { measured, ..self.clone() }
    }

    /// The same, in which every simulated track is corrected by what `fine` shows otherwise than `coarse`, one of the same
    /// values: the error of a coarse division of time and object changes little from one value to another.
    #[must_use]
    pub fn corrected_by(&self, fine: &Track, coarse: &Track) -> Self {
        let difference = |(f, c): (&Frame, &Frame)| Correction {
            dlo: std::array::from_fn(|k| std::array::from_fn(|i| f.dlo[k][i] - c.dlo[k][i])),
            eef: std::array::from_fn(|i| f.eef[i] - c.eef[i]),
        };
        Self { correction: fine.frames.iter().zip(&coarse.frames).map(difference).collect(), ..self.clone() }
    }

    /// The same at another fidelity, without correction.
    #[must_use]
    pub fn at(&self, fidelity: Fidelity) -> Self {
        let mut other = self.uncorrected();
        other.template.fidelity = fidelity;
        other
    }

    /// Sum of the squares of what simulated tracks are corrected by, in variances of the noise.
    pub fn corrected_squares(&self) -> f64 {
        let frame =
            |c: &Correction| -> f64 { self.quantities().map(|q| (q.of(&c.dlo, &c.eef) / self.sd(q)).powi(2)).sum() };
        self.correction.iter().map(frame).sum()
    }

    /// The same without correction.
    #[must_use]
    pub fn uncorrected(&self) -> Self {
        Self { correction: Vec::new(), ..self.clone() }
    }

    /// The first of its frames, that share of them.
    #[must_use]
    pub fn beginning(&self, share: f64) -> Self {
        let count = (share * self.measured.frames.len() as f64).ceil() as usize;
        let mut first = self.clone();
        first.measured.frames.truncate(count);
        // Of a path that was measured no more is driven; of actions, those before the last frame.
        first.template.frame_times_s.truncate(count);
        if let Drive::Actions(actions) = &mut first.template.drive {
            actions.truncate(count.saturating_sub(1));
        }
        first
    }

    /// A simulated track with the case's correction.
    #[must_use]
    pub fn corrected(&self, mut track: Track) -> Track {
        for (frame, by) in track.frames.iter_mut().zip(&self.correction) {
            for k in 0..4 {
                (0..2).for_each(|i| frame.dlo[k][i] += by.dlo[k][i]);
            }
            (0..3).for_each(|i| frame.eef[i] += by.eef[i]);
        }
        track
    }

    /// What each row of residuals is a difference of.
    pub fn channels(&self, episode: usize) -> Vec<Channel> {
        let frames = self.measured.frames.iter().enumerate();
        frames
            .flat_map(|(i, f)| {
                self.quantities().map(move |quantity| Channel { episode, frame: i, time_s: f.time_s, quantity })
            })
            .collect()
    }

    /// What is measured of a frame, in the order of its keypoints and of its coordinates of the end effector.
    fn quantities(&self) -> impl Iterator<Item = Quantity> + use<> {
        let keypoints = (0..4).flat_map(|point| [0, 1].map(|axis| Quantity::Keypoint { point, axis }));
        let poses = if self.pose_sd_m.is_some() { 3 } else { 0 };
        keypoints.chain((0..poses).map(|axis| Quantity::Pose { axis }))
    }

    /// Standard deviation of a quantity's noise, in the quantity's unit.
    fn sd(&self, quantity: Quantity) -> f64 {
        let pose_sd_m = self.pose_sd_m.unwrap_or(f64::INFINITY);
        match quantity {
            Quantity::Keypoint { .. } => self.keypoint_sd,
            Quantity::Pose { axis: 2 } => pose_sd_m / LEVER_M,
            Quantity::Pose { .. } => pose_sd_m,
        }
    }

    /// Measured less simulated, in standard deviations of the noise, a row a channel; and the simulated track's
    /// derivatives by the parameters asked for in the same unit, a column each. The order of a frame's keypoints is the one that
    /// fits best, of those that may be. An episode that ended before a measured frame stands still from its end on.
    pub fn compare(&self, measured: &Track, simulated: &TrackSensitivities) -> (DVector<f64>, DMatrix<f64>) {
        let rows = self.quantities().count();
        let count = measured.frames.len();
        let mut residuals = DVector::zeros(rows * count);
        let mut jacobian = DMatrix::zeros(rows * count, simulated.derivatives.len());
        for (i, seen) in measured.frames.iter().enumerate() {
            let Some(last) = simulated.track.frames.len().checked_sub(1) else { break };
            let at = i.min(last);
            let predicted = &simulated.track.frames[at];
            let order = self.order.closest(&seen.dlo, &predicted.dlo);
            let ordered = order.map(|k| seen.dlo[k]);
            for (r, quantity) in self.quantities().enumerate() {
                let sd = self.sd(quantity);
                let difference = quantity.of(&ordered, &seen.eef) - quantity.of(&predicted.dlo, &predicted.eef);
                residuals[rows * i + r] = difference / sd;
                if i <= last {
                    for (c, derivative) in simulated.derivatives.iter().enumerate() {
                        let FrameDerivative { dlo, eef, .. } = &derivative[at];
                        jacobian[(rows * i + r, c)] = quantity.of(dlo, eef) / sd;
                    }
                }
            }
        }
        (residuals, jacobian)
    }

    /// The residuals of [`Self::compare`] alone.
    pub fn residuals(&self, measured: &Track, simulated: &Track) -> DVector<f64> {
        let plain = TrackSensitivities { track: simulated.clone(), derivatives: Vec::new(), changes: Vec::new() };
        self.compare(measured, &plain).0
    }

    /// Sum of their squares.
    pub fn cost(&self, measured: &Track, simulated: &Track) -> f64 {
        self.residuals(measured, simulated).norm_squared()
    }

    /// Whether the first frames of a simulated track, in which nothing is corrected yet, cost more than `most` by themselves, or
    /// none that was measured is left. What they cost is looked at some times in an episode, so that this costs next to nothing.
    pub fn is_enough(&self, measured: &Track, frames: &[Frame], most: f64) -> bool {
        let count = measured.frames.len();
        if frames.len() >= count {
            return true;
        }
        let beginning = |of: &[Frame]| Track { frames: of[..frames.len()].to_vec(), end: End::Complete };
        frames.len().is_multiple_of(count.div_ceil(LOOKS))
            && self.cost(&beginning(&measured.frames), &self.corrected(beginning(frames))) > most
    }

    /// A number that stands for what [`Self::is_enough`] says, where each of some tracks may cost that much.
    pub fn number_of(&self, measured: &Track, most: &[f64]) -> u64 {
        let Self { order, keypoint_sd, pose_sd_m, correction, .. } = self;
        fnv1a(format!("{measured:?} {order:?} {keypoint_sd} {pose_sd_m:?} {correction:?} {most:?}").into_bytes())
    }

    /// A simulated track as it would have been measured: with noise, and cut or held to the measured frames.
    pub fn measure<R: Rng>(&self, simulated: &Track, rng: &mut R) -> Track {
        let mut normal = || -> f64 { StandardNormal.sample(rng) };
        let mut frames = Vec::with_capacity(self.measured.frames.len());
        for (i, seen) in self.measured.frames.iter().enumerate() {
            let Some(last) = simulated.frames.len().checked_sub(1) else { break };
            let mut frame = Frame { time_s: seen.time_s, ..simulated.frames[i.min(last)] };
            let values = frame.dlo.iter_mut().flatten().chain(&mut frame.eef);
            values.zip(self.quantities()).for_each(|(v, quantity)| *v += self.sd(quantity) * normal());
            frames.push(frame);
        }
        Track { frames, end: simulated.end }
    }

    /// [`offsets_mm`] of what was measured from a simulated track.
    pub fn offsets_mm(&self, simulated: &Track, camera: &Camera) -> Vec<Offset> {
        offsets_mm(&self.measured, simulated, self.order, camera)
    }
}

/// By how much the keypoints of a frame differ between two tracks, mm: x and z of each. None where a keypoint's line of
/// sight misses the plane of motion.
pub type Offset = Option<[f64; 8]>;

/// Keypoints of `measured` less those of `simulated` in the plane of motion, a row a frame of the measured track.
pub fn offsets_mm(measured: &Track, simulated: &Track, order: KeypointOrder, camera: &Camera) -> Vec<Offset> {
    let Some(last) = simulated.frames.len().checked_sub(1) else { return vec![None; measured.frames.len()] };
    let offset = |(i, seen): (usize, &Frame)| {
        let predicted = &simulated.frames[i.min(last)];
        let order = order.closest(&seen.dlo, &predicted.dlo);
        let mut offset = [0.0; 8];
        for k in 0..4 {
            let a = camera.plane_from_scaled(seen.dlo[order[k]])?;
            let b = camera.plane_from_scaled(predicted.dlo[k])?;
            (0..2).for_each(|axis| offset[2 * k + axis] = 1e3 * (a[axis] - b[axis]));
        }
        Some(offset)
    };
    measured.frames.iter().enumerate().map(offset).collect()
}

/// Root mean square distance of keypoints, mm, whose offsets these are.
pub fn rmse_mm<'a>(offsets: impl Iterator<Item = &'a Offset>) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for offset in offsets.flatten() {
        sum += offset.iter().map(|v| v * v).sum::<f64>();
        count += 4.0;
    }
    (sum / count).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use catenary_core::{GripTrajectory, seed};

    fn frame(time_s: f64) -> Frame {
        let dlo = std::array::from_fn(|k| [0.1 * k as f64, 0.05 * time_s]);
        Frame { time_s, dlo, target: [0.0; 2], eef: [0.4, 0.3, 0.0], action: [0.0; 2] }
    }

    fn case(drive: DriveKind) -> Case {
        let mut model = Model::from_yaml(include_str!("../../../launch_configs/models/soft_bar.yaml")).unwrap();
        model.observation.drive = drive;
        let measured = MeasuredTrack {
            track: Track { frames: (0..5).map(|i| frame(f64::from(i))).collect(), end: End::Complete },
            grip: GripTrajectory::new(vec![0.0, 5.0], vec![Default::default(); 2]).unwrap(),
            actions: vec![[0.0; 2]; 4],
            start: StartShape::HangingAtRest,
            target_m: None,
            warnings: Vec::new(),
        };
        Case::new(&model, &measured, 0, &Settings::default()).unwrap()
    }

    fn simulated(track: Track, derivatives: usize) -> TrackSensitivities {
        let one = FrameDerivative { dlo: [[2.0; 2]; 4], target: [0.0; 2], eef: [3.0; 3] };
        let derivatives = vec![vec![one; track.frames.len()]; derivatives];
        TrackSensitivities { changes: vec![1e-6; derivatives.len()], derivatives, track }
    }

    #[test]
    fn residuals_are_in_standard_deviations_and_do_not_mind_a_flip() {
        let case = case(DriveKind::Grip);
        let mut track = case.measured.clone();
        track.frames[2].dlo[1][0] -= 0.7 / 128.0;
        let mut flipped = case.measured.clone();
        flipped.frames[2].dlo.reverse();
        for measured in [&case.measured, &flipped] {
            let (residuals, jacobian) = case.compare(measured, &simulated(track.clone(), 2));
            assert_eq!((residuals.len(), jacobian.shape()), (5 * 8, (5 * 8, 2)));
            assert!((residuals[2 * 8 + 2] - 1.0).abs() < 1e-9 && (residuals.norm_squared() - 1.0).abs() < 1e-9);
            assert!((jacobian[(17, 1)] - 2.0 / (0.7 / 128.0)).abs() < 1e-9);
        }
    }

    #[test]
    fn observations_whose_keypoints_were_sorted_are_compared_with_the_object_as_it_lies() {
        let mut predicted = case(DriveKind::Actions).measured;
        // The tip is folded back over the bar, below its third keypoint by a hair.
        predicted.frames[3].dlo = [[0.0, -0.4], [0.1, 0.1], [0.4, 0.3], [0.2, 0.301]];
        let mut measured = predicted.clone();
        measured.frames[3].dlo = [[0.0, -0.4], [0.1, 0.1], [0.2, 0.3], [0.4, 0.301]];
        let (sorted, followed) = (case(DriveKind::Actions), case(DriveKind::Grip));
        let cost = |case: &Case| case.compare(&measured, &simulated(predicted.clone(), 0)).0.norm_squared();
        assert!(cost(&sorted) < 0.1 && cost(&followed) > 1000.0, "{} {}", cost(&sorted), cost(&followed));
    }

    #[test]
    fn a_beginning_has_the_first_frames_of_what_was_measured_and_drives_no_more() {
        let case = case(DriveKind::Grip);
        let first = case.beginning(0.5);
        assert_eq!(
            (first.measured.frames.len(), first.template.frame_times_s.as_slice()),
            (3, [0.0, 1.0, 2.0].as_slice())
        );
        assert_eq!(case.beginning(1.0).measured, case.measured);
        let acted = self::case(DriveKind::Actions);
        let driven = |case: &Case| match &case.template.drive {
            Drive::Actions(actions) => actions.len(),
            _ => panic!("actions drive it"),
        };
        assert_eq!([driven(&acted), driven(&acted.beginning(0.5)), driven(&acted.beginning(0.1))], [4, 2, 0]);
    }

    #[test]
    fn the_first_frames_are_enough_where_they_cost_more_with_their_correction() {
        let case = case(DriveKind::Grip);
        let mut track = case.measured.clone();
        track.frames.iter_mut().for_each(|f| f.dlo[0][0] += 1.0 / 128.0);
        let cost = |case: &Case, count: usize| {
            let within = |most: f64| !case.is_enough(&case.measured, &track.frames[..count], most);
            (0..).map(|i| 0.1 * f64::from(i)).find(|most| within(*most)).unwrap()
        };
        // A pixel is 1 / 0.7 standard deviations.
        assert!((cost(&case, 2) - 2.0 / 0.49).abs() < 0.1 && (cost(&case, 4) - 4.0 / 0.49).abs() < 0.1);
        assert!(case.is_enough(&case.measured, &track.frames, f64::INFINITY), "no frame is left");
        let corrected = case.corrected_by(&case.measured, &track);
        assert_eq!(cost(&corrected, 4), 0.0);
        let number = case.number_of(&case.measured, &[3.0]);
        assert_ne!(number, corrected.number_of(&case.measured, &[3.0]));
        assert_ne!(number, case.number_of(&case.measured, &[4.0]));
        assert_ne!(number, case.number_of(&track, &[3.0]));
        assert_eq!(number, case.number_of(&case.measured.clone(), &[3.0]));
    }

    #[test]
    fn long_episodes_are_looked_at_no_more_often_than_short_ones() {
        let mut case = case(DriveKind::Grip);
        case.measured.frames = (0..101).map(|i| frame(f64::from(i))).collect();
        let mut track = case.measured.clone();
        track.frames.iter_mut().for_each(|f| f.dlo[0][0] += 0.1);
        let looks: Vec<usize> =
            (1..101).filter(|count| case.is_enough(&case.measured, &track.frames[..*count], 0.0)).collect();
        assert_eq!(looks, (1..=16).map(|i| 6 * i).collect::<Vec<_>>());
    }

    #[test]
    fn the_arm_is_compared_where_its_path_is_a_prediction() {
        let case = case(DriveKind::Actions);
        let mut track = case.measured.clone();
        track.frames[1].eef[2] += 5e-3;
        track.frames.truncate(3);
        let (residuals, jacobian) = case.compare(&case.measured, &simulated(track, 1));
        assert_eq!(residuals.len(), 5 * 11);
        assert!((residuals[11 + 10] + 1.0).abs() < 1e-9, "5 mrad at a lever of 0.1 m are 0.5 mm");
        assert!(residuals[4 * 11 + 1].abs() > 1.0, "it stands still from frame 2 on");
        assert_eq!((jacobian[(2 * 11, 0)] > 0.0, jacobian[(3 * 11, 0)]), (true, 0.0));
    }

    #[test]
    fn measured_noise_has_the_size_by_which_residuals_are_divided() {
        let case = case(DriveKind::Actions);
        let mut rng = seed::rng(3, 0);
        let square = |rng: &mut _| {
            let noisy = case.measure(&case.measured, rng);
            let (residuals, _) = case.compare(&noisy, &simulated(case.measured.clone(), 0));
            residuals.norm_squared() / residuals.len() as f64
        };
        let mean = (0..200).map(|_| square(&mut rng)).sum::<f64>() / 200.0;
        // 11000 squares of standard normals: their mean is known to 0.0135.
        assert!((mean - 1.0).abs() < 0.05, "{mean}");
    }
}
