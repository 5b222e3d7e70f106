//! Choice of the records that a log keeps.

/// Time in ns before an episode's start from which records still belong to it: they hold the pose and the frame at the
/// start.
pub const LEAD_NS: i64 = 200_000_000;

/// Choice of the records that a log keeps: those of some complete episodes.
#[derive(Debug, Clone, Default)]
pub struct Kept {
    /// Spans of the episodes, in order of their starts.
    pub spans: Vec<Span>,
    /// Ranges of the stamps in ns, in order and apart from one another.
    ranges_ns: Vec<(i64, i64)>,
    /// True while records are counted, too: in the first reading of a recording.
    pub counts: bool,
}

impl Kept {
    /// Choice of the episodes with these spans, in order of their starts.
    pub fn new(spans: Vec<Span>, counts: bool) -> Self {
        let mut ranges_ns: Vec<(i64, i64)> = Vec::new();
        for span in &spans {
            let (from, to) = (span.start_ns.saturating_sub(LEAD_NS), span.end_ns);
            match ranges_ns.last_mut().filter(|last| last.1 >= from) {
                Some(last) => last.1 = last.1.max(to),
                None => ranges_ns.push((from, to)),
            }
        }
        Self { spans, ranges_ns, counts }
    }

    /// True if a record of a stream lies in one of the episodes.
    pub fn holds(&self, stamp_ns: i64) -> bool {
        let next = self.ranges_ns.partition_point(|(from, _)| *from <= stamp_ns);
        next.checked_sub(1).is_some_and(|i| stamp_ns <= self.ranges_ns[i].1)
    }

    /// True if a step is one of the episodes' own.
    pub fn holds_step(&self, episode: u32, stamp_ns: i64) -> bool {
        let own = |s: &&Span| s.number == episode;
        self.spans.iter().filter(own).any(|s| {
            (s.start_ns.saturating_sub(LEAD_NS)..=s.until_ns.saturating_sub(LEAD_NS).max(s.end_ns)).contains(&stamp_ns)
        })
    }
}

/// Complete episode: its number and the stamps in ns of its start and end.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Span {
    /// Stamp of the start in ns.
    pub start_ns: i64,
    /// Number of the episode.
    pub number: u32,
    /// Stamp of the end in ns.
    pub end_ns: i64,
    /// Start of the next episode with the same number.
    pub until_ns: i64,
}
