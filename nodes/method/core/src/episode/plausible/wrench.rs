//! Plausible wrenches of the object on the hand.

use super::chain::MOST_LEFT_OUT;

/// Topic of the wrench.
pub(crate) const WRENCHES: &str = "/panda/external_wrench";

/// Greatest force in N and torque in N m of a hand that holds an object: the joints of a Panda bear 87 N m, at a reach of 0.3 m and more.
const MOST_N: f64 = 300.0;
const MOST_N_M: f64 = 90.0;
/// Longest time in s between two samples that are joined by a line: some frames of a slow stream. An object swings in half a second and
/// more.
const LONGEST_GAP_S: f64 = 0.1;
/// Time in s before the first and after the last sample for which that one stands: a few samples at the 200 Hz of the contract.
const EDGE_S: f64 = 0.02;
/// Number of samples that cannot all be equal, as noise changes the last place of an estimate.
const ALL_EQUAL: usize = 3;

/// Usable wrenches, with warnings about the others.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::episode) struct Wrenches {
    samples: Vec<(f64, [f64; 3])>,
    pub(in crate::episode) warnings: Vec<String>,
}

/// Keeps the wrenches that a hand can bear. A stream that never changes is that of an arm without an estimate, and a stream with many
/// impossible values has another unit: nothing is kept of them.
pub(in crate::episode) fn wrenches(samples: &[(f64, [f64; 3])]) -> Wrenches {
    let bears = |(_, [x, z, y]): &&(f64, [f64; 3])| x.hypot(*z) <= MOST_N && y.abs() <= MOST_N_M;
    let kept: Vec<(f64, [f64; 3])> = samples.iter().filter(bears).copied().collect();
    let (of, out) = (samples.len(), samples.len() - kept.len());
    let none = |warning: String| Wrenches { samples: Vec::new(), warnings: vec![warning] };
    let expected = format!("expected at most {MOST_N} N and {MOST_N_M} N m");
    if out as f64 > MOST_LEFT_OUT * of as f64 {
        return none(format!(
            "{WRENCHES}: wrench: {expected}, got more in {out} of {of} records: check the unit of its publisher"
        ));
    }
    if of >= ALL_EQUAL && samples.iter().all(|(_, wrench)| *wrench == samples[0].1) {
        let [x, z, y] = samples[0].1;
        return none(format!(
            "{WRENCHES}: wrench: expected a measured one, got ({x}, {z}) N and {y} N m in all of {of} records: its publisher measures nothing"
        ));
    }
    let warnings = if out > 0 {
        vec![format!("{WRENCHES}: wrench: {expected}, got more in {out} of {of} records, which are left out")]
    } else {
        Vec::new()
    };
    Wrenches { samples: kept, warnings }
}

impl Wrenches {
    /// Wrench at `time_s`: linear between two samples; none in a gap. An average would be a filter that the simulator does not have.
    pub(in crate::episode) fn at(&self, time_s: f64) -> Option<[f64; 3]> {
        let next = self.samples.partition_point(|(t, _)| *t <= time_s);
        let before = next.checked_sub(1).map(|i| self.samples[i]);
        let after = self.samples.get(next).copied();
        let near = |sample: Option<(f64, [f64; 3])>| {
            sample.filter(|(t, _)| (t - time_s).abs() <= EDGE_S).map(|(_, wrench)| wrench)
        };
        let (Some((t0, old)), Some((t1, new))) = (before, after) else { return near(before).or_else(|| near(after)) };
        if t1 - t0 > LONGEST_GAP_S {
            return near(before).or_else(|| near(after));
        }
        let share = (time_s - t0) / (t1 - t0);
        Some(std::array::from_fn(|i| old[i] + share * (new[i] - old[i])))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stream(count: u32) -> Vec<(f64, [f64; 3])> {
        (0..count).map(|i| (0.01 * f64::from(i), [0.1 * f64::from(i), -4.0, 0.01 * f64::from(i)])).collect()
    }

    #[test]
    fn a_wrench_is_linear_between_samples_and_absent_in_gaps() {
        let mut samples = stream(100);
        samples.retain(|(t, _)| !(0.3..0.5).contains(t));
        let felt = wrenches(&samples);
        let x = |t: f64| felt.at(t).map(|wrench| wrench[0]);
        assert!((x(0.123).unwrap() - 1.23).abs() < 1e-9 && (x(-0.01).unwrap()).abs() < 1e-12, "{:?}", x(0.123));
        assert_eq!((x(0.4), x(1.2), x(-0.1), felt.warnings.len()), (None, None, None, 0));
        assert!(x(0.3).is_some(), "10 ms after the last sample before the gap");
    }

    #[test]
    fn impossible_wrenches_are_left_out_and_a_stream_of_them_is_refused() {
        let mut samples = stream(100);
        samples[50].1[1] = -4000.0;
        let felt = wrenches(&samples);
        assert!(felt.warnings[0].contains("1 of 100") && (felt.at(0.5).unwrap()[1] + 4.0).abs() < 1e-12, "{felt:?}");
        samples.iter_mut().for_each(|(_, wrench)| wrench[1] *= 1000.0);
        let felt = wrenches(&samples);
        assert!(felt.warnings[0].contains("unit") && felt.at(0.5).is_none(), "{:?}", felt.warnings);
        samples.iter_mut().for_each(|(_, wrench)| *wrench = [0.0; 3]);
        let felt = wrenches(&samples);
        assert!(felt.warnings[0].contains("measures nothing") && felt.at(0.5).is_none(), "{:?}", felt.warnings);
    }
}
