//! Every record through both encodings, whole.

use super::csv::{CsvReader, CsvWriter};
use super::mcap::{McapReader, McapWriter};
use super::samples;
use super::window::WindowState;
use super::{Options, Role, StreamRecord, Window};
use crate::record::TrajectoryPoint;
use proptest::prelude::*;
use std::cell::RefCell;
use std::fmt::Debug;
use std::io::{self, Cursor, Write};
use std::rc::Rc;

#[derive(Clone, Default)]
struct Buffer(Rc<RefCell<Vec<u8>>>);

impl Write for Buffer {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.borrow_mut().write(bytes)
    }
    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

fn to_csv<R: StreamRecord>(records: &[R]) -> Vec<u8> {
    let buffer = Buffer::default();
    let mut writer = CsvWriter::new(buffer.clone());
    for record in records {
        writer.write(record).unwrap();
    }
    writer.flush().unwrap();
    buffer.0.take()
}

fn from_csv<R: StreamRecord>(bytes: Vec<u8>) -> Vec<R> {
    let mut reader = CsvReader::new(
        Box::new(Cursor::new(bytes)),
        "csv",
        crate::stream::csv::Lines::default(),
    )
    .unwrap();
    let mut records = Vec::new();
    while reader.advance().unwrap_or_else(|e| panic!("{e:?}")) {
        records.push(R::clone(reader.record()));
    }
    records
}

fn to_mcap<R: StreamRecord>(records: &[R], role: Role, file: bool) -> Vec<u8> {
    let buffer = Buffer::default();
    let mut writer = McapWriter::new(buffer.clone(), file, &Options::default()).unwrap();
    for record in records {
        writer.write(record, role).unwrap();
    }
    writer.finish().unwrap();
    drop(writer);
    buffer.0.take()
}

fn from_mcap<R: StreamRecord>(bytes: Vec<u8>, role: Role) -> (Vec<R>, Option<String>) {
    let mut reader = McapReader::new(Box::new(Cursor::new(bytes)), "mcap", role);
    let mut window = WindowState::new(Window::default());
    let mut records = Vec::new();
    loop {
        match reader.advance(None, &mut window) {
            Ok(true) => records.push(R::clone(reader.record())),
            Ok(false) => return (records, None),
            Err(error) => return (records, Some(format!("{error:?}"))),
        }
    }
}

/// Text shows every value to the last digit, and NaN like NaN.
fn same<R: Debug>(read: &[R], written: &[R]) -> Result<(), TestCaseError> {
    prop_assert_eq!(format!("{read:?}"), format!("{written:?}"));
    Ok(())
}

