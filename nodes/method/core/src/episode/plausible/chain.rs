//! Chains of samples that can follow each other, and the samples beside them.

use crate::{Camera, Keypoints};

/// Greatest share of the poses or frames that is left out. With more faults it is unknown which samples are right.
pub(in crate::episode) const MOST_LEFT_OUT: f64 = 0.2;
/// Number of runs that a chain may skip. Data with more faults in a row are refused in any case.
const MOST_SKIPPED_RUNS: usize = 512;

/// Usable samples, with warnings about the others.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Plausible<T> {
    /// Samples with their times in s.
    pub(crate) kept: Vec<(f64, T)>,
    /// Warnings about samples that were left out, and about the rest.
    pub(crate) warnings: Vec<String>,
}

/// Keypoints in the plane of motion, m; none if the camera cannot place one of them.
pub(super) fn points_m(keypoints: &Keypoints, camera: &Camera) -> Option<[[f64; 2]; 4]> {
    let [a, b, c, d] = keypoints.dlo_scaled().map(|p| camera.plane_from_scaled(p));
    Some([a?, b?, c?, d?])
}

/// Clears the kept flags of the samples that `also` flags. `also` has one entry for each kept sample.
pub(super) fn take_out(flags: &mut [bool], also: &[bool]) {
    let kept = flags.iter_mut().filter(|flag| **flag);
    kept.zip(also).for_each(|(flag, out)| *flag = !out);
}

/// Samples whose flag is set.
pub(super) fn kept<T: Copy>(samples: &[(f64, T)], flags: &[bool]) -> Vec<(f64, T)> {
    samples.iter().zip(flags).filter(|(_, flag)| **flag).map(|(sample, _)| *sample).collect()
}

/// Flags the samples of the longest chain in which each sample can follow the one before.
///
/// Two samples alone do not show which of them is a fault: the first sample may be wrong, or a hundred in a row. The
/// longest chain is right if most samples are. A chain may skip the first `entry_s` of a run to reach the run.
pub(super) fn longest_chain<T>(
    samples: &[(f64, T)],
    entry_s: f64,
    follows: impl Fn(&(f64, T), &(f64, T)) -> bool,
) -> Vec<bool> {
    // Runs of neighbours that can follow each other. A chain takes whole runs, except for the start of a run.
    let mut runs: Vec<(usize, usize)> = Vec::new();
    for i in 0..samples.len() {
        match runs.last_mut() {
            Some(run) if follows(&samples[run.1], &samples[i]) => run.1 = i,
            _ => runs.push((i, i)),
        }
    }
    // First sample of a run that can follow an earlier run. An ideal simulated arm jumps to its target: the samples
    // right after the jump are skipped instead of the whole run.
    let entry = |from: usize, (first, last): (usize, usize)| {
        let early = |k: &usize| samples[*k].0 - samples[first].0 <= entry_s;
        (first..=last).take_while(early).find(|k| follows(&samples[from], &samples[*k]))
    };
    // For each run: the number of samples of the longest chain to its end, the sample at which the chain enters the
    // run, and the run before it in the chain.
    let mut longest: Vec<(usize, usize, Option<usize>)> = Vec::with_capacity(runs.len());
    for (i, run) in runs.iter().enumerate() {
        let after =
            |j: usize| Some((longest[j].0 + run.1 + 1 - entry(runs[j].1, *run)?, entry(runs[j].1, *run)?, Some(j)));
        let best = (i.saturating_sub(MOST_SKIPPED_RUNS)..i).filter_map(after).max_by_key(|(length, ..)| *length);
        let alone = (run.1 + 1 - run.0, run.0, None);
        longest.push(best.filter(|(length, ..)| *length >= alone.0).unwrap_or(alone));
    }
    let mut flags = vec![false; samples.len()];
    // The chain is read backwards, from the run with which the longest one ends.
    let mut next = (0..runs.len()).max_by_key(|i| longest[*i].0);
    while let Some(i) = next {
        flags[longest[i].1..=runs[i].1].fill(true);
        next = longest[i].2;
    }
    flags
}

/// First and last sample that was left out, each with the kept sample that it contradicts.
pub(super) fn left_out<T: Copy>(samples: &[(f64, T)], flags: &[bool]) -> Vec<((f64, T), (f64, T))> {
    let witness = |i: usize| {
        let before = (0..i).rev().find(|j| flags[*j]);
        let after = (i + 1..samples.len()).find(|j| flags[*j]);
        before.or(after).map(|j| (samples[i], samples[j]))
    };
    let out: Vec<usize> = (0..samples.len()).filter(|i| !flags[*i]).collect();
    let ends = match out.as_slice() {
        [] => vec![],
        [only] => vec![*only],
        [first, .., last] => vec![*first, *last],
    };
    ends.into_iter().filter_map(witness).collect()
}

/// Time of an episode and its stamp, as text.
pub(crate) fn at(time_s: f64, start_ns: i64) -> String {
    let stamp_ns = start_ns.saturating_add((time_s * 1e9).round() as i64);
    format!("at {time_s:.3} s (stamp {})", seconds(stamp_ns))
}

/// Stamp in s with all nine decimals, as text.
pub(crate) fn seconds(stamp_ns: i64) -> String {
    let (sign, magnitude) = (if stamp_ns < 0 { "-" } else { "" }, stamp_ns.unsigned_abs());
    format!("{sign}{}.{:09}", magnitude / 1_000_000_000, magnitude % 1_000_000_000)
}
