//! Warnings about a posterior, and the verdict that it must not be used.

use super::parts::Part;
use super::predictive::{Predictive, PredictiveCheck, Unchecked};
use crate::prior_support::PriorSupport;
use crate::sequential::{DRAWS, Side, pressed};
use catenary_core::mixture::MixtureError;
use catenary_core::{Parameter, Posterior, Prior, seed};

/// Share of the prior's range at either end that counts as its edge.
const EDGE: f64 = 0.05;
/// Share of the posterior at an edge above which a warning is given: six times the prior's share.
const PRESSED: f64 = 0.3;
/// Share of the mixture outside of the support above which a warning is given. Mass outside is no error in itself: of three
/// parameters that the data do not determine, with the largest covariance inflation, seven tenths lie outside.
const OUTSIDE: f64 = 0.75;
/// Effective sample size below which a mixture density network learns too little.
const FEW_SAMPLES: f64 = 100.0;
/// Prediction error in half widths of the predictive band above which the posterior is a misfit. A half width is 1.64
/// standard deviations, so that 5 of them are 8 standard deviations, on average over all keypoints.
const FAR_HALF_WIDTHS: f64 = 5.0;
/// Prediction error in spreads of the measured keypoints about their mean above which the posterior is a misfit, however
/// wide its band is.
const FAR_SPREADS: f64 = 3.0;
/// Coverage of the nominal 90 % band below which the posterior may be a misfit.
const NO_COVERAGE: f64 = 0.3;

/// Posterior whose edges are looked at.
pub enum Edges<'a> {
    /// Posterior of networks: its mixture before the truncation tells how far it reaches beyond the edges.
    Beyond(&'a Posterior),
    /// Posterior of which nothing but the part inside of the support has a meaning.
    Inside(&'a Posterior),
}

/// Warnings about edges of the prior on which the posterior presses: much of it lies near the edge, or the mixture before its
/// truncation lies there by the rule that moves an adaptive support. `support` is the setting of the inference, and `range_of`
/// returns the values of a parameter that the simulator accepts.
///
/// # Errors
/// [`MixtureError`] if the posterior has no mass inside of the prior's support.
pub fn edge_warnings(
    edges: Edges<'_>,
    support: PriorSupport,
    range_of: &dyn Fn(&str) -> Option<[f64; 2]>,
) -> Result<Vec<String>, MixtureError> {
    let (Edges::Beyond(posterior) | Edges::Inside(posterior)) = edges;
    let inside = posterior.sample(DRAWS, 0)?;
    let mut rng = seed::rng(0, 1);
    let all: Vec<Vec<f64>> = match edges {
        Edges::Beyond(_) => (0..DRAWS).map(|_| posterior.mixture.sample(&mut rng)).collect(),
        Edges::Inside(_) => Vec::new(),
    };
    let mut warnings = Vec::new();
    for (i, p) in posterior.parameters.parameters().iter().enumerate() {
        let pressed = if all.is_empty() { None } else { pressed(all.iter().map(|u| u[i])) };
        let limits = range_of(&p.name);
        let (low, high) = p.prior.bounds();
        for (side, bound) in [(Side::Lower, low), (Side::Upper, high)] {
            let is_near = |u: f64| if side == Side::Lower { u < EDGE } else { u > 1.0 - EDGE };
            let near = inside.iter().filter(|t| is_near(p.prior.to_unit(t[i]))).count() as f64 / DRAWS as f64;
            // The end of a Gaussian is no bound: it reaches far beyond its last 5 %.
            if near > PRESSED && matches!(p.prior, Prior::Normal { .. }) {
                warnings.push(disagreement(p, side, near));
                continue;
            }
            let beyond = pressed.filter(|(of, _)| *of == side).map(|(_, share)| 100.0 * share);
            let place = match beyond {
                _ if near > PRESSED => {
                    format!(
                        "{:.0} % of the posterior lies in the {:.0} % of the prior next to its",
                        100.0 * near,
                        100.0 * EDGE
                    )
                }
                Some(share) => {
                    format!("{share:.0} % of the mixture before its truncation lies at or beyond the prior's")
                }
                None => continue,
            };
            let is_limit =
                limits.is_some_and(|[least, most]| if side == Side::Lower { low <= least } else { high >= most });
            let is_free = limits.is_some() && !matches!(p.prior, Prior::Mixture(_));
            warnings.push(format!(
                "{}: {place} {} bound {bound}: {}",
                p.name,
                side.name(),
                advice(support, is_limit, is_free)
            ));
        }
    }
    Ok(warnings)
}

/// Warning about a share `near` of the posterior in the end of a Gaussian prior.
fn disagreement(p: &Parameter, side: Side, near: f64) -> String {
    format!(
        "{}: {:.0} % of the posterior lies in the {} {:.0} % of its prior, {}: what is known before disagrees with the recording, or the model \
         lacks something",
        p.name,
        100.0 * near,
        side.name(),
        100.0 * EDGE,
        p.prior
    )
}

/// Consequence of a posterior that presses on a bound. `is_limit`: the simulator accepts nothing beyond the bound; `is_free`:
/// the prior has bounds that can move, and the simulator's limits are known.
fn advice(support: PriorSupport, is_limit: bool, is_free: bool) -> &'static str {
    match support {
        _ if is_limit => "the simulator accepts no value beyond this bound, so that no prior reaches farther",
        PriorSupport::Fixed if is_free => {
            "the prior may be too narrow, and the posterior falsely certain; with prior_support adaptive, the support grows there"
        }
        PriorSupport::Adaptive(_) if is_free => {
            "the prior may be too narrow, and the posterior falsely certain; with more iterations, the support grows farther"
        }
        _ => "the prior may be too narrow, and the posterior falsely certain",
    }
}

