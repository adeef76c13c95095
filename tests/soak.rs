//! An hour's faults in minutes: a live chain between an emulated scanner that loses, garbles, stalls,
//! resets and restarts, and a controller that comes and goes, with a stage that is stopped now and
//! then. Whatever happens, nothing is lost that is not counted, and nothing grows.
//!
//! The faults are drawn from CABLEPOSE_SOAK_SEED (1), and the run takes CABLEPOSE_SOAK_S seconds (12;
//! `make soak` runs longer). The scanner's clock keeps its pace: what is compressed is the time
//! between one fault and the next.

#![cfg(unix)]

mod shell;
mod stages;

use cablepose::link::emulation::Conditions;
use cablepose::twincat::emulator::{Plc, Service, SharedPlc};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use shell::{scratch, sh};
use stages::{LONG, Scanner, Stage, column};
use std::fs;
use std::net::SocketAddr;
use std::process::Stdio;
use std::time::{Duration, Instant};

const SYMBOL: &str = "MAIN.SickValue";
/// Scans a second.
const RATE: u64 = 100;
/// On average so far apart, s.
const SCANNER_FAULTS_APART_S: f64 = 3.0;
const OTHER_FAULTS_APART_S: f64 = 2.0;
/// What the sockets between may hold when a connection breaks, in scans.
const IN_FLIGHT: u64 = 600;
/// No stage needs more memory than this, kB.
const MOST_KB: u64 = 96 << 10;

struct Dice(ChaCha8Rng);

impl Dice {
    fn share(&mut self) -> f64 {
        (self.0.next_u64() >> 11) as f64 / (1u64 << 53) as f64
    }

    fn between(&mut self, from: f64, to: f64) -> f64 {
        from + (to - from) * self.share()
    }

    fn one_of<'a, T>(&mut self, of: &'a [T]) -> &'a T {
        &of[(self.share() * of.len() as f64) as usize]
    }
}

/// What goes wrong with the scanner and its line within `span_s`.
fn scanner_faults(dice: &mut Dice, span_s: f64) -> String {
    let mut faults =
        "drop=0.003,flip=0.003,cut=0.003,repeat=0.003,garbage=0.01,chunk=1..1448".to_owned();
    let mut at_s = 2.0;
    while at_s < span_s {
        let lasts_ms = dice.between(50.0, 1500.0).round();
        let what = *dice.one_of(&["stall", "blackhole", "reboot", "reset"]);
        let lasting = if what == "reset" {
            String::new()
        } else {
            format!("={lasts_ms}ms")
        };
        faults += &format!(",{what}{lasting}@{at_s:.3}s");
        at_s += lasts_ms * 1e-3 + dice.between(0.5, 2.0 * SCANNER_FAULTS_APART_S - 0.5);
    }
    faults
}

fn setting(name: &str, usual: u64) -> u64 {
    std::env::var(name)
        .ok()
        .map_or(usual, |text| text.parse().unwrap())
}

