//! One connection to a controller: requests with deadlines, replies by their number, notifications.
//!
//! Replies are matched by their invoke id. One that comes after its deadline is counted and dropped,
//! and the connection goes on. Nothing here reconnects: whoever has a [`Client`] drops it on
//! [`ClientError::is_fatal`] and makes another.

use super::address::{AmsAddress, NetId, Target};
use super::ams::{self, FrameError, Framer, Header, Notified, Request, command, tcp_command};
use super::bytes::{Bytes, latin_1, length_u32};
use super::code::Code;
use crate::link::{Connection, Endpoint, HostInstant, LinkError, Waiter};
use std::collections::VecDeque;
use std::time::{Duration, Instant};

/// Notifications that may wait to be taken; the oldest ones are dropped.
const MOST_NOTIFIED: usize = 4096;
/// Requests without a reply yet that are remembered.
const MOST_OPEN: usize = 16;
/// Bytes read at a time.
const PIECE: usize = 16 << 10;

/// Why a request has failed.
#[derive(Debug, thiserror::Error)]
pub enum ClientError {
    /// The connection cannot be made or is gone.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// No reply within the deadline. The connection may be fine.
    #[error("no answer within {waited_ms} ms")]
    Timeout {
        /// How long was waited, ms.
        waited_ms: u128,
    },
    /// A router on the way, or the device, says no.
    #[error("{0}")]
    Refused(Code),
    /// Bytes that are no ADS.
    #[error(transparent)]
    Frame(#[from] FrameError),
    /// A reply that cannot be understood.
    #[error("the answer to {0} cannot be understood")]
    Reply(&'static str),
    /// No NetId can be made of a host's address.
    #[error("{0} has no IPv4 address to make a NetId of: give it")]
    NoNetId(String),
}

impl ClientError {
    /// Whether the connection is of no more use.
    pub fn is_fatal(&self) -> bool {
        !matches!(
            self,
            ClientError::Refused(_) | ClientError::Timeout { .. } | ClientError::Reply(_)
        )
    }

    /// The device's code, if it gave one.
    pub fn code(&self) -> Option<Code> {
        match self {
            ClientError::Refused(code) => Some(*code),
            _ => None,
        }
    }
}

/// Who this client says it is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum LocalAddress {
    /// The host's address on the way to the controller, with `.1.1`; the local router, if the
    /// target is reached through the loopback at the usual port.
    #[default]
    Usual,
    /// This NetId.
    NetId(NetId),
    /// What a TwinCAT router on this host gives.
    Router,
}

/// What a connection has seen besides replies.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Replies that came after their deadline.
    pub late: u64,
    /// Frames that belong to nothing.
    pub strange: u64,
    /// Notifications dropped because nobody took them.
    pub overflowed: u64,
}

/// A number by which a reply is recognised.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct InvokeId(u32);

/// A reply: what a router says, and the payload.
struct Reply {
    id: u32,
    error: Code,
    payload: Vec<u8>,
}

/// A connection to one AMS port.
pub struct Client {
    connection: Connection,
    framer: Framer,
    piece: Vec<u8>,
    request: Vec<u8>,
    source: AmsAddress,
    target: AmsAddress,
    next_id: u32,
    /// Replies that are waited for.
    open: VecDeque<u32>,
    replies: VecDeque<Reply>,
    /// Buffers of replies, to use again.
    spare: Vec<Vec<u8>>,
    notified: VecDeque<(Notified, HostInstant)>,
    /// What a local router said last.
    router: Option<(u16, Vec<u8>)>,
    /// Whether a local router gave the port.
    routed: bool,
    counts: Counts,
    heard: Instant,
}

