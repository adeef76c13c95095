//! Setting a scanner: in the order that works, read back, and only where it is not set already.
//!
//! Order: log in, what telegrams hold and the filters, the output range with `Run` and another login
//! (an LMS511 takes it over only so), frequency and resolution, `mEEwriteall` where asked for, `Run`.
//! Parameters become active with `Run`, which logs out. Sources: telegram listing 8014631 and the
//! experience of the users of SICK's driver.

use super::commands::{
    self, EchoFilter, MeanFilter, OutputRange, ParticleFilter, ScanConfiguration, ScanContents,
};
use super::error::ClientError;
use super::modes::Mode;
use super::request::Request;
use super::session::Client;
use std::fmt::Display;
use std::time::{Duration, Instant};

/// A scanner whose frequency changes may say nothing for so long; the listing says 30 s.
const FREQUENCY_CHANGE: Duration = Duration::from_secs(35);
/// Some firmware refuses the output range at first after power-on.
const RANGE_ATTEMPTS: usize = 6;
/// Between two of these attempts.
const RANGE_PAUSE: Duration = Duration::from_millis(500);
/// The aperture of an LMS5xx, 1e-4 deg.
pub const APERTURE: [i32; 2] = [-50_000, 1_850_000];

/// What is to be set; none stays as the device has it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Wanted {
    /// Frequency and resolution.
    pub mode: Option<Mode>,
    /// First and last angle that are sent, 1e-4 deg.
    pub range: Option<[i32; 2]>,
    /// Which echoes are sent.
    pub echoes: Option<EchoFilter>,
    /// Whether remissions are sent.
    pub remission: Option<bool>,
    /// Whether the calendar time is sent.
    pub time: Option<bool>,
    /// Whether encoder values are sent.
    pub encoder: Option<bool>,
    /// Every how many scans one is sent.
    pub every: Option<u16>,
    /// Scans to a mean; 1 switches the filter off.
    pub mean: Option<u16>,
    /// Whether the particle filter is on.
    pub particle: Option<bool>,
    /// Whether the measurement is to be started.
    pub start: bool,
    /// Whether all parameters are to be kept over power-off.
    pub save: bool,
}

/// A device that is not set as it should be.
#[derive(Debug, thiserror::Error)]
pub enum ConfigureError {
    /// A request failed.
    #[error(transparent)]
    Client(#[from] ClientError),
    /// What was set reads back otherwise.
    #[error("set, but it reads back otherwise: {0}. This firmware or device cannot do it")]
    ReadBack(String),
}

/// How the device is set, as far as it can be read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Present {
    /// Frequency, resolution, aperture.
    pub scan: Option<ScanConfiguration>,
    /// What is sent of it.
    pub range: Option<OutputRange>,
    /// What telegrams hold.
    pub contents: Option<ScanContents>,
    /// Echoes.
    pub echoes: Option<EchoFilter>,
    /// Mean filter.
    pub mean: Option<MeanFilter>,
    /// Particle filter.
    pub particle: Option<ParticleFilter>,
}

impl Present {
    /// Asks the device; what its firmware does not know, or answers strangely, stays none.
    pub fn read(client: &mut Client) -> Result<Present, ClientError> {
        let echoes = client.ask_if_known(&EchoFilter::request(), EchoFilter::parse)?;
        Ok(Present {
            scan: client.ask_if_known(&ScanConfiguration::request(), ScanConfiguration::parse)?,
            range: client.ask_if_known(&OutputRange::request(), OutputRange::parse)?,
            contents: client.ask_if_known(&ScanContents::request(), ScanContents::parse)?,
            echoes: echoes.flatten(),
            mean: client.ask_if_known(&MeanFilter::request(), MeanFilter::parse)?,
            particle: client.ask_if_known(&ParticleFilter::request(), ParticleFilter::parse)?,
        })
    }

    /// From telegram to telegram, s; none where the frequency is not known.
    pub fn interval_s(&self) -> Option<f64> {
        let frequency = self.scan.map(|scan| scan.frequency).filter(|hz| *hz > 0)?;
        let every = self.contents.map_or(1, |contents| contents.every.max(1));
        let mean = self.mean.map_or(1, |mean| mean.divisor());
        Some(100.0 / f64::from(frequency) * f64::from(every) * f64::from(mean))
    }
}

