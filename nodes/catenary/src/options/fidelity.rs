//! Option `--fidelity`.

use catenary_core::Fidelity;
use clap::ValueEnum;
use clap::builder::PossibleValue;

/// Fidelity as a value of a command-line option.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FidelityName(pub Fidelity);

impl ValueEnum for FidelityName {
    fn value_variants<'a>() -> &'a [Self] {
        const ALL: [FidelityName; Fidelity::ALL.len()] = {
            let mut all = [FidelityName(Fidelity::Fast); Fidelity::ALL.len()];
            let mut i = 0;
            while i < all.len() {
                all[i] = FidelityName(Fidelity::ALL[i]);
                i += 1;
            }
            all
        };
        &ALL
    }

    fn to_possible_value(&self) -> Option<PossibleValue> {
        Some(PossibleValue::new(self.0.name()).help(self.0.description()))
    }
}
