//! What is written to a controller or read from it: quantities, each in its unit.

use super::layout::{LayoutError, Number};
use crate::record::{POSE_STATE, Pose, Stamp, Status, TrajectoryPoint};
use std::f64::consts::PI;
use std::fmt;
use std::str::FromStr;

/// Bits of the status word that the records do not have.
pub mod bits {
    /// No pose has come for longer than the limit; the values are the last ones.
    pub const STALE: u32 = 1 << 16;
    /// The last write of a program that has ended.
    pub const ENDED: u32 = 1 << 17;
}

/// The fields that are written unless others are asked for.
pub const USUAL: &str = "x,y,z,roll,pitch,yaw,stamp,status,counter";
/// The fields that are read unless others are asked for.
pub const USUAL_READ: &str = "x,y,z,roll,pitch,yaw,vx,vy,vz";

/// What a field holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// One of x, y, z, roll, pitch, yaw.
    Component(usize),
    /// One of vx, vy, vz.
    Velocity(usize),
    /// Standard deviation of a component.
    Sigma(usize),
    /// Range bias common to all beams.
    RangeBias,
    /// The instant that the pose is for.
    Stamp,
    /// The stamp of its scan.
    ScanStamp,
    /// How old the pose is when it is written.
    Age,
    /// The status word: [`Status::bits`] and [`bits`].
    Status,
    /// Number of the scan.
    Sequence,
    /// Number of the write.
    Counter,
    /// Strip edges used.
    Edges,
    /// Votes of the winning cell.
    Votes,
    /// 1 for a whole and fresh pose, else 0.
    Valid,
    /// Written as 0, not looked at when read.
    Unused,
}

impl Quantity {
    /// Every name, in the order of the documentation.
    fn named(name: &str) -> Option<Quantity> {
        if let Some(component) = POSE_STATE.iter().position(|known| *known == name) {
            return Some(Quantity::Component(component));
        }
        if let Some(component) = name.strip_prefix("sigma_") {
            let component = POSE_STATE.iter().position(|known| *known == component);
            return component.map(Quantity::Sigma);
        }
        Some(match name {
            "vx" => Quantity::Velocity(0),
            "vy" => Quantity::Velocity(1),
            "vz" => Quantity::Velocity(2),
            "range_bias" => Quantity::RangeBias,
            "stamp" => Quantity::Stamp,
            "scan_stamp" => Quantity::ScanStamp,
            "age" => Quantity::Age,
            "status" => Quantity::Status,
            "sequence" => Quantity::Sequence,
            "counter" => Quantity::Counter,
            "edges" => Quantity::Edges,
            "votes" => Quantity::Votes,
            "valid" => Quantity::Valid,
            "_" => Quantity::Unused,
            _ => return None,
        })
    }

    fn units(self) -> &'static [(&'static str, Unit)] {
        const LENGTH: &[(&str, Unit)] = &[
            ("m", Unit::Of(1.0)),
            ("mm", Unit::Of(1e-3)),
            ("um", Unit::Of(1e-6)),
        ];
        const ANGLE: &[(&str, Unit)] = &[
            ("rad", Unit::Of(1.0)),
            ("deg", Unit::Of(PI / 180.0)),
            ("mrad", Unit::Of(1e-3)),
        ];
        const SPEED: &[(&str, Unit)] = &[("m/s", Unit::Of(1.0)), ("mm/s", Unit::Of(1e-3))];
        const SPAN: &[(&str, Unit)] = &[
            ("s", Unit::Of(1.0)),
            ("ms", Unit::Of(1e-3)),
            ("us", Unit::Of(1e-6)),
            ("ns", Unit::Of(1e-9)),
        ];
        match self {
            Quantity::Component(0..3) | Quantity::Sigma(0..3) | Quantity::RangeBias => LENGTH,
            Quantity::Component(_) | Quantity::Sigma(_) => ANGLE,
            Quantity::Velocity(_) => SPEED,
            Quantity::Age => SPAN,
            _ => &[("", Unit::Of(1.0))],
        }
    }

    fn is_instant(self) -> bool {
        matches!(self, Quantity::Stamp | Quantity::ScanStamp)
    }
}

/// A unit.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Unit {
    /// So many SI units.
    Of(f64),
    /// Ticks since an epoch.
    Ticks {
        /// Nanoseconds of a tick.
        tick_ns: i64,
        /// The epoch, ns after 1970.
        epoch_ns: i128,
    },
}

