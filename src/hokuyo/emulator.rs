//! A device that behaves like a UTM-30LX: bytes and the time go in, bytes come out.
//!
//! Knows VV, PP, II, BM, QT, RS, TM0 to TM2, GD, GS, GE, MD, MS, ME, and SS, CR and HS as far as
//! they are answered; everything else gets status 0E, as on the device. A scan goes out when its
//! sweep is over and a millisecond has passed; its stamp is the device's time when it began.

use super::scip::{self, Parameters, Writer, encode};
use crate::link::emulation::{Device, LineId, Outbox, nanoseconds};
use crate::record::Scan;
use std::collections::BTreeMap;
use std::time::Duration;

/// From the end of the sweep to the transmission, ns.
const PROCESSING_NS: i64 = 1_000_000;
/// The longest line that a host sends: a command, its numbers and a string of 16.
const LONGEST_LINE: usize = 48;

/// What the emulated scanner sees.
pub trait Source {
    /// The next scan: fills it, and gives when it begins and ends, ns since the source's start. None:
    /// there are no more.
    fn next(&mut self, scan: &mut Scan) -> Option<(i64, i64)>;
}

/// How the device is.
#[derive(Clone, Debug)]
pub struct Behaviour {
    /// What PP says.
    pub parameters: Parameters,
    /// Serial number.
    pub serial: String,
    /// How long it starts.
    pub boot: Duration,
    /// The source begins when the first client measures.
    pub hold: bool,
    /// How long to stay after the source's end while clients are there.
    pub linger: Duration,
    /// How much too fast its clock runs.
    pub clock_ppm: f64,
    /// What its clock shows at the start.
    pub uptime: Duration,
}

/// What has been done.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    /// Scans made.
    pub scans: u64,
    /// Replies with scans.
    pub sent: u64,
    /// Requests.
    pub requests: u64,
    /// Requests that were refused.
    pub refused: u64,
}

/// What a client asked to be sent.
#[derive(Clone, Debug)]
struct Order {
    /// The echo without the number of scans: `ME00001080010`.
    head: Vec<u8>,
    /// What follows the semicolon, with it.
    string: Vec<u8>,
    steps: [u32; 3],
    /// Turns left out between two scans, and how many are to be left out next.
    interval: u32,
    skip: u32,
    /// Scans still to be sent; none: without end.
    left: Option<u32>,
    /// One scan at once (GD, GS, GE): no status 99.
    single: bool,
}

#[derive(Debug, Default)]
struct Client {
    line: Vec<u8>,
    order: Option<Order>,
}

/// The device.
#[derive(Debug)]
pub struct Emulator<S> {
    behaviour: Behaviour,
    source: S,
    clients: BTreeMap<LineId, Client>,
    laser: bool,
    adjusting: bool,
    booted_ns: i64,
    /// True time at which the device's clock showed `clock_start_ns`.
    clock_zero_ns: i64,
    clock_start_ns: i64,
    origin_ns: Option<i64>,
    next: Option<(i64, i64)>,
    scan: Scan,
    /// When the source had ended.
    over_ns: Option<i64>,
    last_ns: i64,
    ended: bool,
    tally: Tally,
    spare: Vec<u8>,
    data: Vec<u8>,
}

impl<S: Source> Emulator<S> {
    /// A device at the moment of power-on.
    pub fn new(behaviour: Behaviour, source: S) -> Emulator<S> {
        Emulator {
            booted_ns: nanoseconds(behaviour.boot),
            clock_zero_ns: 0,
            clock_start_ns: nanoseconds(behaviour.uptime),
            behaviour,
            source,
            clients: BTreeMap::new(),
            laser: false,
            adjusting: false,
            origin_ns: None,
            next: None,
            scan: Scan::default(),
            over_ns: None,
            last_ns: 0,
            ended: false,
            tally: Tally::default(),
            spare: Vec::new(),
            data: Vec::new(),
        }
    }

    /// What has been done so far.
    pub fn tally(&self) -> Tally {
        self.tally
    }

    /// The source, at the end.
    pub fn into_source(self) -> S {
        self.source
    }

