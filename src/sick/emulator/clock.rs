//! The device's clocks: the counter since power-on, and the calendar that somebody may set.

use crate::record::Stamp;
use crate::sick::scandata::Calendar;

/// An unset calendar begins so long after the counter, ns (recorded units: 0.2 s to 3.4 s).
const CALENDAR_AFTER_NS: i64 = 300_000_000;

/// Both clocks run at the same rate, which is not quite the true one.
#[derive(Clone, Copy, Debug)]
pub struct DeviceClock {
    /// The rate's error, ppm.
    ppm: f64,
    /// True time of power-on, ns.
    power_on_ns: i64,
    /// What the counter shows at power-on, ns: after it only for tests of its wrap.
    uptime_ns: i64,
    /// Calendar minus counter, ns since 1970; none while nobody has set it.
    calendar_ns: Option<i64>,
}

impl DeviceClock {
    /// Power-on at true time 0, the counter at `uptime_ns`.
    pub fn new(ppm: f64, uptime_ns: i64) -> DeviceClock {
        DeviceClock {
            ppm,
            power_on_ns: 0,
            uptime_ns,
            calendar_ns: None,
        }
    }

    /// Power was off: counter and calendar begin anew.
    pub fn restart(&mut self, now_ns: i64) {
        *self = DeviceClock {
            power_on_ns: now_ns,
            ..DeviceClock::new(self.ppm, 0)
        };
    }

    /// The counter at a true time, ns.
    pub fn counter_ns(&self, t_ns: i64) -> i64 {
        let since = t_ns - self.power_on_ns;
        self.uptime_ns + since + (since as f64 * self.ppm * 1e-6).round() as i64
    }

    /// The counter as a telegram has it: microseconds that wrap after 71.6 min.
    pub fn tick_us(&self, t_ns: i64) -> u32 {
        self.counter_ns(t_ns).div_euclid(1000) as u32
    }

    /// Sets the calendar at a true time to nanoseconds since 1970.
    pub fn set(&mut self, t_ns: i64, calendar_ns: i64) {
        self.calendar_ns = Some(calendar_ns - self.counter_ns(t_ns));
    }

    /// The calendar at a true time. It counts whole milliseconds.
    pub fn calendar(&self, t_ns: i64) -> Calendar {
        self.calendar_at(self.counter_ns(t_ns))
    }

    /// The calendar as it was, or would have been, when the counter began.
    pub fn calendar_at_power_on(&self) -> Calendar {
        self.calendar_at(0)
    }

    fn calendar_at(&self, counter_ns: i64) -> Calendar {
        let ns = match self.calendar_ns {
            Some(offset_ns) => counter_ns + offset_ns,
            None => (counter_ns - CALENDAR_AFTER_NS).max(0),
        };
        let ms = ns.div_euclid(1_000_000);
        Calendar::at(Stamp::from_ns(ms * 1_000_000)).unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn known_dates() {
        let date = |seconds: i64| {
            let c = Calendar::at(Stamp::from_ns(seconds * 1_000_000_000)).unwrap();
            (c.year, c.month, c.day, c.hour, c.minute, c.second)
        };
        // From `date -u -d @N`.
        assert_eq!(date(0), (1970, 1, 1, 0, 0, 0));
        assert_eq!(date(951_782_399), (2000, 2, 28, 23, 59, 59));
        assert_eq!(date(951_868_799), (2000, 2, 29, 23, 59, 59));
        assert_eq!(date(951_868_800), (2000, 3, 1, 0, 0, 0));
        assert_eq!(date(1_767_225_599), (2025, 12, 31, 23, 59, 59));
        assert_eq!(date(4_107_542_400), (2100, 3, 1, 0, 0, 0));
    }

    proptest! {
        /// The way back is the decoder's own, written independently.
        #[test]
        fn dates_lead_back(seconds in 0i64..9_000_000_000) {
            let stamp = Stamp::from_ns(seconds * 1_000_000_000 + 123_456_000);
            prop_assert_eq!(Calendar::at(stamp).unwrap().stamp(), Some(stamp));
        }
    }

    #[test]
    fn counters_drift_and_wrap_and_the_calendar_is_set() {
        let mut clock = DeviceClock::new(100.0, 4_294_967_000_000);
        assert_eq!(clock.tick_us(0), 4_294_967_000);
        // 296 us later the counter wraps.
        assert_eq!(clock.tick_us(295_000), 4_294_967_295);
        assert_eq!(clock.tick_us(296_500), 0);
        assert_eq!(
            clock.counter_ns(1_000_000_000) - clock.counter_ns(0),
            1_000_100_000
        );
        clock.set(0, 1_767_225_600_123_456_789);
        let calendar = clock.calendar(0);
        assert_eq!((calendar.year, calendar.microsecond), (2026, 123_000));
        clock.restart(5_000_000_000);
        assert_eq!(clock.tick_us(5_000_000_000), 0);
        let calendar = clock.calendar(5_000_000_000);
        assert_eq!((calendar.year, calendar.second), (1970, 0));
        // 100 ppm of 1.8 s are 0.18 ms.
        assert_eq!(clock.calendar(6_800_000_000).microsecond, 500_000);
        assert!(!calendar.is_set());
    }
}
