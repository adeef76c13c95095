//! Framing of SICK's CoLa protocol in its two dialects.
//!
//! - CoLa A: `02`, text, `03`.
//! - CoLa B: four times `02`, a big-endian u32 length, that many bytes, one byte XOR of them.
//!
//! CoLa B escapes nothing, so that its start mark also occurs inside telegrams (TiM scans are full
//! of `00 02 00 02`). A telegram is therefore taken only if its length is sane, it begins with one
//! of the protocol's verbs and its XOR is right; after a fault the next place where all three hold
//! is searched byte by byte. One byte of XOR lets every 256th cut telegram pass, so that one into
//! which another reaches is not taken either, nor waited for. The dialect is told telegram by
//! telegram: a device may change it.

/// Start of text; four of them open a telegram in CoLa B.
pub const STX: u8 = 0x02;
/// End of text: closes a telegram in CoLa A.
pub const ETX: u8 = 0x03;

/// The longest body taken for sane in CoLa B: twice what five echoes with remissions at the finest
/// (4-fold interlaced) resolution need.
pub const MAX_BINARY_BODY: usize = 1 << 17;
/// The same in CoLa A.
pub const MAX_TEXT_BODY: usize = 1 << 18;

/// The shortest body: `sFA` and its code.
const MIN_BODY: usize = 5;
/// From this length on a frame that seems to end in the first bytes of the next one waits for the
/// rest of them. A reply is shorter, and it may be the last for a while.
const LONG_FRAME: usize = 64;
/// Bytes before the body in CoLa B.
const BINARY_HEADER: usize = 8;

/// A dialect of the protocol.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dialect {
    /// CoLa A: values as hexadecimal text separated by blanks.
    Text,
    /// CoLa B: packed big-endian values.
    Binary,
}

/// One whole telegram, borrowed from the framer's buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Telegram<'a> {
    /// Its dialect.
    pub dialect: Dialect,
    /// Offset of its first byte in the stream.
    pub offset: u64,
    /// What the frame holds, from the verb on.
    pub body: &'a [u8],
}

impl<'a> Telegram<'a> {
    /// The verb, such as `sSN`.
    pub fn verb(&self) -> &'a [u8] {
        self.body.get(..3).unwrap_or_default()
    }

    /// The command's name, such as `LMDscandata`; empty for `sFA`.
    pub fn name(&self) -> &'a [u8] {
        match self.body.get(3..) {
            Some([b' ', rest @ ..]) if self.verb() != b"sFA" => {
                rest.split(|byte| *byte == b' ').next().unwrap_or_default()
            }
            _ => &[],
        }
    }

    /// Offset of the frame's last byte in the stream: with it the telegram is there.
    pub fn last_offset(&self) -> u64 {
        let before = match self.dialect {
            Dialect::Text => 1,
            Dialect::Binary => BINARY_HEADER,
        };
        self.offset + (before + self.body.len()) as u64
    }

    /// What follows the name: in CoLa B the packed values without the separating blank, in CoLa A
    /// the tokens, each with the blank before it.
    pub fn arguments(&self) -> &'a [u8] {
        let head = match self.name() {
            [] => 3,
            name => 4 + name.len(),
        };
        let rest = self.body.get(head..).unwrap_or_default();
        match (self.dialect, rest) {
            (Dialect::Binary, [b' ', values @ ..]) => values,
            _ => rest,
        }
    }
}

/// What was wrong with bytes that are not part of a good telegram.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Cause {
    /// Bytes before the first telegram: the recording starts in mid-telegram.
    #[error("the stream starts in mid-telegram")]
    LeadIn,
    /// The stream ends before the telegram does.
    #[error("the stream ends in mid-telegram")]
    Tail,
    /// The next telegram begins before this one has ended.
    #[error("a telegram is cut short")]
    CutShort,
    /// The XOR is wrong.
    #[error("wrong checksum: {sent:02X} sent, XOR of the telegram is {computed:02X}")]
    Xor {
        /// The byte after the body.
        sent: u8,
        /// What the body gives.
        computed: u8,
    },
    /// A length that no telegram has.
    #[error("a telegram claims a length of {0} bytes")]
    Length(u32),
    /// Bytes that begin no telegram.
    #[error("bytes that belong to no telegram")]
    Noise,
}

