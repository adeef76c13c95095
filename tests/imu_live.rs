//! imu-read against a unit on a pseudo terminal: starts, losses, outages, ends, recordings.

mod peer;
mod shell;

use cablepose::gx1::session::Line;
use cablepose::gx1::{Command, Session};
use cablepose::link::Endpoint;
use peer::{Making, Order, Peer};
use shell::{Ended, scratch, sh};
use std::path::{Path, PathBuf};
use std::process::{Child, Command as Process, Stdio};
use std::time::{Duration, Instant};

/// A directory of its own and a unit in it, called `imu`.
fn unit(name: &str, making: Making) -> (PathBuf, Peer) {
    let dir = scratch(&format!("imu-{name}"));
    let peer = Peer::start(&dir.join("imu"), making);
    (dir, peer)
}

/// `imu-read` with these arguments, running.
fn spawn(dir: &Path, arguments: &[&str]) -> Child {
    Process::new(env!("CARGO_BIN_EXE_imu-read"))
        .args(arguments)
        .current_dir(dir)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap()
}

/// Its end, which must come by itself.
fn end(child: Child) -> Ended {
    let output = child.wait_with_output().unwrap();
    Ended {
        status: output.status.code().unwrap_or(-1),
        stdout: output.stdout,
        stderr: String::from_utf8_lossy(&output.stderr).into_owned(),
    }
}

fn signal(child: &Child, name: &str) {
    let id = child.id().to_string();
    let sent = Process::new("kill").args([name, &id]).status().unwrap();
    assert!(sent.success());
}

fn is_consecutive(seq: &[f64]) -> bool {
    seq.windows(2).all(|pair| pair[1] == pair[0] + 1.0)
}

#[test]
fn samples_come_scaled_stamped_and_counted() {
    let cells = [Making::default().cells, vec![(230, 7000), (130, 8500)]].concat();
    let (dir, peer) = unit(
        "samples",
        Making {
            cells,
            ..Making::default()
        },
    );
    let ended = sh(&dir, "imu-read ./imu -n 50 -v").expect(0);
    let seq = ended.numbers("seq");
    assert_eq!(seq.len(), 50);
    assert!(is_consecutive(&seq));
    assert!(ended.column("axes").iter().all(|axes| axes == "ned"));
    // The unit's own gains, not the factory's.
    let g = -3855.0 * 7000.0 / 32_768_000.0 * 9.81;
    assert!(
        ended
            .numbers("accel_z_m_s2")
            .iter()
            .all(|a| (a - g).abs() < 1e-12)
    );
    let rate = 3.0 * 8500.0 / 32_768_000.0;
    assert!(
        ended
            .numbers("gyro_x_rad_s")
            .iter()
            .all(|r| (r - rate).abs() < 1e-12)
    );
    let device = ended.numbers("device_ns");
    assert!(device.windows(2).all(|pair| pair[1] - pair[0] == 1e7));
    // Stamps are the samples' times, before the arrivals.
    let (stamp, received) = (ended.numbers("stamp_ns"), ended.numbers("received_ns"));
    assert!(stamp.iter().zip(&received).all(|(s, r)| r - s >= 15e6));
    assert!(stamp.windows(2).all(|pair| pair[1] >= pair[0]));
    assert!(
        ended.stderr.contains("number 4021, firmware 3.2.01"),
        "{}",
        ended.stderr
    );
    assert!(
        ended.stderr.contains("50 samples, 0 replies lost"),
        "{}",
        ended.stderr
    );
    // It is left as it should be.
    assert_eq!(peer.state().streaming, None);
}

#[test]
fn the_unit_may_be_left_streaming() {
    let (dir, peer) = unit("leave", Making::default());
    sh(&dir, "imu-read ./imu -n 5 --leave-streaming").expect(0);
    assert_eq!(
        peer.state().streaming,
        Some(Command::StabilisedEulerAccelRate)
    );
}

