//! An emulated 3DM-GX1: bytes and the time in, bytes out.
//!
//! What it does by the protocol: every command of [`Command`] with its guard bytes, an EEPROM with the
//! factory's defaults, ticks by the formula of cells 238 to 246, calculation cycles of whole ticks
//! (two for vectors, three for attitudes, one less without gyro stabilisation), the continuous
//! packet first and then one queued command at the end of each cycle, at most 15 in the queue.
//!
//! Where the documents are silent it does this: unknown bytes, and commands with a wrong guard byte,
//! are not answered; a new tick acts at once, one that makes no sense is the factory's; a new speed or
//! interface acts when power comes back; a cycle does not begin before the line can take its packet at
//! its end.
//!
//! What it feels comes from a [`Senses`]: attitude, rates and accelerations in the device's own axes
//! (north, east, down). The instantaneous attitudes are calculated as the unit does, from
//! acceleration and field alone.

mod memory;
mod reading;

use super::command::{Argument, Command, Word};
use super::session::Identity;
use super::unit_file::UnitFile;
use super::{eeprom, packet, ticks, wire_time_s};
use crate::link::emulation::{Device, LineId, Outbox};
use crate::record::ImuSample;
use memory::Memory;
use reading::{Reading, Sensors};
use std::collections::VecDeque;
use std::time::Duration;

/// What the unit feels.
pub trait Senses {
    /// Attitude, rates and specific force at `now_ns` of the emulation, in the device's axes. The
    /// times do not go back.
    fn sample(&mut self, now_ns: i64) -> ImuSample;
    /// Somebody asked for an attitude or a vector for the first time.
    fn asked(&mut self, _now_ns: i64) {}
    /// Nothing more will happen.
    fn ended(&self, _now_ns: i64) -> bool {
        false
    }
}

/// How the unit is made and set.
#[derive(Clone, Debug, PartialEq)]
pub struct Behaviour {
    /// Speed of the line, as cell 44 has it.
    pub baud: u32,
    /// Factors of the tick, as cells 238 to 246 have them.
    pub tick: ticks::TickFactors,
    /// Command that is streamed after power-up, as cell 132 has it; none for silence.
    pub power_up: Option<Command>,
    /// How much too fast its clock runs, ppm.
    pub clock_ppm: f64,
    /// What the tick counter shows at the start.
    pub first_tick: u16,
    /// Noise of the field and of the temperature; without, both are exact.
    pub noisy: bool,
    /// Seed of all that is random about it.
    pub seed: u64,
    /// Serial number.
    pub serial: u16,
}

impl Default for Behaviour {
    fn default() -> Behaviour {
        Behaviour {
            baud: 38_400,
            tick: ticks::TickFactors::FACTORY,
            power_up: None,
            clock_ppm: 0.0,
            first_tick: 0,
            noisy: false,
            seed: 1,
            serial: 1207,
        }
    }
}

/// Firmware 3.2.01.
const FIRMWARE: u16 = 3201;
/// Commands that wait; further ones are lost (3DM-G protocol).
const QUEUE: usize = 15;
/// How long a tare takes.
const TARE: Duration = Duration::from_secs(2);

/// What the unit has done.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    /// Commands understood.
    pub commands: u64,
    /// Bytes that were none.
    pub ignored_bytes: u64,
    /// Commands lost to a full queue.
    pub crowded_out: u64,
    /// Packets of the continuous command.
    pub streamed: u64,
}

/// A command that waits, with the bytes of the caller's.
#[derive(Clone, Debug)]
struct Request {
    command: Command,
    free: Vec<u8>,
}

/// A calculation that runs.
#[derive(Clone, Debug)]
struct Cycle {
    begun_ns: i64,
    end_ns: i64,
    /// The tick counter at its start.
    tick: i64,
    /// How many it takes.
    ticks: i64,
    request: Option<Request>,
}

/// The unit.
pub struct Emulator<S> {
    senses: S,
    behaviour: Behaviour,
    memory: Memory,
    sensors: Sensors,
    line: Option<LineId>,
    input: Vec<u8>,
    queue: VecDeque<Request>,
    continuous: Option<Command>,
    cycle: Option<Cycle>,
    /// A tick and its time, from which the others are counted.
    tick_anchor: (i64, f64),
    /// When the line has sent what it was given, ns.
    line_free_ns: i64,
    /// Nothing works before that.
    boots_until_ns: i64,
    /// The line's speed since power came.
    baud: u32,
    asked: bool,
    now_ns: i64,
    tally: Tally,
}

