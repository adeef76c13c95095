//! One question and its answer over UDP.

use super::LinkError;
use super::connection::plain;
use std::io;
use std::net::{IpAddr, SocketAddr, ToSocketAddrs, UdpSocket};
use std::time::{Duration, Instant};

/// The longest datagram that is read, bytes.
const MOST: usize = 2048;

/// A socket for datagrams to and from one host.
#[derive(Debug)]
pub struct Datagrams {
    socket: UdpSocket,
    place: String,
    local: IpAddr,
}

impl Datagrams {
    /// Opens a socket to a host.
    ///
    /// # Errors
    /// [`LinkError::Open`] where the name has no address or the network is not there.
    pub fn open(host: &str, port: u16) -> Result<Datagrams, LinkError> {
        let place = format!("{host}:{port}");
        let open = |error: io::Error| LinkError::Open {
            place: format!("{place} (UDP)"),
            reason: plain(&error),
        };
        let mut last = io::Error::new(io::ErrorKind::NotFound, "the name has no address");
        for address in (host, port).to_socket_addrs().map_err(open)? {
            let any: SocketAddr = match address {
                SocketAddr::V4(_) => ([0, 0, 0, 0], 0).into(),
                SocketAddr::V6(_) => ([0u16; 8], 0).into(),
            };
            let opened = UdpSocket::bind(any).and_then(|socket| {
                socket.connect(address)?;
                let local = socket.local_addr()?.ip();
                Ok((socket, local))
            });
            match opened {
                Ok((socket, local)) => {
                    return Ok(Datagrams {
                        socket,
                        place,
                        local,
                    });
                }
                Err(error) => last = error,
            }
        }
        Err(open(last))
    }

    /// The host's own address on the way there.
    pub fn local_address(&self) -> IpAddr {
        self.local
    }

    /// Sends `question` up to `times` times, `timeout` apart, until an answer comes that `take`
    /// takes; what it made of it, or none.
    ///
    /// # Errors
    /// [`LinkError::Io`] where nothing can be sent or the host says that nobody listens.
    pub fn ask<T>(
        &self,
        question: &[u8],
        times: u32,
        timeout: Duration,
        mut take: impl FnMut(&[u8]) -> Option<T>,
    ) -> Result<Option<T>, LinkError> {
        let fault = |error: io::Error| LinkError::Io {
            place: format!("{} (UDP)", self.place),
            reason: plain(&error),
        };
        let mut answer = [0; MOST];
        for _ in 0..times {
            self.socket.send(question).map_err(fault)?;
            let due = Instant::now() + timeout;
            loop {
                let left = due.saturating_duration_since(Instant::now());
                if left.is_zero() {
                    break;
                }
                let limit = left.max(Duration::from_millis(1));
                self.socket.set_read_timeout(Some(limit)).map_err(fault)?;
                match self.socket.recv(&mut answer) {
                    Ok(count) => {
                        if let Some(taken) = take(answer.get(..count).unwrap_or_default()) {
                            return Ok(Some(taken));
                        }
                    }
                    Err(error) => match error.kind() {
                        io::ErrorKind::WouldBlock
                        | io::ErrorKind::TimedOut
                        | io::ErrorKind::Interrupted => {}
                        _ => return Err(fault(error)),
                    },
                }
            }
        }
        Ok(None)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_answer_that_fits_is_taken() {
        let server = UdpSocket::bind("127.0.0.1:0").unwrap();
        let port = server.local_addr().unwrap().port();
        let serving = std::thread::spawn(move || {
            let mut question = [0; 16];
            let (count, from) = server.recv_from(&mut question).unwrap();
            for answer in [&b"no"[..], b"yes"] {
                server.send_to(answer, from).unwrap();
            }
            question[..count].to_vec()
        });
        let line = Datagrams::open("127.0.0.1", port).unwrap();
        assert!(line.local_address().is_loopback());
        let take = |answer: &[u8]| (answer == b"yes").then(|| answer.to_vec());
        let taken = line.ask(b"well?", 20, Duration::from_secs(1), take);
        assert_eq!(taken.unwrap().unwrap(), b"yes");
        assert_eq!(serving.join().unwrap(), b"well?");
        // Nobody is there any more: silence, or the system says so.
        let silence = line.ask(b"well?", 2, Duration::from_millis(10), |_| Some(()));
        assert!(matches!(silence, Ok(None) | Err(LinkError::Io { .. })));
    }
}
