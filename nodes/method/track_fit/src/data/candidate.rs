//! Candidate effects: effects that a model may lack.

use catenary_core::{Model, Prior};
use serde::{Deserialize, Serialize};

/// Width of a candidate's search range, in widths of its prior. A fit may exceed the prior, so that an effect larger
/// than expected is found as itself and not as another effect.
const ROOM: f64 = 3.0;
/// Relative tolerance, in lengths of the range, within which two ends of ranges count as equal.
const ROUNDING: f64 = 1e-9;

/// Quantile of a companion's prior to either side of its median, for starts of a fit.
// The quantiles 15 and 85 % lie about a standard deviation to either side of the middle.
const SIDES: [f64; 2] = [0.15, 0.85];

/// Further number of an effect: where, how fast or from which size on it acts. It does nothing without the effect.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Companion {
    /// Name with its unit, as in model files.
    pub name: String,
    /// Name in sentences.
    pub title: String,
    /// Prior of the number, given that the effect is present. A fit stays within.
    pub prior: Prior,
}

/// Effect that the model may lack.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Candidate {
    /// Name with its unit, as in model files.
    pub name: String,
    /// Name in sentences.
    pub title: String,
    /// Prior of the magnitude, given that the effect is present.
    pub prior: Prior,
    /// Smallest and largest meaningful magnitude; the interval holds zero.
    pub range: [f64; 2],
    /// Magnitude that the model has fixed already; the candidate changes it.
    pub base: f64,
    /// Prior odds against the other candidates; 1 by default.
    pub odds: f64,
    /// Further numbers, which are unknown as long as the effect is present; empty for an effect of one number. An effect and its
    /// companions are a group, which is added, judged and named as one.
    #[serde(default)]
    pub companions: Vec<Companion>,
}

impl Candidate {
    /// Returns whether `model` could lack the named effect: true unless the model infers or draws it.
    pub fn is_open(name: &str, model: &Model) -> bool {
        model.theta.index_of(name).is_none() && model.effects.iter().all(|e| e.name != name)
    }

