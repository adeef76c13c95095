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
    /// Host clock when the answer had arrived.
    pub host_receive: Stamp,
}

columns!(ClockExchange, kind = "clock", stamp = host_receive, {
    Required "host_send_ns" => host_send;
    Required "device_ns" => device;
    Required "host_receive_ns" => host_receive;
});
