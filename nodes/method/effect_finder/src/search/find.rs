//! Search for missing effects: calibrate, detect, localise, name, repair, verify.

use super::calibrate::{Calibration, calibrate};
use super::context::Search;
use super::explain::Explained;
use super::progress::{OnProgress, Reporter, Stage, Told};
use super::question::Question;
use crate::error::FinderError;
use crate::evidence::{Baseline, Detection, Effort, Hypothesis};
use crate::report::{
    Finding, Fitness, FurtherTest, Outcome, PressingValue, Verdict, VerdictEvidence, index_among_all, is_too_quiet,
    join, limits, localise, sentences, trade_offs,
};
use crate::settings::Settings;
use catenary_core::DifferentiableSimulator;
use catenary_core::track::spread_mm;
use track_fit::fitting::{CorrectedFit, FidelityCorrection, Fit, Problem};

/// Finds the disagreement between the model and the measured episodes, and the candidates that explain it. Equal
/// arguments give equal bits.
///
/// If the fitted episodes show no gap, but validation or held-out episodes contradict the model, these join the fitted
/// ones, and the search goes on as if they had been given so.
///
/// # Errors
/// [`FinderError`].
pub fn find(
    question: Question<'_>,
    simulator: &dyn DifferentiableSimulator,
    settings: &Settings,
    on_progress: OnProgress<'_>,
) -> Result<Outcome, FinderError> {
    settings.check()?;
    if question.measured.is_empty() {
        return Err(FinderError::NoEpisode);
    }
    let (mut joined, mut told): (Vec<FurtherTest>, _) = (Vec::new(), Told::default());
    // Each round but the last moves episodes to the fitted ones, so that the loop ends.
    loop {
        let [mut measured, mut validation, mut held_out] =
            [question.measured, question.validation, question.held_out].map(<[_]>::to_vec);
        join(&joined, &mut measured, &mut validation, &mut held_out);
        let own = Question { measured: &measured, validation: &validation, held_out: &held_out, ..question };
        let mut reporter = Reporter::new(&mut *on_progress, told);
        let Calibration { model, noise, present, validation, held_out } =
            calibrate(&own, simulator, settings, &mut reporter)?;
        let CorrectedFit { episodes, fit, correction } = present;
        let problem = Problem::of(&model, &episodes, simulator, settings.rounds);
        let search = Search {
            question: Question { model: &model, ..own },
            noise,
            problem: &problem,
            validation: &validation,
            held_out: &held_out,
            settings,
            reporter,
        };
        match search.run(fit, correction)? {
            Ended::Found(mut outcome) => {
                outcome.finding.judge(spread_mm(measured.iter().map(|m| &m.track), &question.model.camera.view));
                outcome.finding.joined = joined;
                return Ok(*outcome);
            }
            Ended::Unlike(unlike, so_far) => {
                let among_all = |t: FurtherTest| {
                    let index = index_among_all(t.index, t.is_held_out, &joined);
                    FurtherTest { index, ..t }
                };
                let unlike: Vec<FurtherTest> = unlike.into_iter().map(among_all).collect();
                joined.extend(unlike);
                told = so_far;
            }
        }
    }
}

/// End of a pass through the stages.
enum Ended {
    /// Outcome of the search.
    Found(Box<Outcome>),
    /// Episodes that contradict a present model with which the fitted ones agree, and what was told until then.
    Unlike(Vec<FurtherTest>, Told),
}

/// Present model with its test on the fitted episodes.
struct Tested {
    base: Hypothesis,
    baseline: Baseline,
    detection: Detection,
    fitness: Fitness,
    pressing: Vec<String>,
    pressing_values: Vec<PressingValue>,
    is_gap: bool,
}

