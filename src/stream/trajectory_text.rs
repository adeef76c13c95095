//! Two text formats in which other people keep trajectories: TUM and EuRoC.
//!
//! TUM (the RGB-D benchmark): `stamp x y z qx qy qz qw`, separated by blanks; the stamp is in
//! seconds, with a fraction. EuRoC (the MAV dataset's ground truth): comma separated, a header that
//! starts with `#timestamp`, the stamp in nanoseconds, `x, y, z, qw, qx, qy, qz` and, in its longer
//! form, the velocity. Both hold poses without covariance or status; lines that start with `#` are
//! remarks. Metres; the quaternion turns platform into robot coordinates.
//!
//! Reading makes rows of our own CSV of them, line by line, so that everything that holds for CSV
//! holds for them: the flush rule, faults that name the line, `--skip-bad`.

use super::exit::{self, Fault};
use crate::record::{POSE_COLUMNS, Presence, Record, VELOCITY_COLUMNS, Value, Visit, text};
use nalgebra::{Quaternion, UnitQuaternion};
use std::io::{self, BufRead, BufReader, Read, Write};

/// Which of the two.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Layout {
    /// Blanks between the fields, seconds, the quaternion's scalar last.
    Tum,
    /// Commas, nanoseconds, the scalar first.
    Euroc,
}

impl Layout {
    /// What a line has to have, for messages.
    pub(super) fn line(self) -> &'static str {
        match self {
            Layout::Tum => "a line of TUM has 8 (stamp x y z qx qy qz qw)",
            Layout::Euroc => {
                "a line of EuRoC has 8 (stamp x y z qw qx qy qz), or 11 and more with the velocity"
            }
        }
    }
}

/// Fields of a pose: stamp, position, quaternion.
const FIELDS: usize = 8;
/// EuRoC's longer form goes on with the velocity.
const WITH_VELOCITY: usize = 11;

/// The layout of a text, told by its first lines; none for our own CSV and anything else.
pub(super) fn sniff(head: &[u8]) -> Option<Layout> {
    let mut lines = head.split_inclusive(|b| *b == b'\n');
    let first = lines.next()?;
    if let Some(remark) = first.strip_prefix(b"#")
        && remark.trim_ascii_start().starts_with(b"timestamp")
        && remark.contains(&b',')
    {
        return Some(Layout::Euroc);
    }
    // The first line that is no remark; one that has not come whole tells nothing.
    let data = std::iter::once(first)
        .chain(lines)
        .find(|line| !is_remark(line))?;
    let number = |field: &[u8]| text::parse_f64(field).is_some();
    let fields = |separator: fn(&u8) -> bool| {
        let fields = data.trim_ascii().split(separator);
        let mut count = 0;
        let numbers = fields
            .map(<[u8]>::trim_ascii)
            .filter(|field| !field.is_empty())
            .inspect(|_| count += 1)
            .all(number);
        if numbers { count } else { 0 }
    };
    if !data.ends_with(b"\n") {
        None
    } else if fields(|b| b.is_ascii_whitespace()) == FIELDS {
        Some(Layout::Tum)
    } else if fields(|b| *b == b',') >= FIELDS {
        Some(Layout::Euroc)
    } else {
        None
    }
}

fn is_remark(line: &[u8]) -> bool {
    let line = line.trim_ascii();
    line.is_empty() || line.starts_with(b"#")
}

/// Our CSV's text of a file in one of the two layouts. A header line is put in front; every other
/// line stands for the line of the file above it.
pub(super) struct AsCsv<R> {
    input: BufReader<R>,
    layout: Layout,
    line: Vec<u8>,
    row: Vec<u8>,
    /// How much of `row` has been given out.
    given: usize,
}

const HEADER: &[u8] = b"stamp_ns,x_m,y_m,z_m,roll_rad,pitch_rad,yaw_rad,vx_m_s,vy_m_s,vz_m_s\n";

impl<R: Read> AsCsv<R> {
    pub(super) fn new(input: R, layout: Layout) -> AsCsv<R> {
        AsCsv {
            input: BufReader::new(input),
            layout,
            line: Vec::new(),
            row: HEADER.to_vec(),
            given: 0,
        }
    }
}

