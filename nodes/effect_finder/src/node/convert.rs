//! Conversions: the simulator's effects to candidates, and findings to wire messages.

use crate::data::Candidate;
use crate::error::FinderError;
use crate::report::Finding;
use crate::search::Progress;
use catenary_core::Model;
use catenary_core::model::Lacking;
use catenary_core::spelling::did_you_mean;
use catenary_msgs::action::{FindEffectsFeedback, FindEffectsResult};
use catenary_simulator::Registry;
use catenary_simulator::effects::About;

/// Candidates for `model`: the effects of `registry` that it could lack, without the vetoed ones, with their prior
/// odds.
///
/// # Errors
/// [`FinderError::UnknownEffect`] if `model.lacking` names an effect that the registry does not have.
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
