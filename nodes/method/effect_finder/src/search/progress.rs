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
    /// Approximate share of the search that is done. It never falls.
    pub progress: f64,
    /// Conclusion of a finished stage.
    pub conclusion: Option<String>,
}

/// Listener for progress; it returns whether the search goes on.
pub type OnProgress<'a> = &'a mut dyn FnMut(&Progress) -> ControlFlow<()>;

/// Account of a search so far.
#[derive(Debug, Default)]
pub struct Told {
    conclusions: Vec<String>,
    /// Progress at the beginning of the present pass through the stages.
    begun: f64,
    /// Progress that was reported last.
    reached: f64,
}

/// Reporter of progress and collector of conclusions.
pub struct Reporter<'a> {
    on_progress: OnProgress<'a>,
    told: Told,
}

impl<'a> Reporter<'a> {
    /// Reporter of a search that has `told` something in earlier passes through its stages, or nothing yet.
    pub fn new(on_progress: OnProgress<'a>, told: Told) -> Self {
        let mut reporter = Self { on_progress, told };
        reporter.pass_again();
        reporter
    }

    /// Conclusions so far.
    pub fn into_conclusions(self) -> Vec<String> {
        self.told.conclusions
    }

    /// Everything told so far, for a reporter that goes on.
    pub fn into_told(self) -> Told {
        self.told
    }

    /// Begins another pass through the stages, which share what is left of the progress.
    pub fn pass_again(&mut self) {
        self.told.begun = self.told.reached;
    }

    /// Runs `fit`. Each of its rounds is reported as half of `stage`, because the number of rounds is not known beforehand.
    pub fn with_progress<T, E: Into<FinderError>>(
        &mut self,
        stage: Stage,
        fit: impl FnOnce(OnRound<'_>) -> Result<T, E>,
    ) -> Result<T, FinderError> {
        fit(&mut || self.notify(stage, 0.5, None)).map_err(|e| in_stage(e.into(), stage))
    }

    /// Runs `fit` while its progress is reported by the number of its rounds.
    pub fn with_rounds<T, E: Into<FinderError>>(
        &mut self,
        stage: Stage,
        fit: impl FnOnce(OnRound<'_>) -> Result<T, E>,
    ) -> Result<T, FinderError> {
        self.with_rounds_of_part(stage, [0.0, 1.0], fit)
    }

    /// Runs `fit`, which is the part of `stage` between two shares of it, while its progress is reported by the number of its
    /// rounds.
    pub fn with_rounds_of_part<T, E: Into<FinderError>>(
        &mut self,
        stage: Stage,
        [from, to]: [f64; 2],
        fit: impl FnOnce(OnRound<'_>) -> Result<T, E>,
    ) -> Result<T, FinderError> {
        let mut rounds = 0.0;
        // The number of rounds is unknown: the share approaches 1, and is half after four rounds.
        let mut on_round = || {
            rounds += 1.0;
            self.notify(stage, from + (to - from) * rounds / (rounds + 4.0), None)
        };
        fit(&mut on_round).map_err(|e| in_stage(e.into(), stage))
    }

    /// Adds a conclusion of a stage, and reports it.
    pub fn conclude(&mut self, stage: Stage, sentence: String) -> Result<(), FinderError> {
        self.told.conclusions.push(sentence.clone());
        self.report(stage, 1.0, Some(sentence))
    }

    /// Reports progress, `share` of a stage.
    pub fn report(&mut self, stage: Stage, share: f64, conclusion: Option<String>) -> Result<(), FinderError> {
        match self.notify(stage, share, conclusion) {
            ControlFlow::Continue(()) => Ok(()),
            ControlFlow::Break(()) => Err(FinderError::Cancelled(stage.name())),
        }
    }

    /// Reports progress, `share` of a stage, and returns whether to go on.
    fn notify(&mut self, stage: Stage, share: f64, conclusion: Option<String>) -> ControlFlow<()> {
        let Told { begun, reached, .. } = &mut self.told;
        // The search may go back to an earlier stage, or to the beginning of its own: progress waits for it.
        *reached = reached.max(*begun + (1.0 - *begun) * within(stage, share));
        (self.on_progress)(&Progress { stage, progress: *reached, conclusion })
    }
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
