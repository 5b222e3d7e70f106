//! Numbering of episodes.

use std::time::SystemTime;

/// Returns the number of the first episode of a node that is started at `wall`: the seconds since 1970.
///
/// A restarted node therefore repeats no number of an earlier recording: an episode takes longer than a second.
#[must_use]
pub fn first_episode(wall: SystemTime) -> u32 {
    wall.duration_since(SystemTime::UNIX_EPOCH).map_or(1, |since| since.as_secs() as u32).max(1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn a_restarted_node_repeats_no_number() {
        let started = SystemTime::UNIX_EPOCH + Duration::from_secs(1_750_000_000);
        let first = first_episode(started);
        let episodes = 20;
        let again = first_episode(started + Duration::from_secs(2 * u64::from(episodes)));
        assert!(again > first + episodes - 1, "{again} after {episodes} episodes from {first}");
        assert_eq!(first_episode(SystemTime::UNIX_EPOCH - Duration::from_secs(5)), 1, "a clock before 1970");
    }
}
