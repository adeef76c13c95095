//! Questions to a unit: who it is, what its cells hold, its bias, tare and tick, its conventions.

use super::NAME;
use super::arguments::{parse_address, parse_baud, parse_port, parse_tick};
use crate::gx1::attitude::Sense;
use crate::gx1::command::firmware_version;
use crate::gx1::conventions::Observation;
use crate::gx1::eeprom::{self, Cell, Guard};
use crate::gx1::session::{Interrupted, Line, write_request};
use crate::gx1::ticks::cycle_ticks;
use crate::gx1::{
    BAUD_RATES, Command, Gains, Packet, Session, SessionError, TickFactors, Word, scale,
    wire_time_s,
};
use crate::link::{Endpoint, latency_timer};
use crate::stream::{Fault, Outcome, Stop};
use crate::tool::values::parse_duration;
use std::io::{self, Write};
use std::time::Duration;

/// Which unit.
#[derive(Clone, Debug, clap::Args)]
pub struct UnitArgs {
    /// Serial port of the unit; what it streams is stopped
    #[arg(value_name = "DEVICE", value_parser = parse_port)]
    pub device: Endpoint,
    /// Speed of the unit, Bd [default: found by asking]
    #[arg(long, value_name = "BD", value_parser = parse_baud)]
    pub baud: Option<u32>,
    /// Address of the unit on an RS-485 line, where commands up to 0x0F can be asked
    #[arg(long, value_name = "N", value_parser = parse_address)]
    pub rs485_address: Option<u8>,
    /// Wait this long for the unit to answer
    #[arg(long, value_name = "TIME", default_value = "5s", value_parser = parse_duration)]
    pub wait: Duration,
}

/// Arguments of `info`.
#[derive(Clone, Debug, clap::Args)]
pub struct InfoArgs {
    /// The unit
    #[command(flatten)]
    pub unit: UnitArgs,
    /// As JSON
    #[arg(long)]
    pub json: bool,
}

/// Arguments of what changes the unit.
#[derive(Clone, Debug, clap::Args)]
pub struct ChangeArgs {
    /// Do it; without this the bytes are only printed
    #[arg(long)]
    pub yes: bool,
}

/// Arguments of `eeprom`.
#[derive(Clone, Debug, clap::Subcommand)]
pub enum EepromArgs {
    /// Prints cells
    Get {
        /// The unit
        #[command(flatten)]
        unit: UnitArgs,
        /// Cells by address or name (230, accel-gain-scale)
        #[arg(value_name = "CELL", required = true, value_parser = parse_cell)]
        cells: Vec<u16>,
    },
    /// Writes a cell and reads it back. Cells of the factory's calibration are refused; --yes does it
    Set {
        /// The unit
        #[command(flatten)]
        unit: UnitArgs,
        /// The cell by address or name
        #[arg(value_name = "CELL", value_parser = parse_cell)]
        cell: u16,
        /// What it shall hold: 0 to 65535, or -32768 to -1
        #[arg(value_name = "VALUE", value_parser = parse_value, allow_negative_numbers = true)]
        value: u16,
        /// Also cells that can cut the link or change the scales, and cells of unknown meaning
        #[arg(long)]
        force: bool,
        /// Whether to do it
        #[command(flatten)]
        change: ChangeArgs,
    },
    /// Prints every cell from 0 to 254 as CSV
    Dump {
        /// The unit
        #[command(flatten)]
        unit: UnitArgs,
    },
}

/// Arguments of `bias`.
#[derive(Clone, Debug, clap::Args)]
pub struct BiasArgs {
    /// The unit
    #[command(flatten)]
    pub unit: UnitArgs,
    /// Whether to do it
    #[command(flatten)]
    pub change: ChangeArgs,
}

/// Arguments of `tare`.
#[derive(Clone, Debug, clap::Args)]
pub struct TareArgs {
    /// The unit
    #[command(flatten)]
    pub unit: UnitArgs,
    /// Forget the tare instead
    #[arg(long)]
    pub remove: bool,
    /// Whether to do it
    #[command(flatten)]
    pub change: ChangeArgs,
}

/// Arguments of `rate`.
#[derive(Clone, Debug, clap::Args)]
pub struct RateArgs {
    /// The unit
    #[command(flatten)]
    pub unit: UnitArgs,
    /// Set the tick to TIME (10ms, 2ms, 6.5536ms)
    #[arg(long, value_name = "TIME", value_parser = parse_tick)]
    pub tick: Option<TickFactors>,
    /// Whether to do it
    #[command(flatten)]
    pub change: ChangeArgs,
}

