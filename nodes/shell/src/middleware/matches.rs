//! Which endpoints of others this node's endpoints are matched with.

use rustdds::{DomainParticipantStatusEvent, GUID};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Mutex, MutexGuard, PoisonError};

#[derive(Default)]
struct State {
    /// Matched endpoints of others, by the own endpoint.
    matched: BTreeMap<GUID, BTreeSet<GUID>>,
    /// Those who wait for a change.
    waiting: Vec<smol::channel::Sender<()>>,
}

/// Matched endpoints, as discovery tells of them.
#[derive(Default)]
pub(crate) struct Matches {
    state: Mutex<State>,
}

impl Matches {
    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes in a change, and wakes those who wait for one.
    pub(crate) fn apply(&self, event: &DomainParticipantStatusEvent) {
        let mut state = self.state();
        match *event {
            DomainParticipantStatusEvent::RemoteReaderMatched { local_writer: own, remote_reader: other }
            | DomainParticipantStatusEvent::RemoteWriterMatched { local_reader: own, remote_writer: other } => {
                state.matched.entry(own).or_default().insert(other);
            }
            DomainParticipantStatusEvent::ReaderLost { guid, .. }
            | DomainParticipantStatusEvent::WriterLost { guid, .. } => {
                // An own endpoint that ended is lost, too.
                state.matched.remove(&guid);
                for others in state.matched.values_mut() {
                    others.remove(&guid);
                }
            }
            // RustDDS tells of a participant that was killed, or said goodbye, by this alone.
            DomainParticipantStatusEvent::ParticipantLost { id, .. } => {
                state.matched.retain(|own, _| own.prefix != id);
                for others in state.matched.values_mut() {
                    others.retain(|other| other.prefix != id);
                }
            }
            _ => return,
        }
        for waiting in state.waiting.drain(..) {
            let _already_told = waiting.try_send(());
        }
    }

    /// Becomes readable at the next change.
    pub(crate) fn change(&self) -> smol::channel::Receiver<()> {
        let (sender, receiver) = smol::channel::bounded(1);
        let mut state = self.state();
        state.waiting.retain(|waiting| !waiting.is_closed());
        state.waiting.push(sender);
        receiver
    }

    fn has_any(&self, own: GUID) -> bool {
        self.state().matched.get(&own).is_some_and(|others| !others.is_empty())
    }

    /// Whether the own writer has a reader.
    pub(crate) fn has_reader(&self, writer: GUID) -> bool {
        self.has_any(writer)
    }

    /// Whether the own reader has a writer.
    pub(crate) fn has_writer(&self, reader: GUID) -> bool {
        self.has_any(reader)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rustdds::LostReason;

    #[test]
    fn a_match_lasts_until_the_other_is_lost_and_wakes_who_waits() {
        let guid = |byte| GUID::from_bytes([byte; 16]);
        let matches = Matches::default();
        let change = matches.change();
        matches.apply(&DomainParticipantStatusEvent::RemoteReaderMatched {
            local_writer: guid(1),
            remote_reader: guid(2),
        });
        assert!(matches.has_reader(guid(1)) && !matches.has_reader(guid(2)));
        assert_eq!(change.try_recv(), Ok(()));
        let change = matches.change();
        matches.apply(&DomainParticipantStatusEvent::TopicLost { name: "rt/a".to_owned() });
        assert!(change.try_recv().is_err());
        matches.apply(&DomainParticipantStatusEvent::ReaderLost { guid: guid(2), reason: LostReason::Disposed });
        assert!(!matches.has_reader(guid(1)));
        assert_eq!(change.try_recv(), Ok(()));
    }

    #[test]
    fn a_participant_that_is_lost_takes_all_its_endpoints_along_and_wakes_who_waits() {
        let guid = |byte| GUID::from_bytes([byte; 16]);
        let matches = Matches::default();
        for other in [2, 3] {
            matches.apply(&DomainParticipantStatusEvent::RemoteWriterMatched {
                local_reader: guid(1),
                remote_writer: guid(other),
            });
        }
        for (lost, is_left) in [(2, true), (3, false)] {
            let change = matches.change();
            let id = guid(lost).prefix;
            matches.apply(&DomainParticipantStatusEvent::ParticipantLost { id, reason: LostReason::Disposed });
            assert_eq!(matches.has_writer(guid(1)), is_left);
            assert_eq!(change.try_recv(), Ok(()));
        }
    }
}
