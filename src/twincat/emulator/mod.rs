//! A PLC in a controller's place, for tests and for trying things out.
//!
//! [`Plc`] is what it knows and how it answers: variables, types, handles, the symbol version, what
//! shall go wrong. [`SharedPlc`] is the same for several owners, so that a test can change the program
//! under a client's feet; [`Service`] puts it on a socket. What it cannot show: a real router's
//! routes, and how long a real download takes.

mod answers;
mod service;

pub use service::{Service, SharedPlc};

use super::address::NetId;
use super::code::Code;
use super::layout::Scalar;
use super::symbols::{DataType, Symbol};
use crate::link::emulation::LineId;
use std::collections::{HashMap, VecDeque};

/// A variable and its value.
#[derive(Clone, Debug)]
pub struct Held {
    /// What a client is told of it.
    pub symbol: Symbol,
    /// Its bytes.
    pub value: Vec<u8>,
    /// How often it was written.
    pub writes: u64,
}

/// What shall go wrong.
#[derive(Clone, Debug, Default)]
pub struct Trouble {
    /// Nothing is answered any more.
    pub mute: bool,
    /// No server has the AMS port.
    pub port_closed: bool,
    /// There is no route to the client: connections are closed at its first request.
    pub no_route: bool,
    /// So many answers to come are late, and by how much, ns.
    pub late: u32,
    /// See there.
    pub late_ns: i64,
    /// This item of the next sum-up write fails so.
    pub item: Option<(usize, Code)>,
    /// The next answer is this in place of what it should be.
    pub garbage: Option<Vec<u8>>,
    /// Every write is refused so, whatever its handle.
    pub refuse: Option<Code>,
    /// A newer connection of the same host ends the older one, as a TwinCAT router does.
    pub one_connection: bool,
    /// Index groups that are not known.
    pub unknown_groups: Vec<u32>,
}

/// Notifications that a client has asked for.
#[derive(Clone, Debug)]
struct Subscription {
    line: LineId,
    handle: u32,
    client: super::AmsAddress,
    group: u32,
    offset: u32,
    length: u32,
    on_change: bool,
    cycle_ns: i64,
    due_ns: i64,
    last: Vec<u8>,
}

/// A PLC's runtime.
#[derive(Clone, Debug)]
pub struct Plc {
    /// Its NetId.
    pub net_id: NetId,
    /// Its AMS port.
    pub port: u16,
    /// ADS state: 5 is RUN.
    pub state: u16,
    /// What shall go wrong.
    pub trouble: Trouble,
    /// What a handle of an older program gives.
    pub stale: Code,
    /// Keep every value that is written, in order.
    pub keep_journal: bool,
    /// Those values.
    pub journal: Vec<(String, Vec<u8>)>,
    /// Requests answered.
    pub requests: u64,
    /// Connections made.
    pub connections: u64,
    variables: Vec<Held>,
    types: Vec<DataType>,
    version: u8,
    handles: HashMap<u32, String>,
    next_handle: u32,
    next_offset: u32,
    next_port: u16,
    subscriptions: Vec<Subscription>,
    lines: Vec<LineId>,
    framers: HashMap<LineId, super::ams::Framer>,
    /// Late answers: when, to whom, what.
    waiting: VecDeque<(i64, LineId, Vec<u8>)>,
    /// An answer while it is made.
    out: Vec<u8>,
}

impl Default for Plc {
    fn default() -> Self {
        Plc {
            net_id: NetId([127, 0, 0, 1, 1, 1]),
            port: super::address::PLC_PORT,
            state: 5,
            trouble: Trouble::default(),
            stale: Code::OLD_SYMBOL,
            keep_journal: false,
            journal: Vec::new(),
            requests: 0,
            connections: 0,
            variables: Vec::new(),
            types: Vec::new(),
            version: 1,
            handles: HashMap::new(),
            next_handle: 0xA500_0001,
            next_offset: 0x5_DC40,
            next_port: 0x8001,
            subscriptions: Vec::new(),
            lines: Vec::new(),
            framers: HashMap::new(),
            waiting: VecDeque::new(),
            out: Vec::new(),
        }
    }
}

/// `ARRAY [a..b] OF` a scalar.
struct Array {
    lower: i32,
    count: u32,
    element: Scalar,
}

impl Array {
    fn parse(type_name: &str) -> Option<Array> {
        let (bounds, element) = type_name.strip_prefix("ARRAY [")?.split_once("] OF ")?;
        let (lower, upper) = bounds.split_once("..")?;
        let (lower, upper): (i32, i32) = (lower.parse().ok()?, upper.parse().ok()?);
        Some(Array {
            lower,
            count: u32::try_from(upper.checked_sub(lower)?).ok()? + 1,
            element: element.parse().ok()?,
        })
    }
}

/// Index group of the variables.
const MEMORY: u32 = 0x4040;

