//! `simulate --serve`, `--serve-pty`: the scanner itself, emulated.

use super::serve_args::{Address, ServeArgs};
use super::source::{Simulation, View};
use super::unit::{self, Origin};
use super::{Args, Sides, args, serve_hokuyo};
use crate::frame::{ScanMode, ScannerModel};
use crate::link::LinkError;
use crate::link::emulation::{Conditions, Emulation};
use crate::record::Stamp;
use crate::sick::cola::Dialect;
use crate::sick::emulator::recording::Recording;
use crate::sick::emulator::{Behaviour, Emulator, Identity, Source, Speech};
use crate::stream::{Fault, Options, Outcome, Stop};
use std::net::SocketAddr;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

/// The scanner's own ports: CoLa A, and the host port.
const TEXT_PORT: u16 = 2111;
const HOST_PORT: u16 = 2112;
/// How long a reboot takes that nobody says more about.
const REBOOT: Duration = Duration::from_secs(2);
/// How long nothing comes after a change of the scan frequency (up to 30 s on the device).
const SETTLE: Duration = Duration::from_millis(500);

/// Runs the emulated scanner until what it sees has ended or a signal comes.
pub(super) fn run(args: &Args) -> anyhow::Result<Outcome> {
    let mut options = args.common.options("simulate")?;
    options.seed = Some(args.seed);
    if args.common.output.is_some() || args.common.format.is_some() {
        let text = "-o and --format are for a stream of scans, which --serve does not write";
        return Err(Fault::Usage(text.into()).into());
    }
    let serve = &args.serve;
    if serve.replay.is_none() {
        let (frame, text) = args.read_frame()?;
        let setup = args::setup(args, frame, &options)?;
        if setup.model.name == serve_hokuyo::MODEL {
            options.configuration = Some(text);
            if args.unit.imu_pty.is_some() {
                let text = "--imu-pty goes with an LMS5xx; serve the IMU by a second simulate";
                return Err(Fault::Usage(text.into()).into());
            }
            return serve_hokuyo::run(args, setup, &options);
        }
    }
    let origin = args
        .unit
        .imu_pty
        .as_ref()
        .map(|_| Arc::new(Origin::default()));
    if origin.is_some() && serve.speed.factor() != Some(1.0) {
        let text = "--imu-pty needs --speed 1: the speed of a serial line is what it is";
        return Err(Fault::Usage(text.into()).into());
    }
    let (view, model, mode) = view(args, &mut options, origin.clone())?;
    let stop = Stop::install()?;
    let mut emulation = Emulation::new(Conditions {
        speed: serve.speed.factor(),
        faults: serve.faults.clone(),
        seed: args.seed,
    });
    let behaviour = behaviour(serve, model, mode, emulation.start().utc);
    let mut device = Emulator::new(behaviour, view);
    open(serve, &mut emulation, &mut device).map_err(fault)?;
    if options.verbose > 0 {
        // Together with --clock-ppm the whole truth of the scanner's clock.
        eprintln!(
            "simulate: the counter was at {} s at {} ns of the monotonic raw clock",
            serve.uptime_s,
            emulation.start().raw_ns
        );
    }
    let account = match &origin {
        None => emulation.run(&mut device, || stop.requested()),
        Some(origin) => {
            origin.scanner_starts_at(emulation.start().raw_ns);
            unit::beside(args, &options, origin, &stop, |stop| {
                emulation.run(&mut device, stop)
            })?
        }
    }
    .map_err(fault)?;
    if options.verbose > 0 {
        let tally = device.tally();
        eprintln!(
            "simulate: {} scans made, {} telegrams; {} requests, {} refused",
            tally.scans, tally.telegrams, tally.requests, tally.refused
        );
        eprintln!("simulate: {account}");
    }
    device.into_source().finish()?;
    Ok(Outcome::Done)
}

