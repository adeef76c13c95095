use super::*;
use crate::record::{
    ClockExchange, ImuSample, Pose, ReflectorLines, Scan, Segment, Stamp, TrajectoryPoint,
};
use crate::stream::samples::{self, START};

fn written<R: Record>(records: &[R]) -> anyhow::Result<String> {
    let mut writer = CsvWriter::new(Vec::new());
    for record in records {
        writer.write(record)?;
    }
    writer.flush()?;
    let bytes = writer
        .writer
        .into_inner()
        .map_err(|e| anyhow::anyhow!("{e}"))?;
    Ok(String::from_utf8(bytes.inner)?)
}

fn reader<R: StreamRecord>(text: &str) -> anyhow::Result<CsvReader<R>> {
    CsvReader::new(
        Box::new(std::io::Cursor::new(text.to_owned())),
        "f.csv",
        Lines::default(),
    )
}

/// The records before the first fault, and the fault.
fn read<R: StreamRecord>(text: &str) -> (Vec<R>, Option<String>) {
    let mut records = Vec::new();
    let mut reader = match reader::<R>(text) {
        Ok(reader) => reader,
        Err(error) => return (records, Some(error.to_string())),
    };
    loop {
        match reader.advance() {
            Ok(true) => records.push(reader.record().clone()),
            Ok(false) => return (records, None),
            Err(RowError::Bad(fault)) => return (records, Some(fault.to_string())),
            Err(RowError::Fatal(error)) => return (records, Some(error.to_string())),
        }
    }
}

fn fault<R: StreamRecord>(text: &str) -> String {
    read::<R>(text).1.unwrap_or_default()
}

const POINTS: &str = "stamp_ns,x_m,y_m,z_m,roll_rad,pitch_rad,yaw_rad,vx_m_s,vy_m_s,vz_m_s\n\
                      5,1,2,3,0.1,0.2,0.3,,,\n";

