//! Health of a node, and the sources of its reports.

use crate::dds::qos::Qos;
use std::fmt::Display;
use std::sync::{Arc, Mutex, PoisonError, Weak};

/// Topic, message type and profile of a publisher of another participant.
pub(crate) type OtherPublisher = (String, String, Qos);

/// Health of a node.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Health {
    /// No problem.
    Ok = 0,
    /// Works with losses.
    Warn = 1,
    /// Does not work, or gets no data on a topic that it needs.
    Error = 2,
}

/// Health report of a node.
#[derive(Debug)]
pub struct Report {
    pub(crate) health: Health,
    pub(crate) message: String,
    pub(crate) values: Vec<(String, String)>,
}

impl Report {
    pub(crate) fn new() -> Self {
        Self { health: Health::Ok, message: String::new(), values: Vec::new() }
    }

    /// Returns the worst health of all problems so far.
    #[must_use]
    pub fn health(&self) -> Health {
        self.health
    }

    /// Adds a value. Its name carries the unit: `image_rate_hz`.
    pub fn value(&mut self, key: &str, value: impl Display) -> &mut Self {
        self.values.push((key.to_owned(), value.to_string()));
        self
    }

    /// Adds a problem. The report has the worst health of its problems, and all their messages.
    pub fn problem(&mut self, health: Health, message: &str) -> &mut Self {
        self.health = self.health.max(health);
        if !self.message.is_empty() {
            self.message.push_str("; ");
        }
        self.message.push_str(message);
        self
    }
}

/// Source of problems and values for a node's reports.
pub(crate) trait Source: Send + Sync {
    /// Adds to a report. `publishers` are the publishers of other participants.
    fn report(&self, publishers: &[OtherPublisher], report: &mut Report);
}

/// Sources of a node's reports. A source is reported until it is dropped.
#[derive(Default)]
pub(crate) struct Sources {
    all: Mutex<Vec<Weak<dyn Source>>>,
}

impl Sources {
    /// Adds a source.
    pub(crate) fn add(&self, source: Weak<dyn Source>) {
        self.all.lock().unwrap_or_else(PoisonError::into_inner).push(source);
    }

    /// Adds every living source to a report.
    pub(crate) fn report(&self, publishers: &[OtherPublisher], report: &mut Report) {
        let mut all = self.all.lock().unwrap_or_else(PoisonError::into_inner);
        all.retain(|source| source.strong_count() > 0);
        let left: Vec<Arc<dyn Source>> = all.iter().filter_map(Weak::upgrade).collect();
        // Released before the reports, because other threads add sources meanwhile.
        drop(all);
        left.iter().for_each(|source| source.report(publishers, report));
    }
}
