//! Unknowns of a fit and their unit coordinates.

use crate::data::{Candidate, Companion};
use catenary_core::{Camera, Model, Prior};
use std::ops::Range;

/// Scope of an unknown: all episodes, or each by itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scope {
    /// One value for all episodes.
    Shared,
    /// Value drawn anew for each episode.
    PerEpisode,
}

/// Unknown of a fit.
#[derive(Debug, Clone, PartialEq)]
pub struct Unknown {
    /// Name of a parameter or an effect.
    pub name: String,
    /// Prior: unit coordinate u is its cumulative distribution function.
    pub prior: Prior,
    /// Mean and standard deviation of a Gaussian prior, which adds a row to the residuals; `prior` is then uniform over
    /// the support.
    pub gaussian: Option<[f64; 2]>,
    /// Scope of the value.
    pub scope: Scope,
    /// Candidate effect, if the unknown is one; `prior` is then uniform over its search range.
    pub candidate: Option<Candidate>,
    /// Name of the candidate effect whose companion the unknown is; none if it is no companion.
    pub companion_of: Option<String>,
}

/// Half the width of a Gaussian prior's coordinate, in standard deviations.
const REACH: f64 = 6.0;

/// Difference in a unit coordinate above which two points are far apart.
const APART: f64 = 0.05;

impl Unknown {
    fn new(name: &str, prior: Prior, scope: Scope) -> Self {
        let name = name.to_owned();
        match prior {
            Prior::Normal { mean, sd, low, high } => {
                let prior = Prior::Uniform { low: low.max(mean - REACH * sd), high: high.min(mean + REACH * sd) };
                Self { name, prior, scope, gaussian: Some([mean, sd]), candidate: None, companion_of: None }
            }
            prior => Self { name, prior, scope, gaussian: None, candidate: None, companion_of: None },
        }
    }

    /// Coordinate at quantile `u` of the prior. A candidate's own prior is narrower than its search range.
    fn drawn(&self, u: f64) -> f64 {
        match (&self.candidate, self.gaussian) {
            (Some(candidate), _) => self.prior.to_unit(candidate.drawn(u)),
            (None, Some([mean, sd])) => {
                let (low, high) = self.prior.bounds();
                self.prior.to_unit(Prior::Normal { mean, sd, low, high }.from_unit(u))
            }
            (None, None) => u,
        }
    }
}

/// Unknowns of E episodes: the model's theta, then the unknowns drawn for each episode, then the companions of all candidates,
/// and the candidates last.
///
/// A point has one coordinate for each value: one for theta and candidates, E for an unknown drawn for each episode.
#[derive(Debug, Clone, PartialEq)]
pub struct Unknowns {
    list: Vec<Unknown>,
    theta: usize,
    episodes: usize,
}

impl Unknowns {
    /// Unknowns of `episodes` episodes of the model: theta, the drawn effects, and the camera's jitter.
    pub fn of(model: &Model, episodes: usize) -> Self {
        let unknown = |name: &str, prior, scope| Unknown::new(name, prior, scope);
        let mut list: Vec<Unknown> =
            model.theta.parameters().iter().map(|p| unknown(&p.name, p.prior.clone(), Scope::Shared)).collect();
        list.extend(model.effects.iter().map(|e| unknown(&e.name, e.distribution.clone(), Scope::PerEpisode)));
        for (name, half) in camera_jitter(model) {
            if half > 0.0 && list.iter().all(|u| u.name != name) {
                list.push(unknown(name, Prior::Uniform { low: -half, high: half }, Scope::PerEpisode));
            }
        }
        Self { list, theta: model.theta.dimension(), episodes }
    }

    /// These unknowns and a candidate with its companions. If another unknown has its name, as the camera's jitter may, their
    /// values add up.
    #[must_use]
    pub fn with(&self, candidate: &Candidate) -> Self {
        let mut list = self.list.clone();
        // Candidates stay the last columns, in the order in which they came.
        let before = list.iter().position(|u| u.candidate.is_some()).unwrap_or(list.len());
        let companion = |c: &Companion| Unknown {
            companion_of: Some(candidate.name.clone()),
            ..Unknown::new(&c.name, c.prior.clone(), Scope::Shared)
        };
        list.splice(before..before, candidate.companions.iter().map(companion));
        let unknown = Unknown::new(&candidate.name, candidate.search(), Scope::Shared);
        list.push(Unknown { candidate: Some(candidate.clone()), ..unknown });
        Self { list, ..*self }
    }

