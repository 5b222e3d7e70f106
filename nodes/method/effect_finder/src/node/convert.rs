//! Conversions: the simulator's effects to candidates, and findings to wire messages.

use crate::error::FinderError;
use crate::report::Finding;
use crate::search::Progress;
use crate::template::{Companion, Template};
use catenary_core::model::{DriveKind, Lacking};
use catenary_core::spelling::did_you_mean;
use catenary_core::{Model, SimulatorError};
use catenary_msgs::action::{FindEffectsFeedback, FindEffectsResult};
use catenary_simulator::Registry;
use catenary_simulator::effects::{About, Effect, Hook, TEMPLATE_FREQUENCY, TEMPLATE_PLACE, replaced};
use track_fit::data::Candidate;

/// Candidates for `model`: the effects of `registry`, and those that the model states as expressions, that it could lack, without
/// the vetoed ones, with their prior odds.
///
/// # Errors
/// [`FinderError::UnknownEffect`] if `model.lacking` names an effect that the registry does not have, and
/// [`FinderError::Simulator`] if it states an expression that cannot be read.
pub fn candidates(registry: &Registry, model: &Model) -> Result<Vec<Candidate>, FinderError> {
    let stated = registry.with_expressions(model);
    let registry = &stated.map_err(|e| FinderError::Simulator(SimulatorError::Input(e.to_string())))?;
    let Lacking { vetoes, prior_odds } = &model.lacking;
    let known: Vec<&str> = registry.effects().map(|e| e.about().name).collect();
    let named = vetoes.iter().map(|name| ("vetoes", name)).chain(prior_odds.keys().map(|name| ("prior_odds", name)));
    for (field, name) in named {
        if registry.find(name).is_none() {
            let similar = || did_you_mean(name, known.iter().copied());
            let hint = replaced(name).map_or_else(similar, |(_, by)| format!("; it is no more: expected {by}"));
            return Err(FinderError::UnknownEffect { field, name: name.clone(), known: known.join(", "), hint });
        }
    }
    let is_open = |name: &str| Candidate::is_open(name, model) && vetoes.iter().all(|v| v != name);
    let is_expected = |e: &&dyn Effect| e.is_offered_unasked() || prior_odds.contains_key(e.about().name);
    // A companion is no effect by itself.
    let is_offered = |e: &&dyn Effect| {
        e.concerns(model) && is_open(e.about().name) && !registry.is_companion(e.about().name) && is_expected(e)
    };
    let candidate = |effect: &dyn Effect| {
        let about = effect.about();
        let base = model.parameters.get(about.name).copied().unwrap_or(0.0);
        Candidate {
            name: about.name.to_owned(),
            title: about.title.to_owned(),
            prior: about.prior,
            range: about.range,
            base,
            odds: prior_odds.get(about.name).copied().unwrap_or(1.0),
            // An effect that the model has fixed keeps the companions that it has there.
            companions: if base == 0.0 { companions(registry, effect, model) } else { Vec::new() },
        }
    };
    Ok(registry.effects().filter(is_offered).map(candidate).collect())
}

/// Companions of an effect that `model` leaves open.
fn companions(registry: &Registry, effect: &dyn Effect, model: &Model) -> Vec<track_fit::data::Companion> {
    let abouts = effect.companions().iter().filter_map(|name| Some(registry.find(name)?.about()));
    let is_open = |about: &About| Candidate::is_open(about.name, model) && !model.parameters.contains_key(about.name);
    let companion = |about: About| track_fit::data::Companion {
        name: about.name.to_owned(),
        title: about.title.to_owned(),
        prior: about.prior,
    };
    abouts.filter(is_open).map(companion).collect()
}

/// Templates of `registry` that can act in `model`, and the effects of the library that it could lack. An arm does not act on a grip that follows a measured path.
pub fn templates(registry: &Registry, model: &Model) -> Vec<Template> {
    let template = |is_known: bool, effect: &dyn Effect| {
        let about = effect.about();
        let companion = effect.companions().iter().find_map(|name| match *name {
            TEMPLATE_PLACE => Some((Companion::Place, TEMPLATE_PLACE.to_owned())),
            TEMPLATE_FREQUENCY => Some((Companion::Frequency, TEMPLATE_FREQUENCY.to_owned())),
            _ => None,
        });
        Template {
            name: about.name.to_owned(),
            title: about.title.to_owned(),
            unit: about.unit.to_owned(),
            hook: about.hook.name().to_owned(),
            most: about.prior.bounds().1,
            range: about.range,
            is_known,
            companion,
        }
    };
    let acts = |hook: &str| hook != Hook::Actuation.name() || model.observation.drive != DriveKind::Grip;
    let templates = registry.templates().map(|effect| template(false, effect));
    let is_open = |name: &str| Candidate::is_open(name, model);
    let is_known = |name: &str| is_open(name) && !registry.is_companion(name);
    let known = Registry::shipped().effects().filter(|e| e.concerns(model) && is_known(e.about().name));
    let known = known.map(|effect| template(true, effect));
    templates.chain(known).filter(|template| acts(&template.hook)).collect()
}

/// Progress of a search as action feedback.
#[must_use]
pub fn feedback(progress: &Progress) -> FindEffectsFeedback {
    FindEffectsFeedback {
        stage: progress.stage.name().to_owned(),
        progress: progress.progress,
        conclusion: progress.conclusion.clone().unwrap_or_default(),
    }
}

/// Finding as action result. `model_yaml` is the repaired model, or the present one if nothing was added.
#[must_use]
pub fn result(finding: &Finding, model_yaml: String) -> FindEffectsResult {
    FindEffectsResult {
        success: true,
        message: finding.conclusions.join("\n"),
        verdict: finding.verdict.name().to_owned(),
        found: finding.found.iter().map(|alike| alike.join("|")).collect(),
        effects: finding.presence.iter().map(|p| p.name.clone()).collect(),
        probabilities: finding.presence.iter().map(|p| p.probability).collect(),
        model_yaml,
        separating_actions: finding.separation.iter().flat_map(|s| s.actions.as_flattened()).copied().collect(),
    }
}
