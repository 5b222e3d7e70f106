//! The whole search: calibrate, detect, localise, name, repair, again, verify.

mod contenders;
mod in_part;
mod naming;
mod unseen;

use naming::{Best, Named};
use unseen::{Looked, Refusal};

use crate::calibrate::{
    Agreement, Refined, best_fit, fit_among_draws, leaves_more_than_noise, looked_further, refined,
};
use crate::candidate::Candidate;
use crate::case::Case;
use crate::detect::{Detection, detect};
use crate::detectable::limits;
use crate::error::FinderError;
use crate::evidence::Yardstick;
use crate::fit::{Fit, OnRound, Problem, presses};
use crate::hypothesis::{Depth, Grain, Hypothesis};
use crate::laplace::Laplace;
use crate::localise;
use crate::name::groups;
use crate::outcome::{self, Outcome, Shown};
use crate::repair::repaired;
use crate::sentences;
use crate::separate::{Separation, separate};
use crate::settings::Settings;
use crate::trade_off::trade_offs;
use crate::verdict::{Finding, Verdict};
use catenary_core::episode::MeasuredTrack;
use catenary_core::track::spread_mm;
use catenary_core::{DifferentiableSimulator, Model};
use std::ops::ControlFlow;

/// A stage of the search.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    /// The present model is fitted.
    Calibrate,
    /// What is left is tested against noise.
    Detect,
    /// Where it lies.
    Localise,
    /// Which effects explain it.
    Name,
    /// The model with those effects is tested.
    Repair,
    /// It is held against episodes that no fit has seen.
    Verify,
}

impl Stage {
    /// Its name, a verb.
    pub fn name(self) -> &'static str {
        match self {
            Stage::Calibrate => "calibrate",
            Stage::Detect => "detect",
            Stage::Localise => "localise",
            Stage::Name => "name",
            Stage::Repair => "repair",
            Stage::Verify => "verify",
        }
    }

    /// Shares of the whole search after which the stage begins and ends, roughly.
    fn span(self) -> [f64; 2] {
        match self {
            Stage::Calibrate => [0.0, 0.05],
            Stage::Detect => [0.05, 0.3],
            Stage::Localise => [0.3, 0.3],
            Stage::Name => [0.3, 0.65],
            Stage::Repair => [0.65, 0.9],
            Stage::Verify => [0.9, 1.0],
        }
    }
}

/// How far a search is.
#[derive(Debug, Clone, PartialEq)]
pub struct Progress {
    /// The present stage.
    pub stage: Stage,
    /// Share of the whole search that is done, roughly; it falls back where the search begins again with other effects.
    pub progress: f64,
    /// What the stage came to, once it has come to it.
    pub conclusion: Option<String>,
}

/// Told of progress; says whether to go on.
pub type OnProgress<'a> = &'a mut dyn FnMut(&Progress) -> ControlFlow<()>;

/// What is asked.
#[derive(Clone, Copy)]
pub struct Question<'a> {
    /// The present model.
    pub model: &'a Model,
    /// Episodes that models are fitted to.
    pub measured: &'a [MeasuredTrack],
    /// Episodes that no fit sees, by which a repair is judged; may be none.
    pub held_out: &'a [MeasuredTrack],
    /// What the model may lack.
    pub candidates: &'a [Candidate],
}

/// Finds where the model and the measured episodes disagree, and which candidates explain it. The same arguments give the same
/// bits.
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
    let cases = |measured: &[MeasuredTrack]| -> Result<Vec<Case>, FinderError> {
        measured.iter().enumerate().map(|(i, m)| Case::new(question.model, m, i, settings)).collect()
    };
    let (cases, mut held_out) = (cases(question.measured)?, cases(question.held_out)?);
    let mut telling = Telling { on_progress, conclusions: Vec::new() };
    let in_need = settings.in_need.filter(|_| settings.finer_fidelity.is_some());
    let mut present = calibrate(question.model, cases, simulator, Vec::new(), settings, &mut telling)?;
    if let Some(finer) = in_need.filter(|_| present.is_too_coarse()) {
        let at = |cases: &[Case]| -> Vec<Case> { cases.iter().map(|c| c.at(finer)).collect() };
        held_out = at(&held_out);
        telling.conclude(Stage::Calibrate, sentences::finer(finer))?;
        let known = vec![present.fit.point];
        let settings = &Settings { in_need: None, ..settings.clone() };
        present = calibrate(question.model, at(&present.cases), simulator, known, settings, &mut telling)?;
    }
    let Refined { cases, fit, grain } = present;
    let problem = Problem::of(question.model, &cases, simulator, settings.rounds);
    let mut outcome = Search { question, problem: &problem, held_out: &held_out, settings, telling }.run(fit, grain)?;
    let tracks = question.measured.iter().map(|m| &m.track);
    outcome.finding.judge(spread_mm(tracks, &question.model.camera.view));
    Ok(outcome)
}

