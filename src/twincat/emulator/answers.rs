//! How a PLC answers.

use super::super::ams::{
    Frame, Header, REQUEST, Request, Transmission, command, index, router_frame, tcp_command,
};
use super::super::bytes::{Bytes, latin_1, length_u32};
use super::super::code::Code;
use super::super::fields::to_filetime;
use super::{MEMORY, Plc, Subscription};
use crate::link::emulation::{LineId, Outbox};
use crate::record::Stamp;

/// What is answered: a result and bytes behind it.
type Answer = Result<Vec<u8>, Code>;

/// A number in front of bytes.
fn with_length(data: &[u8]) -> Vec<u8> {
    [&length_u32(data.len()).to_le_bytes()[..], data].concat()
}

impl Plc {
    /// Takes bytes from a client.
    pub(super) fn input(&mut self, line: LineId, bytes: &[u8], now_ns: i64, out: &mut Outbox) {
        let mut framer = self.framers.remove(&line).unwrap_or_default();
        framer.feed(bytes);
        loop {
            match framer.next() {
                Ok(Some(frame)) => self.frame(line, frame, now_ns, out),
                Ok(None) => break,
                Err(_) => {
                    out.close(line);
                    break;
                }
            }
        }
        self.framers.insert(line, framer);
    }

    fn frame(&mut self, line: LineId, frame: Frame<'_>, now_ns: i64, out: &mut Outbox) {
        if self.trouble.mute {
            return;
        }
        match frame.command {
            tcp_command::AMS => {}
            tcp_command::OPEN_PORT => {
                let mut given = self.net_id.0.to_vec();
                given.extend_from_slice(&self.next_port.to_le_bytes());
                self.next_port = self.next_port.wrapping_add(1);
                self.out.clear();
                router_frame(&mut self.out, tcp_command::OPEN_PORT, &given);
                out.reply(line, &self.out);
                return;
            }
            _ => return,
        }
        if self.trouble.no_route {
            out.close(line);
            return;
        }
        let Some((header, payload)) = Header::parse(frame.body) else {
            out.close(line);
            return;
        };
        if header.is_reply() {
            return;
        }
        self.requests += 1;
        let mut answered = std::mem::take(&mut self.out);
        answered.clear();
        self.answer(line, &header, payload, now_ns, &mut answered);
        if let Some(garbage) = self.trouble.garbage.take() {
            out.reply(line, &garbage);
        } else if self.trouble.late > 0 {
            self.trouble.late -= 1;
            let due_ns = now_ns + self.trouble.late_ns;
            self.waiting.push_back((due_ns, line, answered.clone()));
        } else {
            out.reply(line, &answered);
        }
        self.out = answered;
    }

    fn answer(
        &mut self,
        line: LineId,
        header: &Header,
        payload: &[u8],
        now_ns: i64,
        out: &mut Vec<u8>,
    ) {
        let router_says = if header.target.net_id != self.net_id {
            Code::NO_MACHINE
        } else if header.target.port != self.port || self.trouble.port_closed {
            Code::NO_PORT
        } else {
            Code::OK
        };
        if !router_says.is_ok() {
            let header = Header {
                error: router_says,
                ..*header
            };
            header.reply(out, Code::OK, |_| {});
            return;
        }
        let Some(request) = Request::parse(header.command, payload) else {
            header.reply(out, Code::NO_SERVICE, |_| {});
            return;
        };
        // The usual write: nothing is allocated for it.
        if let Request::Write {
            group,
            offset,
            data,
        } = request
        {
            let result = self.write(group, offset, data);
            header.reply(out, result.err().unwrap_or(Code::OK), |_| {});
            return;
        }
        match self.result(line, header, &request, now_ns) {
            Ok(data) => header.reply(out, Code::OK, |out| out.extend_from_slice(&data)),
            // A refusal has the answer's length all the same: no data, handle 0.
            Err(code) => header.reply(out, code, |out| out.extend_from_slice(&[0; 4])),
        }
    }

