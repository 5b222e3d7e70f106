//! Samples that leave the path of their neighbours and come back: at a low rate, speed alone does not tell them.

/// Samples that no motion of at most `acceleration` passes through between their neighbours, one flag each. `placed` gives the
/// points of three neighbours, the middle one second, in order; `slack` is a departure that needs no time, and `turn_back` the
/// speed of a thing that may turn back at once.
///
/// Between two samples a motion departs from the chord by at most half the acceleration times the times to both of them. A step
/// departs as far and does not turn back, and is no spike; and a spike makes its neighbours depart by half of it.
pub(super) fn spikes<T, const N: usize>(
    samples: &[(f64, T)],
    [acceleration, turn_back, slack]: [f64; 3],
    placed: impl Fn([&T; 3]) -> Vec<[[f64; N]; 3]>,
) -> Vec<bool> {
    let excess = |i: usize| {
        let [(t0, a), (t1, b), (t2, c)] = [&samples[i - 1], &samples[i], &samples[i + 1]];
        let (before_s, after_s) = (t1 - t0, t2 - t1);
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

/// Distance of the second of three points from the chord of the others, `share` of it from the first, where the path turns back
/// there; 0 where it goes on.
fn excursion<const N: usize>([a, b, c]: &[[f64; N]; 3], share: f64) -> f64 {
    let turn: f64 = (0..N).map(|k| (b[k] - a[k]) * (c[k] - b[k])).sum();
    if turn >= 0.0 {
        return 0.0;
    }
    (0..N).map(|k| (b[k] - a[k] - share * (c[k] - a[k])).powi(2)).sum::<f64>().sqrt()
}
