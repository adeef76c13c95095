//! A line between the emulated scanner and its client.
//!
//! It hands on every telegram in one piece and notes when, or gathers bytes into large pieces.

use crate::{Failure, during};
use cablepose::link::HostInstant;
use cablepose::sick::cola::{Event, Framer};
use cablepose::sick::scandata::is_scan;
use std::io::{ErrorKind, Read, Write};
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream};
use std::thread::JoinHandle;
use std::time::Duration;

/// With nothing new for so long, gathered bytes go on.
const GATHERED: Duration = Duration::from_millis(20);

/// A scan is held so long before it goes on.
const ASIDE: Duration = Duration::from_millis(2);

/// What goes on in one piece.
#[derive(Clone, Copy)]
pub enum Pieces {
    /// Each telegram; the time of each scan is noted.
    Telegrams,
    /// So many bytes.
    Bytes(usize),
}

/// The relay; it carries one connection.
pub struct Relay {
    pub address: SocketAddr,
    thread: JoinHandle<Result<Vec<HostInstant>, Failure>>,
}

impl Relay {
    /// A relay to the scanner at `place`.
    pub fn start(place: &str, pieces: Pieces) -> Result<Relay, Failure> {
        let listener = TcpListener::bind("127.0.0.1:0").map_err(during("relay"))?;
        let address = listener.local_addr().map_err(during("relay"))?;
        let scanner = TcpStream::connect(place).map_err(during("relay to the scanner"))?;
        let thread = std::thread::spawn(move || {
            let (client, _) = listener.accept().map_err(during("relay"))?;
            drop(listener);
            for line in [&client, &scanner] {
                line.set_nodelay(true).map_err(during("relay"))?;
            }
            let up = (client.try_clone(), scanner.try_clone());
            let (Ok(mut from), Ok(mut to)) = up else {
                return Err("relay: no second handle of a socket".to_owned());
            };
            let requests = std::thread::spawn(move || {
                let _ = std::io::copy(&mut from, &mut to);
                let _ = to.shutdown(Shutdown::Write);
            });
            let sent = match pieces {
                Pieces::Telegrams => telegrams(&scanner, &client),
                Pieces::Bytes(most) => gathered(&scanner, &client, most),
            };
            for line in [&client, &scanner] {
                let _ = line.shutdown(Shutdown::Both);
            }
            let _ = requests.join();
            sent
        });
        Ok(Relay { address, thread })
    }

    /// Waits for the end of the connection; when the relay sent each scan.
    pub fn end(self) -> Result<Vec<HostInstant>, Failure> {
        let ended = self.thread.join();
        ended.map_err(|_| "the relay fell over".to_owned())?
    }
}

/// Hands on each telegram as soon as it is whole, each in one piece.
fn telegrams(mut scanner: &TcpStream, mut client: &TcpStream) -> Result<Vec<HostInstant>, Failure> {
    let mut framer = Framer::new();
    let mut buffer = vec![0; 1 << 16];
    let (mut waiting, mut begin) = (Vec::new(), 0u64);
    let mut sent = Vec::with_capacity(1 << 14);
    loop {
        let count = match scanner.read(&mut buffer) {
            Ok(0) | Err(_) => return Ok(sent),
            Ok(count) => count,
        };
        let bytes = buffer.get(..count).unwrap_or_default();
        waiting.extend_from_slice(bytes);
        framer.feed(bytes);
        while let Some(event) = framer.next() {
            let Event::Telegram(telegram) = event else {
                continue;
            };
            let end = (telegram.last_offset() + 1 - begin) as usize;
            let scan = is_scan(&telegram);
            let piece: Vec<u8> = waiting.drain(..end.min(waiting.len())).collect();
            begin += piece.len() as u64;
            if scan {
                // A real scanner computes elsewhere: let the emulator finish with its next scan.
                std::thread::sleep(ASIDE);
            }
            let now = HostInstant::now();
            if client.write_all(&piece).is_err() {
                return Ok(sent);
            }
            if scan {
                sent.push(now);
            }
        }
    }
}

/// Hands on pieces of `most` bytes, and less once nothing more comes.
fn gathered(
    mut scanner: &TcpStream,
    mut client: &TcpStream,
    most: usize,
) -> Result<Vec<HostInstant>, Failure> {
    let timeout = scanner.set_read_timeout(Some(GATHERED));
    timeout.map_err(during("relay"))?;
    let mut piece = vec![0; most];
    let mut have = 0;
    loop {
        let free = piece.get_mut(have..).unwrap_or_default();
        let came = scanner.read(free);
        have += came.as_ref().copied().unwrap_or(0);
        let quiet = matches!(&came, Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut));
        let over = !quiet && came.as_ref().copied().unwrap_or(0) == 0;
        if have == most || (have > 0 && (quiet || over)) {
            if client
                .write_all(piece.get(..have).unwrap_or_default())
                .is_err()
            {
                return Ok(Vec::new());
            }
            have = 0;
        }
        if over {
            return Ok(Vec::new());
        }
    }
}
