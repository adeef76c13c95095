//! timesync: logs of exchanges whose truth is known, streams that are tracked, delays, and an
//! emulated scanner that is asked for its time.

mod shell;

use cablepose::simulate::Seed;
use cablepose::simulate::exchanges::ExchangeModel;
use serde_json::Value;
use shell::{scratch, sh};
use std::fmt::Write as _;
use std::fs;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::process::{Child, Command, Stdio};

/// What host times count from, ns.
const EPOCH_NS: i64 = 1_700_000_000_000_000_000;

/// A log of a run of the model; `device_ns` may be changed on the way.
fn log(model: &ExchangeModel, change: impl Fn(usize, i64) -> i64) -> String {
    let mut text = "host_send_ns,device_ns,host_receive_ns\n".to_owned();
    for (k, [send, device, receive]) in model.run(Seed(11), 0).into_iter().enumerate() {
        let device = change(k, device);
        let (send, receive) = (send + EPOCH_NS, receive + EPOCH_NS);
        writeln!(text, "{send},{device},{receive}").unwrap();
    }
    text
}

fn json(dir: &Path, line: &str) -> Value {
    serde_json::from_str(sh(dir, line).expect(0).text()).unwrap()
}

/// Error of a fit's offset against the model, us, with device times shifted by `shift_ns`.
fn error_us(found: &Value, model: &ExchangeModel, shift_ns: i64) -> f64 {
    let at_ns = found["at_host_ns"].as_i64().unwrap();
    let offset_ns = found["offset_ns"].as_i64().unwrap() + EPOCH_NS - shift_ns;
    (offset_ns as f64 - model.offset_ns((at_ns - EPOCH_NS) as f64 * 1e-9)) * 1e-3
}

#[test]
fn fit_finds_offset_and_drift() {
    let dir = scratch("timesync-fit");
    let model = ExchangeModel::default();
    fs::write(dir.join("log.csv"), log(&model, |_, device| device)).unwrap();
    for (method, most_us) in [
        ("hull", 4.0),
        ("joint", 4.0),
        ("window", 15.0),
        ("weighted", 70.0),
    ] {
        let found = json(
            &dir,
            &format!("timesync fit --json --method {method} log.csv"),
        );
        let off_us = error_us(&found, &model, 0);
        assert!(off_us.abs() < most_us, "{method}: {off_us}");
        assert_eq!(found["verdict"], "two-way");
        let drift = found["drift_ppb"].as_f64().unwrap();
        assert!((drift - 20_000.0).abs() < 2000.0, "{method}: {drift}");
    }
    // By a pipe, as text, and on MCAP.
    let text = sh(&dir, "timesync fit < log.csv").expect(0);
    assert!(text.text().contains("verdict           two-way"));
    assert!(text.text().contains("drift             +"));
    let found = json(&dir, "timesync fit --json --asymmetry 100us log.csv");
    assert!((error_us(&found, &model, 0) - 50.0).abs() < 4.0);
    let found = json(&dir, "timesync fit --json --asymmetry -100us log.csv");
    assert!((error_us(&found, &model, 0) + 50.0).abs() < 4.0);
    // No way takes less than no time.
    let most = sh(&dir, "timesync fit --asymmetry 1h log.csv").expect(2);
    assert!(
        most.stderr.contains("shortest round trip"),
        "{}",
        most.stderr
    );
    let slow = "(echo host_send_ns,device_ns,host_receive_ns,request_bytes,reply_bytes; \
                tail -n +2 log.csv | cut -d, -f1-3 | sed 's/$/,24,2400/') \
                | timesync fit --wire 1Mbit";
    let slow = sh(&dir, slow).expect(2);
    assert!(
        slow.stderr.contains("the link is faster"),
        "{}",
        slow.stderr
    );
    if Path::new("/dev/full").exists() {
        let full = sh(&dir, "timesync fit log.csv > /dev/full").expect(74);
        assert_eq!(full.stderr, "timesync: stdout: No space left on device\n");
    }
    let found = json(
        &dir,
        "timesync fit --json -o fit.json log.csv && cat fit.json",
    );
    assert_eq!(found["exchanges"], 2100);
}

