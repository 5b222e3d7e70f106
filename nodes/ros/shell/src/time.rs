//! Time: points in time, stamps, clocks, watchdogs, and waits that end at shutdown.

pub(crate) mod clock;
pub(crate) mod point;
pub(crate) mod shutdown;
pub mod stamp;
pub(crate) mod wait;
pub(crate) mod watchdog;
