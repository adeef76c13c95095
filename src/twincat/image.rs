//! The bytes of a pose, as they lie in the controller's variables; and a point out of such bytes.

use super::fields::{Field, Sample};
use super::layout::{Layout, LayoutError, Number, Scalar};
use crate::record::TrajectoryPoint;
use std::fmt::Write as _;

/// A variable as the controller has it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Variable {
    /// Its name.
    pub name: String,
    /// Its type's name; empty where it is not known.
    pub type_name: String,
    /// The scalars in it.
    pub layout: Layout,
}

/// A variable to write, and what to write to it: `MAIN.fYaw`, `MAIN.fYaw=yaw:deg`.
#[derive(Clone, Debug, PartialEq)]
pub struct Wanted {
    /// The variable's name.
    pub name: String,
    /// What is written, where it is said here.
    pub field: Option<Field>,
}

impl std::str::FromStr for Wanted {
    type Err = LayoutError;

    fn from_str(text: &str) -> Result<Wanted, LayoutError> {
        let (name, field) = match text.split_once('=') {
            Some((name, field)) => (name.trim(), Some(field.parse()?)),
            None => (text.trim(), None),
        };
        let control = |letter: char| letter.is_control() || letter.is_whitespace();
        if name.is_empty() || name.len() > 1024 || name.contains(control) {
            return Err(LayoutError(format!("{text:?} names no variable")));
        }
        Ok(Wanted {
            name: name.to_owned(),
            field,
        })
    }
}

/// What is written where a pose has no number. TwinCAT stops a PLC that calculates with NaN.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Missing {
    /// The last number that there was, 0 before the first.
    #[default]
    Hold,
    /// Another number, NaN for example.
    Fixed(f64),
}

/// A field at its place.
#[derive(Clone, Debug)]
struct Cell {
    field: Field,
    offset: usize,
    scalar: Scalar,
    /// The last number that there was.
    held: Number,
}

/// One variable's part of the image.
#[derive(Clone, Debug)]
struct Part {
    name: String,
    size: usize,
    cells: Vec<Cell>,
}

/// Where every field goes.
#[derive(Clone, Debug)]
pub struct Image {
    parts: Vec<Part>,
    missing: Missing,
    clipped: u64,
}

impl Image {
    /// Pairs variables with fields: several scalars with one field each, an array with fields in
    /// order, a structure with fields by their members' names (or in order). `fields` are those
    /// asked for; none are the usual ones.
    ///
    /// # Errors
    /// [`LayoutError`] with both sides where they do not fit.
    pub fn plan(
        wanted: &[Wanted],
        variables: &[Variable],
        fields: Option<&[Field]>,
        usual: &[Field],
        missing: Missing,
    ) -> Result<Image, LayoutError> {
        let parts = match (wanted, variables) {
            ([one], [variable]) if one.field.is_none() => {
                vec![whole(variable, fields, usual)?]
            }
            _ => singles(wanted, variables, fields)?,
        };
        Ok(Image {
            parts,
            missing,
            clipped: 0,
        })
    }

    /// The names and sizes, bytes, of the variables.
    pub fn parts(&self) -> impl Iterator<Item = (&str, usize)> {
        self.parts
            .iter()
            .map(|part| (part.name.as_str(), part.size))
    }

    /// Bytes of all variables together.
    pub fn size(&self) -> usize {
        self.parts.iter().map(|part| part.size).sum()
    }

    /// The fields, in their order.
    pub fn fields(&self) -> impl Iterator<Item = &Field> {
        let cells = self.parts.iter().flat_map(|part| &part.cells);
        cells.map(|cell| &cell.field)
    }

    /// Goes on where an older image of the same fields left off: its numbers are held on.
    pub fn follow(&mut self, older: &Image) {
        let cells = |image: &Image| {
            image
                .parts
                .iter()
                .map(|part| part.cells.len())
                .sum::<usize>()
        };
        if cells(self) == cells(older) {
            let held = older.parts.iter().flat_map(|part| &part.cells);
            let new = self.parts.iter_mut().flat_map(|part| &mut part.cells);
            for (new, old) in new.zip(held) {
                new.held = old.held;
            }
        }
        self.clipped = older.clipped;
    }

