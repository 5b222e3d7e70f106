//! Thread of a server: sockets and clock around a [`Session`].
#![allow(clippy::disallowed_methods, reason = "a server has a clock, a thread and sockets")]

use super::events::Event;
use super::handle::{Input, Shared, Snapshot};
use super::network::Link;
use super::pace::Pace;
use super::session::{Reception, Session};
use crate::wire::{STATE_BYTES_MAX, encode_state};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use std::io::{self, ErrorKind, Read, Write};
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream, UdpSocket};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Period of a cycle.
const CYCLE: Duration = Duration::from_millis(1);
/// Cycles that the clock catches up after a pause of the machine. Chosen: a burst that a client takes as jitter.
const CATCH_UP: u32 = 5;
/// Time for which the lock step looks for the command without sleeping. Chosen: twice the usual answer of a client. To fall asleep and
/// wake up costs a fifth of a cycle.
const WATCH: Duration = Duration::from_micros(100);
/// Wait of the lock step for a command. Chosen: half of libfranka's timeout for a state, 1 s.
const PATIENCE: Duration = Duration::from_millis(500);
/// Wait for the `Connect` of a new connection. Chosen: clients send it at once.
const CONNECT_PATIENCE: Duration = Duration::from_secs(5);
/// Datagrams to a closed port after which the client counts as silent. Chosen: half a second, because each second one is reported.
const REFUSALS: u32 = 250;
/// Longest sleep, so that the end of the server is noticed.
const LONGEST_SLEEP: Duration = Duration::from_millis(10);

/// Starts the thread.
pub(super) fn start(
    session: Session,
    link: Link,
    listener: TcpListener,
    pace: Pace,
    shared: Arc<Shared>,
) -> io::Result<JoinHandle<()>> {
    let server = Loop {
        session,
        link,
        listener,
        pace,
        shared,
        client: None,
        cycles: 0,
        cycles_left_out: 0,
        is_awaited: false,
        sent: None,
    };
    std::thread::Builder::new().name("fci_server".to_owned()).spawn(move || server.run())
}

/// Sockets that have something.
#[derive(Debug, Clone, Copy)]
struct Ready {
    connections: bool,
    requests: bool,
    commands: bool,
}

/// Connection of a client.
struct Client {
    stream: TcpStream,
    address: SocketAddr,
    since: Instant,
    /// Socket for states and commands, once the client connected.
    datagrams: Option<UdpSocket>,
    outbox: Vec<u8>,
    refusals: u32,
}

struct Loop {
    session: Session,
    link: Link,
    listener: TcpListener,
    pace: Pace,
    shared: Arc<Shared>,
    client: Option<Client>,
    cycles: u64,
    cycles_left_out: u64,
    /// True if the newest state has reached the client, so that its command can come.
    is_awaited: bool,
    /// Time at which the newest state was sent, until its command comes.
    sent: Option<Instant>,
}

impl Loop {
    fn run(mut self) {
        let began = Instant::now();
        let mut next_cycle = began;
        let mut last_cycle = began;
        while !self.shared.is_stopped() {
            let is_stepped = self.pace == Pace::LockStep && self.is_awaited && self.session.waits_for_command();
            let wake = if is_stepped { last_cycle + PATIENCE } else { self.next_wake(began, next_cycle) };
            let ready = self.wait(wake, if is_stepped { WATCH } else { Duration::ZERO });
            self.serve(ready);
            if self.pace == Pace::Clock {
                self.deliver(ms_since(began));
            }
            let now = Instant::now();
            if self.pace == Pace::LockStep && self.session.is_stepped() {
                if self.is_awaited && self.session.waits_for_command() {
                    if now < last_cycle + PATIENCE {
                        continue;
                    }
                    self.session.give_up_waiting();
                }
                next_cycle = now;
            } else if now < next_cycle {
                continue;
            }
            self.cycle(began);
            last_cycle = now;
            next_cycle += CYCLE;
            let behind = now.saturating_duration_since(next_cycle);
            if behind > CYCLE * CATCH_UP {
                // The quotient is small and not negative.
                self.cycles_left_out += behind.as_millis() as u64;
                next_cycle = now;
            }
        }
    }

