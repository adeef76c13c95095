//! The clock of the benches that measure what one thread computes.

use rustix::time::{ClockId, clock_gettime};

/// The thread's own time, s: what other work the machine has does not count.
pub fn thread_s() -> f64 {
    let now = clock_gettime(ClockId::ThreadCPUTime);
    now.tv_sec as f64 + 1e-9 * now.tv_nsec as f64
}
