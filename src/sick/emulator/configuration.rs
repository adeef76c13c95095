//! What can be set: variables with their types, ranges and factory values, the scan mode and the
//! passwords.

use super::values::{Kind, Refusal, Request, Value};
use crate::frame::{ScanMode, ScannerModel};
use crate::sick::cola::Dialect;
use std::collections::BTreeMap;

/// The aperture, 1e-4 deg.
pub const APERTURE: [i32; 2] = [-50_000, 1_850_000];
/// A range a little beyond the aperture is cut: clients reckon in radians.
const APERTURE_ROOM: i32 = 1_000;

const BOOL: Kind = Kind::Unsigned(1, 0, 1);
const BYTE: Kind = Kind::Unsigned(1, 0, 255);
const fn choice(most: u32) -> Kind {
    Kind::Unsigned(1, 0, most)
}

/// Every variable that can be written: its name, its parameters' types, its factory values
/// (numbers; a text begins empty).
const VARIABLES: &[(&str, &[Kind], &[u32])] = &[
    // 2 is CoLa B with a CRC32 on newer firmware; this one does not speak it.
    ("EIHstCola", &[choice(1)], &[1]),
    ("FREchoFilter", &[choice(2)], &[2]),
    (
        "LFPmeanfilter",
        &[BOOL, Kind::Unsigned(2, 2, 100), choice(0)],
        &[0, 2, 0],
    ),
    (
        "LFPparticle",
        &[BOOL, Kind::Unsigned(2, 500, 500)],
        &[0, 500],
    ),
    ("CLFogFilterEn", &[BOOL], &[0]),
    ("MCSenseLevel", &[choice(5)], &[0]),
    (
        "LMDscandatacfg",
        &[
            BYTE,
            BYTE,
            BOOL,
            choice(1),
            choice(0),
            BYTE,
            BYTE,
            BOOL,
            BOOL,
            BOOL,
            BOOL,
            Kind::Unsigned(2, 1, 50_000),
        ],
        &[1, 0, 1, 0, 0, 0, 0, 0, 0, 0, 1, 1],
    ),
    (
        "LMPoutputRange",
        &[
            Kind::Signed(2, 1, 1),
            Kind::Unsigned(4, 0, u32::MAX),
            Kind::Signed(4, i32::MIN, i32::MAX),
            Kind::Signed(4, i32::MIN, i32::MAX),
        ],
        &[
            1,
            1667,
            APERTURE[0].cast_unsigned(),
            APERTURE[1].cast_unsigned(),
        ],
    ),
    ("LocationName", &[Kind::Text(16)], &[0]),
    ("TSCRole", &[choice(2)], &[0]),
    ("TSCTCInterface", &[choice(1)], &[0]),
    ("TSCTCSrvAddr", &[BYTE; 4], &[192, 168, 0, 100]),
    ("TSCTCtimezone", &[choice(24)], &[12]),
    ("TSCTCupdatetime", &[Kind::Unsigned(4, 1, 3600)], &[60]),
    ("LICsrc", &[choice(1)], &[0]),
    ("LICencset", &[choice(3)], &[0]),
    ("LICencres", &[Kind::Real], &[0]),
    ("LICFixVel", &[Kind::Real], &[0]),
    ("DO3And4Fnc", &[choice(2)], &[0]),
    ("DO6Fnc", &[choice(7)], &[0]),
    ("SYMode", &[choice(2)], &[0]),
    ("SYPhase", &[Kind::Unsigned(2, 0, 359)], &[0]),
    ("LCMcfg", &[choice(3)], &[0]),
    ("EIIpAddr", &[BYTE; 4], &[192, 168, 0, 1]),
    ("EImask", &[BYTE; 4], &[255, 255, 255, 0]),
    ("EIgate", &[BYTE; 4], &[0, 0, 0, 0]),
    ("EIHstPort", &[Kind::Unsigned(2, 1, 65_535)], &[2112]),
    ("SIHstBaud", &[choice(11)], &[7]),
    ("SIHstHw", &[choice(2)], &[0]),
];

/// Frequency (Hz) and resolution (deg) of the modes of `mCLsetscancfglist`, by number.
const MODES: [(f64, f64); 17] = [
    (25.0, 1.0 / 6.0),
    (25.0, 0.25),
    (35.0, 0.25),
    (35.0, 0.5),
    (50.0, 1.0 / 3.0),
    (50.0, 0.5),
    (75.0, 0.5),
    (75.0, 1.0),
    (100.0, 2.0 / 3.0),
    (100.0, 1.0),
    (50.0, 1.0 / 6.0),
    (75.0, 0.25),
    (100.0, 1.0 / 6.0),
    (100.0, 1.0 / 3.0),
    (100.0, 0.5),
    (25.0, 1.0 / 12.0),
    (25.0, 1.0 / 24.0),
];

/// The factory's password hashes of the levels 2 (maintenance), 3 (authorised client), 4 (service).
const PASSWORDS: [u32; 3] = [0xB21A_CE26, 0xF472_4744, 0x81BE_23AA];

