//! How one component of a pose moves, judged from its measurements so far: a filter with several
//! levels of liveliness, of which the measurements choose (an interacting multiple model, IMM:
//! Blom and Bar-Shalom 1988).
//!
//! One level alone cannot do: what follows a start at 5 m/s^2 passes the measurements' noise on as
//! motion at rest, and what is quiet at rest is late at a start. The state of a level is position,
//! velocity and acceleration; levels of a lower order keep the higher ones at zero.

use nalgebra::{Matrix3, Vector3};

/// Derivatives that a level has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Order {
    /// The component rests.
    Rest = 1,
    /// It has a velocity.
    Velocity = 2,
    /// It has an acceleration.
    Acceleration = 3,
}

/// A level of liveliness. Lengths are m, or rad for an angle.
#[derive(Clone, Copy, Debug)]
pub(super) struct Level {
    pub order: Order,
    /// Wandering of the position, m^2/s.
    pub position_psd: f64,
    /// White acceleration, m^2/s^3.
    pub acceleration_psd: f64,
    /// White jerk, m^2/s^5.
    pub jerk_psd: f64,
    /// How long it lasts on average, s.
    pub stay_s: f64,
}

/// How many levels there are at most.
pub(super) const LEVELS: usize = 3;

/// What a filter assumes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Character {
    /// The levels; the last one is the liveliest.
    pub levels: [Level; LEVELS],
    /// How many of them are used.
    pub used: usize,
    /// Standard deviation of the velocity at the start, m/s.
    pub velocity_sigma: f64,
    /// Standard deviation of the acceleration at the start, m/s^2.
    pub acceleration_sigma: f64,
}

/// What is known of the motion from elsewhere between two measurements (an IMU).
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Push {
    /// Change of the position beyond velocity times time, m.
    pub position: f64,
    /// Change of the velocity, m/s.
    pub velocity: f64,
}

/// How far a component moves on from its last measurement.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Shift {
    /// Change of position, m.
    pub by: f64,
    /// Velocity at the measurement, m/s.
    pub velocity: f64,
    /// By how much the variance of the moved position is larger than the measurement's, m^2.
    pub growth: f64,
}

/// One level's estimate.
#[derive(Clone, Copy, Debug)]
struct Estimate {
    state: Vector3<f64>,
    covariance: Matrix3<f64>,
    /// Covariance of the state's error with the last measurement's error.
    shared: Vector3<f64>,
}

/// The filter of one component.
#[derive(Clone, Copy, Debug)]
pub(super) struct Axis {
    character: Character,
    estimates: [Estimate; LEVELS],
    probability: [f64; LEVELS],
    started: bool,
    /// Measurements in a row that contradicted every level.
    refused: u32,
    /// How far the component can have got away from what every level expects, m.
    allowance: f64,
}

/// How probable it is that a stream starts at rest. Two poses tell if it does not.
const START_AT_REST: f64 = 0.8;
/// A measurement this many standard deviations off is not believed at once...
const REFUSE_SIGMAS: f64 = 8.0;
/// ... unless an acceleration that no level expects, m/s^2 or rad/s^2, explains it ...
const REFUSE_ACCELERATION: f64 = 5.0;
/// ... but when it comes this often in a row, the filter was wrong.
const REFUSE_AT_MOST: u32 = 2;
/// A level is never given up: what it needs to come back in one or two measurements.
const LEAST_PROBABILITY: f64 = 1e-6;

impl Axis {
    pub fn new(character: Character) -> Axis {
        let nothing = Estimate {
            state: Vector3::zeros(),
            covariance: Matrix3::zeros(),
            shared: Vector3::zeros(),
        };
        Axis {
            character,
            estimates: [nothing; LEVELS],
            probability: [0.0; LEVELS],
            started: false,
            refused: 0,
            allowance: 0.0,
        }
    }

    /// What the filter assumes.
    pub fn character(&self) -> &Character {
        &self.character
    }

    /// How probable each level is.
    pub fn probability(&self) -> [f64; LEVELS] {
        self.probability
    }