fn serve(plc: &SharedPlc, address: SocketAddr) -> Service {
    let due = Instant::now() + LONG;
    loop {
        match Service::start(plc, address, Conditions::default()) {
            Ok(service) => return service,
            Err(error) => assert!(Instant::now() < due, "{error}"),
        }
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// The number before some words.
#[track_caller]
fn counted(text: &str, words: &str) -> u64 {
    let before = text
        .split(words)
        .next()
        .filter(|before| before.len() < text.len());
    let number = before.and_then(|before| before.rsplit([' ', '(']).next());
    number.map_or(0, |number| number.parse().unwrap())
}

#[test]
fn nothing_is_lost_that_is_not_counted() {
    let span_s = setting("CABLEPOSE_SOAK_S", 12) as f64;
    let seed = setting("CABLEPOSE_SOAK_SEED", 1);
    println!("{span_s} s, CABLEPOSE_SOAK_SEED={seed}");
    let mut dice = Dice(ChaCha8Rng::seed_from_u64(seed));
    let dir = scratch("soak");
    let faults = scanner_faults(&mut dice, span_s);
    println!("--faults {faults}");
    let scanner = Scanner::serve(
        &dir,
        "127.0.0.1:0",
        &format!(
            "--model lms511-sr --frequency-hz {RATE} --resolution-deg 1 --n-scans 200000 -v \
             --seed {seed} --faults {faults}"
        ),
    );
    let plc = SharedPlc::new(Plc::with_sick_value());
    let mut service = Some(serve(&plc, ([127, 0, 0, 1], 0).into()));
    let address = service.as_ref().unwrap().address();
    let target = service.as_ref().unwrap().target(&plc);

    let lines = [
        format!("scan-capture {} --tee run.cola -v", scanner.place),
        "extract-lines -f frame.toml".to_owned(),
        "solve-pose -f frame.toml --pitch-deg 0".to_owned(),
        "compensate-delay --delay 1ms".to_owned(),
        format!("ads-push {target} {SYMBOL} --every -v"),
    ];
    let mut stages: Vec<Stage> = Vec::new();
    for (k, line) in lines.iter().enumerate() {
        let stdin = match stages.last_mut() {
            Some(before) => before.stdout().into(),
            None => Stdio::null(),
        };
        let stdout = match k + 1 == lines.len() {
            true => fs::File::create(dir.join("pushed.csv")).unwrap().into(),
            false => Stdio::piped(),
        };
        stages.push(Stage::start(&dir, line, stdin, stdout));
    }

    // The first scan may take its time on a busy machine; then the clock runs.
    assert!(plc.wait_until(LONG, |plc| plc.writes(SYMBOL) > 0));
    let due = Instant::now() + Duration::from_secs_f64(span_s);
    let mut restarts = 0;
    while Instant::now() < due {
        let pause_s = dice.between(0.5, 2.0 * OTHER_FAULTS_APART_S - 0.5);
        std::thread::sleep(Duration::from_secs_f64(pause_s));
        let lasts = Duration::from_secs_f64(dice.between(0.1, 1.0));
        if dice.share() < 0.5 {
            drop(service.take());
            std::thread::sleep(lasts);
            service = Some(serve(&plc, address));
            restarts += 1;
        } else {
            let stage = 1 + (dice.share() * 4.0) as usize;
            stages[stage].signal("STOP");
            std::thread::sleep(lasts);
            stages[stage].signal("CONT");
        }
        for (stage, line) in stages.iter_mut().zip(&lines) {
            assert!(stage.runs(), "{line}: {}", stage.said());
        }
    }
    // The last fault may have been the controller's: it is back, and is written to.
    let before = plc.lock().writes(SYMBOL);
    assert!(plc.wait_until(LONG, |plc| plc.writes(SYMBOL) > before));
    for (stage, line) in stages.iter().zip(&lines) {
        if let Some(kb) = stage.proc_status("VmHWM") {
            let kb: u64 = kb.split(' ').next().unwrap().parse().unwrap();
            assert!(kb < MOST_KB, "{line} took {kb} kB");
        }
    }
    stages.iter().for_each(|stage| stage.signal("INT"));
    let said: Vec<String> = stages
        .into_iter()
        .map(|stage| stage.end().expect(&[0, 3]))
        .collect();
    scanner.stage.signal("INT");
    let truth = scanner.stage.end().expect(&[0]);

    // From the scanner to the first record: every gap is counted.
    let pushed = column(&fs::read_to_string(dir.join("pushed.csv")).unwrap(), "seq");
    assert!(pushed.is_sorted_by(|a, b| a < b));
    let gaps: i64 = pushed.windows(2).map(|pair| pair[1] - pair[0] - 1).sum();
    let capture = &said[0];
    assert_eq!(counted(capture, " scans lost, "), gaps as u64, "{capture}");
    let received = pushed.len() as u64;
    assert_eq!(counted(capture, " scans, "), received, "{capture}");
    // By the scanner's own account: what it sent whole came, but for what was under way when a
    // connection broke.
    let whole = counted(&truth, " messages to ")
        - counted(&truth, " lost on purpose")
        - counted(&truth, " lost by slow clients")
        - counted(&truth, " not taken by clients");
    let clients = counted(&truth, " clients: ");
    assert!(received <= whole, "{received}: {truth}");
    assert!(
        whole - received <= IN_FLIGHT * clients,
        "{received}: {truth}"
    );

    // From the first record to the last stage: every one came through, in order.
    let replay = sh(&dir, "scan-capture --replay run.cola --skip-bad -q");
    assert!(matches!(replay.status, 0 | 3), "{}", replay.stderr);
    assert_eq!(column(replay.text(), "seq"), pushed);

    // From there into the controller: written, or counted.
    let push = &said[4];
    let accounted: u64 = [
        " poses written",
        " passed over for newer ones",
        " not written before the first connection",
        " not written while the controller was away",
        " sent and not acknowledged",
    ]
    .iter()
    .map(|words| counted(push, words))
    .sum();
    assert_eq!(accounted, received, "{push}");
    assert!(restarts == 0 || push.contains("connections lost"), "{push}");
    println!(
        "{received} poses, {gaps} scans lost, {clients} connections, {restarts} restarts of the controller"
    );
    println!(
        "{}{}",
        capture.lines().last().unwrap_or(""),
        push.lines().rev().take(2).collect::<String>()
    );
}