impl Plc {
    /// A PLC with one variable, the published one.
    pub fn with_sick_value() -> Plc {
        let mut plc = Plc::default();
        plc.declare("MAIN.SickValue", "ARRAY [0..8] OF LREAL");
        plc
    }

    /// Declares a variable of a scalar type, `ARRAY [a..b] OF` one, or a structure declared before;
    /// whether the type is known.
    pub fn declare(&mut self, name: &str, type_name: &str) -> bool {
        let Some((base, size)) = self.size_of(type_name) else {
            return false;
        };
        let symbol = Symbol {
            name: name.to_owned(),
            group: MEMORY,
            offset: self.next_offset,
            size,
            base,
            flags: 0x8,
            type_name: type_name.to_owned(),
            comment: String::new(),
        };
        self.next_offset += size.next_multiple_of(8);
        self.variables.push(Held {
            value: vec![0; size as usize],
            symbol,
            writes: 0,
        });
        true
    }

    /// Declares a structure with TwinCAT 3's alignment: every member at a multiple of its own size.
    pub fn declare_struct(&mut self, name: &str, members: &[(&str, &str)]) -> bool {
        let mut whole = DataType {
            name: name.to_owned(),
            base: 65,
            ..DataType::default()
        };
        let mut widest = 1;
        for (member, type_name) in members {
            let Some((base, size)) = self.size_of(type_name) else {
                return false;
            };
            let scalar = Scalar::from_base(base).map_or(8, |scalar| scalar.size() as u32);
            widest = widest.max(scalar);
            whole.size = whole.size.next_multiple_of(scalar);
            whole.members.push(DataType {
                name: (*member).to_owned(),
                type_name: (*type_name).to_owned(),
                size,
                offset: whole.size,
                base,
                dimensions: Array::parse(type_name)
                    .map(|array| (array.lower, array.count))
                    .into_iter()
                    .collect(),
                ..DataType::default()
            });
            whole.size += size;
        }
        whole.size = whole.size.next_multiple_of(widest);
        self.types.push(whole);
        true
    }

    fn size_of(&self, type_name: &str) -> Option<(u32, u32)> {
        if let Ok(scalar) = type_name.parse::<Scalar>() {
            return Some((scalar.base(), scalar.size() as u32));
        }
        if let Some(found) = self.types.iter().find(|known| known.name == type_name) {
            return Some((found.base, found.size));
        }
        let array = Array::parse(type_name)?;
        let size = array.count.checked_mul(array.element.size() as u32)?;
        Some((array.element.base(), size))
    }

    /// The runtime stops and starts with the same program: handles and notifications are gone, the
    /// symbol version is the same.
    pub fn restart(&mut self) {
        self.handles.clear();
        self.subscriptions.clear();
    }

    /// Loads a changed program: `change` may rename, remove and declare variables; every handle is
    /// one of the older program then.
    pub fn download(&mut self, change: impl FnOnce(&mut Plc)) {
        change(self);
        self.version = self.version.wrapping_add(1);
        self.restart();
    }

    /// Renames a variable; for [`Plc::download`].
    pub fn rename(&mut self, from: &str, to: &str) {
        if let Some(held) = self.find_mut(from) {
            held.symbol.name = to.to_owned();
        }
    }

    /// Takes a variable out of the program; for [`Plc::download`].
    pub fn remove(&mut self, name: &str) {
        self.variables.retain(|held| held.symbol.name != name);
    }

    /// Marks a variable as read-only.
    pub fn set_read_only(&mut self, name: &str) {
        if let Some(held) = self.find_mut(name) {
            held.symbol.flags |= 0x20;
        }
    }

    /// A variable by its name; TwinCAT does not tell capital letters from small ones.
    pub fn find(&self, name: &str) -> Option<&Held> {
        let same = |held: &&Held| held.symbol.name.eq_ignore_ascii_case(name);
        self.variables.iter().find(same)
    }

    fn find_mut(&mut self, name: &str) -> Option<&mut Held> {
        let same = |held: &&mut Held| held.symbol.name.eq_ignore_ascii_case(name);
        self.variables.iter_mut().find(same)
    }

    /// A variable's value as LREALs; empty where there is none of that name.
    pub fn lreals(&self, name: &str) -> Vec<f64> {
        let bytes = self.find(name).map(|held| held.value.as_slice());
        let chunks = bytes.unwrap_or_default().chunks_exact(8);
        chunks
            .filter_map(|chunk| chunk.try_into().ok().map(f64::from_le_bytes))
            .collect()
    }

    /// Sets a variable's bytes, as the program would.
    pub fn set(&mut self, name: &str, bytes: &[u8]) {
        if let Some(held) = self.find_mut(name) {
            for (to, from) in held.value.iter_mut().zip(bytes) {
                *to = *from;
            }
        }
    }

    /// How often a variable was written; 0 where there is none.
    pub fn writes(&self, name: &str) -> u64 {
        self.find(name).map_or(0, |held| held.writes)
    }
}
