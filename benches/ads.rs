//! Writes to an emulated PLC over the loopback: how long they take, and that a million of them leave
//! neither a wrong byte nor a byte of memory. `make bench-ads` prints both beside the goals.
//!
//! Round trips: nine LREALs by handle at 100 Hz, as poses come, and as fast as they go. The PLC is a
//! thread of this process. Two lines say what is not this client's: two threads that send as many
//! bytes there and back and do nothing else (what the machine itself takes: at 100 Hz a core has gone
//! to sleep each time), and the client with such a thread in the PLC's place. Memory: the resident set before and after a million writes, each of which
//! is compared with what the PLC then holds.
//!
//! Arguments: `trips` or `million` for one of the two.

use cablepose::link::emulation::Conditions;
use cablepose::twincat::ams::{Header, Request, index};
use cablepose::twincat::emulator::{Plc, Service, SharedPlc};
use cablepose::twincat::fields::{USUAL, parse_fields};
use cablepose::twincat::image::{Image, Missing};
use cablepose::twincat::variables::{self, Handles};
use cablepose::twincat::{Client, Code, LocalAddress};
use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::process::ExitCode;
use std::time::{Duration, Instant};

const LIMIT: Duration = Duration::from_secs(5);
const SYMBOL: &str = "MAIN.SickValue";
/// What is promised at 100 Hz, us.
const GOAL_P50_US: f64 = 60.0;
const GOAL_P99_US: f64 = 300.0;
/// Bytes of the answer to a write: both headers and a result.
const REPLY: usize = 6 + 32 + 4;
const MILLION: u64 = 1_000_000;

type Failure = Box<dyn std::error::Error>;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let asks = |name: &str| arguments.iter().any(|argument| argument == name);
    let both = !asks("trips") && !asks("million");
    let run = || -> Result<(), Failure> {
        if both || asks("trips") {
            trips()?;
        }
        if both || asks("million") {
            million()?;
        }
        Ok(())
    };
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("bench-ads: {error}");
            ExitCode::FAILURE
        }
    }
}

fn connect() -> Result<(SharedPlc, Service, Client, Handles), Failure> {
    let plc = SharedPlc::new(Plc::with_sick_value());
    let service = Service::start(&plc, ([127, 0, 0, 1], 0).into(), Conditions::default())?;
    let target = service.target(&plc).parse()?;
    let mut client = Client::connect(&target, LocalAddress::Usual, LIMIT)?;
    let (_, variable) = variables::find(&mut client, SYMBOL, None, LIMIT)?;
    let usual = parse_fields(USUAL)?;
    let image = Image::plan(&[SYMBOL.parse()?], &[variable], None, &usual, Missing::Hold)?;
    let handles = Handles::get(&mut client, &image, LIMIT)?;
    Ok((plc, service, client, handles))
}

fn value(number: u64, bytes: &mut Vec<u8>) {
    bytes.clear();
    for place in 0..9u64 {
        // Every byte takes every value.
        let mixed = (number * 9 + place).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        bytes.extend_from_slice(&mixed.to_le_bytes());
    }
}

/// A thread in the PLC's place that answers every write with "done" and looks at nothing else.
fn echo() -> Result<SocketAddr, Failure> {
    let listener = TcpListener::bind(("127.0.0.1", 0))?;
    let address = listener.local_addr()?;
    // Each client's thread ends with its connection, this one with the process.
    std::thread::spawn(move || {
        for stream in listener.incoming().flatten() {
            std::thread::spawn(move || answer_writes(stream));
        }
    });
    Ok(address)
}

/// An answer has its request's invoke id and nothing but zeros behind its header: a good result.
fn answer_writes(mut stream: TcpStream) -> std::io::Result<()> {
    stream.set_nodelay(true)?;
    let mut bytes = [0; 256];
    loop {
        let count = stream.read(&mut bytes)?;
        let Some((header, _)) = bytes.get(6..count).and_then(Header::parse) else {
            return Ok(());
        };
        let mut reply = Vec::with_capacity(64);
        header.reply(&mut reply, Code::OK, |_| {});
        stream.write_all(&reply)?;
    }
}

