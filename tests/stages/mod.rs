//! Stages of a live chain as real processes, to be killed, signalled and waited for.

// Each test file is a crate of its own and uses a part of this.
#![allow(dead_code)]

use std::fs;
use std::io::{BufRead, BufReader, Read};
use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Far more than anything needs, even on a busy machine.
pub const LONG: Duration = Duration::from_secs(120);

/// Waits for a condition.
#[track_caller]
pub fn wait_for(what: &str, mut there: impl FnMut() -> bool) {
    let due = Instant::now() + LONG;
    while !there() {
        assert!(Instant::now() < due, "{what}: it did not come");
        std::thread::sleep(Duration::from_millis(10));
    }
}

/// A program that was just built.
pub fn program(tool: &str) -> PathBuf {
    let bin = Path::new(env!("CARGO_BIN_EXE_report")).parent().unwrap();
    bin.join(tool)
}

/// A running program, ended with its test.
pub struct Stage {
    /// The process.
    pub child: Child,
    name: String,
    said: Arc<Mutex<String>>,
    stderr: Option<JoinHandle<()>>,
}

/// How a program ended.
pub struct Ended {
    /// Its status; none where a signal ended it.
    pub status: Option<i32>,
    /// The signal that ended it.
    pub signal: Option<i32>,
    /// Its stderr.
    pub stderr: String,
}

impl Ended {
    /// Panics unless the status is one of `statuses`, and where a message is not for people.
    #[track_caller]
    pub fn expect(self, statuses: &[i32]) -> String {
        let right = self.status.is_some_and(|status| statuses.contains(&status));
        assert!(
            right,
            "status {:?}, signal {:?}: {}",
            self.status, self.signal, self.stderr
        );
        for text in ["panicked", "os error"] {
            assert!(!self.stderr.contains(text), "{}", self.stderr);
        }
        self.stderr
    }
}

impl Stage {
    /// Starts a command line (words parted by blanks) whose first word is a tool.
    pub fn start(
        dir: &Path,
        line: &str,
        stdin: impl Into<Stdio>,
        stdout: impl Into<Stdio>,
    ) -> Stage {
        let mut words = line.split_whitespace();
        let tool = words.next().unwrap();
        let mut command = Command::new(program(tool));
        command.args(words);
        Stage::spawn(dir, tool, command, stdin, stdout)
    }

    /// Starts a line of shell in which the tools are found by their names; to end the tool and not
    /// the shell, it begins with `exec` or ends in it.
    pub fn shell(
        dir: &Path,
        line: &str,
        stdin: impl Into<Stdio>,
        stdout: impl Into<Stdio>,
    ) -> Stage {
        let path = std::env::var("PATH").unwrap_or_default();
        let bin = program("report");
        let mut command = Command::new("bash");
        command.args(["-c", line]);
        command.env(
            "PATH",
            format!("{}:{path}", bin.parent().unwrap().display()),
        );
        Stage::spawn(dir, line, command, stdin, stdout)
    }

    fn spawn(
        dir: &Path,
        name: &str,
        mut command: Command,
        stdin: impl Into<Stdio>,
        stdout: impl Into<Stdio>,
    ) -> Stage {
        let mut child = command
            .current_dir(dir)
            .env("LC_ALL", "C")
            .env_remove("CABLEPOSE_PASSWORD")
            .stdin(stdin)
            .stdout(stdout)
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let said = Arc::new(Mutex::new(String::new()));
        let (mut err, heard) = (child.stderr.take().unwrap(), Arc::clone(&said));
        let stderr = std::thread::spawn(move || {
            let mut piece = [0; 512];
            while let Ok(count @ 1..) = err.read(&mut piece) {
                let text = String::from_utf8_lossy(&piece[..count]).into_owned();
                heard.lock().unwrap().push_str(&text);
            }
        });
        Stage {
            child,
            name: name.to_owned(),
            said,
            stderr: Some(stderr),
        }
    }

    /// What goes into it.
    pub fn stdin(&mut self) -> ChildStdin {
        self.child.stdin.take().unwrap()
    }