impl Client {
    /// Connects; a host that does not answer is given up after `timeout`.
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn connect(
        target: &Target,
        local: LocalAddress,
        timeout: Duration,
    ) -> Result<Client, ClientError> {
        let endpoint = Endpoint::Tcp {
            host: target.host.clone(),
            port: target.tcp_port,
        };
        let connection = Connection::open(&endpoint, ams::TCP_PORT, 0, timeout)?;
        let addresses = connection.addresses().map(|(l, p)| (l.ip(), p.ip()));
        let no_net_id = |what: &str| ClientError::NoNetId(what.to_owned());
        let net_id = target
            .net_id
            .or_else(|| NetId::of_host(addresses?.1))
            .ok_or_else(|| no_net_id(&target.host))?;
        let mut client = Client {
            connection,
            framer: Framer::default(),
            piece: vec![0; PIECE],
            request: Vec::with_capacity(256),
            source: AmsAddress::default(),
            target: AmsAddress {
                net_id,
                port: target.port,
            },
            next_id: 1,
            open: VecDeque::with_capacity(MOST_OPEN + 1),
            replies: VecDeque::with_capacity(MOST_OPEN + 1),
            spare: Vec::new(),
            notified: VecDeque::new(),
            router: None,
            routed: false,
            counts: Counts::default(),
            heard: Instant::now(),
        };
        let usual_router = || {
            let port = target.tcp_port.is_none_or(|port| port == ams::TCP_PORT);
            port && addresses.is_some_and(|(local, _)| local.is_loopback())
        };
        client.source = match local {
            LocalAddress::NetId(net_id) => own_address(net_id),
            LocalAddress::Usual if !usual_router() => {
                let net_id = addresses.and_then(|(local, _)| NetId::of_host(local));
                own_address(net_id.ok_or_else(|| no_net_id("this host"))?)
            }
            LocalAddress::Usual | LocalAddress::Router => {
                client.routed = true;
                client.open_port(timeout)?
            }
        };
        Ok(client)
    }

