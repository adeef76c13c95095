//! `simulate --format cola`: the emulated scanner's telegrams as a byte stream.

use super::{Args, serve};
use crate::link::emulation::{Device, Message, Outbox};
use crate::link::faults::Damage;
use crate::link::{HostInstant, Pacing, Recorder, Rotation};
use crate::record::Stamp;
use crate::sick::cola::{Dialect, frame};
use crate::sick::emulator::{Behaviour, Emulator};
use crate::stream::{Fault, Outcome, Stop};
use std::io::{self, Write};
use std::time::Duration;

/// Where the telegrams go.
enum Sink {
    Stdout(io::BufWriter<io::Stdout>),
    /// A file with the times of arrival beside it.
    File(Box<Recorder>),
}

impl Sink {
    fn chunk(&mut self, bytes: &[u8], at: HostInstant, live: bool) -> anyhow::Result<()> {
        match self {
            Sink::Stdout(out) => {
                out.write_all(bytes)?;
                if live {
                    out.flush()?;
                }
            }
            Sink::File(recorder) => recorder
                .chunk(bytes, at)
                .map_err(|error| Fault::Io(error.to_string()))?,
        }
        Ok(())
    }

    fn finish(self) -> anyhow::Result<()> {
        match self {
            Sink::Stdout(mut out) => out.flush()?,
            Sink::File(recorder) => recorder
                .finish()
                .map_err(|error| Fault::Io(error.to_string()))?,
        }
        Ok(())
    }
}

/// Writes what a client that has asked for scans would receive, from the first scan to the last.
pub(super) fn run(args: &Args) -> anyhow::Result<Outcome> {
    let mut options = args.common.options("simulate")?;
    options.seed = Some(args.seed);
    let serve = &args.serve;
    if !serve.faults.timed.is_empty() || serve.faults.chunk.is_some() {
        let text = "--faults at set times and chunks need clients; --format cola has none";
        return Err(Fault::Usage(text.into()).into());
    }
    let (view, model, mode) = serve::view(args, &mut options, None)?;
    let epoch = view.epoch().unwrap_or(Stamp::from_ns(0));
    let behaviour = Behaviour {
        linger: Duration::ZERO,
        boot: Duration::ZERO,
        ..serve::behaviour(serve, model, mode, epoch)
    };
    let stop = Stop::install()?;
    let mut sink = match &args.common.output {
        None => Sink::Stdout(io::BufWriter::new(io::stdout())),
        Some(path) => {
            let recorder = Recorder::create(path, Rotation::default());
            let recorder = recorder.map_err(|error| Fault::Io(error.to_string()))?;
            Sink::File(Box::new(recorder))
        }
    };
    let mut device = Emulator::new(behaviour, view);
    let mut damage = Damage::new(&serve.faults, args.seed, 0);
    let mut out = Outbox::default();
    let pacing = Pacing::new(args.real_time.then_some(1.0));
    let (dialect, request): (_, &[u8]) = match serve.dialect.as_str() {
        "a" => (Dialect::Text, b"sEN LMDscandata 1"),
        _ => (Dialect::Binary, b"sEN LMDscandata \x01"),
    };
    let mut start = Vec::new();
    frame(dialect, request, &mut start);
    device.connected(0, 0, 0);
    device.input(0, &start, 0, &mut out);
    let mut piece = Vec::new();
    let mut scans = 0;
    while !device.ended() && !stop.requested() {
        device.prepare();
        let Some(due_ns) = device.due_ns() else {
            break;
        };
        let now_ns = due_ns.max(0);
        if !pacing.wait(now_ns as f64 * 1e-9, || stop.requested()) {
            break;
        }
        device.advance(now_ns, &mut out);
        let at = HostInstant {
            utc: epoch + now_ns,
            raw_ns: now_ns,
        };
        for (_, what, bytes) in out.take() {
            piece.clear();
            if what == Message::Reply {
                piece.extend_from_slice(&bytes);
            } else {
                damage.message(&bytes, &mut piece);
                scans += 1;
            }
            if !piece.is_empty() {
                sink.chunk(&piece, at, args.real_time)?;
            }
        }
    }
    sink.finish()?;
    if options.verbose > 0 {
        eprintln!("simulate: {scans} scans: {}", damage.losses());
    }
    device.into_source().finish()?;
    stop.check(scans)?;
    Ok(Outcome::Done)
}
