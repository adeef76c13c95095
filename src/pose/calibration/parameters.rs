//! What is calibrated: the parameters, their order, what the survey knew of them, and the frame that
//! they make.

use super::super::joint::{hit_share, threshold_mean};
use super::super::mounting::turned_by;
use super::Survey;
use crate::frame::Frame;
use crate::record::Face;
use nalgebra::{DVector, Rotation3};

/// Parameters beside those of the strips.
pub(super) const OTHERS: usize = 10;
pub(super) const DY: usize = 0;
pub(super) const DZ: usize = 1;
pub(super) const BIAS: usize = 2;
pub(super) const SCALE: usize = 3;
pub(super) const THRESHOLD: usize = 4;
pub(super) const FOOTPRINT: usize = 5;
pub(super) const TURN: [usize; 3] = [6, 7, 8];
pub(super) const X_CONSTANT: usize = 9;

/// Which of scanner and IMU is turned on the platform where the two disagree: a run shows only the
/// turn between them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Turned {
    /// The scanner sits as the frame file says.
    #[default]
    Imu,
    /// The IMU (or the known pitch) is right.
    Scanner,
}

/// The order of the parameters. All are deviations from the frame file, in metres, radians and 1:
/// of every strip the edge at its larger coordinate and the one at its smaller, then of every strip
/// the inclination, then the others.
#[derive(Clone, Copy, Debug)]
pub(super) struct Layout {
    pub(super) strips: usize,
}

impl Layout {
    pub(super) fn count(self) -> usize {
        3 * self.strips + OTHERS
    }

    /// The edge of a strip at its larger (`upper`) or smaller coordinate.
    pub(super) fn edge(self, strip: usize, upper: bool) -> usize {
        2 * strip + usize::from(!upper)
    }

    pub(super) fn inclination(self, strip: usize) -> usize {
        2 * self.strips + strip
    }

    pub(super) fn other(self, which: usize) -> usize {
        3 * self.strips + which
    }

    /// Standard deviations of what is known before the run.
    pub(super) fn prior_sigmas(self, survey: &Survey) -> DVector<f64> {
        let strips = self.strips;
        DVector::from_fn(self.count(), |k, _| match k {
            k if k < 2 * strips => survey.length_sigma_m,
            k if k < 3 * strips => survey.angle_sigma_rad,
            k => match k - 3 * strips {
                DY | DZ => survey.length_sigma_m,
                BIAS => survey.bias_sigma_m,
                SCALE => survey.scale_sigma,
                THRESHOLD => survey.threshold_sigma,
                FOOTPRINT => survey.footprint_sigma,
                X_CONSTANT => WIDE_M,
                _ => survey.turn_sigma_rad,
            },
        })
    }
}

/// Prior of a coordinate of which nothing is known, m.
const WIDE_M: f64 = 0.5;

/// The frame whose geometry has the parameters in it: strips and box.
pub(super) fn geometry(frame: &Frame, by: &DVector<f64>) -> Frame {
    let layout = Layout {
        strips: frame.strips.len(),
    };
    let mut frame = frame.clone();
    for (k, strip) in frame.strips.iter_mut().enumerate() {
        let (upper, lower) = (by[layout.edge(k, true)], by[layout.edge(k, false)]);
        strip.offset_m += 0.5 * (upper + lower);
        strip.width_m += upper - lower;
        strip.inclination_deg += by[layout.inclination(k)].to_degrees();
    }
    frame.bounds.dy_m += by[layout.other(DY)];
    frame.bounds.dz_m += by[layout.other(DZ)];
    frame
}