    /// Asks a router on this host for a port.
    fn open_port(&mut self, timeout: Duration) -> Result<AmsAddress, ClientError> {
        self.request.clear();
        ams::router_frame(&mut self.request, tcp_command::OPEN_PORT, &[0, 0]);
        self.connection.write_all(&self.request, timeout)?;
        let due = Instant::now() + timeout;
        loop {
            if let Some((tcp_command::OPEN_PORT, body)) = self.router.take() {
                let mut bytes = Bytes(&body);
                let net_id = bytes.array().map(NetId);
                return match (net_id, bytes.u16()) {
                    (Some(net_id), Some(port)) => Ok(AmsAddress { net_id, port }),
                    _ => Err(ClientError::Reply("the request for a port")),
                };
            }
            let left = due.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Err(timed_out(timeout));
            }
            self.receive(left)?;
        }
    }

    /// Who this client is to the controller.
    pub fn source(&self) -> AmsAddress {
        self.source
    }

    /// The controller's address.
    pub fn target(&self) -> AmsAddress {
        self.target
    }

    /// Host and port of the connection.
    pub fn place(&self) -> &str {
        self.connection.place()
    }

    /// What came besides replies.
    pub fn counts(&self) -> Counts {
        self.counts
    }

    /// For how long nothing has come from the other side.
    pub fn silence(&self) -> Duration {
        self.heard.elapsed()
    }

    /// Sends a request and gives the reply's payload behind its result to `take`.
    ///
    /// # Errors
    /// [`ClientError`]; a time-out leaves the connection usable.
    pub fn call<T>(
        &mut self,
        request: &Request<'_>,
        timeout: Duration,
        take: impl FnOnce(&[u8]) -> T,
    ) -> Result<T, ClientError> {
        let id = self.send(request, timeout)?;
        let due = Instant::now() + timeout;
        loop {
            if let Some(reply) = self.take(id, take_result) {
                return match reply {
                    Ok(reply) => {
                        let taken = take(reply.payload.get(4..).unwrap_or_default());
                        self.spare.push(reply.payload);
                        Ok(taken)
                    }
                    Err(error) => Err(error),
                };
            }
            let left = due.saturating_duration_since(Instant::now());
            if left.is_zero() {
                self.forget(id);
                return Err(timed_out(timeout));
            }
            self.receive(left)?;
        }
    }

    /// Sends a request without waiting; [`Client::answer`] has the reply later.
    ///
    /// # Errors
    /// [`ClientError::Link`].
    pub fn send(
        &mut self,
        request: &Request<'_>,
        timeout: Duration,
    ) -> Result<InvokeId, ClientError> {
        let id = self.next_id;
        self.next_id = self.next_id.wrapping_add(1).max(1);
        self.request.clear();
        request.frame(&mut self.request, self.target, self.source, id);
        // A frame that went out in part makes the rest of the stream nonsense: fatal by its kind.
        self.connection.write_all(&self.request, timeout)?;
        if self.open.len() == MOST_OPEN {
            self.open.pop_front();
        }
        self.open.push_back(id);
        Ok(InvokeId(id))
    }

    /// The payload of a reply behind its result, once it is there; none until then.
    pub fn answer(&mut self, id: InvokeId) -> Option<Result<Vec<u8>, ClientError>> {
        let reply = self.take(id, take_result)?;
        Some(reply.map(|mut reply| {
            reply.payload.drain(..4.min(reply.payload.len()));
            reply.payload
        }))
    }

    /// Does not wait for a reply any more: it will count as late.
    pub fn forget(&mut self, id: InvokeId) {
        self.open.retain(|open| *open != id.0);
        self.replies.retain(|reply| reply.id != id.0);
    }

    fn take<T>(&mut self, id: InvokeId, with: impl FnOnce(Reply) -> T) -> Option<T> {
        let place = self.replies.iter().position(|reply| reply.id == id.0)?;
        self.replies.remove(place).map(with)
    }

    /// Waits until something came or `waiter` is woken, at most `timeout`, and sorts what came.
    ///
    /// # Errors
    /// [`ClientError`] once the connection is gone.
    pub fn wait(&mut self, waiter: &Waiter, timeout: Duration) -> Result<(), ClientError> {
        if self.connection.wait(waiter, timeout)? {
            self.receive(Duration::ZERO)?;
        }
        Ok(())
    }

    /// The next notification that came, and when.
    pub fn notified(&mut self) -> Option<(Notified, HostInstant)> {
        self.notified.pop_front()
    }

    /// Reads what comes within `timeout` and sorts it.
    fn receive(&mut self, timeout: Duration) -> Result<(), ClientError> {
        let Some(received) = self.connection.read(&mut self.piece, timeout)? else {
            return Ok(());
        };
        self.heard = Instant::now();
        let bytes = self.piece.get(..received.bytes).unwrap_or_default();
        self.framer.feed(bytes);
        while let Some(frame) = self.framer.next()? {
            if frame.command != tcp_command::AMS {
                if frame.body.len() <= 64 {
                    self.router = Some((frame.command, frame.body.to_vec()));
                }
                continue;
            }
            let Some((header, payload)) = Header::parse(frame.body) else {
                return Err(FrameError::Length(length_u32(frame.body.len())).into());
            };
            if header.command == command::NOTIFICATION {
                let (queue, counts) = (&mut self.notified, &mut self.counts);
                let whole = ams::samples(payload, |handle, filetime, data| {
                    if queue.len() == MOST_NOTIFIED {
                        queue.pop_front();
                        counts.overflowed += 1;
                    }
                    let data = data.to_vec();
                    let notified = Notified {
                        handle,
                        filetime,
                        data,
                    };
                    queue.push_back((notified, received.at));
                });
                counts.strange += u64::from(!whole);
            } else if !header.is_reply() {
                self.counts.strange += 1;
            } else if let Some(place) = self.open.iter().position(|id| *id == header.invoke_id) {
                self.open.remove(place);
                let mut buffer = self.spare.pop().unwrap_or_default();
                buffer.clear();
                buffer.extend_from_slice(payload);
                if self.replies.len() == MOST_OPEN {
                    self.replies.pop_front();
                }
                self.replies.push_back(Reply {
                    id: header.invoke_id,
                    error: header.error,
                    payload: buffer,
                });
            } else {
                self.counts.late += 1;
            }
        }
        Ok(())
    }

    /// Writes `data`.
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn write(
        &mut self,
        group: u32,
        offset: u32,
        data: &[u8],
        timeout: Duration,
    ) -> Result<(), ClientError> {
        let request = Request::Write {
            group,
            offset,
            data,
        };
        self.call(&request, timeout, |_| ())
    }

    /// Reads exactly `length` bytes.
    ///
    /// # Errors
    /// [`ClientError`]; [`ClientError::Reply`] where there are more or fewer.
    pub fn read(
        &mut self,
        group: u32,
        offset: u32,
        length: u32,
        timeout: Duration,
    ) -> Result<Vec<u8>, ClientError> {
        let request = Request::Read {
            group,
            offset,
            length,
        };
        let data = self.call(&request, timeout, |payload| {
            data(payload).map(<[u8]>::to_vec)
        })?;
        data.filter(|data| data.len() == length as usize)
            .ok_or(ClientError::Reply("a read"))
    }

    /// Writes `sent` and reads at most `length` bytes.
    ///
    /// # Errors
    /// [`ClientError`]; [`ClientError::Reply`] where there are more.
    pub fn read_write(
        &mut self,
        group: u32,
        offset: u32,
        length: u32,
        sent: &[u8],
        timeout: Duration,
    ) -> Result<Vec<u8>, ClientError> {
        let request = Request::ReadWrite {
            group,
            offset,
            length,
            data: sent,
        };
        let data = self.call(&request, timeout, |payload| {
            data(payload).map(<[u8]>::to_vec)
        })?;
        data.filter(|data| data.len() <= length as usize)
            .ok_or(ClientError::Reply("a read with a write"))
    }

    /// Name and version (`Plc30 App 3.1.4024`).
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn device_info(&mut self, timeout: Duration) -> Result<String, ClientError> {
        let info = self.call(&Request::DeviceInfo, timeout, |payload| {
            let mut bytes = Bytes(payload);
            let (major, minor) = (bytes.u8()?, bytes.u8()?);
            let build = bytes.u16()?;
            Some(format!(
                "{} {major}.{minor}.{build}",
                latin_1(bytes.take(16)?)
            ))
        })?;
        info.ok_or(ClientError::Reply("the question for the device's name"))
    }

    /// State of the PLC.
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn state(&mut self, timeout: Duration) -> Result<PlcState, ClientError> {
        let state = self.call(&Request::ReadState, timeout, PlcState::parse)?;
        state.ok_or(ClientError::Reply("the question for the state"))
    }

    /// Gives a port back to the local router and ends the connection.
    pub fn close(mut self) {
        if self.routed {
            self.request.clear();
            let port = self.source.port.to_le_bytes();
            ams::router_frame(&mut self.request, tcp_command::CLOSE_PORT, &port);
            // A router that has gone needs no farewell.
            let _ = self.connection.write_some(&self.request);
        }
        self.connection.shut_down();
    }
}