    /// The device's milliseconds, 24 bits.
    fn clock_ms(&self, now_ns: i64) -> u32 {
        let elapsed_ns = (now_ns - self.clock_zero_ns) as f64;
        let device_ns = elapsed_ns * (1.0 + self.behaviour.clock_ppm * 1e-6);
        let ms = (self.clock_start_ns + device_ns as i64).div_euclid(1_000_000);
        ms.rem_euclid(1 << scip::STAMP_BITS) as u32
    }

    fn begin(&mut self, now_ns: i64, asked: bool) {
        if self.origin_ns.is_none() && now_ns >= self.booted_ns && (asked || !self.behaviour.hold) {
            self.origin_ns = Some(now_ns);
        }
        self.fetch(now_ns);
    }

    fn fetch(&mut self, now_ns: i64) {
        if self.origin_ns.is_none() || self.next.is_some() || self.over_ns.is_some() {
            return;
        }
        match self.source.next(&mut self.scan) {
            Some(times) => self.next = Some(times),
            None => {
                self.over_ns = Some(self.last_ns.max(now_ns));
                self.ended = self.clients.is_empty();
            }
        }
    }

    fn transmit_ns(&self) -> Option<i64> {
        let (_, end_ns) = self.next?;
        Some(self.origin_ns? + end_ns + PROCESSING_NS)
    }

    /// A scan is complete and goes out.
    fn transmit(&mut self, out: &mut Outbox) {
        let Some(due_ns) = self.transmit_ns() else {
            return;
        };
        let Some((begin_ns, _)) = self.next.take() else {
            return;
        };
        self.last_ns = due_ns;
        self.tally.scans += 1;
        let stamp_ms = self.clock_ms(self.origin_ns.unwrap_or(0) + begin_ns);
        let mut clients = std::mem::take(&mut self.clients);
        for (line, client) in &mut clients {
            let Some(order) = &mut client.order else {
                continue;
            };
            if order.skip > 0 {
                order.skip -= 1;
                continue;
            }
            order.skip = order.interval;
            if let Some(left) = &mut order.left {
                *left -= 1;
            }
            self.write_scan(order, stamp_ms);
            out.data(*line, &self.spare);
            self.tally.sent += 1;
            if order.left == Some(0) {
                client.order = None;
            }
        }
        self.clients = clients;
    }

    fn write_scan(&mut self, order: &Order, stamp_ms: u32) {
        self.spare.clear();
        self.data.clear();
        let two = order.head.get(1) == Some(&b'S');
        let both = order.head.get(1) == Some(&b'E');
        let characters = if two { 2 } else { 3 };
        let [first, last, cluster] = order.steps;
        let offset = first.saturating_sub(self.behaviour.parameters.steps[0]) as usize;
        let count = (last - first + 1) as usize;
        let distances_mm = [
            self.behaviour.parameters.distance_mm[0],
            match two {
                true => 4095,
                false => self.behaviour.parameters.distance_mm[1],
            },
        ];
        let ranges = self.scan.ranges_m.get(offset..).unwrap_or_default();
        let remissions = self.scan.remissions.get(offset..).unwrap_or_default();
        for group in 0..count.div_ceil(cluster as usize) {
            let steps = group * cluster as usize..((group + 1) * cluster as usize).min(count);
            let values = ranges.get(steps.clone()).unwrap_or(&[]);
            let nearest = values.iter().map(|m| distance(*m, distances_mm));
            // Of steps put together the least distance counts, codes only where all are codes.
            let valid = nearest.clone().filter(|mm| *mm >= distances_mm[0]).min();
            let value = valid.or(nearest.clone().next()).unwrap_or(1);
            encode(value, characters, &mut self.data);
            if both {
                let digits = remissions.get(steps.start).copied().unwrap_or(0.0);
                encode(
                    digits.round().clamp(0.0, 262_143.0) as u32,
                    3,
                    &mut self.data,
                );
            }
        }
        let mut echo = order.head.clone();
        if !order.single {
            let left = order.left.unwrap_or(0);
            echo.extend_from_slice(format!("{left:02}").as_bytes());
        }
        echo.extend_from_slice(&order.string);
        let mut stamp = Vec::with_capacity(4);
        encode(stamp_ms, 4, &mut stamp);
        let status = if order.single { *b"00" } else { *b"99" };
        Writer::begin(&mut self.spare, &echo, status)
            .line(&stamp)
            .data(&self.data)
            .end();
    }

