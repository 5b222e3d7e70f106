//! Choice of the draws and the frames that a posterior predictive check compares.

use catenary_core::Track;
use catenary_core::track::End;

/// Draws that are compared, and the number of frames of each episode that are compared.
pub(super) struct Selection {
    pub(super) draws: Vec<usize>,
    pub(super) frames: Vec<usize>,
}

impl Selection {
    /// Selects the draws that reached every measured frame. If there are none, because a success ends an episode of the task
    /// `reach`, it selects the draws that ended by a success, and the frames up to the earliest end.
    ///
    /// The earliest end depends on the draws and the measurement alike: those of one distribution stay exchangeable, and the
    /// p value stays valid.
    pub(super) fn new(episodes: &[(&Track, Vec<Track>)]) -> Option<Self> {
        let finite = |t: &Track| t.frames.iter().all(|f| f.dlo.as_flattened().iter().all(|v| v.is_finite()));
        let draws = episodes.iter().map(|(_, tracks)| tracks.len()).min().unwrap_or(0);
        let reaches = |m: &Track, t: &Track| t.frames.len() >= m.frames.len();
        let in_all = |i: usize, check: &dyn Fn(&Track, &Track) -> bool| episodes.iter().all(|(m, t)| check(m, &t[i]));
        let whole: Vec<usize> = (0..draws).filter(|i| in_all(*i, &|m, t| reaches(m, t) && finite(t))).collect();
        if !whole.is_empty() {
            return Some(Self { draws: whole, frames: episodes.iter().map(|(m, _)| m.frames.len()).collect() });
        }
        let succeeded = |m: &Track, t: &Track| finite(t) && (reaches(m, t) || t.end == End::Success);
        let draws: Vec<usize> = (0..draws).filter(|i| in_all(*i, &succeeded)).collect();
        let earliest = |(m, tracks): &(&Track, Vec<Track>)| {
            draws.iter().map(|&i| tracks[i].frames.len()).chain([m.frames.len()]).min().unwrap_or(0)
        };
        let frames: Vec<usize> = episodes.iter().map(earliest).collect();
        (!draws.is_empty()).then_some(Self { draws, frames })
    }
}
