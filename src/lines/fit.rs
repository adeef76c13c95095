//! One straight line through beams: maximum likelihood in the ranges, with its covariance.
//!
//! A scanner's error is in the range, not across the line, so the residual is
//! `r - d / cos(theta - alpha)` (normal parametrisation `y cos(alpha) + z sin(alpha) = d`). Its
//! least squares are found in two steps: `1/r = A cos(theta) + B sin(theta)` with
//! `A = cos(alpha) / d`, `B = sin(alpha) / d` is linear in A and B and, with weights
//! `r^4 / sigma^2`, the same problem to first order ([`InverseRangeSums`], six sums, so that prefix
//! sums give the fit and the cost of any run of beams in O(1)); Gauss-Newton steps then take out
//! the small bias of weights made from noisy ranges.
//!
//! The covariance is the inverse information with the Jacobian
//! `(1 / cos(phi), -d sin(phi) / cos^2(phi))`, `phi = theta - alpha`. For a wall seen off its foot
//! point d and alpha are strongly correlated: use the whole matrix.

use crate::record::{FittedLine, NormalLine};

/// Beams to fit, as parallel arrays; the points are in the scan plane of S.
#[derive(Clone, Debug, Default)]
pub struct Beams {
    range_m: Vec<f64>,
    y_m: Vec<f64>,
    z_m: Vec<f64>,
}

impl Beams {
    /// Forgets all beams.
    pub fn clear(&mut self) {
        self.range_m.clear();
        self.y_m.clear();
        self.z_m.clear();
    }

    /// Adds a beam by its angle (rad) and range (m, positive and finite).
    pub fn push(&mut self, angle_rad: f64, range_m: f64) {
        let (sin, cos) = angle_rad.sin_cos();
        self.push_point(range_m, range_m * cos, range_m * sin);
    }

    /// Adds a beam by its range and the point it hit.
    pub fn push_point(&mut self, range_m: f64, y_m: f64, z_m: f64) {
        self.range_m.push(range_m);
        self.y_m.push(y_m);
        self.z_m.push(z_m);
    }

    /// All beams.
    pub fn all(&self) -> BeamSlice<'_> {
        BeamSlice {
            range_m: &self.range_m,
            y_m: &self.y_m,
            z_m: &self.z_m,
        }
    }
}

impl FromIterator<(f64, f64)> for Beams {
    /// Collects pairs of angle (rad) and range (m).
    fn from_iter<I: IntoIterator<Item = (f64, f64)>>(beams: I) -> Beams {
        let mut all = Beams::default();
        for (angle_rad, range_m) in beams {
            all.push(angle_rad, range_m);
        }
        all
    }
}

/// A borrowed run of beams: range and hit point of each.
#[derive(Clone, Copy, Debug)]
pub struct BeamSlice<'a> {
    /// Ranges, m.
    pub range_m: &'a [f64],
    /// First coordinates of the points, m.
    pub y_m: &'a [f64],
    /// Second coordinates of the points, m.
    pub z_m: &'a [f64],
}

impl<'a> BeamSlice<'a> {
    /// Number of beams.
    pub fn len(&self) -> usize {
        self.range_m.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.range_m.is_empty()
    }

    /// Range and point of every beam.
    pub fn iter(&self) -> impl Iterator<Item = (f64, f64, f64)> + use<'a> {
        let points = self.y_m.iter().zip(self.z_m);
        self.range_m
            .iter()
            .zip(points)
            .map(|(range_m, (y_m, z_m))| (*range_m, *y_m, *z_m))
    }

    /// Beams `from..to`; cut off at the end.
    pub fn run(&self, from: usize, to: usize) -> BeamSlice<'a> {
        let to = to.min(self.len());
        let from = from.min(to);
        BeamSlice {
            range_m: &self.range_m[from..to],
            y_m: &self.y_m[from..to],
            z_m: &self.z_m[from..to],
        }
    }
}

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

/// Squared sine of the angle between two directions below which they count as one.
const DEGENERATE: f64 = 1e-13;

