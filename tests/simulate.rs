//! `simulate` as a process: the same bytes for the same arguments, its side files, its refusals.

use snapbox::{assert_data_eq, file, str};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn simulate(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_simulate"))
        .args(["-f", "testdata/cablar.toml"])
        .args(args)
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .unwrap()
}

fn bytes(args: &[&str]) -> Vec<u8> {
    let output = simulate(args);
    let complaint = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{args:?}: {complaint}");
    assert!(complaint.is_empty(), "{complaint}");
    output.stdout
}

fn refusal(args: &[&str]) -> (i32, String) {
    let output = simulate(args);
    let text = String::from_utf8(output.stderr).unwrap();
    (output.status.code().unwrap(), text)
}

/// A fresh directory for one test's files.
fn scratch(name: &str) -> PathBuf {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR"))
        .join("simulate")
        .join(name);
    let _ = std::fs::remove_dir_all(&path);
    std::fs::create_dir_all(&path).unwrap();
    path
}

fn text_of(path: &Path) -> String {
    std::fs::read_to_string(path).unwrap()
}

/// FNV-1a, 64 bit: a digest that needs no crate.
fn digest(bytes: &[u8]) -> u64 {
    let mix = |hash: u64, byte: &u8| (hash ^ u64::from(*byte)).wrapping_mul(0x100_0000_01b3);
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, mix)
}

const COARSE: [&str; 4] = ["--frequency-hz", "75", "--resolution-deg", "1"];

#[test]
fn a_small_run_is_golden() {
    let dir = scratch("golden");
    let (truth, imu) = (dir.join("truth.csv"), dir.join("imu.csv"));
    let mut args = vec!["--effects", "reference,mixed,motion", "--n-scans", "3"];
    args.extend(COARSE);
    args.extend([
        "--truth",
        truth.to_str().unwrap(),
        "--imu",
        imu.to_str().unwrap(),
    ]);
    let scans = String::from_utf8(bytes(&args)).unwrap();
    assert_data_eq!(scans, file!["../testdata/golden/simulate/scans.csv"].raw());
    assert_data_eq!(
        text_of(&truth),
        file!["../testdata/golden/simulate/truth.csv"].raw()
    );
    assert_data_eq!(
        text_of(&imu),
        file!["../testdata/golden/simulate/imu.csv"].raw()
    );
}

#[test]
fn every_effect_and_trajectory_keeps_its_digits() {
    let mut table = String::new();
    let effects = [
        "none",
        "all",
        "reference",
        "noise",
        "bias",
        "quantisation",
        "footprint",
        "footprint,mixed",
        "footprint,echoes",
        "remission",
        "motion",
        "angle-jitter",
        "outliers",
        "dropouts",
        "cables",
        "cargo",
        "missing-strip",
        "clocks",
        "all,-cargo",
    ];
    for effects in effects {
        let mut args = vec!["--effects", effects, "--speed-m-s", "3", "--n-scans", "3"];
        args.extend(COARSE);
        writeln!(table, "{:016x} {effects}", digest(&bytes(&args))).unwrap();
    }
    for trajectory in ["grid", "random", "line", "loop"] {
        let mut args = vec!["--trajectory", trajectory, "--n-scans", "3"];
        args.extend(COARSE);
        writeln!(table, "{:016x} {trajectory}", digest(&bytes(&args))).unwrap();
    }
    assert_data_eq!(
        table,
        file!["../testdata/golden/simulate/digests.txt"].raw()
    );
}

#[test]
fn the_same_arguments_give_the_same_bytes() {
    let args = |seed| vec!["--effects", "all", "--n-scans", "20", "--seed", seed];
    assert_eq!(bytes(&args("5")), bytes(&args("5")));
    assert_ne!(bytes(&args("5")), bytes(&args("6")));
}

#[test]
fn a_trajectory_file_is_followed() {
    let dir = scratch("trajectory");
    let (planned, truth) = (dir.join("planned.csv"), dir.join("truth.csv"));
    let mut rows = "stamp_ns,x_m,y_m,z_m,roll_rad,pitch_rad,yaw_rad\n".to_owned();
    for k in 0..=20 {
        let y = -1.0 + 0.1 * f64::from(k);
        writeln!(rows, "{},0,{y},2,0,0,0.01", 1_000_000_000 + k * 50_000_000).unwrap();
    }
    std::fs::write(&planned, rows).unwrap();
    bytes(&[
        "--trajectory",
        planned.to_str().unwrap(),
        "--truth",
        truth.to_str().unwrap(),
    ]);
    let text = text_of(&truth);
    let mut reader = csv::Reader::from_reader(text.as_bytes());
    let mut rows = 0;
    for record in reader.records() {
        let record = record.unwrap();
        let value = |k: usize| record[k].parse::<f64>().unwrap();
        let seconds = (value(0) - 1_767_225_600e9) * 1e-9;
        assert!((value(2) - (2.0 * seconds - 1.0)).abs() < 1e-6);
        assert!((value(6) - 0.01).abs() < 1e-12 && (value(8) - 2.0).abs() < 1e-9);
        rows += 1;
    }
    assert_eq!(rows, 35);
}

