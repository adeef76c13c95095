//! Cuts a byte stream into replies, and finds them again after bytes were lost.
//!
//! There is no mark at which a reply could be found: only a header that is expected, its length and
//! its sum. At each place with an expected header and enough bytes the sum is tested; where it holds
//! the reply goes out and the search jumps over it, else it moves on by one byte. Of a stream that
//! loses 1 % of its bytes this keeps 99.99 % of the whole replies, where collecting and discarding
//! keeps 82 %.

use super::command::{Command, LONGEST_REPLY};
use super::packet::Packet;
use super::wire_time_s;
use crate::link::HostInstant;
use std::collections::VecDeque;

/// A reply with its place and its time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Arrived {
    /// The reply.
    pub packet: Packet,
    /// Place of its first byte in the stream.
    pub offset: u64,
    /// When its last byte had come.
    pub at: HostInstant,
}

/// What the framer has seen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FramerCounts {
    /// Bytes fed.
    pub bytes: u64,
    /// Replies found.
    pub packets: u64,
    /// Bytes that belong to no reply.
    pub skipped: u64,
    /// Times the sum was wrong where a reply should have begun.
    pub bad_sums: u64,
}

/// Beyond its time on the line, how long the rest of a reply is waited for before the search looks
/// past it, ns: longer than a USB adapter holds bytes back.
const TAIL_GRACE_NS: i64 = 20_000_000;

/// Read bytes that are kept before the buffer is moved together.
const COMPACT: usize = 4096;

/// Cuts a byte stream into replies.
///
/// Bytes come by [`Framer::feed`] in any pieces; [`Framer::next`] gives the replies that are
/// complete. The same pieces with the same times give the same replies.
#[derive(Clone, Debug)]
pub struct Framer {
    expected: Vec<Command>,
    baud: u32,
    buffer: Vec<u8>,
    /// First byte of the buffer that is not used up.
    start: usize,
    /// Place of the buffer's first byte in the stream.
    base: u64,
    /// The pieces that the unused bytes came in: place of the end, time.
    pieces: VecDeque<(u64, HostInstant)>,
    /// Whether the search stands where a reply should begin.
    in_step: bool,
    /// The newest time known, ns on the monotonic clock.
    now_raw_ns: i64,
    counts: FramerCounts,
}

impl Framer {
    /// A framer that expects nothing yet.
    pub fn new(baud: u32) -> Framer {
        Framer {
            expected: Vec::new(),
            baud,
            buffer: Vec::new(),
            start: 0,
            base: 0,
            pieces: VecDeque::new(),
            in_step: true,
            now_raw_ns: i64::MIN,
            counts: FramerCounts::default(),
        }
    }

    /// A framer of a session with a unit, live or recorded: it expects what every session asks, and
    /// the replies of `commands`.
    pub fn of_session(baud: u32, commands: &[Command]) -> Framer {
        let mut framer = Framer::new(baud);
        framer.expect(&[
            Command::SetContinuous,
            Command::Firmware,
            Command::SerialNumber,
            Command::ReadEepromChecked,
            Command::WriteEepromChecked,
        ]);
        for command in commands {
            framer.expect_also(*command);
        }
        framer
    }

    /// Sets which replies are looked for. Fewer are better: any byte that looks like an expected
    /// header costs a test, and one test in 65536 holds by chance.
    pub fn expect(&mut self, commands: &[Command]) {
        self.expected.clear();
        let framed = commands.iter().filter(|c| !c.words().is_empty());
        self.expected.extend(framed);
    }

    /// Adds one to what is looked for.
    pub fn expect_also(&mut self, command: Command) {
        if !self.expected.contains(&command) && !command.words().is_empty() {
            self.expected.push(command);
        }
    }

    /// Sets the speed of the line, which says how long a reply's rest may take.
    pub fn set_baud(&mut self, baud: u32) {
        self.baud = baud;
    }

    /// What has been seen.
    pub fn counts(&self) -> FramerCounts {
        self.counts
    }

    /// Bytes that wait for their rest.
    pub fn pending(&self) -> usize {
        self.buffer.len() - self.start
    }

    /// Forgets what waits for its rest: the line was opened anew. It counts as skipped.
    pub fn clear(&mut self) {
        self.counts.skipped += self.pending() as u64;
        self.base += self.buffer.len() as u64;
        self.buffer.clear();
        self.start = 0;
        self.pieces.clear();
        self.in_step = true;
    }

