//! A run: scan after scan with its truth and the IMU samples around it.

use super::clock;
use super::course::Course;
use super::effects::{Effect, Effects};
use super::inertial::Unit;
use super::jitter::{Hunting, Turn};
use super::parameters::Parameters;
use super::random::Seed;
use super::ranging::{Echo, MAX_ECHOES, Physics};
use super::rotation;
use super::scanner::Scanner;
use crate::frame::{Frame, ScanMode, ScannerModel};
use crate::motion::State;
use crate::record::{Axes, ImuSample, Ranges, Scan, Stamp, TrajectoryPoint};
use nalgebra::{Rotation3, Vector3};
use rayon::prelude::*;
use std::ops::Range;

/// What a run is made of.
pub struct Setup {
    /// The frame, with the mountings of scanner and IMU. Its `[calibration]` is what a solver
    /// believes and is not used here.
    pub frame: Frame,
    /// The scanner.
    pub model: &'static ScannerModel,
    /// Its mode.
    pub mode: ScanMode,
    /// Where the platform is.
    pub course: Course,
    /// What is switched on.
    pub effects: Effects,
    /// How large it is.
    pub parameters: Parameters,
    /// The seed.
    pub seed: Seed,
    /// When the first beam of the first scan fires.
    pub start: Stamp,
    /// Number of scans; none: as many as fit into the course.
    pub scans: Option<u64>,
    /// IMU samples a second; none: one at each scan's reference instant.
    pub imu_rate_hz: Option<f64>,
    /// Axes of the IMU samples.
    pub imu_axes: Axes,
}

impl Setup {
    /// A run with the frame's scanner in its first mode and no effects: seed 1, from time 0 on, as many
    /// scans as fit into the course, and with each an IMU sample in the platform's axes.
    pub fn new(frame: Frame, course: Course) -> Setup {
        let model = frame.scanner_model();
        Setup {
            frame,
            model,
            mode: model.modes[0],
            course,
            effects: Effects::NONE,
            parameters: Parameters::default(),
            seed: Seed(1),
            start: Stamp::from_ns(0),
            scans: None,
            imu_rate_hz: None,
            imu_axes: Axes::Platform,
        }
    }

    /// How many scans the run has.
    pub fn scans(&self) -> u64 {
        self.scans.unwrap_or_else(|| {
            let scanner = Scanner::new(&self.frame, self.model, self.mode);
            let (period_s, sweep_s) = (scanner.period_s(), scanner.sweep_s());
            self.course.scans(period_s, sweep_s)
        })
    }
}

/// One scan and what goes with it.
#[derive(Clone, Debug, Default)]
pub struct Step {
    /// The scan.
    pub scan: Scan,
    /// True state at the scan's reference instant (the beam at 90 degrees fires).
    pub truth: TrajectoryPoint,
    /// Desired state at that instant.
    pub desired: TrajectoryPoint,
    /// IMU samples up to the first one at or after that instant that were not given before.
    pub imu: Vec<ImuSample>,
    /// True time at which the scan is complete.
    pub complete: Stamp,
}

/// What one scan is made of; nothing in it depends on any other scan.
#[derive(Clone, Copy, Debug)]
struct Firing {
    number: u64,
    /// When the first beam fires.
    fired: Stamp,
    /// The beams' true angles are larger than the stated ones by this, rad.
    offset_rad: f64,
}

/// What all scans share.
struct Stage {
    setup: Setup,
    physics: Physics,
    /// Whether the beams leave at other angles from scan to scan.
    turning: bool,
}

/// A run in progress.
///
/// What goes on from scan to scan (times, the motor's hunting, the IMU) is made in order; the beams
/// of a scan depend on its number alone, so that scans can be made side by side.
pub struct Simulator {
    stage: Stage,
    scanner: Scanner,
    hunting: Option<Hunting>,
    unit: Unit,
    number: u64,
    total: u64,
    /// Time lost or won by unsteady periods, s.
    shift_s: f64,
    next_imu: u64,
    step: Step,
    firings: Vec<Firing>,
}

