//! report: what it computes of runs whose delay, alignment, drift and faults are known, because they
//! were put in here.

mod shell;

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use serde_json::Value;
use shell::{scratch, sh};
use std::fmt::Write;
use std::fs;
use std::path::Path;

/// 100 Hz.
const STEP_S: f64 = 0.01;
const DELAY_S: f64 = 0.037;
/// Of x, y, z (m), roll, pitch, yaw (rad): 3, 2, 2 mm and 0.05 degrees.
const SIGMA: [f64; 6] = [
    0.003,
    0.002,
    0.002,
    8.726_646e-4,
    8.726_646e-4,
    8.726_646e-4,
];

/// A loop through the workspace, at 1.17 m/s (rms).
fn place(t: f64) -> [f64; 6] {
    let size = 1.0085;
    [
        0.02 * (0.2 * t).sin(),
        size * (3.2 * (0.45 * t).sin() + 0.2 * (1.1 * t).sin()),
        2.2 + size * 1.2 * (0.63 * t + 0.4).cos(),
        0.01 * (0.7 * t).sin(),
        0.008 * (0.4 * t).cos(),
        0.03 * (0.3 * t).sin(),
    ]
}

fn row(stamp_ns: i64, values: [f64; 6]) -> String {
    let values = values.map(|v| format!("{v:.9}"));
    format!("{stamp_ns},{}\n", values.join(","))
}

fn stamp_ns(i: usize) -> i64 {
    1_700_000_000_000_000_000 + i as i64 * 10_000_000
}

const HEADER: &str = "stamp_ns,x_m,y_m,z_m,roll_rad,pitch_rad,yaw_rad\n";

/// Writes truth.csv and NAME: the truth `DELAY_S` late with noise, changed by `moved`.
fn write_run(dir: &Path, name: &str, rows: usize, moved: impl Fn([f64; 6]) -> [f64; 6]) {
    let mut random = ChaCha8Rng::seed_from_u64(37);
    let (mut truth, mut poses) = (HEADER.to_owned(), HEADER.to_owned());
    for i in 0..rows {
        let t = i as f64 * STEP_S;
        truth += &row(stamp_ns(i), place(t));
        let mut pose = place(t - DELAY_S);
        for (p, sigma) in pose.iter_mut().zip(SIGMA) {
            let white: f64 = StandardNormal.sample(&mut random);
            *p += sigma * white;
        }
        poses += &row(stamp_ns(i), moved(pose));
    }
    fs::write(dir.join("truth.csv"), truth).unwrap();
    fs::write(dir.join(name), poses).unwrap();
}

/// The first run of a report's JSON.
fn run_of(dir: &Path, options: &str) -> Value {
    let ended = sh(dir, &format!("report --truth truth.csv --json {options}")).expect(0);
    let mut json: Value = serde_json::from_slice(&ended.stdout).unwrap();
    json["runs"][0].take()
}

fn number(run: &Value, path: &str) -> f64 {
    let found = path.split('.').fold(run, |value, part| &value[part]);
    found.as_f64().unwrap_or_else(|| panic!("{path}: {found}"))
}

#[track_caller]
fn near(value: f64, wanted: f64, share: f64) {
    assert!(
        (value / wanted - 1.0).abs() < share,
        "{value}, not {wanted}"
    );
}

/// sqrt(3^2 + 2^2 + 2^2) mm.
const NOISE_MM: f64 = 4.123;

