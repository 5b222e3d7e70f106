//! The whole search: calibrate, detect, localise, name, repair, again, verify.

use crate::calibrate::{Agreement, best_fit};
use crate::candidate::Candidate;
use crate::case::Case;
use crate::detect::{Detection, detect};
use crate::discrepancy::Whitening;
use crate::error::FinderError;
use crate::evidence::Yardstick;
use crate::fit::{Fit, OnRound, Problem, Start, presses};
use crate::hypothesis::{Depth, Hypothesis, Trial};
use crate::laplace::Laplace;
use crate::localise;
use crate::name::{Extent, Ranking, groups};
use crate::outcome::{self, Outcome, Shown};
use crate::repair::repaired;
use crate::sentences;
use crate::separate::separate;
use crate::settings::Settings;
use crate::unknowns::Unknowns;
use crate::verdict::{Finding, Fitness, Verdict};
use crate::verify::{Verification, Verifier};
use catenary_core::episode::MeasuredTrack;
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
    /// Share of the whole search that is done, roughly; it falls back where the search begins again with further effects.
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
    let (cases, held_out) = (cases(question.measured)?, cases(question.held_out)?);
    let mut telling = Telling { on_progress, conclusions: Vec::new() };
    let (cases, fit) = calibrate(question.model, cases, simulator, settings, &mut telling)?;
    let problem = problem_of(question.model, &cases, simulator, settings);
    Search { question, problem: &problem, held_out: &held_out, settings, telling }.run(fit)
}

/// The problem of fitting the present model.
fn problem_of<'a>(
    model: &Model,
    cases: &'a [Case],
    simulator: &'a dyn DifferentiableSimulator,
    settings: &Settings,
) -> Problem<'a> {
    let unknowns = Unknowns::of(model, cases.len());
    Problem { simulator, unknowns, cases, rounds: settings.rounds, is_shared_held: false }
}

/// The best fit of the present model, and the episodes with what a finer simulation of it shows otherwise.
fn calibrate(
    model: &Model,
    mut cases: Vec<Case>,
    simulator: &dyn DifferentiableSimulator,
    settings: &Settings,
    telling: &mut Telling<'_>,
) -> Result<(Vec<Case>, Fit), FinderError> {
    telling.report(Stage::Calibrate, 0.0, None)?;
    let first = problem_of(model, &cases, simulator, settings);
    let mut fit = telling.in_rounds(Stage::Calibrate, |on_round| best_fit(&first, Vec::new(), settings, on_round))?;
    for _ in 0..REFINEMENTS {
        let Some(finer) = settings.finer_fidelity else { break };
        cases = problem_of(model, &cases, simulator, settings).refined(&fit.point, finer)?;
        let refined = problem_of(model, &cases, simulator, settings);
        let start = Start { point: fit.point, tracks: refined.measured() };
        let fits = telling.in_rounds(Stage::Calibrate, |on_round| refined.fit(vec![start], on_round))?;
        fit = fits.into_iter().flatten().next().ok_or_else(|| FinderError::NoFit("the refined fit failed".into()))?;
    }
    Ok((cases, fit))
}

/// Rounds of correcting simulated tracks by a finer simulation of the best fit, and fitting again.
const REFINEMENTS: usize = 2;

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

/// What naming came to.
struct Named {
    ranking: Ranking,
    /// The most probable model with its test; none where none of the candidates is.
    best: Option<Best>,
}

/// The most probable model with effects.
struct Best {
    hypothesis: Hypothesis,
    extent: Extent,
    fitness: Fitness,
}

