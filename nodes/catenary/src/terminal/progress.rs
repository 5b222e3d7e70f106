//! Progress bars that never run backwards, with the time left.

use anyhow::Result;
use indicatif::{ProgressBar, ProgressState, ProgressStyle};
use std::fmt::Write;
use std::time::Duration;

/// Resolution of a bar.
pub const STEPS: u64 = 1000;
/// Least share of the work from which the time left is estimated.
const LEAST_SHARE: f64 = 0.02;

/// Bar of [`STEPS`] steps; `began` is the share that an earlier process has done.
pub fn bar(name: &str, began: f64) -> Result<ProgressBar> {
    let bar = ProgressBar::new(STEPS);
    bar.set_style(style(&format!("{name} [{{bar:24}}]"), began)?);
    bar.set_position(steps(began));
    Ok(bar)
}

/// Style of a bar: `head`, the percentage, the time left and the message, cut to the terminal's width.
pub fn style(head: &str, began: f64) -> Result<ProgressStyle> {
    let style = ProgressStyle::with_template(&format!("{head} {{percent:>3}}% {{left}}{{wide_msg}}"))?;
    let left = move |state: &ProgressState, out: &mut dyn Write| {
        let left = time_left(state.elapsed(), began, f64::from(state.fraction()));
        // A failed write of the time left must not spoil the bar.
        let _ = left.map_or(Ok(()), |left| write!(out, "{} left  ", in_words(left)));
    };
    Ok(style.with_key("left", left).progress_chars("=> "))
}

/// Moves a bar to a share of the work. A smaller share than the present one, as of late feedback, is ignored.
pub fn advance(bar: &ProgressBar, share: f64) {
    let length = bar.length().unwrap_or(STEPS);
    let position = (share.clamp(0.0, 1.0) * length as f64) as u64;
    // Feedback of a service may arrive out of order.
    if position > bar.position() {
        bar.set_position(position);
    }
}

/// Share `done / all`, between 0 and 1; 0 if `all` is 0.
pub fn share(done: impl Into<f64>, all: impl Into<f64>) -> f64 {
    let (done, all) = (done.into(), all.into());
    if all > 0.0 { (done / all).clamp(0.0, 1.0) } else { 0.0 }
}

fn steps(share: f64) -> u64 {
    (share * STEPS as f64) as u64
}

/// Time left at the speed of this process. `None` if too little was done for an estimate.
fn time_left(elapsed: Duration, began: f64, now: f64) -> Option<Duration> {
    let done = now - began;
    let is_known = done >= LEAST_SHARE && now < 1.0;
    is_known.then(|| elapsed.mul_f64((1.0 - now) / done))
}

/// Time in one or two units: `42 s`, `12 min`, `2 h 05 min`.
fn in_words(time: Duration) -> String {
    let seconds = time.as_secs_f64().ceil() as u64;
    match seconds {
        0..=99 => format!("{seconds} s"),
        100..=5999 => format!("{} min", seconds.div_ceil(60)),
        _ => format!("{} h {:02} min", seconds / 3600, seconds % 3600 / 60),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bar_never_runs_backwards() {
        let bar = bar("training", 0.0).unwrap();
        let positions: Vec<u64> = [0.1, 0.4, 0.2, 0.4, f64::NAN, -1.0, 0.7, 2.0, 0.9]
            .into_iter()
            .map(|share| {
                advance(&bar, share);
                bar.position()
            })
            .collect();
        assert_eq!(positions, [100, 400, 400, 400, 400, 400, 700, 1000, 1000]);
    }

    #[test]
    fn the_time_left_follows_from_the_pace_of_this_process() {
        let ten = Duration::from_secs(10);
        assert_eq!(time_left(ten, 0.0, 0.5), Some(ten));
        assert_eq!(time_left(ten, 0.5, 0.75), Some(ten), "the first half was done before");
        assert_eq!(time_left(ten, 0.0, 0.001), None, "too early to tell");
        assert_eq!(time_left(ten, 0.0, 1.0), None);
    }

    #[test]
    fn times_are_written_in_one_or_two_units() {
        let words = |s: f64| in_words(Duration::from_secs_f64(s));
        assert_eq!([words(0.2), words(99.0), words(100.0), words(5999.0)], ["1 s", "99 s", "2 min", "100 min"]);
        assert_eq!(words(7500.0), "2 h 05 min");
    }

    #[test]
    fn shares_of_nothing_are_nothing() {
        assert_eq!([share(3, 0), share(1, 4), share(5, 4)], [0.0, 0.25, 1.0]);
    }
}
