//! Episodes of a refinement: with the noise that is used, and with the discretisation error taken out.

use catenary_core::episode::MeasuredTrack;
use catenary_core::{Fidelity, Model};
use track_fit::FitError;
use track_fit::data::MeasuredEpisode;
use track_fit::fitting::{FidelityCorrection, Fit, OnRound, Problem, Start, corrected_fit, wrench_inflation};
use track_fit::noise::KeypointNoise;

/// Episodes with the noise that is used.
pub(super) fn episodes_with(
    model: &Model,
    noise: KeypointNoise,
    measured: &[MeasuredTrack],
    of_fits: &track_fit::Settings,
) -> Result<Vec<MeasuredEpisode>, FitError> {
    let model = noise.model(model);
    measured.iter().map(|m| MeasuredEpisode::new(&model, m, of_fits)).collect()
}

/// Episodes and modes with the discretisation error at the best mode taken out, and true if it could be. The correction
/// serves all modes: it changes little between them.
pub(super) fn corrected(
    problem: &Problem<'_>,
    modes: Vec<Fit>,
    finer: Option<Fidelity>,
    on_round: OnRound<'_>,
) -> Result<(Vec<MeasuredEpisode>, Vec<Fit>, bool), FitError> {
    let uncorrected = |modes| (problem.episodes.to_vec(), modes, false);
    let Some(finer) = finer else { return Ok(uncorrected(modes)) };
    let best = corrected_fit(problem, modes[0].clone(), finer, on_round)?;
    if best.correction != FidelityCorrection::Applied {
        return Ok(uncorrected(modes));
    }
    let own = Problem { episodes: &best.episodes, unknowns: problem.unknowns.clone(), ..*problem };
    let start = |fit: &Fit| Start { point: fit.point.clone(), tracks: own.measured() };
    let mut all = vec![best.fit];
    if modes.len() > 1 {
        // A further mode that the correction makes impossible is lost alone.
        let further = match own.fit(modes[1..].iter().map(start).collect(), on_round) {
            Err(FitError::NoFit(_)) => Vec::new(),
            fits => fits?,
        };
        for fit in further.into_iter().flatten() {
            if all.iter().all(|known: &Fit| own.unknowns.are_apart(&known.point, &fit.point)) {
                all.push(fit);
            }
        }
        all.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    }
    Ok((best.episodes, all, true))
}

/// Episodes and modes with the noise of the wrench that the best mode leaves, and that in variances of the stated noise: 1 if it leaves no more.
pub(super) fn at_wrench_noise(
    problem: &Problem<'_>,
    (episodes, modes): (Vec<MeasuredEpisode>, Vec<Fit>),
    on_round: OnRound<'_>,
) -> Result<(Vec<MeasuredEpisode>, Vec<Fit>, f64), FitError> {
    let of = |episodes| Problem { episodes, unknowns: problem.unknowns.clone(), ..*problem };
    let inflation = wrench_inflation(&modes[0], &of(&episodes).channels());
    if inflation == 1.0 {
        return Ok((episodes, modes, inflation));
    }
    let wider: Vec<MeasuredEpisode> = episodes.iter().map(|e| e.with_wrench_variance(inflation)).collect();
    let own = of(&wider);
    let start = |fit: &Fit| Start { point: fit.point.clone(), tracks: own.measured() };
    let fits = own.fit(modes.iter().map(start).collect(), on_round)?;
    let mut again: Vec<Fit> = fits.into_iter().flatten().collect();
    again.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    if again.is_empty() { Ok((episodes, modes, 1.0)) } else { Ok((wider, again, inflation)) }
}
