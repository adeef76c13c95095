//! Where a device is.

use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;

/// A device's place: a host on the network or a serial port.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Endpoint {
    /// A TCP host; without a port the device's own is meant.
    Tcp {
        /// Name or address.
        host: String,
        /// Port, if one was given.
        port: Option<u16>,
    },
    /// A serial port: a path with a slash in it, or `COM3`.
    Serial(PathBuf),
}

/// Text that names no place.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0:?}: HOST, HOST:PORT, [IPV6]:PORT or a serial port such as /dev/ttyUSB0 is wanted")]
pub struct EndpointError(String);

impl FromStr for Endpoint {
    type Err = EndpointError;

    fn from_str(text: &str) -> Result<Endpoint, EndpointError> {
        let wrong = || EndpointError(text.to_owned());
        if text.contains('/') || text.contains('\\') || is_com_port(text) {
            return Ok(Endpoint::Serial(PathBuf::from(text)));
        }
        let (host, port) = match text.strip_prefix('[') {
            Some(rest) => {
                let (host, port) = rest.split_once(']').ok_or_else(wrong)?;
                let port = match port {
                    "" => None,
                    port => Some(port.strip_prefix(':').ok_or_else(wrong)?),
                };
                (host, port)
            }
            None if text.matches(':').count() > 1 => (text, None),
            None => match text.split_once(':') {
                Some((host, port)) => (host, Some(port)),
                None => (text, None),
            },
        };
        let is_host = |byte: u8| byte.is_ascii_alphanumeric() || b"-._:%".contains(&byte);
        if host.is_empty() || host.starts_with('-') || !host.bytes().all(is_host) {
            return Err(wrong());
        }
        let port = port.map(|port| port.parse().map_err(|_| wrong()));
        Ok(Endpoint::Tcp {
            host: host.to_owned(),
            port: port.transpose()?,
        })
    }
}

fn is_com_port(text: &str) -> bool {
    let number = text
        .get(..3)
        .filter(|head| head.eq_ignore_ascii_case("com"))
        .and_then(|_| text.get(3..));
    number.is_some_and(|number| number.parse::<u16>().is_ok())
}

impl fmt::Display for Endpoint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Endpoint::Serial(path) => write!(f, "{}", path.display()),
            Endpoint::Tcp { host, port } => {
                let port = port.map_or(String::new(), |port| format!(":{port}"));
                if host.contains(':') {
                    write!(f, "[{host}]{port}")
                } else {
                    write!(f, "{host}{port}")
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hosts_and_ports() {
        let tcp = |host: &str, port| Endpoint::Tcp {
            host: host.into(),
            port,
        };
        for (text, place) in [
            ("lms.local", tcp("lms.local", None)),
            ("192.168.0.1:2112", tcp("192.168.0.1", Some(2112))),
            ("::1", tcp("::1", None)),
            ("[::1]:2111", tcp("::1", Some(2111))),
            ("/dev/ttyUSB0", Endpoint::Serial("/dev/ttyUSB0".into())),
            ("./tty", Endpoint::Serial("./tty".into())),
            ("COM3", Endpoint::Serial("COM3".into())),
            (r"\\.\COM10", Endpoint::Serial(r"\\.\COM10".into())),
            ("comet", tcp("comet", None)),
        ] {
            let parsed: Endpoint = text.parse().unwrap();
            assert_eq!(parsed, place, "{text}");
            if !matches!(&parsed, Endpoint::Tcp { host, .. } if host.contains(':')) {
                assert_eq!(parsed.to_string(), text);
            }
        }
        for text in [
            "",
            ":2112",
            "host:",
            "host:99999",
            "a b",
            "[::1",
            "[::1]x",
            "-n",
        ] {
            assert!(text.parse::<Endpoint>().is_err(), "{text}");
        }
    }
}
