//! The emulated IMU on its serial line: with imu-read behind it, beside the scanner, and when it is
//! pulled out.

mod shell;

use cablepose::link::{Connection, Endpoint};
use shell::{Ended, scratch, sh};
use std::fs;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// A program that is ended with the test, whatever happens.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

impl Running {
    /// `simulate` with its stderr in `log`, once that says that the IMU is there.
    fn simulate(dir: &Path, arguments: &str, log: &str) -> Running {
        let log = fs::File::create(dir.join(log)).unwrap();
        let child = Command::new(env!("CARGO_BIN_EXE_simulate"))
            .args(arguments.split_whitespace())
            .current_dir(dir)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(log)
            .spawn()
            .unwrap();
        let running = Running(child);
        wait_for("the IMU", || fs::symlink_metadata(dir.join("imu")).is_ok());
        running
    }

    /// Its status, which must come by itself.
    fn ends(mut self) -> i32 {
        let mut status = None;
        wait_for("the end", || {
            status = self.0.try_wait().unwrap();
            status.is_some()
        });
        status.unwrap().code().unwrap_or(-1)
    }

    fn signal(&self, name: &str) {
        let id = self.0.id().to_string();
        assert!(
            Command::new("kill")
                .args([name, &id])
                .status()
                .unwrap()
                .success()
        );
    }
}

fn wait_for(what: &str, mut there: impl FnMut() -> bool) {
    let due = Instant::now() + Duration::from_secs(90);
    while !there() {
        assert!(Instant::now() < due, "{what} did not come");
        std::thread::sleep(Duration::from_millis(10));
    }
}

/// A column of times, which are too long for a float.
fn integers(ended: &Ended, name: &str) -> Vec<i64> {
    let column = ended.column(name);
    column.iter().map(|field| field.parse().unwrap()).collect()
}

fn log_of(dir: &Path, name: &str) -> String {
    fs::read_to_string(dir.join(name)).unwrap()
}

const LONG: &str = "-f frame.toml --effects none --trajectory random --tilt-deg 2 --n-scans 100000 \
                    --scans-per-pose 100000 --imu-pty imu";

#[test]
fn imu_read_finds_the_emulated_unit_at_its_speed() {
    let dir = scratch("imu-unit");
    let arguments = format!("{LONG} --imu-baud 115200 --imu-tick 10ms --imu-streams 0x0C -v");
    let unit = Running::simulate(&dir, &arguments, "log");
    let read = sh(&dir, "imu-read ./imu -n 40 -v").expect(0);
    assert!(
        read.stderr.contains("115200 Bd, tick 10 ms"),
        "{}",
        read.stderr
    );
    assert!(read.stderr.contains(" 0 replies lost"), "{}", read.stderr);
    let device = read.numbers("device_ns");
    assert!(device.windows(2).all(|pair| pair[1] - pair[0] == 3e7));
    // At rest: one attitude, gravity in it.
    let (roll, pitch) = (read.numbers("roll_rad"), read.numbers("pitch_rad"));
    assert!(roll.iter().all(|r| *r == roll[0]) && roll[0].abs() < 0.036);
    assert!(pitch.iter().all(|p| *p == pitch[0]));
    let z = read.numbers("accel_z_m_s2")[0];
    assert!(
        (z + 9.806_65 * roll[0].cos() * pitch[0].cos()).abs() < 5e-3,
        "{z}"
    );
    unit.signal("-INT");
    assert_eq!(unit.ends(), 0);
    assert!(log_of(&dir, "log").contains("packets streamed"));
    assert!(
        fs::symlink_metadata(dir.join("imu")).is_err(),
        "the link is left"
    );
}