/// The best fit of the present model, from `known` points and others, and the episodes with what a finer simulation of it shows
/// otherwise. Where another fidelity will be in need, it is no better fit than shows that.
fn calibrate(
    model: &Model,
    cases: Vec<Case>,
    simulator: &dyn DifferentiableSimulator,
    known: Vec<Vec<f64>>,
    settings: &Settings,
    telling: &mut Telling<'_>,
) -> Result<Refined, FinderError> {
    telling.report(Stage::Calibrate, 0.0, None)?;
    let first = Problem::of(model, &cases, simulator, settings.rounds);
    let fit = telling.in_rounds(Stage::Calibrate, |on_round| fit_among_draws(&first, known, settings, on_round))?;
    if let Some(finer) = settings.finer_fidelity.filter(|_| settings.in_need.is_some() && leaves_more_than_noise(&fit))
    {
        let coarse = telling.in_rounds(Stage::Calibrate, |on_round| refined(&first, fit.clone(), finer, on_round))?;
        if coarse.is_too_coarse() {
            return Ok(coarse);
        }
    }
    let fit = telling.in_rounds(Stage::Calibrate, |on_round| looked_further(&first, fit, settings, on_round))?;
    match settings.finer_fidelity {
        None => Ok(Refined { cases, fit, grain: Grain::Coarse }),
        Some(finer) => telling.in_rounds(Stage::Calibrate, |on_round| refined(&first, fit, finer, on_round)),
    }
}

/// Who is told of progress, and what was concluded.
struct Telling<'a> {
    on_progress: OnProgress<'a>,
    conclusions: Vec<String>,
}

impl Telling<'_> {
    /// What `fit` comes to, while its rounds are reported.
    fn in_rounds<T>(
        &mut self,
        stage: Stage,
        fit: impl FnOnce(OnRound<'_>) -> Result<T, FinderError>,
    ) -> Result<T, FinderError> {
        fit(&mut || told(self.on_progress, stage, 0.5, None)).map_err(|e| in_stage(e, stage))
    }

    fn conclude(&mut self, stage: Stage, sentence: String) -> Result<(), FinderError> {
        self.conclusions.push(sentence.clone());
        self.report(stage, 1.0, Some(sentence))
    }

    fn report(&mut self, stage: Stage, share: f64, conclusion: Option<String>) -> Result<(), FinderError> {
        match told(self.on_progress, stage, share, conclusion) {
            ControlFlow::Continue(()) => Ok(()),
            ControlFlow::Break(()) => Err(FinderError::Cancelled(stage.name())),
        }
    }
}

struct Search<'a> {
    question: Question<'a>,
    problem: &'a Problem<'a>,
    held_out: &'a [Case],
    settings: &'a Settings,
    telling: Telling<'a>,
}

