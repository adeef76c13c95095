//! Scans from a Hokuyo's measurements, in their order.
//!
//! **Time.** A measurement carries the device's milliseconds in 24 bits, which wrap every 4.66 h.
//! The device's clock is followed by the line under the cloud of arrival minus stamp
//! ([`OneWayHull`]), in offset and rate. What stays in that line is the way from stamp to arrival:
//! the scan itself and its transmission. Where the device's time was asked for before (TM1), the two
//! together give it; without, it is taken for the sweep alone. Half a millisecond makes up for the
//! stamp's cut-off digits, which scatter by 0.29 ms (1 sigma).
//!
//! **Numbers.** The device does not count its scans; `seq` follows the stamps, a gap of two periods
//! being one lost scan.

use super::scip::{Measurement, Parameters, STAMP_BITS};
use crate::clock::{Counter, OneWayHull};
use crate::link::HostInstant;
use crate::record::{Scan, Stamp};
use std::f64::consts::{FRAC_PI_2, TAU};

/// Distances below DMIN are codes: no object, too near, and faults.
const NO_OBJECT: u32 = 1;
const TOO_NEAR: u32 = 2;
/// Scans after which the way from stamp to arrival is held for known.
const SETTLED: u64 = 200;
/// A stamp that lies further back than this is another start of the device, ms.
const RESTART_MS: i64 = 1000;
/// Neither does the host's clock differ by so much from the device's within one run, ms.
const ASTRAY_MS: i64 = 60_000;
/// Half of the stamp's last digit, ns.
const HALF_DIGIT_NS: i64 = 500_000;

/// What the scans are told from outside.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Settings {
    /// From the stamp to the first step of the aperture, s.
    pub index_to_first_beam_s: f64,
    /// Least range, m; none is the device's DMIN.
    pub range_min_m: Option<f64>,
}

/// What happened on the way.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Scans given out.
    pub scans: u64,
    /// Scans that the stamps passed over.
    pub missing: u64,
    /// Scans with a stamp that was there already.
    pub repeated: u64,
    /// Times that the device's clock began anew.
    pub restarts: u64,
}

/// The device's time, asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TimeOffset {
    /// Host's monotonic time minus the device's, ns.
    pub raw_minus_device_ns: i64,
    /// It is right to this, ns.
    pub bound_ns: i64,
}

/// What one question after the device's time tells: it read `stamp_ms` between two instants of the
/// host.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TimeReading {
    /// The device's milliseconds as sent, 24 bits.
    pub stamp_ms: u32,
    /// The host's monotonic time before the question, ns.
    pub before_raw_ns: i64,
    /// And after the answer, ns.
    pub after_raw_ns: i64,
}

impl TimeOffset {
    /// The offset that all readings, each behind its milliseconds unwrapped, allow: each says that it
    /// lies between `before - (ms + 1)` and `after - ms`. None without readings, or where they
    /// contradict each other.
    fn of(readings: &[(i64, TimeReading)]) -> Option<TimeOffset> {
        const MS: i64 = 1_000_000;
        let least = readings
            .iter()
            .map(|(ms, r)| r.before_raw_ns - (ms + 1) * MS)
            .max()?;
        let most = readings
            .iter()
            .map(|(ms, r)| r.after_raw_ns - ms * MS)
            .min()?;
        (least <= most).then_some(TimeOffset {
            raw_minus_device_ns: least + (most - least) / 2,
            bound_ns: (most - least) / 2,
        })
    }
}

/// Makes scans of measurements.
#[derive(Debug)]
pub struct Scans {
    parameters: Parameters,
    settings: Settings,
    counts: Counts,
    counter: Counter,
    /// Unwrapped stamp of the newest scan, ms.
    newest_ms: Option<i64>,
    /// The newest stamp of any kind, ms, and the host's monotonic time when it came, ns.
    reference: Option<(i64, Option<i64>)>,
    hull: OneWayHull,
    offset: Option<TimeOffset>,
    /// From stamp to arrival at least, ns, and from how many scans.
    way_ns: Option<i64>,
    seen: u64,
    utc_minus_raw_ns: i64,
    scan: Scan,
}

