//! Logs of exchanges with a device, made ready to be fitted: on one evenly running clock, in the
//! device's order, split where a clock began anew.

use super::ticks::LAP_US;
use crate::record::ClockExchange;
use serde::Serialize;

/// One question and answer, ns: the device read its clock between send and receive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Exchange {
    /// Host clock when the request left.
    pub send_ns: i64,
    /// The device's clock.
    pub device_ns: i64,
    /// Host clock when the answer came.
    pub receive_ns: i64,
}

impl Exchange {
    /// From request to answer, ns.
    pub fn round_trip_ns(&self) -> i64 {
        self.receive_ns.saturating_sub(self.send_ns)
    }

    /// The instant half way, ns.
    pub fn middle_ns(&self) -> i64 {
        self.send_ns.saturating_add(self.round_trip_ns() / 2)
    }
}

/// How a link spends time on the length of a message.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wire {
    /// Bits a second of the slowest part of the way.
    pub bits_per_s: f64,
}

impl Wire {
    /// What Ethernet, IP and TCP (with time stamps) put around a segment, bytes; preamble and gap
    /// included.
    const AROUND: u32 = 90;
    /// Payload of a full segment, bytes.
    const SEGMENT: u32 = 1448;

    /// How long the first segment of a message is on the wire, ns: until then nothing of it can be
    /// read.
    pub fn first_segment_ns(&self, bytes: u32) -> f64 {
        let frame = f64::from(bytes.min(Wire::SEGMENT) + Wire::AROUND);
        frame * 8e9 / self.bits_per_s
    }
}

/// What a log says of its clocks.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(tag = "what", rename_all = "kebab-case")]
pub enum ClockEvent {
    /// The device's 32 bit microsecond counter wrapped; unwrapped, the line goes on.
    Wrapped {
        /// Exchange, counted from 0.
        exchange: usize,
    },
    /// The device's clock began anew: it restarted.
    Restarted {
        /// Exchange, counted from 0.
        exchange: usize,
    },
    /// The host's calendar clock was set.
    HostStepped {
        /// Exchange, counted from 0.
        exchange: usize,
        /// By how much, s; positive is forward.
        by_s: f64,
    },
    /// Exchanges whose answer came before the question, and were left out.
    Backwards {
        /// How many.
        exchanges: usize,
    },
}

/// Exchanges through which a straight line can go.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Session {
    /// In the order of the device's clock.
    pub exchanges: Vec<Exchange>,
    /// Host's calendar time minus the clock of `exchanges` at their end, ns.
    pub utc_minus_host_ns: i64,
}

/// A log, split into sessions.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Log {
    /// In their order; none is empty.
    pub sessions: Vec<Session>,
    /// What happened to the clocks.
    pub events: Vec<ClockEvent>,
}

/// A calendar clock may be slewed by this much, s/s, and two quartz clocks differ by less.
const SLEW: f64 = 1e-3;
/// What a difference may be off besides, ns: unsteady transmission stamps.
const SLACK_NS: f64 = 50e6;
/// A change of the calendar clock against the even one that is a step and not slewing, ns.
const HOST_STEP_NS: f64 = 1e6;
/// One lap of a 32 bit microsecond counter, ns.
const LAP_NS: i64 = LAP_US * 1000;