#[test]
fn a_delay_of_37_ms_is_found_and_what_it_makes_is_said() {
    let dir = scratch("evaluation-delay");
    write_run(&dir, "late.csv", 10_000, |pose| pose);
    let shown = run_of(&dir, "late.csv");
    let delay = &shown["delay"];
    assert!((number(delay, "delay_ms") - 37.0).abs() < 0.1, "{delay}");
    assert!(number(delay, "low_ms") < 37.0 && number(delay, "high_ms") > 37.0);
    assert!(number(delay, "sigma_ms") < 0.05);
    near(number(delay, "rms_before_mm"), 43.66, 0.02);
    near(number(delay, "rms_after_mm"), NOISE_MM, 0.02);
    near(number(delay, "share_mm"), 43.46, 0.02);
    // As measured, unless it is to be taken out.
    near(number(&shown, "position.rms_mm"), 43.66, 0.02);
    let curve = delay["curve"].as_array().unwrap();
    assert!((58..=64).contains(&curve.len()), "{}", curve.len());
    let lowest = curve
        .iter()
        .min_by(|a, b| a[1].as_f64().unwrap().total_cmp(&b[1].as_f64().unwrap()));
    assert!((lowest.unwrap()[0].as_f64().unwrap() - 37.0).abs() < 2.0);
    let removed = run_of(&dir, "--delay estimate late.csv");
    near(number(&removed, "position.rms_mm"), NOISE_MM, 0.02);
    near(
        number(&removed, "rotation.rms_deg"),
        0.05 * 3f64.sqrt(),
        0.02,
    );
    near(number(&removed, "along.rms_mm"), 2.0, 0.03);
    near(number(&removed, "cross.rms_mm"), 13f64.sqrt(), 0.03);
    // Without the delay the error along the way is that of a point 37 ms behind.
    near(
        number(&shown, "along.bias_mm"),
        -number(&shown, "along.max_mm"),
        0.6,
    );
    assert!(number(&shown, "along.bias_mm") < -30.0 && number(&shown, "cross.rms_mm") < 5.0);
    let given = run_of(&dir, "--delay 37ms late.csv");
    near(number(&given, "position.rms_mm"), NOISE_MM, 0.02);
    assert!(given["delay"]["sigma_ms"].is_null());
    let none = run_of(&dir, "--delay none late.csv");
    assert!(none["delay"].is_null());
    let table = sh(&dir, "report --truth truth.csv late.csv").expect(0);
    let text = table.text();
    let sentence = " mm of rms, of which the delay of 37.0 ms made 43.";
    assert!(
        text.contains(sentence) && text.contains("; without it 4.1"),
        "{text}"
    );
    assert!(text.contains("the errors above are as measured"), "{text}");
    sh(
        &dir,
        "report --truth truth.csv late.csv --fail-if 'delay.delay_ms>36'",
    )
    .expect(4);
    sh(
        &dir,
        "report --truth truth.csv late.csv --fail-if 'delay.share_mm>44'",
    )
    .expect(0);
}

#[test]
fn a_moved_run_is_aligned_if_asked_and_the_same_again_from_a_file() {
    let dir = scratch("evaluation-align");
    let turn = 0.02f64;
    write_run(&dir, "moved.csv", 4000, |[x, y, z, roll, pitch, yaw]| {
        let (sin, cos) = turn.sin_cos();
        [
            cos * x - sin * y + 0.05,
            sin * x + cos * y - 0.02,
            z + 0.01,
            roll,
            pitch,
            yaw + turn,
        ]
    });
    let plain = run_of(&dir, "--delay 37ms moved.csv");
    assert!(number(&plain, "position.rms_mm") > 40.0);
    assert_eq!(plain["alignment"]["kind"], "none");
    for how in ["se2", "se3", "full"] {
        let run = run_of(&dir, &format!("--delay estimate --align {how} moved.csv"));
        near(number(&run, "position.rms_mm"), NOISE_MM, 0.03);
        assert!(
            (number(&run, "alignment.yaw_deg") + turn.to_degrees()).abs() < 0.01,
            "{run}"
        );
        assert!((number(&run, "delay.delay_ms") - 37.0).abs() < 0.2);
        near(number(&run, "delay.rms_after_mm"), NOISE_MM, 0.03);
    }
    let line = "report --truth truth.csv --delay 37ms --align se2 --json moved.csv > first.json";
    sh(&dir, line).expect(0);
    let first: Value = serde_json::from_slice(&fs::read(dir.join("first.json")).unwrap()).unwrap();
    let again = run_of(&dir, "--delay 37ms --align file:first.json moved.csv");
    assert_eq!(again["alignment"]["kind"], "file");
    let (a, b) = (
        number(&first["runs"][0], "x.rms_mm"),
        number(&again, "x.rms_mm"),
    );
    assert!((a - b).abs() < 1e-4, "{a} {b}");
    let first = run_of(&dir, "--delay 37ms --align first:1 moved.csv");
    assert_eq!(first["alignment"]["kind"], "first:1");
    for (how, status) in [
        ("first:0", 2),
        ("file:", 2),
        ("sim3", 2),
        ("file:truth.csv", 65),
        ("file:none.toml", 66),
    ] {
        sh(
            &dir,
            &format!("report --truth truth.csv --align {how} moved.csv"),
        )
        .expect(status);
    }
}

