//! The device's clocks: the counter since power-on, and the calendar that somebody may set.

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
        let counter_ns = self.counter_ns(t_ns);
        let ns = match self.calendar_ns {
            Some(offset_ns) => counter_ns + offset_ns,
            None => (counter_ns - CALENDAR_AFTER_NS).max(0),
        };
        let ms = ns.div_euclid(1_000_000);
        let mut calendar = calendar_of(ms.div_euclid(1000));
        calendar.microsecond = (ms.rem_euclid(1000) * 1000) as u32;
        calendar
    }
}

/// The proleptic Gregorian date and time of day of seconds since 1970.
fn calendar_of(seconds: i64) -> Calendar {
    let (days, second) = (seconds.div_euclid(86_400), seconds.rem_euclid(86_400));
    // Days since 0000-03-01, so that a leap day is the last of its year; 400 years are 146 097 days.
    let days = days + 719_468;
    let (era, day) = (days.div_euclid(146_097), days.rem_euclid(146_097));
    let year = (day - day / 1460 + day / 36_524 - day / 146_096) / 365;
    let day = day - (365 * year + year / 4 - year / 100);
    let month = (5 * day + 2) / 153;
    let day = day - (153 * month + 2) / 5 + 1;
    let (month, carry) = if month < 10 {
        (month + 3, 0)
    } else {
        (month - 9, 1)
    };
    Calendar {
        year: (era * 400 + year + carry) as u16,
        month: month as u8,
        day: day as u8,
        hour: (second / 3600) as u8,
        minute: (second / 60 % 60) as u8,
        second: (second % 60) as u8,
        microsecond: 0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn known_dates() {
        let date = |seconds| {
            let c = calendar_of(seconds);
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
            let stamp = calendar_of(seconds).stamp().unwrap();
            prop_assert_eq!(stamp.ns(), seconds * 1_000_000_000);
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