/// The AMS port of a client without a router.
const OWN_PORT: u16 = 32905;

fn own_address(net_id: NetId) -> AmsAddress {
    AmsAddress {
        net_id,
        port: OWN_PORT,
    }
}

fn timed_out(waited: Duration) -> ClientError {
    ClientError::Timeout {
        waited_ms: waited.as_millis(),
    }
}

/// A reply whose codes are good.
fn take_result(reply: Reply) -> Result<Reply, ClientError> {
    if !reply.error.is_ok() {
        return Err(ClientError::Refused(reply.error));
    }
    match Bytes(&reply.payload).u32() {
        Some(0) => Ok(reply),
        Some(code) => Err(ClientError::Refused(Code(code))),
        None => Err(ClientError::Reply("a request")),
    }
}

/// The data of a read's reply behind its result.
fn data(payload: &[u8]) -> Option<&[u8]> {
    let mut bytes = Bytes(payload);
    let length = bytes.u32()?;
    (bytes.0.len() == length as usize).then_some(bytes.0)
}

/// What a PLC is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PlcState {
    /// ADS state: 5 is RUN, 6 STOP.
    pub ads: u16,
    /// State of the device, its own numbers.
    pub device: u16,
}

impl PlcState {
    /// Behind the result of the reply.
    pub fn parse(payload: &[u8]) -> Option<PlcState> {
        let mut bytes = Bytes(payload);
        Some(PlcState {
            ads: bytes.u16()?,
            device: bytes.u16()?,
        })
    }

    /// Whether the program runs.
    pub fn runs(self) -> bool {
        self.ads == 5
    }

    /// The state's name.
    pub fn name(self) -> &'static str {
        const NAMES: [&str; 20] = [
            "INVALID",
            "IDLE",
            "RESET",
            "INIT",
            "START",
            "RUN",
            "STOP",
            "SAVECFG",
            "LOADCFG",
            "POWERFAILURE",
            "POWERGOOD",
            "ERROR",
            "SHUTDOWN",
            "SUSPEND",
            "RESUME",
            "CONFIG",
            "RECONFIG",
            "STOPPING",
            "INCOMPATIBLE",
            "EXCEPTION",
        ];
        NAMES
            .get(usize::from(self.ads))
            .copied()
            .unwrap_or("UNKNOWN")
    }
}

#[cfg(test)]
#[path = "client_tests.rs"]
mod tests;
