//! HTML page of an inference: values with their intervals, and the fit of the model to the recordings.

use super::predicted::{self, Predicted};
use crate::report::number::{millimetres, percent, plain};
use crate::report::plots::Series;
use crate::report::quantity::{Quantity, titled};
use crate::report::{Page, RecordedFit, plots, posterior};
use anyhow::Result;
use bayes_sim::diagnostics::Part;
use bayes_sim::prediction::undetermined;
use bayes_sim::{Predictive, Refinement};
use catenary_core::Posterior;
use catenary_core::posterior::Marginal;
use std::path::PathBuf;

/// Number of low-variance samples in the picture of two parameters.
const SAMPLES: usize = 12;

/// Contents of the page.
pub struct Contents<'a> {
    /// Name of the model.
    pub model: &'a str,
    /// Bags of the recordings.
    pub bags: &'a [PathBuf],
    /// Number of episodes, frames and seconds in words; empty if unknown.
    pub size: String,
    /// Posterior over the parameters.
    pub posterior: &'a Posterior,
    /// Marginals of the posterior.
    pub marginals: &'a [Marginal],
    /// Figures of the posterior predictive check, or the reason why there are none.
    pub predictive: Result<&'a Predictive, &'static str>,
    /// Reason why the result does not fit the recording.
    pub misfit: Option<&'a str>,
    /// Reasons for doubt.
    pub warnings: &'a [String],
    /// Held-out loss after each iteration, nat.
    pub losses: Vec<f64>,
    /// Total number of simulations.
    pub simulations: usize,
    /// Refinement of the networks' posterior; none if there was none, or nothing is known of it.
    pub refinement: Option<&'a Refinement>,
    /// Recordings with the model's keypoints at the medians; empty if there are none.
    pub fits: &'a [RecordedFit],
    /// Recordings that the inference has not seen, with their predictions; empty if none were asked for.
    pub predicted: &'a [Predicted],
}

/// Renders the whole page.
pub fn page(inferred: &Contents<'_>) -> Result<String> {
    let mut page = Page::new(&format!("Parameters of {} from the recording", inferred.model));
    page.answer(&answer(inferred), inferred.misfit.is_some() || is_refuted(inferred.predictive.ok()));
    let of_predictions = inferred.predicted.iter().flat_map(Predicted::named_warnings);
    let warnings = inferred.warnings.iter().map(|text| titled(text)).chain(of_predictions);
    page.warnings(&warnings.collect::<Vec<_>>());
    let bags: Vec<String> = inferred.bags.iter().map(|b| b.display().to_string()).collect();
    page.note(&format!("Measured: {}{}.", bags.join(", "), inferred.size));
    page.heading("Parameters");
    let posterior = inferred.posterior;
    page.table(&posterior::HEAD[..4], &posterior::rows(posterior, inferred.marginals, None));
    plots::marginals(posterior, None)?.iter().for_each(|svg| page.svg(svg));
    if !inferred.fits.is_empty() {
        page.heading("Recording and fit");
        page.note("Keypoints in the picture of the camera, at the medians of the posterior. The slider begins where they differ most.");
        inferred.fits.iter().for_each(|fit| page.svg(&fit.figure()));
    }
    if !inferred.predicted.is_empty() {
        page.heading("Recordings that the fit has not seen");
        page.table(&predicted::HEAD, &inferred.predicted.iter().map(Predicted::row).collect::<Vec<_>>());
        inferred.predicted.iter().filter_map(Predicted::sentence).for_each(|sentence| page.note(&sentence));
    }
    if posterior.parameters.dimension() > 1 {
        page.heading("Pairs of parameters");
        page.note("A slanted shape means that the recording determines a combination of the two better than either.");
        let samples = posterior.sample_low_variance(SAMPLES, 0)?;
        page.wide(&plots::corner(posterior, &samples, None)?);
    }
    page.heading("Inference");
    page.paragraph(&format!("{} simulations.", plain(inferred.simulations as f64, 0)));
    inferred.refinement.iter().for_each(|refinement| page.paragraph(&refined(refinement)));
    page.paragraph(&inferred.predictive.map_or_else(str::to_owned, predicted));
    if let Ok(p) = inferred.predictive {
        page.table(&PARTS, &parts(p));
        page.note("Keypoints are counted from the grip. The worst part is the farthest off in standard deviations of the predictions.");
    }
    if inferred.losses.len() > 1 {
        let points = inferred.losses.iter().enumerate().map(|(i, l)| (i as f64 + 1.0, *l)).collect();
        let series = [Series { name: "held-out loss".into(), points }];
        page.svg(&plots::lines("Held-out loss of the networks", "iteration", "nat", &series)?);
    }
    Ok(page.finish())
}

/// Answer in sentences. An objection to the values comes before them.
fn answer(inferred: &Contents<'_>) -> Vec<String> {
    let values = [values(inferred.marginals)].into_iter().chain(untold(inferred));
    if let Some(reason) = inferred.misfit {
        let objection = format!("The result does not fit the recording: {reason}. Do not rely on the values below.");
        return [objection].into_iter().chain(values).collect();
    }
    // Without the check there is no statement on the fit.
    let Ok(p) = inferred.predictive else { return values.collect() };
    let (rmse, share) = (millimetres(p.rmse_mm), percent(p.coverage));
    if is_refuted(inferred.predictive.ok()) {
        let objection = format!(
            // Ordered by urgency: a reader who stops after the first sentence must not rely on refuted values.
            "The model does not reproduce the recording: it is {rmse} mm off (root mean square), and {share} of the track \
             lies in the 90 % band of its predictions.{} Do not rely on the values below.",
            p.worst().map(|part| format!(" It is worst at {}.", place(p, part))).unwrap_or_default()
        );
        return [objection].into_iter().chain(values).collect();
    }
    let fit = format!(
        "The model with these values reproduces the recording within {rmse} mm (root mean square); {share} of the track lies \
         in the 90 % band of its predictions."
    );
    values.chain([fit]).collect()
}