    /// The pairs of level and estimate in use.
    fn used(&self) -> impl Iterator<Item = (&Level, &Estimate, f64)> {
        self.character
            .levels
            .iter()
            .zip(&self.estimates)
            .zip(&self.probability)
            .take(self.character.used)
            .map(|((level, estimate), probability)| (level, estimate, *probability))
    }

    /// Forgets everything and starts at a measured position.
    pub fn start(&mut self, position: f64, variance: f64) {
        let c = &self.character;
        let square = |x: f64| x * x;
        for (level, estimate) in c.levels.iter().zip(&mut self.estimates) {
            let mut covariance = Matrix3::zeros();
            covariance[(0, 0)] = variance;
            if level.order != Order::Rest {
                covariance[(1, 1)] = square(c.velocity_sigma);
            }
            if level.order == Order::Acceleration {
                covariance[(2, 2)] = square(c.acceleration_sigma);
            }
            *estimate = Estimate {
                state: Vector3::new(position, 0.0, 0.0),
                covariance,
                shared: Vector3::new(variance, 0.0, 0.0),
            };
        }
        self.probability = [0.0; LEVELS];
        let others = c.used.max(2) as f64 - 1.0;
        for (level, probability) in c.levels.iter().zip(&mut self.probability).take(c.used) {
            *probability = match (c.used, level.order) {
                (1, _) => 1.0,
                (_, Order::Rest) => START_AT_REST,
                _ => (1.0 - START_AT_REST) / others,
            };
        }
        self.started = true;
        self.refused = 0;
    }

    /// Goes on by `span_s` (positive).
    pub fn predict(&mut self, span_s: f64, push: Push) {
        if !self.started {
            return;
        }
        self.mix(span_s);
        self.allowance = REFUSE_ACCELERATION * span_s * span_s;
        let levels = self.character.levels.iter().zip(&mut self.estimates);
        for (level, estimate) in levels.take(self.character.used) {
            let f = transition(span_s);
            estimate.state = f * estimate.state + Vector3::new(push.position, push.velocity, 0.0);
            estimate.covariance =
                f * estimate.covariance * f.transpose() + level.noise(span_s.abs());
            estimate.shared = Vector3::zeros();
            if level.order == Order::Rest {
                estimate.state[1] = 0.0;
            }
        }
    }

    /// Lets the levels learn from each other, as they may change into each other within `span_s`.
    /// A level that lacks a derivative does not teach it: it would teach that it is zero for sure.
    fn mix(&mut self, span_s: f64) {
        let n = self.character.used;
        if n < 2 {
            return;
        }
        let leave = self
            .character
            .levels
            .map(|level| -(-span_s.abs() / level.stay_s).exp_m1());
        let before = self.estimates;
        let was = self.probability;
        for to in 0..n {
            let weight = |from: usize| {
                was[from]
                    * if from == to {
                        1.0 - leave[from]
                    } else {
                        leave[from] / (n as f64 - 1.0)
                    }
            };
            let total: f64 = (0..n).map(weight).sum();
            self.probability[to] = total;
            let order = self.character.levels[to].order;
            let own = before[to];
            let seen = |from: usize| {
                let mut state = before[from].state;
                let mut covariance = before[from].covariance;
                let known = self.character.levels[from].order as usize;
                for i in 0..3 {
                    if i >= known {
                        state[i] = own.state[i];
                    }
                    for j in 0..3 {
                        if i >= known || j >= known {
                            covariance[(i, j)] = if i >= known && j >= known {
                                own.covariance[(i, j)]
                            } else {
                                0.0
                            };
                        }
                    }
                }
                (state, covariance)
            };
            let mut state = Vector3::zeros();
            for from in 0..n {
                state += seen(from).0 * (weight(from) / total);
            }
            let mut covariance = Matrix3::zeros();
            for from in 0..n {
                let (mean, spread) = seen(from);
                let off = mean - state;
                covariance += (spread + off * off.transpose()) * (weight(from) / total);
            }
            for i in order as usize..3 {
                state[i] = 0.0;
                covariance.fill_row(i, 0.0);
                covariance.fill_column(i, 0.0);
            }
            self.estimates[to] = Estimate {
                state,
                covariance,
                shared: Vector3::zeros(),
            };
        }
    }

