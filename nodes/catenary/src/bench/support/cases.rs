//! Hidden truths with prior supports that contain them or not.

use crate::bench::args::SupportArgs;
use crate::inputs::model_file;
use anyhow::{Context, Result};
use catenary_core::{Model, Parameter, ParameterSpace, seed};
use rand::RngExt;
use std::path::Path;

/// Distances of truths from the prior support, in its widths.
const BEYOND: [f64; 2] = [0.1, 0.6];
/// Distance of the bars' parameters from the prior support.
const BARS_BEYOND: f64 = 0.3;
/// Width of a prior support that excludes the truth, in widths of the model file's: the truth then stays within the model
/// file's support, for which the simulator's settings are made.
const NARROW: f64 = 0.5;
/// The bars of the paper.
pub const BARS: [&str; 4] = ["dlo_0", "dlo_1", "dlo_2", "dlo_3"];

/// Hidden truth with a prior support.
pub struct Case {
    /// Group whose figures are averaged.
    pub group: &'static str,
    /// Model with the prior support. The simulator gets it as well: it simulates any theta within the physical limits,
    /// inside of the support or not.
    pub model: Model,
    /// Seed of motion, noise and inference.
    pub seed: u64,
    /// Hidden theta, D.
    pub truth: Vec<f64>,
    /// Distance of each truth from the prior support in its widths, D.
    pub beyond: Vec<f64>,
}

impl Case {
    /// Case of `model` whose truth has the unit coordinates `u` (D) and lies `beyond` (D) the prior support.
    fn new(group: &'static str, model: &Model, u: &[f64], beyond: &[f64], seed: u64) -> Result<Self> {
        let stated = |((p, u), beyond): ((&Parameter, &f64), &f64)| {
            if *beyond == 0.0 {
                return Some(p.clone());
            }
            // On the side that keeps the prior support near the middle of the model file's.
            let near = if *u < 0.5 { u + NARROW * beyond } else { u - NARROW * beyond };
            let far = if *u < 0.5 { near + NARROW } else { near - NARROW };
            let prior = p.prior.with_bounds(p.prior.from_unit(near.min(far)), p.prior.from_unit(near.max(far)))?;
            Some(Parameter { name: p.name.clone(), prior })
        };
        let pairs = model.theta.parameters().iter().zip(u).zip(beyond);
        let parameters = pairs.map(stated).collect::<Option<Vec<_>>>();
        let theta = ParameterSpace::new(parameters.context("a prior is a mixture, whose bounds cannot be set")?)?;
        let truth = model.theta.from_unit(u);
        Ok(Self { group, model: Model { theta, ..model.clone() }, truth, beyond: beyond.to_vec(), seed })
    }
}

/// All cases: truths outside of the prior support in one parameter, truths inside, and the four bars outside in both
/// parameters.
pub fn all(arguments: &SupportArgs) -> Result<Vec<Case>> {
    let model = model_file::read_or_soft_bar(arguments.model.as_deref())?;
    let d = model.theta.dimension();
    let mut cases = Vec::new();
    for number in 0..arguments.truths {
        let mut rng = seed::rng(number, 5);
        let u: Vec<f64> = (0..d).map(|_| rng.random::<f64>()).collect();
        let mut beyond = vec![0.0; d];
        beyond[number as usize % d] = rng.random_range(BEYOND[0]..BEYOND[1]);
        cases.push(Case::new("outside", &model, &u, &beyond, number)?);
        cases.push(Case::new("inside", &model, &u, &vec![0.0; d], number)?);
    }
    for number in 0..arguments.motions {
        for name in BARS {
            let bar = model_file::read(Path::new(name))?;
            let u = bar.theta.to_unit(&bar.nominal_theta());
            let beyond = vec![BARS_BEYOND; u.len()];
            // Seeds beyond those of the truths.
            cases.push(Case::new(name, &bar, &u, &beyond, (1 << 32) + number)?);
        }
    }
    Ok(cases)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::options::{InferencePreset, InferenceSizes, Output};

    #[test]
    fn a_truth_lies_as_far_from_its_stated_support_as_it_should() {
        let arguments = SupportArgs {
            truths: 6,
            motions: 1,
            out: "unused".into(),
            model: None,
            sizes: InferenceSizes { preset: InferencePreset::Default, iterations: None, simulations: None },
            output: Output { json: false },
        };
        let cases = all(&arguments).unwrap();
        assert_eq!(cases.len(), 2 * 6 + 4);
        for case in cases {
            let u = case.model.theta.to_unit(&case.truth);
            for (u, beyond) in u.iter().zip(&case.beyond) {
                let outside = (u - 1.0).max(-u).max(0.0);
                assert!((outside - beyond).abs() < 1e-9, "{}: {u} is {outside} outside, not {beyond}", case.group);
            }
        }
    }
}
