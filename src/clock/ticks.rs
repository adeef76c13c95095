//! A 32 bit microsecond counter that wraps every 71.58 min, unwrapped to 64 bit.

/// One lap of the counter, us.
pub(super) const LAP_US: i64 = 1 << 32;
/// How far a telegram may lag behind one that overtook it, us. Further back is a new start.
const LATE_US: i64 = 10_000_000;
/// How much more time than the host saw may have passed on the device, us: telegrams that a stalled
/// link delivers in a burst arrive closer together than they were made.
const BURST_US: i64 = 60_000_000;
/// How much less time than the host saw may have passed on the device when a new connection brings
/// its first tick, us: that one may have waited on its way. No scanner restarts within this time.
const BEHIND_US: i64 = 3_000_000;
/// By how much a device's clock may be slow, as a fraction of the time that passed: one in this
/// many.
const SLOW: i64 = 5000;

/// A tick, unwrapped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tick {
    /// The newest so far (or the same again).
    Forward(i64),
    /// Older than the newest: it was overtaken.
    Late(i64),
    /// The counter began anew: the device restarted. The count goes on from the tick as it is.
    Restart(i64),
}

impl Tick {
    /// Microseconds since start-up.
    pub fn us(self) -> i64 {
        match self {
            Tick::Forward(us) | Tick::Late(us) | Tick::Restart(us) => us,
        }
    }
}

/// Unwraps a 32 bit microsecond counter.
///
/// A tick a little older than the newest (across a wrap, too) is late and changes nothing; one much
/// older is a restart.
#[derive(Clone, Copy, Debug, Default)]
pub struct TickUnwrapper {
    newest_us: Option<i64>,
}

impl TickUnwrapper {
    /// The newest tick, unwrapped.
    pub fn newest_us(&self) -> Option<i64> {
        self.newest_us
    }

    /// Unwraps `tick`. `elapsed_us` is the host's time since the newest tick arrived, if it is
    /// known: it tells a pause of several laps from a restart. Without it a pause of up to half a
    /// lap (35.8 min) is followed.
    pub fn push(&mut self, tick: u32, elapsed_us: Option<i64>) -> Tick {
        let Some(newest) = self.newest_us else {
            return self.restart(tick);
        };
        let ahead = elapsed_us.map_or(LAP_US / 2 - 1, |us| us.max(0).saturating_add(BURST_US));
        // The largest count with these low 32 bits that is at most `latest`.
        let latest = newest.saturating_add(ahead);
        let us = latest - (latest - i64::from(tick)).rem_euclid(LAP_US);
        if us >= newest {
            self.newest_us = Some(us);
            Tick::Forward(us)
        } else if us >= newest - LATE_US {
            Tick::Late(us)
        } else {
            self.restart(tick);
            Tick::Restart(i64::from(tick))
        }
    }

    /// Unwraps the first tick of a new connection to the device. What a new connection brings was
    /// made after all that the old one brought, so that a tick that goes back, however little, is a
    /// restart, and one is, too, that went on by far less than `elapsed_us`, the host's time.
    pub fn push_connected(&mut self, tick: u32, elapsed_us: Option<i64>) -> Tick {
        let newest = self.newest_us;
        let pushed = self.push(tick, elapsed_us);
        let restarted = match (pushed, newest) {
            (Tick::Late(_), _) => true,
            (Tick::Forward(us), Some(newest)) => elapsed_us.is_some_and(|elapsed_us| {
                let slow_us = elapsed_us / SLOW;
                us - newest < elapsed_us.saturating_sub(BEHIND_US + slow_us)
            }),
            _ => false,
        };
        if !restarted {
            return pushed;
        }
        self.restart(tick);
        Tick::Restart(i64::from(tick))
    }

