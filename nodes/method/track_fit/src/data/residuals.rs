//! Whitened residuals between a measured and a simulated track.

use super::episode::{Correction, MeasuredEpisode};
use catenary_core::grip::POSE_LEVER_M;
use catenary_core::identity;
use catenary_core::simulator::{FrameDerivative, TrackSensitivities};
use catenary_core::track::End;
use catenary_core::{Frame, Track};
use nalgebra::{DMatrix, DVector};
use rand::Rng;
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};

/// Most checks of an episode's cost while it is simulated. Twenty checks cost next to nothing beside the simulation.
const CHECKS: usize = 20;

/// Measured quantity of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Quantity {
    /// Image coordinate of a keypoint. Keypoints are counted from the grip.
    Keypoint {
        /// Index along the object, 0 to 3.
        point: usize,
        /// Image axis, 0: x to the right, 1: y down.
        axis: usize,
    },
    /// Coordinate of the end effector.
    Pose {
        /// Axis, 0: x, 1: z, 2: pitch.
        axis: usize,
    },
    /// Component of the wrench of the object on the hand.
    Wrench {
        /// Axis, 0: force along x, 1: force along z, 2: torque about y.
        axis: usize,
    },
}

impl Quantity {
    /// Value of the quantity in a frame, or in a frame's derivative.
    fn of(self, dlo: &[[f64; 2]; 4], eef: &[f64; 3], wrench: &[f64; 3]) -> f64 {
        match self {
            Quantity::Keypoint { point, axis } => dlo[point][axis],
            Quantity::Pose { axis } => eef[axis],
            Quantity::Wrench { axis } => wrench[axis],
        }
    }
}

/// Row of the residuals: a quantity in one frame of one episode.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Channel {
    /// Index of the episode.
    pub episode: usize,
    /// Index of the frame.
    pub frame: usize,
    /// Time since the start of the episode, s.
    pub time_s: f64,
    /// Measured quantity.
    pub quantity: Quantity,
}

impl MeasuredEpisode {
    /// Sum of squares of the fidelity correction, in variances of the noise.
    pub fn corrected_squares(&self) -> f64 {
        let frame = |c: &Correction| -> f64 {
            self.quantities().map(|q| (q.of(&c.dlo, &c.eef, &c.wrench) / self.sd(q)).powi(2)).sum()
        };
        self.correction.iter().map(frame).sum()
    }

    /// Rows of the residuals, in order: by frame, then by quantity.
    pub fn channels(&self, episode: usize) -> Vec<Channel> {
        let frames = self.measured.frames.iter().enumerate();
        frames
            .flat_map(|(i, f)| {
                self.quantities().map(move |quantity| Channel { episode, frame: i, time_s: f.time_s, quantity })
            })
            .collect()
    }

    /// Measured quantities of a frame, in the order of the residuals: keypoints, then end effector, then wrench.
    fn quantities(&self) -> impl Iterator<Item = Quantity> + use<> {
        self.quantities_with(if self.is_seen { 4 } else { 0 })
    }

    /// Quantities of a frame with this number of keypoints.
    fn quantities_with(&self, points: usize) -> impl Iterator<Item = Quantity> + use<> {
        let keypoints = (0..points).flat_map(|point| [0, 1].map(|axis| Quantity::Keypoint { point, axis }));
        let poses = if self.pose_sd_m.is_some() { 3 } else { 0 };
        let wrench = if self.wrench_sd.is_some() { 3 } else { 0 };
        let poses = (0..poses).map(|axis| Quantity::Pose { axis });
        keypoints.chain(poses).chain((0..wrench).map(|axis| Quantity::Wrench { axis }))
    }

    /// Standard deviation of a quantity's noise, in the unit of the quantity.
    fn sd(&self, quantity: Quantity) -> f64 {
        let pose_sd_m = self.pose_sd_m.unwrap_or(f64::INFINITY);
        match quantity {
            Quantity::Keypoint { .. } => self.keypoint_sd,
            Quantity::Pose { axis: 2 } => pose_sd_m / POSE_LEVER_M,
            Quantity::Pose { .. } => pose_sd_m,
            Quantity::Wrench { axis } => self.wrench_sd.map_or(f64::INFINITY, |sd| sd[axis]),
        }
    }

