//! Records topics into a bag.
#![allow(clippy::disallowed_methods, reason = "recording follows the wall clock")]

mod discovery;
mod settings;

use crate::backlog::Backlog;
use crate::error::BagError;
use crate::reader::reindex;
use crate::writer::{BagSummary, BagWriter};
use catenary_shell::{Health, Node, Time};
use discovery::Topics;
pub use settings::RecordSettings;
use std::collections::BTreeSet;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Wall time after which what came is in the file: what a killed recorder loses.
const FLUSH_PERIOD: Duration = Duration::from_secs(1);
/// How often the writing thread looks whether it shall end, and whether there are new topics.
const LOOK_PERIOD: Duration = Duration::from_millis(100);
/// How long messages are waited for that were sent before the recording was told to end.
const LINGER: Duration = Duration::from_millis(200);
/// Time without a message after which a recording is warned of.
const EMPTY: Duration = Duration::from_secs(5);
/// Bytes that wait for the disk at most.
const BACKLOG_BYTES: usize = 256 << 20;

/// Records until 0.2 s after the node is told to end, then ends the bag in order: what was sent until then may be on its way still.
///
/// A message is logged at the time at which it came, in the node's clock, and published at the time at which it was sent,
/// in the sender's. Under simulated time recording begins with the first `/clock`. The folder appears when all
/// subscriptions to the contract's topics are there; other topics are subscribed to within 0.1 s after the first
/// publisher is known. A message is in the file a second after it came at the latest.
///
/// # Errors
/// [`BagError`]: settings, an existing folder, the graph, the disk. A full disk ends the recording; the bag can be read up
/// to its last complete chunk.
pub fn record(node: &Node, settings: &RecordSettings) -> Result<BagSummary, BagError> {
    settings.check()?;
    let backlog = Arc::new(Backlog::new(BACKLOG_BYTES));
    let left_out = Arc::<Mutex<BTreeSet<String>>>::default();
    report(node, &backlog, &left_out)?;
    wait_for_clock(node);
    let unbound = node.unbound();
    let mut topics = Topics::subscribe(&unbound, settings, Arc::clone(&backlog), left_out)?;
    let mut bag = BagWriter::create(&settings.out, &settings.writer_options())?;
    let written = topics.enter(&mut bag).and_then(|count| {
        tracing::info!("recording {count} topics into {}", settings.out.display());
        write_until_shutdown(node, &mut bag, &mut topics, &backlog)
    });
    drop(topics);
    if let Err(error) = written {
        drop(bag);
        if let Err(also) = reindex(&settings.out) {
            tracing::warn!("metadata.yaml stays as it was at the start: {also}");
        }
        return Err(error);
    }
    let (_, lost) = backlog.counts();
    if lost > 0 {
        tracing::error!("{lost} messages were lost because the disk is too slow");
    }
    bag.finish()
}

/// Reports what a recording lacks: an error while messages are being lost, a warning from then on, for the bag has a gap.
fn report(node: &Node, backlog: &Arc<Backlog>, left_out: &Arc<Mutex<BTreeSet<String>>>) -> Result<(), BagError> {
    let (backlog, left_out) = (Arc::clone(backlog), Arc::clone(left_out));
    let (mut lost_before, started) = (0, Instant::now());
    node.report_diagnostics(move |report| {
        let (messages, lost) = backlog.counts();
        report.value("messages", messages).value("lost", lost);
        let losing = lost - std::mem::replace(&mut lost_before, lost);
        if losing > 0 {
            report.problem(Health::Error, &format!("{losing} messages were lost in 1 s: the disk is too slow"));
        } else if lost > 0 {
            report.problem(Health::Warn, &format!("{lost} messages are missing in the bag: the disk was too slow"));
        }
        if messages == 0 && started.elapsed() > EMPTY {
            report.problem(Health::Warn, "nothing was recorded yet: no topic of the recording has a message");
        }
        for why in left_out.lock().unwrap_or_else(PoisonError::into_inner).iter() {
            report.problem(Health::Warn, why);
        }
    })?;
    Ok(())
}

fn wait_for_clock(node: &Node) {
    let waiting = || node.clock().is_simulated() && node.now() == Time::ZERO;
    if waiting() {
        tracing::info!("waiting for /clock");
    }
    while waiting() && !node.shutdown().wait_timeout(LOOK_PERIOD / 10) {}
}

fn write_until_shutdown(
    node: &Node,
    bag: &mut BagWriter,
    topics: &mut Topics<'_>,
    backlog: &Backlog,
) -> Result<(), BagError> {
    let mut flush_at = Instant::now() + FLUSH_PERIOD;
    let mut look_at = Instant::now();
    let mut end_at = None;
    loop {
        let now = Instant::now();
        if end_at.is_none() && node.is_shutdown() {
            end_at = Some(now + LINGER);
        }
        if end_at.is_none() && now >= look_at {
            topics.discover(bag)?;
            look_at = now + LOOK_PERIOD;
        }
        let is_over = end_at.is_some_and(|end| now >= end);
        if is_over {
            topics.end();
        }
        match backlog.next(if is_over { Duration::ZERO } else { LOOK_PERIOD }) {
            Some((number, arrival)) => {
                let sent = arrival.sent.unwrap_or(arrival.received);
                bag.write_cdr(topics.id(number), arrival.received.nanos(), sent.nanos(), &arrival.cdr)?;
            }
            None if is_over => return Ok(()),
            None => {}
        }
        if Instant::now() >= flush_at {
            bag.flush()?;
            flush_at = Instant::now() + FLUSH_PERIOD;
        }
    }
}