impl Simulator {
    /// Gets ready.
    pub fn new(mut setup: Setup) -> Simulator {
        if setup.effects.is_reference() && setup.parameters.noise.sigma_mm.is_none() {
            setup.parameters.noise.sigma_mm = Some(6.5);
        }
        let scanner = Scanner::new(&setup.frame, setup.model, setup.mode);
        let physics = Physics::new(
            &setup.frame,
            setup.model,
            setup.effects,
            &setup.parameters,
            setup.seed,
        );
        let mut unit = Unit::new(&setup.frame, setup.imu_axes);
        if setup.effects.has(Effect::Imu) {
            unit = unit.with_errors(&setup.parameters.imu, setup.seed);
        }
        let hunting = setup
            .effects
            .has(Effect::AngleJitter)
            .then(|| Hunting::new(setup.seed, &setup.parameters.angle_jitter));
        Simulator {
            total: setup.scans(),
            stage: Stage {
                turning: hunting.is_some() || setup.mode.interlace > 1,
                setup,
                physics,
            },
            scanner,
            hunting,
            unit,
            number: 0,
            shift_s: 0.0,
            next_imu: 0,
            step: Step::default(),
            firings: Vec::new(),
        }
    }

    /// How many scans the run has, from the first on; with [`Simulator::only`] up to the part's end.
    pub fn scans(&self) -> u64 {
        self.total
    }

    /// The scanner.
    pub fn scanner(&self) -> &Scanner {
        &self.scanner
    }

    /// Goes on in another mode from where the course is now.
    pub fn set_mode(&mut self, mode: ScanMode) {
        let setup = &mut self.stage.setup;
        if mode == setup.mode {
            return;
        }
        let number = self.number as f64;
        let before_s = self.scanner.period_s();
        let now_s = number * before_s + self.shift_s;
        setup.mode = mode;
        self.stage.turning = self.hunting.is_some() || mode.interlace > 1;
        self.scanner = Scanner::new(&setup.frame, setup.model, mode);
        let period_s = self.scanner.period_s();
        self.shift_s = now_s - number * period_s;
        if setup.scans.is_none() && !setup.course.is_resting() {
            let fitting = setup.course.scans(period_s, self.scanner.sweep_s());
            let passed = (now_s / period_s - 1e-9).ceil() as u64;
            self.total = self.number + fitting.saturating_sub(passed);
        }
    }

    /// Leaves only scans `part` of the run. They are the same as in the whole run, and so are the
    /// IMU samples around them: what goes on from scan to scan is followed up to the first of them.
    pub fn only(&mut self, part: Range<u64>) {
        while self.number < part.start && self.prepare().is_some() {}
        self.total = self.total.min(part.end);
    }

    /// Passes over the next scan, which nobody sees; when it would have been complete, or none
    /// after the last.
    pub fn pass(&mut self) -> Option<Stamp> {
        let (firing, turn) = self.fire()?;
        self.go_on(turn);
        Some(firing.fired.plus_s(self.scanner.sweep_s()))
    }

    /// The next scan, or none after the last.
    pub fn advance(&mut self) -> Option<&Step> {
        let firing = self.prepare()?;
        self.stage.expose(&mut self.scanner, firing, &mut self.step);
        Some(&self.step)
    }

    /// All scans of a run that is short enough to be held.
    pub fn all(mut self) -> Vec<Step> {
        let mut steps = Vec::new();
        while let Some(step) = self.advance() {
            steps.push(step.clone());
        }
        steps
    }

    /// The next scans, `count` at most and none after the last, in place of what is in `steps`. They
    /// are made side by side by the threads of the rayon pool in which this is called, and are the
    /// same whatever their number.
    pub fn advance_many(&mut self, count: usize, steps: &mut Vec<Step>) {
        let mut firings = std::mem::take(&mut self.firings);
        firings.clear();
        for index in 0..count {
            let Some(firing) = self.prepare() else {
                break;
            };
            if steps.len() == index {
                steps.push(Step::default());
            }
            if let Some(step) = steps.get_mut(index) {
                step.imu.clone_from(&self.step.imu);
            }
            firings.push(firing);
        }
        steps.truncate(firings.len());
        let (stage, scanner) = (&self.stage, &self.scanner);
        steps.par_iter_mut().zip(&firings).for_each_init(
            || scanner.clone(),
            |scanner, (step, firing)| stage.expose(scanner, *firing, step),
        );
        self.firings = firings;
    }