#[test]
fn fit_says_what_happened_to_the_clocks() {
    let dir = scratch("timesync-events");
    let model = ExchangeModel::default();
    let lap_ns = 4_294_967_296_000;
    // The counter wraps after a third.
    let start_ns = lap_ns - 20_000_000_000;
    let wraps = |_: usize, device: i64| (device + start_ns).rem_euclid(lap_ns);
    fs::write(dir.join("wrap.csv"), log(&model, wraps)).unwrap();
    let found = json(&dir, "timesync fit --json wrap.csv");
    assert_eq!(found["events"][0]["what"], "wrapped", "{found}");
    assert_eq!(found["exchanges"], 2100);
    assert!(error_us(&found, &model, start_ns).abs() < 4.0);
    // The device restarts after two thirds.
    let restarts = |k: usize, device: i64| device + if k < 1400 { 900_000_000_000 } else { 0 };
    fs::write(dir.join("restart.csv"), log(&model, restarts)).unwrap();
    let found = json(&dir, "timesync fit --json restart.csv");
    assert_eq!(found["events"][0]["what"], "restarted");
    assert_eq!(found["exchanges"], 1400);
    assert_eq!(found["sessions"][0]["exchanges"], 700);
    let text = sh(&dir, "timesync fit restart.csv").expect(0);
    assert!(
        text.text().contains("the device restarted"),
        "{}",
        text.text()
    );
    // Stamps from before the request.
    let void = |_: usize, device: i64| device - device.rem_euclid(28_571_000);
    fs::write(dir.join("void.csv"), log(&model, void)).unwrap();
    let found = json(&dir, "timesync fit --json void.csv");
    assert_eq!(found["verdict"], "one-way-stamps-void");
    assert_eq!(found["bracket_ns"], Value::Null);
}

#[test]
fn what_cannot_be_fitted_is_said() {
    let dir = scratch("timesync-refused");
    let header = "host_send_ns,device_ns,host_receive_ns\n";
    fs::write(dir.join("none.csv"), header).unwrap();
    let few = format!("{header}1,2,3\n4,5,6\n");
    fs::write(dir.join("few.csv"), few).unwrap();
    for name in ["none.csv", "few.csv"] {
        let ended = sh(&dir, &format!("timesync fit {name}")).expect(65);
        assert!(ended.stderr.contains("too few"), "{}", ended.stderr);
    }
    let back = format!("{header}5,1,4\n6,2,3\n7,3,5\n8,4,4\n9,5,6\n");
    fs::write(dir.join("back.csv"), back).unwrap();
    let ended = sh(&dir, "timesync fit back.csv").expect(65);
    let why = "5 exchanges whose answer precedes the question";
    assert!(ended.stderr.contains(why), "{}", ended.stderr);
    sh(&dir, "timesync fit nowhere.csv").expect(66);
    sh(&dir, "timesync fit --wire 100Mbit few.csv").expect(65);
    sh(&dir, "timesync fit --wire fast few.csv").expect(2);
    sh(&dir, "timesync").expect(2);
    let nobody = sh(&dir, "timesync poll 127.0.0.1:1 --for 1s").expect(69);
    assert!(nobody.stderr.starts_with("timesync: "), "{}", nobody.stderr);
}

