//! timesync ntp: a scanner as client of a time server.

use super::live::{self, DeviceArgs, LoginArgs, fault};
use crate::sick::client::commands;
use crate::sick::client::{Client, Request, Value, Values};
use crate::sick::scandata::FieldError;
use crate::stream::{Fault, Outcome, Stop, WholeFile};
use crate::tool::values::parse_duration;
use serde::Serialize;
use std::net::Ipv4Addr;
use std::time::Duration;

/// Make a scanner the client of a time server, or see how well that goes
///
/// With --server or --off logs in and configures; always reads the settings back, with the largest
/// offset and the delay that the device has found (TSCTCmaxoffset, TSCTCdelay).
#[derive(Debug, clap::Args)]
pub struct Args {
    #[command(flatten)]
    device: DeviceArgs,
    #[command(flatten)]
    login: LoginArgs,
    /// Take the time from the server at this address
    #[arg(long, value_name = "ADDR", conflicts_with = "off")]
    server: Option<Ipv4Addr>,
    /// Take the time from nobody
    #[arg(long)]
    off: bool,
    /// How often the server is asked, whole seconds, 1s to 1h
    #[arg(long, value_name = "TIME", default_value = "10s", value_parser = parse_interval, requires = "server")]
    interval: u32,
    /// The device's time zone, hours from Greenwich, -12 to 12
    #[arg(long, value_name = "HOURS", default_value_t = 0, allow_hyphen_values = true,
        value_parser = clap::value_parser!(i8).range(-12..=12), requires = "server")]
    timezone: i8,
    /// Forget the largest offset so far
    #[arg(long)]
    reset_max_offset: bool,
    /// Keep the settings over power-off
    #[arg(long)]
    save: bool,
    /// Write the result as JSON
    #[arg(long)]
    json: bool,
}

/// What the device says.
#[derive(Debug, Serialize)]
struct State {
    /// 0 off, 1 client, 2 server.
    role: u8,
    /// 0 Ethernet, 1 CAN.
    interface: u8,
    server: Ipv4Addr,
    timezone_h: i16,
    interval_s: u32,
    max_offset_s: f32,
    delay_s: f32,
}

const OFF: u8 = 0;
const CLIENT: u8 = 1;
const SERVER: u8 = 2;

impl State {
    /// How it is not what the device was told, if it is not.
    fn differs_from(&self, server: Option<Ipv4Addr>, off: bool) -> Option<String> {
        let role = self.role();
        match server {
            Some(server) if self.role != CLIENT || self.server != server => Some(format!(
                "the device was told to be the client of {server}; its role is {role}, its server {}",
                self.server
            )),
            None if off && self.role != OFF => Some(format!(
                "the device was told to take the time from nobody; its role is {role}"
            )),
            _ => None,
        }
    }

    fn role(&self) -> &'static str {
        match self.role {
            OFF => "off",
            CLIENT => "client",
            SERVER => "server",
            _ => "not documented",
        }
    }
}

pub(super) fn run(args: &Args) -> anyhow::Result<Outcome> {
    let hash = args.login.hash()?;
    let stop = Stop::install()?;
    let mut client = live::connect(&args.device, &stop)?;
    let writes = writes(args);
    if !writes.is_empty() {
        client.log_in(hash).map_err(fault)?;
        let mut write = || {
            for request in &writes {
                client.request(request).map_err(fault)?;
            }
            anyhow::Ok(())
        };
        let written = write();
        // Logged out in any case: a device that is logged in to does not measure.
        let running = client.run().map_err(fault);
        written.and(running)?;
    }
    let state = read_back(&mut client)?;
    if let Some(otherwise) = state.differs_from(args.server, args.off) {
        return Err(Fault::Unavailable(otherwise).into());
    }
    let text = match args.json {
        true => serde_json::to_string_pretty(&state)? + "\n",
        false => words(&state),
    };
    WholeFile::open(None)?.finish(&text)?;
    Ok(Outcome::Done)
}

