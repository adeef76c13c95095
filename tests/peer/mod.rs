//! A stand-in for a 3DM-GX1 on a pseudo terminal, small and strict: it answers only at its own
//! speed, in the order asked, at the end of its cycles.

// Each test file is a crate of its own and uses a part of this.
#![allow(dead_code)]

use cablepose::gx1::{Command, TickFactors, Word, eeprom, packet};
use cablepose::link::{Connection, Pty};
use std::collections::{HashMap, VecDeque};
use std::fs::File;
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// How the unit is made.
#[derive(Clone)]
pub struct Making {
    /// Its speed, Bd.
    pub baud: u32,
    /// What it streams from the start.
    pub streaming: Option<Command>,
    /// Cells that differ from the factory's.
    pub cells: Vec<(u16, u16)>,
    /// Cells that it does not answer for.
    pub mute_cells: Vec<u16>,
    /// Ticks a cycle.
    pub step: u32,
    /// Every so many bytes one is lost; 0 loses none.
    pub lose_every: u64,
    /// Bytes that stand in its input: half a command of somebody else.
    pub half_command: Vec<u8>,
    /// Its serial number.
    pub serial: u16,
}

impl Default for Making {
    fn default() -> Making {
        Making {
            baud: 38_400,
            streaming: None,
            // 2 ms, so that five of them are 10 ms.
            cells: vec![(238, 4), (240, 10), (242, 250), (246, 2)],
            mute_cells: Vec::new(),
            step: 5,
            lose_every: 0,
            half_command: Vec::new(),
            serial: 4021,
        }
    }
}

/// What can happen to it.
pub enum Order {
    /// The adapter is pulled for so long.
    Unplug(Duration),
    /// The same reply is sent again and again for so long.
    Hang(Duration),
    /// Nothing is sent or read for so long.
    Silence(Duration),
    /// It is switched off and on: its ticks begin anew, it streams nothing.
    Restart,
    /// The end.
    End,
}

/// What it does at the moment.
#[derive(Clone, Debug, Default)]
pub struct State {
    /// What it streams.
    pub streaming: Option<Command>,
    /// Its cells.
    pub cells: HashMap<u16, u16>,
    /// Replies sent of what is streamed.
    pub sent: u64,
    /// Commands taken.
    pub asked: Vec<u8>,
}

/// A unit that runs until it is dropped.
pub struct Peer {
    /// What to open.
    pub path: PathBuf,
    orders: Sender<Order>,
    state: Arc<Mutex<State>>,
    thread: Option<JoinHandle<()>>,
}

impl Peer {
    /// Starts one whose port is linked at `path`.
    pub fn start(path: &Path, making: Making) -> Peer {
        let (orders, inbox) = channel();
        let state = Arc::new(Mutex::new(State::default()));
        let pty = Pty::open_as(path).unwrap();
        let shared = Arc::clone(&state);
        let link = path.to_owned();
        let thread = std::thread::spawn(move || Unit::new(making, shared, link).run(pty, &inbox));
        Peer {
            path: path.to_owned(),
            orders,
            state,
            thread: Some(thread),
        }
    }

    /// Has something happen.
    pub fn order(&self, order: Order) {
        self.orders.send(order).unwrap();
    }

    /// What it does at the moment.
    pub fn state(&self) -> State {
        self.state.lock().unwrap().clone()
    }

    /// Waits until `wanted` holds, half a minute at most.
    #[track_caller]
    pub fn wait_until(&self, what: &str, wanted: impl Fn(&State) -> bool) {
        let start = Instant::now();
        while !wanted(&self.state()) {
            assert!(
                start.elapsed() < Duration::from_secs(30),
                "waited for {what}"
            );
            std::thread::sleep(Duration::from_millis(5));
        }
    }
}

