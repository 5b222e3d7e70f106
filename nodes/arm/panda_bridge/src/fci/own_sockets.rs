//! Second handles of this process's sockets. franka-rs keeps its own ones to itself.

use rustix::io::fcntl_dupfd_cloexec;
use std::os::fd::{BorrowedFd, OwnedFd, RawFd};

/// Lowest number of a second handle: above those of standard input, output and error.
const LOWEST: RawFd = 3;

/// Returns second handles of the sockets of this process, one after the other, from the highest number down.
pub fn own_sockets() -> impl Iterator<Item = OwnedFd> {
    let entries = std::fs::read_dir("/proc/self/fd").into_iter().flatten().flatten();
    let mut numbers: Vec<RawFd> = entries
        .filter(|entry| std::fs::read_link(entry.path()).is_ok_and(|to| to.to_string_lossy().starts_with("socket:")))
        .filter_map(|entry| entry.file_name().to_str()?.parse().ok())
        .collect();
    numbers.sort_unstable();
    numbers.into_iter().rev().filter_map(second_handle)
}

/// Returns a second handle of an open file; `None` if it was closed meanwhile.
///
/// `pidfd_getfd` does this without a borrowed number, but containers forbid it.
#[allow(unsafe_code, reason = "a file that another part of the process has open is known by its number alone")]
fn second_handle(number: RawFd) -> Option<OwnedFd> {
    // SAFETY: the number is borrowed for this one call. If its owner closes it before, the call fails, or copies the file that has the
    // number now: a copy changes nothing, and callers look at its address before they use it.
    let borrowed = unsafe { BorrowedFd::borrow_raw(number) };
    fcntl_dupfd_cloexec(borrowed, LOWEST).ok()
}
