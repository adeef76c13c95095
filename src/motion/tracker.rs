//! How a platform moves, judged from its poses so far: six independent [`Axis`] filters over x, y,
//! z and small turns about the axes of B.
//!
//! Angles are kept as turns away from a reference attitude that follows the platform, so that they
//! stay small and nothing depends on how roll, pitch and yaw are chosen.

use super::axis::{Axis, Character, LEVELS, Level, Order, Push, Shift};
use super::turn;
use crate::record::Stamp;
use nalgebra::{UnitQuaternion, Vector3};

const fn rest(position_psd: f64, stay_s: f64) -> Level {
    Level {
        order: Order::Rest,
        position_psd,
        acceleration_psd: 0.0,
        jerk_psd: 0.0,
        stay_s,
    }
}

const fn velocity(acceleration_psd: f64, stay_s: f64) -> Level {
    Level {
        order: Order::Velocity,
        position_psd: 0.0,
        acceleration_psd,
        jerk_psd: 0.0,
        stay_s,
    }
}

const fn acceleration(acceleration_psd: f64, jerk_psd: f64, stay_s: f64) -> Level {
    Level {
        order: Order::Acceleration,
        position_psd: 0.0,
        acceleration_psd,
        jerk_psd,
        stay_s,
    }
}

/// Rest, cruise, and starts of some m/s^2.
const CONSTANT_VELOCITY: [Character; 2] = [
    Character {
        levels: [rest(1e-9, 5.0), velocity(0.02, 5.0), velocity(0.5, 1.0)],
        used: 3,
        velocity_sigma: 1.5,
        acceleration_sigma: 0.0,
    },
    Character {
        levels: [rest(1e-10, 5.0), velocity(1e-3, 5.0), velocity(0.1, 1.0)],
        used: 3,
        velocity_sigma: 0.3,
        acceleration_sigma: 0.0,
    },
];

/// Rest, a smooth move, and the jerk between the two, which is short. Chosen on simulated runs
/// (`make delay-table`): livelier levels follow a start sooner and pass on more noise at a cruise.
const CONSTANT_ACCELERATION: [Character; 2] = [
    Character {
        levels: [
            rest(1e-9, 8.0),
            acceleration(0.0, 0.2, 8.0),
            acceleration(0.0, 30.0, 0.1),
        ],
        used: 3,
        velocity_sigma: 1.5,
        acceleration_sigma: 3.0,
    },
    Character {
        levels: [
            rest(1e-10, 8.0),
            acceleration(0.0, 0.01, 8.0),
            acceleration(0.0, 10.0, 0.1),
        ],
        used: 3,
        velocity_sigma: 0.3,
        acceleration_sigma: 2.0,
    },
];

/// What an IMU leaves to be found: velocity and the error of the acceleration, which changes
/// slowly as gravity tilts into it; of an angle, the bias of the rate.
const INERTIAL: [Character; 2] = [
    Character {
        levels: [acceleration(1e-4, 1e-3, 1.0); LEVELS],
        used: 1,
        velocity_sigma: 1.5,
        acceleration_sigma: 0.5,
    },
    Character {
        levels: [Level {
            position_psd: 1e-6,
            ..velocity(1e-7, 1.0)
        }; LEVELS],
        used: 1,
        velocity_sigma: 0.03,
        acceleration_sigma: 0.0,
    },
];

/// What the filter goes by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Model {
    /// Velocity at most.
    Velocity,
    /// Acceleration too.
    Acceleration,
    /// Changes of velocity and attitude are measured by an IMU.
    Inertial,
    /// Changes of attitude are measured by an IMU without accelerometers.
    Rates,
}

/// A measured pose. A component that is not known is NaN.
#[derive(Clone, Copy, Debug)]
pub(super) struct Measured {
    pub position_m: Vector3<f64>,
    pub attitude: UnitQuaternion<f64>,
    /// Which angles are known.
    pub angles: [bool; 3],
    /// Variances of position (m^2) and of turns about the axes of B (rad^2).
    pub variance: [f64; 6],
}

/// What an IMU says of the motion over a span of time.
#[derive(Clone, Copy, Debug)]
pub(super) struct Impulse {
    /// Change of position beyond velocity times time, m; in B.
    pub position_m: Vector3<f64>,
    /// Change of velocity, m/s; in B.
    pub velocity_m_s: Vector3<f64>,
    /// The turn, about the axes of B.
    pub turn: UnitQuaternion<f64>,
}

impl Impulse {
    pub fn none() -> Impulse {
        Impulse {
            position_m: Vector3::zeros(),
            velocity_m_s: Vector3::zeros(),
            turn: UnitQuaternion::identity(),
        }
    }
}

/// The motion from a measured pose to another instant.
#[derive(Clone, Copy, Debug)]
pub(super) struct Increment {
    pub translation_m: Vector3<f64>,
    /// About the axes of B, put before the attitude.
    pub turn: UnitQuaternion<f64>,
    /// Velocity on the way, m/s.
    pub velocity_m_s: Vector3<f64>,
    /// Turning rate about the axes of B on the way, rad/s.
    pub rate_rad_s: Vector3<f64>,
    /// By how much the variances of position and turns grow, m^2 and rad^2.
    pub growth: [f64; 6],
}