/// All that can be set.
#[derive(Clone, Debug, PartialEq)]
pub struct Configuration {
    model: &'static ScannerModel,
    /// Frequency and resolution.
    pub mode: ScanMode,
    variables: BTreeMap<&'static str, Vec<Value>>,
    passwords: [u32; 3],
    /// First and last angle that can be sent, 1e-4 deg.
    coverage: [i32; 2],
}

impl Configuration {
    /// As it leaves the factory, apart from the mode and the name.
    pub fn factory(model: &'static ScannerModel, mode: ScanMode, name: &str) -> Configuration {
        let variables = VARIABLES.iter().map(|(variable, kinds, numbers)| {
            let values = kinds.iter().zip(*numbers);
            let values = values.map(|(kind, number)| match *kind {
                Kind::Unsigned(bytes, ..) => Value::Unsigned(bytes, *number),
                Kind::Signed(bytes, ..) => Value::Signed(bytes, number.cast_signed()),
                Kind::Real => Value::Real(*number as f32),
                Kind::Text(_) => Value::Text(name.to_owned()),
            });
            (*variable, values.collect())
        });
        Configuration {
            model,
            mode,
            variables: variables.collect(),
            passwords: PASSWORDS,
            coverage: APERTURE,
        }
    }

    /// There is nothing to be seen outside of these angles, 1e-4 deg: the output range begins as
    /// them and stays inside. Clients take their angles from it.
    pub fn narrow(&mut self, [from, to]: [i32; 2]) {
        let (from, to) = (from.max(APERTURE[0]), to.min(APERTURE[1]));
        if from >= to {
            return;
        }
        self.coverage = [from, to];
        if let Some([_, _, Value::Signed(_, start), Value::Signed(_, end)]) = self
            .variables
            .get_mut("LMPoutputRange")
            .map(Vec::as_mut_slice)
        {
            (*start, *end) = (from, to);
        }
    }

    /// A variable's values; none where there is no such variable.
    pub fn read(&self, name: &str) -> Option<Vec<Value>> {
        let mut values = self.variables.get(name)?.clone();
        // The resolution of the output range is always that of the scan.
        if let ("LMPoutputRange", Some(resolution)) = (name, values.get_mut(1)) {
            *resolution = Value::Unsigned(4, self.resolution_raw());
        }
        Some(values)
    }

    /// Sets a variable from a request's parameters.
    pub fn write(&mut self, name: &str, request: &mut Request) -> Result<(), Refusal> {
        let (variable, kinds, _) = VARIABLES
            .iter()
            .find(|(variable, ..)| *variable == name)
            .ok_or(Refusal::UnknownVariable)?;
        let values = kinds.iter().map(|kind| request.value(*kind));
        let mut values: Vec<Value> = values.collect::<Result<_, _>>()?;
        request.end()?;
        if let ("LMPoutputRange", [_, _, Value::Signed(_, from), Value::Signed(_, to)]) =
            (name, values.as_mut_slice())
        {
            let [least, most] = APERTURE;
            if *from < least - APERTURE_ROOM || *to > most + APERTURE_ROOM || *from >= *to {
                return Err(Refusal::Condition);
            }
            let [least, most] = self.coverage;
            *from = (*from).max(least);
            *to = (*to).min(most);
            if *from >= *to {
                return Err(Refusal::Condition);
            }
        }
        self.variables.insert(variable, values);
        Ok(())
    }

    /// Takes a variable over from another configuration.
    pub fn restore(&mut self, name: &str, from: &Configuration) {
        if let Some((name, values)) = from.variables.get_key_value(name) {
            self.variables.insert(name, values.clone());
        }
    }

    /// One number of a variable; 0 where there is none.
    pub fn number(&self, name: &str, place: usize) -> i64 {
        let values = self.variables.get(name);
        values.and_then(|v| v.get(place)).map_or(0, Value::number)
    }

    /// One real number of a variable; 0 where there is none.
    pub fn real(&self, name: &str) -> f32 {
        match self.variables.get(name).and_then(|values| values.first()) {
            Some(Value::Real(value)) => *value,
            _ => 0.0,
        }
    }

    /// A variable that is a string.
    pub fn text(&self, name: &str) -> &str {
        match self.variables.get(name).and_then(|values| values.first()) {
            Some(Value::Text(text)) => text,
            _ => "",
        }
    }

    /// The dialect of the host port.
    pub fn host_dialect(&self) -> Dialect {
        match self.number("EIHstCola", 0) {
            0 => Dialect::Text,
            _ => Dialect::Binary,
        }
    }

    /// Sets the dialect of the host port.
    pub fn set_host_dialect(&mut self, dialect: Dialect) {
        let value = Value::byte(u8::from(dialect == Dialect::Binary));
        self.variables.insert("EIHstCola", vec![value]);
    }

    /// Scan frequency, 1/100 Hz.
    pub fn frequency_raw(&self) -> u32 {
        (self.mode.frequency_hz * 100.0).round() as u32
    }

    /// Resolution, 1e-4 deg, rounded.
    pub fn resolution_raw(&self) -> u32 {
        (self.mode.resolution_deg() * 1e4).round() as u32
    }

