//! Search for what is missing where no effect explains the rest: in which part of the simulator, where and when it acts.
//!
//! Linear models at the fit weigh the parts: each template at each place or frequency alone, and all templates of a part
//! together, as smooth functions of place or time. The last stand for what is no template itself. All parts are equally
//! likely a priori, and so are all kinds of models in a part. The likeliest templates are then fitted, because a linear model
//! errs where they are large.

use super::context::Search;
use super::progress::Stage;
use super::template_groups::{Group, Kind};
use crate::error::FinderError;
use crate::evidence::{Baseline, Hypothesis, Refined, WeighedModel, Weighing, Whitening};
use crate::report::{Alternative, Form, Missing, sentences, shows_most};
use crate::template::Template;
use catenary_core::mixture::log_sum_exp;
use nalgebra::{DMatrix, DVector};
use track_fit::data::Candidate;
use track_fit::fitting::{Fit, Probe, Problem, Start};

/// Least probability of a listed alternative.
const LISTED: f64 = 0.01;
/// Number of the likeliest settings from which templates are fitted, each from the size of the linear model and from a part of
/// it, because a linear model overshoots.
const SETTINGS: usize = 3;
const SIZES: [f64; 2] = [1.0, 0.3];
/// Number of groups that are fitted beside those at a place.
const OTHERS: usize = 2;

/// Depth of a search for what is missing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Depth {
    /// Linear models alone, at a fraction of the cost. They underrate what is large.
    Linear,
    /// The likeliest templates are fitted, too.
    Fitted,
}

/// Weighed models of the templates.
struct Weighed<'a> {
    groups: Vec<Group<'a>>,
    kinds: Vec<Kind<'a>>,
    /// Models of each kind after the data.
    models: Vec<Vec<WeighedModel>>,
    /// Fitted templates of the kinds; none for a mixture, or if no fit is better than the linear models.
    fitted: Vec<Option<Fitted>>,
}

/// Fitted templates of a group.
struct Fitted {
    /// Gain in log evidence.
    gain: f64,
    /// Sizes relative to the largest ones of the priors.
    sizes: Vec<f64>,
    companion: Option<f64>,
}

/// Linear models of the templates at a fit.
struct Linear<'a> {
    fit: &'a Fit,
    /// Changes by the largest sizes of the priors.
    columns: &'a DMatrix<f64>,
    weighing: &'a Weighing,
    whitenings: &'a [Whitening],
}

/// Part of the simulator with its probability.
struct Part<'a> {
    hook: &'a str,
    probability: f64,
    /// Likeliest group of templates.
    group: &'a Group<'a>,
    /// Models of its settings.
    settings: &'a [WeighedModel],
    fitted: Option<&'a Fitted>,
}

impl<'a> Search<'a> {
    /// Missing thing that the residual of `model` shows; none without templates, or if none explains more than a smooth
    /// discrepancy.
    pub(super) fn missing(&mut self, model: &Hypothesis, baseline: &Baseline) -> Result<Option<Missing>, FinderError> {
        if self.question.templates.is_empty() {
            return Ok(None);
        }
        let found = if_linear(self.weigh(model, baseline, self.question.templates, Depth::Fitted))?;
        let found = found.and_then(|(_, missing)| missing);
        self.reporter.conclude(Stage::Repair, sentences::missing(found.as_ref()))?;
        Ok(found)
    }

    /// Gain in log evidence of `model` by things that no effect of the library is; zero without templates.
    pub(super) fn gain_by_templates(
        &mut self,
        model: &Hypothesis,
        baseline: &Baseline,
        depth: Depth,
    ) -> Result<f64, FinderError> {
        let unknown: Vec<Template> = self.question.templates.iter().filter(|t| !t.is_known).cloned().collect();
        if unknown.is_empty() {
            return Ok(0.0);
        }
        Ok(if_linear(self.weigh(model, baseline, &unknown, depth))?.map_or(0.0, |(gain, _)| gain))
    }