impl<'a> Search<'a> {
    fn run(mut self, fit: Fit, grain: Grain) -> Result<Outcome, FinderError> {
        let agreement = self.agreement(self.problem, &fit)?;
        self.telling.conclude(Stage::Calibrate, sentences::fitted(&agreement.estimates, agreement.rmse_mm))?;
        let pressing = self.pressing(&fit);
        let detection = self.detect(self.problem, &fit, 0, Stage::Detect)?;
        let present = agreement.with(&detection);
        let is_gap = present.test.p_value <= self.settings.level;
        self.telling.conclude(Stage::Detect, sentences::detected(&present, is_gap))?;
        let places = localise::localise(&fit, &self.problem.channels(), &detection);
        let mut outcome =
            Outcome { finding: Finding::without_gap(present, places, pressing), model: None, shown: Vec::new() };
        let (problem, candidates) = (self.problem, self.question.candidates);
        outcome.finding.limits =
            self.telling.in_rounds(Stage::Localise, |on_round| limits(problem, &fit, candidates, on_round))?;
        let mut is_narrow = false;
        if is_gap {
            self.telling.conclude(Stage::Localise, sentences::located(&outcome.finding.places, self.settings.level))?;
            is_narrow = self.closes_with_open_priors(&fit, &outcome.finding, &detection)?;
        }
        let yardstick = Yardstick::new(self.problem.cases, &fit).ok_or_else(FinderError::curvature)?;
        let base = Hypothesis {
            candidates: Vec::new(),
            unknowns: self.problem.unknowns.clone(),
            fit,
            evidence: yardstick.evidence().clone(),
            cases: None,
            grain,
            depth: Depth::Polished,
            spread: Vec::new(),
        };
        if is_gap {
            self.explain(&base, &yardstick, &mut outcome)?;
        } else {
            outcome.shown = self.shown(&base, None)?;
        }
        if is_narrow {
            outcome.is_at_the_edge();
            self.telling.conclude(Stage::Repair, sentences::at_the_edge(&outcome.finding))?;
        }
        outcome.finding.conclusions = std::mem::take(&mut self.telling.conclusions);
        Ok(outcome)
    }

    /// What pictures show of the fitted episodes.
    fn shown(&self, base: &Hypothesis, best: Option<&Hypothesis>) -> Result<Vec<Shown>, FinderError> {
        outcome::fitted(self.problem, base, best, &self.question.model.camera.view, self.settings.seed)
    }

    /// Names, repairs and verifies.
    fn explain(&mut self, base: &Hypothesis, yardstick: &Yardstick, outcome: &mut Outcome) -> Result<(), FinderError> {
        let finding = &mut outcome.finding;
        let mut named = self.name(base, yardstick, finding)?;
        let mut looked = self.looked_at_unseen(&named, base)?;
        let verified = looked.verified.as_ref().map(|v| &v.0);
        if looked.is_left && self.without_stand_in(&mut named, verified, base, yardstick, finding)? {
            looked = self.looked_at_unseen(&named, base)?;
        }
        let Named { ranking, best } = named;
        let Looked { mut verified, is_left } = looked;
        finding.set_ranking(&ranking);
        let likeliest = |h: &Hypothesis| h.evidence.likeliest().map(|place| yardstick.discrepancies[place]);
        let Some(best) = best else {
            outcome.shown = self.shown(base, None)?;
            finding.verdict = Verdict::NoneOfThese;
            finding.discrepancy = likeliest(base);
            return Ok(());
        };
        let mut alike = ranking.alike(self.settings);
        let Best { hypothesis: mut best, mut fitness, extent } = best;
        if is_left {
            finding.discrepancy = likeliest(&best);
            if let Some(objection) = self.objection(base, &best, extent, &fitness) {
                outcome.shown = self.shown(base, Some(&best))?;
                finding.refute();
                finding.repaired = Some(fitness);
                if let Some((verification, held_out)) = verified {
                    outcome.shown.extend(held_out);
                    self.telling.conclude(Stage::Verify, sentences::verified(&verification))?;
                    finding.verification = Some(verification);
                }
                let stage = if finding.verification.is_some() { Stage::Verify } else { Stage::Repair };
                return self.telling.conclude(stage, objection);
            }
            for (effect, limit) in alike.iter().skip(1).filter_map(|h| h.at_its_limit()) {
                self.telling.conclude(Stage::Repair, sentences::not_added(effect, limit))?;
            }
            alike.retain(|h| h.is_same(&best.candidates) || h.at_its_limit().is_none());
            let unseen = verified.as_ref().and_then(|v| v.0.p_value);
            best = self.weighed_in_part(best, &mut fitness, yardstick)?;
            finding.set_magnitudes(best.magnitudes());
            // The first look at the unseen episodes is what speaks against the model: now it has been weighed by them.
            verified = self.verified(base, &best, &ranking, unseen)?;
        }
        finding.repaired = Some(fitness);
        outcome.shown = self.shown(base, Some(&best))?;
        finding.trade_offs = trade_offs(&best);
        for trade_off in &finding.trade_offs {
            self.telling.conclude(Stage::Repair, sentences::traded(trade_off))?;
        }
        finding.found = groups(&alike);
        finding.verdict = match (is_left, alike.len() > 1) {
            (true, _) => Verdict::NamedInPart,
            (false, true) => Verdict::CannotTellApart,
            (false, false) => Verdict::Named,
        };
        if let Some((verification, held_out)) = verified {
            outcome.shown.extend(held_out);
            self.telling.conclude(Stage::Verify, sentences::verified(&verification))?;
            let refusal = self.refusal(&verification, is_left, [base, &best], &alike)?;
            finding.verification = Some(verification);
            match refusal {
                None => (),
                Some(Refusal::ExplainsLittle(share)) => {
                    finding.refute();
                    return self.telling.conclude(Stage::Verify, sentences::refuted(share));
                }
                Some(Refusal::LessLikely(loss)) => {
                    finding.withdraw();
                    finding.discrepancy = likeliest(base);
                    return self.telling.conclude(Stage::Verify, sentences::less_likely(loss));
                }
            }
        }
        if let [first, second, ..] = alike.as_slice() {
            let (model, problem, settings) = (self.question.model, self.problem, self.settings);
            let separation = self
                .telling
                .in_rounds(Stage::Verify, |on_round| separate(model, problem, [first, second], settings, on_round))?;
            self.telling.conclude(Stage::Verify, sentences::separated(separation.as_ref()))?;
            finding.separation = separation.filter(Separation::tells);
        }
        let posterior = best.posterior().ok_or_else(FinderError::curvature)?;
        outcome.model = Some(repaired(self.question.model, &best, &posterior)?);
        Ok(())
    }

