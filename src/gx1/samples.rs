//! IMU samples from a stream of replies: one streamed command, others polled in between, or polled
//! ones only.

use super::attitude::{self, Sense};
use super::command::{Command, Word};
use super::framer::Arrived;
use super::pace::{Pace, Place, Pushed};
use super::packet::Packet;
use super::scale::Gains;
use super::ticks::{TickFactors, cycle_ticks};
use super::timing::SampleClock;
use crate::record::{Axes, ImuSample, Stamp};
use std::collections::{BTreeMap, VecDeque};

/// How the samples come.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Mode {
    /// The first command is streamed by the unit at the end of each of its cycles, the others are
    /// asked for with each of its replies.
    Continuous,
    /// All are asked for this often, Hz.
    Polled(f64),
}

/// All that must be known to make samples of replies.
#[derive(Clone, Debug, PartialEq)]
pub struct Setup {
    /// The commands, the streamed one first.
    pub commands: Vec<Command>,
    /// How they come.
    pub mode: Mode,
    /// The unit's gains.
    pub gains: Gains,
    /// The unit's tick.
    pub tick: TickFactors,
    /// Speed of the line, Bd.
    pub baud: u32,
    /// 1 where the unit's accelerations are specific force (-1 g on Z when level, Z down), -1 where
    /// they are gravity (+1 g).
    pub accel_sign: f64,
    /// Sense of the unit's quaternion.
    pub quaternion: Sense,
}

/// What became of the replies.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SampleCounts {
    /// Samples made.
    pub samples: u64,
    /// Replies of the leading command.
    pub replies: u64,
    /// Replies missing by the ticks.
    pub lost: u64,
    /// Replies of the leading command that came again, counted in `replies` as well.
    pub repeated: u64,
    /// Polled replies beside them whose sample had gone out, or had one such reply already.
    pub late: u64,
    /// Replies whose ticks fit nothing around them.
    pub implausible: u64,
    /// Times the unit was switched off and on.
    pub restarts: u64,
}

/// Something that happened between samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Remark {
    /// This many replies are missing before the sample of this number.
    Gap {
        /// How many.
        missing: u64,
        /// `seq` of the sample after the gap.
        seq: u32,
    },
    /// The unit was switched off and on before the sample of this number.
    Restarted {
        /// `seq` of the first sample after it.
        seq: u32,
    },
}

/// Replies of the leading command that are looked at before the first is numbered: the usual step
/// of the ticks must be known, or a loss at the very start would not be seen.
const FIRST_LOOK: usize = 8;

/// For how long the first replies are held back at most, ns.
const FIRST_LOOK_NS: i64 = 500_000_000;

/// Makes samples of replies. The same replies with the same arrival times give the same samples.
#[derive(Clone, Debug)]
pub struct Samples {
    setup: Setup,
    pace: Pace,
    clock: SampleClock,
    /// Whether the unit has confirmed the mode; what came before was somebody else's.
    begun: bool,
    first: Vec<Arrived>,
    looked: bool,
    /// Samples that may get quantities of further replies, by ticks.
    pending: BTreeMap<i64, Pending>,
    newest_ticks: i64,
    /// Ticks of the newest sample that went out.
    gone_ticks: i64,
    next_seq: u32,
    out: VecDeque<ImuSample>,
    remarks: VecDeque<Remark>,
    counts: SampleCounts,
}

#[derive(Clone, Debug)]
struct Pending {
    sample: ImuSample,
    commands: Vec<Command>,
    missing: u64,
    restarted: bool,
}

impl Samples {
    /// For replies of a unit that was set up so.
    pub fn new(setup: Setup) -> Samples {
        let tick_ns = setup.tick.tick_ns();
        Samples {
            pace: Pace::new(tick_ns),
            clock: SampleClock::new(tick_ns),
            setup,
            begun: false,
            first: Vec::new(),
            looked: false,
            pending: BTreeMap::new(),
            newest_ticks: i64::MIN,
            gone_ticks: i64::MIN,
            next_seq: 0,
            out: VecDeque::new(),
            remarks: VecDeque::new(),
            counts: SampleCounts::default(),
        }
    }

    /// Takes every reply from here on, without waiting for the unit's word that the stream began.
    pub fn begin(&mut self) {
        self.begun = true;
    }

    /// How the unit was set up.
    pub fn setup(&self) -> &Setup {
        &self.setup
    }

    /// What became of the replies so far.
    pub fn counts(&self) -> SampleCounts {
        SampleCounts {
            implausible: self.pace.implausible(),
            ..self.counts
        }
    }

