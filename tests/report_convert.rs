//! report convert: what goes round comes back, and what is lost is said.

#![cfg(unix)]

mod shell;

use shell::{scratch, sh};
use std::fs;
use std::path::{Path, PathBuf};

const KINDS: [&str; 6] = ["scans", "imu", "lines", "poses", "truth", "desired"];

/// A run's files in run/.
fn a_run(name: &str) -> PathBuf {
    let dir = scratch(name);
    let line = "mkdir run && simulate -f frame.toml --n-scans 40 --effects reference,motion \
                --wobble-deg 1,0,0.5 --truth run/truth.csv --desired run/desired.csv \
                --imu run/imu.csv > run/scans.csv && \
                extract-lines -f frame.toml run/scans.csv > run/lines.csv && \
                solve-pose -f frame.toml --imu run/imu.csv run/lines.csv > run/poses.csv";
    sh(&dir, line).expect(0);
    dir
}

fn read(dir: &Path, file: &str) -> Vec<u8> {
    fs::read(dir.join(file)).unwrap_or_else(|error| panic!("{file}: {error}"))
}

#[test]
fn csv_to_mcap_and_back_is_the_same_bytes() {
    let dir = a_run("convert-round");
    let files = KINDS.map(|kind| format!("run/{kind}.csv")).join(" ");
    let there = format!("report convert {files} -o all.mcap");
    let ended = sh(&dir, &there).expect(0);
    assert!(
        ended.stdout.is_empty() && ended.stderr.is_empty(),
        "{}",
        ended.stderr
    );
    let back = sh(&dir, "report convert all.mcap -o back/").expect(0);
    assert!(back.stderr.is_empty(), "{}", back.stderr);
    for kind in KINDS {
        let (was, is) = (format!("run/{kind}.csv"), format!("back/{kind}.csv"));
        assert!(read(&dir, &was) == read(&dir, &is), "{kind}");
        let line = format!("report diff {was} {is}");
        assert!(sh(&dir, &line).expect(0).stdout.is_empty());
    }
    // One kind at a time through pipes, in both encodings.
    for kind in KINDS {
        let line = format!(
            "cat run/{kind}.csv | report convert --format mcap {kind}=- \
             | report convert --only {kind} --format csv > again.csv"
        );
        sh(&dir, &line).expect(0);
        assert!(
            read(&dir, &format!("run/{kind}.csv")) == read(&dir, "again.csv"),
            "{kind}"
        );
    }
    // The one MCAP is what report reads by itself.
    sh(&dir, "report --json all.mcap > mcap.json && report --json --truth run/truth.csv run/poses.csv > csv.json").expect(0);
    let ignore = "--ignore '*source' --ignore '*stages*' --ignore '*.run'";
    let line = format!("report diff {ignore} mcap.json csv.json");
    sh(&dir, &line).expect(0);
}

#[test]
fn messages_are_in_order_of_time() {
    let dir = a_run("convert-order");
    let line = "report convert run/poses.csv run/scans.csv run/imu.csv run/truth.csv -o all.mcap";
    sh(&dir, line).expect(0);
    let file = read(&dir, "all.mcap");
    let mut times = Vec::new();
    let mut topics = std::collections::BTreeSet::new();
    for message in mcap::MessageStream::new(&file).unwrap() {
        let message = message.unwrap();
        topics.insert(message.channel.topic.clone());
        if message.channel.topic != "/tf_static" {
            times.push(message.publish_time);
        }
    }
    assert!(times.is_sorted());
    for topic in [
        "/scan",
        "/scan_info",
        "/imu",
        "/pose",
        "/pose_status",
        "/truth",
        "/tf",
    ] {
        assert!(topics.contains(topic), "{topic}: {topics:?}");
    }
}

#[test]
fn other_kits_get_what_they_can_hold() {
    let dir = a_run("convert-text");
    let there = sh(&dir, "report convert run/poses.csv -o poses.tum").expect(0);
    assert!(
        there
            .stderr
            .contains("poses: stamp, position and rotation have a place here")
    );
    assert!(there.stderr.contains("cov_pitch_pitch"), "{}", there.stderr);
    let back = sh(&dir, "report convert poses.tum -o back.csv").expect(0);
    assert!(
        back.stderr.contains("last digits may differ"),
        "{}",
        back.stderr
    );
    let quiet = sh(&dir, "report convert -q poses.tum -o poses.mcap").expect(0);
    assert!(quiet.stderr.is_empty(), "{}", quiet.stderr);
    // Positions come back to the last digit, angles to rounding, in every encoding.
    let pose = "--ignore 'cov_*' --ignore '*stamp_ns' --ignore seq --ignore edges --ignore votes \
                --ignore range_bias_m --ignore status --ignore '*_ns'";
    let line = format!("report diff {pose} --tol '*_rad=1e-14' run/poses.csv back.csv");
    sh(&dir, &line).expect(0);
    let line = format!("report diff {pose} --tol '*_rad=1e-14' run/poses.csv poses.mcap");
    sh(&dir, &line).expect(0);
    // A trajectory with its velocity, through EuRoC.
    let line = "report convert -q run/desired.csv -o desired.euroc && \
                report convert -q desired=desired.euroc -o desired.csv && \
                report diff --tol '*_rad=1e-14' run/desired.csv desired.csv";
    sh(&dir, line).expect(0);
    // Scans have no place there.
    let ended = sh(&dir, "report convert run/scans.csv -o scans.tum").expect(2);
    assert!(
        ended
            .stderr
            .contains("TUM and EuRoC files hold poses and trajectories")
    );
}

