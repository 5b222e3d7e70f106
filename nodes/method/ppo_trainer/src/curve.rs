//! Learning curve of a training.

use serde::{Deserialize, Serialize};

/// Share of the whole rise of the mean return after which a training has stopped improving. Chosen.
const RISEN: f64 = 0.95;
/// Share of a training, at its end, in which a rise means that more steps may help. Chosen.
const END: f64 = 0.1;

/// Point of the learning curve, after an update.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct CurvePoint {
    /// Environment steps so far.
    pub steps: u64,
    /// Mean return of the last 100 episodes; NaN before the first one ends.
    pub mean_return: f64,
    /// Share of successes among these episodes.
    pub success_rate: f64,
    /// Entropy of the actions' distribution in nat, with actions in units of their limit. It falls as the policy makes up its mind.
    pub entropy: f64,
    /// Mean squared error of the values in the last pass of the update, in squared units of the discounted return.
    pub value_loss: f64,
}

/// Rise of the mean return in a training, from the first point of the curve to the highest one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Rise {
    /// It never rose.
    None,
    /// 95 % of it were made by this number of environment steps, before the last tenth of the training.
    By(u64),
    /// It lasted into the last tenth of the training: more steps may help.
    ToTheEnd,
}

impl Rise {
    /// Rise of a learning curve.
    pub fn of(curve: &[CurvePoint]) -> Self {
        let (Some(first), Some(last)) = (curve.first(), curve.last()) else { return Self::None };
        let highest = curve.iter().map(|p| p.mean_return).fold(f64::NEG_INFINITY, f64::max);
        let level = first.mean_return + RISEN * (highest - first.mean_return);
        match curve.iter().find(|p| p.mean_return >= level) {
            Some(at) if highest > first.mean_return && at.steps as f64 <= (1.0 - END) * last.steps as f64 => {
                Self::By(at.steps)
            }
            Some(_) if highest > first.mean_return => Self::ToTheEnd,
            _ => Self::None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn curve(returns: impl IntoIterator<Item = f64>) -> Vec<CurvePoint> {
        let point = |(i, mean_return)| CurvePoint {
            steps: 100 * (i as u64 + 1),
            mean_return,
            success_rate: 0.0,
            entropy: 0.0,
            value_loss: 0.0,
        };
        returns.into_iter().enumerate().map(point).collect()
    }

    #[test]
    fn a_curve_that_levels_off_has_stopped_where_it_came_near_its_highest_point() {
        let levels_off = (0..40).map(|i| 5.0 - 6.0 * (-f64::from(i) / 5.0).exp());
        // exp(-i / 5) = 0.05 at i = 15.
        assert_eq!(Rise::of(&curve(levels_off)), Rise::By(1600));
    }

    #[test]
    fn a_curve_may_rise_to_the_end_or_never() {
        assert_eq!(Rise::of(&curve((0..40).map(f64::from))), Rise::ToTheEnd);
        assert_eq!(Rise::of(&curve((0..40).map(|i| -f64::from(i)))), Rise::None);
        assert_eq!(Rise::of(&curve([1.0; 5])), Rise::None);
        assert_eq!(Rise::of(&[]), Rise::None);
    }
}