    /// How many numbers did not fit into their types.
    pub fn clipped(&self) -> u64 {
        self.clipped
    }

    /// Makes the bytes of all variables, one behind the other.
    pub fn fill(&mut self, sample: &Sample<'_>, out: &mut Vec<u8>) {
        out.clear();
        for part in &mut self.parts {
            let start = out.len();
            out.resize(start + part.size, 0);
            for cell in &mut part.cells {
                let mut number = cell.field.value(sample);
                if number.real().is_nan() {
                    number = match self.missing {
                        Missing::Hold => cell.held,
                        Missing::Fixed(fixed) => Number::Real(fixed),
                    };
                } else {
                    cell.held = number;
                }
                if let (true, Number::Whole(whole)) = (cell.field.wraps(), number) {
                    number = Number::Whole(wrapped(whole, cell.scalar));
                }
                let at = start + cell.offset;
                if let Some(place) = out.get_mut(at..at + cell.scalar.size()) {
                    self.clipped += u64::from(!cell.scalar.put(number, place));
                }
            }
        }
    }

    /// A point out of bytes; fields that are not there stay NaN. None where there are too few bytes.
    pub fn read(&self, bytes: &[u8]) -> Option<TrajectoryPoint> {
        let mut point = TrajectoryPoint::default();
        let mut start = 0;
        for part in &self.parts {
            for cell in &part.cells {
                let number = cell.scalar.get(bytes.get(start + cell.offset..)?)?;
                cell.field.assign(number, &mut point);
            }
            start += part.size;
        }
        Some(point)
    }

    /// What lies where, a line for each field: variable, offset, type, field and, of `bytes`, value.
    pub fn describe(&self, bytes: Option<&[u8]>) -> String {
        let mut text = String::new();
        let mut start = 0;
        for part in &self.parts {
            for cell in &part.cells {
                let Cell { field, scalar, .. } = cell;
                let name = scalar.name();
                let _ = write!(text, "{} + {:<4} {name:<6} {field}", part.name, cell.offset);
                let place = bytes.and_then(|bytes| bytes.get(start + cell.offset..));
                if let Some(number) = place.and_then(|place| scalar.get(place)) {
                    let _ = write!(text, " = {number}");
                }
                text.push('\n');
            }
            start += part.size;
        }
        text
    }
}

/// A number that runs on, within a type's range.
fn wrapped(number: i128, scalar: Scalar) -> i128 {
    let bits = match scalar {
        Scalar::I8 => 7,
        Scalar::U8 => 8,
        Scalar::I16 => 15,
        Scalar::U16 => 16,
        Scalar::I32 => 31,
        Scalar::U32 => 32,
        Scalar::Bool => 1,
        Scalar::I64 | Scalar::U64 | Scalar::F32 | Scalar::F64 => return number,
    };
    number & ((1 << bits) - 1)
}

fn cell(field: &Field, variable: &Variable, slot: usize) -> Option<Cell> {
    let slot = variable.layout.slots.get(slot)?;
    Some(Cell {
        field: field.clone(),
        offset: slot.offset,
        scalar: slot.scalar,
        held: Number::Whole(0),
    })
}

fn part(variable: &Variable, cells: Vec<Cell>) -> Part {
    Part {
        name: variable.name.clone(),
        size: variable.layout.size,
        cells,
    }
}

fn listed(fields: &[Field]) -> String {
    let texts: Vec<String> = fields.iter().map(Field::to_string).collect();
    texts.join(",")
}

/// What the controller has, for a message.
fn declared(variable: &Variable) -> String {
    let Variable {
        name,
        type_name,
        layout,
    } = variable;
    if type_name.is_empty() {
        format!("{name} is {layout}")
    } else {
        format!("{name} is {type_name}: {layout}")
    }
}

