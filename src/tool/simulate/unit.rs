//! `simulate --imu-pty`: the IMU itself, emulated on a serial line, beside the scanner or alone.

use super::serve::{announce, fault};
use super::serve_args::ImuArgs;
use super::{Args, args};
use crate::gx1::emulator::{Behaviour, Emulator, Senses};
use crate::gx1::{Command, TickFactors};
use crate::link::emulation::{Account, Conditions, Device, Emulation, Outbox, Serial};
use crate::link::{HostInstant, LinkError, Recorder, Rotation};
use crate::record::{Axes, ImuSample, Stamp};
use crate::simulate::{Course, Effect, Setup, Unit};
use crate::stream::{Fault, Options, Outcome, Stop};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock, mpsc};

/// When the course begins, for all that move on it.
#[derive(Debug, Default)]
pub(super) struct Origin {
    /// On the host's monotonic raw clock, ns.
    scanner_start_ns: OnceLock<i64>,
    zero_ns: OnceLock<i64>,
}

impl Origin {
    /// The scanner's emulation counts its time from here.
    pub(super) fn scanner_starts_at(&self, raw_ns: i64) {
        // The first one holds.
        let _ = self.scanner_start_ns.set(raw_ns);
    }

    /// The course begins at this time of the scanner's emulation.
    pub(super) fn begin(&self, now_ns: i64) {
        if let Some(start_ns) = self.scanner_start_ns.get() {
            self.begin_at(start_ns + now_ns);
        }
    }

    fn begin_at(&self, raw_ns: i64) {
        let _ = self.zero_ns.set(raw_ns);
    }
}

/// The IMU on the simulated platform.
struct Mounted {
    course: Course,
    unit: Unit,
    period_s: f64,
    /// How long the course lasts, s.
    lasts_s: f64,
    origin: Arc<Origin>,
    /// Where the emulation's own time began, ns of the monotonic raw clock.
    start_ns: i64,
    /// The course begins with the first question.
    hold: bool,
    /// The unit itself says when the course is over.
    alone: bool,
    last_ns: i64,
}

impl Mounted {
    fn new(setup: Setup, origin: Arc<Origin>, hold: bool, alone: bool) -> Mounted {
        let period_s = 1.0 / setup.mode.frequency_hz;
        let mut unit = Unit::new(&setup.frame, Axes::Ned);
        if setup.effects.has(Effect::Imu) {
            unit = unit.with_errors(&setup.parameters.imu, setup.seed);
        }
        Mounted {
            // The run's last scan is made in the period that ends it.
            lasts_s: setup.scans.unwrap_or(0) as f64 * period_s,
            course: setup.course,
            unit,
            period_s,
            origin,
            start_ns: 0,
            hold,
            alone,
            last_ns: i64::MIN,
        }
    }

    /// Time on the course; before its start it is below 0.
    fn course_s(&self, now_ns: i64) -> f64 {
        match self.origin.zero_ns.get() {
            None => -1.0,
            Some(zero_ns) => (self.start_ns + now_ns - zero_ns) as f64 * 1e-9,
        }
    }
}

impl Senses for Mounted {
    fn sample(&mut self, now_ns: i64) -> ImuSample {
        let t_s = self.course_s(now_ns);
        let number = (t_s.max(0.0) / self.period_s) as u64;
        let state = self.course.truth(number, t_s);
        // The noise is made from time differences: never none.
        self.last_ns = now_ns.max(self.last_ns.saturating_add(1));
        self.unit.sample(&state, Stamp::from_ns(self.last_ns))
    }

    fn asked(&mut self, now_ns: i64) {
        if self.hold && self.alone {
            self.origin.begin_at(self.start_ns + now_ns);
        }
    }

    fn ended(&self, now_ns: i64) -> bool {
        self.alone && self.course_s(now_ns) > self.lasts_s
    }
}

fn behaviour(unit: &ImuArgs, setup: &Setup, seed: u64) -> Behaviour {
    let noisy = setup.effects.has(Effect::Imu);
    Behaviour {
        baud: unit.imu_baud.parse().unwrap_or(38_400),
        tick: unit.imu_tick.unwrap_or(TickFactors::FACTORY),
        power_up: unit.imu_streams,
        clock_ppm: unit.imu_ppm,
        first_tick: unit.imu_first_tick,
        noisy,
        seed,
        ..Behaviour::default()
    }
}

/// The run once more, for the IMU: where the platform is at any time.
fn setup(args: &Args, options: &Options) -> anyhow::Result<Setup> {
    let (frame, _) = args.read_frame()?;
    let mut setup = args::setup(args, frame, options)?;
    setup.scans = Some(setup.scans());
    Ok(setup)
}

/// Opens the line and says where it is.
fn open(
    args: &Args,
    options: &Options,
    origin: &Arc<Origin>,
    alone: bool,
) -> anyhow::Result<(Emulation, Emulator<Mounted>)> {
    let setup = setup(args, options)?;
    let behaviour = behaviour(&args.unit, &setup, args.seed);
    let baud = behaviour.baud;
    let mut emulation = Emulation::new(Conditions {
        speed: Some(1.0),
        faults: args.unit.imu_faults.clone(),
        seed: args.seed,
    });
    let mut mounted = Mounted::new(setup, Arc::clone(origin), args.serve.hold, alone);
    mounted.start_ns = emulation.start().raw_ns;
    if alone && !args.serve.hold {
        origin.begin_at(mounted.start_ns);
    }
    let mut device = Emulator::new(behaviour, mounted);
    let link = args.unit.imu_pty.as_deref().unwrap_or(Path::new("imu"));
    let serial = Serial {
        baud: Some(baud),
        adapter: args.unit.imu_adapter,
        strict: true,
    };
    emulation
        .open_serial(&mut device, link, serial)
        .map_err(fault)?;
    announce("imu", &link.display());
    Ok((emulation, device))
}

