//! solve-pose with an IMU beside it: what a run tells of the IMU's mounting, and what gaps in its
//! samples do to the poses.

mod shell;

use shell::{scratch, sh, testdata};
use std::fs;
use std::path::Path;

/// A frame file from testdata with the IMU mounted at `rotation_deg`.
fn mounted(dir: &Path, source: &str, name: &str, rotation_deg: &str) {
    let text = fs::read_to_string(testdata(source)).unwrap();
    let at = text.find("[imu]").expect("an [imu] table");
    let (before, imu) = text.split_at(at);
    let nominal = "rotation_deg = [0.0, 0.0, 0.0]";
    assert!(imu.contains(nominal));
    let turned = imu.replacen(nominal, &format!("rotation_deg = {rotation_deg}"), 1);
    fs::write(dir.join(name), format!("{before}{turned}")).unwrap();
}

/// `imu.rotation_deg` of a frame file, and the standard deviations in the line's remark.
fn written(dir: &Path, name: &str) -> ([f64; 3], Vec<f64>) {
    let text = fs::read_to_string(dir.join(name)).unwrap();
    let imu = &text[text.find("[imu]").unwrap()..];
    let line = imu.lines().find(|l| l.starts_with("rotation_deg")).unwrap();
    let list = line.split(['[', ']']).nth(1).unwrap();
    let values: Vec<f64> = list.split(',').map(|v| v.trim().parse().unwrap()).collect();
    let sigmas = line.split("+- ").skip(1);
    let sigmas = sigmas.map(|s| s.split(' ').next().unwrap().parse().unwrap());
    ([values[0], values[1], values[2]], sigmas.collect())
}

/// The IMU's errors without the constant one and the one that wanders off for good: nothing tells
/// them from its mounting.
const ERRORS: &str = "[imu]\nattitude_bias_deg = 0.0\nattitude_walk_deg_sqrt_s = 0.0\n";

fn simulated(dir: &Path, frame: &str, seed: u32) {
    fs::write(dir.join("errors.toml"), ERRORS).unwrap();
    let command = format!(
        "simulate -q -f {frame} --effects reference,imu --effects-file errors.toml --seed {seed} \
         --trajectory loop --speed-m-s 0.5 --wobble-deg 1,1,0.5 --wobble-hz 0.7 --n-scans 500 \
         --imu-rate-hz 100 --imu-axes ned --imu imu.csv --truth truth.csv > scans.csv"
    );
    sh(dir, &command).expect(0);
}

#[test]
fn strips_on_the_walls_align_roll_and_pitch() {
    let dir = scratch("align-walls");
    mounted(&dir, "inclined.toml", "true.toml", "[0.70, -1.10, 0.0]");
    mounted(&dir, "inclined.toml", "frame.toml", "[0.0, 0.0, 0.0]");
    simulated(&dir, "true.toml", 7);
    sh(
        &dir,
        "extract-lines -q -f frame.toml scans.csv | solve-pose -f frame.toml --imu imu.csv \
         --align-imu aligned.toml > poses.csv",
    )
    .expect(0);
    let (found_deg, sigmas_deg) = written(&dir, "aligned.toml");
    for (k, want) in [0.70, -1.10].into_iter().enumerate() {
        let sigma = sigmas_deg[k];
        assert!(sigma > 0.0 && sigma < 0.05, "{sigmas_deg:?}");
        let off = (found_deg[k] - want) / sigma;
        assert!(off.abs() < 3.0, "{found_deg:?} +- {sigmas_deg:?}");
    }
    // Nothing else in the file has changed.
    let before = fs::read_to_string(dir.join("frame.toml")).unwrap();
    let after = fs::read_to_string(dir.join("aligned.toml")).unwrap();
    let changed = before.lines().zip(after.lines()).filter(|(a, b)| a != b);
    assert_eq!(
        (before.lines().count(), changed.count()),
        (after.lines().count(), 1)
    );
}

