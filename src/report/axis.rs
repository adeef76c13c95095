//! The components that errors are reported for, with the unit people read them in.

use super::number::fixed;

/// One reported component.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Axis {
    /// Name, as in `x.rms_mm`.
    pub name: &'static str,
    /// Unit in the names of statistics.
    pub unit: &'static str,
    /// Unit as printed.
    pub symbol: &'static str,
    /// How many of the unit make a metre or a radian.
    pub factor: f64,
    /// Decimals that a person wants to see.
    pub decimals: usize,
}

impl Axis {
    /// A value, m or rad, with its unit: "2.00 mm", "0.031°".
    pub(super) fn quantity(&self, value: f64) -> String {
        let text = fixed(value * self.factor, self.decimals);
        match self.symbol {
            "°" => format!("{text}°"),
            symbol => format!("{text} {symbol}"),
        }
    }
}

const fn length(name: &'static str) -> Axis {
    Axis {
        name,
        unit: "mm",
        symbol: "mm",
        factor: 1e3,
        decimals: 2,
    }
}

const fn angle(name: &'static str) -> Axis {
    Axis {
        name,
        unit: "deg",
        symbol: "°",
        factor: 180.0 / std::f64::consts::PI,
        decimals: 3,
    }
}

/// The six components in the order of [`crate::record::POSE_STATE`], then the distance between
/// the measured and the reference position, then the angle of the rotation between the two
/// orientations.
pub const AXES: [Axis; 8] = [
    length("x"),
    length("y"),
    length("z"),
    angle("roll"),
    angle("pitch"),
    angle("yaw"),
    length("position"),
    angle("rotation"),
];

/// The six components of a pose, numbered.
pub(super) fn components() -> impl Iterator<Item = (usize, &'static Axis)> {
    AXES.iter().take(POSITION).enumerate()
}

/// Where the position's distance is in [`AXES`].
pub(super) const POSITION: usize = 6;
/// Where the rotation's angle is.
pub(super) const ROTATION: usize = 7;
