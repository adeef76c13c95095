//! When a sample was taken.
//!
//! A reply says at which tick its calculation began; it arrives a cycle, its time on the line and
//! whatever the adapter holds it back later. The earliest arrivals over the ticks are a straight
//! line, which follows the unit's clock in offset and rate ([`OneWayHull`]); less cycle and line
//! time it is the time of the sample. Arrival stamps alone are 16 to 25 ms late.

use super::{Command, wire_time_s};
use crate::clock::{OneWayHull, OneWaySettings};
use crate::link::HostInstant;
use crate::record::Stamp;

/// For how long arrivals are remembered, s. The timer of an adapter and the unit's cycle beat: the
/// shortest delay comes back only after tens of seconds, and the line needs several of them.
const WINDOW_S: f64 = 300.0;

/// Maps the ticks of a stream to the host's clock.
#[derive(Clone, Debug)]
pub struct SampleClock {
    hull: OneWayHull,
    tick_ns: i64,
    /// Real time minus monotonic time of the newest arrival, ns.
    utc_minus_raw_ns: i64,
    /// What the line of the earliest arrivals is later than the tick, ns.
    delay_ns: i64,
}

impl SampleClock {
    /// For ticks of this length, ns, by the unit's clock.
    pub fn new(tick_ns: u64) -> SampleClock {
        SampleClock {
            hull: OneWayHull::new(OneWaySettings {
                window_s: WINDOW_S,
                ..OneWaySettings::default()
            }),
            tick_ns: i64::try_from(tick_ns).unwrap_or(i64::MAX),
            utc_minus_raw_ns: 0,
            delay_ns: 0,
        }
    }

    /// The unit was switched off and on: its ticks begin anew.
    pub fn restart(&mut self) {
        self.hull.restart();
    }

    /// Device time of a count of ticks, ns.
    pub fn device_ns(&self, ticks: i64) -> i64 {
        ticks.saturating_mul(self.tick_ns)
    }

    /// Takes a reply of the streamed command that began at `ticks` and had come by `at`, with the
    /// cycle that it took, ns, and gives the time of its sample.
    pub fn push(
        &mut self,
        ticks: i64,
        at: HostInstant,
        command: Command,
        cycle_ns: i64,
        baud: u32,
    ) -> Stamp {
        let wire_ns = (wire_time_s(command.reply_length(), baud) * 1e9).round() as i64;
        self.delay_ns = cycle_ns.saturating_add(wire_ns);
        self.utc_minus_raw_ns = at.utc_minus_raw_ns();
        let mapped = self.hull.push(self.device_ns(ticks), at.raw_ns);
        self.stamp(mapped.host_ns)
    }

    /// The time of a sample whose arrival says nothing: a polled reply between streamed ones. None
    /// before the first streamed reply.
    pub fn at(&self, ticks: i64) -> Option<Stamp> {
        self.hull
            .host_ns(self.device_ns(ticks))
            .map(|raw_ns| self.stamp(raw_ns))
    }

    fn stamp(&self, raw_ns: i64) -> Stamp {
        let ns = raw_ns
            .saturating_sub(self.delay_ns)
            .saturating_add(self.utc_minus_raw_ns);
        Stamp::from_ns(ns)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gx1::pace::{Pace, Pushed};
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::{Rng, SeedableRng};

    const TICK_NS: u64 = 2_000_000;
    const STEP: i64 = 5;
    const UTC_NS: i64 = 1_700_000_000_000_000_000;

    /// Root mean square error of the sample times, s, over four laps of the tick counter (524 s),
    /// and the worst, with an adapter that hands its bytes over when its timer (`timer_ms`) runs out.
    /// The unit's clock is 50 ppm fast; the host wakes up to 30 us late. The first `skip` samples
    /// are left out.
    fn errors(timer_ms: f64, skip: usize) -> (f64, f64) {
        const BAUD: u32 = 38_400;
        let command = Command::StabilisedEulerAccelRate;
        let mut rng = ChaCha8Rng::seed_from_u64(7);
        let mut pace = Pace::new(TICK_NS);
        pace.learn(STEP as u16);
        let mut clock = SampleClock::new(TICK_NS);
        let (mut sum, mut worst, mut count) = (0.0, 0.0f64, 0);
        let mut handed_over_s = 0.0;
        for k in 0..53_000i64 {
            let ticks = 60_000 + k * STEP;
            // When the tick is on the host's clock, s.
            let sampled_s = (ticks * TICK_NS as i64) as f64 * 1e-9 / (1.0 + 50e-6);
            let sent_s = sampled_s + STEP as f64 * 2e-3 + wire_time_s(23, BAUD);
            // A timer that runs from the last time the adapter handed bytes over.
            let timer_s = timer_ms * 1e-3;
            if timer_s > 0.0 {
                let turns = ((sent_s - handed_over_s) / timer_s).ceil().max(0.0);
                handed_over_s += turns * timer_s;
            } else {
                handed_over_s = sent_s;
            }
            let wake_s = f64::from(rng.next_u32() % 30_000) * 1e-9;
            let raw_ns = ((handed_over_s + wake_s) * 1e9) as i64;
            let at = HostInstant {
                utc: Stamp::from_ns(UTC_NS + raw_ns),
                raw_ns,
            };
            let Pushed::On(place) = pace.push(ticks as u16, raw_ns) else {
                panic!("sample {k}");
            };
            assert_eq!(place.ticks, ticks);
            let stamp = clock.push(place.ticks, at, command, pace.step_ns(), BAUD);
            if k as usize >= skip {
                let error_s = (stamp.ns() - UTC_NS) as f64 * 1e-9 - sampled_s;
                sum += error_s * error_s;
                worst = worst.max(error_s.abs());
                count += 1;
            }
        }
        ((sum / f64::from(count)).sqrt(), worst)
    }

    #[test]
    fn microseconds_across_three_wraps() {
        for (timer_ms, limit_s) in [(0.0, 20e-6), (1.0, 20e-6), (16.0, 500e-6)] {
            let (rms, worst) = errors(timer_ms, 6000);
            println!(
                "{timer_ms} ms: rms {:.1} us, worst {:.1} us",
                rms * 1e6,
                worst * 1e6
            );
            assert!(rms <= limit_s, "{timer_ms} ms: {rms}");
            let (all, _) = errors(timer_ms, 0);
            println!("{timer_ms} ms: rms from the start {:.1} us", all * 1e6);
        }
    }
}