/// Opens a unit that is streaming something at some speed; how long it took.
fn start(dir: &Path, turn: usize) -> Duration {
    let speeds = [38_400, 115_200, 19_200];
    let streams = [
        None,
        Some(Command::StabilisedEulerAccelRate),
        Some(Command::StabilisedQuaternionVectors),
        Some(Command::StabilisedEuler),
        Some(Command::InstantVectors),
        Some(Command::Temperature),
        Some(Command::StabilisedMatrix),
    ];
    // Half a command that swallows what comes next: a write of a cell, a start of the stream.
    let halves: [&[u8]; 3] = [&[], &[0x29, 0x71, 0], &[0x10]];
    let peer = Peer::start(
        &dir.join(format!("imu{turn}")),
        Making {
            baud: speeds[turn % 3],
            streaming: streams[turn % 7],
            half_command: halves[turn % 5 % 3].to_vec(),
            ..Making::default()
        },
    );
    let never = || false;
    let line = Line {
        port: &Endpoint::Serial(peer.path.clone()),
        bauds: &[],
        bus_address: None,
    };
    let began = Instant::now();
    let mut session = Session::open(&line, &[], None, Duration::from_secs(20), &never).unwrap();
    let gains = session.gains(&never).unwrap();
    session.start(Command::StabilisedEuler, &never).unwrap();
    let took = began.elapsed();
    assert_eq!(session.baud(), speeds[turn % 3]);
    assert_eq!(gains, cablepose::gx1::Gains::FACTORY);
    assert!(session.stop());
    assert_eq!(peer.state().streaming, None);
    took
}

#[test]
fn starts_whatever_the_unit_is_doing() {
    let dir = scratch("imu-starts");
    for turn in 0..12 {
        start(&dir, turn);
    }
}

/// `cargo test --test imu_live -- --ignored --nocapture` prints the times.
#[test]
#[ignore = "takes a minute; prints how long 100 starts take"]
fn a_hundred_starts() {
    let dir = scratch("imu-hundred");
    let mut times: Vec<Duration> = (0..100).map(|turn| start(&dir, turn)).collect();
    times.sort();
    println!(
        "100 starts: median {:?}, longest {:?}",
        times[50], times[99]
    );
}

#[test]
fn a_replugged_unit_streams_again_and_the_gap_is_said() {
    let (dir, peer) = unit("replug", Making::default());
    let child = spawn(&dir, &["./imu", "-n", "200"]);
    peer.wait_until("a stream", |state| state.sent > 60);
    peer.order(Order::Unplug(Duration::from_millis(600)));
    let ended = end(child).expect(3);
    let (seq, device) = (ended.numbers("seq"), ended.numbers("device_ns"));
    assert_eq!(seq.len(), 200);
    // No sample twice, none stale, and as many numbers missing as samples.
    assert!(device.windows(2).all(|pair| pair[1] > pair[0]));
    for (s, d) in seq.windows(2).zip(device.windows(2)) {
        assert_eq!((s[1] - s[0]) * 1e7, d[1] - d[0]);
    }
    let gap = seq
        .windows(2)
        .map(|pair| pair[1] - pair[0])
        .fold(0.0, f64::max);
    assert!(gap > 30.0, "{gap}");
    assert!(
        ended.stderr.contains("looking for the unit"),
        "{}",
        ended.stderr
    );
    assert!(ended.stderr.contains("back after"), "{}", ended.stderr);
    assert!(
        ended.stderr.contains("samples are missing before seq"),
        "{}",
        ended.stderr
    );
    assert_eq!(peer.state().streaming, None);
}

#[test]
fn a_hanging_unit_gives_no_stale_samples() {
    let (dir, peer) = unit("hang", Making::default());
    let child = spawn(&dir, &["./imu", "-n", "150"]);
    peer.wait_until("a stream", |state| state.sent > 60);
    peer.order(Order::Hang(Duration::from_millis(1500)));
    let ended = end(child).expect(3);
    let device = ended.numbers("device_ns");
    assert!(device.windows(2).all(|pair| pair[1] > pair[0]));
    assert!(
        ended.stderr.contains("nothing but the same reply came"),
        "{}",
        ended.stderr
    );
    assert!(ended.stderr.contains("back after"), "{}", ended.stderr);
}

#[test]
fn a_restarted_unit_begins_a_new_clock() {
    let (dir, peer) = unit("restart", Making::default());
    let child = spawn(&dir, &["./imu", "-n", "500"]);
    // Late enough for its ticks to fall far behind the host's clock.
    peer.wait_until("a stream", |state| state.sent > 350);
    peer.order(Order::Restart);
    let ended = end(child).expect(3);
    assert!(
        ended.stderr.contains("switched off and on"),
        "{}",
        ended.stderr
    );
    let (seq, stamp) = (ended.numbers("seq"), ended.numbers("stamp_ns"));
    assert!(seq.windows(2).all(|pair| pair[1] > pair[0]));
    assert!(stamp.windows(2).all(|pair| pair[1] >= pair[0]));
}