/// Warnings from the figures of an inference. `networks` are the mass of the mixture outside of the support and the effective
/// sample size of the weights, for a posterior that rests on networks.
pub fn fit_warnings(networks: Option<(f64, f64)>, predictive: Option<&Predictive>) -> Vec<String> {
    let mut warnings = Vec::new();
    if let Some((mass_outside, effective_sample_size)) = networks {
        if mass_outside > OUTSIDE {
            warnings.push(format!("{:.0} % of the mixture lies outside the prior's support", 100.0 * mass_outside));
        }
        if effective_sample_size < FEW_SAMPLES {
            warnings.push(format!(
                "the simulations are worth only {effective_sample_size:.0} effective samples: more simulations are needed"
            ));
        }
    }
    warnings.extend(predictive.filter(|p| p.is_in_doubt()).map(model_warning));
    if let Some(p) = predictive.filter(|p| p.rmse_mm > p.spread_mm) {
        warnings.push(format!(
            "the mean prediction is {:.1} mm off the measured keypoints, and their own mean only {:.1} mm: check that the model belongs to the recording",
            p.rmse_mm, p.spread_mm
        ));
    }
    warnings
}

/// Warning about a model in doubt: the figures of the check, and the worst part.
fn model_warning(p: &Predictive) -> String {
    let bound = match p.p_value <= p.least_p_value() * (1.0 + 1e-9) {
        true => format!("p <= {:.3}, the least that {} draws can show", p.p_value, p.draws),
        false => format!("p = {:.3}", p.p_value),
    };
    let of_several = |part: &Part| match p.parts.last().is_some_and(|last| last.episode > 1) {
        true => format!("recording {}, ", part.episode),
        false => String::new(),
    };
    let worst = p.worst().map(|part| {
        format!(
            "; worst: {}keypoint {} from the grip, {:.2} s to {:.2} s (third {} of 3), RMSE {:.1} mm, {:.0} % in the band",
            of_several(part),
            part.keypoint,
            part.times_s[0],
            part.times_s[1],
            part.third,
            part.rmse_mm,
            100.0 * part.coverage
        )
    });
    format!(
        "the model reproduces the recording poorly: RMSE {:.1} mm, {:.0} % of the measured coordinates in the 90 % band of the posterior's predictions, {bound}{}",
        p.rmse_mm,
        100.0 * p.coverage,
        worst.unwrap_or_default()
    )
}

