//! End of a connection from outside of the thread that waits on it.

use super::own_sockets::own_sockets;
use rustix::io::Errno;
use rustix::net::{Shutdown, getpeername, shutdown};
use std::net::SocketAddr;
use std::os::fd::OwnedFd;

/// Second handle of the connection's TCP socket.
pub struct HangUp(OwnedFd);

impl HangUp {
    /// Finds the socket that this process has connected to `address`, the newest one first. Returns `None` if there is none.
    pub fn find(address: SocketAddr) -> Option<Self> {
        let is_connected = |fd: &OwnedFd| {
            let peer = getpeername(fd).ok().flatten().and_then(|p| SocketAddr::try_from(p).ok());
            peer == Some(address)
        };
        own_sockets().find(is_connected).map(Self)
    }

    /// Shuts the socket down: whoever waits on it gets an error. Returns false if that was not possible.
    pub fn end(&self) -> bool {
        // A socket that is not connected any more has ended by itself.
        matches!(shutdown(&self.0, Shutdown::Both), Ok(()) | Err(Errno::NOTCONN))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Read;
    use std::net::{TcpListener, TcpStream};

    #[test]
    fn a_waiting_read_ends() {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a free port");
        let address = listener.local_addr().expect("an address");
        let mut client = TcpStream::connect(address).expect("a listener");
        let _server = listener.accept().expect("a client");
        let hang_up = HangUp::find(address).expect("the socket of this process");
        let waiting = std::thread::spawn(move || client.read(&mut [0; 8]).expect("the end of the stream"));
        assert!(hang_up.end());
        assert_eq!(waiting.join().expect("no panic"), 0);
    }
}