#[test]
fn ends_in_good_order_whatever_the_unit_does() {
    // While it streams; while it is away; while nothing has come yet.
    let (dir, peer) = unit("ends", Making::default());
    for name in ["-INT", "-TERM"] {
        let sent = peer.state().sent;
        let child = spawn(&dir, &["./imu"]);
        peer.wait_until("a stream", |state| state.sent > sent + 30);
        signal(&child, name);
        let ended = end(child).expect(0);
        assert!(ended.numbers("seq").len() > 5);
        assert_eq!(peer.state().streaming, None);
    }
    let ended = sh(&dir, "imu-read ./imu --for 300ms").expect(0);
    assert!(ended.numbers("seq").len() > 5);
    let sent = peer.state().sent;
    let child = spawn(&dir, &["./imu"]);
    peer.wait_until("a stream", |state| state.sent > sent + 30);
    peer.order(Order::Unplug(Duration::from_secs(4)));
    while dir.join("imu").exists() {
        std::thread::sleep(Duration::from_millis(5));
    }
    std::thread::sleep(Duration::from_millis(200));
    signal(&child, "-INT");
    let ended = end(child).expect(3);
    assert!(
        ended.stderr.contains("could not be told to stop"),
        "{}",
        ended.stderr
    );
    drop(peer);
    let (dir, _peer) = unit(
        "ends-mute",
        Making {
            baud: 9600,
            ..Making::default()
        },
    );
    let child = spawn(&dir, &["./imu", "--wait", "1min"]);
    std::thread::sleep(Duration::from_millis(500));
    signal(&child, "-TERM");
    end(child).expect(143);
}

#[test]
fn a_reader_that_leaves_ends_it_even_while_nothing_comes() {
    let (dir, peer) = unit("reader", Making::default());
    let ended = sh(&dir, "imu-read ./imu | head -n 5").expect(0);
    assert_eq!(ended.rows().len(), 4);
    peer.wait_until("the end of the stream", |state| state.streaming.is_none());
    let sent = peer.state().sent;
    let mut child = spawn(&dir, &["./imu"]);
    peer.wait_until("a stream", |state| state.sent > sent + 30);
    peer.order(Order::Silence(Duration::from_secs(20)));
    std::thread::sleep(Duration::from_millis(100));
    drop(child.stdout.take());
    end(child);
}

#[test]
fn no_unit_no_port_no_gains() {
    let (dir, _peer) = unit(
        "gains",
        Making {
            mute_cells: vec![230],
            ..Making::default()
        },
    );
    let ended = sh(&dir, "imu-read ./imu -n 3").expect(69);
    assert!(ended.stderr.contains("--gains"), "{}", ended.stderr);
    assert!(ended.stdout.is_empty());
    let ended = sh(&dir, "imu-read ./imu -n 3 --gains 8500,10000,2000").expect(0);
    assert_eq!(ended.rows().len(), 3);
    // The predecessor's gain, which means other scales.
    let cells = [Making::default().cells, vec![(130, 64)]].concat();
    let (other, _peer) = unit(
        "3dmg",
        Making {
            cells,
            ..Making::default()
        },
    );
    let ended = sh(&other, "imu-read ./imu -n 3").expect(69);
    assert!(ended.stderr.contains("3DM-G"), "{}", ended.stderr);
    let ended = sh(&dir, "imu-read ./nothing --wait 0s").expect(69);
    assert!(ended.stderr.contains("imu-read list"), "{}", ended.stderr);
    assert!(!ended.stderr.contains("os error"), "{}", ended.stderr);
    let (mute, _peer) = unit(
        "mute",
        Making {
            baud: 9600,
            ..Making::default()
        },
    );
    let ended = sh(&mute, "imu-read ./imu --wait 0s --tee old.gx1").expect(69);
    assert!(
        ended
            .stderr
            .contains("no 3DM-GX1 answered at 38400, 115200, 19200 Bd")
    );
    assert!(!mute.join("old.gx1").exists());
    sh(&dir, "imu-read 192.168.0.1").expect(2);
    sh(&dir, "imu-read ./imu --axes platform").expect(2);
    sh(&dir, "imu-read ./imu --tee x.gx1 -o x.times.csv").expect(2);
}

