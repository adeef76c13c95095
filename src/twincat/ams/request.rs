//! What a client asks, as bytes and back.

use super::{Header, REQUEST, command};
use crate::twincat::address::AmsAddress;
use crate::twincat::bytes::{Bytes, length_u32};
use crate::twincat::code::Code;

/// What a client asks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Request<'a> {
    /// Name and version.
    DeviceInfo,
    /// Reads.
    Read {
        /// Index group.
        group: u32,
        /// Index offset.
        offset: u32,
        /// Bytes wanted.
        length: u32,
    },
    /// Writes.
    Write {
        /// Index group.
        group: u32,
        /// Index offset.
        offset: u32,
        /// What is written.
        data: &'a [u8],
    },
    /// The device's state.
    ReadState,
    /// Asks for notifications.
    AddNotification {
        /// Index group.
        group: u32,
        /// Index offset.
        offset: u32,
        /// Bytes of a sample.
        length: u32,
        /// When a sample is sent.
        mode: Transmission,
        /// Samples are gathered for at most so long, 100 ns.
        max_delay: u32,
        /// The variable is looked at so often, 100 ns.
        cycle: u32,
    },
    /// No more of them.
    DeleteNotification {
        /// Which.
        handle: u32,
    },
    /// Writes, and reads in the same request.
    ReadWrite {
        /// Index group.
        group: u32,
        /// Index offset.
        offset: u32,
        /// Bytes wanted, at most.
        length: u32,
        /// What is written.
        data: &'a [u8],
    },
}

/// When a notification is sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Transmission {
    /// Every cycle.
    Cyclic,
    /// When the value has changed.
    OnChange,
}

impl Transmission {
    fn number(self) -> u32 {
        match self {
            Transmission::Cyclic => 3,
            Transmission::OnChange => 4,
        }
    }
}

impl<'a> Request<'a> {
    /// The ADS command.
    pub fn command(&self) -> u16 {
        match self {
            Request::DeviceInfo => command::DEVICE_INFO,
            Request::Read { .. } => command::READ,
            Request::Write { .. } => command::WRITE,
            Request::ReadState => command::READ_STATE,
            Request::AddNotification { .. } => command::ADD_NOTIFICATION,
            Request::DeleteNotification { .. } => command::DELETE_NOTIFICATION,
            Request::ReadWrite { .. } => command::READ_WRITE,
        }
    }

    /// Appends the request's frame.
    pub fn frame(&self, out: &mut Vec<u8>, target: AmsAddress, source: AmsAddress, invoke_id: u32) {
        let header = Header {
            target,
            source,
            command: self.command(),
            flags: REQUEST,
            error: Code::OK,
            invoke_id,
        };
        header.frame(out, |out| self.payload(out));
    }

    fn payload(&self, out: &mut Vec<u8>) {
        let mut numbers = |numbers: &[u32]| {
            for number in numbers {
                out.extend_from_slice(&number.to_le_bytes());
            }
        };
        match *self {
            Request::DeviceInfo | Request::ReadState => {}
            Request::Read {
                group,
                offset,
                length,
            } => numbers(&[group, offset, length]),
            Request::Write {
                group,
                offset,
                data,
            } => {
                numbers(&[group, offset, length_u32(data.len())]);
                out.extend_from_slice(data);
            }
            Request::AddNotification {
                group,
                offset,
                length,
                mode,
                max_delay,
                cycle,
            } => {
                numbers(&[group, offset, length, mode.number(), max_delay, cycle]);
                out.extend_from_slice(&[0; 16]);
            }
            Request::DeleteNotification { handle } => numbers(&[handle]),
            Request::ReadWrite {
                group,
                offset,
                length,
                data,
            } => {
                numbers(&[group, offset, length, length_u32(data.len())]);
                out.extend_from_slice(data);
            }
        }
    }

    /// The request in a frame; none where it is not one that is known.
    pub fn parse(command: u16, payload: &'a [u8]) -> Option<Request<'a>> {
        let mut bytes = Bytes(payload);
        let request = match command {
            command::DEVICE_INFO => Request::DeviceInfo,
            command::READ_STATE => Request::ReadState,
            command::READ => Request::Read {
                group: bytes.u32()?,
                offset: bytes.u32()?,
                length: bytes.u32()?,
            },
            command::WRITE => {
                let (group, offset, length) = (bytes.u32()?, bytes.u32()?, bytes.u32()?);
                Request::Write {
                    group,
                    offset,
                    data: bytes.take(length as usize)?,
                }
            }
            command::ADD_NOTIFICATION => {
                let (group, offset, length) = (bytes.u32()?, bytes.u32()?, bytes.u32()?);
                let mode = match bytes.u32()? {
                    3 => Transmission::Cyclic,
                    4 => Transmission::OnChange,
                    _ => return None,
                };
                let (max_delay, cycle) = (bytes.u32()?, bytes.u32()?);
                bytes.take(16)?;
                Request::AddNotification {
                    group,
                    offset,
                    length,
                    mode,
                    max_delay,
                    cycle,
                }
            }
            command::DELETE_NOTIFICATION => Request::DeleteNotification {
                handle: bytes.u32()?,
            },
            command::READ_WRITE => {
                let (group, offset) = (bytes.u32()?, bytes.u32()?);
                let (length, write) = (bytes.u32()?, bytes.u32()?);
                Request::ReadWrite {
                    group,
                    offset,
                    length,
                    data: bytes.take(write as usize)?,
                }
            }
            _ => return None,
        };
        bytes.0.is_empty().then_some(request)
    }
}