impl<R: Read> Read for AsCsv<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if self.given == self.row.len() {
            self.line.clear();
            self.row.clear();
            self.given = 0;
            if self.input.read_until(b'\n', &mut self.line)? == 0 {
                return Ok(0);
            }
            push_row(&self.line, self.layout, &mut self.row);
        }
        let length = buffer.len().min(self.row.len() - self.given);
        buffer[..length].copy_from_slice(&self.row[self.given..self.given + length]);
        self.given += length;
        Ok(length)
    }
}

/// The CSV row of a line. What is not a number goes through as it is, for the CSV reader to name.
fn push_row(line: &[u8], layout: Layout, out: &mut Vec<u8>) {
    // A last line without line feed stays one: it may have been cut off.
    let end = &line[line.len() - usize::from(line.ends_with(b"\n"))..];
    if is_remark(line) {
        out.push(b'#');
        out.extend_from_slice(end);
        return;
    }
    let line = line.trim_ascii();
    let mut fields: Vec<&[u8]> = match layout {
        Layout::Tum => line
            .split(u8::is_ascii_whitespace)
            .filter(|field| !field.is_empty())
            .collect(),
        Layout::Euroc => line.split(|b| *b == b',').map(<[u8]>::trim_ascii).collect(),
    };
    let wanted = match layout {
        Layout::Tum => fields.len() == FIELDS,
        Layout::Euroc => fields.len() == FIELDS || fields.len() >= WITH_VELOCITY,
    };
    if !wanted {
        // A row of one field, the number of them, is how the CSV reader knows such a line.
        text::push_int(out, fields.len());
        out.extend_from_slice(end);
        return;
    }
    let stamp = match layout {
        Layout::Tum => seconds_to_ns(fields[0]),
        Layout::Euroc => std::str::from_utf8(fields[0])
            .ok()
            .and_then(|t| t.parse().ok()),
    };
    match stamp {
        Some(ns) => text::push_int(out, ns),
        None => push_field(out, fields[0]),
    }
    for field in &fields[1..4] {
        out.push(b',');
        push_field(out, field);
    }
    if layout == Layout::Euroc {
        // The scalar goes last, as in the other layout.
        fields[4..8].rotate_left(1);
    }
    push_angles(&fields[4..8], out);
    for k in FIELDS..WITH_VELOCITY {
        out.push(b',');
        push_field(out, fields.get(k).copied().unwrap_or_default());
    }
    out.extend_from_slice(end);
}

/// Roll, pitch and yaw of a quaternion x, y, z, w, each behind a comma.
fn push_angles(fields: &[&[u8]], out: &mut Vec<u8>) {
    let mut parts = [0.0; 4];
    for (part, field) in parts.iter_mut().zip(fields) {
        match text::parse_f64(field).filter(|v| v.is_finite()) {
            Some(value) => *part = value,
            None => {
                out.push(b',');
                push_field(out, if field.is_empty() { b"?" } else { field });
                return out.extend_from_slice(b",,");
            }
        }
    }
    let [x, y, z, w] = parts;
    let quaternion = Quaternion::new(w, x, y, z);
    if !(quaternion.norm() > 1e-6) {
        return out.extend_from_slice(b",quaternion of length 0,,");
    }
    let (roll, pitch, yaw) = UnitQuaternion::from_quaternion(quaternion).euler_angles();
    for angle in [roll, pitch, yaw] {
        out.push(b',');
        text::push_f64(out, angle);
    }
}

/// A field that means nothing to the CSV around it.
fn push_field(out: &mut Vec<u8>, field: &[u8]) {
    out.extend(field.iter().map(|b| match b {
        b'"' | b',' | b'\r' => b'?',
        other => *other,
    }));
}