/// The filter.
#[derive(Clone, Debug)]
pub(super) struct Tracker {
    axes: [Axis; 6],
    attitude: UnitQuaternion<f64>,
    origin_m: Vector3<f64>,
    last: Option<Stamp>,
    /// Which components the last pose has taught something.
    taught: [bool; 6],
}

/// No pose is better than this, m^2 or rad^2, whatever its covariance says: a micrometre.
const LEAST_VARIANCE: f64 = 1e-12;
/// After a pause as long as this the motion is not the same any more.
const FORGET_S: f64 = 1.0;

impl Tracker {
    pub fn new(model: Model) -> Tracker {
        let [along, about] = match model {
            Model::Velocity => CONSTANT_VELOCITY,
            Model::Acceleration => CONSTANT_ACCELERATION,
            Model::Inertial => INERTIAL,
            Model::Rates => [CONSTANT_ACCELERATION[0], INERTIAL[1]],
        };
        let (along, about) = (Axis::new(along), Axis::new(about));
        Tracker {
            axes: [along, along, along, about, about, about],
            attitude: UnitQuaternion::identity(),
            origin_m: Vector3::zeros(),
            last: None,
            taught: [false; 6],
        }
    }

    /// The attitude at the last pose.
    pub fn attitude(&self) -> UnitQuaternion<f64> {
        let [_, _, _, a, b, c] = &self.axes;
        turn::turn(Vector3::new(a.position(), b.position(), c.position())) * self.attitude
    }

    /// When the last pose was measured that taught something.
    pub fn last(&self) -> Option<Stamp> {
        self.last
    }

    /// Takes a pose; `impulse` is what an IMU says of the time since the last one. A pose that is
    /// not later than the last one teaches nothing, unless time has jumped back.
    pub fn measure(&mut self, stamp: Stamp, measured: &Measured, impulse: &Impulse) {
        let span_s = self.last.map(|last| stamp.since_s(last));
        self.taught = [false; 6];
        match span_s {
            Some(s) if s > 0.0 && s <= FORGET_S => self.predict(s, impulse),
            Some(s) if (-FORGET_S..=0.0).contains(&s) => return,
            _ => {
                for axis in &mut self.axes {
                    *axis = Axis::new(*axis.character());
                }
                self.attitude = measured.attitude;
                self.origin_m = Vector3::zeros();
            }
        }
        self.last = Some(stamp);
        let off_m = measured.position_m - self.origin_m;
        let off_rad = turn::vector(&(measured.attitude * self.attitude.inverse()));
        let values = off_m.iter().chain(&off_rad);
        for (i, (axis, value)) in self.axes.iter_mut().zip(values).enumerate() {
            let known = i < 3 || measured.angles[i - 3];
            let variance = measured.variance[i];
            if known && value.is_finite() && variance.is_finite() {
                self.taught[i] = axis.update(*value, variance.max(LEAST_VARIANCE));
            }
        }
    }

    fn predict(&mut self, span_s: f64, impulse: &Impulse) {
        for (i, axis) in self.axes.iter_mut().enumerate() {
            axis.predict(span_s, impulse.push(i));
        }
        // The reference goes where the platform is expected, and the filters count from there.
        let expected: [f64; 6] = std::array::from_fn(|i| self.axes[i].position());
        for (axis, by) in self.axes.iter_mut().zip(expected) {
            axis.shift_origin(by);
        }
        let [x, y, z, a, b, c] = expected;
        self.origin_m += Vector3::new(x, y, z);
        self.attitude = turn::turn(Vector3::new(a, b, c)) * impulse.turn * self.attitude;
        // Rounding would add up, and faster where the turn itself comes from this attitude.
        self.attitude.renormalize();
    }

    /// The motion within `span_s` of a pose. `own` says that it is the last one measured.
    pub fn increment(&self, span_s: f64, impulse: &Impulse, own: bool) -> Increment {
        let shifts: [Shift; 6] = std::array::from_fn(|i| {
            self.axes[i].shift(span_s, impulse.push(i), own && self.taught[i])
        });
        let [x, y, z, a, b, c] = shifts;
        Increment {
            translation_m: Vector3::new(x.by, y.by, z.by),
            turn: turn::turn(Vector3::new(a.by, b.by, c.by)) * impulse.turn,
            velocity_m_s: Vector3::new(x.velocity, y.velocity, z.velocity),
            rate_rad_s: Vector3::new(a.velocity, b.velocity, c.velocity),
            growth: shifts.map(|shift| shift.growth),
        }
    }
}

impl Impulse {
    fn push(&self, i: usize) -> Push {
        match (self.position_m.get(i), self.velocity_m_s.get(i)) {
            (Some(position), Some(velocity)) => Push {
                position: *position,
                velocity: *velocity,
            },
            // The turn moves the reference attitude, from which the angles count.
            _ => Push::default(),
        }
    }
}
