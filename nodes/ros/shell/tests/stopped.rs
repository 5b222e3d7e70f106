//! Test of a process that is stopped and continues, alone in its process: the stop delays every test beside it.
#![allow(
    clippy::disallowed_methods,
    clippy::unwrap_used,
    reason = "a test reads the clock and starts threads, and a failure is a panic"
)]

use catenary_shell::{Discovery, DomainClaim, NodeBuilder, RosArgs};
use rustdds::mio1::{Events, Poll, Token, Waker};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// Stops this process and lets it continue, `times` times, from another process.
fn stop_and_continue(times: u32) -> Child {
    // A script that is killed lets the process continue, too.
    let script =
        "trap 'kill -CONT $1' EXIT; for i in $(seq $2); do kill -STOP $1; sleep 0.1; kill -CONT $1; sleep 0.1; done";
    let (process, times) = (std::process::id().to_string(), times.to_string());
    let mut command = Command::new("sh");
    command.args(["-c", script, "sh", &process, &times]).stdin(Stdio::null());
    command.spawn().unwrap()
}

#[test]
fn a_wait_for_events_lives_through_stop_and_continue_and_keeps_its_end() {
    // A program with a node has the replaced wait.
    let domain = DomainClaim::any(|_| Ok(true)).unwrap();
    let (args, _) = RosArgs::parse(["--ros-args"]).unwrap();
    let node = NodeBuilder::new("node", &args).unwrap().domain(domain.id(), Discovery::Localhost).build().unwrap();
    let mut poll = Poll::new().unwrap();
    let mut events = Events::with_capacity(1);
    let begun = Instant::now();
    let mut stopping = stop_and_continue(3);
    poll.poll(&mut events, Some(Duration::from_millis(1200))).unwrap();
    assert!(events.is_empty());
    assert!(begun.elapsed() >= Duration::from_millis(1200), "{:?}", begun.elapsed());
    assert!(stopping.wait().unwrap().success());
    // Without a limit, and without a wait.
    poll.poll(&mut events, Some(Duration::ZERO)).unwrap();
    let waker = Waker::new(poll.registry(), Token(1)).unwrap();
    let mut stopping = stop_and_continue(2);
    let waking = std::thread::spawn(move || {
        assert!(stopping.wait().unwrap().success());
        waker.wake().unwrap();
        // Returned: the event of a waker that is dropped may be lost before the wait has seen it.
        waker
    });
    poll.poll(&mut events, None).unwrap();
    assert!(!events.is_empty());
    drop(waking.join().unwrap());
    assert!(!node.is_shutdown());
}
