//! The motion of the scanner while it scans, found from the scans themselves.
//!
//! A scan's lines are fitted with a motion taken out of it; how they change with that motion is
//! known ([`LineFit::sensitivity`]). So the lines of consecutive scans, as they come, measure place
//! and motion together: a Kalman filter with the state (y, z, roll) of the scanner, its velocity
//! and its acceleration expects the next scan, the scan is fitted with the expected motion, and the
//! lines then correct the motion and the motion the lines. What remains uncertain of the motion
//! goes into the lines' covariance, with its correlation to the lines' own noise.
//!
//! The width of the frame holds the two walls apart, so that a range bias that differs from scan to
//! scan is not taken for a motion. Yaw makes the width larger by a part in thousands, which moves z
//! but hardly its change.
//!
//! The filter is causal. [`SelfMotion::smoothed`] gives the motion in hindsight (Rauch, Tung and
//! Striebel 1965), for recorded runs.

use super::guide::Guide;
use super::turn;
use crate::frame::Frame;
use crate::record::{NormalLine, ScanMotion, Stamp};
use nalgebra::{Matrix3, SMatrix, SVector, Vector3};
use std::f64::consts::{FRAC_PI_2, PI};

/// The lines of one scan, fitted with an assumed motion.
#[derive(Clone, Copy, Debug)]
pub struct LineFit {
    /// Right, upper, left line.
    pub lines: [NormalLine; 3],
    /// Which of them were seen.
    pub seen: [bool; 3],
    /// Covariance in the order of [`crate::record::LINE_STATE`], as if the motion were exact.
    pub covariance: SMatrix<f64, 7, 7>,
    /// Change of the seven parameters with the assumed velocity along y and z (per m/s) and roll
    /// rate (per rad/s).
    pub sensitivity: SMatrix<f64, 7, 3>,
}

/// What the motion makes of a scan's lines.
#[derive(Clone, Copy, Debug)]
pub struct Deskewed {
    /// The motion to be taken out of the scan.
    pub motion: ScanMotion,
    /// By how much the seven parameters change against the last fit.
    pub step: SVector<f64, 7>,
    /// Their covariance with the motion's uncertainty.
    pub covariance: SMatrix<f64, 7, 7>,
    /// How the scan stands to the one before.
    pub relation: Relation,
}

/// How a scan stands to the one before.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Relation {
    /// It belongs to the same motion. Where that began with the scan before, whose motion was
    /// hardly known then: what is known of it now.
    GoesOn(Option<KnownMotion>),
    /// Nothing was known of the motion before it. The next scan will tell much more of it.
    Begins,
    /// It is from another place, too far away for any platform to have gone there: so the platform
    /// rested in the scan before, and does now.
    Elsewhere,
}

/// Where a scan comes in the sequence.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Place {
    /// After the last one, of the same motion.
    Next,
    /// Of the same motion, but not later than the last one: it teaches nothing.
    Stray,
    /// The first one of a motion.
    First,
    /// The first one, after a jump.
    Elsewhere,
}

/// Place (y, z, roll), velocity, acceleration: three each, in axes along floor and walls.
const N: usize = 9;
type State = SVector<f64, N>;
type Square = SMatrix<f64, N, N>;

