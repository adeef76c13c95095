//! What the tick counter tells of a stream: its 64 bit time, its usual step, and what is missing.

use crate::clock::Counter;

/// Places in the device's time and in the stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Place {
    /// Ticks since the counter was 0 before the first reply.
    pub ticks: i64,
    /// Running number in the stream, gaps included.
    pub number: i64,
    /// Replies missing before this one.
    pub missing: u64,
    /// Whether the unit's counter began anew here: it was switched off and on.
    pub restarted: bool,
}

/// What became of a reply's ticks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pushed {
    /// It goes on.
    On(Place),
    /// The same ticks again: the unit hangs, or an adapter repeats. Not a new sample.
    Repeated,
    /// So far off that it is wrong or the unit was restarted; the next one decides. It is not a
    /// sample until then.
    Doubtful,
}

/// Follows the ticks of one streamed command.
///
/// Nothing on the wire says how many ticks lie between two replies (it depends on the command and on
/// the unit's settings), so the usual step is the one that occurs most. Missing replies are gaps in
/// units of it. The host's clock tells which lap of the counter a reply belongs to.
#[derive(Clone, Debug)]
pub struct Pace {
    tick_ns: i64,
    counter: Counter,
    last: Option<Last>,
    /// How often each step from 1 to [`STEPS`] occurred.
    steps: [u32; STEPS],
    step: Option<i64>,
    /// The least that arrivals were later than the ticks, ns.
    early_ns: i64,
    /// Whether the stream has gone on since the last reply, as far as anybody knows.
    unbroken: bool,
    doubtful: Option<(u16, i64)>,
    implausible: u64,
}

#[derive(Clone, Copy, Debug)]
struct Last {
    ticks: i64,
    number: i64,
    raw_ns: i64,
}

/// The longest usual step, ticks.
const STEPS: usize = 64;

/// How far the ticks may be off the host's clock before they are doubted, ns: more than any adapter
/// holds bytes back. Replies that waited longer in the host, because nobody read them, are known by
/// going on where the last one was.
const DOUBTFUL_NS: i64 = 2_000_000_000;

/// By how much of the time that passed the earliest arrival may drift: one part in this many. No
/// unit's clock is that far off.
const DRIFT: i64 = 50;

/// How far a gap may be off a whole number of steps, in steps, before the step is doubted.
const ROUNDING: i64 = 2;

impl Pace {
    /// For ticks of this length, ns.
    pub fn new(tick_ns: u64) -> Pace {
        Pace {
            tick_ns: i64::try_from(tick_ns).unwrap_or(i64::MAX).max(1),
            counter: Counter::new(16),
            last: None,
            steps: [0; STEPS],
            step: None,
            early_ns: 0,
            unbroken: true,
            doubtful: None,
            implausible: 0,
        }
    }

    /// The usual step, once two replies have come.
    pub fn step(&self) -> Option<i64> {
        self.step
    }

    /// The usual step, ns; a tick before it is known.
    pub fn step_ns(&self) -> i64 {
        self.step.unwrap_or(1).saturating_mul(self.tick_ns)
    }

    /// Replies left out because neither their predecessors nor their successors agreed with them.
    pub fn implausible(&self) -> u64 {
        self.implausible
    }

    /// Lets the pace see a step without following it, so that the usual one is known before the
    /// first reply is numbered.
    pub fn learn(&mut self, step: u16) {
        self.count(i64::from(step));
    }

    /// Takes the ticks of a reply that had come by `raw_ns` (the host's monotonic clock).
    pub fn push(&mut self, reading: u16, raw_ns: i64) -> Pushed {
        let Some(last) = self.last else {
            return Pushed::On(self.begin(reading, raw_ns, 0, 0, false));
        };
        let since_ns = raw_ns.saturating_sub(self.early_ns);
        let by_clock = (since_ns / self.tick_ns).saturating_sub(last.ticks);
        let mut counter = self.counter;
        let mut ticks = counter.push(u32::from(reading), Some(by_clock));
        if !self.is_timely(ticks, since_ns) || ticks < last.ticks {
            // Off the clock, but perhaps only read late: then it is the next of what waited.
            let next = i64::from(reading.wrapping_sub(last.ticks as u16));
            if next == 0 {
                return Pushed::Repeated;
            }
            let waited = self.unbroken && next < by_clock;
            if !waited || next.saturating_mul(self.tick_ns) > DOUBTFUL_NS {
                return self.doubt(reading, raw_ns, last);
            }
            counter = self.counter;
            ticks = counter.push(u32::from(reading), Some(next));
        }
        let passed = ticks - last.ticks;
        if passed == 0 {
            return Pushed::Repeated;
        }
        if self.doubtful.take().is_some() {
            self.implausible += 1;
        }
        self.counter = counter;
        self.unbroken = true;
        let passed_ns = passed.saturating_mul(self.tick_ns);
        let late_ns = raw_ns.saturating_sub(ticks.saturating_mul(self.tick_ns));
        self.early_ns = late_ns.min(self.early_ns.saturating_add(passed_ns / DRIFT));
        self.count(passed);
        let steps = self.in_steps(passed).max(1);
        let number = last.number.saturating_add(steps);
        self.last = Some(Last {
            ticks,
            number,
            raw_ns,
        });
        Pushed::On(Place {
            ticks,
            number,
            missing: u64::try_from(steps - 1).unwrap_or(0),
            restarted: false,
        })
    }