#[test]
fn relative_errors_have_names_for_gates() {
    let dir = scratch("evaluation-relative");
    write_run(&dir, "late.csv", 3000, |pose| pose);
    let run = run_of(
        &dir,
        "--delay 37ms --rpe 1s --rpe 0.5m --rpe 10f --rpe-pairs all late.csv",
    );
    // Two poses' noise.
    near(
        number(&run, "rpe.10f.position.rms_mm"),
        NOISE_MM * 2f64.sqrt(),
        0.05,
    );
    assert_eq!(number(&run, "rpe.1s.pairs"), 2896.0);
    near(
        run["rpe"]["0.5m"]["rotation"]["rms_deg"].as_f64().unwrap(),
        0.05 * 6f64.sqrt(),
        0.05,
    );
    let gate = |options: &str, condition: &str, status| {
        let line = format!("report --truth truth.csv {options} late.csv --fail-if '{condition}'");
        sh(&dir, &line).expect(status)
    };
    gate("--rpe 0.5m", "rpe.0.5m.x.rms_mm>1", 4);
    gate("--rpe 0.5m", "rpe.0.5m.x.rms_mm>100", 0);
    gate("--rpe 1s", "rpe.2s.x.rms_mm>100", 4);
    gate("--rpe 1s", "rpe.1s.x.rms_deg>100", 2);
    gate("--rpe 1d", "x.rms_mm>100", 2);
    let table = sh(&dir, "report --truth truth.csv --rpe 1s late.csv").expect(0);
    assert!(
        table.text().contains("rpe, mm") && table.text().contains("29 pairs"),
        "{}",
        table.text()
    );
}

#[test]
fn an_imu_is_compared_where_the_platform_moves() {
    let dir = scratch("evaluation-imu");
    write_run(&dir, "late.csv", 6000, |pose| pose);
    let mut imu =
        "stamp_ns,axes,roll_rad,pitch_rad,yaw_rad,gyro_x_rad_s,gyro_y_rad_s,gyro_z_rad_s\n"
            .to_owned();
    for i in 0..6000 {
        let t = i as f64 * STEP_S;
        let [.., roll, pitch, yaw] = place(t - DELAY_S);
        // Two degrees an hour.
        let drift = (2.0f64 / 3600.0).to_radians() * (t - 30.0);
        let rates = [
            0.007 * (0.7 * t).cos(),
            -0.0032 * (0.4 * t).sin(),
            0.009 * (0.3 * t).cos(),
        ];
        let _ = write!(
            imu,
            "{},platform,{roll:.9},{:.9},{:.9}",
            stamp_ns(i),
            pitch - 0.01,
            yaw + 1.0 + drift
        );
        let _ = writeln!(imu, ",{:.9},{:.9},{:.9}", rates[0], rates[1], rates[2]);
    }
    fs::write(dir.join("imu.csv"), imu).unwrap();
    let run = run_of(&dir, "--imu imu.csv late.csv");
    let of = |path: &str| number(&run["orientation"], path);
    assert!((of("pitch.offset_deg") - 0.01f64.to_degrees()).abs() < 5e-3);
    assert!((of("yaw.offset_deg") + 1f64.to_degrees()).abs() < 5e-3);
    // The line through 6000 errors of 0.05 deg over a minute is known to 0.13 deg/h.
    assert!((of("yaw.drift_deg_h") + 2.0).abs() < 0.6 && of("roll.drift_deg_h").abs() < 0.6);
    near(of("roll.rms_deg"), 0.05, 0.03);
    assert!((280.0..=300.0).contains(&of("rate.z.n")));
    let table = sh(&dir, "report --truth truth.csv --imu imu.csv late.csv").expect(0);
    let text = table.text();
    assert!(
        text.contains("to IMU, deg") && !text.contains("IMU at rest"),
        "{text}"
    );
    sh(
        &dir,
        "report --truth truth.csv --imu imu.csv late.csv --fail-if 'orientation.yaw.rms_deg>1'",
    )
    .expect(0);
}

