//! The live capture of a Hokuyo.

use super::args::LiveArgs;
use super::line::{FAREWELL, Line, patience};
use super::live::{Heard, LineFault, Scanner};
use crate::hokuyo::BAUD;
use crate::hokuyo::client::{self, Client, ClientError, Incoming};
use crate::hokuyo::scans::{self, Scans};
use crate::hokuyo::scip::{self, Measurement, Parameters};
use crate::record::Scan;
use std::collections::BTreeMap;
use std::time::{Duration, Instant};

/// How long the first scan may take: the motor may have to start.
const FIRST_SCAN: Duration = Duration::from_secs(5);

/// What is kept of the device between connections.
pub(super) struct Hokuyo {
    line: Line,
    baud: u32,
    client: Option<Client>,
    /// Whether the device may be measuring though nobody is connected.
    left_on: bool,
    settings: scans::Settings,
    parameters: Parameters,
    scans: Option<Scans>,
    empty: Scan,
    measurement: Measurement,
    scan_end: u64,
    scans_on_line: u64,
    notes: BTreeMap<String, String>,
}

impl Hokuyo {
    pub(super) fn new(line: Line, args: &LiveArgs, settings: scans::Settings) -> Hokuyo {
        Hokuyo {
            line,
            baud: args.baud.unwrap_or(BAUD),
            client: None,
            left_on: false,
            settings,
            parameters: Parameters::default(),
            scans: None,
            empty: Scan::default(),
            measurement: Measurement::default(),
            scan_end: 0,
            scans_on_line: 0,
            notes: BTreeMap::new(),
        }
    }

    fn connect(&self) -> Result<Client, ClientError> {
        let settings = client::Settings {
            baud: self.baud,
            connect: self.line.connect_limit(),
            answer: self.line.answer_limit(),
        };
        let (tap, interrupted) = (self.line.tap(), self.line.interrupted());
        Client::connect(self.line.place(), &settings, Some(tap), Some(interrupted))
    }

    /// Asks who the device is; what it does not know is left out.
    fn ask_notes(&mut self, client: &mut Client) -> Result<(), ClientError> {
        self.notes.insert("place".into(), client.place().to_owned());
        self.notes
            .insert("device".into(), self.parameters.model.clone());
        for request in ["VV", "II"] {
            let fields = match client.fields(request) {
                Err(ClientError::Answer { .. } | ClientError::Refused { .. }) => continue,
                other => other?,
            };
            for (key, value) in fields {
                let key = match key.as_str() {
                    "FIRM" => "firmware",
                    "SERI" => "serial number",
                    "PROT" => "protocol",
                    "STAT" => "state",
                    _ => continue,
                };
                self.notes.insert(key.into(), value);
            }
        }
        if let Some(state) = self.notes.get("state")
            && !state.to_ascii_lowercase().contains("well")
        {
            let text = format!("the scanner says of its state: {state}");
            self.line.remark(&text);
        }
        Ok(())
    }

    /// Asks for the device's time, so that the way from a stamp to its arrival is known.
    fn ask_time(&mut self, client: &mut Client) -> Result<(), ClientError> {
        let readings = match client.read_time() {
            Ok(readings) => readings,
            Err(error @ (ClientError::Refused { .. } | ClientError::Answer { .. })) => {
                let text = format!("{error}; stamps are taken for a sweep before arrival");
                self.line.remark(&text);
                return Ok(());
            }
            Err(error) => return Err(error),
        };
        let offset = self
            .scans
            .as_mut()
            .and_then(|scans| scans.set_time(&readings));
        match offset {
            Some(offset) => {
                let bound_ms = format!("{:.3}", offset.bound_ns as f64 * 1e-6);
                self.notes.insert("clock known to, ms".into(), bound_ms);
            }
            None => self.line.remark(
                "its answers to TM1 contradict each other; stamps are taken for a sweep before \
                 arrival",
            ),
        }
        Ok(())
    }
}

