//! How lively a quantity is at the moment: at rest, cruising, or starting and stopping. For filters
//! that need to know how far to trust the past.

use super::axis::{Axis, Character, Level, Order};

/// How a quantity gets from one measurement to the next.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Gait {
    /// It stays where it is.
    Rest,
    /// It has a velocity, which white acceleration changes.
    Moving {
        /// Power spectral density of the acceleration, m^2/s^3 (rad^2/s^3 for an angle).
        psd: f64,
    },
}

/// Judges a quantity by its measurements so far: an interacting multiple model (Blom and Bar-Shalom
/// 1988) of rest and two levels of white acceleration.
#[derive(Clone, Debug)]
pub struct Liveliness {
    axis: Axis,
}

/// How long a state lasts on average, s.
const STAY_S: [f64; 3] = [5.0, 2.0, 1.0];

impl Liveliness {
    /// `psd` are the accelerations' power spectral densities of cruising and of starting, m^2/s^3;
    /// `velocity_sigma` the standard deviation of a velocity that nothing is known of, m/s (rad for m
    /// for an angle).
    pub fn new(psd: [f64; 2], velocity_sigma: f64) -> Liveliness {
        let level = |order, acceleration_psd, position_psd, stay_s| Level {
            order,
            position_psd,
            acceleration_psd,
            jerk_psd: 0.0,
            stay_s,
        };
        let levels = [
            level(Order::Rest, 0.0, 1e-9 * velocity_sigma.powi(2), STAY_S[0]),
            level(Order::Velocity, psd[0], 0.0, STAY_S[1]),
            level(Order::Velocity, psd[1], 0.0, STAY_S[2]),
        ];
        Liveliness {
            axis: Axis::new(Character {
                used: levels.len(),
                levels,
                velocity_sigma,
                acceleration_sigma: 0.0,
            }),
        }
    }

    /// Takes a measurement `span_s` after the last one and says how the quantity got there.
    pub fn step(&mut self, span_s: f64, value: f64, variance: f64) -> Gait {
        self.axis.predict(span_s, Default::default());
        self.axis.update(value, variance);
        let [rest, cruise, start] = self.axis.probability();
        if rest > 0.5 {
            return Gait::Rest;
        }
        let [_, slow, fast] = self.axis.character().levels;
        // The mean of the roots: a start that is hardly probable does not make a cruise lively.
        let share = start / (cruise + start).max(f64::MIN_POSITIVE);
        let root =
            (1.0 - share) * slow.acceleration_psd.sqrt() + share * fast.acceleration_psd.sqrt();
        let psd = root * root;
        Gait::Moving { psd }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Scans of a platform that stands, starts with 5 m/s^2, cruises and stands again; 0.4 mm of
    /// noise that alternates.
    #[test]
    fn a_start_is_seen_at_once_and_a_rest_soon() {
        let mut judge = Liveliness::new([0.02, 20.0], 1.5);
        let dt = 1.0 / 35.0;
        let (mut position, mut velocity) = (1.0, 0.0);
        for k in 0..140 {
            let acceleration = match k {
                40..50 => 5.0,
                90..100 => -5.0,
                _ => 0.0,
            };
            velocity += acceleration * dt;
            position += velocity * dt;
            let noise = if k % 2 == 0 { 4e-4 } else { -4e-4 };
            let gait = judge.step(dt, position + noise, 1.6e-7);
            match k {
                1..40 | 125.. => assert_eq!(gait, Gait::Rest, "{k}"),
                42..50 => assert!(matches!(gait, Gait::Moving { psd } if psd > 1.0), "{k}"),
                80..90 => assert!(matches!(gait, Gait::Moving { psd } if psd < 1.0), "{k}"),
                _ => {}
            }
        }
    }
}
