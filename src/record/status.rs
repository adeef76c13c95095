//! What a consumer must know before it trusts a pose.

use super::columns::{Value, ValueError};
use serde::Serialize;
use std::fmt;
use std::ops::{BitOr, BitOrAssign};

/// A set of remarks on a pose; empty is `ok`.
///
/// In text: the names of the remarks, separated by single spaces.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Status(u32);

macro_rules! remarks {
    ($($bit:literal $name:ident $text:literal $doc:literal;)*) => {
        impl Status {
            $(#[doc = $doc] pub const $name: Status = Status(1 << $bit);)*
        }
        const NAMES: &[(Status, &str)] = &[$((Status::$name, $text)),*];
    };
}

remarks! {
    0 NO_POSE "no-pose" "Nothing could be solved: the numbers are empty.";
    1 NO_UPPER "no-upper" "The upper line was not seen: z and roll are not to be trusted.";
    2 ONE_WALL "one-wall" "Only one side wall was seen: y and range bias rest on it alone.";
    3 NO_WALLS "no-walls" "No side wall was seen: y is not known.";
    4 NO_EDGES "no-edges" "No strip edge was seen: x and yaw are not known.";
    5 FEW_EDGES "few-edges" "Fewer than four strip edges: x and yaw are weak; see the covariance.";
    6 NO_YAW "no-yaw" "Yaw is not observable here (Kurniawan 2017, eq. 3.104).";
    7 EDGE_OUTLIER "edge-outlier" "An edge contradicted the others and was left out.";
    8 NO_IMU "no-imu" "No pitch was given: it was taken as zero with a wide sigma.";
    9 STALE_IMU "stale-imu" "The IMU sample used is older than the limit.";
    10 EXTRAPOLATED "extrapolated" "Carried beyond the last measurement.";
    11 RE_ACQUIRED "re-acquired" "Tracking was lost and found again by a cold start.";
    12 DISAGREE "disagree" "The measurements contradict each other more than their sigmas allow.";
    13 TOO_FAR "extrapolated-too-far" "The time of use is further off than the limit: the numbers are empty.";
    14 STALE_MOTION "stale-motion" "The desired motion does not reach the pose: it was carried by the poses' own motion.";
}

impl Status {
    /// Nothing to remark.
    pub const OK: Status = Status(0);

    /// Whether there is nothing to remark.
    pub fn is_ok(self) -> bool {
        self.0 == 0
    }

    /// Whether all remarks of `other` are in this set.
    pub fn has(self, other: Status) -> bool {
        self.0 & other.0 == other.0
    }

    /// The set as a number, one bit a remark (for a PLC's status word).
    pub fn bits(self) -> u32 {
        self.0
    }

    /// The remark of one bit of [`Status::bits`]; none where the bit has no meaning.
    pub fn from_bit(bit: u32) -> Option<Status> {
        let status = Status(1u32.checked_shl(bit)?);
        NAMES
            .iter()
            .any(|(known, _)| *known == status)
            .then_some(status)
    }

    /// The names of the remarks.
    pub fn names(self) -> impl Iterator<Item = &'static str> {
        NAMES
            .iter()
            .filter(move |(bit, _)| self.has(*bit))
            .map(|(_, name)| *name)
    }
}

impl BitOr for Status {
    type Output = Status;
    fn bitor(self, other: Status) -> Status {
        Status(self.0 | other.0)
    }
}

impl BitOrAssign for Status {
    fn bitor_assign(&mut self, other: Status) {
        self.0 |= other.0;
    }
}

impl fmt::Display for Status {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.is_ok() {
            return f.write_str("ok");
        }
        for (i, name) in self.names().enumerate() {
            if i > 0 {
                f.write_str(" ")?;
            }
            f.write_str(name)?;
        }
        Ok(())
    }
}

impl Value for Status {
    const ROS_TYPE: &'static str = "string";
    type Wire = String;
    fn is_missing(&self) -> bool {
        false
    }
    fn push_text(&self, out: &mut Vec<u8>) {
        out.extend_from_slice(self.to_string().as_bytes());
    }
    fn parse_text(&mut self, text: &[u8]) -> Result<(), ValueError> {
        *self = Status::OK;
        if text.is_empty() || text == b"ok" {
            return Ok(());
        }
        for word in text.split(|b| *b == b' ') {
            let known = NAMES.iter().find(|(_, name)| name.as_bytes() == word);
            *self |= known.ok_or(ValueError::Not("a known status"))?.0;
        }
        Ok(())
    }
    fn to_wire(&self) -> impl Serialize {
        self.to_string()
    }
    /// Words of a later version are passed over: a message cannot be refused half read.
    fn from_wire(wire: String) -> Status {
        let mut status = Status::OK;
        for (bit, name) in NAMES {
            if wire.split(' ').any(|word| word == *name) {
                status |= *bit;
            }
        }
        status
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reads_what_it_writes() {
        for status in [
            Status::OK,
            Status::NO_YAW,
            Status::FEW_EDGES | Status::STALE_IMU,
        ] {
            let mut out = Vec::new();
            status.push_text(&mut out);
            let mut back = Status::NO_POSE;
            back.parse_text(&out).unwrap();
            assert_eq!(back, status);
            assert_eq!(Status::from_wire(status.to_string()), status);
        }
        assert_eq!(Status::default().to_string(), "ok");
        assert!(Status::OK.clone().parse_text(b"no-such").is_err());
    }
}
