//! What measured poses tell of the pulleys that a controller believes in.
//!
//! The controller winds the cables for a desired pose by the pulleys that it believes in, the cables
//! put the platform somewhere else, and the platform's pose is measured. The unknowns are shifts of
//! all pulleys of a group along one axis of B. They are found by weighted least squares over the six
//! components of all places: the poses that [`Winches`] predict for shifted pulleys against the
//! measured ones. Gauss and Newton's steps, with derivatives by central differences of the forward
//! kinematics.
//!
//! Their covariance is that of the weights, made larger by chi-square per degree of freedom where that
//! exceeds 1: the robot then differs from its belief in more than the unknowns say.

use super::kinematics::{KinematicsError, Winches};
use super::{Place, Pose, Robot};
use nalgebra::{Cholesky, DMatrix, DVector, Dyn, Matrix6};
use std::fmt;
use std::str::FromStr;

/// An axis of B.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Coordinate {
    /// Depth.
    X,
    /// Along the frame.
    Y,
    /// Up.
    Z,
}

impl Coordinate {
    fn index(self) -> usize {
        match self {
            Coordinate::X => 0,
            Coordinate::Y => 1,
            Coordinate::Z => 2,
        }
    }
}

/// A shift of all pulleys of a group along an axis; as text `upper.z`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Unknown {
    /// The group.
    pub group: String,
    /// The axis.
    pub coordinate: Coordinate,
}

impl fmt::Display for Unknown {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let axis = ["x", "y", "z"][self.coordinate.index()];
        write!(f, "{}.{axis}", self.group)
    }
}

impl FromStr for Unknown {
    type Err = String;

    fn from_str(text: &str) -> Result<Unknown, String> {
        let wanted = || format!("\"{text}\": a group of cables and an axis are wanted, as upper.z");
        let (group, axis) = text.rsplit_once('.').ok_or_else(wanted)?;
        let coordinate = match axis {
            "x" => Coordinate::X,
            "y" => Coordinate::Y,
            "z" => Coordinate::Z,
            _ => return Err(wanted()),
        };
        if group.is_empty() {
            return Err(wanted());
        }
        Ok(Unknown {
            group: group.to_owned(),
            coordinate,
        })
    }
}

/// Why nothing can be found.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CalibrationError {
    /// No cable of the robot is in the group.
    #[error("no cable has the group \"{0}\"")]
    Group(String),
    /// Nothing is looked for.
    #[error("no group and axis are given")]
    NoUnknown,
    /// Nothing was measured.
    #[error("no place has a measured pose")]
    NoPlace,
    /// The places do not show the unknowns.
    #[error("the places do not show {0}; measure at other heights and further to the sides")]
    NotShown(String),
    /// A covariance that is none.
    #[error("the covariance at place {0} is not positive definite; give --model-sigma-mm")]
    Covariance(usize),
    /// The robot cannot be at a place.
    #[error(transparent)]
    Kinematics(#[from] KinematicsError),
}

/// What was found of one unknown.
#[derive(Clone, Debug, PartialEq)]
pub struct Shift {
    /// Which.
    pub unknown: Unknown,
    /// The real pulleys' coordinate minus the believed one, m.
    pub shift_m: f64,
    /// Its standard deviation, m.
    pub sigma_m: f64,
}

/// What places tell.
#[derive(Clone, Debug, PartialEq)]
pub struct Calibrated {
    /// The unknowns.
    pub shifts: Vec<Shift>,
    /// Chi-square per degree of freedom: 1 where the shifts explain all that was measured.
    pub chi2_per_dof: f64,
    /// What the shifts leave of each place's measured pose: measured minus predicted.
    pub left: Vec<Pose>,
    /// The belief with its pulleys shifted.
    pub corrected: Robot,
}

/// Steps of the search.
const STEPS: usize = 30;
/// Half the difference that derivatives are taken over, m.
const DIFFERENCE_M: f64 = 1e-4;
/// A standard deviation from which on a shift is not shown at all, m: rounding alone shows that much.
const SHOWN_M: f64 = 1.0;
/// A step this small, in standard deviations, ends the search.
const SMALL: f64 = 1e-6;

