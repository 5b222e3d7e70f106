//! Subscriptions: by callback, as the newest message, or as a queue. Each has its own thread, which sleeps until
//! a message comes.

use crate::clock::{Clock, wall_now};
use crate::error::ShellError;
use crate::graph::Graph;
use crate::intake::Intake;
use crate::interface::{Msg, Payload};
use crate::late_join::LateJoin;
use crate::middleware::Reader;
use crate::node::Node;
use crate::qos::Qos;
use crate::shutdown::{Shutdown, Signal, Wake};
use crate::tally::Flaw;
use crate::time::Time;
use crate::wait::block_until;
use crate::watchdog::Throttle;
use futures::StreamExt;
use std::collections::VecDeque;
use std::pin::pin;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// A message with what is known about its arrival.
#[derive(Debug)]
pub struct Received<M> {
    /// The message.
    pub message: Arc<M>,
    /// When it came, in the node's clock.
    pub received: Time,
    /// When it was sent, in the sender's wall clock, where the sender says so.
    pub sent: Option<Time>,
    /// Identifies the publisher.
    pub publisher: [u8; 16],
    /// Messages that this subscription has delivered so far, this one included.
    pub count: u64,
}

impl<M> Clone for Received<M> {
    fn clone(&self) -> Self {
        Self { message: Arc::clone(&self.message), ..*self }
    }
}

/// Ends its subscription when it is dropped.
#[must_use = "the subscription ends when its handle is dropped"]
pub struct Subscription {
    topic: String,
    stop: Shutdown,
}

impl Drop for Subscription {
    fn drop(&mut self) {
        self.stop.trigger();
    }
}

impl Subscription {
    /// The absolute topic.
    #[must_use]
    pub fn topic(&self) -> &str {
        &self.topic
    }

    pub(crate) fn start<M: Payload>(
        node: &Node,
        topic: String,
        qos: Qos,
        reader: Reader<M>,
        intake: Option<Intake>,
        callback: impl FnMut(Received<M>) + Send + 'static,
    ) -> Result<Self, ShellError> {
        let stop = node.end_of_subscription();
        let pump = Pump {
            reader,
            topic: topic.clone(),
            qos,
            intake,
            clock: node.clock().clone(),
            stop: stop.clone(),
            _graph: Arc::clone(node.graph()),
        };
        node.spawn(&format!("sub {topic}"), move || pump.run(callback))?;
        Ok(Self { topic, stop })
    }
}

struct Pump<M: Payload> {
    // Before the graph, so that the reader goes first.
    reader: Reader<M>,
    topic: String,
    qos: Qos,
    /// Counter of unreadable messages.
    intake: Option<Intake>,
    clock: Clock,
    stop: Shutdown,
    _graph: Arc<Graph>,
}

impl<M: Payload> Pump<M> {
    fn run(&self, mut callback: impl FnMut(Received<M>)) {
        let mut stream = pin!(self.reader.stream());
        let mut unreadable = Throttle::new(Duration::from_secs(5));
        let mut late = self.qos.is_transient_local().then(|| LateJoin::new(wall_now(), self.qos.depth()));
        let mut count = 0;
        let mut deliver = |received: Received<M>| {
            count += 1;
            callback(Received { count, ..received });
        };
        loop {
            let due = late.as_ref().and_then(LateJoin::due);
            let deadline = due.map(|due| Instant::now() + due.saturating_since(wall_now()));
            match block_until(smol::future::or(self.stopped(), stream.next()), deadline) {
                Some(None) => return,
                Some(Some(Ok((message, info)))) => {
                    let received = Received {
                        message: Arc::new(message),
                        received: self.clock.now(),
                        sent: info.source_timestamp().map(|time| Time::from_nanos(time.to_nanos())),
                        publisher: *info.publisher_gid().as_bytes(),
                        count: 0,
                    };
                    match &mut late {
                        Some(late) => {
                            let (publisher, sent) = (received.publisher, received.sent);
                            late.message(received, publisher, sent, wall_now(), &mut deliver);
                        }
                        None => deliver(received),
                    }
                }
                Some(Some(Err(error))) => match &self.intake {
                    Some(intake) => intake.count(Err(Flaw::new("unreadable", format!("unreadable: {error}")))),
                    None => {
                        if let Some(before) = unreadable.pass(wall_now()) {
                            tracing::warn!("{}: unreadable message: {error} (and {before} before)", self.topic);
                        }
                    }
                },
                None => {}
            }
            if let Some(late) = &mut late {
                late.deliver_due(wall_now(), &mut deliver);
            }
        }
    }

    async fn stopped<T>(&self) -> Option<T> {
        self.stop.triggered().await;
        None
    }
}

