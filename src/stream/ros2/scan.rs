//! A scan: `/scan_info`, `/scan_echo2` and further ones, then `/scan`, which completes it.

use super::types::{Header, LASER, LaserScanHead, Time};
use super::{Bodies, MARKERS, Message, Messages, TF_STATIC, Topic, definitions};
use crate::record::{Ranges, Scan, Stamp, text};
use crate::stream::check::BadField;
use crate::stream::{Role, cdr};

static SCAN_INFO: Topic = Topic {
    name: "/scan_info",
    type_name: "cablepose_msgs/msg/ScanInfo",
    definition: |_| definitions::of_columns::<Scan>(is_info),
};
static SCAN: Topic = Topic::standard("/scan", "sensor_msgs/msg/LaserScan");
static ECHOES: [Topic; 4] = [
    Topic::standard("/scan_echo2", "sensor_msgs/msg/LaserScan"),
    Topic::standard("/scan_echo3", "sensor_msgs/msg/LaserScan"),
    Topic::standard("/scan_echo4", "sensor_msgs/msg/LaserScan"),
    Topic::standard("/scan_echo5", "sensor_msgs/msg/LaserScan"),
];
static READ: [&Topic; 6] = [
    &SCAN_INFO, &ECHOES[0], &ECHOES[1], &ECHOES[2], &ECHOES[3], &SCAN,
];
static WRITTEN: [&Topic; 8] = [
    &SCAN_INFO, &ECHOES[0], &ECHOES[1], &ECHOES[2], &ECHOES[3], &SCAN, &TF_STATIC, &MARKERS,
];

/// The columns that a LaserScan cannot hold, or not exactly: all but ranges and remissions.
fn is_info(column: &str) -> bool {
    !column.starts_with("ranges") && !column.starts_with("remissions")
}

/// What has come of a scan before its `/scan`.
#[derive(Debug, Default)]
pub struct ScanParts {
    info: Option<Time>,
    echoes: [Option<Time>; 4],
}

impl Messages for Scan {
    type Parts = ScanParts;

    fn read_from(_: Role) -> &'static [&'static Topic] {
        &READ
    }

    fn written_to(_: Role) -> &'static [&'static Topic] {
        &WRITTEN
    }

    fn encode(&self, _: Role, out: &mut Bodies) -> Result<(), BadField> {
        out.sequence = Some(self.seq);
        out.received = self.received;
        out.add(&SCAN_INFO, |out| cdr::encode_columns(out, self, is_info))?;
        let (no_ranges, no_remissions) = (Ranges::default(), Vec::new());
        for (k, topic) in ECHOES.iter().enumerate() {
            let ranges_m = self.further_ranges_m.get(k).unwrap_or(&no_ranges);
            let remissions = self.further_remissions.get(k).unwrap_or(&no_remissions);
            if !ranges_m.is_empty() || !remissions.is_empty() {
                out.add(topic, |out| encode_echo(out, self, ranges_m, remissions))?;
            }
        }
        out.add(&SCAN, |out| {
            encode_echo(out, self, &self.ranges_m, &self.remissions)
        })
    }

    fn decode(
        &mut self,
        topic: &'static Topic,
        message: Message<'_>,
        parts: &mut ScanParts,
    ) -> Result<bool, BadField> {
        if topic.name == SCAN_INFO.name {
            parts.info = None;
            cdr::decode_columns(message.body, self, is_info, None)?;
            parts.info = Some(self.stamp.into());
            return Ok(false);
        }
        let (head, mut tail) = cdr::decode::<LaserScanHead>(message.body)?;
        if let Some(k) = ECHOES.iter().position(|echo| echo.name == topic.name) {
            parts.echoes[k] = None;
            self.further_ranges_m
                .resize_with(ECHOES.len(), Ranges::default);
            self.further_remissions.resize_with(ECHOES.len(), Vec::new);
            decode_echo(
                &mut tail,
                &mut self.further_ranges_m[k],
                &mut self.further_remissions[k],
            )?;
            parts.echoes[k] = Some(head.header.stamp);
            return Ok(false);
        }
        decode_echo(&mut tail, &mut self.ranges_m, &mut self.remissions)?;
        if parts.info.take() != Some(head.header.stamp) {
            take_head(self, &head, message.sequence);
        }
        drop_foreign_echoes(self, parts, head.header.stamp);
        Ok(true)
    }
}