impl Scanner for Hokuyo {
    fn start(&mut self, _deadline: Instant) -> Result<(), LineFault> {
        self.scans_on_line = 0;
        let mut client = self.connect().map_err(fault)?;
        let first = self.line.note_answer()?;
        let parameters = client.parameters().map_err(fault)?;
        if self.scans.is_none() || parameters != self.parameters {
            self.parameters = parameters.clone();
            self.scans = Some(Scans::new(parameters, self.settings));
        }
        if first {
            self.ask_notes(&mut client).map_err(fault)?;
        }
        self.ask_time(&mut client).map_err(fault)?;
        self.left_on = true;
        client.start(&self.parameters).map_err(fault)?;
        self.client = Some(client);
        Ok(())
    }

    fn wait(&mut self, timeout: Duration) -> Result<(), LineFault> {
        match &mut self.client {
            None => Err(LineFault::Down("no connection".to_owned())),
            Some(client) => client.wait(timeout).map(|_| ()).map_err(fault),
        }
    }

    fn next(&mut self) -> Option<Heard> {
        let client = self.client.as_mut()?;
        let scans = self.scans.as_mut()?;
        loop {
            let (reply, at) = match client.next()? {
                Incoming::Skipped(skipped) => {
                    let text = format!("{} ({} bytes)", skipped.cause, skipped.bytes);
                    return Some(Heard::Fault(text));
                }
                Incoming::Reply { reply, at } => (reply, at),
            };
            if Measurement::is_one(&reply) {
                if let Err(error) = self.measurement.parse(&reply) {
                    let text = format!("a scan that makes no sense was skipped: {error}");
                    return Some(Heard::Fault(text));
                }
                let end = reply.last_offset();
                if scans.push(&self.measurement, Some(at)).is_some() {
                    self.scan_end = end;
                    self.scans_on_line += 1;
                    return Some(Heard::Scan);
                }
            } else if !matches!(&reply.status(), b"00" | b"99") {
                let echo = reply.echo();
                let words = scip::status_words(echo, reply.status());
                let status = reply.status().escape_ascii().to_string();
                let text = format!("{}: status {status}: {words}", echo.escape_ascii());
                return Some(Heard::Fault(text));
            }
        }
    }

    fn scan(&self) -> &Scan {
        self.scans.as_ref().map_or(&self.empty, Scans::newest)
    }

    fn scan_end(&self) -> u64 {
        self.scan_end
    }

    fn patience(&self) -> Duration {
        if self.scans_on_line == 0 {
            return FIRST_SCAN;
        }
        patience(self.parameters.period_s())
    }

    fn has_answered(&self) -> bool {
        self.line.has_answered()
    }

    fn lost(&self) -> u64 {
        self.scans
            .as_ref()
            .map_or(0, |scans| scans.counts().missing)
    }

    fn restarts(&self) -> u64 {
        self.scans
            .as_ref()
            .map_or(0, |scans| scans.counts().restarts)
    }

    fn stop(&mut self) {
        // A device that was left behind an outage may still measure, its laser on.
        if self.client.is_none() && self.left_on {
            self.client = self.connect().ok();
        }
        if let Some(mut client) = self.client.take() {
            match client.stop(FAREWELL) {
                Ok(()) => self.left_on = false,
                Err(error) => self.line.remark(&format!("not stopped: {error}")),
            }
        } else if self.left_on {
            let text = "the line is down: the scanner may go on measuring, its laser on";
            self.line.remark(text);
        }
    }

    fn hang_up(&mut self) {
        self.client = None;
    }

    fn notes(&self) -> BTreeMap<String, String> {
        self.notes.clone()
    }

    fn summary(&self, verbose: u8) -> Vec<String> {
        let Some(scans) = &self.scans else {
            return Vec::new();
        };
        let counts = scans.counts();
        let mut lines = Vec::new();
        if counts.restarts > 0 {
            lines.push(format!("{} times the device restarted", counts.restarts));
        }
        if verbose > 0 {
            lines.push(format!("{} repeated scans dropped", counts.repeated));
        }
        lines
    }
}

/// Which faults another attempt may mend.
fn fault(error: ClientError) -> LineFault {
    match error {
        ClientError::Interrupted => LineFault::Ended,
        ClientError::Link(_) | ClientError::Silent { .. } | ClientError::Answer { .. } => {
            LineFault::Down(error.to_string())
        }
        ClientError::Refused { .. } => LineFault::Refused(error.to_string()),
    }
}
