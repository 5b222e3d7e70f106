//! Trainings of networks with a progress bar.

use super::progress;
use crate::exit::Interrupted;
use anyhow::Result;
use catenary_shell::Shutdown;
use keypoint_tracker::learned::Progress;

/// Trains with a bar that shows the loss, until Ctrl-C. `train` calls the given function after each of `steps` steps, and returns none if it
/// was interrupted. Returns what was trained, and the mean loss of the last tenth of the steps.
pub fn watch<T>(
    steps: usize,
    shutdown: &Shutdown,
    train: impl FnOnce(&mut dyn FnMut(Progress) -> bool) -> Result<Option<T>>,
) -> Result<(T, f64)> {
    let bar = progress::bar("training", 0.0)?;
    let (mut done, mut last) = (0, (0.0, 0_u32));
    let trained = train(&mut |p| {
        done = p.step;
        if p.step + steps / 10 >= steps {
            last = (last.0 + p.loss, last.1 + 1);
        }
        bar.set_message(format!("loss {:.3}", p.loss));
        progress::advance(&bar, progress::share(p.step as f64, steps as f64));
        !shutdown.is_triggered()
    })?;
    let trained = trained.ok_or_else(|| Interrupted(format!(" after {done} of {steps} steps")))?;
    bar.finish_and_clear();
    Ok((trained, last.0 / f64::from(last.1.max(1))))
}
