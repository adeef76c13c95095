//! The angle jitter of a whole scan, and how to take it out.
//!
//! An LMS511's motor hunts: the scans of one unit are turned against each other by 0.016 to 0.018
//! deg (1 sigma), all beams alike, with about 0.3 cycles a scan. 0.017 deg are 3 mm at 10 m, and no
//! mean over the beams takes them out. The period from one zero index to the next foretells it:
//!
//! `angle(i) = a dP(i-1) + b dP(i) + c dP(i-2)`
//!
//! with dP(i) the deviation from the mean of the period that begins with scan i. The first term
//! alone needs nothing but the past; all three need the next scan's time and so one scan of delay.
//!
//! The figures hold for one unit. The model is therefore learned from a recording in which scanner
//! and scene stand still, and kept in a small file:
//!
//! - [`Learner`] takes the scans and gives an [`AngleJitter`]
//! - [`Correction`] turns each scan's `angle_min_rad` by what the model says

use crate::record::Scan;
use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

/// Beams that scatter by more than this see an edge or something that moves, m (1 sigma).
const STILL_M: f64 = 0.008;
/// Scans below which nothing can be learned.
const LEAST_SCANS: usize = 60;
/// Scans beyond which nothing more is learned: 40 s at 25 Hz, some 10 MB.
const MOST_SCANS: usize = 1000;
/// Beams on which the angle shows that are needed.
const LEAST_BEAMS: usize = 30;
/// How far a period may be from the model's mean and still be one of the same setting.
const SAME_SETTING: f64 = 0.05;
/// How many periods the learned mean counts for in the running one.
const PRIOR_PERIODS: f64 = 50.0;
/// Over how many periods the running mean forgets.
const MEAN_PERIODS: f64 = 1000.0;

/// A learned model. The file has the same keys, in degrees.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AngleJitter {
    /// Serial number of the scanner that it was learned from, if that said so.
    pub serial_number: Option<u32>,
    /// Scans that it was learned from.
    pub scans: usize,
    /// Mean period, us.
    pub mean_period_us: f64,
    /// deg a us of dP(i-1), for a correction without delay.
    pub at_once_deg_per_us: f64,
    /// deg a us of dP(i-1), dP(i), dP(i-2), for a correction one scan late.
    pub one_late_deg_per_us: [f64; 3],
    /// Angle jitter of the scans learned from, deg (1 sigma).
    pub jitter_deg: f64,
    /// What the correction without delay leaves of it, deg.
    pub left_at_once_deg: f64,
    /// What the correction one scan late leaves of it, deg.
    pub left_one_late_deg: f64,
    /// How well the angle of one scan is known from its beams, deg (1 sigma).
    pub noise_deg: f64,
}

/// Why no model can be learned or read.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum AngleJitterError {
    /// Too few scans in succession.
    #[error(
        "{0} scans in succession are too few: {LEAST_SCANS} are needed, of a scanner and a scene \
         that stand still"
    )]
    FewScans(usize),
    /// Too few beams that stand still and see a slope.
    #[error(
        "only {0} beams stand still and see surfaces at a slant: {LEAST_BEAMS} are needed; record \
         a scene at rest, such as a room's walls and corners"
    )]
    FewBeams(usize),
    /// The scans' angles scatter by no more than their noise, or the periods do not.
    #[error("the scans are not turned against each other: {0:.4} deg with a noise of {1:.4} deg")]
    NoJitter(f64, f64),
    /// The file is none.
    #[error("{0}")]
    File(String),
}

impl AngleJitter {
    /// Reads a model's file.
    pub fn from_toml(text: &str) -> Result<AngleJitter, AngleJitterError> {
        let model: AngleJitter =
            toml::from_str(text).map_err(|error| AngleJitterError::File(error.to_string()))?;
        let finite = [model.mean_period_us, model.at_once_deg_per_us]
            .iter()
            .chain(&model.one_late_deg_per_us)
            .all(|value| value.is_finite());
        if !finite || model.mean_period_us <= 0.0 {
            let reason = "the coefficients must be finite and mean_period_us above 0";
            return Err(AngleJitterError::File(reason.into()));
        }
        Ok(model)
    }

    /// The model's file.
    pub fn to_toml(&self) -> String {
        let head = "# Angle jitter of a SICK scanner: deg a us of the deviation of the periods before, \
                    after\n# and before the one before a scan from their mean.\n";
        head.to_owned() + &toml::to_string(self).unwrap_or_default()
    }
}