    /// These unknowns with wider priors of those that `opens` names by their index: on both sides by their own width, or by
    /// a quarter of their values if that is more. Gaussians and mixtures become uniform. Positive values stay positive.
    #[must_use]
    pub fn opened(&self, opens: impl Fn(usize) -> bool) -> Self {
        let mut list = self.list.clone();
        for (_, unknown) in list.iter_mut().enumerate().filter(|(i, _)| opens(*i)) {
            let (low, high) = unknown.prior.bounds();
            unknown.gaussian = None;
            unknown.prior = match unknown.prior {
                Prior::LogUniform { .. } => {
                    // The width of a log-uniform prior is a ratio.
                    let factor = (high / low).sqrt().max(2.0);
                    Prior::LogUniform { low: low / factor, high: high * factor }
                }
                Prior::Uniform { .. } | Prior::Normal { .. } | Prior::Mixture(_) => {
                    let margin = (high - low).max(0.25 * low.abs().max(high.abs()));
                    // A positive value stays positive: a fifth of the old bound is low enough.
                    let least = if low > 0.0 { 0.2 * low } else { f64::NEG_INFINITY };
                    Prior::Uniform { low: (low - margin).max(least), high: high + margin }
                }
            };
        }
        Self { list, ..*self }
    }

    /// These unknowns for another number of episodes.
    #[must_use]
    pub fn for_episodes(&self, episodes: usize) -> Self {
        Self { episodes, ..self.clone() }
    }

    /// Point with the shared unknowns of `old`'s point `u` and the others at the middle of their priors. `old` has the
    /// same unknowns for any number of episodes.
    pub fn shared_from(&self, old: &Unknowns, u: &[f64]) -> Vec<f64> {
        let mut point = vec![0.5; self.columns()];
        for (i, unknown) in self.list.iter().enumerate() {
            if unknown.scope == Scope::Shared {
                point[self.column(i, 0)] = u[old.column(i, 0)];
            }
        }
        point
    }

    /// Point of one episode with all unknowns as in `old`'s first episode.
    pub fn from_first_episode(&self, old: &Unknowns, u: &[f64]) -> Vec<f64> {
        (0..self.list.len()).map(|i| u[old.column(i, 0)]).collect()
    }

    /// Unknowns in order.
    pub fn list(&self) -> &[Unknown] {
        &self.list
    }

    /// Names in order, each once.
    pub fn names(&self) -> Vec<&str> {
        let mut names: Vec<&str> = Vec::new();
        for unknown in &self.list {
            if !names.contains(&unknown.name.as_str()) {
                names.push(&unknown.name);
            }
        }
        names
    }

    /// Index of each unknown's name in [`Unknowns::names`].
    pub fn places(&self) -> Vec<usize> {
        let names = self.names();
        let place = |u: &Unknown| names.iter().position(|name| *name == u.name).expect("every unknown has a name");
        self.list.iter().map(place).collect()
    }

    /// Point of these parameters, with what is drawn for each episode at the middle of its prior.
    pub fn point_at(&self, theta: &[f64]) -> Vec<f64> {
        let mut point = vec![0.5; self.columns()];
        for (i, (value, unknown)) in theta.iter().zip(&self.list).enumerate() {
            point[self.column(i, 0)] = unknown.prior.to_unit(*value).clamp(0.0, 1.0);
        }
        point
    }

    /// Parameter values in an episode at the point `u`, in the order of [`Unknowns::names`].
    pub fn parameters(&self, u: &[f64], episode: usize) -> Vec<f64> {
        let mut sums = vec![0.0; self.names().len()];
        for (place, value) in self.places().into_iter().zip(self.values(u, episode)) {
            sums[place] += value;
        }
        sums
    }

    /// Number of episodes.
    pub fn episodes(&self) -> usize {
        self.episodes
    }

    /// Number of theta's parameters, which come first.
    pub fn theta(&self) -> usize {
        self.theta
    }

    /// Number of coordinates of a point.
    pub fn columns(&self) -> usize {
        self.list.iter().map(|u| self.width(u)).sum()
    }

    fn width(&self, unknown: &Unknown) -> usize {
        if unknown.scope == Scope::Shared { 1 } else { self.episodes }
    }

    /// Column of unknown `index` in an episode.
    pub fn column(&self, index: usize, episode: usize) -> usize {
        let before: usize = self.list[..index].iter().map(|u| self.width(u)).sum();
        before + if self.list[index].scope == Scope::Shared { 0 } else { episode }
    }

