//! Clock of the log times. A bag is sorted by them: where the clock is set back, as by a replay that begins again or by hand,
//! messages of two passes lie among one another.

/// Step back in ns above which the clock was set. Messages of two topics are received by two threads, and overtake each other by
/// less.
const BACK_NS: i64 = 100_000_000;

/// Newest log time, and steps back.
#[derive(Debug, Default)]
pub(super) struct LogClock {
    newest_ns: Option<i64>,
    steps: u64,
    /// Sentence about the last step.
    last: String,
}

impl LogClock {
    /// Takes the log time of a message, in order of reception. Returns a sentence if the clock was set back before it.
    pub(super) fn take(&mut self, log_ns: i64) -> Option<&str> {
        let newest_ns = self.newest_ns.map_or(log_ns, |newest| newest.max(log_ns));
        if newest_ns.saturating_sub(log_ns) <= BACK_NS {
            self.newest_ns = Some(newest_ns);
            return None;
        }
        self.newest_ns = Some(log_ns);
        self.steps += 1;
        let seconds = |ns: i64| ns as f64 * 1e-9;
        self.last = format!(
            "the clock went back by {:.3} s, from {:.3} s to {:.3} s: the bag is sorted by this clock, so that messages before and after \
             the step may be mixed; record again with a clock that runs on",
            seconds(newest_ns.saturating_sub(log_ns)),
            seconds(newest_ns),
            seconds(log_ns)
        );
        Some(&self.last)
    }

    /// Sentence about all steps; none if there was none.
    pub(super) fn summary(&self) -> Option<String> {
        match self.steps {
            0 => None,
            1 => Some(self.last.clone()),
            steps => Some(format!("the clock went back {steps} times; the last time, {}", self.last)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_back_is_named_once_and_late_messages_are_none() {
        let mut clock = LogClock::default();
        let mut told = |times_ms: &[i64]| times_ms.iter().filter(|t| clock.take(**t * 1_000_000).is_some()).count();
        assert_eq!(told(&[100_000, 100_050, 99_990, 104_000]), 0);
        assert_eq!(told(&[50_000, 50_010, 49_990, 60_000]), 1);
        let one = clock.summary().unwrap();
        assert!(one.starts_with("the clock went back by 54.000 s, from 104.000 s to 50.000 s"), "{one}");
        assert!(clock.take(0).is_some() && clock.summary().unwrap().starts_with("the clock went back 2 times"));
        assert_eq!(LogClock::default().summary(), None);
    }
}