    /// Takes bytes that had come by `at`.
    pub fn feed(&mut self, bytes: &[u8], at: HostInstant) {
        if bytes.is_empty() {
            return;
        }
        self.now_raw_ns = self.now_raw_ns.max(at.raw_ns);
        if self.start > COMPACT {
            self.buffer.drain(..self.start);
            self.base += self.start as u64;
            self.start = 0;
        }
        self.buffer.extend_from_slice(bytes);
        self.counts.bytes += bytes.len() as u64;
        let end = self.base + self.buffer.len() as u64;
        self.pieces.push_back((end, at));
    }

    /// Says that it is `now`, so that a rest which does not come is not waited for without end.
    pub fn tell_time(&mut self, now: HostInstant) {
        self.now_raw_ns = self.now_raw_ns.max(now.raw_ns);
    }

    /// The next reply that is complete.
    #[allow(clippy::should_implement_trait)]
    pub fn next(&mut self) -> Option<Arrived> {
        loop {
            match self.test(self.start) {
                Test::Reply(packet) => return Some(self.take(packet)),
                Test::Nothing { wrong_sum } => {
                    self.counts.bad_sums += u64::from(wrong_sum && self.in_step);
                    self.in_step = false;
                    self.skip(1);
                }
                Test::Incomplete if self.start == self.buffer.len() => return None,
                Test::Incomplete => {
                    // Its rest may be lost. After a while what lies behind it is looked at; what
                    // waits is given up only for a reply that was found.
                    if !self.overdue() {
                        return None;
                    }
                    let found =
                        (self.start + 1..self.buffer.len()).find_map(|at| match self.test(at) {
                            Test::Reply(packet) => Some((at, packet)),
                            _ => None,
                        });
                    let (at, packet) = found?;
                    self.skip(at - self.start);
                    return Some(self.take(packet));
                }
            }
        }
    }

    /// Whether the bytes at `at` are a reply that is expected.
    fn test(&self, at: usize) -> Test {
        let rest = self.buffer.get(at..).unwrap_or_default();
        let Some(header) = rest.first() else {
            return Test::Incomplete;
        };
        let expected = self.expected.iter().find(|c| c.byte() == *header);
        let Some(command) = expected else {
            return Test::Nothing { wrong_sum: false };
        };
        match rest.get(..command.reply_length()) {
            None => Test::Incomplete,
            Some(bytes) => match Packet::decode(bytes) {
                Ok(packet) => Test::Reply(packet),
                Err(_) => Test::Nothing { wrong_sum: true },
            },
        }
    }

    /// Whether the rest of the reply that should stand first has been waited for long enough.
    fn overdue(&self) -> bool {
        let place = self.base + self.start as u64;
        let first = self.pieces.iter().find(|(end, _)| *end > place);
        let limit_ns = (wire_time_s(LONGEST_REPLY, self.baud) * 1e9) as i64 + TAIL_GRACE_NS;
        first.is_some_and(|(_, at)| self.now_raw_ns.saturating_sub(at.raw_ns) > limit_ns)
    }

    fn take(&mut self, packet: Packet) -> Arrived {
        let offset = self.base + self.start as u64;
        self.start += packet.command().reply_length();
        let end = self.base + self.start as u64;
        while self.pieces.front().is_some_and(|(piece, _)| *piece < end) {
            self.pieces.pop_front();
        }
        let at = self.pieces.front().map_or(HostInstant::default(), |p| p.1);
        if self.pieces.front().is_some_and(|(piece, _)| *piece == end) {
            self.pieces.pop_front();
        }
        self.in_step = true;
        self.counts.packets += 1;
        Arrived { packet, offset, at }
    }

    fn skip(&mut self, bytes: usize) {
        self.start += bytes;
        self.counts.skipped += bytes as u64;
        let place = self.base + self.start as u64;
        while self.pieces.front().is_some_and(|(end, _)| *end <= place) {
            self.pieces.pop_front();
        }
    }
}

enum Test {
    Reply(Packet),
    Incomplete,
    Nothing { wrong_sum: bool },
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gx1::packet;
    use crate::record::Stamp;
    use proptest::prelude::*;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::{Rng, SeedableRng};

    const STREAMED: Command = Command::StabilisedEulerAccelRate;

    fn at(raw_ns: i64) -> HostInstant {
        HostInstant {
            utc: Stamp::from_ns(raw_ns),
            raw_ns,
        }
    }

    fn framer(commands: &[Command]) -> Framer {
        let mut framer = Framer::new(38_400);
        framer.expect(commands);
        framer
    }

    fn words(rng: &mut ChaCha8Rng, command: Command, ticks: u16) -> Vec<u16> {
        let mut words: Vec<u16> = command
            .words()
            .iter()
            .map(|_| rng.next_u32() as u16)
            .collect();
        *words.last_mut().unwrap() = ticks;
        words
    }