#[test]
fn what_is_lost_is_said() {
    let dir = a_run("convert-lost");
    sh(
        &dir,
        "awk -F, -v OFS=, '{ print $0, NR == 1 ? \"note\" : \"x\" }' run/truth.csv > noted.csv",
    )
    .expect(0);
    let ended = sh(
        &dir,
        "report convert --format csv truth=noted.csv -o plain.csv",
    )
    .expect(0);
    assert!(
        ended
            .stderr
            .contains("truth: columns of no such record left out: note"),
        "{}",
        ended.stderr
    );
    assert!(read(&dir, "plain.csv") == read(&dir, "run/truth.csv"));
    let several = "report convert run/truth.csv run/imu.csv --format csv";
    assert!(
        sh(&dir, several)
            .expect(2)
            .stderr
            .contains("imu do not go into one file")
    );
    for (line, status, words) in [
        (
            "report convert run/poses.csv none=run/truth.csv",
            2,
            "one of scans, imu",
        ),
        (
            "report convert frame.toml",
            65,
            "its columns are of no record",
        ),
        ("report convert nowhere.csv", 66, "nowhere.csv"),
        (
            "report convert lines=run/poses.csv",
            65,
            "these are pose records, lines records are wanted",
        ),
        (
            "cat run/poses.csv | report convert --format mcap | report convert",
            2,
            "a pipe can be read only once",
        ),
        (
            "head -c 3000 run/scans.csv | report convert --format mcap > cut.mcap",
            65,
            "cut off",
        ),
    ] {
        let ended = sh(&dir, line).expect(status);
        assert!(ended.stderr.contains(words), "{line}: {}", ended.stderr);
    }
    let skipped =
        "head -c 10000 run/truth.csv | report convert --skip-bad --format mcap > cut.mcap";
    let ended = sh(&dir, skipped);
    assert!(
        ended.status == 3 || ended.stderr.is_empty(),
        "{}",
        ended.stderr
    );
}

#[test]
fn provenance_goes_along() {
    let dir = scratch("convert-provenance");
    let line = "export CABLEPOSE_META=1; \
                simulate -f frame.toml --n-scans 5 --seed 7 --truth truth.csv > scans.csv && \
                extract-lines -f frame.toml scans.csv | solve-pose -f frame.toml > poses.csv";
    sh(&dir, line).expect(0);
    let poses = String::from_utf8(read(&dir, "poses.csv")).unwrap();
    let stages: Vec<&str> = poses
        .lines()
        .take_while(|line| line.starts_with("# cablepose {"))
        .collect();
    assert_eq!(stages.len(), 3, "{poses:.300}");
    assert!(stages[0].contains("\"seed\":\"7\"") && stages[2].contains("\"tool\":\"solve-pose\""));
    // What a stream says is passed on without being asked to, and so is what people wrote above it.
    sh(
        &dir,
        "{ echo '# by hand'; cat poses.csv; } | compensate-delay --delay 1ms > later.csv",
    )
    .expect(0);
    let later = String::from_utf8(read(&dir, "later.csv")).unwrap();
    let lines: Vec<&str> = later
        .lines()
        .take_while(|line| line.starts_with('#'))
        .collect();
    assert_eq!((lines.len(), lines[0]), (5, "# by hand"));
    assert!(lines[4].contains("\"stage\":\"3\"") && lines[4].contains("compensate-delay"));
    // Without being asked to, nothing of it is written.
    let bare = sh(&dir, "simulate -f frame.toml --n-scans 2").expect(0);
    assert!(bare.text().starts_with("stamp_ns,"));
    // Into MCAP and back.
    sh(
        &dir,
        "report convert poses.csv truth.csv -o run.mcap && report convert --meta run.mcap -o back/",
    )
    .expect(0);
    let back = String::from_utf8(read(&dir, "back/poses.csv")).unwrap();
    let tools: Vec<&str> = back
        .lines()
        .take_while(|line| line.starts_with('#'))
        .filter_map(|line| line.split("\"tool\":\"").nth(1)?.split('"').next())
        .collect();
    // The simulation that both files come from is one stage.
    assert_eq!(
        tools,
        [
            "simulate",
            "extract-lines",
            "solve-pose",
            "report",
            "report"
        ]
    );
    // A fault is named by the file's own line.
    sh(&dir, "sed '7s/,.*//' poses.csv > bad.csv").expect(0);
    let ended = sh(&dir, "report --truth truth.csv bad.csv").expect(65);
    assert!(
        ended
            .stderr
            .contains("bad.csv:7: 1 fields where the header has"),
        "{}",
        ended.stderr
    );
}