/// Power spectral density of the jerk, m^2/s^5 and rad^2/s^5: that of jerks of 50 m/s^3 that last
/// 30 ms, or of a roll of 1 deg at 2 Hz. The velocity is then known to some 0.03 m/s, which is
/// 0.15 mm of z.
const JERK_PSD: [f64; 3] = [60.0, 60.0, 40.0];
/// At the start: standard deviation of the velocity, m/s and rad/s ...
const START_VELOCITY: [f64; 3] = [1.5, 1.5, 0.3];
/// ... and of the acceleration, m/s^2 and rad/s^2.
const START_ACCELERATION: [f64; 3] = [3.0, 3.0, 3.0];
/// Of the place that the first scan's lines show by themselves: so wide that it says nothing, m and
/// rad.
const START_PLACE: [f64; 3] = [0.1, 0.1, 0.01];
/// After a pause as long as this nothing is known of the motion, s.
const FORGET_S: f64 = 1.0;
/// Squared distance of a scan from what was expected, in units of its covariance and with six
/// degrees of freedom, beyond which it is not of the same motion (one in 1e8 is 47).
const GATE: f64 = 50.0;
/// No platform moves as fast, m/s and rad/s: scans further apart are not of one motion but of a
/// stepped run, in which the platform rests.
const IMPOSSIBLE: [f64; 3] = [8.0, 8.0, 8.0];
/// How well it is known that it rests, m/s and rad/s.
const REST_VELOCITY: [f64; 3] = [0.005, 0.005, 0.001];
/// What is known of a platform that rests.
pub const AT_REST: KnownMotion = (
    ScanMotion::REST,
    Matrix3::new(
        REST_VELOCITY[0] * REST_VELOCITY[0],
        0.0,
        0.0,
        0.0,
        REST_VELOCITY[1] * REST_VELOCITY[1],
        0.0,
        0.0,
        0.0,
        REST_VELOCITY[2] * REST_VELOCITY[2],
    ),
);
/// Walls stand askew to the ceiling in the scan plane by yaw times pitch, rad.
const SKEW_RAD: f64 = 4e-4;
/// A line's distance is not better than this, m.
const DISTANCE_FLOOR_M: f64 = 5e-5;
/// The scan is fitted again where the motion was wrong by more, m/s and rad/s ...
const FIT_AGAIN: [f64; 3] = [0.3, 0.3, 0.3];
/// ... this often at most.
const FITS: usize = 4;

/// The scanner's motion in its own axes at an instant, from a trajectory of the platform whose
/// points are not further away than `reach_s`; none where there are none.
pub fn guided(guide: &Guide, frame: &Frame, stamp: Stamp, reach_s: f64) -> Option<ScanMotion> {
    let platform = guide.at(stamp, reach_s)?;
    let lever_m = platform.attitude * Vector3::from(frame.scanner.position_m);
    let mounting = turn::attitude(frame.scanner.rotation_deg.map(f64::to_radians));
    let into_scanner = (platform.attitude * mounting).inverse();
    let velocity = into_scanner * (platform.velocity_m_s + platform.rate_rad_s.cross(&lever_m));
    let rate = into_scanner * platform.rate_rad_s;
    Some(ScanMotion {
        vy_m_s: velocity.y,
        vz_m_s: velocity.z,
        roll_rad_s: rate.x,
    })
}

/// The scanner's motion as far as the scans show it.
#[derive(Clone, Debug)]
pub struct SelfMotion {
    dy_m: f64,
    belief: Option<Belief>,
    /// Whether the belief is that of a single scan.
    begun: bool,
    /// Every belief so far where hindsight is wanted.
    history: Option<Vec<Past>>,
    /// The in-plane rate of turn at the next scan and its standard deviation, rad/s, from a gyro.
    turn: Option<(f64, f64)>,
}

#[derive(Clone, Copy, Debug)]
struct Belief {
    stamp: Stamp,
    state: State,
    covariance: Square,
}

/// A scan in the history. Nearly all of them are known.
#[derive(Clone, Copy, Debug)]
#[allow(clippy::large_enum_variant)]
enum Past {
    /// No lines, or a stamp that does not go on.
    Nothing,
    /// What was known at it, and how it stands to the one before.
    Known(Belief, Relation),
}

/// The motion within a scan and the covariance of its three components.
pub type KnownMotion = (ScanMotion, Matrix3<f64>);

impl SelfMotion {
    /// For scans in a frame of the given width.
    pub fn new(dy_m: f64) -> SelfMotion {
        SelfMotion {
            dy_m,
            belief: None,
            begun: false,
            history: None,
            turn: None,
        }
    }

    /// The same, which remembers every scan for [`SelfMotion::smoothed`].
    pub fn remembering(dy_m: f64) -> SelfMotion {
        SelfMotion {
            history: Some(Vec::new()),
            ..SelfMotion::new(dy_m)
        }
    }