    fn result(
        &mut self,
        line: LineId,
        header: &Header,
        request: &Request<'_>,
        now_ns: i64,
    ) -> Answer {
        match *request {
            Request::DeviceInfo => {
                let mut data = vec![3, 1];
                data.extend_from_slice(&4026u16.to_le_bytes());
                let mut name = b"Plc30 App".to_vec();
                name.resize(16, 0);
                data.extend_from_slice(&name);
                Ok(data)
            }
            Request::ReadState => Ok([self.state.to_le_bytes(), [0, 0]].concat()),
            Request::Read {
                group,
                offset,
                length,
            } => self
                .read(group, offset, length)
                .map(|data| with_length(&data)),
            Request::Write { .. } => Err(Code::NO_SERVICE),
            Request::ReadWrite {
                group,
                offset,
                length,
                data,
            } => {
                let answer = self.read_write(group, offset, data)?;
                if answer.len() > length as usize {
                    return Err(Code::SIZE);
                }
                Ok(with_length(&answer))
            }
            Request::AddNotification {
                group,
                offset,
                length,
                mode,
                cycle,
                ..
            } => {
                self.read(group, offset, length)?;
                let handle = self.next_handle;
                self.next_handle += 1;
                self.subscriptions.push(Subscription {
                    line,
                    handle,
                    client: header.source,
                    group,
                    offset,
                    length,
                    on_change: mode == Transmission::OnChange,
                    cycle_ns: (i64::from(cycle) * 100).max(1_000_000),
                    due_ns: now_ns,
                    last: Vec::new(),
                });
                Ok(handle.to_le_bytes().to_vec())
            }
            Request::DeleteNotification { handle } => {
                let before = self.subscriptions.len();
                self.subscriptions.retain(|s| s.handle != handle);
                if self.subscriptions.len() == before {
                    return Err(Code::NO_NOTIFICATION);
                }
                Ok(Vec::new())
            }
        }
    }

    /// The variable that group and offset name, and where in it they point.
    fn place(&self, group: u32, offset: u32) -> Result<(usize, usize), Code> {
        if self.trouble.unknown_groups.contains(&group) {
            return Err(Code::NO_GROUP);
        }
        match group {
            index::VALUE_BY_HANDLE => {
                let name = self.handles.get(&offset).ok_or(self.stale)?;
                let same = |held: &super::Held| held.symbol.name.eq_ignore_ascii_case(name);
                let found = self.variables.iter().position(same);
                found.map(|found| (found, 0)).ok_or(self.stale)
            }
            MEMORY => {
                let inside = |held: &super::Held| {
                    let symbol = &held.symbol;
                    (symbol.offset..symbol.offset + symbol.size).contains(&offset)
                };
                let found = self
                    .variables
                    .iter()
                    .position(inside)
                    .ok_or(Code::NO_OFFSET)?;
                let start = self
                    .variables
                    .get(found)
                    .map_or(0, |held| held.symbol.offset);
                Ok((found, (offset - start) as usize))
            }
            _ => Err(Code::NO_GROUP),
        }
    }

    fn write(&mut self, group: u32, offset: u32, data: &[u8]) -> Result<(), Code> {
        if group == index::RELEASE_HANDLE {
            let handle = Bytes(data).u32().ok_or(Code::SIZE)?;
            return self.handles.remove(&handle).map(|_| ()).ok_or(self.stale);
        }
        if let Some(code) = self.trouble.refuse {
            return Err(code);
        }
        let (found, start) = self.place(group, offset)?;
        let held = self.variables.get_mut(found).ok_or(self.stale)?;
        if held.symbol.is_read_only() {
            return Err(Code::DENIED);
        }
        let by_handle = group == index::VALUE_BY_HANDLE;
        if by_handle && data.len() != held.value.len() {
            return Err(Code::SIZE);
        }
        let place = held.value.get_mut(start..start + data.len());
        place.ok_or(Code::SIZE)?.copy_from_slice(data);
        held.writes += 1;
        if self.keep_journal {
            let entry = (held.symbol.name.clone(), data.to_vec());
            self.journal.push(entry);
        }
        Ok(())
    }

