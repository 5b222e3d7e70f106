//! Search for what is missing where no effect explains the rest: in which part of the simulator, where and when it acts.
//!
//! Linear models at the fit weigh the parts: each template at each place or frequency alone, and all templates of a part
//! together, as smooth functions of place or time. The last stand for what is no template itself. All parts are equally
//! likely a priori, and so are all kinds of models in a part.

use super::context::Search;
use super::progress::Stage;
use super::template_groups::{Group, Kind};
use crate::error::FinderError;
use crate::evidence::{Baseline, Hypothesis, LinearModel, WeighedModel, weigh};
use crate::fitting::{Fit, Probe, Problem, Start};
use crate::report::{Alternative, Form, Missing, sentences, shows_most};
use catenary_core::mixture::log_sum_exp;
use nalgebra::{DMatrix, DVector};

/// Least probability of a listed alternative.
const LISTED: f64 = 0.01;

/// Weighed models of the templates.
struct Weighed<'a> {
    groups: Vec<Group<'a>>,
    kinds: Vec<Kind<'a>>,
    /// Models of each kind after the data.
    models: Vec<Vec<WeighedModel>>,
}

/// Part of the simulator with its probability.
struct Part<'a> {
    hook: &'a str,
    probability: f64,
    /// Likeliest group of templates.
    group: &'a Group<'a>,
    /// Models of its settings.
    settings: &'a [WeighedModel],
}

impl<'a> Search<'a> {
    /// Missing thing that the residual of `model` shows; none without templates, or if none explains more than a smooth
    /// discrepancy.
    pub(super) fn missing(&mut self, model: &Hypothesis, baseline: &Baseline) -> Result<Option<Missing>, FinderError> {
        if self.question.templates.is_empty() {
            return Ok(None);
        }
        let found = match self.weigh_and_fit(model, baseline) {
            // Templates that cannot be simulated here say nothing.
            Err(FinderError::Simulator(_) | FinderError::NoFit(_)) => None,
            other => other?,
        };
        self.reporter.conclude(Stage::Repair, sentences::missing(found.as_ref()))?;
        Ok(found)
    }

    fn weigh_and_fit(&mut self, model: &Hypothesis, baseline: &Baseline) -> Result<Option<Missing>, FinderError> {
        let problem = model.problem(self.problem);
        // A fit beside a discrepancy is whitened, so that the model is linearised again at its point.
        let start = vec![Start { point: model.fit.point.clone(), tracks: problem.measured() }];
        let seen = self.reporter.with_progress(Stage::Repair, |on_round| problem.linearise(start, on_round))?;
        let Some(fit) = seen.into_iter().flatten().next().map(|seen| seen.fit) else { return Ok(None) };
        let (weighed, columns) = self.weighed(&problem, &fit, model, baseline)?;
        let parts = weighed.parts(self.settings.least_log_bayes_factor);
        let Some((first, others)) = parts.split_first() else { return Ok(None) };
        let likeliest = first.likeliest();
        let change = columns.select_columns(&first.group.columns(likeliest)) * &first.settings[likeliest].sizes;
        let Some(phase) = shows_most(&problem.channels(), &left_of(&fit, &change)) else { return Ok(None) };
        let alternative = |part: &Part<'_>| Alternative {
            hook: part.hook.to_owned(),
            probability: part.probability,
            form: part.form(),
        };
        Ok(Some(Missing {
            hook: first.hook.to_owned(),
            probability: first.probability,
            form: first.form(),
            episode: phase.episode,
            phase_s: phase.times_s,
            alternatives: others.iter().filter(|p| p.probability >= LISTED).map(alternative).collect(),
        }))
    }

    /// Weighed templates at the fit of `model`, with the changes of the simulated values by the largest sizes of the priors,
    /// a column for each template and setting.
    fn weighed(
        &mut self,
        problem: &Problem<'_>,
        fit: &Fit,
        model: &Hypothesis,
        baseline: &Baseline,
    ) -> Result<(Weighed<'a>, DMatrix<f64>), FinderError> {
        let groups = Group::all(self.question.templates, problem);
        let probes: Vec<Probe<'_>> = groups.iter().flat_map(Group::probes).collect();
        let mut columns =
            self.reporter.with_progress(Stage::Repair, |on_round| problem.probed(fit, &probes, on_round))?;
        groups.iter().flat_map(Group::scales).for_each(|(column, scale)| columns.column_mut(column).scale_mut(scale));
        let kinds = Kind::all(&groups);
        let all: Vec<LinearModel> = kinds.iter().flat_map(|kind| kind.models.clone()).collect();
        let share = self.settings.discrepancy_share;
        let logs = [model.evidence.alone + (1.0 - share).ln(), share.ln()];
        let weighed = weigh(fit, &columns, &all, logs, &model.evidence.with, baseline.whitenings());
        let mut rest = weighed.ok_or_else(FinderError::curvature)?.into_iter();
        let models = kinds.iter().map(|kind| rest.by_ref().take(kind.models.len()).collect()).collect();
        Ok((Weighed { groups, kinds, models }, columns))
    }
}