    /// The usual time between two replies of the leading command, s; none before it is known.
    pub fn period_s(&self) -> Option<f64> {
        match self.setup.mode {
            Mode::Continuous => self.pace.step().map(|_| self.pace.step_ns() as f64 * 1e-9),
            Mode::Polled(hz) => Some(1.0 / hz),
        }
    }

    /// The command whose replies the samples are counted by.
    pub fn leading(&self) -> Command {
        self.setup
            .commands
            .first()
            .copied()
            .unwrap_or(Command::Null)
    }

    /// Takes a reply. Those of no command of the setup only say when the stream begins and ends.
    pub fn push(&mut self, arrived: &Arrived) {
        let command = arrived.packet.command();
        if command == Command::SetContinuous {
            let code = arrived.packet.word(Word::Value(0)).unwrap_or(0);
            self.begun = match self.setup.mode {
                Mode::Continuous => code == u16::from(self.leading().byte()),
                Mode::Polled(_) => code == 0,
            };
            self.pace.interrupt();
        }
        if !self.begun || !self.setup.commands.contains(&command) {
            return;
        }
        if command != self.leading() {
            if self.looked {
                self.attach(arrived);
            }
            return;
        }
        self.counts.replies += 1;
        if self.looked || self.setup.mode != Mode::Continuous {
            self.looked = true;
            self.lead(arrived);
            return;
        }
        if let Some(before) = self.first.last().and_then(|before| before.packet.ticks())
            && let Some(now) = arrived.packet.ticks()
        {
            self.pace.learn(now.wrapping_sub(before));
        }
        self.first.push(*arrived);
        let since_ns = |first: &Arrived| arrived.at.raw_ns.saturating_sub(first.at.raw_ns);
        let waited_ns = self.first.first().map_or(0, since_ns);
        if self.first.len() >= FIRST_LOOK || waited_ns > FIRST_LOOK_NS {
            self.end_first_look();
        }
    }

    /// The next sample that is complete.
    pub fn next_sample(&mut self) -> Option<ImuSample> {
        self.out.pop_front()
    }

    /// The next thing to say.
    pub fn next_remark(&mut self) -> Option<Remark> {
        self.remarks.pop_front()
    }

    /// The end of the stream: what still waits for further quantities goes out as it is.
    pub fn finish(&mut self) {
        self.end_first_look();
        self.emit_before(i64::MAX);
    }

    fn end_first_look(&mut self) {
        self.looked = true;
        for arrived in std::mem::take(&mut self.first) {
            self.lead(&arrived);
        }
    }

    /// A reply of the leading command.
    fn lead(&mut self, arrived: &Arrived) {
        let command = arrived.packet.command();
        let Some(reading) = arrived.packet.ticks() else {
            return;
        };
        let mut place = match self.pace.push(reading, arrived.at.raw_ns) {
            Pushed::On(place) => place,
            Pushed::Repeated => {
                self.counts.repeated += 1;
                return;
            }
            Pushed::Doubtful => return,
        };
        if let Mode::Polled(hz) = self.setup.mode {
            place.missing = self.missed_polls(place, hz);
        }
        if place.restarted {
            self.emit_before(i64::MAX);
            self.gone_ticks = i64::MIN;
            self.clock.restart();
            self.counts.restarts += 1;
        }
        self.counts.lost += place.missing;
        self.emit_before(place.ticks);
        self.newest_ticks = place.ticks;
        let cycle_ns = match self.setup.mode {
            Mode::Continuous => self.pace.step_ns(),
            Mode::Polled(_) => {
                let ticks = i64::from(cycle_ticks(command, true));
                self.clock.device_ns(ticks)
            }
        };
        let stamp = self
            .clock
            .push(place.ticks, arrived.at, command, cycle_ns, self.setup.baud);
        let mut sample = self.blank(stamp, place.ticks, arrived);
        self.fill(&mut sample, &arrived.packet);
        self.pending.insert(
            place.ticks,
            Pending {
                sample,
                commands: vec![command],
                missing: place.missing,
                restarted: place.restarted,
            },
        );
        self.emit_complete();
    }

    /// Polls that were due between two replies and were not answered. An answer comes at the end of
    /// a cycle, so that the time between two of them varies by one.
    fn missed_polls(&self, place: Place, hz: f64) -> u64 {
        if self.newest_ticks == i64::MIN || place.restarted {
            return 0;
        }
        let passed_s = self.clock.device_ns(place.ticks - self.newest_ticks) as f64 * 1e-9;
        let cycle_s = 3.0 * self.setup.tick.tick_s();
        let missed = ((passed_s - cycle_s) * hz - 0.5).round();
        if missed >= 1.0 { missed as u64 } else { 0 }
    }

