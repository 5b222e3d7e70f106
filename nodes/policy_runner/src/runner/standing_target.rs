//! Place of the target, which stands still.

use super::{Inputs, check_stamp};
use std::collections::VecDeque;

use catenary_core::statistics::median_high;

/// Number of sightings that count. Chosen: 1.7 s at 60 Hz and 3.3 s at 30 Hz. More bridge longer mistakes; fewer follow a target sooner that
/// somebody moves.
const SIGHTINGS: usize = 100;

/// Newest sightings of the target. In some frames something else may be mistaken for it, which the median drops.
#[derive(Debug, Default)]
pub(super) struct StandingTarget {
    /// Stamp of the newest keypoints that were looked at, s.
    looked_s: Option<f64>,
    /// Places in the scaled image, the newest last.
    seen: VecDeque<[f64; 2]>,
}

impl StandingTarget {
    /// Takes the target of fresh keypoints. The same keypoints may come again.
    pub(super) fn look(&mut self, inputs: &Inputs, max_age_s: f64) {
        let Some((stamp_s, keypoints)) = inputs.keypoints else { return };
        let is_fresh = check_stamp(stamp_s, inputs.now_s, [inputs.now_s - max_age_s, inputs.now_s + max_age_s]).is_ok();
        if !is_fresh || self.looked_s.is_some_and(|looked_s| stamp_s <= looked_s) {
            return;
        }
        self.looked_s = Some(stamp_s);
        let Some(target) = keypoints.target_scaled() else { return };
        if self.seen.len() == SIGHTINGS {
            self.seen.pop_front();
        }
        self.seen.push_back(target);
    }

    /// Returns the median place, coordinate by coordinate; `None` if the target was never seen. A hidden target stays where it was seen.
    pub(super) fn place(&self) -> Option<[f64; 2]> {
        let median = |i: usize| median_high(&mut self.seen.iter().map(|place| place[i]).collect::<Vec<_>>());
        Some([median(0)?, median(1)?])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use catenary_core::Keypoints;
    use catenary_core::image::LabelMask;

    /// Looks at keypoints with a stamp, of an object that is not seen. The mask is 100 px wide and high.
    fn look(target: &mut StandingTarget, now_s: f64, stamp_s: f64, place_px: Option<[f64; 2]>) {
        let mask = LabelMask::new(100, 100);
        let keypoints = Keypoints::unseen(&mask, place_px.map(|px| (px, 1.0)));
        target.look(&Inputs { now_s, keypoints: Some((stamp_s, keypoints)), ..Inputs::default() }, 0.1);
    }

    #[test]
    fn a_target_that_is_mistaken_in_some_frames_stands_where_most_frames_see_it() {
        let (mut target, mut mistaken) = (StandingTarget::default(), StandingTarget::default());
        assert_eq!(target.place(), None);
        for i in 0..30 {
            let s = f64::from(i) / 30.0;
            look(&mut target, s, s, Some([50.0, 75.0]));
            // A third of the frames sees something else, the newest one, too; and the target is hidden in some.
            let place = [Some([50.0, 75.0]), None, Some([50.0, 75.0]), Some([90.0, 10.0])][i as usize % 4];
            look(&mut mistaken, s, s, if i == 29 { Some([90.0, 10.0]) } else { place });
        }
        assert!(target.place().is_some() && mistaken.place() == target.place(), "{:?}", mistaken.place());
    }

    #[test]
    fn a_target_that_was_moved_is_followed_and_only_fresh_keypoints_count_each_once() {
        let mut target = StandingTarget::default();
        for i in 0..SIGHTINGS {
            look(&mut target, i as f64, i as f64, Some([50.0, 75.0]));
        }
        let before = target.place();
        // Keypoints that come again, of the future, and old ones.
        for stamp_s in [99.0, 99.5, 98.0] {
            (0..SIGHTINGS).for_each(|_| look(&mut target, 99.0, stamp_s, Some([90.0, 10.0])));
        }
        assert_eq!(target.place(), before);
        for i in 0..SIGHTINGS {
            let s = (SIGHTINGS + i) as f64;
            look(&mut target, s, s, Some([90.0, 10.0]));
            assert_eq!(target.place() == before, i < SIGHTINGS / 2 - 1, "sighting {i}");
        }
    }
}