/// What large residuals count for.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Loss {
    /// Least squares: for beams known to be on the line.
    #[default]
    Squares,
    /// Huber's, linear beyond the given number of sigmas (1.345 usual). Outliers keep a bias.
    Huber(f64),
    /// Tukey's biweight, nothing beyond the given number of sigmas (4.685 usual), started from
    /// Huber's.
    Tukey(f64),
    /// Hard rejection beyond the given number of sigmas, started from Huber's.
    Trimmed(f64),
}

impl Loss {
    /// Tukey's biweight with 95 % efficiency on normal errors.
    pub const TUKEY: Loss = Loss::Tukey(4.685);

    /// Weight of a residual given in sigmas.
    fn weight(self, u: f64) -> f64 {
        match self {
            Loss::Squares => 1.0,
            Loss::Huber(k) => (k / u.abs()).min(1.0),
            Loss::Tukey(c) if u.abs() < c => (1.0 - (u / c).powi(2)).powi(2),
            Loss::Trimmed(k) if u.abs() <= k => 1.0,
            Loss::Tukey(_) | Loss::Trimmed(_) => 0.0,
        }
    }

    /// Variance of the estimate over that of least squares, on normal errors.
    fn variance_factor(self) -> f64 {
        match self {
            Loss::Squares | Loss::Trimmed(_) => 1.0,
            Loss::Huber(_) | Loss::Tukey(_) => 1.0 / 0.95,
        }
    }
}

/// Fits a line to beams with range noise `sigma_m`; none where they do not define one.
///
/// `points` and `rms_m` of the result are those of the beams that count: all of them, or with a
/// robust loss those within its limit (three sigmas for Huber's).
pub fn fit(beams: BeamSlice<'_>, sigma_m: f64, loss: Loss) -> Option<FittedLine> {
    let start = beams.iter().collect::<InverseRangeSums>().line()?;
    match loss {
        Loss::Squares => fit_from(start.normal(), beams, sigma_m),
        robust => fit_robust(start, beams, sigma_m, robust),
    }
}

/// Least squares in the ranges from a near start, such as a closed form's line.
pub fn fit_from(start: NormalLine, beams: BeamSlice<'_>, sigma_m: f64) -> Option<FittedLine> {
    // A step of 3 % of the estimate's own uncertainty leaves an error far below that: what
    // remains is of second order.
    let small_m2 = 1e-3 * sigma_m * sigma_m;
    let (normal, equations) = gauss_newton(start, small_m2, |line| {
        NormalEquations::over(beams, line, |_| 1.0)
    })?;
    let rms_m = (equations.squares / beams.len() as f64).sqrt();
    fitted(normal, &equations, sigma_m, 1.0, beams.len(), rms_m)
}

fn fit_robust(
    mut start: InverseLine,
    beams: BeamSlice<'_>,
    sigma_m: f64,
    loss: Loss,
) -> Option<FittedLine> {
    // Huber's loss on the linear residual is convex: its minimum does not depend on the start.
    let huber = Loss::Huber(1.345);
    for _ in 0..HUBER_STEPS {
        let mut sums = InverseRangeSums::default();
        for (range_m, y_m, z_m) in beams.iter() {
            let u = start.residual_m(range_m, y_m, z_m) / sigma_m;
            sums.add(range_m, y_m, z_m, huber.weight(u));
        }
        let next = sums.line()?;
        let change = (next.a - start.a).hypot(next.b - start.b);
        start = next;
        if change < 1e-6 * start.a.hypot(start.b) {
            break;
        }
    }
    // Reweighting converges linearly only.
    let small_m2 = 1e-8 * sigma_m * sigma_m;
    let (normal, _) = gauss_newton(start.normal(), small_m2, |line| {
        NormalEquations::over(beams, line, |e| loss.weight(e / sigma_m))
    })?;
    let limit_m = sigma_m
        * match loss {
            Loss::Tukey(c) | Loss::Trimmed(c) => c,
            Loss::Huber(_) | Loss::Squares => 3.0,
        };
    let inlier = |e: f64| f64::from(u8::from(e.abs() <= limit_m));
    let inliers = NormalEquations::over(beams, normal, inlier);
    let rms_m = (inliers.squares / inliers.weight).sqrt();
    let factor = loss.variance_factor();
    fitted(
        normal,
        &inliers,
        sigma_m,
        factor,
        inliers.weight as usize,
        rms_m,
    )
}

