//! Thread of a server: sockets and clock around a [`Session`].
#![allow(clippy::disallowed_methods, reason = "a server has a clock, a thread and sockets")]

use super::events::Event;
use super::handle::{Input, Shared, Snapshot};
use super::network::Link;
use super::newcomers::{Caller, Newcomers};
use super::pace::Pace;
use super::session::{Reception, Session};
use crate::wire::{STATE_BYTES_MAX, encode_state};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use std::any::Any;
use std::io::{self, ErrorKind, Read, Write};
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream, UdpSocket};
use std::panic::{AssertUnwindSafe, catch_unwind};
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
/// Datagrams to a closed port after which the client counts as silent. Chosen: half a second, because each second one is reported.
const REFUSALS: u32 = 250;
/// Wait for a client to take a byte of the answers that wait for it. Chosen: long for a busy machine, and nobody else is kept waiting
/// for ever.
const READ_PATIENCE: Duration = Duration::from_secs(10);
/// Bytes of requests, connections and datagrams that are taken before the clock is looked at. Chosen: the requests of that many bytes
/// take a fraction of a cycle.
const REQUEST_BYTES_AT_ONCE: usize = 512;
const CONNECTIONS_AT_ONCE: usize = 16;
const DATAGRAMS_AT_ONCE: usize = 32;
/// Reads that look for the end of a connection behind its last requests. Chosen: more than a client sends in its last moment.
const LAST_READS: usize = 64;
/// Longest sleep, so that the end of the server is noticed.
const LONGEST_SLEEP: Duration = Duration::from_millis(10);

/// Starts the thread. A panic ends it, closes its sockets, and is reported by the handles.
pub(super) fn start(
    session: Session,
    link: Link,
    listener: TcpListener,
    (pace, patience): (Pace, Duration),
    shared: Arc<Shared>,
) -> io::Result<JoinHandle<()>> {
    let observer = Arc::clone(&shared);
    let server = Loop {
        session,
        link,
        listener,
        pace,
        patience,
        shared,
        newcomers: Newcomers::default(),
        client: None,
        cycles: 0,
        cycles_left_out: 0,
        is_awaited: false,
        sent: None,
    };
    std::thread::Builder::new().name("fci_server".to_owned()).spawn(move || {
        // The loop is gone after its panic, so that nothing sees its state half changed.
        if let Err(panic) = catch_unwind(AssertUnwindSafe(|| server.run())) {
            observer.fail(text_of(panic.as_ref()));
        }
    })
}

/// Message of a panic.
fn text_of(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().map(|text| (*text).to_owned());
    text.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_else(|| "panic without a message".to_owned())
}

/// Sockets that have something.
#[derive(Debug, Clone, Copy)]
struct Ready {
    connections: bool,
    requests: bool,
    commands: bool,
}

/// Client that has the session.
struct Client {
    stream: TcpStream,
    address: SocketAddr,
    /// Socket for states and commands.
    datagrams: UdpSocket,
    outbox: Vec<u8>,
    /// Time at which the outbox was empty, or the client took a part of it.
    took: Instant,
    refusals: u32,
}