#[test]
fn track_takes_the_jitter_out_of_stamps() {
    let dir = scratch("timesync-track");
    let make = "simulate -f frame.toml --effects clocks --n-scans 600 > scans.csv";
    sh(&dir, make).expect(0);
    sh(&dir, "timesync track scans.csv > causal.csv").expect(0);
    sh(&dir, "timesync track --smooth scans.csv > smooth.csv").expect(0);
    sh(&dir, "timesync track < scans.csv | cmp - causal.csv").expect(0);
    // Scatter of the stamps about an even line, us, over the second half.
    let scatter_us = |name: &str| {
        let stamps = sh(&dir, &format!("cat {name}"))
            .expect(0)
            .column("stamp_ns");
        let stamps: Vec<i64> = stamps.iter().map(|s| s.parse().unwrap()).collect();
        assert_eq!(stamps.len(), 600);
        assert!(stamps.windows(2).all(|pair| pair[0] < pair[1]));
        let half = &stamps[300..];
        let n = half.len() as f64;
        let ys: Vec<f64> = half
            .iter()
            .enumerate()
            .map(|(k, s)| (s - half[0]) as f64 - k as f64 * 40e6)
            .collect();
        let (mx, my) = ((n - 1.0) / 2.0, ys.iter().sum::<f64>() / n);
        let xy = ys
            .iter()
            .enumerate()
            .map(|(k, y)| (k as f64 - mx) * (y - my))
            .sum::<f64>();
        let xx = (0..half.len())
            .map(|k| (k as f64 - mx).powi(2))
            .sum::<f64>();
        let rest = ys
            .iter()
            .enumerate()
            .map(|(k, y)| y - my - (k as f64 - mx) * xy / xx);
        (rest.map(|r| r * r).sum::<f64>() / n).sqrt() * 1e-3
    };
    // The simulated stamps scatter by 30 us.
    assert!(scatter_us("scans.csv") > 20.0);
    let (causal, smooth) = (scatter_us("causal.csv"), scatter_us("smooth.csv"));
    assert!(causal < 5.0 && smooth < 3.0, "{causal} {smooth}");
    // In MCAP everything else passes.
    let mcap = "simulate -f frame.toml --effects clocks --n-scans 20 --format mcap \
                | timesync track | extract-lines -f frame.toml --format csv";
    assert_eq!(sh(&dir, mcap).expect(0).rows().len(), 20);
    // Nothing to map by.
    let bare = "simulate -f frame.toml --effects none --n-scans 3 | timesync track > /dev/null";
    let ended = sh(&dir, bare);
    assert_eq!(ended.status, 65, "{}", ended.stderr);
    sh(&dir, "timesync track --smooth < scans.csv").expect(2);
}

#[test]
fn track_says_restarts_and_steps() {
    let dir = scratch("timesync-track-steps");
    let mut rows =
        "stamp_ns,received_ns,device_ns,seq,axes,roll_rad,pitch_rad,gyro_x_rad_s\n".to_owned();
    for k in 0..1200i64 {
        // The device restarts after 400 samples, the host is set back by 2 s after 800.
        let device = k * 10_000_000
            - if k >= 400 {
                4_000_000_000
            } else {
                -900_000_000_000
            };
        let wait = 100_000 + (k * 7919) % 400_000;
        let host = EPOCH_NS + k * 10_000_000 + wait - if k >= 800 { 2_000_000_000 } else { 0 };
        writeln!(rows, "{host},{host},{device},{k},platform,0.1,0.2,0.5").unwrap();
    }
    fs::write(dir.join("imu.csv"), rows).unwrap();
    let ended = sh(&dir, "timesync track imu.csv").expect(0);
    assert!(
        ended.stderr.contains("record 401: the device restarted"),
        "{}",
        ended.stderr
    );
    assert!(
        ended.stderr.contains("record 801: a clock was set (-2."),
        "{}",
        ended.stderr
    );
    let stamps = ended.column("stamp_ns");
    assert_eq!(stamps.len(), 1200);
    for (k, stamp) in stamps.iter().enumerate() {
        let k = k as i64;
        let settled = [350..400, 700..800, 1100..1200]
            .iter()
            .any(|range| range.contains(&k));
        let sent = EPOCH_NS + k * 10_000_000 - if k >= 800 { 2_000_000_000 } else { 0 };
        let wait = stamp.parse::<i64>().unwrap() - sent;
        assert!(!settled || (95_000..130_000).contains(&wait), "{k}: {wait}");
    }
}

