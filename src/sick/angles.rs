//! The angles that the device means, from the rounded ones that it sends.
//!
//! A step of 1/6 deg goes over the wire as 1667 (1e-4 deg). Used as it stands it ends 0.038 deg
//! wrong at beam 1140, which is 20 mm at 30 m.

/// Units of an angle on the wire in a degree.
const PER_DEGREE: f64 = 1e4;
/// How far rounding or truncation can take an angle, in units of the wire.
const ROUNDING: f64 = 1.0;

/// The angular step, deg, from its wire value (1e-4 deg): 2 deg / round(20000 / raw), which gives
/// 1/6, 1/4, 1/3, 1/2, 2/3 and 1 deg and the interlaced 1/12 and 1/24 deg exactly. A value that
/// does not round to such a step (another family's) is taken as it stands.
pub fn true_step_deg(raw: u16) -> f64 {
    let as_sent = f64::from(raw) / PER_DEGREE;
    let parts = (2.0 / as_sent).round();
    let step = 2.0 / parts;
    // Below 1/50 deg neighbouring steps lie closer together than the wire's unit.
    if (1.0..=100.0).contains(&parts) && ((step - as_sent) * PER_DEGREE).abs() < ROUNDING {
        step
    } else {
        as_sent
    }
}

/// The first beam's angle, deg, from its wire value (1e-4 deg): the nearest multiple of half a
/// true step, because a device that leaves out the last beam of its aperture starts at -4.8333.
pub fn first_angle_deg(raw: i32, step_deg: f64) -> f64 {
    let as_sent = f64::from(raw) / PER_DEGREE;
    let halves = (2.0 * as_sent / step_deg).round();
    let snapped = halves * step_deg / 2.0;
    if ((snapped - as_sent) * PER_DEGREE).abs() < ROUNDING {
        snapped
    } else {
        as_sent
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_resolution_of_the_lms5xx() {
        let steps = [
            (417, 1.0 / 24.0),
            (833, 1.0 / 12.0),
            (1667, 1.0 / 6.0),
            (2500, 0.25),
            (3333, 1.0 / 3.0),
            (5000, 0.5),
            (6667, 2.0 / 3.0),
            (10_000, 1.0),
        ];
        for (raw, step_deg) in steps {
            assert_eq!(true_step_deg(raw), step_deg, "{raw}");
        }
    }

    #[test]
    fn other_steps_stand_as_sent() {
        // MRS6000 0.13 deg, R2000 0.225 deg; truncated 2/3 deg and nothing.
        assert_eq!(true_step_deg(1300), 0.13);
        assert_eq!(true_step_deg(2250), 0.225);
        assert_eq!(true_step_deg(6666), 2.0 / 3.0);
        assert_eq!(true_step_deg(0), 0.0);
        assert_eq!(true_step_deg(65_535), 6.5535);
    }

    #[test]
    fn start_angles_snap_to_half_steps() {
        let third = 1.0 / 3.0;
        assert!((first_angle_deg(-48_333, third) + 29.0 / 6.0).abs() < 1e-12);
        assert_eq!(first_angle_deg(-50_000, 1.0 / 6.0), -5.0);
        assert!((first_angle_deg(303_333, 2.0 / 3.0) - 91.0 / 3.0).abs() < 1e-12);
        assert_eq!(first_angle_deg(700_000, 0.5), 70.0);
        assert_eq!(first_angle_deg(-450_000, 0.5), -45.0);
        // Not a multiple of half a step, and no step at all.
        assert_eq!(first_angle_deg(1234, 0.5), 0.1234);
        assert_eq!(first_angle_deg(1234, 0.0), 0.1234);
    }
}
