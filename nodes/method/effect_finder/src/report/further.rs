//! Tests of the present model on further episodes, for validation or held out, where the fitted ones show no gap.

use super::decide::is_unlike;
use crate::settings::Settings;
use serde::{Deserialize, Serialize};

/// Test of the present model on a validation or held-out episode.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FurtherTest {
    /// Name of the episode.
    pub name: String,
    /// True for a held-out episode, false for a validation episode.
    pub is_held_out: bool,
    /// Index among the validation episodes, or among the held-out ones.
    pub index: usize,
    /// p-value of the hypothesis that the present model explains the episode together with the fitted ones.
    pub p_value: f64,
    /// Number of null data sets of the test.
    pub null_sets: usize,
}

/// Tests that contradict the present model.
pub fn unlike(tests: &[FurtherTest], settings: &Settings) -> Vec<FurtherTest> {
    tests.iter().filter(|test| is_unlike(test.p_value, tests.len(), settings)).cloned().collect()
}

/// Moves episodes that `joined` the fitted ones to the end of these, in the order of `joined`. The others keep their order.
pub fn join<T>(joined: &[FurtherTest], fitted: &mut Vec<T>, validation: &mut Vec<T>, held_out: &mut Vec<T>) {
    let [mut selecting, mut unseen] =
        [&mut *validation, &mut *held_out].map(|list| list.drain(..).map(Some).collect::<Vec<Option<T>>>());
    for FurtherTest { is_held_out, index, .. } in joined {
        let list = if *is_held_out { &mut unseen } else { &mut selecting };
        fitted.extend(list.get_mut(*index).and_then(Option::take));
    }
    validation.extend(selecting.into_iter().flatten());
    held_out.extend(unseen.into_iter().flatten());
}

/// Index, among all episodes of the kind, of number `place` of those that have not `joined` the fitted ones.
pub(crate) fn index_among_all(place: usize, is_held_out: bool, joined: &[FurtherTest]) -> usize {
    let mut gone: Vec<usize> = joined.iter().filter(|j| j.is_held_out == is_held_out).map(|j| j.index).collect();
    gone.sort_unstable();
    // Each earlier episode that is gone moves the place by one.
    gone.into_iter().fold(place, |index, gone| if gone <= index { index + 1 } else { index })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn test(is_held_out: bool, index: usize, p_value: f64) -> FurtherTest {
        FurtherTest { name: format!("episode {index}"), is_held_out, index, p_value, null_sets: 199 }
    }

    #[test]
    fn joined_episodes_follow_the_fitted_ones_and_the_others_keep_their_order() {
        let lists = |joined: &[FurtherTest]| {
            let [mut fitted, mut validation, mut held_out] = [vec!["a"], vec!["b", "c", "d"], vec!["e", "f"]];
            join(joined, &mut fitted, &mut validation, &mut held_out);
            [fitted, validation, held_out]
        };
        assert_eq!(lists(&[]), [vec!["a"], vec!["b", "c", "d"], vec!["e", "f"]]);
        let joined = [test(false, 1, 0.01), test(true, 0, 0.01), test(false, 0, 0.01)];
        assert_eq!(lists(&joined), [vec!["a", "c", "e", "b"], vec!["d"], vec!["f"]]);
        let left = |is_held_out: bool, place| index_among_all(place, is_held_out, &joined);
        assert_eq!((left(false, 0), left(false, 1), left(true, 0)), (2, 3, 1));
        assert_eq!(index_among_all(0, false, &joined[..1]), 0);
        assert_eq!(index_among_all(1, false, &joined[..1]), 2);
    }

    #[test]
    fn each_of_several_episodes_is_tested_at_its_share_of_the_level() {
        let of = |p: &[f64]| {
            let tests: Vec<FurtherTest> = p.iter().enumerate().map(|(i, p)| test(false, i, *p)).collect();
            unlike(&tests, &Settings::default()).iter().map(|t| t.index).collect::<Vec<_>>()
        };
        assert_eq!((of(&[]), of(&[0.051]), of(&[0.05])), (vec![], vec![], vec![0]));
        assert_eq!(of(&[0.025, 0.026]), [0]);
        assert_eq!(of(&[0.012, 0.5, 0.0126, 0.005]), [0, 3]);
    }
}
