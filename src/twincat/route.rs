//! Asking a controller for a route to this host, over UDP.
//!
//! A controller talks to those only that it has a route to. The request carries user name and
//! password as they are: anybody on the same network can read them, as with every tool that does
//! this. Messages are a cookie, an invoke id, a service (replies have the top bit set), the sender's
//! address, and tagged items.

use super::address::{AmsAddress, NetId};
use super::bytes::{Bytes, latin_1, length_u32, zero_ended};
use super::code::Code;
use crate::link::{Datagrams, LinkError};
use std::fmt;
use std::time::Duration;

/// UDP port of a controller's system service.
pub const UDP_PORT: u16 = 48899;
const COOKIE: u32 = 0x7114_6603;
const ADD_ROUTE: u32 = 6;
const REPLY: u32 = 0x8000_0000;
/// AMS port of the system service.
const SYSTEM_SERVICE: u16 = 10_000;
/// How often and for how long a controller is asked.
const TIMES: u32 = 3;
const WAIT: Duration = Duration::from_secs(2);

mod tag {
    pub const STATUS: u16 = 1;
    pub const PASSWORD: u16 = 2;
    pub const HOST: u16 = 5;
    pub const NET_ID: u16 = 7;
    pub const OPTIONS: u16 = 9;
    pub const ROUTE_NAME: u16 = 12;
    pub const USER: u16 = 13;
}

/// Who may add a route.
#[derive(Clone, PartialEq, Eq)]
pub struct Credentials {
    /// A user of the controller, mostly Administrator.
    pub user: String,
    /// That user's password.
    pub password: String,
}

/// Never shows the password.
impl fmt::Debug for Credentials {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Credentials")
            .field("user", &self.user)
            .finish_non_exhaustive()
    }
}

impl Credentials {
    /// Reads lines `user = NAME` and `password = WORD`; empty lines and `#` lines are passed over.
    ///
    /// # Errors
    /// What is missing or strange, without the text of it.
    pub fn parse(text: &str) -> Result<Credentials, String> {
        let (mut user, mut password) = (None, None);
        for (number, line) in text.lines().enumerate() {
            let line = line.trim_end_matches('\r');
            if line.trim().is_empty() || line.starts_with('#') {
                continue;
            }
            let wrong = || {
                format!(
                    "line {}: user = NAME or password = WORD is wanted",
                    number + 1
                )
            };
            let (key, value) = line.split_once('=').ok_or_else(wrong)?;
            let value = value.strip_prefix(' ').unwrap_or(value).to_owned();
            match key.trim() {
                "user" => user = Some(value),
                "password" => password = Some(value),
                _ => return Err(wrong()),
            }
        }
        Ok(Credentials {
            user: user.ok_or("the line user = NAME is missing")?,
            password: password.ok_or("the line password = WORD is missing")?,
        })
    }
}

/// A route to this host.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Route {
    /// Its name in the controller's list.
    pub name: String,
    /// This host's NetId.
    pub net_id: NetId,
    /// This host's address or name, as the controller can reach it.
    pub host: String,
    /// Whether it is forgotten when the controller restarts.
    pub temporary: bool,
}

/// Why there is no route.
#[derive(Debug, thiserror::Error)]
pub enum RouteError {
    /// The network.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// Silence.
    #[error(
        "{0}: no answer on UDP port 48899. Is it a TwinCAT system, is it on, does its firewall let \
         the port through?"
    )]
    Silence(String),
    /// The controller says no.
    #[error("{place}: the route was refused: {code}")]
    Refused {
        /// The controller.
        place: String,
        /// Its reason.
        code: Code,
    },
}

impl Route {
    /// The request for it.
    pub fn request(&self, invoke_id: u32, credentials: &Credentials) -> Vec<u8> {
        let source = AmsAddress {
            net_id: self.net_id,
            port: SYSTEM_SERVICE,
        };
        let mut items = vec![
            (tag::ROUTE_NAME, zero_ended(&self.name)),
            (tag::NET_ID, self.net_id.0.to_vec()),
            (tag::USER, zero_ended(&credentials.user)),
            (tag::PASSWORD, zero_ended(&credentials.password)),
            (tag::HOST, zero_ended(&self.host)),
        ];
        if self.temporary {
            items.push((tag::OPTIONS, 1u32.to_le_bytes().to_vec()));
        }
        message(invoke_id, ADD_ROUTE, source, &items)
    }

    /// Asks the controller at `place` for it.
    ///
    /// # Errors
    /// [`RouteError`].
    pub fn add(&self, line: &Datagrams, place: &str, who: &Credentials) -> Result<(), RouteError> {
        let invoke_id = std::process::id();
        let request = self.request(invoke_id, who);
        let answer = line.ask(&request, TIMES, WAIT, |answer| status(answer, invoke_id))?;
        match answer {
            None => Err(RouteError::Silence(place.to_owned())),
            Some(Code::OK) => Ok(()),
            Some(code) => Err(RouteError::Refused {
                place: place.to_owned(),
                code,
            }),
        }
    }
}