impl Drop for Peer {
    fn drop(&mut self) {
        let _ = self.orders.send(Order::End);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

struct Unit {
    making: Making,
    state: Arc<Mutex<State>>,
    link: PathBuf,
    input: Vec<u8>,
    queue: VecDeque<Vec<u8>>,
    start: Instant,
    cycle: u64,
    bytes: u64,
    last: Vec<u8>,
    hang_until: Option<Instant>,
    silent_until: Option<Instant>,
}

impl Unit {
    fn new(making: Making, state: Arc<Mutex<State>>, link: PathBuf) -> Unit {
        let mut cells: HashMap<u16, u16> = eeprom::CELLS
            .iter()
            .map(|cell| (cell.address, cell.default.unwrap_or(7)))
            .collect();
        cells.extend(making.cells.iter().copied());
        {
            let mut state = state.lock().unwrap();
            state.cells = cells;
            state.streaming = making.streaming;
        }
        Unit {
            input: making.half_command.clone(),
            making,
            state,
            link,
            queue: VecDeque::new(),
            start: Instant::now(),
            cycle: 0,
            bytes: 0,
            last: Vec::new(),
            hang_until: None,
            silent_until: None,
        }
    }

    fn tick_ns(&self) -> u64 {
        let state = self.state.lock().unwrap();
        TickFactors(eeprom::TICK_CELLS.map(|cell| state.cells[&cell])).tick_ns()
    }

    fn run(&mut self, pty: Pty, inbox: &Receiver<Order>) {
        let (mut link, mut speed) = open(pty);
        let mut buffer = [0; 256];
        loop {
            match inbox.try_recv() {
                Ok(Order::End) => return,
                Ok(Order::Unplug(span)) => {
                    drop((link, speed));
                    std::thread::sleep(span);
                    (link, speed) = open(Pty::open_as(&self.link).unwrap());
                    // It went on meanwhile; what it sent is lost.
                    self.cycle = self.now_cycle();
                    self.input.clear();
                }
                Ok(Order::Hang(span)) => self.hang_until = Some(Instant::now() + span),
                Ok(Order::Silence(span)) => self.silent_until = Some(Instant::now() + span),
                Ok(Order::Restart) => {
                    self.start = Instant::now();
                    self.cycle = 0;
                    self.state.lock().unwrap().streaming = None;
                }
                Err(_) => {}
            }
            let silent = self
                .silent_until
                .is_some_and(|until| Instant::now() < until);
            let right = speed_of(&speed) == self.making.baud;
            match link.read(&mut buffer, Duration::from_millis(1)) {
                Ok(Some(received)) if !silent => {
                    let bytes = &buffer[..received.bytes];
                    if right {
                        self.input.extend_from_slice(bytes);
                    }
                    self.take();
                }
                Ok(_) | Err(_) => {}
            }
            let out = self.cycle_end();
            if silent || out.is_empty() {
                continue;
            }
            let out = if right {
                self.damaged(&out)
            } else {
                // At another speed a byte is another byte.
                out.iter().map(|byte| byte.rotate_left(3) ^ 0x5A).collect()
            };
            let _ = link.write_all(&out, Duration::from_millis(20));
        }
    }

    fn now_cycle(&self) -> u64 {
        let cycle_ns = self.tick_ns() * u64::from(self.making.step);
        u64::try_from(self.start.elapsed().as_nanos()).unwrap() / cycle_ns
    }

    /// Takes whole commands from the input.
    fn take(&mut self) {
        while let Some(byte) = self.input.first().copied() {
            let Some(command) = Command::from_byte(byte) else {
                self.input.remove(0);
                continue;
            };
            let Some(request) = self.input.get(..command.request_length()) else {
                return;
            };
            let free = command.free_arguments(request);
            match free {
                None => {
                    self.input.remove(0);
                }
                Some(free) => {
                    self.input.drain(..command.request_length());
                    self.answer(command, &free);
                }
            }
        }
    }

    fn ticks(&self) -> u16 {
        (self.cycle * u64::from(self.making.step)) as u16
    }

    fn answer(&mut self, command: Command, free: &[u8]) {
        let ticks = self.ticks();
        let mut state = self.state.lock().unwrap();
        state.asked.push(command.byte());
        let words = match (command, free) {
            (Command::SetContinuous, [code]) => {
                state.streaming = Command::from_byte(*code).filter(|c| c.is_measurement());
                vec![u16::from(*code), ticks]
            }
            (Command::Firmware, _) => vec![3201],
            (Command::SerialNumber, _) => vec![self.making.serial],
            (Command::ReadEepromChecked, [high, low]) => {
                let address = u16::from_be_bytes([*high, *low]);
                if self.making.mute_cells.contains(&address) {
                    return;
                }
                vec![state.cells.get(&address).copied().unwrap_or(0), ticks]
            }
            (Command::WriteEepromChecked, [a, b, c, d]) => {
                let value = u16::from_be_bytes([*c, *d]);
                state.cells.insert(u16::from_be_bytes([*a, *b]), value);
                vec![value, ticks]
            }
            _ => words(command, ticks),
        };
        drop(state);
        if command == Command::WriteEepromChecked {
            // Cycles may be of another length now: what has passed are as many of those.
            self.cycle = self.now_cycle();
        }
        if let Some(reply) = packet::encode(command, &words) {
            self.queue.push_back(reply);
        }
    }

    /// What goes out at the end of a cycle: first what is streamed, then one answer.
    fn cycle_end(&mut self) -> Vec<u8> {
        let now = self.now_cycle();
        if now <= self.cycle {
            return Vec::new();
        }
        let mut out = Vec::new();
        while self.cycle < now {
            let streaming = self.state.lock().unwrap().streaming;
            if let Some(command) = streaming {
                let hangs = self.hang_until.is_some_and(|until| Instant::now() < until);
                if !hangs || self.last.is_empty() {
                    self.last = packet::encode(command, &words(command, self.ticks())).unwrap();
                }
                out.extend_from_slice(&self.last);
                self.state.lock().unwrap().sent += 1;
            }
            self.cycle += 1;
        }
        out.extend(self.queue.pop_front().unwrap_or_default());
        out
    }

    fn damaged(&mut self, bytes: &[u8]) -> Vec<u8> {
        let every = self.making.lose_every;
        bytes
            .iter()
            .filter(|_| {
                self.bytes += 1;
                every == 0 || !self.bytes.is_multiple_of(every)
            })
            .copied()
            .collect()
    }
}

/// A measurement whose every word says where it stands and when it was made; its attitude is level.
pub fn words(command: Command, ticks: u16) -> Vec<u16> {
    let word = |(place, word): (usize, &Word)| match word {
        Word::Ticks => ticks,
        Word::Quaternion(0) | Word::Matrix(1, 1) | Word::Matrix(2, 2) | Word::Matrix(3, 3) => 8192,
        Word::Quaternion(_) | Word::Matrix(..) | Word::Roll | Word::Pitch | Word::Yaw => 0,
        // -1 g on Z at the factory's gain.
        Word::Accel(2) => (-3855i16).cast_unsigned(),
        Word::Accel(_) => 0,
        Word::Rate(_) => 3,
        Word::Temperature => 9830,
        _ => 100 * place as u16,
    };
    command.words().iter().enumerate().map(word).collect()
}

fn open(pty: Pty) -> (Connection, File) {
    let speed = File::options()
        .read(true)
        .write(true)
        .custom_flags(rustix::fs::OFlags::NOCTTY.bits().cast_signed())
        .open(pty.path())
        .unwrap();
    (Connection::from_pty(pty), speed)
}

/// The speed that whoever opened the port has set.
fn speed_of(port: &File) -> u32 {
    rustix::termios::tcgetattr(port).map_or(0, |termios| termios.output_speed())
}

/// Writes a recording of `samples` replies to 0x31, 10 ms apart, with what belongs beside it.
pub fn record(path: &Path, samples: u16) {
    let streamed = Command::StabilisedEulerAccelRate;
    let mut bytes = packet::encode(Command::SetContinuous, &[0x31, 0]).unwrap();
    let mut times = format!(
        "t_s,raw_s,offset,length,session_s\n1700000000.0,5.0,0,{},5.0\n",
        bytes.len()
    );
    for k in 0..samples {
        let reply = packet::encode(streamed, &words(streamed, 5 * k)).unwrap();
        let ms = 20 + 10 * u32::from(k);
        let (s, ms) = (ms / 1000, ms % 1000);
        times += &format!(
            "17000000{s:02}.{ms:03},{}.{ms:03},{},{},5.0\n",
            5 + s,
            bytes.len(),
            reply.len()
        );
        bytes.extend(reply);
    }
    let unit = "firmware = 3201\nserial = 4021\nbaud = 38400\ncommands = [0x31]\n\
                tick_factors = [4, 10, 250, 2]\naccel_gain = 8500\nrate_gain = 10000\nmag_gain = 2000\n";
    std::fs::write(path, bytes).unwrap();
    std::fs::write(path.with_extension("times.csv"), times).unwrap();
    std::fs::write(path.with_extension("unit.toml"), unit).unwrap();
}