impl<'a> Search<'a> {
    fn run(mut self, fit: Fit) -> Result<Outcome, FinderError> {
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
        let finding = &mut outcome.finding;
        if is_gap {
            self.telling.conclude(Stage::Localise, sentences::located(&finding.places, self.settings.level))?;
            if self.closes_with_open_priors(&fit, finding, &detection)? {
                finding.verdict = Verdict::PriorTooNarrow;
            }
        }
        let yardstick = Yardstick::new(self.problem.cases, &fit).ok_or_else(FinderError::curvature)?;
        let base = Hypothesis {
            candidates: Vec::new(),
            unknowns: self.problem.unknowns.clone(),
            fit,
            evidence: yardstick.evidence().clone(),
            depth: Depth::Polished,
            spread: Vec::new(),
        };
        if is_gap && finding.verdict != Verdict::PriorTooNarrow {
            self.explain(&base, &yardstick, &mut outcome)?;
        } else {
            outcome.shown = self.shown(&base, None)?;
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
        let Named { ranking, best } = self.name(base, yardstick, finding)?;
        finding.set_ranking(&ranking);
        let likeliest = |h: &Hypothesis| h.evidence.likeliest().map(|place| yardstick.discrepancies[place]);
        let Some(best) = best else {
            outcome.shown = self.shown(base, None)?;
            finding.verdict = Verdict::NoneOfThese;
            finding.discrepancy = likeliest(base);
            return Ok(());
        };
        let alike = ranking.alike(self.settings);
        let is_left = best.extent == Extent::Part;
        finding.discrepancy = if is_left { likeliest(&best.hypothesis) } else { None };
        finding.repaired = Some(best.fitness.clone());
        if is_left && !self.is_worth_naming(base, &best.hypothesis) {
            outcome.shown = self.shown(base, Some(&best.hypothesis))?;
            finding.verdict = Verdict::NoneOfThese;
            return self.telling.conclude(Stage::Repair, sentences::refused(&best.fitness));
        }
        let Best { hypothesis: mut best, mut fitness, .. } = best;
        if is_left {
            best = self.beside_a_discrepancy(best, yardstick)?;
            let own = best.magnitudes();
            let elsewhere = self.let_conditions_differ(&mut best, yardstick)?;
            self.telling.conclude(Stage::Repair, sentences::weighed(&own, elsewhere.as_deref(), &best.magnitudes()))?;
            finding.set_magnitudes(best.magnitudes());
            let posterior = best.posterior().ok_or_else(FinderError::curvature)?;
            let (problem, camera) = (best.problem(self.problem), &self.question.model.camera.view);
            let agreement = Agreement::with_posterior(&problem, &best.fit, &posterior, camera, self.settings)?;
            (fitness.estimates, fitness.rmse_mm) = (agreement.estimates, agreement.rmse_mm);
        }
        finding.repaired = Some(fitness);
        outcome.shown = self.shown(base, Some(&best))?;
        finding.found = groups(&alike);
        finding.verdict = match (alike.len() > 1, is_left) {
            (true, _) => Verdict::CannotTellApart,
            (false, true) => Verdict::NamedInPart,
            (false, false) => Verdict::Named,
        };
        if !self.held_out.is_empty() {
            let (verification, held_out) = self.verify(base, &best, &ranking)?;
            outcome.shown.extend(held_out);
            self.telling.conclude(Stage::Verify, sentences::verified(&verification))?;
            finding.verification = Some(verification);
        }
        if let [first, second, ..] = alike.as_slice() {
            let (model, problem, settings) = (self.question.model, self.problem, self.settings);
            finding.separation = self
                .telling
                .in_rounds(Stage::Verify, |on_round| separate(model, problem, [first, second], settings, on_round))?;
            self.telling.conclude(Stage::Verify, sentences::separated(finding.separation.as_ref()))?;
        }
        let posterior = best.posterior().ok_or_else(FinderError::curvature)?;
        outcome.model = Some(repaired(self.question.model, &best, &posterior)?);
        Ok(())
    }

    /// The hypothesis fitted anew beside the likeliest smooth error: what it then is, and how well it is known, counts what is
    /// left of the data as more than noise.
    fn beside_a_discrepancy(
        &mut self,
        hypothesis: Hypothesis,
        yardstick: &Yardstick,
    ) -> Result<Hypothesis, FinderError> {
        let Some(place) = hypothesis.evidence.likeliest() else { return Ok(hypothesis) };
        let own = hypothesis.problem(self.problem);
        let fit = self.weighed(&own, hypothesis.fit, yardstick.whitening(place))?;
        Ok(Hypothesis { fit, ..hypothesis })
    }

    /// The best fit as `whitening` sees it, from `fit` on.
    fn weighed(&mut self, own: &Problem<'_>, fit: Fit, whitening: &Whitening) -> Result<Fit, FinderError> {
        let mut best = whitening.of(&fit);
        let mut share = 1.0;
        for _ in 0..REWEIGHINGS {
            let promised = best.clone().descended();
            if best.cost - promised.cost < LEAST_DECREASE {
                break;
            }
            let point = best.point.iter().zip(&promised.point).map(|(from, to)| from + share * (to - from)).collect();
            let start = Start { point, tracks: own.measured() };
            let seen = self.telling.in_rounds(Stage::Repair, |on_round| own.look(vec![start], on_round));
            match seen.map(|seen| seen.into_iter().flatten().next().map(|seen| whitening.of(&seen.fit))) {
                Err(cancelled @ FinderError::Cancelled(_)) => return Err(cancelled),
                Ok(Some(lower)) if lower.cost < best.cost => (best, share) = (lower, 1.0),
                _ => share *= 0.5,
            }
        }
        Ok(best)
    }

    /// Fits the hypothesis to the held-out episodes alone, and takes by how much more its effects differ there than the data
    /// leave open for how much they differ between conditions: a model that leaves something is a little another one in each.
    /// One difference is all there is to say so. Returns the values of the effects there.
    fn let_conditions_differ(
        &mut self,
        best: &mut Hypothesis,
        yardstick: &Yardstick,
    ) -> Result<Option<Vec<f64>>, FinderError> {
        let Some(place) = best.evidence.likeliest().filter(|_| !self.held_out.is_empty()) else { return Ok(None) };
        let (verifier, settings) = (self.verifier(), self.settings);
        let mut cases = Vec::new();
        for case in self.held_out {
            cases.push(self.telling.in_rounds(Stage::Repair, |on_round| verifier.refined(case, best, on_round))?);
        }
        let unknowns = best.unknowns.for_episodes(cases.len());
        let known = vec![unknowns.shared_from(&best.unknowns, &best.fit.point)];
        let own = Problem { cases: &cases, unknowns, ..*self.problem };
        let fit = match self.telling.in_rounds(Stage::Repair, |on_round| best_fit(&own, known, settings, on_round)) {
            Err(FinderError::NoFit(_)) => return Ok(None),
            other => other?,
        };
        let whitening = Whitening::new(&cases, yardstick.discrepancies[place]).ok_or_else(FinderError::curvature)?;
        let fit = self.weighed(&own, fit, &whitening)?;
        let unknowns = own.unknowns.clone();
        let there = Hypothesis { unknowns, fit, candidates: best.candidates.clone(), ..best.clone() };
        let (here, other) = (Laplace::of(&best.fit), Laplace::of(&there.fit));
        let (here, other) = here.zip(other).ok_or_else(FinderError::curvature)?;
        let spread = |i: usize| {
            let (own, far) = (best.column(i), there.column(i));
            let apart = best.fit.point[own] - there.fit.point[far];
            // Of two draws of one Gaussian, the difference has twice its variance.
            (0.5 * (apart.powi(2) - here.sd(own).powi(2) - other.sd(far).powi(2)).max(0.0)).sqrt()
        };
        best.spread = (0..best.candidates.len()).map(spread).collect();
        Ok(Some((0..there.candidates.len()).map(|i| there.magnitude(i).0).collect()))
    }

    /// Models with one effect each, and where the best of them does not close the gap, with more.
    fn name(&mut self, base: &Hypothesis, yardstick: &Yardstick, finding: &mut Finding) -> Result<Named, FinderError> {
        let candidates = self.question.candidates;
        let mut hypotheses = self.singles(base, yardstick, finding)?;
        let mut tested: Option<Best> = None;
        for effects in 1.. {
            let ranking = Ranking::new(self.problem, base, hypotheses, candidates.len(), self.settings)?;
            let ranking = self.polish(ranking, base, yardstick)?;
            let is_new = |best: &Hypothesis| tested.as_ref().is_none_or(|t| !t.hypothesis.is_same(&best.candidates));
            self.telling.conclude(Stage::Name, sentences::named(&ranking, self.settings))?;
            if let Some((hypothesis, extent)) = ranking.best().filter(|(best, _)| is_new(best)) {
                if let Some(last) = tested.take_if(|t| t.hypothesis.candidates.len() < hypothesis.candidates.len())
                    && !self.is_plain(&ranking, &last.hypothesis, hypothesis)?
                {
                    let is_small = |h: &Hypothesis| h.candidates.len() <= last.hypothesis.candidates.len();
                    let left = ranking.hypotheses.into_iter().filter(is_small).collect();
                    let ranking = Ranking::new(self.problem, base, left, candidates.len(), self.settings)?;
                    return Ok(Named { ranking, best: Some(last) });
                }
                tested = Some(self.test(hypothesis.clone(), extent, finding, effects)?);
            }
            let is_closed = tested.as_ref().is_some_and(|t| t.extent == Extent::Whole);
            let is_candidate = |c: &&Candidate| finding.left_out.iter().all(|(name, _)| *name != c.name);
            let usable: Vec<&Candidate> = candidates.iter().filter(is_candidate).collect();
            if is_closed || effects >= self.settings.most_effects.min(usable.len()) {
                let best = tested.filter(|t| ranking.best().is_some_and(|(b, _)| b.is_same(&t.hypothesis.candidates)));
                return Ok(Named { ranking, best });
            }
            hypotheses = self.extended(ranking.hypotheses, effects, &usable, yardstick)?;
        }
        unreachable!("the last round returns")
    }

    /// Models with one effect each: those that promise most are fitted.
    fn singles(
        &mut self,
        base: &Hypothesis,
        yardstick: &Yardstick,
        finding: &mut Finding,
    ) -> Result<Vec<Hypothesis>, FinderError> {
        let (candidates, problem) = (self.question.candidates, self.problem);
        let mut left_out = |candidate: &Candidate, error: FinderError| match error {
            cancelled @ FinderError::Cancelled(_) => Err(cancelled),
            error => {
                finding.left_out.push((candidate.name.clone(), error.to_string()));
                Ok(())
            }
        };
        let mut trials = Vec::new();
        for (i, candidate) in candidates.iter().enumerate() {
            self.telling.report(Stage::Name, 0.5 * i as f64 / candidates.len() as f64, None)?;
            match self.telling.in_rounds(Stage::Name, |on_round| base.with(problem, candidate, on_round)) {
                Ok(trial) => trials.push((candidate, trial)),
                Err(error) => left_out(candidate, error)?,
            }
        }
        trials.sort_by(|(_, a), (_, b)| a.promise.total_cmp(&b.promise));
        let mut hypotheses = Vec::new();
        for (i, (candidate, trial)) in trials.into_iter().enumerate() {
            let fitted = if i < self.settings.extensions {
                self.telling.in_rounds(Stage::Name, |on_round| trial.fitted(problem, yardstick, on_round))
            } else {
                trial.promised(yardstick)
            };
            match fitted {
                Ok(one) => hypotheses.push(one),
                Err(error) => left_out(candidate, error)?,
            }
        }
        Ok(hypotheses)
    }

    fn verifier(&self) -> Verifier<'a> {
        let camera = &self.question.model.camera.view;
        Verifier { problem: self.problem, held_out: self.held_out, camera, settings: self.settings }
    }