/// One variable that takes all fields.
fn whole(
    variable: &Variable,
    fields: Option<&[Field]>,
    usual: &[Field],
) -> Result<Part, LayoutError> {
    let slots = &variable.layout.slots;
    let named = slots.iter().all(|slot| !slot.name.is_empty());
    let by_member = fields.is_some_and(|fields| fields.iter().any(|f| f.member.is_some()));
    if named && (fields.is_none() || by_member) {
        return members(variable, fields);
    }
    if by_member {
        return Err(LayoutError(format!(
            "{}; it has no members to give fields to by name",
            declared(variable)
        )));
    }
    let fields = fields.unwrap_or(usual);
    if fields.len() != slots.len() {
        let array = Layout::of_scalars(Scalar::F64, fields.len());
        return Err(LayoutError(format!(
            "{}\nthe {} fields {} want {} scalars, such as ARRAY [0..{}] OF LREAL: {array}\nNothing \
             was written. Change --fields or the variable",
            declared(variable),
            fields.len(),
            listed(fields),
            fields.len(),
            fields.len().saturating_sub(1),
        )));
    }
    let cells = fields.iter().enumerate();
    let cells = cells.filter_map(|(slot, field)| cell(field, variable, slot));
    Ok(part(variable, cells.collect()))
}

/// A structure whose members are found by name.
fn members(variable: &Variable, fields: Option<&[Field]>) -> Result<Part, LayoutError> {
    let mut cells = Vec::new();
    let (mut without, mut used) = (Vec::new(), Vec::new());
    for (number, slot) in variable.layout.slots.iter().enumerate() {
        let found = match fields {
            Some(fields) => fields
                .iter()
                .find(|field| field.member_name().eq_ignore_ascii_case(&slot.name)),
            None => None,
        };
        let field = match (fields, found) {
            (Some(_), found) => found.cloned(),
            (None, _) => slot.name.to_ascii_lowercase().parse().ok(),
        };
        match field {
            Some(field) => {
                used.push(field.clone());
                cells.extend(cell(&field, variable, number));
            }
            None => without.push(slot.name.as_str()),
        }
    }
    if !without.is_empty() {
        return Err(LayoutError(format!(
            "{}\nno field for the members {}\nNothing was written: a structure is written as a \
             whole. Give --fields MEMBER=FIELD,.. for all of them (MEMBER=_ writes 0)",
            declared(variable),
            without.join(", ")
        )));
    }
    if let Some(unused) = fields.and_then(|fields| fields.iter().find(|f| !used.contains(f))) {
        let member = unused.member.clone().unwrap_or_else(|| unused.to_string());
        return Err(LayoutError(format!(
            "{}\nit has no member {member}",
            declared(variable)
        )));
    }
    Ok(part(variable, cells))
}

/// Several variables of one scalar each.
fn singles(
    wanted: &[Wanted],
    variables: &[Variable],
    fields: Option<&[Field]>,
) -> Result<Vec<Part>, LayoutError> {
    let by_name = wanted
        .iter()
        .filter(|wanted| wanted.field.is_some())
        .count();
    if by_name != 0 && (by_name != wanted.len() || fields.is_some()) {
        return Err(LayoutError(
            "either every variable says its field (NAME=FIELD), or --fields does".to_owned(),
        ));
    }
    let fields: Vec<&Field> = match fields {
        Some(fields) => fields.iter().collect(),
        None => wanted.iter().filter_map(|w| w.field.as_ref()).collect(),
    };
    if fields.len() != wanted.len() {
        return Err(LayoutError(format!(
            "{} variables and {} fields: say what goes where, NAME=FIELD for each or --fields",
            wanted.len(),
            fields.len()
        )));
    }
    let pairs = variables.iter().zip(fields);
    let parts = pairs.map(|(variable, field)| match variable.layout.slots.as_slice() {
        [_] => Ok(part(
            variable,
            cell(field, variable, 0).into_iter().collect(),
        )),
        _ => Err(LayoutError(format!(
            "{}\nthe field {field} wants one scalar. Nothing was written",
            declared(variable)
        ))),
    });
    parts.collect()
}

#[cfg(test)]
mod tests {
    use super::super::fields::{USUAL, parse_fields};
    use super::super::layout::Slot;
    use super::*;
    use crate::record::{Pose, Stamp, Status};

