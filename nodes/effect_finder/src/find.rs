//! The whole search: calibrate, detect, localise, name, repair.

use crate::candidate::Candidate;
use crate::case::Case;
use crate::detect::{Detection, detect};
use crate::error::FinderError;
use crate::fit::{Fit, OnRound, Problem, Seen, Start, presses};
use crate::laplace::Laplace;
use crate::localise;
use crate::name::{self, Fitted};
use crate::repair::repaired;
use crate::sentences::{detected, fitted, located, named};
use crate::settings::Settings;
use crate::unknowns::{Scope, Unknowns};
use crate::verdict::{Estimate, Finding, Fitness, Verdict};
use catenary_core::episode::MeasuredTrack;
use catenary_core::{DifferentiableSimulator, Model, seed};
use rand::RngExt;
use std::ops::ControlFlow;

/// Random streams of the search, beyond those of the null sets.
const START_STREAM: u64 = 1;
const ESTIMATE_STREAM: u64 = 2;
/// Draws behind the quantiles of an estimate.
const ESTIMATE_DRAWS: usize = 1000;

/// A stage of the search.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    /// The present model is fitted.
    Calibrate,
    /// What is left is tested against noise.
    Detect,
    /// Where it lies.
    Localise,
    /// Which effect explains it.
    Name,
    /// The model with that effect is tested.
    Repair,
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
        }
    }

    /// Shares of the whole search after which the stage begins and ends, roughly.
    fn span(self) -> [f64; 2] {
        match self {
            Stage::Calibrate => [0.0, 0.05],
            Stage::Detect => [0.05, 0.3],
            Stage::Localise => [0.3, 0.3],
            Stage::Name => [0.3, 0.7],
            Stage::Repair => [0.7, 1.0],
        }
    }
}

/// How far a search is.
#[derive(Debug, Clone, PartialEq)]
pub struct Progress {
    /// The present stage.
    pub stage: Stage,
    /// Share of the whole search that is done, roughly.
    pub progress: f64,
    /// What the stage came to, once it has come to it.
    pub conclusion: Option<String>,
}

/// Told of progress; says whether to go on.
pub type OnProgress<'a> = &'a mut dyn FnMut(&Progress) -> ControlFlow<()>;

/// Finds where `model` and the measured episodes disagree, and which candidate explains it. Returns the finding and, where an
/// effect was found, the repaired model. The same arguments give the same bits.
///
/// # Errors
/// [`FinderError`].
pub fn find(
    model: &Model,
    measured: &[MeasuredTrack],
    candidates: &[Candidate],
    simulator: &dyn DifferentiableSimulator,
    settings: &Settings,
    on_progress: OnProgress<'_>,
) -> Result<(Finding, Option<Model>), FinderError> {
    settings.check()?;
    if measured.is_empty() {
        return Err(FinderError::NoEpisode);
    }
    let cases: Result<Vec<Case>, _> =
        measured.iter().enumerate().map(|(i, m)| Case::new(model, m, i, settings)).collect();
    let cases = cases?;
    let unknowns = Unknowns::of(model, cases.len());
    let problem = Problem { simulator, unknowns, cases: &cases, rounds: settings.rounds };
    let mut search = Search { model, problem: &problem, settings, on_progress, conclusions: Vec::new() };
    search.run(candidates)
}

struct Search<'a> {
    model: &'a Model,
    problem: &'a Problem<'a>,
    settings: &'a Settings,
    on_progress: OnProgress<'a>,
    conclusions: Vec<String>,
}

