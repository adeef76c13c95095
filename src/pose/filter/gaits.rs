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

/// The judge of all six components.
#[derive(Clone, Debug)]
pub(super) struct Gaits {
    y: Liveliness,
    z: Liveliness,
    roll: Liveliness,
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
            watches: [Watch::NEW; 3],
            in_plane: [Gait::Rest; 3],
            pitch_given,
        }
    }

    /// Takes the pose of a scan on its own, `span_s` after the last one.
    pub(super) fn see(&mut self, span_s: f64, pose: &Pose) {
        let c = pose.components();
        let judges = [&mut self.y, &mut self.z, &mut self.roll];
        for ((judge, k), gait) in judges.into_iter().zip([Y, Z, ROLL]).zip(&mut self.in_plane) {
            if c[k].is_finite() {
                *gait = judge.step(span_s, c[k], pose.cov(k, k));
            }
        }
    }

    /// How the components got to this scan.
    pub(super) fn now(&self) -> [Gait; 6] {
        let [y, z, roll] = self.in_plane;
        let stands = self.in_plane.iter().all(|gait| *gait == Gait::Rest)
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
    pub(super) fn compare(&mut self, off: &[f64; 6], variance: &[f64; 6]) -> bool {
        let mut again = false;
        for (watch, k) in self.watches.iter_mut().zip(WATCHED) {
            let squared = off[k] * off[k] / variance[k];
            if squared.is_finite() && !(k == PITCH && self.pitch_given) {
                again |= watch.take(squared);
            }
        }
        again
    }

    /// The boxes of a platform at rest contradict each other: it does not rest.
    pub(super) fn disturb(&mut self) {
        for watch in &mut self.watches {
            watch.level = watch.level.max(1);
            watch.calm = 0;
        }
    }
}