/// The newest message of a topic. Clones share it; the subscription ends with the last.
#[derive(Clone)]
pub struct Latest<M: Msg> {
    slot: Arc<Signal<Option<Received<M>>>>,
    subscription: Arc<Subscription>,
}

impl<M: Msg> Latest<M> {
    /// Latest message of an intake's topic that `check` finds no flaw in.
    pub(crate) fn start(
        node: &Node,
        intake: &Intake,
        mut check: impl FnMut(&M) -> Result<(), Flaw> + Send + 'static,
    ) -> Result<Self, ShellError> {
        let slot = Arc::new(Signal::new(None));
        let wake: Arc<dyn Wake> = Arc::<Signal<Option<Received<M>>>>::clone(&slot);
        node.shutdown().register(Arc::downgrade(&wake));
        let filled = Arc::clone(&slot);
        let subscription = node.take(intake, move |received: Received<M>| {
            check(&received.message)?;
            *filled.lock() = Some(received);
            filled.notify();
            Ok(())
        })?;
        Ok(Self { slot, subscription: Arc::new(subscription) })
    }

    /// The newest message; none: none yet.
    #[must_use]
    pub fn get(&self) -> Option<Received<M>> {
        self.slot.lock().clone()
    }

    /// The newest message where it is not older than `age` at `now`.
    #[must_use]
    pub fn fresh(&self, now: Time, age: Duration) -> Option<Received<M>> {
        self.get().filter(|received| now.saturating_since(received.received) <= age)
    }

    /// Waits for a message with a count above `seen` (0: any) and returns the newest; none: the wall-clock timeout
    /// or shutdown came first.
    #[must_use]
    pub fn wait_newer(&self, seen: u64, timeout: Duration) -> Option<Received<M>> {
        let deadline = Instant::now() + timeout;
        let mut guard = self.slot.lock();
        loop {
            if let Some(received) = guard.as_ref().filter(|received| received.count > seen) {
                return Some(received.clone());
            }
            if self.subscription.stop.is_triggered() || Instant::now() >= deadline {
                return None;
            }
            guard = self.slot.wait_until(guard, Some(deadline));
        }
    }

    /// The absolute topic.
    #[must_use]
    pub fn topic(&self) -> &str {
        self.subscription.topic()
    }
}

struct Backlog<M> {
    messages: VecDeque<Received<M>>,
    dropped: u64,
}

/// The messages of a topic in order, up to a capacity. Clones share the queue.
#[derive(Clone)]
pub struct Queue<M: Msg> {
    backlog: Arc<Signal<Backlog<M>>>,
    subscription: Arc<Subscription>,
}

impl<M: Msg> Queue<M> {
    /// Queue of an intake's topic. An overflow counts as a drop while the topic is needed: an idle node reads no queue.
    pub(crate) fn start(node: &Node, intake: &Intake, capacity: usize) -> Result<Self, ShellError> {
        let capacity = capacity.max(1);
        let messages = VecDeque::with_capacity(capacity.min(1024));
        let backlog = Arc::new(Signal::new(Backlog { messages, dropped: 0 }));
        let wake: Arc<dyn Wake> = Arc::<Signal<Backlog<M>>>::clone(&backlog);
        node.shutdown().register(Arc::downgrade(&wake));
        let filled = Arc::clone(&backlog);
        let read = intake.clone();
        let subscription = node.take(intake, move |received| {
            let mut backlog = filled.lock();
            let is_full = backlog.messages.len() == capacity;
            if is_full {
                backlog.messages.pop_front();
                backlog.dropped += 1;
            }
            backlog.messages.push_back(received);
            drop(backlog);
            filled.notify();
            if is_full && read.is_needed() {
                return Err(Flaw::new("overflow", format!("the queue of {capacity} messages is full")));
            }
            Ok(())
        })?;
        Ok(Self { backlog, subscription: Arc::new(subscription) })
    }

    /// The oldest message, without waiting.
    #[must_use]
    pub fn try_next(&self) -> Option<Received<M>> {
        self.backlog.lock().messages.pop_front()
    }

    /// The oldest message; none: the wall-clock timeout or shutdown came first.
    #[must_use]
    pub fn next(&self, timeout: Duration) -> Option<Received<M>> {
        let deadline = Instant::now() + timeout;
        let mut guard = self.backlog.lock();
        loop {
            if let Some(received) = guard.messages.pop_front() {
                return Some(received);
            }
            if self.subscription.stop.is_triggered() || Instant::now() >= deadline {
                return None;
            }
            guard = self.backlog.wait_until(guard, Some(deadline));
        }
    }

    /// Messages that were lost because the queue was full.
    #[must_use]
    pub fn dropped(&self) -> u64 {
        self.backlog.lock().dropped
    }

    /// The absolute topic.
    #[must_use]
    pub fn topic(&self) -> &str {
        self.subscription.topic()
    }
}
