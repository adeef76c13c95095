//! SCIP 2.0 on the wire: lines, check characters, numbers in characters of 6 bits.

/// The longest reply that is taken for one: 1081 steps of two values are 6.7 kB, three echoes of
/// 1441 steps 27 kB.
pub const MAX_REPLY: usize = 64 << 10;
/// The most characters of data in a line, without the check character.
pub const BLOCK: usize = 64;
/// Milliseconds after which a time stamp begins anew: 24 bits.
pub const STAMP_BITS: u32 = 24;

/// The check character of a line.
pub fn check_character(line: &[u8]) -> u8 {
    let sum = line.iter().fold(0u8, |sum, byte| sum.wrapping_add(*byte));
    (sum & 0x3F) + 0x30
}

/// A number in characters of 6 bits, most significant first; none for other characters.
pub fn decode(characters: &[u8]) -> Option<u32> {
    characters.iter().try_fold(0u32, |value, character| {
        let bits = character.checked_sub(0x30).filter(|bits| *bits < 0x40)?;
        Some(value << 6 | u32::from(bits))
    })
}

/// Appends `value` in `count` characters; what does not fit is cut off.
pub fn encode(value: u32, count: u32, out: &mut Vec<u8>) {
    for place in (0..count).rev() {
        out.push((value >> (6 * place) & 0x3F) as u8 + 0x30);
    }
}

/// What was wrong with bytes that are no reply.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Cause {
    /// The stream starts in mid-reply.
    #[error("the stream starts in mid-reply")]
    LeadIn,
    /// The stream ends before the reply does.
    #[error("the stream ends in mid-reply")]
    Tail,
    /// No echo and status at the beginning.
    #[error("bytes that belong to no reply")]
    Noise,
    /// More than any reply has.
    #[error("{MAX_REPLY} bytes without an empty line")]
    TooLong,
}

/// One whole reply, borrowed from the framer's buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reply<'a> {
    /// Offset of its first byte in the stream.
    pub offset: u64,
    /// Its lines with the ends between them; the empty line is left out.
    pub body: &'a [u8],
}

impl<'a> Reply<'a> {
    /// The line that the host sent, as the device repeats it.
    pub fn echo(&self) -> &'a [u8] {
        self.body
            .split(|byte| *byte == b'\n')
            .next()
            .unwrap_or_default()
    }

    /// The two characters of the status.
    pub fn status(&self) -> [u8; 2] {
        let mut lines = self.body.split(|byte| *byte == b'\n');
        match lines.nth(1) {
            Some([first, second, ..]) => [*first, *second],
            _ => *b"??",
        }
    }

    /// The lines after the status, each with its check character.
    pub fn lines(&self) -> impl Iterator<Item = &'a [u8]> + use<'a> {
        self.body.split(|byte| *byte == b'\n').skip(2)
    }

    /// Offset of its last byte (the empty line's end) in the stream.
    pub fn last_offset(&self) -> u64 {
        self.offset + self.body.len() as u64 + 1
    }
}

/// Bytes passed over.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Skipped {
    /// Offset of the first of them in the stream.
    pub offset: u64,
    /// How many.
    pub bytes: u64,
    /// What was wrong.
    pub cause: Cause,
}

/// What the framer found next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Event<'a> {
    /// A reply with an echo and a status whose check character is right.
    Reply(Reply<'a>),
    /// Bytes that are no part of one.
    Skipped(Skipped),
}

/// Cuts a byte stream, fed in chunks of any size, into replies. In steady state nothing is
/// allocated, and what comes out does not depend on the chunks.
///
/// A reply ends at an empty line. Where its end was lost the next one follows at once: what counts
/// is the last echo and status before the empty line.
#[derive(Debug, Default)]
pub struct Framer {
    buffer: Vec<u8>,
    start: usize,
    /// Offset of `buffer[0]` in the stream.
    base: u64,
    /// Bytes from `start` on that hold no empty line.
    searched: usize,
    ended: bool,
    /// A reply that was found behind bytes that are none.
    found: Option<(usize, usize)>,
    replies: u64,
}

impl Framer {
    /// A framer at the start of a stream.
    pub fn new() -> Framer {
        Framer::default()
    }

    /// Takes the next bytes.
    pub fn feed(&mut self, chunk: &[u8]) {
        if self.start > 0 && self.found.is_none() {
            self.buffer.copy_within(self.start.., 0);
            self.buffer.truncate(self.buffer.len() - self.start);
            self.base += self.start as u64;
            self.start = 0;
        }
        self.buffer.extend_from_slice(chunk);
    }

