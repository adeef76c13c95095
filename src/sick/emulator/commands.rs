//! Every request and its answer.

use super::values::{Refusal, Reply, Request, Value};
use super::{Emulator, Source, State};
use crate::link::emulation::{LineId, Outbox, nanoseconds};
use crate::sick::cola::{self, Dialect, Telegram};
use crate::sick::emulator::configuration::APERTURE;
use crate::sick::scandata::Calendar;

/// The level that may write and start and stop.
const AUTHORISED: i32 = 3;

/// What becomes of a request.
enum Answer {
    /// Values after the verb and the name.
    Values(Vec<Value>),
    /// The answer is a scan, or will be.
    Scan,
}

/// An answer of one byte.
fn status(value: u8) -> Answer {
    Answer::Values(vec![Value::byte(value)])
}

impl<S: Source> Emulator<S> {
    /// Answers one request.
    pub(super) fn answer(
        &mut self,
        line: LineId,
        telegram: &Telegram,
        now_ns: i64,
        out: &mut Outbox,
    ) {
        let Some(client) = self.clients.get(&line) else {
            return;
        };
        let mut dialect = telegram.dialect;
        self.tally.requests += 1;
        let result = match (client.only, dialect) {
            (Some(Dialect::Binary), Dialect::Text) => return,
            (Some(Dialect::Text), Dialect::Binary) => {
                dialect = Dialect::Text;
                Err(Refusal::TextCharacter)
            }
            _ => self.execute(line, telegram, now_ns, out),
        };
        let name = String::from_utf8_lossy(telegram.name());
        let answer = match telegram.verb() {
            b"sRN" => "sRA",
            b"sWN" => "sWA",
            b"sMN" => "sAN",
            _ => "sEA",
        };
        let reply = match &result {
            Ok(Answer::Scan) => return,
            Ok(Answer::Values(values)) => {
                Reply::new(dialect, &format!("{answer} {name}")).values(values)
            }
            Err(refusal) => {
                self.tally.refused += 1;
                Reply::refusal(dialect, *refusal)
            }
        };
        send(line, dialect, &reply, out);
        match (telegram.verb(), telegram.name(), &result) {
            (b"sEN", name, Ok(_)) => self.first_events(line, name, out),
            (b"sMN", b"mSCreboot", Ok(_)) => out.restart(self.behaviour.reboot),
            _ => {}
        }
    }

    fn execute(
        &mut self,
        line: LineId,
        telegram: &Telegram,
        now_ns: i64,
        out: &mut Outbox,
    ) -> Result<Answer, Refusal> {
        let mut request = Request::new(telegram.dialect, telegram.arguments());
        let name = str::from_utf8(telegram.name()).map_err(|_| Refusal::UnknownCommand)?;
        match telegram.verb() {
            b"sRN" if name == "LMDscandata" => {
                let answered = self.answer_poll(line, telegram.dialect, now_ns, out);
                answered.then_some(Answer::Scan).ok_or(Refusal::Condition)
            }
            b"sRN" => self.read(name, now_ns).map(Answer::Values),
            b"sWN" => self.write(line, name, &mut request),
            b"sMN" => self.call(line, name, &mut request, now_ns),
            b"sEN" => self.subscribe(line, name, telegram.dialect, &mut request, now_ns),
            _ => Err(Refusal::UnknownCommand),
        }
    }

    fn level(&self, line: LineId) -> i32 {
        self.clients.get(&line).map_or(0, |client| client.level)
    }

