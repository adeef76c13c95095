//! A scanner that is asked for the time, again and again.

use super::TOOL;
use crate::clock::{Tick, TickUnwrapper};
use crate::link::{Backoff, Endpoint};
use crate::record::{ClockExchange, Stamp};
use crate::sick::client::{Client, ClientError, Reply, Settings};
use crate::sick::cola::Dialect;
use crate::sick::scandata::{self, LmdScandata};
use crate::stream::{Fault, Stop};
use crate::tool::password;
use crate::tool::values::parse_duration;
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Which scanner, and how it is asked.
#[derive(Clone, Debug, clap::Args)]
#[command(next_help_heading = "Scanner")]
pub(super) struct DeviceArgs {
    /// The scanner: HOST, HOST:PORT or a serial port
    #[arg(value_name = "HOST")]
    pub host: Endpoint,
    /// Speed of a serial line
    #[arg(long, value_name = "BAUD", default_value_t = 57_600)]
    pub baud: u32,
    /// How long an answer may take
    #[arg(long, value_name = "TIME", default_value = "2s", value_parser = parse_duration)]
    pub timeout: Duration,
}

/// How often it is asked.
#[derive(Clone, Debug, clap::Args)]
#[command(next_help_heading = "Polling")]
pub(super) struct PaceArgs {
    /// Exchanges a second; their spacing is varied, so that they do not keep step with the scans
    #[arg(long, value_name = "HZ", default_value_t = 35.0, value_parser = parse_rate)]
    pub rate: f64,
    /// Before and after each request be busy for so long instead of sleeping: a CPU that sleeps wakes
    /// up late, and not equally late both ways
    #[arg(long, value_name = "TIME", default_value = "2ms", value_parser = parse_duration)]
    pub spin: Duration,
    /// Which of the device's times is asked for
    #[arg(long, value_enum, value_name = "WHICH", default_value_t = Which::Transmit)]
    pub stamp: Which,
}

/// A device's times in a scan.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub(super) enum Which {
    /// When the telegram was sent
    Transmit,
    /// When the scan was begun: useful one-way only
    Scan,
    /// The calendar at transmission, whole milliseconds; the time block must be switched on
    Calendar,
}

/// Who logs in.
#[derive(Clone, Debug, clap::Args)]
#[command(next_help_heading = "Login")]
pub(super) struct LoginArgs {
    /// File with the 8 hexadecimal digits of the password's hash [default: CABLEPOSE_PASSWORD, or the
    /// hash of the password with which devices are delivered]
    #[arg(long, value_name = "FILE")]
    pub password_file: Option<PathBuf>,
}

impl LoginArgs {
    /// The hash to log in with.
    pub fn hash(&self) -> Result<u32, Fault> {
        password::hash(self.password_file.as_deref())
    }
}

/// A fault of the session.
pub(super) fn fault(error: ClientError) -> anyhow::Error {
    Fault::Unavailable(error.to_string()).into()
}

/// A scanner that answers.
pub(super) fn connect(device: &DeviceArgs, stop: &Stop) -> anyhow::Result<Client> {
    let settings = Settings {
        baud: device.baud,
        answer: device.timeout,
        ..Settings::default()
    };
    let asked = stop.clone();
    let interrupted = Box::new(move || asked.requested());
    Client::connect(&device.host, &settings, None, Some(interrupted)).map_err(fault)
}

/// Asks for the time again and again.
pub(super) struct Poller {
    device: DeviceArgs,
    which: Which,
    period: Duration,
    spin: Duration,
    /// When the next one is due.
    due: Instant,
    number: u64,
    ticks: TickUnwrapper,
    last_raw_ns: Option<i64>,
    /// The next answer is the first of a connection.
    connected: bool,
    telegram: LmdScandata,
    pub counts: Counts,
}

/// What happened.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Counts {
    pub asked: u64,
    pub answered: u64,
    /// Requests that were refused or not answered in time.
    pub lost: u64,
    pub restarts: u64,
}

/// So many requests in a row without an answer end it.
const MOST_LOST: u32 = 5;
/// How long a device that was there may be away.
const AWAY: Duration = Duration::from_secs(60);
/// The longest sleep between two looks at whether to stop.
const NAP: Duration = Duration::from_millis(50);

impl Poller {
    pub fn new(device: &DeviceArgs, pace: &PaceArgs) -> Poller {
        Poller {
            device: device.clone(),
            which: pace.stamp,
            period: Duration::from_secs_f64(1.0 / pace.rate),
            spin: pace.spin,
            due: Instant::now(),
            number: 0,
            ticks: TickUnwrapper::default(),
            last_raw_ns: None,
            connected: false,
            telegram: LmdScandata::default(),
            counts: Counts::default(),
        }
    }

