//! Named profiles of the quality of service. Every publisher and subscription of the project states one of them.

use rustdds::policy::{Durability, History, Lifespan, Liveliness, Reliability, ResourceLimits};
use rustdds::{Duration as DdsDuration, QosPolicies, QosPolicyBuilder};
use std::fmt;

/// Profile of the quality of service. Every profile keeps the last `depth` messages.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Qos {
    /// Messages may be lost; late subscribers get no old messages. For sensors, images and states at a rate.
    BestEffort {
        /// Number of messages kept.
        depth: u16,
    },
    /// Lost messages are repeated; late subscribers get no old messages. For commands.
    Reliable {
        /// Number of messages kept.
        depth: u16,
    },
    /// Lost messages are repeated, and late subscribers get the last messages. For states that change seldom.
    ReliableTransientLocal {
        /// Number of messages kept, also for late subscribers.
        depth: u16,
    },
}

/// Maximum number of unacknowledged messages of a transient-local writer: 80 s at 50 Hz. A killed subscriber acknowledges nothing
/// during its lease of 50 s. With a smaller number, publishing would fail during the rest of the lease.
const TRANSIENT_LOCAL_MAX_SAMPLES: i32 = 4096;

/// Minimum number of messages that a best-effort writer keeps until they are sent.
const UNSENT: u16 = 10;

/// Liveliness lease of writers that command an arm or publish its state, s. For it RustDDS sends a sign of life every 3 s. Without
/// it a killed publisher would count beside its successor during the 50 s of its participant's lease.
const LEASE_S: i32 = 6;

impl Qos {
    /// Default profile of ROS 2: reliable, volatile, depth 10.
    pub const DEFAULT: Self = Self::Reliable { depth: 10 };
    /// Profile of `/parameter_events`.
    pub const PARAMETER_EVENTS: Self = Self::Reliable { depth: 1000 };
    /// Profile of `/clock`.
    pub const CLOCK: Self = Self::BestEffort { depth: 1 };
    /// Profile of `/tf`.
    pub const TF: Self = Self::Reliable { depth: 100 };
    /// Profile of `/tf_static`.
    pub const TF_STATIC: Self = Self::ReliableTransientLocal { depth: 1 };

    /// Returns the number of messages kept.
    #[must_use]
    pub const fn depth(self) -> u16 {
        match self {
            Self::BestEffort { depth } | Self::Reliable { depth } | Self::ReliableTransientLocal { depth } => depth,
        }
    }

    /// Returns true if lost messages are repeated.
    #[must_use]
    pub const fn is_reliable(self) -> bool {
        !matches!(self, Self::BestEffort { .. })
    }

    /// Returns true if late subscribers get the last messages.
    #[must_use]
    pub const fn is_transient_local(self) -> bool {
        matches!(self, Self::ReliableTransientLocal { .. })
    }

    /// Returns the reason why a subscription with this profile does not hear a publisher that offers `offered`; `None` if it does.
    /// A reader may request at most the quality that the writer offers (DDS 1.4, section 2.2.3).
    #[must_use]
    pub fn unheard(self, offered: Self) -> Option<String> {
        if self.is_reliable() && !offered.is_reliable() {
            return Some("it offers best effort, and reliable is asked for (quality of service)".to_owned());
        }
        if self.is_transient_local() && !offered.is_transient_local() {
            return Some("it offers volatile, and transient local is asked for (quality of service)".to_owned());
        }
        None
    }

    /// Returns the profile with another depth.
    #[must_use]
    pub const fn with_depth(self, depth: u16) -> Self {
        match self {
            Self::BestEffort { .. } => Self::BestEffort { depth },
            Self::Reliable { .. } => Self::Reliable { depth },
            Self::ReliableTransientLocal { .. } => Self::ReliableTransientLocal { depth },
        }
    }

    /// Returns the profile in lock step: lost messages are repeated.
    #[must_use]
    pub(crate) const fn repeated(self) -> Self {
        match self {
            Self::BestEffort { depth } => Self::Reliable { depth },
            other => other,
        }
    }

    /// Returns the profile that a publisher announces, with the depth of [`Qos::DEFAULT`]: depths are not announced.
    pub(crate) fn offered(reliability: Option<Reliability>, durability: Option<Durability>) -> Self {
        let depth = Self::DEFAULT.depth();
        let is_latched = durability.is_some_and(|d| d >= Durability::TransientLocal);
        match reliability {
            Some(Reliability::BestEffort) => Self::BestEffort { depth },
            // A policy that is not announced has its default, which for writers is reliable (DDS 1.4, section 2.2.3).
            _ if is_latched => Self::ReliableTransientLocal { depth },
            _ => Self::Reliable { depth },
        }
    }

    /// Returns the profile of a writer that offers this one. RustDDS sends on another thread. With a depth of one, the next message
    /// replaces the last one before it is sent: half of the messages at 1 kHz on a busy machine. Depths are not announced.
    #[must_use]
    pub(crate) const fn of_writer(self) -> Self {
        match self {
            Self::BestEffort { depth } if depth < UNSENT => Self::BestEffort { depth: UNSENT },
            other => other,
        }
    }

    /// Returns the policies of a writer that commands an arm or publishes its state, with a liveliness lease.
    pub(crate) fn policies_with_lease(self) -> QosPolicies {
        let lease_duration = DdsDuration::from_secs(LEASE_S);
        let lease = QosPolicyBuilder::new().liveliness(Liveliness::Automatic { lease_duration }).build();
        self.policies().modify_by(&lease)
    }

