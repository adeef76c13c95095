//! A device's clock mapped to the host's by arrival times alone, as the records come.

use super::hull::{Line, LowerHull, Point};

/// How a [`OneWayHull`] forgets and when it begins anew.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OneWaySettings {
    /// The line is taken from the last half to whole of this time, s: the device's rate may change
    /// from one such piece to the next.
    pub window_s: f64,
    /// How far apart two quartz clocks usually run, ns/s (1 sigma). It holds the slope where the
    /// points are too few to tell it.
    pub drift_sigma: f64,
    /// A difference that stays this far off the line is a step of one of the clocks, ns.
    pub step_ns: i64,
}

impl Default for OneWaySettings {
    /// 60 s, 50 ppm, 50 ms: clocks are stepped by 0.1 s or more and slewed by less.
    fn default() -> Self {
        OneWaySettings {
            window_s: 60.0,
            drift_sigma: 50_000.0,
            step_ns: 50_000_000,
        }
    }
}

/// A device's instant on the host's clock.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Mapped {
    /// The host's time, ns. At most the arrival.
    pub host_ns: i64,
    /// By how much one of the clocks had been stepped when the map began anew here, ns (positive:
    /// the host's forward, or the device's back).
    pub step_ns: Option<i64>,
}

/// The causal map from a device's clock to the host's: the line under the cloud of
/// `arrival - device time`, in pieces.
///
/// The shortest delay stays in it, which one-way times cannot show. Two hulls take turns, so that
/// what is older than [`OneWaySettings::window_s`] is forgotten; memory is bounded and a record costs
/// well below a microsecond. Among records in the device's order the mapped times never go back
/// unless a clock was stepped.
#[derive(Clone, Debug)]
pub struct OneWayHull {
    settings: OneWaySettings,
    /// Device time and arrival of the first record, from which all is counted, ns.
    start: Option<(i64, i64)>,
    /// The older hull gives the map; the younger one replaces it.
    older: Cloud,
    younger: Cloud,
    line: Option<Line>,
    newest: Option<Newest>,
    late: Option<Late>,
}

#[derive(Clone, Copy, Debug)]
struct Newest {
    device_ns: i64,
    /// What it was mapped to.
    host_ns: i64,
}

/// A run of records that are all far above the line.
#[derive(Clone, Copy, Debug)]
struct Late {
    device_ns: i64,
    arrival_ns: i64,
    least_ns: f64,
    records: u32,
}

/// Corners after which the hulls take turns early: convex runs of points must not cost memory.
const MOST_VERTICES: usize = 1024;
/// For how long, ns, and for how many records differences must be far off to be a step forward. A
/// burst after a stall is late as well, but comes all at once.
const STEP_HOLDS_NS: i64 = 2_000_000_000;
const STEP_RECORDS: u32 = 16;

/// Points: their hull and their means.
#[derive(Clone, Debug, Default)]
struct Cloud {
    hull: LowerHull,
    first_s: f64,
    count: f64,
    sum_x_s: f64,
    sum_y_ns: f64,
}

impl Cloud {
    fn clear(&mut self) {
        self.hull.clear();
        (self.count, self.sum_x_s, self.sum_y_ns) = (0.0, 0.0, 0.0);
    }

    fn push(&mut self, point: Point) {
        if self.count == 0.0 {
            self.first_s = point.x_s;
        }
        self.hull.push(point);
        self.count += 1.0;
        self.sum_x_s += point.x_s - self.first_s;
        self.sum_y_ns += point.y_ns;
    }

    fn line(&self, drift_sigma: f64) -> Option<Line> {
        let x_s = self.first_s + self.sum_x_s / self.count;
        let flat = self.hull.line_at(x_s)?;
        // The mean delay above the edge says how much a record weighs; a microsecond is the least
        // that a stamp resolves.
        let mean_ns = (self.sum_y_ns / self.count - flat.at(x_s)).max(1000.0);
        self.hull
            .line_with_prior(x_s, self.count / mean_ns, 0.0, drift_sigma)
    }
}

impl Default for OneWayHull {
    fn default() -> Self {
        OneWayHull::new(OneWaySettings::default())
    }
}

impl OneWayHull {
    /// A map that knows nothing yet.
    pub fn new(settings: OneWaySettings) -> OneWayHull {
        OneWayHull {
            settings,
            start: None,
            older: Cloud::default(),
            younger: Cloud::default(),
            line: None,
            newest: None,
            late: None,
        }
    }

    /// Forgets everything: the device restarted, or another one took its place.
    pub fn restart(&mut self) {
        *self = OneWayHull::new(self.settings);
    }

