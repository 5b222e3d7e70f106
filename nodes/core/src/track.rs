//! What was seen of one episode.

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
