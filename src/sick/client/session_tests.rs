//! Sessions with scripted peers on loopback sockets.

use super::*;
use crate::link::{Connection, Endpoint, Tap};
use crate::sick::client::commands::DeviceStatus;
use crate::sick::cola::{self, Dialect, Event, Framer};
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::thread::JoinHandle;
use std::time::Duration;

/// A device that answers each request by `answer`, with the bytes it returns; ends with the
/// connection, at the latest after 20 s.
fn device(
    mut answer: impl FnMut(Dialect, &str) -> Vec<u8> + Send + 'static,
) -> (Endpoint, JoinHandle<()>) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let endpoint = listener.local_addr().unwrap().to_string().parse().unwrap();
    let thread = std::thread::spawn(move || {
        let (mut stream, _): (TcpStream, _) = listener.accept().unwrap();
        stream
            .set_read_timeout(Some(Duration::from_secs(20)))
            .unwrap();
        let mut framer = Framer::new();
        let mut chunk = [0; 4096];
        while let Ok(length @ 1..) = stream.read(&mut chunk) {
            framer.feed(&chunk[..length]);
            while let Some(event) = framer.next() {
                if let Event::Telegram(telegram) = event {
                    let text = String::from_utf8_lossy(telegram.body).into_owned();
                    let bytes = answer(telegram.dialect, &text);
                    if stream.write_all(&bytes).is_err() {
                        return;
                    }
                }
            }
        }
    });
    (endpoint, thread)
}

fn framed(dialect: Dialect, body: &[u8]) -> Vec<u8> {
    let mut out = Vec::new();
    cola::frame(dialect, body, &mut out);
    out
}

/// Answers the probe in `spoken`, and in the other dialect as a real device might.
fn probe_answer(spoken: Dialect, heard: Dialect, text: &str) -> Option<Vec<u8>> {
    if heard != spoken {
        return Some(match spoken {
            // Seen on a CoLa A port that got CoLa B.
            Dialect::Text => framed(spoken, b"sFA 11"),
            Dialect::Binary => Vec::new(),
        });
    }
    match text {
        "sRN SCdevicestate" => Some(match spoken {
            Dialect::Text => framed(spoken, b"sRA SCdevicestate 1"),
            Dialect::Binary => framed(spoken, b"sRA SCdevicestate \x01"),
        }),
        "sRN DeviceIdent" => Some(match spoken {
            Dialect::Text => framed(spoken, b"sRA DeviceIdent 3 LMS 1 1"),
            Dialect::Binary => framed(spoken, b"sRA DeviceIdent \0\x03LMS\0\x011"),
        }),
        _ => None,
    }
}

fn settings() -> Settings {
    Settings {
        answer: Duration::from_secs(10),
        ..Settings::default()
    }
}

#[test]
fn the_dialect_is_found_out() {
    for spoken in [Dialect::Text, Dialect::Binary] {
        let (endpoint, device) = device(move |heard, text| {
            probe_answer(spoken, heard, text).unwrap_or_else(|| framed(spoken, b"sFA 3"))
        });
        let client = Client::connect(&endpoint, &settings(), None, None).unwrap();
        assert_eq!(client.dialect(), spoken);
        drop(client);
        device.join().unwrap();
    }
}

#[test]
fn a_device_that_speaks_both_is_taken_in_one_and_the_rest_passes_by() {
    let (endpoint, device) = device(move |heard, text| {
        probe_answer(heard, heard, text).unwrap_or_else(|| match heard {
            Dialect::Text => framed(heard, b"sFA 3"),
            Dialect::Binary => framed(heard, b"sRA LCMstate \x01"),
        })
    });
    let mut client = Client::connect(&endpoint, &settings(), None, None).unwrap();
    assert_eq!(client.dialect(), Dialect::Binary);
    let state = client
        .ask(
            &commands::Contamination::request(),
            commands::Contamination::parse,
        )
        .unwrap();
    assert_eq!(state, commands::Contamination(1));
    drop(client);
    device.join().unwrap();
}

#[test]
fn who_says_nothing_is_given_up() {
    let (endpoint, device) = device(|_, _| Vec::new());
    let short = Settings {
        answer: Duration::from_millis(50),
        ..Settings::default()
    };
    let error = Client::connect(&endpoint, &short, None, None)
        .err()
        .unwrap();
    let text = error.to_string();
    assert!(
        text.contains("nothing came at all") && text.contains("2111"),
        "{text}"
    );
    device.join().unwrap();
}