    /// Whether a further effect predicts the held-out episodes better; where there are none, whether its probability is plain.
    fn is_plain(&mut self, ranking: &Ranking, less: &Hypothesis, more: &Hypothesis) -> Result<bool, FinderError> {
        if self.held_out.is_empty() {
            let behind = ranking.log_odds(more, less);
            let is_plain = behind > self.settings.least_log_bayes_factor;
            if !is_plain {
                self.telling.conclude(Stage::Name, sentences::not_plain(more, behind))?;
            }
            return Ok(is_plain);
        }
        let verifier = self.verifier();
        let mut rmse_mm = |h: &Hypothesis| {
            self.telling.in_rounds(Stage::Verify, |on_round| Ok(verifier.predict(h, on_round)?.score.rmse_mm))
        };
        let (less_mm, more_mm) = (rmse_mm(less)?, rmse_mm(more)?);
        let shrinks = more_mm < LEAST_SHRINK * less_mm;
        if !shrinks {
            self.telling.conclude(Stage::Verify, sentences::no_better(more, less_mm, more_mm))?;
        }
        Ok(shrinks)
    }

    /// Looks for better fits of the most probable hypotheses elsewhere: with an effect more, the best values of all others may
    /// lie in another valley.
    fn polish(
        &mut self,
        mut ranking: Ranking,
        base: &Hypothesis,
        yardstick: &Yardstick,
    ) -> Result<Ranking, FinderError> {
        let (problem, settings) = (self.problem, self.settings);
        let (draws, starts) = (settings.draws.div_ceil(FEWER), settings.starts.div_ceil(FEWER));
        let few = Settings { draws, starts, ..settings.clone() };
        loop {
            let alike: Vec<Vec<Candidate>> =
                ranking.alike(settings).into_iter().map(|h| h.candidates.clone()).collect();
            let wants = |(place, h): (usize, &Hypothesis)| match h.depth {
                Depth::Promised => place < PARENTS || alike.iter().any(|a| h.is_same(a)),
                Depth::Fitted => place < PARENTS,
                Depth::Glanced => place == 0,
                Depth::Polished => false,
            };
            let Some(place) = ranking.hypotheses.iter().enumerate().position(wants) else { return Ok(ranking) };
            let mut all = ranking.hypotheses;
            let old = &all[place];
            let fitted = match (old.depth, old.candidates.as_slice()) {
                (Depth::Promised, [candidate]) => self.telling.in_rounds(Stage::Name, |on_round| {
                    base.with(problem, candidate, on_round)?.fitted(problem, yardstick, on_round)
                }),
                _ => {
                    let (own, known) = (old.problem(problem), vec![old.fit.point.clone()]);
                    let (how, depth) = if place == 0 { (settings, Depth::Polished) } else { (&few, Depth::Glanced) };
                    let found = self.telling.in_rounds(Stage::Name, |on_round| best_fit(&own, known, how, on_round));
                    found.map(|fit| match yardstick.of(&old.candidates, &fit) {
                        Some(evidence) if fit.cost < old.fit.cost - LEAST_DECREASE => {
                            Hypothesis { fit, evidence, depth, ..old.clone() }
                        }
                        _ => Hypothesis { depth, ..old.clone() },
                    })
                }
            };
            match fitted {
                Ok(fitted) => all[place] = fitted,
                Err(cancelled @ FinderError::Cancelled(_)) => return Err(cancelled),
                // What promised something cannot be simulated.
                Err(_) => drop(all.remove(place)),
            }
            ranking = Ranking::new(problem, base, all, self.question.candidates.len(), settings)?;
        }
    }