#[test]
fn desired_is_without_wobble_and_lag() {
    let dir = scratch("desired");
    let (truth, desired) = (dir.join("truth.csv"), dir.join("desired.csv"));
    bytes(&[
        "--trajectory",
        "line",
        "--speed-m-s",
        "2",
        "--wobble-deg",
        "1,0,0",
        "--lag",
        "100ms",
        "--n-scans",
        "40",
        "--truth",
        truth.to_str().unwrap(),
        "--desired",
        desired.to_str().unwrap(),
    ]);
    let column = |path: &Path, name: &str| -> Vec<f64> {
        let text = text_of(path);
        let mut reader = csv::Reader::from_reader(text.as_bytes());
        let k = reader
            .headers()
            .unwrap()
            .iter()
            .position(|h| h == name)
            .unwrap();
        reader
            .records()
            .map(|r| r.unwrap()[k].parse().unwrap())
            .collect()
    };
    assert!(column(&desired, "roll_rad").iter().all(|roll| *roll == 0.0));
    let most = column(&truth, "roll_rad").into_iter().fold(0.0, f64::max);
    assert!((most.to_degrees() - 1.0).abs() < 0.02, "{most}");
    let behind = column(&desired, "y_m")[30] - column(&truth, "y_m")[30];
    let along_y = 8.0 / (64.0f64 + 3.035 * 3.035).sqrt();
    assert!((behind - 0.2 * along_y).abs() < 1e-9, "{behind}");
}

#[test]
fn an_effects_file_sets_sizes() {
    let dir = scratch("effects");
    let path = dir.join("effects.toml");
    std::fs::write(&path, "[outliers]\nshare = 0.5\n").unwrap();
    let path = path.to_str().unwrap();
    let common = ["--effects", "outliers", "--n-scans", "2"];
    let by_file = bytes(&[&common[..], &["--effects-file", path]].concat());
    let by_option = bytes(&[&common[..], &["--outlier-share", "0.5"]].concat());
    assert_eq!(by_file, by_option);
    std::fs::write(path, "[outliers]\nshare = 1.5\n").unwrap();
    let (status, text) = refusal(&["--effects-file", path]);
    assert_eq!(status, 78);
    assert!(text.contains("outliers.share: 1.5"), "{text}");
    // What would stop the run in its midst.
    std::fs::write(path, "[remission]\nceiling = -1.0\n").unwrap();
    let (status, text) = refusal(&["--effects-file", path]);
    assert_eq!(status, 78);
    assert!(text.contains("remission.ceiling: -1"), "{text}");
    std::fs::write(path, "[outlier]\nshare = 0.5\n").unwrap();
    assert_eq!(refusal(&["--effects-file", path]).0, 78);
    assert_eq!(refusal(&["--effects-file", "no-such-file.toml"]).0, 66);
}