    /// The stream was begun anew: the next reply need not go on where the last one was.
    pub fn interrupt(&mut self) {
        self.unbroken = false;
    }

    /// Whether the ticks are where the host's clock has them, `since_ns` after the counter's 0.
    fn is_timely(&self, ticks: i64, since_ns: i64) -> bool {
        let off_ns = ticks.saturating_mul(self.tick_ns).saturating_sub(since_ns);
        off_ns.saturating_abs() <= DOUBTFUL_NS
    }

    /// Decides about ticks that are far off: two in a row that agree with each other are a restart.
    fn doubt(&mut self, reading: u16, raw_ns: i64, last: Last) -> Pushed {
        if let Some((before, before_raw_ns)) = self.doubtful.replace((reading, raw_ns)) {
            let passed = i64::from(reading.wrapping_sub(before));
            let passed_ns = passed.saturating_mul(self.tick_ns);
            let off_ns = passed_ns.saturating_sub(raw_ns.saturating_sub(before_raw_ns));
            if passed > 0 && off_ns.saturating_abs() <= DOUBTFUL_NS {
                self.doubtful = None;
                // The first of the two was held back and is among the missing.
                let elapsed = raw_ns.saturating_sub(last.raw_ns) / self.tick_ns;
                let steps = self.in_steps(elapsed).max(2);
                let missing = u64::try_from(steps - 1).unwrap_or(0);
                let number = last.number.saturating_add(steps);
                return Pushed::On(self.begin(reading, raw_ns, number, missing, true));
            }
            self.implausible += 1;
        }
        Pushed::Doubtful
    }

    fn begin(
        &mut self,
        reading: u16,
        raw_ns: i64,
        number: i64,
        missing: u64,
        restarted: bool,
    ) -> Place {
        self.counter.restart();
        let ticks = self.counter.push(u32::from(reading), None);
        self.early_ns = raw_ns.saturating_sub(ticks.saturating_mul(self.tick_ns));
        self.unbroken = true;
        self.last = Some(Last {
            ticks,
            number,
            raw_ns,
        });
        Place {
            ticks,
            number,
            missing,
            restarted,
        }
    }

    fn count(&mut self, passed: i64) {
        let index = usize::try_from(passed - 1).ok();
        let Some(count) = index.and_then(|index| self.steps.get_mut(index)) else {
            return;
        };
        *count = count.saturating_add(1);
        // The shortest of those that occur most.
        let mut best = (0, 0);
        for (index, count) in self.steps.iter().enumerate() {
            if *count > best.1 {
                best = (index, *count);
            }
        }
        self.step = i64::try_from(best.0 + 1).ok();
    }