    fn variable(name: &str, layout: &str) -> Variable {
        Variable {
            name: name.into(),
            type_name: String::new(),
            layout: layout.parse().unwrap(),
        }
    }

    fn structure(members: &[(&str, usize, Scalar)], size: usize) -> Variable {
        let slots = members.iter().map(|(name, offset, scalar)| Slot {
            name: (*name).into(),
            offset: *offset,
            scalar: *scalar,
        });
        Variable {
            name: "MAIN.stPose".into(),
            type_name: "ST_Pose".into(),
            layout: Layout {
                size,
                slots: slots.collect(),
            },
        }
    }

    fn plan(
        wanted: &[&str],
        variables: &[Variable],
        fields: Option<&str>,
    ) -> Result<Image, LayoutError> {
        let wanted: Vec<Wanted> = wanted.iter().map(|w| w.parse().unwrap()).collect();
        let fields = fields.map(|fields| parse_fields(fields).unwrap());
        let usual = parse_fields(USUAL).unwrap();
        Image::plan(&wanted, variables, fields.as_deref(), &usual, Missing::Hold)
    }

    fn pose() -> Pose {
        Pose {
            stamp: Stamp::from_ns(1_700_000_000_500_000_000),
            seq: 70_000,
            position_m: [0.5, -3.0, 1.5],
            rotation_rad: [0.01, 0.02, 0.03],
            status: Status::NO_IMU,
            ..Pose::default()
        }
    }