    /// A polled reply beside the streamed ones: to the sample of its cycle, or one of its own.
    fn attach(&mut self, arrived: &Arrived) {
        let Some(reading) = arrived.packet.ticks() else {
            return;
        };
        if self.newest_ticks == i64::MIN {
            return;
        }
        // Nearest to the newest streamed one; the counter's laps are minutes long.
        let ahead = i64::from(reading.wrapping_sub(self.newest_ticks as u16).cast_signed());
        let ticks = self.newest_ticks.saturating_add(ahead);
        let command = arrived.packet.command();
        let mut pending = match self.pending.remove(&ticks) {
            Some(pending) => pending,
            // The sample of that cycle has gone out, and samples do not go back.
            None if ticks <= self.gone_ticks => {
                self.counts.late += 1;
                return;
            }
            None => {
                let Some(stamp) = self.clock.at(ticks) else {
                    return;
                };
                Pending {
                    sample: self.blank(stamp, ticks, arrived),
                    commands: Vec::new(),
                    missing: 0,
                    restarted: false,
                }
            }
        };
        if pending.commands.contains(&command) {
            self.counts.late += 1;
        } else {
            pending.commands.push(command);
            pending.sample.received = Some(arrived.at.utc);
            self.fill(&mut pending.sample, &arrived.packet);
        }
        self.pending.insert(ticks, pending);
        self.emit_complete();
    }

    fn blank(&self, stamp: Stamp, ticks: i64, arrived: &Arrived) -> ImuSample {
        ImuSample {
            stamp,
            received: Some(arrived.at.utc),
            device: Some(Stamp::from_ns(self.clock.device_ns(ticks))),
            axes: Axes::Ned,
            ..ImuSample::default()
        }
    }

    /// Writes a reply's quantities into a sample, in the device's axes.
    fn fill(&self, sample: &mut ImuSample, packet: &Packet) {
        let gains = self.setup.gains;
        if let Some([roll, pitch, yaw]) = attitude::of(packet, self.setup.quaternion) {
            (sample.roll_rad, sample.pitch_rad, sample.yaw_rad) = (roll, pitch, yaw);
        }
        if let Some([x, y, z]) = gains.vector(packet, Word::Rate) {
            (
                sample.gyro_x_rad_s,
                sample.gyro_y_rad_s,
                sample.gyro_z_rad_s,
            ) = (x, y, z);
        }
        if let Some(accel) = gains.vector(packet, Word::Accel) {
            let [x, y, z] = accel.map(|a| a * self.setup.accel_sign);
            (
                sample.accel_x_m_s2,
                sample.accel_y_m_s2,
                sample.accel_z_m_s2,
            ) = (x, y, z);
        }
        if let Some([x, y, z]) = gains.vector(packet, Word::Mag) {
            (sample.mag_x_gauss, sample.mag_y_gauss, sample.mag_z_gauss) = (x, y, z);
        }
    }

    /// Lets out what has all its quantities, in order.
    fn emit_complete(&mut self) {
        while let Some(entry) = self.pending.first_entry()
            && entry.get().commands.len() >= self.setup.commands.len()
        {
            let (ticks, pending) = entry.remove_entry();
            self.emit(ticks, pending);
        }
    }

    /// Lets out what is older than `ticks`.
    fn emit_before(&mut self, ticks: i64) {
        while let Some(entry) = self.pending.first_entry()
            && *entry.key() < ticks
        {
            let (ticks, pending) = entry.remove_entry();
            self.emit(ticks, pending);
        }
    }

    fn emit(&mut self, ticks: i64, pending: Pending) {
        self.gone_ticks = ticks;
        let missing = u32::try_from(pending.missing).unwrap_or(u32::MAX);
        let seq = self.next_seq.wrapping_add(missing);
        self.next_seq = seq.wrapping_add(1);
        if pending.restarted {
            self.remarks.push_back(Remark::Restarted { seq });
        }
        if missing > 0 {
            let missing = pending.missing;
            self.remarks.push_back(Remark::Gap { missing, seq });
        }
        self.counts.samples += 1;
        self.out.push_back(ImuSample {
            seq,
            ..pending.sample
        });
    }
}

