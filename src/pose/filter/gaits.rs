//! How lively the platform is, scan by scan: what the filter may expect of the next one.
//!
//! y, z and roll come from the lines of a single scan so well that their own motion shows in two
//! scans. x, pitch and yaw do not: they are taken to rest while the others rest, to drift slowly while
//! the others move, and to do more only where the scans contradict that.

use crate::motion::{Gait, Liveliness};
use crate::pose::joint::{PITCH, ROLL, X, Y, YAW, Z};
use crate::record::Pose;

/// Accelerations of y and z in m^2/s^3, of roll in rad^2/s^3: cruising, and starting at 5 m/s^2 or
/// swinging by 1 deg at 2 Hz.
const ALONG: [f64; 2] = [0.03, 20.0];
const ABOUT: [f64; 2] = [1e-3, 5.0];
/// The same of x, pitch and yaw while nothing contradicts it: a sway of 5 mm at 0.25 Hz, a turning of
/// 0.3 deg at 0.15 Hz.
const QUIET_X: f64 = 1e-4;
const QUIET_TILT: f64 = 2e-5;
/// What moves with no more than this is cruising, m^2/s^3 and rad^2/s^3 (x to yaw).
pub(super) const CRUISING: [f64; 6] = [
    2.0 * QUIET_X,
    10.0 * ALONG[0],
    10.0 * ALONG[0],
    10.0 * ABOUT[0],
    2.0 * QUIET_TILT,
    2.0 * QUIET_TILT,
];
/// Pitch as an IMU gives it.
const GIVEN_PITCH: f64 = 1.0;
/// From one level of liveliness to the next.
const LOUDER: f64 = 30.0;
const LEVELS: i32 = 4;

/// Watches how well one component is predicted.
#[derive(Clone, Copy, Debug)]
struct Watch {
    level: i32,
    /// Mean squared error of the prediction over its variance, over the last scans.
    mean: f64,
    /// Scans since the level was last needed.
    calm: u32,
}

/// Scans that the mean goes over.
const MEMORY: f64 = 6.0;
/// A single prediction, or the mean of some, as wrong as this raises the level.
const SINGLE: f64 = 16.0;
const SEVERAL: f64 = 3.0;
/// After so many scans without need the level is lowered.
const CALM: u32 = 25;

impl Watch {
    const NEW: Watch = Watch {
        level: 0,
        mean: 1.0,
        calm: 0,
    };

    /// Takes a prediction's squared error over its variance. True if it asks for another level.
    fn take(&mut self, squared: f64) -> bool {
        self.mean += (squared - self.mean) / MEMORY;
        self.calm += 1;
        if (squared > SINGLE || self.mean > SEVERAL) && self.level < LEVELS {
            self.level += 1;
            self.mean = 1.0;
            self.calm = 0;
            return true;
        }
        if self.mean > 1.5 {
            self.calm = 0;
        }
        if self.calm > CALM && self.level > 0 {
            self.level -= 1;
            self.calm = 0;
        }
        false
    }

    fn psd(&self, quiet: f64) -> f64 {
        quiet * LOUDER.powi(self.level.min(LEVELS - 1))
    }
}

/// Whether a platform that stands has begun to move along the plane of the scan (quickest detection:
/// Shiryaev 1963). The first scan of a start lies within a few deviations of the rest and no judge of
/// a single component can be sure of it; what it may be has to show in the covariance.
#[derive(Clone, Copy, Debug, Default)]
struct Start {
    /// Odds that it began before this scan.
    odds: f64,
}

/// How long a platform stands on average, s.
const STAND_S: f64 = 6.0;
/// Acceleration of a start, as a standard deviation, m/s^2.
const START_M_S2: f64 = 3.5;
/// Odds beyond which the platform is taken to have begun.
const BEGUN: f64 = 3.0;
/// Scans in which y and z are expected to start once one of them has.
const STARTING: u32 = 6;

impl Start {
    /// Takes by how much y and z of a scan, `span_s` after the last one, are off the rest, m, with the
    /// variances of these differences.
    fn take(&mut self, span_s: f64, off: [f64; 2], variance: [f64; 2]) {
        // Begun by now by `way_m`, as a standard deviation, over resting.
        let likelier = |way_m: f64| -> f64 {
            off.iter()
                .zip(&variance)
                .map(|(off, variance)| {
                    let moved = variance + way_m * way_m;
                    let exponent = off * off / 2.0 * (1.0 / variance - 1.0 / moved);
                    (variance / moved).sqrt() * exponent.min(50.0).exp()
                })
                .product()
        };
        let way_m = |since_s: f64| START_M_S2 * since_s * since_s / 2.0;
        let begins = span_s / STAND_S;
        // It began anywhere within this span, or one to two spans ago.
        let odds =
            begins * likelier(way_m(0.7 * span_s)) + self.odds * likelier(way_m(1.6 * span_s));
        self.odds = if odds.is_finite() { odds.min(1e6) } else { 0.0 };
    }
}