/// Finds the unknowns from places; see the module.
///
/// # Errors
/// An unknown that is none of the robot's or that the places do not show; a robot that cannot be at
/// a place.
pub fn calibrate(
    belief: &Robot,
    places: &[Place],
    unknowns: &[Unknown],
) -> Result<Calibrated, CalibrationError> {
    for unknown in unknowns {
        if !belief.groups().contains(&unknown.group.as_str()) {
            return Err(CalibrationError::Group(unknown.group.clone()));
        }
    }
    if unknowns.is_empty() {
        return Err(CalibrationError::NoUnknown);
    }
    if places.is_empty() {
        return Err(CalibrationError::NoPlace);
    }
    let whitening = whitening(places)?;
    let n = unknowns.len();
    let mut shifts = DVector::zeros(n);
    let mut covariance = DMatrix::zeros(n, n);
    for _ in 0..STEPS {
        let Equations { normal, slope } =
            Equations::at(belief, places, unknowns, &shifts, &whitening)?;
        let factor = shown(&normal).ok_or_else(|| CalibrationError::NotShown(names(unknowns)))?;
        covariance = factor.inverse();
        let step = factor.solve(&slope);
        shifts += &step;
        let small = |i: usize| step[i].abs() < SMALL * covariance[(i, i)].sqrt();
        if (0..n).all(small) {
            break;
        }
    }
    let left = differences(belief, places, unknowns, &shifts)?;
    let squares = whitening
        .iter()
        .zip(&left)
        .map(|(w, l)| (w * l).norm_squared());
    let degrees = (6 * places.len()).saturating_sub(n).max(1) as f64;
    let chi2_per_dof = squares.sum::<f64>() / degrees;
    let scale = chi2_per_dof.max(1.0).sqrt();
    let found = unknowns.iter().enumerate().map(|(i, unknown)| Shift {
        unknown: unknown.clone(),
        shift_m: shifts[i],
        sigma_m: covariance[(i, i)].sqrt() * scale,
    });
    Ok(Calibrated {
        shifts: found.collect(),
        chi2_per_dof,
        left,
        corrected: shifted(belief, unknowns, &shifts),
    })
}

fn names(unknowns: &[Unknown]) -> String {
    let names: Vec<String> = unknowns.iter().map(Unknown::to_string).collect();
    names.join(" and ")
}

/// What makes a place's components independent and alike: W with W^T W the inverse of its covariance.
fn whitening(places: &[Place]) -> Result<Vec<Matrix6<f64>>, CalibrationError> {
    let of_place = |(k, place): (usize, &Place)| {
        let inverse = place.covariance.cholesky().map(|c| c.inverse());
        let factor = inverse.and_then(|inverse| inverse.cholesky());
        factor
            .map(|f| f.l().transpose())
            .ok_or(CalibrationError::Covariance(k + 1))
    };
    places.iter().enumerate().map(of_place).collect()
}

/// The normal equations of a step.
struct Equations {
    normal: DMatrix<f64>,
    slope: DVector<f64>,
}

impl Equations {
    /// Those at pulleys shifted so, with derivatives by central differences.
    fn at(
        belief: &Robot,
        places: &[Place],
        unknowns: &[Unknown],
        shifts: &DVector<f64>,
        whitening: &[Matrix6<f64>],
    ) -> Result<Equations, KinematicsError> {
        let n = unknowns.len();
        let left = differences(belief, places, unknowns, shifts)?;
        let mut columns: Vec<Vec<Pose>> = Vec::with_capacity(n);
        for k in 0..n {
            let step = DVector::from_fn(n, |i, _| if i == k { DIFFERENCE_M } else { 0.0 });
            let above = differences(belief, places, unknowns, &(shifts + &step))?;
            let below = differences(belief, places, unknowns, &(shifts - &step))?;
            let slope = |(a, b): (&Pose, &Pose)| (b - a) / (2.0 * DIFFERENCE_M);
            columns.push(above.iter().zip(&below).map(slope).collect());
        }
        let (mut normal, mut slope) = (DMatrix::zeros(n, n), DVector::zeros(n));
        for (p, whiten) in whitening.iter().enumerate() {
            let rows: Vec<Pose> = columns.iter().map(|column| whiten * column[p]).collect();
            let error = whiten * left[p];
            for (i, row) in rows.iter().enumerate() {
                slope[i] += row.dot(&error);
                for (j, other) in rows.iter().enumerate() {
                    normal[(i, j)] += row.dot(other);
                }
            }
        }
        Ok(Equations { normal, slope })
    }
}