    struct Damaged {
        kept: usize,
        whole: usize,
        patched: usize,
        wrong: usize,
    }

    /// Sends packets over a line that loses, flips and adds bytes, and counts exactly.
    fn damaged(packets: usize, lost: f64, flipped: f64, added: f64, seed: u64) -> Damaged {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let share = |rng: &mut ChaCha8Rng| f64::from(rng.next_u32()) / 4_294_967_296.0;
        let mut framer = framer(&[STREAMED]);
        // Place in the damaged stream and content of the packets that came through whole.
        let mut whole = std::collections::HashMap::new();
        // A packet may lose the end of its sum to a header of the same value and still be right.
        let mut contents = std::collections::HashSet::new();
        let mut result = Damaged {
            kept: 0,
            whole: 0,
            patched: 0,
            wrong: 0,
        };
        let mut fed = 0u64;
        let mut taken = 0u64;
        for k in 0..packets {
            let words = words(&mut rng, STREAMED, (k * 2) as u16);
            let bytes = packet::encode(STREAMED, &words).unwrap();
            contents.insert(words.clone());
            let mut sent = Vec::new();
            let mut untouched = true;
            for byte in &bytes {
                if share(&mut rng) < lost {
                    untouched = false;
                    continue;
                }
                if !sent.is_empty() && share(&mut rng) < added {
                    sent.push(rng.next_u32() as u8);
                    untouched = false;
                }
                let flip = share(&mut rng) < flipped;
                untouched &= !flip;
                sent.push(if flip {
                    byte ^ (1 << (rng.next_u32() % 8))
                } else {
                    *byte
                });
            }
            if untouched {
                whole.insert(fed, words);
                result.whole += 1;
            }
            // In pieces of any size, as an adapter hands them over.
            for piece in sent.chunks(1 + (rng.next_u32() % 40) as usize) {
                framer.feed(piece, at(k as i64 * 10_000_000));
                fed += piece.len() as u64;
                while let Some(found) = framer.next() {
                    taken += found.packet.command().reply_length() as u64;
                    match whole.remove(&found.offset) {
                        Some(words) if words == found.packet.words() => result.kept += 1,
                        _ if contents.contains(found.packet.words()) => result.patched += 1,
                        _ => result.wrong += 1,
                    }
                }
            }
        }
        // Every byte is in a reply, skipped, or waits.
        let counts = framer.counts();
        assert_eq!(counts.bytes, fed);
        assert_eq!(
            counts.packets as usize,
            result.kept + result.patched + result.wrong
        );
        assert_eq!(taken + counts.skipped + framer.pending() as u64, fed);
        result
    }

    #[test]
    fn one_percent_of_lost_bytes_costs_one_packet_in_ten_thousand() {
        let result = damaged(200_000, 0.01, 0.0, 0.0, 1);
        // 0.99^23 of the packets are whole.
        assert!(
            (150_000..168_000).contains(&result.whole),
            "{}",
            result.whole
        );
        let kept = result.kept as f64 / result.whole as f64;
        assert!(kept >= 0.9999, "{kept}");
        assert!(result.wrong <= 3, "{} wrong ones", result.wrong);
    }

    #[test]
    fn a_quiet_line_loses_nothing_and_a_bad_one_little() {
        let quiet = damaged(20_000, 0.0, 0.0, 0.0, 2);
        assert_eq!((quiet.kept, quiet.wrong), (20_000, 0));
        let flipped = damaged(100_000, 0.0, 0.001, 0.0, 3);
        assert!(flipped.kept as f64 >= 0.9999 * flipped.whole as f64);
        let bad = damaged(100_000, 0.01, 0.01, 0.01, 4);
        assert!(bad.kept as f64 >= 0.9999 * bad.whole as f64);
        // Two flips that cancel in the sum pass; the search adds few of its own.
        assert!(bad.wrong < 200, "{}", bad.wrong);
    }

    #[test]
    fn a_reply_may_come_byte_by_byte_and_is_stamped_with_its_last() {
        let bytes = packet::encode(Command::StabilisedEuler, &[1, 2, 3, 4]).unwrap();
        let mut framer = framer(&[Command::StabilisedEuler]);
        for (k, byte) in bytes.iter().enumerate() {
            assert_eq!(framer.next(), None);
            framer.feed(&[*byte], at(k as i64));
        }
        let found = framer.next().unwrap();
        assert_eq!(found.at, at(bytes.len() as i64 - 1));
        assert_eq!(found.packet.words(), [1, 2, 3, 4]);
        // Two in one piece have its time.
        framer.feed(&[bytes.clone(), bytes].concat(), at(100));
        assert_eq!(framer.next().unwrap().at, at(100));
        let second = framer.next().unwrap();
        assert_eq!((second.at, second.offset), (at(100), 22));
        assert_eq!(framer.counts().skipped, 0);
    }