    /// Whitened residuals (measured less simulated, in standard deviations of the noise, a row a channel) and their
    /// Jacobian: derivatives of the simulated values by the requested parameters in the same unit, a column a
    /// parameter.
    ///
    /// Keypoints are compared in the order that fits best among the possible ones. A simulation that ends early keeps
    /// its last frame, with zero derivatives. A frame without the wrench, measured or simulated, has zeros in its place, which pull at
    /// nothing: the first frame of an object that starts in motion, and those in a gap of the recording.
    pub fn compare(&self, measured: &Track, simulated: &TrackSensitivities) -> (DVector<f64>, DMatrix<f64>) {
        let rows = self.quantities().count();
        let count = measured.frames.len();
        let mut residuals = DVector::zeros(rows * count);
        let mut jacobian = DMatrix::zeros(rows * count, simulated.derivatives.len());
        for (i, seen) in measured.frames.iter().enumerate() {
            let Some(last) = simulated.track.frames.len().checked_sub(1) else { break };
            // Early end: the last frame stands for all later ones.
            let at = i.min(last);
            let predicted = &simulated.track.frames[at];
            let order = self.order.closest(&seen.dlo, &predicted.dlo);
            let ordered = order.map(|k| seen.dlo[k]);
            let wrenches = seen.wrench.zip(predicted.wrench);
            let (felt, predicted_wrench) = wrenches.unwrap_or_default();
            for (r, quantity) in self.quantities().enumerate() {
                if wrenches.is_none() && matches!(quantity, Quantity::Wrench { .. }) {
                    continue;
                }
                let sd = self.sd(quantity);
                let difference = quantity.of(&ordered, &seen.eef, &felt)
                    - quantity.of(&predicted.dlo, &predicted.eef, &predicted_wrench);
                residuals[rows * i + r] = difference / sd;
                if i <= last {
                    for (c, derivative) in simulated.derivatives.iter().enumerate() {
                        let FrameDerivative { dlo, eef, wrench, .. } = &derivative[at];
                        jacobian[(rows * i + r, c)] = quantity.of(dlo, eef, wrench) / sd;
                    }
                }
            }
        }
        (residuals, jacobian)
    }

    /// Residuals of [`Self::compare`] alone.
    pub fn residuals(&self, measured: &Track, simulated: &Track) -> DVector<f64> {
        let without_derivatives =
            TrackSensitivities { track: simulated.clone(), derivatives: Vec::new(), changes: Vec::new() };
        self.compare(measured, &without_derivatives).0
    }

    /// Sum of squares of the residuals.
    pub fn cost(&self, measured: &Track, simulated: &Track) -> f64 {
        self.residuals(measured, simulated).norm_squared()
    }

    /// Stopping rule of a simulation: true if its first `frames`, not corrected yet, cost more than `most`, or if no
    /// measured frame is left. The cost is checked at most `CHECKS` times an episode.
    pub fn is_enough(&self, measured: &Track, frames: &[Frame], most: f64) -> bool {
        let count = measured.frames.len();
        if frames.len() >= count {
            return true;
        }
        let beginning = |of: &[Frame]| Track { frames: of[..frames.len()].to_vec(), end: End::Complete };
        frames.len().is_multiple_of(count.div_ceil(CHECKS))
            && self.cost(&beginning(&measured.frames), &self.corrected(beginning(frames))) > most
    }

    /// Fingerprint of [`Self::is_enough`] for tracks that may cost up to `most` each.
    pub fn stop_fingerprint(&self, measured: &Track, most: &[f64]) -> u64 {
        let Self { order, keypoint_sd, pose_sd_m, is_seen, wrench_sd, correction, .. } = self;
        identity::fingerprint(&(measured, order, keypoint_sd, pose_sd_m, is_seen, wrench_sd, correction, most))
    }

    /// Simulated track with measurement noise, at the measured frames.
    pub fn measure<R: Rng>(&self, simulated: &Track, rng: &mut R) -> Track {
        let mut normal = || -> f64 { StandardNormal.sample(rng) };
        let mut frames = Vec::with_capacity(self.measured.frames.len());
        for (i, seen) in self.measured.frames.iter().enumerate() {
            // A track without frames has nothing to measure.
            let Some(last) = simulated.frames.len().checked_sub(1) else { break };
            let mut frame = Frame { time_s: seen.time_s, ..simulated.frames[i.min(last)] };
            // A quantity that was not measured in this frame is not predicted either.
            frame.wrench = frame.wrench.filter(|_| seen.wrench.is_some());
            // Keypoints that are not compared have noise, too.
            for quantity in self.quantities_with(4) {
                let noise = self.sd(quantity) * normal();
                match quantity {
                    Quantity::Keypoint { point, axis } => frame.dlo[point][axis] += noise,
                    Quantity::Pose { axis } => frame.eef[axis] += noise,
                    Quantity::Wrench { axis } => frame.wrench.iter_mut().for_each(|wrench| wrench[axis] += noise),
                }
            }
            frames.push(frame);
        }
        Track { frames, end: simulated.end }
    }
}

