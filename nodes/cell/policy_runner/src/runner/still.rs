//! Wait until the object hangs still.

use super::decay::Decay;
use super::{Fault, Inputs, NONE_CAME, NOT_SEEN, Settings, check_stamp};
use catenary_core::{Keypoints, Policy};
use std::collections::VecDeque;
use std::fmt;

/// Time over which the object must not move, s: a swing of the softest bars.
const WINDOW_S: f64 = 1.0;
/// Number of parts of the window. Parts of 0.1 s average out the noise of the keypoints, and keep swings of less than 4 Hz.
const PARTS: usize = 10;

/// Outcome of one turn.
#[derive(Debug, Clone, PartialEq)]
pub enum StillTurn {
    /// The object may still move.
    Wait,
    /// The object hangs still: the episode may begin.
    Still,
    /// The object does not come to rest, or is not seen.
    Fault(Fault),
}

impl fmt::Display for StillProgress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { waited_s, limit_px, .. } = self;
        match self.motion_px {
            Some(px) => write!(f, "its keypoints move by {px:.1} px in a second, {limit_px} px count as still; ")?,
            None => write!(f, "how much it moves is not known yet; ")?,
        }
        write!(f, "waited {waited_s:.0} s")?;
        self.remaining_s.map_or(Ok(()), |s| write!(f, ", about {s:.0} s to go"))
    }
}

/// Wait before an episode. The arm has just moved to its start, and the object swings. Policies have never seen an object that swings at the
/// start, unless they were trained for starts in motion: before those there is no wait.
#[derive(Debug)]
pub struct StillWait {
    settings: Settings,
    began_s: Option<f64>,
    /// Time of the last turn with fresh keypoints of the object.
    fresh_s: Option<f64>,
    /// Stamps and places of the middle of the four keypoints, px, over the last window. The middle does not depend on their order.
    seen: VecDeque<(f64, [f64; 2])>,
    /// Motions so far.
    decay: Decay,
    /// Time of the last turn.
    now_s: f64,
}

/// State of a wait, for those who wait, too.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StillProgress {
    /// Time since the wait began, s.
    pub waited_s: f64,
    /// Motion of the keypoints' middle in the last second, px; none before it is known.
    pub motion_px: Option<f64>,
    /// Motion at which the episode begins, px.
    pub limit_px: f64,
    /// Predicted rest of the wait, s; none before the motion was seen for some seconds, and for one that hardly decays.
    pub remaining_s: Option<f64>,
}

impl StillWait {
    /// Creates a wait. It begins with the first turn.
    #[must_use]
    pub fn new(settings: Settings) -> Self {
        let (seen, decay) = (VecDeque::new(), Decay::default());
        Self { settings, began_s: None, fresh_s: None, seen, decay, now_s: 0.0 }
    }

    /// Creates the wait before an episode of `policy`.
    #[must_use]
    pub fn before(policy: &Policy, settings: Settings) -> Self {
        let still_patience_s = if policy.start_speed_m_s.is_some() { 0.0 } else { settings.still_patience_s };
        Self::new(Settings { still_patience_s, ..settings })
    }

    /// Decides at `inputs.now_s` whether an episode may begin. A patience of 0 asks for no wait.
    pub fn turn(&mut self, inputs: &Inputs) -> StillTurn {
        let Settings { still_patience_s, patience_s, max_age_s, still_px, .. } = self.settings;
        if still_patience_s <= 0.0 {
            return StillTurn::Still;
        }
        let now_s = inputs.now_s;
        let began_s = *self.began_s.get_or_insert(now_s);
        self.now_s = now_s;
        match fresh(inputs, max_age_s) {
            Ok((stamp_s, keypoints)) => {
                self.see(stamp_s, &keypoints);
                self.fresh_s = Some(now_s);
            }
            Err(detail) if now_s - self.fresh_s.unwrap_or(began_s) > patience_s => {
                return StillTurn::Fault(Fault::Stale { what: "keypoints", step: 0, patience_s, detail });
            }
            Err(_) => {}
        }
        let moved_px = self.moved_px();
        if let Some(px) = moved_px {
            self.decay.see(now_s, px);
        }
        match moved_px {
            Some(px) if px <= still_px => StillTurn::Still,
            _ if now_s - began_s > still_patience_s => {
                StillTurn::Fault(Fault::Swinging { still_patience_s, still_px, moved_px })
            }
            _ => StillTurn::Wait,
        }
    }

    /// State of the wait at the last turn.
    #[must_use]
    pub fn progress(&self) -> StillProgress {
        let limit_px = self.settings.still_px;
        StillProgress {
            waited_s: self.began_s.map_or(0.0, |began_s| self.now_s - began_s),
            motion_px: self.moved_px(),
            limit_px,
            remaining_s: self.decay.remaining_s(limit_px),
        }
    }

