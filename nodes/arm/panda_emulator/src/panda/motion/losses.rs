//! Commands received and lost.

/// Number of cycles that the success rate looks back.
const WINDOW: u32 = 100;

/// Record of the last commands.
#[derive(Debug, Clone, Copy, Default)]
pub struct Losses {
    /// Bit of each of the last cycles, the newest lowest: 1 = received.
    received: u128,
    cycles: u32,
    consecutive: u32,
}

impl Losses {
    /// Records a cycle. Cycles before the first command do not count.
    pub fn record(&mut self, received: bool) {
        if self.cycles == 0 && !received {
            return;
        }
        let mask = (1_u128 << WINDOW) - 1;
        self.received = ((self.received << 1) | u128::from(received)) & mask;
        self.cycles = (self.cycles + 1).min(WINDOW);
        self.consecutive = if received { 0 } else { self.consecutive + 1 };
    }

    /// Returns true after the first command.
    pub fn has_begun(&self) -> bool {
        self.cycles > 0
    }

    /// Number of commands lost since the last one received.
    pub fn consecutive(&self) -> u32 {
        self.consecutive
    }

    /// Share of the last 100 commands that were received; 0 before the first.
    pub fn success_rate(&self) -> f64 {
        if self.cycles == 0 { 0.0 } else { f64::from(self.received.count_ones()) / f64::from(self.cycles) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rate_counts_the_last_hundred_commands_after_the_first() {
        let mut losses = Losses::default();
        losses.record(false);
        assert!(!losses.has_begun() && losses.success_rate() == 0.0);
        (0..200).for_each(|_| losses.record(true));
        (0..19).for_each(|_| losses.record(false));
        assert_eq!((losses.consecutive(), losses.success_rate()), (19, 0.81));
        losses.record(true);
        assert_eq!(losses.consecutive(), 0);
    }
}