/// The periods around a scan, as deviations from their mean, us: before it, after it, and before
/// the one before.
type Around = [f64; 3];

/// Learns a model from scans of a scene at rest.
#[derive(Debug, Default)]
pub struct Learner {
    serial_number: Option<u32>,
    beams: usize,
    increment_rad: f64,
    /// Sequence number, device time in us, ranges in m.
    scans: Vec<(u32, f64, Vec<f64>)>,
}

/// The angle of each scan against the mean of all, by its beams.
struct Angles {
    /// rad a scan.
    rad: Vec<f64>,
    /// Standard error of one of them, rad.
    noise_rad: f64,
}

impl Learner {
    /// Takes a scan; ones without a device time, of another shape, or beyond the first thousand are
    /// left out.
    pub fn push(&mut self, scan: &Scan) {
        let Some(device) = scan.device else { return };
        if self.scans.is_empty() {
            self.beams = scan.beams();
            self.increment_rad = scan.angle_increment_rad;
            self.serial_number = scan.info.as_deref().and_then(|info| info.serial_number);
        }
        if scan.beams() == self.beams && !self.is_full() {
            let us = device.ns() as f64 * 1e-3;
            self.scans.push((scan.seq, us, scan.ranges_m.to_vec()));
        }
    }

    /// Whether no further scan is of use.
    pub fn is_full(&self) -> bool {
        self.scans.len() >= MOST_SCANS
    }

    /// The model.
    pub fn learn(&self) -> Result<AngleJitter, AngleJitterError> {
        let (around, mean_period_us) = self.periods();
        let known: Vec<(usize, Around)> = around
            .iter()
            .enumerate()
            .filter_map(|(scan, around)| Some((scan, (*around)?)))
            .collect();
        if known.len() < LEAST_SCANS {
            return Err(AngleJitterError::FewScans(known.len()));
        }
        let angles = self.angles()?;
        let angle = |scan: usize| angles.rad.get(scan).copied().unwrap_or(f64::NAN);
        let rad: Vec<f64> = known.iter().map(|(scan, _)| angle(*scan)).collect();
        let (_, jitter_rad) = mean_and_sd(&rad);
        let no_jitter =
            || AngleJitterError::NoJitter(jitter_rad.to_degrees(), angles.noise_rad.to_degrees());
        if !(jitter_rad > 1.5 * angles.noise_rad) {
            return Err(no_jitter());
        }
        let columns = |terms: usize| known.iter().map(move |(_, around)| &around[..terms]);
        let at_once = regress(columns(1), &rad).ok_or_else(no_jitter)?;
        let one_late = regress(columns(3), &rad).ok_or_else(no_jitter)?;
        let degrees = |fit: &Fit, term: usize| fit.terms.get(term).map_or(0.0, |t| t.to_degrees());
        Ok(AngleJitter {
            serial_number: self.serial_number,
            scans: self.scans.len(),
            mean_period_us,
            at_once_deg_per_us: degrees(&at_once, 0),
            one_late_deg_per_us: [0, 1, 2].map(|term| degrees(&one_late, term)),
            jitter_deg: jitter_rad.to_degrees(),
            left_at_once_deg: at_once.sd.to_degrees(),
            left_one_late_deg: one_late.sd.to_degrees(),
            noise_deg: angles.noise_rad.to_degrees(),
        })
    }

    /// The periods around each scan, where it and its neighbours follow each other, and their mean.
    fn periods(&self) -> (Vec<Option<Around>>, f64) {
        let mut periods_us: Vec<Option<f64>> = vec![None];
        periods_us.extend(self.scans.windows(2).map(|pair| match pair {
            [(seq_0, us_0, _), (seq_1, us_1, _)] if *seq_1 == seq_0.wrapping_add(1) => {
                Some(us_1 - us_0)
            }
            _ => None,
        }));
        let known: Vec<f64> = periods_us.iter().flatten().copied().collect();
        let (mean_us, _) = mean_and_sd(&known);
        // One that is far off is no period of this setting.
        let deviation = |index: Option<usize>| {
            let period_us = (*periods_us.get(index?)?)?;
            let off_us = period_us - mean_us;
            (off_us.abs() < SAME_SETTING * mean_us).then_some(off_us)
        };
        let around = (0..self.scans.len()).map(|scan| {
            Some([
                deviation(Some(scan))?,
                deviation(Some(scan + 1))?,
                deviation(scan.checked_sub(1))?,
            ])
        });
        (around.collect(), mean_us)
    }

