//! Evidence of a posterior: recordings of an object, and simulations of the inference.

use anyhow::{Context, Result, bail};
use serde::{Deserialize, Serialize};
use std::fmt::{self, Display};
use std::str::FromStr;

/// Largest number of recordings.
const RECORDINGS: u64 = 20;

/// Evidence of a posterior. Its text is RECORDINGS:ROUNDSxSIMULATIONS; the numbers after the colon may be left out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Evidence {
    /// Recordings of the object.
    pub recordings: u64,
    /// Rounds of simulation and training.
    pub rounds: usize,
    /// Simulations in each round.
    pub simulations: usize,
}

impl Evidence {
    /// Settings of an inference from it.
    pub fn settings(&self) -> bayes_sim::Settings {
        // The number of simulations is the evidence that is compared, so that no refinement adds others.
        bayes_sim::Settings {
            iterations: self.rounds,
            simulations: self.simulations,
            ..bayes_sim::Settings::networks()
        }
    }

    /// Words for it.
    pub fn words(&self) -> String {
        let recordings = if self.recordings == 1 { "recording" } else { "recordings" };
        format!("{} {recordings}, {} simulations", self.recordings, self.rounds * self.simulations)
    }
}

impl Display for Evidence {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}x{}", self.recordings, self.rounds, self.simulations)
    }
}

impl FromStr for Evidence {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        const FORM: &str =
            "expected RECORDINGS or RECORDINGS:ROUNDSxSIMULATIONS in whole numbers, such as 2 or 1:15x100";
        let parse = || -> Result<Self> {
            let (recordings, sizes) = text.split_once(':').map_or((text, None), |(r, s)| (r, Some(s)));
            let recordings: u64 = recordings.parse().context(FORM)?;
            let defaults = bayes_sim::Settings::default();
            let (rounds, simulations) = match sizes {
                None => (defaults.iterations, defaults.simulations),
                Some(sizes) => {
                    let (rounds, simulations) = sizes.split_once('x').context(FORM)?;
                    (rounds.parse().context(FORM)?, simulations.parse().context(FORM)?)
                }
            };
            if !(1..=RECORDINGS).contains(&recordings) {
                bail!("expected 1 to {RECORDINGS} recordings, got {recordings}");
            }
            let evidence = Self { recordings, rounds, simulations };
            evidence.settings().check()?;
            Ok(evidence)
        };
        parse().map_err(|e| e.to_string())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn evidence_has_defaults_and_wrong_ones_say_what_was_expected() {
        let read = |text: &str| text.parse::<Evidence>();
        let default = bayes_sim::Settings::default();
        let two = Evidence { recordings: 2, rounds: default.iterations, simulations: default.simulations };
        assert_eq!(read("2"), Ok(two));
        assert_eq!(read("1:1x20"), Ok(Evidence { recordings: 1, rounds: 1, simulations: 20 }));
        assert_eq!(read(&two.to_string()), Ok(two));
        assert_eq!(read("1:3x60").unwrap().words(), "1 recording, 180 simulations");
        for (bad, says) in [
            ("", "RECORDINGS:ROUNDSxSIMULATIONS"),
            ("1:20", "ROUNDSxSIMULATIONS"),
            ("1:2x", "ROUNDSxSIMULATIONS"),
            ("-1", "RECORDINGS"),
            ("0", "1 to 20 recordings, got 0"),
            ("1:0x20", "iterations"),
            ("1:2x1", "simulations"),
        ] {
            assert!(read(bad).is_err_and(|e| e.contains(says)), "{bad}: {:?}", read(bad));
        }
    }
}