    /// Everything about the next scan that depends on those before it: its time and the IMU's
    /// samples. None after the last.
    fn prepare(&mut self) -> Option<Firing> {
        let (firing, turn) = self.fire()?;
        let reference = firing.fired.plus_s(self.scanner.reference_s());
        self.sample_imu(firing.number, reference);
        self.go_on(turn);
        Some(firing)
    }

    fn fire(&mut self) -> Option<(Firing, Turn)> {
        if self.number >= self.total {
            return None;
        }
        let number = self.number;
        let turn = self
            .hunting
            .as_mut()
            .map_or(Turn::default(), |hunting| hunting.next(number));
        if self.stage.turning {
            self.scanner.go_to(number);
        }
        let passed_s = number as f64 * self.scanner.period_s() + self.shift_s;
        let firing = Firing {
            number,
            fired: (self.stage.setup.start).plus_s(passed_s + self.scanner.lead_s()),
            offset_rad: turn.offset_rad,
        };
        Some((firing, turn))
    }

    fn go_on(&mut self, turn: Turn) {
        self.shift_s += turn.period_deviation * self.scanner.period_s();
        self.number += 1;
    }

    fn sample_imu(&mut self, number: u64, reference: Stamp) {
        self.step.imu.clear();
        let setup = &self.stage.setup;
        let (course, start) = (&setup.course, setup.start);
        let Some(rate_hz) = setup.imu_rate_hz else {
            let state = course.truth(number, reference.since_s(start));
            self.step.imu.push(self.unit.sample(&state, reference));
            return;
        };
        // From the run's start on, until one sample is at or after the reference instant.
        loop {
            let stamp = start.plus_s(self.next_imu as f64 / rate_hz);
            let before = self.step.imu.last().map(|sample| sample.stamp);
            let bracketed = before.or_else(|| self.last_imu(rate_hz));
            if bracketed.is_some_and(|last| last >= reference) {
                return;
            }
            let state = course.truth(number, stamp.since_s(start));
            self.step.imu.push(self.unit.sample(&state, stamp));
            self.next_imu += 1;
        }
    }

    /// Stamp of the last sample given with an earlier scan.
    fn last_imu(&self, rate_hz: f64) -> Option<Stamp> {
        let last = self.next_imu.checked_sub(1)?;
        Some((self.stage.setup.start).plus_s(last as f64 / rate_hz))
    }
}

impl Stage {
    /// Everything about a scan that its number and time tell.
    fn expose(&self, scanner: &mut Scanner, firing: Firing, step: &mut Step) {
        if self.turning {
            scanner.go_to(firing.number);
            scanner.aim(firing.offset_rad);
        }
        self.scan(scanner, firing, &mut step.scan);
        let (course, start) = (&self.setup.course, self.setup.start);
        let reference = firing.fired.plus_s(scanner.reference_s());
        let reference_s = reference.since_s(start);
        step.truth = point(reference, &course.truth(firing.number, reference_s));
        step.desired = point(reference, &course.desired(firing.number, reference_s));
        step.complete = firing.fired.plus_s(scanner.sweep_s());
    }