/// The scan's own columns from a LaserScan that no `/scan_info` came with.
fn take_head(scan: &mut Scan, head: &LaserScanHead, sequence: u32) {
    scan.stamp = Stamp::from(head.header.stamp);
    scan.received = None;
    scan.device = None;
    scan.seq = sequence;
    scan.angle_min_rad = f64::from(head.angle_min);
    scan.angle_increment_rad = f64::from(head.angle_increment);
    scan.time_increment_s = f64::from(head.time_increment);
    scan.scan_time_s = f64::from(head.scan_time);
    scan.range_min_m = metres(head.range_min);
    scan.range_max_m = metres(head.range_max);
    scan.info = None;
}

/// Drops the echoes that belong to another scan.
fn drop_foreign_echoes(scan: &mut Scan, parts: &mut ScanParts, stamp: Time) {
    for (k, echo) in parts.echoes.iter_mut().enumerate() {
        if echo.take() == Some(stamp) {
            continue;
        }
        if let Some(ranges_m) = scan.further_ranges_m.get_mut(k) {
            ranges_m.clear();
        }
        if let Some(remissions) = scan.further_remissions.get_mut(k) {
            remissions.clear();
        }
    }
    scan.drop_absent_echoes();
}

fn encode_echo(
    out: &mut Vec<u8>,
    scan: &Scan,
    ranges_m: &Ranges,
    remissions: &[f32],
) -> Result<(), BadField> {
    let start = out.len();
    let last = scan.beams().saturating_sub(1);
    cdr::encode(
        out,
        &LaserScanHead {
            header: Header::new(scan.stamp, LASER),
            angle_min: scan.angle_min_rad as f32,
            angle_max: scan.angle_rad(last) as f32,
            angle_increment: scan.angle_increment_rad as f32,
            time_increment: scan.time_increment_s as f32,
            scan_time: scan.scan_time_s as f32,
            range_min: scan.range_min_m as f32,
            range_max: scan.range_max_m as f32,
        },
    )?;
    cdr::push_f32s(
        out,
        start,
        ranges_m.iter().map(|range_m| float_metres(*range_m)),
    );
    cdr::push_f32s(out, start, remissions.iter().copied());
    Ok(())
}

fn decode_echo(
    tail: &mut cdr::Tail<'_>,
    ranges_m: &mut Ranges,
    remissions: &mut Vec<f32>,
) -> Result<(), BadField> {
    let ranges = tail.f32s()?;
    ranges_m.clear();
    // Nearly all are whole millimetres: a first loop without branches takes them so, and a second
    // one finds those that are not.
    ranges_m.extend(ranges.clone().map(whole_millimetres));
    for (range_m, range) in ranges_m.iter_mut().zip(ranges) {
        if *range_m as f32 != range {
            *range_m = metres(range);
        }
    }
    remissions.clear();
    remissions.extend(tail.f32s()?);
    Ok(())
}

/// Beyond this a float32 is coarser than the micrometre that ranges are carried to.
const EXACT_BELOW_M: f64 = 16.0;

/// A range as the message holds it: rounded to the micrometre first, as CSV has it, so that both
/// encodings give the same range back.
fn float_metres(range_m: f64) -> f32 {
    if range_m.abs() < EXACT_BELOW_M {
        return (text::whole(range_m * 1e6) / 1e6) as f32;
    }
    range_m as f32
}

/// The range that a message's float32 stands for: the whole millimetre that it is nearest to, if
/// it is that millimetre's float32; else rounded to the micrometre.
fn metres(range: f32) -> f64 {
    let range_m = f64::from(range);
    let whole_mm = whole_millimetres(range);
    if whole_mm as f32 == range {
        whole_mm
    } else if range_m.abs() < 1e6 {
        text::whole(range_m * 1e6) / 1e6
    } else {
        range_m
    }
}

/// The whole millimetre nearest to a range, m.
fn whole_millimetres(range: f32) -> f64 {
    text::whole(f64::from(range) * 1e3) / 1e3
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_whole_millimetre_survives() {
        for mm in 0..=80_000u32 {
            let range_m = f64::from(mm) / 1000.0;
            assert_eq!(metres(float_metres(range_m)), range_m);
        }
    }

    #[test]
    fn every_micrometre_survives_up_to_16_m() {
        for um in (0..16_000_000u32).step_by(37) {
            let range_m = f64::from(um) / 1e6;
            assert_eq!(metres(float_metres(range_m)), range_m, "{um}");
        }
    }

    #[test]
    fn what_is_no_distance_survives() {
        assert_eq!(metres(float_metres(f64::INFINITY)), f64::INFINITY);
        assert_eq!(metres(float_metres(f64::NEG_INFINITY)), f64::NEG_INFINITY);
        assert!(metres(float_metres(f64::NAN)).is_nan());
        assert_eq!(metres(3.0e38), f64::from(3.0e38f32));
    }
}