    /// Takes a record's device time (unwrapped, ns) and its arrival at the host (ns), and maps the
    /// device time. A device time older than the newest is mapped and otherwise left out.
    pub fn push(&mut self, device_ns: i64, arrival_ns: i64) -> Mapped {
        let step_ns = self.step_ns(device_ns, arrival_ns);
        if step_ns.is_some() {
            self.restart();
        }
        let in_order = self
            .newest
            .is_none_or(|newest| device_ns >= newest.device_ns);
        if in_order {
            self.learn(device_ns, arrival_ns);
        }
        let mut host_ns = self
            .host_ns(device_ns)
            .unwrap_or(arrival_ns)
            .min(arrival_ns);
        if in_order {
            if let Some(newest) = self.newest {
                host_ns = host_ns.max(newest.host_ns).min(arrival_ns);
            }
            self.newest = Some(Newest { device_ns, host_ns });
        }
        Mapped { host_ns, step_ns }
    }

    /// The host's time at a device time, ns; none before the first record. Beyond the newest record
    /// the line is extrapolated.
    pub fn host_ns(&self, device_ns: i64) -> Option<i64> {
        let (device_0, arrival_0) = self.start?;
        let elapsed_ns = device_ns.saturating_sub(device_0);
        let above_ns = self.line?.at(elapsed_ns as f64 * 1e-9);
        Some(
            arrival_0
                .saturating_add(elapsed_ns)
                .saturating_add(above_ns.round() as i64),
        )
    }

    /// How much slower the device's clock runs than the host's, ns/s: negative where it is fast.
    pub fn rate(&self) -> Option<f64> {
        self.line.map(|line| line.slope)
    }

    fn point(start: (i64, i64), device_ns: i64, arrival_ns: i64) -> Point {
        let elapsed_ns = device_ns.saturating_sub(start.0);
        Point {
            x_s: elapsed_ns as f64 * 1e-9,
            y_ns: arrival_ns
                .saturating_sub(start.1)
                .saturating_sub(elapsed_ns) as f64,
        }
    }

    fn learn(&mut self, device_ns: i64, arrival_ns: i64) {
        let start = *self.start.get_or_insert((device_ns, arrival_ns));
        let point = OneWayHull::point(start, device_ns, arrival_ns);
        self.older.push(point);
        let window_s = self.settings.window_s;
        let vertices = self.older.hull.vertices().len();
        let half_way =
            point.x_s - self.older.first_s >= window_s / 2.0 || vertices > MOST_VERTICES / 2;
        if half_way || self.younger.count > 0.0 {
            self.younger.push(point);
        }
        let full = point.x_s - self.older.first_s >= window_s || vertices > MOST_VERTICES;
        if full && self.younger.count > 0.0 {
            std::mem::swap(&mut self.older, &mut self.younger);
            self.younger.clear();
            self.younger.push(point);
        }
        self.line = self.older.line(self.settings.drift_sigma);
    }

