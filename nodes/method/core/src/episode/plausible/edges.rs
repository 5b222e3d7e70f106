//! Faults in the first and the last sample of a stream, which have neighbours on one side alone.
//!
//! The limits of speed and acceleration leave a sample at the edge much room at a low rate: a hand may move 0.7 m
//! within
//! 0.2 s. A single fault there is found by comparison with the rest of the stream.

/// Least ratio of the departure of an edge sample to the greatest departure in the rest of the stream. It was at most
/// 2.7 in 158 000 windows of measured grips, cables and ropes at 2 to 15 Hz.
const LEAST_RATIO: f64 = 5.0;
/// Least number of departures in the rest of the stream: fewer do not show its usual motion.
const LEAST_DEPARTURES: usize = 16;

/// Sample at an edge that the rest of the stream contradicts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct EdgeFault {
    /// Index of the sample.
    pub(super) index: usize,
    /// Distance of the sample from the straight continuation of its two neighbours.
    pub(super) departure: f64,
    /// Greatest such distance in the rest of the stream.
    pub(super) usual: f64,
}

/// Finds faults in the first and the last sample. `placed` returns the points of three samples; `least` is the
/// departure up to which a sample is never a fault.
pub(super) fn edge_faults<T, const N: usize>(
    samples: &[(f64, T)],
    least: f64,
    placed: impl Fn([&T; 3]) -> Vec<[[f64; N]; 3]>,
) -> Vec<EdgeFault> {
    let Some(last) = samples.len().checked_sub(1).filter(|last| *last >= LEAST_DEPARTURES + 3) else { return vec![] };
    // Departure of sample `i` from the line through samples `j` and `k`, which follow it in either direction.
    let departure = |[i, j, k]: [usize; 3]| {
        let [(t0, a), (t1, b), (t2, c)] = [&samples[i], &samples[j], &samples[k]];
        let share = (t1 - t0) / (t2 - t1);
        let one = |[a, b, c]: &[[f64; N]; 3]| {
            (0..N).map(|n| (a[n] - b[n] + share * (c[n] - b[n])).powi(2)).sum::<f64>().sqrt()
        };
        placed([a, b, c]).iter().map(one).fold(0.0, f64::max)
    };
    // Neither edge takes part: a fault at one edge must not hide a fault at the other.
    let usual = (1..last - 2).map(|i| departure([i, i + 1, i + 2])).fold(0.0, f64::max);
    let edges = [[0, 1, 2], [last, last - 1, last - 2]].map(|places| EdgeFault {
        index: places[0],
        departure: departure(places),
        usual,
    });
    edges.into_iter().filter(|e| e.departure > least.max(LEAST_RATIO * e.usual)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Faults of a stream of `n` numbers at 5 Hz that sways by 0.1 every 4 s, with `fault` added at some samples.
    fn found(n: usize, fault: f64, wrong: &[usize]) -> Vec<usize> {
        let value = |i: usize| 0.1 * (0.5 * std::f64::consts::PI * 0.2 * i as f64).sin();
        let sample = |i| (0.2 * i as f64, value(i) + if wrong.contains(&i) { fault } else { 0.0 });
        let samples: Vec<(f64, f64)> = (0..n).map(sample).collect();
        let faults = edge_faults(&samples, 0.1, |[a, b, c]| vec![[[*a], [*b], [*c]]]);
        faults.into_iter().map(|f| f.index).collect()
    }

    #[test]
    fn faults_at_either_edge_and_at_both_are_found() {
        for fault in [0.2, -0.2, 1.0] {
            assert_eq!(found(40, fault, &[0]), [0], "{fault}");
            assert_eq!(found(40, fault, &[39]), [39], "{fault}");
            assert_eq!(found(40, fault, &[0, 39]), [0, 39], "{fault}");
        }
        assert_eq!(found(40, 0.0, &[]), [] as [usize; 0]);
        // A lively stream may begin with a departure of this size.
        assert_eq!(found(40, 0.2, &[0, 20]), [] as [usize; 0]);
        assert_eq!(found(LEAST_DEPARTURES + 3, 1.0, &[0]), [] as [usize; 0], "too short to tell");
    }
}
