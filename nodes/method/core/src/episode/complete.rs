//! Complete episode: the records between a start and an end.

use super::plausible::{self, HandLimits, MeasuredPose};
use crate::task::DeltaAnchor;
use crate::{Keypoints, Observation};

/// Start of an episode, as `/episode/event` reports it.
#[derive(Debug, Clone, PartialEq)]
pub struct EpisodeStart {
    /// Name of the policy that runs; `recorded` for a path that was recorded without a policy.
    pub policy: String,
    /// Seed of the episode.
    pub seed: u64,
    /// Time between two actions in s.
    pub step_period_s: f64,
    /// Pose that a delta is added to.
    pub delta_anchor: DeltaAnchor,
}

/// Complete episode. Times are in s since its start.
#[derive(Debug, Clone, PartialEq)]
pub struct Episode {
    /// Number of the episode in the recording.
    pub number: u32,
    /// Number of other complete episodes with the same number.
    pub namesakes: usize,
    /// Start event of the episode.
    pub start: EpisodeStart,
    /// Stamp of the start, ns.
    pub start_ns: i64,
    /// Length in s.
    pub duration_s: f64,
    /// Reason for its end, as the end event states it.
    pub end: String,
    /// Keypoints with their times in s, in order of time.
    pub keypoints: Vec<(f64, Keypoints)>,
    /// Poses of the hand with their times in s, in order of time.
    pub poses: Vec<(f64, MeasuredPose)>,
    /// Wrenches of the object on the hand, in the order of [`crate::Frame::wrench`], with their times in s, in order of time.
    pub wrenches: Vec<(f64, [f64; 3])>,
    /// Actions (dx, dz) in m with the numbers of their steps, in order of steps.
    pub actions: Vec<(u32, [f64; 2])>,
    /// Observations with the numbers of their steps, in order of steps. A regular end adds one observation after the
    /// last action.
    pub observations: Vec<(u32, Observation)>,
    /// Reason why keypoints and poses are those of several episodes; none if they are not.
    pub mixed: Option<String>,
    /// Doubts about the recording, one sentence each.
    pub notes: Vec<String>,
}

/// True if `reason` says that a fault of the arm or of a node ended an episode, instead of the task or the user.
pub(super) fn is_fault(reason: &str) -> bool {
    let reason = reason.trim_start().to_ascii_lowercase();
    ["fault", "error", "abort", "failed", "failure"].iter().any(|word| reason.starts_with(word))
}

impl Episode {
    /// Doubts that need no model: records of several episodes, an end by a fault, poses that no Panda reaches, and zeros
    /// in place of keypoints.
    pub fn doubts(&self) -> Vec<String> {
        let poses = plausible::poses(&self.poses, &HandLimits::default(), self.start_ns);
        // A stream that is refused is the greatest doubt.
        let poses = poses.map_or_else(|reason| vec![reason], |plausible| plausible.warnings);
        let seen: Vec<_> = self.keypoints.iter().filter(|(_, k)| k.dlo_seen()).copied().collect();
        let zeros = plausible::zero_warning(&seen, self.start_ns).unwrap_or_else(Some);
        self.mixed.iter().cloned().chain(self.fault_warning()).chain(poses).chain(zeros).collect()
    }

    /// True if a fault ended the episode, instead of the task or the user.
    pub fn is_faulty(&self) -> bool {
        is_fault(&self.end)
    }

    /// Warning about an episode that a fault ended; none for other ends.
    pub fn fault_warning(&self) -> Option<String> {
        self.is_faulty().then(|| {
            format!(
                "/episode/event: episode {} ended with \"{}\": the arm may not have done what it was told",
                self.number, self.end
            )
        })
    }

    /// Known doubts as a prefix of an error message.
    pub(super) fn cause(&self) -> String {
        self.notes.iter().map(|note| format!("{note}: ")).collect()
    }

    /// Warning about other complete episodes with the same number.
    pub(super) fn namesake_warning(&self) -> Option<String> {
        (self.namesakes > 0).then(|| {
            format!(
                "the recording has {} complete episodes called {}: this is the one that starts at {:.3} s and ended with {}",
                self.namesakes + 1,
                self.number,
                self.start_ns as f64 * 1e-9,
                self.end
            )
        })
    }
}