impl Scans {
    /// At the start of a stream from a device with these parameters.
    pub fn new(parameters: Parameters, settings: Settings) -> Scans {
        Scans {
            parameters,
            settings,
            counts: Counts::default(),
            counter: Counter::new(STAMP_BITS),
            newest_ms: None,
            reference: None,
            hull: OneWayHull::default(),
            offset: None,
            way_ns: None,
            seen: 0,
            utc_minus_raw_ns: 0,
            scan: Scan::default(),
        }
    }

    /// What happened so far.
    pub fn counts(&self) -> Counts {
        self.counts
    }

    /// The newest scan.
    pub fn newest(&self) -> &Scan {
        &self.scan
    }

    /// The device's time has been asked for (again): the way from stamp to arrival is learned anew.
    /// What was found.
    pub fn set_time(&mut self, readings: &[TimeReading]) -> Option<TimeOffset> {
        let unwrapped: Vec<(i64, TimeReading)> = readings
            .iter()
            .map(|reading| {
                let ms = self.unwrap(reading.stamp_ms, Some(reading.after_raw_ns));
                (ms, *reading)
            })
            .collect();
        self.set_offset(TimeOffset::of(&unwrapped));
        self.offset
    }

    fn set_offset(&mut self, offset: Option<TimeOffset>) {
        self.offset = offset;
        self.way_ns = None;
        self.seen = 0;
    }

    /// Unwraps a stamp that came at the host's monotonic time `raw_ns`; notices a restart.
    fn unwrap(&mut self, stamp_ms: u32, raw_ns: Option<i64>) -> i64 {
        let elapsed_ms = match (self.reference, raw_ns) {
            (Some((_, Some(then_ns))), Some(now_ns)) => {
                Some(now_ns.saturating_sub(then_ns) / 1_000_000)
            }
            _ => None,
        };
        let mut ms = self.counter.push(stamp_ms, elapsed_ms);
        if let Some((last_ms, _)) = self.reference {
            let step_ms = ms - last_ms;
            // A stamp far off the host's clock is as good as one that goes back.
            let astray = elapsed_ms.is_some_and(|elapsed| (step_ms - elapsed).abs() > ASTRAY_MS);
            if step_ms < -RESTART_MS || astray {
                self.counts.restarts += 1;
                self.hull.restart();
                self.set_offset(None);
                self.newest_ms = None;
                self.reference = None;
                self.counter.restart();
                ms = self.counter.push(stamp_ms, None);
            }
        }
        if self.reference.is_none_or(|(last_ms, _)| ms >= last_ms) {
            self.reference = Some((ms, raw_ns));
        }
        ms
    }

    /// Takes a measurement that had arrived at that instant. Gives its scan, or none if it repeats
    /// one.
    pub fn push(
        &mut self,
        measurement: &Measurement,
        arrival: Option<HostInstant>,
    ) -> Option<&Scan> {
        let ms = self.unwrap(measurement.stamp_ms, arrival.map(|arrival| arrival.raw_ns));
        let period_ms = self.parameters.period_s() * 1e3;
        let number = match self.newest_ms {
            None if self.counts.scans == 0 => 0,
            None => self.scan.seq.wrapping_add(1),
            Some(last_ms) => {
                let periods = ((ms - last_ms) as f64 / period_ms).round() as i64;
                if periods <= 0 {
                    self.counts.repeated += 1;
                    return None;
                }
                self.counts.missing += (periods - 1) as u64;
                self.scan
                    .seq
                    .wrapping_add(u32::try_from(periods).unwrap_or(u32::MAX))
            }
        };
        self.newest_ms = Some(ms);
        let device_ns = ms.saturating_mul(1_000_000);
        let stamp_ns = self.stamp_ns(device_ns, arrival);
        self.fill(measurement);
        let scan = &mut self.scan;
        scan.seq = number;
        scan.device = Some(Stamp::from_ns(device_ns));
        scan.received = arrival.map(|arrival| arrival.utc);
        let first_step = f64::from(measurement.steps[0].saturating_sub(self.parameters.steps[0]));
        let turn_share = first_step / f64::from(self.parameters.steps_per_turn.max(1));
        let first_beam_s =
            self.settings.index_to_first_beam_s + turn_share * self.parameters.period_s();
        scan.stamp = Stamp::from_ns(stamp_ns).plus_s(first_beam_s);
        self.counts.scans += 1;
        Some(&self.scan)
    }