/// The judge of all six components.
#[derive(Clone, Debug)]
pub(super) struct Gaits {
    y: Liveliness,
    z: Liveliness,
    roll: Liveliness,
    start: Start,
    /// Scans for which y and z are still expected to start.
    starting: u32,
    /// Of x, pitch, yaw.
    watches: [Watch; 3],
    in_plane: [Gait; 3],
    pitch_given: bool,
}

const WATCHED: [usize; 3] = [X, PITCH, YAW];

impl Gaits {
    pub(super) fn new(pitch_given: bool) -> Gaits {
        let [_, y, z, roll, _, _] = super::state::ANY_VELOCITY;
        Gaits {
            y: Liveliness::new(ALONG, y),
            z: Liveliness::new(ALONG, z),
            roll: Liveliness::new(ABOUT, roll),
            start: Start::default(),
            starting: 0,
            watches: [Watch::NEW; 3],
            in_plane: [Gait::Rest; 3],
            pitch_given,
        }
    }

    /// Takes the pose of a scan on its own, `span_s` after the last one.
    pub(super) fn see(&mut self, span_s: f64, pose: &Pose) {
        let c = pose.components();
        let rested = self.rests();
        self.starting = self.starting.saturating_sub(1);
        let judges = [&mut self.y, &mut self.z, &mut self.roll];
        for ((judge, k), gait) in judges.into_iter().zip([Y, Z, ROLL]).zip(&mut self.in_plane) {
            if c[k].is_finite() {
                *gait = judge.step(span_s, c[k], pose.cov(k, k));
            }
        }
        if rested && !self.rests() {
            self.starting = STARTING;
        }
    }

    /// Whether y and z are taken to rest.
    fn rests(&self) -> bool {
        let [y, z, _] = self.in_plane;
        y == Gait::Rest && z == Gait::Rest && self.starting == 0
    }

    /// How the components got to this scan.
    pub(super) fn now(&self) -> [Gait; 6] {
        let [mut y, mut z, roll] = self.in_plane;
        if self.starting > 0 {
            // What starts along one axis starts along the other.
            for gait in [&mut y, &mut z].into_iter().filter(|g| **g == Gait::Rest) {
                *gait = Gait::Moving { psd: ALONG[1] };
            }
        }
        let stands = [y, z, roll].iter().all(|gait| *gait == Gait::Rest)
            && self.watches.iter().all(|w| w.level == 0);
        let of = |watch: &Watch, quiet| match stands {
            true => Gait::Rest,
            false => Gait::Moving {
                psd: watch.psd(quiet),
            },
        };
        let [watch_x, watch_pitch, watch_yaw] = &self.watches;
        let pitch = match self.pitch_given {
            true if !stands => Gait::Moving { psd: GIVEN_PITCH },
            _ => of(watch_pitch, QUIET_TILT),
        };
        [
            of(watch_x, QUIET_X),
            y,
            z,
            roll,
            pitch,
            of(watch_yaw, QUIET_TILT),
        ]
    }

    /// Compares a scan on its own with its prediction: `off` and the variance of that difference, for
    /// each component of the pose. True where the prediction has to be made again, livelier.
    pub(super) fn compare(&mut self, span_s: f64, off: &[f64; 6], variance: &[f64; 6]) -> bool {
        let mut again = false;
        if self.rests() {
            let of = |values: &[f64; 6]| [values[Y], values[Z]];
            self.start.take(span_s, of(off), of(variance));
            if self.start.odds > BEGUN {
                self.starting = STARTING;
                again = true;
            }
        }
        if !self.rests() {
            self.start = Start::default();
        }
        for (watch, k) in self.watches.iter_mut().zip(WATCHED) {
            let squared = off[k] * off[k] / variance[k];
            if squared.is_finite() && !(k == PITCH && self.pitch_given) {
                again |= watch.take(squared);
            }
        }
        again
    }

    /// Probability that y and z have begun to move though they are taken to rest.
    pub(super) fn may_have_started(&self) -> f64 {
        self.start.odds / (1.0 + self.start.odds)
    }

    /// The boxes of a platform at rest contradict each other: it does not rest.
    pub(super) fn disturb(&mut self) {
        for watch in &mut self.watches {
            watch.level = watch.level.max(1);
            watch.calm = 0;
        }
    }
}
