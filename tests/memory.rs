//! The memory of a filter does not grow with its stream, and stays small. It is read from /proc
//! while the filter waits for more, in CSV, and as the most there has been, in MCAP.
#![cfg(target_os = "linux")]

mod shell;

use shell::{scratch, sh, testdata};
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::Duration;

/// What a filter may take, and by what it may grow once it has seen some records, KiB.
const MOST_KIB: u64 = 32 * 1024;
const GROWTH_KIB: u64 = 512;

/// A filter that is fed by hand.
struct Filter {
    child: Child,
    /// A message for each line that has come out.
    lines: Receiver<()>,
    came: usize,
}

impl Filter {
    fn start(program: &str, arguments: &[&str]) -> Filter {
        let mut child = Command::new(program)
            .args(arguments)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .expect("the filter starts");
        let stdout = child.stdout.take().expect("its stdout");
        let (sender, lines) = channel();
        std::thread::spawn(move || {
            for line in BufReader::new(stdout).lines() {
                if line.is_err() || sender.send(()).is_err() {
                    return;
                }
            }
        });
        let came = 0;
        Filter { child, lines, came }
    }

    fn feed(&mut self, text: &str) {
        let stdin = self.child.stdin.as_mut().expect("its stdin");
        stdin.write_all(text.as_bytes()).expect("it reads");
        stdin.flush().expect("it reads");
    }

    /// Waits until so many lines have come in all, then for the filter to wait; its memory, KiB.
    fn memory_kib_after(&mut self, lines: usize) -> u64 {
        while self.came < lines {
            self.lines
                .recv_timeout(Duration::from_secs(120))
                .expect("the filter writes");
            self.came += 1;
        }
        status_kib(self.child.id(), "VmRSS").expect("it lives")
    }
}