    /// Answers a line.
    fn request(&mut self, line: LineId, text: &[u8], now_ns: i64, out: &mut Outbox) {
        self.tally.requests += 1;
        let (command, string) = match text.iter().position(|byte| *byte == b';') {
            Some(at) => text.split_at(at),
            None => (text, &[][..]),
        };
        let status = if string.len() > 17 {
            *b"0G"
        } else {
            match command {
                b"VV" => return self.identity(line, text, out),
                b"PP" => return self.parameters(line, text, out),
                b"II" => return self.state(line, text, now_ns, out),
                b"TM1" if self.adjusting => {
                    let mut stamp = Vec::with_capacity(4);
                    encode(self.clock_ms(now_ns), 4, &mut stamp);
                    let mut reply = Vec::new();
                    Writer::begin(&mut reply, text, *b"00").line(&stamp).end();
                    return out.reply(line, &reply);
                }
                _ => self.command(line, command, string, now_ns),
            }
        };
        self.tally.refused += u64::from(status != *b"00");
        let deferred = status == *b"00" && matches!(command, [b'G', ..]);
        if !deferred {
            let mut reply = Vec::new();
            Writer::begin(&mut reply, text, status).end();
            out.reply(line, &reply);
        }
    }

    /// Does what is answered with a status alone.
    fn command(&mut self, line: LineId, command: &[u8], string: &[u8], now_ns: i64) -> [u8; 2] {
        match command {
            b"QT" => {
                if self.adjusting {
                    return *b"0E";
                }
                if let Some(client) = self.clients.get_mut(&line) {
                    client.order = None;
                }
                self.laser = self.clients.values().any(|client| client.order.is_some());
                *b"00"
            }
            b"TM0" if self.adjusting => *b"02",
            b"TM0" => {
                self.stop_all();
                self.adjusting = true;
                *b"00"
            }
            b"TM1" => *b"04",
            b"TM2" if self.adjusting => {
                self.adjusting = false;
                *b"00"
            }
            b"TM2" => *b"03",
            [b'T', b'M', ..] => *b"01",
            b"RS" => {
                self.stop_all();
                self.adjusting = false;
                self.clock_zero_ns = now_ns;
                self.clock_start_ns = 0;
                *b"00"
            }
            _ if self.adjusting => *b"0E",
            b"BM" if self.laser => *b"02",
            b"BM" => {
                self.laser = true;
                *b"00"
            }
            [b'S', b'S', rate @ ..] | [b'C', b'R', rate @ ..] | [b'H', b'S', rate @ ..] => {
                match rate.is_empty() || !rate.iter().all(u8::is_ascii_digit) {
                    true => *b"01",
                    false => *b"00",
                }
            }
            [b'M' | b'G', b'D' | b'S' | b'E', ..] => match self.order(command, string) {
                Err(status) => status,
                Ok(order) if order.single && !self.laser => *b"10",
                Ok(order) => {
                    self.laser = true;
                    if let Some(client) = self.clients.get_mut(&line) {
                        client.order = Some(order);
                    }
                    self.begin(now_ns, true);
                    *b"00"
                }
            },
            _ => *b"0E",
        }
    }

    fn stop_all(&mut self) {
        self.clients
            .values_mut()
            .for_each(|client| client.order = None);
        self.laser = false;
    }

