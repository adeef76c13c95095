//! Which scan follows which: what the two counters of a telegram say about losses.
//!
//! The scan counter counts turns of the mirror, the telegram counter what was given to the
//! interface; both are 16 bits wide. Where the device sends every n-th scan or the mean of n, each
//! telegram is n turns on from the one before; n (the stride) is learned from the two counters.

use super::replay::{PERIOD_TOLERANCE, nominal_period_s};
use super::scandata::LmdScandata;

/// Telegrams that must agree before a wider stride is taken for a new setting, not for losses.
const STRIDE_HOLDS: u32 = 8;
/// One lap of the scan counter.
const LAP: i64 = 1 << 16;
/// How well the time must fit a number of turns beyond a lap of the counter.
const LAP_TOLERANCE: f64 = 0.005;

/// What lies between a scan and the one before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// The device went on measuring.
    On {
        /// By how many scans of the stream this one is ahead; 0 for another layer of the same.
        scans: i64,
        /// By how many turns of the mirror.
        turns: i64,
        /// How many scans should have come between.
        missing: u64,
    },
    /// The scan counter began anew.
    Anew,
}

/// The counters of the newest scan and the stride.
#[derive(Clone, Copy, Debug)]
pub struct Succession {
    scan_counter: u16,
    telegram_counter: u16,
    layer: u16,
    /// Turns from telegram to telegram; 0 while not known.
    stride: u16,
    /// Pairs of telegrams that have shown this stride.
    confirmed: u32,
    /// A stride seen last that is wider than the known one, and how many times in a row.
    wider: (u16, u32),
}

impl Succession {
    /// Begins with a scan.
    pub fn new(telegram: &LmdScandata) -> Succession {
        Succession {
            scan_counter: telegram.scan_counter,
            telegram_counter: telegram.telegram_counter,
            layer: telegram.layer,
            stride: 0,
            confirmed: 0,
            wider: (0, 0),
        }
    }

    /// Turns from telegram to telegram.
    pub fn stride(&self) -> i64 {
        self.stride.max(1).into()
    }

    /// Takes the next scan, `elapsed_s` after the one before by the device's clock, whose turns take
    /// `period_s` where that has been measured.
    pub fn push(&mut self, telegram: &LmdScandata, elapsed_s: f64, period_s: Option<f64>) -> Step {
        let turns = telegram.scan_counter.wrapping_sub(self.scan_counter);
        let telegrams = telegram
            .telegram_counter
            .wrapping_sub(self.telegram_counter);
        let other_layer = telegram.layer != self.layer;
        self.scan_counter = telegram.scan_counter;
        self.telegram_counter = telegram.telegram_counter;
        self.layer = telegram.layer;
        if turns == 0 && other_layer {
            return Step::On {
                scans: 0,
                turns: 0,
                missing: 0,
            };
        }
        // The device may stand still for any time between two scans, but it cannot make more of
        // them than the time allows.
        let most = nominal_period_s(telegram).map_or(f64::INFINITY, |period_s| {
            1.5 + elapsed_s / (period_s * (1.0 - PERIOD_TOLERANCE))
        });
        let all_turns = beyond_a_lap(turns.into(), elapsed_s, period_s);
        if all_turns == 0 || f64::from(turns) > most {
            return Step::Anew;
        }
        if telegram.polled {
            return Step::On {
                scans: all_turns,
                turns: all_turns,
                missing: 0,
            };
        }
        let hidden = self.learn_stride(turns, telegrams);
        let stride = self.stride();
        let scans = (all_turns + stride - 1) / stride;
        Step::On {
            scans,
            turns: all_turns,
            missing: hidden + (scans - 1).unsigned_abs(),
        }
    }

    /// Learns the stride from one pair of telegrams. Gives the scans that an earlier pair has lost
    /// though its stride was believed.
    fn learn_stride(&mut self, turns: u16, telegrams: u16) -> u64 {
        let even = turns.checked_rem(telegrams) == Some(0);
        let Some(seen) = even.then(|| turns / telegrams).filter(|seen| *seen > 0) else {
            return 0;
        };
        match seen.cmp(&self.stride) {
            _ if self.stride == 0 => {
                self.stride = seen;
                self.confirmed = 1;
            }
            std::cmp::Ordering::Equal => {
                self.confirmed = self.confirmed.saturating_add(1);
                self.wider = (0, 0);
            }
            std::cmp::Ordering::Less => {
                // Nothing makes the device send more often than it was told to.
                let hidden = u64::from(self.stride / seen - 1) * u64::from(self.confirmed == 1);
                self.stride = seen;
                self.confirmed = 1;
                self.wider = (0, 0);
                return hidden;
            }
            std::cmp::Ordering::Greater => {
                let times = if self.wider.0 == seen {
                    self.wider.1 + 1
                } else {
                    1
                };
                self.wider = (seen, times);
                if times >= STRIDE_HOLDS {
                    self.stride = seen;
                    self.confirmed = times;
                    self.wider = (0, 0);
                }
            }
        }
        0
    }
}

