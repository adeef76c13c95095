//! A source that replays a recorded byte stream of an LMS5xx.
//!
//! What a recording says of time is kept: the distance from zero index to zero index and from there
//! to the transmission. Counters, ticks, calendar and check bytes are the emulator's own, so that a
//! recording may be played over and over without a step back.

use super::{Revolution, Source};
use crate::frame::{ScanMode, ScannerModel};
use crate::sick::angles::{first_angle_deg, true_step_deg};
use crate::sick::cola::{Event, Framer};
use crate::sick::scandata::{LmdScandata, is_scan};

/// Why a recording cannot be replayed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum RecordingError {
    /// Nothing to replay.
    #[error("it holds no telegram with a scan")]
    NoScans,
    /// Not a mode of the device that is emulated.
    #[error(
        "it was made at {frequency_hz} Hz with {step_deg:.4} deg, which no mode of {model} has"
    )]
    Mode {
        /// Scan frequency, Hz.
        frequency_hz: f64,
        /// Angle from beam to beam, deg.
        step_deg: f64,
        /// The scanner's name.
        model: &'static str,
    },
}

/// A longer pause between two scans, or a step back, comes from a device that was started again or a
/// telegram that was overtaken: one period stands for it, us.
const LONGEST_PAUSE_US: i64 = 10_000_000;

/// Recorded scans and when they were made.
#[derive(Debug)]
pub struct Recording {
    scans: Vec<(LmdScandata, Revolution)>,
    mode: ScanMode,
    /// First and last angle of all scans, 1e-4 deg.
    coverage: Option<[i32; 2]>,
    /// From the first zero index of one pass to that of the next, ns.
    pass_ns: i64,
    passes: Option<u64>,
    place: usize,
    pass: u64,
}

impl Recording {
    /// Reads a recording, to be played `passes` times or without end.
    pub fn new(
        bytes: &[u8],
        model: &'static ScannerModel,
        passes: Option<u64>,
    ) -> Result<Recording, RecordingError> {
        let mut framer = Framer::new();
        let mut scans: Vec<(LmdScandata, Revolution)> = Vec::new();
        let mut index_ns = 0;
        for chunk in bytes.chunks(64 << 10) {
            framer.feed(chunk);
            while let Some(event) = framer.next() {
                let Event::Telegram(telegram) = event else {
                    continue;
                };
                let mut scan = LmdScandata::default();
                if !is_scan(&telegram) || scan.parse(&telegram).is_err() {
                    continue;
                }
                let ticks_us = |from: u32, to: u32| i64::from(to.wrapping_sub(from).cast_signed());
                if let Some((last, _)) = scans.last() {
                    index_ns += match ticks_us(last.scan_tick_us, scan.scan_tick_us) {
                        0 => continue, // sent twice
                        since_us @ 1..=LONGEST_PAUSE_US => since_us * 1000,
                        _ => period_ns(&scan),
                    };
                }
                let after_us = ticks_us(scan.scan_tick_us, scan.transmit_tick_us);
                let transmit_after_ns = after_us.max(0) * 1000;
                let revolution = Revolution {
                    index_ns,
                    end_ns: index_ns,
                    transmit_after_ns: Some(transmit_after_ns),
                };
                scans.push((scan, revolution));
            }
        }
        let (first, _) = scans.first().ok_or(RecordingError::NoScans)?;
        let frequency_hz = f64::from(first.scan_frequency) / 100.0;
        let raw = first.channels.first().map_or(0, |c| c.angular_step);
        let step_deg = true_step_deg(raw);
        let found = model.modes.iter().find(|mode| {
            (mode.frequency_hz - frequency_hz).abs() < 1e-6
                && (mode.step_deg() - step_deg).abs() < 1e-6
        });
        let mode = *found.ok_or(RecordingError::Mode {
            frequency_hz,
            step_deg,
            model: model.name,
        })?;
        let mean_ns = match scans.len() as i64 - 1 {
            0 => period_ns(first),
            gaps => index_ns / gaps,
        };
        Ok(Recording {
            pass_ns: index_ns + mean_ns,
            coverage: coverage(&scans, mode),
            scans,
            mode,
            passes,
            place: 0,
            pass: 0,
        })
    }