impl<S: Senses> Emulator<S> {
    /// A unit that has just been switched on.
    pub fn new(behaviour: Behaviour, senses: S) -> Emulator<S> {
        let memory = Memory::new(&behaviour);
        let mut unit = Emulator {
            sensors: Sensors::new(behaviour.noisy, behaviour.seed),
            tick_anchor: (i64::from(behaviour.first_tick), 0.0),
            baud: behaviour.baud,
            senses,
            behaviour,
            memory,
            line: None,
            input: Vec::new(),
            queue: VecDeque::new(),
            continuous: None,
            cycle: None,
            line_free_ns: 0,
            boots_until_ns: 0,
            asked: false,
            now_ns: 0,
            tally: Tally::default(),
        };
        unit.power_up(0);
        unit
    }

    /// What it has done.
    pub fn tally(&self) -> Tally {
        self.tally
    }

    /// What a recording of it needs beside it, when `commands` are read from it.
    pub fn unit_file(&self, commands: &[Command]) -> UnitFile {
        let identity = Identity {
            firmware: Some(FIRMWARE),
            serial: self.behaviour.serial,
        };
        let (gains, tick) = (self.memory.gains(), self.memory.tick());
        let mut unit = UnitFile::new(identity, self.behaviour.baud, gains, tick);
        unit.commands = commands.iter().map(|command| command.byte()).collect();
        unit
    }

    /// What it feels.
    pub fn senses(&self) -> &S {
        &self.senses
    }

    fn power_up(&mut self, now_ns: i64) {
        let [_, command] = self.memory.get(eeprom::POWER_UP_CELL).to_be_bytes();
        self.continuous = Command::from_byte(command).filter(|c| c.can_be_streamed());
        let baud = eeprom::baud_of(self.memory.get(eeprom::BAUD_CELL));
        self.baud = baud.unwrap_or(self.behaviour.baud);
        self.start_cycle(now_ns);
    }

    /// Length of a tick in true time, ns.
    fn tick_ns(&self) -> f64 {
        let tick = self.memory.tick().check();
        let tick_ns = tick.unwrap_or(ticks::TickFactors::FACTORY).tick_ns();
        tick_ns as f64 / (1.0 + self.behaviour.clock_ppm * 1e-6)
    }

    fn time_of_tick(&self, tick: i64) -> i64 {
        let (anchor, at_ns) = self.tick_anchor;
        (at_ns + (tick - anchor) as f64 * self.tick_ns()).ceil() as i64
    }

    /// The first tick at or after an instant.
    fn tick_from(&self, now_ns: i64) -> i64 {
        let (anchor, at_ns) = self.tick_anchor;
        let mut tick = anchor + ((now_ns as f64 - at_ns) / self.tick_ns()).floor() as i64;
        while self.time_of_tick(tick) < now_ns {
            tick += 1;
        }
        tick
    }

    fn stabilises(&self) -> bool {
        self.memory.get(eeprom::STABILISATION_CELL) == 1
    }

    /// Ticks that a command's calculation takes.
    fn ticks_of(&self, command: Command) -> i64 {
        let whole = |duration_ns: f64| (duration_ns / self.tick_ns()).ceil() as i64;
        match command {
            Command::CaptureGyroBias => {
                i64::from(self.memory.get(eeprom::BIAS_SAMPLES_CELL)).clamp(1, 10_000)
            }
            Command::Tare => whole(TARE.as_nanos() as f64),
            _ => i64::from(ticks::cycle_ticks(command, self.stabilises())),
        }
    }

    /// Begins the next calculation at the next tick from `from_ns` on, if there is anything to do.
    fn start_cycle(&mut self, from_ns: i64) {
        let from_ns = from_ns.max(self.boots_until_ns);
        let request = self.queue.pop_front();
        let commands = [self.continuous, request.as_ref().map(|r| r.command)];
        let lengths = commands.iter().flatten().map(|c| self.ticks_of(*c));
        let Some(ticks) = lengths.max() else {
            self.cycle = None;
            return;
        };
        let length_ns = (ticks as f64 * self.tick_ns()) as i64;
        let tick = self.tick_from(from_ns.max(self.line_free_ns - length_ns));
        self.cycle = Some(Cycle {
            begun_ns: self.time_of_tick(tick),
            end_ns: self.time_of_tick(tick + ticks),
            tick,
            ticks,
            request,
        });
    }