/// Arguments of `check`.
#[derive(Clone, Debug, clap::Args)]
pub struct CheckArgs {
    /// The unit
    #[command(flatten)]
    pub unit: UnitArgs,
    /// Answers of each kind to take the mean of
    #[arg(short, long, value_name = "N", default_value = "20", value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub n_answers: u32,
}

/// For how long a capture of the bias may take.
const BIAS_WAIT: Duration = Duration::from_secs(60);
/// For how long a tare may take.
const TARE_WAIT: Duration = Duration::from_secs(20);

/// A unit that answers, and the wish to end.
struct Asked {
    session: Session,
    stop: Stop,
}

impl Asked {
    fn open(args: &UnitArgs) -> anyhow::Result<Asked> {
        let stop = Stop::install()?;
        let bauds: Vec<u32> = args.baud.into_iter().collect();
        let line = Line {
            port: &args.device,
            bauds: &bauds,
            bus_address: args.rs485_address,
        };
        let session = Session::open(&line, &[], None, args.wait, &|| stop.requested());
        match session {
            Ok(session) => Ok(Asked { session, stop }),
            Err(error) => Err(fault(&error, &stop)),
        }
    }

    /// Asks something of the session.
    fn ask<T>(
        &mut self,
        question: impl FnOnce(&mut Session, Interrupted<'_>) -> Result<T, SessionError>,
    ) -> anyhow::Result<T> {
        let stop = &self.stop;
        let answer = question(&mut self.session, &|| stop.requested());
        // What nobody reads would be kept for ever.
        while self.session.next().is_some() {}
        answer.map_err(|error| fault(&error, stop))
    }

    fn packet(&mut self, command: Command) -> anyhow::Result<Packet> {
        self.ask(|session, interrupted| session.ask(command, &[], interrupted))
    }

    fn cell(&mut self, address: u16) -> anyhow::Result<u16> {
        self.ask(|session, interrupted| session.cell(address, interrupted))
    }

    fn write_cell(&mut self, address: u16, value: u16) -> anyhow::Result<()> {
        self.ask(|session, interrupted| session.write_cell(address, value, interrupted))
    }
}

/// The exit status of a talk that ended early.
fn fault(error: &SessionError, stop: &Stop) -> anyhow::Error {
    if matches!(error, SessionError::Interrupted)
        && let Err(signal) = stop.check(0)
    {
        return signal;
    }
    Fault::Unavailable(error.to_string()).into()
}

/// Says who the unit is.
pub(super) fn info(args: InfoArgs) -> anyhow::Result<Outcome> {
    let mut asked = Asked::open(&args.unit)?;
    let identity = asked.ask(Session::identity)?;
    let tick = asked.ask(Session::tick_factors)?;
    let mut cells = Vec::new();
    for cell in eeprom::CELLS {
        cells.push((cell, asked.cell(cell.address)?));
    }
    let deg_c = asked
        .packet(Command::Temperature)?
        .word(Word::Temperature)
        .map(scale::temperature_deg_c);
    let timer = match &args.unit.device {
        Endpoint::Serial(path) => latency_timer(path),
        Endpoint::Tcp { .. } => None,
    };
    let mut out = io::stdout().lock();
    let baud = asked.session.baud();
    if args.json {
        let cells: serde_json::Map<String, serde_json::Value> = cells
            .iter()
            .map(|(cell, value)| (cell.name.to_owned(), (*value).into()))
            .collect();
        let text = serde_json::json!({
            "port": asked.session.place(),
            "baud": baud,
            "firmware": identity.firmware.map(firmware_version),
            "serial_number": identity.serial,
            "tick_ms": tick.tick_s() * 1e3,
            "temperature_deg_c": deg_c,
            "adapter_latency_timer_ms": timer.map(|timer| timer.ms),
            "cells": cells,
        });
        writeln!(out, "{text:#}")?;
        return Ok(Outcome::Done);
    }
    let place = asked.session.place();
    writeln!(out, "3DM-GX1 number {} at {place}", identity.serial)?;
    writeln!(out, "firmware     {}", super::firmware(identity))?;
    writeln!(out, "speed        {baud} Bd")?;
    writeln!(out, "tick         {} ms", tick.tick_s() * 1e3)?;
    if let Some(deg_c) = deg_c {
        writeln!(out, "temperature  {deg_c:.1} degC")?;
    }
    if let Some(timer) = timer {
        writeln!(out, "adapter      holds bytes for up to {} ms", timer.ms)?;
    }
    for (cell, value) in cells {
        let changed = match cell.default {
            Some(default) if default != value => format!(" (factory: {default})"),
            _ => String::new(),
        };
        writeln!(
            out,
            "{:>4} {:<20} {value}{changed}  {}",
            cell.address, cell.name, cell.meaning
        )?;
    }
    Ok(Outcome::Done)
}

/// Shows and sets cells.
pub(super) fn cells(args: EepromArgs) -> anyhow::Result<Outcome> {
    match args {
        EepromArgs::Get { unit, cells } => {
            let mut asked = Asked::open(&unit)?;
            let mut out = io::stdout().lock();
            for address in cells {
                writeln!(out, "{address}\t{}", asked.cell(address)?)?;
            }
        }
        EepromArgs::Dump { unit } => {
            let mut asked = Asked::open(&unit)?;
            let mut out = io::stdout().lock();
            writeln!(out, "address,value,name,default")?;
            for address in (0..=eeprom::LAST_ADDRESS).step_by(2) {
                let value = asked.cell(address)?;
                let cell = eeprom::at(address);
                let name = cell.map_or("", |cell| cell.name);
                let default = cell.and_then(|cell| cell.default);
                let default = default.map_or(String::new(), |value| value.to_string());
                writeln!(out, "{address},{value},{name},{default}")?;
            }
        }
        EepromArgs::Set {
            unit,
            cell,
            value,
            force,
            change,
        } => return set(&unit, cell, value, force, &change),
    }
    Ok(Outcome::Done)
}

fn set(
    unit: &UnitArgs,
    address: u16,
    value: u16,
    force: bool,
    change: &ChangeArgs,
) -> anyhow::Result<Outcome> {
    let name = eeprom::at(address).map_or(String::new(), |cell| format!(" ({})", cell.name));
    match eeprom::guard(address, value) {
        Guard::Refused(reason) => {
            let text = format!("cell {address}{name} is not written: {reason}");
            return Err(Fault::Usage(text).into());
        }
        Guard::Forced(reason) if !force => {
            let text = format!("cell {address}{name} needs --force: {reason}");
            return Err(Fault::Usage(text).into());
        }
        Guard::Forced(reason) => eprintln!("{NAME}: cell {address}{name}: {reason}"),
        Guard::Free => {}
    }
    if !change.yes {
        print_write(unit, address, value)?;
        return Ok(nothing_sent());
    }
    let mut asked = Asked::open(unit)?;
    let before = asked.cell(address)?;
    write_cell(asked, unit, address, value)?;
    print_line(&format!(
        "cell {address}{name}: {before} -> {value}, read back"
    ))?;
    Ok(Outcome::Done)
}

/// Writes a cell and reads it back, where need be at another speed.
fn write_cell(mut asked: Asked, unit: &UnitArgs, address: u16, value: u16) -> anyhow::Result<()> {
    let Err(error) = asked.write_cell(address, value) else {
        return Ok(());
    };
    if address != eeprom::BAUD_CELL {
        return Err(error);
    }
    // A new speed may act at once, and the answer was lost with the old one.
    drop(asked);
    let anew = UnitArgs {
        baud: eeprom::baud_of(value),
        ..unit.clone()
    };
    let got = Asked::open(&anew)?.cell(address)?;
    if got == value {
        return Ok(());
    }
    Err(error)
}

/// Prints how a cell would be written.
fn print_write(unit: &UnitArgs, address: u16, value: u16) -> anyhow::Result<()> {
    let request = write_request(address, value, unit.rs485_address.is_some());
    let (command, free) = request.map_err(|error| Fault::Usage(error.to_string()))?;
    print_request(unit, command, &free)
}

/// Prints what would be sent.
fn print_request(unit: &UnitArgs, command: Command, free: &[u8]) -> anyhow::Result<()> {
    let mut bytes = command.request(free).unwrap_or_default();
    if let (Some(address), Some(first)) = (unit.rs485_address, bytes.first_mut()) {
        let text = SessionError::NotOnBus(command).to_string();
        *first = command.bus_byte(address).ok_or(Fault::Usage(text))?;
    }
    let bytes: Vec<String> = bytes.iter().map(|byte| format!("{byte:02X}")).collect();
    print_line(&format!("{command} would be sent as {}", bytes.join(" ")))
}

/// A line of stdout, whose reader may have left.
fn print_line(text: &str) -> anyhow::Result<()> {
    Ok(writeln!(io::stdout().lock(), "{text}")?)
}

fn nothing_sent() -> Outcome {
    eprintln!("{NAME}: nothing was sent: --yes does it");
    Outcome::Done
}

/// Captures the gyros' bias.
pub(super) fn bias(args: BiasArgs) -> anyhow::Result<Outcome> {
    if !args.change.yes {
        print_request(&args.unit, Command::CaptureGyroBias, &[])?;
        return Ok(nothing_sent());
    }
    let mut asked = Asked::open(&args.unit)?;
    let gains = asked.ask(Session::gains)?;
    let before = mean_rate(&mut asked, gains)?;
    if before.spread_rad_s > STILL_RAD_S {
        let text = format!(
            "the unit turns (its rates spread over {:.3} rad/s): lay it still and try again",
            before.spread_rad_s
        );
        return Err(Fault::Unavailable(text).into());
    }
    eprintln!("{NAME}: capturing the bias; keep the unit still");
    asked.ask(|session, interrupted| {
        session.ask_within(Command::CaptureGyroBias, &[], BIAS_WAIT, 1, interrupted)
    })?;
    let after = mean_rate(&mut asked, gains)?;
    for (name, rate) in [("before", before), ("after", after)] {
        let [x, y, z] = rate.mean_rad_s;
        print_line(&format!("mean rate {name}: {x:+.5} {y:+.5} {z:+.5} rad/s"))?;
    }
    Ok(Outcome::Done)
}

/// The most that the rates of a still unit spread, rad/s.
const STILL_RAD_S: f64 = 0.1;

struct Rate {
    mean_rad_s: [f64; 3],
    spread_rad_s: f64,
}

fn mean_rate(asked: &mut Asked, gains: Gains) -> anyhow::Result<Rate> {
    const ANSWERS: u32 = 20;
    let (mut sum, mut low, mut high) = ([0.0; 3], [f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    for _ in 0..ANSWERS {
        let packet = asked.packet(Command::StabilisedVectors)?;
        let rate = gains.vector(&packet, Word::Rate).unwrap_or_default();
        for (((rate, sum), low), high) in rate.iter().zip(&mut sum).zip(&mut low).zip(&mut high) {
            *sum += rate;
            *low = low.min(*rate);
            *high = high.max(*rate);
        }
    }
    let spread = high.iter().zip(low).map(|(high, low)| high - low);
    Ok(Rate {
        mean_rad_s: sum.map(|sum| sum / f64::from(ANSWERS)),
        spread_rad_s: spread.fold(0.0, f64::max),
    })
}

/// Tares, or forgets the tare.
pub(super) fn tare(args: TareArgs) -> anyhow::Result<Outcome> {
    let command = if args.remove {
        Command::RemoveTare
    } else {
        Command::Tare
    };
    if !args.change.yes {
        print_request(&args.unit, command, &[])?;
        return Ok(nothing_sent());
    }
    let mut asked = Asked::open(&args.unit)?;
    if !args.remove {
        eprintln!("{NAME}: taring; keep the unit still for some seconds");
    }
    asked
        .ask(|session, interrupted| session.ask_within(command, &[], TARE_WAIT, 1, interrupted))?;
    print_line(&format!("{}: confirmed", command.title()))?;
    Ok(Outcome::Done)
}

/// Shows or sets the tick.
pub(super) fn rate(args: RateArgs) -> anyhow::Result<Outcome> {
    if let (Some(wanted), false) = (args.tick, args.change.yes) {
        for (address, value) in eeprom::TICK_CELLS.into_iter().zip(wanted.0) {
            print_write(&args.unit, address, value)?;
        }
        return Ok(nothing_sent());
    }
    let mut asked = Asked::open(&args.unit)?;
    // Whatever the cells hold: this is what mends them.
    let mut tick = asked.ask(Session::tick_factors)?;
    if let Some(wanted) = args.tick {
        let cells = eeprom::TICK_CELLS.into_iter().zip(wanted.0).zip(tick.0);
        let mut written = Vec::new();
        for ((address, value), before) in cells {
            if value != before {
                asked.write_cell(address, value)?;
                written.push(format!("cell {address}: {before} -> {value}, read back"));
            }
        }
        // Told when all are written: a tick of which a part is new is no tick that anybody wants.
        for line in written {
            print_line(&line)?;
        }
        tick = wanted;
        eprintln!("{NAME}: the new tick may act only after the unit was switched off and on");
    }
    let stabilised = asked.cell(eeprom::STABILISATION_CELL)? != 0;
    print_rates(tick, stabilised)?;
    Ok(Outcome::Done)
}

/// Prints what rates follow from a tick.
fn print_rates(tick: TickFactors, stabilised: bool) -> io::Result<()> {
    let mut out = io::stdout().lock();
    writeln!(
        out,
        "tick {} ms; samples a second by the protocol's cycles and by the line:",
        tick.tick_s() * 1e3
    )?;
    let bauds = BAUD_RATES.map(|baud| format!("{baud:>8}"));
    writeln!(
        out,
        "command                                    cycle{}",
        bauds.concat()
    )?;
    for command in [
        Command::StabilisedEulerAccelRate,
        Command::StabilisedQuaternionVectors,
        Command::StabilisedEuler,
        Command::StabilisedVectors,
        Command::InstantVectors,
    ] {
        let cycle_hz = 1.0 / (f64::from(cycle_ticks(command, stabilised)) * tick.tick_s());
        let title: String = command.title().chars().take(34).collect();
        write!(out, "0x{:02X} {title:<34} {cycle_hz:>8.1}", command.byte())?;
        for baud in BAUD_RATES {
            let line_hz = 1.0 / wire_time_s(command.reply_length(), baud);
            write!(out, "{:>8.1}", line_hz.min(cycle_hz))?;
        }
        writeln!(out)?;
    }
    Ok(())
}

/// Tells which conventions hold.
pub(super) fn check(args: CheckArgs) -> anyhow::Result<Outcome> {
    let mut asked = Asked::open(&args.unit)?;
    let gains = asked.ask(Session::gains)?;
    let mut observation = Observation::default();
    for _ in 0..args.n_answers {
        for command in [
            Command::StabilisedQuaternion,
            Command::StabilisedMatrix,
            Command::StabilisedEuler,
            Command::InstantVectors,
        ] {
            observation.add(&asked.packet(command)?, gains);
        }
    }
    let Some(found) = observation.conventions() else {
        return Err(Fault::BadData("the quaternion is zero: no attitude".into()).into());
    };
    let mut out = io::stdout().lock();
    for finding in &found.findings {
        let holds = if finding.holds { "yes" } else { "NO" };
        writeln!(out, "{:<28} {holds:<4} {}", finding.what, finding.found)?;
    }
    let sense = match found.sense {
        Some(Sense::Attitude) => "device to earth: --quaternion attitude (the default)",
        Some(Sense::Inverse) => "earth to device: --quaternion inverse",
        None => "not told by this pose: tilt the unit or turn it away from north",
    };
    writeln!(out, "the quaternion is            {sense}")?;
    let sign = match found.accel_sign {
        Some(sign) if sign > 0.0 => "specific force: --accel-sign force (the default)",
        Some(_) => "gravity: --accel-sign gravity",
        None => "not told: gravity is not along the vertical",
    };
    writeln!(out, "the acceleration is          {sign}")?;
    let all = found.findings.iter().all(|finding| finding.holds);
    if !all {
        eprintln!("{NAME}: not everything holds: is the unit still, and are its gains right?");
        return Ok(Outcome::Degraded);
    }
    Ok(Outcome::Done)
}

/// A cell by its address or its name.
fn parse_cell(text: &str) -> Result<u16, String> {
    if let Some(Cell { address, .. }) = eeprom::named(text) {
        return Ok(*address);
    }
    text.parse()
        .ok()
        .filter(|address: &u16| *address <= eeprom::LAST_ADDRESS + 1)
        .ok_or_else(|| {
            let names: Vec<&str> = eeprom::CELLS.iter().map(|cell| cell.name).collect();
            format!(
                "an address from 0 to 254 or a name is wanted: {}",
                names.join(", ")
            )
        })
}

/// What a cell can hold, signed or not.
fn parse_value(text: &str) -> Result<u16, String> {
    let wanted = || "a number from -32768 to 65535 is wanted".to_owned();
    if let Ok(value) = text.parse::<u16>() {
        return Ok(value);
    }
    text.parse::<i16>()
        .map(i16::cast_unsigned)
        .map_err(|_| wanted())
}
