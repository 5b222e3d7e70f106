//! Log time and stamp of a message.

/// Times of one message in ns.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Times {
    pub(super) log_ns: i64,
    pub(super) stamp_ns: i64,
}

impl Times {
    /// Time from stamp to log in s.
    pub(super) fn delay_s(self) -> f64 {
        since_s(self.log_ns, self.stamp_ns)
    }
}

/// Time in s between two times in ns.
pub(super) fn since_s(later_ns: i64, earlier_ns: i64) -> f64 {
    (i128::from(later_ns) - i128::from(earlier_ns)) as f64 * 1e-9
}