    /// Reads what is to be measured.
    fn order(&self, command: &[u8], string: &[u8]) -> Result<Order, [u8; 2]> {
        let single = command.first() == Some(&b'G');
        let length = if single { 12 } else { 15 };
        if command.len() != length {
            return Err(if command.len() < length {
                *b"0C"
            } else {
                *b"0B"
            });
        }
        let number = |from: usize, to: usize, status: &[u8; 2]| {
            let digits = command
                .get(from..to)
                .filter(|d| d.iter().all(u8::is_ascii_digit));
            let text = digits.and_then(|digits| std::str::from_utf8(digits).ok());
            text.and_then(|text| text.parse::<u32>().ok())
                .ok_or(*status)
        };
        let (first, last) = (number(2, 6, b"01")?, number(6, 10, b"02")?);
        let cluster = number(10, 12, b"03")?.max(1);
        let [least, most] = self.behaviour.parameters.steps;
        if last > most || first < least {
            return Err(*b"04");
        }
        if last < first {
            return Err(*b"05");
        }
        let (interval, scans) = match single {
            true => (0, 1),
            false => (number(12, 13, b"06")?, number(13, 15, b"07")?),
        };
        let head = if single {
            command
        } else {
            command.get(..13).unwrap_or_default()
        };
        Ok(Order {
            head: head.to_vec(),
            string: string.to_vec(),
            steps: [first, last, cluster],
            interval,
            skip: 0,
            left: (scans > 0).then_some(scans),
            single,
        })
    }

    fn identity(&mut self, line: LineId, echo: &[u8], out: &mut Outbox) {
        let mut reply = Vec::new();
        let mut writer = Writer::begin(&mut reply, echo, *b"00");
        writer.field("VEND", "Hokuyo Automatic Co.,Ltd.");
        writer.field("PROD", "SOKUIKI Sensor UTM-30LX(emulated)");
        writer.field("FIRM", "1.18.0");
        writer.field("PROT", "SCIP 2.0");
        writer.field("SERI", &self.behaviour.serial);
        writer.end();
        out.reply(line, &reply);
    }

    fn parameters(&mut self, line: LineId, echo: &[u8], out: &mut Outbox) {
        let p = &self.behaviour.parameters;
        let mut reply = Vec::new();
        let mut writer = Writer::begin(&mut reply, echo, *b"00");
        writer.field("MODL", &p.model);
        for (key, value) in [
            ("DMIN", p.distance_mm[0]),
            ("DMAX", p.distance_mm[1]),
            ("ARES", p.steps_per_turn),
            ("AMIN", p.steps[0]),
            ("AMAX", p.steps[1]),
            ("AFRT", p.front),
            ("SCAN", p.speed_rpm),
        ] {
            writer.field(key, &value.to_string());
        }
        writer.end();
        out.reply(line, &reply);
    }

    fn state(&mut self, line: LineId, echo: &[u8], now_ns: i64, out: &mut Outbox) {
        let mut reply = Vec::new();
        let mut writer = Writer::begin(&mut reply, echo, *b"00");
        let mut stamp = Vec::with_capacity(4);
        encode(self.clock_ms(now_ns), 4, &mut stamp);
        let measures = self.clients.values().any(|client| client.order.is_some());
        writer.field("MODL", &self.behaviour.parameters.model);
        writer.field("LASR", if self.laser { "ON" } else { "OFF" });
        writer.field("SCSP", "Initial(2400[rpm])<-Default setting by user");
        writer.field("MESM", if measures { "Measuring" } else { "Idle" });
        writer.field("SBPS", "USB Full Speed");
        writer.field("TIME", &String::from_utf8_lossy(&stamp));
        writer.field("STAT", "Sensor works well.");
        writer.end();
        out.reply(line, &reply);
    }
}

/// A range as the device sends it: mm, or a code.
fn distance(range_m: f64, [least_mm, most_mm]: [u32; 2]) -> u32 {
    let mm = (range_m * 1000.0).round();
    match range_m {
        _ if range_m.is_nan() => 3,
        _ if mm > f64::from(most_mm) => 1,
        _ if mm < f64::from(least_mm) => 2,
        _ => mm as u32,
    }
}

impl<S: Source> Device for Emulator<S> {
    fn connected(&mut self, line: LineId, _service: usize, _now_ns: i64) {
        self.clients.insert(line, Client::default());
    }

    fn disconnected(&mut self, line: LineId) {
        self.clients.remove(&line);
        self.laser &= self.clients.values().any(|client| client.order.is_some());
        self.ended |= self.over_ns.is_some() && self.clients.is_empty();
    }

