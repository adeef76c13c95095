//! What one scan says of the frame: three reflector lines and the strip edges.

use super::columns::{self, Record, Value, ValueError, Visit, VisitMut};
use super::time::Stamp;
use super::{Presence, Scan, ScanMotion, upper_index};
use serde::de::{self, Unexpected, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::fmt;

/// A line in the scan plane of S: `y cos(alpha) + z sin(alpha) = d`, `d >= 0`.
///
/// alpha is kept in (-90, 270] degrees, so that none of the three reflector lines sits on a seam
/// (right wall near 0, upper near 90, left near 180 degrees).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NormalLine {
    /// Distance from the scanner, m.
    pub d_m: f64,
    /// Direction of the normal, rad.
    pub alpha_rad: f64,
}

impl NormalLine {
    /// No line.
    pub const MISSING: NormalLine = NormalLine {
        d_m: f64::NAN,
        alpha_rad: f64::NAN,
    };

    /// The line with d >= 0 and alpha in (-pi/2, 3 pi/2].
    pub fn new(d_m: f64, alpha_rad: f64) -> NormalLine {
        let (d_m, mut alpha_rad) = if d_m < 0.0 {
            (-d_m, alpha_rad + PI)
        } else {
            (d_m, alpha_rad)
        };
        if !(alpha_rad > -FRAC_PI_2 && alpha_rad <= 3.0 * FRAC_PI_2) {
            alpha_rad -= TAU * ((alpha_rad - 3.0 * FRAC_PI_2) / TAU).ceil();
        }
        NormalLine { d_m, alpha_rad }
    }

    /// Range at which a beam at `angle_rad` meets the line; negative or infinite if it does not.
    pub fn range_m(&self, angle_rad: f64) -> f64 {
        self.d_m / (angle_rad - self.alpha_rad).cos()
    }

    /// Where two lines meet; none where they are parallel.
    pub fn corner(&self, other: &NormalLine) -> Option<Corner> {
        let (sin, cos) = self.alpha_rad.sin_cos();
        let (other_sin, other_cos) = other.alpha_rad.sin_cos();
        let determinant = cos * other_sin - sin * other_cos;
        if !(determinant.abs() > 1e-6) {
            return None;
        }
        let y_m = (self.d_m * other_sin - other.d_m * sin) / determinant;
        let z_m = (other.d_m * cos - self.d_m * other_cos) / determinant;
        let angle_rad = z_m.atan2(y_m);
        Some(Corner {
            angle_rad: if angle_rad <= -FRAC_PI_2 {
                angle_rad + TAU
            } else {
                angle_rad
            },
            distance_m: y_m.hypot(z_m),
        })
    }
}

/// Where two lines meet, seen from the scanner.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Corner {
    /// Direction in the scan plane, in (-pi/2, 3 pi/2], rad.
    pub angle_rad: f64,
    /// Distance, m.
    pub distance_m: f64,
}

/// A line fitted to beams, with its covariance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FittedLine {
    /// The line; NaN where it was not seen.
    pub normal: NormalLine,
    /// Variance of d, m^2.
    pub cov_dd: f64,
    /// Covariance of d and alpha, m rad.
    pub cov_da: f64,
    /// Variance of alpha, rad^2.
    pub cov_aa: f64,
    /// Beams used.
    pub points: u32,
    /// Root mean square of their range residuals, m.
    pub rms_m: f64,
}

impl FittedLine {
    /// Whether the line was seen.
    pub fn is_seen(&self) -> bool {
        self.points > 0 && self.normal.d_m.is_finite()
    }
}

impl Default for FittedLine {
    fn default() -> Self {
        FittedLine {
            normal: NormalLine::MISSING,
            cov_dd: f64::NAN,
            cov_da: f64::NAN,
            cov_aa: f64::NAN,
            points: 0,
            rms_m: f64::NAN,
        }
    }
}