    /// Number of scans in one pass.
    pub fn len(&self) -> usize {
        self.scans.len()
    }

    /// Whether there are none, which [`Recording::new`] refuses.
    pub fn is_empty(&self) -> bool {
        self.scans.is_empty()
    }
}

/// The nominal period, ns; 0 where the telegram does not say.
fn period_ns(scan: &LmdScandata) -> i64 {
    match i64::from(scan.scan_frequency) {
        0 => 0,
        hundredths => 100_000_000_000 / hundredths,
    }
}

/// First and last angle of all scans together, 1e-4 deg; none where there are no beams.
fn coverage(scans: &[(LmdScandata, Revolution)], mode: ScanMode) -> Option<[i32; 2]> {
    let step_deg = mode.step_deg();
    let ends = scans.iter().filter_map(|(scan, _)| {
        let channel = scan.channels.first()?;
        let steps = channel.values.len().checked_sub(1)?;
        let first_deg = first_angle_deg(channel.start_angle, step_deg);
        let last_deg = first_deg + steps as f64 * step_deg;
        Some([first_deg, last_deg].map(|deg| (deg * 1e4).round() as i32))
    });
    ends.reduce(|[from, to], [first, last]| [from.min(first), to.max(last)])
}

impl Source for Recording {
    fn next(
        &mut self,
        _mode: ScanMode,
        measured: bool,
        telegram: &mut LmdScandata,
    ) -> Option<Revolution> {
        if self.place == self.scans.len() {
            self.place = 0;
            self.pass += 1;
        }
        if self.passes.is_some_and(|passes| self.pass >= passes) {
            return None;
        }
        let (scan, revolution) = self.scans.get(self.place)?;
        self.place += 1;
        if measured {
            telegram.channels.clone_from(&scan.channels);
        }
        let shift_ns = i64::try_from(self.pass).ok()?.checked_mul(self.pass_ns)?;
        Some(Revolution {
            index_ns: revolution.index_ns + shift_ns,
            end_ns: revolution.end_ns + shift_ns,
            ..*revolution
        })
    }

    fn fixed_mode(&self) -> Option<ScanMode> {
        Some(self.mode)
    }

    fn coverage(&self) -> Option<[i32; 2]> {
        self.coverage
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sick::cola::Dialect;
    use crate::sick::encode::encode;
    use crate::sick::scandata::Channel;

    /// When the scans of a recording with these ticks are made again, ms.
    fn index_ms(ticks_us: &[u32]) -> Vec<i64> {
        let mut bytes = Vec::new();
        for tick_us in ticks_us {
            let scan = LmdScandata {
                scan_tick_us: *tick_us,
                transmit_tick_us: tick_us.wrapping_add(40_000),
                scan_frequency: 2500,
                channels: vec![Channel {
                    name: *b"DIST1",
                    scale: 1.0,
                    start_angle: -50_000,
                    angular_step: 1667,
                    values: vec![1000; 1141],
                    ..Channel::default()
                }],
                ..LmdScandata::default()
            };
            encode(&scan, Dialect::Binary, &mut bytes);
        }
        let model = ScannerModel::by_name("lms511-hr").unwrap();
        let mut recording = Recording::new(&bytes, model, Some(1)).unwrap();
        let mut telegram = LmdScandata::default();
        let revolutions =
            std::iter::from_fn(|| recording.next(model.modes[0], true, &mut telegram));
        revolutions.map(|r| r.index_ns / 1_000_000).collect()
    }

    #[test]
    fn a_restart_and_an_overtaken_telegram_take_one_period() {
        // On, sent twice, one missing.
        assert_eq!(index_ms(&[1000, 41_000, 41_000, 121_000]), [0, 40, 120]);
        // Over the wrap; overtaken; started again, by either way back; on.
        let wrap = u32::MAX - 9999;
        assert_eq!(index_ms(&[wrap, 30_000, 10_000, 50_000]), [0, 40, 80, 120]);
        assert_eq!(
            index_ms(&[3_000_000_000, 2000, 42_000]),
            index_ms(&[1_000_000_000, 2000, 42_000])
        );
        assert_eq!(index_ms(&[1_000_000_000, 2000, 42_000]), [0, 40, 80]);
    }
}
