//! State of the object at the start of a measured track: places and velocities of its keypoints from the first frames.
//!
//! A polynomial in time is fitted to each coordinate of the first frames. Place and velocity are its value and its slope
//! at the middle frame, where both are surest: the one-sided difference of two frames has the error of one frame over the
//! frame period, and an object that was let go accelerates by more than that within the first frames. The track begins
//! at the middle frame. (Savitzky and Golay 1964, "Smoothing and differentiation of data by simplified least squares".)

use super::order::order_from;
use crate::simulator::StartShape;
use crate::{Camera, GripTrajectory, Keypoints};
use nalgebra::{DMatrix, DVector};

/// Time in s over which the first frames are fitted, and least number of frames.
// A hanging cable swings with periods of a second and more: within a fifth of one a cubic follows it to a per cent.
const WINDOW_S: f64 = 0.2;
const LEAST_FRAMES: usize = 7;
/// Highest degree of the polynomials. Four frames or more beyond the degree leave the noise of a frame.
const DEGREE: usize = 3;
/// Longest time in s between the first and the last fitted frame. Frames that are farther apart belong to other motions.
const LONGEST_S: f64 = 0.6;

/// State at the start of a measured track.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct MeasuredStart {
    /// Time of the state since the start of the episode in s.
    pub time_s: f64,
    /// Places and velocities.
    pub shape: StartShape,
    /// Times in s of the first and the last frame behind it.
    pub frames_s: [f64; 2],
    /// Number of frames behind it.
    pub frames: usize,
}

/// State at the start from the frames `keypoints` (time in s since the start of the episode, ordered), as seen by `camera`;
/// none without two frames that the camera can place.
pub(super) fn measured_start(
    keypoints: &[(f64, Keypoints)],
    camera: &Camera,
    grip: &GripTrajectory,
) -> Option<MeasuredStart> {
    // Times were converted from ns: a frame stamped at the start may lie below 0 by rounding.
    let seen = keypoints.iter().filter(|(t, k)| *t >= -1e-9 && k.dlo_seen());
    let placed = seen.filter_map(|(time_s, k)| {
        let [a, b, c, d] = k.dlo_scaled().map(|p| camera.plane_from_scaled(p));
        let p = grip.at(*time_s);
        Some((*time_s, order_from([p.x_m, p.z_m], [a?, b?, c?, d?])))
    });
    let mut frames: Vec<(f64, [[f64; 2]; 4])> = Vec::new();
    for frame in placed {
        let since_s = frames.first().map_or(0.0, |first| frame.0 - first.0);
        let is_enough = frames.len() >= LEAST_FRAMES && since_s > WINDOW_S;
        if is_enough || (frames.len() >= 2 && since_s > LONGEST_S) {
            break;
        }
        frames.push(frame);
    }
    if frames.len() < 2 {
        return None;
    }
    // The middle of an even number of frames is the earlier one, so that two frames give the old difference.
    let time_s = frames[(frames.len() - 1) / 2].0;
    let degree = DEGREE.min(frames.len().div_ceil(2));
    let design = DMatrix::from_fn(frames.len(), degree + 1, |i, j| (frames[i].0 - time_s).powi(j as i32));
    let svd = design.svd(true, true);
    let coefficients = |k: usize, axis: usize| {
        let values = DVector::from_fn(frames.len(), |i, _| frames[i].1[k][axis]);
        svd.solve(&values, f64::EPSILON).ok()
    };
    let mut points_m = [[0.0; 2]; 4];
    let mut velocities_m_s = [[0.0; 2]; 4];
    for k in 0..4 {
        for axis in 0..2 {
            let fitted = coefficients(k, axis)?;
            (points_m[k][axis], velocities_m_s[k][axis]) = (fitted[0], fitted[1]);
        }
    }
    let frames_s = [frames[0].0, frames[frames.len() - 1].0];
    Some(MeasuredStart {
        time_s,
        shape: StartShape::Measured { points_m, velocities_m_s },
        frames_s,
        frames: frames.len(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::GripPose;

    /// Camera without perspective: a square of 2 m about the origin.
    fn camera() -> Camera {
        let model = include_str!("../../../../../launch_configs/models/measured_cable.yaml");
        crate::Model::from_yaml(model).unwrap().camera.view
    }

    fn grip() -> GripTrajectory {
        GripTrajectory::new(vec![0.0], vec![GripPose { x_m: 0.0, z_m: 0.75, pitch_rad: 0.0 }]).unwrap()
    }

    /// Frames of four points that hang below the grip and move along x by `x(t)`, in proportion to their place.
    fn frames(times_s: &[f64], x: impl Fn(f64) -> f64) -> Vec<(f64, Keypoints)> {
        let camera = camera();
        let size = 256;
        let at = |t: f64, share: f64| {
            let [u, v] = camera.scaled_from_world([share * x(t), 0.0, 0.75 - 0.4 * share]).unwrap();
            [u, v].map(|s| 0.5 * (s + 1.0) * f64::from(size))
        };
        let one = |&t: &f64| {
            let dlo_px = [0.25, 0.5, 0.75, 1.0].map(|share| at(t, share));
            let keypoints = Keypoints {
                dlo_px,
                target_px: None,
                scores: [1.0; 4],
                target_score: 0.0,
                image_width_px: size,
                image_height_px: size,
            };
            (t, keypoints)
        };
        times_s.iter().map(one).collect()
    }

    fn tip(start: &MeasuredStart) -> ([f64; 2], [f64; 2]) {
        let StartShape::Measured { points_m, velocities_m_s } = &start.shape else { panic!("{:?}", start.shape) };
        (points_m[3], velocities_m_s[3])
    }

    #[test]
    fn a_cubic_motion_is_recovered_at_the_middle_frame() {
        let times: Vec<f64> = (0..20).map(|i| f64::from(i) / 30.0).collect();
        let x = |t: f64| 0.1 - 0.3 * t - 4.0 * t * t + 20.0 * t * t * t;
        let start = measured_start(&frames(&times, x), &camera(), &grip()).unwrap();
        let t = start.time_s;
        assert!((t - 0.1).abs() < 1e-9 && (start.frames_s[1] - 0.2).abs() < 1e-9, "{start:?}");
        let (place, velocity) = tip(&start);
        assert!((place[0] - x(t)).abs() < 1e-6, "{place:?}");
        assert!((velocity[0] - (-0.3 - 8.0 * t + 60.0 * t * t)).abs() < 1e-4, "{velocity:?}");
    }

    #[test]
    fn two_frames_give_their_difference_and_one_gives_nothing() {
        let x = |t: f64| 0.1 + 0.5 * t;
        let start = measured_start(&frames(&[0.0, 0.1], x), &camera(), &grip()).unwrap();
        let (place, velocity) = tip(&start);
        assert!(start.time_s == 0.0 && (place[0] - 0.1).abs() < 1e-6 && (velocity[0] - 0.5).abs() < 1e-5, "{start:?}");
        assert_eq!(measured_start(&frames(&[0.0], x), &camera(), &grip()), None);
    }

    #[test]
    fn frames_after_a_gap_are_not_fitted() {
        let x = |t: f64| if t < 0.5 { 0.1 } else { 9.0 };
        let start = measured_start(&frames(&[0.0, 0.033, 0.067, 2.0, 2.033], x), &camera(), &grip()).unwrap();
        let (place, velocity) = tip(&start);
        assert!((place[0] - 0.1).abs() < 1e-6 && velocity[0].abs() < 1e-5, "{start:?}");
    }
}
