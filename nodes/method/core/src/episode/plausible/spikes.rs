//! Spikes: samples that leave the path of their neighbours and come back. At a low sample rate a limit on speed alone
//! does not find them.

/// Flags the samples that no motion with a limited acceleration passes through on the way between their neighbours.
///
/// Limits: `acceleration` in units/s^2; `turn_back`, the speed in units/s of a body that may reverse at once; `slack`,
/// a distance that is always allowed. `placed` returns the points of three successive samples.
///
/// A motion of acceleration a departs from the chord between two samples by at most a/2 times the times to both of
/// them. A step departs further, but does not turn back, so it is no spike. A spike makes its neighbours depart by half
/// of its own departure, so only local maxima are flagged.
pub(super) fn spikes<T, const N: usize>(
    samples: &[(f64, T)],
    [acceleration, turn_back, slack]: [f64; 3],
    placed: impl Fn([&T; 3]) -> Vec<[[f64; N]; 3]>,
) -> Vec<bool> {
    let excess = |i: usize| {
        let [(t0, a), (t1, b), (t2, c)] = [&samples[i - 1], &samples[i], &samples[i + 1]];
        let (before_s, after_s) = (t1 - t0, t2 - t1);
        // Equal stamps give no share; the middle of the chord is as good as any other place.
        let share = if t2 > t0 { before_s / (t2 - t0) } else { 0.5 };
        let farthest = placed([a, b, c]).iter().map(|points| excursion(points, share)).fold(0.0, f64::max);
        let possible = (0.5 * acceleration * before_s * after_s).max(turn_back * before_s.min(after_s)) + slack;
        (farthest > possible).then_some(farthest)
    };
    let mut far = vec![0.0; samples.len()];
    (1..samples.len().saturating_sub(1)).for_each(|i| far[i] = excess(i).unwrap_or(0.0));
    let at = |i: Option<usize>| i.and_then(|i| far.get(i)).copied().unwrap_or(0.0);
    (0..far.len()).map(|i| far[i] > 0.0 && far[i] >= at(i.checked_sub(1)) && far[i] >= at(Some(i + 1))).collect()
}

/// Distance of the second of three points from the chord of the others, at `share` of the chord from the first. It is 0
/// if the path does not turn back at the second point.
fn excursion<const N: usize>([a, b, c]: &[[f64; N]; 3], share: f64) -> f64 {
    // A negative scalar product of the two steps means that the path turns back.
    let turn: f64 = (0..N).map(|k| (b[k] - a[k]) * (c[k] - b[k])).sum();
    if turn >= 0.0 {
        return 0.0;
    }
    (0..N).map(|k| (b[k] - a[k] - share * (c[k] - a[k])).powi(2)).sum::<f64>().sqrt()
}
