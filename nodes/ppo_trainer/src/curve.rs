//! Learning curve of a training.

use serde::Serialize;

/// Share of the whole rise of the mean return after which a training has stopped improving. Chosen.
const RISEN: f64 = 0.95;
/// Share of a training, at its end, in which a rise means that more steps may help. Chosen.
const END: f64 = 0.1;

/// Point of the learning curve, after an update.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
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

/// Environment steps after which the mean return had made 95 % of its rise, from the first point to the highest one. None if that lies in
/// the last tenth of the training, which may improve with more steps, or if the return never rose.
pub fn stopped_improving(curve: &[CurvePoint]) -> Option<u64> {
    let (first, last) = (curve.first()?, curve.last()?);
    let highest = curve.iter().map(|p| p.mean_return).fold(f64::NEG_INFINITY, f64::max);
    if highest <= first.mean_return {
        return None;
    }
    let level = first.mean_return + RISEN * (highest - first.mean_return);
    let at = curve.iter().find(|p| p.mean_return >= level)?.steps;
    (at as f64 <= (1.0 - END) * last.steps as f64).then_some(at)
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
        assert_eq!(stopped_improving(&curve(levels_off)), Some(1600));
    }

    #[test]
    fn a_curve_that_still_rises_or_never_rose_has_not_stopped() {
        assert_eq!(stopped_improving(&curve((0..40).map(f64::from))), None);
        assert_eq!(stopped_improving(&curve((0..40).map(|i| -f64::from(i)))), None);
        assert_eq!(stopped_improving(&[]), None);
    }
}