    /// Columns of the companions of all candidates.
    pub fn companion_columns(&self) -> Range<usize> {
        let is_first = |u: &Unknown| u.companion_of.is_some() || u.candidate.is_some();
        let from = self.list.iter().position(is_first).map_or(self.columns(), |i| self.column(i, 0));
        from..self.columns() - self.list.iter().filter(|u| u.candidate.is_some()).count()
    }

    /// Columns of the companions of the candidate `name`, in their order.
    pub fn companions_of(&self, name: &str) -> Vec<usize> {
        let own = self.list.iter().enumerate().filter(|(_, u)| u.companion_of.as_deref() == Some(name));
        own.map(|(i, _)| self.column(i, 0)).collect()
    }

    /// Index of the unknown in `old` that is unknown `index` here; none if `old` lacks it.
    pub fn place_in(&self, old: &Unknowns, index: usize) -> Option<usize> {
        let own = &self.list[index];
        old.list.iter().position(|other| other.name == own.name && other.scope == own.scope)
    }

    /// Scope of the unknown at `column`.
    pub fn scope_of(&self, column: usize) -> Scope {
        self.at(column).map_or(Scope::Shared, |unknown| unknown.scope)
    }

    /// Unknown at `column`; none without unknowns.
    pub fn at(&self, column: usize) -> Option<&Unknown> {
        let owner = (0..self.list.len()).rev().find(|&i| self.column(i, 0) <= column);
        owner.map(|i| &self.list[i])
    }

    /// Returns whether two points are far apart in a shared coordinate.
    pub fn are_apart(&self, a: &[f64], b: &[f64]) -> bool {
        let is_far = |column: usize| self.scope_of(column) == Scope::Shared && (a[column] - b[column]).abs() > APART;
        (0..self.columns()).any(is_far)
    }

    /// Values of all unknowns in an episode at the point `u`.
    pub fn values(&self, u: &[f64], episode: usize) -> Vec<f64> {
        let value = |(i, unknown): (usize, &Unknown)| unknown.prior.from_unit(u[self.column(i, episode)]);
        self.list.iter().enumerate().map(value).collect()
    }

    /// Point at the given prior quantiles, one a column.
    pub fn drawn(&self, mut quantiles: Vec<f64>) -> Vec<f64> {
        for (i, unknown) in self.list.iter().enumerate() {
            for episode in 0..self.width(unknown) {
                let u = &mut quantiles[self.column(i, episode)];
                *u = unknown.drawn(*u);
            }
        }
        quantiles
    }

    /// Residuals of the Gaussian priors at the point `u`: (mean less value in standard deviations, column, derivative
    /// of the value in standard deviations by the coordinate).
    pub fn prior_residuals(&self, u: &[f64]) -> Vec<(f64, usize, f64)> {
        let mut prior_residuals = Vec::new();
        for (i, unknown) in self.list.iter().enumerate() {
            let Some([mean, sd]) = unknown.gaussian else { continue };
            for episode in 0..self.width(unknown) {
                let column = self.column(i, episode);
                let value = unknown.prior.from_unit(u[column]);
                prior_residuals.push(((mean - value) / sd, column, unknown.prior.slope(value) / sd));
            }
        }
        prior_residuals
    }

    /// Derivative of unknown `index` by its coordinate, at `value`.
    pub fn slope(&self, index: usize, value: f64) -> f64 {
        self.list[index].prior.slope(value)
    }

    /// Point with `old`'s unknowns as at its point `u`, and the others at the middle of their priors.
    pub fn point_from(&self, old: &Unknowns, u: &[f64]) -> Vec<f64> {
        let mut point = vec![0.5; self.columns()];
        for (i, unknown) in self.list.iter().enumerate() {
            let Some(j) = self.place_in(old, i) else { continue };
            for episode in 0..self.episodes {
                let value = old.list[j].prior.from_unit(u[old.column(j, episode)]);
                point[self.column(i, episode)] = unknown.prior.to_unit(value).clamp(0.0, 1.0);
            }
        }
        point
    }
}