    fn input(&mut self, line: LineId, bytes: &[u8], now_ns: i64, out: &mut Outbox) {
        if now_ns < self.booted_ns {
            return;
        }
        for byte in bytes {
            let Some(client) = self.clients.get_mut(&line) else {
                return;
            };
            if !matches!(byte, b'\n' | b'\r') {
                // What is longer than any request is refused as a whole at its end.
                if client.line.len() <= LONGEST_LINE {
                    client.line.push(*byte);
                }
                continue;
            }
            let text = std::mem::take(&mut client.line);
            if !text.is_empty() {
                self.request(line, &text, now_ns, out);
            }
        }
    }

    fn advance(&mut self, now_ns: i64, out: &mut Outbox) {
        if let Some(over_ns) = self.over_ns {
            self.ended |= now_ns >= over_ns + nanoseconds(self.behaviour.linger);
            return;
        }
        self.begin(now_ns, false);
        while self.transmit_ns().is_some_and(|due_ns| due_ns <= now_ns) {
            self.transmit(out);
            self.fetch(now_ns);
        }
    }

    fn due_ns(&self) -> Option<i64> {
        if let Some(over_ns) = self.over_ns {
            return Some(over_ns + nanoseconds(self.behaviour.linger));
        }
        match self.origin_ns {
            None if self.behaviour.hold => None,
            None => Some(self.booted_ns),
            Some(_) => self.transmit_ns(),
        }
    }

    fn restart(&mut self, now_ns: i64, boot: Duration) {
        self.stop_all();
        self.clients
            .values_mut()
            .for_each(|client| client.line.clear());
        self.adjusting = false;
        self.booted_ns = now_ns + nanoseconds(boot);
        self.clock_zero_ns = now_ns;
        self.clock_start_ns = 0;
    }

    fn hurries(&self) -> bool {
        self.over_ns.is_none()
    }

    fn ended(&self) -> bool {
        self.ended
    }
}

#[cfg(test)]
mod tests {
    use super::super::scip::{Event, Framer, Measurement, Reply};
    use super::*;

    /// Three scans of one wall.
    struct Wall(u32);

    impl Source for Wall {
        fn next(&mut self, scan: &mut Scan) -> Option<(i64, i64)> {
            let begin_ns = i64::from(self.0) * 25_000_000;
            self.0 += 1;
            scan.ranges_m.clear();
            scan.ranges_m.extend((0..1081).map(|k| match k {
                0 => f64::INFINITY,
                1 => f64::NAN,
                2 => 0.01,
                _ => 1.0 + f64::from(self.0),
            }));
            scan.remissions = vec![150.0; 1081];
            (self.0 <= 3).then_some((begin_ns, begin_ns + 18_750_000))
        }
    }

    fn device() -> Emulator<Wall> {
        let behaviour = Behaviour {
            parameters: Parameters::utm_30lx(),
            serial: "H1".into(),
            boot: Duration::ZERO,
            hold: true,
            linger: Duration::from_secs(1),
            clock_ppm: 0.0,
            uptime: Duration::from_secs(5),
        };
        let mut device = Emulator::new(behaviour, Wall(0));
        device.connected(1, 0, 0);
        device
    }

    /// What is answered, by echo, status and the lines after it.
    fn ask(device: &mut Emulator<Wall>, text: &str, now_ns: i64) -> Vec<(String, String, usize)> {
        let mut out = Outbox::default();
        device.input(1, text.as_bytes(), now_ns, &mut out);
        read(&mut out)
    }

    fn read(out: &mut Outbox) -> Vec<(String, String, usize)> {
        let mut framer = Framer::new();
        out.take()
            .iter()
            .for_each(|(_, _, bytes)| framer.feed(bytes));
        let mut found = Vec::new();
        while let Some(event) = framer.next() {
            let Event::Reply(reply) = event else {
                panic!("{event:?}")
            };
            let text = |bytes: &[u8]| String::from_utf8(bytes.to_vec()).unwrap();
            found.push((
                text(reply.echo()),
                text(&reply.status()),
                reply.lines().count(),
            ));
        }
        found
    }

