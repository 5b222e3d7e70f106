//! Matches between the node's endpoints and endpoints of others.

use rustdds::{DomainParticipantStatusEvent, GUID};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Mutex, MutexGuard, PoisonError};

#[derive(Default)]
struct State {
    /// Matched endpoints of others, by own endpoint.
    matched: BTreeMap<GUID, BTreeSet<GUID>>,
    /// Waiters for the next change.
    waiting: Vec<smol::channel::Sender<()>>,
}

/// Matched endpoints, according to discovery.
#[derive(Default)]
pub(crate) struct Matches {
    state: Mutex<State>,
}

impl Matches {
    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Applies an event of discovery, and wakes the waiters if it is a change.
    pub(crate) fn apply(&self, event: &DomainParticipantStatusEvent) {
        let mut state = self.state();
        match *event {
            DomainParticipantStatusEvent::RemoteReaderMatched { local_writer: own, remote_reader: other }
            | DomainParticipantStatusEvent::RemoteWriterMatched { local_reader: own, remote_writer: other } => {
                state.matched.entry(own).or_default().insert(other);
            }
            DomainParticipantStatusEvent::ReaderLost { guid, .. }
            | DomainParticipantStatusEvent::WriterLost { guid, .. } => {
                // The lost endpoint may also be an own one.
                state.matched.remove(&guid);
                for others in state.matched.values_mut() {
                    others.remove(&guid);
                }
            }
            // For a participant that left or was killed, RustDDS reports no loss of its endpoints.
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

    /// Returns a channel that becomes readable at the next change.
    pub(crate) fn change(&self) -> smol::channel::Receiver<()> {
        let (sender, receiver) = smol::channel::bounded(1);
        let mut state = self.state();
        // Waiters that gave up leave a closed channel behind.
        state.waiting.retain(|waiting| !waiting.is_closed());
        state.waiting.push(sender);
        receiver
    }

    fn has_any(&self, own: GUID) -> bool {
        self.state().matched.get(&own).is_some_and(|others| !others.is_empty())
    }

    /// Returns true if an own writer has a reader.
    pub(crate) fn has_reader(&self, writer: GUID) -> bool {
        self.has_any(writer)
    }

    /// Returns true if an own reader has a writer.
    pub(crate) fn has_writer(&self, reader: GUID) -> bool {
        self.has_any(reader)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rustdds::LostReason;

    #[test]
    fn a_match_lasts_until_the_other_is_lost_and_wakes_waiters() {
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
    fn a_lost_participant_loses_all_its_matches_and_wakes_waiters() {
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
