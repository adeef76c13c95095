//! From what the scanner measures to what a telegram holds, by the configuration: echo filter, mean
//! filter, output rate, output range, remissions.

use super::configuration::Configuration;
use crate::record::Scan;
use crate::sick::angles::{first_angle_deg, true_step_deg};
use crate::sick::scandata::{Channel, LmdScandata, Width};

/// Echoes that the device tells apart.
const ECHOES: usize = 5;
/// The largest distance in 1 mm digits (telegram listing).
const MAX_RAW: f64 = 65_000.0;
/// Raw distances below this are codes: 0 no return, 2 implausible.
const FIRST_DISTANCE: f64 = 16.0;

/// Writes a scan's angles, distances and remissions as the device's channels.
pub fn fill(scan: &Scan, telegram: &mut LmdScandata) {
    let wire = |rad: f64| (rad.to_degrees() * 1e4).round();
    let start_angle = wire(scan.angle_min_rad) as i32;
    let angular_step = wire(scan.angle_increment_rad) as u16;
    let mut channels = std::mem::take(&mut telegram.channels).into_iter();
    let mut next = |kind: &[u8; 4], echo: usize, width| {
        let mut channel = channels.next().unwrap_or_default();
        let [a, b, c, d] = *kind;
        channel.name = [a, b, c, d, b'1' + echo as u8];
        channel.width = width;
        channel.scale = 1.0;
        channel.offset = 0.0;
        channel.start_angle = start_angle;
        channel.angular_step = angular_step;
        channel.values.clear();
        channel
    };
    let ranges = std::iter::once(&scan.ranges_m).chain(&scan.further_ranges_m);
    for (echo, ranges_m) in ranges.take(ECHOES).enumerate() {
        let mut channel = next(b"DIST", echo, Width::Bits16);
        channel.values.extend(ranges_m.iter().map(|m| digits(*m)));
        telegram.channels.push(channel);
    }
    let remissions = std::iter::once(&scan.remissions).chain(&scan.further_remissions);
    for (echo, values) in remissions.take(ECHOES).enumerate() {
        if values.is_empty() {
            continue;
        }
        let mut channel = next(b"RSSI", echo, Width::Bits8);
        let values = values.iter();
        // 255 is dazzled: what is bright stays one below.
        channel
            .values
            .extend(values.map(|value| value.round().clamp(0.0, 254.0) as u16));
        telegram.channels.push(channel);
    }
}

fn digits(range_m: f64) -> u16 {
    let mm = (range_m * 1000.0).round();
    if mm.is_nan() || mm == f64::NEG_INFINITY {
        2
    } else if mm > MAX_RAW {
        0
    } else {
        mm.max(FIRST_DISTANCE) as u16
    }
}

/// Takes scan after scan and gives out those that are sent.
#[derive(Debug, Default)]
pub struct Output {
    /// Scans since one was given out.
    since: i64,
    /// The mean filter's sums over valid distances and over remissions, and their counts.
    sums: Vec<Vec<(u32, u16)>>,
    /// Scans in the sums.
    summed: i64,
    /// Where the summed scans start; interlaced scans cannot be averaged with each other.
    start_angle: i32,
}

impl Output {
    /// Takes one scan; whether `sent` now holds one to send.
    pub fn take(
        &mut self,
        measured: &LmdScandata,
        configuration: &Configuration,
        sent: &mut LmdScandata,
    ) -> bool {
        choose_channels(measured, configuration, sent);
        let mean = match configuration.number("LFPmeanfilter", 0) {
            0 => 1,
            _ => configuration.number("LFPmeanfilter", 1),
        };
        if mean > 1 && !self.average(sent, mean) {
            return false;
        }
        self.since += 1;
        if self.since < configuration.number("LMDscandatacfg", 11) {
            return false;
        }
        self.since = 0;
        let from = configuration.number("LMPoutputRange", 2) as i32;
        let to = configuration.number("LMPoutputRange", 3) as i32;
        sent.channels
            .iter_mut()
            .for_each(|channel| cut(channel, from, to));
        true
    }