    fn scan(&self, scanner: &Scanner, firing: Firing, scan: &mut Scan) {
        let (setup, effects, number) = (&self.setup, self.setup.effects, firing.number);
        let course = &setup.course;
        let t_s = firing.fired.since_s(setup.start);
        let last = scanner.count().saturating_sub(1);
        let aperture_rad = [scanner.angle_min_rad(), scanner.angle_rad(last)];
        let mut physics = self.physics.scan(number, aperture_rad);
        let with_remission = effects.has(Effect::Remission);
        let further = if effects.has(Effect::Echoes) {
            setup.parameters.echoes.count.clamp(1, MAX_ECHOES) - 1
        } else {
            0
        };
        begin(scan, scanner, firing, further, with_remission);
        let frozen = course.truth(number, t_s + scanner.reference_s());
        let mut placement = Placement::new(&frozen, scanner.origin_m());
        let moving = effects.has(Effect::Motion) && !course.is_resting();
        let (increment_s, step_rad) = (scanner.time_increment_s(), scanner.mode.step_rad());
        let mut echoes = [NO_ECHO; MAX_ECHOES];
        for (index, direction) in scanner.beams().iter().enumerate() {
            if moving {
                let beam_s = t_s + index as f64 * increment_s;
                placement.go_to(&course.truth(number, beam_s), scanner.origin_m());
            }
            let count = physics.measure(
                aperture_rad[0] + index as f64 * step_rad + firing.offset_rad,
                placement.origin_m,
                placement.rotation * direction,
                &mut echoes,
            );
            scan.ranges_m.push(echoes[0].range_m);
            if with_remission {
                scan.remissions.push(echoes[0].remission);
            }
            if further > 0 {
                echoes[count..].fill(NO_ECHO);
                push_echoes(scan, &echoes[1..=further]);
            }
        }
        if effects.has(Effect::Clocks) {
            let (clocks, seed) = (&setup.parameters.clocks, setup.seed);
            clock::disturb(scan, clocks, seed, setup.start, scanner.period_s());
        }
    }
}

/// Where the beams leave at an instant and how they are turned, in B.
#[derive(Clone, Copy, Debug)]
struct Placement {
    origin_m: Vector3<f64>,
    rotation: Rotation3<f64>,
    /// Roll, pitch and yaw of `rotation`, rad.
    rotation_rad: Vector3<f64>,
}

impl Placement {
    /// Of the platform's state; `lever_m` is the beams' origin in P.
    fn new(state: &State, lever_m: Vector3<f64>) -> Placement {
        let rotation = rotation::attitude_matrix(state.rotation_rad);
        Placement {
            origin_m: state.position_m + rotation * lever_m,
            rotation,
            rotation_rad: state.rotation_rad,
        }
    }

    /// The same for another state. Turning costs six sines, and many courses keep the attitude.
    fn go_to(&mut self, state: &State, lever_m: Vector3<f64>) {
        if state.rotation_rad == self.rotation_rad {
            self.origin_m = state.position_m + self.rotation * lever_m;
        } else {
            *self = Placement::new(state, lever_m);
        }
    }
}

const NO_ECHO: Echo = Echo {
    range_m: f64::INFINITY,
    remission: 0.0,
};

/// Heads a scan and empties its lists.
fn begin(scan: &mut Scan, scanner: &Scanner, firing: Firing, further: usize, with_remission: bool) {
    scan.stamp = firing.fired;
    scan.seq = firing.number as u32;
    scan.angle_min_rad = scanner.angle_min_rad();
    scan.angle_increment_rad = scanner.mode.step_rad();
    scan.time_increment_s = scanner.time_increment_s();
    scan.scan_time_s = scanner.period_s();
    scan.range_min_m = scanner.model.range_m[0];
    scan.range_max_m = scanner.model.range_m[1];
    scan.ranges_m.clear();
    scan.remissions.clear();
    scan.further_ranges_m.resize_with(further, Ranges::default);
    let lists = scan.further_ranges_m.iter_mut();
    lists.for_each(|list| list.clear());
    let remissions = if with_remission { further } else { 0 };
    scan.further_remissions.resize_with(remissions, Vec::new);
    scan.further_remissions.iter_mut().for_each(Vec::clear);
}

fn push_echoes(scan: &mut Scan, echoes: &[Echo]) {
    for (list, echo) in scan.further_ranges_m.iter_mut().zip(echoes) {
        list.push(echo.range_m);
    }
    for (list, echo) in scan.further_remissions.iter_mut().zip(echoes) {
        list.push(echo.remission);
    }
}

fn point(stamp: Stamp, state: &State) -> TrajectoryPoint {
    TrajectoryPoint {
        stamp,
        position_m: state.position_m.into(),
        rotation_rad: state.rotation_rad.into(),
        velocity_m_s: state.velocity_m_s.into(),
    }
}
