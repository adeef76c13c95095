//! Faults on request, for emulated devices: what a bad line, a pulled cable and a reboot do.
//!
//! [`Faults`] is what is asked for, read from one text. [`Damage`] is one line's damage to its
//! messages: pure, seeded, and it counts exactly what it destroys. The faults at set times are for
//! the service that owns the lines ([`emulation`](super::emulation)).

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use std::fmt;
use std::ops::RangeInclusive;
use std::str::FromStr;
use std::time::Duration;

/// The most bytes of garbage before one message.
const MOST_GARBAGE: u64 = 64;

/// What shall go wrong.
///
/// `drop=0.001,flip=0.001,cut=0.001,repeat=0.001,garbage=0.01,chunk=1..1448,stall=2s@10s,reset@20s,`
/// `blackhole=3s@30s,reboot=5s@40s,unplug=1s@50s`: the shares are of the messages with data (a scan, a sample),
/// the times count from the device's start. Faults at set times may come several times.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Faults {
    /// Share of the messages left out.
    pub drop: f64,
    /// Share of the messages with one wrong bit.
    pub flip: f64,
    /// Share of the messages whose end is missing.
    pub cut: f64,
    /// Share of the messages sent twice.
    pub repeat: f64,
    /// Share of the messages with up to 64 bytes of garbage before them.
    pub garbage: f64,
    /// Bytes are written in pieces of so many.
    pub chunk: Option<RangeInclusive<usize>>,
    /// Faults at set times, in order of time.
    pub timed: Vec<TimedFault>,
}

/// A fault at a set time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TimedFault {
    /// When, after the device's start.
    pub at: Duration,
    /// What happens.
    pub what: Mishap,
}

/// What happens at a set time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mishap {
    /// Nothing is sent for so long; then what waited comes in one burst.
    Stall(Duration),
    /// Every connection is reset.
    Reset,
    /// The cable is out for so long: nothing is read, sent or accepted, and nobody is told. What was
    /// to be sent is lost, and the connections of before it are dead afterwards.
    Blackhole(Duration),
    /// The device restarts and needs so long for it.
    Reboot(Duration),
    /// The adapter of a serial line is pulled for so long: the port is gone, and the device talks on.
    Unplug(Duration),
}

/// A text that names no faults.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "{item:?}: {reason}; faults are drop=SHARE, flip=SHARE, cut=SHARE, repeat=SHARE, garbage=SHARE, \
     chunk=N or N..M (bytes), stall=TIME@TIME, reset@TIME, blackhole=TIME@TIME, reboot=TIME@TIME, \
     unplug=TIME@TIME"
)]
pub struct FaultsError {
    item: String,
    reason: String,
}

impl FromStr for Faults {
    type Err = FaultsError;

    fn from_str(text: &str) -> Result<Faults, FaultsError> {
        let mut faults = Faults::default();
        for item in text.split(',').map(str::trim).filter(|i| !i.is_empty()) {
            faults.add(item).map_err(|reason| FaultsError {
                item: item.to_owned(),
                reason,
            })?;
        }
        faults.timed.sort_by_key(|fault| fault.at);
        Ok(faults)
    }
}

impl Faults {
    fn add(&mut self, item: &str) -> Result<(), String> {
        let (what, at) = match item.split_once('@') {
            Some((what, at)) => (what, Some(duration(at)?)),
            None => (item, None),
        };
        let (name, value) = match what.split_once('=') {
            Some((name, value)) => (name, Some(value)),
            None => (what, None),
        };
        if let Some(at) = at {
            let lasting = || duration(value.ok_or("for how long?")?);
            let what = match name {
                "stall" => Mishap::Stall(lasting()?),
                "blackhole" => Mishap::Blackhole(lasting()?),
                "reboot" => Mishap::Reboot(lasting()?),
                "unplug" => Mishap::Unplug(lasting()?),
                "reset" if value.is_none() => Mishap::Reset,
                _ => return Err("no such fault at a set time".into()),
            };
            self.timed.push(TimedFault { at, what });
            return Ok(());
        }
        let value = value.ok_or("a value or a time is missing")?;
        if name == "chunk" {
            self.chunk = Some(chunk(value)?);
            return Ok(());
        }
        let share = match name {
            "drop" => &mut self.drop,
            "flip" => &mut self.flip,
            "cut" => &mut self.cut,
            "repeat" => &mut self.repeat,
            "garbage" => &mut self.garbage,
            "stall" | "blackhole" | "reboot" | "reset" | "unplug" => {
                return Err("at what time? (such as @10s)".into());
            }
            _ => return Err("no such fault".into()),
        };
        *share = value
            .parse()
            .ok()
            .filter(|share| (0.0..=1.0).contains(share))
            .ok_or("a share from 0 to 1 is wanted")?;
        Ok(())
    }

    /// Whether nothing is to go wrong.
    pub fn is_none(&self) -> bool {
        *self == Faults::default()
    }
}