macro_rules! tokens {
    ($type:ident, $what:literal, $($variant:ident $text:literal),*) => {
        impl $type {
            /// The word in a column.
            pub fn name(self) -> &'static str {
                match self { $($type::$variant => $text),* }
            }
            /// The value of a word.
            pub fn from_name(name: &[u8]) -> Option<$type> {
                $(if name == $text.as_bytes() { return Some($type::$variant); })*
                None
            }
        }

        /// In a message, a word.
        impl Serialize for $type {
            fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
                serializer.serialize_str(self.name())
            }
        }

        impl<'de> Deserialize<'de> for $type {
            fn deserialize<D: Deserializer<'de>>(from: D) -> Result<$type, D::Error> {
                struct Word;
                impl Visitor<'_> for Word {
                    type Value = $type;
                    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                        f.write_str($what)
                    }
                    fn visit_str<E: de::Error>(self, word: &str) -> Result<$type, E> {
                        let known = $type::from_name(word.as_bytes());
                        known.ok_or_else(|| E::invalid_value(Unexpected::Str(word), &self))
                    }
                }
                from.deserialize_str(Word)
            }
        }

        /// A list of words in one field.
        impl Value for Vec<$type> {
            const ROS_TYPE: &'static str = "string[]";
            type Wire = Vec<$type>;
            fn is_missing(&self) -> bool {
                self.is_empty()
            }
            fn push_text(&self, out: &mut Vec<u8>) {
                columns::push_list(out, self, |out, v| out.extend_from_slice(v.name().as_bytes()));
            }
            fn parse_text(&mut self, text: &[u8]) -> Result<(), ValueError> {
                columns::parse_list(self, text, |item| {
                    $type::from_name(item).ok_or(ValueError::Not($what))
                })
            }
            fn to_wire(&self) -> impl Serialize {
                self
            }
            fn from_wire(wire: Vec<$type>) -> Vec<$type> {
                wire
            }
            fn items(&self) -> Option<usize> {
                Some(self.len())
            }
        }
    };
}

/// A face of the frame's box that the scan plane meets.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub enum Face {
    /// The wall y = +dy/2, scanned first.
    Right,
    /// The ceiling z = dz.
    #[default]
    Upper,
    /// The wall y = -dy/2, scanned last.
    Left,
}
impl Face {
    /// The faces in the order in which a scan meets them.
    pub const ALL: [Face; 3] = [Face::Right, Face::Upper, Face::Left];
}
tokens!(Face, "a list of right, upper, left", Right "right", Upper "upper", Left "left");

/// Which way a strip edge is crossed with growing beam angle.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Default)]
pub enum EdgeKind {
    /// From the gap onto the strip.
    #[default]
    On,
    /// From the strip into the gap.
    Off,
}
tokens!(EdgeKind, "a list of on, off", On "on", Off "off");

/// What an edge rests on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Default)]
pub enum EdgeBasis {
    /// Ranges alone: there is no remission, or too little of it.
    #[default]
    Interval,
    /// The remissions of the beams about it.
    Remission,
    /// The shares of two echoes of the beams about it.
    Echoes,
    /// Ranges alone, because the remissions are at the device's ceiling.
    Saturated,
    /// Ranges alone, because the remissions do not single out one place.
    Ambiguous,
}
tokens!(EdgeBasis, "a list of interval, remission, echoes, saturated, ambiguous",
    Interval "interval", Remission "remission", Echoes "echoes", Saturated "saturated",
    Ambiguous "ambiguous");

/// Where the beams pass from a gap onto a strip or back.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Edge {
    /// The face that the strip is on.
    pub face: Face,
    /// Which strip: its index among the frame file's strips; -1 where it is not known.
    pub strip: i32,
    /// Onto the strip or off it.
    pub kind: EdgeKind,
    /// Angle of the last beam surely before the edge, rad.
    pub from_rad: f64,
    /// Angle of the first beam surely behind it, rad.
    pub to_rad: f64,
    /// Sub-beam estimate of the edge's angle, rad; NaN where there is none.
    pub edge_rad: f64,
    /// Its standard deviation, rad; NaN where there is none.
    pub sigma_rad: f64,
    /// Change of the edge's angle with the common hit threshold, rad for one spot radius.
    pub d_threshold: f64,
    /// Change of the edge's angle with the common footprint scale, rad for a scale of 1.
    pub d_footprint: f64,
    /// Covariance of the sub-beam estimate with the next edge's, rad^2: the two edges of a strip
    /// share its level. 0 where they share nothing.
    pub cov_next_rad2: f64,
    /// What the edge rests on.
    pub basis: EdgeBasis,
    /// When the edge was passed, s after the lines' stamp.
    pub time_s: f64,
}

impl Default for Edge {
    fn default() -> Self {
        Edge {
            face: Face::Upper,
            strip: -1,
            kind: EdgeKind::On,
            from_rad: f64::NAN,
            to_rad: f64::NAN,
            edge_rad: f64::NAN,
            sigma_rad: f64::NAN,
            d_threshold: 0.0,
            d_footprint: 0.0,
            cov_next_rad2: 0.0,
            basis: EdgeBasis::Interval,
            time_s: 0.0,
        }
    }
}

