//! Subscriptions. Each has its own thread, which sleeps until a message comes.

use super::intake::Intake;
use super::late_join::LateJoin;
use super::tally::Flaw;
use crate::dds::endpoint::Reader;
use crate::dds::graph::Graph;
use crate::dds::interface::Payload;
use crate::dds::qos::Qos;
use crate::error::ShellError;
use crate::process::node::Node;
use crate::time::clock::{Clock, wall_now};
use crate::time::point::Time;
use crate::time::shutdown::Shutdown;
use crate::time::wait::block_until;
use crate::time::watchdog::Throttle;
use futures::StreamExt;
use std::pin::pin;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Received message with its metadata.
#[derive(Debug)]
pub struct Received<M> {
    /// Message.
    pub message: Arc<M>,
    /// Time of arrival, in the node's clock.
    pub received: Time,
    /// Time of sending, in the sender's wall clock, if the sender gives it.
    pub sent: Option<Time>,
    /// Identifier of the publisher.
    pub publisher: [u8; 16],
    /// Number of messages delivered by this subscription so far, including this one.
    pub count: u64,
}

impl<M> Clone for Received<M> {
    fn clone(&self) -> Self {
        Self { message: Arc::clone(&self.message), ..*self }
    }
}

/// Handle of a subscription. Dropping it ends the subscription.
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
    /// Returns the absolute name of the topic.
    #[must_use]
    pub fn topic(&self) -> &str {
        &self.topic
    }

    /// Returns true once the subscription must end.
    pub(super) fn is_over(&self) -> bool {
        self.stop.is_triggered()
    }

    /// Starts the thread of a subscription.
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
    // Declared before the graph: fields drop in this order, and endpoints must go before their participant.
    reader: Reader<M>,
    topic: String,
    qos: Qos,
    /// Intake that counts unreadable messages.
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
                        // Set on delivery: the late join may drop or delay messages.
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