    /// Signs that a change of the magnitude may have. A positive prior gives two signs if the model has fixed the
    /// effect: the fixed magnitude may be too large as well as too small.
    pub fn signs(&self) -> &'static [f64] {
        if self.prior.bounds().0 >= 0.0 && self.base > self.range[0] { &[1.0, -1.0] } else { &[1.0] }
    }

    /// Search range of the magnitude: uniform, around the base in all directions of [`signs`](Self::signs), wider than
    /// the prior.
    pub fn search(&self) -> Prior {
        let [down, up] = self.reach();
        let (from, to) = (self.base + ROOM * down, self.base + ROOM * up);
        Prior::Uniform { low: from.max(self.range[0]), high: to.min(self.range[1]) }
    }

    /// Largest change that the prior allows, downward and upward.
    fn reach(&self) -> [f64; 2] {
        let (low, high) = self.prior.bounds();
        [if self.signs().len() > 1 { -high } else { low.min(0.0) }, high]
    }

    /// End of the candidate's range at which the search coordinate `u` lies, if that end is beyond the prior. A fit
    /// that ends there needs more of the effect than is physically possible.
    ///
    /// None if only the search range ends there, because the effect may just be larger than expected. None also at zero
    /// of an effect that the model has fixed: the effect may be absent.
    pub fn limit_at(&self, u: f64) -> Option<f64> {
        let (from, to) = self.search().bounds();
        let value = match u {
            u if u <= 0.0 && self.signs().len() == 1 => from,
            u if u >= 1.0 => to,
            _ => return None,
        };
        let is_end = self.range.iter().any(|end| (value - end).abs() <= ROUNDING * (self.range[1] - self.range[0]));
        let [down, up] = self.reach();
        (is_end && !(down..=up).contains(&(value - self.base))).then_some(value)
    }

    /// Smallest and largest value that the prior allows, over all signs.
    pub fn support(&self) -> [f64; 2] {
        self.reach().map(|change| (self.base + change).clamp(self.range[0], self.range[1]))
    }

    /// Density of the prior at `value`, per unit of it; all signs are equally likely.
    pub fn density(&self, value: f64) -> f64 {
        let change = value - self.base;
        let signs = self.signs().len() as f64;
        let magnitude = if signs > 1.0 { change.abs() } else { change };
        self.prior.density(magnitude) / signs
    }

    /// Value at quantile `u` of the prior, over all signs.
    pub fn drawn(&self, u: f64) -> f64 {
        let signs = self.signs();
        let scaled = u.clamp(0.0, 1.0) * signs.len() as f64;
        let place = (scaled as usize).min(signs.len() - 1);
        let value = self.base + signs[place] * self.prior.from_unit(scaled - place as f64);
        value.clamp(self.range[0], self.range[1])
    }

    /// Values at which a fit starts: two quantiles of the prior for each sign.
    pub fn starts(&self) -> Vec<f64> {
        let [least, greatest] = self.range;
        let at = |sign: &f64| SIDES.map(|u| (self.base + sign * self.prior.from_unit(u)).clamp(least, greatest));
        self.signs().iter().flat_map(at).collect()
    }

    /// Settings of the companions at which a fit starts, as quantiles of their priors: all at the median, then each at two
    /// quantiles beside it. A single setting without companions.
    ///
    /// An absent effect does not depend on its companions, so that no derivative leads from one setting to another.
    pub fn settings(&self) -> Vec<Vec<f64>> {
        let middle = vec![0.5; self.companions.len()];
        let aside = (0..middle.len()).flat_map(|i| SIDES.map(|u| (i, u)));
        let moved = aside.map(|(i, u)| {
            let mut setting = middle.clone();
            setting[i] = u;
            setting
        });
        std::iter::once(middle.clone()).chain(moved).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn drag() -> Candidate {
        let prior = Prior::LogUniform { low: 1e-3, high: 0.3 };
        Candidate {
            name: "linear_drag_n_s_m2".into(),
            title: "drag".into(),
            prior,
            range: [0.0, 1e3],
            base: 0.0,
            odds: 1.0,
            companions: Vec::new(),
        }
    }

    #[test]
    fn a_group_starts_at_several_settings_of_its_companions() {
        assert_eq!(drag().settings(), [[0.0; 0]]);
        let companion = |name: &str| Companion {
            name: name.into(),
            title: name.into(),
            prior: Prior::Uniform { low: 0.0, high: 2.0 },
        };
        let group = Candidate { companions: ["place", "rate"].map(companion).into(), ..drag() };
        let expected = [[0.5, 0.5], [0.15, 0.5], [0.85, 0.5], [0.5, 0.15], [0.5, 0.85]];
        assert_eq!(group.settings(), expected);
    }

    #[test]
    fn a_search_range_begins_at_the_base_and_ends_beyond_the_prior() {
        let (low, high) = drag().search().bounds();
        assert!(low == 0.0 && (high - 0.9).abs() < 1e-12, "{low} to {high}");
        let tilt =
            Candidate { prior: Prior::Uniform { low: -0.1, high: 0.1 }, range: [-0.2, 1.5], base: 0.05, ..drag() };
        let Prior::Uniform { low, high } = tilt.search() else { panic!("linear") };
        assert!((low + 0.2).abs() < 1e-12 && (high - 0.35).abs() < 1e-12, "{low} to {high}");
    }

    #[test]
    fn a_candidate_has_a_limit_where_its_range_ends_beyond_the_prior() {
        let tilt = Candidate { prior: Prior::Uniform { low: -0.1, high: 0.1 }, range: [-0.2, 1.5], ..drag() };
        assert_eq!([0.0, 0.5, 1.0].map(|u| tilt.limit_at(u)), [Some(-0.2), None, None]);
        // A blend from 0 to 1, two effects fixed in the model, and an effect at zero.
        let switch = Candidate { prior: Prior::Uniform { low: 0.0, high: 1.0 }, range: [0.0, 1.0], ..drag() };
        let fixed = |base: f64| Candidate { base, ..drag() }.limit_at(0.0);
        assert_eq!([switch.limit_at(1.0), fixed(0.1), fixed(0.5), drag().limit_at(0.0)], [None; 4]);
        assert_eq!(drag().limit_at(1.0), None, "a search ends there, and the range does not");
        let density = Candidate { prior: Prior::Uniform { low: -0.3, high: 0.3 }, range: [-0.9, 10.0], ..drag() };
        assert!(
            density.limit_at(0.0).is_some_and(|limit| (limit + 0.9).abs() < 1e-9),
            "by rounding, 3 times 0.3 is less"
        );
    }

    #[test]
    fn draws_cover_the_prior_with_each_sign() {
        let quantiles: Vec<f64> = [0.0, 0.5, 1.0].map(|u| drag().drawn(u)).into();
        assert!((quantiles[0] - 1e-3).abs() < 1e-12 && (quantiles[2] - 0.3).abs() < 1e-12, "{quantiles:?}");
        assert!((quantiles[1] - (1e-3f64 * 0.3).sqrt()).abs() < 1e-9, "{quantiles:?}");
        let fixed = Candidate { base: 0.5, ..drag() };
        let (more, less) = (fixed.drawn(0.25), fixed.drawn(0.75));
        assert!((more - 0.5 - quantiles[1]).abs() < 1e-9 && (0.5 - less - quantiles[1]).abs() < 1e-9, "{more} {less}");
    }

    #[test]
    fn the_density_of_a_prior_integrates_to_one() {
        let wide =
            Candidate { prior: Prior::Uniform { low: -0.1, high: 0.3 }, base: 1.0, range: [-9.0, 9.0], ..drag() };
        let fixed = Candidate { base: 0.5, ..drag() };
        assert_eq!((fixed.signs().len(), fixed.starts().len()), (2, 4));
        for candidate in [drag(), wide, fixed] {
            let (low, high) = candidate.prior.bounds();
            let low = if candidate.signs().len() > 1 { -high } else { low };
            let n = 400_000;
            let h = (high - low) / f64::from(n);
            let sum: f64 = (0..n).map(|i| candidate.density(candidate.base + low + h * (f64::from(i) + 0.5)) * h).sum();
            assert!((sum - 1.0).abs() < 5e-4, "{sum}");
        }
    }
}