    /// Says that no more bytes will come.
    pub fn end(&mut self) {
        self.ended = true;
    }

    /// Replies found so far.
    pub fn replies(&self) -> u64 {
        self.replies
    }

    /// Bytes taken so far.
    pub fn bytes(&self) -> u64 {
        self.base + self.buffer.len() as u64
    }

    /// The next reply or skipped piece; none until more bytes are fed.
    #[allow(clippy::should_implement_trait)] // it lends from the buffer
    pub fn next(&mut self) -> Option<Event<'_>> {
        if let Some((begin, end)) = self.found.take() {
            return self.reply(begin, end);
        }
        // An empty line where a reply should begin is nothing.
        while self.searched == 0 && self.buffer.get(self.start) == Some(&b'\n') {
            self.start += 1;
        }
        let rest = self.buffer.get(self.start..).unwrap_or_default();
        let from = self.searched.saturating_sub(1);
        let ends = rest.windows(2).enumerate().skip(from);
        let mut ends = ends.filter(|(_, pair)| **pair == *b"\n\n");
        let Some((length, _)) = ends.next() else {
            return self.unfinished();
        };
        let (begin, end) = (self.start, self.start + length);
        if length > MAX_REPLY {
            return self.skip(MAX_REPLY, Cause::TooLong);
        }
        self.searched = 0;
        match last_reply(rest.get(..length).unwrap_or_default()) {
            Some(0) => self.reply(begin, end),
            Some(lead) => {
                self.found = Some((begin + lead, end));
                self.skip(lead, self.noise())
            }
            None => self.skip(length + 2, self.noise()),
        }
    }

    fn reply(&mut self, begin: usize, end: usize) -> Option<Event<'_>> {
        self.start = end + 2;
        self.replies += 1;
        Some(Event::Reply(Reply {
            offset: self.base + begin as u64,
            body: self.buffer.get(begin..end)?,
        }))
    }

    fn noise(&self) -> Cause {
        if self.replies == 0 {
            Cause::LeadIn
        } else {
            Cause::Noise
        }
    }

    fn skip(&mut self, bytes: usize, cause: Cause) -> Option<Event<'_>> {
        let offset = self.base + self.start as u64;
        self.start += bytes;
        self.searched = 0;
        Some(Event::Skipped(Skipped {
            offset,
            bytes: bytes as u64,
            cause,
        }))
    }

    /// No empty line is there yet.
    fn unfinished(&mut self) -> Option<Event<'_>> {
        let length = self.buffer.len() - self.start;
        if length > MAX_REPLY + 1 {
            return self.skip(MAX_REPLY, Cause::TooLong);
        }
        if self.ended && length > 0 {
            return self.skip(length, Cause::Tail);
        }
        self.searched = length;
        None
    }
}

/// Where in `body` the last echo begins that a status follows.
fn last_reply(body: &[u8]) -> Option<usize> {
    let mut found = None;
    let (mut begin, mut before) = (0, None::<(usize, &[u8])>);
    for line in body.split(|byte| *byte == b'\n') {
        if let Some((line_begin, echo)) = before
            && is_status(line)
            && let Some(at) = echo_in(echo)
        {
            found = Some(line_begin + at);
        }
        before = Some((begin, line));
        begin += line.len() + 1;
    }
    found
}

/// Whether a line is a status with its check character.
fn is_status(line: &[u8]) -> bool {
    matches!(line, [a, b, sum]
        if a.is_ascii_alphanumeric() && b.is_ascii_alphanumeric() && *sum == check_character(&[*a, *b]))
}

/// Where in a line what a host sent begins: a command of two capital letters and its arguments. The
/// end of a reply that was cut short may stand before a measurement's.
fn echo_in(line: &[u8]) -> Option<usize> {
    let measures = (0..line.len()).rev().find(|at| {
        let command = line.get(*at..).unwrap_or_default();
        measurement_digits(command).is_some()
    });
    let other = matches!(line, [a, b, rest @ ..]
        if a.is_ascii_uppercase() && b.is_ascii_uppercase() && rest.len() < 48);
    measures.or(other.then_some(0))
}

/// The numbers of a measurement's command, of which there are 10 (GD, GS, GE) or 13 (MD, MS, ME).
fn measurement_digits(command: &[u8]) -> Option<&[u8]> {
    let numbers = command.split(|byte| *byte == b';').next()?;
    let [kind, b'D' | b'S' | b'E', digits @ ..] = numbers else {
        return None;
    };
    let count = match kind {
        b'G' => 10,
        b'M' => 13,
        _ => return None,
    };
    (digits.len() == count && digits.iter().all(u8::is_ascii_digit)).then_some(digits)
}

