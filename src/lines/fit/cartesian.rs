//! Fits in coordinates instead of ranges: total and ordinary least squares.
//!
//! They take every point's error for the same, whereas a range error moves a point along its beam.
//! So they are as good as the maximum likelihood fit on a wall seen from straight ahead and worse
//! on one seen at a slant. What the range errors do to them is known, and their covariance says it:
//! `H^-1 (sum (w s)^2 g g^T) H^-1`, with the gradients g of the residuals, the weights w, and s the
//! change of a residual with its range.

use super::{BeamSlice, DEGENERATE, InverseLine, Loss, range};
use crate::record::{FittedLine, NormalLine};

/// Which coordinate ordinary least squares takes for the one in error.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Axis {
    /// The one that varies less along the line.
    #[default]
    Auto,
    /// The first: `y = m z + c`, for walls across the y axis.
    Y,
    /// The second: `z = m y + c`, for walls along the y axis.
    Z,
}

impl Axis {
    pub(super) fn residual(self, beams: BeamSlice<'_>) -> Residual {
        match self {
            Axis::Y => Residual::AlongY,
            Axis::Z => Residual::AlongZ,
            Axis::Auto => {
                let moments = Moments::over(beams, |_, _, _| 1.0);
                if moments.yy <= moments.zz {
                    Residual::AlongY
                } else {
                    Residual::AlongZ
                }
            }
        }
    }
}

/// The distance whose squares are summed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Residual {
    Orthogonal,
    AlongY,
    AlongZ,
}

/// Iteratively reweighted least squares; a single pass without a robust loss. The loss judges by
/// the residual in the range, which is what the noise is in.
pub(super) fn fit(
    start: InverseLine,
    beams: BeamSlice<'_>,
    sigma_m: f64,
    residual: Residual,
    loss: Loss,
) -> Option<FittedLine> {
    let line = if loss == Loss::Squares {
        residual.best(&Moments::over(beams, |_, _, _| 1.0))?
    } else {
        let mut line = range::huber(start, beams, sigma_m)?.normal();
        for _ in 0..MAX_STEPS {
            let (sin, cos) = line.alpha_rad.sin_cos();
            let weight = |r: f64, y: f64, z: f64| {
                loss.weight(range_residual_m(line.d_m, y * cos + z * sin, r) / sigma_m)
            };
            let next = residual.best(&Moments::over(beams, weight))?;
            let change = (next.d_m - line.d_m).abs() / sigma_m
                + (next.alpha_rad - line.alpha_rad).sin().abs();
            line = next;
            if change < 1e-6 {
                break;
            }
        }
        line
    };
    residual.judge(line, beams, sigma_m, loss)
}

const MAX_STEPS: usize = 60;

/// `r - d / cos(phi)` with `cos(phi) = p / r`; without end for a beam that does not meet the line.
fn range_residual_m(d_m: f64, p_m: f64, range_m: f64) -> f64 {
    if p_m > 1e-9 * range_m {
        range_m - d_m * range_m / p_m
    } else {
        f64::INFINITY
    }
}

/// Weighted mean and centred second moments (not divided by the weight).
#[derive(Clone, Copy, Debug, Default)]
struct Moments {
    weight: f64,
    y: f64,
    z: f64,
    yy: f64,
    yz: f64,
    zz: f64,
}

impl Moments {
    fn over(beams: BeamSlice<'_>, weight: impl Fn(f64, f64, f64) -> f64) -> Moments {
        // Relative to a point of the line, so that its distance cancels before it is squared.
        let middle = beams.iter().nth(beams.len() / 2);
        let (_, y0, z0) = middle.unwrap_or_default();
        let mut m = Moments::default();
        for (r, y, z) in beams.iter() {
            let w = weight(r, y, z);
            let (y, z) = (y - y0, z - z0);
            m.weight += w;
            m.y += w * y;
            m.z += w * z;
            m.yy += w * y * y;
            m.yz += w * y * z;
            m.zz += w * z * z;
        }
        let n = m.weight.max(f64::MIN_POSITIVE);
        m.yy -= m.y * m.y / n;
        m.yz -= m.y * m.z / n;
        m.zz -= m.z * m.z / n;
        m.y = y0 + m.y / n;
        m.z = z0 + m.z / n;
        m
    }
}

impl Residual {
    /// The line with the least sum of squares.
    fn best(self, m: &Moments) -> Option<NormalLine> {
        let (cos, sin) = match self {
            Residual::Orthogonal => {
                let twice_rad = (-2.0 * m.yz).atan2(m.zz - m.yy);
                let (sin, cos) = (0.5 * twice_rad).sin_cos();
                ((m.yy + m.zz > 0.0).then_some(cos)?, sin)
            }
            Residual::AlongY => normal_of(1.0, -ratio(m.yz, m.zz)?),
            Residual::AlongZ => normal_of(-ratio(m.yz, m.yy)?, 1.0),
        };
        let line = NormalLine::new(m.y * cos + m.z * sin, sin.atan2(cos));
        (m.weight > 0.0 && line.d_m.is_finite() && line.alpha_rad.is_finite()).then_some(line)
    }

    /// The line with its covariance and what lies on it.
    fn judge(
        self,
        line: NormalLine,
        beams: BeamSlice<'_>,
        sigma_m: f64,
        loss: Loss,
    ) -> Option<FittedLine> {
        let (sin, cos) = line.alpha_rad.sin_cos();
        let limit_m = if loss == Loss::Squares {
            f64::INFINITY
        } else {
            loss.limit_m(sigma_m)
        };
        // In (d, alpha) every residual is the distance times a factor common to all beams, which
        // cancels in the covariance but for its change with alpha; that change is multiplied by
        // residuals and of second order.
        let (mut h, mut g) = ([0.0f64; 3], [0.0f64; 3]);
        let (mut points, mut squares) = (0u32, 0.0);
        for (r, y, z) in beams.iter() {
            let p = y * cos + z * sin;
            let e = range_residual_m(line.d_m, p, r);
            if !(e.abs() <= limit_m) {
                continue;
            }
            let q = z * cos - y * sin;
            let s = p / r;
            h[0] += 1.0;
            h[1] -= q;
            h[2] += q * q;
            g[0] += s * s;
            g[1] -= s * s * q;
            g[2] += s * s * q * q;
            points += 1;
            squares += if e.is_finite() { e * e } else { 0.0 };
        }
        let det = h[0] * h[2] - h[1] * h[1];
        if !(det > DEGENERATE * h[0] * h[2]) {
            return None;
        }
        // Rows of H^-1.
        let (a, b, c) = (h[2] / det, -h[1] / det, h[0] / det);
        let scale = loss.variance_factor() * sigma_m * sigma_m;
        let (u, v) = (a * g[0] + b * g[1], a * g[1] + b * g[2]);
        let (x, w) = (b * g[0] + c * g[1], b * g[1] + c * g[2]);
        Some(FittedLine {
            normal: line,
            cov_dd: scale * (u * a + v * b),
            cov_da: scale * (u * b + v * c),
            cov_aa: scale * (x * b + w * c),
            points,
            rms_m: (squares / f64::from(points)).sqrt(),
        })
    }
}

fn ratio(over: f64, under: f64) -> Option<f64> {
    (under > 0.0).then(|| over / under)
}

/// Cosine and sine of the direction of a normal vector.
fn normal_of(y: f64, z: f64) -> (f64, f64) {
    let length = y.hypot(z);
    (y / length, z / length)
}
