//! End of a training and fall of its learning rate.
//!
//! A training ends when its mean return has stopped rising, since the number of steps that an object needs is not known before. The learning rate
//! stays while the return rises, and then falls to zero in the second half of the training (warm-up, stable, decay: Hu et al. 2024,
//! arXiv:2404.06395, there for language models).

use crate::curve::CurvePoint;
use crate::settings::Settings;
use serde::{Deserialize, Serialize};

/// Environment steps before which no curve counts as flat: fewer updates than sixteen of the default preset tell nothing.
const EARLIEST: u64 = 12_288;
/// Rise of the mean return between two thirds of a training below which the curve is flat also if it is certain, as a share of the highest mean
/// return: half a millimetre of tasks whose reward ends at 0.4 m.
const LEAST_RISE: f64 = 1.25e-3;
/// Standard errors by which a rise must differ from none.
const CERTAIN: f64 = 2.0;
/// Rise that never counts as flat, however uncertain it is, as a share of the highest mean return.
const LARGE_RISE: f64 = 0.02;
/// Share of the whole training in which the learning rate falls.
const FALL: f64 = 0.5;

/// Schedule of a training.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Schedule {
    /// Steps before this schedule: those of a training that ended with a flat curve, and goes on.
    from: u64,
    /// Most steps.
    most: u64,
    /// Steps at which the learning rate begins to fall.
    fall_from: u64,
    /// Steps after which the curve was flat.
    flat_at: Option<u64>,
}

impl Schedule {
    /// Schedule at the start of a training.
    pub fn of(settings: &Settings) -> Self {
        Self::after(0, settings)
    }

    /// Schedule of the rest of a training after `from` steps.
    fn after(from: u64, settings: &Settings) -> Self {
        let most = settings.total_steps;
        let stays = if settings.ends_when_flat { 1.0 - FALL } else { 0.0 };
        let fall_from = from + (most.saturating_sub(from) as f64 * stays) as u64;
        Self { from, most, fall_from, flat_at: None }
    }

    /// Schedule with which a training goes on after `steps`: this one, or after its end with a flat curve another one for what is left of the most
    /// steps, with the learning rate of the start. A curve may be flat for a while.
    #[must_use]
    pub fn resumed(self, steps: u64, settings: &Settings) -> Self {
        if self.flat_at.is_some() && steps >= self.most { Self::after(steps, settings) } else { self }
    }

    /// Steps at which the training ends, as far as is known.
    pub fn end(&self) -> u64 {
        self.most
    }

    /// Steps after which the curve was flat; none if it was not yet.
    pub fn flat_at(&self) -> Option<u64> {
        self.flat_at
    }

    /// Share of the fall of the learning rate that is done, 0 to 1.
    pub fn annealed(&self, steps: u64) -> f32 {
        let length = self.most.saturating_sub(self.fall_from).max(1);
        (steps.saturating_sub(self.fall_from) as f32 / length as f32).min(1.0)
    }

    /// Looks whether the curve is flat after `steps`. If it is, the learning rate begins to fall.
    pub fn look(&mut self, steps: u64, curve: &[CurvePoint]) {
        let own = &curve[curve.partition_point(|point| point.steps <= self.from)..];
        if self.flat_at.is_none() && steps < self.fall_from && steps >= self.from + EARLIEST && is_flat(own) {
            let end = self.from + ((steps - self.from) as f64 / (1.0 - FALL)) as u64;
            *self = Self { most: end.min(self.most), fall_from: steps, flat_at: Some(steps), ..*self };
        }
    }
}