    /// Gain in log evidence of `model` by all templates together, and the likeliest of them.
    fn weigh(
        &mut self,
        model: &Hypothesis,
        baseline: &Baseline,
        templates: &[Template],
        depth: Depth,
    ) -> Result<Option<(f64, Option<Missing>)>, FinderError> {
        let problem = model.problem(self.problem);
        // A fit beside a discrepancy is whitened, so that the model is linearised again at its point.
        let start = vec![Start { point: model.fit.point.clone(), tracks: problem.measured() }];
        let seen = self.reporter.with_progress(Stage::Repair, |on_round| problem.linearise(start, on_round))?;
        let Some(fit) = seen.into_iter().flatten().next().map(|seen| seen.fit) else { return Ok(None) };
        let groups = Group::all(templates, &problem);
        let probes: Vec<Probe<'_>> = groups.iter().flat_map(Group::probes).collect();
        let mut columns =
            self.reporter.with_progress(Stage::Repair, |on_round| problem.probed(&fit, &probes, on_round))?;
        // Changes by the largest sizes of the priors.
        groups.iter().flat_map(Group::scales).for_each(|(column, scale)| columns.column_mut(column).scale_mut(scale));
        let share = self.settings.discrepancy_share;
        let each = share.ln() - (model.evidence.with.len() as f64).ln();
        let logs: Vec<f64> = model.evidence.with.iter().map(|log| each + log).collect();
        let log_alone = (1.0 - share).ln() + model.evidence.alone;
        let weighing = Weighing::new(&fit, &columns, log_alone, &logs, baseline.whitenings());
        let weighing = weighing.ok_or_else(FinderError::curvature)?;
        let mut weighed = Weighed::of(groups, &weighing).ok_or_else(FinderError::curvature)?;
        let linear = Linear { fit: &fit, columns: &columns, weighing: &weighing, whitenings: baseline.whitenings() };
        let promising = if depth == Depth::Fitted { weighed.promising() } else { Vec::new() };
        for kind in promising {
            let fitted = self.fitted(&problem, model, &linear, &weighed, kind)?;
            weighed.fitted[kind] = fitted.filter(|fitted| fitted.gain > weighed.gain(kind));
        }
        let gain = weighed.total_gain();
        let parts = weighed.parts(self.settings.least_log_bayes_factor);
        let Some((first, others)) = parts.split_first() else { return Ok(Some((gain, None))) };
        let likeliest = first.likeliest();
        let change = columns.select_columns(&first.group.columns(likeliest)) * &first.settings[likeliest].sizes;
        let Some(phase) = shows_most(&problem.channels(), &(&change + &fit.jacobian * followed(&fit, &change))) else {
            return Ok(Some((gain, None)));
        };
        let alternative = |part: &Part<'_>| Alternative {
            hook: part.hook.to_owned(),
            probability: part.probability,
            form: part.form(),
        };
        let missing = Missing {
            hook: first.hook.to_owned(),
            probability: first.probability,
            form: first.form(),
            episode: phase.episode,
            phase_s: phase.times_s,
            alternatives: others.iter().filter(|p| p.probability >= LISTED).map(alternative).collect(),
        };
        Ok(Some((gain, Some(missing))))
    }

    /// Templates of kind number `kind` fitted together with all unknowns of `model`, from the likeliest settings of the linear
    /// models. None if no start can be fitted.
    fn fitted(
        &mut self,
        problem: &Problem<'_>,
        model: &Hypothesis,
        linear: &Linear<'_>,
        weighed: &Weighed<'_>,
        kind: usize,
    ) -> Result<Option<Fitted>, FinderError> {
        let Linear { fit, columns, weighing, whitenings } = *linear;
        let Some(group) = weighed.kinds[kind].group.map(|group| &weighed.groups[group]) else { return Ok(None) };
        let settings = &weighed.models[kind];
        let candidates = group.as_candidates();
        let unknowns = candidates.iter().fold(model.unknowns.clone(), |all, candidate| all.with(candidate));
        let own = Problem { unknowns, ..*problem };
        let start = |(setting, share): (usize, f64)| {
            let sizes = share * &settings[setting].sizes;
            let change = columns.select_columns(&group.columns(setting)) * &sizes;
            let moved = followed(fit, &change);
            let values = group.templates.iter().zip(sizes.iter()).map(|(template, size)| template.most * size);
            let values = values.chain(group.companion_at(setting));
            let further = candidates.iter().zip(values).map(|(candidate, value)| candidate.search().to_unit(value));
            let point = fit.point.iter().zip(moved.iter()).map(|(u, by)| u + by).chain(further);
            Start { point: point.map(|u| u.clamp(0.0, 1.0)).collect(), tracks: own.measured() }
        };
        let ranked = ranked(settings);
        let starts = ranked.into_iter().take(SETTINGS).flat_map(|setting| SIZES.map(|share| (setting, share)));
        let starts: Vec<Start> = starts.map(start).collect();
        let found = self.reporter.with_progress(Stage::Repair, |on_round| {
            let seen = own.linearise(starts, on_round)?.into_iter().flatten().collect();
            own.minimise_best(seen, on_round)
        });
        let found = match found {
            Err(FinderError::NoFit(_)) => return Ok(None),
            found => found?,
        };
        let further = &found.point[fit.point.len()..];
        let values: Vec<f64> = candidates.iter().zip(further).map(|(c, u)| c.search().from_unit(*u)).collect();
        let (own_values, companion) = values.split_at(group.templates.len());
        let sizes: Vec<f64> = own_values.iter().zip(&group.templates).map(|(value, t)| value / t.most).collect();
        let width = |(candidate, template): (&Candidate, &&Template)| {
            let (low, high) = candidate.search().bounds();
            (high - low) / template.most
        };
        let widths = candidates.iter().zip(&group.templates).map(width);
        let scales = widths.zip(&sizes).map(|(width, size)| [width, *size]).collect();
        let refined = Refined { fit: &found, sizes: sizes.len(), companions: companion.len(), scales };
        let gain = weighing.gain_of(&refined, whitenings);
        Ok(gain.map(|gain| Fitted { gain, companion: companion.first().copied(), sizes }))
    }
}

