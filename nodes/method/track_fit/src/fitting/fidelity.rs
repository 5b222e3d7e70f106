//! Fidelity correction of a fit: the discretisation error of the coarse simulation, taken out at the best fit.

use super::excess::leaves_more_than_noise;
use super::multi_start::{fit_among_draws, search_further, search_within_noise};
use super::problem::{Fit, OnRound, Problem, Start};
use crate::data::MeasuredEpisode;
use crate::error::FitError;
use crate::settings::Settings;
use catenary_core::Fidelity;

/// Rounds of fidelity correction: correct at the best fit, fit again.
const REFINEMENTS: usize = 2;
/// Standard deviations of noise by which the corrected fit may be worse than the coarse one.
const WORSE_SDS: f64 = 3.0;

/// Discretisation error that is too large for a correction, in variances of the noise for each coordinate.
const TOO_COARSE: f64 = 0.2;

/// Fidelity correction of a fit: the error of the coarse simulation at the candidate model's own best fit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FidelityCorrection {
    /// Correction not tried yet.
    Untried,
    /// Correction applied.
    Applied,
    /// Correction rejected because the finer simulation does not fit, or not available.
    Rejected,
}

/// Fit with a fidelity correction, if one could be made.
pub struct CorrectedFit {
    /// Fitted episodes, with the correction.
    pub episodes: Vec<MeasuredEpisode>,
    /// Best fit.
    pub fit: Fit,
    /// State of the correction.
    pub correction: FidelityCorrection,
}

/// Cost for each residual, in variances of the noise, below which a fit lies far within the noise.
const WITHIN_NOISE: f64 = 0.5;

/// Best fit of the present model, from `known` points and draws, with its fidelity correction. Returns the rough fit early
/// if it already shows that the discretisation error is too large and there is a fallback fidelity.
///
/// # Errors
/// As [`Problem::best_of`].
pub fn calibrated(
    problem: &Problem<'_>,
    known: Vec<Vec<f64>>,
    settings: &Settings,
    on_round: OnRound<'_>,
) -> Result<CorrectedFit, FitError> {
    let rough = fit_among_draws(problem, known, settings, on_round)?;
    let Some(finer) = settings.finer_fidelity else {
        let fit = search_further(problem, rough, settings, on_round)?;
        return Ok(CorrectedFit { episodes: problem.episodes.to_vec(), fit, correction: FidelityCorrection::Rejected });
    };
    // A better coarse fit would be wasted if the fallback fidelity replaces it.
    if settings.fallback_fidelity.is_some() && leaves_more_than_noise(&rough) {
        let coarse = corrected_fit(problem, rough.clone(), finer, on_round)?;
        if coarse.is_too_coarse() {
            return Ok(coarse);
        }
    }
    let mut fit = search_further(problem, rough, settings, on_round)?;
    // A fit far within the noise says that the noise is stated too large, so that it cannot tell when to stop.
    if fit.cost < WITHIN_NOISE * fit.residuals.len() as f64 {
        fit = search_within_noise(problem, fit, settings, on_round)?;
    }
    corrected_fit(problem, fit, finer, on_round)
}

/// Corrects the simulations of the fitted episodes by simulations at `finer` fidelity at the best fit, and fits again,
/// from `fit` on. The correction is rejected if the corrected fit is worse by more than noise, or if the finer
/// simulation fails: near a fold the finer simulation may fold the object another way.
///
/// # Errors
/// [`FitError::Cancelled`] if `on_round` breaks.
pub fn corrected_fit(
    problem: &Problem<'_>,
    fit: Fit,
    finer: Fidelity,
    on_round: OnRound<'_>,
) -> Result<CorrectedFit, FitError> {
    let worst = fit.cost + WORSE_SDS * (2.0 * fit.residuals.len() as f64).sqrt();
    let mut best = CorrectedFit { episodes: problem.episodes.to_vec(), fit, correction: FidelityCorrection::Rejected };
    for _ in 0..REFINEMENTS {
        let next = match correction_round(problem, &best, finer, on_round) {
            Err(cancelled @ FitError::Cancelled) => return Err(cancelled),
            Err(_) => break,
            Ok(next) => next,
        };
        if next.fit.cost > worst {
            break;
        }
        best = next;
    }
    Ok(best)
}

impl CorrectedFit {
    /// Returns whether the discretisation error is too large for a correction: the correction was rejected, or it
    /// exceeds 20 % of the noise variance.
    pub fn is_too_coarse(&self) -> bool {
        let squares: f64 = self.episodes.iter().map(MeasuredEpisode::corrected_squares).sum();
        self.correction == FidelityCorrection::Rejected || squares > TOO_COARSE * self.fit.residuals.len() as f64
    }
}