    fn read(&self, name: &str, now_ns: i64) -> Result<Vec<Value>, Refusal> {
        let identity = &self.behaviour.identity;
        let text = |text: &str| vec![Value::Text(text.to_owned())];
        if let Some(values) = self.written.read(name) {
            return Ok(values);
        }
        Ok(match name {
            "DeviceIdent" => {
                let [device, version] = &identity.ident;
                vec![Value::Text(device.clone()), Value::Text(version.clone())]
            }
            "FirmwareVersion" => text(&identity.firmware),
            "SerialNumber" => text(&format!("{:08}", identity.serial)),
            "DItype" => text(identity.ident.first().map_or("", |ident| ident.trim())),
            "DIornr" => text(&identity.order_number),
            "ODoprh" => {
                let since = self.clock.counter_ns(now_ns) / 360_000_000_000;
                vec![Value::Unsigned(
                    4,
                    identity.operating_tenths_h + since as u32,
                )]
            }
            "ODpwrc" => vec![Value::Unsigned(4, identity.power_ons)],
            "OPcurtmpdev" => vec![Value::Real(31.5)],
            "LCMstate" => vec![Value::byte(0)],
            "SCdevicestate" => vec![Value::byte(self.device_state())],
            "STlms" => self.status(now_ns),
            "LMPscancfg" => self.scan_configuration(),
            "TSCTCmaxoffset" => vec![Value::Real(self.max_offset_s)],
            "TSCTCdelay" => vec![Value::Real(0.0)],
            "LIDoutputstate" => self.outputs(),
            "LIDinputstate" => self.inputs(),
            // No evaluation field is defined.
            _ if is_field(name) => vec![Value::byte(0)],
            _ => return Err(Refusal::UnknownVariable),
        })
    }

    /// 0 busy or logged in, 1 ready, 3 standby.
    fn device_state(&self) -> u8 {
        let logged_in = self.clients.values().any(|client| client.level > 0);
        match self.state {
            _ if logged_in => 0,
            State::Boot(_) | State::Settle(_) => 0,
            State::Measuring | State::Stopped => 1,
            State::Standby => 3,
        }
    }

    /// `STlms`: state, temperature, time and date, three LEDs and three that are reserved.
    fn status(&self, now_ns: i64) -> Vec<Value> {
        let state = match self.state {
            State::Boot(until_ns) if until_ns - now_ns > 1_000_000_000 => 1,
            State::Boot(_) | State::Settle(_) => 5,
            State::Stopped | State::Standby => 6,
            State::Measuring => 7,
        };
        let now = self.clock.calendar(now_ns);
        let time = format!("{:02}:{:02}:{:02}", now.hour, now.minute, now.second);
        let date = format!("{:02}.{:02}.{:04}", now.day, now.month, now.year);
        let mut values = vec![
            Value::Unsigned(2, state),
            Value::byte(0),
            Value::Text(time),
            Value::Text(date),
        ];
        values.extend([0; 6].map(|led| Value::Unsigned(2, led)));
        values
    }

    fn scan_configuration(&self) -> Vec<Value> {
        let [from, to] = APERTURE;
        vec![
            Value::Unsigned(4, self.written.frequency_raw()),
            Value::Signed(2, 1),
            Value::Unsigned(4, self.written.resolution_raw()),
            Value::Signed(4, from),
            Value::Signed(4, to),
        ]
    }

    /// The device's six outputs, all low, and eight of an external module that is not there.
    fn outputs(&self) -> Vec<Value> {
        let mut values = self.changed().to_vec();
        for output in 0..14 {
            values.push(Value::byte(if output < 6 { 0 } else { 2 }));
            values.push(Value::Unsigned(4, 0));
        }
        values.extend(self.time_block());
        values
    }

    /// The device's four inputs, all low.
    fn inputs(&self) -> Vec<Value> {
        let mut values = self.changed().to_vec();
        values.extend([0; 4].map(Value::byte));
        values.extend(self.time_block());
        values
    }

    /// Version and counter. A recorded unit gives the counter of the last change, here power-on.
    fn changed(&self) -> [Value; 2] {
        [Value::Unsigned(2, 0), Value::Unsigned(4, 0)]
    }

    /// The calendar of the last change.
    fn time_block(&self) -> [Value; 8] {
        let then = self.powered_on;
        [
            Value::Unsigned(2, 1),
            Value::Unsigned(2, then.year.into()),
            Value::byte(then.month),
            Value::byte(then.day),
            Value::byte(then.hour),
            Value::byte(then.minute),
            Value::byte(then.second),
            Value::Unsigned(4, then.microsecond),
        ]
    }