fn message(invoke_id: u32, service: u32, source: AmsAddress, items: &[(u16, Vec<u8>)]) -> Vec<u8> {
    let mut out = Vec::new();
    for number in [COOKIE, invoke_id, service] {
        out.extend_from_slice(&number.to_le_bytes());
    }
    out.extend_from_slice(&source.net_id.0);
    out.extend_from_slice(&source.port.to_le_bytes());
    out.extend_from_slice(&length_u32(items.len()).to_le_bytes());
    for (tag, data) in items {
        let length = u16::try_from(data.len()).unwrap_or(u16::MAX);
        out.extend_from_slice(&tag.to_le_bytes());
        out.extend_from_slice(&length.to_le_bytes());
        out.extend_from_slice(data.get(..length.into()).unwrap_or_default());
    }
    out
}

/// A message's tags and what they hold.
type Items<'a> = Vec<(u16, &'a [u8])>;

/// Invoke id, service and items of a message.
fn parse(message: &[u8]) -> Option<(u32, u32, Items<'_>)> {
    let mut bytes = Bytes(message);
    if bytes.u32()? != COOKIE {
        return None;
    }
    let (invoke_id, service) = (bytes.u32()?, bytes.u32()?);
    bytes.take(8)?;
    let mut items = Vec::new();
    for _ in 0..bytes.u32()?.min(64) {
        let (tag, length) = (bytes.u16()?, bytes.u16()?);
        items.push((tag, bytes.take(length.into())?));
    }
    Some((invoke_id, service, items))
}

/// The result in an answer to our request; none in any other datagram.
fn status(answer: &[u8], invoke_id: u32) -> Option<Code> {
    let (id, service, items) = parse(answer)?;
    if id != invoke_id || service != ADD_ROUTE | REPLY {
        return None;
    }
    let status = items.iter().find(|item| item.0 == tag::STATUS)?;
    Bytes(status.1).u32().map(Code)
}

/// What a controller answers to a request for a route: it takes it from those who know the password.
/// None where it is no such request.
pub fn answer(request: &[u8], who: &Credentials) -> Option<(Vec<u8>, Option<Route>)> {
    let (invoke_id, service, items) = parse(request)?;
    if service != ADD_ROUTE {
        return None;
    }
    let text = |wanted: u16| {
        let item = items.iter().find(|item| item.0 == wanted)?;
        Some(latin_1(item.1))
    };
    let known = text(tag::USER)? == who.user && text(tag::PASSWORD)? == who.password;
    let net_id = items.iter().find(|item| item.0 == tag::NET_ID)?;
    let route = Route {
        name: text(tag::ROUTE_NAME)?,
        net_id: NetId(net_id.1.try_into().ok()?),
        host: text(tag::HOST)?,
        temporary: items.iter().any(|item| item.0 == tag::OPTIONS),
    };
    let code = if known { Code::OK } else { Code::NO_ACCESS };
    let status = vec![(tag::STATUS, code.0.to_le_bytes().to_vec())];
    let source = AmsAddress {
        net_id: NetId::default(),
        port: SYSTEM_SERVICE,
    };
    let reply = message(invoke_id, ADD_ROUTE | REPLY, source, &status);
    Some((reply, known.then_some(route)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn who(password: &str) -> Credentials {
        Credentials {
            user: "Administrator".into(),
            password: password.into(),
        }
    }

    fn route() -> Route {
        Route {
            name: "cablepose".into(),
            net_id: NetId([10, 0, 0, 1, 1, 1]),
            host: "10.0.0.1".into(),
            temporary: true,
        }
    }

    #[test]
    fn a_route_is_given_to_who_knows_the_password() {
        let request = route().request(7, &who("secret"));
        assert_eq!(request[..12], [3, 0x66, 0x14, 0x71, 7, 0, 0, 0, 6, 0, 0, 0]);
        let (reply, added) = answer(&request, &who("secret")).unwrap();
        assert_eq!(status(&reply, 7), Some(Code::OK));
        assert_eq!(added, Some(route()));
        let (reply, added) = answer(&request, &who("other")).unwrap();
        assert_eq!(status(&reply, 7), Some(Code::NO_ACCESS));
        assert_eq!(added, None);
        assert_eq!(status(&reply, 8), None);
        assert!(!format!("{:?}", who("secret")).contains("secret"));
    }

    #[test]
    fn credentials_are_two_lines() {
        let text = "# of the IPC\nuser = Administrator\r\npassword = a = b \n";
        assert_eq!(Credentials::parse(text), Ok(who("a = b ")));
        for text in ["", "user = x\n", "password = x\n", "x\n", "name = y\n"] {
            let error = Credentials::parse(text).unwrap_err();
            assert!(error.contains("wanted") || error.contains("missing"));
        }
    }

    proptest! {
        #[test]
        fn any_bytes_do_no_harm(bytes in proptest::collection::vec(any::<u8>(), 0..80), at in 0..150usize) {
            let _ = (status(&bytes, 0), answer(&bytes, &who("x")));
            let mut request = route().request(7, &who("x"));
            request.truncate(at);
            let _ = answer(&request, &who("x"));
        }
    }
}
