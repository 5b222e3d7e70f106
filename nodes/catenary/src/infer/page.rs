//! The page of an inference: values with their intervals, and how well the model reproduces the recordings.

use crate::report::Page;
use crate::report::number::{millimetres, percent, plain};
use crate::report::plots::{self, Extent, Series};
use crate::report::posterior;
use crate::report::quantity::Quantity;
use anyhow::Result;
use bayes_sim::Predictive;
use catenary_core::Posterior;
use catenary_core::posterior::Marginal;
use std::path::PathBuf;

/// Low-variance samples in a picture of two parameters.
const SAMPLES: usize = 12;
/// p-value of the predictive check, and share of the track in the 90 % band, at and under which the model cannot have made the
/// recording. The warnings of the inference have the same limits.
const IMPROBABLE: f64 = 0.02;
const LOW_COVERAGE: f64 = 0.6;
/// Share of the prior's interval that the posterior's must be under, or the recording told nothing of the parameter.
const TOLD: f64 = 0.9;

/// Contents of the page.
pub struct Inferred<'a> {
    /// Name of the model.
    pub model: &'a str,
    /// The recordings.
    pub bags: &'a [PathBuf],
    /// Episodes, frames and seconds in words; empty where nobody counted.
    pub size: String,
    /// The posterior.
    pub posterior: &'a Posterior,
    /// Its marginals.
    pub marginals: &'a [Marginal],
    /// Check of the posterior's predictions; none where it was not made.
    pub predictive: Option<&'a Predictive>,
    /// Reason why the result fits nothing of the recording.
    pub misfit: Option<&'a str>,
    /// Reasons for doubt.
    pub warnings: &'a [String],
    /// Held-out loss after each iteration, nat.
    pub losses: Vec<f64>,
    /// Simulations in all.
    pub simulations: usize,
}

/// The whole page.
pub fn page(inferred: &Inferred<'_>) -> Result<String> {
    let mut page = Page::new(&format!("What the recording says of {}", inferred.model));
    page.answer(&answer(inferred), inferred.misfit.is_some() || is_refuted(inferred.predictive));
    inferred.warnings.iter().for_each(|w| page.warning(w));
    let bags: Vec<String> = inferred.bags.iter().map(|b| b.display().to_string()).collect();
    page.note(&format!("Measured: {}{}.", bags.join(", "), inferred.size));
    page.heading("Parameters");
    let posterior = inferred.posterior;
    page.table(&posterior::HEAD[..4], &posterior::rows(posterior, inferred.marginals, None));
    plots::marginals(posterior, None)?.iter().for_each(|svg| page.svg(svg));
    let d = posterior.parameters.dimension();
    if d > 1 {
        page.heading("Pairs of parameters");
        page.note("A slanted shape says that the recording tells a combination of the two better than either.");
        let samples = posterior.sample_low_variance(SAMPLES, 0)?;
        for (i, j) in (0..d).flat_map(|i| (i + 1..d).map(move |j| (i, j))) {
            page.svg(&plots::heatmap(posterior, [i, j], Extent::Prior, &samples, None)?);
            if d == 2 {
                page.svg(&plots::heatmap(posterior, [i, j], Extent::Posterior, &samples, None)?);
            }
        }
    }
    page.heading("How it was found");
    page.paragraph(&format!("{} simulations.", plain(inferred.simulations as f64, 0)));
    if let Some(p) = inferred.predictive {
        page.paragraph(&predicted(p));
    }
    if inferred.losses.len() > 1 {
        let points = inferred.losses.iter().enumerate().map(|(i, l)| (i as f64 + 1.0, *l)).collect();
        let series = [Series { name: "held-out loss".into(), points }];
        page.svg(&plots::lines("Held-out loss of the networks", "iteration", "nat", &series)?);
    }
    Ok(page.finish())
}

/// The answer in sentences; that the values cannot be relied on comes before them.
fn answer(inferred: &Inferred<'_>) -> Vec<String> {
    let values = [values(inferred.marginals)].into_iter().chain(untold(inferred));
    if let Some(reason) = inferred.misfit {
        let objection = format!("The result does not fit the recording: {reason}. Do not rely on the values below.");
        return [objection].into_iter().chain(values).collect();
    }
    let Some(p) = inferred.predictive else { return values.collect() };
    let (rmse, share) = (millimetres(p.rmse_mm), percent(p.coverage));
    if is_refuted(inferred.predictive) {
        let objection = format!(
            "The model does not reproduce the recording: it is {rmse} mm off (root mean square), and {share} of the track \
             lies in the 90 % band of its predictions. Do not rely on the values below."
        );
        return [objection].into_iter().chain(values).collect();
    }
    let fit = format!(
        "The model with these values reproduces the recording within {rmse} mm (root mean square); {share} of the track lies \
         in the 90 % band of its predictions."
    );
    values.chain([fit]).collect()
}