    fn see(&mut self, stamp_s: f64, keypoints: &Keypoints) {
        // The newest keypoints may be those of the turn before.
        if self.seen.back().is_some_and(|(newest_s, _)| stamp_s <= *newest_s) {
            return;
        }
        let middle = [0, 1].map(|i| keypoints.dlo_px.iter().map(|p| p[i]).sum::<f64>() / 4.0);
        self.seen.push_back((stamp_s, middle));
        // The oldest one that is kept lies outside: the window is full if it is there.
        while self.seen.get(1).is_some_and(|(second_s, _)| stamp_s - second_s >= WINDOW_S) {
            self.seen.pop_front();
        }
    }

    /// Largest distance between two parts of the last second, px; none before the window is full, or if keypoints are missing in a part.
    #[must_use]
    pub fn moved_px(&self) -> Option<f64> {
        let (&(oldest_s, _), &(newest_s, _)) = (self.seen.front()?, self.seen.back()?);
        if newest_s - oldest_s < WINDOW_S {
            return None;
        }
        let mut parts = [(0.0, [0.0; 2]); PARTS];
        for (stamp_s, middle) in &self.seen {
            // 0 is the newest part. The oldest keypoints lie beyond the last one.
            let part = ((newest_s - stamp_s) / WINDOW_S * PARTS as f64) as usize;
            if let Some((n, sum)) = parts.get_mut(part) {
                *n += 1.0;
                (0..2).for_each(|i| sum[i] += middle[i]);
            }
        }
        if parts.iter().any(|(n, _)| *n == 0.0) {
            return None;
        }
        let places = parts.map(|(n, sum)| sum.map(|s| s / n));
        let distance = |a: &[f64; 2], b: &[f64; 2]| (a[0] - b[0]).hypot(a[1] - b[1]);
        places.iter().flat_map(|a| places.iter().map(move |b| distance(a, b))).reduce(f64::max)
    }
}

