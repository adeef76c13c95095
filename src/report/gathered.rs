//! A run in order of time, joined to the reference: aligned, and freed of its delay, where that is
//! wanted.

use super::align::{Align, Alignment, Placed};
use super::association::{Matching, Reference};
use super::case::{Run, Settings};
use super::disorder::Disorder;
use super::lag::{self, Delay, DelayChoice, Estimate, Passed};
use super::measured::{lacking, measured};
use super::statistics::wrap_angle;
use crate::record::{Pose, Stamp};

/// A pose with its reference.
pub(super) struct Sample {
    /// Index into the run's poses.
    pose: u32,
    /// x, y, z (m), roll, pitch, yaw (rad).
    pub reference: [f64; 6],
    /// Measured minus reference; NaN where not measured.
    pub error: [f64; 6],
    /// Angle of the rotation between the two, rad; NaN where not measured.
    pub turned_rad: f64,
    /// The reference's velocity, m/s; NaN where it does not move on.
    pub velocity_m_s: [f32; 3],
}

/// A run in order of time, joined to the reference.
pub(super) struct Gathered {
    pub run: Run,
    pub samples: Vec<Sample>,
    pub matching: Matching,
    pub disorder: Disorder,
    pub alignment: Alignment,
    pub delay: Option<Delay>,
    /// Why a delay that was asked for is not there.
    pub no_delay: Option<String>,
}

impl Gathered {
    /// Sorts, joins, aligns and estimates.
    pub fn new(mut run: Run, reference: &Reference, settings: &Settings) -> Gathered {
        let poses = &mut run.poses;
        let mut disorder = Disorder::of(poses);
        if disorder.unsorted > 0 {
            poses.sort_by_key(|p| p.stamp);
        }
        let rows = poses.len();
        poses.dedup_by_key(|p| p.stamp);
        disorder.repeated = rows - poses.len();
        let mut gathered = Gathered {
            run,
            samples: Vec::new(),
            matching: Matching::default(),
            disorder,
            alignment: Alignment::default(),
            delay: None,
            no_delay: None,
        };
        gathered.join(reference, 0.0);
        gathered.align(&settings.align);
        gathered.find_delay(reference, settings);
        gathered
    }

    /// Finds every pose's reference `delay_s` before its stamp.
    fn join(&mut self, reference: &Reference, delay_s: f64) {
        self.matching = Matching::default();
        self.samples.clear();
        let (mut place, mut place_of_velocity) = (0, 0);
        for (index, pose) in self.run.poses.iter().enumerate() {
            let instant = lag::earlier(pose.stamp, delay_s);
            let found = reference.at_next(&mut place, instant);
            if lacking(pose).is_some() {
                self.matching.add(&found);
            }
            let Ok((truth, _)) = found else {
                continue;
            };
            let velocity = reference.velocity_m_s(&mut place_of_velocity, instant);
            let mut sample = Sample {
                pose: index as u32,
                reference: truth,
                error: [f64::NAN; 6],
                turned_rad: f64::NAN,
                velocity_m_s: velocity.map(|v| v as f32),
            };
            sample.compare(pose);
            self.samples.push(sample);
        }
    }

    /// Aligns the poses and compares them anew.
    fn align(&mut self, align: &Align) {
        if *align == Align::None {
            return;
        }
        let whole = |s: &&Sample| s.error.iter().all(|e| e.is_finite());
        let pairs = self.samples.iter().filter(whole).filter_map(|s| {
            let pose = self.run.poses.get(s.pose as usize)?;
            Some((Placed::new(&measured(pose)), Placed::new(&s.reference)))
        });
        let step = Alignment::of(align, pairs);
        for pose in &mut self.run.poses {
            step.apply(&mut pose.position_m, &mut pose.rotation_rad);
        }
        self.alignment = self.alignment.then(&step);
        for sample in &mut self.samples {
            if let Some(pose) = self.run.poses.get(sample.pose as usize) {
                sample.compare(pose);
            }
        }
    }

    fn find_delay(&mut self, reference: &Reference, settings: &Settings) {
        let (found, remove) = match settings.delay {
            DelayChoice::None => return,
            DelayChoice::Show => (lag::estimate(self.passed(), reference), false),
            DelayChoice::Estimate => (lag::estimate(self.passed(), reference), true),
            DelayChoice::Given(delay_s) => {
                let given = Estimate {
                    delay_s,
                    sigma_s: f64::NAN,
                    samples: 0,
                    effective_n: f64::NAN,
                };
                (Ok(given), true)
            }
        };
        let found = match found {
            Ok(found) => found,
            Err(why) => {
                self.no_delay = remove.then_some(why);
                return;
            }
        };
        let mut delay = Delay::of(found, self.passed(), reference);
        if remove {
            delay.removed = true;
            self.join(reference, delay.delay_s);
            // Without the delay the poses lie elsewhere; a given alignment is what it is.
            if !matches!(settings.align, Align::Given(_)) {
                self.align(&settings.align);
                let squares = self.samples.iter().map(|s| s.distance2_m2());
                let known: Vec<f64> = squares.filter(|d| d.is_finite()).collect();
                delay.rms_after_m = (known.iter().sum::<f64>() / known.len() as f64).sqrt();
            }
        }
        self.delay = Some(delay);
    }

    /// Positions with the reference's velocity.
    fn passed(&self) -> impl Iterator<Item = Passed> + Clone {
        self.samples.iter().filter_map(|s| {
            Some(Passed {
                stamp: self.run.poses.get(s.pose as usize)?.stamp,
                position_m: [0, 1, 2].map(|i| s.reference[i] + s.error[i]),
                velocity_m_s: s.velocity_m_s.map(f64::from),
            })
        })
    }

    /// A sample's pose.
    pub fn pose(&self, sample: &Sample) -> Option<&Pose> {
        self.run.poses.get(sample.pose as usize)
    }

    /// First and last stamp.
    pub fn span(&self) -> Option<(Stamp, Stamp)> {
        let poses = &self.run.poses;
        Some((poses.first()?.stamp, poses.last()?.stamp))
    }
}

impl Sample {
    fn compare(&mut self, pose: &Pose) {
        let measured = measured(pose);
        for (i, e) in self.error.iter_mut().enumerate() {
            let difference = measured[i] - self.reference[i];
            *e = if i < 3 {
                difference
            } else {
                wrap_angle(difference)
            };
        }
        let (a, b) = (Placed::new(&measured), Placed::new(&self.reference));
        self.turned_rad = (b.rotation.inverse() * a.rotation).angle();
    }

    fn distance2_m2(&self) -> f64 {
        let [x, y, z, ..] = self.error;
        x * x + y * y + z * z
    }

    /// The distance of the positions, m.
    pub fn distance_m(&self) -> f64 {
        self.distance2_m2().sqrt()
    }

    /// The position's error along the reference's velocity, and its distance from the path, m; none
    /// where the reference hardly moves.
    pub fn along_and_cross_m(&self) -> Option<(f64, f64)> {
        let v = self.velocity_m_s.map(f64::from);
        let speed = v.iter().map(|v| v * v).sum::<f64>().sqrt();
        // Not a number is no speed either.
        if !(speed >= LEAST_M_S) {
            return None;
        }
        let along = self.error.iter().zip(&v).map(|(e, v)| e * v).sum::<f64>() / speed;
        let across = (self.distance2_m2() - along * along).max(0.0).sqrt();
        along.is_finite().then_some((along, across))
    }
}

/// Slower than this the reference has no direction, m/s.
const LEAST_M_S: f64 = 0.005;
