//! The closed form: `1/r = A cos(theta) + B sin(theta)` by six sums.

use super::{BeamSlice, DEGENERATE};
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
    /// Distance from the scanner, m.
    pub fn d_m(self) -> f64 {
        1.0 / self.a.hypot(self.b)
    }

    /// The line in normal parametrisation.
    pub fn normal(self) -> NormalLine {
        NormalLine::new(self.d_m(), self.b.atan2(self.a))
    }

    /// Range residual of a beam to first order, m. Unlike `r - d / cos(phi)` it stays finite for a
    /// beam that does not meet the line at all.
    #[inline]
    pub fn residual_m(self, range_m: f64, y_m: f64, z_m: f64) -> f64 {
        range_m * (self.a * y_m + self.b * z_m - 1.0)
    }

    /// Whether all residuals are, to first order, at most `limit_m`. Beams are taken in blocks that
    /// go through vector registers; the first block that says no ends the search.
    pub fn is_within(self, limit_m: f64, beams: BeamSlice<'_>) -> bool {
        let within = |r: f64, y: f64, z: f64| self.residual_m(r, y, z).abs() <= limit_m;
        let (r8, r_rest) = beams.range_m.as_chunks::<BLOCK>();
        let (y8, y_rest) = beams.y_m.as_chunks::<BLOCK>();
        let (z8, z_rest) = beams.z_m.as_chunks::<BLOCK>();
        for ((r, y), z) in r8.iter().zip(y8).zip(z8) {
            let mut all = true;
            for lane in 0..BLOCK {
                all &= within(r[lane], y[lane], z[lane]);
            }
            if !all {
                return false;
            }
        }
        let mut rest = r_rest.iter().zip(y_rest).zip(z_rest);
        rest.all(|((r, y), z)| within(*r, *y, *z))
    }
}

impl From<NormalLine> for InverseLine {
    /// A line through the scanner has none; its values are infinite.
    fn from(line: NormalLine) -> InverseLine {
        let (sin, cos) = line.alpha_rad.sin_cos();
        InverseLine {
            a: cos / line.d_m,
            b: sin / line.d_m,
        }
    }
}

/// Beams looked at together.
const BLOCK: usize = 8;

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

    /// The sums of y^2, y z, z^2, y, z and 1, all with their weights.
    #[inline]
    pub fn parts(&self) -> [f64; 6] {
        [self.yy, self.yz, self.zz, self.y, self.z, self.one]
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

/// Sums over the beams before each beam of a group: those of any run in O(1).
#[derive(Clone, Debug, Default)]
pub struct PrefixSums {
    before: Vec<InverseRangeSums>,
}

impl PrefixSums {
    /// Takes in a group, in place of the one before. Sums start anew with every group, because the
    /// weights of near and far surfaces differ by many decades.
    pub fn read(&mut self, group: BeamSlice<'_>) {
        self.before.clear();
        let mut sums = InverseRangeSums::default();
        self.before.push(sums);
        self.before.extend(group.iter().map(|(range_m, y_m, z_m)| {
            sums.add(range_m, y_m, z_m, 1.0);
            sums
        }));
    }

    /// Whether some border in `borders` may part `from..to` so that two lines lower the sum of
    /// squared residuals to less than `bound_m2`; says no only where there is none.
    ///
    /// With L and R the sums before and behind a border, both as differences to the prefix sum
    /// there, and `explained = num / det`, two lines leave
    /// `one - num_L / det_L - num_R / det_R`: multiplied out, no border costs a division, and L and
    /// R go through one vector register side by side.
    pub fn may_be_two(
        &self,
        from: usize,
        to: usize,
        borders: impl Iterator<Item = usize>,
        bound_m2: f64,
    ) -> bool {
        let (a, b) = (self.before[from].parts(), self.before[to].parts());
        // Rounding must not turn a yes into a no.
        let least = (b[5] - a[5] - bound_m2) * (1.0 - 1e-9);
        let mut any = false;
        for k in borders {
            let at = self.before[k].parts();
            // L, and R with its sign turned: its `det` stays, its `num` changes sign.
            let of = |part: usize| [at[part] - a[part], at[part] - b[part]];
            let (yy, yz, zz, y, z) = (of(0), of(1), of(2), of(3), of(4));
            let (mut num, mut det) = ([0.0; 2], [0.0; 2]);
            let mut degenerate = [0.0; 2];
            for side in 0..2 {
                let product = yy[side] * zz[side];
                det[side] = product - yz[side] * yz[side];
                degenerate[side] = DEGENERATE * product;
                num[side] = y[side] * (y[side] * zz[side] - z[side] * yz[side])
                    + z[side] * (z[side] * yy[side] - y[side] * yz[side]);
            }
            let regular = (det[0] > degenerate[0]) & (det[1] > degenerate[1]);
            let explained = num[0] * det[1] - num[1] * det[0];
            any |= !(regular & (explained <= least * (det[0] * det[1])));
        }
        any
    }

    /// Sums over the beams before `to`.
    #[inline]
    pub fn before(&self, to: usize) -> &InverseRangeSums {
        &self.before[to]
    }

    /// Sums over beams `from..to`.
    #[inline]
    pub fn between(&self, from: usize, to: usize) -> InverseRangeSums {
        self.before[to].minus(&self.before[from])
    }

    /// Sum of squared residuals of the best line through beams `from..to`, m^2.
    #[inline]
    pub fn cost_m2(&self, from: usize, to: usize) -> f64 {
        // Two beams or one contradict no line, but for rounding.
        if to - from < 3 {
            return 0.0;
        }
        self.between(from, to).cost_m2()
    }
}
