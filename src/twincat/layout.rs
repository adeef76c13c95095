//! Which scalar lies where in a variable.

use super::symbols::{DataType, Symbol};
use std::fmt;
use std::str::FromStr;

/// The most scalars of one variable.
const MOST_SLOTS: usize = 4096;
/// How deep structures may lie in each other.
const MOST_DEPTH: u32 = 8;

/// A number, exact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Number {
    /// A whole one.
    Whole(i128),
    /// Any other.
    Real(f64),
}

impl Number {
    /// As a floating point number.
    pub fn real(self) -> f64 {
        match self {
            Number::Whole(whole) => whole as f64,
            Number::Real(real) => real,
        }
    }

    /// As the nearest whole number; none for NaN.
    pub fn whole(self) -> Option<i128> {
        match self {
            Number::Whole(whole) => Some(whole),
            Number::Real(real) if real.is_nan() => None,
            Number::Real(real) => Some(real.round() as i128),
        }
    }
}

impl fmt::Display for Number {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Number::Whole(whole) => write!(f, "{whole}"),
            Number::Real(real) => write!(f, "{real}"),
        }
    }
}

macro_rules! scalars {
    ($($name:ident $rust:ty, $base:literal, $text:literal $(| $alias:literal)*;)*) => {
        /// A scalar of the PLC.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum Scalar {
            $(#[doc = concat!("`", $text, "`")] $name,)*
        }

        impl Scalar {
            /// Bytes.
            pub fn size(self) -> usize {
                match self {
                    $(Scalar::$name => size_of::<$rust>(),)*
                }
            }

            /// The PLC's name for it.
            pub fn name(self) -> &'static str {
                match self {
                    $(Scalar::$name => $text,)*
                }
            }

            /// The scalar of a type number (`ADST_..`).
            pub fn from_base(base: u32) -> Option<Scalar> {
                match base {
                    $($base => Some(Scalar::$name),)*
                    _ => None,
                }
            }

            /// Its type number.
            pub fn base(self) -> u32 {
                match self {
                    $(Scalar::$name => $base,)*
                }
            }

            fn named(name: &str) -> Option<Scalar> {
                match name {
                    $($text $(| $alias)* => Some(Scalar::$name),)*
                    _ => None,
                }
            }
        }
    };
}

scalars! {
    Bool u8, 33, "BOOL";
    I8 i8, 16, "SINT";
    U8 u8, 17, "USINT" | "BYTE";
    I16 i16, 2, "INT";
    U16 u16, 18, "UINT" | "WORD";
    I32 i32, 3, "DINT";
    U32 u32, 19, "UDINT" | "DWORD" | "TIME";
    I64 i64, 20, "LINT";
    U64 u64, 21, "ULINT" | "LWORD" | "LTIME";
    F32 f32, 4, "REAL";
    F64 f64, 5, "LREAL";
}

impl Scalar {
    /// Puts a number into `place`, which has the scalar's size. Whole types take the nearest number
    /// and the nearest end of their range; whether the number was within it.
    pub fn put(self, number: Number, place: &mut [u8]) -> bool {
        let real = number.real();
        let (bits, fits) = match self {
            Scalar::F64 => (real.to_bits(), true),
            Scalar::F32 => {
                let single = real as f32;
                let fits = single.is_finite() || !real.is_finite();
                (u64::from(single.to_bits()), fits)
            }
            Scalar::Bool => (u64::from(real != 0.0), true),
            _ => {
                let (lowest, highest) = self.range();
                let whole = number.whole();
                let clipped = whole.unwrap_or(0).clamp(lowest, highest);
                // The low bytes of two's complement are the same in every width.
                (clipped as u64, whole == Some(clipped))
            }
        };
        for (to, from) in place.iter_mut().zip(bits.to_le_bytes()) {
            *to = from;
        }
        fits
    }

    /// Reads a number from the front of `place`; none where there is too little.
    pub fn get(self, place: &[u8]) -> Option<Number> {
        let place = place.get(..self.size())?;
        let mut bytes = [0; 8];
        for (to, from) in bytes.iter_mut().zip(place) {
            *to = *from;
        }
        let raw = u64::from_le_bytes(bytes);
        Some(match self {
            Scalar::F64 => Number::Real(f64::from_bits(raw)),
            Scalar::F32 => Number::Real(f64::from(f32::from_bits(raw as u32))),
            Scalar::Bool => Number::Whole(i128::from(raw != 0)),
            Scalar::I8 => Number::Whole((raw as u8 as i8).into()),
            Scalar::I16 => Number::Whole((raw as u16 as i16).into()),
            Scalar::I32 => Number::Whole((raw as u32 as i32).into()),
            Scalar::I64 => Number::Whole((raw as i64).into()),
            Scalar::U8 | Scalar::U16 | Scalar::U32 | Scalar::U64 => Number::Whole(raw.into()),
        })
    }