struct Loop {
    session: Session,
    link: Link,
    listener: TcpListener,
    pace: Pace,
    patience: Duration,
    shared: Arc<Shared>,
    newcomers: Newcomers,
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
            let watches = self.pace == Pace::LockStep && self.waits_for_command();
            let wake = self.next_wake(began, last_cycle, next_cycle);
            let ready = self.wait(wake, if watches { WATCH } else { Duration::ZERO });
            self.serve(ready);
            if self.pace != Pace::LockStep {
                self.deliver(ms_since(began));
            }
            let now = Instant::now();
            if self.waits_for_command() {
                if now < last_cycle + self.patience {
                    continue;
                }
                self.session.give_up_waiting();
            }
            if self.is_stepped() {
                next_cycle = now;
            } else if now < next_cycle {
                continue;
            }
            self.cycle(began);
            last_cycle = now;
            next_cycle = self.after(next_cycle, now);
        }
    }

    /// Returns true if the next state does not leave before the command for the newest one has come.
    fn waits_for_command(&self) -> bool {
        self.pace != Pace::Clock && self.is_awaited && self.session.waits_for_command()
    }

    /// Returns true if commands alone decide when states leave.
    fn is_stepped(&self) -> bool {
        self.pace == Pace::LockStep && self.session.is_stepped()
    }

    /// Time of the cycle after one that was due at `due` and ran at `now`.
    fn after(&mut self, due: Instant, now: Instant) -> Instant {
        let next = due + CYCLE;
        let behind = now.saturating_duration_since(next);
        match self.pace {
            // A cycle that waited for the client is not made up for: 1 kHz is the most.
            Pace::Elastic if behind > Duration::ZERO => now + CYCLE,
            Pace::Clock | Pace::LockStep if behind > CYCLE * CATCH_UP => {
                // The quotient is small and not negative.
                self.cycles_left_out += behind.as_millis() as u64;
                now
            }
            _ => next,
        }
    }

    fn next_wake(&self, began: Instant, last_cycle: Instant, next_cycle: Instant) -> Instant {
        let cycle = if self.waits_for_command() {
            last_cycle + self.patience
        } else if self.is_stepped() {
            began
        } else {
            next_cycle
        };
        match self.link.next_due_ms() {
            // In lock step the network counts in cycles.
            Some(due_ms) if self.pace != Pace::LockStep => {
                cycle.min(began + Duration::from_secs_f64(due_ms.max(0.0) / 1e3))
            }
            _ => cycle,
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
            sockets.push(PollFd::new(&client.datagrams, PollFlags::IN));
        }
        sockets.extend(self.newcomers.streams().map(|stream| PollFd::new(stream, PollFlags::IN)));
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
        let has_client = self.client.is_some();
        Ready { connections: ready(0), requests: has_client && ready(1), commands: has_client && ready(2) }
    }

    /// Serves the sockets that have something, without waiting.
    fn serve(&mut self, ready: Ready) {
        // Each cycle finds out whether the client is silent.
        if (ready.requests || !ready.commands) && !self.serve_requests(1) {
            self.close();
        }
        if ready.commands {
            self.serve_commands();
        }
        if ready.connections {
            self.accept();
        }
        while let Some(caller) = self.newcomers.first_caller() {
            self.connect(caller);
        }
        self.shared.log(&mut self.session.log);
    }

    fn accept(&mut self) {
        for _ in 0..CONNECTIONS_AT_ONCE {
            let Ok((stream, address)) = self.listener.accept() else { return };
            // A client that closed its connection before this one was made has left.
            if !self.serve_requests(LAST_READS) {
                self.close();
            }
            if self.client.is_some() || self.newcomers.add(stream, address).is_err() {
                self.session.log_event(Event::ClientRefused(address));
            }
        }
    }

    /// Gives the session to the first connection that asks for it with the right version.
    fn connect(&mut self, caller: Caller) {
        let Caller { mut stream, address, connect } = caller;
        let mut outbox = Vec::new();
        let Reception::Connected { udp_port } = self.session.receive(&connect, &mut outbox) else {
            // A few bytes: a new connection takes them at once.
            let _written = stream.write(&outbox);
            return;
        };
        match open(&stream, address, udp_port) {
            Ok(datagrams) => {
                self.session.log_event(Event::ClientConnected(address));
                self.client = Some(Client { stream, address, datagrams, outbox, took: Instant::now(), refusals: 0 });
                for address in self.newcomers.dismiss() {
                    self.session.log_event(Event::ClientRefused(address));
                }
                // Handles see the event before the client sees its answer.
                self.shared.log(&mut self.session.log);
                if !self.serve_requests(1) {
                    self.close();
                }
            }
            Err(error) => {
                self.session.log_event(Event::SocketFailed(error.to_string()));
                self.session.leave();
            }
        }
    }

    /// Takes requests with this many reads at most. Returns false if the connection is over.
    fn serve_requests(&mut self, most_reads: usize) -> bool {
        let Some(client) = &mut self.client else { return true };
        let mut bytes = [0; REQUEST_BYTES_AT_ONCE];
        for _ in 0..most_reads {
            match client.stream.read(&mut bytes) {
                Ok(0) => return false,
                Ok(count) => {
                    if self.session.receive(&bytes[..count], &mut client.outbox) == Reception::Close {
                        flush(client);
                        return false;
                    }
                }
                Err(error) if error.kind() == ErrorKind::WouldBlock => break,
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(_) => return false,
            }
        }
        // Handles see an event before the client sees its answer.
        self.shared.log(&mut self.session.log);
        if !flush(client) || client.refusals > REFUSALS {
            return false;
        }
        let takes_none = client.took.elapsed() > READ_PATIENCE;
        if takes_none {
            self.session.log_event(Event::ClientTooSlow { bytes: client.outbox.len() });
        }
        !takes_none
    }

    fn serve_commands(&mut self) {
        let Some(client) = &mut self.client else { return };
        let mut datagram = [0; 512];
        for _ in 0..DATAGRAMS_AT_ONCE {
            match client.datagrams.recv(&mut datagram) {
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
                Input::Crash => panic!("Handle::crash asked for this panic"),
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
            let counts_cycles = self.pace == Pace::LockStep;
            let now_ms = if counts_cycles { self.cycles as f64 } else { ms_since(began) };
            self.sent = Some(Instant::now());
            self.is_awaited = self.link.send(now_ms, datagram);
            self.deliver(if counts_cycles { (now_ms + 1.0).next_down() } else { now_ms });
        }
        self.publish();
    }

    fn deliver(&mut self, now_ms: f64) {
        let Some(client) = &mut self.client else { return };
        self.link.deliver(now_ms, |datagram| match client.datagrams.send(datagram) {
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
            client: self.client.as_ref().map(|client| client.address),
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

/// Opens the socket for states and commands: from the port of the server to the client's. It takes no datagrams of others.
fn open(stream: &TcpStream, client: SocketAddr, udp_port: u16) -> io::Result<UdpSocket> {
    let socket = UdpSocket::bind(stream.local_addr()?)?;
    socket.connect((client.ip(), udp_port))?;
    socket.set_nonblocking(true)?;
    Ok(socket)
}

/// Sends as much as the connection takes. Returns false if the connection is over.
fn flush(client: &mut Client) -> bool {
    while !client.outbox.is_empty() {
        match client.stream.write(&client.outbox) {
            Ok(0) => return false,
            Ok(count) => {
                client.outbox.drain(..count);
                client.took = Instant::now();
            }
            Err(error) if error.kind() == ErrorKind::WouldBlock => return true,
            Err(error) if error.kind() == ErrorKind::Interrupted => {}
            Err(_) => return false,
        }
    }
    client.took = Instant::now();
    true
}
