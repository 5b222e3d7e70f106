//! Mistakes in what a command was given. They end it with an exit code of their own: the same command would fail again.

use crate::interrupted::Interrupted;
use bayes_sim::InferenceError;
use catenary_bag::BagError;
use catenary_shell::ShellError;
use effect_finder::FinderError;
use std::io::{Error as IoError, ErrorKind};
use thiserror::Error;

/// A mistake in the command line, in a file that it names or in the environment, with all of its causes.
#[derive(Debug, Error)]
#[error("{0}")]
pub struct WrongInput(String);

impl WrongInput {
    /// Exit code of clap and of most Unix tools for a wrong command line; our nodes have it, too.
    pub const EXIT_CODE: u8 = 2;

    /// A mistake in these words.
    pub fn error(what: impl Into<String>) -> anyhow::Error {
        Self(what.into()).into()
    }

    /// Whether an error is such a mistake, whoever found it.
    pub fn is(error: &anyhow::Error) -> bool {
        error.is::<Self>()
            || error.downcast_ref::<ShellError>().is_some_and(ShellError::is_usage)
            || error.downcast_ref::<BagError>().is_some_and(is_of_bag)
            || error.downcast_ref::<InferenceError>().is_some_and(is_of_inference)
            || error.downcast_ref::<FinderError>().is_some_and(is_of_search)
    }
}

/// Whether a bag, a track or a setting is wrong, and not the machine or the graph.
fn is_of_bag(error: &BagError) -> bool {
    match error {
        BagError::Io { reason, .. } => !is_of_machine(reason),
        BagError::Shell(error) => error.is_usage(),
        BagError::Write { .. } | BagError::Refused(_) => false,
        _ => true,
    }
}

/// Whether the machine is at fault, and the same command may do later: a full disk, a device that fails.
pub fn is_of_machine(error: &IoError) -> bool {
    use ErrorKind::{AlreadyExists, InvalidInput, IsADirectory, NotADirectory, NotFound, PermissionDenied};
    let of_path = [AlreadyExists, InvalidInput, IsADirectory, NotADirectory, NotFound, PermissionDenied];
    !of_path.contains(&error.kind())
}

fn is_of_inference(error: &InferenceError) -> bool {
    use InferenceError::{Drive, Observation, OutOfView, Setting};
    matches!(error, Drive { .. } | Observation(_) | OutOfView { .. } | Setting { .. })
}

fn is_of_search(error: &FinderError) -> bool {
    use FinderError::{Drive, NoEpisode, Noise, PoseNoise, Setting, UnknownEffect};
    matches!(error, Drive { .. } | NoEpisode | Noise { .. } | PoseNoise { .. } | Setting { .. } | UnknownEffect { .. })
}

/// Marks the errors of a step that reads or checks what a command was given.
pub trait Given<T> {
    /// The result with its error marked as a [`WrongInput`].
    fn given(self) -> anyhow::Result<T>;

    /// The result with its error marked where `is_given` says so.
    fn given_if(self, is_given: impl FnOnce(&anyhow::Error) -> bool) -> anyhow::Result<T>;
}

impl<T, E: Into<anyhow::Error>> Given<T> for Result<T, E> {
    fn given(self) -> anyhow::Result<T> {
        self.given_if(|_| true)
    }

    fn given_if(self, is_given: impl FnOnce(&anyhow::Error) -> bool) -> anyhow::Result<T> {
        self.map_err(|error| match error.into() {
            error if error.is::<Interrupted>() || !is_given(&error) => error,
            error => WrongInput::error(format!("{error:#}")),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use anyhow::{Context, anyhow};

    #[test]
    fn a_mistake_stays_one_behind_further_context_and_keeps_its_causes() {
        let error = Err::<(), _>(anyhow!("no such file").context("model nope")).given().context("infer").unwrap_err();
        assert!(WrongInput::is(&error));
        assert_eq!(format!("{error:#}"), "infer: model nope: no such file");
        assert!(!WrongInput::is(&anyhow!("the disk is full")));
    }

    #[test]
    fn an_interruption_is_no_mistake() {
        let error = Err::<(), _>(Interrupted(String::new())).given().unwrap_err();
        assert!(error.is::<Interrupted>() && !WrongInput::is(&error));
    }

    #[test]
    fn a_wrong_environment_is_a_mistake_too() {
        let expected = "a whole number of 0 to 232";
        let error = ShellError::Environment { variable: "ROS_DOMAIN_ID", value: "lab".into(), expected };
        assert!(WrongInput::is(&error.into()));
    }
}
