//! A scan record from one telegram: true angles, ranges, remissions and everything else it says.

use super::angles::{first_angle_deg, true_step_deg};
use super::scandata::{Channel, LmdScandata};
use crate::record::{Ranges, Scan, ScanInfo, Value};
use std::f64::consts::TAU;
use std::ops::RangeInclusive;

/// Raw distances below this are codes.
const FIRST_DISTANCE: u16 = 16;
/// The largest distance an LMS5xx sends: 65 m in 1 mm, 80 m in 2 mm digits.
const MAX_RAW_1MM: f64 = 65_000.0;
const MAX_M_2MM: f64 = 80.0;
/// Echoes that a record can hold.
const MAX_ECHOES: usize = 5;
/// Scales that a channel can have: the devices send 1 and 2, and three decades on either side
/// leave room for others. Outside them, as for NaN, a digit means nothing.
const SCALES: RangeInclusive<f32> = 1e-3..=1e3;
/// A full turn in the wire's unit, 1e-4 deg.
const FULL_TURN: u32 = 3_600_000;

/// Why a telegram that reads well is no scan.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum ScanError {
    /// No distances of a first echo.
    #[error("no channel DIST1")]
    NoDistances,
    /// The channel of the first echo's distances is empty.
    #[error("channel DIST1 has no values")]
    Empty,
    /// A scale that no digit can be multiplied with.
    #[error("channel {}: scale factor {scale} cannot be", String::from_utf8_lossy(.name))]
    Scale {
        /// The channel.
        name: [u8; 5],
        /// Its scale.
        scale: f32,
    },
    /// A scale offset that is not finite.
    #[error("channel {}: scale offset {offset} cannot be", String::from_utf8_lossy(.name))]
    Offset {
        /// The channel.
        name: [u8; 5],
        /// Its offset.
        offset: f32,
    },
    /// All beams at one angle.
    #[error("channel DIST1: angular step 0 cannot be")]
    NoStep,
    /// A start angle beyond a full turn, or beams that reach over more than one.
    #[error(
        "channel DIST1: {beams} beams from {start_angle} by {angular_step} (1e-4 deg) cannot be"
    )]
    Angles {
        /// The number of beams.
        beams: usize,
        /// Angle of the first, 1e-4 deg.
        start_angle: i32,
        /// From beam to beam, 1e-4 deg.
        angular_step: u16,
    },
    /// A channel does not fit the first echo's distances.
    #[error("channel {} has {values} values, DIST1 has {beams}", String::from_utf8_lossy(.name))]
    Mismatch {
        /// The channel.
        name: [u8; 5],
        /// Its number of values.
        values: usize,
        /// The number of beams.
        beams: usize,
    },
}

/// When the beams fire.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BeamTiming {
    /// From scan to scan, s.
    pub period_s: f64,
    /// From the zero index to the beam at the aperture's start, s.
    pub index_to_first_beam_s: f64,
    /// The aperture's start, rad.
    pub aperture_start_rad: f64,
}

impl BeamTiming {
    /// From the zero index to the beam at `angle_min_rad`, the first that the telegram holds, s.
    pub fn first_beam_s(&self, angle_min_rad: f64) -> f64 {
        let cut_off_rad = (angle_min_rad - self.aperture_start_rad).max(0.0);
        // Angles made in two ways may differ by rounding; a period may be unknown.
        if cut_off_rad < 1e-9 || self.period_s.is_nan() {
            return self.index_to_first_beam_s;
        }
        self.index_to_first_beam_s + cut_off_rad / TAU * self.period_s
    }
}

/// Checks that the telegram describes a scan: a valid checksum only says that the bytes came as
/// they were sent.
pub fn check(telegram: &LmdScandata) -> Result<(), ScanError> {
    let first = telegram.channel(b"DIST1").ok_or(ScanError::NoDistances)?;
    check_angles(first)?;
    let measured = telegram
        .channels
        .iter()
        .filter(|channel| is_echo(channel.echo_of(b"DIST")) || is_echo(channel.echo_of(b"RSSI")));
    for channel in measured {
        check_values(channel, first.values.len())?;
    }
    Ok(())
}

