//! The host's two clocks, read together.

use super::system::{monotonic_ns, utc_ns};
use crate::record::Stamp;

/// How many times the clocks are read at most for one instant.
const ATTEMPTS: u32 = 4;
/// Within what time, ns, all readings of one instant should be made.
const CLOSE_NS: i64 = 1000;

/// One instant on both of the host's clocks.
///
/// `CLOCK_REALTIME` is what the world calls the time; it is slewed and stepped. `CLOCK_MONOTONIC_RAW`
/// runs evenly and is what two clocks are compared by. Their difference tells a step. Other systems
/// than Unix have their own two clocks in their place.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct HostInstant {
    /// `CLOCK_REALTIME`.
    pub utc: Stamp,
    /// `CLOCK_MONOTONIC_RAW`, ns since some instant before the host's start.
    pub raw_ns: i64,
}

impl HostInstant {
    /// Now. The two readings are some tens of nanoseconds apart: real time is read between two
    /// readings of the other clock, again where something came in between.
    pub fn now() -> HostInstant {
        let mut best = HostInstant::read();
        for _ in 1..ATTEMPTS {
            if best.1 <= CLOSE_NS {
                break;
            }
            let again = HostInstant::read();
            if again.1 < best.1 {
                best = again;
            }
        }
        best.0
    }

    /// An instant of which only one time is known, as from a table of arrivals.
    pub fn from_one_clock(ns: i64) -> HostInstant {
        HostInstant {
            utc: Stamp::from_ns(ns),
            raw_ns: ns,
        }
    }

    /// Reads both clocks; with how long it took, ns.
    fn read() -> (HostInstant, i64) {
        let before_ns = monotonic_ns();
        let utc_ns = utc_ns();
        let after_ns = monotonic_ns();
        let instant = HostInstant {
            utc: Stamp::from_ns(utc_ns),
            raw_ns: before_ns + (after_ns - before_ns) / 2,
        };
        (instant, after_ns - before_ns)
    }

    /// Real time minus monotonic time, ns: it changes only where real time is slewed or stepped.
    pub fn utc_minus_raw_ns(self) -> i64 {
        self.utc.ns() - self.raw_ns
    }
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
