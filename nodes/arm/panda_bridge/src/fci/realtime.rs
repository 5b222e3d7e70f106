//! Real-time means of the control thread: priority, processor, stack and memory. Each is used as far as the system grants it.

use franka::realtime::{pin_current_thread_to_cpu, set_current_thread_scheduler_priority};
use rustix::mm::{MlockAllFlags, mlockall};
use rustix::process::{Resource, getrlimit};
use rustix::thread::{CapabilitySet, capabilities};
use std::sync::OnceLock;

/// Highest real-time priority of Linux.
const HIGHEST: i32 = 99;
/// Part of its stack that the control thread touches before its first motion, bytes. Its cycle uses less than 64 KiB.
const STACK: usize = 256 * 1024;
/// Size of the smallest page, bytes.
const PAGE: usize = 4096;

/// Way to the right of a real-time priority.
pub const PRIORITY_REMEDY: &str = "put `@realtime - rtprio 99` into /etc/security/limits.conf, add the user to the group realtime, and log \
    in again; in a container: --cap-add=SYS_NICE --ulimit rtprio=99";
/// Way to the right of locking memory.
pub const MEMORY_REMEDY: &str = "put `@realtime - memlock unlimited` into /etc/security/limits.conf, add the user to the group realtime, \
    and log in again; in a container: --cap-add=IPC_LOCK --ulimit memlock=-1";

/// Returns the priority of the supervisor of a control thread with this priority: one step above, so that a control thread that never
/// sleeps cannot keep it from the processor. It wakes ten times a second for some microseconds.
#[must_use]
pub const fn supervisor_priority(control: i32) -> i32 {
    if control < HIGHEST { control + 1 } else { HIGHEST }
}

/// Tries on a thread of its own whether the system grants this real-time priority.
///
/// # Errors
/// The system's reason.
pub fn try_priority(priority: i32) -> Result<(), String> {
    let tried = std::thread::Builder::new().spawn(move || set_priority(priority)).map(std::thread::JoinHandle::join);
    match tried {
        Ok(Ok(granted)) => granted,
        Ok(Err(_)) | Err(_) => Err("no thread could be started".to_owned()),
    }
}

/// Gives the calling thread a real-time priority (SCHED_FIFO).
pub(super) fn set_priority(priority: i32) -> Result<(), String> {
    let plain = |why: String| why.strip_prefix("libfranka: ").unwrap_or(&why).to_owned();
    set_current_thread_scheduler_priority(priority).map_err(plain)
}

/// Returns the reason why this process may not lock its memory; `None` if it may.
///
/// A process with a limit is left alone: once its memory is locked, the system would refuse it any memory beyond the limit.
#[must_use]
pub fn memory_lock_refusal() -> Option<String> {
    let has_right = capabilities(None).is_ok_and(|sets| sets.effective.contains(CapabilitySet::IPC_LOCK));
    let limit = getrlimit(Resource::Memlock).current?;
    (!has_right).then(|| format!("the limit of locked memory is {} KiB", limit / 1024))
}

/// Locks the memory of this process, once: the pages that it has, and later ones when they are first used. Logs the outcome.
///
/// Pages are not filled in advance. That would take memory for the whole stack of each thread and for the allocator's reserve.
pub(super) fn lock_memory() {
    static LOCKED: OnceLock<()> = OnceLock::new();
    LOCKED.get_or_init(|| {
        let lock = || mlockall(MlockAllFlags::CURRENT | MlockAllFlags::FUTURE | MlockAllFlags::ONFAULT);
        match memory_lock_refusal().map_or_else(|| lock().map_err(|error| error.to_string()), Err) {
            Ok(()) => tracing::info!("memory is locked: the control thread does not wait for the disk"),
            Err(why) => {
                tracing::warn!("memory is not locked ({why}), a cycle may wait for the disk: {MEMORY_REMEDY}");
            }
        }
    });
}

/// Prepares the calling thread for cycles: touches its stack, and binds it to a processor if one is given. Logs what was refused.
pub(super) fn prepare_thread(cpu: Option<usize>) {
    touch_stack();
    let Some(cpu) = cpu else { return };
    match pin_current_thread_to_cpu(cpu) {
        Ok(()) => tracing::info!("control thread: bound to processor {cpu}"),
        Err(why) => {
            tracing::warn!("parameter fci.cpu: {why}; `nproc --all` counts the processors from 1, fci.cpu from 0")
        }
    }
}

/// Writes to the pages of the stack below the caller: the system provides a page when it is first used.
#[inline(never)]
fn touch_stack() {
    let mut stack = [0_u8; STACK];
    stack.iter_mut().step_by(PAGE).for_each(|byte| *byte = 1);
    std::hint::black_box(&stack);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_supervisor_stands_above_the_control_thread() {
        assert_eq!([80, 98, 99].map(supervisor_priority), [81, 99, 99]);
    }

    #[test]
    fn a_refused_priority_has_a_reason() {
        // Above the range of Linux: refused whoever asks.
        let why = try_priority(HIGHEST + 1).unwrap_err();
        assert!(why.contains("real-time") || why.contains("realtime"), "{why}");
    }
}