    /// The host's real time at a stamp, ns.
    fn stamp_ns(&mut self, device_ns: i64, arrival: Option<HostInstant>) -> i64 {
        let Some(arrival) = arrival else {
            let way_ns = self.way_ns.unwrap_or_default();
            return match self.hull.host_ns(device_ns) {
                Some(raw_ns) => raw_ns - way_ns + HALF_DIGIT_NS + self.utc_minus_raw_ns,
                None => device_ns,
            };
        };
        self.utc_minus_raw_ns = arrival.utc_minus_raw_ns();
        let mapped = self.hull.push(device_ns, arrival.raw_ns);
        self.seen += 1;
        let way_ns = match self.offset {
            Some(offset) => {
                let due_ns = device_ns.saturating_add(offset.raw_minus_device_ns);
                let way_ns = arrival.raw_ns.saturating_sub(due_ns);
                match self.way_ns {
                    Some(known_ns) if self.seen > SETTLED => known_ns,
                    Some(known_ns) => known_ns.min(way_ns),
                    None => way_ns,
                }
            }
            None => {
                let [first, last] = self.parameters.steps;
                let turn = f64::from(self.parameters.steps_per_turn.max(1));
                let sweep_s = f64::from(last - first) / turn * self.parameters.period_s();
                (sweep_s * 1e9) as i64
            }
        };
        self.way_ns = Some(way_ns);
        mapped
            .host_ns
            .saturating_sub(way_ns)
            .saturating_add(HALF_DIGIT_NS + self.utc_minus_raw_ns)
    }

