//! How far along its path the platform is: from rest to rest within limits of speed, acceleration
//! and jerk.

/// Bounds that a profile keeps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Largest speed, m/s.
    pub speed_m_s: f64,
    /// Largest acceleration and deceleration, m/s^2.
    pub acceleration_m_s2: f64,
    /// Largest change of the acceleration, m/s^3.
    pub jerk_m_s3: f64,
}

/// Distance along a path, speed and acceleration at an instant.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Travel {
    /// From the start, m.
    pub distance_m: f64,
    /// m/s
    pub speed_m_s: f64,
    /// m/s^2
    pub acceleration_m_s2: f64,
}

/// A profile from rest to rest.
pub trait Profile {
    /// `t_s` seconds after the start; clamped to the ends.
    fn at(&self, t_s: f64) -> Travel;
    /// From start to rest, s.
    fn duration_s(&self) -> f64;
}

/// Seven phases of constant jerk, the shortest such profile within its limits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SCurve {
    distance_m: f64,
    jerk_m_s3: f64,
    /// Of each of the four phases with jerk, s.
    jerk_s: f64,
    /// From rest to the highest speed, s.
    ramp_s: f64,
    /// At the highest speed, s.
    cruise_s: f64,
}

impl SCurve {
    /// The profile over `distance_m` (not negative) within `limits` (positive).
    pub fn new(distance_m: f64, limits: Limits) -> SCurve {
        let (v, a, j) = (limits.speed_m_s, limits.acceleration_m_s2, limits.jerk_m_s3);
        let ramp = |v: f64| {
            // The full acceleration is reached only if the speed leaves room for it.
            let jerk_s = if v * j >= a * a {
                a / j
            } else {
                (v / j).sqrt()
            };
            let hold_s = if v * j >= a * a { v / a - a / j } else { 0.0 };
            (jerk_s, 2.0 * jerk_s + hold_s)
        };
        let (mut jerk_s, mut ramp_s) = ramp(v);
        let mut cruise_s = distance_m / v - ramp_s;
        if cruise_s < 0.0 {
            // Too short for the full speed: the highest speed at which both ramps fit.
            cruise_s = 0.0;
            let full_acceleration_m = 2.0 * a * a * a / (j * j);
            let v = if distance_m >= full_acceleration_m {
                let b = a * a / j;
                (((b * b) + 4.0 * a * distance_m).sqrt() - b) / 2.0
            } else {
                let jerk_s = libm::cbrt(distance_m / (2.0 * j));
                j * jerk_s * jerk_s
            };
            (jerk_s, ramp_s) = ramp(v);
        }
        SCurve {
            distance_m,
            jerk_m_s3: j,
            jerk_s,
            ramp_s,
            cruise_s,
        }
    }

    /// The ramp from rest up to the highest speed.
    fn ramp(&self, t: f64) -> Travel {
        let (j, tj) = (self.jerk_m_s3, self.jerk_s);
        let a = j * tj;
        let rising = t.min(tj);
        let mut travel = Travel {
            distance_m: j * rising * rising * rising / 6.0,
            speed_m_s: j * rising * rising / 2.0,
            acceleration_m_s2: j * rising,
        };
        let hold_s = self.ramp_s - 2.0 * tj;
        let held = (t - tj).clamp(0.0, hold_s);
        travel.distance_m += travel.speed_m_s * held + a * held * held / 2.0;
        travel.speed_m_s += a * held;
        let falling = t - tj - hold_s;
        if falling > 0.0 {
            travel.distance_m += travel.speed_m_s * falling + a * falling * falling / 2.0
                - j * falling * falling * falling / 6.0;
            travel.speed_m_s += a * falling - j * falling * falling / 2.0;
            travel.acceleration_m_s2 = a - j * falling;
        }
        travel
    }
}

impl Profile for SCurve {
    fn at(&self, t_s: f64) -> Travel {
        let t = t_s.clamp(0.0, self.duration_s());
        if t <= self.ramp_s {
            return self.ramp(t);
        }
        let top = self.ramp(self.ramp_s);
        if t <= self.ramp_s + self.cruise_s {
            return Travel {
                distance_m: top.distance_m + top.speed_m_s * (t - self.ramp_s),
                speed_m_s: top.speed_m_s,
                acceleration_m_s2: 0.0,
            };
        }
        // The way down is the way up, seen from the end.
        let mirrored = self.ramp(self.duration_s() - t);
        Travel {
            distance_m: self.distance_m - mirrored.distance_m,
            speed_m_s: mirrored.speed_m_s,
            acceleration_m_s2: -mirrored.acceleration_m_s2,
        }
    }

    fn duration_s(&self) -> f64 {
        2.0 * self.ramp_s + self.cruise_s
    }
}

