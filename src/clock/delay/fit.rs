//! The delay by least squares on delay, gain and offset, with weights that know of jitter and of
//! outliers.

use super::{DelayError, DelaySettings, LEAST, Measured, axes, correlation, median};
use crate::motion::Motion;
use nalgebra::{SMatrix, SVector};
use serde::Serialize;

/// The result.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DelayFit {
    /// The delay, s; positive: the measurement lags.
    pub delay_s: f64,
    /// Its standard error, s (sandwich: it holds for noise of any distribution).
    pub sigma_s: f64,
    /// How many positions took part.
    pub samples: usize,
    /// How many of them were off by more than three of their standard deviations.
    pub outliers: usize,
    /// What was found along each axis that took part.
    pub axes: Vec<AxisFit>,
    /// The delay in parts of the motion, gain and offset kept. Values that differ tell of dynamics,
    /// not of transport.
    pub parts: Vec<PartFit>,
}

/// What was found along an axis.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct AxisFit {
    /// 0 is x, 1 y, 2 z.
    pub axis: usize,
    /// Measured over desired motion.
    pub gain: f64,
    /// Measured minus scaled desired position, m.
    pub offset_m: f64,
    /// Noise of the measured position at rest, m (1 sigma).
    pub noise_m: f64,
    /// Scatter of the delay from sample to sample, s (1 sigma).
    pub jitter_s: f64,
}

/// A part of the motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Part {
    /// In the direction of growing coordinates.
    Out,
    /// The other way.
    Back,
    /// Getting faster.
    Accelerating,
    /// At steady speed.
    Cruising,
    /// Getting slower.
    Decelerating,
}

/// The delay in a part of the motion.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct PartFit {
    /// Which part.
    pub part: Part,
    /// The delay, s.
    pub delay_s: f64,
    /// Its standard error, s.
    pub sigma_s: f64,
    /// Positions in it.
    pub samples: usize,
}

/// Huber's constant: full weight up to so many standard deviations.
const HUBER: f64 = 1.5;
/// Median of a squared standard normal number.
const MEDIAN_SQUARE: f64 = 0.454_936_423_119_572_7;
/// Below and above these shares of the top speed the noise alone, or noise and jitter, are seen.
const SLOW: f64 = 0.2;
const FAST: f64 = 0.6;
const STEPS: usize = 60;
/// A step this small ends the iteration, s,
const SETTLED_S: f64 = 1e-10;
/// or one of this share of the standard error.
const SETTLED_SHARE: f64 = 1e-4;
/// Speed is steady where it changes by less than this share of the largest acceleration.
const STEADY: f64 = 0.25;

/// Unknowns at most: the delay, and gain and offset of three axes.
const MOST_UNKNOWNS: usize = 7;
type Gradient = SVector<f64, MOST_UNKNOWNS>;
type Matrix = SMatrix<f64, MOST_UNKNOWNS, MOST_UNKNOWNS>;

/// A coordinate of a measured position.
#[derive(Clone, Copy, Debug)]
struct Row {
    t_s: f64,
    /// Index into the axes used.
    axis: usize,
    measured_m: f64,
}

/// One axis as it stands.
#[derive(Clone, Copy, Debug)]
struct Axis {
    coordinate: usize,
    gain: f64,
    offset_m: f64,
    noise_m2: f64,
    jitter_s2: f64,
}

/// Row by row what the model says.
#[derive(Clone, Copy, Debug)]
struct Modelled {
    axis: usize,
    desired_m: f64,
    velocity_m_s: f64,
    acceleration_m_s2: f64,
    residual_m: f64,
    variance_m2: f64,
}