/// What a status means.
pub fn status_words(command: &[u8], status: [u8; 2]) -> &'static str {
    let measures = matches!(command, [b'M' | b'G' | b'H' | b'N', b'D' | b'S' | b'E', ..]);
    match (&status, command) {
        (b"00" | b"99", _) => "done",
        (b"0A", _) => "it cannot make data to send",
        (b"0B", _) => "its buffer is full, or the command has too many characters",
        (b"0C" | b"0D", _) => "a parameter is missing",
        (b"0E", _) => "it does not know the command, or is adjusting its time",
        (b"0F", _) => "it does not know this form of the command",
        (b"0G" | b"0H", _) => "the string after the semicolon is too long or not allowed",
        (b"0I", _) => "it is in firmware update mode",
        (b"01" | b"02", _) if measures => "the first or last step is no number",
        (b"03", _) if measures => "the cluster count is no number",
        (b"04", _) if measures => "the last step is beyond the aperture",
        (b"05", _) if measures => "the last step is below the first",
        (b"06" | b"07", _) if measures => "the interval or the number of scans is no number",
        (b"10", _) if measures => "the laser is off",
        (b"98", _) => "it measures again after a check of the laser",
        ([b'2'..=b'4', _], _) if measures => "measuring is stopped while it checks an error",
        ([b'5'..=b'9', _], _) if measures => "a fault of the hardware, such as its laser or motor",
        (b"01", b"BM") => "the laser cannot be switched on: a fault of the scanner",
        (b"02", b"BM") => "the laser was on already",
        (b"01", [b'T', b'M', ..]) => "the form of the time command is unknown",
        (b"02", [b'T', b'M', ..]) => "it was adjusting its time already",
        (b"03", [b'T', b'M', ..]) => "it had stopped adjusting its time already",
        (b"04", [b'T', b'M', ..]) => "its time was asked for without TM0 before",
        _ => "not in the protocol's list",
    }
}

/// Why a reply says nothing useful.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ReplyError {
    /// A check character is wrong.
    #[error(
        "wrong check character in line {line} after the status: {sent:?} sent, {computed:?} computed"
    )]
    Check {
        /// Line after the status, from 1.
        line: usize,
        /// What the device sent.
        sent: char,
        /// What the line gives.
        computed: char,
    },
    /// A character that carries no 6 bits.
    #[error("a character of the data is none of the 64")]
    Character,
    /// The number of values is not what was asked for.
    #[error("{found} characters of data where {expected} belong")]
    Length {
        /// Characters that came.
        found: usize,
        /// Characters asked for.
        expected: usize,
    },
    /// The echo is none of a measurement.
    #[error("no measurement: {0}")]
    Echo(String),
    /// A line or a field is missing or makes no sense.
    #[error("{0} is missing or makes no sense")]
    Field(&'static str),
}

/// The lines of a VV, PP or II reply: `KEY:value;` and the check character, which may have been
/// computed with or without the semicolon.
pub fn fields<'a>(
    reply: &Reply<'a>,
) -> impl Iterator<Item = Result<(&'a str, &'a str), ReplyError>> {
    reply.lines().enumerate().map(|(index, line)| {
        let (sum, text) = line.split_last().ok_or(ReplyError::Field("a line"))?;
        let bare = text.strip_suffix(b";").unwrap_or(text);
        if *sum != check_character(bare) && *sum != check_character(text) {
            return Err(wrong_check(index, *sum, bare));
        }
        let bare = std::str::from_utf8(bare).map_err(|_| ReplyError::Field("a line"))?;
        let (key, value) = bare.split_once(':').ok_or(ReplyError::Field("a line"))?;
        Ok((key, value.trim()))
    })
}

fn wrong_check(index: usize, sent: u8, text: &[u8]) -> ReplyError {
    ReplyError::Check {
        line: index + 1,
        sent: sent.into(),
        computed: check_character(text).into(),
    }
}

/// The text of a line whose check character is right.
fn checked(index: usize, line: &[u8]) -> Result<&[u8], ReplyError> {
    let (sum, text) = line.split_last().ok_or(ReplyError::Field("a line"))?;
    if *sum == check_character(text) {
        Ok(text)
    } else {
        Err(wrong_check(index, *sum, text))
    }
}

