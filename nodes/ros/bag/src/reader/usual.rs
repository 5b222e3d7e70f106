//! Log times of a bag that are not decades away from the rest.

/// Range of log times in ns that are not far.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Usual {
    from_ns: i64,
    to_ns: i64,
}

impl Usual {
    /// Range that holds all times.
    pub(super) const ALL: Self = Self { from_ns: i64::MIN, to_ns: i64::MAX };

    /// Times within `distance_ns` of `middle_ns`.
    pub(super) fn around(middle_ns: i64, distance_ns: i64) -> Self {
        Self { from_ns: middle_ns.saturating_sub(distance_ns), to_ns: middle_ns.saturating_add(distance_ns) }
    }

    /// True if a log time is not far.
    pub(crate) fn holds(self, time_ns: i64) -> bool {
        (self.from_ns..=self.to_ns).contains(&time_ns)
    }
}