#[test]
fn polled_and_combined() {
    let (dir, _peer) = unit("polled", Making::default());
    let ended = sh(&dir, "imu-read ./imu -n 30 --poll 20 --command 0x03");
    // A busy host asks late, which is said.
    assert!([0, 3].contains(&ended.status), "{}", ended.stderr);
    assert!(ended.numbers("mag_y_gauss").iter().all(|m| m.is_finite()));
    assert!(ended.column("roll_rad").iter().all(String::is_empty));
    let device = ended.numbers("device_ns");
    assert!(device.windows(2).all(|pair| pair[1] > pair[0]));
    let ended = sh(&dir, "imu-read ./imu -n 60 --command 0x0E,0x03").expect(0);
    let seq = ended.numbers("seq");
    assert!(is_consecutive(&seq));
    let (roll, mag) = (ended.numbers("roll_rad"), ended.numbers("mag_x_gauss"));
    assert!(roll.iter().filter(|r| r.is_finite()).count() >= 25);
    assert!(mag.iter().filter(|m| m.is_finite()).count() >= 15);
    let stamp = ended.numbers("stamp_ns");
    assert!(stamp.windows(2).all(|pair| pair[1] >= pair[0]));
    let ended = sh(&dir, "imu-read ./imu -n 5 --quantities attitude,mag").expect(0);
    assert!(ended.numbers("yaw_rad").iter().all(|y| y.abs() < 1e-9));
}

#[test]
fn a_recording_gives_the_same_records() {
    // One byte of 97 is lost, and the adapter is pulled once.
    let (dir, peer) = unit(
        "tee",
        Making {
            lose_every: 97,
            ..Making::default()
        },
    );
    let child = spawn(&dir, &["./imu", "--tee", "run.gx1", "-o", "live.csv", "-v"]);
    peer.wait_until("a stream", |state| state.sent > 150);
    peer.order(Order::Unplug(Duration::from_millis(300)));
    peer.wait_until("the stream again", |state| state.sent > 400);
    signal(&child, "-INT");
    let live = end(child).expect(3);
    assert!(live.stderr.contains("1 reconnections"), "{}", live.stderr);
    sh(&dir, "imu-read replay run.gx1 -o again.csv").expect(3);
    let read = |name: &str| std::fs::read_to_string(dir.join(name)).unwrap();
    assert!(read("live.csv").lines().count() > 100);
    assert_eq!(read("live.csv"), read("again.csv"));
    // In other axes, without times, as words.
    let enu = sh(&dir, "imu-read replay run.gx1 --axes enu -n 5").expect(3);
    assert!(enu.numbers("accel_z_m_s2").iter().all(|a| *a > 9.0));
    let own = sh(&dir, "imu-read replay run.gx1 --no-times").expect(3);
    assert_eq!(
        own.numbers("seq").len(),
        read("live.csv").lines().count() - 1
    );
    let packets = sh(&dir, "imu-read replay run.gx1 --packets -q").expect(0);
    assert!(packets.rows().iter().any(|row| row.contains(",0x28,")));
    // A table of times is of one recording.
    let twice = "imu-read replay run.gx1 run.gx1 --times run.times.csv";
    let refused = sh(&dir, twice).expect(2);
    assert!(
        refused.stderr.contains("one recording"),
        "{}",
        refused.stderr
    );
    sh(&dir, "imu-read replay run.gx1 --unit nowhere.toml").expect(66);
    // What the unit file says wrongly may be stated.
    let edit = "sed -i 's/rate_gain = .*/rate_gain = 64/; s/tick_factors = .*/tick_factors = [0, 0, 0, 0]/' \
                run.unit.toml; imu-read replay run.gx1";
    for (stated, option) in [("", "--gains"), ("--gains 8500,10000,2000", "--tick")] {
        let refused = sh(&dir, &format!("{edit} {stated}")).expect(65);
        assert!(refused.stderr.contains(option), "{}", refused.stderr);
    }
    sh(
        &dir,
        "imu-read replay run.gx1 --gains 8500,10000,2000 --tick 2ms",
    )
    .expect(3);
    // Without what lies beside it.
    std::fs::remove_file(dir.join("run.unit.toml")).unwrap();
    sh(&dir, "imu-read replay run.gx1").expect(2);
    sh(
        &dir,
        "imu-read replay run.gx1 --gains 8500,10000,2000 --tick 2ms",
    )
    .expect(3);
}