impl Cause {
    /// Whether a recording that was merely switched on or off at that moment shows it.
    pub fn is_edge(self) -> bool {
        matches!(self, Cause::LeadIn | Cause::Tail)
    }
}

/// Bytes passed over.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Skipped {
    /// Offset of the first of them in the stream.
    pub offset: u64,
    /// How many they are.
    pub bytes: u64,
    /// What was wrong with the first.
    pub cause: Cause,
}

/// What the framer found next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Event<'a> {
    /// A telegram whose frame is right.
    Telegram(Telegram<'a>),
    /// Bytes that are not part of one.
    Skipped(Skipped),
}

/// What the bytes at the framer's position are, as far as they have arrived.
enum Look {
    /// Too few bytes to tell; the first so many need not be searched again.
    Wait { searched: usize },
    /// A good telegram: where its body begins and ends, and its frame's length.
    Frame {
        dialect: Dialect,
        body: usize,
        end: usize,
        frame: usize,
    },
    /// A telegram that is bad as a whole; the next one begins `frame` bytes further on.
    Bad { frame: usize, cause: Cause },
    /// An end of line, as text logs put between telegrams.
    Line,
    /// No telegram begins here.
    Not(Cause),
}

/// Too few bytes to tell, and none of them searched.
const WAIT: Look = Look::Wait { searched: 0 };

/// What a frame's bytes hold besides its own telegram.
enum Inside {
    Nothing,
    /// Another telegram.
    Another,
    /// Perhaps one that begins at `at`: it has not all come.
    Perhaps {
        at: usize,
    },
}

/// Whether a telegram of CoLa B begins at some place.
enum Begins {
    No,
    /// Too few bytes to tell.
    Perhaps,
    /// Yes, and its frame is `end` bytes long.
    Yes {
        end: usize,
    },
}

/// Cuts a byte stream, fed in chunks of any size, into telegrams.
///
/// What comes out does not depend on the chunks. In steady state nothing is allocated.
#[derive(Debug, Default)]
pub struct Framer {
    buffer: Vec<u8>,
    /// Where in `buffer` the bytes begin that are still to be looked at.
    start: usize,
    /// Offset of `buffer[0]` in the stream.
    base: u64,
    /// How many bytes from `start` have been looked at, in CoLa A for the telegram's end, in CoLa B
    /// for another's beginning.
    searched: usize,
    ended: bool,
    gap: Option<Skipped>,
    telegrams: u64,
}

impl Framer {
    /// A framer at the start of a stream.
    pub fn new() -> Framer {
        Framer::default()
    }

    /// A framer of a stream whose first byte has this offset.
    pub fn at(offset: u64) -> Framer {
        Framer {
            base: offset,
            ..Framer::default()
        }
    }

    /// Takes the next bytes of the stream.
    pub fn feed(&mut self, chunk: &[u8]) {
        if self.start > 0 {
            self.buffer.copy_within(self.start.., 0);
            self.buffer.truncate(self.buffer.len() - self.start);
            self.base += self.start as u64;
            self.start = 0;
        }
        self.buffer.extend_from_slice(chunk);
    }

    /// Says that no more bytes will come; [`Framer::next`] then gives up waiting for the rest of an
    /// incomplete telegram.
    pub fn end(&mut self) {
        self.ended = true;
    }

    /// Telegrams found so far.
    pub fn telegrams(&self) -> u64 {
        self.telegrams
    }

    /// Bytes taken so far.
    pub fn bytes(&self) -> u64 {
        self.base + self.buffer.len() as u64
    }