    /// The lowest and the highest whole number.
    fn range(self) -> (i128, i128) {
        let bits = 8 * self.size() as u32;
        match self {
            Scalar::I8 | Scalar::I16 | Scalar::I32 | Scalar::I64 => {
                (-(1 << (bits - 1)), (1 << (bits - 1)) - 1)
            }
            _ => (0, (1 << bits) - 1),
        }
    }
}

impl FromStr for Scalar {
    type Err = LayoutError;

    fn from_str(text: &str) -> Result<Scalar, LayoutError> {
        Scalar::named(&text.to_ascii_uppercase())
            .ok_or_else(|| LayoutError(format!("{text:?} is no scalar such as LREAL or UDINT")))
    }
}

/// A scalar at its place.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Slot {
    /// The member's name, with those above it; empty in an array or a scalar.
    pub name: String,
    /// Bytes from the variable's start.
    pub offset: usize,
    /// What lies there.
    pub scalar: Scalar,
}

/// The scalars of a variable.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Layout {
    /// Bytes of the whole variable.
    pub size: usize,
    /// In order of their places.
    pub slots: Vec<Slot>,
}

/// A variable that cannot be laid out, or not as asked.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct LayoutError(pub String);

impl Layout {
    /// One scalar after the other.
    pub fn of_scalars(scalar: Scalar, count: usize) -> Layout {
        let slot = |number| Slot {
            name: String::new(),
            offset: number * scalar.size(),
            scalar,
        };
        Layout {
            size: count * scalar.size(),
            slots: (0..count).map(slot).collect(),
        }
    }

    /// The layout of a variable; `look_up` gives the data type of a name.
    ///
    /// # Errors
    /// [`LayoutError`] in `look_up`'s error type where something in it is no scalar.
    pub fn of_symbol<E: From<LayoutError>>(
        symbol: &Symbol,
        mut look_up: impl FnMut(&str) -> Result<DataType, E>,
    ) -> Result<Layout, E> {
        let mut layout = Layout {
            size: symbol.size as usize,
            slots: Vec::new(),
        };
        let whole = DataType {
            type_name: symbol.type_name.clone(),
            size: symbol.size,
            base: symbol.base,
            ..DataType::default()
        };
        layout.add(&whole, "", 0, 0, &mut look_up)?;
        Ok(layout)
    }

    fn add<E: From<LayoutError>>(
        &mut self,
        part: &DataType,
        name: &str,
        offset: usize,
        depth: u32,
        look_up: &mut impl FnMut(&str) -> Result<DataType, E>,
    ) -> Result<(), E> {
        let wrong = |why: &str| {
            let name = if name.is_empty() { "it" } else { name };
            E::from(LayoutError(format!("{name} is {}: {why}", part.type_name)))
        };
        let size = part.size as usize;
        if offset.saturating_add(size) > self.size || depth > MOST_DEPTH {
            return Err(wrong("its place cannot be"));
        }
        // They are numbers to the controller, and an address made of a pose would end its program.
        if points_elsewhere(&part.type_name) {
            return Err(wrong("pointers and references are not written"));
        }
        // Its size and its place are counted in bits, and its neighbours share its byte.
        if part.type_name.eq_ignore_ascii_case("BIT") {
            return Err(wrong("single bits are not written; BOOL is"));
        }
        if let Some(scalar) = Scalar::from_base(part.base) {
            let count = size / scalar.size();
            let whole = count > 0 && count * scalar.size() == size;
            if !whole || self.slots.len() + count > MOST_SLOTS {
                return Err(wrong("its size cannot be"));
            }
            let first = part.dimensions.first().map_or(0, |dimension| dimension.0);
            for number in 0..count {
                let several = count > 1 && !name.is_empty();
                let index = i64::from(first) + number as i64;
                self.slots.push(Slot {
                    name: if several {
                        format!("{name}[{index}]")
                    } else {
                        name.to_owned()
                    },
                    offset: offset + number * scalar.size(),
                    scalar,
                });
            }
            return Ok(());
        }
        let found = look_up(&part.type_name)?;
        if found.members.is_empty() || found.size as usize != size {
            return Err(wrong(
                "only scalars, arrays of them and structures are written",
            ));
        }
        for member in &found.members {
            let path = if name.is_empty() {
                member.name.clone()
            } else {
                format!("{name}.{}", member.name)
            };
            let at = offset.saturating_add(member.offset as usize);
            self.add(member, &path, at, depth + 1, look_up)?;
        }
        Ok(())
    }
}

