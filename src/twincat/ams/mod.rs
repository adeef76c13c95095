//! AMS frames: the two headers, requests, replies, notifications; and where one ends in a stream.
//!
//! A frame is the AMS/TCP header (u16 command, u32 length), and for command 0 the AMS header of 32
//! bytes and its payload. Infosys: "AMS/TCP Packet", "ADS Commands".

mod request;

pub use request::{Request, Transmission};

use super::address::{AmsAddress, NetId};
use super::bytes::{Bytes, length_u32};
use super::code::Code;

/// TCP port of an AMS router.
pub const TCP_PORT: u16 = 48898;
/// Bytes of the AMS/TCP header.
pub const TCP_HEADER: usize = 6;
/// Bytes of the AMS header.
pub const AMS_HEADER: usize = 32;
/// The longest frame that is taken, bytes: a symbol table of a large program fits, and the router of
/// TwinCAT has 2 MiB for everything by default.
pub const MOST_FRAME: usize = 16 << 20;

/// Commands of the AMS/TCP header.
pub mod tcp_command {
    /// An AMS frame.
    pub const AMS: u16 = 0;
    /// A client gives its port back to the local router.
    pub const CLOSE_PORT: u16 = 1;
    /// A client asks the local router for a port (u16, 0: any); answered by NetId and port.
    pub const OPEN_PORT: u16 = 0x1000;
    /// The local router tells its state.
    pub const ROUTER_NOTE: u16 = 0x1001;
    /// The NetId of the local router.
    pub const NET_ID: u16 = 0x1002;
}

/// ADS commands.
pub mod command {
    /// Name and version of the device.
    pub const DEVICE_INFO: u16 = 1;
    /// Read.
    pub const READ: u16 = 2;
    /// Write.
    pub const WRITE: u16 = 3;
    /// State of the device.
    pub const READ_STATE: u16 = 4;
    /// Ask for notifications.
    pub const ADD_NOTIFICATION: u16 = 6;
    /// No more of them.
    pub const DELETE_NOTIFICATION: u16 = 7;
    /// A notification.
    pub const NOTIFICATION: u16 = 8;
    /// Write, and read in the same request.
    pub const READ_WRITE: u16 = 9;
}

/// Index groups that any PLC has.
pub mod index {
    /// Handle of a symbol by its name.
    pub const HANDLE_BY_NAME: u32 = 0xF003;
    /// Value of a symbol by its handle.
    pub const VALUE_BY_HANDLE: u32 = 0xF005;
    /// Gives a handle back.
    pub const RELEASE_HANDLE: u32 = 0xF006;
    /// Group, offset and size of a symbol.
    pub const INFO_BY_NAME: u32 = 0xF007;
    /// A number that changes with the program.
    pub const SYMBOL_VERSION: u32 = 0xF008;
    /// Everything about a symbol.
    pub const INFO_BY_NAME_EX: u32 = 0xF009;
    /// All symbols.
    pub const SYMBOL_UPLOAD: u32 = 0xF00B;
    /// How many symbols there are, and their size.
    pub const SYMBOL_UPLOAD_INFO: u32 = 0xF00C;
    /// The same with the data types.
    pub const SYMBOL_UPLOAD_INFO_2: u32 = 0xF00F;
    /// A data type by its name.
    pub const DATA_TYPE_BY_NAME: u32 = 0xF011;
    /// Several reads in one request.
    pub const SUM_READ: u32 = 0xF080;
    /// Several writes in one request.
    pub const SUM_WRITE: u32 = 0xF081;
}

/// Flags of a request.
pub const REQUEST: u16 = 0x0004;
/// Flags of a reply.
pub const REPLY: u16 = 0x0005;
/// The bit that tells the two apart.
const IS_REPLY: u16 = 0x0001;

/// The AMS header.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Header {
    /// Who it is for.
    pub target: AmsAddress,
    /// Who it is from.
    pub source: AmsAddress,
    /// ADS command.
    pub command: u16,
    /// Request or reply.
    pub flags: u16,
    /// Error of a router on the way.
    pub error: Code,
    /// A reply has its request's.
    pub invoke_id: u32,
}

impl Header {
    /// Whether this is a reply.
    pub fn is_reply(&self) -> bool {
        self.flags & IS_REPLY != 0
    }

    /// Header and payload of an AMS frame's body; none where its lengths do not agree.
    pub fn parse(body: &[u8]) -> Option<(Header, &[u8])> {
        let mut bytes = Bytes(body);
        let mut address = || {
            let net_id = NetId(bytes.array()?);
            let port = bytes.u16()?;
            Some(AmsAddress { net_id, port })
        };
        let (target, source) = (address()?, address()?);
        let (command, flags) = (bytes.u16()?, bytes.u16()?);
        let length = bytes.u32()?;
        let (error, invoke_id) = (Code(bytes.u32()?), bytes.u32()?);
        let header = Header {
            target,
            source,
            command,
            flags,
            error,
            invoke_id,
        };
        (bytes.0.len() == length as usize).then_some((header, bytes.0))
    }