/// Order of the parameters in [`ReflectorLines::joint_cov`].
pub const LINE_STATE: [&str; 7] = [
    "right_d",
    "right_alpha",
    "upper_d",
    "upper_alpha",
    "left_d",
    "left_alpha",
    "range_bias",
];

/// The three reflector lines of one scan, fitted jointly with the range bias, and the strip edges.
#[derive(Clone, Debug, PartialEq)]
pub struct ReflectorLines {
    /// The reference instant: when the beam at 90 degrees fires.
    pub stamp: Stamp,
    /// Stamp of the scan.
    pub scan_stamp: Stamp,
    /// Sequence number of the scan.
    pub seq: u32,
    /// The wall y = +dy/2.
    pub right: FittedLine,
    /// The ceiling z = dz.
    pub upper: FittedLine,
    /// The wall y = -dy/2.
    pub left: FittedLine,
    /// Range bias common to all beams, already taken out of the three lines, m.
    pub range_bias_m: f64,
    /// Upper triangle, row by row, of the 7 by 7 covariance of [`LINE_STATE`]; NaN for a line that
    /// was not seen; empty where the lines were not fitted jointly. The prior on the range bias
    /// is in it.
    pub joint_cov: Vec<f64>,
    /// Velocity of the scanner along y of S at the reference instant that was taken out of the
    /// scan, m/s; see [`ScanMotion`].
    pub motion_vy_m_s: f64,
    /// Velocity along z that was taken out, m/s.
    pub motion_vz_m_s: f64,
    /// Roll rate that was taken out, rad/s.
    pub motion_roll_rad_s: f64,
    /// The strip edges in beam order.
    pub edges: Vec<Edge>,
}

impl Default for ReflectorLines {
    fn default() -> Self {
        ReflectorLines {
            stamp: Stamp::default(),
            scan_stamp: Stamp::default(),
            seq: 0,
            right: FittedLine::default(),
            upper: FittedLine::default(),
            left: FittedLine::default(),
            range_bias_m: f64::NAN,
            joint_cov: Vec::new(),
            motion_vy_m_s: 0.0,
            motion_vz_m_s: 0.0,
            motion_roll_rad_s: 0.0,
            edges: Vec::new(),
        }
    }
}

impl ReflectorLines {
    /// Empties the record for another scan. The reference instant is when the beam at 90 degrees
    /// fires, whether the scan has one or not.
    pub fn begin(&mut self, scan: &Scan) {
        let mut edges = std::mem::take(&mut self.edges);
        let mut joint_cov = std::mem::take(&mut self.joint_cov);
        edges.clear();
        joint_cov.clear();
        let beams = (FRAC_PI_2 - scan.angle_min_rad) / scan.angle_increment_rad;
        let after_s = beams * scan.time_increment_s;
        *self = ReflectorLines {
            stamp: scan
                .stamp
                .plus_s(if after_s.is_finite() { after_s } else { 0.0 }),
            scan_stamp: scan.stamp,
            seq: scan.seq,
            edges,
            joint_cov,
            ..ReflectorLines::default()
        };
    }

    /// The motion that was taken out.
    pub fn motion(&self) -> ScanMotion {
        ScanMotion {
            vy_m_s: self.motion_vy_m_s,
            vz_m_s: self.motion_vz_m_s,
            roll_rad_s: self.motion_roll_rad_s,
        }
    }

    /// Says which motion was taken out.
    pub fn set_motion(&mut self, motion: ScanMotion) {
        self.motion_vy_m_s = motion.vy_m_s;
        self.motion_vz_m_s = motion.vz_m_s;
        self.motion_roll_rad_s = motion.roll_rad_s;
    }

    /// The lines in the order of [`LINE_STATE`]: right, upper, left.
    pub fn lines(&self) -> [&FittedLine; 3] {
        [&self.right, &self.upper, &self.left]
    }

    /// Covariance of two parameters numbered as in [`LINE_STATE`]; NaN where not fitted jointly.
    pub fn joint(&self, row: usize, col: usize) -> f64 {
        self.joint_cov
            .get(upper_index(7, row, col))
            .copied()
            .unwrap_or(f64::NAN)
    }
}

macro_rules! line_columns {
    ($v:ident, $prefix:literal, $($line:tt)+) => {
        $v.column(concat!($prefix, "_d_m"), Presence::Required, $($line)+.normal.d_m)?;
        $v.column(concat!($prefix, "_alpha_rad"), Presence::Required, $($line)+.normal.alpha_rad)?;
        $v.column(concat!($prefix, "_cov_dd"), Presence::Required, $($line)+.cov_dd)?;
        $v.column(concat!($prefix, "_cov_da"), Presence::Required, $($line)+.cov_da)?;
        $v.column(concat!($prefix, "_cov_aa"), Presence::Required, $($line)+.cov_aa)?;
        $v.column(concat!($prefix, "_points"), Presence::Required, $($line)+.points)?;
        $v.column(concat!($prefix, "_rms_m"), Presence::Required, $($line)+.rms_m)?;
    };
}