#[test]
fn events_between_request_and_reply_are_kept_in_order() {
    let (endpoint, device) = device(|heard, text| {
        probe_answer(Dialect::Text, heard, text).unwrap_or_else(|| {
            let mut out = framed(Dialect::Text, b"sSN LIDoutputstate 0 1");
            out.extend(b"noise");
            out.extend(framed(Dialect::Text, b"sSN LFErec 0"));
            out.extend(framed(
                Dialect::Text,
                b"sRA STlms 7 0 8 16:36:54 A 17.03.2030 0 0 0 0 0 0",
            ));
            // Behind the reply in the same chunk.
            out.extend(framed(Dialect::Text, b"sSN LIDoutputstate 0 2"));
            out
        })
    });
    let tapped = std::rc::Rc::new(std::cell::RefCell::new(0));
    let seen = std::rc::Rc::clone(&tapped);
    let tap: Tap = Box::new(move |bytes, _| *seen.borrow_mut() += bytes.len());
    let mut client = Client::connect(&endpoint, &settings(), Some(tap), None).unwrap();
    for _ in 0..2 {
        let status: DeviceStatus = client.status().unwrap();
        assert_eq!(status.state, DeviceStatus::MEASURING);
    }
    // What came behind the second reply may still be on its way.
    let mut found = Vec::new();
    while found.len() < 8 {
        while let Some(incoming) = client.next() {
            found.push(match incoming {
                Incoming::Telegram { telegram, at } => {
                    assert!(at.raw_ns > 0);
                    String::from_utf8_lossy(telegram.body).into_owned()
                }
                Incoming::Skipped(skipped) => format!("{} bytes", skipped.bytes),
            });
        }
        if found.len() < 8 {
            assert!(client.wait(Duration::from_secs(10)).unwrap());
        }
    }
    let once = [
        "sSN LIDoutputstate 0 1",
        "5 bytes",
        "sSN LFErec 0",
        "sSN LIDoutputstate 0 2",
    ];
    assert_eq!(found[..4], once);
    assert_eq!(found[4..], once);
    assert!(*tapped.borrow() > 200);
    drop(client);
    device.join().unwrap();
}

#[test]
fn refusals_and_failures_say_what_to_do() {
    let (endpoint, device) = device(|heard, text| {
        probe_answer(Dialect::Binary, heard, text).unwrap_or_else(|| {
            if text.starts_with("sMN SetAccessMode") {
                framed(heard, b"sAN SetAccessMode \0")
            } else {
                framed(heard, b"sFA\0\x0A")
            }
        })
    });
    let mut client = Client::connect(&endpoint, &settings(), None, None).unwrap();
    let refused = client.log_in(0x1234_5678);
    let text = refused.unwrap_err().to_string();
    assert!(
        text.contains("--password-file") && !text.contains("12345678"),
        "{text}"
    );
    let text = client.run().unwrap_err().to_string();
    assert!(text.contains("sFA A, write access denied"), "{text}");
    let unknown = client.ask_if_known(&DeviceStatus::request(), DeviceStatus::parse);
    assert!(unknown.unwrap().is_none());
    drop(client);
    device.join().unwrap();
}

#[test]
fn a_reply_has_its_times_and_silence_its_limit() {
    let (endpoint, device) = device(|heard, text| {
        probe_answer(Dialect::Text, heard, text).unwrap_or_else(|| match text {
            "sRN LMDscandata" => framed(heard, b"sRA LMDscandata 1"),
            _ => Vec::new(),
        })
    });
    let mut client = Client::connect(&endpoint, &settings(), None, None).unwrap();
    let reply = client.poll().unwrap();
    assert!(reply.sent.raw_ns <= reply.first.raw_ns);
    assert!(reply.first.raw_ns <= reply.received.raw_ns);
    let limit = Duration::from_millis(30);
    let error = client.request_within(&Request::read("Nothing"), limit);
    assert!(matches!(error, Err(ClientError::Silent { .. })));
    client.set_interrupted(Some(Box::new(|| true)));
    let error = client.request(&Request::read("Nothing"));
    assert!(matches!(error, Err(ClientError::Interrupted)));
    drop(client);
    device.join().unwrap();
}

#[test]
fn an_open_line_can_be_handed_over() {
    let (endpoint, device) =
        device(|heard, text| probe_answer(Dialect::Text, heard, text).unwrap_or_default());
    let line = Connection::open(&endpoint, 0, 0, Duration::from_secs(10)).unwrap();
    let only = Settings {
        dialect: Some(Dialect::Text),
        ..settings()
    };
    let client = Client::start(line, &only, None, None).unwrap();
    assert_eq!(client.dialect(), Dialect::Text);
    drop(client);
    device.join().unwrap();
}