    fn write(
        &mut self,
        line: LineId,
        name: &str,
        request: &mut Request,
    ) -> Result<Answer, Refusal> {
        if self.written.read(name).is_none() {
            let readable = self.read(name, 0).is_ok();
            return Err(if readable {
                Refusal::WriteAccess
            } else {
                Refusal::UnknownVariable
            });
        }
        if self.level(line) < AUTHORISED {
            return Err(Refusal::WriteAccess);
        }
        // Recorded units refuse an output range while they start.
        if name == "LMPoutputRange" && matches!(self.state, State::Boot(_)) {
            return Err(Refusal::Condition);
        }
        self.written.write(name, request)?;
        Ok(Answer::Values(Vec::new()))
    }

    fn call(
        &mut self,
        line: LineId,
        name: &str,
        request: &mut Request,
        now_ns: i64,
    ) -> Result<Answer, Refusal> {
        // What anybody may ask for.
        match name {
            "SetAccessMode" => {
                let (level, hash) = level_and_hash(request)?;
                let granted = self.written.is_password(level, hash);
                if let Some(client) = self.clients.get_mut(&line) {
                    client.level = if granted { level } else { 0 };
                }
                return Ok(status(granted.into()));
            }
            "Run" => {
                request.end()?;
                if let Some(client) = self.clients.get_mut(&line) {
                    client.level = 0;
                }
                self.activate(now_ns);
                return Ok(status(1));
            }
            "CheckPassword" => {
                let (level, hash) = level_and_hash(request)?;
                return Ok(status(self.written.is_password(level, hash).into()));
            }
            _ => {}
        }
        let known = [
            "SetPassword",
            "mLMPsetscancfg",
            "mCLsetscancfglist",
            "LMCstartmeas",
            "LMCstopmeas",
            "LMCstandby",
            "LSPsetdatetime",
            "mEEwriteall",
            "mSCreboot",
            "mSCloadfacdef",
            "mSCloadappdef",
            "mResetMaxOff",
        ];
        if !known.contains(&name) {
            return Err(Refusal::UnknownMethod);
        }
        if self.level(line) < AUTHORISED {
            return Err(Refusal::UserLevel);
        }
        match name {
            "SetPassword" => {
                let (level, hash) = level_and_hash(request)?;
                Ok(status(self.written.set_password(level, hash).into()))
            }
            "mLMPsetscancfg" => self.set_scan_configuration(request),
            "mCLsetscancfglist" => {
                let number = request.unsigned(1)?;
                request.end()?;
                let mut wanted = self.written.clone();
                let fits = wanted.set_mode_number(number) && self.may_scan_in(wanted.mode);
                if fits {
                    self.written.mode = wanted.mode;
                }
                Ok(status(if fits { 0 } else { 1 }))
            }
            "LMCstartmeas" | "LMCstopmeas" | "LMCstandby" => {
                request.end()?;
                Ok(status(self.set_state(name, now_ns)))
            }
            "LSPsetdatetime" => self.set_clock(request, now_ns),
            _ => {
                request.end()?;
                match name {
                    "mEEwriteall" => self.saved = self.written.clone(),
                    "mSCreboot" => {
                        self.saved = self.written.clone();
                        return Ok(Answer::Values(Vec::new()));
                    }
                    "mResetMaxOff" => {
                        self.max_offset_s = 0.0;
                        return Ok(Answer::Values(Vec::new()));
                    }
                    _ => self.written = self.factory.clone(),
                }
                Ok(status(1))
            }
        }
    }

    fn may_scan_in(&self, mode: crate::frame::ScanMode) -> bool {
        self.source.fixed_mode().is_none_or(|fixed| fixed == mode)
    }

    fn set_scan_configuration(&mut self, request: &mut Request) -> Result<Answer, Refusal> {
        let frequency = request.unsigned(4)?;
        let sectors = request.signed(2)?;
        let resolution = request.unsigned(4)?;
        let (from, to) = (request.signed(4)?, request.signed(4)?);
        request.end()?;
        let mut wanted = self.written.clone();
        let code = match wanted.set_mode(frequency, resolution) {
            Err(code) => code,
            Ok(()) if from >= to => 4,
            Ok(()) if sectors != 1 || !self.may_scan_in(wanted.mode) => 5,
            Ok(()) => {
                self.written.mode = wanted.mode;
                // LMS511: an output range that no Run has made active yet is lost.
                self.written.restore("LMPoutputRange", &self.active);
                0
            }
        };
        let mut values = vec![Value::byte(code)];
        values.extend(self.scan_configuration());
        Ok(Answer::Values(values))
    }

