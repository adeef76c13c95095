//! Framing of SICK's CoLa protocol in its two dialects.
//!
//! - CoLa A: `02`, text, `03`.
//! - CoLa B: four times `02`, a big-endian u32 length, that many bytes, one byte XOR of them.
//!
//! CoLa B escapes nothing, so that its start mark also occurs inside telegrams (TiM scans are full
//! of `00 02 00 02`). A telegram is therefore taken only if its length is sane, it begins with one
//! of the protocol's verbs and its XOR is right; after a fault the next place where all three hold
//! is searched byte by byte. The dialect is told telegram by telegram: a device may change it.

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
/// Bytes around the body in CoLa B.
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
    #[error("wrong XOR: {sent:02X} sent, {computed:02X} computed")]
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
    /// Too few bytes to tell.
    Wait,
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
    /// How many bytes from `start` are known to hold no end of a CoLa A telegram.
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
                Look::Wait if !self.ended => {
                    self.searched = self.buffer.len() - self.start;
                    return None;
                }
                Look::Wait if self.start == self.buffer.len() => {
                    return self.gap.take().map(Event::Skipped);
                }
                Look::Wait => self.skip_byte(Cause::Tail),
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
            [] | [STX] => Look::Wait,
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
            return Look::Wait;
        };
        let length = u32::from_be_bytes([l3, l2, l1, l0]);
        if !(MIN_BODY as u32..=MAX_BINARY_BODY as u32).contains(&length) {
            return Look::Not(Cause::Length(length));
        }
        match begins_with_verb(after) {
            None => return Look::Wait,
            Some(false) => return Look::Not(Cause::Noise),
            Some(true) => {}
        }
        let Some((body, after)) = after.split_at_checked(length as usize) else {
            return Look::Wait;
        };
        let Some((&sent, following)) = after.split_first() else {
            return Look::Wait;
        };
        let end = BINARY_HEADER + body.len();
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
            Look::Wait
        } else if following.is_empty() || (following.len() >= 4 && begins_binary(following)) {
            Look::Bad { frame, cause }
        } else {
            Look::Not(cause)
        }
    }

    fn look_text(&self, rest: &[u8]) -> Look {
        match begins_with_verb(rest.get(1..).unwrap_or_default()) {
            None => return Look::Wait,
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
            None if rest.len() <= MAX_TEXT_BODY => Look::Wait,
            _ => Look::Not(Cause::Length(rest.len() as u32)),
        }
    }
}

/// Whether `bytes` are the start mark of CoLa B, as far as they go.
fn begins_binary(bytes: &[u8]) -> bool {
    bytes.iter().take(4).all(|byte| *byte == STX)
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
