//! The elastic pace, and the end of a server's thread.
#![allow(
    clippy::disallowed_methods,
    clippy::unwrap_used,
    clippy::print_stdout,
    dead_code,
    reason = "tests have clocks, threads and sockets; a failure is a panic; the rig is that of the conformance tests"
)]

#[path = "conformance/rig.rs"]
mod rig;

use panda_emulator::fci::{ErrorKind, Errors, MoveStatus};
use panda_emulator::server::{Event, Pace, Server, ServerOptions};
use rig::{RawClient, Rig};
use std::time::{Duration, Instant};

fn elastic(patience: Duration) -> Rig {
    Rig::at(Pace::Elastic, ServerOptions { patience, ..ServerOptions::default() })
}

#[test]
fn elastic_waits_for_late_commands_and_its_clock_shows_no_gap() {
    // Far above what a busy machine delays a client.
    let rig = elastic(Duration::from_secs(10));
    let client = RawClient::in_motion(&rig, 50);
    let mut last = client.answer();
    for k in 0..60 {
        // Three times as late as 20 lost commands.
        let late = Duration::from_millis(if k % 20 == 0 { 60 } else { 0 });
        std::thread::sleep(late);
        let id = client.answer();
        assert_eq!(id, last + 1, "no state without its command");
        last = id;
    }
    assert_eq!(rig.ends(), []);
}

#[test]
fn elastic_passes_1_khz_neither_in_a_motion_nor_after_a_wait() {
    let rig = elastic(Duration::from_secs(10));
    let client = RawClient::in_motion(&rig, 10);
    let (began, first) = (Instant::now(), client.answer());
    std::thread::sleep(Duration::from_millis(100));
    let mut last = first;
    for _ in 0..300 {
        last = client.answer();
    }
    // The last state left at most when this clock is read. One state may be due when it begins, and one may have left late.
    let states = u32::try_from(last - first).unwrap();
    assert!(began.elapsed() >= Duration::from_millis(100 + 298), "{states} states in {:?}", began.elapsed());
}

#[test]
fn elastic_notices_a_client_that_has_gone_without_a_word() {
    let rig = elastic(Duration::from_millis(50));
    let client = RawClient::in_motion(&rig, 50);
    rig.wait_for("the end", |events| events.iter().any(|event| matches!(event, Event::MotionEnded(_))));
    assert_eq!(rig.ends(), [MoveStatus::ReflexAborted]);
    let reason = Event::Reflex(Errors::of(ErrorKind::CommunicationConstraintsViolation));
    rig.wait_for("the reflex", |events| events.contains(&reason));
    drop(client);
}

#[test]
fn elastic_without_a_motion_sends_states_that_nobody_answers() {
    let rig = elastic(Duration::from_secs(10));
    let mut client = RawClient::new(&rig);
    assert_eq!(client.connect(5), (0, 5));
    let ids: Vec<u64> = (0..100).map(|_| client.receive_state().0).collect();
    assert!(ids.windows(2).all(|pair| pair[1] == pair[0] + 1), "{ids:?}");
}

#[test]
fn thread_that_panics_is_told_by_the_handle_and_frees_the_address() {
    let rig = Rig::new();
    let mut client = RawClient::new(&rig);
    assert_eq!(client.connect(5), (0, 5));
    assert_eq!(rig.handle.failure(), None);
    rig.handle.crash();
    let began = Instant::now();
    let failure = loop {
        if let Some(failure) = rig.handle.failure() {
            break failure;
        }
        assert!(began.elapsed() < Duration::from_secs(20), "no failure is told");
        std::thread::sleep(Duration::from_millis(1));
    };
    assert!(failure.contains("Handle::crash"), "{failure}");
    assert!(client.is_closed());
    let again = Server::bind(rig.server.address(), ServerOptions::default()).unwrap();
    assert_eq!(again.handle().failure(), None);
}