/// Whether a type, or what an array of it is made of, holds an address.
fn points_elsewhere(type_name: &str) -> bool {
    let upper = type_name.to_ascii_uppercase();
    let element = upper.rsplit("] OF ").next().unwrap_or_default().trim();
    ["POINTER TO", "REFERENCE TO", "PVOID"]
        .iter()
        .any(|start| element.starts_with(start))
}

/// `9*LREAL`, `LREAL,UDINT,_4,LREAL`: types in their order, with bytes that are left free; nothing is
/// aligned by itself.
impl FromStr for Layout {
    type Err = LayoutError;

    fn from_str(text: &str) -> Result<Layout, LayoutError> {
        let mut layout = Layout::default();
        for item in text.split(',').map(str::trim) {
            if let Some(free) = item.strip_prefix('_') {
                let free: u16 = free
                    .parse()
                    .map_err(|_| LayoutError(format!("{item:?}: how many bytes are free?")))?;
                layout.size += usize::from(free);
                continue;
            }
            let (count, scalar) = match item.split_once('*') {
                Some((count, scalar)) => (count.trim().parse().unwrap_or(0), scalar.trim()),
                None => (1, item),
            };
            if count == 0 || count > MOST_SLOTS - layout.slots.len() {
                return Err(LayoutError(format!("{item:?}: how many of them?")));
            }
            let scalar: Scalar = scalar.parse()?;
            for _ in 0..count {
                layout.slots.push(Slot {
                    name: String::new(),
                    offset: layout.size,
                    scalar,
                });
                layout.size += scalar.size();
            }
        }
        Ok(layout)
    }
}

impl fmt::Display for Layout {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut slots = self.slots.as_slice();
        let mut first = true;
        while let Some(slot) = slots.first() {
            let same = |other: &&Slot| {
                slot.name.is_empty() && other.scalar == slot.scalar && other.name.is_empty()
            };
            let run = slots.iter().take_while(same).count().max(1);
            if !first {
                f.write_str(", ")?;
            }
            first = false;
            let name = slot.scalar.name();
            match (run, slot.name.as_str()) {
                (1, "") => write!(f, "{name}")?,
                (1, member) => write!(f, "{member}: {name}")?,
                _ => write!(f, "{run} {name}")?,
            }
            slots = slots.get(run..).unwrap_or_default();
        }
        write!(f, " ({} bytes)", self.size)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_count_beyond_all_numbers_is_refused() {
        for text in [
            "LREAL,18446744073709551615*LREAL",
            "4096*INT,INT",
            "5000*INT",
        ] {
            let wrong = text.parse::<Layout>().unwrap_err();
            assert!(wrong.to_string().contains("how many"), "{wrong}");
        }
        assert_eq!("4096*INT".parse::<Layout>().unwrap().size, 8192);
    }

    #[test]
    fn pointers_are_not_written() {
        for type_name in [
            "POINTER TO LREAL",
            "ARRAY [0..3] OF reference to ST_X",
            "PVOID",
        ] {
            let symbol = Symbol {
                name: "MAIN.p".into(),
                type_name: type_name.into(),
                base: 21,
                size: 8,
                ..Symbol::default()
            };
            let look_up = |_: &str| -> Result<DataType, LayoutError> { unreachable!() };
            let wrong = Layout::of_symbol(&symbol, look_up).unwrap_err();
            assert!(wrong.to_string().contains("pointers"), "{wrong}");
        }
    }

    /// As TwinCAT tells of `b0: BIT; b1: BIT; x: LREAL`: a bit's size and place are in bits.
    #[test]
    fn single_bits_are_not_written() {
        let member = DataType::member;
        let bits = DataType {
            size: 16,
            members: vec![
                member("b0", "BIT", 1, 0, 33),
                member("b1", "BIT", 1, 1, 33),
                member("x", "LREAL", 8, 8, 5),
            ],
            ..DataType::default()
        };
        let symbol = Symbol {
            size: 16,
            base: 65,
            type_name: "ST_Bits".into(),
            ..Symbol::default()
        };
        let wrong = Layout::of_symbol(&symbol, |_| Ok::<_, LayoutError>(bits.clone()));
        let wrong = wrong.unwrap_err().to_string();
        assert!(
            wrong.contains("b0 is BIT") && wrong.contains("BOOL"),
            "{wrong}"
        );
        assert!("BIT".parse::<Layout>().is_err());
    }