    /// Says how fast the scan plane turns at the next scan: rate and standard deviation, rad/s, such
    /// as [`super::Gyro`] gives; none where nothing is known.
    pub fn tell_turn(&mut self, turn: Option<(f64, f64)>) {
        self.turn = turn;
    }

    /// Takes the next scan, whose lines are those of `stamp`, the reference instant. `fit` fits
    /// them with a motion taken out; it is called once, and again where that motion turns out to
    /// be far off. None where it finds no lines.
    pub fn take(
        &mut self,
        stamp: Stamp,
        mut fit: impl FnMut(ScanMotion) -> Option<LineFit>,
    ) -> Option<Deskewed> {
        let deskewed = self.deskew(stamp, &mut fit);
        if let Some(history) = &mut self.history
            && deskewed.is_none()
        {
            history.push(Past::Nothing);
        }
        deskewed
    }

    fn deskew(
        &mut self,
        stamp: Stamp,
        fit: &mut impl FnMut(ScanMotion) -> Option<LineFit>,
    ) -> Option<Deskewed> {
        let turn = self.turn.take();
        let span_s = self.belief.map(|belief| stamp.since_s(belief.stamp));
        let expected = self.belief.zip(span_s).and_then(|(belief, span_s)| {
            // A stamp that does not go on leaves what is known as it is.
            let near = span_s.abs() <= FORGET_S;
            near.then(|| Belief {
                stamp,
                ..belief.after(span_s.max(0.0))
            })
        });
        let expected = expected.map(|belief| belief.told(turn));
        let assumed = expected.map_or(ScanMotion::REST, |belief| belief.motion());
        let first = fit(assumed)?;
        if !first.is_finite() {
            return None;
        }
        if let Some(expected) = expected {
            let update = expected.update(self.dy_m, &first, assumed);
            if let Some(update) = update.filter(|update| update.distance <= GATE) {
                let place = if span_s.is_some_and(|s| s > 0.0) {
                    Place::Next
                } else {
                    Place::Stray
                };
                return self.settle(expected, update, first, assumed, fit, place);
            }
        }
        let mut start = Belief::at(self.dy_m, stamp, &first);
        let jumped = self.belief.zip(span_s).is_some_and(|(before, span_s)| {
            let off = start.state - before.state;
            span_s.abs() <= FORGET_S
                && (0..3).any(|k| off[k].abs() > IMPOSSIBLE[k] * span_s.max(0.0))
        });
        if jumped {
            start.rest();
        }
        start = start.told(turn);
        // With the motion unknown, or at rest, the expectation from before does not count.
        let (first, assumed) = if assumed.is_rest() {
            (first, assumed)
        } else {
            (fit(ScanMotion::REST)?, ScanMotion::REST)
        };
        let update = start.update(self.dy_m, &first, assumed)?;
        self.belief = None;
        let place = if jumped {
            Place::Elsewhere
        } else {
            Place::First
        };
        self.settle(start, update, first, assumed, fit, place)
    }

    /// Brings motion and lines together, fitting again where the motion was far off.
    fn settle(
        &mut self,
        expected: Belief,
        mut update: Update,
        mut lines: LineFit,
        mut assumed: ScanMotion,
        fit: &mut impl FnMut(ScanMotion) -> Option<LineFit>,
        place: Place,
    ) -> Option<Deskewed> {
        for _ in 1..FITS {
            let off = vector(update.belief.motion()) - vector(assumed);
            if (0..3).all(|k| off[k].abs() <= FIT_AGAIN[k]) {
                break;
            }
            let next = update.belief.motion();
            let Some(again) = fit(next).filter(LineFit::is_finite) else {
                // The last motion with which there were lines stands.
                lines = fit(assumed)?;
                break;
            };
            (lines, assumed) = (again, next);
            update = expected.update(self.dy_m, &lines, assumed)?;
        }
        let relation = match place {
            Place::Elsewhere => Relation::Elsewhere,
            Place::First => Relation::Begins,
            Place::Stray => Relation::GoesOn(None),
            Place::Next => {
                let before = self.belief.filter(|_| self.begun);
                Relation::GoesOn(
                    before.map(|before| before.in_hindsight(&update.belief).known_motion()),
                )
            }
        };
        let is_kept = place != Place::Stray;
        if is_kept {
            self.belief = Some(update.belief);
            self.begun = relation == Relation::Begins;
        }
        if let Some(history) = &mut self.history {
            history.push(if is_kept {
                Past::Known(update.belief, relation)
            } else {
                Past::Nothing
            });
        }
        Some(update.deskewed(&lines, assumed, relation))
    }