    fn next_wake(&self, began: Instant, next_cycle: Instant) -> Instant {
        if self.pace == Pace::LockStep && self.session.is_stepped() {
            return began;
        }
        match self.link.next_due_ms() {
            Some(due_ms) if self.pace == Pace::Clock => {
                next_cycle.min(began + Duration::from_secs_f64(due_ms.max(0.0) / 1e3))
            }
            _ => next_cycle,
        }
    }

    /// Looks for `watch`, and then sleeps, until a socket has something or the time has come. Returns the sockets that have something.
    fn wait(&self, until: Instant, watch: Duration) -> Ready {
        let begun = Instant::now();
        let sleep = until.saturating_duration_since(begun).min(LONGEST_SLEEP);
        let mut sockets = vec![PollFd::new(&self.listener, PollFlags::IN)];
        if let Some(client) = &self.client {
            let write = if client.outbox.is_empty() { PollFlags::empty() } else { PollFlags::OUT };
            sockets.push(PollFd::new(&client.stream, PollFlags::IN | write));
            sockets.extend(client.datagrams.as_ref().map(|socket| PollFd::new(socket, PollFlags::IN)));
        }
        let timeout = Timespec { tv_sec: 0, tv_nsec: i64::from(sleep.subsec_nanos()) };
        let at_once = Timespec { tv_sec: 0, tv_nsec: 0 };
        let mut has_come = false;
        while !has_come && begun.elapsed() < watch {
            has_come = poll(&mut sockets, Some(&at_once)).is_ok_and(|count| count > 0);
            // The client may need this processor.
            std::thread::yield_now();
        }
        if !has_come {
            // An interrupted sleep is a short one.
            let _count = poll(&mut sockets, Some(&timeout));
        }
        let ready = |at: usize| sockets.get(at).is_some_and(|socket| !socket.revents().is_empty());
        Ready { connections: ready(0), requests: ready(1), commands: ready(2) }
    }

    /// Serves the sockets that have something, without waiting.
    fn serve(&mut self, ready: Ready) {
        // Each cycle finds out whether the client is silent.
        if (ready.requests || !ready.commands) && !self.serve_requests() {
            self.close();
        }
        if ready.commands {
            self.serve_commands();
        }
        if ready.connections {
            self.accept();
        }
        self.shared.log(&mut self.session.log);
    }

    fn accept(&mut self) {
        while let Ok((stream, address)) = self.listener.accept() {
            // A client that closed its connection before this one was made has left.
            if !self.serve_requests() {
                self.close();
            }
            if self.client.is_some() || prepare(&stream).is_err() {
                self.session.log_event(Event::ClientRefused(address));
                continue;
            }
            let since = Instant::now();
            let client = Client { stream, address, since, datagrams: None, outbox: Vec::new(), refusals: 0 };
            self.client = Some(client);
        }
    }

    /// Returns false if the connection is over.
    fn serve_requests(&mut self) -> bool {
        let Some(client) = &mut self.client else { return true };
        let mut bytes = [0; 4096];
        loop {
            match client.stream.read(&mut bytes) {
                Ok(0) => return false,
                Ok(count) => match self.session.receive(&bytes[..count], &mut client.outbox) {
                    Reception::Continue => {}
                    Reception::Connected { udp_port } => match open(client, udp_port) {
                        Ok(socket) => {
                            client.datagrams = Some(socket);
                            self.session.log_event(Event::ClientConnected(client.address));
                        }
                        Err(error) => {
                            self.session.log_event(Event::SocketFailed(error.to_string()));
                            return false;
                        }
                    },
                    Reception::Close => {
                        flush(client);
                        return false;
                    }
                },
                Err(error) if error.kind() == ErrorKind::WouldBlock => break,
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(_) => return false,
            }
        }
        // Handles see an event before the client sees its answer.
        self.shared.log(&mut self.session.log);
        let is_silent =
            client.refusals > REFUSALS || client.datagrams.is_none() && client.since.elapsed() > CONNECT_PATIENCE;
        flush(client) && !is_silent
    }

