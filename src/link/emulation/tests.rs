//! An emulation's lines and their clients.

use super::*;
use std::net::Shutdown;
use std::sync::atomic::{AtomicBool, Ordering};

const WAIT: Duration = Duration::from_secs(20);

/// Sends back what it hears, in capitals, and ends at a full stop.
#[derive(Default)]
struct Parrot {
    clients: usize,
    heard: usize,
    ended: bool,
}

impl Device for Parrot {
    fn connected(&mut self, _line: LineId, _service: usize, _now_ns: i64) {
        self.clients += 1;
    }
    fn input(&mut self, line: LineId, bytes: &[u8], _now_ns: i64, out: &mut Outbox) {
        self.heard += bytes.len();
        out.reply(line, &bytes.to_ascii_uppercase());
        self.ended |= bytes.contains(&b'.');
    }
    fn advance(&mut self, _now_ns: i64, _out: &mut Outbox) {}
    fn due_ns(&self) -> Option<i64> {
        None
    }
    fn ended(&self) -> bool {
        self.ended
    }
}

fn hear(line: &mut Connection, count: usize) -> Vec<u8> {
    let mut heard = Vec::new();
    let mut buffer = [0; 64];
    while heard.len() < count {
        let received = line.read(&mut buffer, WAIT).unwrap().unwrap();
        heard.extend_from_slice(&buffer[..received.bytes]);
    }
    heard
}

#[test]
fn a_device_is_heard_on_sockets_and_ptys_and_ends_in_order() {
    let mut emulation = Emulation::new(Conditions {
        speed: Some(1.0),
        ..Conditions::default()
    });
    let mut device = Parrot::default();
    let address = emulation.listen("127.0.0.1:0".parse().unwrap()).unwrap();
    let name = format!("cablepose-parrot-{}", std::process::id());
    let link = std::env::temp_dir().join(name);
    emulation.open_pty(&mut device, &link, None).unwrap();
    let talk = std::thread::spawn(move || {
        let open = |place: &str| {
            let place = place.parse().unwrap();
            Connection::open(&place, 0, 115_200, WAIT).unwrap()
        };
        let mut socket = open(&address.to_string());
        let mut serial = open(link.to_str().unwrap());
        serial.write_all(b"polly", WAIT).unwrap();
        assert_eq!(hear(&mut serial, 5), b"POLLY");
        socket.write_all(b"cracker.", WAIT).unwrap();
        assert_eq!(hear(&mut socket, 8), b"CRACKER.");
        let end = socket.read(&mut [0; 8], WAIT);
        assert!(matches!(end, Err(LinkError::Closed { .. })));
    });
    let account = emulation.run(&mut device, || false).unwrap();
    talk.join().unwrap();
    assert_eq!((account.clients, device.clients), (1, 2));
}

#[test]
fn who_reads_no_answers_is_not_read_from() {
    let mut emulation = Emulation::new(Conditions {
        speed: Some(1.0),
        ..Conditions::default()
    });
    let address = emulation.listen("127.0.0.1:0".parse().unwrap()).unwrap();
    let stuck = AtomicBool::new(false);
    std::thread::scope(|scope| {
        scope.spawn(|| {
            let stream = std::net::TcpStream::connect(address).unwrap();
            let mut line = Connection::from_stream(stream.try_clone().unwrap()).unwrap();
            // Answers come back until every buffer on the way is full.
            while line
                .write_all(&[b'x'; 65_536], Duration::from_millis(300))
                .is_ok()
            {}
            stuck.store(true, Ordering::Relaxed);
            stream.shutdown(Shutdown::Both).unwrap();
        });
        let account = emulation.run(&mut Parrot::default(), || stuck.load(Ordering::Relaxed));
        assert_eq!(account.unwrap().clients, 1);
    });
    assert!(stuck.load(Ordering::Relaxed));
}

#[test]
fn who_leaves_without_reading_is_heard_to_the_last_word() {
    let mut emulation = Emulation::new(Conditions {
        speed: Some(1.0),
        ..Conditions::default()
    });
    let address = emulation.listen("127.0.0.1:0".parse().unwrap()).unwrap();
    // Several buffers of requests, all sent and the socket closed before the first is read: the
    // answers cannot be sent.
    let mut said = vec![b'x'; 20_000];
    said.extend(b"bye.");
    let mut stream = std::net::TcpStream::connect(address).unwrap();
    std::io::Write::write_all(&mut stream, &said).unwrap();
    drop(stream);
    let due = Instant::now() + WAIT;
    let mut device = Parrot::default();
    let account = emulation.run(&mut device, || Instant::now() >= due);
    assert_eq!(account.unwrap().clients, 1);
    assert_eq!(device.heard, said.len());
}

#[test]
fn what_was_given_up_is_counted_though_the_line_is_broken_off() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let _client = std::net::TcpStream::connect(listener.local_addr().unwrap()).unwrap();
    let connection = Connection::from_stream(listener.accept().unwrap().0).unwrap();
    let mut emulation = Emulation::new(Conditions::default());
    emulation.add(connection, None, None);
    let line = &mut emulation.lines[0];
    line.enqueue(b"a scan", Message::Data);
    line.hang_up();
    emulation.break_off(&mut Parrot::default());
    let account = emulation.account;
    assert_eq!((account.losses.messages, account.untaken), (1, 1));
}

#[test]
fn data_for_who_has_left_is_counted_and_the_line_removed() {
    /// Talks all the time, until its client has gone.
    #[derive(Default)]
    struct Talker {
        line: Option<LineId>,
        said: u64,
        ended: bool,
    }
    impl Device for Talker {
        fn connected(&mut self, line: LineId, _service: usize, _now_ns: i64) {
            self.line = Some(line);
        }
        fn disconnected(&mut self, _line: LineId) {
            self.ended = true;
        }
        fn input(&mut self, line: LineId, bytes: &[u8], _now_ns: i64, out: &mut Outbox) {
            for _ in bytes {
                out.data(line, &[b'y'; 100]);
                self.said += 1;
            }
        }
        fn advance(&mut self, _now_ns: i64, _out: &mut Outbox) {}
        fn due_ns(&self) -> Option<i64> {
            None
        }
        fn ended(&self) -> bool {
            self.ended
        }
    }
    let mut emulation = Emulation::new(Conditions {
        speed: Some(1.0),
        ..Conditions::default()
    });
    let address = emulation.listen("127.0.0.1:0".parse().unwrap()).unwrap();
    let mut stream = std::net::TcpStream::connect(address).unwrap();
    std::io::Write::write_all(&mut stream, &[b'x'; 10_000]).unwrap();
    drop(stream);
    let due = Instant::now() + WAIT;
    let mut device = Talker::default();
    let account = emulation
        .run(&mut device, || Instant::now() >= due)
        .unwrap();
    assert!(device.ended && device.line.is_some());
    assert_eq!(device.said, 10_000);
    assert_eq!(account.losses.messages + account.crowded_out, device.said);
    assert!(account.untaken > 0);
}