#[test]
fn a_constant_x_aligns_the_pitch_where_only_the_ceiling_has_strips() {
    let dir = scratch("align-plane");
    mounted(&dir, "cablar.toml", "true.toml", "[0.70, -1.10, 0.0]");
    mounted(&dir, "cablar.toml", "frame.toml", "[0.0, 0.0, 0.0]");
    simulated(&dir, "true.toml", 8);
    let solve = "extract-lines -q -f frame.toml scans.csv | solve-pose -f frame.toml --imu imu.csv";
    let ended = sh(&dir, &format!("{solve} --align-imu roll.toml > poses.csv")).expect(0);
    assert!(
        ended.stderr.contains("pitch not shown by this run"),
        "{}",
        ended.stderr
    );
    let (found_deg, _) = written(&dir, "roll.toml");
    assert!(
        (found_deg[0] - 0.70).abs() < 0.05 && found_deg[1] == 0.0,
        "{found_deg:?}"
    );

    sh(
        &dir,
        &format!("{solve} --align-imu aligned.toml --align-x-constant > poses.csv"),
    )
    .expect(0);
    let (found_deg, sigmas_deg) = written(&dir, "aligned.toml");
    for (k, want) in [0.70, -1.10].into_iter().enumerate() {
        let off = (found_deg[k] - want) / sigmas_deg[k];
        assert!(
            off.abs() < 3.0 && sigmas_deg[k] < 0.1,
            "{found_deg:?} +- {sigmas_deg:?}"
        );
    }
    // With the mounting found, x is right; without, 1.1 deg moves it by up to 90 mm.
    let with = |frame: &str| {
        let command = format!(
            "extract-lines -q -f {frame} scans.csv | solve-pose -f {frame} --imu imu.csv \
             | report --truth truth.csv --json | grep -A 12 '\"x\": {{' | grep rms_mm | tr -dc 0-9."
        );
        sh(&dir, &command)
            .expect(0)
            .text()
            .trim()
            .parse::<f64>()
            .unwrap()
    };
    let (before_mm, after_mm) = (with("frame.toml"), with("aligned.toml"));
    assert!(
        before_mm > 40.0 && after_mm < 12.0,
        "{before_mm} {after_mm}"
    );
}

#[test]
fn gaps_in_the_samples_are_not_bridged_and_said() {
    let dir = scratch("imu-gap");
    mounted(&dir, "cablar.toml", "frame.toml", "[0.0, 0.0, 0.0]");
    sh(
        &dir,
        "simulate -q -f frame.toml --n-scans 60 --imu-rate-hz 100 --imu all.csv \
         | extract-lines -q -f frame.toml > lines.csv",
    )
    .expect(0);
    // 80 ms without a sample, in the middle.
    let all = fs::read_to_string(dir.join("all.csv")).unwrap();
    let kept: Vec<&str> = all
        .lines()
        .enumerate()
        .filter(|(i, _)| !(81..=88).contains(i))
        .map(|(_, line)| line)
        .collect();
    fs::write(dir.join("imu.csv"), kept.join("\n") + "\n").unwrap();
    let whole = sh(&dir, "solve-pose -f frame.toml --imu all.csv lines.csv").expect(0);
    assert!(whole.column("status").iter().all(|s| !s.contains("imu")));
    let gappy = sh(&dir, "solve-pose -f frame.toml --imu imu.csv lines.csv").expect(0);
    let stale = gappy
        .column("status")
        .iter()
        .filter(|s| s.contains("stale-imu"))
        .count();
    assert!((2..=3).contains(&stale), "{stale}");
    // Bridged on request.
    let bridged = sh(
        &dir,
        "solve-pose -f frame.toml --imu imu.csv --imu-max-gap 20 lines.csv",
    );
    let bridged = bridged.expect(0).column("status");
    assert!(bridged.iter().all(|s| !s.contains("imu")));
}

#[test]
fn the_samples_own_sigma_counts_unless_another_is_given() {
    let dir = scratch("imu-sigma");
    mounted(&dir, "cablar.toml", "frame.toml", "[0.0, 0.0, 0.0]");
    sh(
        &dir,
        "simulate -q -f frame.toml --n-scans 5 --imu plain.csv \
         | extract-lines -q -f frame.toml > lines.csv; \
         sed '1s/$/,pitch_sigma_rad/; 2,$s/$/,0.002/' plain.csv > stated.csv",
    )
    .expect(0);
    let sigma = |options: &str| {
        let ended = sh(
            &dir,
            &format!("solve-pose -f frame.toml {options} lines.csv"),
        )
        .expect(0);
        ended.numbers("cov_pitch_pitch")[0].sqrt()
    };
    assert!((sigma("--imu stated.csv") - 0.002).abs() < 1e-4);
    let half_deg = 0.5f64.to_radians();
    assert!((sigma("--imu plain.csv") - half_deg).abs() < 0.2 * half_deg);
    let given = sigma("--imu stated.csv --imu-pitch-sigma-deg 0.05").to_degrees();
    assert!((given - 0.05).abs() < 1e-3, "{given}");
}

#[test]
fn options_that_do_not_go_together_are_refused() {
    let dir = scratch("align-usage");
    mounted(&dir, "cablar.toml", "frame.toml", "[0.0, 0.0, 0.0]");
    for options in [
        "--align-imu a.toml --pitch-deg 0",
        "--align-imu a.toml --method vote",
        "--align-x-constant",
    ] {
        sh(
            &dir,
            &format!("solve-pose -f frame.toml {options} < /dev/null"),
        )
        .expect(2);
    }
}
