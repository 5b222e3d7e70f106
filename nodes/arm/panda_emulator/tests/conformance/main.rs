//! Conformance with franka-rs, a client that was written independently: the checks of `tests/conformance_fci`.
//!
//! A test's name begins with the number of its check. Each prints its row; `--nocapture` shows it. All motions run in lock step, so
//! that the load of the machine changes no result.
#![allow(
    clippy::disallowed_methods,
    clippy::unwrap_used,
    clippy::print_stdout,
    dead_code,
    reason = "tests have clocks, threads, sockets and rows; a failure is a panic; other tests have this rig, too"
)]

mod contact;
mod losses;
mod motions;
mod rig;
mod session;
mod stops;
