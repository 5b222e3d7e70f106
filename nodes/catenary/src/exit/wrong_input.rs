//! Wrong input of a command. It has its own exit code, because the same command would fail again.

use super::interrupted::Interrupted;
use bayes_sim::InferenceError;
use catenary_bag::BagError;
use catenary_shell::ShellError;
use effect_finder::FinderError;
use std::io::{Error as IoError, ErrorKind};
use thiserror::Error;

/// Error in the command line, in a file that it names, or in the environment. The text includes all causes.
#[derive(Debug, Error)]
#[error("{0}")]
pub struct WrongInput(String);

impl WrongInput {
    /// Exit code of clap and of most Unix tools for a wrong command line, and of our nodes.
    pub const EXIT_CODE: u8 = 2;

    /// Error with this text.
    pub fn error(what: impl Into<String>) -> anyhow::Error {
        Self(what.into()).into()
    }

    /// True if an error, of this crate or a library, is due to wrong input.
    pub fn is(error: &anyhow::Error) -> bool {
        error.is::<Self>()
            || error.downcast_ref::<ShellError>().is_some_and(ShellError::is_usage)
            || error.downcast_ref::<BagError>().is_some_and(is_of_bag)
            || error.downcast_ref::<InferenceError>().is_some_and(is_of_inference)
            || error.downcast_ref::<FinderError>().is_some_and(is_of_search)
    }
}

/// True if a bag, a track or a setting is wrong; false for faults of the machine or the graph.
fn is_of_bag(error: &BagError) -> bool {
    match error {
        BagError::Io { reason, .. } => !is_of_machine(reason),
        BagError::Shell(error) => error.is_usage(),
        // A full disk, and a refusal because of the state of the graph.
        BagError::Write { .. } | BagError::Refused(_) | BagError::Interrupted { .. } => false,
        BagError::Scratch { is_of_disk, .. } => !is_of_disk,
        _ => true,
    }
}

/// True for a fault of the machine, such as a full disk: the same command may succeed later.
pub fn is_of_machine(error: &IoError) -> bool {
    use ErrorKind::{AlreadyExists, InvalidInput, IsADirectory, NotADirectory, NotFound, PermissionDenied};
    let of_path = [AlreadyExists, InvalidInput, IsADirectory, NotADirectory, NotFound, PermissionDenied];
    !of_path.contains(&error.kind())
}

/// True if an error comes from a machine that has no room left: a full disk, a quota, a limit on the size of files, or no memory. No step makes
/// it a wrong input, whatever it reads or checks.
fn is_full(error: &anyhow::Error) -> bool {
    use ErrorKind::{FileTooLarge, OutOfMemory, QuotaExceeded, StorageFull};
    let full = |kind: ErrorKind| [FileTooLarge, OutOfMemory, QuotaExceeded, StorageFull].contains(&kind);
    let of_cause = |cause: &(dyn std::error::Error + 'static)| match cause.downcast_ref::<BagError>() {
        Some(BagError::Io { reason, .. }) => full(reason.kind()),
        Some(BagError::Write { .. }) => true,
        Some(BagError::Scratch { is_of_disk, .. }) => *is_of_disk,
        _ => cause.downcast_ref::<IoError>().is_some_and(|error| full(error.kind())),
    };
    error.chain().any(of_cause)
}

fn is_of_inference(error: &InferenceError) -> bool {
    use InferenceError::{Drive, Observation, OutOfView, Seen, Setting};
    matches!(error, Drive { .. } | Observation(_) | OutOfView { .. } | Seen { .. } | Setting { .. })
}

fn is_of_search(error: &FinderError) -> bool {
    use FinderError::{Episode, NoEpisode, Setting, UnknownEffect};
    matches!(error, Episode(_) | NoEpisode | Setting { .. } | UnknownEffect { .. })
}

/// Marks errors of steps that read or check a command's input.
pub trait Given<T> {
    /// Marks any error as [`WrongInput`], except that of a full machine.
    fn given(self) -> anyhow::Result<T>;

    /// Marks an error as [`WrongInput`] if `is_given` returns true for it.
    fn given_if(self, is_given: impl FnOnce(&anyhow::Error) -> bool) -> anyhow::Result<T>;
}

impl<T, E: Into<anyhow::Error>> Given<T> for Result<T, E> {
    fn given(self) -> anyhow::Result<T> {
        self.given_if(|_| true)
    }

    fn given_if(self, is_given: impl FnOnce(&anyhow::Error) -> bool) -> anyhow::Result<T> {
        self.map_err(|error| match error.into() {
            // Ctrl-C keeps its own exit code, whatever step it interrupts.
            error if Interrupted::is(&error) || is_full(&error) || !is_given(&error) => error,
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
    fn a_full_disk_is_no_mistake_in_whatever_step_it_shows() {
        let full = |raw: i32| IoError::from_raw_os_error(raw);
        let bag = BagError::Io { action: "make the file", path: "out/bag_0.mcap".into(), reason: full(28) };
        // ENOSPC, EDQUOT and EFBIG.
        let errors = [full(28).into(), full(122).into(), full(27).into(), bag.into()];
        for error in errors.map(|e: anyhow::Error| e.context("--out out")) {
            let error = Err::<(), _>(error).given().unwrap_err();
            assert!(is_full(&error) && !WrongInput::is(&error), "{error:#}");
        }
        let missing = Err::<(), _>(full(2)).given().unwrap_err();
        assert!(WrongInput::is(&missing) && !is_full(&missing));
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