    /// The motion within every scan taken so far, in the light of all of them; none for a scan
    /// without lines and for one whose stamp did not go on. Forgets them.
    pub fn smoothed(&mut self) -> Vec<Option<KnownMotion>> {
        let history = self
            .history
            .as_mut()
            .map(std::mem::take)
            .unwrap_or_default();
        let mut smoothed = vec![None; history.len()];
        // What hindsight makes of the scan behind, where it belongs to the same motion, and
        // whether it is from elsewhere.
        let mut behind: Option<Belief> = None;
        let mut left = false;
        for (past, place) in history.iter().zip(&mut smoothed).rev() {
            let Past::Known(belief, relation) = past else {
                continue;
            };
            let own = behind.map_or(*belief, |behind| belief.in_hindsight(&behind));
            let begins = *relation == Relation::Begins;
            *place = Some(if begins && behind.is_none() && left {
                AT_REST
            } else {
                own.known_motion()
            });
            let goes_on = matches!(relation, Relation::GoesOn(_));
            behind = goes_on.then_some(own);
            left = *relation == Relation::Elsewhere;
        }
        smoothed
    }
}

impl LineFit {
    fn is_finite(&self) -> bool {
        let seen = self.lines.iter().zip(self.seen).filter(|(_, seen)| *seen);
        let mut lines = seen.flat_map(|(line, _)| [line.d_m, line.alpha_rad]);
        lines.all(f64::is_finite)
            && self.covariance.as_slice().iter().all(|v| v.is_finite())
            && self.sensitivity.as_slice().iter().all(|v| v.is_finite())
    }

    /// The covariance with the uncertainty of a motion that does not depend on this scan's noise.
    pub fn with_motion(&self, motion_covariance: &Matrix3<f64>) -> SMatrix<f64, 7, 7> {
        self.covariance + self.sensitivity * motion_covariance * self.sensitivity.transpose()
    }
}

/// What a scan makes of a belief.
#[derive(Clone, Copy, Debug)]
struct Update {
    belief: Belief,
    /// Squared distance of the scan from the expectation.
    distance: f64,
    /// Covariance of the motion's error with the lines' own noise.
    shared: SMatrix<f64, 3, 7>,
}

impl Update {
    fn deskewed(&self, lines: &LineFit, assumed: ScanMotion, relation: Relation) -> Deskewed {
        let motion = self.belief.motion();
        let s = &lines.sensitivity;
        let shared = s * self.shared;
        let covariance =
            lines.with_motion(&self.belief.motion_covariance()) + shared + shared.transpose();
        Deskewed {
            motion,
            step: s * (vector(motion) - vector(assumed)),
            covariance,
            relation,
        }
    }
}

impl Belief {
    /// Where the lines are, and nothing known of the motion.
    fn at(dy_m: f64, stamp: Stamp, fit: &LineFit) -> Belief {
        let [right, upper, left] = fit.lines;
        let y_m = match (fit.seen[0], fit.seen[2]) {
            (true, false) => 0.5 * dy_m - right.d_m,
            (false, true) => left.d_m - 0.5 * dy_m,
            (false, false) => 0.0,
            (true, true) => 0.5 * (left.d_m - right.d_m),
        };
        let roll_rad = match fit.seen {
            [_, true, _] => FRAC_PI_2 - upper.alpha_rad,
            [true, ..] => -right.alpha_rad,
            _ => PI - left.alpha_rad,
        };
        let z_m = if fit.seen[1] { -upper.d_m } else { 0.0 };
        let mut state = State::zeros();
        let mut covariance = Square::zeros();
        for (k, value) in [y_m, z_m, roll_rad].into_iter().enumerate() {
            state[k] = value;
            covariance[(k, k)] = START_PLACE[k] * START_PLACE[k];
            covariance[(3 + k, 3 + k)] = START_VELOCITY[k] * START_VELOCITY[k];
            covariance[(6 + k, 6 + k)] = START_ACCELERATION[k] * START_ACCELERATION[k];
        }
        Belief {
            stamp,
            state,
            covariance,
        }
    }