impl Wanted {
    /// What telegrams are to hold: `base` with what is wanted otherwise.
    fn contents(&self, base: ScanContents) -> ScanContents {
        ScanContents {
            remission: self.remission.unwrap_or(base.remission),
            time: self.time.unwrap_or(base.time),
            encoder: match self.encoder {
                Some(on) => [u8::from(on), 0],
                None => base.encoder,
            },
            every: self.every.unwrap_or(base.every),
            ..base
        }
    }

    fn touches_contents(&self) -> bool {
        self.remission.is_some()
            || self.time.is_some()
            || self.encoder.is_some()
            || self.every.is_some()
    }

    /// Where the device is not as wanted, in words.
    fn differences(&self, present: &Present) -> Vec<String> {
        let on_off = |on: bool| if on { "on" } else { "off" };
        let mut all = vec![
            difference(
                "frequency and resolution",
                self.mode,
                present.scan,
                |mode, scan| {
                    scan.frequency == mode.frequency
                        && scan.resolution.abs_diff(mode.resolution.into()) <= 1
                },
            ),
            difference(
                "the output range",
                self.range,
                present.range,
                |[from, to], range| {
                    // The device may move the ends to beams.
                    let step = present.scan.map_or(10_000, |scan| scan.resolution);
                    range.start.abs_diff(from) <= step && range.end.abs_diff(to) <= step
                },
            ),
            difference(
                "the echo filter",
                self.echoes,
                present.echoes,
                |wanted, is| wanted == is,
            ),
            difference("the mean filter", self.mean, present.mean, |scans, is| {
                is.divisor() == scans
            }),
        ];
        let contents = |value: fn(ScanContents) -> bool| present.contents.map(value).map(on_off);
        let particle = present.particle.map(|filter| on_off(filter.on));
        for (what, wanted, is) in [
            ("remission", self.remission, contents(|c| c.remission)),
            ("the time block", self.time, contents(|c| c.time)),
            ("encoder", self.encoder, contents(|c| c.encoder != [0, 0])),
            ("the particle filter", self.particle, particle),
        ] {
            let wanted = wanted.map(on_off);
            all.push(difference(what, wanted, is, |wanted, is| wanted == is));
        }
        let divider = present.contents.map(|contents| contents.every);
        all.push(difference(
            "the divider",
            self.every,
            divider,
            |wanted, is| wanted == is,
        ));
        all.into_iter().flatten().collect()
    }

    /// The requests, in their order, to a device that is set as `present`.
    pub fn requests(&self, present: &Present, hash: u32) -> Vec<Request> {
        let log_in = || commands::log_in(hash);
        let mut requests = vec![log_in()];
        if self.touches_contents() {
            let base = present.contents.unwrap_or(DELIVERED);
            requests.push(self.contents(base).set());
        }
        if let Some(echoes) = self.echoes {
            requests.push(echoes.set());
        }
        if let Some(mean) = self.mean {
            let filter = MeanFilter {
                on: mean > 1,
                scans: mean.max(2),
            };
            requests.push(filter.set());
        }
        if let Some(on) = self.particle {
            requests.push(ParticleFilter { on }.set());
        }
        let scan = match self.mode {
            Some(mode) => Some(ScanConfiguration {
                frequency: mode.frequency,
                resolution: mode.resolution.into(),
                start: APERTURE[0],
                end: APERTURE[1],
            }),
            None => present.scan,
        };
        if let Some([start, end]) = self.range {
            let resolution = scan.map_or(5000, |scan| scan.resolution);
            let range = OutputRange {
                resolution,
                start,
                end,
            };
            requests.extend([range.set(), commands::run(), log_in()]);
        }
        if (self.mode.is_some() || self.range.is_some())
            && let Some(scan) = scan
        {
            requests.push(scan.set());
        }
        if self.start {
            requests.push(commands::start_measurement());
        }
        if self.save {
            requests.push(commands::save());
        }
        requests.push(commands::run());
        requests
    }