    /// The next telegram or skipped piece; none until more bytes are fed.
    #[allow(clippy::should_implement_trait)] // it lends from the buffer
    pub fn next(&mut self) -> Option<Event<'_>> {
        loop {
            let offset = self.base + self.start as u64;
            match self.look() {
                Look::Wait { searched } if !self.ended => {
                    self.searched = searched;
                    return None;
                }
                Look::Wait { .. } if self.start == self.buffer.len() => {
                    return self.gap.take().map(Event::Skipped);
                }
                Look::Wait { .. } => self.skip_byte(Cause::Tail),
                Look::Line if self.gap.is_none() => self.consume(1),
                Look::Line => self.skip_byte(Cause::Noise),
                Look::Not(cause) => self.skip_byte(cause),
                Look::Bad { .. } | Look::Frame { .. } if self.gap.is_some() => {
                    return self.gap_before_telegram().map(Event::Skipped);
                }
                Look::Bad { frame, cause } => {
                    self.consume(frame);
                    return Some(Event::Skipped(Skipped {
                        offset,
                        bytes: frame as u64,
                        cause,
                    }));
                }
                Look::Frame {
                    dialect,
                    body,
                    end,
                    frame,
                } => {
                    let first = self.start;
                    self.consume(frame);
                    self.telegrams += 1;
                    let body = self.buffer.get(first + body..first + end)?;
                    return Some(Event::Telegram(Telegram {
                        dialect,
                        offset,
                        body,
                    }));
                }
            }
        }
    }

    fn consume(&mut self, bytes: usize) {
        self.start += bytes;
        self.searched = 0;
    }

    /// Adds the byte here, and those after it that cannot begin a telegram, to the gap.
    fn skip_byte(&mut self, cause: Cause) {
        let offset = self.base + self.start as u64;
        let rest = self.buffer.get(self.start + 1..).unwrap_or_default();
        let bytes = 1 + rest.iter().take_while(|byte| **byte != STX).count();
        self.consume(bytes);
        let gap = self.gap.get_or_insert(Skipped {
            offset,
            bytes: 0,
            cause,
        });
        gap.bytes += bytes as u64;
    }

    /// The gap, now that a telegram is known to follow it.
    fn gap_before_telegram(&mut self) -> Option<Skipped> {
        let mut gap = self.gap.take()?;
        gap.cause = match gap.cause {
            Cause::Noise if self.telegrams == 0 && gap.bytes <= MAX_BINARY_BODY as u64 => {
                Cause::LeadIn
            }
            Cause::Tail => Cause::CutShort,
            cause => cause,
        };
        Some(gap)
    }

    fn look(&self) -> Look {
        match self.buffer.get(self.start..).unwrap_or_default() {
            [] | [STX] => WAIT,
            rest @ [STX, STX, ..] => self.look_binary(rest),
            rest @ [STX, b's', ..] => self.look_text(rest),
            [b'\r' | b'\n', ..] => Look::Line,
            _ => Look::Not(Cause::Noise),
        }
    }

    fn look_binary(&self, rest: &[u8]) -> Look {
        if !begins_binary(rest) {
            return Look::Not(Cause::Noise);
        }
        let Some((&[_, _, _, _, l3, l2, l1, l0], after)) = rest.split_first_chunk() else {
            return WAIT;
        };
        let length = u32::from_be_bytes([l3, l2, l1, l0]);
        if !is_sane_length(length) {
            return Look::Not(Cause::Length(length));
        }
        match begins_with_verb(after) {
            None => return WAIT,
            Some(false) => return Look::Not(Cause::Noise),
            Some(true) => {}
        }
        let end = BINARY_HEADER + length as usize;
        let searched = match self.look_inside(rest, end + 1) {
            Inside::Another => return Look::Not(Cause::CutShort),
            Inside::Perhaps { at } if !self.ended => return Look::Wait { searched: at },
            Inside::Perhaps { .. } | Inside::Nothing => rest.len(),
        };
        let Some((body, after)) = after.split_at_checked(length as usize) else {
            return Look::Wait { searched };
        };
        let Some((&sent, following)) = after.split_first() else {
            return Look::Wait { searched };
        };
        let frame = end + 1;
        let computed = xor(body);
        if sent == computed {
            return Look::Frame {
                dialect: Dialect::Binary,
                body: BINARY_HEADER,
                end,
                frame,
            };
        }
        // Where another telegram (or nothing) follows, the length is right and a byte is wrong;
        // otherwise the length itself is doubtful and every byte may begin the next telegram.
        let cause = Cause::Xor { sent, computed };
        if following.len() < 4 && !self.ended {
            Look::Wait { searched }
        } else if following.is_empty() || (following.len() >= 4 && begins_binary(following)) {
            Look::Bad { frame, cause }
        } else {
            Look::Not(cause)
        }
    }

    /// Whether another telegram reaches into the first `frame` bytes of `rest`, as far as they have
    /// come: one that begins there and ends beyond, or a whole one with the right XOR.
    fn look_inside(&self, rest: &[u8], frame: usize) -> Inside {
        let from = self.searched.saturating_sub(1).max(BINARY_HEADER);
        let held = rest.get(from..frame.min(rest.len())).unwrap_or_default();
        if !may_hold_two_stx(held) {
            return Inside::Nothing;
        }
        // A short one is judged by its own bytes alone.
        let known = match rest.get(..frame) {
            Some(short) if frame < LONG_FRAME => short,
            _ => rest,
        };
        let pairs = held.windows(2).enumerate();
        for (at, _) in pairs.filter(|(_, pair)| **pair == [STX, STX]) {
            let at = from + at;
            match begins_telegram(known.get(at..).unwrap_or_default()) {
                Begins::No => {}
                Begins::Yes { end } if at + end > frame => return Inside::Another,
                Begins::Yes { end } => match rest.get(at + BINARY_HEADER..at + end) {
                    Some(whole) if xor(whole) == 0 => return Inside::Another,
                    Some(_) => {}
                    None => return Inside::Perhaps { at },
                },
                Begins::Perhaps if rest.len() >= frame && frame < LONG_FRAME => {}
                Begins::Perhaps => return Inside::Perhaps { at },
            }
        }
        Inside::Nothing
    }

    fn look_text(&self, rest: &[u8]) -> Look {
        match begins_with_verb(rest.get(1..).unwrap_or_default()) {
            None => return WAIT,
            Some(false) => return Look::Not(Cause::Noise),
            Some(true) => {}
        }
        let from = self.searched.max(1);
        let mut unseen = rest.iter().enumerate().skip(from);
        match unseen.find(|(_, byte)| matches!(**byte, STX | ETX)) {
            Some((end, &ETX)) if end <= MAX_TEXT_BODY => Look::Frame {
                dialect: Dialect::Text,
                body: 1,
                end,
                frame: end + 1,
            },
            Some((frame, _)) if frame <= MAX_TEXT_BODY => Look::Bad {
                frame,
                cause: Cause::CutShort,
            },
            None if rest.len() <= MAX_TEXT_BODY => Look::Wait {
                searched: rest.len(),
            },
            _ => Look::Not(Cause::Length(rest.len() as u32)),
        }
    }
}