/// The time stamp of a TM1 reply, ms.
pub fn time_ms(reply: &Reply) -> Result<u32, ReplyError> {
    let line = reply.lines().next().ok_or(ReplyError::Field("time"))?;
    let text = checked(0, line)?;
    match text.len() {
        4 => decode(text).ok_or(ReplyError::Character),
        _ => Err(ReplyError::Field("time")),
    }
}

/// What PP says of a device.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Parameters {
    /// Model.
    pub model: String,
    /// Least and largest distance, mm.
    pub distance_mm: [u32; 2],
    /// Steps in a turn.
    pub steps_per_turn: u32,
    /// First and last step that are measured.
    pub steps: [u32; 2],
    /// The step straight ahead.
    pub front: u32,
    /// Turns a minute.
    pub speed_rpm: u32,
}

impl Parameters {
    /// A UTM-30LX as delivered.
    pub fn utm_30lx() -> Parameters {
        Parameters {
            model: "UTM-30LX(Hokuyo Automatic Co.,Ltd.)".into(),
            distance_mm: [23, 60_000],
            steps_per_turn: 1440,
            steps: [0, 1080],
            front: 540,
            speed_rpm: 2400,
        }
    }

    /// Reads a PP reply.
    pub fn parse(reply: &Reply) -> Result<Parameters, ReplyError> {
        let mut parameters = Parameters::default();
        for field in fields(reply) {
            let (key, value) = field?;
            let place = match key {
                "MODL" => {
                    value.clone_into(&mut parameters.model);
                    continue;
                }
                "DMIN" => &mut parameters.distance_mm[0],
                "DMAX" => &mut parameters.distance_mm[1],
                "ARES" => &mut parameters.steps_per_turn,
                "AMIN" => &mut parameters.steps[0],
                "AMAX" => &mut parameters.steps[1],
                "AFRT" => &mut parameters.front,
                "SCAN" => &mut parameters.speed_rpm,
                _ => continue,
            };
            *place = value
                .parse()
                .map_err(|_| ReplyError::Field("a number of PP"))?;
        }
        let p = &parameters;
        let sane = (1..=100_000).contains(&p.steps_per_turn)
            && p.steps[0] <= p.steps[1]
            && p.steps[1] - p.steps[0] <= p.steps_per_turn
            && p.steps[1] < 10_000
            && p.front < 10_000
            && (1..=100_000).contains(&p.speed_rpm)
            && p.distance_mm[0] < p.distance_mm[1];
        sane.then_some(parameters)
            .ok_or(ReplyError::Field("a number of PP"))
    }

    /// Time of a turn, s.
    pub fn period_s(&self) -> f64 {
        60.0 / f64::from(self.speed_rpm.max(1))
    }
}

/// One scan as the device sends it. Its buffers are kept from scan to scan.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Measurement {
    /// Time stamp, ms; 24 bits.
    pub stamp_ms: u32,
    /// First step, last step, steps that are put together.
    pub steps: [u32; 3],
    /// Distances, mm, and codes below DMIN.
    pub distances: Vec<u32>,
    /// Intensities; empty where none were asked for.
    pub intensities: Vec<u32>,
    /// The data of all lines.
    data: Vec<u8>,
}

impl Measurement {
    /// Whether a reply carries a scan.
    pub fn is_one(reply: &Reply) -> bool {
        let measures = measurement_digits(reply.echo()).is_some();
        measures && (reply.status() == *b"99" || reply.lines().next().is_some_and(|l| l.len() == 5))
    }

    /// Reads a reply for which [`Measurement::is_one`] holds.
    pub fn parse(&mut self, reply: &Reply) -> Result<(), ReplyError> {
        let echo = reply.echo();
        let wrong = || ReplyError::Echo(echo.escape_ascii().to_string());
        let digits = measurement_digits(echo).ok_or_else(wrong)?;
        let number = |from: usize, to: usize| {
            let text = digits.get(from..to).map(std::str::from_utf8);
            let number = text.and_then(Result::ok).and_then(|text| text.parse().ok());
            number.ok_or_else(wrong)
        };
        self.steps = [number(0, 4)?, number(4, 8)?, number(8, 10)?.max(1)];
        let [first, last, cluster] = self.steps;
        if last < first {
            return Err(wrong());
        }
        let mut lines = reply.lines().enumerate();
        let (index, stamp) = lines.next().ok_or(ReplyError::Field("time stamp"))?;
        let stamp = checked(index, stamp)?;
        if stamp.len() != 4 {
            return Err(ReplyError::Field("time stamp"));
        }
        self.stamp_ms = decode(stamp).ok_or(ReplyError::Character)?;
        self.data.clear();
        for (index, line) in lines {
            self.data.extend_from_slice(checked(index, line)?);
        }
        let (characters, both) = match echo.get(1) {
            Some(b'S') => (2, false),
            Some(b'E') => (3, true),
            _ => (3, false),
        };
        let values = ((last - first) / cluster + 1) as usize;
        let expected = values * characters * (1 + usize::from(both));
        if self.data.len() != expected {
            let found = self.data.len();
            return Err(ReplyError::Length { found, expected });
        }
        self.distances.clear();
        self.intensities.clear();
        for (index, value) in self.data.chunks_exact(characters).enumerate() {
            let value = decode(value).ok_or(ReplyError::Character)?;
            if both && index % 2 == 1 {
                self.intensities.push(value);
            } else {
                self.distances.push(value);
            }
        }
        Ok(())
    }
}