    /// Ends the running calculation: the continuous packet, then the answer.
    fn end_cycle(&mut self, cycle: Cycle, out: &mut Outbox) {
        let mut reading = None;
        if let Some(command) = self.continuous {
            let bytes = self.answer(command, &[], &cycle, &mut reading);
            self.tally.streamed += 1;
            self.say(&bytes, cycle.end_ns, true, out);
        }
        // A command that came meanwhile and takes no longer than the running calculation is answered
        // with it.
        let next = self
            .queue
            .front()
            .map(|request| self.ticks_of(request.command));
        let due = next.is_some_and(|ticks| ticks <= cycle.ticks);
        let late = if cycle.request.is_none() && due {
            self.queue.pop_front()
        } else {
            None
        };
        if let Some(request) = cycle.request.as_ref().or(late.as_ref()) {
            let bytes = self.answer(request.command, &request.free, &cycle, &mut reading);
            self.say(&bytes, cycle.end_ns, false, out);
        }
        self.start_cycle(cycle.end_ns);
    }

    fn say(&mut self, bytes: &[u8], at_ns: i64, data: bool, out: &mut Outbox) {
        let (Some(line), 1) = (self.line, self.memory.get(eeprom::INTERFACE_CELL)) else {
            return;
        };
        let sent_ns = (wire_time_s(bytes.len(), self.baud) * 1e9) as i64;
        self.line_free_ns = self.line_free_ns.max(at_ns) + sent_ns;
        if data {
            out.data(line, bytes);
        } else {
            out.reply(line, bytes);
        }
    }

    /// Does a command and gives its reply. `reading` is that of the cycle, taken once.
    fn answer(
        &mut self,
        command: Command,
        free: &[u8],
        cycle: &Cycle,
        reading: &mut Option<Reading>,
    ) -> Vec<u8> {
        let values = self.carry_out(command, free, cycle);
        if command.feels() && !self.asked {
            self.asked = true;
            self.senses.asked(cycle.begun_ns);
        }
        if command.feels() && reading.is_none() {
            let sample = self.senses.sample(cycle.begun_ns);
            let offset = self.memory.hard_iron_gauss();
            *reading = Some(self.sensors.read(&sample, offset));
        }
        if command == Command::CollectHardIron
            && let Some(reading) = reading
        {
            self.sensors.collect_hard_iron(reading);
        }
        if command == Command::ComputeHardIron {
            let offset = self.sensors.hard_iron_offset();
            self.memory.set_hard_iron(offset);
        }
        if command.is_bare() {
            let [value, ..] = values;
            return packet::encode(command, &[value]).unwrap_or_default();
        }
        let gains = self.memory.gains();
        let word = |word: &Word| match word {
            Word::Ticks => cycle.tick as u16,
            Word::Value(k) => values.get(usize::from(*k)).copied().unwrap_or(0),
            Word::MagMin(_) | Word::MagMax(_) | Word::MagOffset(_) => {
                self.sensors.hard_iron_word(*word, gains)
            }
            word => reading
                .as_ref()
                .map_or(0, |reading| reading.word(command, *word, gains)),
        };
        let words: Vec<u16> = command.words().iter().map(word).collect();
        packet::encode(command, &words).unwrap_or_default()
    }

    /// Does what a command asks for besides measuring; the numbers of its reply.
    fn carry_out(&mut self, command: Command, free: &[u8], cycle: &Cycle) -> [u16; 3] {
        let mut values = [0; 3];
        match (command, free) {
            (Command::ReadEeprom, [address]) => values[0] = self.memory.get((*address).into()),
            (Command::ReadEepromChecked, [high, low]) => {
                values[0] = self.memory.get(u16::from_be_bytes([*high, *low]));
            }
            (Command::WriteEeprom, [address, high, low]) => {
                let value = u16::from_be_bytes([*high, *low]);
                values[0] = self.write((*address).into(), value, cycle.end_ns);
            }
            (Command::WriteEepromChecked, [high, low, value_high, value_low]) => {
                let address = u16::from_be_bytes([*high, *low]);
                let value = u16::from_be_bytes([*value_high, *value_low]);
                values[0] = self.write(address, value, cycle.end_ns);
            }
            (Command::SetContinuous, [byte]) => {
                self.continuous = Command::from_byte(*byte).filter(|c| c.can_be_streamed());
                values[0] = u16::from(*byte);
            }
            (Command::Firmware, _) => values[0] = FIRMWARE,
            (Command::SerialNumber, _) => values[0] = self.behaviour.serial,
            (Command::ReadGains, _) => {
                let gains = self.memory.gains();
                values = [gains.accel, gains.rate, gains.mag];
            }
            (Command::CaptureGyroBias, _) => self.capture_bias(cycle),
            (Command::Tare, _) => {
                let sample = self.senses.sample(cycle.begun_ns);
                self.sensors.tare(&sample);
            }
            (Command::RemoveTare, _) => self.sensors.remove_tare(),
            (Command::StartHardIron, _) => self.sensors.begin_hard_iron(),
            _ => {}
        }
        values
    }

