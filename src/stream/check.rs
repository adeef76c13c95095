//! When a record that could be read is still not a good one.

use crate::record::{
    BeamFate, ClockExchange, DelayPoint, FURTHER_RANGES, FURTHER_REMISSIONS, ImuSample,
    POSE_COLUMNS, Pose, Presence, Record, ReflectorLines, Scan, Segment, Status, TrajectoryPoint,
    Value, ValueError,
};
use std::fmt;

/// A record's fault: the column, and what is wrong with it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BadField {
    column: Option<&'static str>,
    why: String,
}

impl BadField {
    /// A fault of one column.
    pub(super) fn new(column: &'static str, why: impl Into<String>) -> BadField {
        BadField {
            column: Some(column),
            why: why.into(),
        }
    }

    /// A fault of the whole row.
    pub(super) fn row(why: impl Into<String>) -> BadField {
        BadField {
            column: None,
            why: why.into(),
        }
    }

    /// Text that is not a value; what is shown of it is kept short.
    pub(super) fn text(column: &'static str, error: &ValueError, text: &[u8]) -> BadField {
        const SHOWN: usize = 40;
        let why = if *error == ValueError::Empty {
            error.to_string()
        } else if text.len() > SHOWN {
            let item = culprit(text);
            format!("{error}: \"{}\"", item.escape_debug())
        } else {
            let text = String::from_utf8_lossy(text);
            format!("{error}: \"{}\"", text.escape_debug())
        };
        BadField::new(column, why)
    }
}

/// The item of a long list of numbers that is not one; of another text, its beginning.
fn culprit(text: &[u8]) -> String {
    let number =
        |item: &[u8]| std::str::from_utf8(item).is_ok_and(|item| item.parse::<f64>().is_ok());
    let mut items = text.split(|b| *b == b' ');
    let item = match items.next() {
        Some(first) if number(first) => items.find(|item| !number(item)).unwrap_or(text),
        _ => text,
    };
    String::from_utf8_lossy(&item[..item.len().min(40)]).into_owned()
}

impl fmt::Display for BadField {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.column {
            Some(column) => write!(f, "{column}: {}", self.why),
            None => f.write_str(&self.why),
        }
    }
}

/// A record that the streams carry: what makes one good, beyond its columns.
pub trait StreamRecord: Record + super::ros2::Messages + Send + 'static {
    /// Prefix of list columns that must all be equally long.
    const PARALLEL_LISTS: Option<&'static str> = None;

    /// Whether the values make sense together.
    fn check(&self) -> Result<(), BadField>;

    /// How the record divides its plane into beams, if it does.
    fn raster(&self) -> Option<Raster> {
        None
    }
}

/// The beams of a scan.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Raster {
    /// Angle of the first beam, rad.
    pub angle_min_rad: f64,
    /// Angle from beam to beam, rad.
    pub angle_increment_rad: f64,
    /// Number of ranges.
    pub ranges: usize,
}

/// Checks the records of one stream, each by itself and against those before it: the same angles
/// must come with the same number of ranges.
#[derive(Default)]
pub(super) struct Checks {
    /// What has been seen of the present angles.
    raster: Option<Raster>,
    /// Whether a second scan has agreed with it.
    confirmed: bool,
    /// Another number of ranges, seen before one was confirmed: the first scan may be the bad one.
    rival: Option<usize>,
}

impl Checks {
    pub(super) fn check<R: StreamRecord>(&mut self, record: &R) -> Result<(), BadField> {
        record.check()?;
        match record.raster() {
            Some(raster) => self.compare(raster),
            None => Ok(()),
        }
    }

    fn compare(&mut self, found: Raster) -> Result<(), BadField> {
        let Some(wanted) = self.raster.filter(|known| {
            known.angle_min_rad == found.angle_min_rad
                && known.angle_increment_rad == found.angle_increment_rad
        }) else {
            *self = Checks {
                raster: Some(found),
                ..Checks::default()
            };
            return Ok(());
        };
        let ranges = found.ranges;
        if ranges == wanted.ranges || self.rival == Some(ranges) {
            *self = Checks {
                raster: Some(found),
                confirmed: true,
                rival: None,
            };
            return Ok(());
        }
        if !self.confirmed {
            self.rival = Some(ranges);
        }
        let why = format!(
            "{ranges} ranges where the scans before, of the same angles, have {}",
            wanted.ranges
        );
        Err(BadField::new("ranges_mm", why))
    }
}