    /// Appends a whole frame with the payload that `payload` appends.
    pub fn frame(&self, out: &mut Vec<u8>, payload: impl FnOnce(&mut Vec<u8>)) {
        let start = out.len();
        out.extend_from_slice(&[0; TCP_HEADER]);
        for address in [self.target, self.source] {
            out.extend_from_slice(&address.net_id.0);
            out.extend_from_slice(&address.port.to_le_bytes());
        }
        out.extend_from_slice(&self.command.to_le_bytes());
        out.extend_from_slice(&self.flags.to_le_bytes());
        let length_at = out.len();
        out.extend_from_slice(&[0; 4]);
        out.extend_from_slice(&self.error.0.to_le_bytes());
        out.extend_from_slice(&self.invoke_id.to_le_bytes());
        let payload_at = out.len();
        payload(out);
        let length = length_u32(out.len() - payload_at);
        set(out, length_at, &length.to_le_bytes());
        let whole = length_u32(out.len() - start - TCP_HEADER);
        set(out, start + 2, &whole.to_le_bytes());
    }

    /// Appends a reply to this request: the payload is a result and what `payload` appends.
    pub fn reply(&self, out: &mut Vec<u8>, result: Code, payload: impl FnOnce(&mut Vec<u8>)) {
        let header = Header {
            target: self.source,
            source: self.target,
            flags: REPLY,
            ..*self
        };
        header.frame(out, |out| {
            out.extend_from_slice(&result.0.to_le_bytes());
            payload(out);
        });
    }
}

fn set(out: &mut [u8], at: usize, bytes: &[u8]) {
    if let Some(place) = out.get_mut(at..at + bytes.len()) {
        place.copy_from_slice(bytes);
    }
}

/// Appends a frame between a client and its local router.
pub fn router_frame(out: &mut Vec<u8>, command: u16, data: &[u8]) {
    out.extend_from_slice(&command.to_le_bytes());
    out.extend_from_slice(&length_u32(data.len()).to_le_bytes());
    out.extend_from_slice(data);
}

/// A value that came by itself.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Notified {
    /// Which notification.
    pub handle: u32,
    /// When the controller took it: 100 ns since 1601, its system time.
    pub filetime: u64,
    /// The value.
    pub data: Vec<u8>,
}

/// Calls `each` with handle, time (100 ns since 1601) and data of every sample in a notification's
/// payload; false where its lengths do not agree.
pub fn samples(payload: &[u8], mut each: impl FnMut(u32, u64, &[u8])) -> bool {
    let mut bytes = Bytes(payload);
    let mut read = || -> Option<()> {
        bytes.u32()?;
        for _ in 0..bytes.u32()? {
            let filetime = bytes.u64()?;
            for _ in 0..bytes.u32()? {
                let (handle, length) = (bytes.u32()?, bytes.u32()?);
                each(handle, filetime, bytes.take(length as usize)?);
            }
        }
        Some(())
    };
    read().is_some()
}

/// A frame as it came.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Frame<'a> {
    /// Command of the AMS/TCP header.
    pub command: u16,
    /// What is behind that header.
    pub body: &'a [u8],
}

/// Bytes that are no AMS/TCP frames. The connection is of no more use.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FrameError {
    /// No command that is known.
    #[error("bytes came that are no ADS (command {0:#06x}): does something else listen there?")]
    Command(u16),
    /// A length that cannot be.
    #[error("a frame of {0} bytes was announced, which cannot be")]
    Length(u32),
}

/// Finds frames in a stream.
#[derive(Clone, Debug, Default)]
pub struct Framer {
    buffer: Vec<u8>,
    /// Where the next frame begins.
    begin: usize,
}

impl Framer {
    /// Takes bytes as they came.
    pub fn feed(&mut self, bytes: &[u8]) {
        if self.begin > 0 {
            self.buffer.drain(..self.begin.min(self.buffer.len()));
            self.begin = 0;
        }
        self.buffer.extend_from_slice(bytes);
    }