/// 1601 (Windows' FILETIME) and 2000 (EtherCAT's distributed clocks), ns after 1970.
const EPOCH_1601_NS: i128 = -11_644_473_600_000_000_000;
const EPOCH_2000_NS: i128 = 946_684_800_000_000_000;

/// The unit of an instant: `s`, `100ns@1601`, `ns@2000`, `filetime`, `dc`.
fn instant_unit(text: &str) -> Option<Unit> {
    let text = match text {
        "filetime" => "100ns@1601",
        "dc" => "ns@2000",
        other => other,
    };
    let (tick, epoch) = text.split_once('@').unwrap_or((text, "1970"));
    let tick_ns = match tick {
        "s" => 1_000_000_000,
        "ms" => 1_000_000,
        "us" => 1000,
        "100ns" => 100,
        "ns" | "1ns" => 1,
        _ => return None,
    };
    let epoch_ns = match epoch {
        "1601" => EPOCH_1601_NS,
        "1970" => 0,
        "2000" => EPOCH_2000_NS,
        _ => return None,
    };
    Some(Unit::Ticks { tick_ns, epoch_ns })
}

/// A quantity in a unit, perhaps for one member: `x`, `yaw:deg`, `fYaw=yaw:deg`.
#[derive(Clone, Debug, PartialEq)]
pub struct Field {
    /// What.
    pub quantity: Quantity,
    /// The structure's member that it is for.
    pub member: Option<String>,
    unit: Unit,
    text: String,
}

impl FromStr for Field {
    type Err = LayoutError;

    fn from_str(text: &str) -> Result<Field, LayoutError> {
        let (member, what) = match text.split_once('=') {
            Some((member, what)) => (Some(member.trim().to_owned()), what.trim()),
            None => (None, text.trim()),
        };
        let (name, unit) = match what.split_once(':') {
            Some((name, unit)) => (name, Some(unit)),
            None => (what, None),
        };
        let quantity = Quantity::named(name).ok_or_else(|| {
            LayoutError(format!(
                "{name:?} is no field; those are x, y, z, roll, pitch, yaw, vx, vy, vz (read only), \
                 sigma_x .. sigma_yaw, range_bias, stamp, scan_stamp, age, status, sequence, \
                 counter, edges, votes, valid and _ (unused)"
            ))
        })?;
        let unit = if quantity.is_instant() {
            instant_unit(unit.unwrap_or("s")).ok_or_else(|| {
                LayoutError(format!(
                    "{what:?}: units of an instant are s, ms, us, 100ns, ns, since @1601, @1970 (the \
                     default) or @2000; filetime is 100ns@1601, dc is ns@2000"
                ))
            })?
        } else {
            let units = quantity.units();
            let found = match unit {
                None => units.first(),
                Some(unit) => units.iter().find(|(name, _)| *name == unit),
            };
            let names = || {
                let names: Vec<&str> = units.iter().map(|unit| unit.0).collect();
                match names.as_slice() {
                    [""] => format!("{what:?}: {name} has no unit"),
                    names => format!("{what:?}: units of {name} are {}", names.join(", ")),
                }
            };
            found.ok_or_else(|| LayoutError(names()))?.1
        };
        Ok(Field {
            quantity,
            member,
            unit,
            text: what.to_owned(),
        })
    }
}

impl fmt::Display for Field {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

/// Fields with commas between them.
///
/// # Errors
/// [`LayoutError`].
pub fn parse_fields(text: &str) -> Result<Vec<Field>, LayoutError> {
    text.split(',').map(str::parse).collect()
}

/// What there is to write.
#[derive(Clone, Copy, Debug)]
pub struct Sample<'a> {
    /// The newest pose.
    pub pose: &'a Pose,
    /// What its status word has besides: [`bits`].
    pub bits: u32,
    /// Number of the write.
    pub counter: u64,
    /// Now.
    pub now: Stamp,
}

impl Sample<'_> {
    /// The whole status word.
    pub fn status(&self) -> u32 {
        self.pose.status.bits() | self.bits
    }

    fn is_valid(&self) -> bool {
        let whole = self.pose.components().iter().all(|value| value.is_finite());
        whole && self.bits == 0 && !self.pose.status.has(Status::NO_POSE)
    }
}