    /// Whether a clock was stepped: back shows at once, forward only when no record comes in time
    /// any more.
    fn step_ns(&mut self, device_ns: i64, arrival_ns: i64) -> Option<i64> {
        let (start, line) = (self.start?, self.line?);
        let point = OneWayHull::point(start, device_ns, arrival_ns);
        let above_ns = point.y_ns - line.at(point.x_s);
        let limit_ns = self.settings.step_ns as f64;
        // A pause leaves room for the drift that is not known yet.
        let newest_ns = self.newest.map_or(device_ns, |newest| newest.device_ns);
        let pause_s = device_ns.saturating_sub(newest_ns).max(0) as f64 * 1e-9;
        if above_ns < -(limit_ns + 4.0 * self.settings.drift_sigma * pause_s) {
            return Some(above_ns as i64);
        }
        if above_ns < limit_ns {
            self.late = None;
            return None;
        }
        let late = self.late.get_or_insert(Late {
            device_ns,
            arrival_ns,
            least_ns: above_ns,
            records: 0,
        });
        late.records += 1;
        late.least_ns = late.least_ns.min(above_ns);
        let held = arrival_ns.saturating_sub(late.arrival_ns) >= STEP_HOLDS_NS
            && device_ns.saturating_sub(late.device_ns) >= STEP_HOLDS_NS
            && late.records >= STEP_RECORDS;
        held.then_some(late.least_ns as i64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulate::random::{Draws, Purpose, Seed};
    use proptest::prelude::*;

    /// Device time and arrival of message `k`, sent every 28.57 ms by a clock `ppm` off.
    fn message(k: i64, ppm: f64, delay_ns: f64) -> (i64, i64) {
        let true_ns = k * 28_571_429;
        let device_ns = (true_ns as f64 * (1.0 + ppm * 1e-6)) as i64 / 1000 * 1000;
        (
            device_ns,
            1_700_000_000_000_000_000 + true_ns + delay_ns as i64,
        )
    }

    fn delay_ns(draws: &mut Draws) -> f64 {
        150e3 + 200e3 * (1.2 * draws.normal()).exp()
    }

    #[test]
    fn follows_a_clock_to_microseconds() {
        let mut hull = OneWayHull::default();
        let mut draws = Seed(5).draws(Purpose::Clocks, 0);
        let (mut worst_us, mut last) = (0.0f64, 0);
        // The minimum is 150 us + the least of the lognormal delays, about 5 us.
        for k in 0..35 * 600 {
            let ppm = 20.0;
            let (device_ns, arrival_ns) = message(k, ppm, delay_ns(&mut draws));
            let mapped = hull.push(device_ns, arrival_ns);
            assert_eq!(mapped.step_ns, None);
            assert!(mapped.host_ns >= last && mapped.host_ns <= arrival_ns);
            last = mapped.host_ns;
            let (_, sent_ns) = message(k, ppm, 150e3);
            if k > 35 * 30 {
                worst_us = worst_us.max((mapped.host_ns - sent_ns).abs() as f64 * 1e-3);
            }
        }
        assert!(worst_us < 20.0, "{worst_us}");
        assert!((hull.rate().unwrap() + 20_000.0).abs() < 1000.0);
    }

    #[test]
    fn a_step_is_said_and_followed() {
        for step_ns in [-1_000_000_000i64, 500_000_000] {
            let mut hull = OneWayHull::default();
            let mut draws = Seed(6).draws(Purpose::Clocks, 0);
            let mut said = Vec::new();
            for k in 0..4000 {
                let (device_ns, arrival_ns) = message(k, -35.0, delay_ns(&mut draws));
                let stepped = if k < 2000 { 0 } else { step_ns };
                let mapped = hull.push(device_ns, arrival_ns + stepped);
                if let Some(step) = mapped.step_ns {
                    said.push((k, step));
                }
                if k > 3000 {
                    let late = mapped.host_ns - (arrival_ns + stepped);
                    assert!(late <= 0);
                    let (_, sent_ns) = message(k, -35.0, 150e3);
                    assert!((mapped.host_ns - sent_ns - stepped).abs() < 60_000);
                }
            }
            let [(k, step)] = said[..] else {
                panic!("{said:?}")
            };
            assert!((2000..2100).contains(&k));
            assert!((step - step_ns).abs() < 2_000_000, "{step}");
        }
    }

    #[test]
    fn a_stall_is_no_step() {
        let mut hull = OneWayHull::default();
        let mut draws = Seed(7).draws(Purpose::Clocks, 0);
        for k in 0..3000i64 {
            let stalled = (1000..1200).contains(&k);
            let (device_ns, mut arrival_ns) = message(k, 10.0, delay_ns(&mut draws));
            if stalled {
                // All of them arrive when the stall ends, 20 us apart.
                arrival_ns = message(1200, 10.0, 100e3).1 + (k - 1200) * 20_000;
            }
            assert_eq!(hull.push(device_ns, arrival_ns).step_ns, None, "{k}");
        }
        assert!((hull.rate().unwrap() + 10_000.0).abs() < 2000.0);
    }

    proptest! {
        #[test]
        fn never_late_never_back_and_bounded(
            waits in prop::collection::vec((0i64..100_000_000, 0i64..40_000_000), 1..300),
            window_s in 0.1..5.0f64,
        ) {
            let settings = OneWaySettings { window_s, ..OneWaySettings::default() };
            let mut hull = OneWayHull::new(settings);
            let (mut device_ns, mut last_ns) = (0, i64::MIN);
            let mut arrived_ns = 0;
            for (step_ns, wait_ns) in waits {
                device_ns += step_ns;
                arrived_ns = arrived_ns.max(device_ns + wait_ns);
                let mapped = hull.push(device_ns, arrived_ns);
                prop_assert!(mapped.host_ns <= arrived_ns);
                if mapped.step_ns.is_none() {
                    prop_assert!(mapped.host_ns >= last_ns);
                }
                last_ns = mapped.host_ns;
                prop_assert!(hull.older.hull.vertices().len() <= MOST_VERTICES + 2);
            }
        }

        #[test]
        fn any_numbers_are_taken(
            pairs in prop::collection::vec((any::<i64>(), any::<i64>()), 1..50),
        ) {
            let mut hull = OneWayHull::default();
            for (device_ns, arrival_ns) in pairs {
                prop_assert!(hull.push(device_ns, arrival_ns).host_ns <= arrival_ns);
            }
        }
    }
}