    /// The next whole frame, if there is one.
    ///
    /// # Errors
    /// [`FrameError`]; nothing after that can be understood.
    // Not an iterator: the frame is lent.
    #[allow(clippy::should_implement_trait)]
    pub fn next(&mut self) -> Result<Option<Frame<'_>>, FrameError> {
        let waiting = self.buffer.get(self.begin..).unwrap_or_default();
        let mut bytes = Bytes(waiting);
        let (Some(command), Some(length)) = (bytes.u16(), bytes.u32()) else {
            return Ok(None);
        };
        let least = match command {
            tcp_command::AMS => AMS_HEADER,
            tcp_command::CLOSE_PORT
            | tcp_command::OPEN_PORT
            | tcp_command::ROUTER_NOTE
            | tcp_command::NET_ID => 0,
            _ => return Err(FrameError::Command(command)),
        };
        if (length as usize) < least || length as usize > MOST_FRAME {
            return Err(FrameError::Length(length));
        }
        match bytes.take(length as usize) {
            Some(body) => {
                self.begin += TCP_HEADER + body.len();
                Ok(Some(Frame { command, body }))
            }
            None => Ok(None),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const HERE: AmsAddress = AmsAddress {
        net_id: NetId([10, 1, 1, 1, 1, 1]),
        port: 32905,
    };
    const THERE: AmsAddress = AmsAddress {
        net_id: NetId([192, 0, 2, 10, 1, 1]),
        port: 851,
    };

    /// Put together by hand after the ADS specification.
    #[test]
    fn a_write_by_handle_byte_by_byte() {
        let request = Request::Write {
            group: index::VALUE_BY_HANDLE,
            offset: 0x1234_5678,
            data: &1.5f64.to_le_bytes(),
        };
        let mut out = Vec::new();
        request.frame(&mut out, THERE, HERE, 7);
        let expected = [
            &[0x00, 0x00, 0x34, 0x00, 0x00, 0x00][..], // AMS/TCP: 32 + 20 bytes follow
            &[192, 0, 2, 10, 1, 1, 0x53, 0x03],        // target, port 851
            &[10, 1, 1, 1, 1, 1, 0x89, 0x80],          // source, port 32905
            &[0x03, 0x00, 0x04, 0x00],                 // write, request
            &[20, 0, 0, 0, 0, 0, 0, 0, 7, 0, 0, 0],    // length, error, invoke id
            &[0x05, 0xF0, 0, 0, 0x78, 0x56, 0x34, 0x12, 8, 0, 0, 0],
            &[0, 0, 0, 0, 0, 0, 0xF8, 0x3F],
        ]
        .concat();
        assert_eq!(out, expected);
    }

    #[test]
    fn requests_come_back() {
        let data = [1, 2, 3];
        for request in [
            Request::DeviceInfo,
            Request::ReadState,
            Request::Read {
                group: 1,
                offset: 2,
                length: 3,
            },
            Request::Write {
                group: 1,
                offset: 2,
                data: &data,
            },
            Request::AddNotification {
                group: 1,
                offset: 2,
                length: 3,
                mode: Transmission::Cyclic,
                max_delay: 4,
                cycle: 5,
            },
            Request::DeleteNotification { handle: 9 },
            Request::ReadWrite {
                group: 1,
                offset: 2,
                length: 3,
                data: &data,
            },
        ] {
            let mut out = Vec::new();
            request.frame(&mut out, THERE, HERE, 5);
            let mut framer = Framer::default();
            framer.feed(&out);
            let frame = framer.next().unwrap().unwrap();
            let (header, payload) = Header::parse(frame.body).unwrap();
            assert_eq!((header.target, header.source), (THERE, HERE));
            assert_eq!((header.invoke_id, header.is_reply()), (5, false));
            assert_eq!(Request::parse(header.command, payload), Some(request));
            assert_eq!(
                Request::parse(header.command, &[payload, &[0]].concat()),
                None
            );
        }
    }

    #[test]
    fn frames_are_found_split_and_merged() {
        let mut stream = Vec::new();
        for id in 0..50 {
            let data = vec![id as u8; id as usize * 7];
            let request = Request::Write {
                group: 1,
                offset: id,
                data: &data,
            };
            request.frame(&mut stream, THERE, HERE, id);
        }
        for chunk in [1, 2, 37, 38, 39, 1448, stream.len()] {
            let mut framer = Framer::default();
            let mut next = 0;
            for bytes in stream.chunks(chunk) {
                framer.feed(bytes);
                while let Some(frame) = framer.next().unwrap() {
                    assert_eq!(Header::parse(frame.body).unwrap().0.invoke_id, next);
                    next += 1;
                }
            }
            assert_eq!(next, 50);
        }
    }

    #[test]
    fn what_cannot_be_a_frame_is_refused() {
        let refused = |bytes: &[u8]| {
            let mut framer = Framer::default();
            framer.feed(bytes);
            framer.next().map(|frame| frame.is_some())
        };
        assert_eq!(refused(b"HTTP/1.1 400"), Err(FrameError::Command(0x5448)));
        assert_eq!(refused(&[0, 0, 31, 0, 0, 0]), Err(FrameError::Length(31)));
        let four_gib = [0, 0, 0xFF, 0xFF, 0xFF, 0xFF];
        assert_eq!(refused(&four_gib), Err(FrameError::Length(u32::MAX)));
        assert_eq!(refused(&[0, 0, 32]), Ok(false));
    }

    proptest! {
        #[test]
        fn any_bytes_do_no_harm(bytes in proptest::collection::vec(any::<u8>(), 0..200), command in 0u16..12) {
            let _ = Header::parse(&bytes);
            let _ = Request::parse(command, &bytes);
            let _ = samples(&bytes, |_, _, _| {});
            let mut framer = Framer::default();
            framer.feed(&bytes);
            while let Ok(Some(_)) = framer.next() {}
        }
    }
}