    /// The hypotheses, and those with an effect more than `effects` that promise most.
    fn extended(
        &mut self,
        mut hypotheses: Vec<Hypothesis>,
        effects: usize,
        candidates: &[&Candidate],
        yardstick: &Yardstick,
    ) -> Result<Vec<Hypothesis>, FinderError> {
        let parents: Vec<&Hypothesis> =
            hypotheses.iter().filter(|h| h.candidates.len() == effects).take(PARENTS).collect();
        let problem = self.problem;
        let mut trials: Vec<Trial> = Vec::new();
        for (i, parent) in parents.iter().enumerate() {
            for candidate in candidates.iter().filter(|c| !parent.has(&c.name)) {
                let is_known = |t: &Trial| parent.names().iter().all(|n| t.has(n)) && t.has(&candidate.name);
                if trials.iter().any(is_known) {
                    continue;
                }
                self.telling.report(Stage::Name, i as f64 / parents.len() as f64, None)?;
                match self.telling.in_rounds(Stage::Name, |on_round| parent.with(problem, candidate, on_round)) {
                    Ok(trial) => trials.push(trial),
                    Err(cancelled @ FinderError::Cancelled(_)) => return Err(cancelled),
                    // What cannot be simulated beside the others explains nothing.
                    Err(_) => (),
                }
            }
        }
        trials.sort_by(|a, b| a.promise.total_cmp(&b.promise));
        trials.truncate(self.settings.extensions);
        for trial in trials {
            match self.telling.in_rounds(Stage::Name, |on_round| trial.fitted(problem, yardstick, on_round)) {
                Ok(one) => hypotheses.push(one),
                Err(cancelled @ FinderError::Cancelled(_)) => return Err(cancelled),
                Err(_) => (),
            }
        }
        Ok(hypotheses)
    }