/// What the samples of these commands hold: attitude, acceleration, rate, magnetic field.
pub fn quantities(commands: &[Command]) -> [bool; 4] {
    let has = |wanted: fn(&Word) -> bool| commands.iter().any(|c| c.words().iter().any(wanted));
    [
        has(|word| matches!(word, Word::Roll | Word::Quaternion(_) | Word::Matrix(..))),
        has(|word| matches!(word, Word::Accel(_))),
        has(|word| matches!(word, Word::Rate(_))),
        has(|word| matches!(word, Word::Mag(_))),
    ]
}

/// Rate of samples that the line can carry with these commands, Hz.
pub fn most_per_second(commands: &[Command], baud: u32) -> f64 {
    let bytes = commands.iter().map(|command| command.reply_length()).sum();
    1.0 / super::wire_time_s(bytes, baud).max(1e-9)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gx1::packet;
    use crate::link::HostInstant;

    const MS: i64 = 1_000_000;

    fn setup(commands: &[Command], mode: Mode) -> Setup {
        Setup {
            commands: commands.to_vec(),
            mode,
            gains: Gains::FACTORY,
            tick: TickFactors([4, 10, 250, 2]),
            baud: 38_400,
            accel_sign: 1.0,
            quaternion: Sense::Attitude,
        }
    }

    fn reply(command: Command, words: &[u16], raw_ns: i64) -> Arrived {
        let bytes = packet::encode(command, words).unwrap();
        Arrived {
            packet: Packet::decode(&bytes).unwrap(),
            offset: 0,
            at: HostInstant {
                utc: Stamp::from_ns(1_000 * MS + raw_ns),
                raw_ns,
            },
        }
    }

    fn euler(ticks: u16, raw_ns: i64) -> Arrived {
        reply(Command::StabilisedEuler, &[100, 200, 300, ticks], raw_ns)
    }

    fn vectors(ticks: u16, raw_ns: i64) -> Arrived {
        let words = [1, 2, 3, 4, 5, 6, 7, 8, 9, ticks];
        reply(Command::InstantVectors, &words, raw_ns)
    }

    fn taken(samples: &mut Samples) -> Vec<ImuSample> {
        std::iter::from_fn(|| samples.next_sample()).collect()
    }

    fn begun(commands: &[Command], mode: Mode) -> Samples {
        let mut samples = Samples::new(setup(commands, mode));
        let code = match mode {
            Mode::Continuous => u16::from(commands[0].byte()),
            Mode::Polled(_) => 0,
        };
        samples.push(&reply(Command::SetContinuous, &[code, 0], 0));
        samples
    }

    #[test]
    fn what_came_before_the_unit_said_so_is_not_ours() {
        let mut samples = Samples::new(setup(&[Command::StabilisedEuler], Mode::Continuous));
        for k in 0..20 {
            samples.push(&euler(5 * k, i64::from(k) * 10 * MS));
        }
        assert_eq!(samples.counts().replies, 0);
        samples.push(&reply(Command::SetContinuous, &[0x0E, 0], 300 * MS));
        for k in 20..40 {
            samples.push(&euler(5 * k, i64::from(k) * 10 * MS + 200 * MS));
        }
        assert_eq!(taken(&mut samples).len(), 20);
    }

    #[test]
    fn a_gap_is_in_seq_and_said() {
        let mut samples = begun(&[Command::StabilisedEuler], Mode::Continuous);
        // The very first step is a gap of three: 8 replies are looked at before one is numbered.
        let lost = [1, 2, 3, 20, 21];
        let mut sent = 0;
        for k in (0..40).filter(|k| !lost.contains(k)) {
            samples.push(&euler(5 * k as u16, k * 10 * MS));
            sent += 1;
        }
        let seqs: Vec<u32> = taken(&mut samples).iter().map(|s| s.seq).collect();
        let wanted: Vec<u32> = (0..40).filter(|k| !lost.contains(&i64::from(*k))).collect();
        assert_eq!(seqs, wanted);
        assert_eq!(samples.counts().lost, 5);
        assert_eq!(samples.counts().samples, sent);
        let remarks: Vec<Remark> = std::iter::from_fn(|| samples.next_remark()).collect();
        let gap = |missing, seq| Remark::Gap { missing, seq };
        assert_eq!(remarks, [gap(3, 4), gap(2, 22)]);
        assert_eq!(samples.period_s(), Some(0.01));
    }

    #[test]
    fn a_stamp_is_the_tick_less_cycle_and_line() {
        let mut samples = begun(&[Command::StabilisedEuler], Mode::Continuous);
        for k in 0..20 {
            // A cycle of 10 ms and 11 bytes on the line.
            let wire_ns = 2_864_583;
            samples.push(&euler(5 * k as u16, (k + 1) * 10 * MS + wire_ns));
        }
        for (k, sample) in taken(&mut samples).iter().enumerate() {
            let wanted = 1_000 * MS + k as i64 * 10 * MS;
            assert!((sample.stamp.ns() - wanted).abs() < 1000, "{k}");
            assert_eq!(sample.device, Some(Stamp::from_ns(k as i64 * 10 * MS)));
        }
    }

    #[test]
    fn polled_replies_join_the_sample_of_their_cycle() {
        let commands = [Command::StabilisedEuler, Command::InstantVectors];
        let mut samples = begun(&commands, Mode::Continuous);
        for k in 0..30u16 {
            let at = i64::from(k) * 10 * MS;
            samples.push(&euler(5 * k, at));
            // One is not answered, one belongs to another cycle.
            match k {
                20 => {}
                25 => samples.push(&vectors(5 * k + 2, at + MS)),
                _ => samples.push(&vectors(5 * k, at + MS)),
            }
        }
        samples.finish();
        let taken = taken(&mut samples);
        let whole = taken
            .iter()
            .filter(|s| s.roll_rad.is_finite() && s.mag_x_gauss.is_finite());
        // While the first 7 were looked at, what was polled is let go.
        assert_eq!(whole.count(), 30 - 7 - 2);
        assert_eq!(taken.len(), 31);
        assert!(taken.windows(2).all(|pair| pair[0].stamp <= pair[1].stamp));
        assert!(taken.windows(2).all(|pair| pair[1].seq == pair[0].seq + 1));
        assert_eq!(samples.counts().lost, 0);
    }

    #[test]
    fn a_polled_reply_that_comes_twice_makes_no_sample() {
        let commands = [Command::StabilisedEuler, Command::InstantVectors];
        let mut samples = begun(&commands, Mode::Continuous);
        for k in 0..20u16 {
            let at = i64::from(k) * 10 * MS;
            samples.push(&euler(5 * k, at));
            samples.push(&vectors(5 * k, at + MS));
            // Again at once, and again a cycle later.
            if k > 10 {
                samples.push(&vectors(5 * k, at + 2 * MS));
                samples.push(&vectors(5 * (k - 1), at + 3 * MS));
            }
        }
        samples.finish();
        let taken = taken(&mut samples);
        assert_eq!(taken.len(), 20);
        assert!(taken.windows(2).all(|pair| pair[0].stamp < pair[1].stamp));
        let counts = samples.counts();
        assert_eq!(
            (counts.replies, counts.repeated, counts.late),
            (20, 0, 2 * 9)
        );
    }

    #[test]
    fn polls_that_were_not_answered_are_missing() {
        let mut samples = begun(&[Command::InstantVectors], Mode::Polled(20.0));
        for k in (0..60i64).filter(|k| ![10, 11, 30].contains(k)) {
            // Answers come up to a cycle later than asked.
            let ticks = 25 * k + (k * 7) % 3;
            samples.push(&vectors(ticks as u16, ticks * 2 * MS));
        }
        assert_eq!(samples.counts().lost, 3);
        assert_eq!(taken(&mut samples).last().unwrap().seq, 59);
    }

    #[test]
    fn the_sign_of_the_accelerometer_is_the_callers() {
        let mut setup = setup(&[Command::InstantVectors], Mode::Polled(10.0));
        setup.accel_sign = -1.0;
        let mut samples = Samples::new(setup);
        samples.push(&reply(Command::SetContinuous, &[0, 0], 0));
        samples.push(&vectors(5, MS));
        let sample = samples.next_sample().unwrap();
        assert!((sample.accel_z_m_s2 + Gains::FACTORY.accel_m_s2(6)).abs() < 1e-15);
        assert!((sample.gyro_x_rad_s - Gains::FACTORY.rate_rad_s(7)).abs() < 1e-15);
    }

    #[test]
    fn a_unit_that_was_switched_off_begins_anew() {
        let mut samples = begun(&[Command::StabilisedEuler], Mode::Continuous);
        for k in 0..20 {
            samples.push(&euler(40_000 + 5 * k as u16, k * 10 * MS));
        }
        for k in 0..20 {
            samples.push(&euler(5 * k as u16, 3_000 * MS + k * 10 * MS));
        }
        assert_eq!(samples.counts().restarts, 1);
        let last = taken(&mut samples).pop().unwrap();
        assert_eq!(last.seq, 319);
        assert!((last.stamp.ns() - 1_000 * MS - 3_177 * MS).abs() < MS);
    }
}
