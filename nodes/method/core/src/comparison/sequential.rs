//! Sequential sign test of paired episodes, which may be looked at after every pair.

use serde::{Deserialize, Serialize};

/// Pairs of episodes of two policies, each pair in the same conditions.
///
/// The evidence against "either is as likely to be better" is the beta-binomial mixture of Robbins (1970): 2^n k! (n - k)! / (n + 1)!
/// for k of n pairs that the first won. It is a test martingale: whenever one looks, and however often, the probability that it ever
/// reaches 1 / a is at most a if the hypothesis holds (Ville 1939). Equal pairs tell nothing and do not count.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct SequentialSigns {
    /// Pairs in which the first was better.
    pub wins: u32,
    /// Pairs in which the second was better.
    pub losses: u32,
}

/// State of a sequential test.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Decision {
    /// The first is better.
    First,
    /// The second is better.
    Second,
    /// More pairs may decide.
    Open,
    /// The pairs that are left decide nothing, even if all of them fall to one side.
    Hopeless,
}

impl SequentialSigns {
    /// Adds a pair by its difference, the first minus the second.
    pub fn add(&mut self, difference: f64) {
        self.wins += u32::from(difference > 0.0);
        self.losses += u32::from(difference < 0.0);
    }

    /// Natural logarithm of the evidence.
    pub fn log_evidence(&self) -> f64 {
        let n = self.wins + self.losses;
        let log_factorial = |k: u32| (2..=k).map(|i| f64::from(i).ln()).sum::<f64>();
        f64::from(n) * std::f64::consts::LN_2 + log_factorial(self.wins) + log_factorial(self.losses)
            - log_factorial(n + 1)
    }

    /// Decision at an error probability, with `left` pairs to come.
    pub fn decision(&self, error: f64, left: u32) -> Decision {
        let limit = -error.ln();
        let Self { wins, losses } = *self;
        if self.log_evidence() >= limit {
            return if wins > losses { Decision::First } else { Decision::Second };
        }
        let can = |wins, losses| Self { wins, losses }.log_evidence() >= limit;
        if can(wins + left, losses) || can(wins, losses + left) { Decision::Open } else { Decision::Hopeless }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::seed;
    use rand::RngExt;

    #[test]
    fn eight_of_eight_decide_at_five_percent_and_seven_do_not() {
        // 2^7 / 8 = 16 and 2^8 / 9 = 28.4.
        assert_eq!(SequentialSigns { wins: 7, losses: 0 }.decision(0.05, 3), Decision::Open);
        assert_eq!(SequentialSigns { wins: 8, losses: 0 }.decision(0.05, 0), Decision::First);
        assert_eq!(SequentialSigns { wins: 0, losses: 8 }.decision(0.05, 0), Decision::Second);
        // With four of eight, eight more of one side make 12 of 16: 2^16 / (17 C(16, 4)) = 2.1.
        assert_eq!(SequentialSigns { wins: 4, losses: 4 }.decision(0.05, 8), Decision::Hopeless);
        let mut signs = SequentialSigns::default();
        [0.5, -0.1, 0.0].into_iter().for_each(|d| signs.add(d));
        assert_eq!(signs, SequentialSigns { wins: 1, losses: 1 });
    }

    #[test]
    fn equal_policies_are_rarely_told_apart_however_often_one_looks() {
        // 2000 series of 200 looks: the share that ever decides is at most 5 %, and 1.5 % more are four standard errors above.
        let mut rng = seed::rng(4, 0);
        let decided = (0..2000)
            .filter(|_| {
                let mut signs = SequentialSigns::default();
                (0..200).any(|_| {
                    signs.add(if rng.random_bool(0.5) { 1.0 } else { -1.0 });
                    signs.decision(0.05, 1000) != Decision::Open
                })
            })
            .count();
        assert!(decided < 130, "{decided} of 2000");
        assert!(decided > 10, "{decided} of 2000: a test that never decides");
    }
}