    /// Sets the device where it is not as wanted, and reads everything back. `remark` is told what
    /// takes long; whether anything had to be set.
    ///
    /// # Errors
    /// A refused login or request, silence, or a value that reads back otherwise.
    pub fn apply(
        &self,
        client: &mut Client,
        hash: u32,
        measuring: bool,
        remark: &mut dyn FnMut(&str),
    ) -> Result<bool, ConfigureError> {
        let present = Present::read(client)?;
        let needs_start = self.start && !measuring;
        if self.differences(&present).is_empty() && !self.save && !needs_start {
            return Ok(false);
        }
        let changes_frequency = self.mode.is_some_and(|mode| {
            let is = present.scan.map(|scan| scan.frequency);
            is != Some(mode.frequency)
        });
        client.log_in(hash)?;
        let answer = client.patience();
        if changes_frequency {
            client.set_patience(FREQUENCY_CHANGE);
        }
        let sent = self.send_all(client, &present, hash, changes_frequency, remark);
        if sent.is_err() {
            // Logged in, the device is busy for everybody else; nothing may keep it so.
            client.set_interrupted(None);
            client.set_patience(answer);
            let _ = client.run();
        }
        sent?;
        let now = Present::read(client)?;
        client.set_patience(answer);
        let differences = self.differences(&now);
        if differences.is_empty() {
            Ok(true)
        } else {
            Err(ConfigureError::ReadBack(differences.join("; ")))
        }
    }

    fn send_all(
        &self,
        client: &mut Client,
        present: &Present,
        hash: u32,
        changes_frequency: bool,
        remark: &mut dyn FnMut(&str),
    ) -> Result<(), ConfigureError> {
        // The first of them is the login, which is done.
        for request in self.requests(present, hash).iter().skip(1) {
            match request.name() {
                "SetAccessMode" => client.log_in(hash)?,
                "Run" => client.run()?,
                "LMPoutputRange" => set_range(client, request)?,
                "mLMPsetscancfg" => {
                    if changes_frequency {
                        remark("the frequency changes: the scanner may say nothing for up to 30 s");
                    }
                    set_scan(client, request)?;
                }
                "LMCstartmeas" => {
                    let refused = "the measurement cannot be started in this state";
                    client.call(request, 0, refused)?;
                }
                "mEEwriteall" => {
                    client.call(request, 1, "the parameters were not saved")?;
                }
                _ => {
                    client.request(request)?;
                }
            }
        }
        Ok(())
    }
}

/// What is to be said where something that is wanted reads otherwise, or cannot be read.
fn difference<W, P: Display + Copy>(
    what: &str,
    wanted: Option<W>,
    present: Option<P>,
    same: impl FnOnce(W, P) -> bool,
) -> Option<String> {
    match (wanted, present) {
        (None, _) => None,
        (Some(_), None) => Some(format!("{what} cannot be read")),
        (Some(wanted), Some(is)) => (!same(wanted, is)).then(|| format!("{what} is {is}")),
    }
}

/// What an LMS5xx sends as delivered, for where it cannot be asked.
const DELIVERED: ScanContents = ScanContents {
    channels: [1, 0],
    remission: false,
    wide_remission: false,
    unit: 0,
    encoder: [0, 0],
    position: false,
    device_name: false,
    comment: false,
    time: false,
    every: 1,
};

fn set_range(client: &mut Client, request: &Request) -> Result<(), ClientError> {
    let mut attempt = 1;
    loop {
        match client.request(request) {
            Ok(_) => return Ok(()),
            Err(ClientError::Refused { refusal, .. })
                if refusal.0 == 4 && attempt < RANGE_ATTEMPTS => {}
            Err(error) => return Err(error),
        }
        attempt += 1;
        let until = Instant::now() + RANGE_PAUSE;
        while Instant::now() < until {
            client.wait(RANGE_PAUSE / 5)?;
        }
    }
}