    /// With a gyro's rate of turn and its standard deviation taken in.
    fn told(mut self, turn: Option<(f64, f64)>) -> Belief {
        const TURN: usize = 5;
        let Some((rate_rad_s, sigma_rad_s)) = turn else {
            return self;
        };
        let along = self.covariance.column(TURN).into_owned();
        let gain = along / (along[TURN] + sigma_rad_s * sigma_rad_s);
        self.state += gain * (rate_rad_s - self.state[TURN]);
        self.covariance -= gain * along.transpose();
        self
    }

    /// Says that it rests.
    fn rest(&mut self) {
        for (k, sigma) in REST_VELOCITY.iter().enumerate() {
            self.covariance[(3 + k, 3 + k)] = sigma * sigma;
            self.covariance[(6 + k, 6 + k)] = sigma * sigma;
        }
    }

    /// What is expected `span_s` later.
    fn after(&self, span_s: f64) -> Belief {
        let t = span_s;
        let mut later = *self;
        let half = 0.5 * t * t;
        for k in 0..3 {
            later.state[k] += t * self.state[3 + k] + half * self.state[6 + k];
            later.state[3 + k] += t * self.state[6 + k];
        }
        // F P F^T: rows first, then columns.
        let p = &mut later.covariance;
        for (to, from, by) in [(0, 3, t), (0, 6, half), (3, 6, t)] {
            for k in 0..3 {
                for col in 0..N {
                    p[(to + k, col)] += by * p[(from + k, col)];
                }
            }
        }
        for (to, from, by) in [(0, 3, t), (0, 6, half), (3, 6, t)] {
            for k in 0..3 {
                for row in 0..N {
                    p[(row, to + k)] += by * p[(row, from + k)];
                }
            }
        }
        let (t2, t3) = (t * t, t * t * t);
        for (k, psd) in JERK_PSD.iter().enumerate() {
            let mut add = |i: usize, j: usize, value: f64| {
                p[(3 * i + k, 3 * j + k)] += psd * value;
                if i != j {
                    p[(3 * j + k, 3 * i + k)] += psd * value;
                }
            };
            add(0, 0, t2 * t3 / 20.0);
            add(0, 1, t2 * t2 / 8.0);
            add(0, 2, t3 / 6.0);
            add(1, 1, t3 / 3.0);
            add(1, 2, t2 / 2.0);
            add(2, 2, t);
        }
        later
    }

    /// The motion in the scanner's own axes.
    fn motion(&self) -> ScanMotion {
        let [vy_m_s, vz_m_s, roll_rad_s] = (self.scanner_turn() * self.velocity()).into();
        ScanMotion {
            vy_m_s,
            vz_m_s,
            roll_rad_s,
        }
    }

    fn velocity(&self) -> Vector3<f64> {
        Vector3::new(self.state[3], self.state[4], self.state[5])
    }

    /// From axes along floor and walls to the scanner's.
    fn scanner_turn(&self) -> Matrix3<f64> {
        let (sin, cos) = self.state[2].sin_cos();
        Matrix3::new(cos, sin, 0.0, -sin, cos, 0.0, 0.0, 0.0, 1.0)
    }

    fn known_motion(&self) -> KnownMotion {
        (self.motion(), self.motion_covariance())
    }

    fn motion_covariance(&self) -> Matrix3<f64> {
        let turn = self.scanner_turn();
        turn * self.covariance.fixed_view::<3, 3>(3, 3) * turn.transpose()
    }

