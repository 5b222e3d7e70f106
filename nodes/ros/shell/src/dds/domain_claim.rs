//! Claim to a DDS domain that no other process of this machine uses.

use super::participant::{domain_id, is_domain_used_here};
use crate::error::ShellError;
use std::os::linux::net::SocketAddrExt;
use std::os::unix::net::{SocketAddr, UnixListener};

/// Claim to a domain, which ends with the process at the latest. Demos and tests claim one, so that simultaneous runs do not
/// meet.
#[derive(Debug)]
pub struct DomainClaim {
    id: u16,
    _socket: UnixListener,
}

impl DomainClaim {
    /// Highest domain with all ports below Linux's ephemeral range, which begins at 32768, and a margin of one domain.
    pub const HIGHEST: u16 = 100;

    /// Claims a domain. Returns `None` if it is claimed already, or a participant of this machine is in it.
    ///
    /// The claim is an abstract socket. Like DDS ports it belongs to a network namespace, and a crash leaves nothing behind.
    ///
    /// # Errors
    /// [`ShellError::Create`]: the operating system refuses the socket.
    pub fn of(id: u16) -> Result<Option<Self>, ShellError> {
        let failed = |error| ShellError::create(format!("claim to DDS domain {id}"), error);
        let address = SocketAddr::from_abstract_name(format!("catenary/domain/{id}")).map_err(failed)?;
        match UnixListener::bind_addr(&address) {
            // Checked after the bind, so that two processes cannot both find the domain free.
            Ok(_) if is_domain_used_here(id) => Ok(None),
            Ok(socket) => Ok(Some(Self { id, _socket: socket })),
            Err(error) if error.kind() == std::io::ErrorKind::AddrInUse => Ok(None),
            Err(error) => Err(failed(error)),
        }
    }

    /// Claims a domain that `accept` takes. Tries the highest first, and never the domain of the environment.
    ///
    /// # Errors
    /// [`ShellError`]: an invalid environment, an error of `accept`, no free domain.
    pub fn any(mut accept: impl FnMut(u16) -> Result<bool, ShellError>) -> Result<Self, ShellError> {
        let users = domain_id()?;
        for id in (1..=Self::HIGHEST).rev().filter(|id| *id != users) {
            if let Some(claim) = Self::of(id)?
                && accept(id)?
            {
                return Ok(claim);
            }
        }
        let reason = "none is free: end other ROS 2 graphs or demos on this machine";
        Err(ShellError::create(format!("DDS domain of 1 to {}", Self::HIGHEST), reason))
    }

    /// Returns the number of the domain, for `ROS_DOMAIN_ID`.
    #[must_use]
    pub fn id(&self) -> u16 {
        self.id
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_claimed_domain_is_exclusive_until_the_claim_ends() {
        let first = DomainClaim::any(|_| Ok(true)).unwrap();
        let second = DomainClaim::any(|_| Ok(true)).unwrap();
        assert_ne!(first.id(), second.id());
        assert!(DomainClaim::of(first.id()).unwrap().is_none());
        let id = first.id();
        drop(first);
        // The multicast port of the domain (RTPS 2.5, section 9.6.2.3).
        let socket = std::net::UdpSocket::bind(("0.0.0.0", 7400 + 250 * id)).unwrap();
        assert!(DomainClaim::of(id).unwrap().is_none(), "a participant is in it");
        drop(socket);
        assert!(DomainClaim::of(id).unwrap().is_some());
    }
}