#[test]
fn what_poses_rest_on_is_counted() {
    let dir = scratch("evaluation-quality");
    let line = "simulate -q -f frame.toml --trajectory random --n-scans 40 --truth truth.csv \
                | extract-lines -q -f frame.toml | tee lines.csv \
                | solve-pose -q -f frame.toml > poses.csv";
    sh(&dir, line).expect(0);
    let run = run_of(&dir, "--lines lines.csv poses.csv");
    let quality = &run["quality"];
    assert_eq!(quality["scans"], 40);
    let edges: u64 = quality["edges"]
        .as_array()
        .unwrap()
        .iter()
        .map(|n| n.as_u64().unwrap())
        .sum();
    assert_eq!(edges, run["scans"]["solved"].as_u64().unwrap());
    assert!(
        number(quality, "residual.upper.rms_mm") > 0.1 && number(quality, "points.upper") > 20.0
    );
    assert!(number(quality, "strips_seen") > 1.0);
    assert_eq!(run["refused"]["total"], run["scans"]["refused"]);
    // Every scan is at another place: no motion, no delay.
    assert!(run["delay"].is_null() && run["along"].is_null());
    let table = sh(&dir, "report --truth truth.csv --lines lines.csv poses.csv").expect(0);
    assert!(table.text().contains("strips and"), "{}", table.text());
}

#[test]
fn a_standing_platform_has_a_stability() {
    let dir = scratch("evaluation-standing");
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let (mut truth, mut poses) = (HEADER.to_owned(), HEADER.to_owned());
    for i in 0..3000 {
        let mut pose = place(0.0);
        truth += &row(stamp_ns(i), pose);
        for (p, sigma) in pose.iter_mut().zip(SIGMA) {
            let white: f64 = StandardNormal.sample(&mut random);
            *p += sigma * white;
        }
        poses += &row(stamp_ns(i), pose);
    }
    fs::write(dir.join("truth.csv"), truth).unwrap();
    fs::write(dir.join("poses.csv"), poses).unwrap();
    let run = run_of(&dir, "poses.csv");
    let of = |name: &str| {
        run["stability"]["x"][name].as_array().unwrap()[0]
            .as_f64()
            .unwrap()
    };
    near(of("deviation_mm"), 3.0, 0.05);
    near(of("tau_s"), 0.01, 1e-9);
    assert!(number(&run, "stability.x.floor_mm") < 0.5);
    assert!(run["delay"].is_null());
    let ended = sh(&dir, "report --truth truth.csv --delay estimate poses.csv").expect(0);
    assert!(
        ended
            .text()
            .contains("the delay cannot be estimated: the platform stands still"),
        "{}",
        ended.text()
    );
    assert!(ended.text().contains("Allan deviation"));
    let ended = sh(&dir, "report --truth truth.csv --align se3 poses.csv").expect(0);
    assert!(
        ended.text().contains("only the shift was aligned"),
        "{}",
        ended.text()
    );
}