/// What the scanner sees, and its first mode.
pub(super) fn view(
    args: &Args,
    options: &mut Options,
    origin: Option<Arc<Origin>>,
) -> anyhow::Result<(View, &'static ScannerModel, ScanMode)> {
    if let Some(path) = &args.serve.replay {
        let (recording, model) = recording(path, args.serve.repeat)?;
        let mode = recording.fixed_mode();
        let mode = mode.unwrap_or(model.modes[0]);
        return Ok((View::Recording(recording), model, mode));
    }
    let (frame, text) = args.read_frame()?;
    options.configuration = Some(text);
    let index_to_first_beam_s = frame.scanner.index_to_first_beam_s;
    let setup = args::setup(args, frame, options)?;
    let (start, model, mode) = (setup.start, setup.model, setup.mode);
    if !model.name.starts_with("lms5") {
        let text = format!(
            "--serve emulates an LMS5xx or a UTM-30LX, and the scanner is {}",
            model.name
        );
        return Err(Fault::Usage(text).into());
    }
    let simulator = args::simulator(setup)?;
    let sides = Sides::open(args, options)?;
    let simulation = Simulation::new(simulator, start, index_to_first_beam_s, sides, origin);
    Ok((View::Simulation(Box::new(simulation)), model, mode))
}

fn recording(path: &Path, repeat: u64) -> anyhow::Result<(Recording, &'static ScannerModel)> {
    let name = path.display();
    let bytes = std::fs::read(path).map_err(|error| {
        let text = error.to_string();
        let text = text.split(" (os error").next().unwrap_or_default();
        Fault::NoInput(format!("{name}: {text}"))
    })?;
    let model = ScannerModel::by_name("lms511-hr")
        .ok_or_else(|| Fault::Usage("the LMS511 is not known".into()))?;
    let passes = (repeat > 0).then_some(repeat);
    let recording = Recording::new(&bytes, model, passes)
        .map_err(|error| Fault::BadData(format!("{name}: {error}")))?;
    Ok((recording, model))
}

pub(super) fn behaviour(
    serve: &ServeArgs,
    model: &'static ScannerModel,
    mode: ScanMode,
    start: Stamp,
) -> Behaviour {
    let (host, host_dialect) = match serve.dialect.as_str() {
        "a" => (Speech::Host, Dialect::Text),
        "b" => (Speech::Host, Dialect::Binary),
        _ => (Speech::Both, Dialect::Binary),
    };
    let mut speech = Vec::new();
    match serve.serve {
        Some(Address::Port(_)) => speech.push(host),
        Some(Address::Host(_)) => speech.extend([Speech::Text, host]),
        None => {}
    }
    speech.extend(serve.serve_pty.iter().map(|_| host));
    Behaviour {
        identity: Identity::default(),
        model,
        mode,
        speech,
        host_dialect,
        boot: serve.boot.unwrap_or(Duration::ZERO),
        reboot: serve.boot.unwrap_or(REBOOT),
        settle: serve.settle.unwrap_or(SETTLE),
        hold: serve.hold,
        linger: serve.linger,
        clock_ppm: serve.clock_ppm,
        calendar_ns: serve
            .clock_offset_s
            .map(|offset_s| start.plus_s(offset_s).ns()),
        uptime: Duration::try_from_secs_f64(serve.uptime_s).unwrap_or_default(),
        transmit_stamp: serve.stamp,
    }
}

/// Opens every service and says where it is.
fn open(
    serve: &ServeArgs,
    emulation: &mut Emulation,
    device: &mut Emulator<View>,
) -> Result<(), LinkError> {
    let addresses: Vec<SocketAddr> = match serve.serve {
        Some(Address::Port(address)) => vec![address],
        Some(Address::Host(host)) => [TEXT_PORT, HOST_PORT]
            .map(|port| (host, port).into())
            .into(),
        None => Vec::new(),
    };
    for address in addresses {
        let address = emulation.listen(address)?;
        if !address.ip().is_loopback() {
            eprintln!(
                "simulate: {address} can be reached from other machines; nothing is encrypted"
            );
        }
        announce("lms511", &address);
    }
    if let Some(link) = &serve.serve_pty {
        emulation.open_pty(device, link, Some(serve.baud))?;
        announce("lms511", &link.display());
    }
    Ok(())
}

pub(super) fn fault(error: LinkError) -> Fault {
    match error {
        LinkError::Open { .. } => Fault::Unavailable(error.to_string()),
        _ => Fault::Io(error.to_string()),
    }
}

/// Says on stderr where an emulated device is, in one write: whoever follows the text never meets
/// half an address.
pub(super) fn announce(device: &str, place: &dyn std::fmt::Display) {
    let line = format!("simulate: serving {device} at {place}\n");
    eprint!("{line}");
}
