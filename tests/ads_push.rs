//! ads-push as people run it, against an emulated PLC: what is written, what goes on to stdout, and
//! every fault that a controller and its line can have.

mod shell;

use cablepose::link::emulation::Conditions;
use cablepose::twincat::Code;
use cablepose::twincat::emulator::{Plc, Service, SharedPlc};
use cablepose::twincat::route::{Credentials, answer};
use shell::{scratch, sh};
use std::fs::File;
use std::io::{Read, Write};
use std::net::{SocketAddr, UdpSocket};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// As long as anything may take on a busy machine.
const LONG: Duration = Duration::from_secs(60);
const SYMBOL: &str = "MAIN.SickValue";
const STALE: u32 = 1 << 16;
const ENDED: u32 = 1 << 17;

fn serve(plc: Plc) -> (SharedPlc, Service) {
    let plc = SharedPlc::new(plc);
    let service = serve_at(&plc, ([127, 0, 0, 1], 0).into());
    (plc, service)
}

/// The address may still be held for a moment by the service before.
fn serve_at(plc: &SharedPlc, address: SocketAddr) -> Service {
    let due = Instant::now() + LONG;
    loop {
        match Service::start(plc, address, Conditions::default()) {
            Ok(service) => return service,
            Err(error) if Instant::now() > due => panic!("{error}"),
            Err(_) => std::thread::sleep(Duration::from_millis(20)),
        }
    }
}

const HEADER: &str =
    "stamp_ns,scan_stamp_ns,seq,x_m,y_m,z_m,roll_rad,pitch_rad,yaw_rad,note,status\n";

fn row(seq: u64) -> String {
    let x = seq as f64 / 8.0;
    format!(
        "{},{},{seq},{x},-2.5,1.50,0.01,-0.02,0.03,\"n, {seq}\",no-imu\n",
        1_000_000_000 + seq,
        seq
    )
}

/// The first numbers of what row `seq` makes of the variable.
fn written(seq: u64) -> [f64; 6] {
    [seq as f64 / 8.0, -2.5, 1.5, 0.01, -0.02, 0.03]
}

/// A running ads-push.
struct Running {
    child: Child,
    stdin: Option<ChildStdin>,
    stdout: JoinHandle<Vec<u8>>,
    stderr: JoinHandle<()>,
    said: Arc<std::sync::Mutex<String>>,
}

struct Done {
    status: i32,
    stdout: Vec<u8>,
    stderr: String,
}

impl Running {
    fn start(arguments: &[&str]) -> Running {
        Running::start_in(Path::new("."), arguments, &[])
    }

    fn start_in(dir: &Path, arguments: &[&str], variables: &[(&str, &str)]) -> Running {
        let mut child = Command::new(env!("CARGO_BIN_EXE_ads-push"))
            .args(arguments)
            .envs(variables.iter().copied())
            .current_dir(dir)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut out = child.stdout.take().unwrap();
        let stdout = std::thread::spawn(move || {
            let mut bytes = Vec::new();
            out.read_to_end(&mut bytes).unwrap();
            bytes
        });
        let said = Arc::new(std::sync::Mutex::new(String::new()));
        let (mut err, heard) = (child.stderr.take().unwrap(), Arc::clone(&said));
        let stderr = std::thread::spawn(move || {
            let mut piece = [0; 512];
            while let Ok(count @ 1..) = err.read(&mut piece) {
                let text = String::from_utf8_lossy(&piece[..count]).into_owned();
                heard.lock().unwrap().push_str(&text);
            }
        });
        Running {
            stdin: child.stdin.take(),
            child,
            stdout,
            stderr,
            said,
        }
    }

    fn feed(&mut self, text: &str) {
        self.stdin
            .as_mut()
            .unwrap()
            .write_all(text.as_bytes())
            .unwrap();
    }

