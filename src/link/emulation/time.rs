//! How time goes in an emulation.

use crate::link::HostInstant;
use std::time::Duration;

/// How time goes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Time {
    pub(super) start: HostInstant,
    /// Seconds a second; none: as fast as can be.
    speed: Option<f64>,
    /// Time passed over, ns.
    skipped_ns: i64,
}

impl Time {
    /// Time begins now.
    pub(super) fn new(speed: Option<f64>) -> Time {
        Time {
            start: HostInstant::now(),
            speed,
            skipped_ns: 0,
        }
    }

    /// Whether it goes as fast as can be.
    pub(super) fn is_free(&self) -> bool {
        self.speed.is_none()
    }

    /// Now, ns after the start.
    pub(super) fn now_ns(&self) -> i64 {
        // True time runs evenly: no time server slews this clock.
        let elapsed_ns = HostInstant::now().raw_ns - self.start.raw_ns;
        match self.speed {
            Some(1.0) => elapsed_ns,
            Some(speed) => (elapsed_ns as f64 * speed) as i64,
            None => elapsed_ns + self.skipped_ns,
        }
    }

    /// The host's time until an instant.
    pub(super) fn until(&self, t_ns: i64) -> Duration {
        let left_ns = t_ns.saturating_sub(self.now_ns()).max(0) as f64;
        Duration::from_secs_f64(left_ns * 1e-9 / self.speed.unwrap_or(1.0))
    }

    /// Goes to a later instant at once, where time is free.
    pub(super) fn pass_over_to(&mut self, t_ns: i64) {
        if self.speed.is_none() {
            self.skipped_ns += t_ns.saturating_sub(self.now_ns()).max(0);
        }
    }
}

/// The longest span of an emulation, ns: 97 years.
const LONGEST_NS: i64 = i64::MAX / 3;

/// A span in nanoseconds. One that is longer than 97 years is cut to them, so that it may be added to
/// any time of an emulation.
pub fn nanoseconds(span: Duration) -> i64 {
    let ns = i64::try_from(span.as_nanos()).unwrap_or(i64::MAX);
    ns.min(LONGEST_NS)
}