#[test]
fn a_listener_at_another_speed_hears_garbage() {
    let dir = scratch("imu-deaf");
    let _unit = Running::simulate(&dir, &format!("{LONG} --imu-streams 0x31"), "log");
    let port: Endpoint = dir.join("imu").display().to_string().parse().unwrap();
    let mut line = Connection::open(&port, 0, 38_400, Duration::from_secs(5)).unwrap();
    let mut hear = |baud: u32| {
        line.set_baud(baud).unwrap();
        let mut buffer = [0; 4096];
        let mut heard = Vec::new();
        // What was under way at the old speed.
        for _ in 0..20 {
            let _ = line.read(&mut buffer, Duration::from_millis(10)).unwrap();
        }
        wait_for("bytes", || {
            if let Some(received) = line.read(&mut buffer, Duration::from_secs(1)).unwrap() {
                heard.extend_from_slice(&buffer[..received.bytes]);
            }
            heard.len() > 400
        });
        let windows = heard.windows(23);
        windows
            .filter(|w| cablepose::gx1::Packet::decode(w).is_ok())
            .count()
    };
    assert!(hear(38_400) >= 15);
    assert_eq!(hear(19_200), 0);
    assert!(hear(38_400) >= 15);
}

#[test]
fn it_is_pulled_out_and_comes_back() {
    let dir = scratch("imu-unplug");
    let arguments = format!("{LONG} --imu-streams 0x31 --imu-faults unplug=700ms@4s");
    let _unit = Running::simulate(&dir, &arguments, "log");
    let read = sh(&dir, "timeout 60 imu-read ./imu --for 9s -v");
    assert_eq!(read.status, 3, "{}", read.stderr);
    assert!(read.stderr.contains("1 reconnection"), "{}", read.stderr);
    let seq = read.numbers("seq");
    let gaps: Vec<f64> = seq
        .windows(2)
        .map(|p| p[1] - p[0])
        .filter(|d| *d != 1.0)
        .collect();
    // 19.66 ms a sample; 700 ms and the reopening. Finding the unit again may cost some more.
    let lost = gaps.iter().sum::<f64>() - gaps.len() as f64;
    assert!(
        gaps.iter().any(|gap| *gap > 30.0) && lost < 200.0,
        "{gaps:?}"
    );
}

#[test]
fn a_slow_consumer_costs_neither_stamps_nor_samples() {
    let dir = scratch("imu-slow");
    let arguments = format!("{LONG} --imu-baud 115200 --imu-tick 2ms");
    let _unit = Running::simulate(&dir, &arguments, "log");
    // Longer than the pipe has room for and than any adapter holds bytes back.
    let read = sh(
        &dir,
        "timeout 80 imu-read ./imu -n 1400 -v 2> read.log | (sleep 6; cat)",
    )
    .expect(0);
    let said = log_of(&dir, "read.log");
    assert!(said.contains("1400 samples, 0 replies lost"), "{said}");
    assert!(said.contains(" 0 reconnections"), "{said}");
    let since = |name: &str| {
        let ns = integers(&read, name);
        ns.iter().map(|at| at - ns[0]).collect::<Vec<i64>>()
    };
    let (stamp, device) = (since("stamp_ns"), since("device_ns"));
    assert_eq!(stamp.len(), 1400);
    let worst_ns = stamp.iter().zip(&device).map(|(s, d)| (s - d).abs()).max();
    assert!(worst_ns.unwrap() < 200_000_000, "{worst_ns:?}");
}

/// `--imu-record` leaves what a recording of `imu-read --tee` has beside it.
#[test]
fn a_recording_of_the_simulated_unit_is_read_without_being_told_anything() {
    let dir = scratch("imu-record");
    let run = "simulate -q -f frame.toml --effects none --trajectory random --tilt-deg 2 \
               --n-scans 70 --scans-per-pose 70 -o /dev/null --imu-record unit.gx1 \
               --imu-baud 115200 --imu-tick 10ms";
    sh(&dir, run).expect(0);
    let read = sh(&dir, "imu-read replay unit.gx1").expect(0);
    let told = "imu-read replay unit.gx1 --unit /dev/null";
    assert_eq!(sh(&dir, told).status, 65);
    let device = integers(&read, "device_ns");
    assert!(device.len() > 50);
    assert!(
        device
            .windows(2)
            .all(|pair| pair[1] - pair[0] == 30_000_000)
    );
    let roll = read.numbers("roll_rad");
    assert!(roll.iter().all(|r| *r == roll[0]) && roll[0].abs() < 0.036);
    let text = log_of(&dir, "unit.unit.toml");
    assert!(
        text.contains("baud = 115200") && text.contains("tick_factors = [4, 10, 250, 10]"),
        "{text}"
    );
    sh(&dir, &format!("{run} --imu-streams 0x10")).expect(2);
    let packets = sh(&dir, "imu-read replay unit.gx1 --packets -o replies.csv");
    assert_eq!(packets.status, 2, "{}", packets.stderr);
}

