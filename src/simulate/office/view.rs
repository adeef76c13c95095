//! Looking at the plan: the scanner's beams, its errors and what each beam meets.

use super::plan::{Disc, Piece, Plan};
use std::f64::consts::{PI, TAU};

/// The beams of a scanner.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum View {
    /// 722 beams all round: two LMS 200s back to back at half a degree.
    AllRound,
    /// 722 beams over 180 deg.
    Half,
    /// 761 beams over 190 deg: an LMS500 at a quarter of a degree.
    Lms500,
}

impl View {
    /// Number of beams.
    pub fn beams(self) -> usize {
        match self {
            View::AllRound | View::Half => 722,
            View::Lms500 => 761,
        }
    }

    /// From beam to beam, rad.
    pub fn increment_rad(self) -> f64 {
        match self {
            View::AllRound => TAU / 722.0,
            View::Half => PI / 721.0,
            View::Lms500 => 0.25 * PI / 180.0,
        }
    }

    /// Angle of the first beam, rad.
    pub fn angle_min_rad(self) -> f64 {
        match self {
            View::AllRound => -PI + 0.5 * self.increment_rad(),
            View::Half => 0.0,
            View::Lms500 => -5.0 * PI / 180.0,
        }
    }

    /// Angle of a beam, rad.
    pub fn angle_rad(self, beam: usize) -> f64 {
        self.angle_min_rad() + beam as f64 * self.increment_rad()
    }

    /// From scan to scan, s.
    pub fn period_s(self) -> f64 {
        match self {
            View::AllRound | View::Half => 0.04,
            View::Lms500 => 1.0 / 35.0,
        }
    }

    /// Largest range, m.
    pub fn range_max_m(self) -> f64 {
        match self {
            View::AllRound | View::Half => 80.0,
            View::Lms500 => 65.0,
        }
    }
}

/// What the scanner does wrong.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Errors {
    /// Standard deviation of a range, m.
    pub sigma_m: f64,
    /// Step of the ranges, m.
    pub resolution_m: f64,
    /// Step in range from beam to beam from which on a pixel may be mixed, m.
    pub mixed_step_m: f64,
    /// Share of such beams that measure something in between.
    pub mixed_share: f64,
    /// Share of beams that measure something nearer.
    pub outlier_share: f64,
    /// Share of beams without a return.
    pub dropout_share: f64,
}

impl Errors {
    /// The errors of the scanner that has these beams.
    pub fn of(view: View) -> Errors {
        let (sigma_m, resolution_m) = match view {
            View::AllRound | View::Half => (0.015, 0.01),
            View::Lms500 => (0.0065, 0.001),
        };
        Errors {
            sigma_m,
            resolution_m,
            mixed_step_m: 0.3,
            mixed_share: 0.3,
            outlier_share: 0.003,
            dropout_share: 0.003,
        }
    }
}

/// Where the scanner stands.
#[derive(Clone, Copy, Debug)]
pub(super) struct Place {
    pub position_m: [f64; 2],
    pub heading_rad: f64,
}

/// A line in the scanner's coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Normal {
    /// Distance, m, not negative.
    pub d_m: f64,
    /// Direction of the normal, rad.
    pub alpha_rad: f64,
}

impl Normal {
    /// Position of a beam's point along the line, m from the foot point; grows with the beam angle.
    pub fn along_m(&self, angle_rad: f64, range_m: f64) -> f64 {
        range_m * libm::sin(angle_rad - self.alpha_rad)
    }

    /// The point at a position along the line, m.
    pub fn at(&self, along_m: f64) -> [f64; 2] {
        let (sin, cos) = libm::sincos(self.alpha_rad);
        [
            self.d_m * cos - along_m * sin,
            self.d_m * sin + along_m * cos,
        ]
    }
}

/// What a beam meets first.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sight {
    /// Range, m; infinite where there is nothing.
    pub range_m: f64,
    /// Which face; none where it is round, or nothing.
    pub face: Option<usize>,
}

/// What every beam meets.
pub(super) fn look(plan: &Plan, view: View, place: Place) -> Vec<Sight> {
    let beam = |i: usize| {
        let (sin, cos) = libm::sincos(view.angle_rad(i) + place.heading_rad);
        cast(plan, place.position_m, [cos, sin])
    };
    (0..view.beams()).map(beam).collect()
}

fn cast(plan: &Plan, from_m: [f64; 2], direction: [f64; 2]) -> Sight {
    let mut nearest = Sight {
        range_m: f64::INFINITY,
        face: None,
    };
    for piece in &plan.pieces {
        if let Some(range_m) = meet_piece(piece, from_m, direction)
            && range_m < nearest.range_m
        {
            nearest = Sight {
                range_m,
                face: Some(piece.face),
            };
        }
    }
    for disc in &plan.discs {
        if let Some(range_m) = meet_disc(disc, from_m, direction)
            && range_m < nearest.range_m
        {
            nearest = Sight {
                range_m,
                face: None,
            };
        }
    }
    nearest
}

/// Range at which a ray meets a piece of a face: from + range * direction = piece.from + share * step.
fn meet_piece(piece: &Piece, from_m: [f64; 2], [dx, dy]: [f64; 2]) -> Option<f64> {
    let [ex, ey] = piece.step_m;
    let [ax, ay] = [0, 1].map(|i| piece.from_m[i] - from_m[i]);
    let det = dx * ey - dy * ex;
    let share = (ax * dy - ay * dx) / det;
    let range_m = (ax * ey - ay * ex) / det;
    (range_m > 1e-6 && (0.0..=1.0).contains(&share)).then_some(range_m)
}

fn meet_disc(disc: &Disc, from_m: [f64; 2], [dx, dy]: [f64; 2]) -> Option<f64> {
    let [cx, cy] = [0, 1].map(|i| disc.centre_m[i] - from_m[i]);
    let nearest_m = cx * dx + cy * dy;
    let off_m = cx * dy - cy * dx;
    let under = disc.radius_m * disc.radius_m - off_m * off_m;
    if nearest_m <= 0.0 || under < 0.0 {
        return None;
    }
    let range_m = nearest_m - under.sqrt();
    (range_m > 1e-6).then_some(range_m)
}