    /// Whether the data are explained where theta's priors are opened, and were not for the priors' edges alone.
    fn closes_with_open_priors(
        &mut self,
        fit: &Fit,
        finding: &Finding,
        detection: &Detection,
    ) -> Result<bool, FinderError> {
        if finding.pressing.is_empty() {
            return Ok(false);
        }
        let unknowns = self.problem.unknowns.opened();
        let point = unknowns.point_from(&self.problem.unknowns, &fit.point);
        let open = Problem { unknowns, ..*self.problem };
        let settings = self.settings;
        let best = match self
            .telling
            .in_rounds(Stage::Localise, |on_round| best_fit(&open, vec![point], settings, on_round))
        {
            // Beyond the edge there may be nothing that can be simulated.
            Err(FinderError::NoFit(_)) => return Ok(false),
            other => other?,
        };
        let p_value = crate::detect::p_value(best.cost, detection.null.iter().map(|f| f.cost));
        let closes = p_value > self.settings.level;
        if closes {
            self.telling.conclude(Stage::Localise, sentences::narrow(&finding.pressing, p_value))?;
        }
        Ok(closes)
    }

    /// Parameters of theta that press on an edge of their prior, or lie so near to one that their values may lie beyond it.
    fn pressing(&self, fit: &Fit) -> Vec<String> {
        let unknowns = &self.problem.unknowns;
        let (gradient, posterior) = (fit.gradient(), Laplace::of(fit));
        let at_edge = |column: usize| {
            let u = fit.point[column];
            let reach = posterior.as_ref().map_or(0.0, |p| NEAR_SDS * p.sd(column)).min(NEAR);
            presses(u, gradient[column]) || u.min(1.0 - u) < reach
        };
        let theta = unknowns.list()[..unknowns.theta()].iter().enumerate();
        theta.filter(|(i, _)| at_edge(unknowns.column(*i, 0))).map(|(_, u)| u.name.clone()).collect()
    }

