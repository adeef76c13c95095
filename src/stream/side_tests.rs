use super::*;
use crate::stream::scratch::Scratch;
use crate::stream::{Encoding, Output};
use std::io::Write;
use std::time::Instant;

const NO_WAIT: Duration = Duration::ZERO;

fn options() -> Options {
    Options {
        tool: "test",
        ..Options::default()
    }
}

fn point(ns: i64) -> TrajectoryPoint {
    TrajectoryPoint {
        stamp: Stamp::from_ns(ns),
        position_m: [ns as f64, 0.0, 0.0],
        rotation_rad: [0.0; 3],
        velocity_m_s: [0.0; 3],
    }
}

fn stamps(
    pair: (Option<&TrajectoryPoint>, Option<&TrajectoryPoint>),
) -> (Option<i64>, Option<i64>) {
    (pair.0.map(|p| p.stamp.ns()), pair.1.map(|p| p.stamp.ns()))
}

#[test]
fn a_file_is_looked_up_by_time() {
    for (encoding, name) in [(Encoding::Csv, "a.csv"), (Encoding::Mcap, "a.mcap")] {
        let dir = Scratch::new(&format!("side-{name}"));
        let file = dir.file(name);
        let mut output = Output::create(&file, encoding, &options()).unwrap();
        for ns in [10, 20, 20, 30] {
            output.write_trajectory(Role::Truth, &point(ns)).unwrap();
        }
        output.finish().unwrap();
        let mut side = SideInput::open_trajectory(&file, Role::Truth, &options()).unwrap();
        let mut at = |ns| stamps(side.around(Stamp::from_ns(ns), NO_WAIT).unwrap());
        assert_eq!(at(5), (None, Some(10)));
        assert_eq!(at(10), (Some(10), Some(20)));
        assert_eq!(at(15), (Some(10), Some(20)));
        assert_eq!(at(20), (Some(20), Some(30)));
        assert_eq!(at(31), (Some(30), None));
        assert_eq!(at(99), (Some(30), None));
    }
}

#[test]
fn a_file_is_given_as_far_as_needed() {
    let dir = Scratch::new("side-until");
    let file = dir.file("until.csv");
    let mut output = Output::create(&file, Encoding::Csv, &options()).unwrap();
    for ns in [10, 20, 20, 30, 40] {
        output.write_trajectory(Role::Desired, &point(ns)).unwrap();
    }
    output.finish().unwrap();
    let mut side = SideInput::<TrajectoryPoint>::open(&file, &options()).unwrap();
    let mut upto = |ns| {
        let mut given = Vec::new();
        while let Some(record) = side.next_until(Stamp::from_ns(ns), None).unwrap() {
            given.push(record.stamp.ns());
        }
        given
    };
    assert_eq!(upto(5), [10]);
    assert_eq!(upto(9), [0; 0]);
    assert_eq!(upto(20), [20, 20, 30]);
    assert_eq!(upto(29), [0; 0]);
    assert_eq!(upto(99), [40]);
    assert_eq!(upto(99), [0; 0]);
}

#[test]
fn no_such_file_is_status_66() {
    let Err(error) = SideInput::<TrajectoryPoint>::open(Path::new("no/such"), &options()) else {
        panic!("opened");
    };
    assert_eq!(crate::stream::exit::status(&error), 66);
}

#[cfg(unix)]
fn made_fifo(dir: &Scratch) -> PathBuf {
    let fifo = dir.file("fifo");
    let made = std::process::Command::new("mkfifo").arg(&fifo).status();
    assert!(made.unwrap().success());
    fifo
}

#[cfg(unix)]
#[test]
fn a_live_fifo_is_waited_for_no_longer_than_asked() {
    let dir = Scratch::new("side-fifo");
    let fifo = made_fifo(&dir);
    let mut side = SideInput::<TrajectoryPoint>::open(&fifo, &options()).unwrap();
    // Nobody has opened it for writing: opening and asking come back all the same.
    assert_eq!(
        stamps(side.around(Stamp::from_ns(1), NO_WAIT).unwrap()),
        (None, None)
    );

    let mut writer = fs::OpenOptions::new().write(true).open(&fifo).unwrap();
    let header = "stamp_ns,x_m,y_m,z_m,roll_rad,pitch_rad,yaw_rad\n";
    writer.write_all(header.as_bytes()).unwrap();
    writer.write_all(b"10,0,0,0,0,0,0\n").unwrap();
    let long = Duration::from_secs(60);
    let short = Duration::from_millis(5);
    let start = Instant::now();
    // One record at or before is there, the one after it is not: the wait for it ends.
    let first = loop {
        let pair = stamps(side.around(Stamp::from_ns(10), short).unwrap());
        if pair.0.is_some() || start.elapsed() > long {
            break pair;
        }
    };
    assert_eq!(first, (Some(10), None));
    writer.write_all(b"20,0,0,0,0,0,0\n").unwrap();
    assert_eq!(
        stamps(side.around(Stamp::from_ns(12), long).unwrap()),
        (Some(10), Some(20))
    );
    // The end of the input ends the waiting.
    drop(writer);
    assert_eq!(
        stamps(side.around(Stamp::from_ns(50), long).unwrap()),
        (Some(20), None)
    );
}

#[cfg(unix)]
#[test]
fn a_fault_in_a_fifo_comes_through() {
    let dir = Scratch::new("side-bad-fifo");
    let fifo = made_fifo(&dir);
    let mut side = SideInput::<TrajectoryPoint>::open(&fifo, &options()).unwrap();
    let mut writer = fs::OpenOptions::new().write(true).open(&fifo).unwrap();
    writer.write_all(b"stamp_ns,x_m\n").unwrap();
    drop(writer);
    let error = side
        .around(Stamp::from_ns(1), Duration::from_secs(60))
        .unwrap_err();
    assert_eq!(crate::stream::exit::status(&error), 65);
}