#[test]
fn a_scan_has_a_row() {
    let text = written(&[samples::scan()]).unwrap();
    let mut rows = text.split('\n');
    let header = rows.next().unwrap();
    assert!(header.starts_with("stamp_ns,received_ns,device_ns,seq,angle_min_rad,"));
    assert!(header.contains(",ranges_mm,remissions,ranges_3_mm,remissions_2,transmit_ns,"));
    assert!(!header.contains("scan_counter"), "{header}");
    let row = rows.next().unwrap();
    assert!(row.contains(",1292 5123.457 inf -inf 65533,0 17 254.5 65535 3,"));
    assert!(row.contains(r#""LMS511, ""left"""#));
}

#[test]
fn columns_come_in_any_order() {
    let text = "# made by hand\nyaw_rad,extra,pitch_rad,roll_rad,z_m,y_m,x_m,stamp_ns\n\
                0.3,what,0.2,0.1,3,2,1,5\n";
    let (records, fault) = read::<TrajectoryPoint>(text);
    assert_eq!(fault, None);
    assert_eq!(records[0].stamp, Stamp::from_ns(5));
    assert_eq!(records[0].position_m, [1.0, 2.0, 3.0]);
    assert_eq!(records[0].rotation_rad, [0.1, 0.2, 0.3]);
    assert!(records[0].velocity_m_s[0].is_nan());
}

#[test]
fn the_header_tells_what_is_wrong() {
    assert_eq!(
        fault::<TrajectoryPoint>(""),
        "f.csv: empty: trajectory records start with a header row"
    );
    assert_eq!(
        fault::<TrajectoryPoint>("# only this\n"),
        fault::<TrajectoryPoint>("")
    );
    assert_eq!(
        fault::<TrajectoryPoint>(&POINTS.replace("y_m,", "width,")),
        "f.csv:1: column y_m missing (trajectory records are wanted)"
    );
    let poses = written(&[samples::pose()]).unwrap();
    let text = fault::<ClockExchange>(&poses);
    assert!(
        text.starts_with("f.csv:1: these are pose records, clock records are wanted: columns host"),
        "{text}"
    );
    assert_eq!(
        fault::<TrajectoryPoint>(&POINTS.replace("vx_m_s", "x_m")),
        "f.csv:1: column x_m is there twice"
    );
}

#[test]
fn a_fault_names_line_and_column() {
    let second = |row: &str| {
        let (records, fault) = read::<TrajectoryPoint>(&format!("{POINTS}{row}\n{POINTS}"));
        assert_eq!(records.len(), 1, "what came before {row} is lost");
        fault.unwrap()
    };
    assert_eq!(
        second("6,1,\"1,5\",3,0,0,0,,,"),
        r#"f.csv:3: y_m: not a number: "1,5""#
    );
    assert_eq!(
        second("6,1,2,3"),
        "f.csv:3: 4 fields where the header has 10"
    );
    assert_eq!(
        second("6,1,2,3,4,5,6,7,8,9,10"),
        "f.csv:3: 11 fields where the header has 10"
    );
    assert_eq!(second("6,1,,3,0,0,0,,,"), "f.csv:3: y_m: empty");
    assert_eq!(second("6,1,inf,3,0,0,0,,,"), "f.csv:3: y_m: not finite");
    assert_eq!(
        second("6,1,nan,3,0,0,0,,,"),
        r#"f.csv:3: y_m: not a number: "nan""#
    );
    assert_eq!(second(",1,2,3,0,0,0,,,"), "f.csv:3: stamp_ns: empty");
    assert_eq!(
        second("6.5,1,2,3,0,0,0,,,"),
        r#"f.csv:3: stamp_ns: not a whole number: "6.5""#
    );
}

#[test]
fn lists_must_fit_together() {
    let scans = written(&[samples::scan()]).unwrap();
    assert_eq!(
        fault::<Scan>(&scans.replace(" 65533,", ",")),
        "f.csv:2: remissions: 5 items where ranges_mm has 4"
    );
    assert_eq!(
        fault::<Scan>(&scans.replace("1 1 1 1 1", "1 1")),
        "f.csv:2: remissions_2: 2 items where ranges_mm has 5"
    );
    let text = fault::<Scan>(&scans.replace("-inf", "-in"));
    assert_eq!(
        text,
        r#"f.csv:2: ranges_mm: not a list of ranges in mm: "1292 5123.457 inf -in 65533""#
    );

    let mut lines = ReflectorLines {
        stamp: START,
        ..ReflectorLines::default()
    };
    lines.edges = vec![Default::default(); 3];
    let text = written(&[lines]).unwrap();
    assert_eq!(
        fault::<ReflectorLines>(&text.replace("-1 -1 -1", "-1 -1")),
        "f.csv:2: edge_strip: 2 items where edge_face has 3"
    );
    assert_eq!(
        fault::<ReflectorLines>(&text.replace("on on on", "")),
        "f.csv:2: edge_kind: 0 items where edge_face has 3"
    );
    assert_eq!(
        fault::<ReflectorLines>(&text.replace("upper upper upper", "upper floor upper")),
        "f.csv:2: edge_face: not a list of right, upper, left: \"upper floor upper\""
    );
}

#[test]
fn a_pose_without_numbers_must_say_so() {
    let mut pose = samples::pose();
    pose.position_m = [f64::NAN; 3];
    pose.rotation_rad = [f64::NAN; 3];
    let text = written(&[pose.clone()]).unwrap();
    assert_eq!(
        fault::<Pose>(&text),
        "f.csv:2: x_m: empty, and the status is not no-pose"
    );
    pose.status = crate::record::Status::NO_POSE;
    assert_eq!(read::<Pose>(&written(&[pose]).unwrap()).1, None);
}

#[test]
fn an_extra_value_without_a_column_is_an_error() {
    let with = samples::scan();
    let mut without = with.clone();
    without.info = None;
    let text = written(&[with.clone(), without.clone()]).unwrap();
    let shown = format!("{:?}", [with.clone(), without.clone()]);
    assert_eq!(format!("{:?}", read::<Scan>(&text).0), shown);
    let error = written(&[without, with]).unwrap_err().to_string();
    assert!(
        error.starts_with("column transmit_ns has a value here"),
        "{error}"
    );
}

#[test]
fn one_stream_has_one_kind() {
    let mut writer = CsvWriter::new(Vec::new());
    writer.write(&samples::scan()).unwrap();
    let error = writer.write(&samples::pose()).unwrap_err();
    assert_eq!(crate::stream::exit::status(&error), 2);
}

#[test]
fn a_stream_without_records_has_a_header() {
    let mut writer = CsvWriter::new(Vec::new());
    writer.write_empty::<ImuSample>().unwrap();
    let text = String::from_utf8(writer.writer.into_inner().unwrap().inner).unwrap();
    assert!(text.starts_with("stamp_ns,received_ns,"));
    assert_eq!(read::<ImuSample>(&text), (Vec::new(), None));
    assert!(fault::<Segment>(&text).contains("these are imu records"));
}

#[test]
fn windows_line_ends() {
    let text = POINTS.replace('\n', "\r\n");
    assert_eq!(read::<TrajectoryPoint>(&text).0.len(), 1);
}

#[test]
fn a_last_row_without_a_line_feed_is_cut_off() {
    // Its last number would pass for a whole one.
    let (records, fault) = read::<TrajectoryPoint>(&format!("{POINTS}6,1,2,3,0,0,0,,,1.25"));
    assert_eq!(records.len(), 1);
    assert_eq!(
        fault.unwrap(),
        "f.csv:3: the row is cut off: no line feed ends it"
    );
    let (records, fault) = read::<TrajectoryPoint>(&format!("{POINTS}6,1,2,"));
    assert_eq!(records.len(), 1);
    assert_eq!(
        fault.unwrap(),
        "f.csv:3: 4 fields where the header has 10; the row is cut off: no line feed ends it"
    );
}