    fn read(&self, group: u32, offset: u32, length: u32) -> Answer {
        let exactly = |data: Vec<u8>| {
            let fits = data.len() == length as usize;
            if fits { Ok(data) } else { Err(Code::SIZE) }
        };
        let table = || {
            let mut table = Vec::new();
            self.variables
                .iter()
                .for_each(|v| v.symbol.push(&mut table));
            table
        };
        if self.trouble.unknown_groups.contains(&group) {
            return Err(Code::NO_GROUP);
        }
        match group {
            index::SYMBOL_VERSION => exactly(vec![self.version]),
            index::SYMBOL_UPLOAD => exactly(table()),
            index::SYMBOL_UPLOAD_INFO | index::SYMBOL_UPLOAD_INFO_2 => {
                let mut info = Vec::new();
                let mut types = Vec::new();
                self.types.iter().for_each(|t| t.push(&mut types));
                for number in [
                    self.variables.len(),
                    table().len(),
                    self.types.len(),
                    types.len(),
                    0,
                    0,
                ] {
                    info.extend_from_slice(&length_u32(number).to_le_bytes());
                }
                // Some clients ask for the first numbers only, some for more than there are.
                info.truncate(length as usize);
                Ok(info)
            }
            _ => {
                let (found, start) = self.place(group, offset)?;
                let held = self.variables.get(found).ok_or(self.stale)?;
                let whole = held.value.get(start..).unwrap_or_default();
                let data = whole.get(..length as usize).ok_or(Code::SIZE)?;
                Ok(data.to_vec())
            }
        }
    }

    fn read_write(&mut self, group: u32, offset: u32, sent: &[u8]) -> Answer {
        if self.trouble.unknown_groups.contains(&group) {
            return Err(Code::NO_GROUP);
        }
        match group {
            index::HANDLE_BY_NAME => {
                let name = latin_1(sent);
                self.find(&name).ok_or(Code::NO_SYMBOL)?;
                let handle = self.next_handle;
                self.next_handle += 1;
                self.handles.insert(handle, name);
                Ok(handle.to_le_bytes().to_vec())
            }
            index::INFO_BY_NAME => {
                let held = self.find(&latin_1(sent)).ok_or(Code::NO_SYMBOL)?;
                let symbol = &held.symbol;
                let numbers = [symbol.group, symbol.offset, symbol.size];
                Ok(numbers.iter().flat_map(|n| n.to_le_bytes()).collect())
            }
            index::INFO_BY_NAME_EX => {
                let held = self.find(&latin_1(sent)).ok_or(Code::NO_SYMBOL)?;
                let mut entry = Vec::new();
                held.symbol.push(&mut entry);
                Ok(entry)
            }
            index::DATA_TYPE_BY_NAME => {
                let name = latin_1(sent);
                let found = self.types.iter().find(|known| known.name == name);
                let mut entry = Vec::new();
                found.ok_or(Code::NO_SYMBOL)?.push(&mut entry);
                Ok(entry)
            }
            index::SUM_WRITE => self.sum_write(offset, sent),
            index::SUM_READ => self.sum_read(offset, sent),
            _ => Err(Code::NO_GROUP),
        }
    }

    fn sum_write(&mut self, items: u32, sent: &[u8]) -> Answer {
        let mut heads = Bytes(sent);
        let mut values = Bytes(sent);
        values.take(items as usize * 12).ok_or(Code::SIZE)?;
        let mut codes = Vec::new();
        let fault = self.trouble.item.take();
        for item in 0..items as usize {
            let mut number = || heads.u32().ok_or(Code::SIZE);
            let (group, offset, length) = (number()?, number()?, number()?);
            let value = values.take(length as usize).ok_or(Code::SIZE)?;
            let code = match fault {
                Some((wrong, code)) if wrong == item => code,
                _ => self.write(group, offset, value).err().unwrap_or(Code::OK),
            };
            codes.extend_from_slice(&code.0.to_le_bytes());
        }
        Ok(codes)
    }