impl Search<'_> {
    fn run(&mut self, candidates: &[Candidate]) -> Result<(Finding, Option<Model>), FinderError> {
        let (fit, agreement) = self.calibrate()?;
        let pressing = self.pressing(&fit);
        let detection = self.detect(self.problem, &fit, 0, Stage::Detect)?;
        let fitness = agreement.with(&detection);
        let is_gap = fitness.test.p_value <= self.settings.level;
        self.conclude(Stage::Detect, detected(&fitness, is_gap))?;
        let places = localise::localise(&fit, &self.problem.channels(), &detection);
        let mut finding = Finding {
            verdict: Verdict::NoGap,
            conclusions: Vec::new(),
            present: fitness,
            places,
            pressing,
            explanations: Vec::new(),
            left_out: Vec::new(),
            probability_of_none: 1.0,
            effects: Vec::new(),
            repaired: None,
        };
        let mut model = None;
        if is_gap {
            self.conclude(Stage::Localise, located(&finding.places, self.settings.level))?;
            if self.closes_with_open_priors(&fit, &finding, &detection)? {
                finding.verdict = Verdict::PriorTooNarrow;
            } else {
                model = self.name(&fit, candidates, &mut finding)?;
            }
        }
        finding.conclusions = std::mem::take(&mut self.conclusions);
        Ok((finding, model))
    }

    /// The best fit of the present model: from the best of many draws of the prior.
    fn calibrate(&mut self) -> Result<(Fit, Agreement), FinderError> {
        self.report(Stage::Calibrate, 0.0, None)?;
        let columns = self.problem.unknowns.columns();
        let mut rng = seed::rng(self.settings.seed, START_STREAM);
        let mut points: Vec<Vec<f64>> =
            (0..self.settings.draws).map(|_| (0..columns).map(|_| rng.random::<f64>()).collect()).collect();
        points[0] = vec![0.5; columns];
        let starts = points.into_iter().map(|point| Start { point, tracks: self.problem.measured() }).collect();
        let (problem, most) = (self.problem, self.settings.starts);
        let fits = self.in_rounds(Stage::Calibrate, |on_round| {
            let mut seen: Vec<Seen> = problem.look(starts, on_round)?.into_iter().flatten().collect();
            seen.sort_by(|a, b| a.fit.cost.total_cmp(&b.fit.cost));
            seen.truncate(most);
            problem.climb(seen, on_round)
        })?;
        let best = fits.into_iter().min_by(|a, b| a.cost.total_cmp(&b.cost));
        let fit = best.ok_or_else(|| FinderError::NoFit("no start was left".into()))?;
        let agreement = self.agreement(problem, &fit)?;
        self.conclude(Stage::Calibrate, fitted(&agreement.estimates, agreement.rmse_mm))?;
        Ok((fit, agreement))
    }

    /// Compares candidates, and tests the model with the best.
    fn name(
        &mut self,
        base: &Fit,
        candidates: &[Candidate],
        finding: &mut Finding,
    ) -> Result<Option<Model>, FinderError> {
        let mut fitted: Vec<Fitted> = Vec::new();
        for (i, candidate) in candidates.iter().enumerate() {
            let share = i as f64 / candidates.len() as f64;
            self.report(Stage::Name, share, None)?;
            let mut on_round = || told(self.on_progress, Stage::Name, share, None);
            match name::try_candidate(self.problem, base, candidate, &mut on_round) {
                Ok(one) => fitted.push(one),
                Err(FinderError::Cancelled(_)) => return Err(FinderError::Cancelled(Stage::Name.name())),
                Err(error) => finding.left_out.push((candidate.name.clone(), error.to_string())),
            }
        }
        let (ranked, probability_of_none) = name::rank(self.problem, fitted)?;
        finding.explanations = ranked.iter().map(|f| f.explanation.clone()).collect();
        finding.probability_of_none = probability_of_none;
        let Some(best) = ranked.first() else {
            finding.verdict = Verdict::NoneOfThese;
            self.conclude(Stage::Name, "no candidate can act in this model".into())?;
            return Ok(None);
        };
        let group = name::group(&ranked, self.settings);
        self.conclude(Stage::Name, named(&group, best))?;
        let with = Problem { unknowns: best.unknowns.clone(), ..*self.problem };
        let detection = self.detect(&with, &best.fit, 1, Stage::Repair)?;
        let fitness = self.agreement(&with, &best.fit)?.with(&detection);
        let closes = fitness.test.p_value > self.settings.level;
        let sentence = format!(
            "with {} RMSE {:.1} -> {:.1} mm; {}",
            best.explanation.title,
            finding.present.rmse_mm,
            fitness.rmse_mm,
            detected(&fitness, !closes)
        );
        self.conclude(Stage::Repair, sentence)?;
        finding.verdict = match (closes && !group.is_empty(), group.len()) {
            (false, _) => Verdict::NoneOfThese,
            (true, 1) => Verdict::Named,
            (true, _) => Verdict::CannotTellApart,
        };
        finding.repaired = Some(fitness);
        if finding.verdict == Verdict::NoneOfThese {
            return Ok(None);
        }
        finding.effects = group.iter().map(|f| f.candidate.name.clone()).collect();
        Ok(Some(repaired(self.model, &best.candidate, &best.explanation)?))
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
        let start = Start { point, tracks: self.problem.measured() };
        let fits = match self.in_rounds(Stage::Localise, |on_round| open.fit(vec![start], on_round)) {
            // Beyond the edge there may be nothing that can be simulated.
            Err(FinderError::NoFit(_)) => return Ok(false),
            other => other?,
        };
        let Some(best) = fits.into_iter().flatten().next() else { return Ok(false) };
        let p_value = crate::detect::p_value(best.cost, detection.null.iter().map(|f| f.cost));
        let closes = p_value > self.settings.level;
        if closes {
            let sentence = format!(
                "{} at the edge of the prior; beyond it the gap closes (p = {p_value:.3})",
                finding.pressing.join(", ")
            );
            self.conclude(Stage::Localise, sentence)?;
        }
        Ok(closes)
    }

    /// Parameters of theta that press on an edge of their prior.
    fn pressing(&self, fit: &Fit) -> Vec<String> {
        let unknowns = &self.problem.unknowns;
        let (theta, gradient) = (unknowns.list()[..unknowns.theta()].iter().enumerate(), fit.gradient());
        let at_edge = |column: usize| presses(fit.point[column], gradient[column]);
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
        self.report(stage, 0.0, None)?;
        let mut rounds = 0.0;
        let mut on_round = || {
            rounds += 1.0;
            told(self.on_progress, stage, rounds / (rounds + 4.0), None)
        };
        detect(problem, fit, self.settings, stream, &mut on_round).map_err(|e| in_stage(e, stage))
    }

    fn agreement(&self, problem: &Problem<'_>, fit: &Fit) -> Result<Agreement, FinderError> {
        Ok(Agreement { estimates: self.estimates(problem, fit)?, rmse_mm: self.rmse_mm(problem, fit) })
    }

    /// Values that all episodes share, with their intervals.
    fn estimates(&self, problem: &Problem<'_>, fit: &Fit) -> Result<Vec<Estimate>, FinderError> {
        let posterior =
            Laplace::of(fit).ok_or_else(|| FinderError::NoFit("the fit's curvature is no positive matrix".into()))?;
        let mut rng = seed::rng(self.settings.seed, ESTIMATE_STREAM);
        let draws: Vec<Vec<f64>> =
            (0..ESTIMATE_DRAWS).map(|_| problem.unknowns.values(&posterior.draw(&mut rng), 0)).collect();
        let best = problem.unknowns.values(&fit.point, 0);
        let shared = problem.unknowns.list().iter().enumerate().filter(|(_, u)| u.scope == Scope::Shared);
        let estimate = |(i, u): (usize, &crate::unknowns::Unknown)| {
            let mut values: Vec<f64> = draws.iter().map(|d| d[i]).collect();
            values.sort_by(f64::total_cmp);
            let quantile = |q: f64| values[(q * (values.len() - 1) as f64).round() as usize];
            Estimate { name: u.name.clone(), value: best[i], q05: quantile(0.05), q95: quantile(0.95) }
        };
        Ok(shared.map(estimate).collect())
    }

    fn rmse_mm(&self, problem: &Problem<'_>, fit: &Fit) -> f64 {
        let camera = &self.model.camera.view;
        let squares: Vec<f64> =
            problem.cases.iter().zip(&fit.tracks).map(|(case, t)| case.rmse_mm(t, camera).powi(2)).collect();
        (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
    }

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

/// How well a fit agrees with the data, before it is tested.
struct Agreement {
    estimates: Vec<Estimate>,
    rmse_mm: f64,
}

impl Agreement {
    fn with(self, detection: &Detection) -> Fitness {
        Fitness { estimates: self.estimates, test: detection.summary(), rmse_mm: self.rmse_mm }
    }
}

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