/// Whether `bytes` are the start mark of CoLa B, as far as they go.
fn begins_binary(bytes: &[u8]) -> bool {
    bytes.iter().take(4).all(|byte| *byte == STX)
}

/// Whether a telegram of CoLa B begins here: mark, sane length, verb.
fn begins_telegram(bytes: &[u8]) -> Begins {
    if !begins_binary(bytes) {
        return Begins::No;
    }
    let Some((&[_, _, _, _, l3, l2, l1, l0], body)) = bytes.split_first_chunk() else {
        return Begins::Perhaps;
    };
    let length = u32::from_be_bytes([l3, l2, l1, l0]);
    match begins_with_verb(body) {
        _ if !is_sane_length(length) => Begins::No,
        None => Begins::Perhaps,
        Some(false) => Begins::No,
        Some(true) => Begins::Yes {
            end: BINARY_HEADER + length as usize + 1,
        },
    }
}

fn is_sane_length(length: u32) -> bool {
    (MIN_BODY as u32..=MAX_BINARY_BODY as u32).contains(&length)
}

/// Whether there may be two STX side by side: certainly not where this says no, which it does for
/// most telegrams, eight bytes at a time. Two of four STX in a row lie in one half of a word.
fn may_hold_two_stx(bytes: &[u8]) -> bool {
    const ONES: u64 = 0x0001_0001_0001_0001;
    const TWO_STX: u64 = ONES * (((STX as u64) << 8) | STX as u64);
    let (words, rest) = bytes.as_chunks::<8>();
    let zero_half = words.iter().fold(0, |found, word| {
        let halves = u64::from_ne_bytes(*word) ^ TWO_STX;
        found | (halves.wrapping_sub(ONES) & !halves)
    });
    zero_half & (ONES << 15) != 0 || rest.contains(&STX)
}