/// The times of so many calls, one each `period`.
fn timed(
    count: u32,
    period: Duration,
    mut call: impl FnMut(u32) -> Result<(), Failure>,
) -> Result<Vec<Duration>, Failure> {
    let mut spans = Vec::with_capacity(count as usize);
    let start = Instant::now();
    for number in 0..count {
        let due = start + period * number;
        std::thread::sleep(due.saturating_duration_since(Instant::now()));
        let before = Instant::now();
        call(number)?;
        spans.push(before.elapsed());
    }
    Ok(spans)
}

fn line(name: &str, mut spans: Vec<Duration>, judged: bool) {
    spans.sort_unstable();
    let at = |share: f64| {
        let place = ((spans.len() as f64 * share) as usize).min(spans.len() - 1);
        spans
            .get(place)
            .map_or(f64::NAN, |span| span.as_secs_f64() * 1e6)
    };
    let (p50, p99, most) = (at(0.5), at(0.99), at(1.0));
    let missed = judged && (p50 > GOAL_P50_US || p99 > GOAL_P99_US);
    let mark = if missed { "  MISSED" } else { "" };
    println!("{name:<44} {p50:>8.1} {p99:>8.1} {most:>8.1}{mark}");
}

fn trips() -> Result<(), Failure> {
    println!("round trip of a write of 72 bytes by handle, loopback, us");
    println!("{:<44} {:>8} {:>8} {:>8}", "", "p50", "p99", "max");
    let (_plc, _service, mut client, mut handles) = connect()?;
    let address = echo()?;
    let mut bare = TcpStream::connect(address)?;
    bare.set_nodelay(true)?;
    let mut request = Vec::new();
    let written = Request::Write {
        group: index::VALUE_BY_HANDLE,
        offset: 1,
        data: &[0; 72],
    };
    written.frame(&mut request, client.target(), client.source(), 1);
    let target = format!("{address}/{}", client.target()).parse()?;
    let own = LocalAddress::NetId(client.source().net_id);
    let mut alone = Client::connect(&target, own, LIMIT)?;
    let mut bytes = Vec::new();
    for (rate, count, period) in [
        ("at 100 Hz", 2000, Duration::from_millis(10)),
        ("one after the other", 100_000, Duration::ZERO),
    ] {
        let mut reply = [0; REPLY];
        let spans = timed(count, period, |_| {
            bare.write_all(&request)?;
            Ok(bare.read_exact(&mut reply)?)
        })?;
        line(&format!("{rate}, the machine alone"), spans, false);
        let spans = timed(count, period, |_| {
            Ok(alone.call(&written, LIMIT, |_| ())?)
        })?;
        line(&format!("{rate}, client"), spans, false);
        let spans = timed(count, period, |number| {
            value(u64::from(number), &mut bytes);
            Ok(handles.write(&mut client, &bytes, LIMIT)?)
        })?;
        let judged = !period.is_zero();
        line(&format!("{rate}, client and emulated PLC"), spans, judged);
    }
    println!(
        "{:<44} {GOAL_P50_US:>8.0} {GOAL_P99_US:>8.0}",
        "goal at 100 Hz"
    );
    Ok(())
}

fn million() -> Result<(), Failure> {
    let (plc, _service, mut client, mut handles) = connect()?;
    let (mut bytes, mut settled) = (Vec::new(), 0);
    for number in 0..MILLION {
        value(number, &mut bytes);
        handles.write(&mut client, &bytes, LIMIT)?;
        let plc = plc.lock();
        let held = plc.find(SYMBOL).ok_or("the variable is gone")?;
        if held.value != bytes || held.writes != number + 1 {
            return Err(format!("write {number} left other bytes").into());
        }
        if number == MILLION / 10 {
            settled = resident_kib()?;
        }
    }
    let after = resident_kib()?;
    println!(
        "{MILLION} writes, every byte as it was sent; memory {settled} KiB after a tenth of them, \
         {after} KiB after all; {:?}",
        client.counts()
    );
    Ok(())
}

/// This process's resident set, KiB (0 where the system does not tell).
fn resident_kib() -> Result<u64, Failure> {
    let Ok(text) = std::fs::read_to_string("/proc/self/status") else {
        return Ok(0);
    };
    let line = text.lines().find(|line| line.starts_with("VmRSS:"));
    let number = line.and_then(|line| line.split_whitespace().nth(1));
    Ok(number.ok_or("no VmRSS")?.parse()?)
}