#[test]
fn delay_is_found_by_every_method() {
    let dir = scratch("timesync-delay");
    // The truth follows the desired motion by 62 ms: measured exactly, it is that late.
    let make = "simulate -f frame.toml --trajectory loop --profile quintic --speed-m-s 3 --loops 2 \
                --lag 62ms --effects motion --format mcap -o run.mcap";
    sh(&dir, make).expect(0);
    let poses = "extract-lines -f frame.toml run.mcap \
                 | solve-pose -f frame.toml --format csv > poses.csv";
    sh(&dir, poses).expect(0);
    let delay = |more: &str| {
        json(
            &dir,
            &format!("timesync delay --desired run.mcap --json {more} poses.csv"),
        )
    };
    let found = delay("--curve curve.csv");
    let fitted_s = found["delay_s"].as_f64().unwrap();
    let sigma_s = found["sigma_s"].as_f64().unwrap();
    // Scans that turn while the platform moves are a fraction of a millisecond off.
    assert!((fitted_s - 0.062).abs() < 1.5e-3, "{found}");
    assert!(sigma_s > 0.0 && sigma_s < 0.5e-3, "{sigma_s}");
    assert_eq!(found["fit"]["parts"].as_array().unwrap().len(), 5);
    let parabolic_s = delay("--method parabolic")["delay_s"].as_f64().unwrap();
    // A parabola through three lags that are a scan apart is good to a fraction of a scan.
    assert!((parabolic_s - fitted_s).abs() < 5e-3);
    let xcorr_s = delay("--method xcorr")["delay_s"].as_f64().unwrap();
    assert!((0.0..0.1).contains(&xcorr_s));
    // The curve is lowest at the delay, and high where nothing is compensated.
    let curve = sh(&dir, "cat curve.csv").expect(0);
    let (delays, errors) = (curve.numbers("delay_s"), curve.numbers("rms_y_m"));
    let lowest = (0..errors.len())
        .min_by(|a, b| errors[*a].total_cmp(&errors[*b]))
        .unwrap();
    assert!((delays[lowest] - fitted_s).abs() < 1.1e-3);
    // The procedure of the dissertation ends where the spike is gone.
    let steps = delay("--method dissertation --adjust 5ms");
    let steps = &steps["dissertation"];
    let found_s = steps["cross_correlation_s"].as_f64().unwrap()
        + steps["best_adjustment_s"].as_f64().unwrap();
    assert!((found_s - 0.062).abs() < 4e-3, "{steps}");
    assert!(steps["spike_m"][0].as_f64().unwrap() > 0.12, "{steps}");
    assert_eq!(steps["total_delay_s"], Value::Null);
    // What cannot be seen is refused.
    let still = "timesync delay --desired run.mcap --axes x poses.csv";
    let ended = sh(&dir, still);
    assert_eq!(ended.status, 65, "{}", ended.stderr);
    sh(
        &dir,
        "timesync delay --desired run.mcap --adjust 5ms poses.csv",
    )
    .expect(2);
}

/// An emulated scanner; it ends with this.
struct Scanner {
    process: Child,
    address: String,
    /// The monotonic raw clock when its counter began, ns.
    start_ns: i64,
}

impl Scanner {
    fn new(dir: &Path, more: &str) -> Scanner {
        let mut process = Command::new(env!("CARGO_BIN_EXE_simulate"))
            .args([
                "-f",
                "frame.toml",
                "--trajectory",
                "grid",
                "--step-m",
                "0.2",
            ])
            .args(["--serve", "127.0.0.1:0", "--linger", "60s", "-v"])
            .args(more.split_whitespace())
            .current_dir(dir)
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut lines = BufReader::new(process.stderr.take().unwrap()).lines();
        let (mut address, mut start_ns) = (None, None);
        while address.is_none() || start_ns.is_none() {
            let line = lines.next().expect("the scanner has ended").unwrap();
            if let Some(place) = line.strip_prefix("simulate: serving lms511 at ") {
                address = Some(place.to_owned());
            }
            if let Some((_, rest)) = line.split_once(" s at ")
                && line.contains("counter was")
            {
                start_ns = rest.split(' ').next().unwrap().parse().ok();
            }
        }
        std::thread::spawn(move || lines.for_each(drop));
        Scanner {
            process,
            address: address.unwrap(),
            start_ns: start_ns.unwrap(),
        }
    }
}