    /// The test of a model.
    fn detect(
        &mut self,
        problem: &Problem<'_>,
        fit: &Fit,
        stream: u64,
        stage: Stage,
    ) -> Result<Detection, FinderError> {
        // Where something is left is asked of the present model alone, and its null sets tell.
        let enough = (stage == Stage::Repair).then_some(ENOUGH);
        self.telling.report(stage, 0.0, None)?;
        let mut rounds = 0.0;
        let mut on_round = || {
            rounds += 1.0;
            told(self.telling.on_progress, stage, rounds / (rounds + 4.0), None)
        };
        detect(problem, fit, self.settings, stream, enough, &mut on_round).map_err(|e| in_stage(e, stage))
    }

    fn agreement(&self, problem: &Problem<'_>, fit: &Fit) -> Result<Agreement, FinderError> {
        Agreement::new(problem, fit, &self.question.model.camera.view, self.settings)
    }
}

/// A value is near an edge of its prior where it lies within as many of its standard deviations, and this share of the prior.
const NEAR_SDS: f64 = 3.0;
const NEAR: f64 = 0.1;
/// Null sets with at least the measured T that end the test of a repaired model: whether it is refused is settled long before.
const ENOUGH: usize = 20;
/// A better fit is one whose cost is less by this: a hundredth of a log Bayes factor.
const LEAST_DECREASE: f64 = 0.02;

/// Tells how far the search is, `share` of a stage, and returns whether to go on.
fn told(on_progress: OnProgress<'_>, stage: Stage, share: f64, conclusion: Option<String>) -> ControlFlow<()> {
    on_progress(&Progress { stage, progress: within(stage, share), conclusion })
}

fn within(stage: Stage, share: f64) -> f64 {
    let [from, to] = stage.span();
    from + (to - from) * share.clamp(0.0, 1.0)
}

