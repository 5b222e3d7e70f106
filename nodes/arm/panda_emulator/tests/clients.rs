//! Clients that die, are slow or send too much: the arm stops as a real one, and others are served meanwhile.
#![allow(
    clippy::disallowed_methods,
    clippy::unwrap_used,
    clippy::print_stdout,
    dead_code,
    reason = "tests have clocks, threads and sockets; a failure is a panic; the rig is that of the conformance tests"
)]

#[path = "conformance/rig.rs"]
mod rig;

use panda_emulator::fci::{ErrorKind, Errors, MoveStatus, RobotMode};
use panda_emulator::server::{Event, ServerOptions};
use rig::{RawClient, Rig, recover};
use std::io::{Read, Write};
use std::net::Shutdown;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

const STOP: u32 = 2;
const LOAD_MODEL: u32 = 13;

/// Asserts that the arm stopped by reflex, that the next client cannot move it, and that it can after a recovery.
fn assert_stopped(rig: &Rig) {
    rig.wait_for("the end", |events| events.contains(&Event::ClientLeft));
    rig.wait_for("the reflex", |events| events.contains(&Event::Mode(RobotMode::Reflex)));
    assert_eq!(rig.ends(), [MoveStatus::ReflexAborted]);
    assert!(rig.events().contains(&Event::Reflex(Errors::of(ErrorKind::CommunicationConstraintsViolation))));
    let robot = rig.robot();
    assert_eq!(robot.read_once().unwrap().robot_mode, franka::RobotMode::Reflex);
    let torques = || robot.start_torque_control().map(|_| ());
    assert!(matches!(torques(), Err(franka::FrankaError::Command(_))), "a motion before the recovery");
    recover(&robot);
    torques().unwrap();
}

#[test]
fn a_client_that_closes_its_connection_in_a_motion_leaves_a_reflex() {
    let rig = Rig::new();
    drop(RawClient::in_motion(&rig, 50));
    assert_stopped(&rig);
}

#[test]
fn a_client_whose_connection_is_reset_in_a_motion_leaves_a_reflex() {
    let rig = Rig::new();
    let mut client = RawClient::in_motion(&rig, 50);
    // Bytes that the client has not read turn its close into a reset: an answer waits in its socket.
    client.send(STOP + 1, &[0; 4]);
    let mut byte = [0; 1];
    while client.stream.peek(&mut byte).unwrap() == 0 {}
    drop(client);
    assert_stopped(&rig);
}

/// Resident memory of this process, MiB.
fn resident_mib() -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find(|line| line.starts_with("VmRSS")).unwrap();
    line.split_whitespace().nth(1).unwrap().parse::<f64>().unwrap() / 1024.0
}

#[test]
fn a_client_that_reads_no_answer_is_dropped_before_they_fill_the_memory() {
    const LIBRARY_BYTES: usize = 1_150_000;
    let rig = Rig::with(ServerOptions { model_library: Some(vec![7; LIBRARY_BYTES]), ..ServerOptions::default() });
    let before = resident_mib();
    let mut client = RawClient::new(&rig);
    assert_eq!(client.connect(5), (0, 5));
    let request: Vec<u8> = [LOAD_MODEL, 1, 14].iter().flat_map(|n| n.to_le_bytes()).chain([0, 0]).collect();
    // The server may close the connection before all were sent.
    let _sent = client.stream.write_all(&request.repeat(300));
    rig.wait_for("the end", |events| events.contains(&Event::ClientLeft));
    let grown = resident_mib() - before;
    println!("300 unread model requests: {grown:.1} MiB");
    assert!(grown < 40.0, "{grown} MiB");
    let reason =
        rig.events().into_iter().map(|event| event.to_string()).find(|text| text.contains("reads its answers"));
    assert!(reason.is_some(), "{:?}", rig.events());
    rig.robot().read_once().unwrap();
}

#[test]
fn a_connection_without_a_word_keeps_nobody_out() {
    let rig = Rig::new();
    let mute: Vec<_> = (0..40).map(|_| RawClient::new(&rig)).collect();
    // Half a message is no word either.
    let mut halting = RawClient::new(&rig);
    halting.stream.write_all(&[0; 8]).unwrap();
    let mut client = RawClient::new(&rig);
    assert_eq!(client.connect(5), (0, 5));
    client.receive_state();
    assert!(!rig.events().contains(&Event::ClientLeft));
    drop((mute, halting));
    client.receive_state();
}

#[test]
fn a_flood_of_requests_and_datagrams_does_not_stop_the_clock() {
    let rig = Rig::new();
    let mut client = RawClient::new(&rig);
    assert_eq!(client.connect(5), (0, 5));
    client.receive_state();
    let (mut reader, datagrams) = (client.stream.try_clone().unwrap(), client.datagrams.try_clone().unwrap());
    let ended = AtomicBool::new(false);
    let server = rig.server.address();
    std::thread::scope(|scope| {
        scope.spawn(|| while reader.read(&mut [0; 65536]).is_ok_and(|count| count > 0) {});
        scope.spawn(|| {
            while !ended.load(Ordering::Relaxed) {
                let _sent = datagrams.send_to(&[0; 370], server);
            }
        });
        let mut writer = client.stream.try_clone().unwrap();
        scope.spawn(move || {
            let request: Vec<u8> = [STOP, 1, 12].iter().flat_map(|n| n.to_le_bytes()).collect();
            while writer.write_all(&request.repeat(10_000)).is_ok() {}
        });
        let start = rig.handle.snapshot().message_id;
        let began = Instant::now();
        let passed = || rig.handle.snapshot().message_id - start;
        while passed() < 300 && began.elapsed() < Duration::from_secs(20) {
            std::thread::sleep(Duration::from_millis(1));
        }
        let cycles = passed();
        ended.store(true, Ordering::Relaxed);
        let _closed = client.stream.shutdown(Shutdown::Both);
        println!("{cycles} cycles in {:.2} s of a flood", began.elapsed().as_secs_f64());
        assert!(cycles >= 300, "{cycles} cycles");
    });
}
