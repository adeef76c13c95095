//! How the IMU sits on the platform, from a run in which both IMU and scanner saw the platform tilt.
//!
//! Both know the vertical: the IMU in its own axes, the scan in the platform's. The constant small
//! turn that takes one into the other is the misalignment, about P's x (seen as roll) and P's y (as
//! pitch); a turn about the vertical does not show. Roll is in every scan, as the slope of the
//! ceiling line. Pitch is in a scan only where strips on the walls show it; otherwise it is in the
//! run if the platform stayed in one plane x = constant while its height changed, because a wrong
//! pitch moves x by the height below the ceiling times the error (dx = -h dpitch). A constant error
//! of the IMU's own attitude, and one that wanders over longer than the run, cannot be told from its
//! mounting: they are taken out with it, and the uncertainty says nothing of them.
//!
//! Errors of neighbouring scans are alike (the IMU's slow walk, an edge between the same two
//! beams), so that a fit that took them as independent would boast: the uncertainty is made from
//! blocks of the run (sandwich with clustered scores).

use super::mounting::turned_by;
use super::thinned::Thinned;
use crate::frame::Frame;
use nalgebra::{Rotation3, SMatrix, SVector, Vector3};

/// Turn about x, turn about y, constant x.
const N: usize = 3;
type Square = SMatrix<f64, N, N>;
type Column = SVector<f64, N>;

/// What one scan says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Observation {
    /// Roll and pitch that the IMU gives with the mounting of the frame file, rad.
    pub imu_rad: [f64; 2],
    /// Roll that the scan gives, rad, and its standard deviation.
    pub roll_rad: [f64; 2],
    /// Pitch that the scan gives without the IMU, rad, and its standard deviation; none where the
    /// scan does not show it.
    pub pitch_rad: Option<[f64; 2]>,
    /// x solved with the IMU's pitch, m, its standard deviation for a known pitch, and dx/dpitch,
    /// m/rad; none where x is not to be compared.
    pub x_m: Option<[f64; 3]>,
}

/// The misalignment found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Alignment {
    /// Turn about P's x that the frame file's mounting lacks, rad.
    pub roll_rad: f64,
    /// Its standard deviation.
    pub roll_sigma_rad: f64,
    /// Turn about P's y, rad; none where the run does not show it.
    pub pitch_rad: Option<f64>,
    /// Its standard deviation.
    pub pitch_sigma_rad: f64,
    /// The IMU's roll, pitch, yaw on P with the turn added, deg (`imu.rotation_deg`).
    pub rotation_deg: [f64; 3],
    /// Scans used.
    pub scans: usize,
}

/// Why there is no alignment.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum AlignmentError {
    /// Not enough to tell a spread.
    #[error(
        "{0} scans had both a roll of their own and a fresh IMU sample; at least {FEWEST} are needed"
    )]
    TooFew(usize),
}

/// Fewest scans.
pub const FEWEST: usize = 16;
/// Numbers of blocks of the run that the uncertainty is made from. Few long blocks hold slow errors,
/// many short ones give a steadier figure: the largest of the three counts.
const BLOCKS: [usize; 3] = [8, 16, 32];
/// The most of them.
const FINEST: usize = 32;
/// Most observations kept.
const KEPT: usize = 100_000;
/// Gauss-Newton steps; the problem is nearly linear.
const STEPS: usize = 8;
/// Residuals beyond this many standard deviations weigh less (Huber).
const HUBER: f64 = 2.5;
/// The pitch counts as shown where its standard deviation is below this, rad.
const PITCH_LIMIT_RAD: f64 = 0.3 * std::f64::consts::PI / 180.0;

/// Collects a run.
#[derive(Clone, Debug, Default)]
pub struct Aligner {
    observations: Thinned<Observation, KEPT>,
}

impl Aligner {
    /// Takes one scan.
    pub fn add(&mut self, observation: Observation) {
        self.observations.add(|| observation);
    }