/// True if the model cannot have made the recording, or predicts it worse than the keypoints' mean position does.
fn is_refuted(predictive: Option<&Predictive>) -> bool {
    predictive.is_some_and(|p| p.is_in_doubt() || p.rmse_mm > p.spread_mm)
}

/// Head of the table of parts.
const PARTS: [&str; 5] = ["keypoint and time", "RMSE, mm", "in the 90 % band", "off, standard deviations", ""];

/// Rows of the table of parts; the worst one is marked.
fn parts(p: &Predictive) -> Vec<Vec<String>> {
    let worst = p.worst();
    let row = |part: &Part| {
        let mark = if Some(part) == worst { "worst" } else { "" };
        let off = plain(part.deviations, 1);
        vec![place(p, part), millimetres(part.rmse_mm), percent(part.coverage), off, mark.to_owned()]
    };
    p.parts.iter().map(row).collect()
}

/// Keypoint and time of a part, and the recording if there are several.
fn place(p: &Predictive, part: &Part) -> String {
    let several = p.parts.iter().any(|other| other.episode != part.episode);
    let recording = if several { format!(" of recording {}", part.episode) } else { String::new() };
    let [from_s, to_s] = part.times_s;
    format!("keypoint {}{recording}, {} to {} s", part.keypoint, plain(from_s, 2), plain(to_s, 2))
}

/// Values with their intervals, in a sentence.
fn values(marginals: &[Marginal]) -> String {
    let estimate = |m: &Marginal| Quantity::of(&m.name).estimate(m.median, m.q05, m.q95);
    let clause = |(i, m): (usize, &Marginal)| match m.name.as_str() {
        // "The object is 261 mm long" reads better than "the object's length is".
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

/// Sentence on the parameters that the recording does not determine; `None` if it determines all.
fn untold(inferred: &Contents<'_>) -> Option<String> {
    let names: Vec<String> =
        undetermined(inferred.posterior, inferred.marginals).into_iter().map(|name| Quantity::of(name).title).collect();
    (!names.is_empty()).then(|| {
        format!("The recording does not determine the {}: the interval is that of the prior.", names.join(" and the "))
    })
}

/// Refinement in words.
fn refined(refinement: &Refinement) -> String {
    let best = millimetres(refinement.best_fit_rmse_mm);
    let networks = refinement.networks_rmse_mm.map_or_else(String::new, |rmse_mm| {
        format!(", where the posterior of the networks alone is {} mm off", millimetres(rmse_mm))
    });
    let minima = match refinement.modes {
        1 => "One minimum of the cost has the whole posterior".to_owned(),
        several => format!("{several} minima of the cost share the posterior"),
    };
    format!(
        "The posterior was refined with the simulator itself, in {} further simulations: the best fit is {best} mm off the \
         recording{networks}. {minima}.",
        plain(refinement.simulations as f64, 0)
    )
}

/// Posterior predictive check in words.
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

    fn inferred(p_value: Result<f64, &'static str>, check: impl FnOnce(&str)) {
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
        let part = |keypoint: usize| Part {
            episode: 1,
            keypoint,
            third: 3,
            times_s: [1.5, 2.25],
            rmse_mm: 12.4,
            coverage: 0.61,
            deviations: keypoint as f64,
        };
        let predictive = p_value.map(|p_value| Predictive {
            rmse_mm: 3.12,
            coverage: 0.928,
            half_width_mm: 4.0,
            spread_mm: 80.0,
            p_value,
            draws: 100,
            parts: [2, 4].map(part).to_vec(),
        });
        let page = page(&Contents {
            model: "soft_bar",
            bags: &["a.mcap".into()],
            size: ": one episode".into(),
            posterior: &posterior,
            marginals: &marginals,
            predictive: predictive.as_ref().map_err(|reason| *reason),
            misfit: None,
            warnings: &["doubtful".into()],
            losses: vec![3.0, 2.0],
            simulations: 12_000,
            refinement: None,
            fits: &[],
            predicted: &[],
        });
        check(&page.unwrap());
    }

    #[test]
    fn the_answer_is_in_words() {
        inferred(Ok(0.4), |page| {
            for words in [
                "The object is 261 mm long (254 to 267) and its Young&#39;s modulus is",
                "reproduces the recording within 3.1 mm (root mean square); 93 % of the track lies in the 90 % band",
                "does not determine the Young",
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
        inferred(Ok(0.01), |page| {
            assert!(page.contains("lead bad\"") && page.contains("Do not rely on the values below"), "{page}");
            assert!(page.contains("It is worst at keypoint 4, 1.50 to 2.25 s."), "{page}");
            let row = "<td>keypoint 4, 1.50 to 2.25 s</td><td>12</td><td>61 %</td><td>4.0</td><td>worst</td>";
            assert!(page.contains(row), "{page}");
        });
    }

    #[test]
    fn a_page_without_figures_of_the_check_gives_the_reason() {
        inferred(Err("No figures."), |page| {
            assert!(page.contains("<p>No figures.</p>") && page.contains("The object is 261 mm long"), "{page}");
            assert!(!page.contains("reproduces the recording") && !page.contains("lead bad\""), "{page}");
        });
    }
}