    fn sample(pose: &Pose, counter: u64) -> Sample<'_> {
        Sample {
            pose,
            bits: 0,
            counter,
            now: pose.stamp,
        }
    }

    #[test]
    fn the_published_array() {
        let mut image = plan(
            &["MAIN.SickValue"],
            &[variable("MAIN.SickValue", "9*LREAL")],
            None,
        )
        .unwrap();
        let mut out = Vec::new();
        image.fill(&sample(&pose(), 3), &mut out);
        let numbers = [
            0.5,
            -3.0,
            1.5,
            0.01,
            0.02,
            0.03,
            1_700_000_000.5,
            256.0,
            3.0,
        ];
        let expected: Vec<u8> = numbers.iter().flat_map(|n: &f64| n.to_le_bytes()).collect();
        assert_eq!(out, expected);
        let text = image.describe(Some(&out));
        assert!(
            text.contains("MAIN.SickValue + 48   LREAL  stamp = 1700000000.5\n"),
            "{text}"
        );
    }

    #[test]
    fn a_structure_with_gaps() {
        let st = structure(
            &[
                ("fX", 0, Scalar::F32),
                ("nSeq", 4, Scalar::U16),
                ("bOk", 6, Scalar::Bool),
                ("tStamp", 8, Scalar::I64),
            ],
            16,
        );
        let st = std::slice::from_ref(&st);
        let fields = "fX=x:mm,nSeq=sequence,bOk=valid,tStamp=stamp:filetime";
        let mut image = plan(&["MAIN.stPose"], st, Some(fields)).unwrap();
        let mut out = Vec::new();
        image.fill(&sample(&pose(), 3), &mut out);
        let mut expected = 500f32.to_le_bytes().to_vec();
        // 70 000 wraps to 4464.
        expected.extend_from_slice(&4464u16.to_le_bytes());
        expected.extend_from_slice(&[1, 0]);
        expected.extend_from_slice(&133_444_736_005_000_000i64.to_le_bytes());
        assert_eq!(out, expected);
        assert_eq!(image.clipped(), 0);
        let error = plan(&["MAIN.stPose"], st, Some("fX=x,nSeq=sequence,bOk=valid")).unwrap_err();
        assert!(
            error
                .to_string()
                .contains("no field for the members tStamp"),
            "{error}"
        );
        let error = plan(&["MAIN.stPose"], st, Some(&format!("{fields},q=y"))).unwrap_err();
        assert!(error.to_string().contains("no member q"), "{error}");
        // Without names the order counts.
        assert!(plan(&["MAIN.stPose"], st, Some("x,sequence,valid,stamp:ns")).is_ok());
        assert!(plan(&["MAIN.stPose"], st, None).is_err());
        let own = structure(&[("X", 0, Scalar::F64), ("status", 8, Scalar::U32)], 16);
        assert!(plan(&["MAIN.stPose"], &[own], None).is_ok());
    }

    #[test]
    fn one_variable_a_field() {
        let variables = [variable("MAIN.fX", "LREAL"), variable("MAIN.n", "UDINT")];
        let mut image = plan(&["MAIN.fX=x:mm", "MAIN.n=status"], &variables, None).unwrap();
        let mut out = Vec::new();
        image.fill(&sample(&pose(), 3), &mut out);
        assert_eq!(
            out,
            [&500f64.to_le_bytes()[..], &256u32.to_le_bytes()].concat()
        );
        assert_eq!(
            image.parts().collect::<Vec<_>>(),
            [("MAIN.fX", 8), ("MAIN.n", 4)]
        );
        assert!(plan(&["MAIN.fX", "MAIN.n"], &variables, Some("x,status")).is_ok());
        assert!(plan(&["MAIN.fX", "MAIN.n"], &variables, Some("x")).is_err());
        assert!(plan(&["MAIN.fX=x", "MAIN.n"], &variables, None).is_err());
        assert!(plan(&["MAIN.fX", "MAIN.n"], &variables, None).is_err());
        assert!(plan(&["MAIN.a=x"], &[variable("MAIN.a", "2*LREAL")], None).is_err());
    }

    #[test]
    fn a_mismatch_shows_both_layouts() {
        let error = plan(
            &["MAIN.SickValue"],
            &[variable("MAIN.SickValue", "7*LREAL")],
            None,
        )
        .unwrap_err();
        let text = error.to_string();
        assert!(text.contains("7 LREAL (56 bytes)"), "{text}");
        assert!(text.contains("9 LREAL (72 bytes)"), "{text}");
    }

    #[test]
    fn what_is_missing_is_held() {
        let one = [variable("MAIN.x", "LREAL")];
        let mut image = plan(&["MAIN.x=x"], &one, None).unwrap();
        let mut out = Vec::new();
        let unsolved = Pose::default();
        for (pose, expected) in [(&unsolved, 0.0), (&pose(), 0.5), (&unsolved, 0.5)] {
            image.fill(&sample(pose, 1), &mut out);
            assert_eq!(out, f64::to_le_bytes(expected));
        }
        image.missing = Missing::Fixed(-1.0);
        image.fill(&sample(&unsolved, 1), &mut out);
        assert_eq!(out, (-1f64).to_le_bytes());
    }

    #[test]
    fn numbers_that_do_not_fit_are_counted() {
        let mut image = plan(&["MAIN.y=y:um"], &[variable("MAIN.y", "INT")], None).unwrap();
        let mut out = Vec::new();
        image.fill(&sample(&pose(), 1), &mut out);
        assert_eq!(out, i16::MIN.to_le_bytes());
        assert_eq!(image.clipped(), 1);
    }

    #[test]
    fn a_point_is_read_back() {
        let fields = "x,y:mm,yaw:deg,vx,stamp:ns";
        let st = [variable("GVL.stDesired", "4*LREAL,LINT")];
        let image = plan(&["GVL.stDesired"], &st, Some(fields)).unwrap();
        let mut bytes = Vec::new();
        for number in [1.0, 2000.0, 180.0, 0.75f64] {
            bytes.extend_from_slice(&number.to_le_bytes());
        }
        bytes.extend_from_slice(&123i64.to_le_bytes());
        let point = image.read(&bytes).unwrap();
        assert_eq!(point.position_m[..2], [1.0, 2.0]);
        assert!((point.rotation_rad[2] - std::f64::consts::PI).abs() < 1e-15);
        assert_eq!((point.velocity_m_s[0], point.stamp.ns()), (0.75, 123));
        assert!(point.position_m[2].is_nan());
        assert!(image.read(&bytes[..39]).is_none());
    }
}