fn set_scan(client: &mut Client, request: &Request) -> Result<(), ClientError> {
    let reply = client.request(request)?;
    let set = ScanConfiguration::parse_set(&reply);
    let (status, _) = set.map_err(|error| ClientError::answer(request, error))?;
    if status == 0 {
        return Ok(());
    }
    Err(ClientError::Failed {
        request: request.to_string(),
        status,
        meaning: format!(
            "{}; a Lite has 25, 50 and 75 Hz with 0.25, 0.5 and 1 deg only",
            ScanConfiguration::set_status(status)
        ),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn texts(wanted: &Wanted, present: &Present) -> Vec<String> {
        wanted
            .requests(present, 0xF472_4744)
            .iter()
            .map(ToString::to_string)
            .collect()
    }

    #[test]
    fn everything_in_the_order_that_an_lms511_takes() {
        let wanted = Wanted {
            mode: Some(Mode::find(50.0, 0.5).unwrap()),
            range: Some([0, 1_800_000]),
            echoes: Some(EchoFilter::All),
            remission: Some(true),
            time: Some(true),
            every: Some(2),
            mean: Some(4),
            particle: Some(false),
            save: true,
            ..Wanted::default()
        };
        assert_eq!(
            texts(&wanted, &Present::default()),
            [
                "sMN SetAccessMode 03 (hash of the password)",
                "sWN LMDscandatacfg 01 00 1 0 0 00 00 0 0 0 1 2",
                "sWN FREchoFilter 1",
                "sWN LFPmeanfilter 1 4 0",
                "sWN LFPparticle 0 1F4",
                "sWN LMPoutputRange +1 1388 +0 +1800000",
                "sMN Run",
                "sMN SetAccessMode 03 (hash of the password)",
                "sMN mLMPsetscancfg 1388 +1 1388 -50000 +1850000",
                "sMN mEEwriteall",
                "sMN Run",
            ]
        );
    }

    #[test]
    fn a_range_alone_is_followed_by_the_scan_as_it_is() {
        let wanted = Wanted {
            range: Some([0, 900_000]),
            ..Wanted::default()
        };
        let present = Present {
            scan: Some(ScanConfiguration {
                frequency: 2500,
                resolution: 1667,
                start: -50_000,
                end: 1_850_000,
            }),
            ..Present::default()
        };
        let texts = texts(&wanted, &present);
        assert_eq!(texts[1], "sWN LMPoutputRange +1 683 +0 +900000");
        assert_eq!(texts[4], "sMN mLMPsetscancfg 9C4 +1 683 -50000 +1850000");
    }

    #[test]
    fn differences_are_in_words() {
        let wanted = Wanted {
            mode: Some(Mode::find(50.0, 1.0 / 3.0).unwrap()),
            mean: Some(1),
            echoes: Some(EchoFilter::Last),
            ..Wanted::default()
        };
        let mut present = Present {
            scan: Some(ScanConfiguration {
                frequency: 2500,
                resolution: 5000,
                start: 0,
                end: 0,
            }),
            mean: Some(MeanFilter {
                on: false,
                scans: 2,
            }),
            ..Present::default()
        };
        assert_eq!(
            wanted.differences(&present),
            [
                "frequency and resolution is 25 Hz 0.5 deg",
                "the echo filter cannot be read"
            ]
        );
        let otherwise = Wanted {
            range: Some([0, 900_000]),
            echoes: Some(EchoFilter::All),
            remission: Some(true),
            time: Some(false),
            encoder: Some(true),
            every: Some(3),
            mean: Some(2),
            particle: Some(true),
            ..Wanted::default()
        };
        let as_delivered = Present {
            range: Some(OutputRange {
                resolution: 5000,
                start: -50_000,
                end: 1_850_000,
            }),
            contents: Some(ScanContents {
                time: true,
                ..DELIVERED
            }),
            echoes: Some(EchoFilter::Last),
            particle: Some(ParticleFilter { on: false }),
            ..present
        };
        assert_eq!(
            otherwise.differences(&as_delivered),
            [
                "the output range is -5 to 185 deg",
                "the echo filter is last",
                "the mean filter is off",
                "remission is off",
                "the time block is on",
                "encoder is off",
                "the particle filter is off",
                "the divider is 1",
            ]
        );
        present.echoes = Some(EchoFilter::Last);
        present.scan = present.scan.map(|scan| ScanConfiguration {
            frequency: 5000,
            resolution: 3334,
            ..scan
        });
        assert!(wanted.differences(&present).is_empty());
        assert_eq!(present.interval_s(), Some(0.02));
    }
}