impl Weighed<'_> {
    /// Gain in log evidence by the models of kind number `i`.
    fn gain(&self, i: usize) -> f64 {
        mean(self.models[i].iter().map(|model| model.gain))
    }

    /// Parts of the simulator, the most probable first; empty if all together gain less than `least` nats.
    fn parts(&self, least: f64) -> Vec<Part<'_>> {
        let mut hooks: Vec<&str> = self.kinds.iter().map(|kind| kind.hook).collect();
        hooks.dedup();
        let own =
            |hook: &str| -> Vec<usize> { (0..self.kinds.len()).filter(|&i| self.kinds[i].hook == hook).collect() };
        let gains: Vec<f64> = hooks.iter().map(|hook| mean(own(hook).into_iter().map(|i| self.gain(i)))).collect();
        if mean(gains.iter().copied()) < least {
            return Vec::new();
        }
        let total = log_sum_exp(&gains);
        let part = |(hook, gain): (&&str, &f64)| {
            let groups = own(hook).into_iter().filter_map(|i| Some((i, self.kinds[i].group?)));
            let (kind, group) = groups.max_by(|a, b| self.gain(a.0).total_cmp(&self.gain(b.0)))?;
            let group = &self.groups[group];
            Some(Part { hook: group.hook(), probability: (gain - total).exp(), group, settings: &self.models[kind] })
        };
        let mut parts: Vec<Part<'_>> = hooks.iter().zip(&gains).filter_map(part).collect();
        parts.sort_by(|a, b| b.probability.total_cmp(&a.probability));
        parts
    }
}

impl Part<'_> {
    /// Likeliest setting of the group.
    fn likeliest(&self) -> usize {
        let greater = |a: &usize, b: &usize| self.settings[*a].gain.total_cmp(&self.settings[*b].gain);
        (0..self.settings.len()).max_by(greater).unwrap_or(0)
    }

    /// Form of the group at its likeliest setting.
    fn form(&self) -> Form {
        let setting = self.likeliest();
        self.group.form(setting, self.settings[setting].sizes.as_slice())
    }
}

/// Log mean of numbers given by their logarithms.
fn mean(logs: impl Iterator<Item = f64>) -> f64 {
    let logs: Vec<f64> = logs.collect();
    log_sum_exp(&logs) - (logs.len() as f64).ln()
}

/// Part of a change that the unknowns of the fit cannot follow.
fn left_of(fit: &Fit, change: &DVector<f64>) -> DVector<f64> {
    let curvature = fit.curvature() + DMatrix::identity(fit.point.len(), fit.point.len());
    match curvature.cholesky() {
        Some(factor) => change - &fit.jacobian * factor.solve(&fit.jacobian.tr_mul(change)),
        None => change.clone(),
    }
}