impl Drop for Scanner {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

#[test]
fn a_scanners_clock_is_found() {
    let dir = scratch("timesync-live");
    // The counter wraps a second or so after the start.
    let scanner = Scanner::new(&dir, "--clock-ppm 20 --uptime-s 4294.3");
    let address = &scanner.address;
    sh(
        &dir,
        &format!("timesync poll {address} --for 4s --rate 60 > log.csv"),
    )
    .expect(0);
    let found = json(&dir, "timesync fit --json log.csv");
    assert_eq!(found["verdict"], "two-way", "{found}");
    let at_ns = found["at_host_ns"].as_i64().unwrap();
    let elapsed_ns = (at_ns - scanner.start_ns) as f64;
    let truth_ns = 4294.3e9 + elapsed_ns * (1.0 + 20e-6) - at_ns as f64;
    let off_ns = found["offset_ns"].as_f64().unwrap() - truth_ns;
    let bracket_ns = found["bracket_ns"].as_f64().unwrap();
    let sigma_ns = found["offset_sigma_ns"].as_f64().unwrap();
    assert!(
        off_ns.abs() < bracket_ns + 3.0 * sigma_ns + 1000.0,
        "{off_ns} {found}"
    );
    assert!(found["exchanges"].as_u64().unwrap() > 50);
    // MCAP holds the same.
    sh(
        &dir,
        &format!("timesync poll {address} -n 20 --format mcap -o log.mcap"),
    )
    .expect(0);
    assert_eq!(json(&dir, "timesync fit --json log.mcap")["exchanges"], 20);
    let lines = sh(
        &dir,
        &format!("timesync watch {address} --for 2500ms --every 500ms --json --records w.csv"),
    );
    let lines = lines.expect(0);
    let last: Value = serde_json::from_str(lines.text().lines().last().unwrap()).unwrap();
    assert!(last["used"].as_u64().unwrap() > 10, "{last}");
    assert!(sh(&dir, "cat w.csv").expect(0).rows().len() > 10);
}

#[test]
fn stamps_of_the_scans_end_are_not_trusted() {
    let dir = scratch("timesync-void");
    let scanner = Scanner::new(&dir, "--stamp scan-end");
    let address = &scanner.address;
    sh(
        &dir,
        &format!("timesync poll {address} --for 4s --rate 60 > log.csv"),
    )
    .expect(0);
    let found = json(&dir, "timesync fit --json log.csv");
    assert_eq!(found["verdict"], "one-way-stamps-void", "{found}");
}

#[test]
fn a_scanners_calendar_is_set() {
    let dir = scratch("timesync-set");
    let scanner = Scanner::new(&dir, "--clock-offset-s -7");
    let address = &scanner.address;
    let found = json(
        &dir,
        &format!("timesync set {address} --for 2s --rate 60 --json -q"),
    );
    let residual_s = found["residual_s"].as_f64().unwrap();
    let probe = [0, 1].map(|k| found["probe_s"][k].as_f64().unwrap());
    // It agrees with the instants between which it was set, to the calendar's half millisecond.
    assert!(residual_s.abs() < 20e-3, "{found}");
    assert!(probe[0] <= probe[1]);
    assert!(
        (probe[0] - 0.6e-3..probe[1] + 0.6e-3).contains(&residual_s),
        "{found}"
    );
    // It measures again, and sends its time as before.
    let poll = format!("timesync poll {address} -n 3 --stamp calendar");
    assert_eq!(sh(&dir, &poll).expect(0).rows().len(), 3);
    sh(&dir, &format!("timesync poll {address} -n 3")).expect(0);
}

/// The time blocks lie up to a scan's period before the requests: the setting itself is gone by.
#[test]
fn a_calendar_whose_stamps_are_void_is_set() {
    let dir = scratch("timesync-set-void");
    let scanner = Scanner::new(&dir, "--clock-offset-s -7 --stamp scan-end");
    let address = &scanner.address;
    let found = json(
        &dir,
        &format!("timesync set {address} --for 2s --rate 60 --json -q"),
    );
    assert_eq!(found["found_by"], "setting", "{found}");
    let residual_s = found["residual_s"].as_f64().unwrap();
    let probe = [0, 1].map(|k| found["probe_s"][k].as_f64().unwrap());
    assert!(residual_s.abs() < 20e-3, "{found}");
    assert!(
        ((probe[0] + probe[1]) / 2.0 - residual_s).abs() < 1e-6,
        "{found}"
    );
    let half_s = (probe[1] - probe[0]) / 2.0;
    assert!((found["bracket_s"].as_f64().unwrap() - half_s).abs() < 1e-6);
}

#[test]
fn a_scanner_follows_a_time_server() {
    let dir = scratch("timesync-ntp");
    let scanner = Scanner::new(&dir, "");
    let address = &scanner.address;
    let before = json(&dir, &format!("timesync ntp {address} --json"));
    assert_eq!(before["role"], 0);
    let set =
        format!("timesync ntp {address} --server 192.168.0.11 --interval 60s --timezone 1 --json");
    let found = json(&dir, &set);
    assert_eq!(found["role"], 1);
    assert_eq!(found["server"], "192.168.0.11");
    assert_eq!(found["interval_s"], 60);
    assert_eq!(found["timezone_h"], 1);
    assert!(found["max_offset_s"].is_number() && found["delay_s"].is_number());
    let off = json(&dir, &format!("timesync ntp {address} --off --json"));
    assert_eq!(off["role"], 0);
    let wrong = "echo 12345678 > pw; timesync ntp --password-file pw --off";
    let ended = sh(&dir, &format!("{wrong} {address}")).expect(69);
    assert!(ended.stderr.contains("login refused"), "{}", ended.stderr);
    let none = sh(
        &dir,
        &format!("echo short > pw; timesync ntp --password-file pw --off {address}"),
    );
    none.expect(78);
}

#[test]
fn a_poll_survives_a_restart_of_the_scanner() {
    let dir = scratch("timesync-restart");
    let scanner = Scanner::new(&dir, "--faults reboot=1s@3s --uptime-s 100");
    let address = &scanner.address;
    let poll = format!("timesync poll {address} --for 15s --rate 50 > log.csv");
    let ended = sh(&dir, &poll).expect(3);
    assert!(
        ended.stderr.contains("connecting again"),
        "{}",
        ended.stderr
    );
    let found = json(&dir, "timesync fit --json log.csv");
    assert_eq!(found["events"][0]["what"], "restarted", "{found}");
    assert!(!found["sessions"].as_array().unwrap().is_empty());
}

#[test]
fn a_poll_ends_on_a_signal() {
    let dir = scratch("timesync-signal");
    let scanner = Scanner::new(&dir, "");
    let mut poll = Command::new(env!("CARGO_BIN_EXE_timesync"))
        .args(["poll", &scanner.address, "--for", "60s"])
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let mut out = BufReader::new(poll.stdout.take().unwrap());
    let mut line = String::new();
    // The header and one exchange.
    for _ in 0..2 {
        out.read_line(&mut line).unwrap();
    }
    let id = poll.id();
    sh(&dir, &format!("kill -INT {id}")).expect(0);
    let mut rest = String::new();
    out.read_to_string(&mut rest).unwrap();
    assert_eq!(poll.wait().unwrap().code(), Some(0));
    assert!(rest.is_empty() || rest.ends_with('\n'));
}