    fn sum_read(&self, items: u32, sent: &[u8]) -> Answer {
        let mut heads = Bytes(sent);
        let (mut codes, mut values) = (Vec::new(), Vec::new());
        for _ in 0..items {
            let mut number = || heads.u32().ok_or(Code::SIZE);
            let (group, offset, length) = (number()?, number()?, number()?);
            let code = match self.read(group, offset, length) {
                Ok(value) => {
                    values.extend_from_slice(&value);
                    Code::OK
                }
                Err(code) => {
                    values.resize(values.len() + (length as usize).min(1 << 16), 0);
                    code
                }
            };
            codes.extend_from_slice(&code.0.to_le_bytes());
        }
        codes.extend_from_slice(&values);
        Ok(codes)
    }

    /// When something is due next.
    pub(super) fn due_ns(&self) -> Option<i64> {
        let late = self.waiting.iter().map(|waiting| waiting.0);
        let notified = self.subscriptions.iter().map(|s| s.due_ns);
        late.chain(notified).min()
    }

    /// Sends what is due.
    pub(super) fn advance(&mut self, now_ns: i64, utc: Stamp, out: &mut Outbox) {
        for (due_ns, line, bytes) in std::mem::take(&mut self.waiting) {
            if due_ns <= now_ns {
                out.reply(line, &bytes);
            } else {
                self.waiting.push_back((due_ns, line, bytes));
            }
        }
        for mut subscription in std::mem::take(&mut self.subscriptions) {
            if subscription.due_ns <= now_ns {
                self.notify(&mut subscription, utc, out);
                // A cycle that was missed is not made up for.
                let late_ns = now_ns - subscription.due_ns;
                let cycles = late_ns / subscription.cycle_ns + 1;
                subscription.due_ns += cycles * subscription.cycle_ns;
            }
            self.subscriptions.push(subscription);
        }
    }

    fn notify(&mut self, subscription: &mut Subscription, utc: Stamp, out: &mut Outbox) {
        let Subscription {
            group,
            offset,
            length,
            ..
        } = *subscription;
        let Ok(value) = self.read(group, offset, length) else {
            return;
        };
        if self.trouble.mute || (subscription.on_change && value == subscription.last) {
            return;
        }
        let source = super::super::AmsAddress {
            net_id: self.net_id,
            port: self.port,
        };
        let header = Header {
            target: subscription.client,
            source,
            command: command::NOTIFICATION,
            flags: REQUEST,
            ..Header::default()
        };
        let mut stamp = 1u32.to_le_bytes().to_vec();
        stamp.extend_from_slice(&to_filetime(utc).to_le_bytes());
        stamp.extend_from_slice(&1u32.to_le_bytes());
        stamp.extend_from_slice(&subscription.handle.to_le_bytes());
        stamp.extend_from_slice(&with_length(&value));
        self.out.clear();
        header.frame(&mut self.out, |out| {
            out.extend_from_slice(&with_length(&stamp))
        });
        out.data(subscription.line, &self.out);
        subscription.last = value;
    }

    pub(super) fn connected(&mut self, line: LineId) {
        self.connections += 1;
        self.lines.push(line);
    }

    pub(super) fn disconnected(&mut self, line: LineId) {
        self.lines.retain(|open| *open != line);
        self.subscriptions.retain(|s| s.line != line);
        self.framers.remove(&line);
    }

    /// Lines that a new one of the same host ends.
    pub(super) fn ended_by(&self, newest: LineId) -> Vec<LineId> {
        if !self.trouble.one_connection {
            return Vec::new();
        }
        let others = self.lines.iter().filter(|line| **line != newest);
        others.copied().collect()
    }
}