fn in_stage(error: FinderError, stage: Stage) -> FinderError {
    match error {
        FinderError::Cancelled(_) => FinderError::Cancelled(stage.name()),
        other => other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::toy::{self, Toy, coarse};
    use catenary_core::{Fidelity, Prior, seed};

    const MASS: &str = "tip_mass_kg";
    const DRAG: &str = "linear_drag_n_s_m2";

    /// What was measured is what the coarse simulation makes by its errors: it hides a gap.
    #[test]
    fn where_coarse_simulations_err_plainly_finer_ones_are_searched_with() {
        let (theta, error) = ([0.25, 2e4], 0.3);
        let simulator = coarse(Toy { gain: 0.3 }, error);
        let mut measured = [toy::measured(&simulator.toy, theta, &[])];
        let points = measured[0].track.frames.iter_mut().flat_map(|f| f.dlo.iter_mut());
        points.for_each(|p| p[0] += error * theta[0]);
        let model = toy::model();
        let found = |in_need: Option<Fidelity>| {
            let question = Question { model: &model, measured: &measured, held_out: &[], candidates: &[] };
            let settings = Settings { in_need, draws: 40, starts: 2, null_sets: 19, ..Settings::default() };
            find(question, &simulator, &settings, &mut |_| ControlFlow::Continue(())).unwrap().finding.verdict
        };
        assert_eq!([None, Some(Fidelity::FineMesh)].map(found), [Verdict::NoGap, Verdict::NoneOfThese]);
    }

    /// The first fit shows it, and no better one is looked for before the finer ones take their place.
    #[test]
    fn what_coarse_simulations_cannot_explain_finer_ones_do() {
        let (theta, simulator) = ([0.25, 2e4], coarse(Toy { gain: 0.3 }, 0.3));
        let measured = [toy::measured(&simulator.toy, theta, &[])];
        let model = toy::model();
        let question = Question { model: &model, measured: &measured, held_out: &[], candidates: &[] };
        let settings =
            Settings { in_need: Some(Fidelity::FineMesh), draws: 40, starts: 2, null_sets: 19, ..Settings::default() };
        let found = find(question, &simulator, &settings, &mut |_| ControlFlow::Continue(())).unwrap().finding;
        assert_eq!(
            (found.verdict, found.conclusions[0].clone()),
            (Verdict::NoGap, sentences::finer(Fidelity::FineMesh))
        );
    }

    /// What a search finds in data of an object with these effects, where no tip mass above 0.03 makes sense, and no drag above
    /// `most`, or is expected above `expected`; other episodes, which no fit sees, hide something else.
    fn with_limits(hidden: &[(&str, f64)], unseen: &[&[(&str, f64)]], [expected, most]: [f64; 2]) -> Outcome {
        let (simulator, model) = (Toy { gain: 3.0 }, toy::model());
        let candidate = |name: &str, high: f64, most: f64| Candidate {
            name: name.into(),
            title: name.into(),
            prior: Prior::LogUniform { low: 1e-3, high },
            range: [0.0, most],
            base: 0.0,
            odds: 1.0,
        };
        let candidates = [candidate(MASS, 0.02, 0.03), candidate(DRAG, expected, most)];
        let theta = [0.25, 2e4];
        let measured = |(stream, effects): (u64, &[(&str, f64)])| {
            let noisy = toy::case(&simulator, theta, effects).measured_anew(&mut seed::rng(9, stream));
            MeasuredTrack { track: noisy.measured, ..toy::measured(&simulator, theta, effects) }
        };
        let fitted = [measured((0, hidden))];
        let held_out: Vec<MeasuredTrack> = (1..).zip(unseen.iter().copied()).map(measured).collect();
        let question = Question { model: &model, measured: &fitted, held_out: &held_out, candidates: &candidates };
        let settings = Settings {
            in_need: None,
            finer_fidelity: None,
            draws: 40,
            starts: 2,
            null_sets: 99,
            ..Settings::default()
        };
        find(question, &simulator, &settings, &mut |_| ControlFlow::Continue(())).unwrap()
    }

    fn named_in_part(name: &str) -> (Verdict, Vec<Vec<String>>) {
        (Verdict::NamedInPart, vec![vec![name.to_owned()]])
    }

    /// The range ends at 0.04, or only the search does, at 0.06.
    #[test]
    fn an_effect_that_leaves_something_at_the_end_of_its_range_is_none_of_these() {
        let found = |most: f64| with_limits(&[(DRAG, 0.08)], &[], [0.02, most]).finding;
        let (limited, open) = (found(0.04), found(1e3));
        assert_eq!((limited.verdict, limited.found.len()), (Verdict::NoneOfThese, 0));
        let is_told = |s: &String| s.contains("goes to the end of its range (linear_drag_n_s_m2 0.04000)");
        assert!(limited.conclusions.last().is_some_and(is_told), "{:?}", limited.conclusions);
        assert!(limited.probability_of_unknown == 1.0 && limited.repaired.is_some());
        assert_eq!((open.verdict, open.found), named_in_part(DRAG));
    }

    #[test]
    fn nor_is_it_named_where_it_leaves_something_of_unseen_episodes_alone() {
        let found = |most: f64| with_limits(&[(DRAG, 0.0403)], &[&[(DRAG, 0.05)]], [0.0399, most]).finding;
        let (limited, open) = (found(0.04), found(1e3));
        assert!(limited.repaired.as_ref().is_some_and(|r| r.test.p_value > 0.05), "the fitted episode is closed");
        assert!(limited.verification.as_ref().is_some_and(|v| v.p_value.is_some_and(|p| p <= 0.01)));
        assert_eq!((limited.verdict, limited.found.len()), (Verdict::NoneOfThese, 0));
        assert_eq!((open.verdict, open.found), named_in_part(DRAG));
    }

    #[test]
    fn what_stands_in_for_something_else_is_not_added_to_what_is_named() {
        let outcome = with_limits(&[(DRAG, 0.05), (MASS, 0.04)], &[], [0.02, 1e3]);
        let (found, model) = (outcome.finding, outcome.model.unwrap());
        let told = "goes to the end of its range (tip_mass_kg 0.03000) and leaves more than noise: it is not added";
        assert!(found.conclusions.iter().any(|s| s.contains(told)), "{:?}", found.conclusions);
        assert!(model.theta.index_of(DRAG).is_some() && model.theta.index_of(MASS).is_none());
        assert_eq!(found.explanations[0].names(), DRAG);
        assert_eq!((found.verdict, found.found), named_in_part(DRAG));
    }
}