impl Search<'_> {
    /// Tests the present model at its best fit, and explains its residual.
    fn run(mut self, fit: Fit, correction: FidelityCorrection) -> Result<Ended, FinderError> {
        let tested = self.test_present(fit, correction)?;
        // A gap of the fitted episodes is explained first; the other ones then choose between explanations.
        let further = if tested.is_gap { Vec::new() } else { self.test_further(&tested.base)? };
        let unlike = self.contradicting(&further)?;
        if !unlike.is_empty() {
            return Ok(Ended::Unlike(unlike, self.reporter.into_told()));
        }
        let outcome = self.explain_tested(tested, further.iter().map(|t| t.p_value).collect())?;
        Ok(Ended::Found(Box::new(outcome)))
    }

    /// Tests the present model on the fitted episodes.
    fn test_present(&mut self, fit: Fit, correction: FidelityCorrection) -> Result<Tested, FinderError> {
        let agreement = self.agreement(self.problem, &fit)?;
        self.reporter.conclude(Stage::Calibrate, sentences::fitted(&agreement.estimates, agreement.rmse_mm))?;
        let (pressing, pressing_values) = (self.pressing(&fit), self.pressing_values(&fit));
        let detection = self.detect(self.problem, &fit, 0, Stage::Detect)?;
        let fitness = agreement.with(&detection);
        let is_gap = fitness.test.p_value <= self.settings.level;
        self.reporter.conclude(Stage::Detect, sentences::detected(&fitness, is_gap))?;
        let baseline = Baseline::new(self.problem.episodes, &fit).ok_or_else(FinderError::curvature)?;
        let base = Hypothesis {
            candidates: Vec::new(),
            unknowns: self.problem.unknowns.clone(),
            fit,
            evidence: baseline.evidence().clone(),
            episodes: None,
            correction,
            effort: Effort::Searched,
            spread: Vec::new(),
        };
        Ok(Tested { base, baseline, detection, fitness, pressing, pressing_values, is_gap })
    }

    /// Explains the residual of the tested model. `further` are its p-values on validation and held-out episodes.
    fn explain_tested(mut self, tested: Tested, further: Vec<f64>) -> Result<Outcome, FinderError> {
        let Tested { base, baseline, detection, fitness, pressing, pressing_values, is_gap } = tested;
        let p_value = fitness.test.p_value;
        let places = localise(&base.fit, &self.problem.channels(), &detection);
        let mut outcome = Outcome {
            finding: Finding::without_gap(fitness, places, pressing),
            model: None,
            nearest: None,
            shown: Vec::new(),
        };
        outcome.finding.pressing_values = pressing_values;
        outcome.finding.noise = Some(self.noise);
        outcome.finding.noise_doubt =
            self.noise.doubt().or_else(|| sentences::noise_doubt(&outcome.finding.present.test));
        if let Some(doubt) = &outcome.finding.noise_doubt {
            self.reporter.conclude(Stage::Detect, format!("warning: {doubt}"))?;
        }
        let (problem, candidates) = (self.problem, self.question.candidates);
        // Limits are reported with every finding, with and without a gap.
        outcome.finding.limits = self
            .reporter
            .with_progress(Stage::Localise, |on_round| limits(problem, &base.fit, candidates, on_round))?;
        let mut closes_beyond_prior = false;
        if is_gap {
            let names: Vec<&str> = self.question.measured.iter().map(|m| m.name.as_str()).collect();
            self.reporter
                .conclude(Stage::Localise, sentences::located(&outcome.finding.places, self.settings.level, &names))?;
            closes_beyond_prior = self.closes_with_open_priors(&base.fit, &outcome.finding, &detection)?;
        }
        let at_bound = outcome.finding.pressing_in_words();
        // A prior that is too narrow is told already.
        if !at_bound.is_empty() && !closes_beyond_prior {
            self.reporter.conclude(Stage::Localise, sentences::at_bound(&at_bound))?;
        }
        let Explained { repair, best } = if is_gap {
            self.explain(&base, &baseline, &mut outcome)?
        } else {
            // Without a gap the estimates of the present model are the result, and hold with these doubts.
            outcome.finding.trade_offs = trade_offs(&base);
            for trade_off in &outcome.finding.trade_offs {
                self.reporter.conclude(Stage::Localise, sentences::traded(trade_off))?;
            }
            outcome.shown = self.bands(&base, None)?;
            Explained { repair: None, best: None }
        };
        let test = &outcome.finding.present.test;
        let is_blind = self.noise.is_unknown || is_too_quiet(test);
        let hidden_gap_mm = is_blind.then(|| self.hidden_gap_mm(test)).flatten();
        let evidence = VerdictEvidence { p_value, further, is_blind, closes_beyond_prior, repair };
        outcome.finding.conclude(&evidence, self.settings);
        if outcome.finding.verdict == Verdict::CannotSee {
            outcome.finding.hidden_gap_mm = hidden_gap_mm;
            self.reporter.conclude(Stage::Detect, sentences::unseen(hidden_gap_mm))?;
        }
        if outcome.finding.verdict == Verdict::PriorTooNarrow {
            (outcome.model, outcome.nearest) = (None, None);
            self.reporter.conclude(Stage::Repair, sentences::at_the_edge(&outcome.finding))?;
        }
        if outcome.finding.verdict == Verdict::NoneOfThese {
            outcome.finding.missing = self.missing(best.as_ref().unwrap_or(&base), &baseline)?;
        }
        outcome.finding.conclusions = self.reporter.into_conclusions();
        Ok(outcome)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::{Verdict, sentences};
    use catenary_core::episode::MeasuredTrack;
    use catenary_core::simulator::{SimulatorError, TrackSensitivities};
    use catenary_core::{Fidelity, ParameterSpace, Prior, SimulationRequest, Simulator, Track, seed};
    use std::ops::ControlFlow;
    use track_fit::data::Candidate;
    use track_fit::toy::twisted::coarse;
    use track_fit::toy::{self, Toy};

    const MASS: &str = "tip_mass_kg";
    const DRAG: &str = "linear_drag_n_s_m2";
    const TOY: Toy = Toy { gain: 3.0 };

    /// The measurement holds the error of the coarse simulation, which hides a gap. It has none of the stated noise, so that nothing is
    /// seen then.
    #[test]
    fn a_large_discretisation_error_selects_the_fallback_fidelity() {
        let (theta, error) = ([0.25, 2e4], 0.3);
        let simulator = coarse(Toy { gain: 0.3 }, error);
        let mut measured = [toy::measured(&simulator.toy, theta, &[])];
        let points = measured[0].track.frames.iter_mut().flat_map(|f| f.dlo.iter_mut());
        points.for_each(|p| p[0] += error * theta[0]);
        let model = toy::model();
        let found = |fallback_fidelity: Option<Fidelity>| {
            let question = Question::of(&model, &measured);
            let settings = Settings { fallback_fidelity, draws: 40, starts: 2, null_sets: 19, ..Settings::default() };
            find(question, &simulator, &settings, &mut |_| ControlFlow::Continue(())).unwrap().finding.verdict
        };
        assert_eq!([None, Some(Fidelity::FineMesh)].map(found), [Verdict::CannotSee, Verdict::NoneOfThese]);
    }

    /// The first fit shows it, and the search for a better one is left to the fallback fidelity. The measurement has none of the
    /// stated noise.
    #[test]
    fn the_fallback_fidelity_closes_a_gap_of_the_discretisation() {
        let (theta, simulator) = ([0.25, 2e4], coarse(Toy { gain: 0.3 }, 0.3));
        let measured = [toy::measured(&simulator.toy, theta, &[])];
        let model = toy::model();
        let question = Question::of(&model, &measured);
        let settings = Settings {
            fallback_fidelity: Some(Fidelity::FineMesh),
            draws: 40,
            starts: 2,
            null_sets: 19,
            ..Settings::default()
        };
        let found = find(question, &simulator, &settings, &mut |_| ControlFlow::Continue(())).unwrap().finding;
        assert_eq!(
            (found.verdict, found.conclusions[0].clone()),
            (Verdict::CannotSee, sentences::finer(Fidelity::FineMesh))
        );
    }

    /// Toy in which the parameters act only by the quotient of the second and the first.
    struct Quotient(Toy);

    impl Quotient {
        const LENGTH_M: f64 = 0.25;

        fn plain(request: &SimulationRequest) -> SimulationRequest {
            let mut plain = request.clone();
            plain.thetas.iter_mut().for_each(|t| *t = vec![Self::LENGTH_M, t[1] / t[0] * Self::LENGTH_M]);
            plain
        }
    }

    impl Simulator for Quotient {
        fn simulate(&self, request: &SimulationRequest) -> Result<Vec<Track>, SimulatorError> {
            self.0.simulate(&Self::plain(request))
        }
    }

    impl DifferentiableSimulator for Quotient {
        fn sensitivities(
            &self,
            request: &SimulationRequest,
            names: &[&str],
        ) -> Result<Vec<TrackSensitivities>, SimulatorError> {
            let by_quotient = vec!["youngs_modulus_pa"; names.len()];
            let mut all = self.0.sensitivities(&Self::plain(request), &by_quotient)?;
            for (one, theta) in all.iter_mut().zip(&request.thetas) {
                for (name, frames) in names.iter().zip(&mut one.derivatives) {
                    let factor = match *name {
                        "length_m" => -theta[1] / theta[0].powi(2) * Self::LENGTH_M,
                        _ => Self::LENGTH_M / theta[0],
                    };
                    frames.iter_mut().flat_map(|by| by.dlo.iter_mut().flatten()).for_each(|v| *v *= factor);
                }
            }
            Ok(all)
        }
    }

    #[test]
    fn parameters_that_act_only_by_their_quotient_are_told_without_a_gap() {
        let (mut model, simulator) = (toy::model(), Quotient(TOY));
        let mut parameters = model.theta.parameters().to_vec();
        parameters[0].prior = Prior::LogUniform { low: 0.2, high: 0.3 };
        model.theta = ParameterSpace::new(parameters).unwrap();
        let found = |simulator: &dyn DifferentiableSimulator| {
            let noisy = toy::episode(&TOY, [0.25, 2e4], &[]).measured_anew(&mut seed::rng(81, 0));
            let measured = [MeasuredTrack { track: noisy.measured, ..toy::measured(&TOY, [0.25, 2e4], &[]) }];
            let settings =
                Settings { finer_fidelity: None, draws: 40, starts: 2, null_sets: 99, ..Settings::default() };
            let question = Question::of(&model, &measured);
            find(question, simulator, &settings, &mut |_| ControlFlow::Continue(())).unwrap().finding
        };
        let finding = found(&simulator);
        let [one] = finding.trade_offs.try_into().unwrap();
        let combination = one.combination.clone().unwrap();
        assert_eq!((finding.verdict, combination.exponent), (Verdict::NoGap, -1.0), "{one:?}");
        assert!(combination.relative_sd < 0.02 && combination.alone.iter().all(|sd| *sd > 0.05), "{one:?}");
        let told = "the recordings determine length_m / youngs_modulus_pa to ";
        assert!(finding.conclusions.iter().any(|s| s.starts_with(told)), "{:?}", finding.conclusions);
        assert_eq!(found(&simulator.0).trade_offs, [], "each acts by itself");
    }

    /// Search in data of an object with the `hidden` effects. The tip mass ends at 0.03, the drag at `most`, with a
    /// prior up to `expected`. Validation episodes have the effects `validation_effects`.
    fn with_limits(
        hidden: &[(&str, f64)],
        validation_effects: &[&[(&str, f64)]],
        [expected, most]: [f64; 2],
    ) -> Outcome {
        let (simulator, model) = (Toy { gain: 3.0 }, toy::model());
        let candidate = |name: &str, high: f64, most: f64| Candidate {
            name: name.into(),
            title: name.into(),
            prior: Prior::LogUniform { low: 1e-3, high },
            range: [0.0, most],
            base: 0.0,
            odds: 1.0,
            companions: Vec::new(),
        };
        let candidates = [candidate(MASS, 0.02, 0.03), candidate(DRAG, expected, most)];
        let theta = [0.25, 2e4];
        let measured = |(stream, effects): (u64, &[(&str, f64)])| {
            let noisy = toy::episode(&simulator, theta, effects).measured_anew(&mut seed::rng(9, stream));
            MeasuredTrack { track: noisy.measured, ..toy::measured(&simulator, theta, effects) }
        };
        let fitted = [measured((0, hidden))];
        let validation: Vec<MeasuredTrack> = (1..).zip(validation_effects.iter().copied()).map(measured).collect();
        let question = Question { validation: &validation, candidates: &candidates, ..Question::of(&model, &fitted) };
        let settings = Settings {
            fallback_fidelity: None,
            finer_fidelity: None,
            draws: 40,
            starts: 2,
            null_sets: 99,
            ..Settings::default()
        };
        find(question, &simulator, &settings, &mut |_| ControlFlow::Continue(())).unwrap()
    }

    fn nearest(name: &str) -> (Verdict, Vec<Vec<String>>) {
        (Verdict::NoneOfThese, vec![vec![name.to_owned()]])
    }

    /// The drag lies beyond its prior. Either its range ends at 0.04, or only the search does, at 0.06.
    #[test]
    fn an_effect_beyond_its_prior_is_a_stand_in() {
        let found = |most: f64| with_limits(&[(DRAG, 0.08)], &[], [0.02, most]).finding;
        let (limited, open) = (found(0.04), found(1e3));
        assert_eq!((limited.verdict, limited.found.len()), (Verdict::NoneOfThese, 0));
        let is_told =
            |s: &String| s.contains("linear_drag_n_s_m2 would have to be 0.04000, beyond its prior of 0 to 0.02000");
        assert!(limited.conclusions.last().is_some_and(is_told), "{:?}", limited.conclusions);
        assert!(limited.probability_of_unknown == 1.0 && limited.repaired.is_some());
        assert_eq!((limited.stand_ins[0].name.as_str(), limited.stand_ins[0].value), (DRAG, 0.04));
        assert_eq!((open.verdict, open.found.len()), (Verdict::NoneOfThese, 0));
        assert!(open.stand_ins.iter().any(|s| s.name == DRAG && s.value > 0.02), "{:?}", open.stand_ins);
    }

    #[test]
    fn a_stand_in_that_leaves_a_validation_residual_is_not_named() {
        let found = |prior: f64| with_limits(&[(DRAG, 0.0403)], &[&[(DRAG, 0.05)]], [prior, 0.04]).finding;
        let (limited, open) = (found(0.0399), found(0.04));
        assert!(limited.repaired.as_ref().is_some_and(|r| r.test.p_value > 0.05), "the fitted episode is closed");
        assert!(limited.verification.as_ref().is_some_and(|v| v.p_value.is_some_and(|p| p <= 0.01)));
        assert_eq!((limited.verdict, limited.found.len()), (Verdict::NoneOfThese, 0));
        assert_eq!((open.verdict, open.nearest), nearest(DRAG), "its prior reaches to the end of its range");
    }

    #[test]
    fn a_stand_in_is_not_added_to_the_named_effects() {
        let hidden = [(DRAG, 0.05), (MASS, 0.04)];
        let outcome = with_limits(&hidden, &[&hidden], [0.1, 1e3]);
        let (found, model) = (outcome.finding, outcome.nearest.unwrap());
        let told = "tip_mass_kg would have to be 0.03000, beyond its prior of 0 to 0.02000: it is not added";
        assert!(found.conclusions.iter().any(|s| s.contains(told)), "{:?}", found.conclusions);
        assert!(model.theta.index_of(DRAG).is_some() && model.theta.index_of(MASS).is_none());
        assert_eq!(found.explanations[0].names(), DRAG);
        assert_eq!((found.verdict, found.nearest), nearest(DRAG));
    }
}