#[test]
fn mcap_carries_covariances() {
    let (dir, _peer) = unit("mcap", Making::default());
    sh(
        &dir,
        "imu-read ./imu -n 20 --format mcap --sigma-tilt-deg 0.3 -o imu.mcap",
    )
    .expect(0);
    let bytes = std::fs::read(dir.join("imu.mcap")).unwrap();
    assert!(bytes.starts_with(b"\x89MCAP"));
    assert!(
        bytes
            .windows(20)
            .any(|w| w == b"sensor_msgs/msg/Imu\0" || w.starts_with(b"sensor_msgs/msg/Imu"))
    );
}

#[test]
fn info_says_who_it_is() {
    let (dir, _peer) = unit(
        "info",
        Making {
            baud: 115_200,
            streaming: Some(Command::InstantVectors),
            ..Making::default()
        },
    );
    let text = sh(&dir, "imu-read info ./imu").expect(0);
    for part in [
        "number 4021",
        "3.2.01",
        "115200 Bd",
        "2 ms",
        "25.0 degC",
        "(factory: 16)",
    ] {
        assert!(text.text().contains(part), "{part}: {}", text.text());
    }
    let json = sh(&dir, "imu-read info ./imu --json").expect(0);
    let json: serde_json::Value = serde_json::from_slice(&json.stdout).unwrap();
    assert_eq!(json["serial_number"], 4021);
    assert_eq!(json["cells"]["accel-gain-scale"], 8500);
}

#[test]
fn cells_are_guarded_and_read_back() {
    let (dir, peer) = unit("cells", Making::default());
    let got = sh(&dir, "imu-read eeprom get ./imu 230 gyro-gain-scale").expect(0);
    assert_eq!(got.text(), "230\t8500\n130\t10000\n");
    // Without --yes nothing is sent.
    let dry = sh(&dir, "imu-read eeprom set ./imu oversampling 6").expect(0);
    assert!(
        dry.text().contains("29 71 00 1E 00 06 AA"),
        "{}",
        dry.text()
    );
    assert_eq!(peer.state().cells[&30], 4);
    let set = sh(&dir, "imu-read eeprom set ./imu 30 6 --yes").expect(0);
    assert!(set.text().contains("4 -> 6, read back"), "{}", set.text());
    assert_eq!(peer.state().cells[&30], 6);
    sh(&dir, "imu-read eeprom set ./imu hard-iron-x -5 --yes").expect(0);
    assert_eq!(peer.state().cells[&172], (-5i16).cast_unsigned());
    // The factory's calibration never, what cuts the link with --force only.
    let asked = peer.state().asked.len();
    for cell in [2, 24, 32, 42, 48, 60, 66, 118, 134, 3] {
        sh(
            &dir,
            &format!("imu-read eeprom set ./imu {cell} 1 --yes --force"),
        )
        .expect(2);
    }
    for cell in ["44 21", "46 0", "64 2", "230 7000"] {
        let refused = sh(&dir, &format!("imu-read eeprom set ./imu {cell} --yes")).expect(2);
        assert!(refused.stderr.contains("--force"), "{}", refused.stderr);
    }
    assert_eq!(peer.state().asked.len(), asked);
    sh(&dir, "imu-read eeprom set ./imu 64 2 --yes --force").expect(0);
    let dump = sh(&dir, "imu-read eeprom dump ./imu").expect(0);
    assert_eq!(dump.rows().len(), 128);
    assert!(dump.rows().contains(&"64,2,node-address,1"));
}