/// The delay between `motion` and what was measured of it.
///
/// Gauss-Newton on delay, gain and offset of each axis; each residual is weighted by
/// 1 / (noise + jitter v^2), found from the medians of squared residuals at low and at high speed,
/// and by Huber's weight; begun at the normalised correlation.
///
/// # Errors
/// [`DelayError`] where there is too little to see a delay by.
pub fn fit(
    measured: &[Measured],
    motion: &dyn Motion,
    settings: &DelaySettings,
) -> Result<DelayFit, DelayError> {
    let coordinates = axes(motion, settings.axes)?;
    let seed_s = correlation::seed(measured, motion, settings)?;
    let rows: Vec<Row> = measured
        .iter()
        .filter(|m| (0.0..=motion.duration_s()).contains(&(m.t_s - seed_s)))
        .flat_map(|m| {
            coordinates
                .iter()
                .enumerate()
                .map(|(axis, coordinate)| Row {
                    t_s: m.t_s,
                    axis,
                    measured_m: m.position_m[*coordinate],
                })
        })
        .filter(|row| row.measured_m.is_finite())
        .collect();
    if rows.len() < LEAST * coordinates.len() {
        return Err(DelayError::TooFew {
            found: rows.len() / coordinates.len().max(1),
            needed: LEAST,
        });
    }
    let mut problem = Problem {
        rows,
        motion,
        delay_s: seed_s,
        axes: coordinates
            .into_iter()
            .map(|coordinate| Axis {
                coordinate,
                gain: 1.0,
                offset_m: 0.0,
                noise_m2: 1.0,
                jitter_s2: 0.0,
            })
            .collect(),
        free_gain: settings.free_gain,
        free_offset: settings.free_offset,
    };
    problem.solve(seed_s, settings.most_s)
}

struct Problem<'a> {
    rows: Vec<Row>,
    motion: &'a dyn Motion,
    delay_s: f64,
    axes: Vec<Axis>,
    free_gain: bool,
    free_offset: bool,
}

