//! Place of the target, which stands still.

use super::{Inputs, check_stamp};
use catenary_core::statistics::median_high;
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
    /// Adds the target of fresh keypoints. Keypoints that were added before are ignored.
    pub(super) fn add_sighting(&mut self, inputs: &Inputs, max_age_s: f64) {
        let Some((stamp_s, keypoints)) = inputs.keypoints else { return };
        let is_fresh = check_stamp(stamp_s, inputs.now_s, [inputs.now_s - max_age_s, inputs.now_s + max_age_s]).is_ok();
        if !is_fresh || self.newest_s.is_some_and(|newest_s| stamp_s <= newest_s) {
            return;
        }
        self.newest_s = Some(stamp_s);
        let Some(place) = keypoints.target_scaled() else { return };
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
        let median = |i: usize| median_high(&mut self.seen.iter().map(|(_, place)| place[i]).collect::<Vec<_>>());
        Some([median(0)?, median(1)?])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use catenary_core::Keypoints;
    use catenary_core::image::LabelMask;

    const HERE: [f64; 2] = [50.0, 75.0];
    const THERE: [f64; 2] = [90.0, 10.0];

    /// Adds keypoints of an object that is not seen, in a mask 100 px wide and high.
    fn add(target: &mut StandingTarget, now_s: f64, stamp_s: f64, place_px: Option<[f64; 2]>) {
        let keypoints = Keypoints::unseen(&LabelMask::new(100, 100), place_px.map(|px| (px, 1.0)));
        target.add_sighting(&Inputs { now_s, keypoints: Some((stamp_s, keypoints)), ..Inputs::default() }, 0.1);
    }

    /// Adds keypoints of `hz` frames a second up to `until_s`, and returns the place.
    fn seen(hz: u32, from_s: f64, until_s: f64, place_px: impl Fn(u32) -> Option<[f64; 2]>) -> StandingTarget {
        let mut target = StandingTarget::default();
        for i in 0..((until_s - from_s) * f64::from(hz)) as u32 {
            let s = from_s + f64::from(i) / f64::from(hz);
            add(&mut target, s, s, place_px(i));
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
        add(&mut hidden, 60.0, 60.0, Some(THERE));
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
    fn fresh_keypoints_count_once_each() {
        let mut target = seen(30, 0.0, 1.0, |_| Some(HERE));
        let place = target.place();
        // Keypoints that come again, that lie ahead, and that are old.
        for (now_s, stamp_s) in [(1.0, 29.0 / 30.0), (1.0, 1.2), (3.0, 2.0)] {
            (0..100).for_each(|_| add(&mut target, now_s, stamp_s, Some(THERE)));
        }
        assert_eq!(target.place(), place);
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