#[cfg(test)]
mod tests {
    use super::super::episode::tests::{bar_episode, frame};
    use super::*;
    use catenary_core::model::DriveKind;
    use catenary_core::seed;

    fn simulated(track: Track, derivatives: usize) -> TrackSensitivities {
        let one = FrameDerivative { dlo: [[2.0; 2]; 4], target: [0.0; 2], eef: [3.0; 3], wrench: [4.0; 3] };
        let derivatives = vec![vec![one; track.frames.len()]; derivatives];
        TrackSensitivities { changes: vec![1e-6; derivatives.len()], derivatives, track }
    }

    #[test]
    fn residuals_are_in_standard_deviations_and_invariant_to_a_flip() {
        let episode = bar_episode(DriveKind::Grip);
        let mut track = episode.measured.clone();
        track.frames[2].dlo[1][0] -= 0.7 / 128.0;
        let mut flipped = episode.measured.clone();
        flipped.frames[2].dlo.reverse();
        for measured in [&episode.measured, &flipped] {
            let (residuals, jacobian) = episode.compare(measured, &simulated(track.clone(), 2));
            assert_eq!((residuals.len(), jacobian.shape()), (5 * 8, (5 * 8, 2)));
            assert!((residuals[2 * 8 + 2] - 1.0).abs() < 1e-9 && (residuals.norm_squared() - 1.0).abs() < 1e-9);
            assert!((jacobian[(17, 1)] - 2.0 / (0.7 / 128.0)).abs() < 1e-9);
        }
    }

    #[test]
    fn sorted_keypoints_are_compared_in_the_order_that_fits_best() {
        let mut predicted = bar_episode(DriveKind::Actions).measured;
        // The tip is folded back over the bar, a hair below the third keypoint.
        predicted.frames[3].dlo = [[0.0, -0.4], [0.1, 0.1], [0.4, 0.3], [0.2, 0.301]];
        let mut measured = predicted.clone();
        measured.frames[3].dlo = [[0.0, -0.4], [0.1, 0.1], [0.2, 0.3], [0.4, 0.301]];
        let (sorted, followed) = (bar_episode(DriveKind::Actions), bar_episode(DriveKind::Grip));
        let cost =
            |episode: &MeasuredEpisode| episode.compare(&measured, &simulated(predicted.clone(), 0)).0.norm_squared();
        assert!(cost(&sorted) < 0.1 && cost(&followed) > 1000.0, "{} {}", cost(&sorted), cost(&followed));
    }

    #[test]
    fn a_simulation_may_end_once_its_corrected_frames_cost_too_much() {
        let episode = bar_episode(DriveKind::Grip);
        let mut track = episode.measured.clone();
        track.frames.iter_mut().for_each(|f| f.dlo[0][0] += 1.0 / 128.0);
        let cost = |episode: &MeasuredEpisode, count: usize| {
            let within = |most: f64| !episode.is_enough(&episode.measured, &track.frames[..count], most);
            (0..).map(|i| 0.1 * f64::from(i)).find(|most| within(*most)).unwrap()
        };
        // A pixel is 1 / 0.7 standard deviations.
        assert!((cost(&episode, 2) - 2.0 / 0.49).abs() < 0.1 && (cost(&episode, 4) - 4.0 / 0.49).abs() < 0.1);
        assert!(episode.is_enough(&episode.measured, &track.frames, f64::INFINITY), "no frame is left");
        let corrected = episode.corrected_by(&episode.measured, &track);
        assert_eq!(cost(&corrected, 4), 0.0);
        let fingerprint = episode.stop_fingerprint(&episode.measured, &[3.0]);
        assert_ne!(fingerprint, corrected.stop_fingerprint(&episode.measured, &[3.0]));
        assert_ne!(fingerprint, episode.stop_fingerprint(&episode.measured, &[4.0]));
        assert_ne!(fingerprint, episode.stop_fingerprint(&track, &[3.0]));
        assert_eq!(fingerprint, episode.stop_fingerprint(&episode.measured.clone(), &[3.0]));
    }

