//! AMS NetIds and ports, and where they are reached.

use crate::link::Endpoint;
use std::fmt;
use std::net::{IpAddr, Ipv4Addr};
use std::str::FromStr;

/// Port of the first PLC runtime of TwinCAT 3.
pub const PLC_PORT: u16 = 851;

/// The name of a TwinCAT system, six numbers; mostly its IPv4 address with `.1.1` behind it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct NetId(pub [u8; 6]);

impl NetId {
    /// The usual one of a host with this address; none for IPv6.
    pub fn of_host(address: IpAddr) -> Option<NetId> {
        let address = match address {
            IpAddr::V4(address) => address,
            IpAddr::V6(address) => address.to_ipv4_mapped()?,
        };
        let [a, b, c, d] = address.octets();
        Some(NetId([a, b, c, d, 1, 1]))
    }

    /// The address that its first four numbers are.
    pub fn host(self) -> Ipv4Addr {
        let [a, b, c, d, ..] = self.0;
        Ipv4Addr::new(a, b, c, d)
    }
}

impl fmt::Display for NetId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [a, b, c, d, e, g] = self.0;
        write!(f, "{a}.{b}.{c}.{d}.{e}.{g}")
    }
}

impl FromStr for NetId {
    type Err = AddressError;

    fn from_str(text: &str) -> Result<NetId, AddressError> {
        let wrong = || AddressError::NetId(text.to_owned());
        let mut numbers = [0; 6];
        let mut parts = text.split('.');
        for number in &mut numbers {
            let part = parts.next().ok_or_else(wrong)?;
            if part.is_empty() || !part.bytes().all(|byte| byte.is_ascii_digit()) {
                return Err(wrong());
            }
            *number = part.parse().map_err(|_| wrong())?;
        }
        match parts.next() {
            None => Ok(NetId(numbers)),
            Some(_) => Err(wrong()),
        }
    }
}

/// Who sends or receives an AMS frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct AmsAddress {
    /// The system.
    pub net_id: NetId,
    /// The server or client in it.
    pub port: u16,
}

impl fmt::Display for AmsAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}", self.net_id, self.port)
    }
}

/// A controller: `192.0.2.10.1.1:851`, `plc.local`, `127.0.0.1:48900/192.0.2.10.1.1:851`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Target {
    /// Host, and TCP port where it is not the usual one.
    pub host: String,
    /// TCP port; none is 48898.
    pub tcp_port: Option<u16>,
    /// Its NetId; none is the address that the host turns out to have, with `.1.1`.
    pub net_id: Option<NetId>,
    /// AMS port of the PLC runtime.
    pub port: u16,
}

/// Text that is no address.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum AddressError {
    /// Not six numbers.
    #[error("{0:?}: an AMS NetId is six numbers, such as 192.0.2.10.1.1")]
    NetId(String),
    /// Not a target.
    #[error(
        "{0:?}: a target is NETID[:AMS-PORT], HOST[:AMS-PORT] or HOST[:TCP-PORT]/NETID[:AMS-PORT], \
         such as 192.0.2.10.1.1:851 or plc.local/192.0.2.10.1.1"
    )]
    Target(String),
}

impl FromStr for Target {
    type Err = AddressError;

    fn from_str(text: &str) -> Result<Target, AddressError> {
        let wrong = || AddressError::Target(text.to_owned());
        let (host, ams) = match text.split_once('/') {
            Some((host, ams)) => (Some(host), ams),
            None => (None, text),
        };
        let (name, port) = match ams.rsplit_once(':') {
            Some((name, port)) => (name, port.parse().map_err(|_| wrong())?),
            None => (ams, PLC_PORT),
        };
        let net_id = name.parse::<NetId>();
        let place = |text: &str| match text.parse() {
            Ok(Endpoint::Tcp { host, port }) => Ok((host, port)),
            _ => Err(wrong()),
        };
        let (host, tcp_port) = match (host, &net_id) {
            (Some(host), Ok(_)) => place(host)?,
            (Some(_), Err(_)) => return Err(wrong()),
            (None, Ok(net_id)) => (net_id.host().to_string(), None),
            // A NetId with a number too few would be taken for a host's name.
            (None, Err(error)) if is_numbers(name) => return Err(error.clone()),
            (None, Err(_)) => place(name)?,
        };
        Ok(Target {
            host,
            tcp_port,
            net_id: net_id.ok(),
            port,
        })
    }
}

/// Whether a text is nothing but numbers with points between, and yet no IPv4 address.
fn is_numbers(text: &str) -> bool {
    text.contains('.')
        && text.bytes().all(|b| b == b'.' || b.is_ascii_digit())
        && text.parse::<Ipv4Addr>().is_err()
}

impl fmt::Display for Target {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Some(net_id) = self.net_id else {
            return write!(f, "{}:{}", self.host, self.port);
        };
        if let Some(tcp_port) = self.tcp_port {
            write!(f, "{}:{tcp_port}/", self.host)?;
        } else if self.host != net_id.host().to_string() {
            write!(f, "{}/", self.host)?;
        }
        write!(f, "{net_id}:{}", self.port)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn targets_in_all_their_forms() {
        let net_id = NetId([192, 0, 2, 10, 1, 1]);
        for (text, host, tcp_port, net_id, port) in [
            ("192.0.2.10.1.1", "192.0.2.10", None, Some(net_id), 851),
            ("192.0.2.10.1.1:852", "192.0.2.10", None, Some(net_id), 852),
            (
                "plc.local/192.0.2.10.1.1",
                "plc.local",
                None,
                Some(net_id),
                851,
            ),
            ("::1/192.0.2.10.1.1", "::1", None, Some(net_id), 851),
            (
                "plc:4/192.0.2.10.1.1:800",
                "plc",
                Some(4),
                Some(net_id),
                800,
            ),
            ("192.0.2.10", "192.0.2.10", None, None, 851),
            ("plc.local:852", "plc.local", None, None, 852),
        ] {
            let target: Target = text.parse().unwrap();
            let wanted = Target {
                host: host.to_owned(),
                tcp_port,
                net_id,
                port,
            };
            assert_eq!(target, wanted, "{text}");
            assert_eq!(target.to_string().parse::<Target>().unwrap(), wanted);
        }
        for text in [
            "",
            ":851",
            "/192.0.2.10.1.1",
            "plc/",
            "plc/192.0.2.10",
            "192.0.2.10.1.1:x",
            "192.0.2.10.1.1:99999",
            "a b",
            "plc/192.0.2.10.1.1.1",
            "/dev/ttyS0",
        ] {
            assert!(text.parse::<Target>().is_err(), "{text}");
        }
        // A NetId that lacks a number is no host's name.
        for text in ["192.0.2.10.1", "1.2.3:851", "192.0.2.10.1.1.1"] {
            let wrong = text.parse::<Target>().unwrap_err();
            assert!(wrong.to_string().contains("six numbers"), "{text}: {wrong}");
        }
    }

    #[test]
    fn net_ids_are_six_numbers() {
        assert_eq!("1.2.3.4.5.255".parse(), Ok(NetId([1, 2, 3, 4, 5, 255])));
        for text in ["1.2.3.4.5", "1.2.3.4.5.256", "1.2.3.4.5.", "+1.2.3.4.5.6"] {
            assert!(text.parse::<NetId>().is_err(), "{text}");
        }
        let id = NetId::of_host("10.1.2.3".parse().unwrap()).unwrap();
        assert_eq!(id.to_string(), "10.1.2.3.1.1");
        assert_eq!(NetId::of_host("::1".parse().unwrap()), None);
    }
}
