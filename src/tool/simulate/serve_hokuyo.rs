//! `simulate --serve --model utm-30lx`: a Hokuyo, emulated.

use super::serve::announce;
use super::serve_args::{Address, ServeArgs};
use super::source::Simulation;
use super::{Args, Sides, args};
use crate::hokuyo::PORT;
use crate::hokuyo::emulator::{Behaviour, Emulator};
use crate::hokuyo::scip::Parameters;
use crate::link::LinkError;
use crate::link::emulation::{Conditions, Emulation};
use crate::sick::emulator::TransmitStamp;
use crate::simulate::Setup;
use crate::stream::{Fault, Options, Outcome, Stop};
use std::time::Duration;

/// The model that is emulated.
pub(super) const MODEL: &str = "utm-30lx";
/// The speed that --baud has where nobody says another.
const LMS_BAUD: u32 = 57_600;

/// Runs the emulated scanner until what it sees has ended or a signal comes.
pub(super) fn run(args: &Args, setup: Setup, options: &Options) -> anyhow::Result<Outcome> {
    let serve = &args.serve;
    refuse_foreign(serve)?;
    let (start, index_to_first_beam_s) = (setup.start, setup.frame.scanner.index_to_first_beam_s);
    let simulator = args::simulator(setup)?;
    let sides = Sides::open(args, options)?;
    let source = Simulation::new(simulator, start, index_to_first_beam_s, sides, None);
    let behaviour = Behaviour {
        parameters: Parameters::utm_30lx(),
        serial: "H0000001".into(),
        boot: serve.boot.unwrap_or(Duration::ZERO),
        hold: serve.hold,
        linger: serve.linger,
        clock_ppm: serve.clock_ppm,
        uptime: Duration::try_from_secs_f64(serve.uptime_s).unwrap_or_default(),
    };
    let stop = Stop::install()?;
    let mut device = Emulator::new(behaviour, source);
    let mut emulation = Emulation::new(Conditions {
        speed: serve.speed.factor(),
        faults: serve.faults.clone(),
        seed: args.seed,
    });
    open(serve, &mut emulation, &mut device).map_err(super::serve::fault)?;
    let account = emulation
        .run(&mut device, || stop.requested())
        .map_err(super::serve::fault)?;
    if options.verbose > 0 {
        let tally = device.tally();
        eprintln!(
            "simulate: {} scans made, {} sent; {} requests, {} refused",
            tally.scans, tally.sent, tally.requests, tally.refused
        );
        eprintln!("simulate: {account}");
    }
    device.into_source().finish()?;
    Ok(Outcome::Done)
}

/// Options that mean something for an LMS5xx only.
fn refuse_foreign(serve: &ServeArgs) -> Result<(), Fault> {
    let foreign = [
        (serve.dialect != "any", "--dialect"),
        (serve.settle.is_some(), "--settle"),
        (serve.clock_offset_s.is_some(), "--clock-offset-s"),
        (serve.stamp != TransmitStamp::Send, "--stamp"),
    ];
    match foreign.iter().find(|(given, _)| *given) {
        Some((_, option)) => Err(Fault::Usage(format!(
            "{option} belongs to an LMS5xx, and the scanner is {MODEL}"
        ))),
        None => Ok(()),
    }
}

/// Opens every service and says where it is.
fn open(
    serve: &ServeArgs,
    emulation: &mut Emulation,
    device: &mut Emulator<Simulation>,
) -> Result<(), LinkError> {
    let address = serve.serve.map(|address| match address {
        Address::Port(address) => address,
        Address::Host(host) => (host, PORT).into(),
    });
    if let Some(address) = address {
        let address = emulation.listen(address)?;
        if !address.ip().is_loopback() {
            eprintln!(
                "simulate: {address} can be reached from other machines; nothing is encrypted"
            );
        }
        announce(MODEL, &address);
    }
    if let Some(link) = &serve.serve_pty {
        // Its serial line is USB, which knows no speed.
        let baud = (serve.baud != LMS_BAUD).then_some(serve.baud);
        emulation.open_pty(device, link, baud)?;
        announce(MODEL, &link.display());
    }
    Ok(())
}
