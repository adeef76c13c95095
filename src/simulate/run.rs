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

/// A run in progress.
pub struct Simulator {
    setup: Setup,
    scanner: Scanner,
    physics: Physics,
    hunting: Option<Hunting>,
    unit: Unit,
    number: u64,
    total: u64,
    /// Time lost or won by unsteady periods, s.
    shift_s: f64,
    next_imu: u64,
    step: Step,
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
        let fitting = setup.course.scans(scanner.period_s(), scanner.sweep_s());
        Simulator {
            total: setup.scans.unwrap_or(fitting),
            step: blank_step(&scanner),
            setup,
            scanner,
            physics,
            hunting,
            unit,
            number: 0,
            shift_s: 0.0,
            next_imu: 0,
        }
    }

    /// How many scans the run has.
    pub fn scans(&self) -> u64 {
        self.total
    }

    /// The scanner.
    pub fn scanner(&self) -> &Scanner {
        &self.scanner
    }

    /// Goes on in another mode from where the course is now.
    pub fn set_mode(&mut self, mode: ScanMode) {
        if mode == self.setup.mode {
            return;
        }
        let number = self.number as f64;
        let before_s = self.scanner.period_s();
        let now_s = number * before_s + self.shift_s;
        self.setup.mode = mode;
        self.scanner = Scanner::new(&self.setup.frame, self.setup.model, mode);
        self.step = blank_step(&self.scanner);
        let period_s = self.scanner.period_s();
        self.shift_s = now_s - number * period_s;
        if self.setup.scans.is_none() && !self.setup.course.is_resting() {
            let fitting = self.setup.course.scans(period_s, self.scanner.sweep_s());
            let passed = (now_s / period_s - 1e-9).ceil() as u64;
            self.total = self.number + fitting.saturating_sub(passed);
        }
    }

    /// Passes over the next scan, which nobody sees; when it would have been complete, or none
    /// after the last.
    pub fn pass(&mut self) -> Option<Stamp> {
        let turn = self.turn()?;
        let fired = self.fired();
        self.go_on(turn);
        Some(fired.plus_s(self.scanner.sweep_s()))
    }

    fn turn(&mut self) -> Option<Turn> {
        if self.number >= self.total {
            return None;
        }
        let number = self.number;
        let turn = self
            .hunting
            .as_mut()
            .map_or(Turn::default(), |hunting| hunting.next(number));
        if self.hunting.is_some() || self.setup.mode.interlace > 1 {
            self.scanner.turn(number, turn.offset_rad);
        }
        Some(turn)
    }

    /// When the first beam of the next scan fires.
    fn fired(&self) -> Stamp {
        let number = self.number as f64;
        self.setup
            .start
            .plus_s(number * self.scanner.period_s() + self.shift_s + self.scanner.lead_s())
    }

    fn go_on(&mut self, turn: Turn) {
        self.shift_s += turn.period_deviation * self.scanner.period_s();
        self.number += 1;
    }

    /// The next scan, or none after the last.
    pub fn advance(&mut self) -> Option<&Step> {
        let turn = self.turn()?;
        let number = self.number;
        let fired = self.fired();
        let t_s = fired.since_s(self.setup.start);
        let reference = fired.plus_s(self.scanner.reference_s());
        self.scan(number, fired, t_s, turn.offset_rad);
        let reference_s = reference.since_s(self.setup.start);
        let course = &self.setup.course;
        self.step.truth = point(reference, &course.truth(number, reference_s));
        self.step.desired = point(reference, &course.desired(number, reference_s));
        self.step.complete = fired.plus_s(self.scanner.sweep_s());
        self.sample_imu(number, reference);
        self.go_on(turn);
        Some(&self.step)
    }

    fn scan(&mut self, number: u64, fired: Stamp, t_s: f64, offset_rad: f64) {
        let (scanner, course, effects) = (&self.scanner, &self.setup.course, self.setup.effects);
        let moving = effects.has(Effect::Motion) && !course.is_resting();
        let frozen = Placement::new(&course.truth(number, t_s + scanner.reference_s()));
        let last = scanner.count().saturating_sub(1);
        let aperture_rad = [scanner.angle_min_rad(), scanner.angle_rad(last)];
        let mut physics = self.physics.scan(number, aperture_rad);
        let scan = &mut self.step.scan;
        scan.stamp = fired;
        scan.angle_min_rad = scanner.angle_min_rad();
        scan.seq = number as u32;
        scan.ranges_m.clear();
        scan.remissions.clear();
        let with_remission = effects.has(Effect::Remission);
        let with_echoes = effects.has(Effect::Echoes);
        let further = self.setup.parameters.echoes.count.clamp(1, MAX_ECHOES) - 1;
        let further = if with_echoes { further } else { 0 };
        clear_echoes(scan, further, with_remission);
        let mut echoes = [NO_ECHO; MAX_ECHOES];
        for index in 0..scanner.count() {
            let placement = if moving {
                let beam_s = t_s + index as f64 * scanner.time_increment_s();
                Placement::new(&course.truth(number, beam_s))
            } else {
                frozen
            };
            let (origin, direction) = scanner.beam(index);
            let count = physics.measure(
                scanner.angle_rad(index) + offset_rad,
                placement.origin_m + placement.rotation * origin,
                placement.rotation * direction,
                &mut echoes,
            );
            echoes
                .iter_mut()
                .skip(count)
                .for_each(|echo| *echo = NO_ECHO);
            scan.ranges_m.push(echoes[0].range_m);
            if with_remission {
                scan.remissions.push(echoes[0].remission);
            }
            push_echoes(scan, &echoes[1..=further]);
        }
        if effects.has(Effect::Clocks) {
            let clocks = &self.setup.parameters.clocks;
            let (seed, start) = (self.setup.seed, self.setup.start);
            clock::disturb(scan, clocks, seed, start, scanner.period_s());
        }
    }

    fn sample_imu(&mut self, number: u64, reference: Stamp) {
        self.step.imu.clear();
        let (course, start) = (&self.setup.course, self.setup.start);
        let Some(rate_hz) = self.setup.imu_rate_hz else {
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
        Some(self.setup.start.plus_s(last as f64 / rate_hz))
    }
}

/// The platform in B at an instant, ready to turn vectors.
#[derive(Clone, Copy, Debug)]
struct Placement {
    origin_m: Vector3<f64>,
    rotation: Rotation3<f64>,
}

impl Placement {
    fn new(state: &State) -> Placement {
        Placement {
            origin_m: state.position_m,
            rotation: rotation::attitude_matrix(state.rotation_rad),
        }
    }
}

const NO_ECHO: Echo = Echo {
    range_m: f64::INFINITY,
    remission: 0.0,
};

fn blank_step(scanner: &Scanner) -> Step {
    let scan = Scan {
        angle_min_rad: scanner.angle_min_rad(),
        angle_increment_rad: scanner.mode.step_rad(),
        time_increment_s: scanner.time_increment_s(),
        scan_time_s: scanner.period_s(),
        range_min_m: scanner.model.range_m[0],
        range_max_m: scanner.model.range_m[1],
        ..Scan::default()
    };
    Step {
        scan,
        ..Step::default()
    }
}

fn clear_echoes(scan: &mut Scan, further: usize, with_remission: bool) {
    scan.further_ranges_m.resize_with(further, Ranges::default);
    scan.further_ranges_m
        .iter_mut()
        .for_each(|list| list.clear());
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
