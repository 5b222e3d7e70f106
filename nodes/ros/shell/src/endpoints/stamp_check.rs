//! Check for stamps that are zero, out of order, or far from the node's clock. Pure; the caller passes the time.

use super::tally::Flaw;
use crate::time::point::Time;
use std::time::Duration;

/// Check of the stamps of one stream.
#[derive(Debug, Clone)]
pub struct StampCheck {
    limit: Duration,
    newest: Option<Time>,
}

impl StampCheck {
    /// Creates a check that tolerates stamps up to `limit` before and after the node's clock.
    #[must_use]
    pub fn new(limit: Duration) -> Self {
        Self { limit, newest: None }
    }

    /// Sets the tolerated distance of a stamp from the node's clock.
    pub fn set_limit(&mut self, limit: Duration) {
        self.limit = limit;
    }

    /// Returns the flaw of a stamp of a message that arrived at `now`. At [`Time::ZERO`], before the first `/clock`, ages are not
    /// checked.
    pub fn flaw(&mut self, stamp: Time, now: Time) -> Option<Flaw> {
        // Replaced also by an older stamp, so that a restarted stream is out of order only once.
        let before = self.newest.replace(stamp);
        let (age, ahead) = (now.saturating_since(stamp), stamp.saturating_since(now));
        if stamp == Time::ZERO && age > self.limit {
            return Some(Flaw::new("zero stamp", "the stamp is zero: the publisher does not stamp its messages"));
        }
        if let Some(before) = before.filter(|before| stamp < *before) {
            let back_s = before.saturating_since(stamp).as_secs_f64();
            return Some(Flaw::new("order", format!("the stamp lies {back_s:.3} s before that of the message before")));
        }
        let limit_s = self.limit.as_secs_f64();
        let is_far = |gap: Duration| now != Time::ZERO && gap > self.limit;
        if is_far(age) {
            let age_s = age.as_secs_f64();
            let detail =
                format!("the stamp is {age_s:.3} s old by this node's clock, at most {limit_s} s are tolerated");
            return Some(Flaw::new("old stamp", detail));
        }
        if is_far(ahead) {
            let ahead_s = ahead.as_secs_f64();
            let detail =
                format!("the stamp lies {ahead_s:.3} s ahead of this node's clock, at most {limit_s} s are tolerated");
            return Some(Flaw::new("future stamp", detail));
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_kind_of_bad_stamp_is_detected() {
        // Previous stamp, stamp and clock in ms, and the expected kind of flaw.
        let table = [
            (1000, 1033, 1040, None),
            (1000, 1000, 1040, None),
            (1000, 900, 1040, Some("order")),
            (0, 0, 9000, Some("zero stamp")),
            (0, 0, 500, None),
            (1000, 1033, 2100, Some("old stamp")),
            (1000, 2100, 1040, Some("future stamp")),
            (1000, 1033, 0, None),
            (-2000, -1500, -1400, None),
        ];
        for (before, stamp, now, expected) in table {
            let at = |millis: i64| Time::from_nanos(millis * 1_000_000);
            let mut check = StampCheck::new(Duration::from_secs(1));
            check.flaw(at(before), at(before));
            assert_eq!(check.flaw(at(stamp), at(now)).map(|flaw| flaw.kind), expected, "{before} {stamp} {now}");
        }
    }

    #[test]
    fn a_restarted_stream_is_out_of_order_once() {
        let at = |second: i64| Time::from_nanos(second * 1_000_000_000);
        let mut check = StampCheck::new(Duration::from_secs(1));
        let kinds: Vec<_> = [5, 6, 1, 2].map(|s| check.flaw(at(s), at(s)).map(|flaw| flaw.kind)).into();
        assert_eq!(kinds, [None, None, Some("order"), None]);
    }
}