/// Unknowns of the camera's jitter in the plane of motion, with half widths. A pinhole camera that keeps looking at its
/// target mostly changes its distance, and so the scale; a camera without perspective is shifted.
fn camera_jitter(model: &Model) -> Vec<(&'static str, f64)> {
    let half_m = model.camera.position_jitter_m;
    match model.camera.view {
        Camera::Pinhole(p) => {
            let away = |i: usize| (p.position_m[i] - p.look_at_m[i]).powi(2);
            vec![("camera_scale_change", half_m / (away(0) + away(1) + away(2)).sqrt())]
        }
        Camera::Plane(_) => vec![("camera_offset_x_m", half_m), ("camera_offset_z_m", half_m)],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn model() -> Model {
        Model::from_yaml(include_str!("../../../../../launch_configs/models/soft_bar.yaml")).unwrap()
    }

    fn candidate(name: &str) -> Candidate {
        let prior = Prior::Uniform { low: -0.1, high: 0.1 };
        Candidate {
            name: name.into(),
            title: name.into(),
            prior,
            range: [-0.9, 10.0],
            base: 0.0,
            odds: 1.0,
            companions: Vec::new(),
        }
    }

    /// Candidate with companions of these names, with priors from 1 to 100.
    fn group(name: &str, companions: [&str; 2]) -> Candidate {
        let prior = Prior::LogUniform { low: 1.0, high: 100.0 };
        let companion = |name: &str| Companion { name: name.into(), title: name.into(), prior: prior.clone() };
        Candidate { companions: companions.map(companion).into(), ..candidate(name) }
    }

    #[test]
    fn companions_precede_all_candidates_and_are_drawn_from_their_priors() {
        let base = Unknowns::of(&model(), 2);
        let with = base
            .with(&group("a", ["a_place", "a_rate"]))
            .with(&candidate("b"))
            .with(&group("c", ["c_place", "c_rate"]));
        let added: Vec<&str> = with.list()[base.list().len()..].iter().map(|u| u.name.as_str()).collect();
        assert_eq!(added, ["a_place", "a_rate", "c_place", "c_rate", "a", "b", "c"]);
        let from = base.columns();
        assert_eq!((with.companion_columns(), base.companion_columns()), (from..from + 4, from..from));
        assert_eq!((with.companions_of("c"), with.companions_of("b").len()), (vec![from + 2, from + 3], 0));
        let point = with.drawn(vec![0.25; with.columns()]);
        let values = with.values(&point, 0);
        assert!((values[base.list().len()] - 10f64.sqrt()).abs() < 1e-12, "{values:?}");
        let smaller = base.with(&group("c", ["c_place", "c_rate"]));
        let moved = smaller.point_from(&with, &(0..with.columns()).map(|i| 0.05 * i as f64).collect::<Vec<_>>());
        for (own, old) in [(from, from + 2), (from + 1, from + 3), (from + 2, from + 6)] {
            assert!((moved[own] - 0.05 * old as f64).abs() < 1e-12, "{moved:?}");
        }
        assert_eq!(
            (smaller.place_in(&with, base.list().len()), with.place_in(&smaller, base.list().len())),
            (Some(base.list().len() + 2), None)
        );
    }

    #[test]
    fn theta_has_one_column_and_a_drawn_unknown_one_for_each_episode() {
        let unknowns = Unknowns::of(&model(), 3);
        let names = ["length_m", "youngs_modulus_pa", "kelvin_voigt_time_s", "table_friction", "camera_scale_change"];
        assert_eq!(unknowns.names(), names);
        assert_eq!(unknowns.columns(), 2 + 3 * 3);
        assert_eq!((unknowns.column(1, 2), unknowns.column(2, 2), unknowns.column(4, 0)), (1, 4, 8));
        let mut u = vec![0.5; 11];
        u[3] = 0.0;
        assert!((unknowns.values(&u, 1)[2] - 0.01).abs() < 1e-12, "the least damping in episode 1");
        assert!(unknowns.values(&u, 0)[2] > 0.02);
    }

    #[test]
    fn a_candidate_adds_to_an_unknown_of_the_same_name() {
        let base = Unknowns::of(&model(), 2);
        let scale = base.with(&candidate("camera_scale_change"));
        assert_eq!((scale.list().len(), scale.names().len(), scale.columns()), (6, 5, base.columns() + 1));
        let mut u = scale.point_from(&base, &vec![0.5; base.columns()]);
        assert!((u[8] - 0.5).abs() < 1e-12, "nobody has moved the candidate");
        (u[7], u[8]) = (1.0, 1.0);
        let [first, second] = [0, 1].map(|episode| scale.parameters(&u, episode)[4]);
        let half = 0.005 / 1.15;
        assert!((first - 0.3).abs() < 1e-12 && (second - 0.3 - half).abs() < 1e-12, "{first} {second}");
        let tilt = base.with(&candidate("gravity_tilt_rad"));
        assert_eq!((tilt.list().len(), tilt.columns()), (6, base.columns() + 1));
    }

    #[test]
    fn a_candidate_is_drawn_from_its_prior_not_from_its_search_range() {
        let with = Unknowns::of(&model(), 1).with(&candidate("gravity_tilt_rad"));
        let point = with.drawn(vec![0.9; with.columns()]);
        // The search range is -0.3 to 0.3; quantile 0.9 of -0.1 to 0.1 is 0.08.
        assert!((point[with.columns() - 1] - 0.38 / 0.6).abs() < 1e-12 && point[0] == 0.9, "{point:?}");
    }

    #[test]
    fn a_point_keeps_its_values_in_other_unknowns() {
        let base = Unknowns::of(&model(), 2);
        let u: Vec<f64> = (0..base.columns()).map(|i| 0.1 + 0.08 * i as f64).collect();
        let tilt = base.with(&candidate("gravity_tilt_rad"));
        let point = tilt.point_from(&base, &u);
        for episode in 0..2 {
            let (a, b) = (base.values(&u, episode), tilt.values(&point, episode));
            for (x, y) in a.iter().zip(&b) {
                assert!((x - y).abs() < 1e-12 * x.abs().max(1.0), "{a:?} {b:?}");
            }
            assert!(b[5].abs() < 1e-12, "a candidate begins at the middle of its search");
        }
        let opened = base.opened(|i| i < base.theta());
        assert!((opened.values(&opened.point_from(&base, &u), 0)[0] - base.values(&u, 0)[0]).abs() < 1e-12);
    }

    #[test]
    fn only_some_priors_are_opened() {
        let base = Unknowns::of(&model(), 2);
        let friction = base.names().iter().position(|name| *name == "table_friction").unwrap();
        let opened = base.opened(|i| i == friction);
        for (i, (old, new)) in base.list().iter().zip(opened.list()).enumerate() {
            let ((low, high), (least, greatest)) = (old.prior.bounds(), new.prior.bounds());
            let is_wider = least < low && greatest > high && least > 0.0;
            assert!(if i == friction { is_wider } else { old == new }, "{}: {least} to {greatest}", new.name);
        }
    }

    #[test]
    fn a_gaussian_prior_pulls_towards_its_mean() {
        let mut model = model();
        let mut parameters = model.theta.parameters().to_vec();
        parameters[0].prior = Prior::Normal { mean: 0.25, sd: 0.004, low: 0.2, high: 0.3 };
        model.theta = catenary_core::ParameterSpace::new(parameters).unwrap();
        let unknowns = Unknowns::of(&model, 2);
        let mut u = vec![0.5; unknowns.columns()];
        u[0] = unknowns.list()[0].prior.to_unit(0.256);
        let prior_residuals = unknowns.prior_residuals(&u);
        assert_eq!((prior_residuals.len(), prior_residuals[0].1), (1, 0));
        assert!((prior_residuals[0].0 + 1.5).abs() < 1e-9, "{prior_residuals:?}");
        let width = 2.0 * REACH * 0.004;
        assert!((prior_residuals[0].2 - width / 0.004).abs() < 1e-9, "{prior_residuals:?}");
        // Quantile of a Gaussian one standard deviation above its mean: 84.1 %.
        u[0] = 0.841345;
        let drawn = unknowns.values(&unknowns.drawn(u.clone()), 0)[0];
        assert!((drawn - 0.254).abs() < 1e-6, "{drawn}");
        assert!(unknowns.opened(|i| i == 0).prior_residuals(&u).is_empty());
    }

    #[test]
    fn slopes_equal_finite_differences() {
        let unknowns = Unknowns::of(&model(), 1);
        let u = vec![0.3; unknowns.columns()];
        for i in 0..unknowns.list().len() {
            let at = |h: f64| {
                let mut v = u.clone();
                v[unknowns.column(i, 0)] += h;
                unknowns.values(&v, 0)[i]
            };
            let slope = (at(1e-6) - at(-1e-6)) / 2e-6;
            let said = unknowns.slope(i, at(0.0));
            assert!((slope - said).abs() < 1e-6 * said.abs(), "{i}: {slope} {said}");
        }
    }
}
