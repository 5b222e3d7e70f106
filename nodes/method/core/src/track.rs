//! Track of one episode: its frames over time, and its end.

use crate::Camera;
use serde::{Deserialize, Serialize};

/// Observed state at one time.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Frame {
    /// Time since the start of the episode in s.
    pub time_s: f64,
    /// Four keypoints (x, y) of the object, scaled to -1 .. 1 over the image. They are a set: the order may flip
    /// between frames.
    pub dlo: [[f64; 2]; 4],
    /// Centre of the target (x, y), scaled to -1 .. 1 over the image.
    pub target: [f64; 2],
    /// End effector x, z in m (frame panda_link0) and pitch in rad.
    pub eef: [f64; 3],
    /// Action (dx, dz) in m that follows this time; zero if none follows.
    pub action: [f64; 2],
    /// Wrench of the object on the hand at the clamped end (panda_hand_tcp), in panda_link0: force along x and z in N, torque about +y
    /// in N m; none if it is not observed. A hanging object has a negative force along z. A torque about +y turns z towards x,
    /// so that a load at x > 0 of the hand has a positive one.
    #[serde(default)]
    pub wrench: Option<[f64; 3]>,
}

/// Reason for the end of a simulated or a measured episode.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum End {
    /// The task's goal was reached.
    Success,
    /// The policy's step limit was reached.
    StepLimit,
    /// The end effector left the workspace.
    LeftWorkspace,
    /// A recorded path or action list was run to its end.
    #[default]
    Complete,
}

impl End {
    /// Name in messages and recordings.
    pub fn name(self) -> &'static str {
        match self {
            End::Success => "success",
            End::StepLimit => "step_limit",
            End::LeftWorkspace => "left_workspace",
            End::Complete => "complete",
        }
    }

    /// End with this name; none if no end has it.
    pub fn from_name(name: &str) -> Option<End> {
        [End::Success, End::StepLimit, End::LeftWorkspace, End::Complete].into_iter().find(|e| e.name() == name)
    }
}

/// F frames in order of time. An episode that ended early has fewer frames than requested.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Track {
    /// Frames in order of time.
    pub frames: Vec<Frame>,
    /// Reason for the end of the episode.
    pub end: End,
}

/// Root mean square distance in mm of the keypoints of tracks from their common mean: the error of a predictor that
/// always returns the mean. None without keypoints, or if the camera cannot place a keypoint in the plane.
pub fn spread_mm<'a>(tracks: impl IntoIterator<Item = &'a Track>, camera: &Camera) -> Option<f64> {
    let points = tracks.into_iter().flat_map(|t| &t.frames).flat_map(|f| f.dlo);
    let points = points.map(|p| camera.plane_from_scaled(p)).collect::<Option<Vec<[f64; 2]>>>()?;
    let n = points.len() as f64;
    let variance = |axis: usize| {
        let mean = points.iter().map(|p| p[axis]).sum::<f64>() / n;
        points.iter().map(|p| (p[axis] - mean).powi(2)).sum::<f64>() / n
    };
    // From m to mm.
    (!points.is_empty()).then(|| 1e3 * (variance(0) + variance(1)).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_spread_is_that_of_all_keypoints_in_the_plane() {
        let camera = Camera::Plane(crate::camera::Plane { side_m: 2.0, ..Default::default() });
        let dlo = [[-0.1, 0.0], [0.1, 0.0], [0.0, -0.1], [0.0, 0.1]];
        let frame = Frame { time_s: 0.0, dlo, target: [0.0; 2], eef: [0.0; 3], action: [0.0; 2], wrench: None };
        let track = Track { frames: vec![frame; 3], end: End::Complete };
        assert!((spread_mm([&track, &track], &camera).unwrap() - 100.0).abs() < 1e-9);
        assert_eq!(spread_mm([&Track::default()], &camera), None);
    }
}