impl<'a> Weighed<'a> {
    /// Weighs the models of all groups; none if a matrix is not positive definite.
    fn of(groups: Vec<Group<'a>>, weighing: &Weighing) -> Option<Self> {
        let kinds = Kind::all(&groups);
        let models = kinds.iter().map(|kind| weighing.weigh(&kind.models)).collect::<Option<Vec<_>>>()?;
        let fitted = kinds.iter().map(|_| None).collect();
        Some(Self { groups, kinds, models, fitted })
    }

    /// Gain in log evidence by the models of kind number `i`.
    fn gain(&self, i: usize) -> f64 {
        let linear = mean(self.models[i].iter().map(|model| model.gain));
        self.fitted[i].as_ref().map_or(linear, |fitted| fitted.gain.max(linear))
    }

    /// Kinds whose templates are fitted: those at a place, because the change by a mass or a joint is far from linear in its
    /// size and place, and the most probable others.
    fn promising(&self) -> Vec<usize> {
        let group = |i: usize| self.kinds[i].group.map(|group| &self.groups[group]);
        let mut all: Vec<usize> = (0..self.kinds.len()).filter(|&i| group(i).is_some()).collect();
        all.sort_by(|a, b| self.gain(*b).total_cmp(&self.gain(*a)));
        let mut others = 0;
        all.retain(|&i| {
            let is_placed = group(i).is_some_and(Group::is_placed);
            others += usize::from(!is_placed);
            is_placed || others <= OTHERS
        });
        all
    }

    /// Places of the kinds of a part.
    fn of_part(&self, hook: &str) -> Vec<usize> {
        (0..self.kinds.len()).filter(|&i| self.kinds[i].hook == hook).collect()
    }

    /// Parts with their gains in log evidence.
    fn gains(&self) -> (Vec<&'a str>, Vec<f64>) {
        let mut hooks: Vec<&str> = self.kinds.iter().map(|kind| kind.hook).collect();
        hooks.dedup();
        let gains = hooks.iter().map(|hook| mean(self.of_part(hook).into_iter().map(|i| self.gain(i)))).collect();
        (hooks, gains)
    }

    /// Gain in log evidence by all parts together.
    fn total_gain(&self) -> f64 {
        mean(self.gains().1.into_iter())
    }

    /// Parts of the simulator, the most probable first; empty if all together gain less than `least` nats.
    fn parts(&self, least: f64) -> Vec<Part<'_>> {
        let (hooks, gains) = self.gains();
        if self.total_gain() < least {
            return Vec::new();
        }
        let total = log_sum_exp(&gains);
        let part = |(hook, gain): (&&str, &f64)| {
            let groups = self.of_part(hook).into_iter().filter_map(|i| Some((i, self.kinds[i].group?)));
            let (kind, group) = groups.max_by(|a, b| self.gain(a.0).total_cmp(&self.gain(b.0)))?;
            let (group, settings) = (&self.groups[group], &self.models[kind][..]);
            let (probability, fitted) = ((gain - total).exp(), self.fitted[kind].as_ref());
            Some(Part { hook: group.hook(), probability, group, settings, fitted })
        };
        let mut parts: Vec<Part<'_>> = hooks.iter().zip(&gains).filter_map(part).collect();
        parts.sort_by(|a, b| b.probability.total_cmp(&a.probability));
        parts
    }
}

impl Part<'_> {
    /// Likeliest setting of the linear models.
    fn likeliest(&self) -> usize {
        ranked(self.settings)[0]
    }

    /// Form of the group: as fitted, or by the linear model at its likeliest setting.
    fn form(&self) -> Form {
        match self.fitted {
            Some(Fitted { sizes, companion, .. }) => self.group.form(sizes, *companion),
            None => {
                let setting = self.likeliest();
                self.group.form(self.settings[setting].sizes.as_slice(), self.group.companion_at(setting))
            }
        }
    }
}

/// What was found; none if the model cannot be linearised, and so shows nothing.
fn if_linear<T>(found: Result<Option<T>, FinderError>) -> Result<Option<T>, FinderError> {
    match found {
        Err(FinderError::Simulator(_) | FinderError::NoFit(_)) => Ok(None),
        found => found,
    }
}

/// Settings, the likeliest first.
fn ranked(settings: &[WeighedModel]) -> Vec<usize> {
    let mut ranked: Vec<usize> = (0..settings.len()).collect();
    ranked.sort_by(|a, b| settings[*b].gain.total_cmp(&settings[*a].gain));
    ranked
}

/// Log mean of numbers given by their logarithms.
fn mean(logs: impl Iterator<Item = f64>) -> f64 {
    let logs: Vec<f64> = logs.collect();
    log_sum_exp(&logs) - (logs.len() as f64).ln()
}

/// Step of the unknowns of a fit by which they follow a change of the simulated values: the rest of the change is least.
fn followed(fit: &Fit, change: &DVector<f64>) -> DVector<f64> {
    let n = fit.point.len();
    let curvature = fit.curvature() + DMatrix::identity(n, n);
    curvature.cholesky().map_or_else(|| DVector::zeros(n), |factor| -factor.solve(&fit.jacobian.tr_mul(change)))
}