    /// The position that is expected.
    pub fn position(&self) -> f64 {
        self.used().map(|(_, e, p)| p * e.state[0]).sum()
    }

    /// Moves the origin that positions count from.
    pub fn shift_origin(&mut self, by: f64) {
        for estimate in &mut self.estimates {
            estimate.state[0] -= by;
        }
    }

    /// Takes a measured position with its variance. False where it was not believed.
    pub fn update(&mut self, position: f64, variance: f64) -> bool {
        if !self.started {
            self.start(position, variance);
            return true;
        }
        let believable = self.used().any(|(_, e, _)| {
            let expected = e.covariance[(0, 0)] + variance;
            let off = (position - e.state[0]).abs() - self.allowance;
            off <= REFUSE_SIGMAS * expected.sqrt()
        });
        if !believable {
            self.refused += 1;
            if self.refused > REFUSE_AT_MOST {
                self.start(position, variance);
            }
            return false;
        }
        self.refused = 0;
        // The likeliest level has the exponent zero, so that not all can vanish.
        let mut exponents = [f64::NEG_INFINITY; LEVELS];
        let n = self.character.used;
        for (estimate, exponent) in self.estimates.iter_mut().zip(&mut exponents).take(n) {
            let expected = estimate.covariance[(0, 0)] + variance;
            let off = position - estimate.state[0];
            let gain = estimate.covariance.column(0) / expected;
            *exponent = -0.5 * (off * off / expected + expected.ln());
            estimate.state += gain * off;
            estimate.covariance -= gain * gain.transpose() * expected;
            estimate.shared = gain * variance;
        }
        let best = exponents.iter().fold(f64::NEG_INFINITY, |a, b| a.max(*b));
        let mut total = 0.0;
        for (probability, exponent) in self.probability.iter_mut().zip(exponents) {
            *probability *= (exponent - best).exp();
            total += *probability;
        }
        for probability in self.probability.iter_mut().take(n) {
            *probability = (*probability / total).max(LEAST_PROBABILITY);
        }
        true
    }

    /// How far the component moves within `span_s` of the last measurement. `own` says that the
    /// pose to be moved is that measurement: then their errors have a part in common.
    pub fn shift(&self, span_s: f64, push: Push, own: bool) -> Shift {
        let f = transition(span_s).row(0) - Vector3::x().transpose();
        let mut shift = Shift::default();
        for (_, e, p) in self.used() {
            shift.by += p * (f * e.state)[0];
            shift.velocity += p * e.state[1];
        }
        for (level, e, p) in self.used() {
            let off = (f * e.state)[0] - shift.by;
            let mut growth = (f * e.covariance * f.transpose())[0]
                + level.noise(span_s.abs())[(0, 0)]
                + off * off;
            if own {
                growth += 2.0 * (f * e.shared)[0];
            }
            shift.growth += p * growth;
        }
        shift.by += push.position;
        // Backwards in time the common part is subtracted; no carrying makes a pose better.
        shift.growth = shift.growth.max(0.0);
        shift
    }
}

impl Level {
    /// What the state's covariance gains within `t` seconds.
    fn noise(&self, t: f64) -> Matrix3<f64> {
        let (t2, t3) = (t * t, t * t * t);
        let (a, j) = (self.acceleration_psd, self.jerk_psd);
        let pp = self.position_psd * t + a * t3 / 3.0 + j * t2 * t3 / 20.0;
        let pv = a * t2 / 2.0 + j * t2 * t2 / 8.0;
        let pa = j * t3 / 6.0;
        let va = j * t2 / 2.0;
        Matrix3::new(
            pp,
            pv,
            pa, //
            pv,
            a * t + j * t3 / 3.0,
            va, //
            pa,
            va,
            j * t,
        )
    }
}

/// Position, velocity and acceleration after `t` seconds.
fn transition(t: f64) -> Matrix3<f64> {
    Matrix3::new(
        1.0,
        t,
        t * t / 2.0, //
        0.0,
        1.0,
        t, //
        0.0,
        0.0,
        1.0,
    )
}
