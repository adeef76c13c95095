//! Counters of any width, unwrapped.

/// Unwraps a counter of `bits` bits, such as the 3DM-GX1's 16 bit ticks or the 24 bit milliseconds
/// of a Hokuyo.
///
/// Which lap a reading belongs to is told by the host's clock where a pause may be longer than half
/// a lap; without it the reading nearest to the newest one is meant.
#[derive(Clone, Copy, Debug)]
pub struct Counter {
    lap: i64,
    newest: Option<i64>,
}

impl Counter {
    /// A counter of `bits` bits (1 to 62).
    pub fn new(bits: u32) -> Counter {
        Counter {
            lap: 1 << bits.clamp(1, 62),
            newest: None,
        }
    }

    /// Begins anew: the device restarted.
    pub fn restart(&mut self) {
        self.newest = None;
    }

    /// Unwraps a reading. `elapsed` is how many counts the host's clock says have passed since the
    /// newest one, if it is known; the count nearest to that is meant. A count below the newest
    /// is an older reading and does not move it.
    pub fn push(&mut self, reading: u32, elapsed: Option<i64>) -> i64 {
        let reading = i64::from(reading).rem_euclid(self.lap);
        let Some(newest) = self.newest else {
            self.newest = Some(reading);
            return reading;
        };
        let expected = newest.saturating_add(elapsed.unwrap_or(0));
        // The difference from the expected count, in [-lap / 2, lap / 2).
        let half = self.lap / 2;
        let ahead = (reading - expected.rem_euclid(self.lap) + half).rem_euclid(self.lap) - half;
        let count = expected.saturating_add(ahead);
        self.newest = Some(newest.max(count));
        count
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn an_older_reading_does_not_move_it() {
        let mut counter = Counter::new(16);
        counter.push(65_530, None);
        assert_eq!(counter.push(4, None), 65_540);
        assert_eq!(counter.push(65_535, None), 65_535);
        // Half a lap from the newest, but more from the older one.
        assert_eq!(counter.push(32_770, None), 65_536 + 32_770);
        counter.restart();
        assert_eq!(counter.push(7, None), 7);
    }

    proptest! {
        #[test]
        fn follows_any_pause_that_the_host_saw(
            bits in 4u32..32,
            start in any::<u32>(),
            steps in prop::collection::vec((0i64..1 << 40, -0.45..0.45f64), 1..40),
        ) {
            let mut counter = Counter::new(bits);
            let lap = 1i64 << bits;
            let mut count = counter.push(start, None);
            prop_assert_eq!(count, i64::from(start) % lap);
            for (step, off) in steps {
                let reading = ((count + step) % lap) as u32;
                let elapsed = step + (off * lap as f64) as i64;
                prop_assert_eq!(counter.push(reading, Some(elapsed)), count + step);
                count += step;
            }
        }

        #[test]
        fn follows_steps_below_half_a_lap(
            bits in 4u32..32,
            start in any::<u32>(),
            shares in prop::collection::vec(0.0..0.49f64, 1..40),
        ) {
            let mut counter = Counter::new(bits);
            let lap = 1i64 << bits;
            let mut count = counter.push(start, None);
            for share in shares {
                count += (share * lap as f64) as i64;
                prop_assert_eq!(counter.push((count % lap) as u32, None), count);
            }
        }
    }
}