/// The normal equations' factor, if they show every unknown, and apart from the others.
fn shown(normal: &DMatrix<f64>) -> Option<Cholesky<f64, Dyn>> {
    let n = normal.nrows();
    let scale: Vec<f64> = (0..n).map(|i| normal[(i, i)].sqrt()).collect();
    if scale.iter().any(|s| !(*s > 0.0 && s.is_finite())) {
        return None;
    }
    let correlation = DMatrix::from_fn(n, n, |i, j| normal[(i, j)] / (scale[i] * scale[j]));
    if !(correlation.symmetric_eigenvalues().min() > 1e-9) {
        return None;
    }
    let factor = normal.clone().cholesky()?;
    let covariance = factor.inverse();
    let known = |i: usize| covariance[(i, i)] < SHOWN_M * SHOWN_M;
    (0..n).all(known).then_some(factor)
}

/// Measured minus predicted, for pulleys shifted so.
fn differences(
    belief: &Robot,
    places: &[Place],
    unknowns: &[Unknown],
    shifts: &DVector<f64>,
) -> Result<Vec<Pose>, KinematicsError> {
    let winches = Winches {
        belief: belief.clone(),
        real: shifted(belief, unknowns, shifts),
    };
    let one = |place: &Place| Ok(place.measured - winches.goes(&place.desired)?.pose);
    places.iter().map(one).collect()
}

fn shifted(belief: &Robot, unknowns: &[Unknown], shifts: &DVector<f64>) -> Robot {
    let mut robot = belief.clone();
    for (unknown, shift_m) in unknowns.iter().zip(shifts.iter()) {
        let in_group = |cable: &&mut super::Cable| cable.group == unknown.group;
        for cable in robot.cables.iter_mut().filter(in_group) {
            cable.pulley_m[unknown.coordinate.index()] += shift_m;
        }
    }
    robot
}

#[cfg(test)]
mod tests {
    use super::super::config::tests::cablar;
    use super::*;
    use crate::simulate::Seed;
    use crate::simulate::random::Purpose;

    /// Table 5.1's poses.
    const POSES: [[f64; 4]; 11] = [
        [-0.027, -0.022, 0.465, 0.0],
        [-0.027, -0.022, 0.765, 0.0],
        [0.0, 0.0, 2.0, 0.0],
        [0.0, 0.0, 2.0, 2.0],
        [0.0, 0.0, 2.0, -2.0],
        [0.0, 0.0, 2.5, 0.0],
        [0.0, 0.0, 1.75, 0.0],
        [0.0, 1.0, 1.75, 2.0],
        [0.0, 2.0, 1.75, 0.0],
        [0.0, -1.0, 1.75, -2.0],
        [0.0, -2.0, 1.75, 0.0],
    ];
    /// What a measured pose is worth here: 1 mm and 0.05 deg.
    const SIGMA: [f64; 2] = [1e-3, 0.9e-3];

    fn unknown(text: &str) -> Unknown {
        text.parse().unwrap()
    }

    /// Places of a robot whose upper pulleys are higher by `shift_m`, measured without an error.
    fn exact(shift_m: f64) -> Vec<Place> {
        let belief = cablar();
        let upper = [unknown("upper.z")];
        let winches = Winches {
            real: shifted(&belief, &upper, &DVector::from_element(1, shift_m)),
            belief,
        };
        let [p, a] = SIGMA.map(|s| s * s);
        let place = |[x, y, z, roll]: [f64; 4]| {
            let desired = Pose::new(x, y, z, roll.to_radians(), 0.0, 0.0);
            Place {
                desired,
                measured: winches.goes(&desired).unwrap().pose,
                covariance: Matrix6::from_diagonal(&Pose::new(p, p, p, a, a, a)),
                count: 1,
            }
        };
        POSES.into_iter().map(place).collect()
    }