fn poses(text: &Ended) -> Vec<(String, Vec<f64>)> {
    let status = text.column("status");
    let columns = [
        "seq",
        "x_m",
        "y_m",
        "z_m",
        "roll_rad",
        "pitch_rad",
        "yaw_rad",
    ];
    let columns = columns.map(|name| text.numbers(name));
    let row = |i: usize| columns.iter().map(|c| c[i]).collect();
    status
        .into_iter()
        .enumerate()
        .map(|(i, s)| (s, row(i)))
        .collect()
}

/// The pipeline of the manual: the emulated scanner and the emulated IMU in one process, the readers
/// of both, the solver. The poses are those of the file path.
#[test]
fn the_live_pipe_gives_the_poses_of_the_files() {
    let dir = scratch("imu-chain");
    let run = "-f frame.toml --effects reference,motion --trajectory loop --speed-m-s 0.5 \
               --wobble-deg 1,1,0.5 --wobble-hz 0.4 --n-scans 150 --seed 3";
    let files = format!(
        "simulate -q {run} --imu-rate-hz 100 --imu imu.csv -o scans.csv; \
         extract-lines -q -f frame.toml scans.csv | solve-pose -q -f frame.toml --imu imu.csv"
    );
    let reference = poses(&sh(&dir, &files).expect(0));
    assert_eq!(reference.len(), 150);
    let arguments = format!("{run} --serve 127.0.0.1:0 --imu-pty imu --hold --linger 200ms");
    let devices = Running::simulate(&dir, &arguments, "log");
    let mut address = String::new();
    wait_for("the address", || {
        let log = log_of(&dir, "log");
        let line = log
            .lines()
            .find_map(|l| l.strip_prefix("simulate: serving lms511 at "));
        address = line.unwrap_or_default().to_owned();
        !address.is_empty()
    });
    // The reader of the IMU is given time to find the unit before the scanner is asked.
    let live = format!(
        "mkfifo imu.fifo; timeout 90 imu-read -q ./imu > imu.fifo 2> read.log & \
         (sleep 3; timeout 90 scan-capture -q {address} -n 150) | extract-lines -q -f frame.toml \
         | solve-pose -q -f frame.toml --imu imu.fifo --imu-wait 2s"
    );
    let live = poses(&sh(&dir, &live));
    assert_eq!(devices.ends(), 0);
    compare(&reference, &live);
}

fn compare(reference: &[(String, Vec<f64>)], live: &[(String, Vec<f64>)]) {
    assert!(live.len() >= 140, "{}", live.len());
    let mut worst = [0.0f64; 6];
    let mut compared = 0;
    for (_, row) in live.iter().filter(|(status, _)| status == "ok") {
        let (_, wanted) = &reference[row[0] as usize];
        compared += 1;
        for (k, worst) in worst.iter_mut().enumerate() {
            *worst = worst.max((row[k + 1] - wanted[k + 1]).abs());
        }
    }
    assert!(compared >= 130, "{compared} of {}", live.len());
    // y, z and roll are the scan's. Pitch is within a digit and what 1 ms of a wrong time makes of
    // 2.5 deg/s; a loaded host may be some milliseconds late. x follows by up to 5 m of height.
    let [x, y, z, roll, pitch, yaw] = worst;
    assert!(y < 5e-4 && z < 1e-3 && roll < 1e-4, "{worst:?}");
    assert!(pitch < 1.5e-3 && x < 1.5e-2 && yaw < 3e-3, "{worst:?}");
}
