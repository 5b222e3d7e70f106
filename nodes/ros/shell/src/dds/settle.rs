//! Pause between joining the domain and creating the first endpoint, in which other participants discover this one.
//!
//! The pause works around Fast DDS 2.14.5, which may otherwise never see some endpoints. RTPS allows announcements without a source
//! timestamp, and RustDDS 0.15.1 sends none. Fast DDS sorts pending announcements by this timestamp. When two participants announce
//! endpoints while earlier announcements are still on their way, some of them may be sorted behind a later one in `ReaderHistory`,
//! and `NotifyChanges` never reaches them. They are acknowledged, so they are not repeated. Announcements to a participant that has
//! discovered this one before come in order.

use crate::time::wait::block_until;
use rustdds::{DomainParticipant, DomainParticipantStatusEvent, StatusEvented};
use smol::stream::StreamExt;
use std::time::{Duration, Instant};

/// Pause after joining: RustDDS announces a participant after 100 ms, and the others answer at once.
const ANSWERED: Duration = Duration::from_millis(150);

/// Pause after an answer: Fast DDS requests earlier announcements 70 ms after it has discovered a participant.
const MET: Duration = Duration::from_millis(150);

/// Maximum pause, in a domain that other participants join all the time.
const PATIENCE: Duration = Duration::from_secs(1);

/// Returns the end of the pause of a participant that joined at `joined` and discovered another one last at `met`.
fn due(joined: Instant, met: Option<Instant>) -> Instant {
    let answered = joined + ANSWERED;
    // Each discovery prolongs the pause, up to its limit.
    met.map_or(answered, |met| (met + MET).max(answered)).min(joined + PATIENCE)
}

/// Waits until the participants of the domain have discovered this one. Call it before the first endpoint: it consumes the
/// participant's events.
pub(crate) fn settle(participant: &DomainParticipant) {
    let listener = participant.status_listener();
    let mut events = listener.as_async_status_stream();
    let (joined, mut met) = (Instant::now(), None);
    while let Some(Some(event)) = block_until(events.next(), Some(due(joined, met))) {
        // The participant's discovery of itself is not reported as an event.
        if matches!(event, DomainParticipantStatusEvent::ParticipantDiscovered { .. }) {
            met = Some(Instant::now());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_pause_ends_after_the_last_discovery_or_at_its_limit() {
        let joined = Instant::now();
        let at = |ms| joined + Duration::from_millis(ms);
        assert_eq!(due(joined, None), at(150));
        assert_eq!(due(joined, Some(joined)), at(150));
        assert_eq!(due(joined, Some(at(120))), at(270));
        assert_eq!(due(joined, Some(at(960))), at(1000));
    }
}