    /// The test of a model with effects: where it fails plainly, something is left.
    fn test(
        &mut self,
        hypothesis: Hypothesis,
        extent: Extent,
        finding: &Finding,
        stream: usize,
    ) -> Result<Best, FinderError> {
        let with = hypothesis.problem(self.problem);
        let detection = self.detect(&with, &hypothesis.fit, stream as u64, Stage::Repair)?;
        let fitness = self.agreement(&with, &hypothesis.fit)?.with(&detection);
        let closes = extent == Extent::Whole && fitness.test.p_value > self.settings.repaired_level;
        let extent = if closes { Extent::Whole } else { Extent::Part };
        self.telling.conclude(Stage::Repair, sentences::repaired(&hypothesis, &finding.present, &fitness, !closes))?;
        Ok(Best { hypothesis, extent, fitness })
    }

    /// Whether effects that leave something explain enough to be named: more than a smooth error does by itself, and the
    /// greater part of what there is.
    fn is_worth_naming(&self, base: &Hypothesis, best: &Hypothesis) -> bool {
        let coordinates = base.fit.residuals.len() as f64;
        let share = 1.0 - (best.fit.cost - coordinates).max(0.0) / (base.fit.cost - coordinates).max(f64::MIN_POSITIVE);
        let gain = best.evidence.with_any() - base.evidence.with_any();
        share >= self.settings.least_share && gain >= self.settings.least_log_bayes_factor
    }