fn check_angles(first: &Channel) -> Result<(), ScanError> {
    let (beams, step) = (first.values.len(), first.angular_step);
    if beams == 0 {
        return Err(ScanError::Empty);
    }
    if step == 0 {
        return Err(ScanError::NoStep);
    }
    // The step is rounded on the wire, by up to one unit a beam.
    let reach = (beams as u64 - 1) * u64::from(step - 1);
    if reach > u64::from(FULL_TURN) || first.start_angle.unsigned_abs() > FULL_TURN {
        return Err(ScanError::Angles {
            beams,
            start_angle: first.start_angle,
            angular_step: step,
        });
    }
    Ok(())
}

fn check_values(channel: &Channel, beams: usize) -> Result<(), ScanError> {
    let (name, values) = (channel.name, channel.values.len());
    let (scale, offset) = (channel.scale, channel.offset);
    if values != beams {
        return Err(ScanError::Mismatch {
            name,
            values,
            beams,
        });
    }
    if !SCALES.contains(&scale) {
        return Err(ScanError::Scale { name, scale });
    }
    if !offset.is_finite() {
        return Err(ScanError::Offset { name, offset });
    }
    Ok(())
}

fn is_echo(echo: Option<usize>) -> bool {
    echo.is_some_and(|echo| echo <= MAX_ECHOES)
}

/// Fills a record, whose buffers are reused, with all that one telegram says; its times since
/// start-up, its number and its stamps are left to the caller.
pub fn fill(scan: &mut Scan, telegram: &LmdScandata, timing: BeamTiming, range_min_m: Option<f64>) {
    let Some(first) = telegram.channel(b"DIST1") else {
        return;
    };
    let step_deg = true_step_deg(first.angular_step);
    scan.angle_min_rad = first_angle_deg(first.start_angle, step_deg).to_radians();
    scan.angle_increment_rad = step_deg.to_radians();
    scan.time_increment_s = scan.angle_increment_rad / TAU * timing.period_s;
    scan.scan_time_s = timing.period_s;
    let scale = f64::from(first.scale);
    scan.range_min_m = range_min_m.unwrap_or(f64::from(FIRST_DISTANCE) * scale / 1000.0);
    scan.range_max_m = (MAX_RAW_1MM * scale / 1000.0).min(MAX_M_2MM);

    fill_ranges(first, &mut scan.ranges_m);
    scan.remissions.clear();
    if let Some(channel) = telegram.channel(b"RSSI1") {
        fill_remissions(channel, &mut scan.remissions);
    }
    fill_echoes(scan, telegram);
    fill_info(scan.info.get_or_insert_default(), telegram, first);
}

fn fill_echoes(scan: &mut Scan, telegram: &LmdScandata) {
    let last = |kind| {
        let echoes = telegram.channels.iter().filter_map(|c| c.echo_of(kind));
        echoes.filter(|echo| *echo <= MAX_ECHOES).max().unwrap_or(1)
    };
    scan.further_ranges_m
        .resize_with(last(b"DIST") - 1, Ranges::default);
    scan.further_ranges_m.iter_mut().for_each(|m| m.clear());
    scan.further_remissions
        .resize_with(last(b"RSSI") - 1, Vec::new);
    scan.further_remissions.iter_mut().for_each(Vec::clear);
    for channel in &telegram.channels {
        let further = |kind| channel.echo_of(kind).and_then(|echo| echo.checked_sub(2));
        if let Some(ranges_m) = further(b"DIST").and_then(|k| scan.further_ranges_m.get_mut(k)) {
            fill_ranges(channel, ranges_m);
        }
        if let Some(digits) = further(b"RSSI").and_then(|k| scan.further_remissions.get_mut(k)) {
            fill_remissions(channel, digits);
        }
    }
}

