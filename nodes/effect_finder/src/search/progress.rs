//! Progress of a search: its stages, and their reporter.

use crate::error::FinderError;
use std::ops::ControlFlow;
use track_fit::fitting::OnRound;

/// Stage of a search.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    /// Fit of the present model.
    Calibrate,
    /// Test of the present model's residual against noise.
    Detect,
    /// Localisation of the residual.
    Localise,
    /// Choice of the effects that explain the residual.
    Name,
    /// Test of the model with those effects.
    Repair,
    /// Prediction of held-out episodes.
    Verify,
}

impl Stage {
    /// Name of the stage, a verb.
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

    /// Approximate shares of the whole search at which the stage begins and ends.
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

/// Progress of a search.
#[derive(Debug, Clone, PartialEq)]
pub struct Progress {
    /// Present stage.
    pub stage: Stage,
    /// Approximate share of the search that is done. It falls if the search begins again with other effects.
    pub progress: f64,
    /// Conclusion of a finished stage.
    pub conclusion: Option<String>,
}

/// Listener for progress; it returns whether the search goes on.
pub type OnProgress<'a> = &'a mut dyn FnMut(&Progress) -> ControlFlow<()>;

/// Reporter of progress and collector of conclusions.
pub struct Reporter<'a> {
    on_progress: OnProgress<'a>,
    conclusions: Vec<String>,
}

impl<'a> Reporter<'a> {
    /// Reporter without conclusions yet.
    pub fn new(on_progress: OnProgress<'a>) -> Self {
        Self { on_progress, conclusions: Vec::new() }
    }

    /// Conclusions so far.
    pub fn into_conclusions(self) -> Vec<String> {
        self.conclusions
    }

    /// Runs `fit`. Each of its rounds is reported as half of `stage`, because the number of rounds is not known beforehand.
    pub fn with_progress<T, E: Into<FinderError>>(
        &mut self,
        stage: Stage,
        fit: impl FnOnce(OnRound<'_>) -> Result<T, E>,
    ) -> Result<T, FinderError> {
        fit(&mut || notify(self.on_progress, stage, 0.5, None)).map_err(|e| in_stage(e.into(), stage))
    }

    /// Runs `fit` while its progress is reported by the number of its rounds.
    pub fn with_rounds<T, E: Into<FinderError>>(
        &mut self,
        stage: Stage,
        fit: impl FnOnce(OnRound<'_>) -> Result<T, E>,
    ) -> Result<T, FinderError> {
        let mut rounds = 0.0;
        // The number of rounds is unknown: the share approaches 1, and is half after four rounds.
        let mut on_round = || {
            rounds += 1.0;
            notify(self.on_progress, stage, rounds / (rounds + 4.0), None)
        };
        fit(&mut on_round).map_err(|e| in_stage(e.into(), stage))
    }

    /// Adds a conclusion of a stage, and reports it.
    pub fn conclude(&mut self, stage: Stage, sentence: String) -> Result<(), FinderError> {
        self.conclusions.push(sentence.clone());
        self.report(stage, 1.0, Some(sentence))
    }

    /// Reports progress, `share` of a stage.
    pub fn report(&mut self, stage: Stage, share: f64, conclusion: Option<String>) -> Result<(), FinderError> {
        match notify(self.on_progress, stage, share, conclusion) {
            ControlFlow::Continue(()) => Ok(()),
            ControlFlow::Break(()) => Err(FinderError::Cancelled(stage.name())),
        }
    }
}

/// Reports progress, `share` of a stage, and returns whether to go on.
fn notify(on_progress: OnProgress<'_>, stage: Stage, share: f64, conclusion: Option<String>) -> ControlFlow<()> {
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