impl Log {
    /// Sorts out records in the order in which they were made. With `wire`, the time that request
    /// and answer spent on the wire for their length is taken off, where the records have it.
    ///
    /// Where the records have the host's monotonic clock, a step of its calendar clock changes
    /// nothing and is only said; without it a new session begins there.
    pub fn of(records: &[ClockExchange], wire: Option<Wire>) -> Log {
        let even = records
            .iter()
            .all(|r| r.host_send_raw.is_some() && r.host_receive_raw.is_some());
        let mut log = Log::default();
        let mut session = Session::default();
        let mut lap_ns = 0i64;
        let (mut backwards, mut last) = (0, None::<Taken>);
        for (index, record) in records.iter().enumerate() {
            let mut taken = Taken::of(record, even);
            if taken.exchange.round_trip_ns() < 0 {
                backwards += 1;
                continue;
            }
            taken.exchange.device_ns = taken.exchange.device_ns.saturating_add(lap_ns);
            if let Some(last) = last {
                let elapsed_ns = taken.since(&last);
                let stepped_ns = taken
                    .utc_minus_host_ns
                    .saturating_sub(last.utc_minus_host_ns);
                if even && (stepped_ns as f64).abs() > HOST_STEP_NS + SLEW * elapsed_ns as f64 {
                    log.events.push(ClockEvent::HostStepped {
                        exchange: index,
                        by_s: stepped_ns as f64 * 1e-9,
                    });
                }
                let split = match taken.against(&last) {
                    Against::Fits => false,
                    Against::Wrapped => {
                        lap_ns = lap_ns.saturating_add(LAP_NS);
                        taken.exchange.device_ns = taken.exchange.device_ns.saturating_add(LAP_NS);
                        log.events.push(ClockEvent::Wrapped { exchange: index });
                        false
                    }
                    Against::Restarted => {
                        lap_ns = 0;
                        taken = Taken::of(record, even);
                        log.events.push(ClockEvent::Restarted { exchange: index });
                        true
                    }
                    Against::Jumped { .. } if even => {
                        log.events.push(ClockEvent::Restarted { exchange: index });
                        true
                    }
                    Against::Jumped { by_ns } => {
                        log.events.push(ClockEvent::HostStepped {
                            exchange: index,
                            by_s: by_ns * 1e-9,
                        });
                        true
                    }
                };
                if split {
                    log.sessions.push(std::mem::take(&mut session));
                }
            }
            last = Some(taken);
            let mut exchange = taken.exchange;
            if let Some(wire) = wire {
                let on_wire = |bytes: Option<u32>| {
                    bytes.map_or(0, |bytes| wire.first_segment_ns(bytes).round() as i64)
                };
                let [request_ns, reply_ns] =
                    [record.request_bytes, record.reply_bytes].map(on_wire);
                exchange.send_ns = exchange.send_ns.saturating_add(request_ns);
                exchange.receive_ns = exchange.receive_ns.saturating_sub(reply_ns);
            }
            session.utc_minus_host_ns = taken.utc_minus_host_ns;
            session.exchanges.push(exchange);
        }
        log.sessions.push(session);
        log.sessions.retain(|session| !session.exchanges.is_empty());
        for session in &mut log.sessions {
            session.exchanges.sort_by_key(|exchange| exchange.device_ns);
        }
        if backwards > 0 {
            log.events.push(ClockEvent::Backwards {
                exchanges: backwards,
            });
        }
        log
    }

    /// The session with the most exchanges.
    pub fn longest(&self) -> Option<&Session> {
        self.sessions.iter().max_by_key(|s| s.exchanges.len())
    }
}

/// How an exchange goes together with the one before it.
enum Against {
    Fits,
    Wrapped,
    Restarted,
    Jumped { by_ns: f64 },
}

/// An exchange as it was logged.
#[derive(Clone, Copy)]
struct Taken {
    exchange: Exchange,
    utc_minus_host_ns: i64,
}

impl Taken {
    fn of(record: &ClockExchange, even: bool) -> Taken {
        let utc = [record.host_send, record.host_receive];
        let host = match (even, record.host_send_raw, record.host_receive_raw) {
            (true, Some(send), Some(receive)) => [send, receive],
            _ => utc,
        };
        Taken {
            exchange: Exchange {
                send_ns: host[0].ns(),
                device_ns: record.device.ns(),
                receive_ns: host[1].ns(),
            },
            utc_minus_host_ns: utc[1] - host[1],
        }
    }

    fn since(&self, last: &Taken) -> i64 {
        self.exchange.send_ns.saturating_sub(last.exchange.send_ns)
    }