fn chunk(text: &str) -> Result<RangeInclusive<usize>, String> {
    let (least, most) = text.split_once("..").unwrap_or((text, text));
    let most = most.strip_prefix('=').unwrap_or(most);
    match (least.parse(), most.parse()) {
        (Ok(least), Ok(most)) if 0 < least && least <= most => Ok(least..=most),
        _ => Err("bytes are wanted, such as 1 or 1..1448".into()),
    }
}

/// A time with its unit. The command line's own reader of times is no part of this room.
fn duration(text: &str) -> Result<Duration, String> {
    let wanted = || format!("{text:?} is no time such as 500ms, 10s or 2min");
    let unit = text
        .find(|char: char| char.is_ascii_alphabetic())
        .ok_or_else(wanted)?;
    let (number, unit) = text.split_at(unit);
    let unit_s = match unit {
        "us" => 1e-6,
        "ms" => 1e-3,
        "s" => 1.0,
        "min" => 60.0,
        "h" => 3600.0,
        _ => return Err(wanted()),
    };
    let number: f64 = number.trim().parse().map_err(|_| wanted())?;
    Duration::try_from_secs_f64(number * unit_s).map_err(|_| wanted())
}

/// What became of messages.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Losses {
    /// Messages handed over.
    pub messages: u64,
    /// Of these, left out.
    pub dropped: u64,
    /// Of these, with one wrong bit.
    pub flipped: u64,
    /// Of these, whose end is missing.
    pub cut: u64,
    /// Of these, sent twice.
    pub repeated: u64,
    /// Bytes of garbage between messages.
    pub garbage_bytes: u64,
}

impl Losses {
    /// Messages that did not go out whole and right.
    pub fn lost(&self) -> u64 {
        self.dropped + self.flipped + self.cut
    }

    /// Adds another line's.
    pub fn add(&mut self, other: &Losses) {
        self.messages += other.messages;
        self.dropped += other.dropped;
        self.flipped += other.flipped;
        self.cut += other.cut;
        self.repeated += other.repeated;
        self.garbage_bytes += other.garbage_bytes;
    }
}

impl fmt::Display for Losses {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{} lost on purpose ({} left out, {} with a wrong bit, {} cut short), {} sent twice, \
             {} bytes of garbage",
            self.lost(),
            self.dropped,
            self.flipped,
            self.cut,
            self.repeated,
            self.garbage_bytes
        )
    }
}

/// The damage of one line to its messages. The same seed and the same messages give the same bytes.
#[derive(Clone, Debug)]
pub struct Damage {
    faults: Faults,
    random: ChaCha8Rng,
    losses: Losses,
}

impl Damage {
    /// The damage of line number `line`.
    pub fn new(faults: &Faults, seed: u64, line: u64) -> Damage {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        random.set_stream(line);
        Damage {
            faults: faults.clone(),
            random,
            losses: Losses::default(),
        }
    }

    /// Appends what goes over the line in place of `message`. At most one of dropped, flipped and
    /// cut happens to a message, and none of them to one that is sent twice. Whether it goes whole.
    pub fn message(&mut self, message: &[u8], out: &mut Vec<u8>) -> bool {
        self.losses.messages += 1;
        if self.happens(self.faults.garbage) {
            let count = 1 + self.below(MOST_GARBAGE);
            let start = out.len();
            out.resize(start + count as usize, 0);
            self.random
                .fill_bytes(out.get_mut(start..).unwrap_or_default());
            self.losses.garbage_bytes += count;
        }
        if self.happens(self.faults.drop) {
            self.losses.dropped += 1;
            false
        } else if self.happens(self.faults.flip) && !message.is_empty() {
            let bit = self.below(message.len() as u64 * 8);
            let start = out.len();
            out.extend_from_slice(message);
            if let Some(byte) = out.get_mut(start + bit as usize / 8) {
                *byte ^= 1 << (bit % 8);
            }
            self.losses.flipped += 1;
            false
        } else if self.happens(self.faults.cut) && message.len() > 1 {
            let kept = 1 + self.below(message.len() as u64 - 1);
            out.extend_from_slice(message.get(..kept as usize).unwrap_or_default());
            self.losses.cut += 1;
            false
        } else {
            out.extend_from_slice(message);
            if self.happens(self.faults.repeat) {
                out.extend_from_slice(message);
                self.losses.repeated += 1;
            }
            true
        }
    }

    /// Counts messages that were taken over but never went out whole as left out.
    pub fn lose(&mut self, messages: u64) {
        self.losses.dropped += messages;
    }

    /// How many of `waiting` bytes are to be written in the next piece.
    pub fn piece(&mut self, waiting: usize) -> usize {
        let Some((least, most)) = self.faults.chunk.as_ref().map(|c| (*c.start(), *c.end())) else {
            return waiting;
        };
        let extra = self.below((most - least) as u64 + 1);
        waiting.min(least + extra as usize)
    }

    /// What became of the messages so far.
    pub fn losses(&self) -> Losses {
        self.losses
    }