/// Whether the model cannot have made the recording, or predicts it no better than its own middle does.
fn is_refuted(predictive: Option<&Predictive>) -> bool {
    predictive.is_some_and(|p| p.p_value <= IMPROBABLE || p.coverage < LOW_COVERAGE || p.rmse_mm > p.spread_mm)
}

/// Values with their intervals, in a sentence.
fn values(marginals: &[Marginal]) -> String {
    let estimate = |m: &Marginal| Quantity::of(&m.name).estimate(m.median, m.q05, m.q95);
    let clause = |(i, m): (usize, &Marginal)| match m.name.as_str() {
        "length_m" if i == 0 => {
            let words = estimate(m);
            let (value, interval) = words.split_once(" (").unwrap_or((&words, ""));
            format!("The object is {value} long ({interval}")
        }
        _ if i == 0 => format!("The object's {} is {}", Quantity::of(&m.name).title, estimate(m)),
        _ => format!("its {} is {}", Quantity::of(&m.name).title, estimate(m)),
    };
    let clauses: Vec<String> = marginals.iter().enumerate().map(clause).collect();
    match clauses.split_last() {
        None => "Nothing was inferred.".into(),
        Some((only, [])) => format!("{only}; the interval holds it with a probability of 90 %."),
        Some((last, rest)) => {
            format!("{} and {last}; each interval holds its value with a probability of 90 %.", rest.join(", "))
        }
    }
}

/// Parameters of which the recording tells next to nothing; none where it tells of all.
fn untold(inferred: &Inferred<'_>) -> Option<String> {
    let is_untold = |m: &&Marginal| {
        let space = &inferred.posterior.parameters;
        let prior = space.index_of(&m.name).map(|i| &space.parameters()[i].prior);
        prior.is_some_and(|p| p.to_unit(m.q95) - p.to_unit(m.q05) > TOLD * 0.9)
    };
    let names: Vec<String> = inferred.marginals.iter().filter(is_untold).map(|m| Quantity::of(&m.name).title).collect();
    (!names.is_empty()).then(|| {
        format!(
            "The recording says next to nothing of the {}: the interval is that of the prior.",
            names.join(" and the ")
        )
    })
}

/// Check of the posterior's predictions in words.
fn predicted(p: &Predictive) -> String {
    format!(
        "Predictions of the posterior: {} mm from the recording (root mean square), where their 90 % band is ± {} mm wide and \
         the keypoints lie {} mm from their own middle. A share of {} of simulated recordings lies at least as far off (p of \
         the predictive check, {} draws).",
        millimetres(p.rmse_mm),
        millimetres(p.half_width_mm),
        millimetres(p.spread_mm),
        percent(p.p_value),
        p.draws
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use catenary_core::{Parameter, ParameterSpace, Prior};

    fn inferred(p_value: f64, check: impl FnOnce(&str)) {
        let parameter = |name: &str, prior| Parameter { name: name.into(), prior };
        let space = ParameterSpace::new(vec![
            parameter("length_m", Prior::Uniform { low: 0.2, high: 0.3 }),
            parameter("youngs_modulus_pa", Prior::LogUniform { low: 1e3, high: 5e4 }),
        ]);
        let posterior = Posterior::prior(space.unwrap());
        let marginal =
            |name: &str, q05, median, q95| Marginal { name: name.into(), mean: median, sd: 1.0, q05, median, q95 };
        let marginals =
            [marginal("length_m", 0.2541, 0.2607, 0.2671), marginal("youngs_modulus_pa", 1.1e3, 7.1e3, 4.6e4)];
        let predictive =
            Predictive { rmse_mm: 3.12, coverage: 0.928, half_width_mm: 4.0, spread_mm: 80.0, p_value, draws: 100 };
        let page = page(&Inferred {
            model: "soft_bar",
            bags: &["a.mcap".into()],
            size: ": one episode".into(),
            posterior: &posterior,
            marginals: &marginals,
            predictive: Some(&predictive),
            misfit: None,
            warnings: &["doubtful".into()],
            losses: vec![3.0, 2.0],
            simulations: 12_000,
        });
        check(&page.unwrap());
    }

    #[test]
    fn the_answer_is_in_words() {
        inferred(0.4, |page| {
            for words in [
                "The object is 261 mm long (254 to 267) and its Young&#39;s modulus is",
                "reproduces the recording within 3.1 mm (root mean square); 93 % of the track lies in the 90 % band",
                "says next to nothing of the Young",
                "<td>200 to 300 mm</td>",
                "12 000 simulations",
            ] {
                let words = words.replace("&#39;", "'");
                assert!(page.contains(&words), "{words}: {page}");
            }
            assert!(!page.contains("length_m") && !page.contains("lead bad\""), "{page}");
        });
    }

    #[test]
    fn a_model_that_cannot_make_the_recording_is_no_answer() {
        inferred(0.01, |page| {
            assert!(page.contains("lead bad\"") && page.contains("Do not rely on the values below"), "{page}");
        });
    }
}