const HUBER_STEPS: usize = 50;

fn fitted(
    normal: NormalLine,
    equations: &NormalEquations,
    sigma_m: f64,
    variance_factor: f64,
    points: usize,
    rms_m: f64,
) -> Option<FittedLine> {
    let scale = variance_factor * sigma_m * sigma_m / equations.determinant()?;
    Some(FittedLine {
        normal,
        cov_dd: scale * equations.aa,
        cov_da: -scale * equations.da,
        cov_aa: scale * equations.dd,
        points: points as u32,
        rms_m,
    })
}

/// Normal equations of the range residuals in (d, alpha), without the factor 1/sigma^2.
#[derive(Clone, Copy, Debug, Default)]
struct NormalEquations {
    dd: f64,
    da: f64,
    aa: f64,
    d: f64,
    a: f64,
    /// Weighted sum of squared residuals, m^2.
    squares: f64,
    /// Sum of the weights.
    weight: f64,
}

impl NormalEquations {
    /// Sums over all beams; `weight_of` gives a residual's (m) weight. In four lanes, so that the
    /// divisions, one a beam, go through vector registers.
    #[inline]
    fn over(
        beams: BeamSlice<'_>,
        line: NormalLine,
        weight_of: impl Fn(f64) -> f64,
    ) -> NormalEquations {
        let (sin, cos) = line.alpha_rad.sin_cos();
        let mut lanes = [[0.0f64; LANES]; 7];
        let mut add = |lane: usize, r: f64, y: f64, z: f64| {
            let p = y * cos + z * sin;
            let q = z * cos - y * sin;
            // A beam that does not meet the line has no say in where it is.
            let inverse = if p > 1e-9 * r { 1.0 / p } else { 0.0 };
            let k = r * inverse;
            let e = r - line.d_m * k;
            let j = -line.d_m * k * q * inverse;
            let w = weight_of(e);
            lanes[0][lane] += w * k * k;
            lanes[1][lane] += w * k * j;
            lanes[2][lane] += w * j * j;
            lanes[3][lane] += w * k * e;
            lanes[4][lane] += w * j * e;
            lanes[5][lane] += w * e * e;
            lanes[6][lane] += w;
        };
        let (r4, r_rest) = beams.range_m.as_chunks::<LANES>();
        let (y4, y_rest) = beams.y_m.as_chunks::<LANES>();
        let (z4, z_rest) = beams.z_m.as_chunks::<LANES>();
        for ((r, y), z) in r4.iter().zip(y4).zip(z4) {
            for lane in 0..LANES {
                add(lane, r[lane], y[lane], z[lane]);
            }
        }
        for (lane, ((r, y), z)) in r_rest.iter().zip(y_rest).zip(z_rest).enumerate() {
            add(lane, *r, *y, *z);
        }
        let [dd, da, aa, d, a, squares, weight] = lanes.map(|lane| lane.iter().sum());
        NormalEquations {
            dd,
            da,
            aa,
            d,
            a,
            squares,
            weight,
        }
    }

    fn determinant(&self) -> Option<f64> {
        let det = self.dd * self.aa - self.da * self.da;
        (det > DEGENERATE * self.dd * self.aa).then_some(det)
    }

    /// The Gauss-Newton step (m, rad) and its squared length in units of the estimate's own
    /// uncertainty, times sigma^2.
    fn step(&self) -> Option<(f64, f64, f64)> {
        let det = self.determinant()?;
        let d = (self.d * self.aa - self.a * self.da) / det;
        let a = (self.a * self.dd - self.d * self.da) / det;
        Some((d, a, d * self.d + a * self.a))
    }
}

const LANES: usize = 4;

