//! Instants as whole nanoseconds, so that golden files are exact.

use std::fmt;
use std::ops::{Add, Sub};

/// An instant: nanoseconds since the Unix epoch (UTC) on the clock that its column names.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Stamp(i64);

impl Stamp {
    /// The instant `ns` nanoseconds after the epoch.
    pub const fn from_ns(ns: i64) -> Self {
        Stamp(ns)
    }

    /// Nanoseconds since the epoch.
    pub const fn ns(self) -> i64 {
        self.0
    }

    /// This instant moved by `seconds` (rounded to the nanosecond, saturating).
    #[must_use]
    pub fn plus_s(self, seconds: f64) -> Self {
        Stamp(self.0.saturating_add((seconds * 1e9).round() as i64))
    }

    /// Seconds from `earlier` to this instant; exact to the nanosecond for spans below 104 days.
    pub fn since_s(self, earlier: Stamp) -> f64 {
        (self - earlier) as f64 * 1e-9
    }
}

impl Add<i64> for Stamp {
    type Output = Stamp;
    /// Moves the instant by whole nanoseconds (saturating).
    fn add(self, ns: i64) -> Stamp {
        Stamp(self.0.saturating_add(ns))
    }
}

impl Sub for Stamp {
    type Output = i64;
    /// Whole nanoseconds between two instants (saturating).
    fn sub(self, other: Stamp) -> i64 {
        self.0.saturating_sub(other.0)
    }
}

impl fmt::Display for Stamp {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spans_keep_their_sign_at_the_ends_of_time() {
        let (first, last) = (Stamp::from_ns(i64::MIN), Stamp::from_ns(i64::MAX));
        let now = Stamp::from_ns(1_700_000_000_123_456_789);
        assert!(now.since_s(first) > 9.2e9 && first.since_s(now) < -9.2e9);
        assert!(last.since_s(first) > 9.2e9 && (last - first) == i64::MAX);
        assert_eq!(now.plus_s(1.5).since_s(now), 1.5);
        assert_eq!((last + 1, last.plus_s(1.0)), (last, last));
    }
}
