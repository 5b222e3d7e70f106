//! Decay of a swing that was seen for some seconds: it predicts when the swing will be small. The measured decay is used, and not a model's
//! damping: it holds for any object, and includes the air, the grip and the table.

use std::collections::VecDeque;

/// Period of the measurements that are kept, s.
const PERIOD_S: f64 = 0.25;
/// Shortest time of measurements that a prediction rests on, s: some swings.
const LEAST_S: f64 = 3.0;
/// Longest time that is kept, s. A large swing decays faster than a small one, so that older measurements mislead.
const MOST_S: f64 = 12.0;
/// Longest prediction, s: beyond it the motion hardly decays.
const LONGEST_S: f64 = 600.0;

/// Measurements of a motion that decays.
#[derive(Debug, Default)]
pub(super) struct Decay {
    /// Times in s, and logarithms of the motion in px.
    seen: VecDeque<(f64, f64)>,
}

impl Decay {
    /// Adds the motion in px at a time in s. Measurements within the period after the last one are skipped.
    pub fn see(&mut self, time_s: f64, motion_px: f64) {
        if motion_px <= 0.0 || self.seen.back().is_some_and(|(newest_s, _)| time_s - newest_s < PERIOD_S) {
            return;
        }
        self.seen.push_back((time_s, motion_px.ln()));
        while self.seen.front().is_some_and(|(oldest_s, _)| time_s - oldest_s > MOST_S) {
            self.seen.pop_front();
        }
    }

    /// Time in s from the newest measurement on until the motion is at most `limit_px`, by the line of least squares through the logarithms
    /// (logarithmic decrement). None before there are 3 s of measurements, and for a motion that hardly decays.
    pub fn remaining_s(&self, limit_px: f64) -> Option<f64> {
        let (&(oldest_s, _), &(newest_s, _)) = (self.seen.front()?, self.seen.back()?);
        if newest_s - oldest_s < LEAST_S {
            return None;
        }
        let n = self.seen.len() as f64;
        let [mean_s, mean_log] =
            [|m: &(f64, f64)| m.0, |m: &(f64, f64)| m.1].map(|of| self.seen.iter().map(of).sum::<f64>() / n);
        let moment = |of: &dyn Fn(&(f64, f64)) -> f64| self.seen.iter().map(of).sum::<f64>();
        let slope = moment(&|(t, log)| (t - mean_s) * (log - mean_log)) / moment(&|(t, _)| (t - mean_s).powi(2));
        let newest_log = mean_log + slope * (newest_s - mean_s);
        let remaining_s = (newest_log - limit_px.ln()) / -slope;
        (slope < 0.0 && remaining_s <= LONGEST_S).then(|| remaining_s.max(0.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Measurements at 60 Hz for `seconds` of a motion that halves in 5 s, from 40 px.
    fn seen(seconds: f64, half_life_s: f64) -> Decay {
        let mut decay = Decay::default();
        for k in 0..(60.0 * seconds) as u32 {
            let time_s = f64::from(k) / 60.0;
            // A window that holds no whole number of swings sees the motion larger and smaller by turns.
            let beat = 1.0 + 0.2 * (5.0 * time_s).sin();
            decay.see(time_s, beat * 40.0 * 0.5_f64.powf(time_s / half_life_s));
        }
        decay
    }

    #[test]
    fn a_swing_that_halves_again_and_again_is_still_when_predicted() {
        // 40 px halve to 2.5 px in four half lives.
        for (seconds, left_s) in [(5.0, 15.0), (10.0, 10.0), (15.0, 5.0)] {
            let remaining_s = seen(seconds, 5.0).remaining_s(2.5).expect("it decays");
            assert!((remaining_s - left_s).abs() < 2.5, "{remaining_s} s after {seconds} s");
        }
        assert_eq!(seen(30.0, 5.0).remaining_s(2.5), Some(0.0));
    }

    #[test]
    fn nothing_is_predicted_from_little_and_of_a_motion_that_stays() {
        assert_eq!(seen(2.9, 5.0).remaining_s(2.5), None);
        assert_eq!(seen(20.0, 1e9).remaining_s(2.5), None);
        assert_eq!(Decay::default().remaining_s(2.5), None);
    }
}