    fn serve_commands(&mut self) {
        let Some(client) = &mut self.client else { return };
        let Some(socket) = &client.datagrams else { return };
        let mut datagram = [0; 512];
        loop {
            match socket.recv(&mut datagram) {
                Ok(_) if self.link.loses_command() => self.session.skip_command(),
                Ok(count) => {
                    self.session.receive_datagram(&datagram[..count]);
                    if let Some(sent) = self.sent.take() {
                        self.shared.respond(sent.elapsed());
                    }
                }
                Err(error) if error.kind() == ErrorKind::ConnectionRefused => client.refusals += 1,
                Err(_) => return,
            }
        }
    }

    fn close(&mut self) {
        if let Some(client) = self.client.take() {
            // The other side may have closed it before.
            let _closed = client.stream.shutdown(Shutdown::Write);
        }
        self.link.clear();
        self.session.leave();
        self.is_awaited = false;
    }

    fn cycle(&mut self, began: Instant) {
        for input in self.shared.take_inputs() {
            let panda = &mut self.session.panda;
            match input {
                Input::UserStop(pressed) => panda.set_user_stop(pressed),
                Input::Brakes(open) => panda.set_brakes(open),
                Input::Guiding(pressed) => panda.set_guiding(pressed),
                Input::Push(wrench) => panda.push(wrench),
                Input::Wall(wall) => panda.set_wall(wall),
                Input::Fault(fault) => self.link.inject(fault),
            }
        }
        self.cycles += 1;
        let mut unsent = Vec::new();
        let generation = self.session.panda.settings().generation;
        let mut buffer = [0; STATE_BYTES_MAX];
        let outbox = self.client.as_mut().map_or(&mut unsent, |client| &mut client.outbox);
        let datagram = encode_state(generation, self.session.cycle(outbox), &mut buffer);
        self.shared.log(&mut self.session.log);
        if self.session.is_connected() {
            if let Some(client) = &mut self.client {
                flush(client);
            }
            // Lock step: the network counts in cycles. A count of milliseconds is far below 2^52.
            let now_ms = if self.pace == Pace::Clock { ms_since(began) } else { self.cycles as f64 };
            self.sent = Some(Instant::now());
            self.is_awaited = self.link.send(now_ms, datagram);
            self.deliver(if self.pace == Pace::Clock { now_ms } else { (now_ms + 1.0).next_down() });
        }
        self.publish();
    }

    fn deliver(&mut self, now_ms: f64) {
        let Some(client) = &mut self.client else { return };
        let Some(socket) = &client.datagrams else { return };
        self.link.deliver(now_ms, |datagram| match socket.send(datagram) {
            Err(error) if error.kind() == ErrorKind::ConnectionRefused => client.refusals += 1,
            // A full buffer loses the datagram, as a network does.
            _ => {}
        });
    }

    fn publish(&mut self) {
        let panda = &self.session.panda;
        let ((hand_pose, hand_twist), (q, dq)) = (panda.true_hand(), panda.true_joints());
        self.shared.publish(Snapshot {
            message_id: panda.state().message_id,
            mode: panda.state().robot_mode,
            client: self.client.as_ref().filter(|c| c.datagrams.is_some()).map(|c| c.address),
            hand_pose,
            hand_twist,
            q_rad: *q,
            dq_rad_s: *dq,
            cycles_left_out: self.cycles_left_out,
        });
    }
}

fn ms_since(began: Instant) -> f64 {
    began.elapsed().as_secs_f64() * 1e3
}

fn prepare(stream: &TcpStream) -> io::Result<()> {
    stream.set_nonblocking(true)?;
    stream.set_nodelay(true)
}

/// Opens the socket for states and commands: from the port of the server to the client's. It takes no datagrams of others.
fn open(client: &Client, udp_port: u16) -> io::Result<UdpSocket> {
    let socket = UdpSocket::bind(client.stream.local_addr()?)?;
    socket.connect((client.address.ip(), udp_port))?;
    socket.set_nonblocking(true)?;
    Ok(socket)
}

/// Sends as much as the connection takes. Returns false if the connection is over.
fn flush(client: &mut Client) -> bool {
    while !client.outbox.is_empty() {
        match client.stream.write(&client.outbox) {
            Ok(0) => return false,
            Ok(count) => drop(client.outbox.drain(..count)),
            Err(error) if error.kind() == ErrorKind::WouldBlock => return true,
            Err(error) if error.kind() == ErrorKind::Interrupted => {}
            Err(_) => return false,
        }
    }
    true
}