    #[test]
    fn long_episodes_are_checked_no_more_often_than_short_ones() {
        let mut episode = bar_episode(DriveKind::Grip);
        episode.measured.frames = (0..101).map(|i| frame(f64::from(i))).collect();
        let mut track = episode.measured.clone();
        track.frames.iter_mut().for_each(|f| f.dlo[0][0] += 0.1);
        let looks: Vec<usize> =
            (1..101).filter(|count| episode.is_enough(&episode.measured, &track.frames[..*count], 0.0)).collect();
        assert_eq!(looks, (1..=16).map(|i| 6 * i).collect::<Vec<_>>());
    }

    #[test]
    fn the_arm_is_compared_if_its_path_is_predicted() {
        let episode = bar_episode(DriveKind::Actions);
        let mut track = episode.measured.clone();
        track.frames[1].eef[2] += 5e-3;
        track.frames.truncate(3);
        let (residuals, jacobian) = episode.compare(&episode.measured, &simulated(track, 1));
        assert_eq!(residuals.len(), 5 * 11);
        assert!((residuals[11 + 10] + 1.0).abs() < 1e-9, "5 mrad at a lever of 0.1 m are 0.5 mm");
        assert!(residuals[4 * 11 + 1].abs() > 1.0, "it stands still from frame 2 on");
        assert_eq!((jacobian[(2 * 11, 0)] > 0.0, jacobian[(3 * 11, 0)]), (true, 0.0));
    }

    /// Episode of a bar whose wrench is measured, beside its keypoints or alone.
    fn felt_episode(keypoints: bool) -> MeasuredEpisode {
        let mut episode = bar_episode(DriveKind::Grip);
        episode.measured.frames.iter_mut().for_each(|f| f.wrench = Some([0.1, -2.0, 0.3]));
        (episode.is_seen, episode.wrench_sd) = (keypoints, Some([0.5, 0.1, 0.02]));
        episode
    }

    #[test]
    fn a_wrench_is_compared_beside_the_keypoints_or_alone() {
        for (keypoints, rows) in [(true, 11), (false, 3)] {
            let episode = felt_episode(keypoints);
            let mut track = episode.measured.clone();
            track.frames[1].wrench.as_mut().unwrap()[2] -= 0.02;
            track.frames[3].wrench = None;
            let (residuals, jacobian) = episode.compare(&episode.measured, &simulated(track, 1));
            assert_eq!((residuals.len(), episode.channels(0).len()), (5 * rows, 5 * rows));
            assert!((residuals[rows + rows - 1] - 1.0).abs() < 1e-9 && (residuals.norm_squared() - 1.0).abs() < 1e-9);
            let last = |frame: usize| jacobian[(frame * rows + rows - 1, 0)];
            assert!((last(1) - 4.0 / 0.02).abs() < 1e-9 && last(3) == 0.0, "no wrench, no pull");
        }
    }

    #[test]
    fn a_correction_and_noise_reach_the_wrench() {
        let episode = felt_episode(true);
        let mut fine = episode.measured.clone();
        fine.frames.iter_mut().for_each(|f| f.wrench.as_mut().unwrap()[0] += 0.5);
        let corrected = episode.corrected_by(&fine, &episode.measured);
        assert_eq!(corrected.corrected(episode.measured.clone()), fine);
        assert!((corrected.corrected_squares() - 5.0).abs() < 1e-9, "{}", corrected.corrected_squares());
        let mut rng = seed::rng(4, 0);
        let mut squares = 0.0;
        for _ in 0..400 {
            let noisy = episode.measure(&episode.measured, &mut rng);
            squares += ((noisy.frames[2].wrench.unwrap()[1] + 2.0) / 0.1).powi(2) / 400.0;
        }
        // The standard error of a mean of 400 squares is 0.07.
        assert!((squares - 1.0).abs() < 0.25, "{squares}");
    }

    #[test]
    fn simulated_noise_has_unit_variance_in_the_residuals() {
        let episode = bar_episode(DriveKind::Actions);
        let mut rng = seed::rng(3, 0);
        let square = |rng: &mut _| {
            let noisy = episode.measure(&episode.measured, rng);
            let (residuals, _) = episode.compare(&noisy, &simulated(episode.measured.clone(), 0));
            residuals.norm_squared() / residuals.len() as f64
        };
        let mean = (0..200).map(|_| square(&mut rng)).sum::<f64>() / 200.0;
        // Mean of 11000 squares of standard normals: its standard error is 0.0135.
        assert!((mean - 1.0).abs() < 0.05, "{mean}");
    }
}