/// The frame with all parameters put in. Bias, scale, threshold and footprint become
/// [`Frame::calibration`]; the turn goes to the scanner or to the IMU.
pub(super) fn applied(frame: &Frame, by: &DVector<f64>, turned: Turned) -> Frame {
    let layout = Layout {
        strips: frame.strips.len(),
    };
    let other = |k: usize| by[layout.other(k)];
    let mut frame = geometry(frame, by);
    let c = &mut frame.calibration;
    // The scan's ranges were (r - bias) / scale with the old ones.
    c.range_bias_m += c.range_scale * other(BIAS);
    c.range_scale *= 1.0 + other(SCALE);
    c.hit_threshold = hit_share(threshold_mean(c.hit_threshold) + other(THRESHOLD));
    c.footprint_scale += other(FOOTPRINT);
    let turn = TURN.map(other);
    if turn != [0.0; 3] {
        let turn = Rotation3::from_euler_angles(turn[0], turn[1], turn[2]);
        match turned {
            Turned::Imu => frame.imu.rotation_deg = turned_by(&turn, frame.imu.rotation_deg),
            Turned::Scanner => {
                frame.scanner.rotation_deg = turned_by(&turn.inverse(), frame.scanner.rotation_deg);
            }
        }
    }
    frame
}

/// The frame with strips cut where they have come to overlap: strips that touch in the frame file do
/// so by a millimetre or two where their real places are known better.
pub(super) fn parted(mut frame: Frame) -> Frame {
    let half_x = 0.5 * frame.bounds.dx_m;
    let count = frame.strips.len();
    for (i, j) in (0..count).flat_map(|i| (i + 1..count).map(move |j| (i, j))) {
        let (a, b) = (frame.strips[i], frame.strips[j]);
        if a.face != b.face {
            continue;
        }
        let [from, to] = shared_x(a.x_m, b.x_m, half_x);
        let needed_m = 0.5 * (a.width_m + b.width_m);
        let apart = |x: f64| (a.offset_m - b.offset_m) + x * (a.slope() - b.slope());
        let middle = 0.5 * (from + to);
        let sign = if apart(middle) < 0.0 { -1.0 } else { 1.0 };
        // Cut a little further in than where they touch, so that rounding leaves them apart.
        let touch = (sign * needed_m - (a.offset_m - b.offset_m)) / (a.slope() - b.slope());
        for (end, outward) in [(from, -1.0), (to, 1.0)] {
            if sign * apart(end) >= needed_m || !touch.is_finite() {
                continue;
            }
            let cut = touch - outward * 1e-3;
            for k in [i, j] {
                let strip = &mut frame.strips[k];
                let x_m = strip.x_m.get_or_insert([-half_x, half_x]);
                if outward > 0.0 {
                    x_m[1] = x_m[1].min(cut);
                } else {
                    x_m[0] = x_m[0].max(cut);
                }
            }
        }
    }
    frame
}

fn shared_x(a: Option<[f64; 2]>, b: Option<[f64; 2]>, half_x: f64) -> [f64; 2] {
    let [a, b] = [a, b].map(|x_m| x_m.unwrap_or([-half_x, half_x]));
    [a[0].max(b[0]), a[1].min(b[1])]
}

/// Directions in the space of the parameters that move the frame as a whole, and no edge against
/// another: no run shows them.
///
/// The first is a common shift along x, under which an edge moves by its slope (dP = T); the second
/// a common turn about the vertical (dP = T P on the ceiling, with the inclinations).
pub(super) fn rigid_patterns(frame: &Frame) -> [DVector<f64>; 2] {
    let layout = Layout {
        strips: frame.strips.len(),
    };
    let mut shift = DVector::zeros(layout.count());
    let mut turn = DVector::zeros(layout.count());
    for (k, strip) in frame.strips.iter().enumerate() {
        let slope = strip.slope();
        for upper in [true, false] {
            let side = if upper { 0.5 } else { -0.5 };
            let at_m = match strip.face {
                Face::Upper => strip.offset_m + side * strip.width_m,
                Face::Right => 0.5 * frame.bounds.dy_m,
                Face::Left => -0.5 * frame.bounds.dy_m,
            };
            shift[layout.edge(k, upper)] = slope;
            turn[layout.edge(k, upper)] = slope * at_m;
        }
        if strip.face == Face::Upper {
            // The inclination itself turns; on a wall it does so in the second order only.
            turn[layout.inclination(k)] = 1.0;
        }
    }
    [shift, turn]
}