    /// What comes out of it.
    pub fn stdout(&mut self) -> ChildStdout {
        self.child.stdout.take().unwrap()
    }

    /// What it has said so far.
    pub fn said(&self) -> String {
        self.said.lock().unwrap().clone()
    }

    /// Waits until it has said something.
    #[track_caller]
    pub fn says(&self, text: &str) {
        let due = Instant::now() + LONG;
        while !self.said().contains(text) {
            let said = self.said();
            assert!(Instant::now() < due, "no {text:?} in: {said}");
            std::thread::sleep(Duration::from_millis(10));
        }
    }

    /// Sends a signal.
    #[track_caller]
    pub fn signal(&self, name: &str) {
        let pid = self.child.id().to_string();
        let status = Command::new("kill").args(["-s", name, &pid]).status();
        assert!(status.unwrap().success(), "{}", self.name);
    }

    /// Whether it still runs.
    pub fn runs(&mut self) -> bool {
        self.child.try_wait().unwrap().is_none()
    }

    /// A line of /proc/PID/status; none where there is no such thing.
    pub fn proc_status(&self, key: &str) -> Option<String> {
        let text = fs::read_to_string(format!("/proc/{}/status", self.child.id())).ok()?;
        let line = text.lines().find_map(|line| line.strip_prefix(key))?;
        Some(line.trim_start_matches(':').trim().to_owned())
    }

    /// Waits until it catches a signal (its number).
    #[track_caller]
    pub fn catches(&self, signal: u32) {
        wait_for(&format!("{} to catch {signal}", self.name), || {
            let mask = self.proc_status("SigCgt").unwrap_or_default();
            let mask = u64::from_str_radix(&mask, 16).unwrap_or(0);
            mask >> (signal - 1) & 1 == 1
        });
    }

    /// Waits for its end.
    #[track_caller]
    pub fn end(mut self) -> Ended {
        let due = Instant::now() + LONG;
        let status = loop {
            if let Some(status) = self.child.try_wait().unwrap() {
                break status;
            }
            if Instant::now() > due {
                let _ = self.child.kill();
                panic!("{} does not end: {}", self.name, self.said());
            }
            std::thread::sleep(Duration::from_millis(10));
        };
        self.stderr.take().unwrap().join().unwrap();
        Ended {
            status: status.code(),
            signal: status.signal(),
            stderr: self.said(),
        }
    }
}

impl Drop for Stage {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// An emulated scanner.
pub struct Scanner {
    /// Its process.
    pub stage: Stage,
    /// Its host and port.
    pub place: String,
}

impl Scanner {
    /// Serves at an address what `more` says: the scans, and what goes wrong.
    pub fn serve(dir: &Path, address: &str, more: &str) -> Scanner {
        let line = format!(
            "simulate -f frame.toml --trajectory random --tilt-deg 2 --serve {address} \
             --linger 60s {more}"
        );
        let stage = Stage::start(dir, &line, Stdio::null(), Stdio::null());
        stage.says("serving lms511 at ");
        let said = stage.said();
        let (_, place) = said.split_once("serving lms511 at ").unwrap();
        let place = place.lines().next().unwrap().to_owned();
        Scanner { stage, place }
    }
}

/// Reads lines of a stage's stdout until it ends.
pub fn lines_of(stdout: ChildStdout) -> impl Iterator<Item = String> {
    BufReader::new(stdout).lines().map_while(Result::ok)
}

/// A column of CSV text by name; a row that is cut off is left out.
pub fn column(text: &str, name: &str) -> Vec<i64> {
    let mut reader = csv::ReaderBuilder::new()
        .flexible(true)
        .from_reader(text.as_bytes());
    let headers = reader.headers().unwrap().clone();
    let index = headers.iter().position(|column| column == name).unwrap();
    let whole = |row: &csv::StringRecord| row.len() == headers.len();
    let rows = reader.records().map_while(Result::ok).filter(whole);
    rows.map(|row| row[index].parse().unwrap()).collect()
}

/// Whole rows of a CSV file that is being written, without the header.
pub fn rows(path: &Path) -> usize {
    fs::read_to_string(path).map_or(0, |text| text.matches('\n').count().saturating_sub(1))
}
