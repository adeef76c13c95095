//! Maximum likelihood in the ranges: Gauss-Newton steps from a near start.

use super::{BeamSlice, DEGENERATE, InverseLine, InverseRangeSums, Loss};
use crate::record::{FittedLine, NormalLine};

/// Least squares in the ranges from a near start, such as a closed form's line.
pub fn fit_from(start: InverseLine, beams: BeamSlice<'_>, sigma_m: f64) -> Option<FittedLine> {
    // A step of a third of the estimate's own uncertainty leaves an error far below that: a step
    // shrinks by about sigma / d.
    let small_m2 = 0.1 * sigma_m * sigma_m;
    let (normal, equations, gain_m2) = gauss_newton(start, small_m2, |line| {
        NormalEquations::over(beams, line, |_| 1.0)
    })?;
    let squares_m2 = (equations.squares - gain_m2).max(0.0);
    let rms_m = (squares_m2 / beams.len() as f64).sqrt();
    fitted(normal, &equations, sigma_m, 1.0, beams.len(), rms_m)
}

pub(super) fn fit_robust(
    start: InverseLine,
    beams: BeamSlice<'_>,
    sigma_m: f64,
    loss: Loss,
) -> Option<FittedLine> {
    let start = huber(start, beams, sigma_m)?;
    // Reweighting converges linearly only.
    let small_m2 = 1e-8 * sigma_m * sigma_m;
    let (normal, ..) = gauss_newton(start, small_m2, |line| {
        NormalEquations::over(beams, line, |e| loss.weight(e / sigma_m))
    })?;
    let limit_m = loss.limit_m(sigma_m);
    let inlier = |e: f64| f64::from(u8::from(e.abs() <= limit_m));
    let inliers = NormalEquations::over(beams, Direct::from(normal), inlier);
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
    fn over(beams: BeamSlice<'_>, line: Direct, weight_of: impl Fn(f64) -> f64) -> NormalEquations {
        let Direct { d_m, sin, cos } = line;
        let mut lanes = [[0.0f64; LANES]; 7];
        let mut add = |lane: usize, r: f64, y: f64, z: f64| {
            let p = y * cos + z * sin;
            let q = z * cos - y * sin;
            // A beam that does not meet the line has no say in where it is.
            let inverse = if p > 1e-9 * r { 1.0 / p } else { 0.0 };
            let k = r * inverse;
            let e = r - d_m * k;
            let j = -d_m * k * q * inverse;
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

/// A line by its distance, m, and the sine and cosine of its normal's direction.
#[derive(Clone, Copy, Debug)]
struct Direct {
    d_m: f64,
    sin: f64,
    cos: f64,
}

impl From<NormalLine> for Direct {
    fn from(line: NormalLine) -> Direct {
        let (sin, cos) = line.alpha_rad.sin_cos();
        Direct {
            d_m: line.d_m,
            sin,
            cos,
        }
    }
}

/// Steps until one is short: its squared length in units of the estimate's own uncertainty, times
/// sigma^2, is at most `small_m2`. The equations returned are those at the last step's start; the
/// step takes the last value off their sum of squares.
fn gauss_newton(
    start: InverseLine,
    small_m2: f64,
    equations_at: impl Fn(Direct) -> NormalEquations,
) -> Option<(NormalLine, NormalEquations, f64)> {
    let d_m = start.d_m();
    let mut line = Direct {
        d_m,
        sin: start.b * d_m,
        cos: start.a * d_m,
    };
    let mut alpha_rad = start.b.atan2(start.a);
    for _ in 0..MAX_STEPS {
        let equations = equations_at(line);
        let (d, a, length2) = equations.step()?;
        line.d_m += d;
        alpha_rad += a;
        if !(line.d_m.is_finite() && alpha_rad.is_finite()) {
            return None;
        }
        if length2 <= small_m2 {
            return Some((NormalLine::new(line.d_m, alpha_rad), equations, length2));
        }
        (line.sin, line.cos) = alpha_rad.sin_cos();
    }
    None
}

const MAX_STEPS: usize = 60;

/// The closed form with Huber's loss, from any start.
pub(super) fn huber(
    mut start: InverseLine,
    beams: BeamSlice<'_>,
    sigma_m: f64,
) -> Option<InverseLine> {
    // Huber's loss on the linear residual is convex: its minimum does not depend on the start.
    let huber = Loss::HUBER;
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
    Some(start)
}

const HUBER_STEPS: usize = 50;