    #[test]
    fn a_wrong_height_is_found() {
        for shift_m in [0.06, -0.2, 0.0] {
            let found = calibrate(&cablar(), &exact(shift_m), &[unknown("upper.z")]).unwrap();
            assert!(
                (found.shifts[0].shift_m - shift_m).abs() < 1e-8,
                "{found:?}"
            );
            assert!(found.chi2_per_dof < 1e-9);
            assert!(found.left.iter().all(|left| left.amax() < 1e-8));
            let z = found.corrected.cables[0].pulley_m[2];
            assert!((z - 5.3 - shift_m).abs() < 1e-8);
        }
    }

    /// Over 400 campaigns the estimate scatters by what it says, and chi-square is what it should be.
    #[test]
    fn the_estimate_is_as_good_as_it_says() {
        let unknowns = [unknown("upper.z"), unknown("lower.z")];
        let truth = exact(0.06);
        let campaigns = 400;
        let (mut nees, mut chi2) = (0.0, 0.0);
        for number in 0..campaigns {
            let mut draws = Seed(5).draws(Purpose::Course, number);
            let mut places = truth.clone();
            for place in &mut places {
                for i in 0..6 {
                    place.measured[i] += SIGMA[i / 3] * draws.normal();
                }
            }
            let found = calibrate(&cablar(), &places, &unknowns).unwrap();
            let sigma = found.shifts[0].sigma_m / found.chi2_per_dof.max(1.0).sqrt();
            nees += ((found.shifts[0].shift_m - 0.06) / sigma).powi(2);
            chi2 += found.chi2_per_dof;
        }
        let n = campaigns as f64;
        // Four standard deviations of the mean of chi-squares with one and with 64 degrees of freedom.
        assert!(
            (nees / n - 1.0).abs() < 4.0 * (2.0 / n).sqrt(),
            "{}",
            nees / n
        );
        assert!(
            (chi2 / n - 1.0).abs() < 4.0 * (2.0 / (64.0 * n)).sqrt(),
            "{}",
            chi2 / n
        );
    }

    #[test]
    fn what_places_do_not_show_is_said() {
        let places = exact(0.06);
        let twice = [unknown("upper.z"), unknown("upper.z")];
        let found = calibrate(&cablar(), &places, &twice);
        assert!(
            matches!(found, Err(CalibrationError::NotShown(_))),
            "{found:?}"
        );
        // At home the platform is where it is locked, whatever the pulleys.
        let found = calibrate(&cablar(), &places[..1], &[unknown("upper.z")]);
        assert!(
            matches!(found, Err(CalibrationError::NotShown(_))),
            "{found:?}"
        );
        let found = calibrate(&cablar(), &places, &[unknown("middle.z")]);
        assert_eq!(found, Err(CalibrationError::Group("middle".into())));
        let found = calibrate(&cablar(), &[], &[unknown("upper.z")]);
        assert_eq!(found, Err(CalibrationError::NoPlace));
        let found = calibrate(&cablar(), &places, &[]);
        assert_eq!(found, Err(CalibrationError::NoUnknown));
        let mut flat = places;
        flat[2].covariance[(4, 4)] = 0.0;
        let found = calibrate(&cablar(), &flat, &[unknown("upper.z")]);
        assert_eq!(found, Err(CalibrationError::Covariance(3)));
    }

    #[test]
    fn unknowns_are_read_and_written() {
        for text in ["upper.z", "a.b.x"] {
            assert_eq!(unknown(text).to_string(), text);
        }
        for text in ["upper", "upper.w", ".z", ""] {
            assert!(Unknown::from_str(text).is_err(), "{text}");
        }
    }
}