impl Record for ReflectorLines {
    const KIND: &'static str = "lines";

    fn stamp(&self) -> Stamp {
        self.stamp
    }

    fn visit<V: Visit>(&self, v: &mut V) -> Result<(), V::Error> {
        use Presence::{Optional, Required};
        v.column("stamp_ns", Required, &self.stamp)?;
        v.column("scan_stamp_ns", Required, &self.scan_stamp)?;
        v.column("seq", Required, &self.seq)?;
        line_columns!(v, "right", &self.right);
        line_columns!(v, "upper", &self.upper);
        line_columns!(v, "left", &self.left);
        v.column("range_bias_m", Optional, &self.range_bias_m)?;
        v.column("joint_cov", Optional, &self.joint_cov)?;
        v.column("motion_vy_m_s", Optional, &self.motion_vy_m_s)?;
        v.column("motion_vz_m_s", Optional, &self.motion_vz_m_s)?;
        v.column("motion_roll_rad_s", Optional, &self.motion_roll_rad_s)?;
        EdgeColumns::from_edges(&self.edges).visit(v)
    }

    fn visit_mut<V: VisitMut>(&mut self, v: &mut V) -> Result<(), V::Error> {
        use Presence::{Optional, Required};
        v.column("stamp_ns", Required, &mut self.stamp)?;
        v.column("scan_stamp_ns", Required, &mut self.scan_stamp)?;
        v.column("seq", Required, &mut self.seq)?;
        line_columns!(v, "right", &mut self.right);
        line_columns!(v, "upper", &mut self.upper);
        line_columns!(v, "left", &mut self.left);
        v.column("range_bias_m", Optional, &mut self.range_bias_m)?;
        v.column("joint_cov", Optional, &mut self.joint_cov)?;
        v.column("motion_vy_m_s", Optional, &mut self.motion_vy_m_s)?;
        v.column("motion_vz_m_s", Optional, &mut self.motion_vz_m_s)?;
        v.column("motion_roll_rad_s", Optional, &mut self.motion_roll_rad_s)?;
        let mut columns = EdgeColumns::default();
        columns.visit_mut(v)?;
        columns.into_edges(&mut self.edges);
        Ok(())
    }
}

/// The edges as parallel lists, the form in which they travel. The lengths must agree; a list that
/// is shorter than the faces' ends the edges there (see [`crate::stream`], which refuses the row).
#[derive(Clone, Debug, Default)]
struct EdgeColumns {
    face: Vec<Face>,
    strip: Vec<i64>,
    kind: Vec<EdgeKind>,
    from_rad: Vec<f64>,
    to_rad: Vec<f64>,
    edge_rad: Vec<f64>,
    sigma_rad: Vec<f64>,
    d_threshold: Vec<f64>,
    d_footprint: Vec<f64>,
    cov_next_rad2: Vec<f64>,
    basis: Vec<EdgeBasis>,
    time_s: Vec<f64>,
}

macro_rules! edge_columns {
    ($self:ident, $v:ident, $($ref:tt)+) => {
        $v.column("edge_face", Presence::Required, $($ref)+ $self.face)?;
        $v.column("edge_strip", Presence::Required, $($ref)+ $self.strip)?;
        $v.column("edge_kind", Presence::Required, $($ref)+ $self.kind)?;
        $v.column("edge_from_rad", Presence::Required, $($ref)+ $self.from_rad)?;
        $v.column("edge_to_rad", Presence::Required, $($ref)+ $self.to_rad)?;
        $v.column("edge_rad", Presence::Optional, $($ref)+ $self.edge_rad)?;
        $v.column("edge_sigma_rad", Presence::Optional, $($ref)+ $self.sigma_rad)?;
        $v.column("edge_d_threshold", Presence::Optional, $($ref)+ $self.d_threshold)?;
        $v.column("edge_d_footprint", Presence::Optional, $($ref)+ $self.d_footprint)?;
        $v.column("edge_cov_next_rad2", Presence::Optional, $($ref)+ $self.cov_next_rad2)?;
        $v.column("edge_basis", Presence::Optional, $($ref)+ $self.basis)?;
        $v.column("edge_time_s", Presence::Optional, $($ref)+ $self.time_s)?;
    };
}