/// Seconds with a fraction as whole nanoseconds, exactly where nine decimals suffice: a double
/// holds seconds since 1970 to 0.2 us only.
fn seconds_to_ns(text: &[u8]) -> Option<i64> {
    let text = std::str::from_utf8(text).ok()?;
    let (sign, digits) = match text.strip_prefix('-') {
        Some(digits) => (-1, digits),
        None => (1, text.strip_prefix('+').unwrap_or(text)),
    };
    let (mantissa, exponent) = match digits.split_once(['e', 'E']) {
        Some((mantissa, exponent)) => (mantissa, exponent.parse::<i32>().ok()?),
        None => (digits, 0),
    };
    let (whole, fraction) = mantissa.split_once('.').unwrap_or((mantissa, ""));
    let all = || whole.bytes().chain(fraction.bytes());
    if whole.is_empty() && fraction.is_empty() || !all().all(|b| b.is_ascii_digit()) {
        return None;
    }
    // Digits before the decimal point once the number counts nanoseconds.
    let before = i64::try_from(whole.len()).ok()? + i64::from(exponent) + 9;
    let mut ns: i64 = 0;
    let mut digits = all();
    for _ in 0..before.min(64) {
        let digit = i64::from(digits.next().map_or(0, |b| b - b'0'));
        ns = ns.checked_mul(10)?.checked_add(digit)?;
    }
    let rounds_up = before >= 0 && digits.next().is_some_and(|b| b >= b'5');
    Some(sign * ns.checked_add(i64::from(rounds_up))?)
}

/// Nanoseconds as seconds with nine decimals.
fn push_seconds(out: &mut Vec<u8>, ns: i64) {
    if ns < 0 {
        out.push(b'-');
    }
    let ns = ns.unsigned_abs();
    text::push_int(out, ns / 1_000_000_000);
    out.extend_from_slice(format!(".{:09}", ns % 1_000_000_000).as_bytes());
}

/// Writes poses or trajectory points in one of the two layouts.
pub(super) struct TextWriter<W: Write> {
    output: io::BufWriter<W>,
    layout: Layout,
    begun: bool,
    /// Records that have no pose, or only a part of one.
    left_out: u64,
    line: Vec<u8>,
}

impl<W: Write> TextWriter<W> {
    pub(super) fn new(output: W, layout: Layout) -> TextWriter<W> {
        TextWriter {
            output: io::BufWriter::with_capacity(1 << 16, output),
            layout,
            begun: false,
            left_out: 0,
            line: Vec::new(),
        }
    }

    /// Writes a record; one whose pose is not whole is left out and counted.
    pub(super) fn write<R: Record>(&mut self, record: &R) -> anyhow::Result<()> {
        self.begin::<R>()?;
        let mut columns = PoseColumns::default();
        let Ok(()) = record.visit(&mut columns);
        let [x, y, z, roll, pitch, yaw] = columns.pose;
        if columns.pose.iter().any(|v| !v.is_finite()) {
            self.left_out += 1;
            return Ok(());
        }
        let q = UnitQuaternion::from_euler_angles(roll, pitch, yaw);
        let line = &mut self.line;
        line.clear();
        let (separator, turn) = match self.layout {
            Layout::Tum => {
                push_seconds(line, record.stamp().ns());
                (b' ', [q.i, q.j, q.k, q.w])
            }
            Layout::Euroc => {
                text::push_int(line, record.stamp().ns());
                (b',', [q.w, q.i, q.j, q.k])
            }
        };
        let velocity: &[f64] = match self.layout {
            Layout::Euroc if columns.has_velocity => &columns.velocity,
            _ => &[],
        };
        for value in [x, y, z].iter().chain(&turn).chain(velocity) {
            line.push(separator);
            text::push_f64(line, *value);
        }
        line.push(b'\n');
        self.output.write_all(line)?;
        Ok(())
    }

    /// Writes what stands above the first record, if it is not there yet.
    pub(super) fn begin<R: Record>(&mut self) -> anyhow::Result<()> {
        if self.begun {
            return Ok(());
        }
        let kind = R::KIND;
        if kind != "pose" && kind != "trajectory" {
            let why =
                format!("TUM and EuRoC files hold poses and trajectories, not {kind} records");
            return Err(Fault::Usage(why).into());
        }
        self.begun = true;
        self.output.write_all(match (self.layout, kind) {
            (Layout::Tum, _) => b"# timestamp tx ty tz qx qy qz qw\n",
            (Layout::Euroc, "pose") => {
                b"#timestamp [ns],p_x [m],p_y [m],p_z [m],q_w [],q_x [],q_y [],q_z []\n"
            }
            (Layout::Euroc, _) => {
                b"#timestamp [ns],p_x [m],p_y [m],p_z [m],q_w [],q_x [],q_y [],q_z [],\
                  v_x [m s^-1],v_y [m s^-1],v_z [m s^-1]\n"
            }
        })?;
        Ok(())
    }

