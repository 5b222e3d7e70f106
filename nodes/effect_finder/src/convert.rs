//! Between wire types and the finder's, and between the simulator's effects and the finder's candidates.

use crate::candidate::Candidate;
use crate::find::Progress;
use crate::verdict::Finding;
use catenary_core::Model;
use catenary_msgs::action::{FindEffectsFeedback, FindEffectsResult};
use simulator_pool::Registry;

/// The effects of `registry` that `model` could lack.
#[must_use]
pub fn candidates(registry: &Registry, model: &Model) -> Vec<Candidate> {
    let open = registry.effects().map(|e| e.about()).filter(|about| Candidate::is_open(about.name, model));
    let candidate = |about: simulator_pool::effects::About| Candidate {
        name: about.name.to_owned(),
        title: about.title.to_owned(),
        prior: about.prior,
        range: about.range,
        base: model.parameters.get(about.name).copied().unwrap_or(0.0),
        odds: 1.0,
    };
    open.map(candidate).collect()
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
    }
}