    fn fill(&mut self, measurement: &Measurement) {
        let p = &self.parameters;
        let [first, _, cluster] = measurement.steps;
        let turn = f64::from(p.steps_per_turn.max(1));
        let step_rad = TAU / turn;
        let scan = &mut self.scan;
        scan.angle_min_rad = FRAC_PI_2 + (f64::from(first) - f64::from(p.front)) * step_rad;
        scan.angle_increment_rad = step_rad * f64::from(cluster);
        scan.time_increment_s = p.period_s() / turn * f64::from(cluster);
        scan.scan_time_s = p.period_s();
        let [least_mm, most_mm] = p.distance_mm;
        scan.range_min_m = self
            .settings
            .range_min_m
            .unwrap_or(f64::from(least_mm) * 1e-3);
        scan.range_max_m = f64::from(most_mm) * 1e-3;
        scan.ranges_m.clear();
        scan.ranges_m
            .extend(measurement.distances.iter().map(|mm| match *mm {
                NO_OBJECT => f64::INFINITY,
                TOO_NEAR => f64::NEG_INFINITY,
                mm if mm < least_mm => f64::NAN,
                mm if mm > most_mm => f64::INFINITY,
                mm => f64::from(mm) / 1000.0,
            }));
        scan.remissions.clear();
        let intensities = measurement.intensities.iter();
        scan.remissions
            .extend(intensities.map(|value| *value as f32));
        scan.info = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn measurement(stamp_ms: u32) -> Measurement {
        let mut measurement = Measurement::default();
        measurement.stamp_ms = stamp_ms & 0xFF_FFFF;
        measurement.steps = [540, 546, 1];
        measurement.distances = vec![1, 2, 3, 22, 23, 1500, 65_533];
        measurement
    }

    #[test]
    fn codes_angles_and_times() {
        let mut scans = Scans::new(Parameters::utm_30lx(), Settings::default());
        let scan = scans.push(&measurement(77), None).unwrap();
        assert_eq!(scan.ranges_m[0], f64::INFINITY);
        assert_eq!(scan.ranges_m[1], f64::NEG_INFINITY);
        assert!(scan.ranges_m[2].is_nan() && scan.ranges_m[3].is_nan());
        assert_eq!(scan.ranges_m[4..6], [0.023, 1.5]);
        assert_eq!(scan.ranges_m[6], f64::INFINITY);
        assert!((scan.angle_min_rad - FRAC_PI_2).abs() < 1e-15);
        assert!((scan.angle_increment_rad.to_degrees() - 0.25).abs() < 1e-12);
        assert!((scan.time_increment_s - 0.025 / 1440.0).abs() < 1e-15);
        // Step 540 comes three eighths of a turn after step 0.
        assert_eq!(scan.stamp.ns(), 77_000_000 + 9_375_000);
    }

    #[test]
    fn numbers_follow_the_stamps_over_the_wrap() {
        let mut scans = Scans::new(Parameters::utm_30lx(), Settings::default());
        let mut seqs = Vec::new();
        for ms in [0u32, 25, 51, 51, 125, 150] {
            let stamp = (0xFF_FFFFu32 - 60).wrapping_add(ms);
            seqs.extend(scans.push(&measurement(stamp), None).map(|scan| scan.seq));
        }
        assert_eq!(seqs, [0, 1, 2, 5, 6]);
        let counts = scans.counts();
        assert_eq!(
            (counts.missing, counts.repeated, counts.restarts),
            (2, 1, 0)
        );
        let scan = scans.push(&measurement(10), None);
        assert!(
            scan.is_none(),
            "older than the newest by less than a second"
        );
    }

    #[test]
    fn a_restart_begins_anew() {
        let mut scans = Scans::new(Parameters::utm_30lx(), Settings::default());
        let at = |ms: i64| Some(HostInstant::from_one_clock(ms * 1_000_000));
        scans.push(&measurement(500_000), at(1_000_000));
        let scan = scans.push(&measurement(4000), at(1_020_000)).unwrap();
        assert_eq!(
            (scan.seq, scan.device),
            (1, Some(Stamp::from_ns(4_000_000_000)))
        );
        assert_eq!(scans.counts().restarts, 1);
    }

    #[test]
    fn the_devices_time_is_found_by_asking() {
        // The device reads floor(t - 5.3 ms); 20 questions of 0.3 ms each.
        let readings: Vec<TimeReading> = (0..20)
            .map(|k| {
                let before_raw_ns = 7_000_000_000 + k * 3_170_000;
                let read_ns = before_raw_ns + 120_000 - 5_300_000;
                TimeReading {
                    stamp_ms: (read_ns / 1_000_000) as u32,
                    before_raw_ns,
                    after_raw_ns: before_raw_ns + 300_000,
                }
            })
            .collect();
        let mut scans = Scans::new(Parameters::utm_30lx(), Settings::default());
        let offset = scans.set_time(&readings).unwrap();
        assert!((offset.raw_minus_device_ns - 5_300_000).abs() <= offset.bound_ns);
        assert!(offset.bound_ns < 300_000, "{offset:?}");
        assert_eq!(scans.set_time(&[]), None);
        let astray = TimeReading {
            stamp_ms: readings[0].stamp_ms + 40,
            ..readings[0]
        };
        assert_eq!(scans.set_time(&[readings[0], astray]), None);
    }

    #[test]
    fn stamps_are_right_to_the_stamps_digit() {
        let mut scans = Scans::new(Parameters::utm_30lx(), Settings::default());
        scans.set_offset(Some(TimeOffset {
            raw_minus_device_ns: 5_300_000,
            bound_ns: 50_000,
        }));
        let mut errors_ns = Vec::new();
        for k in 0..2000i64 {
            // A period of 25.013 ms; the scan arrives 20 ms and up to 2 ms after its start.
            let true_ns = 1_000_000_000 + k * 25_013_000;
            let stamp_ms = ((true_ns - 5_300_000) / 1_000_000) as u32;
            let late_ns = k * 7919 % 2000 * 1000;
            let arrival = HostInstant::from_one_clock(true_ns + 20_000_000 + late_ns);
            let mut measurement = measurement(stamp_ms);
            measurement.steps = [0, 6, 1];
            let scan = scans.push(&measurement, Some(arrival)).unwrap();
            assert_eq!(i64::from(scan.seq), k);
            if k >= 300 {
                errors_ns.push(scan.stamp.ns() - true_ns);
            }
        }
        let mean_ns = errors_ns.iter().sum::<i64>() / errors_ns.len() as i64;
        assert!(mean_ns.abs() < 200_000, "{mean_ns}");
        assert!(errors_ns.iter().all(|ns| ns.abs() < 900_000));
        assert_eq!(scans.counts().missing, 0);
    }
}