    /// Sets frequency (1/100 Hz) and resolution (1e-4 deg) if they go together.
    ///
    /// # Errors
    /// The status of `mLMPsetscancfg`: 1 frequency, 2 resolution, 3 both (or a pair that does not
    /// go together).
    pub fn set_mode(&mut self, frequency: u32, resolution: u32) -> Result<(), u8> {
        let of = |mode: &ScanMode| {
            let raw = (mode.resolution_deg() * 1e4).round() as u32;
            ((mode.frequency_hz * 100.0).round() as u32, raw)
        };
        let modes = self.model.modes;
        // 2/3 deg is written as 6666 as well as 6667.
        let same =
            |mode: &&ScanMode| of(mode).0 == frequency && of(mode).1.abs_diff(resolution) < 2;
        if let Some(mode) = modes.iter().find(same) {
            self.mode = *mode;
            return Ok(());
        }
        let frequency_known = modes.iter().any(|mode| of(mode).0 == frequency);
        let resolution_known = modes.iter().any(|mode| of(mode).1.abs_diff(resolution) < 2);
        Err(match (frequency_known, resolution_known) {
            (false, true) => 1,
            (true, false) => 2,
            _ => 3,
        })
    }

    /// Sets one of the numbered modes; whether there is one of this number.
    pub fn set_mode_number(&mut self, number: u32) -> bool {
        let pair = MODES.get(number as usize);
        let mode = pair.and_then(|(hz, deg)| self.model.mode(*hz, *deg));
        self.mode = mode.unwrap_or(self.mode);
        mode.is_some()
    }

    /// Whether a hash is the password of a level.
    pub fn is_password(&self, level: i32, hash: u32) -> bool {
        let place = usize::try_from(level - 2).ok();
        place.and_then(|place| self.passwords.get(place)) == Some(&hash)
    }

    /// Changes a level's password; whether there is such a level.
    pub fn set_password(&mut self, level: i32, hash: u32) -> bool {
        let place = usize::try_from(level - 2).ok();
        let password = place.and_then(|place| self.passwords.get_mut(place));
        password.map(|password| *password = hash).is_some()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn factory() -> Configuration {
        let model = ScannerModel::by_name("lms511-hr").unwrap();
        Configuration::factory(model, model.modes[0], "N")
    }

    #[test]
    fn every_variable_reads_back_in_both_dialects() {
        use crate::sick::emulator::values::Reply;
        for dialect in [Dialect::Text, Dialect::Binary] {
            let mut configuration = factory();
            for (name, kinds, numbers) in VARIABLES {
                assert_eq!(kinds.len(), numbers.len(), "{name}");
                let values = configuration.read(name).unwrap();
                let reply = Reply::new(dialect, "").values(&values);
                let body = match dialect {
                    Dialect::Text => reply.body(),
                    Dialect::Binary => &reply.body()[1..],
                };
                let mut request = Request::new(dialect, body);
                assert_eq!(configuration.write(name, &mut request), Ok(()), "{name}");
                assert_eq!(configuration.read(name).unwrap(), values);
            }
        }
    }

    #[test]
    fn modes_by_pair_and_by_number() {
        let mut configuration = factory();
        for (number, (hz, deg)) in MODES.iter().enumerate() {
            assert!(configuration.set_mode_number(number as u32));
            assert_eq!(configuration.mode.frequency_hz, *hz);
            assert!((configuration.mode.resolution_deg() - deg).abs() < 1e-12);
            let (frequency, resolution) = (
                configuration.frequency_raw(),
                configuration.resolution_raw(),
            );
            assert_eq!(configuration.set_mode(frequency, resolution), Ok(()));
        }
        assert!(!configuration.set_mode_number(17));
        assert_eq!(configuration.set_mode(10_000, 6666), Ok(()));
        assert_eq!(configuration.set_mode(3300, 2500), Err(1));
        assert_eq!(configuration.set_mode(2500, 1234), Err(2));
        assert_eq!(configuration.set_mode(3300, 1234), Err(3));
        // Both are known, but not together.
        assert_eq!(configuration.set_mode(3500, 1667), Err(3));
        assert_eq!(configuration.resolution_raw(), 6667);
    }

    #[test]
    fn output_ranges_stay_inside_the_aperture() {
        let mut configuration = factory();
        let mut write = |text: &[u8]| {
            let mut request = Request::new(Dialect::Text, text);
            configuration.write("LMPoutputRange", &mut request)
        };
        assert_eq!(write(b" 1 1388 +450000 +1350000"), Ok(()));
        assert_eq!(write(b" 1 1388 +1350000 +450000"), Err(Refusal::Condition));
        assert_eq!(write(b" 1 1388 -100000 +450000"), Err(Refusal::Condition));
        assert_eq!(write(b" 2 1388 +0 +450000"), Err(Refusal::Condition));
        assert_eq!(write(b" 1 1388 +0"), Err(Refusal::Underflow));
        assert_eq!(write(b" 1 1388 -50020 +450000"), Ok(()));
        assert_eq!(configuration.number("LMPoutputRange", 2), -50_000);
        assert_eq!(
            configuration.read("LMPoutputRange").unwrap()[1],
            Value::Unsigned(4, 2500)
        );
    }
}