/// Turns from the counter's difference, which knows them up to whole laps, and the time that went
/// by. Where the time fits no number of laps the device stood still, and the counter is right.
fn beyond_a_lap(turns: i64, elapsed_s: f64, period_s: Option<f64>) -> i64 {
    let Some(period_s) = period_s.filter(|period_s| *period_s > 0.0) else {
        return turns;
    };
    let by_time = elapsed_s / period_s;
    if by_time < 0.5 * LAP as f64 {
        return turns;
    }
    let laps = ((by_time - turns as f64) / LAP as f64).round().max(0.0);
    let all = turns as f64 + laps * LAP as f64;
    if (all / by_time - 1.0).abs() < LAP_TOLERANCE {
        all as i64
    } else {
        turns
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scan(scan_counter: u16, telegram_counter: u16) -> LmdScandata {
        LmdScandata {
            scan_counter,
            telegram_counter,
            scan_frequency: 2500,
            ..LmdScandata::default()
        }
    }

    /// Scans and missing scans of each step, 0.04 s a turn.
    fn steps(counters: &[(u16, u16)]) -> (Vec<(i64, u64)>, i64) {
        let (first, rest) = counters.split_first().unwrap();
        let mut succession = Succession::new(&scan(first.0, first.1));
        let mut last = first.0;
        let steps = rest.iter().map(|(scans, telegrams)| {
            let elapsed_s = f64::from(scans.wrapping_sub(last)) * 0.04;
            last = *scans;
            match succession.push(&scan(*scans, *telegrams), elapsed_s, Some(0.04)) {
                Step::On { scans, missing, .. } => (scans, missing),
                Step::Anew => panic!("anew"),
            }
        });
        (steps.collect(), succession.stride())
    }

    #[test]
    fn a_divider_is_no_loss_and_a_loss_is_one() {
        // Every third scan; the fourth telegram is lost on the way.
        let (found, stride) = steps(&[(65_530, 9), (65_533, 10), (0, 11), (6, 13), (9, 14)]);
        assert_eq!((found, stride), (vec![(1, 0), (1, 0), (2, 1), (1, 0)], 3));
        // Every scan; the device leaves out two for want of room on the line.
        let (found, stride) = steps(&[(5, 1), (6, 2), (9, 3), (10, 4)]);
        assert_eq!((found, stride), (vec![(1, 0), (3, 2), (1, 0)], 1));
        // The same at the very start, where it shows one telegram later.
        let (found, stride) = steps(&[(5, 1), (8, 2), (9, 3)]);
        assert_eq!((found, stride), (vec![(1, 0), (1, 2)], 1));
        // A telegram counter that does not count.
        let (found, stride) = steps(&[(5, 0), (6, 0), (9, 0)]);
        assert_eq!((found, stride), (vec![(1, 0), (3, 2)], 1));
    }

    #[test]
    fn a_new_setting_is_believed_after_a_while() {
        let mut counters = vec![(0, 0), (1, 1), (2, 2)];
        counters.extend((1..=12).map(|k| (2 + 4 * k, 2 + k)));
        let (found, stride) = steps(&counters);
        assert_eq!(stride, 4);
        assert!(found[2..9].iter().all(|step| *step == (4, 3)), "{found:?}");
        assert!(found[9..].iter().all(|step| *step == (1, 0)), "{found:?}");
        // And back at once.
        counters.extend([(51, 15), (52, 16)]);
        let (found, stride) = steps(&counters);
        assert_eq!((stride, &found[14..]), (1, &[(1, 0), (1, 0)][..]));
    }

    #[test]
    fn time_tells_the_laps_of_the_counter() {
        let lap_s = 0.0401 * 65_536.0;
        assert_eq!(beyond_a_lap(10, 0.401, Some(0.0401)), 10);
        assert_eq!(beyond_a_lap(10, 2.0 * lap_s + 0.41, Some(0.0401)), 131_082);
        // 50 minutes of standing still.
        assert_eq!(beyond_a_lap(1, 3000.0, Some(0.0401)), 1);
        assert_eq!(beyond_a_lap(1, 3000.0, None), 1);
    }

    #[test]
    fn what_cannot_be_is_a_new_count() {
        let mut succession = Succession::new(&scan(500, 7));
        assert_eq!(succession.push(&scan(3, 8), 2.0, None), Step::Anew);
        assert_eq!(
            succession.push(&scan(4, 9), 0.04, None),
            Step::On {
                scans: 1,
                turns: 1,
                missing: 0
            }
        );
        let mut poll = scan(90, 10);
        poll.polled = true;
        assert_eq!(
            succession.push(&poll, 3.5, None),
            Step::On {
                scans: 86,
                turns: 86,
                missing: 0
            }
        );
    }
}
