//! Between wire types and the finder's, and between the simulator's effects and the finder's candidates.

use crate::candidate::Candidate;
use crate::error::FinderError;
use crate::find::Progress;
use crate::verdict::Finding;
use catenary_core::Model;
use catenary_core::model::Lacking;
use catenary_core::spelling::did_you_mean;
use catenary_msgs::action::{FindEffectsFeedback, FindEffectsResult};
use simulator_pool::Registry;
use simulator_pool::effects::About;

/// The effects of `registry` that `model` could lack, but for those that it vetoes, with the odds that it gives them.
///
/// # Errors
/// [`FinderError::UnknownEffect`] where the model speaks of an effect that there is not.
pub fn candidates(registry: &Registry, model: &Model) -> Result<Vec<Candidate>, FinderError> {
    let Lacking { vetoes, prior_odds } = &model.lacking;
    let known: Vec<&str> = registry.effects().map(|e| e.about().name).collect();
    let named = vetoes.iter().map(|name| ("vetoes", name)).chain(prior_odds.keys().map(|name| ("prior_odds", name)));
    for (field, name) in named {
        if registry.find(name).is_none() {
            let hint = did_you_mean(name, known.iter().copied());
            return Err(FinderError::UnknownEffect { field, name: name.clone(), known: known.join(", "), hint });
        }
    }
    let is_open = |about: &About| Candidate::is_open(about.name, model) && vetoes.iter().all(|v| v != about.name);
    let open = registry.effects().map(|e| e.about()).filter(is_open);
    let candidate = |about: About| Candidate {
        name: about.name.to_owned(),
        title: about.title.to_owned(),
        prior: about.prior,
        range: about.range,
        base: model.parameters.get(about.name).copied().unwrap_or(0.0),
        odds: prior_odds.get(about.name).copied().unwrap_or(1.0),
    };
    Ok(open.map(candidate).collect())
}

/// How far a search is.
#[must_use]
pub fn feedback(progress: &Progress) -> FindEffectsFeedback {
    FindEffectsFeedback {
        stage: progress.stage.name().to_owned(),
        progress: progress.progress,
        conclusion: progress.conclusion.clone().unwrap_or_default(),
    }
}

/// What a search found, with the text of the repaired model, or of the present one where nothing was added.
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