/// Steps until one is short: its squared length in units of the estimate's own uncertainty, times
/// sigma^2, is at most `small_m2`. The equations returned are those at the last step's start.
fn gauss_newton(
    start: NormalLine,
    small_m2: f64,
    equations_at: impl Fn(NormalLine) -> NormalEquations,
) -> Option<(NormalLine, NormalEquations)> {
    let mut line = start;
    for _ in 0..MAX_STEPS {
        let equations = equations_at(line);
        let (d, a, length2) = equations.step()?;
        line = NormalLine {
            d_m: line.d_m + d,
            alpha_rad: line.alpha_rad + a,
        };
        if !(line.d_m.is_finite() && line.alpha_rad.is_finite()) {
            return None;
        }
        if length2 <= small_m2 {
            return Some((NormalLine::new(line.d_m, line.alpha_rad), equations));
        }
    }
    None
}

const MAX_STEPS: usize = 60;

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix2, Vector2};
    use proptest::prelude::*;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::SeedableRng;
    use rand_distr::{Distribution, Normal};

    const SIGMA_M: f64 = 0.0065;

    /// Beams of a 0.25 degree scanner between two angles (deg) that meet the line exactly.
    fn exact(d_m: f64, alpha_deg: f64, from_deg: f64, to_deg: f64) -> Vec<(f64, f64)> {
        let count = ((to_deg - from_deg) / 0.25) as usize;
        let angles = (0..=count).map(|i| (from_deg + 0.25 * i as f64).to_radians());
        angles
            .map(|angle| (angle, d_m / (angle - alpha_deg.to_radians()).cos()))
            .collect()
    }

    fn noisy(beams: &[(f64, f64)], rng: &mut ChaCha8Rng) -> Beams {
        let noise = Normal::new(0.0, SIGMA_M).unwrap();
        beams
            .iter()
            .map(|(angle, range)| (*angle, range + noise.sample(rng)))
            .collect()
    }

    proptest! {
        #[test]
        fn noise_free_beams_give_the_line(
            d_m in 0.02f64..12.0,
            alpha_deg in -89.9f64..269.9,
            middle_deg in -60.0f64..60.0,
            half_deg in 4.0f64..20.0,
        ) {
            let (from, to) = (alpha_deg + middle_deg - half_deg, alpha_deg + middle_deg + half_deg);
            let beams: Beams = exact(d_m, alpha_deg, from, to).into_iter().collect();
            for loss in [Loss::Squares, Loss::TUKEY, Loss::Trimmed(3.0)] {
                let line = fit(beams.all(), SIGMA_M, loss).unwrap();
                prop_assert!((line.normal.d_m - d_m).abs() < 1e-9);
                prop_assert!((line.normal.alpha_rad - alpha_deg.to_radians()).abs() < 1e-9);
                prop_assert_eq!(line.points as usize, beams.all().len());
            }
        }

        #[test]
        fn sums_add_up(split in 3usize..140) {
            let beams: Beams = exact(4.0, 10.0, -20.0, 15.0).into_iter().collect();
            let (left, right) = (beams.all().run(0, split), beams.all().run(split, 141));
            let left: InverseRangeSums = left.iter().collect();
            let right: InverseRangeSums = right.iter().collect();
            let whole: InverseRangeSums = beams.all().iter().collect();
            let joined = left.plus(&right).line().unwrap();
            let straight = whole.line().unwrap();
            prop_assert!((joined.a - straight.a).abs() < 1e-12);
            let rest = whole.minus(&left).line().unwrap();
            prop_assert!((rest.b - straight.b).abs() < 1e-7);
            prop_assert!(whole.cost_m2() < 1e-10);
        }
    }

    #[test]
    fn the_seam_does_not_matter() {
        // A wall straight ahead of the seam, seen by beams at 170..180 and -180..-170 degrees.
        let mut beams = exact(3.0, 180.0, 170.0, 180.0);
        beams.extend(exact(3.0, -180.0, -179.75, -170.0));
        let beams: Beams = beams.into_iter().collect();
        let line = fit(beams.all(), SIGMA_M, Loss::Squares).unwrap();
        assert!((line.normal.d_m - 3.0).abs() < 1e-9);
        assert!((line.normal.alpha_rad - std::f64::consts::PI).abs() < 1e-9);
    }

    #[test]
    fn a_line_nearly_through_the_scanner() {
        for (from, to) in [(80.0, 89.0), (70.0, 88.0)] {
            let beams: Beams = exact(0.01, 0.0, from, to).into_iter().collect();
            let line = fit(beams.all(), SIGMA_M, Loss::Squares).unwrap();
            assert!((line.normal.d_m - 0.01).abs() < 1e-9, "{line:?}");
        }
    }

    #[test]
    fn too_little_is_no_line() {
        assert!(fit(Beams::default().all(), SIGMA_M, Loss::Squares).is_none());
        let one: Beams = [(0.3, 2.0)].into_iter().collect();
        assert!(fit(one.all(), SIGMA_M, Loss::TUKEY).is_none());
        let same: Beams = [(0.3, 2.0), (0.3, 2.1)].into_iter().collect();
        assert!(fit(same.all(), SIGMA_M, Loss::Squares).is_none());
    }

    /// The information matrix from finite differences of the exact range.
    fn crb(beams: &[(f64, f64)], d_m: f64, alpha_rad: f64) -> Matrix2<f64> {
        let range = |angle: f64, d: f64, alpha: f64| d / (angle - alpha).cos();
        let h = 1e-6;
        let mut information = Matrix2::zeros();
        for (angle, _) in beams {
            let j = Vector2::new(
                (range(*angle, d_m + h, alpha_rad) - range(*angle, d_m - h, alpha_rad)) / (2.0 * h),
                (range(*angle, d_m, alpha_rad + h) - range(*angle, d_m, alpha_rad - h)) / (2.0 * h),
            );
            information += j * j.transpose() / (SIGMA_M * SIGMA_M);
        }
        information.try_inverse().unwrap()
    }

    struct Spread {
        /// rms over bound and bias over bound, of d and alpha.
        rms: [f64; 2],
        bias: [f64; 2],
        nees: f64,
        correlation: f64,
    }

    fn monte_carlo(beams: &[(f64, f64)], d_m: f64, alpha_deg: f64, loss: Loss) -> Spread {
        let trials = 2000;
        let alpha_rad = alpha_deg.to_radians();
        let bound = crb(beams, d_m, alpha_rad);
        let mut rng = ChaCha8Rng::seed_from_u64(7);
        let (mut sum, mut squares, mut nees) = (Vector2::zeros(), Matrix2::zeros(), 0.0);
        for _ in 0..trials {
            let beams = noisy(beams, &mut rng);
            let line = fit(beams.all(), SIGMA_M, loss).unwrap();
            let e = Vector2::new(line.normal.d_m - d_m, line.normal.alpha_rad - alpha_rad);
            let cov = Matrix2::new(line.cov_dd, line.cov_da, line.cov_da, line.cov_aa);
            nees += (e.transpose() * cov.try_inverse().unwrap() * e)[0];
            sum += e;
            squares += e * e.transpose();
        }
        let n = f64::from(trials);
        let cov = squares / n;
        Spread {
            rms: [0, 1].map(|i| (cov[(i, i)] / bound[(i, i)]).sqrt()),
            bias: [0, 1].map(|i| sum[i] / n / bound[(i, i)].sqrt()),
            nees: nees / n,
            correlation: cov[(0, 1)] / (cov[(0, 0)] * cov[(1, 1)]).sqrt(),
        }
    }

    /// Beams (angle, range), and the line's d_m and alpha in degrees.
    type Scene = (Vec<(f64, f64)>, f64, f64);

    /// A side wall 4 m away, seen from 0.5 m to 4 m above the scanner, and a ceiling 2 m above it.
    fn scenes() -> [Scene; 2] {
        let side = exact(4.0, 0.0, 0.5f64.atan2(4.0).to_degrees(), 45.0);
        let ceiling = exact(2.0, 90.0, 90.0 - 68.0, 90.0 + 68.0);
        [(side, 4.0, 0.0), (ceiling, 2.0, 90.0)]
    }

    #[test]
    fn the_fit_reaches_the_bound() {
        for (beams, d_m, alpha_deg) in scenes() {
            let spread = monte_carlo(&beams, d_m, alpha_deg, Loss::Squares);
            for i in 0..2 {
                assert!((0.96..=1.04).contains(&spread.rms[i]), "{:?}", spread.rms);
                // The bias' own scatter is 1/sqrt(2000) of the bound.
                assert!(spread.bias[i].abs() < 0.05, "{:?}", spread.bias);
            }
            assert!((1.85..=2.15).contains(&spread.nees), "{}", spread.nees);
        }
    }

    #[test]
    fn distance_and_angle_of_a_side_wall_are_correlated() {
        let (beams, d_m, alpha_deg) = scenes()[0].clone();
        let spread = monte_carlo(&beams, d_m, alpha_deg, Loss::Squares);
        assert!(
            (spread.correlation - 0.91).abs() < 0.02,
            "{}",
            spread.correlation
        );
        let beams: Beams = beams.into_iter().collect();
        let line = fit(beams.all(), SIGMA_M, Loss::Squares).unwrap();
        let correlation = line.cov_da / (line.cov_dd * line.cov_aa).sqrt();
        assert!((correlation - 0.91).abs() < 0.01, "{correlation}");
        assert!((line.cov_dd.sqrt() - 1.117e-3).abs() < 0.02e-3, "{line:?}");
        assert!(
            (line.cov_aa.sqrt().to_degrees() - 0.0258).abs() < 0.0005,
            "{line:?}"
        );
    }

    #[test]
    fn tukey_costs_little_and_says_so() {
        let (beams, d_m, alpha_deg) = scenes()[0].clone();
        let spread = monte_carlo(&beams, d_m, alpha_deg, Loss::TUKEY);
        assert!(spread.rms.iter().all(|rms| *rms < 1.07), "{:?}", spread.rms);
        assert!((1.8..=2.2).contains(&spread.nees), "{}", spread.nees);
    }

    #[test]
    fn outliers_do_not_pull() {
        let (beams, d_m, _) = scenes()[0].clone();
        let mut rng = ChaCha8Rng::seed_from_u64(11);
        let mut squares = [0.0; 2];
        let trials = 300;
        for _ in 0..trials {
            let clean = noisy(&beams, &mut rng);
            // Every tenth beam ends on something 2 cm to 1.5 m in front of the wall.
            let dirty: Beams = beams
                .iter()
                .zip(clean.all().range_m)
                .enumerate()
                .map(|(i, ((angle, _), range_m))| {
                    let front_m = if i % 10 == 3 {
                        0.02 + 0.1 * (i % 15) as f64
                    } else {
                        0.0
                    };
                    (*angle, range_m - front_m)
                })
                .collect();
            for (sum, loss) in squares.iter_mut().zip([Loss::Squares, Loss::TUKEY]) {
                let line = fit(dirty.all(), SIGMA_M, loss).unwrap();
                *sum += (line.normal.d_m - d_m).powi(2);
            }
        }
        let bound_m = crb(&beams, d_m, 0.0)[(0, 0)].sqrt();
        let [plain, robust] = squares.map(|sum| (sum / f64::from(trials)).sqrt() / bound_m);
        assert!(plain > 10.0, "{plain}");
        assert!(robust < 1.3, "{robust}");
    }

    #[test]
    fn scale_and_sigma_scale_together() {
        let (beams, ..) = scenes()[0].clone();
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let once = noisy(&beams, &mut rng);
        let twice: Beams = beams
            .iter()
            .zip(once.all().range_m)
            .map(|((angle, _), range_m)| (*angle, 2.0 * range_m))
            .collect();
        let a = fit(once.all(), SIGMA_M, Loss::TUKEY).unwrap();
        let b = fit(twice.all(), 2.0 * SIGMA_M, Loss::TUKEY).unwrap();
        assert!((b.normal.d_m - 2.0 * a.normal.d_m).abs() < 1e-9);
        assert!((b.normal.alpha_rad - a.normal.alpha_rad).abs() < 1e-9);
        assert!((b.cov_dd / a.cov_dd - 4.0).abs() < 1e-6);
        assert!((b.cov_aa / a.cov_aa - 1.0).abs() < 1e-6);
    }
}