/// A polynomial of fifth degree: jerk is bounded but not limited, and nothing jumps but the jerk.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quintic {
    distance_m: f64,
    duration_s: f64,
}

impl Quintic {
    /// The profile over `distance_m` (not negative) within the limits of speed and acceleration.
    pub fn new(distance_m: f64, limits: Limits) -> Quintic {
        // Highest speed 15/8 D/T at the middle, highest acceleration 10/sqrt(3) D/T^2.
        let by_speed = 1.875 * distance_m / limits.speed_m_s;
        let by_acceleration = (10.0 / 3f64.sqrt() * distance_m / limits.acceleration_m_s2).sqrt();
        Quintic {
            distance_m,
            duration_s: by_speed.max(by_acceleration),
        }
    }
}

impl Profile for Quintic {
    fn at(&self, t_s: f64) -> Travel {
        if self.duration_s <= 0.0 {
            return Travel::default();
        }
        let (d, full_s) = (self.distance_m, self.duration_s);
        let u = (t_s / full_s).clamp(0.0, 1.0);
        Travel {
            distance_m: d * u * u * u * (10.0 - 15.0 * u + 6.0 * u * u),
            speed_m_s: d / full_s * 30.0 * u * u * (1.0 - u) * (1.0 - u),
            acceleration_m_s2: d / (full_s * full_s) * 60.0 * u * (1.0 - u) * (1.0 - 2.0 * u),
        }
    }

    fn duration_s(&self) -> f64 {
        self.duration_s
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Speed and acceleration against central differences, ends and limits.
    fn check(profile: &dyn Profile, distance_m: f64, limits: Limits) {
        let full_s = profile.duration_s();
        let end = profile.at(full_s);
        assert!((end.distance_m - distance_m).abs() < 1e-9 * (1.0 + distance_m));
        assert!(end.speed_m_s.abs() < 1e-6 && profile.at(0.0) == Travel::default());
        let h = 1e-4 * full_s;
        let mut last_m = 0.0;
        for k in 1..400 {
            let t = full_s * f64::from(k) / 400.0;
            let (before, now, after) = (profile.at(t - h), profile.at(t), profile.at(t + h));
            let speed = (after.distance_m - before.distance_m) / (2.0 * h);
            let acceleration = (after.speed_m_s - before.speed_m_s) / (2.0 * h);
            // The jerk may jump within a difference; a quintic's is at most 60 D/T^3.
            let jerk = limits.jerk_m_s3.max(60.0 * distance_m / full_s.powi(3));
            assert!((speed - now.speed_m_s).abs() < jerk * h * h + 1e-9, "{t}");
            let off = (acceleration - now.acceleration_m_s2).abs();
            assert!(off < jerk * h + 1e-6, "{t}: {acceleration} {now:?}");
            assert!(now.speed_m_s <= limits.speed_m_s * (1.0 + 1e-9));
            assert!(now.acceleration_m_s2.abs() <= limits.acceleration_m_s2 * (1.0 + 1e-9));
            assert!(now.distance_m >= last_m - 1e-12);
            last_m = now.distance_m;
        }
    }

    proptest! {
        #[test]
        fn profiles_keep_their_limits(
            distance_m in 1e-3..20.0f64,
            speed_m_s in 0.05..5.0f64,
            acceleration_m_s2 in 0.2..20.0f64,
            jerk_m_s3 in 5.0..500.0f64,
        ) {
            let limits = Limits { speed_m_s, acceleration_m_s2, jerk_m_s3 };
            check(&SCurve::new(distance_m, limits), distance_m, limits);
            check(&Quintic::new(distance_m, limits), distance_m, limits);
        }
    }

    #[test]
    fn the_long_curve_has_the_textbook_duration() {
        // 10 m at 3 m/s, 5 m/s^2, 50 m/s^3: D/v + v/a + a/j.
        let limits = Limits {
            speed_m_s: 3.0,
            acceleration_m_s2: 5.0,
            jerk_m_s3: 50.0,
        };
        let curve = SCurve::new(10.0, limits);
        assert!((curve.duration_s() - (10.0 / 3.0 + 0.6 + 0.1)).abs() < 1e-12);
        assert!((curve.at(curve.duration_s() / 2.0).speed_m_s - 3.0).abs() < 1e-12);
    }

    #[test]
    fn no_distance_is_no_motion() {
        let limits = Limits {
            speed_m_s: 1.0,
            acceleration_m_s2: 1.0,
            jerk_m_s3: 10.0,
        };
        assert_eq!(SCurve::new(0.0, limits).duration_s(), 0.0);
        assert_eq!(Quintic::new(0.0, limits).at(1.0), Travel::default());
    }
}
