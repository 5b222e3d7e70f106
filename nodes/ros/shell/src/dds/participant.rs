//! DDS participant, configured by the environment variables of ROS 2.

use super::socket_owner::bound_ports;
use super::{own_machine, system_calls};
use crate::error::ShellError;
use rustdds::{DomainParticipant, DomainParticipantBuilder};
use std::net::Ipv4Addr;
use std::sync::{Mutex, PoisonError};

/// Range of automatic discovery.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Discovery {
    /// Nodes on this machine, over the loopback interface only.
    Localhost,
    /// Nodes on every network of this machine.
    Subnet,
}

/// Returns the domain from `ROS_DOMAIN_ID`, 0 by default.
///
/// # Errors
/// [`ShellError::Environment`]: an invalid domain or range of discovery.
pub fn domain_id() -> Result<u16, ShellError> {
    Ok(Participation::from_environment(&|name| std::env::var(name).ok())?.0.domain)
}

/// Returns the domain and the range of discovery of a process with these environment variables.
///
/// # Errors
/// [`ShellError::Environment`], as [`domain_id`].
pub fn domain_and_range(variable: &dyn Fn(&str) -> Option<String>) -> Result<(u16, Discovery), ShellError> {
    let (participation, _) = Participation::from_environment(variable)?;
    Ok((participation.domain, participation.discovery))
}

/// Returns the UDP ports of a domain (RTPS 2.5, section 9.6.2.3): 7400 + 250 d for multicast, and for participant p
/// 7400 + 250 d + 10 + 2 p for discovery and the next port for data.
fn ports(domain: u16) -> std::ops::Range<u32> {
    let first = 7400 + 250 * u32::from(domain);
    first..first + 250
}

/// Returns the UDP port at which a participant receives discovery (RTPS 2.5, section 9.6.2.3).
pub(crate) fn discovery_port(domain: u16, participant: u16) -> u32 {
    ports(domain).start + 10 + 2 * u32::from(participant)
}

/// Returns the UDP port at which a participant receives data.
pub(crate) fn data_port(domain: u16, participant: u16) -> u32 {
    discovery_port(domain, participant) + 1
}

/// Returns true if a participant of this machine is in a domain. Does not join the domain.
#[must_use]
pub fn is_domain_used_here(domain: u16) -> bool {
    let ports = ports(domain);
    bound_ports().into_iter().any(|port| ports.contains(&u32::from(port)))
}

/// Returns the data ports of this machine's participants in a domain, found by their discovery ports.
pub(crate) fn data_ports_here(domain: u16) -> Vec<u16> {
    // Discovery ports are even. A data port counts only together with its discovery port: any program may use a port in the range.
    let (ports, bound) = (ports(domain), bound_ports());
    let first = ports.start + 10;
    let is_discovery =
        |port: &u16| ports.contains(&u32::from(*port)) && u32::from(*port) >= first && port.is_multiple_of(2);
    bound.iter().filter(|port| is_discovery(port) && bound.contains(&(*port + 1))).map(|port| port + 1).collect()
}

/// Domain and range of discovery of a node.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Participation {
    pub(crate) domain: u16,
    pub(crate) discovery: Discovery,
}

/// Highest domain with UDP ports for participants: 7400 + 250 * 232 + 10 + 2 * 62 is still below 65536.
const MAX_DOMAIN: u16 = 232;

/// Maximum number of participants in a domain that RustDDS assigns ports to.
const PARTICIPANTS: u16 = 120;

/// Parses a number as rcl does, with `strtoul` of base 0.
///
/// `0x` begins a hexadecimal number and `0` an octal one: `010` is 8. Text after the digits is ignored, unless the number is
/// zero: rcl takes that for a text without a number.
fn unsigned(text: &str) -> Option<u64> {
    let text = text.trim_start_matches(|c: char| c.is_ascii_whitespace() || c == '\x0b');
    let (is_negative, text) = match text.strip_prefix('-') {
        Some(rest) => (true, rest),
        None => (false, text.strip_prefix('+').unwrap_or(text)),
    };
    let hexadecimal = text.strip_prefix("0x").or_else(|| text.strip_prefix("0X"));
    let (radix, digits) = match hexadecimal {
        Some(rest) if rest.starts_with(|c: char| c.is_ascii_hexdigit()) => (16, rest),
        _ if text.starts_with('0') => (8, text),
        _ => (10, text),
    };
    let rest = digits.trim_start_matches(|c: char| c.is_digit(radix));
    let digits = &digits[..digits.len() - rest.len()];
    // No digits is zero for `strtoul`. An empty variable never comes here: rcl treats it as unset.
    let number = if digits.is_empty() { 0 } else { u64::from_str_radix(digits, radix).ok()? };
    if number == 0 && !rest.is_empty() {
        return None;
    }
    // `strtoul` wraps a negative number; the range check of the domain then refuses it.
    Some(if is_negative { number.wrapping_neg() } else { number })
}