#[test]
fn bias_tare_rate_check() {
    let (dir, peer) = unit("asks", Making::default());
    for (ask, bytes) in [
        ("bias ./imu", "06"),
        ("tare ./imu", "0F C1 C3 C5"),
        ("tare ./imu --remove", "11 C1 C3 C5"),
        ("rate ./imu --tick 10ms", "29 71 00 F6 00 0A AA"),
    ] {
        let dry = sh(&dir, &format!("imu-read {ask}")).expect(0);
        assert!(dry.text().contains(bytes), "{}", dry.text());
    }
    assert!(peer.state().asked.is_empty());
    for ask in [
        "bias ./imu",
        "tare ./imu",
        "tare ./imu --remove",
        "rate ./imu --tick 10ms",
    ] {
        sh(&dir, &format!("imu-read {ask} --yes")).expect(0);
    }
    let state = peer.state();
    assert!(
        [0x06, 0x0F, 0x11]
            .iter()
            .all(|byte| state.asked.contains(byte))
    );
    assert_eq!(state.cells[&246], 10);
    let rate = sh(&dir, "imu-read rate ./imu").expect(0);
    assert!(rate.text().starts_with("tick 10 ms"), "{}", rate.text());
    sh(&dir, "imu-read rate ./imu --tick 1us").expect(2);
    // Nobody reads what was done: all four cells are written even so.
    for ask in [
        "rate ./imu --tick 20ms --yes",
        "tare ./imu",
        "bias ./imu --yes",
    ] {
        sh(&dir, &format!("imu-read {ask} > /dev/full")).expect(74);
    }
    let rate = sh(&dir, "imu-read rate ./imu").expect(0);
    assert!(rate.text().starts_with("tick 20 ms"), "{}", rate.text());
    // Cells that make no sense are shown, and mended by what sets them.
    sh(&dir, "imu-read eeprom set ./imu tick-factor-3 1 --yes").expect(0);
    sh(&dir, "imu-read info ./imu").expect(0);
    sh(&dir, "imu-read -n 1 ./imu").expect(69);
    sh(&dir, "imu-read rate ./imu --tick 10ms --yes").expect(0);
    let rate = sh(&dir, "imu-read rate ./imu").expect(0);
    assert!(rate.text().starts_with("tick 10 ms"), "{}", rate.text());
    // The stand-in is level and says -1 g on Z.
    let check = sh(&dir, "imu-read check ./imu -n 3").expect(0);
    assert!(
        check.text().contains("--accel-sign force"),
        "{}",
        check.text()
    );
    assert!(
        check.text().contains("not told by this pose"),
        "{}",
        check.text()
    );
    let list = sh(&dir, "imu-read list");
    assert!(list.status == 0 || list.status == 69);
}

#[test]
fn a_bus_is_refused_where_it_cannot_be() {
    let (dir, _peer) = unit("bus", Making::default());
    // A pseudo terminal has no ninth bit.
    let ended = sh(&dir, "imu-read ./imu --rs485-address 3 --poll 10").expect(69);
    assert!(ended.stderr.contains("ninth bit"), "{}", ended.stderr);
    sh(&dir, "imu-read info ./imu --rs485-address 3").expect(69);
    // Nothing is streamed there, and 0x31 has no room.
    sh(&dir, "imu-read ./imu --rs485-address 3").expect(2);
    let ended = sh(
        &dir,
        "imu-read ./imu --rs485-address 3 --poll 10 --command 0x31",
    )
    .expect(2);
    assert!(ended.stderr.contains("0x0F"), "{}", ended.stderr);
    sh(&dir, "imu-read ./imu --rs485-address 16 --poll 10").expect(2);
}

/// What is shown without --yes is what the line would carry: the command above the address, and the
/// write without checksum.
#[test]
fn on_a_bus_other_bytes_are_shown() {
    let dir = scratch("imu-bus-bytes");
    for (ask, bytes) in [
        ("eeprom set ./imu oversampling 6", "93 71 1E 00 06 AA"),
        ("bias ./imu", "63"),
        ("tare ./imu", "F3 C1 C3 C5"),
        ("rate ./imu --tick 10ms", "93 71 F6 00 0A AA"),
    ] {
        let dry = sh(&dir, &format!("imu-read {ask} --rs485-address 3")).expect(0);
        assert!(dry.text().contains(bytes), "{}", dry.text());
        assert_eq!(dry.stderr.matches("nothing was sent").count(), 1);
    }
    let none = sh(&dir, "imu-read tare ./imu --remove --rs485-address 3").expect(2);
    assert!(none.stderr.contains("0x0F"), "{}", none.stderr);
}