/// Round of the fidelity correction.
fn correction_round(
    problem: &Problem<'_>,
    last: &CorrectedFit,
    finer: Fidelity,
    on_round: OnRound<'_>,
) -> Result<CorrectedFit, FitError> {
    let of = |episodes| Problem { episodes, unknowns: problem.unknowns.clone(), ..*problem };
    let episodes = of(&last.episodes).corrected_episodes(&last.fit.point, finer)?;
    let own = of(&episodes);
    // One start suffices: a correction moves the minimum only a little.
    let start = Start { point: last.fit.point.clone(), tracks: own.measured() };
    let fits = own.fit(vec![start], on_round)?.into_iter().flatten();
    let fit = fits.last().ok_or_else(|| FitError::NoFit("the refined fit failed".into()))?;
    Ok(CorrectedFit { episodes, fit, correction: FidelityCorrection::Applied })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fitting::best_fit;
    use crate::toy::twisted::coarse;
    use crate::toy::{self, Toy};
    use std::ops::ControlFlow;

    fn go_on() -> ControlFlow<()> {
        ControlFlow::Continue(())
    }

    fn rough(problem: &Problem<'_>) -> Fit {
        let settings = Settings { draws: 10, starts: 2, ..Settings::default() };
        best_fit(problem, Vec::new(), &settings, &mut go_on).unwrap()
    }

    /// Episode measured from a simulation with that discretisation error.
    fn measured_as(toy: &Toy, error: f64, theta: [f64; 2]) -> MeasuredEpisode {
        let mut episode = toy::episode(toy, theta, &[]);
        episode.measured.frames.iter_mut().flat_map(|f| f.dlo.iter_mut()).for_each(|p| p[0] += error * theta[0]);
        episode
    }

    #[test]
    fn a_corrected_fit_is_free_of_the_discretisation_error() {
        let (toy, theta) = (Toy { gain: 0.3 }, [0.25, 2e4]);
        let episodes = [toy::episode(&toy, theta, &[])];
        let error = 0.3;
        let simulator = coarse(toy, error);
        let problem = Problem::of(&toy::model(), &episodes, &simulator, 40);
        let rough = rough(&problem);
        let CorrectedFit { episodes: corrected, fit, correction } =
            corrected_fit(&problem, rough.clone(), Fidelity::Reference, &mut go_on).unwrap();
        assert_eq!(correction, FidelityCorrection::Applied);
        let apart = |fit: &Fit| (problem.unknowns.values(&fit.point, 0)[0] - theta[0]).abs();
        assert!(apart(&fit) < 0.1 * apart(&rough), "{} after {}", apart(&fit), apart(&rough));
        assert!(rough.cost > 10.0 && fit.cost < 0.1 * rough.cost, "{} after {}", fit.cost, rough.cost);
        let none = coarse(Toy { gain: 0.3 }, 0.0);
        let exact = Problem { simulator: &none, unknowns: problem.unknowns.clone(), ..problem };
        let track =
            |p: &Problem<'_>, episodes| Problem { episodes, unknowns: p.unknowns.clone(), ..*p }.tracks(&[&fit.point]);
        let there = |p: &Problem<'_>, episodes| track(p, episodes).unwrap()[0][0].frames[3].dlo[0][0];
        let left = (there(&problem, &corrected) - there(&exact, &episodes)).abs();
        assert!(left < 2e-2 * error * theta[0], "{left}");
    }

    #[test]
    fn a_correction_that_fits_worse_by_more_than_noise_is_rejected() {
        let coarse = coarse(Toy { gain: 0.3 }, 0.3);
        let episodes = [measured_as(&coarse.toy, 0.3, [0.25, 2e4])];
        let problem = Problem::of(&toy::model(), &episodes, &coarse, 40);
        let rough = rough(&problem);
        let CorrectedFit { episodes: same, fit, correction } =
            corrected_fit(&problem, rough.clone(), Fidelity::Reference, &mut go_on).unwrap();
        assert_eq!((&fit.point, fit.cost, correction), (&rough.point, rough.cost, FidelityCorrection::Rejected));
        let own = Problem { episodes: &same, unknowns: problem.unknowns.clone(), ..problem };
        assert_eq!(own.tracks(&[&fit.point]).unwrap(), problem.tracks(&[&fit.point]).unwrap());
    }

    #[test]
    fn a_correction_that_fits_worse_by_less_than_noise_is_applied() {
        let coarse = coarse(Toy { gain: 0.3 }, 2e-3);
        let episodes = [measured_as(&coarse.toy, 2e-3, [0.25, 2e4])];
        let problem = Problem::of(&toy::model(), &episodes, &coarse, 40);
        let rough = rough(&problem);
        let taken = corrected_fit(&problem, rough.clone(), Fidelity::Reference, &mut go_on).unwrap();
        assert!(
            taken.correction == FidelityCorrection::Applied && taken.fit.cost > rough.cost,
            "{} after {}",
            taken.fit.cost,
            rough.cost
        );
    }

    #[test]
    fn a_correction_is_rejected_if_the_finer_simulation_fails() {
        let toy = Toy { gain: 0.3 };
        let episodes = [toy::episode(&toy, [0.25, 2e4], &[])];
        let coarse = coarse(toy, f64::NAN);
        let problem = Problem::of(&toy::model(), &episodes, &coarse, 40);
        let exact = Toy { gain: 0.3 };
        let rough = rough(&Problem { simulator: &exact, unknowns: problem.unknowns.clone(), ..problem });
        let same = corrected_fit(&problem, rough.clone(), Fidelity::Reference, &mut go_on).unwrap();
        assert_eq!((same.fit.point, same.correction), (rough.point, FidelityCorrection::Rejected));
    }
}
