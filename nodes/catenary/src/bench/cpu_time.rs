//! CPU time of this process.

use rustix::time::{ClockId, clock_gettime};
use std::time::Duration;

/// CPU time of this process so far, over all threads.
pub fn cpu_time() -> Duration {
    let now = clock_gettime(ClockId::ProcessCPUTime);
    Duration::new(now.tv_sec.unsigned_abs(), u32::try_from(now.tv_nsec).unwrap_or_default())
}
