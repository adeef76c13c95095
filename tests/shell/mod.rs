//! Runs the nine programs as people do: in a shell, with pipes.

// Each test file is a crate of its own and uses a part of this.
#![allow(dead_code)]

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// The nine programs.
pub const TOOLS: [&str; 9] = [
    "scan-capture",
    "imu-read",
    "timesync",
    "simulate",
    "extract-lines",
    "solve-pose",
    "compensate-delay",
    "ads-push",
    "report",
];

/// How a command line ended.
#[derive(Debug)]
pub struct Ended {
    /// The exit status of the last program that failed, 0 if none did.
    pub status: i32,
    /// All of stdout.
    pub stdout: Vec<u8>,
    /// All of stderr.
    pub stderr: String,
}

impl Ended {
    /// stdout as text.
    pub fn text(&self) -> &str {
        std::str::from_utf8(&self.stdout).unwrap()
    }

    /// Rows of CSV on stdout, without the header.
    pub fn rows(&self) -> Vec<&str> {
        self.text().lines().skip(1).collect()
    }

    /// One column of CSV on stdout, by name.
    pub fn column(&self, name: &str) -> Vec<String> {
        let mut reader = csv::Reader::from_reader(&self.stdout[..]);
        let index = reader
            .headers()
            .unwrap()
            .iter()
            .position(|column| column == name)
            .unwrap_or_else(|| panic!("no column {name}"));
        reader
            .records()
            .map(|row| row.unwrap()[index].to_owned())
            .collect()
    }

    /// One column of numbers; an empty field is NaN.
    pub fn numbers(&self, name: &str) -> Vec<f64> {
        self.column(name)
            .iter()
            .map(|field| {
                if field.is_empty() {
                    f64::NAN
                } else {
                    field.parse().unwrap()
                }
            })
            .collect()
    }

    /// Panics unless the status is `status`.
    #[track_caller]
    pub fn expect(self, status: i32) -> Ended {
        assert_eq!(
            self.status,
            status,
            "stdout: {:.400}\nstderr: {}",
            String::from_utf8_lossy(&self.stdout),
            self.stderr
        );
        self
    }
}

/// An empty directory of its own for a test, with `frame.toml` (CABLAR) in it.
pub fn scratch(name: &str) -> PathBuf {
    let dir = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = fs::remove_dir_all(&dir);
    fs::create_dir_all(&dir).unwrap();
    for (from, to) in [
        ("cablar.toml", "frame.toml"),
        ("robot.toml", "robot.toml"),
        ("robot-real.toml", "real.toml"),
    ] {
        fs::copy(testdata(from), dir.join(to)).unwrap();
    }
    dir
}

/// A file under testdata/.
pub fn testdata(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("testdata")
        .join(name)
}

/// A recording of a real scanner. They lie outside the repository, in ../shared/data or where
/// CABLEPOSE_DATA says; none, and that is said, where this one is not there.
pub fn recording(name: &str) -> Option<PathBuf> {
    let data = std::env::var_os("CABLEPOSE_DATA").map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data"),
        PathBuf::from,
    );
    let path = data.join("lms5xx").join(name);
    if path.is_file() {
        return Some(path);
    }
    eprintln!("SKIPPED: no {} (set CABLEPOSE_DATA)", path.display());
    None
}

/// Runs a line of shell in `dir`; the programs' names mean those just built.
pub fn sh(dir: &Path, line: &str) -> Ended {
    let bin = Path::new(env!("CARGO_BIN_EXE_report")).parent().unwrap();
    let mut path = vec![bin.to_owned()];
    path.extend(std::env::split_paths(
        &std::env::var_os("PATH").unwrap_or_default(),
    ));
    let output = Command::new("bash")
        .args(["-o", "pipefail", "-c", line])
        .current_dir(dir)
        .env("PATH", std::env::join_paths(path).unwrap())
        .env("LC_ALL", "C")
        .stdin(Stdio::null())
        .output()
        .unwrap();
    Ended {
        status: output.status.code().unwrap_or(-1),
        stdout: output.stdout,
        stderr: String::from_utf8_lossy(&output.stderr).into_owned(),
    }
}