    fn against(&self, last: &Taken) -> Against {
        let elapsed_ns = self.since(last) as f64;
        let device_ns = (self.exchange.device_ns as f64) - (last.exchange.device_ns as f64);
        // The device read its clock somewhere between send and receive, both times.
        let round_trips =
            self.exchange.round_trip_ns() as f64 + last.exchange.round_trip_ns() as f64;
        let slack_ns = SLACK_NS + round_trips + SLEW * elapsed_ns.abs();
        let off_ns = device_ns - elapsed_ns;
        if off_ns.abs() <= slack_ns {
            Against::Fits
        } else if (off_ns + LAP_NS as f64).abs() <= slack_ns && device_ns < 0.0 {
            Against::Wrapped
        } else if device_ns < 0.0 && elapsed_ns >= 0.0 {
            Against::Restarted
        } else {
            Against::Jumped { by_ns: -off_ns }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::{FitSettings, fit};
    use crate::record::Stamp;
    use proptest::prelude::*;

    /// A record at `t_s`; the device started at 4200 s, the host's clocks are an hour apart.
    fn record(t_s: f64, utc_s: f64, device_s: f64, even: bool) -> ClockExchange {
        let at = |s: f64| Stamp::from_ns(0).plus_s(s);
        let raw = |s: f64| even.then(|| at(s));
        ClockExchange {
            host_send: at(utc_s + t_s),
            device: at(device_s + t_s),
            host_receive: at(utc_s + t_s + 0.001),
            host_send_raw: raw(t_s),
            host_receive_raw: raw(t_s + 0.001),
            request_bytes: Some(20),
            reply_bytes: Some(4000),
            ..ClockExchange::default()
        }
    }

    #[test]
    fn a_wrap_is_no_restart() {
        let lap_s = 4294.967296;
        let records: Vec<_> = (0..200)
            .map(|k| {
                let t = f64::from(k) * 0.1;
                let device = if t < 9.05 { 4285.9 } else { 4285.9 - lap_s };
                record(t, 3600.0, device, true)
            })
            .collect();
        let log = Log::of(&records, None);
        assert_eq!(log.events, [ClockEvent::Wrapped { exchange: 91 }]);
        let [session] = &log.sessions[..] else {
            panic!("{log:?}")
        };
        let offsets = session.exchanges.iter().map(|e| e.device_ns - e.send_ns);
        assert!(offsets.clone().all(|o| (o - 4_285_900_000_000).abs() < 3));
        assert_eq!(session.utc_minus_host_ns, 3_600_000_000_000);
    }

    #[test]
    fn restarts_and_steps_are_told_apart() {
        for even in [true, false] {
            let records: Vec<_> = (0..300)
                .map(|k| {
                    let t = f64::from(k) * 0.1;
                    let utc = if k < 100 { 3600.0 } else { 3598.5 };
                    let device = if k < 200 { 100.0 } else { -19.5 };
                    record(t, utc, device, even)
                })
                .collect();
            let log = Log::of(&records, None);
            let [
                ClockEvent::HostStepped {
                    exchange: 100,
                    by_s,
                },
                ClockEvent::Restarted { exchange: 200 },
            ] = log.events[..]
            else {
                panic!("{:?}", log.events)
            };
            assert!((by_s + 1.5).abs() < 1e-3);
            let lengths: Vec<_> = log.sessions.iter().map(|s| s.exchanges.len()).collect();
            let expected: &[usize] = if even { &[200, 100] } else { &[100, 100, 100] };
            assert_eq!(lengths, expected);
        }
    }

    #[test]
    fn the_wire_is_taken_off() {
        let wire = Wire { bits_per_s: 100e6 };
        // A full segment is 1538 bytes on the wire, preamble and gap included.
        assert_eq!(wire.first_segment_ns(4000), 123_040.0);
        let log = Log::of(&[record(0.0, 0.0, 0.0, true)], Some(wire));
        let exchange = log.sessions[0].exchanges[0];
        assert_eq!(exchange.send_ns, 8800);
        assert_eq!(exchange.receive_ns, 1_000_000 - 123_040);
    }

    proptest! {
        #[test]
        fn any_records_are_sorted_out(
            fields in prop::collection::vec((any::<[i64; 5]>(), any::<bool>()), 0..40),
        ) {
            let at = Stamp::from_ns;
            let records: Vec<_> = fields
                .iter()
                .map(|(f, even)| ClockExchange {
                    host_send: at(f[0]),
                    device: at(f[1]),
                    host_receive: at(f[2]),
                    host_send_raw: even.then(|| at(f[3])),
                    host_receive_raw: even.then(|| at(f[4])),
                    request_bytes: Some(20),
                    reply_bytes: even.then_some(4000),
                    ..ClockExchange::default()
                })
                .collect();
            let log = Log::of(&records, Some(Wire { bits_per_s: 1.0 }));
            let kept: usize = log.sessions.iter().map(|s| s.exchanges.len()).sum();
            prop_assert!(kept <= records.len());
            let settings = FitSettings { resamples: 2, ..FitSettings::default() };
            for session in &log.sessions {
                if let Ok(found) = fit(&session.exchanges, &settings) {
                    prop_assert_eq!(found.exchanges, session.exchanges.len());
                }
            }
        }
    }
}