    /// The misalignment relative to the frame file's mounting of the IMU.
    ///
    /// # Errors
    /// [`AlignmentError::TooFew`].
    pub fn solve(&self, frame: &Frame) -> Result<Alignment, AlignmentError> {
        let n = self.observations.kept().len();
        if n < FEWEST {
            return Err(AlignmentError::TooFew(n));
        }
        let pitch_is_shown = self
            .observations
            .kept()
            .iter()
            .any(|o| o.pitch_rad.is_some());
        let x_is_used = self.observations.kept().iter().any(|o| o.x_m.is_some());
        let seen = pitch_is_shown || x_is_used;
        // A weak prior (10 deg, 10 m) keeps the turn in bounds where little shows it; where nothing
        // shows the pitch, it is held.
        let pitch_weight = if seen { 33.0 } else { 1e15 };
        let prior = Square::from_diagonal(&Column::new(33.0, pitch_weight, 0.01));
        let mut state = Column::zeros();
        let mut variances = Column::zeros();
        for _ in 0..STEPS {
            let (information, scores) = self.normal_equations(&state);
            let Some(factor) = (information + prior).cholesky() else {
                break;
            };
            let inverse = factor.inverse();
            let total: Column = scores.iter().sum();
            state += inverse * (total - prior * state);
            // Never below what independent scans would give.
            variances = inverse.diagonal();
            let fitted = if seen { 3.0 } else { 1.0 };
            for blocks in BLOCKS {
                let mut spread = Square::zeros();
                for part in scores.chunks(FINEST / blocks) {
                    let score: Column = part.iter().sum();
                    spread += score * score.transpose();
                }
                let few = blocks as f64 / (blocks as f64 - fitted);
                let clustered = inverse * spread * inverse * few;
                variances = variances.sup(&clustered.diagonal());
            }
        }
        let sigma = |k: usize| variances[k].max(0.0).sqrt();
        let shown = seen && sigma(1) < PITCH_LIMIT_RAD;
        let pitch_rad = shown.then_some(state[1]);
        Ok(Alignment {
            roll_rad: state[0],
            roll_sigma_rad: sigma(0),
            pitch_rad,
            pitch_sigma_rad: if shown { sigma(1) } else { f64::NAN },
            rotation_deg: turned_by(
                &Rotation3::from_euler_angles(state[0], pitch_rad.unwrap_or(0.0), 0.0),
                frame.imu.rotation_deg,
            ),
            scans: n,
        })
    }

    /// Information, and the score of every block at `state`.
    ///
    /// The scan's sigmas say nothing of the IMU's noise, so that residuals of a kind count by
    /// their own spread where that is wider.
    fn normal_equations(&self, state: &Column) -> (Square, Vec<Column>) {
        let equations: Vec<[Option<Equation>; 3]> = self
            .observations
            .kept()
            .iter()
            .map(|o| equations(o, state))
            .collect();
        let widths = [0, 1, 2].map(|kind| {
            let kinds = equations.iter().filter_map(|e| e[kind]);
            let mut sizes: Vec<f64> = kinds.map(|e| (e.residual / e.sigma).abs()).collect();
            let middle = sizes.len() / 2;
            sizes.sort_unstable_by(f64::total_cmp);
            // The median of a normal variable's size is 0.6745 sigma.
            sizes.get(middle).map_or(1.0, |m| (m / 0.6745).max(1.0))
        });
        let mut information = Square::zeros();
        let mut scores = vec![Column::zeros(); FINEST];
        let count = equations.len().max(1);
        for (i, equations) in equations.iter().enumerate() {
            let Some(score) = scores.get_mut(i * FINEST / count) else {
                continue;
            };
            for (equation, width) in equations.iter().zip(widths) {
                let Some(Equation {
                    residual,
                    sigma,
                    row,
                }) = equation
                else {
                    continue;
                };
                let sigma = sigma * width;
                let size = (residual / sigma).abs();
                let weight = if size > HUBER { HUBER / size } else { 1.0 } / (sigma * sigma);
                if weight.is_finite() {
                    information += row * row.transpose() * weight;
                    *score += row * (weight * residual);
                }
            }
        }
        (information, scores)
    }
}

/// One residual with its standard deviation and its derivatives (of the model) to the state.
#[derive(Clone, Copy)]
struct Equation {
    residual: f64,
    sigma: f64,
    row: Column,
}

