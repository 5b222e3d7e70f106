//! Two functions of the C library, replaced in every program that links this crate: the calls in which RustDDS 0.15.1 waits and
//! receives.
//!
//! The linker prefers a definition in the program to the one in the C library, so that the crate `mio` and RustDDS call these.
//!
//! - `epoll_wait` waits again after an interruption. The kernel interrupts the wait when a process that was stopped continues
//!   (Ctrl-Z and `fg`, a debugger, `docker pause`, a suspended machine), even if the process has no signal handler. RustDDS takes
//!   any error of its wait as the end of its event loop.
//! - `recvmsg` passes over RTPS messages that [`super::sample_claims`] refuses, as if the network had lost them. RustDDS would
//!   allocate the memory that they claim.
//!
//! Both do all else that the C library does, for every caller in the process. Nothing here relies on interrupted waits: signals
//! have a thread of their own (`signal-hook`).

#![allow(
    unsafe_code,
    reason = "functions of the C library take pointers and are found by their names; descriptors of RustDDS's sockets are only borrowed"
)]

use super::sample_claims;
use libc::{c_int, c_long, epoll_event, msghdr, ssize_t};
use socket2::{SockFilter, SockRef};
use std::io::{Error, ErrorKind};
use std::os::fd::{BorrowedFd, RawFd};
use std::time::{Duration, Instant};

/// Size of the kernel's set of signals, which is not that of the C library.
const SIGNAL_SET_BYTES: usize = 8;

/// Waits for events as epoll_wait(2), also after an interruption.
///
/// # Safety
/// `events` points to `capacity` events.
#[unsafe(no_mangle)]
unsafe extern "C" fn epoll_wait(
    descriptor: c_int,
    events: *mut epoll_event,
    capacity: c_int,
    timeout_ms: c_int,
) -> c_int {
    // 0 does not wait, and a negative timeout has no end.
    let end = u64::try_from(timeout_ms).ok().map(|ms| Instant::now() + Duration::from_millis(ms));
    let mut left_ms = timeout_ms;
    loop {
        let no_mask = std::ptr::null::<libc::sigset_t>();
        // SAFETY: the caller's arguments, and no mask of signals. epoll_pwait(2) exists on every architecture.
        let ready = unsafe {
            libc::syscall(libc::SYS_epoll_pwait, descriptor, events, capacity, left_ms, no_mask, SIGNAL_SET_BYTES)
        };
        if ready >= 0 || Error::last_os_error().kind() != ErrorKind::Interrupted {
            // The kernel returns at most `capacity`.
            return ready as c_int;
        }
        if let Some(end) = end {
            // Rounded up, so that no wait ends before its time.
            let left = end.saturating_duration_since(Instant::now()).as_micros().div_ceil(1000);
            left_ms = c_int::try_from(left).unwrap_or(c_int::MAX);
        }
    }
}

/// Receives a message as recvmsg(2), and passes over refused RTPS messages.
///
/// # Safety
/// `message` points to a header whose buffers are valid.
#[unsafe(no_mangle)]
unsafe extern "C" fn recvmsg(descriptor: c_int, message: *mut msghdr, flags: c_int) -> ssize_t {
    // SAFETY: the caller's pointer. The kernel overwrites these two lengths, and a second call needs them as they were.
    let lengths = unsafe { message.as_ref() }.map(|header| (header.msg_namelen, header.msg_controllen));
    loop {
        // SAFETY: the caller's arguments.
        let received: c_long = unsafe { libc::syscall(libc::SYS_recvmsg, descriptor, message, flags) };
        // A message that is only looked at is received again later.
        if received <= 0 || flags & libc::MSG_PEEK != 0 {
            return received as ssize_t;
        }
        // SAFETY: the kernel has received into the caller's buffers.
        let is_refused = unsafe { first_bytes(message, received) }.is_some_and(sample_claims::refuses);
        // SAFETY: as above; the call has succeeded, so that the header is there.
        let (Some((name, control)), true) = (lengths, is_refused) else { return received as ssize_t };
        // SAFETY: the caller's header, which nobody else uses during the call.
        if let Some(header) = unsafe { message.as_mut() } {
            (header.msg_namelen, header.msg_controllen) = (name, control);
        }
    }
}

/// Returns the received bytes in the first buffer of a message. RustDDS receives into a single one.
///
/// # Safety
/// The kernel has just received `received` bytes into the buffers of `message`.
unsafe fn first_bytes<'a>(message: *const msghdr, received: c_long) -> Option<&'a [u8]> {
    // SAFETY: by the condition above the header and its buffers are valid.
    let buffer = unsafe { message.as_ref().filter(|header| header.msg_iovlen > 0)?.msg_iov.as_ref()? };
    let length = usize::try_from(received).ok()?.min(buffer.iov_len);
    // SAFETY: the kernel has written the buffer up to this length. With MSG_TRUNC the number received may exceed it.
    (!buffer.iov_base.is_null()).then(|| unsafe { std::slice::from_raw_parts(buffer.iov_base.cast::<u8>(), length) })
}

/// Makes the linker take the functions above: it leaves out parts of a library that nothing refers to.
pub(super) fn link() {
    let wait: unsafe extern "C" fn(c_int, *mut epoll_event, c_int, c_int) -> c_int = epoll_wait;
    let receive: unsafe extern "C" fn(c_int, *mut msghdr, c_int) -> ssize_t = recvmsg;
    std::hint::black_box((wait, receive));
}

/// Returns the local port of a socket on which RustDDS listens; `None` for other descriptors. Its IPv4 UDP sockets are the only ones of a
/// node that ask for the interface of each datagram (`IP_PKTINFO`).
pub(super) fn listening_port(descriptor: RawFd) -> Option<u16> {
    let (mut asks, mut length): (c_int, _) = (0, size_of::<c_int>() as libc::socklen_t);
    // SAFETY: both pointers are to living variables of the lengths that the call expects.
    let failed = unsafe {
        libc::getsockopt(descriptor, libc::IPPROTO_IP, libc::IP_PKTINFO, (&raw mut asks).cast(), &raw mut length)
    };
    let socket = borrow(descriptor).filter(|_| failed == 0 && asks != 0)?;
    let socket = SockRef::from(&socket);
    let is_udp = socket.r#type().is_ok_and(|kind| kind == socket2::Type::DGRAM);
    let address = socket.local_addr().ok().filter(|_| is_udp)?;
    address.as_socket_ipv4().map(|address| address.port())
}

/// Attaches a filter to a socket of this process.
pub(super) fn attach_filter(descriptor: RawFd, filter: &[SockFilter]) -> std::io::Result<()> {
    let socket = borrow(descriptor).ok_or(ErrorKind::InvalidInput)?;
    SockRef::from(&socket).attach_filter(filter)
}

/// Borrows a descriptor for one call.
fn borrow(descriptor: RawFd) -> Option<BorrowedFd<'static>> {
    // SAFETY: not negative. The kernel answers calls on a descriptor that was closed meanwhile with an error; the sockets of a
    // participant stay open as long as it lives.
    (descriptor >= 0).then(|| unsafe { BorrowedFd::borrow_raw(descriptor) })
}
