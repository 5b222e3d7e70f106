//! Creation of subscriptions and of their intakes.

use super::intake::Intake;
use super::latest::{Backlog, Latest, Queue};
use super::subscription::{Received, Subscription};
use super::tally::{Flaw, Names};
use crate::dds::interface::Msg;
use crate::dds::qos::Qos;
use crate::error::ShellError;
use crate::process::node::Node;
use crate::time::shutdown::{Signal, Wake};
use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;

impl Node {
    /// Calls `callback` with every message, on the subscription's own thread, until the handle is dropped.
    ///
    /// A transient-local subscription gets the last `depth` earlier messages of each publisher, after the publisher was silent
    /// for 0.1 s or before its next message.
    ///
    /// # Errors
    /// As [`Node::publisher`].
    pub fn subscription<M: Msg>(
        &self,
        topic: &str,
        qos: Qos,
        mut callback: impl FnMut(Received<M>) + Send + 'static,
    ) -> Result<Subscription, ShellError> {
        let intake = self.plain_intake::<M>(topic, qos)?;
        self.take(&intake, move |received| {
            callback(received);
            Ok(())
        })
    }

    /// Creates a subscription. `intake` counts its unreadable messages.
    pub(crate) fn subscribe<M: Msg>(
        &self,
        topic: &str,
        qos: Qos,
        intake: Option<Intake>,
        callback: impl FnMut(Received<M>) + Send + 'static,
    ) -> Result<Subscription, ShellError> {
        let (name, qos) = (self.topic::<M>(topic)?, self.profile(qos));
        let reader = self.graph().reader(&name, M::TYPE_NAME, &qos.policies())?;
        Subscription::start(self, name, qos, reader, intake, callback)
    }

    /// Keeps the newest message of a topic.
    ///
    /// # Errors
    /// As [`Node::publisher`].
    pub fn latest<M: Msg>(&self, topic: &str, qos: Qos) -> Result<Latest<M>, ShellError> {
        self.take_latest(&self.plain_intake::<M>(topic, qos)?, |_| Ok(()))
    }

    /// Queues at most `capacity` messages of a topic. A full queue drops its oldest message, and counts the drop.
    ///
    /// # Errors
    /// As [`Node::publisher`].
    pub fn queue<M: Msg>(&self, topic: &str, qos: Qos, capacity: usize) -> Result<Queue<M>, ShellError> {
        self.take_queue(&self.plain_intake::<M>(topic, qos)?, capacity)
    }

    /// Creates the intake of a topic, for [`Node::take`]. While the topic is needed ([`Intake::need`]), a silence longer than
    /// `patience` is an error.
    ///
    /// # Errors
    /// [`ShellError::Name`].
    pub fn intake<M: Msg>(
        &self,
        topic: &str,
        qos: Qos,
        names: Names,
        patience: Duration,
    ) -> Result<Intake, ShellError> {
        self.new_intake::<M>(topic, qos, Some(names), patience)
    }

    /// Creates an intake that reports only unheard publishers.
    pub(crate) fn plain_intake<M: Msg>(&self, topic: &str, qos: Qos) -> Result<Intake, ShellError> {
        self.new_intake::<M>(topic, qos, None, Duration::MAX)
    }

    fn new_intake<M: Msg>(
        &self,
        topic: &str,
        qos: Qos,
        names: Option<Names>,
        patience: Duration,
    ) -> Result<Intake, ShellError> {
        let intake = Intake::new::<M>(topic, self.resolve(topic)?, self.profile(qos), names, patience, self.clock());
        self.health_sources().add(intake.source());
        Ok(intake)
    }

    /// Calls `callback` with every message of an intake's topic, as [`Node::subscription`]. A message counts as dropped if its
    /// callback returns a flaw.
    ///
    /// # Errors
    /// As [`Node::publisher`].
    pub fn take<M: Msg>(
        &self,
        intake: &Intake,
        mut callback: impl FnMut(Received<M>) -> Result<(), Flaw> + Send + 'static,
    ) -> Result<Subscription, ShellError> {
        let (counted, counting) = (intake.clone(), intake.clone());
        self.subscribe::<M>(intake.topic(), intake.qos(), Some(counted), move |received| {
            counting.count(callback(received));
        })
    }

    /// Keeps the newest message of an intake's topic that passes `check`, which also learns its writer.
    ///
    /// # Errors
    /// As [`Node::publisher`].
    pub fn take_latest<M: Msg>(
        &self,
        intake: &Intake,
        mut check: impl FnMut(&Received<M>) -> Result<(), Flaw> + Send + 'static,
    ) -> Result<Latest<M>, ShellError> {
        let slot = Arc::new(Signal::new(None));
        let wake: Arc<dyn Wake> = Arc::<Signal<Option<Received<M>>>>::clone(&slot);
        self.shutdown().register(Arc::downgrade(&wake));
        let filled = Arc::clone(&slot);
        let subscription = self.take(intake, move |received: Received<M>| {
            check(&received)?;
            *filled.lock() = Some(received);
            filled.notify();
            Ok(())
        })?;
        Ok(Latest::new(slot, subscription))
    }

    /// Queues at most `capacity` messages of an intake's topic, as [`Node::queue`]. An overflow counts as a drop only while the topic
    /// is needed.
    ///
    /// # Errors
    /// As [`Node::publisher`].
    pub fn take_queue<M: Msg>(&self, intake: &Intake, capacity: usize) -> Result<Queue<M>, ShellError> {
        let capacity = capacity.max(1);
        // A queue with a huge limit need not reserve memory for it.
        let messages = VecDeque::with_capacity(capacity.min(1024));
        let backlog = Arc::new(Signal::new(Backlog { messages, dropped: 0 }));
        let wake: Arc<dyn Wake> = Arc::<Signal<Backlog<M>>>::clone(&backlog);
        self.shutdown().register(Arc::downgrade(&wake));
        let filled = Arc::clone(&backlog);
        let read = intake.clone();
        let subscription = self.take(intake, move |received| {
            let is_full = filled.lock().push(received, capacity);
            filled.notify();
            // An idle node does not read its queues.
            if is_full && read.is_needed() {
                return Err(Flaw::new("overflow", format!("the queue of {capacity} messages is full")));
            }
            Ok(())
        })?;
        Ok(Queue::new(backlog, subscription))
    }
}