/// Roll, pitch and x of one observation at `state`.
fn equations(observation: &Observation, state: &Column) -> [Option<Equation>; 3] {
    let (attitude, slopes) = turned_attitude(observation.imu_rad, state[0], state[1]);
    let angle = |k: usize, [seen, sigma]: [f64; 2]| Equation {
        residual: seen - attitude[k],
        sigma,
        row: Column::new(slopes[k][0], slopes[k][1], 0.0),
    };
    let x = |[x_m, sigma, by_pitch]: [f64; 3]| {
        // With the turned pitch the scan's x would have been another; it is to be constant.
        let x_m = x_m + by_pitch * (attitude[1] - observation.imu_rad[1]);
        Equation {
            residual: x_m - state[2],
            sigma,
            row: Column::new(-by_pitch * slopes[1][0], -by_pitch * slopes[1][1], 1.0),
        }
    };
    [
        Some(angle(0, observation.roll_rad)),
        observation.pitch_rad.map(|seen| angle(1, seen)),
        observation.x_m.map(x),
    ]
}

/// Roll and pitch of the platform if the IMU's mounting is turned by `about_x` and `about_y` (P's
/// axes, rad) against the one that gave `[roll, pitch]`, and their derivatives to both.
fn turned_attitude(
    [roll, pitch]: [f64; 2],
    about_x: f64,
    about_y: f64,
) -> ([f64; 2], [[f64; 2]; 2]) {
    /// Far below any tilt, far above rounding.
    const STEP_RAD: f64 = 1e-5;
    let up = Vector3::new(
        -pitch.sin(),
        pitch.cos() * roll.sin(),
        pitch.cos() * roll.cos(),
    );
    let at = |about_x: f64, about_y: f64| {
        let up = Rotation3::from_euler_angles(about_x, about_y, 0.0) * up;
        [up.y.atan2(up.z), (-up.x).clamp(-1.0, 1.0).asin()]
    };
    let middle = at(about_x, about_y);
    let (by_x, by_y) = (
        at(about_x + STEP_RAD, about_y),
        at(about_x, about_y + STEP_RAD),
    );
    let slope = |k: usize, moved: [f64; 2]| (moved[k] - middle[k]) / STEP_RAD;
    let slopes = [0, 1].map(|k| [slope(k, by_x), slope(k, by_y)]);
    (middle, slopes)
}

/// A pitch that was estimated with a prior, with the prior taken out again; none where the scan
/// added too little to it.
///
/// Both are Gaussian: informations subtract, and so do information-weighted means.
pub fn without_prior(posterior: [f64; 2], prior: [f64; 2]) -> Option<[f64; 2]> {
    let [mean, sigma] = posterior;
    let [prior_mean, prior_sigma] = prior;
    let weight = 1.0 / (sigma * sigma);
    let prior_weight = 1.0 / (prior_sigma * prior_sigma);
    let own = weight - prior_weight;
    if !(own > 4.0 * prior_weight) {
        return None;
    }
    Some([
        (weight * mean - prior_weight * prior_mean) / own,
        1.0 / own.sqrt(),
    ])
}

#[cfg(test)]
mod tests {
    use super::super::pitch::platform_attitude;
    use super::*;
    use crate::record::{Axes, ImuSample};
    use crate::simulate::staged;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    /// What a NED unit that sits on P with `mounting_deg` reads when P is at roll, pitch, yaw; the
    /// heading is as wrong as a compass in a steel hall.
    fn reading(mounting_deg: [f64; 3], platform_rad: [f64; 3], heading: f64) -> ImuSample {
        let down = Rotation3::from_euler_angles(std::f64::consts::PI, 0.0, 0.0);
        let [r, p, y] = platform_rad;
        let platform = Rotation3::from_euler_angles(r, p, y + heading);
        let [r, p, y] = mounting_deg.map(f64::to_radians);
        let unit = platform * Rotation3::from_euler_angles(r, p, y) * down;
        let (roll, pitch, yaw) = (down.inverse() * unit).euler_angles();
        ImuSample {
            axes: Axes::Ned,
            roll_rad: roll,
            pitch_rad: pitch,
            yaw_rad: yaw,
            ..ImuSample::default()
        }
    }

    struct Case {
        nominal_deg: &'static str,
        true_deg: [f64; 3],
        pitch_seen: bool,
        x_constant: bool,
    }