fn words(state: &State) -> String {
    format!(
        "role              {}\nserver            {}\ninterval          {} s\n\
         time zone         {:+} h\nlargest offset    {:.6} s\ndelay             {:.6} s\n",
        state.role(),
        state.server,
        state.interval_s,
        state.timezone_h,
        state.max_offset_s,
        state.delay_s
    )
}

fn writes(args: &Args) -> Vec<Request> {
    let mut writes = Vec::new();
    if args.off {
        writes.push(Request::write("TSCRole", vec![Value::U8(OFF)]));
    }
    if let Some(server) = args.server {
        let address = server.octets().map(Value::Byte).to_vec();
        // The listing counts time zones from 0 = -12 h.
        let zone = u8::try_from(i16::from(args.timezone) + 12).unwrap_or(12);
        let interval = i32::try_from(args.interval).unwrap_or(3600);
        writes.extend([
            Request::write("TSCTCInterface", vec![Value::U8(0)]),
            Request::write("TSCTCSrvAddr", address),
            Request::write("TSCTCtimezone", vec![Value::Byte(zone)]),
            Request::write("TSCTCupdatetime", vec![Value::I32(interval)]),
            Request::write("TSCRole", vec![Value::U8(CLIENT)]),
        ]);
    }
    if args.reset_max_offset {
        writes.push(Request::method("mResetMaxOff", Vec::new()));
    }
    if args.save {
        writes.push(commands::save());
    }
    writes
}

fn read_back(client: &mut Client) -> anyhow::Result<State> {
    Ok(State {
        role: value(client, "TSCRole", |v| v.u8("role"))?,
        interface: value(client, "TSCTCInterface", |v| v.u8("interface"))?,
        server: value(client, "TSCTCSrvAddr", |v| {
            let mut octets = [0; 4];
            for octet in &mut octets {
                *octet = v.u8("address")?;
            }
            Ok(octets.into())
        })?,
        timezone_h: value(client, "TSCTCtimezone", |v| {
            Ok(i16::from(v.u8("time zone")?) - 12)
        })?,
        interval_s: value(client, "TSCTCupdatetime", |v| v.u32("interval"))?,
        max_offset_s: value(client, "TSCTCmaxoffset", |v| v.real("largest offset"))?,
        delay_s: value(client, "TSCTCdelay", |v| v.real("delay"))?,
    })
}

fn value<T>(
    client: &mut Client,
    name: &str,
    read: impl FnOnce(&mut Values) -> Result<T, FieldError>,
) -> anyhow::Result<T> {
    let reply = client.request(&Request::read(name)).map_err(fault)?;
    read(&mut reply.values())
        .map_err(|error| Fault::Unavailable(format!("answer to sRN {name}: {error}")).into())
}

fn parse_interval(text: &str) -> Result<u32, String> {
    let interval: Duration = parse_duration(text)?;
    let whole = interval.subsec_nanos() == 0 && (1..=3600).contains(&interval.as_secs());
    match u32::try_from(interval.as_secs()) {
        Ok(seconds) if whole => Ok(seconds),
        _ => Err("whole seconds from 1s to 1h are wanted".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_device_that_does_otherwise_is_told_by_what_it_does() {
        let server = Ipv4Addr::new(192, 0, 2, 1);
        let state = |role, server| State {
            role,
            interface: 0,
            server,
            timezone_h: 0,
            interval_s: 10,
            max_offset_s: 0.0,
            delay_s: 0.0,
        };
        let other = Ipv4Addr::new(192, 0, 2, 2);
        assert_eq!(
            state(CLIENT, server).differs_from(Some(server), false),
            None
        );
        assert_eq!(state(OFF, server).differs_from(None, true), None);
        assert_eq!(state(SERVER, other).differs_from(None, false), None);
        for (found, wanted, off, text) in [
            (state(OFF, server), Some(server), false, "role is off"),
            (
                state(CLIENT, other),
                Some(server),
                false,
                "server 192.0.2.2",
            ),
            (state(CLIENT, server), None, true, "role is client"),
        ] {
            let told = found.differs_from(wanted, off).unwrap();
            assert!(told.contains(text), "{told}");
        }
    }
}
