//! timesync track: stamps from the device's clock.

use super::TOOL;
use crate::clock::{ClockFit, Exchange, FitSettings, Method, OneWayHull, OneWaySettings, fit};
use crate::record::{ImuSample, Scan, Stamp};
use crate::stream::{self, Emit, Fault, Input, Options, Outcome, Stage, StreamRecord};
use crate::tool::arguments::CommonArgs;
use crate::tool::values::parse_duration;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Scans or IMU samples with stamps from the device's clock
///
/// Each record's stamp_ns becomes its device_ns mapped to the host's clock: by the line under the
/// cloud of arrival minus device time, which late arrivals do not move. The shortest delay stays in
/// it. Causal, in pieces that follow a changing rate; --smooth uses the whole file instead. A restart
/// of the device and a step of either clock are said on stderr, and a new line begins.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Scans or IMU samples with device_ns and received_ns, CSV or MCAP [default: stdin]
    #[arg(value_name = "RECORDS")]
    input: Option<PathBuf>,
    /// What the records are [default: told from a CSV file's header; scan]
    #[arg(long, value_enum, value_name = "KIND")]
    kind: Option<Kind>,
    /// Fit the whole file before mapping: not causal, and smoother
    #[arg(long)]
    smooth: bool,
    /// The line is taken from the last half to whole of this time
    #[arg(long, value_name = "TIME", default_value = "60s", value_parser = parse_duration, conflicts_with = "smooth")]
    window: Duration,
    /// From the zero index, which a scanner stamps, to its first beam
    #[arg(long, value_name = "TIME", default_value = "0us", value_parser = parse_duration)]
    index_to_first_beam: Duration,
    /// Where the scanner's aperture begins; a scan whose range is cut begins later
    #[arg(long, value_name = "DEG", default_value_t = -5.0, allow_hyphen_values = true)]
    aperture_start_deg: f64,
    #[command(flatten)]
    common: CommonArgs,
}

/// Kinds of records that have a device's time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Kind {
    /// Scans
    Scan,
    /// IMU samples
    Imu,
}

pub(super) fn run(args: &Args) -> anyhow::Result<Outcome> {
    let options = args.common.options(TOOL)?;
    let path = args.input.as_deref().filter(|path| *path != Path::new("-"));
    match args
        .kind
        .or_else(|| path.and_then(kind_of))
        .unwrap_or(Kind::Scan)
    {
        Kind::Scan => track::<Scan>(args, path, &options),
        Kind::Imu => track::<ImuSample>(args, path, &options),
    }
}

/// What a CSV file's header says.
fn kind_of(path: &Path) -> Option<Kind> {
    if !std::fs::metadata(path).is_ok_and(|found| found.is_file()) {
        return None;
    }
    let mut head = Vec::new();
    File::open(path)
        .ok()?
        .take(4096)
        .read_to_end(&mut head)
        .ok()?;
    let line = head.split(|byte| *byte == b'\n').next()?;
    let has = |column: &str| {
        let mut columns = line.split(|byte| *byte == b',');
        columns.any(|name| name.trim_ascii() == column.as_bytes())
    };
    match (has("ranges_mm"), has("gyro_x_rad_s") || has("axes")) {
        (true, _) => Some(Kind::Scan),
        (_, true) => Some(Kind::Imu),
        _ => None,
    }
}

fn track<R: Timed>(args: &Args, path: Option<&Path>, options: &Options) -> anyhow::Result<Outcome> {
    let beam = Beam {
        index_to_first_s: args.index_to_first_beam.as_secs_f64(),
        aperture_start_rad: args.aperture_start_deg.to_radians(),
    };
    let mut stage = Tracker::<R> {
        beam,
        map: match args.smooth {
            false => Map::Causal(Box::new(OneWayHull::new(OneWaySettings {
                window_s: args.window.as_secs_f64().max(1e-3),
                ..OneWaySettings::default()
            }))),
            true => Map::Smooth(Smooth::of::<R>(path, options)?),
        },
        newest: None,
        records: 0,
        unmapped: 0,
        quiet: options.quiet,
        kind: std::marker::PhantomData,
    };
    stream::filter(options, path, &mut stage)
}

