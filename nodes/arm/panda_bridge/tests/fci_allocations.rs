//! The control thread allocates nothing while a motion runs: an allocation can wait for another thread's lock.
#![allow(
    clippy::disallowed_methods,
    clippy::unwrap_used,
    unsafe_code,
    reason = "the test waits for threads, and its allocator is unsafe by its trait"
)]

use panda_bridge::fci::{FciLink, FciSettings, Generation};
use panda_emulator::server::{Pace, Server, ServerOptions};
use std::alloc::{GlobalAlloc, Layout, System};
use std::net::SocketAddr;
use std::sync::atomic::{AtomicI32, AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// Number of the thread whose allocations are counted.
static WATCHED: AtomicI32 = AtomicI32::new(0);
static COUNT: AtomicU64 = AtomicU64::new(0);

struct Counting;

// SAFETY: every call goes to the system's allocator with the arguments of the caller.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count();
        // SAFETY: as above.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        count();
        // SAFETY: as above.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

fn count() {
    let watched = WATCHED.load(Ordering::Relaxed);
    if watched != 0 && rustix::thread::gettid().as_raw_nonzero().get() == watched {
        COUNT.fetch_add(1, Ordering::Relaxed);
    }
}

/// Returns the number of the thread with this name.
fn thread_number(name: &str) -> i32 {
    let tasks = std::fs::read_dir("/proc/self/task").unwrap();
    let named = |task: &std::fs::DirEntry| {
        std::fs::read_to_string(task.path().join("comm")).is_ok_and(|comm| comm.trim() == name)
    };
    let task = tasks.flatten().find(named).unwrap_or_else(|| panic!("no thread {name}"));
    task.file_name().to_str().unwrap().parse().unwrap()
}

#[test]
fn a_thousand_cycles_allocate_nothing() {
    let address = SocketAddr::from(([127, 62, (std::process::id() % 250 + 1) as u8, 1], 1337));
    let server = Server::bind(address, ServerOptions { pace: Pace::LockStep, ..ServerOptions::default() }).unwrap();
    let settings = FciSettings { priority: 1, ..FciSettings::new(&address.ip().to_string(), Generation::Panda) };
    let link = FciLink::start(settings, || panic!("the connection cannot be ended")).unwrap();
    let start = Instant::now();
    let wait_for = |what: &str, holds: &dyn Fn() -> bool| {
        while !holds() {
            assert!(start.elapsed() < Duration::from_secs(30), "{what}: {:?}", link.unready());
            link.follow(link.unready().is_none());
            std::thread::sleep(Duration::from_millis(1));
        }
    };
    wait_for("a running motion", &|| link.figures().computing.count() > 100);
    WATCHED.store(rustix::thread::gettid().as_raw_nonzero().get(), Ordering::Relaxed);
    drop(std::hint::black_box(Box::new(1)));
    assert!(COUNT.load(Ordering::Relaxed) >= 2, "the allocator counts");
    WATCHED.store(thread_number("fci control"), Ordering::Relaxed);
    let (cycles, from) = (link.figures().computing.count(), COUNT.load(Ordering::Relaxed));
    wait_for("a thousand cycles", &|| link.figures().computing.count() > cycles + 1000);
    assert_eq!(COUNT.load(Ordering::Relaxed) - from, 0, "allocations and releases of the control thread");
    WATCHED.store(0, Ordering::Relaxed);
    drop(server);
}