/// Reason for which a posterior must not be used; none if it may be used. A posterior is a misfit if no draw can be
/// simulated, or if the prediction error is both larger than that of 99 % of the draws and far outside of the band or beyond the
/// error of the trivial prediction. An error beyond three spreads of the keypoints suffices alone. A model that merely lacks
/// an effect gets a warning from [`fit_warnings`].
pub fn misfit(check: &Result<PredictiveCheck, Unchecked>) -> Option<String> {
    let p = match check {
        Ok(check) => &check.figures,
        Err(Unchecked::NoDraw) => {
            return Some("no draw of the posterior could be simulated up to the last measured frame".into());
        }
        // Nothing speaks against the posterior. A warning reports the missing check.
        Err(Unchecked::NotPlaced) => return None,
    };
    let is_far = p.coverage < NO_COVERAGE && p.rmse_mm > FAR_HALF_WIDTHS * p.half_width_mm;
    // The band of a wide posterior may be as wide as the error: no rank and no band detects this misfit.
    let is_foreign = p.rmse_mm.is_nan() || p.rmse_mm > FAR_SPREADS * p.spread_mm;
    (is_foreign || p.is_improbable() && (is_far || p.rmse_mm > p.spread_mm)).then(|| {
        format!(
            "the predictions are {:.1} mm off the measured keypoints on average, {:.0} times the half width of their 90 % band, and {:.0} % of the keypoints lie in it: check model, units, frames and clocks of the recording",
            p.rmse_mm,
            p.rmse_mm / p.half_width_mm,
            100.0 * p.coverage
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnostics::Bands;
    use catenary_core::{Mixture, ParameterSpace};
    use nalgebra::{DMatrix, DVector};

    #[test]
    fn a_posterior_at_an_edge_gets_a_warning() {
        let p = Parameter { name: "length_m".into(), prior: Prior::Uniform { low: 1.0, high: 2.0 } };
        let space = ParameterSpace::new(vec![p]).unwrap();
        let of = |mean: f64, sd: f64, support, limits: Option<[f64; 2]>| {
            let (mean, covariance) = (DVector::from_element(1, mean), DMatrix::from_element(1, 1, sd * sd));
            let mixture = Mixture::new(&[1.0], vec![mean], vec![covariance]).unwrap();
            let posterior = Posterior { parameters: space.clone(), mixture };
            edge_warnings(Edges::Beyond(&posterior), support, &|_| limits).unwrap()
        };
        let (fixed, wide) = (PriorSupport::Fixed, Some([0.0, 9.0]));
        assert_eq!(of(0.5, 0.02, fixed, wide), Vec::<String>::new());
        assert_eq!(of(0.5, 9.0, fixed, wide), Vec::<String>::new(), "undetermined");
        let narrow = of(0.99, 0.02, fixed, wide).remove(0);
        assert!(narrow.starts_with("length_m: ") && narrow.contains("of the posterior lies in the 5 % of the prior"));
        assert!(
            narrow.contains("next to its upper bound 2: ") && narrow.contains("prior_support adaptive"),
            "{narrow}"
        );
        let known = Prior::Normal { mean: 1.5, sd: 0.05, low: 1.0, high: 2.0 };
        let space = ParameterSpace::new(vec![Parameter { name: "length_m".into(), prior: known.clone() }]).unwrap();
        let (mean, covariance) = (DVector::from_element(1, known.to_unit(1.6)), DMatrix::from_element(1, 1, 1e-4));
        let mixture = Mixture::new(&[1.0], vec![mean], vec![covariance]).unwrap();
        let posterior = Posterior { parameters: space, mixture };
        let apart = edge_warnings(Edges::Beyond(&posterior), fixed, &|_| wide).unwrap().remove(0);
        assert!(
            apart.contains("in the upper 5 % of its prior, ") && apart.contains("disagrees with the recording"),
            "{apart}"
        );
        // A wide mixture about a mean outside: few draws inside of the support lie near its edge.
        let outside = of(1.1, 0.6, fixed, wide).remove(0);
        assert!(
            outside.contains("of the mixture before its truncation lies at or beyond the prior's upper"),
            "{outside}"
        );
        let ends = |support, limits| of(0.0, 0.02, support, limits).remove(0);
        assert!(
            ends(fixed, Some([1.0, 9.0])).ends_with(
                "bound 1: the simulator accepts no value beyond this bound, so that no prior reaches farther"
            )
        );
        assert!(ends(PriorSupport::ADAPTIVE, wide).ends_with("with more iterations, the support grows farther"));
        assert!(ends(fixed, None).ends_with("and the posterior falsely certain"), "a simulator without known limits");
    }

    #[test]
    fn a_misfit_is_told_from_a_model_that_lacks_an_effect() {
        let good = good();
        let lowest = 1.0 / 51.0;
        let misfit = |figures: Result<Predictive, Unchecked>| {
            let bands = Bands { coverage_50: 0.5, coverage_p_value: 0.5, effective_coordinates: 8.0 };
            super::misfit(&figures.map(|figures| PredictiveCheck { figures, bands, frames: [1, 1] }))
        };
        assert_eq!(misfit(Ok(good.clone())), None);
        assert_eq!(misfit(Ok(Predictive { p_value: lowest, coverage: 0.5, rmse_mm: 4.0, ..good.clone() })), None);
        assert_eq!(
            misfit(Ok(Predictive { p_value: 2.0 * lowest, coverage: 0.1, rmse_mm: 15.0, ..good.clone() })),
            None
        );
        let far = misfit(Ok(Predictive { p_value: lowest, coverage: 0.1, rmse_mm: 15.0, ..good.clone() })).unwrap();
        assert!(far.contains("15.0 mm off") && far.contains("8 times") && far.contains("10 %"), "{far}");
        assert!(misfit(Ok(Predictive { rmse_mm: 2e6, half_width_mm: 1e6, ..good.clone() })).is_some());
        // Figures of a posterior after a few simulations.
        let wide = Predictive { rmse_mm: 150.0, half_width_mm: 90.0, coverage: 0.4, p_value: 0.09, ..good.clone() };
        assert_eq!(misfit(Ok(wide.clone())), None);
        assert!(misfit(Ok(Predictive { p_value: lowest, ..wide })).is_some());
        assert!(misfit(Ok(Predictive { rmse_mm: f64::NAN, ..good.clone() })).is_some());
        assert!(misfit(Err(Unchecked::NoDraw)).unwrap().contains("no draw"));
        assert_eq!(misfit(Err(Unchecked::NotPlaced)), None);
    }

    /// Figures of a model that fits, by 50 draws.
    fn good() -> Predictive {
        let part = |keypoint, third| Part {
            episode: 1,
            keypoint,
            third,
            times_s: [1.5, 2.25],
            rmse_mm: 41.0,
            coverage: 0.5,
            deviations: if keypoint == 4 && third == 3 { 3.0 } else { 1.0 },
        };
        let parts = vec![part(4, 2), part(4, 3)];
        let (rmse_mm, half_width_mm, spread_mm) = (1.0, 2.0, 100.0);
        Predictive { rmse_mm, coverage: 0.9, half_width_mm, spread_mm, p_value: 0.4, draws: 50, parts }
    }

    #[test]
    fn warnings_contain_their_numbers_and_the_worst_part() {
        let good = good();
        assert!(fit_warnings(Some((0.01, 500.0)), Some(&good)).is_empty());
        let bad = Predictive { coverage: 0.76, rmse_mm: 24.0, ..good.clone() };
        let words = fit_warnings(Some((0.8, 20.0)), Some(&bad));
        assert!(words.len() == 3, "{words:?}");
        for part in [
            "RMSE 24.0 mm, 76 % of the measured coordinates",
            "p = 0.400",
            "worst: keypoint 4 from the grip, 1.50 s to 2.25 s (third 3 of 3), RMSE 41.0 mm, 50 % in the band",
        ] {
            assert!(words[2].contains(part), "{part}: {words:?}");
        }
        let second = Part { episode: 2, deviations: 4.0, ..good.parts[0].clone() };
        let parts = [good.parts.clone(), vec![second]].concat();
        let words = fit_warnings(Some((0.01, 500.0)), Some(&Predictive { coverage: 0.7, parts, ..good.clone() }));
        assert!(words[0].contains("worst: recording 2, keypoint 4 from the grip"), "{words:?}");
        let foreign = Predictive { rmse_mm: 495.0, ..good };
        let words = fit_warnings(Some((0.01, 500.0)), Some(&foreign));
        assert!(words.len() == 1 && words[0].contains("495.0 mm") && words[0].contains("100.0 mm"), "{words:?}");
    }

    #[test]
    fn a_p_value_is_in_doubt_at_its_limit_or_at_the_least_that_the_draws_can_show() {
        let of = |p_value: f64, draws: usize| {
            fit_warnings(Some((0.01, 500.0)), Some(&Predictive { p_value, draws, ..good() })).join("; ")
        };
        assert_eq!(of(3.0 / 200.0, 199), "");
        assert!(of(2.0 / 200.0, 199).contains("p = 0.010"));
        assert!(of(1.0 / 200.0, 199).contains("p <= 0.005, the least that 199 draws can show"));
        // Draws that could not be simulated are missing from the number.
        assert!(of(1.0 / 41.0, 40).contains("p <= 0.024, the least that 40 draws can show"));
        assert_eq!(of(2.0 / 41.0, 40), "");
    }
}