/// Stamp and value of keypoints that are fresh and show the object.
///
/// # Errors
/// State of the newest keypoints.
fn fresh(inputs: &Inputs, max_age_s: f64) -> Result<(f64, Keypoints), String> {
    let (stamp_s, keypoints) = inputs.keypoints.ok_or(NONE_CAME)?;
    check_stamp(stamp_s, inputs.now_s, [inputs.now_s - max_age_s, inputs.now_s + max_age_s])?;
    if keypoints.dlo_seen() { Ok((stamp_s, keypoints)) } else { Err(NOT_SEEN.to_owned()) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use catenary_core::LabelMask;
    use rand::RngExt;
    use rand_distr::StandardNormal;
    use std::f64::consts::TAU;

    /// Runs a wait at 60 Hz. `tip_px` is the motion of the free end at a time; the order of the keypoints flips in each frame.
    fn wait(settings: Settings, tip_px: impl Fn(f64) -> Option<f64>) -> (f64, StillTurn) {
        let mut wait = StillWait::new(settings);
        let mut rng = catenary_core::seed::rng(3, 0);
        for k in 0..6000 {
            let now_s = 5.0 + f64::from(k) / 60.0;
            let mut noise = || 0.7 * rng.sample::<f64, _>(StandardNormal);
            let tip = tip_px(now_s - 5.0);
            let mut dlo_px = [0.125, 0.375, 0.625, 0.875]
                .map(|f: f64| [120.0 + noise() + tip.unwrap_or(0.0) * f * f, 100.0 + noise() + 80.0 * f]);
            if k % 2 == 0 {
                dlo_px.reverse();
            }
            let keypoints = Keypoints {
                dlo_px,
                target_px: None,
                scores: [if tip.is_some() { 1.0 } else { 0.0 }; 4],
                target_score: 0.0,
                image_width_px: 256,
                image_height_px: 256,
            };
            let inputs = Inputs { now_s, keypoints: Some((now_s - 0.03, keypoints)), ..Inputs::default() };
            match wait.turn(&inputs) {
                StillTurn::Wait => {}
                turn => return (now_s - 5.0, turn),
            }
        }
        panic!("the wait has no end")
    }

    #[test]
    fn late_and_early_stamps_are_named() {
        for (ahead_s, said) in [(-3.0, "the newest is 3.000 s old"), (9.0, "its stamp lies 9.000 s ahead")] {
            let mut wait = StillWait::new(Settings::default());
            let fault = (0..90).find_map(|k| {
                let now_s = f64::from(k) / 60.0;
                let keypoints = Keypoints { scores: [1.0; 4], ..Keypoints::unseen(&LabelMask::new(256, 256), None) };
                match wait.turn(&Inputs { now_s, keypoints: Some((now_s + ahead_s, keypoints)), ..Inputs::default() }) {
                    StillTurn::Fault(fault) => Some(fault.to_string()),
                    _ => None,
                }
            });
            assert_eq!(fault.unwrap(), format!("no fresh keypoints within 1 s of step 0: {said}"));
        }
    }

    fn swing(amplitude_px: f64, half_life_s: f64) -> impl Fn(f64) -> Option<f64> {
        move |t| Some(amplitude_px * (TAU * 1.2 * t).cos() * 0.5_f64.powf(t / half_life_s))
    }

    #[test]
    fn an_episode_begins_when_the_object_hangs_still() {
        let usual = Settings::default();
        let (at_rest_s, turn) = wait(usual, |_| Some(0.0));
        assert_eq!(turn, StillTurn::Still);
        assert!((1.0..1.1).contains(&at_rest_s), "{at_rest_s}");
        // The free end moves by 25 px at first. Three to five half lives later it moves by a few.
        let (damped_s, turn) = wait(usual, swing(25.0, 1.5));
        assert_eq!(turn, StillTurn::Still);
        assert!((4.5..8.5).contains(&damped_s), "{damped_s}");
    }

    #[test]
    fn a_wait_in_words_has_what_is_known() {
        let known = StillProgress { waited_s: 12.3, motion_px: Some(5.26), limit_px: 2.0, remaining_s: Some(19.6) };
        let words = "its keypoints move by 5.3 px in a second, 2 px count as still; waited 12 s, about 20 s to go";
        assert_eq!(known.to_string(), words);
        let unknown = StillProgress { motion_px: None, remaining_s: None, ..known };
        assert_eq!(unknown.to_string(), "how much it moves is not known yet; waited 12 s");
    }

    #[test]
    fn a_wait_tells_how_long_it_will_take() {
        let mut wait = StillWait::new(Settings { still_px: 1.0, ..Settings::default() });
        let tip_px = swing(60.0, 4.0);
        let mut told = Vec::new();
        let ended_s = (0..6000).map(|k| f64::from(k) / 60.0).find(|now_s| {
            let dlo_px =
                [0.125, 0.375, 0.625, 0.875].map(|f: f64| [120.0 + tip_px(*now_s).unwrap() * f * f, 100.0 + 80.0 * f]);
            let keypoints =
                Keypoints { dlo_px, scores: [1.0; 4], ..Keypoints::unseen(&LabelMask::new(256, 256), None) };
            let inputs = Inputs { now_s: *now_s, keypoints: Some((*now_s, keypoints)), ..Inputs::default() };
            let is_over = wait.turn(&inputs) == StillTurn::Still;
            told.push(wait.progress());
            is_over
        });
        let ended_s = ended_s.expect("it comes to rest");
        // Nothing is predicted before 4 s: one until the motion is known, and three of motions.
        assert!(told[..230].iter().all(|p| p.remaining_s.is_none()) && told[30].motion_px.is_none());
        for progress in &told[300..] {
            let end_s = progress.waited_s + progress.remaining_s.expect("it decays");
            assert!((end_s - ended_s).abs() < 0.25 * ended_s, "{progress:?}, ended after {ended_s} s");
        }
    }

    #[test]
    fn an_object_that_does_not_come_to_rest_ends_the_wait() {
        let brief = Settings { still_patience_s: 4.0, ..Settings::default() };
        let (ended_s, turn) = wait(brief, swing(25.0, 100.0));
        let StillTurn::Fault(fault) = turn else { panic!("{turn:?}") };
        let message = fault.to_string();
        assert!(
            message.starts_with("the object does not come to rest within 4 s: its keypoints move by "),
            "{message}"
        );
        assert!(message.ends_with("expected at most 2 px (`still_px`)"), "{message}");
        assert!((4.0..4.1).contains(&ended_s));
        // Patience of 0 asks for no wait.
        assert_eq!(wait(Settings { still_patience_s: 0.0, ..brief }, swing(25.0, 100.0)), (0.0, StillTurn::Still));
    }

    #[test]
    fn a_policy_for_starts_in_motion_begins_at_once_and_one_for_objects_at_rest_waits() {
        let swinging = Inputs { now_s: 5.0, ..Inputs::default() };
        for (start_speed_m_s, turn) in [(None, StillTurn::Wait), (Some(0.5), StillTurn::Still)] {
            let policy = Policy { start_speed_m_s, ..super::super::tests::policy([0.0; 2]) };
            assert_eq!(StillWait::before(&policy, Settings::default()).turn(&swinging), turn, "{start_speed_m_s:?}");
        }
    }

    #[test]
    fn an_object_that_is_not_seen_ends_the_wait() {
        let (ended_s, turn) = wait(Settings::default(), |t| (t < 0.5).then_some(0.0));
        let StillTurn::Fault(fault) = turn else { panic!("{turn:?}") };
        assert_eq!(fault.to_string(), "no fresh keypoints within 1 s of step 0: the object is not seen");
        assert!((1.45..1.6).contains(&ended_s), "{ended_s}");
        // Frames in which it is seen twice a second tell no motion.
        let brief = Settings { still_patience_s: 4.0, ..Settings::default() };
        let (_, turn) = wait(brief, |t| ((t * 60.0).round() as u32).is_multiple_of(30).then_some(0.0));
        let StillTurn::Fault(fault) = turn else { panic!("{turn:?}") };
        assert!(fault.to_string().contains("it is not seen ten times in a second"), "{fault}");
    }
}
