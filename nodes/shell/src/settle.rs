//! The time between joining the domain and making the first endpoint, in which the others meet the participant.
//!
//! RTPS lets announcements go without a source timestamp, and those of RustDDS 0.15.1 do. Fast DDS 2.14.5 orders what it has
//! not yet taken in by that timestamp: where two participants announce an endpoint while their earlier announcements are
//! still on the way to it, those of one of them may stand behind a later one in its `ReaderHistory`, and `NotifyChanges`
//! never gets to them. They are acknowledged, so they do not come again, and that process never sees these endpoints. What
//! is announced to a participant that was met before comes in order, and all of it is seen.

use crate::wait::block_until;
use rustdds::{DomainParticipant, DomainParticipantStatusEvent, StatusEvented};
use smol::stream::StreamExt;
use std::time::{Duration, Instant};

/// From joining on: RustDDS announces a participant after 100 ms, and those that are there answer at once.
const ANSWERED: Duration = Duration::from_millis(150);

/// From an answer on: Fast DDS asks 70 ms after it has met a participant for what this has announced so far.
const MET: Duration = Duration::from_millis(150);

/// In a domain in which others come all the time.
const PATIENCE: Duration = Duration::from_secs(1);

/// When to go on, of a participant that joined then and met another one last at `met`.
fn due(joined: Instant, met: Option<Instant>) -> Instant {
    let answered = joined + ANSWERED;
    met.map_or(answered, |met| (met + MET).max(answered)).min(joined + PATIENCE)
}

/// Waits until those that are there have met this participant, which must have no endpoint yet: its events are taken here.
pub(crate) fn settle(participant: &DomainParticipant) {
    let listener = participant.status_listener();
    let mut events = listener.as_async_status_stream();
    let (joined, mut met) = (Instant::now(), None);
    while let Some(Some(event)) = block_until(events.next(), Some(due(joined, met))) {
        // Its own discovery of itself is not among them.
        if matches!(event, DomainParticipantStatusEvent::ParticipantDiscovered { .. }) {
            met = Some(Instant::now());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_goes_on_when_nobody_new_was_met_for_a_while_or_in_the_end() {
        let joined = Instant::now();
        let at = |ms| joined + Duration::from_millis(ms);
        assert_eq!(due(joined, None), at(150));
        assert_eq!(due(joined, Some(joined)), at(150));
        assert_eq!(due(joined, Some(at(120))), at(270));
        assert_eq!(due(joined, Some(at(960))), at(1000));
    }
}