fn goes_through<R: StreamRecord + Debug>(records: &[R], role: Role) -> Result<(), TestCaseError> {
    let csv = to_csv(records);
    same(&from_csv(csv.clone()), records)?;
    for file in [false, true] {
        let (read, fault) = from_mcap::<R>(to_mcap(records, role, file), role);
        prop_assert_eq!(fault, None);
        same(&read, records)?;
        prop_assert!(
            to_csv(&read) == csv,
            "the CSV of what MCAP gave back differs"
        );
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn scans(scan in samples::any_scan(), seq in any::<u32>()) {
        let mut second = scan.clone();
        second.seq = seq;
        goes_through(&[scan, second], Role::Desired)?;
    }

    #[test]
    fn imu_samples(records in prop::collection::vec(samples::any_imu(), 1..4)) {
        goes_through(&records, Role::Desired)?;
    }

    #[test]
    fn lines(records in prop::collection::vec(samples::any_lines(), 1..4)) {
        goes_through(&records, Role::Desired)?;
    }

    #[test]
    fn poses(records in prop::collection::vec(samples::any_pose(), 1..4)) {
        goes_through(&records, Role::Desired)?;
    }

    #[test]
    fn trajectories(records in prop::collection::vec(samples::any_point(), 1..4)) {
        goes_through(&records, Role::Truth)?;
        goes_through(&records, Role::Desired)?;
    }

    #[test]
    fn segments(records in prop::collection::vec(samples::any_segment(), 1..4)) {
        goes_through(&records, Role::Desired)?;
    }

    #[test]
    fn exchanges(records in prop::collection::vec(samples::any_exchange(), 1..4)) {
        goes_through(&records, Role::Desired)?;
    }

    /// Whatever the damage: the whole records before it, then an error or an end, and no panic.
    #[test]
    fn damaged_files(cut in 0..4000usize, at in 0..4000usize, to in any::<u8>(), file in any::<bool>()) {
        let scans = vec![samples::scan(); 5];
        let mut bytes = to_mcap(&scans, Role::Desired, file);
        if let Some(byte) = bytes.get_mut(at) {
            *byte = to;
        }
        bytes.truncate(bytes.len().saturating_sub(cut));
        let (read, _) = from_mcap::<crate::record::Scan>(bytes, Role::Desired);
        prop_assert!(read.len() <= scans.len());
    }
}

fn run_of_scans(count: u32) -> Vec<crate::record::Scan> {
    let scan = |seq| {
        let mut scan = samples::scan();
        scan.seq = seq;
        scan.stamp = scan.stamp + i64::from(seq) * 28_000_000;
        scan.ranges_m = (0..761)
            .map(|i| f64::from(1000 + (i * seq) % 977) / 1e3)
            .collect();
        scan.remissions = Vec::new();
        scan.further_ranges_m = Vec::new();
        scan.further_remissions = Vec::new();
        scan
    };
    (0..count).map(scan).collect()
}

#[test]
fn a_file_cut_in_mid_chunk_gives_what_is_whole() {
    let scans = run_of_scans(700);
    for file in [false, true] {
        let whole = to_mcap(&scans, Role::Desired, file);
        let cut = whole[..whole.len() * 6 / 10].to_vec();
        let (read, fault) = from_mcap::<crate::record::Scan>(cut, Role::Desired);
        assert!(
            read.len() > 300 && read.len() < 700,
            "{} of 700",
            read.len()
        );
        assert_eq!(format!("{read:?}"), format!("{:?}", &scans[..read.len()]));
        let fault = fault.unwrap();
        assert!(
            fault.contains("mcap: ends in the middle: it was cut off after"),
            "{fault}"
        );
    }
}

#[test]
fn other_writers_choices_are_read() {
    use ::mcap::{Compression, WriteOptions};
    let scans = run_of_scans(400);
    let ours = to_mcap(&scans, Role::Desired, true);
    for compression in [None, Some(Compression::Lz4), Some(Compression::Zstd)] {
        let mut out = Cursor::new(Vec::new());
        let mut writer = WriteOptions::new()
            .profile("ros2")
            .compression(compression)
            .create(&mut out)
            .unwrap();
        for message in ::mcap::MessageStream::new(&ours).unwrap() {
            writer.write(&message.unwrap()).unwrap();
        }
        writer.finish().unwrap();
        drop(writer);
        let (read, fault) = from_mcap::<crate::record::Scan>(out.into_inner(), Role::Desired);
        assert_eq!(fault, None);
        assert_eq!(format!("{read:?}"), format!("{scans:?}"));
    }
}

#[test]
fn a_file_is_chunked_and_indexed_and_a_pipe_is_not() {
    let scans = run_of_scans(700);
    let summary = |bytes: &[u8]| ::mcap::Summary::read(bytes).unwrap().unwrap();
    let file = summary(&to_mcap(&scans, Role::Desired, true));
    assert!(file.chunk_indexes.len() >= 2);
    assert!(file.chunk_indexes.iter().all(|c| c.compression == "zstd"));
    assert_eq!(file.stats.unwrap().message_count, 2 * 700 + 1);
    assert!(file.channels.values().any(|c| c.topic == "/tf_static"));
    let pipe = summary(&to_mcap(&scans, Role::Desired, false));
    assert!(pipe.chunk_indexes.is_empty());
    assert_eq!(pipe.metadata_indexes[0].name, "provenance");
}

#[test]
fn another_kind_of_stream_is_named() {
    let bytes = to_mcap(&[samples::pose()], Role::Desired, false);
    let (_, fault) = from_mcap::<crate::record::ReflectorLines>(bytes.clone(), Role::Desired);
    let fault = fault.unwrap();
    assert!(
        fault.contains("no /lines in this stream: it has /pose, /pose_status, /tf"),
        "{fault}"
    );
    let (_, fault) = from_mcap::<TrajectoryPoint>(bytes, Role::Truth);
    assert!(fault.unwrap().contains("no /truth"));
    let (_, fault) = from_mcap::<TrajectoryPoint>(b"\x89MCAP0\r\n".to_vec(), Role::Truth);
    assert!(fault.unwrap().contains("cut off after 0"));
}

#[test]
fn the_two_trajectories_are_told_apart() {
    let buffer = Buffer::default();
    let mut writer = McapWriter::new(buffer.clone(), false, &Options::default()).unwrap();
    let truth = samples::point();
    let mut desired = truth;
    desired.position_m[0] += 1.0;
    writer.write(&truth, Role::Truth).unwrap();
    writer.write(&desired, Role::Desired).unwrap();
    writer.finish().unwrap();
    drop(writer);
    let bytes = buffer.0.take();
    let read = |role| from_mcap::<TrajectoryPoint>(bytes.clone(), role).0;
    assert_eq!(read(Role::Truth), [truth]);
    assert_eq!(read(Role::Desired), [desired]);
}

/// The same file with some of its messages changed, and what it says of their types.
fn rewritten(
    bytes: &[u8],
    change: impl Fn(&mut ::mcap::Message<'_>, &mut ::mcap::Schema<'_>),
) -> Vec<u8> {
    let mut out = Cursor::new(Vec::new());
    let mut writer = ::mcap::Writer::new(&mut out).unwrap();
    for message in ::mcap::MessageStream::new(bytes).unwrap() {
        let mut message = message.unwrap();
        let mut channel = (*message.channel).clone();
        let mut schema = channel.schema.as_deref().unwrap().clone();
        change(&mut message, &mut schema);
        channel.schema = Some(schema.into());
        message.channel = channel.into();
        writer.write(&message).unwrap();
    }
    writer.finish().unwrap();
    drop(writer);
    out.into_inner()
}

#[test]
fn an_older_version_without_the_last_columns_is_read() {
    let pose = samples::pose();
    let older = rewritten(
        &to_mcap(std::slice::from_ref(&pose), Role::Desired, true),
        |message, schema| {
            if message.channel.topic == "/pose_status" {
                // Before there was pushed_ns: a column of eight bytes at the end.
                let text = std::str::from_utf8(&schema.data).unwrap();
                let text = text.strip_suffix("int64 pushed_ns\n").unwrap().to_owned();
                schema.data = text.into_bytes().into();
                let status = message.data.len() - 8;
                message.data.to_mut().truncate(status);
            }
        },
    );
    let (read, fault) = from_mcap::<crate::record::Pose>(older, Role::Desired);
    assert_eq!(fault, None);
    assert_eq!(
        read,
        [crate::record::Pose {
            pushed: None,
            ..pose
        }]
    );
}

#[test]
fn fields_in_another_place_are_refused_and_beside_other_records_passed_over() {
    let mut imu = samples::imu();
    imu.seq = 3;
    let foreign = rewritten(&to_mcap(&[imu], Role::Desired, true), |message, schema| {
        if message.channel.topic == "/imu_info" {
            schema.data = b"int64 stamp_ns\nfloat64 nonsense\n".to_vec().into();
            // It could be read as what it is not.
            message.data.to_mut()[4..].fill(0);
        }
    });
    let (_, fault) = from_mcap::<crate::record::ImuSample>(foreign.clone(), Role::Desired);
    assert!(
        fault
            .unwrap()
            .contains("/imu_info has other fields than this version's")
    );
    let input = Box::new(Cursor::new(foreign));
    let mut reader = McapReader::<crate::record::ReflectorLines>::new(input, "mcap", Role::Desired);
    reader.want_imu();
    let mut window = WindowState::new(Window::default());
    assert!(
        reader.advance(None, &mut window).is_err(),
        "there are no lines"
    );
    let beside: Vec<_> = reader.take_imu().collect();
    // The standard message is as good, but for the last digits.
    assert_eq!(beside.len(), 1);
    assert_eq!((beside[0].stamp, beside[0].axes), (imu.stamp, imu.axes));
    assert!((beside[0].pitch_rad - imu.pitch_rad).abs() < 1e-14);
}
