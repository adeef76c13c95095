//! The closed form: `1/r = A cos(theta) + B sin(theta)` by six sums.

use super::DEGENERATE;
use crate::record::NormalLine;

/// A line as `A y + B z = 1`: A = cos(alpha) / d, B = sin(alpha) / d, in 1/m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InverseLine {
    /// cos(alpha) / d.
    pub a: f64,
    /// sin(alpha) / d.
    pub b: f64,
}

impl InverseLine {
    /// The line in normal parametrisation.
    pub fn normal(self) -> NormalLine {
        NormalLine::new(1.0 / self.a.hypot(self.b), self.b.atan2(self.a))
    }

    /// Range residual of a beam to first order, m. Unlike `r - d / cos(phi)` it stays finite for a
    /// beam that does not meet the line at all.
    #[inline]
    pub fn residual_m(self, range_m: f64, y_m: f64, z_m: f64) -> f64 {
        range_m * (self.a * y_m + self.b * z_m - 1.0)
    }
}

/// Weighted sums of the 1/r problem over a set of beams. Sums of disjoint sets add up.
#[derive(Clone, Copy, Debug, Default)]
pub struct InverseRangeSums {
    yy: f64,
    yz: f64,
    zz: f64,
    y: f64,
    z: f64,
    one: f64,
}

impl InverseRangeSums {
    /// Adds a beam with a further weight (1 for a plain fit).
    #[inline]
    pub fn add(&mut self, range_m: f64, y_m: f64, z_m: f64, weight: f64) {
        let q = weight * range_m * range_m;
        let (qy, qz) = (q * y_m, q * z_m);
        self.yy += qy * y_m;
        self.yz += qy * z_m;
        self.zz += qz * z_m;
        self.y += qy;
        self.z += qz;
        self.one += q;
    }

    /// The sums of both sets.
    #[inline]
    #[must_use]
    pub fn plus(&self, other: &InverseRangeSums) -> InverseRangeSums {
        InverseRangeSums {
            yy: self.yy + other.yy,
            yz: self.yz + other.yz,
            zz: self.zz + other.zz,
            y: self.y + other.y,
            z: self.z + other.z,
            one: self.one + other.one,
        }
    }

    /// The sums without a subset.
    #[inline]
    #[must_use]
    pub fn minus(&self, other: &InverseRangeSums) -> InverseRangeSums {
        InverseRangeSums {
            yy: self.yy - other.yy,
            yz: self.yz - other.yz,
            zz: self.zz - other.zz,
            y: self.y - other.y,
            z: self.z - other.z,
            one: self.one - other.one,
        }
    }

    /// The best line; none for fewer than two directions.
    #[inline]
    pub fn line(&self) -> Option<InverseLine> {
        let det = self.yy * self.zz - self.yz * self.yz;
        if det > DEGENERATE * self.yy * self.zz {
            let inverse = 1.0 / det;
            Some(InverseLine {
                a: (self.y * self.zz - self.z * self.yz) * inverse,
                b: (self.z * self.yy - self.y * self.yz) * inverse,
            })
        } else {
            None
        }
    }

    /// Sum of squared range residuals of the best line to first order, m^2; zero where fewer than
    /// two directions leave nothing to contradict.
    #[inline]
    pub fn cost_m2(&self) -> f64 {
        match self.line() {
            Some(line) => (self.one - line.a * self.y - line.b * self.z).max(0.0),
            None => 0.0,
        }
    }
}

impl FromIterator<(f64, f64, f64)> for InverseRangeSums {
    /// Sums over beams given as range and point.
    fn from_iter<I: IntoIterator<Item = (f64, f64, f64)>>(beams: I) -> InverseRangeSums {
        let mut sums = InverseRangeSums::default();
        for (range_m, y_m, z_m) in beams {
            sums.add(range_m, y_m, z_m, 1.0);
        }
        sums
    }
}