    fn run(case: &Case, seed: u64) -> Alignment {
        let frame = staged::frame(&[(
            "[imu]\nrotation_deg = [0.0, 0.0, 0.0]",
            &format!("[imu]\nrotation_deg = {}", case.nominal_deg),
        )]);
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut normal = |sigma: f64| {
            let z: f64 = StandardNormal.sample(&mut random);
            sigma * z
        };
        let mut aligner = Aligner::default();
        let (mut walk, mut slow) = (0.0, 0.0);
        for k in 0..600 {
            let t = f64::from(k) / 35.0;
            let tilt = [
                0.017 * (1.3 * t).sin(),
                0.012 * (0.9 * t).cos(),
                0.01 * t.sin(),
            ];
            let mut sample = reading(case.true_deg, tilt, 0.7);
            // The IMU's noise, some of it slow.
            walk = 0.95 * walk + normal(1e-4);
            slow = 0.95 * slow + normal(1e-4);
            sample.roll_rad += normal(0.0009) + walk;
            sample.pitch_rad += normal(0.0009) + slow;
            let [roll, pitch, _] = platform_attitude(&sample, &frame);
            let h = 3.2 + 1.4 * (0.4 * t).sin();
            let x_m = 0.02 - h * (pitch - tilt[1]) + normal(0.004);
            aligner.add(Observation {
                imu_rad: [roll, pitch],
                roll_rad: [tilt[0] + normal(1.4e-4), 1.4e-4],
                pitch_rad: case.pitch_seen.then(|| [tilt[1] + normal(1.5e-3), 1.5e-3]),
                x_m: case.x_constant.then_some([x_m, 0.004, -h]),
            });
        }
        aligner.solve(&frame).unwrap()
    }

    #[test]
    fn a_misalignment_is_found_within_its_sigma() {
        for pitch_seen in [true, false] {
            let case = Case {
                nominal_deg: "[0.0, 0.0, 0.0]",
                true_deg: [0.70, -1.10, 0.0],
                pitch_seen,
                x_constant: !pitch_seen,
            };
            let mut sum = [0.0; 2];
            let runs = 60;
            for seed in 0..runs {
                let found = run(&case, seed);
                let off = [
                    (found.rotation_deg[0] - 0.70).to_radians() / found.roll_sigma_rad,
                    (found.rotation_deg[1] + 1.10).to_radians() / found.pitch_sigma_rad,
                ];
                assert!(off[0].abs() < 4.0 && off[1].abs() < 4.0, "{seed}: {off:?}");
                assert!(found.roll_sigma_rad < 0.02f64.to_radians());
                assert!(found.pitch_sigma_rad < 0.1f64.to_radians());
                for (sum, off) in sum.iter_mut().zip(off) {
                    *sum += off * off / f64::from(runs as u32);
                }
            }
            // Honest: the mean square of off/sigma is 1, with 60 runs.
            for nees in sum {
                assert!(nees > 0.5 && nees < 1.9, "{pitch_seen}: {sum:?}");
            }
        }
    }

    #[test]
    fn pitch_that_nothing_shows_is_left_as_it_was() {
        let case = Case {
            nominal_deg: "[0.0, -0.5, 0.0]",
            true_deg: [0.70, -1.10, 0.0],
            pitch_seen: false,
            x_constant: false,
        };
        let found = run(&case, 3);
        assert_eq!(found.pitch_rad, None);
        assert!((found.rotation_deg[0] - 0.70).abs() < 0.05);
        assert!((found.rotation_deg[1] + 0.5).abs() < 1e-3);
    }

    #[test]
    fn a_unit_turned_about_the_vertical_is_aligned_too() {
        let case = Case {
            nominal_deg: "[0.0, 0.0, 90.0]",
            true_deg: [0.40, 0.30, 90.0],
            pitch_seen: true,
            x_constant: false,
        };
        let found = run(&case, 5);
        for (got, want) in found.rotation_deg.iter().zip([0.40, 0.30, 90.0]) {
            assert!((got - want).abs() < 0.1, "{:?}", found.rotation_deg);
        }
    }

    #[test]
    fn too_little_is_refused() {
        let frame = staged::frame(&[]);
        assert_eq!(
            Aligner::default().solve(&frame),
            Err(AlignmentError::TooFew(0))
        );
    }

    #[test]
    fn a_prior_can_be_taken_out() {
        // Combining N(2, 0.5) with the prior N(1, 3) and taking the prior out again.
        let (a, b) = (1.0 / 0.25, 1.0 / 9.0);
        let posterior = [(2.0 * a + b) / (a + b), (1.0f64 / (a + b)).sqrt()];
        let [mean, sigma] = without_prior(posterior, [1.0, 3.0]).unwrap();
        assert!((mean - 2.0).abs() < 1e-12 && (sigma - 0.5).abs() < 1e-12);
        assert_eq!(without_prior([1.0, 2.9], [1.0, 3.0]), None);
    }
}