    /// Each scan's angle: its deviations from the mean scan, regressed on a common range offset and
    /// on dr/dtheta over the beams that stand still.
    fn angles(&self) -> Result<Angles, AngleJitterError> {
        let column = |beam: usize| -> Vec<f64> {
            let ranges = self.scans.iter().filter_map(|(_, _, m)| m.get(beam));
            ranges.copied().collect()
        };
        let beams: Vec<(f64, f64)> = (0..self.beams).map(|b| mean_and_sd(&column(b))).collect();
        let mut used = Vec::new();
        for (beam, three) in beams.windows(3).enumerate() {
            let [(before_m, sd_0), (mean_m, sd_1), (after_m, sd_2)] = three else {
                continue;
            };
            if [sd_0, sd_1, sd_2].iter().all(|sd_m| **sd_m < STILL_M) {
                let slope_m = (after_m - before_m) / (2.0 * self.increment_rad);
                used.push((beam + 1, *mean_m, slope_m));
            }
        }
        let slopes: Vec<f64> = used.iter().map(|(_, _, slope_m)| *slope_m).collect();
        let (mean_slope_m, sd_slope_m) = mean_and_sd(&slopes);
        let slanted = slopes.iter().filter(|m| (*m - mean_slope_m).abs() > 0.1);
        let slanted = slanted.count();
        if slanted < LEAST_BEAMS {
            return Err(AngleJitterError::FewBeams(slanted));
        }
        let spread = sd_slope_m * sd_slope_m * (used.len() - 1) as f64;
        let (mut rad, mut noise) = (Vec::with_capacity(self.scans.len()), 0.0);
        for (_, _, ranges_m) in &self.scans {
            let deviations: Vec<f64> = used
                .iter()
                .map(|(beam, mean_m, _)| ranges_m.get(*beam).copied().unwrap_or(f64::NAN) - mean_m)
                .collect();
            let (offset_m, _) = mean_and_sd(&deviations);
            let pairs = || deviations.iter().zip(&slopes);
            let along = |(m, slope_m): (&f64, &f64)| (m - offset_m) * (slope_m - mean_slope_m);
            let angle = pairs().map(along).sum::<f64>() / spread;
            let rest = |(m, slope_m): (&f64, &f64)| {
                (m - offset_m - angle * (slope_m - mean_slope_m)).powi(2)
            };
            noise += pairs().map(rest).sum::<f64>() / (used.len() - 2) as f64 / spread;
            rad.push(angle);
        }
        Ok(Angles {
            noise_rad: (noise / rad.len() as f64).sqrt(),
            rad,
        })
    }

    /// Each scan's angle against the mean of all, rad, as [`Learner::learn`] sees it: what a
    /// correction is measured against.
    pub fn angles_rad(&self) -> Result<Vec<f64>, AngleJitterError> {
        self.angles().map(|angles| angles.rad)
    }
}

fn mean_and_sd(values: &[f64]) -> (f64, f64) {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let square = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>();
    (mean, (square / (count - 1.0)).sqrt())
}

/// A linear fit with an intercept: its terms and the standard deviation of what is left.
struct Fit {
    terms: Vec<f64>,
    sd: f64,
}

fn regress<'a>(rows: impl Iterator<Item = &'a [f64]>, values: &[f64]) -> Option<Fit> {
    let rows: Vec<Vec<f64>> = rows.map(|row| [&[1.0], row].concat()).collect();
    let width = rows.first()?.len();
    let flat: Vec<f64> = rows.into_iter().flatten().collect();
    let design = DMatrix::from_row_slice(values.len(), width, &flat);
    let values = DVector::from_row_slice(values);
    let normal = design.transpose() * &design;
    let terms = normal.cholesky()?.solve(&(design.transpose() * &values));
    let left = values - design * &terms;
    let freedom = left
        .len()
        .checked_sub(width)
        .filter(|freedom| *freedom > 0)?;
    Some(Fit {
        sd: (left.norm_squared() / freedom as f64).sqrt(),
        terms: terms.iter().skip(1).copied().collect(),
    })
}

/// When a corrected scan goes out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Delay {
    /// At once, by the period before it.
    None,
    /// When the next one has come, by all three periods.
    OneScan,
}