    /// Writes a cell; what it then holds.
    fn write(&mut self, address: u16, value: u16, now_ns: i64) -> u16 {
        // The ticks so far were of the old length.
        let (anchor, at_ns) = self.tick_anchor;
        let tick_ns = self.tick_ns();
        let passed = ((now_ns as f64 - at_ns) / tick_ns).round();
        self.tick_anchor = (anchor + passed as i64, at_ns + passed * tick_ns);
        self.memory.set(address, value);
        self.memory.get(address)
    }

    /// Takes the mean of the rates over the cycle for the gyros' bias.
    fn capture_bias(&mut self, cycle: &Cycle) {
        const SAMPLES: i64 = 50;
        let step_ns = (cycle.end_ns - cycle.begun_ns) / SAMPLES;
        let samples = (0..SAMPLES).map(|k| cycle.begun_ns + k * step_ns);
        let mut sum = [0.0; 3];
        for at_ns in samples {
            let sample = self.senses.sample(at_ns);
            let rates = [
                sample.gyro_x_rad_s,
                sample.gyro_y_rad_s,
                sample.gyro_z_rad_s,
            ];
            for (sum, rate) in sum.iter_mut().zip(rates) {
                *sum += rate / SAMPLES as f64;
            }
        }
        self.sensors.set_gyro_bias(sum);
    }

    /// Takes whole commands off the input.
    fn take_commands(&mut self) {
        while let Some(byte) = self.input.first().copied() {
            let Some(command) = Command::from_byte(byte) else {
                self.ignore();
                continue;
            };
            let Some(request) = self.input.get(..command.request_length()) else {
                // The rest is waited for as long as what there is may become a command.
                let given = self.input.iter().skip(1).zip(command.arguments());
                let mut guards = given.filter_map(|(byte, argument)| match argument {
                    Argument::Fixed(wanted) => Some(byte == wanted),
                    Argument::Free => None,
                });
                if guards.all(|fits| fits) {
                    return;
                }
                self.ignore();
                continue;
            };
            let Some(free) = command.free_arguments(request) else {
                self.ignore();
                continue;
            };
            self.input.drain(..command.request_length());
            self.tally.commands += 1;
            if command == Command::Null {
                continue;
            }
            if self.queue.len() < QUEUE {
                self.queue.push_back(Request { command, free });
            } else {
                self.tally.crowded_out += 1;
            }
        }
    }

    fn ignore(&mut self) {
        self.input.remove(0);
        self.tally.ignored_bytes += 1;
    }
}

impl<S: Senses> Device for Emulator<S> {
    fn connected(&mut self, line: LineId, _service: usize, _now_ns: i64) {
        self.line = Some(line);
    }

    fn input(&mut self, _line: LineId, bytes: &[u8], now_ns: i64, _out: &mut Outbox) {
        if now_ns < self.boots_until_ns {
            return;
        }
        self.input.extend_from_slice(bytes);
        self.take_commands();
        if self.cycle.is_none() {
            self.start_cycle(now_ns);
        }
    }

    fn advance(&mut self, now_ns: i64, out: &mut Outbox) {
        self.now_ns = now_ns;
        while let Some(cycle) = self.cycle.take_if(|cycle| cycle.end_ns <= now_ns) {
            self.end_cycle(cycle, out);
        }
    }

    fn due_ns(&self) -> Option<i64> {
        self.cycle.as_ref().map(|cycle| cycle.end_ns)
    }

    fn restart(&mut self, now_ns: i64, boot: Duration) {
        let boot_ns = i64::try_from(boot.as_nanos()).unwrap_or(i64::MAX);
        self.boots_until_ns = now_ns.saturating_add(boot_ns);
        self.input.clear();
        self.queue.clear();
        self.cycle = None;
        self.tick_anchor = (0, self.boots_until_ns as f64);
        self.sensors.forget();
        self.power_up(self.boots_until_ns);
    }

    fn baud(&self) -> Option<u32> {
        Some(self.baud)
    }

    fn ended(&self) -> bool {
        self.senses.ended(self.now_ns)
    }
}

impl Command {
    /// Whether its reply depends on what the unit feels.
    fn feels(self) -> bool {
        let number = |word: &Word| matches!(word, Word::Ticks | Word::Value(_));
        !self.words().iter().all(number) && self != Command::ComputeHardIron
    }

    /// Whether it can be streamed.
    fn can_be_streamed(self) -> bool {
        self.feels() && self.arguments().is_empty()
    }
}

#[cfg(test)]
mod tests;
