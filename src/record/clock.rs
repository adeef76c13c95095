//! Exchanges between the host's clock and a device's.

use super::columns::columns;
use super::time::Stamp;

/// One question and answer: when it was sent, what the device's clock said, when the answer came.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ClockExchange {
    /// Host clock when the request was sent.
    pub host_send: Stamp,
    /// The device's clock in its answer.
    pub device: Stamp,
    /// Host clock when the answer's first byte had arrived.
    pub host_receive: Stamp,
    /// Host clock when the answer's last byte had arrived.
    pub host_last: Option<Stamp>,
    /// `host_send` on the host's clock that is never set (`CLOCK_MONOTONIC_RAW`).
    pub host_send_raw: Option<Stamp>,
    /// `host_receive` on that clock.
    pub host_receive_raw: Option<Stamp>,
    /// Length of the request.
    pub request_bytes: Option<u32>,
    /// Length of the answer.
    pub reply_bytes: Option<u32>,
}

columns!(ClockExchange, kind = "clock", stamp = host_receive, {
    Required "host_send_ns" => host_send;
    Required "device_ns" => device;
    Required "host_receive_ns" => host_receive;
    Extra "host_last_ns" => host_last;
    Extra "host_send_raw_ns" => host_send_raw;
    Extra "host_receive_raw_ns" => host_receive_raw;
    Extra "request_bytes" => request_bytes;
    Extra "reply_bytes" => reply_bytes;
});