/// Where the beams of a scan are in time.
#[derive(Clone, Copy, Debug)]
struct Beam {
    index_to_first_s: f64,
    aperture_start_rad: f64,
}

/// A record with a device's time and its arrival.
trait Timed: StreamRecord {
    /// The device's time that the stamp stands for, ns, and what the stamp is after it, s.
    fn taken(&self, beam: Beam) -> Option<(i64, f64)>;
    /// The device's time at which the record was sent and the host's at which it had arrived, ns.
    fn sent(&self) -> Option<(i64, i64)>;
    fn set_stamp(&mut self, stamp: Stamp);
}

impl Timed for Scan {
    fn taken(&self, beam: Beam) -> Option<(i64, f64)> {
        let cut_rad = self.angle_min_rad - beam.aperture_start_rad;
        let cut_s = cut_rad / self.angle_increment_rad * self.time_increment_s;
        let cut_s = if cut_rad > 1e-6 && cut_s.is_finite() {
            cut_s
        } else {
            0.0
        };
        Some((self.device?.ns(), beam.index_to_first_s + cut_s))
    }

    fn sent(&self) -> Option<(i64, i64)> {
        let info = self.info.as_ref();
        let transmit = info.and_then(|info| info.transmit).or(self.device)?;
        Some((transmit.ns(), self.received?.ns()))
    }

    fn set_stamp(&mut self, stamp: Stamp) {
        self.stamp = stamp;
    }
}

impl Timed for ImuSample {
    fn taken(&self, _: Beam) -> Option<(i64, f64)> {
        Some((self.device?.ns(), 0.0))
    }

    fn sent(&self) -> Option<(i64, i64)> {
        Some((self.device?.ns(), self.received?.ns()))
    }

    fn set_stamp(&mut self, stamp: Stamp) {
        self.stamp = stamp;
    }
}

enum Map {
    Causal(Box<OneWayHull>),
    Smooth(Smooth),
}

struct Tracker<R> {
    beam: Beam,
    map: Map,
    /// The newest time of sending.
    newest: Option<i64>,
    records: u64,
    unmapped: u64,
    quiet: bool,
    kind: std::marker::PhantomData<fn(R)>,
}

/// A device's time further back than this is a restart, ns.
const RESTART_NS: i64 = 10_000_000_000;

/// Whether a device that sent at `newest` has restarted when it sends at `sent`.
fn restarted(newest: Option<i64>, sent: i64) -> bool {
    newest.is_some_and(|newest| sent < newest.saturating_sub(RESTART_NS))
}

impl<R: Timed> Stage for Tracker<R> {
    type In = R;
    type Out = R;

    fn push(&mut self, record: &R, emit: &mut Emit<'_, R>) -> anyhow::Result<()> {
        self.records += 1;
        let times = record.taken(self.beam).zip(record.sent());
        let Some(((device_ns, after_s), (sent_ns, received_ns))) = times else {
            self.unmapped += 1;
            return emit.write(record);
        };
        let restart = restarted(self.newest, sent_ns);
        self.newest = Some(match self.newest {
            Some(newest) if !restart => newest.max(sent_ns),
            _ => sent_ns,
        });
        let mut step_ns = None;
        let host_ns = match &mut self.map {
            Map::Causal(hull) => {
                if restart {
                    hull.restart();
                }
                let mapped = hull.push(sent_ns, received_ns);
                step_ns = mapped.step_ns;
                // What lies between measurement and sending is the device's own time.
                let between_ns = sent_ns.saturating_sub(device_ns) as f64;
                let slower = hull.rate().unwrap_or(0.0) * 1e-9;
                mapped
                    .host_ns
                    .saturating_sub((between_ns * (1.0 + slower)).round() as i64)
            }
            Map::Smooth(smooth) => {
                if restart {
                    smooth.next_session();
                }
                smooth.host_ns(sent_ns, device_ns)
            }
        };
        if !self.quiet && restart {
            eprintln!(
                "{TOOL}: record {}: the device restarted; a new line begins",
                self.records
            );
        } else if let Some(step_ns) = step_ns.filter(|_| !self.quiet) {
            eprintln!(
                "{TOOL}: record {}: a clock was set ({:+.3} s, host minus device); a new line begins",
                self.records,
                step_ns as f64 * 1e-9
            );
        }
        let mut record = record.clone();
        record.set_stamp(Stamp::from_ns(host_ns).plus_s(after_s));
        emit.write(&record)
    }