impl Participation {
    /// Reads `ROS_DOMAIN_ID`, `ROS_AUTOMATIC_DISCOVERY_RANGE` and the older `ROS_LOCALHOST_ONLY`. Also returns warnings about
    /// deprecated variables and variables without effect.
    pub(crate) fn from_environment(
        variable: &dyn Fn(&str) -> Option<String>,
    ) -> Result<(Self, Vec<&'static str>), ShellError> {
        let variable = |name| variable(name).filter(|value| !value.is_empty());
        let mut warnings = Vec::new();
        let domain = match variable("ROS_DOMAIN_ID") {
            None => 0,
            Some(value) => {
                let domain = unsigned(&value).and_then(|domain| u16::try_from(domain).ok());
                domain.filter(|domain| *domain <= MAX_DOMAIN).ok_or(ShellError::Environment {
                    variable: "ROS_DOMAIN_ID",
                    value,
                    expected: "an integer from 0 to 232",
                })?
            }
        };
        let range = variable("ROS_AUTOMATIC_DISCOVERY_RANGE");
        let mut discovery = match range.as_deref() {
            None | Some("SUBNET" | "SYSTEM_DEFAULT") => Discovery::Subnet,
            Some("LOCALHOST") => Discovery::Localhost,
            Some("OFF") => {
                return Err(ShellError::Environment {
                    variable: "ROS_AUTOMATIC_DISCOVERY_RANGE",
                    value: "OFF".to_owned(),
                    expected: "LOCALHOST or SUBNET, because without discovery this node would meet no other",
                });
            }
            Some(other) => {
                return Err(ShellError::Environment {
                    variable: "ROS_AUTOMATIC_DISCOVERY_RANGE",
                    value: other.to_owned(),
                    expected: "LOCALHOST, SUBNET or SYSTEM_DEFAULT",
                });
            }
        };
        // The old variable outranks the new one, as in rcl.
        if variable("ROS_LOCALHOST_ONLY").as_deref() == Some("1") {
            warnings.push("ROS_LOCALHOST_ONLY is deprecated and taken for ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST");
            discovery = Discovery::Localhost;
        }
        if variable("ROS_STATIC_PEERS").is_some() {
            warnings.push("ROS_STATIC_PEERS has no effect here: other nodes are found by multicast and loopback");
        }
        Ok((Self { domain, discovery }, warnings))
    }

    /// Returns the message for a domain without a free port.
    fn full(self) -> String {
        let (first, last) = (discovery_port(self.domain, 0), discovery_port(self.domain, PARTICIPANTS - 1));
        format!(
            "expected a free UDP port for one more node, but every second one of {first} to {last} is in use; another ROS_DOMAIN_ID has others"
        )
    }

    /// Joins the domain. With [`Discovery::Localhost`] no datagram of another machine is heard from here on.
    pub(crate) fn join(self) -> Result<DomainParticipant, ShellError> {
        // One at a time, because a participant's sockets are known by being new.
        static JOINING: Mutex<()> = Mutex::new(());
        let _joining = JOINING.lock().unwrap_or_else(PoisonError::into_inner);
        system_calls::link();
        match self.discovery {
            Discovery::Subnet => self.build(),
            Discovery::Localhost => self.build_for_own_machine(),
        }
    }

