//! Tests of the supervisor on real processes.

use super::supervisor::{NodeEvent, Supervisor};
use super::table::{Exit, State};
use crate::launch::description::{Grace, Parameters, Process, Restart};
use rustix::process::{Pid, Signal, kill_process};
use std::time::{Duration, Instant};

fn process(name: &str, command: &[&str], respawn: bool) -> Process {
    let mut process = Process::new(name.into(), command.iter().map(|c| (*c).to_owned()).collect());
    process.restart = Restart { respawn, delay: Duration::from_millis(10), limit: None };
    process
}

fn start(processes: Vec<Process>) -> (Supervisor, tempfile::TempDir) {
    let logs = tempfile::tempdir().unwrap();
    (Supervisor::start(processes, logs.path(), false).unwrap(), logs)
}

fn wait_for_event(s: &mut Supervisor) -> NodeEvent {
    let deadline = Instant::now() + Duration::from_secs(10);
    loop {
        if let Some(event) = s.poll().unwrap().into_iter().next() {
            return event;
        }
        assert!(Instant::now() < deadline, "nothing happened");
        std::thread::sleep(Duration::from_millis(5));
    }
}

#[test]
fn a_failing_process_is_reported_with_its_last_line() {
    let (mut s, _logs) = start(vec![process("a", &["sh", "-c", "echo no luck >&2; exit 3"], false)]);
    let event = wait_for_event(&mut s);
    assert!(!event.success && !event.restarting);
    assert!(event.describe().contains("exit code 3: no luck"), "{}", event.describe());
    assert!(s.is_done());
    let row = &s.rows()[0];
    assert_eq!((row.state, row.last_exit, row.pid), (State::Failed, Some(Exit::Code(3)), None));
}

#[test]
fn the_log_of_an_earlier_launch_is_not_reported() {
    let logs = tempfile::tempdir().unwrap();
    for (script, said) in [("echo no luck >&2; exit 3", ": no luck"), ("exit 3", "exit code 3 (")] {
        let mut s = Supervisor::start(vec![process("a", &["sh", "-c", script], false)], logs.path(), false).unwrap();
        let words = wait_for_event(&mut s).describe();
        assert!(words.contains(said), "{words}");
    }
}

#[test]
fn a_process_that_refuses_its_arguments_is_not_restarted() {
    let (mut s, _logs) = start(vec![process("a", &["sh", "-c", "exit 2"], true)]);
    let event = wait_for_event(&mut s);
    assert!(!event.success && !event.restarting && s.is_done());
    assert!(event.describe().contains("not restarted: it refuses its arguments"), "{}", event.describe());
}

#[test]
fn a_process_that_keeps_ending_is_restarted_up_to_its_limit() {
    let mut looping = process("a", &["sh", "-c", "exit 1"], true);
    looping.restart.limit = Some(2);
    let (mut s, _logs) = start(vec![looping]);
    let events = [(); 3].map(|()| wait_for_event(&mut s));
    assert_eq!(events.each_ref().map(|e| e.restarting), [true, true, false]);
    assert!(events[2].describe().contains("restarted 2 times, which is its limit"), "{}", events[2].describe());
    let row = &s.rows()[0];
    assert!(s.is_done() && row.restarts == 2 && row.restart_limit == Some(2) && row.state == State::Failed);
}

#[test]
fn a_killed_process_is_restarted_on_request_and_all_end_on_shutdown() {
    // A test run in the background may ignore SIGINT, and processes inherit that.
    let sleep = ["env", "--default-signal=INT", "sleep", "60"];
    let (mut s, _logs) = start(vec![process("a", &sleep, true), process("b", &sleep, false)]);
    let pid = s.rows()[0].pid.unwrap();
    kill_process(Pid::from_raw(pid.cast_signed()).unwrap(), Signal::KILL).unwrap();
    let event = wait_for_event(&mut s);
    assert!(event.restarting && event.how.contains("signal 9"), "{event:?}");
    assert_eq!(s.rows()[0].state, State::Waiting);
    // Longer than the delay of 10 ms before a restart.
    std::thread::sleep(Duration::from_millis(50));
    s.poll().unwrap();
    let row = &s.rows()[0];
    assert!(row.restarts == 1 && row.pid.is_some_and(|again| again != pid) && row.state == State::Running);
    assert_eq!(row.last_exit, Some(Exit::Signal(9)));
    // Until it is called `sleep`, the process is still `env`, which resets the inherited signals.
    let comm = format!("/proc/{}/comm", row.pid.unwrap());
    while std::fs::read_to_string(&comm).unwrap().trim() != "sleep" {
        std::thread::sleep(Duration::from_millis(5));
    }
    s.shut_down();
    assert!(s.is_done());
    for row in s.rows() {
        assert_eq!((row.state, row.last_exit, row.pid), (State::Stopped, Some(Exit::Signal(2)), None));
    }
}

#[test]
fn shutdown_goes_from_sigint_to_sigterm_to_sigkill() {
    // Short limits keep the test fast; the shell needs a few milliseconds to react.
    let grace = Grace { interrupted: Duration::from_millis(150), terminated: Duration::from_millis(150) };
    let deaf_to = |name: &str, signals: &str| {
        let script = format!("trap '' {signals}; echo ready; while :; do sleep 0.01; done");
        Process { grace, ..process(name, &["sh", "-c", &script], false) }
    };
    let (mut s, logs) = start(vec![deaf_to("a", "INT"), deaf_to("b", "INT TERM")]);
    let is_ready = |name: &str| std::fs::read_to_string(logs.path().join(name)).unwrap().contains("ready");
    while !(is_ready("a.log") && is_ready("b.log")) {
        std::thread::sleep(Duration::from_millis(5));
    }
    let begun = Instant::now();
    s.shut_down();
    let exits: Vec<_> = s.rows().iter().map(|row| row.last_exit).collect();
    assert_eq!(exits, [Some(Exit::Signal(15)), Some(Exit::Signal(9))]);
    assert!(begun.elapsed() >= grace.interrupted + grace.terminated, "{:?}", begun.elapsed());
}

#[test]
fn children_of_a_process_end_with_it() {
    let (mut s, logs) = start(vec![process("a", &["sh", "-c", "sleep 60 & echo $!; exit 0"], false)]);
    assert!(wait_for_event(&mut s).success);
    let child: i32 = std::fs::read_to_string(logs.path().join("a.log")).unwrap().trim().parse().unwrap();
    let state = || std::fs::read_to_string(format!("/proc/{child}/stat")).unwrap_or_default();
    let is_over = || state().is_empty() || state().contains(") Z ");
    let deadline = Instant::now() + Duration::from_secs(2);
    while !is_over() && Instant::now() < deadline {
        std::thread::sleep(Duration::from_millis(5));
    }
    assert!(is_over(), "it lives: {}", state());
}

#[test]
fn parameter_files_are_written_beside_the_log_and_named_to_the_process() {
    let mut node = process("a", &["cat", "(parameters)"], false);
    node.parameters = vec![Parameters { word: 1, yaml: "\"/**\": {}\n".into() }];
    let (mut s, logs) = start(vec![node]);
    assert!(wait_for_event(&mut s).success);
    assert_eq!(std::fs::read_to_string(logs.path().join("a.log")).unwrap(), "\"/**\": {}\n");
}

#[test]
fn a_program_that_does_not_exist_is_an_error() {
    let logs = tempfile::tempdir().unwrap();
    let e = Supervisor::start(vec![process("ghost", &["/no/such/program"], false)], logs.path(), false).err().unwrap();
    assert!(format!("{e:#}").contains("ghost"), "{e:#}");
}
