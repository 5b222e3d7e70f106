//! Quality of service, by name. Every publisher and subscription of the project states one of these.

use rustdds::policy::{Durability, History, Lifespan, Liveliness, Reliability, ResourceLimits};
use rustdds::{Duration as DdsDuration, QosPolicies, QosPolicyBuilder};
use std::fmt;

/// A quality-of-service profile. All keep the last `depth` messages.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Qos {
    /// May lose messages; late subscribers get nothing old. For sensors, images and states at a rate.
    BestEffort {
        /// Messages kept.
        depth: u16,
    },
    /// Lost messages are repeated; late subscribers get nothing old. For commands.
    Reliable {
        /// Messages kept.
        depth: u16,
    },
    /// As `Reliable`, and late subscribers get the last messages. For states that change seldom.
    ReliableTransientLocal {
        /// Messages kept, also for late subscribers.
        depth: u16,
    },
}

/// Unacknowledged messages that a transient-local writer keeps at most: 80 s at 50 Hz. A subscriber that was killed
/// counts as behind for the 50 s of its lease, and with fewer messages publishing would be refused during the rest of it.
const TRANSIENT_LOCAL_MAX_SAMPLES: i32 = 4096;

/// Messages that a best-effort writer keeps at least until they have left.
const UNSENT: u16 = 10;

/// Silence after which whoever commands an arm, or tells its state, is taken for dead. RustDDS gives a sign of life every 3 s for it. The lease of
/// its participants is 50 s, in which one that was killed would count beside the one that follows it.
const PROMISE_S: i32 = 6;

impl Qos {
    /// The command profile of ROS 2's defaults: reliable, volatile, depth 10.
    pub const DEFAULT: Self = Self::Reliable { depth: 10 };
    /// The profile of `/parameter_events`.
    pub const PARAMETER_EVENTS: Self = Self::Reliable { depth: 1000 };
    /// The profile of `/clock`.
    pub const CLOCK: Self = Self::BestEffort { depth: 1 };
    /// The profile of `/tf`.
    pub const TF: Self = Self::Reliable { depth: 100 };
    /// The profile of `/tf_static`.
    pub const TF_STATIC: Self = Self::ReliableTransientLocal { depth: 1 };

    /// Messages kept.
    #[must_use]
    pub const fn depth(self) -> u16 {
        match self {
            Self::BestEffort { depth } | Self::Reliable { depth } | Self::ReliableTransientLocal { depth } => depth,
        }
    }

    /// Whether lost messages are repeated.
    #[must_use]
    pub const fn is_reliable(self) -> bool {
        !matches!(self, Self::BestEffort { .. })
    }

    /// Whether late subscribers get the last messages.
    #[must_use]
    pub const fn is_transient_local(self) -> bool {
        matches!(self, Self::ReliableTransientLocal { .. })
    }

    /// Reason for which a subscription with this profile hears nothing of a publisher that offers `offered`; none: it hears
    /// the publisher. DDS 1.4, section 2.2.3: a reader asks for at most what the writer offers.
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

    /// The same kind with another depth.
    #[must_use]
    pub const fn with_depth(self, depth: u16) -> Self {
        match self {
            Self::BestEffort { .. } => Self::BestEffort { depth },
            Self::Reliable { .. } => Self::Reliable { depth },
            Self::ReliableTransientLocal { .. } => Self::ReliableTransientLocal { depth },
        }
    }

    /// The profile that a publisher announces, with the depth of [`Qos::DEFAULT`]: depths are not announced.
    pub(crate) fn offered(reliability: Option<Reliability>, durability: Option<Durability>) -> Self {
        let depth = Self::DEFAULT.depth();
        let is_latched = durability.is_some_and(|d| d >= Durability::TransientLocal);
        match reliability {
            Some(Reliability::BestEffort) => Self::BestEffort { depth },
            // DDS 1.4, section 2.2.3: what is not announced has its default, which for writers is reliable.
            _ if is_latched => Self::ReliableTransientLocal { depth },
            _ => Self::Reliable { depth },
        }
    }

    /// The profile of a writer that offers this one. RustDDS sends on another thread, and with a depth of one the next message
    /// replaces the last one before it has left: at 1 kHz on a busy machine, half of them. Depths are not told to others.
    #[must_use]
    pub(crate) const fn of_writer(self) -> Self {
        match self {
            Self::BestEffort { depth } if depth < UNSENT => Self::BestEffort { depth: UNSENT },
            other => other,
        }
    }

    /// The policies of a writer that commands an arm or tells its state: it promises signs of life.
    pub(crate) fn policies_with_promise(self) -> QosPolicies {
        let lease_duration = DdsDuration::from_secs(PROMISE_S);
        let promise = QosPolicyBuilder::new().liveliness(Liveliness::Automatic { lease_duration }).build();
        self.policies().modify_by(&promise)
    }

    /// The policies for rustdds. Publishing never waits for acknowledgements: where a reliable writer's
    /// window is full it fails at once.
    #[must_use]
    pub fn policies(self) -> QosPolicies {
        let depth = i32::from(self.depth().max(1));
        let builder = QosPolicyBuilder::new()
            .history(History::KeepLast { depth })
            .lifespan(Lifespan { duration: DdsDuration::INFINITE });
        let reliable = Reliability::Reliable { max_blocking_time: DdsDuration::ZERO };
        match self {
            // Without a limit a reader keeps 64 samples, which are 59 MB of colour images.
            Self::BestEffort { .. } => builder
                .reliability(Reliability::BestEffort)
                .durability(Durability::Volatile)
                .resource_limits(limits(depth)),
            Self::Reliable { .. } => builder.reliability(reliable).durability(Durability::Volatile),
            // Without a limit a writer that nobody reads keeps 8192 samples for late subscribers.
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
    fn a_subscription_says_which_publishers_it_does_not_hear_as_the_middleware_decides() {
        let profiles =
            [Qos::BestEffort { depth: 1 }, Qos::Reliable { depth: 1 }, Qos::ReliableTransientLocal { depth: 1 }];
        for (asked, offered) in profiles.iter().flat_map(|asked| profiles.iter().map(move |offered| (asked, offered))) {
            let refused = offered.policies().compliance_failure_wrt(&asked.policies()).is_some();
            assert_eq!(asked.unheard(*offered).is_some(), refused, "{asked} asked, {offered} offered");
        }
    }

    #[test]
    fn whoever_commands_promises_signs_of_life_and_matches_who_expects_none() {
        let offered = Qos::Reliable { depth: 1 }.policies_with_promise();
        assert!(offered.liveliness().is_some());
        assert_eq!(offered.history(), Some(History::KeepLast { depth: 1 }));
        assert_eq!(offered.compliance_failure_wrt(&Qos::Reliable { depth: 1 }.policies()), None);
    }

    #[test]
    fn a_best_effort_writer_keeps_what_has_not_left() {
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