    fn happens(&mut self, share: f64) -> bool {
        // 53 bits, the precision of f64, from 0 up to but without 1.
        share > 0.0 && ((self.random.next_u64() >> 11) as f64) < share * (1u64 << 53) as f64
    }

    /// A number below `bound`; the bias of the remainder is below 1e-12 for what is asked here.
    fn below(&mut self, bound: u64) -> u64 {
        self.random.next_u64() % bound.max(1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_fault_is_read() {
        let text = "drop=0.001,flip=0.002,cut=0.003,repeat=0.004,garbage=0.005,chunk=1..1448,\
                    reboot=5s@40s,stall=2s@10s,reset@20s,blackhole=1.5s@30s,stall=10ms@2min";
        let faults: Faults = text.parse().unwrap();
        let shares = [
            faults.drop,
            faults.flip,
            faults.cut,
            faults.repeat,
            faults.garbage,
        ];
        assert_eq!(shares, [0.001, 0.002, 0.003, 0.004, 0.005]);
        assert_eq!(faults.chunk, Some(1..=1448));
        let seconds = Duration::from_secs;
        let timed: Vec<_> = faults.timed.iter().map(|f| (f.at, f.what)).collect();
        let due = [
            (seconds(10), Mishap::Stall(seconds(2))),
            (seconds(20), Mishap::Reset),
            (seconds(30), Mishap::Blackhole(Duration::from_millis(1500))),
            (seconds(40), Mishap::Reboot(seconds(5))),
            (seconds(120), Mishap::Stall(Duration::from_millis(10))),
        ];
        assert_eq!(timed, due);
        assert!("".parse::<Faults>().unwrap().is_none());
        for text in [
            "drop",
            "drop=2",
            "drop=nan",
            "chunk=0",
            "chunk=9..3",
            "stall=2s",
            "stall@2s",
            "reset=1s@2s",
            "reset",
            "smoke=1",
            "smoke@1s",
            "stall=2@1s",
            "stall=-2s@1s",
        ] {
            let error = text.parse::<Faults>().unwrap_err().to_string();
            assert!(error.starts_with(&format!("{text:?}: ")), "{error}");
        }
    }

    /// The damage is undone by hand, message by message, and must add up to the account.
    #[test]
    fn the_account_is_exact() {
        let faults: Faults = "drop=0.1,flip=0.1,cut=0.1,repeat=0.1,garbage=0.2"
            .parse()
            .unwrap();
        let mut damage = Damage::new(&faults, 7, 3);
        let mut seen = Losses::default();
        for number in 0..5000u32 {
            let message = [&number.to_be_bytes()[..], &[0x55; 96]].concat();
            let before = damage.losses();
            let mut out = Vec::new();
            damage.message(&message, &mut out);
            let garbage = (damage.losses().garbage_bytes - before.garbage_bytes) as usize;
            assert!(garbage <= 64);
            let sent = &out[garbage..];
            seen.messages += 1;
            seen.garbage_bytes += garbage as u64;
            let wrong_bits = |sent: &[u8]| {
                let pairs = sent.iter().zip(&message);
                pairs.map(|(a, b)| (a ^ b).count_ones()).sum::<u32>()
            };
            match sent.len() {
                0 => seen.dropped += 1,
                100 if wrong_bits(sent) == 0 => {}
                100 if wrong_bits(sent) == 1 => seen.flipped += 1,
                200 => {
                    assert_eq!(sent, [&message[..], &message].concat());
                    seen.repeated += 1;
                }
                length => {
                    assert!(length < 100 && wrong_bits(sent) == 0);
                    seen.cut += 1;
                }
            }
        }
        assert_eq!(seen, damage.losses());
        // Ten per cent of what is left, within four standard deviations.
        for (count, due) in [
            (seen.dropped, 500.0),
            (seen.flipped, 450.0),
            (seen.cut, 405.0),
        ] {
            assert!((count as f64 - due).abs() < 90.0, "{seen}");
        }
        assert_eq!(seen.lost(), seen.dropped + seen.flipped + seen.cut);
    }

    #[test]
    fn the_same_seed_does_the_same_damage() {
        let faults: Faults = "drop=0.3,garbage=0.3,chunk=2..9".parse().unwrap();
        let run = |seed, line| {
            let mut damage = Damage::new(&faults, seed, line);
            let mut out = Vec::new();
            let pieces: Vec<usize> = (0..100)
                .map(|_| {
                    damage.message(b"message", &mut out);
                    damage.piece(1000)
                })
                .collect();
            (out, pieces)
        };
        assert_eq!(run(1, 1), run(1, 1));
        assert_ne!(run(1, 1), run(1, 2));
        assert_ne!(run(1, 1), run(2, 1));
        let pieces = run(1, 1).1;
        assert_eq!(pieces.iter().min(), Some(&2));
        assert_eq!(pieces.iter().max(), Some(&9));
        assert_eq!(Damage::new(&Faults::default(), 1, 1).piece(1000), 1000);
        assert_eq!(Damage::new(&faults, 1, 1).piece(1), 1);
    }
}