impl Drop for Filter {
    fn drop(&mut self) {
        self.child.stdin = None;
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// A line of /proc/PID/status.
fn status_kib(process: u32, name: &str) -> Option<u64> {
    let status = std::fs::read_to_string(format!("/proc/{process}/status")).ok()?;
    let line = status.lines().find(|line| line.starts_with(name))?;
    line.split_whitespace().nth(1)?.parse().ok()
}

/// The records of a file over and over, with stamps that go on: those in the first `stamps`
/// columns, and the number in the one behind.
struct Endless {
    header: String,
    rows: Vec<String>,
    stamps: usize,
    span_ns: i64,
    count: usize,
}

impl Endless {
    fn of(file: &Path, stamps: usize) -> Endless {
        let text = std::fs::read_to_string(file).expect("the records");
        let mut lines = text.lines().map(str::to_owned);
        let header = lines.next().expect("a header");
        let rows: Vec<String> = lines.collect();
        let stamp = |row: &str| -> i64 {
            let first = row.split(',').next().expect("a column");
            first.parse().expect("a stamp")
        };
        let (first, last) = (stamp(&rows[0]), stamp(&rows[rows.len() - 1]));
        let period_ns = (last - first) / (rows.len() as i64 - 1);
        Endless {
            header: header + "\n",
            span_ns: last - first + period_ns,
            rows,
            stamps,
            count: 0,
        }
    }

    fn next(&mut self, count: usize) -> String {
        let mut text = String::new();
        for _ in 0..count {
            let (round, row) = (self.count / self.rows.len(), self.count % self.rows.len());
            let mut fields = self.rows[row].splitn(self.stamps + 1, ',');
            for field in fields.by_ref().take(self.stamps) {
                if let Ok(stamp) = field.parse::<i64>() {
                    text += &(stamp + round as i64 * self.span_ns).to_string();
                }
                text.push(',');
            }
            text += fields.next().expect("more columns");
            text.push('\n');
            self.count += 1;
        }
        text
    }
}

#[test]
fn filters_of_csv_do_not_grow() {
    const WARM_UP: usize = 1500;
    const RECORDS: usize = 6000;
    let dir = scratch("memory-csv");
    let frame = testdata("cablar.toml");
    let frame = frame.to_str().expect("a path");
    // To and fro, so that the end of the file goes on at its beginning.
    let made = sh(
        &dir,
        &format!(
            "simulate -q -f {frame} --trajectory loop --loops 1 --n-scans 600 > scans.csv && \
             extract-lines -q -f {frame} scans.csv > lines.csv && \
             solve-pose -q -f {frame} --pitch-deg 0 lines.csv > poses.csv"
        ),
    );
    assert_eq!(made.status, 0, "{}", made.stderr);
    let filters: [(&str, &str, &[&str], &str, usize); 3] = [
        (
            "extract-lines",
            env!("CARGO_BIN_EXE_extract-lines"),
            &["-q", "-f", frame],
            "scans.csv",
            3,
        ),
        (
            "solve-pose",
            env!("CARGO_BIN_EXE_solve-pose"),
            &["-q", "-f", frame, "--pitch-deg", "0"],
            "lines.csv",
            2,
        ),
        (
            "compensate-delay",
            env!("CARGO_BIN_EXE_compensate-delay"),
            &["-q", "--delay", "62ms"],
            "poses.csv",
            2,
        ),
    ];
    for (name, program, arguments, file, stamps) in filters {
        let mut records = Endless::of(&dir.join(file), stamps);
        let mut filter = Filter::start(program, arguments);
        filter.feed(&records.header);
        filter.feed(&records.next(WARM_UP));
        // A header comes before the records.
        let before_kib = filter.memory_kib_after(1 + WARM_UP);
        filter.feed(&records.next(RECORDS));
        let after_kib = filter.memory_kib_after(1 + WARM_UP + RECORDS);
        assert!(
            after_kib < before_kib + GROWTH_KIB,
            "{name}: {before_kib} KiB after {WARM_UP} records, {after_kib} after {RECORDS} more"
        );
        assert!(after_kib < MOST_KIB, "{name}: {after_kib} KiB");
    }
}

/// The most memory that a filter ever had over a file, KiB.
fn most_kib(program: &str, arguments: &[&str], file: &Path) -> u64 {
    let mut child = Command::new(program)
        .args(arguments)
        .arg(file)
        .stdout(Stdio::null())
        .spawn()
        .expect("the filter starts");
    let mut most_kib = 0;
    loop {
        most_kib = status_kib(child.id(), "VmHWM").unwrap_or(most_kib);
        if let Some(status) = child.try_wait().expect("it can be waited for") {
            assert!(status.success(), "{program}: {status}");
            return most_kib;
        }
        std::thread::sleep(Duration::from_millis(2));
    }
}

#[test]
fn filters_of_mcap_do_not_grow() {
    let dir = scratch("memory-mcap");
    let frame = testdata("cablar.toml");
    let frame = frame.to_str().expect("a path");
    let sizes = [800, 4000];
    for scans in sizes {
        let made = sh(
            &dir,
            &format!(
                "simulate -q -f {frame} --trajectory loop --loops 100 --n-scans {scans} \
                 --effects none --format mcap | cat > scans-{scans} && \
                 extract-lines -q -f {frame} scans-{scans} | cat > lines-{scans} && \
                 solve-pose -q -f {frame} --pitch-deg 0 lines-{scans} | cat > poses-{scans}"
            ),
        );
        assert_eq!(made.status, 0, "{}", made.stderr);
    }
    let filters: [(&str, &[&str], &str); 3] = [
        (
            env!("CARGO_BIN_EXE_extract-lines"),
            &["-q", "-f", frame],
            "scans",
        ),
        (
            env!("CARGO_BIN_EXE_solve-pose"),
            &["-q", "-f", frame, "--pitch-deg", "0"],
            "lines",
        ),
        (
            env!("CARGO_BIN_EXE_compensate-delay"),
            &["-q", "--delay", "62ms"],
            "poses",
        ),
    ];
    for (program, arguments, records) in filters {
        let most_kib =
            sizes.map(|n| most_kib(program, arguments, &dir.join(format!("{records}-{n}"))));
        let [few_kib, many_kib] = most_kib;
        assert!(
            many_kib < few_kib + 2 * GROWTH_KIB,
            "{program}: {sizes:?} scans, {most_kib:?} KiB"
        );
        assert!(many_kib < MOST_KIB, "{program}: {many_kib} KiB");
    }
}