    /// Joins the domain, and restricts the participant's sockets to this machine. RustDDS gives no access to them.
    fn build_for_own_machine(self) -> Result<DomainParticipant, ShellError> {
        let failed = |error: &dyn std::fmt::Display| {
            ShellError::create(
                format!("DDS domain {}", self.domain),
                format!("not restricted to this machine: {error}"),
            )
        };
        let before = own_machine::listeners().map_err(|error| failed(&error))?;
        let participant = self.build()?;
        let mut new = own_machine::listeners().map_err(|error| failed(&error))?;
        new.retain(|name, _| !before.contains_key(name));
        let id = participant.participant_id();
        // Without this check another way of RustDDS to open its sockets would leave them open to everyone.
        for port in [discovery_port(self.domain, id), data_port(self.domain, id)] {
            if !new.values().any(|listener| u32::from(listener.port) == port) {
                return Err(failed(&format!("expected a socket of this process at UDP port {port}")));
            }
        }
        own_machine::restrict(new.values()).map_err(|error| failed(&error))?;
        Ok(participant)
    }

    fn build(self) -> Result<DomainParticipant, ShellError> {
        let builder = DomainParticipantBuilder::new(self.domain);
        let builder = match self.discovery {
            Discovery::Localhost => builder.with_only_networks([Ipv4Addr::LOCALHOST]),
            Discovery::Subnet => builder,
        };
        builder.build().map_err(|error| {
            let reason = error.to_string();
            // RustDDS has no error of its own for a full domain. With another text the message only loses its advice.
            let reason = match reason.contains("ParticipantId") {
                true => self.full(),
                false => reason,
            };
            ShellError::create(format!("DDS domain {}", self.domain), reason)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(pairs: &[(&str, &str)]) -> Result<(Participation, Vec<&'static str>), ShellError> {
        Participation::from_environment(&|name| {
            pairs.iter().find(|(key, _)| *key == name).map(|(_, value)| (*value).to_owned())
        })
    }

    #[test]
    fn the_environment_chooses_domain_and_range() {
        for (pairs, domain, discovery) in [
            (vec![], 0, Discovery::Subnet),
            (vec![("ROS_DOMAIN_ID", "42")], 42, Discovery::Subnet),
            (vec![("ROS_DOMAIN_ID", "")], 0, Discovery::Subnet),
            (vec![("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")], 0, Discovery::Localhost),
            (vec![("ROS_AUTOMATIC_DISCOVERY_RANGE", "SYSTEM_DEFAULT")], 0, Discovery::Subnet),
            (vec![("ROS_LOCALHOST_ONLY", "1")], 0, Discovery::Localhost),
        ] {
            let (participation, _) = read(&pairs).unwrap();
            assert_eq!(participation, Participation { domain, discovery }, "{pairs:?}");
        }
        assert_eq!(read(&[("ROS_LOCALHOST_ONLY", "1")]).unwrap().1.len(), 1);
        assert_eq!(read(&[("ROS_STATIC_PEERS", "lab")]).unwrap().1.len(), 1);
    }

    #[test]
    fn a_domain_is_read_as_rcl_reads_it() {
        for (text, domain) in [
            ("010", Some(8)),
            ("0x1F", Some(31)),
            ("0X1f", Some(31)),
            (" \t42", Some(42)),
            ("+7", Some(7)),
            ("42 ", Some(42)),
            ("42abc", Some(42)),
            ("42.7", Some(42)),
            ("012abc", Some(10)),
            ("0", Some(0)),
            ("-0", Some(0)),
            ("00", Some(0)),
            ("08", None),
            ("0x", None),
            ("0b101", None),
            ("0 ", None),
            ("lab", None),
            ("-1", None),
            ("18446744073709551616", None),
            ("65536", None),
            ("0xE9", None),
        ] {
            let read = read(&[("ROS_DOMAIN_ID", text)]).ok().map(|(participation, _)| participation.domain);
            assert_eq!(read, domain, "{text:?}");
        }
    }

    #[test]
    fn wrong_values_are_named() {
        for (name, value) in [
            ("ROS_DOMAIN_ID", "lab"),
            ("ROS_DOMAIN_ID", "233"),
            ("ROS_AUTOMATIC_DISCOVERY_RANGE", "OFF"),
            ("ROS_AUTOMATIC_DISCOVERY_RANGE", "localhost"),
        ] {
            let message = read(&[(name, value)]).unwrap_err().to_string();
            assert!(message.contains(name) && message.contains(value), "{message}");
        }
    }
}