impl Field {
    /// The field's number; NaN where there is none.
    pub fn value(&self, sample: &Sample<'_>) -> Number {
        let pose = sample.pose;
        let whole = |number: u64| Number::Whole(number.into());
        match self.quantity {
            Quantity::Component(component) => {
                let components = pose.components();
                self.scaled(components.get(component).copied().unwrap_or(f64::NAN))
            }
            Quantity::Sigma(component) => {
                self.scaled(pose.cov(component.min(5), component.min(5)).sqrt())
            }
            Quantity::Velocity(_) => Number::Real(f64::NAN),
            Quantity::RangeBias => self.scaled(pose.range_bias_m),
            Quantity::Stamp => self.ticks(pose.stamp),
            Quantity::ScanStamp => self.ticks(pose.scan_stamp),
            Quantity::Age => self.scaled(sample.now.since_s(pose.stamp)),
            Quantity::Status => whole(sample.status().into()),
            Quantity::Sequence => whole(pose.seq.into()),
            Quantity::Counter => whole(sample.counter),
            Quantity::Edges => whole(pose.edges.into()),
            Quantity::Votes => whole(pose.votes.unwrap_or(0).into()),
            Quantity::Valid => whole(sample.is_valid().into()),
            Quantity::Unused => whole(0),
        }
    }

    /// Whether the number counts on for ever, so that whole types wrap and do not clip it.
    pub fn wraps(&self) -> bool {
        matches!(self.quantity, Quantity::Counter | Quantity::Sequence)
    }

    fn scaled(&self, si: f64) -> Number {
        match self.unit {
            Unit::Of(scale) => Number::Real(if scale == 1.0 { si } else { si / scale }),
            Unit::Ticks { .. } => Number::Real(si),
        }
    }

    fn ticks(&self, stamp: Stamp) -> Number {
        match self.unit {
            Unit::Ticks { tick_ns, epoch_ns } => {
                let since_ns = i128::from(stamp.ns()) - epoch_ns;
                let tick_ns = i128::from(tick_ns);
                if since_ns % tick_ns == 0 {
                    Number::Whole(since_ns / tick_ns)
                } else {
                    Number::Real(since_ns as f64 / tick_ns as f64)
                }
            }
            Unit::Of(_) => Number::Whole(stamp.ns().into()),
        }
    }

    /// Puts a number that was read into a point; whether there is a place for it.
    pub fn assign(&self, number: Number, point: &mut TrajectoryPoint) -> bool {
        let si = match self.unit {
            Unit::Of(scale) => number.real() * scale,
            Unit::Ticks { .. } => number.real(),
        };
        let place = match self.quantity {
            Quantity::Component(component @ 0..3) => point.position_m.get_mut(component),
            Quantity::Component(component) => point.rotation_rad.get_mut(component - 3),
            Quantity::Velocity(component) => point.velocity_m_s.get_mut(component),
            Quantity::Stamp => {
                if let Some(stamp) = self.stamp(number) {
                    point.stamp = stamp;
                }
                return true;
            }
            Quantity::Unused => return true,
            _ => None,
        };
        match place {
            Some(place) => {
                *place = si;
                true
            }
            None => false,
        }
    }

    /// The instant of a number.
    fn stamp(&self, number: Number) -> Option<Stamp> {
        let Unit::Ticks { tick_ns, epoch_ns } = self.unit else {
            return None;
        };
        let since_ns = match number {
            Number::Whole(ticks) => ticks.checked_mul(tick_ns.into())?,
            Number::Real(ticks) => (ticks * tick_ns as f64).round() as i128,
        };
        let ns = since_ns.checked_add(epoch_ns)?;
        i64::try_from(ns).ok().map(Stamp::from_ns)
    }

    /// The structure's member that it is for: the one given, or that of the field's own name.
    pub fn member_name(&self) -> &str {
        let own = self.text.split(':').next().unwrap_or_default();
        self.member.as_deref().unwrap_or(own)
    }

    /// Whether it is the instant of a point.
    pub fn is_stamp(&self) -> bool {
        self.quantity == Quantity::Stamp
    }

    /// Whether it can be read into a trajectory.
    pub fn is_readable(&self) -> bool {
        self.assign(Number::Whole(0), &mut TrajectoryPoint::default())
    }

    /// Whether it can be written from a pose.
    pub fn is_writable(&self) -> bool {
        !matches!(self.quantity, Quantity::Velocity(_))
    }
}

/// An instant of a controller's system time (100 ns since 1601); the nearest one that a stamp can
/// hold, 1677 to 2262.
pub fn filetime(ticks: u64) -> Stamp {
    let ns = i128::from(ticks) * 100 + EPOCH_1601_NS;
    Stamp::from_ns(ns.clamp(i64::MIN.into(), i64::MAX.into()) as i64)
}