/// True if the mean return of the last third of a curve is not above that of the third before.
///
/// The points of a third are means of a hundred episodes each, so that their scatter gives the standard error of the difference.
fn is_flat(curve: &[CurvePoint]) -> bool {
    let third = curve.len() / 3;
    if third < 4 {
        return false;
    }
    let returns = |points: &[CurvePoint]| -> (f64, f64) {
        let n = points.len() as f64;
        let mean = points.iter().map(|p| p.mean_return).sum::<f64>() / n;
        let squares = points.iter().map(|p| (p.mean_return - mean).powi(2)).sum::<f64>();
        (mean, squares / (n - 1.0) / n)
    };
    let (before, now) = (&curve[curve.len() - 2 * third..curve.len() - third], &curve[curve.len() - third..]);
    let ((before, before_error), (now, now_error)) = (returns(before), returns(now));
    let highest = curve.iter().map(|p| p.mean_return.abs()).fold(0.0, f64::max);
    let rise = now - before;
    rise < (CERTAIN * (before_error + now_error).sqrt()).min(LARGE_RISE * highest) || rise < LEAST_RISE * highest
}

#[cfg(test)]
mod tests {
    use super::*;

    fn curve(returns: impl Iterator<Item = f64>) -> Vec<CurvePoint> {
        let point = |(i, mean_return): (usize, f64)| CurvePoint {
            steps: 768 * (i as u64 + 1),
            mean_return,
            success_rate: 0.0,
            entropy: 0.0,
            value_loss: 0.0,
        };
        returns.enumerate().map(point).collect()
    }

    /// Schedule after all points of a curve, one by one.
    fn after(curve: &[CurvePoint]) -> Schedule {
        let mut schedule = Schedule::of(&Settings::tuned());
        (1..=curve.len()).for_each(|n| schedule.look(curve[n - 1].steps, &curve[..n]));
        schedule
    }

    #[test]
    fn a_flat_curve_ends_a_training_early_and_a_rising_one_does_not() {
        let noise = |i: i32| 0.004 * (f64::from(i) * 2.3).sin();
        let flat = after(&curve((0..40).map(|i| 0.97 + noise(i))));
        assert_eq!((flat.flat_at(), flat.end()), (Some(12_288), 24_576));
        assert_eq!(flat.annealed(12_288), 0.0);
        assert!((flat.annealed(18_432) - 0.5).abs() < 1e-6 && flat.annealed(24_576) == 1.0);
        let rising = after(&curve((0..120).map(|i| 0.3 + 0.005 * f64::from(i) + noise(i))));
        assert_eq!((rising.flat_at(), rising.end()), (None, 122_880));
        assert_eq!(rising.annealed(61_440), 0.0);
        // Steps to level off, and as many again to see it.
        let levels_off = after(&curve((0..150).map(|i| 0.9 - 0.6 * (-f64::from(i) / 5.0).exp() + noise(i))));
        let at = levels_off.flat_at().unwrap();
        assert!((30_000..61_440).contains(&at), "{at}");
    }

    #[test]
    fn a_training_that_goes_on_after_a_flat_curve_looks_at_the_new_part_alone() {
        let settings = Settings::tuned();
        let noise = |i: i32| 0.004 * (f64::from(i) * 2.3).sin();
        for (rise, flat_at, end) in [(0.0, Some(36_864), 49_152), (0.004, None, 122_880)] {
            // Flat until the end at step 24,576, then with this rise by point.
            let curve = curve((0..150).map(|i| 0.5 + noise(i) + rise * f64::from((i - 32).max(0))));
            let mut schedule = after(&curve[..20]);
            assert_eq!(schedule.end(), 24_576);
            assert_eq!(schedule.resumed(20_000, &settings), schedule, "it has not ended");
            schedule = schedule.resumed(24_576, &settings);
            assert_eq!((schedule.flat_at(), schedule.end(), schedule.annealed(30_000)), (None, 122_880, 0.0));
            (33..=curve.len()).for_each(|n| schedule.look(curve[n - 1].steps, &curve[..n]));
            assert_eq!((schedule.flat_at(), schedule.end()), (flat_at, end));
        }
    }

    #[test]
    fn a_preset_that_does_not_look_falls_over_the_whole_training() {
        let schedule = Schedule::of(&Settings { total_steps: 1000, ..Settings::sb3() });
        assert_eq!((schedule.annealed(0), schedule.annealed(500), schedule.end()), (0.0, 0.5, 1000));
    }
}