    #[test]
    fn a_lost_tail_is_waited_for_and_then_looked_past() {
        let long = packet::encode(Command::StabilisedQuaternionVectors, &[7; 14]).unwrap();
        let short = packet::encode(Command::SetContinuous, &[0, 9]).unwrap();
        let expected = [Command::StabilisedQuaternionVectors, Command::SetContinuous];
        // The rest never comes; the short reply behind it is found when the wait is over.
        let mut waiting = framer(&expected);
        waiting.feed(&long[..12], at(0));
        waiting.feed(&short, at(5_000_000));
        assert_eq!(waiting.next(), None);
        waiting.tell_time(at(27_000_000));
        assert_eq!(waiting.next(), None);
        waiting.tell_time(at(29_000_000));
        let found = waiting.next().unwrap();
        assert_eq!(found.packet.bytes(), short);
        assert_eq!(found.at, at(5_000_000));
        assert_eq!(waiting.counts().skipped, 12);
        // A rest that comes late, with nothing behind it, is not lost.
        let mut late = framer(&expected);
        late.feed(&long[..12], at(0));
        late.tell_time(at(2_000_000_000));
        assert_eq!(late.next(), None);
        late.feed(&long[12..], at(2_000_000_000));
        assert_eq!(late.next().unwrap().packet.bytes(), long);
    }

    #[test]
    fn interleaved_replies_of_several_commands() {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let commands = [
            Command::StabilisedEuler,
            Command::InstantVectors,
            Command::Temperature,
        ];
        let mut framer = framer(&commands);
        let mut sent = Vec::new();
        for k in 0..3000 {
            let command = commands[k % 3];
            let words = words(&mut rng, command, k as u16);
            framer.feed(&packet::encode(command, &words).unwrap(), at(k as i64));
            sent.push(words);
        }
        for words in sent {
            assert_eq!(framer.next().unwrap().packet.words(), words);
        }
        assert_eq!(framer.next(), None);
        assert_eq!(framer.counts().bad_sums, 0);
    }

    #[test]
    fn the_first_bad_sum_ends_nothing_and_is_counted() {
        let good = packet::encode(Command::StabilisedEuler, &[1, 2, 3, 4]).unwrap();
        let mut bad = good.clone();
        bad[10] ^= 1;
        let mut framer = framer(&[Command::StabilisedEuler]);
        framer.feed(&[good.clone(), bad, good].concat(), at(0));
        assert_eq!(framer.next().unwrap().offset, 0);
        assert_eq!(framer.next().unwrap().offset, 22);
        assert_eq!(framer.counts().bad_sums, 1);
        assert_eq!(framer.counts().skipped, 11);
    }

    #[test]
    fn a_line_opened_anew_begins_anew() {
        let bytes = packet::encode(Command::StabilisedEuler, &[1, 2, 3, 4]).unwrap();
        let mut framer = framer(&[Command::StabilisedEuler]);
        framer.feed(&bytes[..6], at(0));
        assert_eq!(framer.next(), None);
        framer.clear();
        framer.feed(&bytes, at(1));
        let found = framer.next().unwrap();
        assert_eq!((found.offset, found.at), (6, at(1)));
        assert_eq!(framer.counts().skipped, 6);
    }

    proptest! {
        #[test]
        fn any_bytes_in_any_pieces(
            bytes in prop::collection::vec(prop_oneof![Just(0x31u8), Just(0x0E), any::<u8>()], 0..300),
            cuts in prop::collection::vec((1usize..30, 0i64..40_000_000), 1..40),
        ) {
            let mut framer = framer(Command::ALL);
            let (mut rest, mut now, mut taken) = (&bytes[..], 0, 0);
            for (cut, wait) in cuts.iter().cycle() {
                if rest.is_empty() {
                    break;
                }
                let (piece, later) = rest.split_at((*cut).min(rest.len()));
                now += wait;
                framer.feed(piece, at(now));
                rest = later;
                while let Some(found) = framer.next() {
                    let place = found.offset as usize;
                    let length = found.packet.command().reply_length();
                    taken += length;
                    prop_assert_eq!(&bytes[place..place + length], found.packet.bytes());
                }
            }
            prop_assert_eq!(taken as u64 + framer.counts().skipped + framer.pending() as u64, bytes.len() as u64);
        }
    }
}