/// Whether a body begins with a verb of the protocol; none while too few bytes are there.
fn begins_with_verb(body: &[u8]) -> Option<bool> {
    const SECOND: &[u8] = b"RWMESA";
    const THIRD: &[u8] = b"NAIV";
    let &[first, second, third, fourth] = body.first_chunk::<4>()?;
    let refusal = [first, second, third] == *b"sFA";
    let verb = first == b's' && SECOND.contains(&second) && THIRD.contains(&third);
    Some(refusal || (verb && fourth == b' '))
}

/// XOR of all bytes, the check byte of CoLa B.
pub fn xor(bytes: &[u8]) -> u8 {
    let (words, rest) = bytes.as_chunks::<8>();
    let word = words
        .iter()
        .fold(0u64, |sum, word| sum ^ u64::from_ne_bytes(*word));
    word.to_ne_bytes()
        .iter()
        .chain(rest)
        .fold(0, |sum, byte| sum ^ byte)
}

/// Appends `body` in its dialect's frame.
pub fn frame(dialect: Dialect, body: &[u8], out: &mut Vec<u8>) {
    match dialect {
        Dialect::Text => {
            out.push(STX);
            out.extend_from_slice(body);
            out.push(ETX);
        }
        Dialect::Binary => {
            out.extend_from_slice(&[STX; 4]);
            out.extend_from_slice(&(body.len() as u32).to_be_bytes());
            out.extend_from_slice(body);
            out.push(xor(body));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// What a framer makes of a stream: each telegram's offset and body, each skipped piece.
    #[derive(Debug, PartialEq)]
    enum Found {
        Telegram(Dialect, u64, Vec<u8>),
        Skipped(Skipped),
    }

    fn cut(stream: &[u8], chunk: usize) -> Vec<Found> {
        let mut framer = Framer::new();
        let mut found = Vec::new();
        let mut drain = |framer: &mut Framer| {
            while let Some(event) = framer.next() {
                found.push(match event {
                    Event::Telegram(t) => Found::Telegram(t.dialect, t.offset, t.body.to_vec()),
                    Event::Skipped(skipped) => Found::Skipped(skipped),
                });
            }
        };
        for chunk in stream.chunks(chunk) {
            framer.feed(chunk);
            drain(&mut framer);
        }
        framer.end();
        drain(&mut framer);
        found
    }

    fn binary(body: &[u8]) -> Vec<u8> {
        let mut out = Vec::new();
        frame(Dialect::Binary, body, &mut out);
        out
    }

    fn telegram(offset: usize, body: &[u8]) -> Found {
        Found::Telegram(Dialect::Binary, offset as u64, body.to_vec())
    }

    fn skipped(offset: usize, bytes: usize, cause: Cause) -> Found {
        Found::Skipped(Skipped {
            offset: offset as u64,
            bytes: bytes as u64,
            cause,
        })
    }

    #[test]
    fn verb_name_and_arguments() {
        let parts = |dialect, body| {
            let telegram = Telegram {
                dialect,
                offset: 0,
                body,
            };
            (telegram.verb(), telegram.name(), telegram.arguments())
        };
        let event = parts(Dialect::Binary, &b"sSN LMDscandata \x00\x01 "[..]);
        assert_eq!(event, (&b"sSN"[..], &b"LMDscandata"[..], &b"\x00\x01 "[..]));
        let text = parts(Dialect::Text, &b"sRA STlms 7 0"[..]);
        assert_eq!(text, (&b"sRA"[..], &b"STlms"[..], &b" 7 0"[..]));
        let refusal = parts(Dialect::Binary, &b"sFA\x00\x0A"[..]);
        assert_eq!(refusal, (&b"sFA"[..], &b""[..], &b"\x00\x0A"[..]));
        let bare = parts(Dialect::Binary, &b"sWA EIHstCola "[..]);
        assert_eq!(bare, (&b"sWA"[..], &b"EIHstCola"[..], &b""[..]));
    }

    #[test]
    fn a_real_reply() {
        // sAN SetAccessMode 1 of an LMS511; the listing prints a wrong XOR (39) for it.
        let bytes = b"\x02\x02\x02\x02\x00\x00\x00\x13sAN SetAccessMode \x01\x38";
        assert_eq!(cut(bytes, 64), [telegram(0, &bytes[8..27])]);
    }

    #[test]
    fn start_marks_inside_a_telegram_are_no_matter() {
        let body = b"sSN LMDscandata \x02\x02\x02\x02\x00\x00\x00\x05sFA\x00\x01\x17";
        let mut stream = binary(body);
        stream.extend(binary(b"sFA\x00\x02"));
        let next = 9 + body.len();
        let expected = [telegram(0, body), telegram(next, b"sFA\x00\x02")];
        assert_eq!(cut(&stream, 3), expected);
    }

    #[test]
    fn faults_cost_only_the_bad_telegram() {
        let (first, last) = (b"sRA SCdevicestate \x01", b"sWA EIHstCola ");
        let one = binary(first);
        let end = one.len();
        let around = |middle: &[u8]| [&one[..], middle, &binary(last)].concat();

        let mut bad = binary(b"sSN LMDscandata 123456789");
        bad[20] ^= 1;
        let found = cut(&around(&bad), 7);
        assert!(
            matches!(found[1], Found::Skipped(Skipped { offset, bytes, cause: Cause::Xor { .. } })
                if offset == end as u64 && bytes == bad.len() as u64)
        );
        assert_eq!(found[2], telegram(end + bad.len(), last));

        let mut long = binary(b"sSN LMDscandata 123456789");
        long[4..8].copy_from_slice(&0x7FFF_FFFF_u32.to_be_bytes());
        let expected = [
            telegram(0, first),
            skipped(end, long.len(), Cause::Length(0x7FFF_FFFF)),
            telegram(end + long.len(), last),
        ];
        assert_eq!(cut(&around(&long), 7), expected);

        // A length too large, though sane, hides the next telegram only until the XOR is known.
        let mut doubtful = binary(b"sSN LMDscandata 123456789");
        doubtful[7] += 12;
        let found = cut(&around(&doubtful), 7);
        assert_eq!(found[2], telegram(end + doubtful.len(), last));

        // Bytes lost: the rest of the cut telegram is found missing at the end of the stream.
        let cut_short = &binary(&[b"sSN LMDscandata ", &[7; 900][..]].concat())[..300];
        let expected = [
            telegram(0, first),
            skipped(end, 300, Cause::CutShort),
            telegram(end + 300, last),
        ];
        assert_eq!(cut(&around(cut_short), 7), expected);

        let expected = [
            telegram(0, first),
            skipped(end, 5, Cause::Noise),
            telegram(end + 5, last),
        ];
        assert_eq!(cut(&around(b"\x02noi\x02"), 7), expected);
    }

    #[test]
    fn a_cut_telegram_whose_xor_fits_by_chance_costs_only_itself() {
        let (mut first, last) = (vec![0u8; 200], vec![1u8; 200]);
        first[..16].copy_from_slice(b"sSN LMDscandata ");
        let last = [b"sSN LMDscandata ", &last[..]].concat();
        // The byte that makes XOR fit what lies where the check byte should be.
        let (head, next) = (binary(&first)[..100].to_vec(), binary(&last));
        let mut stream = [&head[..], &next].concat();
        let frame = first.len() + 9;
        stream[50] = 0;
        stream[50] = xor(&stream[8..frame]);
        assert_eq!(xor(&stream[8..frame - 1]), stream[frame - 1]);
        for chunk in [1, 7, 1000] {
            let expected = [skipped(0, 100, Cause::CutShort), telegram(100, &last)];
            assert_eq!(cut(&stream, chunk), expected);
        }
        // A wrong bit makes the length reach two bytes into the next telegram, which fit as well.
        let mut long = binary(&first);
        long[7] += 2;
        let stream = [&long[..], &next, &next].concat();
        for chunk in [1, 7, 1000] {
            let found = cut(&stream, chunk);
            assert_eq!(found[0], skipped(0, long.len(), Cause::CutShort));
            assert_eq!(found.len(), 3);
        }
    }

    #[test]
    fn a_length_too_large_does_not_hold_the_next_telegrams_back() {
        let body = [b"sSN LMDscandata ", &[7; 900][..]].concat();
        let mut long = binary(&body);
        long[5] = 1;
        let mut framer = Framer::new();
        framer.feed(&[&long[..], &binary(&body)].concat());
        let event = framer.next();
        assert!(
            matches!(event, Some(Event::Skipped(skipped)) if skipped.bytes == long.len() as u64)
        );
        assert!(matches!(framer.next(), Some(Event::Telegram(_))));
    }

    #[test]
    fn a_recording_may_start_and_end_anywhere() {
        let body = b"sRA SCdevicestate \x01";
        let one = binary(body);
        let stream = [&one[9..], &one[..], &one[..11]].concat();
        let lead = one.len() - 9;
        let expected = [
            skipped(0, lead, Cause::LeadIn),
            telegram(lead, body),
            skipped(lead + one.len(), 11, Cause::Tail),
        ];
        assert_eq!(cut(&stream, 1), expected);
    }

    #[test]
    fn both_dialects_in_one_stream() {
        let stream = b"\x02sRA SCdevicestate 1\x03\r\n\x02sFA A\x03\x02sRN cut\x02sWA x\x03";
        let text = |offset, body: &[u8]| Found::Telegram(Dialect::Text, offset, body.to_vec());
        let mut framer = Framer::at(100);
        framer.feed(&stream[..]);
        let Some(Event::Telegram(first)) = framer.next() else {
            panic!("no telegram");
        };
        assert_eq!((first.offset, first.last_offset()), (100, 120));
        let mut stream = stream.to_vec();
        let end = stream.len();
        stream.extend(binary(b"sFA\x00\x0A"));
        let expected = [
            text(0, b"sRA SCdevicestate 1"),
            text(23, b"sFA A"),
            skipped(30, 8, Cause::CutShort),
            text(38, b"sWA x"),
            telegram(end, b"sFA\x00\x0A"),
        ];
        for chunk in [1, 2, 1000] {
            assert_eq!(cut(&stream, chunk), expected);
        }
    }

    /// Pieces of which streams are made: telegrams, their fragments, start marks, anything.
    fn piece() -> impl Strategy<Value = Vec<u8>> {
        let body = prop::collection::vec(prop_oneof![Just(2u8), Just(0u8), any::<u8>()], 0..90)
            .prop_map(|tail| binary(&[b"sSN X ", &tail[..]].concat()));
        prop_oneof![
            4 => body.clone(),
            1 => (body, any::<prop::sample::Index>()).prop_map(|(telegram, at)| {
                telegram[..at.index(telegram.len())].to_vec()
            }),
            1 => prop::collection::vec(any::<u8>(), 0..12),
            1 => Just(vec![2; 4]),
            1 => Just(b"\x02sRA abc 1 2\x03".to_vec()),
        ]
    }

    proptest! {
        #[test]
        fn chunks_do_not_matter_and_every_byte_is_accounted_for(
            pieces in prop::collection::vec(piece(), 0..12),
            chunk in 1usize..50,
        ) {
            let stream = pieces.concat();
            let found = cut(&stream, chunk);
            prop_assert_eq!(&found, &cut(&stream, stream.len().max(1)));
            let mut at = 0;
            for piece in &found {
                let (offset, bytes) = match piece {
                    Found::Telegram(Dialect::Binary, offset, body) => (*offset, body.len() + 9),
                    Found::Telegram(Dialect::Text, offset, body) => (*offset, body.len() + 2),
                    Found::Skipped(skipped) => (skipped.offset, skipped.bytes as usize),
                };
                let between = &stream[at..offset as usize];
                prop_assert!(between.iter().all(|byte| matches!(*byte, b'\r' | b'\n')));
                at = offset as usize + bytes;
            }
            prop_assert!(stream[at..].iter().all(|byte| matches!(*byte, b'\r' | b'\n')));
        }

        #[test]
        fn no_bytes_make_it_panic(
            stream in prop::collection::vec(any::<u8>(), 0..300),
            chunk in 1usize..50,
        ) {
            prop_assert_eq!(cut(&stream, chunk), cut(&stream, 300));
        }
    }
}