    /// The lines fitted with `assumed` taken out, as a measurement.
    fn update(&self, dy_m: f64, fit: &LineFit, assumed: ScanMotion) -> Option<Update> {
        let [y_m, z_m, roll_rad] = [self.state[0], self.state[1], self.state[2]];
        // The place counts from the frame's middle where both walls tell it.
        let expected = [
            0.5 * dy_m - y_m,
            -roll_rad,
            -z_m,
            FRAC_PI_2 - roll_rad,
            0.5 * dy_m + y_m,
            PI - roll_rad,
        ];
        let turn = self.scanner_turn();
        let sensitivity: SMatrix<f64, 6, 3> = fit.sensitivity.fixed_rows::<6>(0).into();
        let by_velocity = sensitivity * turn;
        let skewed = sensitivity * (vector(assumed) - turn * self.velocity());
        let mut rows = SMatrix::<f64, 6, N>::zeros();
        rows.fixed_columns_mut::<3>(3).copy_from(&-by_velocity);
        let mut noise: SMatrix<f64, 6, 6> = fit.covariance.fixed_view::<6, 6>(0, 0).into();
        let mut off = SVector::<f64, 6>::zeros();
        let place = [(0, -1.0), (1, -1.0), (0, 1.0)];
        for (k, (axis, sign)) in place.into_iter().enumerate() {
            let (d, a) = (2 * k, 2 * k + 1);
            if fit.seen[k] {
                rows[(d, axis)] = sign;
                rows[(a, 2)] = -1.0;
                off[d] = fit.lines[k].d_m - expected[d] - skewed[d];
                off[a] = fit.lines[k].alpha_rad - expected[a] - skewed[a];
                noise[(d, d)] += DISTANCE_FLOOR_M * DISTANCE_FLOOR_M;
            } else {
                rows.row_mut(d).fill(0.0);
                rows.row_mut(a).fill(0.0);
                for i in [d, a] {
                    noise.row_mut(i).fill(0.0);
                    noise.column_mut(i).fill(0.0);
                    noise[(i, i)] = 1.0;
                }
            }
        }
        let skew = SKEW_RAD * SKEW_RAD;
        for (i, j) in [(1, 1), (1, 5), (5, 1), (5, 5)] {
            if fit.seen[i / 2] && fit.seen[j / 2] {
                noise[(i, j)] += skew;
            }
        }
        let across = self.covariance * rows.transpose();
        let inverse = (rows * across + noise).cholesky()?.inverse();
        let gain = across * inverse;
        let mut belief = *self;
        belief.state += gain * off;
        belief.covariance -= gain * across.transpose();
        belief.covariance = 0.5 * (belief.covariance + belief.covariance.transpose());
        let gain_of_motion = turn * gain.fixed_rows::<3>(3);
        Some(Update {
            belief,
            distance: off.dot(&(inverse * off)),
            shared: gain_of_motion * fit.covariance.fixed_rows::<6>(0),
        })
    }

    /// What the next scan's belief, or what hindsight makes of that, makes of this one.
    fn in_hindsight(&self, next: &Belief) -> Belief {
        let span_s = next.stamp.since_s(self.stamp);
        let expected = self.after(span_s);
        let mut forward = Square::identity();
        for k in 0..3 {
            forward[(k, 3 + k)] = span_s;
            forward[(k, 6 + k)] = 0.5 * span_s * span_s;
            forward[(3 + k, 6 + k)] = span_s;
        }
        let Some(inverse) = expected.covariance.cholesky().map(|c| c.inverse()) else {
            return *self;
        };
        let gain = self.covariance * forward.transpose() * inverse;
        let covariance =
            self.covariance + gain * (next.covariance - expected.covariance) * gain.transpose();
        Belief {
            stamp: self.stamp,
            state: self.state + gain * (next.state - expected.state),
            covariance: 0.5 * (covariance + covariance.transpose()),
        }
    }
}

fn vector(motion: ScanMotion) -> Vector3<f64> {
    Vector3::new(motion.vy_m_s, motion.vz_m_s, motion.roll_rad_s)
}

#[cfg(test)]
mod tests;
