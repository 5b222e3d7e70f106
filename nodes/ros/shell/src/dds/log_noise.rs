//! Log lines of the middleware: which of them are noise.

use std::sync::atomic::{AtomicBool, Ordering};

/// Directives of the log filter for the middleware.
///
/// `rustdds::network` warns of every large datagram, and of missing multicast on the loopback interface. The data writer warns of a
/// full window, which the publisher reports itself. [`is_noise`] filters warnings of RTPS writers by their text.
pub(crate) const FILTER: &str = "rustdds=warn,ros2_client=warn,\
    rustdds::network=error,rustdds::dds::with_key::datawriter=error,ros2_client::distributions=error";

/// Set when the last node of the process leaves the graph: warnings of the middleware about its own end are noise.
static IS_HUSHED: AtomicBool = AtomicBool::new(false);

/// Silences the log lines of the middleware, or enables them again.
pub(crate) fn hush(hushed: bool) {
    IS_HUSHED.store(hushed, Ordering::Release);
}

/// Returns true while the log lines of the middleware are silenced.
pub(crate) fn is_hushed() -> bool {
    IS_HUSHED.load(Ordering::Acquire)
}

/// Returns true for a log target of the middleware or of the crates below it.
pub(crate) fn is_of_middleware(target: &str) -> bool {
    ["rustdds", "ros2_client", "mio", "polling"].into_iter().any(|name| target.starts_with(name))
}

/// Returns true for lines of RustDDS that are expected, or that the caller reports itself. A changed text in a later version of
/// RustDDS costs a superfluous log line, and nothing else.
pub(crate) fn is_noise(level: tracing::Level, target: &str, message: &str) -> bool {
    match target {
        // A writer warns of every lost datagram on a lossy link. A mismatch of QoS is a mistake that the user must see.
        "rustdds::rtps::writer" => level == tracing::Level::WARN && !message.contains("QoS mismatch"),
        // The event loop may be busy when an endpoint is dropped. The end of the participant removes the endpoint.
        "rustdds::dds::pubsub" => message.starts_with("Cannot remove"),
        // `Participation::join` returns the same failure to the caller.
        "rustdds::dds::participant" => message.contains("ParticipantId"),
        // A node that ends right after its start hears of its own endpoints when they are gone.
        "rustdds::discovery" | "rustdds::discovery::discovery" => message.contains("Did not find a local"),
        // The interface may be gone at the end of a node; its group went with it.
        "rustdds::network::udp_listener" => message.contains("leave_multicast_group"),
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn discovery_lines_about_a_short_lived_node_are_noise_and_others_are_not() {
        let noise = |message| is_noise(tracing::Level::WARN, "rustdds::discovery", message);
        assert!(noise("Did not find a local reader GUID {1}"));
        let twin = "Did not find a local writer GUID {1}";
        assert!(noise(twin) && is_noise(tracing::Level::WARN, "rustdds::discovery::discovery", twin));
        assert!(!noise("Cannot get multicast discovery listener"));
    }
}
