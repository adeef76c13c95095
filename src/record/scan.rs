//! One revolution of a scanner: ranges and remissions at equally spaced beam angles.

use super::columns::{Record, Value, ValueError, Visit, VisitMut};
use super::text;
use super::time::Stamp;
use super::{Presence, columns};
use serde::Serialize;
use std::ops::{Deref, DerefMut};

/// The most echoes that a scan can hold (LMS5xx PRO: five).
const MAX_ECHOES: usize = 5;

/// One scan of a 2D laser scanner.
///
/// Beam `i` points at `angle_min_rad + i * angle_increment_rad` in the scan plane of S, whose
/// direction vector is `[0, cos, sin]` (Kurniawan 2017, eq. 3.14 to 3.16), and fires
/// `i * time_increment_s` after `stamp`.
#[derive(Clone, Debug, PartialEq)]
pub struct Scan {
    /// When the first beam was fired, on the host's clock.
    pub stamp: Stamp,
    /// Host clock when the last byte had arrived.
    pub received: Option<Stamp>,
    /// The device's own clock, unwrapped: for a scanner that stamps its zero index, at that index
    /// (a constant time before `stamp`).
    pub device: Option<Stamp>,
    /// Running number; a gap is a lost scan.
    pub seq: u32,
    /// Angle of the first beam, rad.
    pub angle_min_rad: f64,
    /// Angle from beam to beam, rad.
    pub angle_increment_rad: f64,
    /// Time from beam to beam, s.
    pub time_increment_s: f64,
    /// Time from scan to scan, s.
    pub scan_time_s: f64,
    /// Smallest range the device can measure, m.
    pub range_min_m: f64,
    /// Largest range the device can measure, m.
    pub range_max_m: f64,
    /// First echo (or the only one): range a beam, m. No return is `inf`, an invalid one NaN, too
    /// close `-inf` (ROS REP 117). Carried through the streams to 1 um.
    pub ranges_m: Ranges,
    /// Remission a beam, in the device's digits; empty where the device sent none.
    pub remissions: Vec<f32>,
    /// Ranges of echoes 2 to 5, as far as the device sent them.
    pub further_ranges_m: Vec<Ranges>,
    /// Remissions of echoes 2 to 5.
    pub further_remissions: Vec<Vec<f32>>,
    /// What else the device's telegram said.
    pub info: Option<Box<ScanInfo>>,
}

impl Default for Scan {
    fn default() -> Self {
        Scan {
            stamp: Stamp::default(),
            received: None,
            device: None,
            seq: 0,
            angle_min_rad: f64::NAN,
            angle_increment_rad: f64::NAN,
            time_increment_s: f64::NAN,
            scan_time_s: f64::NAN,
            range_min_m: f64::NAN,
            range_max_m: f64::NAN,
            ranges_m: Ranges::default(),
            remissions: Vec::new(),
            further_ranges_m: Vec::new(),
            further_remissions: Vec::new(),
            info: None,
        }
    }
}

impl Scan {
    /// Number of beams.
    pub fn beams(&self) -> usize {
        self.ranges_m.len()
    }

    /// Angle of beam `i` in the scan plane, rad.
    pub fn angle_rad(&self, i: usize) -> f64 {
        self.angle_min_rad + i as f64 * self.angle_increment_rad
    }

    /// Leaves no empty echo at the end of the further ones.
    pub(crate) fn drop_absent_echoes(&mut self) {
        while self.further_ranges_m.last().is_some_and(|r| r.is_empty()) {
            self.further_ranges_m.pop();
        }
        while self.further_remissions.last().is_some_and(Vec::is_empty) {
            self.further_remissions.pop();
        }
    }
}

/// An encoder's block in a telegram.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Encoder {
    /// Position, ticks.
    pub position: u32,
    /// Speed, ticks/mm.
    pub speed: u16,
}

/// The fields of an LMDscandata telegram that a scan itself does not carry.
#[derive(Clone, Debug, PartialEq)]
pub struct ScanInfo {
    /// When the complete scan went to the output buffer, on the device's clock, unwrapped.
    pub transmit: Option<Stamp>,
    /// Telegrams given to the interface; wraps at 65536.
    pub telegram_counter: Option<u32>,
    /// Scans made; wraps at 65536.
    pub scan_counter: Option<u32>,
    /// Device status, low byte first as sent: bit 0 error, bit 1 contamination warning, bit 2
    /// contamination error.
    pub device_status: Option<u32>,
    /// Digital inputs.
    pub inputs: Option<u32>,
    /// Digital outputs.
    pub outputs: Option<u32>,
    /// Encoders: position (ticks) and speed (ticks/mm) of each, one after the other.
    pub encoder: Vec<i64>,
    /// Telegram version.
    pub version: Option<u32>,
    /// Device number.
    pub device_number: Option<u32>,
    /// Serial number.
    pub serial_number: Option<u32>,
    /// Layer angle or reserved word, as sent.
    pub layer: Option<u32>,
    /// Nominal scan frequency, Hz.
    pub scan_frequency_hz: f64,
    /// Shots a second, Hz.
    pub measurement_frequency_hz: f64,
    /// Factor from raw values to millimetres.
    pub scale: f64,
    /// Offset of raw values, mm.
    pub offset_mm: f64,
    /// Start angle as sent, 1e-4 deg.
    pub start_angle_raw: Vec<i64>,
    /// Angular step as sent (rounded by the device), 1e-4 deg.
    pub angular_step_raw: Option<u32>,
    /// Position block: x, y, z, rotation about x, y, z, rotation type.
    pub position: Vec<f64>,
    /// The device's name.
    pub device_name: String,
    /// The comment.
    pub comment: String,
    /// The device's calendar time at transmission, as nanoseconds since the epoch.
    pub device_time: Option<Stamp>,
    /// Encoder event: encoder position, time in us, angle in 1e-4 deg.
    pub event: Vec<i64>,
}

