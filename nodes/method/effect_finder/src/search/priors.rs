//! Parameters and values of episodes at bounds of their priors, which may cause the gap.

use super::context::Search;
use super::progress::Stage;
use crate::error::FinderError;
use crate::evidence::{Detection, p_value};
use crate::report::{Finding, PressingValue, sentences};
use catenary_core::episode::MeasuredTrack;
use track_fit::data::Scope;
use track_fit::fitting::{Fit, Laplace, Problem, best_fit, is_bound_active};

/// Distance from a bound of the prior within which a value is near it: the smaller of this many standard deviations and
/// this share of the prior.
const NEAR_SDS: f64 = 3.0;
const NEAR: f64 = 0.1;
/// Least distance of the linearised best value of an episode from the bound at which the fit holds it, in standard
/// deviations. Values are drawn from the whole prior, so that many lie near a bound by chance.
const BEYOND_SDS: f64 = 3.0;

impl Search<'_> {
    /// Returns whether the gap closes once priors are opened: the bounds of the priors caused it. All of theta's priors are
    /// opened if one of its parameters presses, and those of the values of episodes that press.
    pub(super) fn closes_with_open_priors(
        &mut self,
        fit: &Fit,
        finding: &Finding,
        detection: &Detection,
    ) -> Result<bool, FinderError> {
        let pressing = finding.pressing_in_words();
        if pressing.is_empty() {
            return Ok(false);
        }
        let own = &self.problem.unknowns;
        let presses = |i: usize| match own.list()[i].scope {
            Scope::Shared => i < own.theta() && !finding.pressing.is_empty(),
            Scope::PerEpisode => finding.pressing_values.iter().any(|value| value.name == own.list()[i].name),
        };
        let unknowns = own.opened(presses);
        let point = unknowns.point_from(own, &fit.point);
        let open = Problem { unknowns, ..*self.problem };
        let settings = self.settings;
        let best = match self
            .reporter
            .with_progress(Stage::Localise, |on_round| best_fit(&open, vec![point], &settings.of_fits(), on_round))
        {
            // Values beyond the prior may be impossible to simulate.
            Err(FinderError::NoFit(_)) => return Ok(false),
            other => other?,
        };
        // The null sets of the present model serve the opened one, too: they differ only in the bounds.
        let p_value = p_value(best.cost, detection.null.iter().map(|f| f.cost));
        let closes = p_value > self.settings.level;
        if closes {
            self.reporter.conclude(Stage::Localise, sentences::narrow(&pressing, p_value))?;
        }
        Ok(closes)
    }

    /// Parameters of theta at an active bound of their prior, or so near to a bound that their values may lie beyond
    /// it.
    pub(super) fn pressing(&self, fit: &Fit) -> Vec<String> {
        let unknowns = &self.problem.unknowns;
        let (gradient, posterior) = (fit.gradient(), Laplace::of(fit));
        let at_edge = |column: usize| {
            let u = fit.point[column];
            let reach = posterior.as_ref().map_or(0.0, |p| NEAR_SDS * p.sd(column)).min(NEAR);
            is_bound_active(u, gradient[column]) || u.min(1.0 - u) < reach
        };
        let theta = unknowns.list()[..unknowns.theta()].iter().enumerate();
        theta.filter(|(i, _)| at_edge(unknowns.column(*i, 0))).map(|(_, u)| u.name.clone()).collect()
    }

    /// Values drawn anew for each episode that are held at a bound of their prior, and would have to lie clearly beyond it.
    pub(super) fn pressing_values(&self, fit: &Fit) -> Vec<PressingValue> {
        let unknowns = &self.problem.unknowns;
        let gradient = fit.gradient();
        let is_beyond = |column: usize| {
            let (g, known) = (gradient[column], fit.jacobian.column(column).norm());
            // With slope g and curvature k^2 of half the cost, the best value lies g / k^2 away, which is g / k standard deviations.
            is_bound_active(fit.point[column], g) && g.abs() >= BEYOND_SDS * known
        };
        let mut values = Vec::new();
        for (i, unknown) in unknowns.list().iter().enumerate().filter(|(_, u)| u.scope == Scope::PerEpisode) {
            let of_episode = |(episode, measured): (usize, &MeasuredTrack)| {
                let (name, episode_name) = (unknown.name.clone(), measured.name.clone());
                is_beyond(unknowns.column(i, episode)).then_some(PressingValue { name, episode, episode_name })
            };
            values.extend(self.question.measured.iter().enumerate().filter_map(of_episode));
        }
        values
    }
}