    /// Returns the policies for RustDDS. Publishing never waits for acknowledgements: with a full window it fails at once.
    #[must_use]
    pub fn policies(self) -> QosPolicies {
        // DDS has no history of zero messages.
        let depth = i32::from(self.depth().max(1));
        let builder = QosPolicyBuilder::new()
            .history(History::KeepLast { depth })
            .lifespan(Lifespan { duration: DdsDuration::INFINITE });
        // A node must not stop because a subscriber does.
        let reliable = Reliability::Reliable { max_blocking_time: DdsDuration::ZERO };
        match self {
            // Without a limit a reader keeps 64 samples: 59 MB of colour images.
            Self::BestEffort { .. } => builder
                .reliability(Reliability::BestEffort)
                .durability(Durability::Volatile)
                .resource_limits(limits(depth)),
            Self::Reliable { .. } => builder.reliability(reliable).durability(Durability::Volatile),
            // Without a limit a writer without readers keeps 8192 samples for late subscribers.
            Self::ReliableTransientLocal { .. } => builder
                .reliability(reliable)
                .durability(Durability::TransientLocal)
                .resource_limits(limits(depth.max(TRANSIENT_LOCAL_MAX_SAMPLES))),
        }
        .build()
    }
}

fn limits(max_samples: i32) -> ResourceLimits {
    ResourceLimits { max_samples, max_instances: 1, max_samples_per_instance: max_samples }
}

impl fmt::Display for Qos {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let kind = match self {
            Self::BestEffort { .. } => "best effort",
            Self::Reliable { .. } => "reliable",
            Self::ReliableTransientLocal { .. } => "reliable, transient local",
        };
        write!(formatter, "{kind}, depth {}", self.depth())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn in_lock_step_every_stream_repeats_what_was_lost() {
        for (qos, repeated) in [
            (Qos::BestEffort { depth: 5 }, Qos::Reliable { depth: 5 }),
            (Qos::DEFAULT, Qos::DEFAULT),
            (Qos::TF_STATIC, Qos::TF_STATIC),
        ] {
            assert_eq!(qos.repeated(), repeated);
        }
    }

    #[test]
    fn policies_say_what_the_profile_says() {
        let image = Qos::BestEffort { depth: 5 }.policies();
        assert_eq!(image.reliability(), Some(Reliability::BestEffort));
        assert_eq!(image.durability(), Some(Durability::Volatile));
        assert_eq!(image.history(), Some(History::KeepLast { depth: 5 }));
        assert_eq!(image.resource_limits().map(|limits| limits.max_samples), Some(5));
        let state = Qos::ReliableTransientLocal { depth: 1 }.policies();
        assert!(matches!(state.reliability(), Some(Reliability::Reliable { .. })));
        assert_eq!(state.durability(), Some(Durability::TransientLocal));
        assert_eq!(state.history(), Some(History::KeepLast { depth: 1 }));
        let command = Qos::Reliable { depth: 10 }.policies();
        assert_eq!(command.durability(), Some(Durability::Volatile));
        assert_eq!(command.resource_limits(), None);
    }

    #[test]
    fn a_best_effort_subscription_matches_a_reliable_publisher_and_not_the_reverse() {
        let best_effort = Qos::BestEffort { depth: 1 }.policies();
        let reliable = Qos::Reliable { depth: 1 }.policies();
        let latched = Qos::ReliableTransientLocal { depth: 1 }.policies();
        assert_eq!(reliable.compliance_failure_wrt(&best_effort), None);
        assert!(best_effort.compliance_failure_wrt(&reliable).is_some());
        assert_eq!(latched.compliance_failure_wrt(&reliable), None);
        assert!(reliable.compliance_failure_wrt(&latched).is_some());
    }

    #[test]
    fn unheard_publishers_are_those_that_the_middleware_does_not_match() {
        let profiles =
            [Qos::BestEffort { depth: 1 }, Qos::Reliable { depth: 1 }, Qos::ReliableTransientLocal { depth: 1 }];
        for (asked, offered) in profiles.iter().flat_map(|asked| profiles.iter().map(move |offered| (asked, offered))) {
            let refused = offered.policies().compliance_failure_wrt(&asked.policies()).is_some();
            assert_eq!(asked.unheard(*offered).is_some(), refused, "{asked} asked, {offered} offered");
        }
    }

    #[test]
    fn a_writer_with_a_lease_matches_readers_that_request_none() {
        let offered = Qos::Reliable { depth: 1 }.policies_with_lease();
        assert!(offered.liveliness().is_some());
        assert_eq!(offered.history(), Some(History::KeepLast { depth: 1 }));
        assert_eq!(offered.compliance_failure_wrt(&Qos::Reliable { depth: 1 }.policies()), None);
    }

    #[test]
    fn a_best_effort_writer_keeps_unsent_messages() {
        assert_eq!(Qos::BestEffort { depth: 1 }.of_writer(), Qos::BestEffort { depth: 10 });
        assert_eq!(Qos::BestEffort { depth: 50 }.of_writer(), Qos::BestEffort { depth: 50 });
        assert_eq!(Qos::Reliable { depth: 1 }.of_writer(), Qos::Reliable { depth: 1 });
    }

    #[test]
    fn a_depth_of_zero_is_taken_as_one() {
        let policies = Qos::Reliable { depth: 0 }.policies();
        assert_eq!(policies.history(), Some(History::KeepLast { depth: 1 }));
    }
}
