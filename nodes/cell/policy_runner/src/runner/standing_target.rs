//! Place of the target, which stands still.

use catenary_core::statistics::median_place;
use std::collections::VecDeque;

/// Time over which sightings count, s. Chosen: longer than most mistakes of a segmenter, and short enough to follow a target that somebody moves.
const WINDOW_S: f64 = 2.0;
/// Least number of sightings that count, however old they are. After a time in which the target was hidden, one mistaken frame does not decide.
const LEAST: usize = 15;

/// Sightings of the target. In some frames something else is taken for it: the median ignores them.
#[derive(Debug, Default)]
pub(super) struct StandingTarget {
    /// Stamp of the newest keypoints, with or without the target, s.
    newest_s: Option<f64>,
    /// Stamps, s, and places in the scaled image, the newest last.
    seen: VecDeque<(f64, [f64; 2])>,
}

impl StandingTarget {
    /// Adds the target of keypoints: its place, or `None` if it is hidden. Keypoints that are not newer than the last ones are ignored.
    pub(super) fn add_sighting(&mut self, stamp_s: f64, place: Option<[f64; 2]>) {
        if self.newest_s.is_some_and(|newest_s| stamp_s <= newest_s) {
            return;
        }
        self.newest_s = Some(stamp_s);
        let Some(place) = place else { return };
        self.seen.push_back((stamp_s, place));
        while self.seen.len() > LEAST && stamp_s - self.seen[0].0 > WINDOW_S {
            self.seen.pop_front();
        }
    }

    /// Forgets sightings from long before `now_s`, the start of an episode. Within the episode a hidden target stays where it was seen; one that
    /// was taken away before must not be followed.
    pub(super) fn begin(&mut self, now_s: f64) {
        self.seen.retain(|(stamp_s, _)| now_s - stamp_s <= WINDOW_S);
    }

    /// Returns the median place, coordinate by coordinate; `None` if the target was not seen.
    pub(super) fn place(&self) -> Option<[f64; 2]> {
        median_place(self.seen.iter().map(|(_, place)| *place))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HERE: [f64; 2] = [0.0, 0.5];
    const THERE: [f64; 2] = [0.8, -0.8];

    /// Adds keypoints of `hz` frames a second up to `until_s`, and returns the place.
    fn seen(hz: u32, from_s: f64, until_s: f64, place: impl Fn(u32) -> Option<[f64; 2]>) -> StandingTarget {
        let mut target = StandingTarget::default();
        for i in 0..((until_s - from_s) * f64::from(hz)) as u32 {
            let s = from_s + f64::from(i) / f64::from(hz);
            target.add_sighting(s, place(i));
        }
        target
    }

    #[test]
    fn a_target_that_is_mistaken_in_some_frames_stands_where_most_frames_see_it() {
        assert_eq!(StandingTarget::default().place(), None);
        let exact = seen(30, 0.0, 1.0, |_| Some(HERE)).place();
        // A third of the sightings, the newest among them, are of something else; in some frames the target is hidden.
        let mistaken = seen(30, 0.0, 1.0, |i| [Some(THERE), Some(HERE), None, Some(HERE)][(29 - i) as usize % 4]);
        assert!(exact.is_some() && mistaken.place() == exact, "{:?}", mistaken.place());
        // Hidden for a long time, then one mistaken frame.
        let mut hidden = seen(30, 0.0, 1.0, |_| Some(HERE));
        hidden.add_sighting(60.0, Some(THERE));
        assert_eq!(hidden.place(), exact);
    }

    #[test]
    fn a_target_that_was_moved_is_followed_within_two_seconds_at_any_rate() {
        let there = seen(30, 0.0, 1.0, |_| Some(THERE)).place();
        for hz in [5, 30, 60] {
            let moved = |after_s: f64| seen(hz, 0.0, 10.0 + after_s, |i| Some(if i < 10 * hz { HERE } else { THERE }));
            assert_ne!(moved(0.5).place(), there, "{hz} Hz");
            assert_eq!(moved(2.1).place(), there, "{hz} Hz");
        }
    }

    #[test]
    fn keypoints_that_come_again_count_once() {
        let mut target = seen(30, 0.0, 1.0, |_| Some(HERE));
        (0..100).for_each(|_| target.add_sighting(29.0 / 30.0, Some(THERE)));
        assert_eq!(target.place(), Some(HERE));
    }

    #[test]
    fn a_target_that_was_taken_away_before_the_episode_is_forgotten() {
        for (start_s, is_known) in [(1.5, true), (3.5, false)] {
            let mut target = seen(30, 0.0, 1.0, |_| Some(HERE));
            target.begin(start_s);
            assert_eq!(target.place().is_some(), is_known, "start at {start_s} s");
        }
    }
}