impl EdgeColumns {
    fn from_edges(edges: &[Edge]) -> EdgeColumns {
        let measured = edges.iter().any(|e| e.edge_rad.is_finite());
        let optional = |value: fn(&Edge) -> f64| {
            if measured {
                edges.iter().map(value).collect()
            } else {
                Vec::new()
            }
        };
        EdgeColumns {
            face: edges.iter().map(|e| e.face).collect(),
            strip: edges.iter().map(|e| i64::from(e.strip)).collect(),
            kind: edges.iter().map(|e| e.kind).collect(),
            from_rad: edges.iter().map(|e| e.from_rad).collect(),
            to_rad: edges.iter().map(|e| e.to_rad).collect(),
            edge_rad: optional(|e| e.edge_rad),
            sigma_rad: optional(|e| e.sigma_rad),
            d_threshold: edges.iter().map(|e| e.d_threshold).collect(),
            d_footprint: edges.iter().map(|e| e.d_footprint).collect(),
            cov_next_rad2: optional(|e| e.cov_next_rad2),
            basis: if edges.iter().any(|e| e.basis != EdgeBasis::Interval) {
                edges.iter().map(|e| e.basis).collect()
            } else {
                Vec::new()
            },
            time_s: edges.iter().map(|e| e.time_s).collect(),
        }
    }

    fn into_edges(self, edges: &mut Vec<Edge>) {
        let none = Edge::default();
        edges.clear();
        edges.extend(self.face.iter().enumerate().map(|(i, face)| {
            Edge {
                face: *face,
                strip: self
                    .strip
                    .get(i)
                    .map_or(-1, |s| i32::try_from(*s).unwrap_or(-1)),
                kind: self.kind.get(i).copied().unwrap_or_default(),
                from_rad: self.from_rad.get(i).copied().unwrap_or(f64::NAN),
                to_rad: self.to_rad.get(i).copied().unwrap_or(f64::NAN),
                edge_rad: self.edge_rad.get(i).copied().unwrap_or(f64::NAN),
                sigma_rad: self.sigma_rad.get(i).copied().unwrap_or(f64::NAN),
                d_threshold: self.d_threshold.get(i).copied().unwrap_or(none.d_threshold),
                d_footprint: self.d_footprint.get(i).copied().unwrap_or(none.d_footprint),
                cov_next_rad2: self
                    .cov_next_rad2
                    .get(i)
                    .copied()
                    .unwrap_or(none.cov_next_rad2),
                basis: self.basis.get(i).copied().unwrap_or_default(),
                time_s: self.time_s.get(i).copied().unwrap_or(none.time_s),
            }
        }));
    }

    fn visit<V: Visit>(&self, v: &mut V) -> Result<(), V::Error> {
        edge_columns!(self, v, &);
        Ok(())
    }

    fn visit_mut<V: VisitMut>(&mut self, v: &mut V) -> Result<(), V::Error> {
        edge_columns!(self, v, &mut);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn alpha_stays_off_the_seam() {
        assert_eq!(NormalLine::new(1.0, -FRAC_PI_2).alpha_rad, 3.0 * FRAC_PI_2);
        assert!((NormalLine::new(-2.0, 0.1).alpha_rad - (PI + 0.1)).abs() < 1e-15);
        assert!((NormalLine::new(2.0, 7.0).alpha_rad - (7.0 - 2.0 * PI)).abs() < 1e-15);
        assert!((NormalLine::new(2.0, -3.0).alpha_rad - (2.0 * PI - 3.0)).abs() < 1e-15);
        assert_eq!(NormalLine::new(2.0, PI).alpha_rad, PI);
    }

    #[test]
    fn a_corner_lies_on_both_lines() {
        for roll_rad in [-0.1, 0.0, 0.07] {
            let right = NormalLine::new(3.1, -roll_rad);
            let upper = NormalLine::new(2.7, FRAC_PI_2 - roll_rad);
            let left = NormalLine::new(7.3, PI - roll_rad);
            let lower = NormalLine::new(1.5, -FRAC_PI_2 - roll_rad);
            for (a, b) in [(right, upper), (upper, left), (left, lower), (lower, right)] {
                for (a, b) in [(a, b), (b, a)] {
                    let corner = a.corner(&b).unwrap();
                    for line in [a, b] {
                        let range_m = line.range_m(corner.angle_rad);
                        assert!((range_m - corner.distance_m).abs() < 1e-12, "{corner:?}");
                    }
                    assert!(corner.angle_rad > -FRAC_PI_2 && corner.angle_rad <= 1.5 * PI);
                }
            }
            assert_eq!(right.corner(&left), None);
        }
    }
}