    fn finish(&mut self, _: &mut Emit<'_, R>) -> anyhow::Result<Outcome> {
        if self.unmapped == 0 {
            return Ok(Outcome::Done);
        }
        if self.unmapped == self.records {
            let what = "no record has device_ns and received_ns: there is nothing to map";
            return Err(Fault::BadData(what.into()).into());
        }
        eprintln!(
            "{TOOL}: {} of {} records have no device_ns or no received_ns and keep their stamps",
            self.unmapped, self.records
        );
        Ok(Outcome::Degraded)
    }
}

/// The lines through a whole file, one for each time that the device was started.
struct Smooth {
    sessions: std::collections::VecDeque<ClockFit>,
}

impl Smooth {
    /// Reads the file for the first time.
    fn of<R: Timed>(path: Option<&Path>, options: &Options) -> anyhow::Result<Smooth> {
        let regular = |path: &Path| std::fs::metadata(path).is_ok_and(|found| found.is_file());
        let Some(path) = path.filter(|path| regular(path) || !path.exists()) else {
            let what = "--smooth reads its input twice: give a file, not a stream";
            return Err(Fault::Usage(what.into()).into());
        };
        let first_pass = Options {
            quiet: true,
            ..options.clone()
        };
        let mut input: Input<R> = Input::open(Some(path), &first_pass)?;
        let mut sessions: Vec<Vec<Exchange>> = vec![Vec::new()];
        let mut newest = None;
        while let Some(record) = input.next()? {
            let Some((sent_ns, received_ns)) = record.sent() else {
                continue;
            };
            if restarted(newest, sent_ns) {
                sessions.push(Vec::new());
                newest = None;
            }
            newest = Some(newest.map_or(sent_ns, |newest: i64| newest.max(sent_ns)));
            if let Some(session) = sessions.last_mut() {
                session.push(Exchange {
                    send_ns: received_ns,
                    device_ns: sent_ns,
                    receive_ns: received_ns,
                });
            }
        }
        let settings = FitSettings {
            method: Method::OneWay,
            resamples: 100,
            ..FitSettings::default()
        };
        let fits = sessions.iter_mut().map(|session| {
            session.sort_by_key(|exchange| exchange.device_ns);
            fit(session, &settings).map_err(|error| Fault::BadData(error.to_string()))
        });
        Ok(Smooth {
            sessions: fits.collect::<Result<_, _>>()?,
        })
    }

    fn next_session(&mut self) {
        if self.sessions.len() > 1 {
            self.sessions.pop_front();
        }
    }

    /// The host's time of `device_ns`, by the piece in which the record was sent.
    fn host_ns(&self, sent_ns: i64, device_ns: i64) -> i64 {
        let Some(fit) = self.sessions.front() else {
            return device_ns;
        };
        let sent_host_ns = fit.line.host_ns(sent_ns);
        let piece = fit
            .pieces
            .iter()
            .find(|piece| piece.to_host_ns >= sent_host_ns);
        let line = piece
            .or(fit.pieces.last())
            .map_or(fit.line, |piece| piece.line);
        line.host_ns(device_ns)
    }
}