    /// What the repair is worth on the held-out episodes, and what pictures show of them.
    fn verify(
        &mut self,
        base: &Hypothesis,
        best: &Hypothesis,
        ranking: &Ranking,
    ) -> Result<(Verification, Vec<Shown>), FinderError> {
        self.telling.report(Stage::Verify, 0.0, None)?;
        let alike = ranking.alike(self.settings);
        let is_wrong = |h: &&Hypothesis| {
            let is_other = alike.iter().all(|a| !a.is_same(&h.candidates));
            h.depth != Depth::Promised && h.candidates.len() == 1 && !best.has(&h.candidates[0].name) && is_other
        };
        let wrong = ranking.hypotheses.iter().find(is_wrong);
        let (verifier, camera) = (self.verifier(), &self.question.model.camera.view);
        let (verification, [before, after]) =
            self.telling.in_rounds(Stage::Verify, |on_round| verifier.verify(base, best, wrong, on_round))?;
        let draws = before.draws.iter().zip(&after.draws);
        let shown = self.held_out.iter().zip(draws).map(|(case, (b, a))| Shown::held_out(case, b, a, camera));
        Ok((verification, shown.collect()))
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
        self.telling.report(stage, 0.0, None)?;
        let mut rounds = 0.0;
        let mut on_round = || {
            rounds += 1.0;
            told(self.telling.on_progress, stage, rounds / (rounds + 4.0), None)
        };
        detect(problem, fit, self.settings, stream, &mut on_round).map_err(|e| in_stage(e, stage))
    }

    fn agreement(&self, problem: &Problem<'_>, fit: &Fit) -> Result<Agreement, FinderError> {
        Agreement::new(problem, fit, &self.question.model.camera.view, self.settings)
    }
}

/// Models that are looked at more closely, of all the most probable.
const PARENTS: usize = 3;
/// A value is near an edge of its prior where it lies within as many of its standard deviations, and this share of the prior.
const NEAR_SDS: f64 = 3.0;
const NEAR: f64 = 0.1;
/// How many times fewer draws and starts look for the best fit of a model that is not the most probable.
const FEWER: usize = 4;
/// What a further effect leaves of held-out episodes, over what is left without it, is at most this.
const LEAST_SHRINK: f64 = 0.98;
/// Most steps of a fit beside a discrepancy.
const REWEIGHINGS: usize = 10;
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