    /// Ticks in usual steps, rounded.
    fn in_steps(&self, ticks: i64) -> i64 {
        let step = self.step.unwrap_or(1).max(1);
        let shares = ROUNDING.saturating_mul(ticks).saturating_add(step);
        shares / (ROUNDING * step)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::{Rng, SeedableRng};

    const TICK_NS: u64 = 2_000_000;

    fn on(pushed: Pushed) -> Place {
        match pushed {
            Pushed::On(place) => place,
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn losses_are_exact_in_a_thousand_runs() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        for run in 0..1000u64 {
            let step = 1 + rng.next_u32() % 6;
            let tick_ns = [6_553_600, 10_000_000, 2_000_000][(run % 3) as usize];
            let start = rng.next_u32() as u16;
            let mut pace = Pace::new(tick_ns);
            // As the session does: a few replies are looked at before the first is numbered.
            pace.learn(step as u16);
            // Losses before the first reply and after the last one leave no trace in the ticks.
            let (mut lost, mut missing) = (0, 0);
            let (mut held, mut lost_since) = (0u64, 0);
            let mut first = None;
            for k in 0..3000u64 {
                // Losses of one to 200 replies.
                if held == 0 && rng.next_u32().is_multiple_of(20) {
                    let most: u32 = if rng.next_u32().is_multiple_of(10) {
                        200
                    } else {
                        4
                    };
                    held = 1 + u64::from(rng.next_u32() % most);
                }
                if held > 0 {
                    held -= 1;
                    lost_since += 1;
                    continue;
                }
                let ticks = k * u64::from(step);
                let late_ns = u64::from(rng.next_u32() % 30_000_000);
                let raw_ns = (ticks * tick_ns + late_ns) as i64;
                let place = on(pace.push((u64::from(start) + ticks) as u16, raw_ns));
                if first.is_some() {
                    lost += lost_since;
                }
                lost_since = 0;
                missing += place.missing;
                let first = *first.get_or_insert(k);
                assert_eq!(place.number as u64, k - first, "run {run}");
            }
            assert_eq!(missing, lost, "run {run}");
        }
    }

    /// A unit's cells may hold anything: no length of a tick makes the arithmetic overflow.
    #[test]
    fn any_tick_is_survived() {
        for tick_ns in [0, 1, 100, u64::MAX] {
            let mut pace = Pace::new(tick_ns);
            for (reading, raw_ns) in [
                (5, 0),
                (9, 1),
                (65_535, i64::MAX),
                (3, i64::MIN),
                (40_000, i64::MAX),
                (1, i64::MIN),
                (2, 7),
            ] {
                pace.push(reading, raw_ns);
            }
        }
    }

    #[test]
    fn the_counter_wraps_at_65536() {
        let mut pace = Pace::new(TICK_NS);
        pace.learn(5);
        for k in 0..200_000i64 {
            let ticks = 65_530 + 5 * k;
            let place = on(pace.push(ticks as u16, ticks * TICK_NS as i64));
            assert_eq!((place.ticks, place.number, place.missing), (ticks, k, 0));
        }
    }

    #[test]
    fn a_pause_of_several_laps_is_followed_by_the_hosts_clock() {
        let mut pace = Pace::new(TICK_NS);
        on(pace.push(100, 0));
        on(pace.push(105, 10_000_000));
        let pause = 3 * 65_536 + 500;
        let raw_ns = 10_000_000 + pause * TICK_NS as i64;
        let place = on(pace.push((105 + pause) as u16, raw_ns));
        assert_eq!(place.ticks, 105 + pause);
        assert_eq!(place.missing as i64, (pause + 2) / 5 - 1);
    }

    #[test]
    fn what_waited_in_the_host_is_late_and_no_restart() {
        // A reader that is stopped for so long: what the host kept comes at once, then the stream
        // goes on, some of it lost.
        for (stopped_s, lost) in [(3i64, 0i64), (5, 300), (90, 8800), (200, 19_800)] {
            let mut pace = Pace::new(TICK_NS);
            pace.learn(5);
            let arrives = |k: i64| 5 * k * TICK_NS as i64 + 16_000_000;
            let reading = |k: i64| (40_000 + 5 * k) as u16;
            for k in 0..100 {
                on(pace.push(reading(k), arrives(k)));
            }
            let back = 100 + stopped_s * 100;
            let kept = back - lost;
            let mut missing = 0;
            for k in 100..back + 500 {
                if (kept..back).contains(&k) {
                    continue;
                }
                let place = on(pace.push(reading(k), arrives(k.max(back))));
                assert_eq!(
                    (place.ticks, place.number),
                    (40_000 + 5 * k, k),
                    "{stopped_s} s"
                );
                assert!(!place.restarted);
                missing += place.missing as i64;
            }
            assert_eq!((missing, pace.implausible()), (lost, 0), "{stopped_s} s");
        }
    }

    #[test]
    fn a_stream_begun_anew_need_not_go_on() {
        // The counter happens to begin a little after where the last reply was.
        let ns = 10_000_000;
        let mut pace = Pace::new(TICK_NS);
        for k in 0..10 {
            on(pace.push(65_000 + 5 * k as u16, k * ns));
        }
        pace.interrupt();
        assert_eq!(pace.push(3, 1000 * ns), Pushed::Doubtful);
        assert!(on(pace.push(8, 1001 * ns)).restarted);
    }

    #[test]
    fn a_clock_that_is_off_drifts_and_does_not_restart() {
        // An hour at a step of 10 ms, 5000 ppm slow and fast.
        for ppm in [-5000, 5000] {
            let mut pace = Pace::new(TICK_NS);
            pace.learn(5);
            for k in 0..360_000i64 {
                let raw_ns = 5 * k * (TICK_NS as i64 + TICK_NS as i64 * ppm / 1_000_000);
                let place = on(pace.push((5 * k) as u16, raw_ns));
                assert_eq!((place.number, place.restarted), (k, false), "{ppm} ppm");
            }
        }
    }

    #[test]
    fn a_stale_reply_is_no_sample() {
        let mut pace = Pace::new(TICK_NS);
        on(pace.push(100, 0));
        assert_eq!(pace.push(100, 10_000_000), Pushed::Repeated);
        assert_eq!(pace.push(100, 20_000_000), Pushed::Repeated);
        assert_eq!(on(pace.push(115, 30_000_000)).ticks, 115);
    }

    #[test]
    fn one_wild_counter_is_left_out_and_two_are_a_restart() {
        let mut pace = Pace::new(TICK_NS);
        let ns = 10_000_000;
        for k in 0..10 {
            on(pace.push(40_000 + 5 * k as u16, k * ns));
        }
        assert_eq!(pace.push(3, 10 * ns), Pushed::Doubtful);
        let place = on(pace.push(40_055, 11 * ns));
        assert_eq!((place.missing, place.restarted), (1, false));
        assert_eq!(pace.implausible(), 1);
        assert_eq!(pace.push(5, 300 * ns), Pushed::Doubtful);
        let place = on(pace.push(10, 301 * ns));
        assert!(place.restarted);
        assert_eq!((place.ticks, place.missing), (10, 289));
        assert_eq!(pace.implausible(), 1);
        assert_eq!(on(pace.push(15, 302 * ns)).missing, 0);
    }
}
