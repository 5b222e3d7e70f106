//! Connections that have not sent `Connect` yet. They do not have the session, so that one without a word keeps nobody out.
#![allow(clippy::disallowed_methods, reason = "connections have a deadline")]

use crate::wire::{HEADER_BYTES, Header};
use std::collections::VecDeque;
use std::io::{self, ErrorKind, Read};
use std::net::{SocketAddr, TcpStream};
use std::time::{Duration, Instant};

/// Size of `Connect`, bytes.
const CONNECT_BYTES: usize = 16;
/// Wait for the `Connect` of a new connection. Chosen: clients send it at once.
const CONNECT_PATIENCE: Duration = Duration::from_secs(5);
/// Connections that may wait. Chosen: many more than users of one arm; another one takes the place of the oldest.
const MOST: usize = 16;

/// Connection that has not sent its `Connect`.
struct Newcomer {
    stream: TcpStream,
    address: SocketAddr,
    since: Instant,
    bytes: [u8; CONNECT_BYTES],
    got: usize,
}

/// Connection whose `Connect` has come.
pub struct Caller {
    /// Connection.
    pub stream: TcpStream,
    /// Its address.
    pub address: SocketAddr,
    /// `Connect`.
    pub connect: [u8; CONNECT_BYTES],
}

/// Connections that have not sent their `Connect`.
#[derive(Default)]
pub struct Newcomers {
    waiting: VecDeque<Newcomer>,
}

impl Newcomers {
    /// Lets a connection wait for its `Connect`.
    ///
    /// # Errors
    /// The connection cannot be read without waiting.
    pub fn add(&mut self, stream: TcpStream, address: SocketAddr) -> io::Result<()> {
        stream.set_nonblocking(true)?;
        stream.set_nodelay(true)?;
        if self.waiting.len() == MOST {
            self.waiting.pop_front();
        }
        let since = Instant::now();
        self.waiting.push_back(Newcomer { stream, address, since, bytes: [0; CONNECT_BYTES], got: 0 });
        Ok(())
    }

    /// Connections, to wait for their bytes.
    pub fn streams(&self) -> impl Iterator<Item = &TcpStream> {
        self.waiting.iter().map(|newcomer| &newcomer.stream)
    }

    /// Reads, and returns the first connection whose `Connect` has come. One that sends something else, closes or is silent for too long
    /// is closed.
    pub fn first_caller(&mut self) -> Option<Caller> {
        self.waiting.retain_mut(|newcomer| newcomer.read().is_ok());
        let at = self.waiting.iter().position(|newcomer| newcomer.got == CONNECT_BYTES)?;
        let Newcomer { stream, address, bytes, .. } = self.waiting.remove(at)?;
        Some(Caller { stream, address, connect: bytes })
    }

    /// Closes all connections and returns their addresses.
    pub fn dismiss(&mut self) -> impl Iterator<Item = SocketAddr> {
        std::mem::take(&mut self.waiting).into_iter().map(|newcomer| newcomer.address)
    }
}

impl Newcomer {
    /// Reads what has come of `Connect`.
    ///
    /// # Errors
    /// The connection is over, too late, or sends something else.
    fn read(&mut self) -> io::Result<()> {
        while self.got < CONNECT_BYTES {
            match self.stream.read(&mut self.bytes[self.got..]) {
                Ok(0) => return Err(ErrorKind::UnexpectedEof.into()),
                Ok(count) => self.got += count,
                Err(error) if error.kind() == ErrorKind::WouldBlock => break,
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
        if self.got < CONNECT_BYTES && self.since.elapsed() > CONNECT_PATIENCE {
            return Err(ErrorKind::TimedOut.into());
        }
        if self.got < HEADER_BYTES {
            return Ok(());
        }
        // Command 0 is `Connect` in every version, and all have its size.
        match Header::decode(&self.bytes) {
            Ok(Some(Header { command: 0, size, .. })) if size as usize == CONNECT_BYTES => Ok(()),
            _ => Err(ErrorKind::InvalidData.into()),
        }
    }
}
