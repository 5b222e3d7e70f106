//! Trainings of networks with a progress bar, which go on after Ctrl-C.

use super::progress;
use crate::exit::{Interrupted, WrongInput};
use crate::kept::Kept;
use crate::terminal::output;
use anyhow::Result;
use catenary_shell::Shutdown;
use keypoint_tracker::learned::{Descent, Progress};

/// State of an interrupted training, if `resume` asks for it.
///
/// # Errors
/// No state, or that of another training.
pub fn begun(resume: bool, kept: &Kept, steps: usize) -> Result<Option<Box<Descent>>> {
    if !resume {
        return Ok(None);
    }
    let path = kept.path().display();
    match kept.read::<Descent>()?.filter(|begun| begun.step() < steps) {
        None => Err(WrongInput::error(format!(
            "--resume: {path}: expected the state that Ctrl-C leaves of a training, got no file"
        ))),
        Some(begun) => {
            output::tell(&format!("resumes after {} of {steps} steps, from {path}", begun.step()));
            Ok(Some(Box::new(begun)))
        }
    }
}

/// Trains with a bar that shows the loss, until Ctrl-C, which leaves the state in `kept`. `train` calls the given function after each of `steps`
/// steps, and returns the state of an interrupted training as its error. Returns what was trained, and the mean loss of the last tenth of the steps.
pub fn watch<T>(
    steps: usize,
    kept: &Kept,
    shutdown: &Shutdown,
    train: impl FnOnce(&mut dyn FnMut(Progress) -> bool) -> Result<Result<T, Box<Descent>>>,
) -> Result<(T, f64)> {
    let bar = progress::bar("training", 0.0)?;
    let mut last = (0.0, 0_u32);
    let trained = train(&mut |p| {
        if p.step + steps / 10 >= steps {
            last = (last.0 + p.loss, last.1 + 1);
        }
        bar.set_message(format!("loss {:.3}", p.loss));
        progress::advance(&bar, progress::share(p.step as f64, steps as f64));
        !shutdown.is_triggered()
    })?;
    bar.finish_and_clear();
    let trained = match trained {
        Ok(trained) => trained,
        Err(begun) => {
            kept.write(&begun)?;
            let done = format!("{} of {steps} steps", begun.step());
            return Err(Interrupted::kept(done, kept.path().display(), "--resume").into());
        }
    };
    Ok((trained, last.0 / f64::from(last.1.max(1))))
}
