//! What the programs say about themselves is true: every example in every `--help` runs, `-h` is
//! short, `--version` names the program, a wrong command line ends with status 2.

mod peer;
mod shell;

use shell::{TOOLS, scratch, sh, testdata};
use std::path::PathBuf;

/// The commands under EXAMPLES in a tool's `--help`: lines indented by four, joined where one ends
/// with a backslash. What is indented by two says what the next command does.
fn examples(help: &str) -> Vec<String> {
    let mut commands: Vec<String> = Vec::new();
    let mut open = false;
    let section = help
        .lines()
        .skip_while(|line| *line != "EXAMPLES")
        .skip(1)
        .take_while(|line| line.is_empty() || line.starts_with(' '));
    for line in section
        .filter(|line| line.starts_with("    "))
        .map(str::trim)
    {
        let (text, more) = match line.strip_suffix('\\') {
            Some(text) => (text, true),
            None => (line, false),
        };
        match commands.last_mut() {
            Some(last) if open => last.push_str(text),
            _ => commands.push(text.to_owned()),
        }
        open = more;
    }
    commands
}

/// A directory with the files that the examples name: a frame file, a run of 20 scans through every
/// stage, a recording of a scanner.
fn a_small_run(name: &str) -> PathBuf {
    let dir = scratch(name);
    std::fs::copy(testdata("lms511.cola"), dir.join("run.cola")).unwrap();
    if name == "help-timesync" {
        // A log of exchanges with a clock 20 ppm fast, and poses of a platform there and back.
        let log = r#"awk 'BEGIN { print "host_send_ns,device_ns,host_receive_ns"; for (k = 0; k < 400; k++) {
            s = k * 28571429; a = 150000 + (k * 7919) % 300000; b = 150000 + (k * 104729) % 500000
            printf "1700000%012d,%.0f,1700000%012d\n", s, int((s + a) * 1.00002) + 3200000000, s + a + b
            } }' > exchanges.csv"#;
        let run = "simulate -f frame.toml --trajectory loop --lag 20ms --format mcap -o loop.mcap";
        let poses = "extract-lines -f frame.toml loop.mcap | solve-pose -f frame.toml --format csv \
                     > measured.csv";
        for stage in [log, run, poses] {
            sh(&dir, stage).expect(0);
        }
    }
    if name == "help-imu-read" {
        peer::record(&dir.join("run.gx1"), 200);
        std::fs::copy(dir.join("run.gx1"), dir.join("bare.gx1")).unwrap();
    }
    for stage in [
        "simulate -f frame.toml --n-scans 20 --truth truth.csv --imu imu.csv > scans.csv",
        "simulate -f frame.toml --n-scans 20 --format mcap -o run.mcap",
        "extract-lines -f frame.toml scans.csv > lines.csv",
        "solve-pose -f frame.toml --imu imu.csv lines.csv > poses.csv",
        "solve-pose -f frame.toml --method vote lines.csv > vote.csv",
    ] {
        sh(&dir, stage).expect(0);
    }
    dir
}

/// Runs the examples of a tool's `--help`, in order.
fn run_examples(tool: &str) {
    let dir = a_small_run(&format!("help-{tool}"));
    let help = sh(&dir, &format!("{tool} --help")).expect(0);
    let commands = examples(help.text());
    assert!(
        (3..=10).contains(&commands.len()),
        "{tool}: {} examples",
        commands.len()
    );
    assert!(commands.iter().all(|command| command.contains(tool)));
    for command in commands {
        let ended = sh(&dir, &command);
        assert_eq!(ended.status, 0, "{command}\n{}", ended.stderr);
    }
}

#[test]
fn the_examples_of_simulate_run() {
    run_examples("simulate");
}

#[test]
fn the_examples_of_extract_lines_run() {
    run_examples("extract-lines");
}

#[test]
fn the_examples_of_solve_pose_run() {
    run_examples("solve-pose");
}

#[test]
fn the_examples_of_compensate_delay_run() {
    run_examples("compensate-delay");
}

#[test]
fn the_examples_of_ads_push_run() {
    run_examples("ads-push");
}

#[test]
fn the_examples_of_report_run() {
    run_examples("report");
}

#[test]
fn the_examples_of_scan_capture_run() {
    run_examples("scan-capture");
}

#[test]
fn the_examples_of_timesync_run() {
    run_examples("timesync");
}

#[test]
fn the_examples_of_imu_read_run() {
    run_examples("imu-read");
    let dir = a_small_run("help-imu-read");
    let help = sh(&dir, "imu-read replay --help").expect(0);
    for command in examples(help.text()) {
        let ended = sh(&dir, &command);
        assert_eq!(ended.status, 0, "{command}\n{}", ended.stderr);
    }
}

#[test]
fn the_examples_of_the_readme_run() {
    let dir = scratch("help-readme");
    std::fs::create_dir(dir.join("testdata")).unwrap();
    std::fs::rename(dir.join("frame.toml"), dir.join("testdata/cablar.toml")).unwrap();
    let readme = include_str!("../README.md");
    let blocks: Vec<&str> = readme
        .split("<!-- example -->\n```sh\n")
        .skip(1)
        .map(|rest| rest.split("```").next().unwrap())
        .collect();
    assert_eq!(blocks.len(), 5);
    for block in blocks {
        let ended = sh(&dir, &format!("set -e\n{block}"));
        assert_eq!(ended.status, 0, "{block}\n{}", ended.stderr);
    }
}

#[test]
fn a_short_help_is_short() {
    let dir = scratch("help-short");
    for tool in TOOLS {
        let short = sh(&dir, &format!("{tool} -h")).expect(0);
        let long = sh(&dir, &format!("{tool} --help")).expect(0);
        let (short, long) = (short.text().lines().count(), long.text().lines().count());
        assert!(short < long, "{tool}: -h {short} lines, --help {long}");
    }
}

#[test]
fn a_version_names_the_program() {
    let dir = scratch("help-version");
    for tool in TOOLS {
        let version = sh(&dir, &format!("{tool} --version")).expect(0);
        assert_eq!(
            version.text(),
            format!("{tool} {}\n", env!("CARGO_PKG_VERSION"))
        );
    }
}

#[test]
fn a_wrong_command_line_ends_with_status_2() {
    let dir = scratch("help-usage");
    for tool in TOOLS {
        let ended = sh(&dir, &format!("{tool} --no-such-option")).expect(2);
        assert!(ended.stdout.is_empty());
        assert!(
            ended.stderr.contains("--no-such-option"),
            "{}",
            ended.stderr
        );
    }
}

#[test]
fn examples_are_found_in_a_help_text() {
    let help = "Options:\n  -h\n\nEXAMPLES\n  A remark:\n    simulate \\\n      | report -\n  \
        Another:\n    report x\n\nSEE ALSO\n    more\n";
    assert_eq!(examples(help), ["simulate | report -", "report x"]);
}