    pub(super) fn flush(&mut self) -> io::Result<()> {
        self.output.flush()
    }

    /// Ends the text, and says what is not in it.
    pub(super) fn finish(&mut self, tool: &str, name: &str) -> io::Result<()> {
        self.output.flush()?;
        if self.left_out > 0 {
            let n = self.left_out;
            let s = if n == 1 { "" } else { "s" };
            eprintln!("{tool}: {name}: {n} record{s} without a whole pose left out");
            exit::note_lost();
            self.left_out = 0;
        }
        Ok(())
    }
}

/// The pose and velocity columns of a record.
struct PoseColumns {
    pose: [f64; 6],
    velocity: [f64; 3],
    has_velocity: bool,
    text: Vec<u8>,
}

impl Default for PoseColumns {
    fn default() -> Self {
        PoseColumns {
            pose: [f64::NAN; 6],
            velocity: [0.0; 3],
            has_velocity: false,
            text: Vec::new(),
        }
    }
}

impl Visit for PoseColumns {
    type Error = std::convert::Infallible;

    fn column<T: Value>(
        &mut self,
        name: &'static str,
        _: Presence,
        value: &T,
    ) -> Result<(), Self::Error> {
        let at = |columns: &[&str]| columns.iter().position(|column| *column == name);
        let place = if let Some(k) = at(&POSE_COLUMNS) {
            &mut self.pose[k]
        } else if let Some(k) = at(&VELOCITY_COLUMNS) {
            self.has_velocity = true;
            &mut self.velocity[k]
        } else {
            return Ok(());
        };
        self.text.clear();
        value.push_text(&mut self.text);
        // An empty field is a value that is missing.
        *place = text::parse_f64(&self.text).unwrap_or(f64::NAN);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::{Stamp, TrajectoryPoint};
    use proptest::prelude::*;

    fn as_csv(text: &str, layout: Layout) -> String {
        let mut out = String::new();
        let mut reader = AsCsv::new(text.as_bytes(), layout);
        reader.read_to_string(&mut out).unwrap();
        out.strip_prefix(std::str::from_utf8(HEADER).unwrap())
            .unwrap()
            .to_owned()
    }

    #[test]
    fn seconds_are_exact() {
        for (text, ns) in [
            ("1700000000.002", 1_700_000_000_002_000_000),
            ("1403636579.763555527", 1_403_636_579_763_555_527),
            ("1.700000000002000093e+09", 1_700_000_000_002_000_093),
            ("0.0000000005", 1),
            ("0.0000000004", 0),
            ("-1.5", -1_500_000_000),
            ("+2", 2_000_000_000),
            (".25", 250_000_000),
            ("5e-9", 5),
            ("5e-30", 0),
        ] {
            assert_eq!(seconds_to_ns(text.as_bytes()), Some(ns), "{text}");
        }
        for text in ["", ".", "x", "1.2.3", "1e", "nan", "1e300", "--1"] {
            assert_eq!(seconds_to_ns(text.as_bytes()), None, "{text}");
        }
    }

    #[test]
    fn tells_the_layouts_apart() {
        assert_eq!(sniff(b"# a remark\n1.5 1 2 3 0 0 0 1\n"), Some(Layout::Tum));
        assert_eq!(sniff(b"1.5 1 2 3 0 0 0 1"), None);
        let header = b"#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m]\n";
        assert_eq!(sniff(header), Some(Layout::Euroc));
        assert_eq!(sniff(b"15,1,2,3,1,0,0,0\n"), Some(Layout::Euroc));
        assert_eq!(sniff(b"stamp_ns,x_m,y_m\n1,2,3\n"), None);
        assert_eq!(sniff(b"1 2 3 4\n"), None);
        assert_eq!(sniff(b""), None);
    }

    #[test]
    fn a_quarter_turn_about_each_axis() {
        let half = std::f64::consts::FRAC_PI_4;
        let (s, c) = half.sin_cos();
        for (k, turn) in [(0, [s, 0.0, 0.0]), (2, [0.0, 0.0, s])] {
            let [x, y, z] = turn;
            let tum = as_csv(&format!("2 1 2 3 {x} {y} {z} {c}\n"), Layout::Tum);
            let euroc = as_csv(
                &format!("2000000000,1,2,3,{c},{x},{y},{z}\n"),
                Layout::Euroc,
            );
            assert_eq!(tum, euroc);
            let fields: Vec<f64> = tum
                .trim_end()
                .split(',')
                .take(7)
                .map(|f| f.parse().unwrap())
                .collect();
            assert_eq!(fields[..4], [2e9, 1.0, 2.0, 3.0]);
            for (j, angle) in fields[4..].iter().enumerate() {
                let expected = if j == k { 2.0 * half } else { 0.0 };
                assert!((angle - expected).abs() < 1e-12, "{k} {j} {angle}");
            }
        }
    }

    #[test]
    fn faults_keep_their_line_and_words() {
        assert_eq!(as_csv("# x\n\n1 2 3\n", Layout::Tum), "#\n#\n3\n");
        let row = as_csv("1 2 3 4 a 0 0 1\n", Layout::Tum);
        assert_eq!(row, "1000000000,2,3,4,a,,,,,\n");
        let row = as_csv("1 2 3 4 0 0 0 0\n", Layout::Tum);
        assert!(row.contains("quaternion of length 0"), "{row}");
        assert_eq!(as_csv("x 2 3 4 0 0 0 1", Layout::Tum), "x,2,3,4,0,-0,0,,,");
    }

    #[test]
    fn only_poses_and_trajectories() {
        let mut writer = TextWriter::new(Vec::new(), Layout::Tum);
        let error = writer.write(&crate::record::Scan::default()).unwrap_err();
        assert_eq!(exit::status(&error), 2);
    }

    proptest! {
        #[test]
        fn what_is_written_reads_back(
            ns in 0i64..4_000_000_000_000_000_000,
            position in prop::array::uniform3(-10.0f64..10.0),
            roll in -3.0f64..3.0, pitch in -1.5f64..1.5, yaw in -3.0f64..3.0,
            euroc: bool,
        ) {
            let layout = if euroc { Layout::Euroc } else { Layout::Tum };
            let point = TrajectoryPoint {
                stamp: Stamp::from_ns(ns),
                position_m: position,
                rotation_rad: [roll, pitch, yaw],
                velocity_m_s: [0.25, -1.0, 3.0],
            };
            let mut text = Vec::new();
            let mut writer = TextWriter::new(&mut text, layout);
            writer.write(&point).unwrap();
            writer.flush().unwrap();
            drop(writer);
            prop_assert_eq!(sniff(&text), Some(layout));
            let csv = as_csv(std::str::from_utf8(&text).unwrap(), layout);
            let row = csv.lines().nth(1).unwrap();
            let fields: Vec<&str> = row.split(',').collect();
            prop_assert_eq!(fields[0], ns.to_string());
            let pose = position.into_iter().chain([roll, pitch, yaw]);
            for (field, value) in fields[1..7].iter().zip(pose) {
                let back: f64 = field.parse().unwrap();
                prop_assert!((back - value).abs() < 1e-9, "{} {}", back, value);
            }
            prop_assert_eq!(&fields[7..], if euroc { ["0.25", "-1", "3"] } else { ["", "", ""] });
        }

        #[test]
        fn any_bytes_are_taken(bytes: Vec<u8>, euroc: bool) {
            let layout = if euroc { Layout::Euroc } else { Layout::Tum };
            sniff(&bytes);
            let mut out = Vec::new();
            AsCsv::new(&bytes[..], layout).read_to_end(&mut out).unwrap();
        }
    }
}