    #[test]
    fn statuses_are_the_devices() {
        let mut device = device();
        for (request, status) in [
            ("QT\n", "00"),
            ("XX\n", "0E"),
            ("BM\r\n", "00"),
            ("BM\n", "02"),
            ("MD00001080010\n", "0C"),
            ("MDx0001080010000\n", "0B"),
            ("MDx001108001000\n", "01"),
            ("MD0000x08001000\n", "02"),
            ("MD00001080x1000\n", "03"),
            ("MD0000108101000\n", "04"),
            ("MD0009000801000\n", "05"),
            ("MD0000108001x00\n", "06"),
            ("MD00001080010x0\n", "07"),
            ("TM1\n", "04"),
            ("TM0\n", "00"),
            ("TM0\n", "02"),
            ("MD0000108001000\n", "0E"),
            ("QT\n", "0E"),
            ("TM2\n", "00"),
            ("TM2\n", "03"),
            ("TM9\n", "01"),
            ("GD0000108001\n", "10"),
            ("VV;12345678901234567\n", "0G"),
        ] {
            let found = ask(&mut device, request, 0);
            assert_eq!(found.len(), 1, "{request}");
            assert_eq!(found[0].0, request.trim_end(), "{request}");
            assert_eq!(found[0].1, status, "{request}");
        }
        let lines = |found: Vec<(String, String, usize)>| found[0].2;
        assert_eq!(lines(ask(&mut device, "VV;hello\n", 0)), 5);
        assert_eq!(lines(ask(&mut device, "PP\n", 0)), 8);
        assert_eq!(lines(ask(&mut device, "II\n", 0)), 7);
        assert_eq!(device.tally().refused, 19);
    }

    #[test]
    fn scans_go_out_when_they_are_complete() {
        let mut device = device();
        assert_eq!(device.due_ns(), None);
        let found = ask(&mut device, "ME0000108001000;a\n", 1_000_000);
        assert_eq!(found, [("ME0000108001000;a".into(), "00".into(), 0)]);
        let mut out = Outbox::default();
        assert_eq!(device.due_ns(), Some(1_000_000 + 18_750_000 + 1_000_000));
        device.advance(20_000_000, &mut out);
        assert_eq!(read(&mut out), []);
        device.advance(20_750_000, &mut out);
        let sent = out.take();
        let bytes = &sent[0].2;
        let reply = Reply {
            offset: 0,
            body: &bytes[..bytes.len() - 2],
        };
        assert_eq!(
            (reply.echo(), reply.status()),
            (&b"ME0000108001000;a"[..], *b"99")
        );
        let mut measurement = Measurement::default();
        measurement.parse(&reply).unwrap();
        assert_eq!(measurement.stamp_ms, 5001);
        assert_eq!(measurement.distances[..4], [1, 3, 2, 2000]);
        assert_eq!(measurement.intensities, vec![150; 1081]);
        // The source ends after three; then the device waits for its client, but not for ever.
        device.advance(100_000_000, &mut out);
        assert_eq!(read(&mut out).len(), 2);
        assert!(!device.ended());
        device.advance(1_200_000_000, &mut out);
        assert!(device.ended());
    }

    #[test]
    fn one_that_is_to_stay_for_ever_stays() {
        let mut device = device();
        device.behaviour.linger = Duration::MAX;
        ask(&mut device, "MD0000108001000\n", 0);
        let mut out = Outbox::default();
        device.advance(200_000_000, &mut out);
        device.advance(1_000_000_000_000, &mut out);
        assert!(device.due_ns() > Some(1_000_000_000_000) && !device.ended());
    }

    #[test]
    fn a_number_of_scans_and_clusters() {
        let mut device = device();
        ask(&mut device, "MD0003001204002\n", 0);
        let mut out = Outbox::default();
        device.advance(200_000_000, &mut out);
        let sent = out.take();
        let echoes: Vec<_> = sent
            .iter()
            .map(|(_, _, bytes)| bytes[..15].to_vec())
            .collect();
        assert_eq!(echoes, [&b"MD0003001204001"[..], b"MD0003001204000"]);
        let bytes = &sent[1].2;
        let mut measurement = Measurement::default();
        measurement
            .parse(&Reply {
                offset: 0,
                body: &bytes[..bytes.len() - 2],
            })
            .unwrap();
        assert_eq!(measurement.distances, [3000, 3000, 3000]);
        assert!(measurement.intensities.is_empty());
    }
}