#[test]
fn an_invalid_mode_is_refused_with_its_neighbours() {
    let (status, text) = refusal(&["--frequency-hz", "35", "--resolution-deg", "0.1667"]);
    assert_eq!(status, 2);
    assert_data_eq!(
        text,
        str![[r#"
simulate: lms511-hr has no mode 35 Hz/0.1667 deg; valid neighbours: 35 Hz/0.2500 deg, 25 Hz/0.1667 deg, 35 Hz/0.5000 deg, 50 Hz/0.1667 deg (interlaced 2x), 100 Hz/0.1667 deg (interlaced 4x)

"#]]
    );
    let (status, text) = refusal(&["--model", "lms9"]);
    assert_eq!(status, 2);
    assert!(text.contains("utm-30lx"), "{text}");
}

#[test]
fn an_interlaced_run_is_solved() {
    let dir = scratch("interlaced");
    let path = |name: &str| dir.join(name).to_str().unwrap().to_owned();
    let chained = |program: &str, args: &[&str]| {
        let output = Command::new(program)
            .args(["-f", "testdata/cablar.toml"])
            .args(args)
            .current_dir(env!("CARGO_MANIFEST_DIR"))
            .output()
            .unwrap();
        assert!(output.status.success(), "{output:?}");
    };
    let column = |name: &str, column: &str| -> Vec<f64> {
        let text = text_of(&dir.join(name));
        let mut reader = csv::Reader::from_reader(text.as_bytes());
        let k = reader.headers().unwrap().iter().position(|h| h == column);
        reader
            .records()
            .map(|row| row.unwrap()[k.unwrap()].parse().unwrap())
            .collect()
    };
    for (frequency, resolution, starts_deg) in [
        ("50", "0.1667", &[0.0, 1.0 / 6.0][..]),
        ("100", "0.1667", &[0.0, 1.0 / 6.0, 1.0 / 3.0, 0.5]),
    ] {
        let (truth, scans, lines, poses) =
            (path("t.csv"), path("s.csv"), path("l.csv"), path("p.csv"));
        let imu = path("i.csv");
        let mode = ["--frequency-hz", frequency, "--resolution-deg", resolution];
        let run = ["--effects", "none", "--n-scans", "24", "-o", &scans];
        bytes(&[&mode[..], &run, &["--truth", &truth, "--imu", &imu]].concat());
        for (k, angle_rad) in column("s.csv", "angle_min_rad").iter().enumerate() {
            let due_deg = starts_deg[k % starts_deg.len()] - 5.0;
            assert!((angle_rad.to_degrees() - due_deg).abs() < 1e-9, "scan {k}");
        }
        // Without effects the platform is at rest in each scan, and elsewhere in the next.
        chained(
            env!("CARGO_BIN_EXE_extract-lines"),
            &["--deskew", "none", &scans, "-o", &lines],
        );
        chained(
            env!("CARGO_BIN_EXE_solve-pose"),
            &["--imu", &imu, &lines, "-o", &poses],
        );
        for axis in ["y_m", "z_m"] {
            let (true_m, found_m) = (column("t.csv", axis), column("p.csv", axis));
            assert_eq!((true_m.len(), found_m.len()), (24, 24));
            for (true_m, found_m) in true_m.iter().zip(found_m) {
                assert!(
                    (true_m - found_m).abs() < 0.002,
                    "{axis}: {true_m} {found_m}"
                );
            }
        }
    }
}

#[test]
fn impossible_command_lines_are_refused() {
    for args in [
        &["--effects", "fog"][..],
        &["--effects", "none", "--sigma-mm", "3"],
        &["--trajectory", "grid", "--step-m", "0"],
        &["--trajectory", "line", "--speed-m-s", "-1"],
        &["--trajectory", "line", "--from-pose", "1,2"],
        &["--y-range", "4,-4"],
        &["--imu-rate-hz", "0"],
        &["--imu-rate-hz", "inf"],
        &["--trajectory", "line", "--speed-m-s", "inf"],
        &["--trajectory", "loop", "--jerk-m-s3", "inf"],
        &["--trajectory", "random", "--tilt-deg", "nan"],
        &["--wobble-deg", "1,0,0", "--wobble-hz", "nan"],
        &["--dilution", "--step-m", "0.0001"],
        &["--dilution", "--step-m", "1e-300"],
        &["--dilution", "--y-range=-1e300,1e300"],
        &["--dilution", "--dilution-html", "-"],
        &["--dilution", "--tilt-deg", "nan"],
        &["--speed-m-s", "2000"],
    ] {
        let (status, text) = refusal(args);
        assert_eq!(status, 2, "{args:?}: {text}");
        assert!(!text.is_empty());
    }
    assert_eq!(refusal(&["--trajectory", "no-such-file.csv"]).0, 66);
}

#[test]
fn options_of_another_trajectory_or_method_are_refused() {
    for (args, says) in [
        (
            &["--trajectory", "grid", "--from-pose", "0,0,2"][..],
            "--from-pose belongs to",
        ),
        (
            &["--trajectory", "random", "--step-m", "0.1"],
            "--step-m belongs to",
        ),
        (
            &["--y-range", "0,1"],
            "grid, random, --dilution, not to line",
        ),
        (
            &["--trajectory", "grid", "--lag", "5ms"],
            "--lag belongs to",
        ),
        (&["--loops", "2"], "--loops belongs to --trajectory loop"),
    ] {
        let (status, text) = refusal(args);
        assert_eq!(status, 2, "{args:?}: {text}");
        assert!(text.contains(says), "{text}");
    }
    for (args, says) in [
        (
            &["-f", "testdata/cablar.toml", "--sigma-mm", "3"][..],
            "--sigma-mm belongs to the methods for any scene",
        ),
        (
            &["--method", "split-and-merge", "--cold"],
            "--cold belongs to",
        ),
        (&["--range-sigma-mm", "3"], "--method reflectors"),
        (&["--bias-sigma-mm", "15"], "--method reflectors"),
    ] {
        let output = Command::new(env!("CARGO_BIN_EXE_extract-lines"))
            .args(args)
            .current_dir(env!("CARGO_MANIFEST_DIR"))
            .output()
            .unwrap();
        let text = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{args:?}: {text}");
        assert!(text.contains(says), "{text}");
    }
}

#[test]
fn an_mcap_stream_holds_everything() {
    let dir = scratch("mcap");
    let path = dir.join("run.mcap");
    let mut args = vec!["--effects", "reference,motion,clocks", "--n-scans", "4"];
    args.extend(COARSE);
    args.extend([
        "--imu-rate-hz",
        "100",
        "--format",
        "mcap",
        "-o",
        path.to_str().unwrap(),
    ]);
    assert!(bytes(&args).is_empty());
    let file = std::fs::read(&path).unwrap();
    let mut counts = std::collections::BTreeMap::new();
    for message in mcap::MessageStream::new(&file).unwrap() {
        *counts
            .entry(message.unwrap().channel.topic.clone())
            .or_insert(0) += 1;
    }
    let count = |topic: &str| counts.get(topic).copied().unwrap_or(0);
    for topic in ["/scan", "/scan_info", "/truth", "/desired"] {
        assert_eq!(count(topic), 4, "{topic} of {counts:?}");
    }
    // Four scans at 75 Hz end 0.047 s after the start: samples at 0, 10, .. 50 ms.
    assert_eq!(count("/imu"), 6, "{counts:?}");
}

#[test]
fn a_scene_says_where_it_is_from_as_a_frame_does() {
    let output = Command::new(env!("CARGO_BIN_EXE_simulate"))
        .args(["--scene", "office", "--n-scans", "2", "--meta"])
        .output()
        .unwrap();
    let complaint = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{complaint}");
    assert!(output.stdout.starts_with(b"# "));
}

/// Everything a run writes with the given arguments: scans, truth, desired trajectory, IMU samples.
fn everything(dir: &Path, name: &str, args: &[&str]) -> [String; 4] {
    let side = |what: &str| dir.join(format!("{name}-{what}.csv"));
    let sides = ["truth", "desired", "imu"].map(side);
    let [truth, desired, imu] = sides.each_ref().map(|path| path.to_str().unwrap());
    let mut all = vec!["--truth", truth, "--desired", desired, "--imu", imu];
    all.extend(args);
    let scans = String::from_utf8(bytes(&all)).unwrap();
    let [truth, desired, imu] = sides.map(|path| text_of(&path));
    [scans, truth, desired, imu]
}

const EVERYTHING: [&str; 14] = [
    "--effects",
    "all",
    "--trajectory",
    "loop",
    "--wobble-deg",
    "1,0.5,1",
    "--n-scans",
    "101",
    "--imu-rate-hz",
    "100",
    "--frequency-hz",
    "25",
    "--resolution-deg",
    "0.1667",
];

#[test]
fn any_number_of_jobs_gives_the_same_bytes() {
    let dir = scratch("jobs");
    let run = |jobs: &str| {
        let args = [&EVERYTHING[..], &["--jobs", jobs]].concat();
        everything(&dir, jobs, &args)
    };
    let one = run("1");
    assert_eq!(one[0].lines().count(), 102);
    for jobs in ["2", "5"] {
        assert!(run(jobs) == one, "--jobs {jobs}");
    }
}

#[test]
fn shards_put_together_are_the_run() {
    let dir = scratch("shards");
    let grid = ["--effects", "all", "--trajectory", "grid", "--step-m", "1"];
    for (name, args) in [("loop", &EVERYTHING[..]), ("grid", &grid[..])] {
        let whole = everything(&dir, name, args);
        let mut joined: [String; 4] = Default::default();
        for index in 1..=3 {
            let shard = format!("{index}/3");
            let args = [args, &["--shard", &shard]].concat();
            let part = everything(&dir, &format!("{name}-{index}"), &args);
            for (joined, part) in joined.iter_mut().zip(part) {
                let (header, rows) = part.split_once('\n').unwrap();
                if joined.is_empty() {
                    *joined = format!("{header}\n");
                }
                assert!(joined.starts_with(header) && !rows.is_empty());
                joined.push_str(rows);
            }
        }
        assert!(joined == whole, "{name}");
    }
    let (status, text) = refusal(&["--shard", "4/3"]);
    assert_eq!(status, 2);
    assert!(text.contains("I from 1 to N"), "{text}");
    let (status, _) = refusal(&["--shard", "1/3", "--real-time"]);
    assert_eq!(status, 2);
}