/// The same the other way.
pub fn to_filetime(stamp: Stamp) -> u64 {
    let ticks = (i128::from(stamp.ns()) - EPOCH_1601_NS) / 100;
    u64::try_from(ticks).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn value(field: &str, pose: &Pose) -> Number {
        let field: Field = field.parse().unwrap();
        field.value(&Sample {
            pose,
            bits: bits::STALE,
            counter: 77,
            now: pose.stamp + 12_500_000,
        })
    }

    #[test]
    fn every_quantity_in_its_unit() {
        let mut pose = Pose {
            // 2023-11-14 22:13:20 UTC.
            stamp: Stamp::from_ns(1_700_000_000_000_000_000),
            scan_stamp: Stamp::from_ns(1_700_000_000_000_000_050),
            seq: 9,
            position_m: [0.25, -3.0, 1.5],
            rotation_rad: [0.0, 0.002, PI / 4.0],
            edges: 16,
            votes: None,
            range_bias_m: -0.011,
            status: Status::FEW_EDGES,
            ..Pose::default()
        };
        pose.covariance[0] = 9e-6;
        let real = Number::Real;
        let whole = Number::Whole;
        for (field, number) in [
            ("x", real(0.25)),
            ("y:mm", real(-3000.0)),
            ("yaw:deg", real(45.0)),
            ("pitch:mrad", real(2.0)),
            ("sigma_x:mm", real(3.0)),
            ("range_bias:mm", real(-11.0)),
            ("stamp", whole(1_700_000_000)),
            ("stamp:ns", whole(1_700_000_000_000_000_000)),
            ("stamp:filetime", whole(133_444_736_000_000_000)),
            ("stamp:dc", whole(753_315_200_000_000_000)),
            ("stamp:s@2000", whole(753_315_200)),
            ("scan_stamp:100ns", real(17_000_000_000_000_000.5)),
            ("age:ms", real(12.5)),
            (
                "status",
                whole(i128::from(Status::FEW_EDGES.bits() | 1 << 16)),
            ),
            ("sequence", whole(9)),
            ("counter", whole(77)),
            ("edges", whole(16)),
            ("votes", whole(0)),
            ("valid", whole(0)),
            ("_", whole(0)),
        ] {
            let found = value(field, &pose);
            let near = (found.real() - number.real()).abs() <= 1e-12 * number.real().abs();
            let exact = matches!(number, Number::Real(_)) || found == number;
            assert!(near && exact, "{field}: {found:?}");
        }
        assert!(value("sigma_y", &pose).real().is_nan());
        let fresh = Sample {
            pose: &pose,
            bits: 0,
            counter: 0,
            now: pose.stamp,
        };
        assert_eq!("valid".parse::<Field>().unwrap().value(&fresh), whole(1));
    }

    #[test]
    fn what_is_no_field_is_said() {
        for (text, why) in [
            ("w", "no field"),
            ("x:deg", "units of x are m, mm, um"),
            ("status:m", "status has no unit"),
            ("stamp:h", "units of an instant"),
            ("stamp:ns@1999", "units of an instant"),
            ("sigma_q", "no field"),
            ("", "no field"),
        ] {
            let error = text.parse::<Field>().unwrap_err().to_string();
            assert!(error.contains(why), "{text}: {error}");
        }
        let fields = parse_fields("fX=x:mm,yaw").unwrap();
        assert_eq!(fields[0].member.as_deref(), Some("fX"));
        assert_eq!(fields[0].to_string(), "x:mm");
    }

    #[test]
    fn a_point_takes_what_it_has_a_place_for() {
        let mut point = TrajectoryPoint::default();
        for (field, number) in [
            ("x:mm", Number::Real(1500.0)),
            ("yaw:deg", Number::Real(90.0)),
            ("vz:mm/s", Number::Whole(-250)),
            ("stamp:dc", Number::Whole(753_315_200_000_000_001)),
            ("_", Number::Whole(4)),
        ] {
            let field: Field = field.parse().unwrap();
            assert!(field.assign(number, &mut point));
        }
        assert_eq!(point.position_m[0], 1.5);
        assert_eq!(point.rotation_rad[2], PI / 2.0);
        assert_eq!(point.velocity_m_s[2], -0.25);
        assert_eq!(point.stamp.ns(), 1_700_000_000_000_000_001);
        assert!(!"status".parse::<Field>().unwrap().is_readable());
        assert!(!"vx".parse::<Field>().unwrap().is_writable());
        let stamp = Stamp::from_ns(1_700_000_000_123_456_700);
        assert_eq!(filetime(to_filetime(stamp)), stamp);
        assert_eq!(filetime(0).ns(), i64::MIN);
        assert_eq!(filetime(u64::MAX).ns(), i64::MAX);
    }
}
