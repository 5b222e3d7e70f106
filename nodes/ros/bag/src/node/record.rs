//! Recording of topics into a bag.
#![allow(clippy::disallowed_methods, reason = "recording follows the wall clock")]

mod discovery;
mod log_clock;
mod settings;

use crate::error::BagError;
use crate::node::backlog::Backlog;
use crate::reindex::reindex;
use crate::writer::{BagSummary, BagWriter};
use catenary_shell::{Health, Node, Throttle, Time, wall_now};
use discovery::Topics;
use log_clock::LogClock;
pub use settings::RecordSettings;
use std::collections::BTreeSet;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Wall time after which a received message is in the file. A killed recorder loses at most this.
const FLUSH_PERIOD: Duration = Duration::from_secs(1);
/// Period at which the writing thread checks for the shutdown and for new topics.
const LOOK_PERIOD: Duration = Duration::from_millis(100);
/// Time after the shutdown request in which messages that were sent before it can still arrive.
const LINGER: Duration = Duration::from_millis(200);
/// Time without any message after which a warning is given.
const EMPTY: Duration = Duration::from_secs(5);
/// Least time between two log lines about a clock that was set back.
const COMPLAIN: Duration = Duration::from_secs(5);
/// Greatest number of bytes that wait for the disk: 256 MiB, about 10 s of RGB images of 640 x 480 at 30 Hz.
const BACKLOG_BYTES: usize = 256 << 20;

/// Records until 0.2 s after the node is told to shut down, then finishes the bag. The delay lets messages arrive that
/// were sent before.
///
/// The log time of a message is its reception in the node's clock, the publish time its sending in the sender's clock.
/// Under simulated time, recording begins with the first `/clock`. The folder is created after the node has
/// subscribed to all recorded topics of the contract. Other topics are subscribed to within 0.1 s after their first
/// publisher is known. A message is in the file a second after its reception at the latest.
///
/// # Errors
/// [`BagError`] if the settings are invalid, the folder exists, the node cannot subscribe to a topic or report
/// diagnostics, or a write to the disk fails. A full disk ends the recording; the bag can be read up to its last complete
/// chunk.
pub fn record(node: &Node, settings: &RecordSettings) -> Result<BagSummary, BagError> {
    settings.check()?;
    let backlog = Arc::new(Backlog::new(BACKLOG_BYTES));
    let left_out = Arc::<Mutex<BTreeSet<String>>>::default();
    let clock = Arc::<Mutex<LogClock>>::default();
    report(node, &backlog, &left_out, &clock)?;
    wait_for_clock(node);
    let unbound = node.unbound();
    let mut topics = Topics::subscribe(&unbound, settings, Arc::clone(&backlog), left_out)?;
    let mut bag = BagWriter::create(&settings.out, &settings.writer_options())?;
    let written = topics.add_pending(&mut bag).and_then(|count| {
        tracing::info!("recording {count} topics into {}", settings.out.display());
        write_until_shutdown(node, &mut bag, &mut topics, &backlog, &clock)
    });
    drop(topics);
    if let Err(error) = written {
        // The bag is dropped first: reindex refuses a bag that is still being written.
        drop(bag);
        if let Err(also) = reindex(&settings.out) {
            tracing::warn!("metadata.yaml could not be updated: {also}");
        }
        return Err(error);
    }
    let (_, lost) = backlog.counts();
    if lost > 0 {
        tracing::error!("{lost} messages were lost because the disk is too slow");
    }
    if let Some(steps) = clock.lock().unwrap_or_else(PoisonError::into_inner).summary() {
        tracing::warn!("{}: {steps}", settings.out.display());
    }
    bag.finish()
}

/// Reports the gaps of a recording: an error while messages are being lost, and a warning afterwards.
fn report(
    node: &Node,
    backlog: &Arc<Backlog>,
    left_out: &Arc<Mutex<BTreeSet<String>>>,
    clock: &Arc<Mutex<LogClock>>,
) -> Result<(), BagError> {
    let (backlog, left_out, clock) = (Arc::clone(backlog), Arc::clone(left_out), Arc::clone(clock));
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
            report.problem(Health::Warn, "nothing was recorded yet: no recorded topic has a message");
        }
        if let Some(steps) = clock.lock().unwrap_or_else(PoisonError::into_inner).summary() {
            report.problem(Health::Warn, &steps);
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
    // A recording under simulated time would log its first messages at time 0.
    while waiting() && !node.shutdown().wait_timeout(LOOK_PERIOD / 10) {}
}

fn write_until_shutdown(
    node: &Node,
    bag: &mut BagWriter,
    topics: &mut Topics<'_>,
    backlog: &Backlog,
    clock: &Mutex<LogClock>,
) -> Result<(), BagError> {
    let mut complaint = Throttle::new(COMPLAIN);
    let mut flush_at = Instant::now() + FLUSH_PERIOD;
    let mut look_at = Instant::now();
    // New topics are no longer accepted after the shutdown request; known ones are drained for LINGER.
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
                // Some publishers send no source timestamp.
                let sent = arrival.sent.unwrap_or(arrival.received);
                if let Some(step) = clock.lock().unwrap_or_else(PoisonError::into_inner).take(arrival.received.nanos())
                    && complaint.pass(wall_now()).is_some()
                {
                    tracing::warn!("{step}");
                }
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