/// Writes replies.
#[derive(Debug)]
pub struct Writer<'a> {
    out: &'a mut Vec<u8>,
}

impl<'a> Writer<'a> {
    /// Begins a reply: the echo and the status.
    pub fn begin(out: &'a mut Vec<u8>, echo: &[u8], status: [u8; 2]) -> Writer<'a> {
        out.extend_from_slice(echo);
        out.push(b'\n');
        let mut writer = Writer { out };
        writer.line(&status);
        writer
    }

    /// A line with its check character.
    pub fn line(&mut self, text: &[u8]) -> &mut Self {
        self.out.extend_from_slice(text);
        self.out.push(check_character(text));
        self.out.push(b'\n');
        self
    }

    /// A line of VV, PP or II.
    pub fn field(&mut self, key: &str, value: &str) -> &mut Self {
        let text = format!("{key}:{value}");
        self.out.extend_from_slice(text.as_bytes());
        self.out.push(b';');
        self.out.push(check_character(text.as_bytes()));
        self.out.push(b'\n');
        self
    }

    /// Data in blocks.
    pub fn data(&mut self, data: &[u8]) -> &mut Self {
        for block in data.chunks(BLOCK) {
            self.line(block);
        }
        self
    }

    /// The empty line.
    pub fn end(&mut self) {
        self.out.push(b'\n');
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// What a framer makes of a stream.
    fn cut(stream: &[u8], chunk: usize) -> Vec<Result<(u64, Vec<u8>), Skipped>> {
        let mut framer = Framer::new();
        let mut found = Vec::new();
        let mut drain = |framer: &mut Framer| {
            while let Some(event) = framer.next() {
                found.push(match event {
                    Event::Reply(reply) => Ok((reply.offset, reply.body.to_vec())),
                    Event::Skipped(skipped) => Err(skipped),
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

    #[test]
    fn the_specifications_own_examples() {
        // Status 00 has P, 99 has b; the line SCAN:600; of the PP example has e.
        assert_eq!(check_character(b"00"), b'P');
        assert_eq!(check_character(b"99"), b'b');
        assert_eq!(check_character(b"SCAN:600"), b'e');
        // Two and three characters: 1234 is CB, 5432 is 1Dh; four: 16 000 000 is m2@0.
        assert_eq!(decode(b"CB"), Some(1234));
        assert_eq!(decode(b"1Dh"), Some(5432));
        assert_eq!(decode(b"m2@0"), Some(16_000_000));
        let mut out = Vec::new();
        encode(5432, 3, &mut out);
        encode(16_000_000, 4, &mut out);
        assert_eq!(out, b"1Dhm2@0");
        assert_eq!(decode(b"1 h"), None);
    }

    #[test]
    fn a_pp_reply_is_read() {
        let body = b"PP\n00P\nMODL:URG-04LX(Hokuyo Automatic Co.,Ltd.);N\nSCAN:600;e";
        let reply = Reply { offset: 0, body };
        let found: Vec<_> = fields(&reply).collect();
        assert_eq!(found[1], Ok(("SCAN", "600")));
        let mut out = Vec::new();
        let mut writer = Writer::begin(&mut out, b"PP", *b"00");
        for (key, value) in [
            ("MODL", "UTM-30LX(Hokuyo Automatic Co.,Ltd.)"),
            ("DMIN", "23"),
            ("DMAX", "60000"),
            ("ARES", "1440"),
            ("AMIN", "0"),
            ("AMAX", "1080"),
            ("AFRT", "540"),
            ("SCAN", "2400"),
        ] {
            writer.field(key, value);
        }
        writer.end();
        let body = &out[..out.len() - 2];
        let reply = Reply { offset: 0, body };
        assert_eq!(Parameters::parse(&reply), Ok(Parameters::utm_30lx()));
        let wrong = String::from_utf8(body.to_vec())
            .unwrap()
            .replace("1440", "1441");
        let reply = Reply {
            offset: 0,
            body: wrong.as_bytes(),
        };
        assert!(matches!(
            Parameters::parse(&reply),
            Err(ReplyError::Check { line: 4, .. })
        ));
    }

    fn scan(distances: &[u32], stamp_ms: u32) -> Vec<u8> {
        let echo = format!("ME{:04}{:04}01000", 0, distances.len() - 1);
        let (mut out, mut data, mut stamp) = (Vec::new(), Vec::new(), Vec::new());
        encode(stamp_ms, 4, &mut stamp);
        for (index, distance) in distances.iter().enumerate() {
            encode(*distance, 3, &mut data);
            encode(index as u32 * 7, 3, &mut data);
        }
        Writer::begin(&mut out, echo.as_bytes(), *b"99")
            .line(&stamp)
            .data(&data)
            .end();
        out
    }

    #[test]
    fn a_scan_comes_back_and_a_wrong_bit_does_not() {
        let distances: Vec<u32> = (0..1081).map(|k| k * 50).collect();
        let bytes = scan(&distances, 0xABCDEF);
        let found = cut(&bytes, 7);
        let [Ok((0, body))] = &found[..] else {
            panic!("{found:?}")
        };
        let reply = Reply { offset: 0, body };
        assert!(Measurement::is_one(&reply));
        let mut measurement = Measurement::default();
        measurement.parse(&reply).unwrap();
        assert_eq!(
            (measurement.stamp_ms, measurement.steps),
            (0xABCDEF, [0, 1080, 1])
        );
        assert_eq!(measurement.distances, distances);
        assert_eq!(measurement.intensities[1080], 7560);
        for at in 20..body.len() {
            let mut wrong = body.clone();
            wrong[at] ^= 1;
            let reply = Reply {
                offset: 0,
                body: &wrong,
            };
            assert!(measurement.parse(&reply).is_err(), "{at}");
        }
    }

    #[test]
    fn a_reply_without_its_end_costs_only_itself() {
        let (one, two) = (scan(&[100, 200], 1), scan(&[300, 400], 26));
        let stream = [&one[..], &one[..one.len() - 9], &two].concat();
        for chunk in [1, 3, 1000] {
            let found = cut(&stream, chunk);
            assert_eq!(found.len(), 3);
            let begin = (2 * one.len() - 9) as u64;
            let skipped = Skipped {
                offset: one.len() as u64,
                bytes: one.len() as u64 - 9,
                cause: Cause::Noise,
            };
            assert_eq!(found[1], Err(skipped));
            assert_eq!(found[2], Ok((begin, two[..two.len() - 2].to_vec())));
        }
    }

    #[test]
    fn statuses_have_words() {
        assert_eq!(
            status_words(b"MD0000108001000", *b"04"),
            "the last step is beyond the aperture"
        );
        assert_eq!(status_words(b"GD000010800100", *b"10"), "the laser is off");
        assert!(status_words(b"BM", *b"02").contains("on already"));
        assert!(status_words(b"ME", *b"55").contains("hardware"));
        assert!(status_words(b"VV", *b"ZZ").contains("not in"));
    }

    proptest! {
        #[test]
        fn numbers_come_back(value in 0u32..1 << 24) {
            let mut out = Vec::new();
            encode(value, 4, &mut out);
            prop_assert_eq!(decode(&out), Some(value));
        }

        #[test]
        fn chunks_do_not_matter_and_nothing_panics(
            pieces in prop::collection::vec(prop_oneof![
                3 => Just(scan(&[5, 6, 7], 9)),
                1 => Just(b"QT\n00P\n\n".to_vec()),
                2 => prop::collection::vec(prop_oneof![Just(b'\n'), Just(b'0'), any::<u8>()], 0..20),
            ], 0..9),
            chunk in 1usize..30,
        ) {
            let stream = pieces.concat();
            let found = cut(&stream, chunk);
            prop_assert_eq!(&found, &cut(&stream, stream.len().max(1)));
            let mut measurement = Measurement::default();
            for reply in found.iter().flatten() {
                let _ = measurement.parse(&Reply { offset: reply.0, body: &reply.1 });
            }
        }
    }
}