impl Default for ScanInfo {
    fn default() -> Self {
        ScanInfo {
            transmit: None,
            telegram_counter: None,
            scan_counter: None,
            device_status: None,
            inputs: None,
            outputs: None,
            encoder: Vec::new(),
            version: None,
            device_number: None,
            serial_number: None,
            layer: None,
            scan_frequency_hz: f64::NAN,
            measurement_frequency_hz: f64::NAN,
            scale: f64::NAN,
            offset_mm: f64::NAN,
            start_angle_raw: Vec::new(),
            angular_step_raw: None,
            position: Vec::new(),
            device_name: String::new(),
            comment: String::new(),
            device_time: None,
            event: Vec::new(),
        }
    }
}

macro_rules! info_columns {
    ($visitor:ident, $info:expr, $($ref:tt)+) => {
        info_columns!(@ $visitor, $info, [$($ref)+],
            "transmit_ns" transmit, "telegram_counter" telegram_counter,
            "scan_counter" scan_counter, "device_status" device_status, "inputs" inputs,
            "outputs" outputs, "encoder" encoder, "version" version,
            "device_number" device_number, "serial_number" serial_number, "layer" layer,
            "scan_frequency_hz" scan_frequency_hz,
            "measurement_frequency_hz" measurement_frequency_hz, "scale" scale,
            "offset_mm" offset_mm, "start_angle_raw" start_angle_raw,
            "angular_step_raw" angular_step_raw, "position" position,
            "device_name" device_name, "comment" comment, "device_time_ns" device_time,
            "event" event)
    };
    (@ $visitor:ident, $info:expr, $ref:tt, $($name:literal $field:ident),*) => {
        $(info_columns!(# $visitor, $info, $ref, $name, $field);)*
    };
    (# $visitor:ident, $info:expr, [$($ref:tt)+], $name:literal, $field:ident) => {
        $visitor.column($name, Presence::Extra, $($ref)+ $info.$field)?
    };
}

impl ScanInfo {
    /// Shows every column.
    pub fn visit<V: Visit>(&self, visitor: &mut V) -> Result<(), V::Error> {
        info_columns!(visitor, self, &);
        Ok(())
    }

    /// Lets every column be filled.
    pub fn visit_mut<V: VisitMut>(&mut self, visitor: &mut V) -> Result<(), V::Error> {
        info_columns!(visitor, self, &mut);
        Ok(())
    }

    /// Whether no field has a value.
    pub fn is_missing(&self) -> bool {
        struct AnyPresent;
        impl Visit for AnyPresent {
            type Error = ();
            fn column<T: Value>(&mut self, _: &'static str, _: Presence, v: &T) -> Result<(), ()> {
                if v.is_missing() { Ok(()) } else { Err(()) }
            }
        }
        self.visit(&mut AnyPresent).is_ok()
    }

    /// The encoders' blocks.
    pub fn encoders(&self) -> impl Iterator<Item = Encoder> + '_ {
        self.encoder.chunks_exact(2).map(|pair| Encoder {
            position: pair[0] as u32,
            speed: pair[1] as u16,
        })
    }
}

/// Ranges, m. In CSV they are one field in millimetres, because text in metres is five times
/// slower to read and 60 % larger.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Ranges(pub Vec<f64>);

impl Deref for Ranges {
    type Target = Vec<f64>;
    fn deref(&self) -> &Vec<f64> {
        &self.0
    }
}

impl DerefMut for Ranges {
    fn deref_mut(&mut self) -> &mut Vec<f64> {
        &mut self.0
    }
}

impl From<Vec<f64>> for Ranges {
    fn from(ranges_m: Vec<f64>) -> Ranges {
        Ranges(ranges_m)
    }
}

impl FromIterator<f64> for Ranges {
    fn from_iter<I: IntoIterator<Item = f64>>(ranges_m: I) -> Ranges {
        Ranges(ranges_m.into_iter().collect())
    }
}

impl Value for Ranges {
    const ROS_TYPE: &'static str = "float32[]";
    type Wire = Vec<f32>;
    fn is_missing(&self) -> bool {
        self.0.is_empty()
    }
    fn push_text(&self, out: &mut Vec<u8>) {
        columns::push_list(out, &self.0, |out, range_m| {
            text::push_range_mm(out, *range_m)
        });
    }
    fn parse_text(&mut self, text: &[u8]) -> Result<(), ValueError> {
        columns::parse_mostly_whole(&mut self.0, text, text::metres, |item| {
            text::parse_range_mm(item).ok_or(ValueError::Not("a list of ranges in mm"))
        })
    }
    fn to_wire(&self) -> impl Serialize {
        self.0
            .iter()
            .map(|range_m| *range_m as f32)
            .collect::<Vec<f32>>()
    }
    fn from_wire(wire: Vec<f32>) -> Ranges {
        Ranges(wire.into_iter().map(f64::from).collect())
    }
    fn items(&self) -> Option<usize> {
        Some(self.0.len())
    }
}

/// The columns of [`Scan::further_ranges_m`].
pub(crate) const FURTHER_RANGES: [&str; MAX_ECHOES - 1] =
    ["ranges_2_mm", "ranges_3_mm", "ranges_4_mm", "ranges_5_mm"];
/// The columns of [`Scan::further_remissions`].
pub(crate) const FURTHER_REMISSIONS: [&str; MAX_ECHOES - 1] = [
    "remissions_2",
    "remissions_3",
    "remissions_4",
    "remissions_5",
];

impl Record for Scan {
    const KIND: &'static str = "scan";

    fn stamp(&self) -> Stamp {
        self.stamp
    }

    fn visit<V: Visit>(&self, v: &mut V) -> Result<(), V::Error> {
        use Presence::{Extra, Optional, Required};
        v.column("stamp_ns", Required, &self.stamp)?;
        v.column("received_ns", Optional, &self.received)?;
        v.column("device_ns", Optional, &self.device)?;
        v.column("seq", Required, &self.seq)?;
        v.column("angle_min_rad", Required, &self.angle_min_rad)?;
        v.column("angle_increment_rad", Required, &self.angle_increment_rad)?;
        v.column("time_increment_s", Required, &self.time_increment_s)?;
        v.column("scan_time_s", Optional, &self.scan_time_s)?;
        v.column("range_min_m", Optional, &self.range_min_m)?;
        v.column("range_max_m", Optional, &self.range_max_m)?;
        v.column("ranges_mm", Required, &self.ranges_m)?;
        v.column("remissions", Optional, &self.remissions)?;
        let (no_ranges, no_remissions) = (Ranges::default(), Vec::new());
        for (k, name) in FURTHER_RANGES.iter().enumerate() {
            let ranges_m = self.further_ranges_m.get(k).unwrap_or(&no_ranges);
            v.column(name, Extra, ranges_m)?;
        }
        for (k, name) in FURTHER_REMISSIONS.iter().enumerate() {
            v.column(
                name,
                Extra,
                self.further_remissions.get(k).unwrap_or(&no_remissions),
            )?;
        }
        match &self.info {
            Some(info) => info.visit(v),
            None => ScanInfo::default().visit(v),
        }
    }

    fn visit_mut<V: VisitMut>(&mut self, v: &mut V) -> Result<(), V::Error> {
        use Presence::{Extra, Optional, Required};
        v.column("stamp_ns", Required, &mut self.stamp)?;
        v.column("received_ns", Optional, &mut self.received)?;
        v.column("device_ns", Optional, &mut self.device)?;
        v.column("seq", Required, &mut self.seq)?;
        v.column("angle_min_rad", Required, &mut self.angle_min_rad)?;
        v.column(
            "angle_increment_rad",
            Required,
            &mut self.angle_increment_rad,
        )?;
        v.column("time_increment_s", Required, &mut self.time_increment_s)?;
        v.column("scan_time_s", Optional, &mut self.scan_time_s)?;
        v.column("range_min_m", Optional, &mut self.range_min_m)?;
        v.column("range_max_m", Optional, &mut self.range_max_m)?;
        v.column("ranges_mm", Required, &mut self.ranges_m)?;
        v.column("remissions", Optional, &mut self.remissions)?;
        self.further_ranges_m
            .resize(MAX_ECHOES - 1, Ranges::default());
        for (name, ranges_m) in FURTHER_RANGES.iter().zip(&mut self.further_ranges_m) {
            v.column(name, Extra, ranges_m)?;
        }
        self.further_remissions.resize(MAX_ECHOES - 1, Vec::new());
        for (name, remissions) in FURTHER_REMISSIONS.iter().zip(&mut self.further_remissions) {
            v.column(name, Extra, remissions)?;
        }
        self.drop_absent_echoes();
        let info = self.info.get_or_insert_default();
        info.visit_mut(v)?;
        // A stream without a device's columns has no telegram behind it.
        if info.is_missing() {
            self.info = None;
        }
        Ok(())
    }
}
