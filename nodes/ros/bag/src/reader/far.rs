//! Messages whose log time lies decades away from the rest of a bag: 0, or 2^64 - x after a clock that ran backwards.
//!
//! They are measurements as all others, and stay in the bag. Only their log times tell nothing: neither the duration of the
//! bag nor the time of a replay.

use super::index::{IndexedFile, Piece, nanoseconds};
use super::messages::visit_times;
use super::usual::Usual;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// Distance in ns from the middle of a bag above which a log time is far: ten years.
const FAR_NS: i64 = 10 * 365 * 86_400 * 1_000_000_000;
/// Number of different times of a topic that a note lists.
const LISTED: usize = 3;

/// Far messages of a topic.
#[derive(Debug, Default)]
struct Far {
    count: u64,
    times: BTreeSet<i128>,
}

/// Finds the far messages, and takes them out of the spans of the pieces. Returns the range of the other log times, and a
/// sentence for each topic with far ones.
pub(super) fn set_apart(path: &Path, files: &mut [IndexedFile]) -> (Usual, Vec<String>) {
    let spans = || files.iter().filter_map(IndexedFile::span_ns);
    let (Some(first), Some(last)) = (spans().map(|s| s.0).min(), spans().map(|s| s.1).max()) else {
        return (Usual::ALL, Vec::new());
    };
    // Nearly every bag ends here, by its index alone.
    if last.saturating_sub(first) <= FAR_NS {
        return (Usual::ALL, Vec::new());
    }
    let Some(middle) = middle(files) else { return (Usual::ALL, Vec::new()) };
    let usual = Usual::around(middle, FAR_NS);
    let mut far: BTreeMap<String, Far> = BTreeMap::new();
    for file in files {
        let changed: Vec<(usize, Option<(i64, i64)>)> = (0..file.pieces.len())
            .filter(|place| !(usual.holds(file.pieces[*place].span.0) && usual.holds(file.pieces[*place].span.1)))
            .map(|place| (place, count(file, &file.pieces[place], usual, &mut far)))
            .collect();
        for (place, span) in changed {
            // A piece of far messages alone comes with the one before it, or at the middle.
            let neighbour = file.pieces[..place].last().map_or(middle, |before| before.span.0);
            file.pieces[place].span = span.unwrap_or((neighbour, neighbour));
        }
    }
    let note = |(topic, far): (&String, &Far)| {
        let times: Vec<String> = far.times.iter().take(LISTED).map(|time| format!("{time} ns")).collect();
        let more = if far.times.len() > LISTED { " and others" } else { "" };
        let many = if far.count == 1 { "message is" } else { "messages are" };
        format!(
            "{}: {topic}: {} {many} logged more than ten years away from the rest, at {}{more}: the clock of the recorder was not set; the duration and a replay leave them out",
            path.display(),
            far.count,
            times.join(", ")
        )
    };
    (usual, far.iter().map(note).collect())
}

/// Adds the far messages of a piece to `far`. Returns the span of the others.
fn count(file: &IndexedFile, piece: &Piece, usual: Usual, far: &mut BTreeMap<String, Far>) -> Option<(i64, i64)> {
    let mut span: Option<(i64, i64)> = None;
    let counted = visit_times(file, piece, |channel, time| {
        let clipped = clipped(time);
        if usual.holds(clipped) {
            span = Some(span.map_or((clipped, clipped), |(first, last)| (first.min(clipped), last.max(clipped))));
        } else if let Some(topic) = file.channels.get(&channel) {
            let of_topic = far.entry(topic.name.clone()).or_default();
            of_topic.count += 1;
            if of_topic.times.len() <= LISTED {
                of_topic.times.insert(time);
            }
        }
    });
    if let Err(reason) = counted {
        tracing::debug!("{}: the times of a chunk cannot be read: {reason}", file.path.display());
    }
    span
}

/// Log time as messages of the reader have it.
fn clipped(time: i128) -> i64 {
    i64::try_from(time).unwrap_or_else(|_| u64::try_from(time).map_or(i64::MIN, nanoseconds))
}

/// Median log time of a bag, by the lengths of its pieces: a few far messages do not move it. Times after the year 2262 are
/// no times of a clock, however many there are: they are left out of the median. `None` without any other time.
fn middle(files: &[IndexedFile]) -> Option<i64> {
    let mut times: Vec<(i64, u64)> = Vec::new();
    for file in files {
        for piece in &file.pieces {
            let (first, last) = piece.span;
            if first == i64::MAX {
                continue;
            }
            if last.saturating_sub(first) <= FAR_NS {
                times.push((first, piece.len.max(1)));
                continue;
            }
            // The span of a piece with far messages tells nothing about the others.
            let mut own = Vec::new();
            let visited = visit_times(file, piece, |_, time| own.push(clipped(time)));
            own.retain(|time| *time < i64::MAX);
            if visited.is_ok() && !own.is_empty() {
                let middle = own.len() / 2;
                times.push((*own.select_nth_unstable(middle).1, piece.len.max(1)));
            }
        }
    }
    times.sort_unstable();
    let half = times.iter().map(|(_, weight)| u128::from(*weight)).sum::<u128>() / 2;
    let mut sum = 0;
    times.iter().find(|(_, weight)| (sum += u128::from(*weight), sum > half).1).map(|(time, _)| *time)
}
