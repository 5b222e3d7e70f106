//! Real-time means of the threads of a connection. A failure here means a control loop that waits for other work, or for the disk.
#![allow(
    clippy::disallowed_methods,
    clippy::unwrap_used,
    reason = "a test of threads and sockets waits for them, and a failure is a panic"
)]

use panda_bridge::fci::realtime::{memory_lock_refusal, supervisor_priority, try_priority};
use panda_bridge::fci::{FciLink, FciSettings, Generation};
use panda_emulator::server::{Pace, Server, ServerOptions};
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Policies of the kernel, as in /proc: SCHED_OTHER and SCHED_FIFO.
const OTHER: &str = "0";
const FIFO: &str = "1";
/// Columns of /proc/PID/stat after the name in brackets, from 0.
const RT_PRIORITY: usize = 37;
const POLICY: usize = 38;

/// Runs one test at a time: threads are found by their names. Calls `look` when the link to an emulated arm is ready.
fn with_link(change: impl FnOnce(&mut FciSettings), look: impl FnOnce()) {
    static ONE: Mutex<()> = Mutex::new(());
    let _one = ONE.lock().unwrap_or_else(PoisonError::into_inner);
    let address = SocketAddr::from(([127, 64, (std::process::id() % 250 + 1) as u8, 1], 1337));
    let server = Server::bind(address, ServerOptions { pace: Pace::LockStep, ..ServerOptions::default() }).unwrap();
    let mut settings = FciSettings::new(&address.ip().to_string(), Generation::Panda);
    change(&mut settings);
    let link = FciLink::start(settings, || panic!("the connection cannot be ended")).unwrap();
    let start = Instant::now();
    while link.unready().is_some() {
        assert!(start.elapsed() < Duration::from_secs(30), "{:?}", link.unready());
        std::thread::sleep(Duration::from_millis(1));
    }
    look();
    drop(link);
    drop(server);
}

/// Returns the folder in /proc of the thread with this name.
fn thread(name: &str) -> PathBuf {
    let tasks = std::fs::read_dir("/proc/self/task").unwrap().flatten().map(|task| task.path());
    let has_name = |task: &PathBuf| std::fs::read_to_string(task.join("comm")).is_ok_and(|comm| comm.trim() == name);
    tasks.into_iter().find(has_name).unwrap_or_else(|| panic!("no thread {name}"))
}

/// Returns policy and real-time priority of the thread with this name.
fn schedule(name: &str) -> (String, i32) {
    let stat = std::fs::read_to_string(thread(name).join("stat")).unwrap();
    let columns: Vec<&str> = stat.rsplit_once(") ").unwrap().1.split_whitespace().collect();
    (columns[POLICY].to_owned(), columns[RT_PRIORITY].parse().unwrap())
}

/// Returns the value of a line of a file like /proc/self/status.
fn status(path: &str, name: &str) -> String {
    let text = std::fs::read_to_string(path).unwrap();
    let line = text.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(':')).unwrap();
    line.trim().to_owned()
}

/// Returns the processors of a thread, such as `0-3`.
fn processors(name: &str) -> String {
    status(thread(name).join("status").to_str().unwrap(), "Cpus_allowed_list")
}

#[test]
fn the_supervisor_stands_above_the_control_thread_and_the_rest_below() {
    let priority = 10;
    let granted = try_priority(supervisor_priority(priority)).is_ok();
    with_link(
        |settings| settings.priority = priority,
        || {
            let wanted = |priority| if granted { (FIFO.to_owned(), priority) } else { (OTHER.to_owned(), 0) };
            assert_eq!(schedule("fci control"), wanted(priority));
            // The thread sets its own priority, and may not have run yet.
            let start = Instant::now();
            while schedule("fci watchdog") != wanted(priority + 1) && start.elapsed() < Duration::from_secs(30) {
                std::thread::sleep(Duration::from_millis(10));
            }
            assert_eq!(schedule("fci watchdog"), wanted(priority + 1));
            assert_eq!(
                schedule("fci session"),
                (OTHER.to_owned(), 0),
                "it waits for answers, and none of them is urgent"
            );
        },
    );
}

#[test]
fn the_control_thread_alone_is_bound_to_its_processor() {
    let all = status("/proc/self/status", "Cpus_allowed_list");
    let first = all.split([',', '-']).next().unwrap().to_owned();
    let cpu = first.parse().unwrap();
    with_link(
        |settings| (settings.priority, settings.cpu) = (1, Some(cpu)),
        || {
            assert_eq!(processors("fci control"), first);
            assert_eq!(processors("fci watchdog"), all);
        },
    );
}

#[test]
fn a_processor_that_is_not_there_does_not_keep_the_arm_from_its_states() {
    let all = status("/proc/self/status", "Cpus_allowed_list");
    with_link(
        |settings| (settings.priority, settings.cpu) = (1, Some(1023)),
        || assert_eq!(processors("fci control"), all),
    );
}

#[test]
fn memory_is_locked_where_the_system_lets_a_process_lock_all() {
    with_link(
        |settings| settings.priority = 1,
        || {
            let locked: u64 = status("/proc/self/status", "VmLck").split(' ').next().unwrap().parse().unwrap();
            assert_eq!(locked > 0, memory_lock_refusal().is_none(), "{locked} KiB: {:?}", memory_lock_refusal());
        },
    );
}