fn account_for(options: &Options, device: &Emulator<Mounted>, account: &Account) {
    if options.verbose > 0 {
        let tally = device.tally();
        eprintln!(
            "simulate: IMU: {} commands, {} lost to a full queue, {} bytes that were none, {} packets \
             streamed",
            tally.commands, tally.crowded_out, tally.ignored_bytes, tally.streamed
        );
        eprintln!("simulate: IMU: {account}");
    }
}

/// Runs the IMU without a scanner until the course is over or a signal comes.
pub(super) fn alone(args: &Args) -> anyhow::Result<Outcome> {
    let mut options = args.common.options("simulate")?;
    options.seed = Some(args.seed);
    let useless = [&args.common.output, &args.truth, &args.desired, &args.imu];
    if useless.iter().any(|path| path.is_some()) || args.common.format.is_some() {
        let text = "-o, --format, --truth, --desired and --imu are of scans, which --imu-pty alone \
                    does not make; add --serve";
        return Err(Fault::Usage(text.into()).into());
    }
    let stop = Stop::install()?;
    let origin = Arc::new(Origin::default());
    let (emulation, mut device) = open(args, &options, &origin, true)?;
    let account = emulation
        .run(&mut device, || stop.requested())
        .map_err(fault)?;
    account_for(&options, &device, &account);
    Ok(Outcome::Done)
}

/// What the scanner's emulation gives when it has run.
type Ran = Result<Account, LinkError>;

/// Runs the IMU in a thread of its own while `scanner` runs; it ends with the scanner.
pub(super) fn beside(
    args: &Args,
    options: &Options,
    origin: &Arc<Origin>,
    stop: &Stop,
    scanner: impl FnOnce(&mut dyn FnMut() -> bool) -> Ran,
) -> anyhow::Result<Ran> {
    let over = AtomicBool::new(false);
    let failed = AtomicBool::new(false);
    std::thread::scope(|scope| {
        let (ready, opened) = mpsc::channel();
        let (over, failed) = (&over, &failed);
        let thread = scope.spawn(move || -> anyhow::Result<()> {
            let (emulation, mut device) = open(args, options, origin, false)?;
            let _ = ready.send(());
            let ended = || over.load(Ordering::Relaxed);
            let account = emulation.run(&mut device, ended);
            if account.is_err() {
                failed.store(true, Ordering::Relaxed);
            }
            account_for(options, &device, &account.map_err(fault)?);
            Ok(())
        });
        let ran = match opened.recv() {
            Ok(()) => {
                let ran = scanner(&mut || stop.requested() || failed.load(Ordering::Relaxed));
                Some(ran)
            }
            // The thread has ended without a line; it says why.
            Err(_) => None,
        };
        over.store(true, Ordering::Relaxed);
        let ended = thread
            .join()
            .unwrap_or_else(|panic| std::panic::resume_unwind(panic));
        ended?;
        ran.ok_or_else(|| Fault::Unavailable("the IMU's line did not open".into()).into())
    })
}

/// Records what a reader gets from the IMU over the whole run, without waiting for it: the answers
/// to what a reader asks first, then the stream.
pub(super) fn record(args: &Args, options: &Options, path: &Path) -> anyhow::Result<()> {
    let setup = setup(args, options)?;
    let start = setup.start;
    let behaviour = behaviour(&args.unit, &setup, args.seed);
    let streamed = args
        .unit
        .imu_streams
        .unwrap_or(Command::StabilisedEulerAccelRate);
    if !streamed.is_measurement() {
        let text = format!("--imu-streams: {streamed} is no measurement to record");
        return Err(Fault::Usage(text).into());
    }
    let behaviour = Behaviour {
        power_up: None,
        ..behaviour
    };
    let origin = Arc::new(Origin::default());
    let mounted = Mounted::new(setup, Arc::clone(&origin), false, true);
    origin.begin_at(mounted.start_ns);
    let byte_ns = 1e10 / f64::from(behaviour.baud);
    let adapter_ns = i64::try_from(args.unit.imu_adapter.as_nanos()).unwrap_or(0);
    let mut device = Emulator::new(behaviour, mounted);
    device.connected(0, 0, 0);
    let mut out = Outbox::default();
    let mut requests = vec![vec![0x10, 0, 0], vec![0xF0], vec![0xF1]];
    requests.extend([130u8, 230, 232, 238, 240, 242, 246, 122].map(|cell| vec![0x28, 0, cell]));
    requests.push(vec![0x10, 0, streamed.byte()]);
    for request in requests {
        device.input(0, &request, 0, &mut out);
    }
    let mut recorder = Recorder::create(path, Rotation::default()).map_err(unwritten)?;
    let mut free_ns = 0.0f64;
    while !device.ended() {
        let Some(due_ns) = device.due_ns() else {
            break;
        };
        device.advance(due_ns, &mut out);
        for (_, _, bytes) in out.take() {
            free_ns = free_ns.max(due_ns as f64) + bytes.len() as f64 * byte_ns;
            let mut at_ns = free_ns as i64;
            if adapter_ns > 0 {
                at_ns = (at_ns + adapter_ns - 1).div_euclid(adapter_ns) * adapter_ns;
            }
            let at = HostInstant {
                utc: start + at_ns,
                raw_ns: at_ns,
            };
            recorder.chunk(&bytes, at).map_err(unwritten)?;
        }
    }
    recorder.finish().map_err(unwritten)?;
    let unit = device.unit_file(&[streamed]);
    unit.save_beside(path).map_err(unwritten)?;
    Ok(())
}

fn unwritten(error: crate::link::RecordingError) -> Fault {
    Fault::Io(error.to_string())
}