#[cfg(test)]
mod tests {
    use super::super::find::find;
    use super::super::question::Question;
    use crate::report::{Finding, PressingValue, Verdict};
    use crate::settings::Settings;
    use catenary_core::episode::MeasuredTrack;
    use catenary_core::{Model, ParameterSpace, Prior, seed};
    use std::ops::ControlFlow;
    use track_fit::toy::{self, Toy};

    const FRICTION: &str = "table_friction";
    const THETA: [f64; 2] = [0.25, 2e4];

    /// Search in an episode for each of these frictions, which `model` draws between 0.3 and 0.6.
    fn found(model: &Model, frictions: &[f64]) -> Finding {
        let simulator = Toy { gain: 0.3 };
        let measured = |(number, friction): (u64, &f64)| {
            let effects = [(FRICTION, *friction)];
            let noisy = toy::episode(&simulator, THETA, &effects).measured_anew(&mut seed::rng(71, number));
            let name = format!("episode {}", number + 1);
            MeasuredTrack { name, track: noisy.measured, ..toy::measured(&simulator, THETA, &effects) }
        };
        let episodes: Vec<MeasuredTrack> = (0..).zip(frictions).map(measured).collect();
        let candidates = [toy::candidate("tip_mass_kg")];
        let question = Question { candidates: &candidates, ..Question::of(model, &episodes) };
        let settings = Settings { finer_fidelity: None, draws: 40, starts: 2, null_sets: 99, ..Settings::default() };
        find(question, &simulator, &settings, &mut |_| ControlFlow::Continue(())).unwrap().finding
    }

    /// Model that draws friction anew for each episode, with this prior of the length.
    fn model(low: f64, high: f64) -> Model {
        let mut model =
            Model::from_yaml(include_str!("../../../../../launch_configs/models/soft_bar.yaml")).expect("it is valid");
        model.effects.retain(|e| e.name == FRICTION);
        model.camera.position_jitter_m = 0.0;
        let mut parameters = model.theta.parameters().to_vec();
        parameters[0].prior = Prior::Uniform { low, high };
        model.theta = ParameterSpace::new(parameters).unwrap();
        model
    }

    #[test]
    fn a_value_of_an_episode_beyond_its_prior_gives_prior_too_narrow() {
        let model = model(0.2, 0.3);
        let value = |episode: usize| PressingValue {
            name: FRICTION.into(),
            episode,
            episode_name: format!("episode {}", episode + 1),
        };
        let within = found(&model, &[0.5, 0.31]);
        assert_eq!((within.verdict, within.pressing_values), (Verdict::NoGap, vec![]), "{:?}", within.conclusions);
        let beyond = found(&model, &[0.5, 0.8]);
        assert_eq!(
            (beyond.verdict, beyond.pressing.len(), &beyond.pressing_values[..]),
            (Verdict::PriorTooNarrow, 0, &[value(1)][..]),
            "{:?}",
            beyond.conclusions
        );
        let told = "table_friction of episode 2 at a bound of the prior; beyond it the gap closes (p = ";
        assert!(beyond.conclusions.iter().any(|s| s.starts_with(told)), "{:?}", beyond.conclusions);
        let last = "no effect closes the gap within the prior of table_friction of episode 2: widen the prior, and search again";
        assert!(beyond.conclusions.iter().any(|s| s == last), "{:?}", beyond.conclusions);
        // An opened prior ends at 0.9.
        let far = found(&model, &[0.5, 1.5]);
        assert_ne!(far.verdict, Verdict::PriorTooNarrow, "{:?}", far.conclusions);
        assert_eq!(far.pressing_values, [value(1)]);
        let is_told = |s: &String| {
            s.starts_with("at a bound of the prior, beyond which the best value may lie: ")
                && s.ends_with("table_friction of episode 2")
        };
        assert!(far.conclusions.iter().any(is_told), "{:?}", far.conclusions);
    }

    /// A friction at a bound by chance is not told, a length is.
    #[test]
    fn a_parameter_at_a_bound_is_told_without_a_gap() {
        let finding = found(&model(0.25, 0.3), &[0.6, 0.3]);
        assert_eq!((finding.verdict, finding.pressing_in_words()), (Verdict::NoGap, vec!["length_m".to_owned()]));
        let told = "at a bound of the prior, beyond which the best value may lie: length_m";
        assert!(finding.conclusions.iter().any(|s| s == told), "{:?}", finding.conclusions);
    }
}
