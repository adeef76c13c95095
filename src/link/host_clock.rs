//! The host's two clocks, read together.

use crate::record::Stamp;
use rustix::time::{ClockId, Timespec, clock_gettime};

/// One instant on both of the host's clocks.
///
/// `CLOCK_REALTIME` is what the world calls the time; it is slewed and stepped. `CLOCK_MONOTONIC_RAW`
/// runs evenly and is what two clocks are compared by. Their difference tells a step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct HostInstant {
    /// `CLOCK_REALTIME`.
    pub utc: Stamp,
    /// `CLOCK_MONOTONIC_RAW`, ns since some instant before the host's start.
    pub raw_ns: i64,
}

impl HostInstant {
    /// Now. The two readings are some tens of nanoseconds apart.
    pub fn now() -> HostInstant {
        let utc_ns = nanoseconds(clock_gettime(ClockId::Realtime));
        HostInstant {
            utc: Stamp::from_ns(utc_ns),
            raw_ns: nanoseconds(clock_gettime(ClockId::MonotonicRaw)),
        }
    }

    /// Real time minus monotonic time, ns: it changes only where real time is slewed or stepped.
    pub fn utc_minus_raw_ns(self) -> i64 {
        self.utc.ns() - self.raw_ns
    }
}

fn nanoseconds(time: Timespec) -> i64 {
    time.tv_sec * 1_000_000_000 + time.tv_nsec
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_clocks_go_on() {
        let then = HostInstant::now();
        std::thread::sleep(std::time::Duration::from_millis(2));
        let now = HostInstant::now();
        assert!(now.raw_ns - then.raw_ns >= 2_000_000);
        assert!(now.utc > then.utc);
        assert!(now.utc.ns() > 1_500_000_000_000_000_000);
    }
}