/// Turns scans by what a model says, from the past (and, where asked, the next scan) alone.
#[derive(Debug)]
pub struct Correction {
    model: AngleJitter,
    delay: Delay,
    /// Sequence number and device time of the newest scan, us.
    newest: Option<(u32, f64)>,
    /// The periods before the newest scan and before the one before, as deviations, us.
    before_us: [Option<f64>; 2],
    mean_us: f64,
    periods: f64,
    scan: Scan,
    /// Whether `scan` waits for the next.
    held: bool,
    /// What is handed out in place of `scan` while that is filled.
    ready: Scan,
    corrected: u64,
    passed: u64,
}

impl Correction {
    /// A correction at the start of a stream.
    pub fn new(model: AngleJitter, delay: Delay) -> Correction {
        Correction {
            mean_us: model.mean_period_us,
            periods: PRIOR_PERIODS,
            model,
            delay,
            newest: None,
            before_us: [None; 2],
            scan: Scan::default(),
            held: false,
            ready: Scan::default(),
            corrected: 0,
            passed: 0,
        }
    }

    /// Scans that were turned, and scans that went out as they came because the periods around them
    /// are not known or not the model's.
    pub fn counts(&self) -> (u64, u64) {
        (self.corrected, self.passed)
    }

    /// Turns the next scan in place, by the period before it.
    pub fn turn(&mut self, scan: &mut Scan) {
        let period_us = self.period_us(scan);
        let angle_deg = period_us.map(|us| us * self.model.at_once_deg_per_us);
        self.turn_by(scan, angle_deg);
    }

    /// Takes the next scan and gives the one that is ready: this one, or, one scan late, the one
    /// before.
    pub fn push(&mut self, scan: &Scan) -> Option<&Scan> {
        if self.delay == Delay::None {
            let mut ready = std::mem::take(&mut self.ready);
            ready.clone_from(scan);
            self.turn(&mut ready);
            self.ready = ready;
            return Some(&self.ready);
        }
        let period_us = self.period_us(scan);
        std::mem::swap(&mut self.ready, &mut self.scan);
        self.scan.clone_from(scan);
        let was_held = std::mem::replace(&mut self.held, true);
        if was_held {
            self.turn_held(period_us);
        }
        let [before_us, _] = self.before_us;
        self.before_us = [period_us, before_us];
        was_held.then_some(&self.ready)
    }

    /// The scan that still waits, at the end of the stream.
    pub fn finish(&mut self) -> Option<&Scan> {
        if !std::mem::take(&mut self.held) {
            return None;
        }
        std::mem::swap(&mut self.ready, &mut self.scan);
        self.turn_held(None);
        Some(&self.ready)
    }

    /// The deviation of the period before `scan`, us; none where it does not follow the newest.
    fn period_us(&mut self, scan: &Scan) -> Option<f64> {
        let newest = self.newest.take();
        let us = scan.device?.ns() as f64 * 1e-3;
        self.newest = Some((scan.seq, us));
        let (seq, last_us) = newest?;
        let period_us = us - last_us;
        let mean_us = self.model.mean_period_us;
        if scan.seq != seq.wrapping_add(1) || (period_us / mean_us - 1.0).abs() > SAME_SETTING {
            return None;
        }
        // The mean of the past, this period not among it.
        let deviation_us = period_us - self.mean_us;
        self.periods = (self.periods + 1.0).min(MEAN_PERIODS);
        self.mean_us += deviation_us / self.periods;
        Some(deviation_us)
    }

    /// Turns the scan that waited, `after_us` being the deviation of the period that began with it.
    fn turn_held(&mut self, after_us: Option<f64>) {
        let [a, b, c] = self.model.one_late_deg_per_us;
        let angle_deg = match (self.before_us, after_us) {
            ([Some(before_us), Some(earlier_us)], Some(after_us)) => {
                Some(a * before_us + b * after_us + c * earlier_us)
            }
            ([Some(before_us), _], _) => Some(before_us * self.model.at_once_deg_per_us),
            _ => None,
        };
        let mut ready = std::mem::take(&mut self.ready);
        self.turn_by(&mut ready, angle_deg);
        self.ready = ready;
    }

    fn turn_by(&mut self, scan: &mut Scan, angle_deg: Option<f64>) {
        match angle_deg {
            Some(angle_deg) => {
                scan.angle_min_rad += angle_deg.to_radians();
                self.corrected += 1;
            }
            None => self.passed += 1,
        }
    }
}

#[cfg(test)]
#[path = "angle_jitter_tests.rs"]
mod tests;
