//! What was seen of one episode.

use crate::Camera;
use serde::{Deserialize, Serialize};

/// What was seen at one moment.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Frame {
    /// s since the start of the episode.
    pub time_s: f64,
    /// The object's four keypoints (x, y), scaled to -1 .. 1 over the image: a set, its order may flip between frames.
    pub dlo: [[f64; 2]; 4],
    /// The target's centre (x, y), scaled likewise.
    pub target: [f64; 2],
    /// End effector x, z in m (frame panda_link0) and pitch in rad.
    pub eef: [f64; 3],
    /// The action (dx, dz) in m that follows this moment; zero where none does.
    pub action: [f64; 2],
}

/// Why a simulated or a measured episode ended.
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
    /// The name used in messages and recordings.
    pub fn name(self) -> &'static str {
        match self {
            End::Success => "success",
            End::StepLimit => "step_limit",
            End::LeftWorkspace => "left_workspace",
            End::Complete => "complete",
        }
    }

    /// The end that is called `name`.
    pub fn from_name(name: &str) -> Option<End> {
        [End::Success, End::StepLimit, End::LeftWorkspace, End::Complete].into_iter().find(|e| e.name() == name)
    }
}

/// A track: F frames in order of time. An episode that ended early has fewer frames than was asked for.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Track {
    /// The frames, in order of time.
    pub frames: Vec<Frame>,
    /// Why the episode ended.
    pub end: End,
}
/// Root mean square distance, in mm, of the keypoints of tracks from their own middle: the error of a prediction of nothing
/// but that middle. None without keypoints, or where the camera cannot place one in the plane.
pub fn spread_mm<'a>(tracks: impl IntoIterator<Item = &'a Track>, camera: &Camera) -> Option<f64> {
    let points = tracks.into_iter().flat_map(|t| &t.frames).flat_map(|f| f.dlo);
    let points = points.map(|p| camera.plane_from_scaled(p)).collect::<Option<Vec<[f64; 2]>>>()?;
    let n = points.len() as f64;
    let variance = |axis: usize| {
        let mean = points.iter().map(|p| p[axis]).sum::<f64>() / n;
        points.iter().map(|p| (p[axis] - mean).powi(2)).sum::<f64>() / n
    };
    (!points.is_empty()).then(|| 1e3 * (variance(0) + variance(1)).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_spread_is_that_of_all_keypoints_in_the_plane() {
        let camera = Camera::Plane(crate::camera::Plane { side_m: 2.0, ..Default::default() });
        let dlo = [[-0.1, 0.0], [0.1, 0.0], [0.0, -0.1], [0.0, 0.1]];
        let frame = Frame { time_s: 0.0, dlo, target: [0.0; 2], eef: [0.0; 3], action: [0.0; 2] };
        let track = Track { frames: vec![frame; 3], end: End::Complete };
        assert!((spread_mm([&track, &track], &camera).unwrap() - 100.0).abs() < 1e-9);
        assert_eq!(spread_mm([&Track::default()], &camera), None);
    }
}
