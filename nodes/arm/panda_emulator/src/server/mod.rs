//! Server of the Franka Control Interface: TCP for requests, UDP for states and commands.
//!
//! One client has the session: the first one that sends `Connect`. The server closes the connection of a second client as soon as it is
//! made; how a robot refuses it is not published. A client of another version gets the version of the server, then its connection is
//! closed.

mod events;
mod handle;
mod network;
mod newcomers;
mod pace;
mod run;
mod session;

pub use events::{Event, EventLog};
pub use handle::{Handle, Snapshot};
pub use network::{Fault, Link, Network};
pub use pace::Pace;
pub use session::{Reception, Session};

use crate::{Panda, Settings};
use handle::Shared;
use std::io;
use std::net::{SocketAddr, TcpListener};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;

/// Port of the Franka Control Interface. Clients that build on libfranka know no other.
pub const FCI_PORT: u16 = 1337;
/// Default wait for a command. Chosen: half of libfranka's timeout for a state, 1 s.
pub const PATIENCE: Duration = Duration::from_millis(500);

/// Options of a server.
#[derive(Debug, Clone)]
pub struct ServerOptions {
    /// Settings of arm and control box.
    pub settings: Settings,
    /// Seed of all random numbers: noise of sensors, and network.
    pub seed: u64,
    /// Clock.
    pub pace: Pace,
    /// Wait for a command in lock step and in the elastic pace. libfranka gives up a robot that is silent for 1 s.
    pub patience: Duration,
    /// Quality of the network.
    pub network: Network,
    /// Shared library that clients of FCI 5 on x86-64 Linux load as the model of the arm. Without one, the answer says that there is none.
    pub model_library: Option<Vec<u8>>,
}

impl Default for ServerOptions {
    fn default() -> Self {
        Self {
            settings: Settings::default(),
            seed: 0,
            pace: Pace::default(),
            patience: PATIENCE,
            network: Network::default(),
            model_library: None,
        }
    }
}

/// Running server. It ends when it is dropped.
#[derive(Debug)]
pub struct Server {
    address: SocketAddr,
    handle: Handle,
    thread: Option<JoinHandle<()>>,
}

impl Server {
    /// Starts a server on a thread of its own.
    ///
    /// Port 0 takes a free port, for clients that let the port be chosen.
    ///
    /// # Errors
    /// The address is taken or does not exist; the settings are invalid ([`io::ErrorKind::InvalidInput`]).
    pub fn bind(address: SocketAddr, options: ServerOptions) -> io::Result<Self> {
        let ServerOptions { settings, seed, pace, patience, network, model_library } = options;
        let panda = Panda::new(settings, seed).map_err(|error| io::Error::new(io::ErrorKind::InvalidInput, error))?;
        let listener = TcpListener::bind(address)?;
        listener.set_nonblocking(true)?;
        let address = listener.local_addr()?;
        let shared = Arc::new(Shared::default());
        let session = Session::new(panda, model_library);
        // The network has random numbers of its own, so that it does not change the noise of the sensors.
        let link = Link::new(network, seed ^ 0x006E_6574_776F_726B);
        let thread = run::start(session, link, listener, (pace, patience), Arc::clone(&shared))?;
        Ok(Self { address, handle: Handle::new(shared), thread: Some(thread) })
    }

    /// Address of the server.
    #[must_use]
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Handle of arm and control box, for other threads.
    #[must_use]
    pub fn handle(&self) -> Handle {
        self.handle.clone()
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.handle.stop();
        if let Some(thread) = self.thread.take() {
            // A panic of the thread was printed when it happened, and handles tell it.
            let _ended = thread.join();
        }
    }
}