/// No scanner measures so far, m.
const FARTHEST_M: f64 = 1000.0;

/// A range is a length or one of the markers `inf`, NaN and `-inf`.
fn lengths(column: &'static str, ranges_m: &[f64]) -> Result<(), BadField> {
    let bad = |r: &&f64| r.is_finite() && !(0.0..=FARTHEST_M).contains(*r);
    // Counting goes through all of them without a branch, several at a time.
    if ranges_m.iter().filter(bad).count() == 0 {
        return Ok(());
    }
    match ranges_m.iter().find(bad) {
        None => Ok(()),
        Some(range_m) => {
            let (range_mm, most_mm) = (range_m * 1e3, FARTHEST_M * 1e3);
            let why = format!("{range_mm} mm is no range: 0 to {most_mm} mm, inf, nan or -inf");
            Err(BadField::new(column, why))
        }
    }
}

/// Compares the lengths of parallel lists as they come by.
pub(super) struct ListLengths {
    prefix: Option<&'static str>,
    first: Option<(&'static str, usize)>,
}

impl ListLengths {
    pub(super) fn new(prefix: Option<&'static str>) -> Self {
        ListLengths {
            prefix,
            first: None,
        }
    }

    /// An optional list may be empty; everything else must be as long as the first list.
    pub(super) fn see<T: Value>(
        &mut self,
        name: &'static str,
        presence: Presence,
        value: &T,
    ) -> Result<(), BadField> {
        let Some(items) = value.items() else {
            return Ok(());
        };
        if !self.prefix.is_some_and(|prefix| name.starts_with(prefix)) {
            return Ok(());
        }
        match self.first {
            None => self.first = Some((name, items)),
            Some((_, wanted)) if items == wanted => {}
            Some(_) if items == 0 && presence != Presence::Required => {}
            Some((first, wanted)) => {
                return Err(BadField::new(
                    name,
                    format!("{items} items where {first} has {wanted}"),
                ));
            }
        }
        Ok(())
    }
}

fn finite(values: impl IntoIterator<Item = (&'static str, f64)>) -> Result<(), BadField> {
    match values.into_iter().find(|(_, value)| !value.is_finite()) {
        Some((column, value)) if value.is_nan() => Err(BadField::new(column, "empty")),
        Some((column, _)) => Err(BadField::new(column, "not finite")),
        None => Ok(()),
    }
}

impl StreamRecord for Scan {
    fn check(&self) -> Result<(), BadField> {
        finite([
            ("angle_min_rad", self.angle_min_rad),
            ("angle_increment_rad", self.angle_increment_rad),
            ("time_increment_s", self.time_increment_s),
        ])?;
        if self.angle_increment_rad <= 0.0 {
            let why = format!("{} is not above 0", self.angle_increment_rad);
            return Err(BadField::new("angle_increment_rad", why));
        }
        let beams = self.beams();
        if beams == 0 {
            return Err(BadField::new("ranges_mm", "empty"));
        }
        lengths("ranges_mm", &self.ranges_m)?;
        let same = |column, items: usize| {
            if items == beams || items == 0 {
                return Ok(());
            }
            let why = format!("{items} items where ranges_mm has {beams}");
            Err(BadField::new(column, why))
        };
        same("remissions", self.remissions.len())?;
        for (column, ranges_m) in FURTHER_RANGES.into_iter().zip(&self.further_ranges_m) {
            same(column, ranges_m.len())?;
            lengths(column, ranges_m)?;
        }
        let further = FURTHER_REMISSIONS.into_iter();
        for (column, remissions) in further.zip(&self.further_remissions) {
            same(column, remissions.len())?;
        }
        Ok(())
    }

    fn raster(&self) -> Option<Raster> {
        Some(Raster {
            angle_min_rad: self.angle_min_rad,
            angle_increment_rad: self.angle_increment_rad,
            ranges: self.beams(),
        })
    }
}

impl StreamRecord for ImuSample {
    fn check(&self) -> Result<(), BadField> {
        Ok(())
    }
}

impl StreamRecord for ReflectorLines {
    const PARALLEL_LISTS: Option<&'static str> = Some("edge_");

    fn check(&self) -> Result<(), BadField> {
        match self.joint_cov.len() {
            0 | 28 => Ok(()),
            items => {
                let why = format!("{items} items where a 7 by 7 covariance has 28");
                Err(BadField::new("joint_cov", why))
            }
        }
    }
}

impl StreamRecord for Pose {
    /// A number may be missing only where the status says that something is.
    fn check(&self) -> Result<(), BadField> {
        let components = self.components();
        if components.iter().all(|v| v.is_nan()) {
            return if self.status.has(Status::NO_POSE) {
                Ok(())
            } else {
                Err(BadField::new("x_m", "empty, and the status is not no-pose"))
            };
        }
        for (column, value) in POSE_COLUMNS.into_iter().zip(components) {
            if value.is_infinite() {
                return Err(BadField::new(column, "not finite"));
            }
            if value.is_nan() && self.status.is_ok() {
                return Err(BadField::new(column, "empty, and the status is ok"));
            }
        }
        Ok(())
    }
}

impl StreamRecord for TrajectoryPoint {
    fn check(&self) -> Result<(), BadField> {
        let components = self.position_m.iter().chain(&self.rotation_rad);
        finite(POSE_COLUMNS.into_iter().zip(components.copied()))
    }
}

impl StreamRecord for Segment {
    fn check(&self) -> Result<(), BadField> {
        finite([
            ("d_m", self.normal.d_m),
            ("alpha_rad", self.normal.alpha_rad),
        ])
    }
}

impl StreamRecord for BeamFate {
    fn check(&self) -> Result<(), BadField> {
        finite([("angle_rad", self.angle_rad)])
    }
}

impl StreamRecord for DelayPoint {
    fn check(&self) -> Result<(), BadField> {
        finite([("delay_s", self.delay_s)])
    }
}

impl StreamRecord for ClockExchange {
    fn check(&self) -> Result<(), BadField> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Which of these numbers of ranges, one a scan, are reported.
    fn reported(ranges: &[usize]) -> Vec<usize> {
        let mut checks = Checks::default();
        let raster = |ranges| Raster {
            angle_min_rad: -0.1,
            angle_increment_rad: 0.004,
            ranges,
        };
        let bad = ranges
            .iter()
            .enumerate()
            .filter(|(_, n)| checks.compare(raster(**n)).is_err());
        bad.map(|(i, _)| i).collect()
    }

    #[test]
    fn one_stream_has_one_number_of_ranges() {
        assert_eq!(reported(&[9, 9, 9]), [0; 0]);
        assert_eq!(reported(&[9, 8, 9, 9]), [1]);
        assert_eq!(reported(&[9, 9, 8, 8, 8, 9]), [2, 3, 4]);
        // A first scan that is wrong cannot be known: the second is reported, and no other.
        assert_eq!(reported(&[8, 9, 9, 9, 8]), [1, 4]);
    }

    #[test]
    fn other_angles_may_have_another_number() {
        let mut checks = Checks::default();
        let mut raster = Raster {
            angle_min_rad: -0.1,
            angle_increment_rad: 0.004,
            ranges: 9,
        };
        assert!(checks.compare(raster).is_ok());
        raster.angle_increment_rad = 0.002;
        raster.ranges = 17;
        assert!(checks.compare(raster).is_ok());
        raster.ranges = 16;
        let bad = checks.compare(raster).unwrap_err().to_string();
        assert!(bad.starts_with("ranges_mm: 16 ranges where"), "{bad}");
        assert!(bad.ends_with("have 17"), "{bad}");
    }

    #[test]
    fn a_scan_has_ranges_and_an_increment_that_can_be() {
        let good = crate::stream::samples::scan();
        assert_eq!(good.check(), Ok(()));
        for range_m in [-0.001, 1000.001, -1e30] {
            let mut scan = good.clone();
            scan.ranges_m[1] = range_m;
            let bad = scan.check().unwrap_err().to_string();
            assert!(bad.starts_with("ranges_mm: "), "{bad}");
        }
        for increment in [0.0, -0.004, f64::NAN, f64::INFINITY] {
            let mut scan = good.clone();
            scan.angle_increment_rad = increment;
            let bad = scan.check().unwrap_err().to_string();
            assert!(bad.starts_with("angle_increment_rad: "), "{bad}");
        }
    }
}