/// Ranges in metres. Raw 0 (no return) is `inf`; 1 (dazzled), 2 (implausible), 3 (filtered) and the
/// reserved values up to 15 are measurements that failed: NaN (REP 117).
fn fill_ranges(channel: &Channel, ranges_m: &mut Vec<f64>) {
    let (scale, offset) = (f64::from(channel.scale), f64::from(channel.offset));
    ranges_m.clear();
    ranges_m.extend(channel.values.iter().map(|raw| {
        let range_m = (f64::from(*raw) * scale + offset) / 1000.0;
        let code = if *raw == 0 { f64::INFINITY } else { f64::NAN };
        if *raw < FIRST_DISTANCE { code } else { range_m }
    }));
}

/// Remissions in the device's digits: 0 is too weak, 255 dazzled (8 bit).
fn fill_remissions(channel: &Channel, digits: &mut Vec<f32>) {
    digits.clear();
    let values = channel.values.iter();
    digits.extend(values.map(|raw| f32::from(*raw) * channel.scale + channel.offset));
}

/// Gives `like` a value in every column in which `scan` has one, so that a CSV header can be chosen
/// that fits both.
pub fn widen(like: &mut Scan, scan: &Scan) {
    if like.further_ranges_m.len() < scan.further_ranges_m.len() {
        like.further_ranges_m.clone_from(&scan.further_ranges_m);
    }
    if like.further_remissions.len() < scan.further_remissions.len() {
        like.further_remissions.clone_from(&scan.further_remissions);
    }
    let Some(from) = &scan.info else { return };
    let Some(to) = &mut like.info else {
        like.info = Some(from.clone());
        return;
    };
    fn take<T: Value>(to: &mut T, from: &T) {
        if to.is_missing() {
            to.clone_from(from);
        }
    }
    take(&mut to.encoder, &from.encoder);
    take(&mut to.position, &from.position);
    take(&mut to.device_name, &from.device_name);
    take(&mut to.comment, &from.comment);
    take(&mut to.device_time, &from.device_time);
    take(&mut to.event, &from.event);
    take(&mut to.scan_frequency_hz, &from.scan_frequency_hz);
}

fn fill_info(info: &mut ScanInfo, telegram: &LmdScandata, first: &Channel) {
    let low_first = |pair: [u8; 2]| Some(u32::from(u16::from_le_bytes(pair)));
    info.transmit = None;
    info.telegram_counter = Some(telegram.telegram_counter.into());
    info.scan_counter = Some(telegram.scan_counter.into());
    info.device_status = low_first(telegram.device_status);
    info.inputs = low_first(telegram.inputs);
    info.outputs = low_first(telegram.outputs);
    info.encoder.clear();
    for encoder in &telegram.encoders {
        info.encoder.push(encoder.position.into());
        info.encoder.push(encoder.speed.into());
    }
    info.version = Some(telegram.version.into());
    info.device_number = Some(telegram.device_number.into());
    info.serial_number = Some(telegram.serial_number);
    info.layer = Some(telegram.layer.into());
    info.scan_frequency_hz = f64::from(telegram.scan_frequency) / 100.0;
    info.measurement_frequency_hz = f64::from(telegram.measurement_frequency) * 100.0;
    info.scale = first.scale.into();
    info.offset_mm = first.offset.into();
    info.start_angle_raw.clear();
    info.start_angle_raw.push(first.start_angle.into());
    info.angular_step_raw = Some(first.angular_step.into());
    info.position.clear();
    if let Some(position) = &telegram.position {
        let coordinates = position.coordinates.iter().copied().map(f64::from);
        info.position.extend(coordinates);
        info.position.push(position.rotation_type.into());
    }
    info.device_name.clone_from(&telegram.device_name);
    info.comment.clone_from(&telegram.comment);
    info.device_time = telegram.time.and_then(|time| time.stamp());
    info.event.clear();
    for event in &telegram.events {
        let fields = [
            event.position.into(),
            event.time_us.into(),
            event.angle.into(),
        ];
        info.event.extend::<[i64; 3]>(fields);
    }
}