impl Problem<'_> {
    fn solve(&mut self, seed_s: f64, most_s: f64) -> Result<DelayFit, DelayError> {
        // Without weights first: the residuals of the seed say little about the noise.
        for round in 0..STEPS {
            let mut rows = self.modelled(self.delay_s);
            if round > 0 {
                self.weigh(&mut rows);
            }
            let (step, error_s) = self.step(&rows, round > 0).ok_or(DelayError::Unsettled)?;
            self.take(&step);
            if !((self.delay_s - seed_s).abs() <= most_s.max(0.1)) {
                return Err(DelayError::Unsettled);
            }
            let settled_s = SETTLED_S.max(SETTLED_SHARE * error_s);
            if round > 2 && step[0].abs() < settled_s {
                break;
            }
        }
        let rows = self.modelled(self.delay_s);
        let sigma_s = self.sigma_s(&rows).ok_or(DelayError::Unsettled)?;
        let off = |row: &&Modelled| row.residual_m.powi(2) > 9.0 * row.variance_m2;
        Ok(DelayFit {
            delay_s: self.delay_s,
            sigma_s,
            samples: rows.len() / self.axes.len().max(1),
            outliers: rows.iter().filter(off).count(),
            axes: self
                .axes
                .iter()
                .map(|axis| AxisFit {
                    axis: axis.coordinate,
                    gain: axis.gain,
                    offset_m: axis.offset_m,
                    noise_m: axis.noise_m2.sqrt(),
                    jitter_s: axis.jitter_s2.sqrt(),
                })
                .collect(),
            parts: self.parts(&rows),
        })
    }

    fn modelled(&self, delay_s: f64) -> Vec<Modelled> {
        // The rows of one instant follow each other.
        let mut last = (f64::NAN, self.motion.at(0.0));
        let model = |row: &Row| {
            if row.t_s != last.0 {
                last = (row.t_s, self.motion.at(row.t_s - delay_s));
            }
            let state = last.1;
            let axis = self.axes.get(row.axis)?;
            let velocity = state.velocity_m_s[axis.coordinate];
            let desired_m = state.position_m[axis.coordinate];
            Some(Modelled {
                axis: row.axis,
                desired_m,
                velocity_m_s: velocity,
                acceleration_m_s2: state.acceleration_m_s2[axis.coordinate],
                residual_m: row.measured_m - axis.gain * desired_m - axis.offset_m,
                variance_m2: axis.noise_m2 + axis.jitter_s2 * velocity * velocity,
            })
        };
        self.rows.iter().filter_map(model).collect()
    }

    /// Noise and jitter of each axis from the medians of squared residuals; the rows' variances with
    /// them.
    fn weigh(&mut self, rows: &mut [Modelled]) {
        for (index, axis) in self.axes.iter_mut().enumerate() {
            let own = || rows.iter().filter(|row| row.axis == index);
            let top = own().map(|row| row.velocity_m_s.abs()).fold(0.0, f64::max);
            let squares = |low: f64, high: f64| -> (Vec<f64>, f64) {
                let speeds = low * top..=high * top;
                let chosen = own().filter(|row| speeds.contains(&row.velocity_m_s.abs()));
                let (squares, speeds): (Vec<f64>, Vec<f64>) = chosen
                    .map(|row| (row.residual_m.powi(2), row.velocity_m_s.powi(2)))
                    .unzip();
                let mean_speed = speeds.iter().sum::<f64>() / speeds.len().max(1) as f64;
                (squares, mean_speed)
            };
            let (mut slow, _) = squares(0.0, SLOW);
            let (mut fast, fast_v2) = squares(FAST, 1.0);
            let (mut all, _) = squares(0.0, 1.0);
            // Never nothing: a perfect measurement would have infinite weight.
            let least = 1e-18;
            let variance = |squares: &mut [f64]| (median(squares) / MEDIAN_SQUARE).max(least);
            if slow.len() >= LEAST && fast.len() >= LEAST {
                axis.noise_m2 = variance(&mut slow);
                axis.jitter_s2 = ((variance(&mut fast) - axis.noise_m2) / fast_v2).max(0.0);
            } else {
                axis.noise_m2 = variance(&mut all);
                axis.jitter_s2 = 0.0;
            }
        }
        for row in rows {
            if let Some(axis) = self.axes.get(row.axis) {
                row.variance_m2 = axis.noise_m2 + axis.jitter_s2 * row.velocity_m_s.powi(2);
            }
        }
    }

    /// How many unknowns there are: the delay, and gain and offset of each axis where free.
    fn unknowns(&self) -> usize {
        1 + self.axes.len() * (usize::from(self.free_gain) + usize::from(self.free_offset))
    }

    /// The derivatives of the model: minus d residual / d unknown.
    fn gradient(&self, row: &Modelled) -> Gradient {
        let mut gradient = Gradient::zeros();
        let gain = self.axes.get(row.axis).map_or(1.0, |axis| axis.gain);
        gradient[0] = -gain * row.velocity_m_s;
        let per_axis = (self.unknowns() - 1) / self.axes.len().max(1);
        let values = [(self.free_gain, row.desired_m), (self.free_offset, 1.0)];
        let values = values.iter().filter(|(free, _)| *free);
        for (k, (_, value)) in values.enumerate() {
            gradient[1 + row.axis * per_axis + k] = *value;
        }
        gradient
    }

    /// A matrix whose places for unknowns that do not exist keep it invertible.
    fn begun(&self) -> Matrix {
        let n = self.unknowns();
        Matrix::from_diagonal(&Gradient::from_fn(|i, _| if i < n { 0.0 } else { 1.0 }))
    }

    /// The next step of the unknowns, and the delay's standard error if the errors were independent
    /// and Gaussian, s.
    fn step(&self, rows: &[Modelled], robust: bool) -> Option<(Gradient, f64)> {
        let (mut matrix, mut right) = (self.begun(), Gradient::zeros());
        for row in rows {
            let gradient = self.gradient(row);
            let off = row.residual_m.abs() / row.variance_m2.sqrt();
            let huber = if robust && off > HUBER {
                HUBER / off
            } else {
                1.0
            };
            let weight = huber / row.variance_m2;
            matrix.ger(weight, &gradient, &gradient, 1.0);
            right.axpy(weight * row.residual_m, &gradient, 1.0);
        }
        let root = matrix.cholesky()?;
        let step = root.solve(&right);
        let finite = step.iter().all(|value| value.is_finite());
        finite.then(|| (step, root.inverse()[(0, 0)].sqrt()))
    }

    fn take(&mut self, step: &Gradient) {
        let mut step = step.iter();
        self.delay_s += step.next().copied().unwrap_or(0.0);
        for axis in &mut self.axes {
            if self.free_gain {
                axis.gain += step.next().copied().unwrap_or(0.0);
            }
            if self.free_offset {
                axis.offset_m += step.next().copied().unwrap_or(0.0);
            }
        }
    }

    /// The standard error of the delay: A^-1 B A^-1 with A the curvature and B the scatter of the
    /// gradient that were really met.
    fn sigma_s(&self, rows: &[Modelled]) -> Option<f64> {
        let n = self.unknowns();
        let (mut curvature, mut scatter) = (self.begun(), Matrix::zeros());
        for row in rows {
            let gradient = self.gradient(row);
            let off = row.residual_m.abs() / row.variance_m2.sqrt();
            let weight = 1.0 / row.variance_m2;
            if off <= HUBER {
                curvature.ger(weight, &gradient, &gradient, 1.0);
            }
            let pull = off.min(HUBER).powi(2) * weight;
            scatter.ger(pull, &gradient, &gradient, 1.0);
        }
        let inverse = curvature.try_inverse()?;
        let covariance = inverse * scatter * inverse;
        // What the unknowns themselves have taken from the residuals.
        let count = rows.len() as f64;
        let lost = count / (count - n as f64).max(1.0);
        Some((covariance[(0, 0)] * lost).sqrt()).filter(|sigma| sigma.is_finite())
    }

    /// The delay of each part of the motion, as a step from the delay of the whole.
    fn parts(&self, rows: &[Modelled]) -> Vec<PartFit> {
        let most = |value: fn(&Modelled) -> f64| rows.iter().map(value).fold(0.0, f64::max);
        let top_m_s = most(|row| row.velocity_m_s.abs());
        let hardest = most(|row| row.acceleration_m_s2.abs());
        let moves = |row: &Modelled| row.velocity_m_s.abs() > 0.01 * top_m_s;
        // Along the motion.
        let gains = |row: &Modelled| row.acceleration_m_s2 * row.velocity_m_s.signum();
        let steady = STEADY * hardest;
        let belongs = |part: Part, row: &Modelled| match part {
            Part::Out => row.velocity_m_s > 0.0,
            Part::Back => row.velocity_m_s < 0.0,
            Part::Accelerating => gains(row) > steady,
            Part::Cruising => gains(row).abs() <= steady,
            Part::Decelerating => gains(row) < -steady,
        };
        let parts = [
            Part::Out,
            Part::Back,
            Part::Accelerating,
            Part::Cruising,
            Part::Decelerating,
        ];
        parts
            .into_iter()
            .filter_map(|part| {
                let chosen = rows.iter().filter(|row| moves(row) && belongs(part, row));
                let (mut samples, mut right, mut curvature, mut scatter) = (0, 0.0, 0.0, 0.0);
                for row in chosen {
                    let gain = self.axes.get(row.axis).map_or(1.0, |axis| axis.gain);
                    let slope = -gain * row.velocity_m_s;
                    let sigma_m = row.variance_m2.sqrt();
                    let off = row.residual_m / sigma_m;
                    let pull = off.clamp(-HUBER, HUBER) / sigma_m;
                    samples += 1;
                    right += pull * slope;
                    scatter += (pull * slope).powi(2);
                    if off.abs() <= HUBER {
                        curvature += slope * slope / row.variance_m2;
                    }
                }
                (samples >= LEAST && curvature > 0.0).then(|| PartFit {
                    part,
                    delay_s: self.delay_s + right / curvature,
                    sigma_s: scatter.sqrt() / curvature,
                    samples,
                })
            })
            .collect()
    }
}
