//! A device that answers with any bytes, to a real session over a loopback socket: every client ends
//! with a result or an error, in time, and holds no more than a bounded amount of memory.
//!
//! The first byte says which client. Its peer sends all the rest at once, half closes, and reads
//! what the client asks until that leaves.
#![no_main]

use cablepose::hokuyo::client as hokuyo;
use cablepose::gx1::{Command, Session, session::Line};
use cablepose::link::Endpoint;
use cablepose::sick::client as sick;
use cablepose::sick::client::configure::Present;
use cablepose::twincat::symbols;
use cablepose::twincat::{Client, LocalAddress, NetId, Target, client};
use cablepose_fuzz::bounded;
use libfuzzer_sys::fuzz_target;
use std::io::{Read, Write};
use std::net::{Shutdown, TcpListener};
use std::sync::mpsc::{Sender, channel};
use std::sync::{LazyLock, Mutex};
use std::thread;
use std::time::Duration;

/// Nobody is silent here: a wait this long shows a client that hangs.
const PATIENCE: Duration = Duration::from_secs(5);

struct Peer {
    port: u16,
    bytes: Mutex<Sender<Vec<u8>>>,
}

static PEER: LazyLock<Peer> = LazyLock::new(|| {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = listener.local_addr().unwrap().port();
    let (sender, receiver) = channel::<Vec<u8>>();
    thread::spawn(move || {
        for bytes in receiver {
            let (mut stream, _) = listener.accept().unwrap();
            // Without lingering no port stays in use after its connection.
            let _ = socket2::SockRef::from(&stream).set_linger(Some(Duration::ZERO));
            let _ = stream.write_all(&bytes);
            let _ = stream.shutdown(Shutdown::Write);
            while matches!(stream.read(&mut [0; 4096]), Ok(1..)) {}
        }
    });
    Peer { port, bytes: Mutex::new(sender) }
});

fuzz_target!(|data: &[u8]| {
    let Some((which, bytes)) = data.split_first() else {
        return;
    };
    let port = PEER.port;
    PEER.bytes.lock().unwrap().send(bytes.to_vec()).unwrap();
    bounded(96 << 20, || match which % 4 {
        0 => sick(port),
        1 => hokuyo(port),
        2 => gx1(port),
        _ => ads(port),
    });
});

fn endpoint(port: u16) -> Endpoint {
    Endpoint::Tcp { host: "127.0.0.1".to_owned(), port: Some(port) }
}

fn sick(port: u16) {
    let settings = sick::Settings {
        connect: PATIENCE,
        answer: PATIENCE,
        ..sick::Settings::default()
    };
    let Ok(mut client) = sick::Client::connect(&endpoint(port), &settings, None, None) else {
        return;
    };
    let _ = client.status();
    let _ = Present::read(&mut client);
    let _ = sick::facts(&mut client);
    let _ = client.poll();
    while client.next().is_some() {}
}

fn hokuyo(port: u16) {
    let settings = hokuyo::Settings {
        connect: PATIENCE,
        answer: PATIENCE,
        ..hokuyo::Settings::default()
    };
    let Ok(mut client) = hokuyo::Client::connect(&endpoint(port), &settings, None, None) else {
        return;
    };
    let _ = client.read_time();
    let _ = client.fields("VV");
    if let Ok(parameters) = client.parameters() {
        let _ = client.start(&parameters);
    }
    while client.next().is_some() {}
}

fn gx1(port: u16) {
    let line = Line { port: &endpoint(port), bauds: &[38_400], bus_address: None };
    let keep = [Command::StabilisedEulerAccelRate];
    let never = || false;
    let Ok(mut session) = Session::open(&line, &keep, None, Duration::ZERO, &never) else {
        return;
    };
    let _ = session.identity(&never);
    let _ = session.gains(&never);
    let _ = session.tick(&never);
    let _ = session.start(Command::StabilisedEulerAccelRate, &never);
    while session.next().is_some() {}
}

fn ads(port: u16) {
    let target = Target {
        net_id: Some(NetId([127, 0, 0, 1, 1, 1])),
        host: "127.0.0.1".to_owned(),
        tcp_port: Some(port),
        port: 851,
    };
    let local = LocalAddress::NetId(NetId([127, 0, 0, 2, 1, 1]));
    let Ok(mut client) = Client::connect(&target, local, PATIENCE) else {
        return;
    };
    let asked = |client: &mut Client| -> Result<(), client::ClientError> {
        client.state(PATIENCE)?;
        client.device_info(PATIENCE)?;
        symbols::find(client, "MAIN.SickValue", PATIENCE)?;
        symbols::data_type(client, "ST_Pose", PATIENCE)?;
        symbols::all(client, PATIENCE)?;
        Ok(())
    };
    let _ = asked(&mut client);
    while client.notified().is_some() {}
    client.close();
}