    /// Waits until stderr has a text.
    #[track_caller]
    fn hears(&self, text: &str) {
        let due = Instant::now() + LONG;
        while !self.said.lock().unwrap().contains(text) {
            assert!(
                Instant::now() < due,
                "no {text:?} in: {}",
                self.said.lock().unwrap()
            );
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    fn end(mut self) -> Done {
        self.stdin = None;
        self.wait()
    }

    fn wait(mut self) -> Done {
        let due = Instant::now() + LONG;
        let status = loop {
            if let Some(status) = self.child.try_wait().unwrap() {
                break status;
            }
            if Instant::now() > due {
                self.child.kill().unwrap();
                panic!("it does not end: {}", self.said.lock().unwrap());
            }
            std::thread::sleep(Duration::from_millis(5));
        };
        let stdout = self.stdout.join().unwrap();
        self.stderr.join().unwrap();
        Done {
            status: status.code().unwrap_or(-1),
            stdout,
            stderr: self.said.lock().unwrap().clone(),
        }
    }
}

/// Poses at 100 Hz until told to stop.
struct Feeder {
    stop: Arc<AtomicBool>,
    fed: Arc<AtomicU64>,
    thread: JoinHandle<ChildStdin>,
}

impl Feeder {
    fn start(running: &mut Running) -> Feeder {
        let mut stdin = running.stdin.take().unwrap();
        let stop = Arc::new(AtomicBool::new(false));
        let fed = Arc::new(AtomicU64::new(0));
        let (asked, count) = (Arc::clone(&stop), Arc::clone(&fed));
        let thread = std::thread::spawn(move || {
            stdin.write_all(HEADER.as_bytes()).unwrap();
            let mut seq = 0;
            while !asked.load(Ordering::Relaxed) {
                // A program that has ended takes no more.
                if stdin.write_all(row(seq).as_bytes()).is_err() {
                    break;
                }
                seq += 1;
                count.store(seq, Ordering::Relaxed);
                std::thread::sleep(Duration::from_millis(10));
            }
            stdin
        });
        Feeder { stop, fed, thread }
    }

    fn end(self) {
        self.stop.store(true, Ordering::Relaxed);
        drop(self.thread.join().unwrap());
    }
}

/// Waits until a variable has been written so many more times.
#[track_caller]
fn more_writes(plc: &SharedPlc, more: u64) {
    let before = plc.lock().writes(SYMBOL);
    let done = plc.wait_until(LONG, |plc| plc.writes(SYMBOL) >= before + more);
    assert!(done, "no {more} writes more");
}

fn status_word(plc: &SharedPlc) -> u32 {
    plc.lock().lreals(SYMBOL)[7] as u32
}

#[track_caller]
fn ends(done: Done, status: i32, texts: &[&str]) -> Done {
    assert_eq!(done.status, status, "{}", done.stderr);
    for text in texts {
        assert!(
            done.stderr.contains(text),
            "no {text:?} in: {}",
            done.stderr
        );
    }
    assert!(!done.stderr.contains("os error"), "{}", done.stderr);
    done
}

#[test]
fn every_pose_is_written_and_passed_on_byte_by_byte() {
    let (plc, service) = serve(Plc::with_sick_value());
    plc.lock().keep_journal = true;
    let mut running = Running::start(&[&service.target(&plc), SYMBOL, "--every", "-v"]);
    let text: String = [HEADER.to_owned()]
        .into_iter()
        .chain((0..500).map(row))
        .collect();
    running.feed(&text);
    let done = ends(running.end(), 0, &["500 poses written", "round trips"]);
    assert_eq!(done.stdout, text.as_bytes());
    let plc = plc.lock();
    // One more for the last status.
    assert_eq!(plc.journal.len(), 501);
    for (seq, (name, bytes)) in plc.journal.iter().enumerate() {
        assert_eq!((name.as_str(), bytes.len()), (SYMBOL, 72));
        let numbers: Vec<f64> = bytes
            .chunks_exact(8)
            .map(|chunk| f64::from_le_bytes(chunk.try_into().unwrap()))
            .collect();
        let pose = (seq as u64).min(499);
        assert_eq!(numbers[..6], written(pose));
        assert_eq!(numbers[6], (1_000_000_000 + pose) as f64 / 1e9);
        let ended = if seq == 500 { ENDED } else { 0 };
        // no-imu is bit 8.
        assert_eq!(
            (numbers[7], numbers[8]),
            (f64::from(1 << 8 | ended), seq as f64 + 1.0)
        );
    }
}

#[test]
fn mcap_passes_on_byte_by_byte() {
    let dir = scratch("ads-mcap");
    let run = "simulate -f frame.toml --n-scans 30 --format mcap | extract-lines -f frame.toml \
               | solve-pose -f frame.toml > poses.mcap";
    sh(&dir, run).expect(0);
    let (plc, service) = serve(Plc::with_sick_value());
    let push = format!(
        "ads-push {} {SYMBOL} --every < poses.mcap > passed.mcap",
        service.target(&plc)
    );
    sh(&dir, &push).expect(0);
    let read = |name: &str| std::fs::read(dir.join(name)).unwrap();
    assert!(read("poses.mcap") == read("passed.mcap"));
    assert_eq!(plc.lock().writes(SYMBOL), 31);
}

#[test]
fn one_variable_a_field_and_a_structure() {
    let mut plc = Plc::default();
    for (name, of) in [
        ("MAIN.fX", "REAL"),
        ("MAIN.nSeq", "UINT"),
        ("MAIN.nState", "DWORD"),
    ] {
        assert!(plc.declare(name, of));
    }
    let members = [
        ("x", "LREAL"),
        ("fYaw", "REAL"),
        ("counter", "ULINT"),
        ("bOk", "BOOL"),
    ];
    assert!(plc.declare_struct("ST_Pose", &members));
    assert!(plc.declare("GVL.stPose", "ST_Pose"));
    let (plc, service) = serve(plc);
    let target = service.target(&plc);
    let arguments = [
        &target,
        "MAIN.fX=x:mm",
        "MAIN.nSeq=sequence",
        "MAIN.nState=status",
    ];
    let mut running = Running::start(&arguments);
    running.feed(&(HEADER.to_owned() + &row(80_000)));
    ends(running.end(), 0, &[]);
    let value = |name: &str| plc.lock().find(name).unwrap().value.clone();
    assert_eq!(value("MAIN.fX"), 1e7f32.to_le_bytes());
    assert_eq!(value("MAIN.nSeq"), ((80_000 % 65_536) as u16).to_le_bytes());
    assert_eq!(value("MAIN.nState"), (1 << 8 | ENDED).to_le_bytes());
    let fields = "x=x,fYaw=yaw:mrad,counter=counter,bOk=valid";
    let mut running = Running::start(&[&target, "GVL.stPose", "--fields", fields, "--every"]);
    running.feed(&(HEADER.to_owned() + &row(8)));
    ends(running.end(), 0, &[]);
    let expected = [
        &1f64.to_le_bytes()[..],
        &30f32.to_le_bytes(),
        &[0; 4],
        &2u64.to_le_bytes(),
        &[0; 8],
    ];
    assert_eq!(value("GVL.stPose"), expected.concat());
}

#[test]
fn what_does_not_fit_is_never_written() {
    let mut plc = Plc::default();
    assert!(plc.declare(SYMBOL, "ARRAY [0..6] OF LREAL"));
    assert!(plc.declare("MAIN.sText", "ARRAY [0..8] OF LREAL"));
    plc.set_read_only("MAIN.sText");
    let (plc, service) = serve(plc);
    let target = service.target(&plc);
    let push = |arguments: &[&str]| {
        let mut all = vec![target.as_str()];
        all.extend(arguments);
        let running = Running::start(&all);
        running.end()
    };
    let both = [
        "7 LREAL (56 bytes)",
        "9 LREAL (72 bytes)",
        "Nothing was written",
    ];
    ends(push(&[SYMBOL]), 78, &both);
    ends(
        push(&["MAIN.NoSuch"]),
        78,
        &["MAIN.NoSuch", "no such symbol", "list"],
    );
    ends(push(&["MAIN.sText"]), 78, &["does not let it be written"]);
    ends(
        push(&[SYMBOL, "--layout", "9*LREAL"]),
        78,
        &["56 bytes", "72 bytes"],
    );
    ends(push(&[]), 2, &["which variable"]);
    ends(push(&[SYMBOL, "--fields", "vx"]), 2, &["read only"]);
    assert_eq!(plc.lock().writes(SYMBOL), 0);
}

#[test]
fn the_poses_flow_on_without_a_controller() {
    let (plc, service) = serve(Plc::with_sick_value());
    let (target, address) = (service.target(&plc), service.address());
    drop(service);
    let text = HEADER.to_owned() + &row(1) + &row(2);
    let mut running = Running::start(&[&target, SYMBOL, "--wait", "300ms"]);
    running.feed(&text);
    let done = ends(running.wait(), 69, &["Connection refused", "trying again"]);
    assert_eq!(done.stdout, text.as_bytes());
    // A controller that comes later is found, and a pose that waited is written.
    let mut running = Running::start(&[&target, SYMBOL, "--wait", "60s"]);
    running.feed(&text);
    running.hears("trying again");
    let _service = serve_at(&plc, address);
    more_writes(&plc, 1);
    ends(running.end(), 0, &["connected as"]);
    assert_eq!(plc.lock().lreals(SYMBOL)[..6], written(2));
}

#[test]
fn a_controller_that_restarts_is_found_again() {
    let (plc, service) = serve(Plc::with_sick_value());
    let (target, address) = (service.target(&plc), service.address());
    let mut running = Running::start(&[&target, SYMBOL]);
    let feeder = Feeder::start(&mut running);
    more_writes(&plc, 10);
    drop(service);
    running.hears("connecting again");
    // It has forgotten everything, its handles too.
    let fresh = SharedPlc::new(Plc::with_sick_value());
    let _service = serve_at(&fresh, address);
    more_writes(&fresh, 10);
    running.hears("connected again after");
    let fed = Arc::clone(&feeder.fed);
    feeder.end();
    let done = ends(running.wait(), 3, &["while the controller was away"]);
    let rows = String::from_utf8(done.stdout).unwrap().lines().count() as u64;
    assert_eq!(rows, fed.load(Ordering::Relaxed) + 1);
    assert_eq!(status_word(&fresh) & ENDED, ENDED);
}

#[test]
fn a_changed_program_is_checked_again() {
    let (plc, service) = serve(Plc::with_sick_value());
    let mut running = Running::start(&[&service.target(&plc), SYMBOL]);
    let feeder = Feeder::start(&mut running);
    more_writes(&plc, 10);
    // The same variable at another place, and every handle gone.
    plc.lock().download(|plc| {
        plc.declare("MAIN.fOther", "LREAL");
    });
    running.hears("found and checked again");
    more_writes(&plc, 10);
    assert_eq!(plc.lock().connections, 1);
    feeder.end();
    ends(running.wait(), 0, &[]);
}

/// A controller that takes every question and no write must not be asked as fast as can be.
#[test]
fn writes_that_are_always_refused_are_held_back() {
    let (plc, service) = serve(Plc::with_sick_value());
    let mut running = Running::start(&[&service.target(&plc), SYMBOL]);
    let feeder = Feeder::start(&mut running);
    more_writes(&plc, 10);
    plc.lock().trouble.refuse = Some(Code::OLD_SYMBOL);
    running.hears("though the variables were found a moment ago");
    let renewed = running
        .said
        .lock()
        .unwrap()
        .matches("checked again, and fit")
        .count();
    assert!(renewed <= 1, "{renewed}");
    plc.lock().trouble.refuse = None;
    more_writes(&plc, 10);
    feeder.end();
    ends(running.wait(), 3, &["connected again after"]);
}

/// With --every a pose that is refused waits for its turn, and the controller has time for others.
#[test]
fn a_pose_that_waits_for_its_turn_is_not_tried_as_fast_as_can_be() {
    let (plc, service) = serve(Plc::with_sick_value());
    let mut running = Running::start(&[&service.target(&plc), SYMBOL, "--every"]);
    let feeder = Feeder::start(&mut running);
    more_writes(&plc, 10);
    plc.lock().trouble.refuse = Some(Code::DENIED);
    running.hears("not permitted");
    let before = plc.lock().requests;
    std::thread::sleep(Duration::from_millis(500));
    let asked = plc.lock().requests - before;
    assert!(asked < 50, "{asked}");
    plc.lock().trouble.refuse = None;
    more_writes(&plc, 10);
    feeder.end();
    ends(running.wait(), 0, &[]);
}

/// Two programs on one host: each gets its turn, and the controller is not flooded.
#[test]
fn two_that_end_each_others_connections_both_write() {
    let (plc, service) = serve(Plc::with_sick_value());
    plc.lock().trouble.one_connection = true;
    let target = service.target(&plc);
    let mut both = [(); 2].map(|()| Running::start(&[&target, SYMBOL]));
    let feeders: Vec<Feeder> = both.iter_mut().map(Feeder::start).collect();
    for running in &both {
        running.hears("connected again after");
        running.hears("keeps one connection a host");
    }
    feeders.into_iter().for_each(Feeder::end);
    for running in both {
        let done = running.wait();
        assert_eq!(done.status, 3, "{}", done.stderr);
        assert!(!done.stderr.contains(" 0 poses written"), "{}", done.stderr);
    }
}

#[test]
fn poses_before_the_first_connection_are_told() {
    let plc = SharedPlc::new(Plc::with_sick_value());
    let service = serve_at(&plc, ([127, 0, 0, 1], 0).into());
    let (target, address) = (service.target(&plc), service.address());
    drop(service);
    let mut running = Running::start(&[&target, SYMBOL, "--wait", "60s"]);
    let feeder = Feeder::start(&mut running);
    running.hears("trying again");
    let fed = feeder.fed.load(Ordering::Relaxed);
    let due = Instant::now() + LONG;
    while feeder.fed.load(Ordering::Relaxed) < fed + 20 && Instant::now() < due {
        std::thread::sleep(Duration::from_millis(5));
    }
    let _service = serve_at(&plc, address);
    more_writes(&plc, 5);
    feeder.end();
    let texts = ["not written before the first connection"];
    ends(running.wait(), 0, &texts);
}

#[test]
fn a_renamed_variable_ends_with_78() {
    let (plc, service) = serve(Plc::with_sick_value());
    let mut running = Running::start(&[&service.target(&plc), SYMBOL, "--wait", "400ms"]);
    let feeder = Feeder::start(&mut running);
    more_writes(&plc, 10);
    plc.lock().download(|plc| plc.rename(SYMBOL, "MAIN.Other"));
    ends(
        running.wait(),
        78,
        &[SYMBOL, "no such symbol", "trying again"],
    );
    assert_eq!(plc.lock().find("MAIN.Other").unwrap().value.len(), 72);
    feeder.end();
}

#[test]
fn a_variable_that_comes_back_is_written_again() {
    let (plc, service) = serve(Plc::with_sick_value());
    let mut running = Running::start(&[&service.target(&plc), SYMBOL, "--wait", "60s"]);
    let feeder = Feeder::start(&mut running);
    more_writes(&plc, 10);
    plc.lock().download(|plc| plc.rename(SYMBOL, "MAIN.Other"));
    running.hears("trying again");
    plc.lock().download(|plc| plc.rename("MAIN.Other", SYMBOL));
    more_writes(&plc, 10);
    feeder.end();
    ends(running.wait(), 3, &["connected again after"]);
}

#[test]
fn another_size_is_never_written_to() {
    let (plc, service) = serve(Plc::with_sick_value());
    plc.lock().keep_journal = true;
    let mut running = Running::start(&[&service.target(&plc), SYMBOL, "--wait", "400ms"]);
    let feeder = Feeder::start(&mut running);
    more_writes(&plc, 10);
    plc.lock().download(|plc| {
        plc.remove(SYMBOL);
        plc.declare(SYMBOL, "ARRAY [0..9] OF LREAL");
        plc.journal.clear();
    });
    ends(
        running.wait(),
        78,
        &["10 LREAL (80 bytes)", "9 LREAL (72 bytes)"],
    );
    assert!(plc.lock().journal.is_empty());
    assert_eq!(plc.lock().lreals(SYMBOL), [0.0; 10]);
    feeder.end();
}

#[test]
fn a_late_answer_costs_one_pose_and_no_connection() {
    let (plc, service) = serve(Plc::with_sick_value());
    let mut running = Running::start(&[&service.target(&plc), SYMBOL, "--timeout", "150ms"]);
    let feeder = Feeder::start(&mut running);
    more_writes(&plc, 10);
    {
        let mut plc = plc.lock();
        plc.trouble.late = 1;
        plc.trouble.late_ns = 400_000_000;
    }
    running.hears("no answer within 150 ms");
    more_writes(&plc, 60);
    assert_eq!(plc.lock().connections, 1);
    feeder.end();
    ends(running.wait(), 3, &["sent and not acknowledged"]);
}

#[test]
fn a_line_that_is_dead_at_the_other_end_is_left() {
    let (plc, service) = serve(Plc::with_sick_value());
    let mut running = Running::start(&[&service.target(&plc), SYMBOL, "--timeout", "100ms"]);
    let feeder = Feeder::start(&mut running);
    more_writes(&plc, 10);
    plc.lock().trouble.mute = true;
    running.hears("no answer within");
    running.hears("trying again");
    plc.lock().trouble.mute = false;
    more_writes(&plc, 10);
    running.hears("connected again");
    assert!(plc.lock().connections >= 2);
    feeder.end();
    ends(running.wait(), 3, &[]);
}

#[test]
fn garbage_and_a_closed_port_are_survived() {
    let (plc, service) = serve(Plc::with_sick_value());
    let mut running = Running::start(&[&service.target(&plc), SYMBOL]);
    let feeder = Feeder::start(&mut running);
    more_writes(&plc, 10);
    plc.lock().trouble.garbage = Some(b"HTTP/1.1 400 Bad Request\r\n\r\n".to_vec());
    running.hears("no ADS");
    more_writes(&plc, 10);
    plc.lock().trouble.port_closed = true;
    running.hears("no server has that AMS port");
    plc.lock().trouble.port_closed = false;
    more_writes(&plc, 10);
    plc.lock().state = 6;
    running.hears("the PLC is in STOP now");
    feeder.end();
    ends(running.wait(), 3, &[]);
}

#[test]
fn a_missing_route_is_named() {
    let (plc, service) = serve(Plc::with_sick_value());
    plc.lock().trouble.no_route = true;
    let mut running = Running::start(&[&service.target(&plc), SYMBOL, "--wait", "200ms"]);
    running.feed(&(HEADER.to_owned() + &row(1)));
    ends(running.end(), 69, &["have a route for NetId 127.0.0.1.1.1"]);
    plc.lock().trouble.no_route = false;
    let target = service
        .target(&plc)
        .replace("127.0.0.1.1.1", "10.9.8.7.1.1");
    let mut running = Running::start(&[&target, SYMBOL, "--wait", "200ms"]);
    running.feed(&(HEADER.to_owned() + &row(1)));
    ends(running.end(), 69, &["the target machine is not known"]);
}

#[test]
fn a_silent_input_is_told_to_the_controller() {
    let (plc, service) = serve(Plc::with_sick_value());
    let mut running = Running::start(&[&service.target(&plc), SYMBOL, "--stale", "100ms"]);
    // Nothing has come yet.
    let stale = |plc: &Plc| plc.lreals(SYMBOL)[7] as u32 & STALE != 0;
    assert!(plc.wait_until(LONG, stale));
    assert_eq!(status_word(&plc) & 1, 1);
    running.feed(&(HEADER.to_owned() + &row(3)));
    let fresh = |plc: &Plc| plc.lreals(SYMBOL)[7] as u32 == 1 << 8;
    assert!(plc.wait_until(LONG, fresh));
    assert!(plc.wait_until(LONG, stale));
    let counter = plc.lock().lreals(SYMBOL)[8];
    let counts = |plc: &Plc| plc.lreals(SYMBOL)[8] > counter + 1.0;
    assert!(plc.wait_until(LONG, counts));
    // The values stay.
    assert_eq!(plc.lock().lreals(SYMBOL)[..6], written(3));
    ends(running.end(), 0, &[]);
    assert_eq!(status_word(&plc), 1 << 8 | ENDED);
}

#[test]
fn sigterm_and_bad_data_leave_a_last_status() {
    let (plc, service) = serve(Plc::with_sick_value());
    let mut running = Running::start(&[&service.target(&plc), SYMBOL]);
    running.feed(&(HEADER.to_owned() + &row(3)));
    more_writes(&plc, 1);
    let kill = format!("kill -TERM {}", running.child.id());
    sh(Path::new("."), &kill).expect(0);
    let stdin = running.stdin.take();
    ends(running.wait(), 0, &[]);
    drop(stdin);
    assert_eq!(status_word(&plc), 1 << 8 | ENDED);
    let mut running = Running::start(&[&service.target(&plc), SYMBOL]);
    running.feed(&(HEADER.to_owned() + &row(4) + "5,5,5,?,0,0,0,0,0,,ok\n"));
    ends(running.wait(), 65, &["stdin:3: x_m"]);
    assert_eq!(plc.lock().lreals(SYMBOL)[..6], written(4));
    assert_eq!(status_word(&plc) & ENDED, ENDED);
}

#[test]
fn the_newest_pose_overtakes() {
    let (plc, service) = serve(Plc::with_sick_value());
    {
        let mut plc = plc.lock();
        plc.trouble.late = 1_000_000;
        plc.trouble.late_ns = 50_000_000;
    }
    let mut running = Running::start(&[&service.target(&plc), SYMBOL, "--timeout", "20s"]);
    let feeder = Feeder::start(&mut running);
    more_writes(&plc, 8);
    feeder.end();
    ends(running.wait(), 0, &["passed over for newer ones"]);
}

#[test]
fn pushes_are_stamped() {
    let (plc, service) = serve(Plc::with_sick_value());
    let mut running = Running::start(&[&service.target(&plc), SYMBOL, "--stamp-push"]);
    let text: String = [HEADER.to_owned()]
        .into_iter()
        .chain((0..50).map(row))
        .collect();
    running.feed(&text);
    let done = ends(running.end(), 0, &[]);
    assert_eq!(plc.lock().writes(SYMBOL), 51);
    let mut reader = csv::Reader::from_reader(&done.stdout[..]);
    let place = reader
        .headers()
        .unwrap()
        .iter()
        .position(|name| name == "pushed_ns");
    let stamps: Vec<i64> = reader
        .records()
        .map(|row| row.unwrap()[place.unwrap()].parse().unwrap())
        .collect();
    assert_eq!(stamps.len(), 50);
    assert!(stamps.is_sorted() && stamps[0] > 1_700_000_000_000_000_000);
}

fn desired() -> Plc {
    let mut plc = Plc::with_sick_value();
    let members = [
        ("nTime", "ULINT"),
        ("x", "LREAL"),
        ("y", "LREAL"),
        ("vy", "LREAL"),
    ];
    assert!(plc.declare_struct("ST_Desired", &members));
    assert!(plc.declare("GVL.stDesired", "ST_Desired"));
    plc
}

/// Lets the controller's motion go on until told to stop: its clock counts 100 ns since 1601, and is
/// an hour off.
fn moving(plc: &SharedPlc) -> (Arc<AtomicBool>, JoinHandle<()>) {
    let now = || {
        let since = std::time::SystemTime::UNIX_EPOCH.elapsed();
        since.unwrap().as_nanos()
    };
    let start = now();
    let set = {
        let plc = plc.clone();
        move || {
            let now = now();
            let ticks = now / 100 + 116_444_736_000_000_000 + 36_000_000_000;
            let y = (now - start) as f64 * 1e-9;
            let mut bytes = (ticks as u64).to_le_bytes().to_vec();
            for number in [250.0, y, 1.0f64] {
                bytes.extend_from_slice(&number.to_le_bytes());
            }
            plc.lock().set("GVL.stDesired", &bytes);
        }
    };
    // Nobody is to see it before it moves.
    set();
    let stop = Arc::new(AtomicBool::new(false));
    let asked = Arc::clone(&stop);
    let thread = std::thread::spawn(move || {
        while !asked.load(Ordering::Relaxed) {
            set();
            std::thread::sleep(Duration::from_millis(2));
        }
    });
    (stop, thread)
}

const DESIRED: &str = "nTime=stamp:filetime,x=x:mm,y=y,vy=vy";

/// Stamps, ns, and y of a trajectory.
fn points(text: &[u8]) -> Vec<(i64, f64)> {
    let mut reader = csv::Reader::from_reader(text);
    let header = reader.headers().unwrap().clone();
    let place = |name: &str| header.iter().position(|column| column == name).unwrap();
    let (stamp, x, y, vy) = (
        place("stamp_ns"),
        place("x_m"),
        place("y_m"),
        place("vy_m_s"),
    );
    let mut points = Vec::new();
    for row in reader.records() {
        let row = row.unwrap();
        assert_eq!((&row[x], &row[vy]), ("0.25", "1"));
        points.push((row[stamp].parse().unwrap(), row[y].parse().unwrap()));
    }
    points
}

#[test]
fn the_desired_motion_is_read() {
    let (plc, service) = serve(desired());
    let (stop, thread) = moving(&plc);
    let target = service.target(&plc);
    let shared = [
        "--read",
        "GVL.stDesired",
        "-n",
        "40",
        "--read-fields",
        DESIRED,
    ];
    for further in [
        &["--read-period", "5ms"][..],
        &["--poll", "5ms"],
        &["--read-time", "arrival"],
        &["--read-time", "notified"],
        &["--read-time", "plc"],
    ] {
        let arguments = [&[target.as_str()], &shared[..], further].concat();
        let running = Running::start(&arguments);
        let texts: &[&str] = match further {
            ["--read-time", "arrival"] => &["stamped on arrival"],
            _ => &[],
        };
        let done = ends(running.wait(), 0, texts);
        let points = points(&done.stdout);
        assert_eq!(points.len(), 40, "{further:?}");
        let now = std::time::SystemTime::UNIX_EPOCH
            .elapsed()
            .unwrap()
            .as_nanos() as i64;
        let hour = if further[1] == "plc" { 3600 } else { 0 };
        for pair in points.windows(2) {
            assert!(pair[0].0 < pair[1].0, "{further:?}");
            let late_s = (now - pair[1].0) / 1_000_000_000 + hour;
            assert!(late_s.abs() < 120, "{further:?}: {pair:?}");
        }
        // y runs with the controller's clock at 1 m/s.
        let (first, last) = (points[0], points[39]);
        if matches!(further[1], "plc") {
            let drift = (last.0 - first.0) as f64 * 1e-9 - (last.1 - first.1);
            assert!(drift.abs() < 1e-5, "{further:?}: {drift}");
        }
    }
    stop.store(true, Ordering::Relaxed);
    thread.join().unwrap();
}

/// A runtime that restarts keeps its program and the router's connection, and forgets who wanted to
/// be notified.
#[test]
fn the_desired_motion_is_read_on_after_the_runtime_has_restarted() {
    let (plc, service) = serve(desired());
    let (stop, thread) = moving(&plc);
    let target = service.target(&plc);
    let arguments = [
        &target,
        "--read",
        "GVL.stDesired",
        "--read-fields",
        DESIRED,
        "--read-period",
        "5ms",
        "-n",
        "600",
        "-v",
    ];
    let running = Running::start(&arguments);
    running.hears("connected as");
    {
        let mut plc = plc.lock();
        plc.trouble.port_closed = true;
        plc.restart();
    }
    running.hears("no server has that AMS port");
    plc.lock().trouble.port_closed = false;
    let done = ends(running.wait(), 0, &["connected again after"]);
    assert_eq!(points(&done.stdout).len(), 600);
    stop.store(true, Ordering::Relaxed);
    thread.join().unwrap();
}

#[test]
fn one_connection_pushes_and_reads() {
    let dir = scratch("ads-both");
    let (plc, service) = serve(desired());
    plc.lock().trouble.one_connection = true;
    let (stop, thread) = moving(&plc);
    let arguments = [
        &service.target(&plc),
        SYMBOL,
        "--read",
        "GVL.stDesired",
        "--read-fields",
        DESIRED,
        "--read-to",
        "desired.csv",
    ];
    let mut running = Running::start_in(&dir, &arguments, &[]);
    let feeder = Feeder::start(&mut running);
    more_writes(&plc, 60);
    feeder.end();
    ends(running.wait(), 0, &[]);
    stop.store(true, Ordering::Relaxed);
    thread.join().unwrap();
    assert_eq!(plc.lock().connections, 1);
    let mut text = Vec::new();
    File::open(dir.join("desired.csv"))
        .unwrap()
        .read_to_end(&mut text)
        .unwrap();
    assert!(points(&text).len() >= 10);
    assert_eq!(status_word(&plc) & ENDED, ENDED);
}

#[test]
fn a_fifo_that_nobody_reads_holds_up_nothing() {
    let dir = scratch("ads-fifo");
    sh(&dir, "mkfifo desired.fifo").expect(0);
    let (plc, service) = serve(desired());
    let target = service.target(&plc);
    let arguments = [
        &target,
        SYMBOL,
        "--read",
        "GVL.stDesired",
        "--read-fields",
        "_,x,y,vy",
        "--read-to",
        "desired.fifo",
    ];
    let mut running = Running::start_in(&dir, &arguments, &[]);
    running.feed(&(HEADER.to_owned() + &row(1)));
    more_writes(&plc, 1);
    drop(running.stdin.take());
    // Points wait for a reader that never comes: it is let go by one.
    let fifo: PathBuf = dir.join("desired.fifo");
    let reader = std::thread::spawn(move || std::fs::read(fifo).unwrap());
    ends(running.wait(), 0, &[]);
    // Whoever reads late finds an end.
    if !reader.is_finished() {
        let opened = File::options().write(true).open(dir.join("desired.fifo"));
        drop(opened);
    }
    reader.join().unwrap();
}

#[test]
fn checks_and_lists() {
    let (plc, service) = serve(desired());
    plc.lock().set_read_only("GVL.stDesired");
    let target = service.target(&plc);
    let done = ends(Running::start(&["check", &target, SYMBOL]).end(), 0, &[]);
    let text = String::from_utf8(done.stdout).unwrap();
    assert!(
        text.contains("Plc30 App 3.1.4026") && text.contains("RUN"),
        "{text}"
    );
    assert!(
        text.contains("MAIN.SickValue + 64   LREAL  counter"),
        "{text}"
    );
    let wrong = ["check", &target, SYMBOL, "--fields", "x,y"];
    ends(Running::start(&wrong).end(), 78, &["2 fields x,y"]);
    let done = ends(Running::start(&["list", &target, "gvl.*"]).end(), 0, &[]);
    let text = String::from_utf8(done.stdout).unwrap();
    assert_eq!(text, "GVL.stDesired\tST_Desired (read-only)\t32\t\n");
    assert_eq!(plc.lock().writes(SYMBOL), 0);
    drop(service);
    ends(
        Running::start(&["list", &target]).end(),
        69,
        &["Connection refused"],
    );
}

#[test]
fn a_route_is_asked_for() {
    let dir = scratch("ads-route");
    let udp = UdpSocket::bind("127.0.0.1:0").unwrap();
    udp.set_read_timeout(Some(LONG)).unwrap();
    let port = udp.local_addr().unwrap().port().to_string();
    let controller = std::thread::spawn(move || {
        let who = Credentials {
            user: "Administrator".into(),
            password: "s3cret".into(),
        };
        let mut routes = Vec::new();
        while routes.len() < 3 {
            let mut request = [0; 2048];
            let (count, from) = udp.recv_from(&mut request).unwrap();
            let (reply, route) = answer(&request[..count], &who).unwrap();
            udp.send_to(&reply, from).unwrap();
            routes.push(route);
        }
        routes
    });
    std::fs::write(
        dir.join("plc.txt"),
        "user = Administrator\npassword = s3cret\n",
    )
    .unwrap();
    let shared = ["--add-route", "127.0.0.1.1.1", "--route-port", &port];
    let file = [
        &shared[..],
        &["--route-credentials", "plc.txt", "--route-name", "robot"],
    ]
    .concat();
    ends(
        Running::start_in(&dir, &file, &[]).end(),
        0,
        &["has a route robot"],
    );
    let user = ("CABLEPOSE_ADS_USER", "Administrator");
    for (password, status, text) in [("s3cret", 0, "has a route"), ("other", 69, "refused")] {
        let variables = [user, ("CABLEPOSE_ADS_PASSWORD", password)];
        let done = Running::start_in(&dir, &shared, &variables).end();
        let done = ends(done, status, &[text]);
        assert!(!done.stderr.contains(password), "{}", done.stderr);
    }
    ends(
        Running::start_in(&dir, &shared, &[]).end(),
        2,
        &["--route-credentials"],
    );
    let routes = controller.join().unwrap();
    let first = routes[0].as_ref().unwrap();
    assert_eq!(
        (first.name.as_str(), first.host.as_str()),
        ("robot", "127.0.0.1")
    );
    assert_eq!(
        routes[1].as_ref().unwrap().net_id.to_string(),
        "127.0.0.1.1.1"
    );
    assert!(routes[2].is_none());
}

/// The bytes shown are those sent: the emulated PLC takes them for the write that they are.
#[test]
fn a_rehearsal_shows_the_request() {
    let dir = scratch("ads-rehearsal");
    std::fs::write(dir.join("poses.csv"), HEADER.to_owned() + &row(3)).unwrap();
    let shown = sh(
        &dir,
        "ads-push 192.0.2.10.1.1 MAIN.SickValue --dry-run < poses.csv",
    )
    .expect(0);
    let hex = shown.text().lines().filter(|line| !line.starts_with('#'));
    let bytes: Vec<u8> = hex
        .flat_map(|line| line.split_whitespace().skip(1))
        .map(|byte| u8::from_str_radix(byte, 16).unwrap())
        .collect();
    assert_eq!(bytes.len(), 6 + 32 + 12 + 72);
    assert_eq!(bytes[6..14], [192, 0, 2, 10, 1, 1, 0x53, 0x03]);
    assert_eq!(bytes[50..58], 0.375f64.to_le_bytes());
    assert!(
        shown
            .text()
            .contains("# MAIN.SickValue + 8    LREAL  y = -2.5\n"),
        "{}",
        shown.text()
    );
}
