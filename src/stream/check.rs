//! When a record that could be read is still not a good one.

use crate::record::{
    ClockExchange, ImuSample, Pose, Presence, Record, ReflectorLines, Scan, Segment, Status,
    TrajectoryPoint, Value, ValueError,
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

fn finite(values: &[(&'static str, f64)]) -> Result<(), BadField> {
    match values.iter().find(|(_, value)| !value.is_finite()) {
        Some((column, value)) if value.is_nan() => Err(BadField::new(column, "empty")),
        Some((column, _)) => Err(BadField::new(column, "not finite")),
        None => Ok(()),
    }
}

impl StreamRecord for Scan {
    fn check(&self) -> Result<(), BadField> {
        finite(&[
            ("angle_min_rad", self.angle_min_rad),
            ("angle_increment_rad", self.angle_increment_rad),
            ("time_increment_s", self.time_increment_s),
        ])?;
        let beams = self.beams();
        if beams == 0 {
            return Err(BadField::new("ranges_mm", "empty"));
        }
        let same = |column, items: usize| {
            if items == beams || items == 0 {
                return Ok(());
            }
            let why = format!("{items} items where ranges_mm has {beams}");
            Err(BadField::new(column, why))
        };
        same("remissions", self.remissions.len())?;
        let further = ["ranges_2_mm", "ranges_3_mm", "ranges_4_mm", "ranges_5_mm"];
        for (column, ranges_m) in further.into_iter().zip(&self.further_ranges_m) {
            same(column, ranges_m.len())?;
        }
        let further = [
            "remissions_2",
            "remissions_3",
            "remissions_4",
            "remissions_5",
        ];
        for (column, remissions) in further.into_iter().zip(&self.further_remissions) {
            same(column, remissions.len())?;
        }
        Ok(())
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
        const COLUMNS: [&str; 6] = ["x_m", "y_m", "z_m", "roll_rad", "pitch_rad", "yaw_rad"];
        let components = self.components();
        if components.iter().all(|v| v.is_nan()) {
            return if self.status.has(Status::NO_POSE) {
                Ok(())
            } else {
                Err(BadField::new("x_m", "empty, and the status is not no-pose"))
            };
        }
        for (column, value) in COLUMNS.into_iter().zip(components) {
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
        let ([x, y, z], [roll, pitch, yaw]) = (self.position_m, self.rotation_rad);
        finite(&[
            ("x_m", x),
            ("y_m", y),
            ("z_m", z),
            ("roll_rad", roll),
            ("pitch_rad", pitch),
            ("yaw_rad", yaw),
        ])
    }
}

impl StreamRecord for Segment {
    fn check(&self) -> Result<(), BadField> {
        finite(&[
            ("d_m", self.normal.d_m),
            ("alpha_rad", self.normal.alpha_rad),
        ])
    }
}

impl StreamRecord for ClockExchange {
    fn check(&self) -> Result<(), BadField> {
        Ok(())
    }
}