    /// Adds a scan to the sums; whether they were full and `scan` is now their mean.
    fn average(&mut self, scan: &mut LmdScandata, over: i64) -> bool {
        let shape = |sums: &[Vec<(u32, u16)>]| sums.iter().map(Vec::len).collect::<Vec<_>>();
        let due: Vec<usize> = scan.channels.iter().map(|c| c.values.len()).collect();
        let start_angle = scan.channels.first().map_or(0, |c| c.start_angle);
        if self.summed == 0 || shape(&self.sums) != due || self.start_angle != start_angle {
            self.sums = due.iter().map(|n| vec![(0, 0); *n]).collect();
            self.summed = 0;
            self.start_angle = start_angle;
        }
        for (sums, channel) in self.sums.iter_mut().zip(&scan.channels) {
            let is_distance = channel.name.starts_with(b"DIST");
            for (sum, value) in sums.iter_mut().zip(&channel.values) {
                if !is_distance || f64::from(*value) >= FIRST_DISTANCE {
                    *sum = (sum.0 + u32::from(*value), sum.1 + 1);
                }
            }
        }
        self.summed += 1;
        if self.summed < over {
            return false;
        }
        self.summed = 0;
        for (sums, channel) in self.sums.iter().zip(&mut scan.channels) {
            for ((sum, count), value) in sums.iter().zip(&mut channel.values) {
                let count = u32::from(*count);
                *value = (sum + count / 2).checked_div(count).unwrap_or(0) as u16;
            }
        }
        true
    }
}

/// The channels that the echo filter and the remission flag ask for.
fn choose_channels(measured: &LmdScandata, configuration: &Configuration, sent: &mut LmdScandata) {
    let with_remission = configuration.number("LMDscandatacfg", 2) != 0;
    let filter = configuration.number("FREchoFilter", 0);
    let echoes = if filter == 1 { ECHOES } else { 1 };
    let beams = measured.channels.first().map_or(0, |c| c.values.len());
    let kinds = [(b"DIST", Width::Bits16), (b"RSSI", Width::Bits8)];
    let mut spare = std::mem::take(&mut sent.channels).into_iter();
    for (kind, width) in kinds.into_iter().take(1 + usize::from(with_remission)) {
        for echo in 1..=echoes {
            let mut channel = spare.next().unwrap_or_default();
            let [a, b, c, d] = *kind;
            channel.name = [a, b, c, d, b'0' + echo as u8];
            channel.width = width;
            let first = measured.channels.first();
            channel.scale = 1.0;
            channel.offset = 0.0;
            if let (Some(first), Width::Bits16) = (first, width) {
                (channel.scale, channel.offset) = (first.scale, first.offset);
            }
            channel.start_angle = first.map_or(0, |first| first.start_angle);
            channel.angular_step = first.map_or(0, |first| first.angular_step);
            channel.values.clear();
            match measured.channel(&channel.name) {
                Some(from) => channel.values.extend_from_slice(&from.values),
                None => channel.values.resize(beams, 0),
            }
            sent.channels.push(channel);
        }
    }
    if filter == 2 {
        keep_last_echo(measured, sent);
    }
}

/// Puts the last echo of each beam into the only channels.
fn keep_last_echo(measured: &LmdScandata, sent: &mut LmdScandata) {
    for echo in 2..=ECHOES as u8 {
        let Some(distances) = measured.channel(&[b'D', b'I', b'S', b'T', b'0' + echo]) else {
            return;
        };
        let remissions = measured.channel(&[b'R', b'S', b'S', b'I', b'0' + echo]);
        for (beam, distance) in distances.values.iter().enumerate() {
            if *distance == 0 {
                continue;
            }
            let remission = remissions.and_then(|channel| channel.values.get(beam).copied());
            let values = [Some(*distance), remission];
            for (channel, value) in sent.channels.iter_mut().zip(values) {
                if let (Some(place), Some(value)) = (channel.values.get_mut(beam), value) {
                    *place = value;
                }
            }
        }
    }
}

/// Leaves the beams of an output range, 1e-4 deg, its ends included.
fn cut(channel: &mut Channel, from: i32, to: i32) {
    let step_deg = true_step_deg(channel.angular_step);
    let start_deg = first_angle_deg(channel.start_angle, step_deg);
    // Angles on the wire are rounded.
    let (from_deg, to_deg) = (f64::from(from) * 1e-4 - 1e-4, f64::from(to) * 1e-4 + 1e-4);
    if step_deg <= 0.0 {
        return;
    }
    let first = ((from_deg - start_deg) / step_deg).ceil().max(0.0) as usize;
    let end = ((to_deg - start_deg) / step_deg).floor() + 1.0;
    channel.values.truncate(end.max(0.0) as usize);
    let first = first.min(channel.values.len());
    if first > 0 {
        channel.values.drain(..first);
        let start_deg = start_deg + first as f64 * step_deg;
        channel.start_angle = (start_deg * 1e4).round() as i32;
    }
}