    /// The next exchange, when it is due; none when it is time to stop.
    ///
    /// # Errors
    /// Where the device does not answer any more, or not with a scan.
    pub fn next(
        &mut self,
        client: &mut Client,
        stop: &Stop,
        until: Option<Instant>,
    ) -> anyhow::Result<Option<ClockExchange>> {
        let mut lost = 0;
        client.set_spin(self.spin);
        loop {
            if !self.wait(stop, until) {
                return Ok(None);
            }
            self.counts.asked += 1;
            match client.poll() {
                Ok(reply) => {
                    while client.next().is_some() {}
                    self.counts.answered += 1;
                    return self.exchange(&reply).map(Some);
                }
                Err(ClientError::Interrupted) => return Ok(None),
                Err(error @ (ClientError::Silent { .. } | ClientError::Refused { .. })) => {
                    lost += 1;
                    self.counts.lost += 1;
                    if lost >= MOST_LOST {
                        return Err(fault(error));
                    }
                }
                // The device restarts, or somebody pulled the cable: what was logged stays good.
                Err(error @ ClientError::Link(_)) if self.counts.answered > 0 => {
                    self.counts.lost += 1;
                    eprintln!("{TOOL}: {error}; connecting again");
                    let Some(again) = self.reconnect(stop, until)? else {
                        return Ok(None);
                    };
                    *client = again;
                    self.connected = true;
                    client.set_spin(self.spin);
                }
                Err(error) => return Err(fault(error)),
            }
        }
    }

    /// Connects again, for at most a minute; none when it is time to stop.
    fn reconnect(&mut self, stop: &Stop, until: Option<Instant>) -> anyhow::Result<Option<Client>> {
        let mut backoff = Backoff::new(Duration::from_millis(100), Duration::from_secs(1));
        let given_up = Instant::now() + AWAY;
        loop {
            let due = Instant::now() + backoff.wait();
            while Instant::now() < due {
                if stop.requested() || until.is_some_and(|until| Instant::now() >= until) {
                    return Ok(None);
                }
                std::thread::sleep(NAP);
            }
            match connect(&self.device, stop) {
                Ok(client) => return Ok(Some(client)),
                Err(_) if stop.requested() => return Ok(None),
                Err(error) if Instant::now() >= given_up => return Err(error),
                Err(_) => {}
            }
        }
    }

    /// Waits until the next request is due: asleep, and in the end busy.
    fn wait(&mut self, stop: &Stop, until: Option<Instant>) -> bool {
        // The golden ratio's multiples cover the interval evenly and keep step with nothing.
        let share = (self.number as f64 * 0.618_033_988_749_895).fract();
        let due = self.due + self.period.mul_f64(0.5 * share);
        loop {
            let now = Instant::now();
            if stop.requested() || until.is_some_and(|until| now >= until) {
                return false;
            }
            let left = due.saturating_duration_since(now);
            if left.is_zero() {
                break;
            }
            match left.checked_sub(self.spin) {
                Some(sleep) if !sleep.is_zero() => std::thread::sleep(sleep.min(NAP)),
                _ => std::hint::spin_loop(),
            }
        }
        self.number += 1;
        // What was missed is not made up for.
        self.due += self.period;
        let now = Instant::now();
        if now.saturating_duration_since(self.due) > self.period {
            self.due = now;
        }
        true
    }

    fn exchange(&mut self, reply: &Reply) -> anyhow::Result<ClockExchange> {
        let telegram = reply.telegram();
        let bad =
            |what: String| Fault::Unavailable(format!("the answer to sRN LMDscandata: {what}"));
        if !scandata::is_scan(&telegram) {
            return Err(bad("no scan".to_owned()).into());
        }
        self.telegram
            .parse(&telegram)
            .map_err(|error| bad(error.to_string()))?;
        let device = match self.which {
            Which::Calendar => {
                let calendar = self.telegram.time.and_then(|time| time.stamp());
                calendar
                    .ok_or_else(|| bad("no time block; timesync set switches it on".to_owned()))?
            }
            Which::Transmit => self.unwrapped(self.telegram.transmit_tick_us, reply),
            Which::Scan => self.unwrapped(self.telegram.scan_tick_us, reply),
        };
        // The frame around the body: 4 + 4 + 1 bytes in CoLa B, 2 in CoLa A.
        let frame = match reply.dialect {
            Dialect::Binary => 9,
            Dialect::Text => 2,
        };
        Ok(ClockExchange {
            host_send: reply.sent.utc,
            device,
            host_receive: reply.first.utc,
            host_last: Some(reply.received.utc),
            host_send_raw: Some(Stamp::from_ns(reply.sent.raw_ns)),
            host_receive_raw: Some(Stamp::from_ns(reply.first.raw_ns)),
            request_bytes: Some(frame + "sRN LMDscandata".len() as u32),
            reply_bytes: Some(frame + u32::try_from(reply.body.len()).unwrap_or(u32::MAX - frame)),
        })
    }

    fn unwrapped(&mut self, tick: u32, reply: &Reply) -> Stamp {
        let raw_ns = reply.first.raw_ns;
        let elapsed_us = self.last_raw_ns.map(|last| (raw_ns - last) / 1000);
        self.last_raw_ns = Some(raw_ns);
        let tick = match std::mem::take(&mut self.connected) {
            true => self.ticks.push_connected(tick, elapsed_us),
            false => self.ticks.push(tick, elapsed_us),
        };
        self.counts.restarts += u64::from(matches!(tick, Tick::Restart(_)));
        Stamp::from_ns(tick.us().saturating_mul(1000))
    }
}

fn parse_rate(text: &str) -> Result<f64, String> {
    let rate: Option<f64> = text.parse().ok();
    rate.filter(|rate| (0.01..=1000.0).contains(rate))
        .ok_or_else(|| "a number of exchanges a second from 0.01 to 1000 is wanted".to_owned())
}