    /// Begins anew at `tick`, for a caller that knows of a restart by other signs.
    pub fn restart(&mut self, tick: u32) -> Tick {
        self.newest_us = Some(i64::from(tick));
        Tick::Forward(i64::from(tick))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn goes_on_over_the_wrap() {
        let mut ticks = TickUnwrapper::default();
        assert_eq!(ticks.push(u32::MAX - 9, None), Tick::Forward(LAP_US - 10));
        assert_eq!(ticks.push(30, None), Tick::Forward(LAP_US + 30));
        assert_eq!(ticks.push(30, None), Tick::Forward(LAP_US + 30));
        // Overtaken by the tick after the wrap: not a whole lap ahead.
        assert_eq!(ticks.push(u32::MAX, None), Tick::Late(LAP_US - 1));
        assert_eq!(ticks.push(40, Some(10)), Tick::Forward(LAP_US + 40));
    }

    #[test]
    fn a_restart_begins_anew() {
        let mut ticks = TickUnwrapper::default();
        ticks.push(2_000_000_000, None);
        assert_eq!(ticks.push(5_000_000, None), Tick::Restart(5_000_000));
        assert_eq!(ticks.push(5_040_000, None), Tick::Forward(5_040_000));
        // Shortly before a wrap only the host's clock tells a restart from a pause.
        let mut ticks = TickUnwrapper::default();
        ticks.push(4_100_000_000, None);
        let restart = ticks.push(5_000_000, Some(40_000_000));
        assert_eq!(restart, Tick::Restart(5_000_000));
    }

    #[test]
    fn a_new_connection_brings_nothing_late() {
        let mut ticks = TickUnwrapper::default();
        ticks.push(7_000_000, None);
        assert_eq!(ticks.push(5_000_000, None), Tick::Late(5_000_000));
        assert_eq!(
            ticks.push_connected(5_000_000, Some(900_000)),
            Tick::Restart(5_000_000)
        );
        // Later than the newest before, but 12 s passed: the device was off for a part of them.
        assert_eq!(
            ticks.push_connected(6_000_000, Some(12_000_000)),
            Tick::Restart(6_000_000)
        );
        // On its way for 2 s, and a clock that is 100 ppm slow.
        assert_eq!(
            ticks.push_connected(16_000_000, Some(12_000_000)),
            Tick::Forward(16_000_000)
        );
        assert_eq!(
            ticks.push_connected(4_012_400_000, Some(4_000_000_000)),
            Tick::Forward(4_012_400_000)
        );
        // Over the wrap.
        assert_eq!(
            ticks.push_connected(20_000_000, Some(300_000_000)),
            Tick::Forward(LAP_US + 20_000_000)
        );
        assert_eq!(ticks.push_connected(7, None), Tick::Restart(7));
        assert_eq!(
            TickUnwrapper::default().push_connected(7, Some(9)),
            Tick::Forward(7)
        );
    }

    #[test]
    fn long_pauses_and_bursts_by_the_hosts_clock() {
        let mut ticks = TickUnwrapper::default();
        ticks.push(1000, None);
        let pause = 3 * LAP_US + 5_000_000;
        assert_eq!(
            ticks.push(5_001_000, Some(pause)),
            Tick::Forward(3 * LAP_US + 5_001_000)
        );
        // 40 ms of the device's time in 0.1 ms of the host's, and the other way round.
        assert!(matches!(ticks.push(5_041_000, Some(100)), Tick::Forward(_)));
        assert!(matches!(
            ticks.push(5_081_000, Some(30_000_000)),
            Tick::Forward(_)
        ));
    }

    proptest! {
        #[test]
        fn follows_any_steps_below_half_a_lap(
            start in any::<u32>(),
            steps in prop::collection::vec(0i64..LAP_US / 2, 1..40),
        ) {
            let mut ticks = TickUnwrapper::default();
            let mut us = i64::from(start);
            ticks.push(start, None);
            for step in steps {
                us += step;
                prop_assert_eq!(ticks.push(us as u32, None), Tick::Forward(us));
            }
        }

        #[test]
        fn follows_any_pause_that_the_host_saw(
            start in any::<u32>(),
            steps in prop::collection::vec((0i64..20 * LAP_US, 0i64..50_000_000), 1..40),
        ) {
            let mut ticks = TickUnwrapper::default();
            let mut us = i64::from(start);
            ticks.push(start, None);
            for (step, delay) in steps {
                us += step;
                let elapsed = step + delay - 25_000_000;
                prop_assert_eq!(ticks.push(us as u32, Some(elapsed)), Tick::Forward(us));
            }
        }
    }
}