    #[test]
    fn numbers_fit_or_are_clipped() {
        let put = |scalar: Scalar, number| {
            let mut place = vec![0xEE; scalar.size()];
            let fits = scalar.put(number, &mut place);
            (scalar.get(&place).unwrap(), fits)
        };
        let whole = Number::Whole;
        for (scalar, number, held, fits) in [
            (Scalar::F64, Number::Real(0.1), Number::Real(0.1), true),
            (Scalar::F32, Number::Real(0.5), Number::Real(0.5), true),
            (
                Scalar::F32,
                Number::Real(1e300),
                Number::Real(f64::INFINITY),
                false,
            ),
            (Scalar::Bool, Number::Real(2.0), whole(1), true),
            (Scalar::I8, Number::Real(-1.6), whole(-2), true),
            (Scalar::I8, whole(200), whole(127), false),
            (Scalar::U8, whole(-1), whole(0), false),
            (Scalar::I16, whole(-32768), whole(-32768), true),
            (Scalar::U16, Number::Real(f64::NAN), whole(0), false),
            (
                Scalar::U32,
                Number::Real(f64::INFINITY),
                whole(u32::MAX.into()),
                false,
            ),
            (
                Scalar::I64,
                whole(i64::MIN.into()),
                whole(i64::MIN.into()),
                true,
            ),
            (
                Scalar::U64,
                whole(u64::MAX.into()),
                whole(u64::MAX.into()),
                true,
            ),
            (Scalar::U64, whole(i128::MAX), whole(u64::MAX.into()), false),
        ] {
            assert_eq!(put(scalar, number), (held, fits), "{scalar:?} {number:?}");
        }
        let nan = put(Scalar::F64, Number::Real(f64::NAN));
        assert!(nan.0.real().is_nan() && nan.1);
    }

    #[test]
    fn a_layout_is_read_and_written() {
        let layout: Layout = "2*lreal, UDINT,_4,LREAL".parse().unwrap();
        let offsets: Vec<usize> = layout.slots.iter().map(|slot| slot.offset).collect();
        assert_eq!((layout.size, offsets), (32, vec![0, 8, 16, 24]));
        assert_eq!(layout.to_string(), "2 LREAL, UDINT, LREAL (32 bytes)");
        for text in ["", "STRING", "0*LREAL", "_", "x*LREAL", "99999*LREAL"] {
            assert!(text.parse::<Layout>().is_err(), "{text}");
        }
    }

    #[test]
    fn structures_are_taken_apart() {
        let member = DataType::member;
        let inner = DataType {
            size: 16,
            members: vec![member("a", "LREAL", 8, 0, 5), member("b", "LREAL", 8, 8, 5)],
            ..DataType::default()
        };
        let outer = DataType {
            size: 32,
            members: vec![
                DataType {
                    dimensions: vec![(1, 2)],
                    ..member("n", "ARRAY [1..2] OF UDINT", 8, 0, 19)
                },
                member("in", "ST_In", 16, 8, 65),
                member("ok", "BOOL", 1, 24, 33),
            ],
            ..DataType::default()
        };
        let look_up = |name: &str| match name {
            "ST_Out" => Ok(outer.clone()),
            "ST_In" => Ok(inner.clone()),
            _ => Err(LayoutError(name.to_owned())),
        };
        let symbol = Symbol {
            size: 32,
            base: 65,
            type_name: "ST_Out".into(),
            ..Symbol::default()
        };
        let layout = Layout::of_symbol(&symbol, look_up).unwrap();
        assert_eq!(
            layout.to_string(),
            "n[1]: UDINT, n[2]: UDINT, in.a: LREAL, in.b: LREAL, ok: BOOL (32 bytes)"
        );
        assert_eq!(layout.slots[3].offset, 16);
        let text = Symbol {
            size: 81,
            base: 30,
            type_name: "STRING(80)".into(),
            ..Symbol::default()
        };
        assert!(Layout::of_symbol(&text, look_up).is_err());
        // A type that holds itself does not run for ever.
        let endless = DataType {
            size: 32,
            members: vec![member("again", "ST_Out", 32, 0, 65)],
            ..DataType::default()
        };
        let layout = Layout::of_symbol(&symbol, |_| Ok::<_, LayoutError>(endless.clone()));
        assert!(layout.is_err());
    }
}
