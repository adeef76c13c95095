//! A robot whose pulleys are not where its controller believes them to be, from simulation to the
//! robot file that is right.

mod shell;

use shell::{scratch, sh};

const RUN: &str = "simulate -q -f frame.toml --trajectory loop --from-pose 0,-2,0.8 --to-pose 0,2,2.4 \
                   --loops 2 --dwell 1s --speed-m-s 2 --robot robot.toml --robot-real real.toml \
                   --desired desired.csv --truth truth.csv --imu imu.csv";

/// The real upper pulleys are 60.2 mm higher on average.
#[test]
fn a_wrong_height_is_found_from_scans_and_corrected() {
    let dir = scratch("robot");
    // In two steps: the IMU's file is whole when it is opened.
    let poses = "extract-lines -q -f frame.toml | solve-pose -q -f frame.toml --imu imu.csv \
                 --imu-pitch-sigma-deg 0";
    sh(
        &dir,
        &format!("{RUN} > scans.csv; cat scans.csv | {poses} > poses.csv"),
    )
    .expect(0);
    let json = sh(
        &dir,
        "report robot --robot robot.toml --desired desired.csv --corrected corrected.toml --json poses.csv",
    )
    .expect(0);
    let found: serde_json::Value = serde_json::from_str(json.text()).unwrap();
    let shift = &found["shifts"]["upper.z"];
    let (mm, sigma) = (
        shift["shift_mm"].as_f64().unwrap(),
        shift["sigma_mm"].as_f64().unwrap(),
    );
    assert!(
        (mm - 60.2).abs() < 4.0 * sigma && sigma < 15.0,
        "{mm} +- {sigma}"
    );
    assert!(found["places"].as_array().unwrap().len() >= 4);
    // By the corrected file, the same poses show nothing more to find: it is what holds the platform,
    // though not what the controller wound by.
    let belief = std::fs::read_to_string(dir.join("robot.toml")).unwrap();
    let corrected = std::fs::read_to_string(dir.join("corrected.toml")).unwrap();
    assert_eq!(belief.lines().count(), corrected.lines().count());
    let changed = belief
        .lines()
        .zip(corrected.lines())
        .filter(|(a, b)| a != b);
    assert_eq!(changed.count(), 4);

    let again = RUN.replace("--robot robot.toml", "--robot corrected.toml");
    sh(
        &dir,
        &format!("{again} > scans.csv; cat scans.csv | {poses} > again.csv"),
    )
    .expect(0);
    let json = sh(
        &dir,
        "report robot --robot corrected.toml --desired desired.csv --json again.csv",
    )
    .expect(0);
    let after: serde_json::Value = serde_json::from_str(json.text()).unwrap();
    let rms = |report: &serde_json::Value| report["rms"]["error"]["z_mm"].as_f64().unwrap();
    assert!(
        rms(&after) < 0.3 * rms(&found),
        "{} {}",
        rms(&found),
        rms(&after)
    );

    let table = sh(
        &dir,
        "report robot --robot robot.toml --desired desired.csv --ascii poses.csv",
    )
    .expect(0);
    assert!(
        table.text().is_ascii() && table.text().contains("upper.z"),
        "{}",
        table.text()
    );
}

#[test]
fn the_same_robot_gives_the_same_bytes() {
    let dir = scratch("robot-bytes");
    for name in ["a", "b"] {
        sh(
            &dir,
            &format!("{RUN} --n-scans 20 > {name}.csv; mv truth.csv {name}.truth.csv"),
        )
        .expect(0);
    }
    let read = |name: &str| std::fs::read(dir.join(name)).unwrap();
    assert!(read("a.csv") == read("b.csv"));
    assert!(read("a.truth.csv") == read("b.truth.csv"));
}

#[test]
fn what_makes_no_sense_is_refused() {
    let dir = scratch("robot-refused");
    let text = std::fs::read_to_string(dir.join("robot.toml")).unwrap();
    std::fs::write(
        dir.join("bad.toml"),
        text.replacen("radius_m = 0.06", "radius_m = -1", 1),
    )
    .unwrap();
    let cases = [
        (
            "simulate -f frame.toml --trajectory grid --robot robot.toml",
            2,
            "--trajectory",
        ),
        (
            "simulate -f frame.toml --trajectory loop --robot bad.toml",
            78,
            "pulley_radius_m",
        ),
        (
            "simulate -f frame.toml --trajectory loop --robot none.toml",
            66,
            "none.toml",
        ),
        (
            "simulate -f frame.toml --trajectory loop --robot-real real.toml",
            2,
            "--robot",
        ),
        (
            "simulate -f frame.toml --trajectory loop --to-pose 0.33,4.5,5.6 --robot robot.toml",
            78,
            "cable",
        ),
    ];
    for (command, status, word) in cases {
        let ended = sh(&dir, command);
        assert_eq!(ended.status, status, "{command}\n{}", ended.stderr);
        assert!(ended.stderr.contains(word), "{command}\n{}", ended.stderr);
    }
    sh(&dir, &format!("{RUN} > scans.csv")).expect(0);
    let robot = "report robot --robot robot.toml --desired desired.csv";
    for (command, status, word) in [
        (format!("{robot} --find middle.z truth.csv"), 2, "middle"),
        (format!("{robot} --find upper truth.csv"), 2, "upper.z"),
        (format!("{robot} --least 1h truth.csv"), 65, "no place"),
    ] {
        let ended = sh(&dir, &command);
        assert_eq!(ended.status, status, "{command}\n{}", ended.stderr);
        assert!(ended.stderr.contains(word), "{command}\n{}", ended.stderr);
    }
}