    /// Starts and stops; 0 done, 1 not allowed.
    fn set_state(&mut self, method: &str, now_ns: i64) -> u8 {
        match (method, self.state) {
            (_, State::Boot(_)) => return 1,
            ("LMCstartmeas", State::Stopped) => self.resume(now_ns),
            ("LMCstartmeas", State::Standby) => {
                self.state = State::Settle(now_ns + nanoseconds(self.behaviour.settle));
            }
            ("LMCstopmeas", _) => self.state = State::Stopped,
            ("LMCstandby", _) => self.state = State::Standby,
            _ => {}
        }
        if !matches!(self.state, State::Measuring) {
            self.next = None;
        }
        0
    }

    fn set_clock(&mut self, request: &mut Request, now_ns: i64) -> Result<Answer, Refusal> {
        let mut byte = [0u8; 5];
        let year = request.unsigned(2)? as u16;
        for value in &mut byte {
            *value = request.unsigned(1)? as u8;
        }
        let microsecond = request.unsigned(4)?;
        request.end()?;
        let [month, day, hour, minute, second] = byte;
        let calendar = Calendar {
            year,
            month,
            day,
            hour,
            minute,
            second,
            microsecond,
        };
        let stamp = calendar.stamp().ok_or(Refusal::Condition)?;
        // While it follows a time server nobody else sets the clock.
        let follows = self.written.number("TSCRole", 0) == 1;
        if !follows {
            self.clock.set(now_ns, stamp.ns());
        }
        Ok(status((!follows).into()))
    }

    fn subscribe(
        &mut self,
        line: LineId,
        name: &str,
        dialect: Dialect,
        request: &mut Request,
        now_ns: i64,
    ) -> Result<Answer, Refusal> {
        let on = request.unsigned(1)?;
        request.end()?;
        if on > 1 {
            return Err(Refusal::Condition);
        }
        let Some(client) = self.clients.get_mut(&line) else {
            return Err(Refusal::UnknownEvent);
        };
        let subscriptions = &mut client.subscriptions;
        let place = match name {
            "LMDscandata" => &mut subscriptions.scans,
            "LIDoutputstate" => &mut subscriptions.outputs,
            "LIDinputstate" => &mut subscriptions.inputs,
            "LFErec" => &mut subscriptions.fields,
            "SCParmChngd" => &mut subscriptions.parameters,
            "LCMstate" => &mut subscriptions.contamination,
            _ => return Err(Refusal::UnknownEvent),
        };
        *place = (on == 1).then_some(dialect);
        if name == "LMDscandata" && on == 1 {
            self.begin(now_ns, true);
        }
        Ok(status(on as u8))
    }

    /// What a subscription brings at once: the outputs' state, twice (recorded on an LMS511).
    fn first_events(&mut self, line: LineId, name: &[u8], out: &mut Outbox) {
        let subscriptions = self.clients.get(&line).map(|client| client.subscriptions);
        let dialect = subscriptions.and_then(|s| s.outputs);
        if let (b"LIDoutputstate", Some(dialect)) = (name, dialect) {
            let event = Reply::new(dialect, "sSN LIDoutputstate").values(&self.outputs());
            send(line, dialect, &event, out);
            send(line, dialect, &event, out);
        }
    }
}

fn send(line: LineId, dialect: Dialect, reply: &Reply, out: &mut Outbox) {
    let mut framed = Vec::new();
    cola::frame(dialect, reply.body(), &mut framed);
    out.reply(line, &framed);
}

fn level_and_hash(request: &mut Request) -> Result<(i32, u32), Refusal> {
    let level = request.signed(1)?;
    let hash = request.unsigned(4)?;
    request.end()?;
    Ok((level, hash))
}

/// `field000` to `field029`: an evaluation field's definition.
fn is_field(name: &str) -> bool {
    let number = name
        .strip_prefix("field")
        .filter(|digits| digits.len() == 3);
    number
        .and_then(|digits| digits.parse::<u8>().ok())
        .is_some_and(|number| number < 30)
}
