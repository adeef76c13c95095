//! Exchanges as two clouds of differences, and the estimators of the line between them.
//!
//! With the device's offset o = device - host, a request's delay a and an answer's delay b the
//! differences are device - send = o + a and receive - device = b - o. Delays are never negative:
//! the line under the first cloud is never below o by less than the shortest a, and the line under
//! the second never below -o by less than the shortest b. Half their difference is o, but for half
//! the difference of the shortest delays, which no estimator can see.

use super::exchange::Exchange;
use super::hull::{Line, LowerHull, Point};
use serde::Serialize;

/// An estimator.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// A line under each cloud, with slopes of their own; half their difference.
    #[default]
    Hull,
    /// The same with one common slope: maximum likelihood for exponential delays.
    Joint,
    /// The line under the answers alone; the shortest delay stays in it.
    OneWay,
    /// Least squares through the middles of all exchanges.
    Mean,
    /// The exchange with the shortest round trip, carried along by the rate of `Window`.
    MinRtt,
    /// Least squares through the middles of the fastest exchange of each second.
    Window,
    /// Least squares weighted by 1 / (1 + (d - d_min) / sd)^2 with d half the round trip and
    /// sd = (median d - d_min) / 0.7, as chrony does.
    Weighted,
}

/// What the two differences of an exchange are, counted from the session's first exchange.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sample {
    /// Device time, s.
    pub x_s: f64,
    /// device - send, ns.
    pub ask_ns: f64,
    /// receive - device, ns.
    pub reply_ns: f64,
}

impl Sample {
    pub fn ask(&self) -> Point {
        Point {
            x_s: self.x_s,
            y_ns: self.ask_ns,
        }
    }

    pub fn reply(&self) -> Point {
        Point {
            x_s: self.x_s,
            y_ns: self.reply_ns,
        }
    }

    pub fn round_trip_ns(&self) -> f64 {
        self.ask_ns + self.reply_ns
    }

    /// The offset if both ways took equally long, ns.
    fn middle_ns(&self) -> f64 {
        (self.ask_ns - self.reply_ns) / 2.0
    }
}

/// Where a session's numbers count from.
#[derive(Clone, Copy, Debug)]
pub(super) struct Origin {
    pub device_ns: i64,
    /// Device minus host, ns.
    pub offset_ns: i64,
}

impl Origin {
    pub fn of(first: &Exchange) -> Origin {
        Origin {
            device_ns: first.device_ns,
            offset_ns: first.device_ns.saturating_sub(first.send_ns),
        }
    }

    /// A device reads whole ticks that have passed: half a tick is added, ns.
    pub fn samples(self, exchanges: &[Exchange], tick_ns: f64) -> Vec<Sample> {
        let sample = |e: &Exchange| {
            let ask = e.device_ns.saturating_sub(e.send_ns);
            let reply = e.receive_ns.saturating_sub(e.device_ns);
            Sample {
                x_s: e.device_ns.saturating_sub(self.device_ns) as f64 * 1e-9,
                ask_ns: ask.saturating_sub(self.offset_ns) as f64 + tick_ns / 2.0,
                reply_ns: reply.saturating_add(self.offset_ns) as f64 - tick_ns / 2.0,
            }
        };
        exchanges.iter().map(sample).collect()
    }
}

/// Both hulls of some samples, and their mean abscissa.
#[derive(Clone, Debug, Default)]
pub(super) struct Hulls {
    pub ask: LowerHull,
    pub reply: LowerHull,
    pub mean_s: f64,
}

/// An offset line, and the gap between the lines that it was made of.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Offset {
    pub line: Line,
    /// Line under the requests plus line under the answers at the mean abscissa, ns: the shortest
    /// round trip as the hulls see it. None for estimators without two hulls.
    pub gap_ns: Option<f64>,
}

impl Hulls {
    pub fn of(samples: &[Sample]) -> Hulls {
        Hulls {
            ask: LowerHull::of(samples.iter().map(Sample::ask)),
            reply: LowerHull::of(samples.iter().map(Sample::reply)),
            mean_s: mean(samples.iter().map(|s| s.x_s)),
        }
    }

    /// The lines under requests and answers, for the methods that need no more than hulls; none for
    /// the others. The one-way method has no line under the requests.
    pub fn lines(&self, method: Method) -> Option<(Option<Line>, Line)> {
        let x_s = self.mean_s;
        match method {
            Method::Hull => Some((Some(self.ask.line_at(x_s)?), self.reply.line_at(x_s)?)),
            Method::OneWay => Some((None, self.reply.line_at(x_s)?)),
            Method::Joint => {
                let slope = self.common_slope();
                let line = |hull: &LowerHull, slope: f64| Line {
                    x_s,
                    at_ns: hull.support_ns(slope, x_s),
                    slope,
                };
                Some((Some(line(&self.ask, slope)), line(&self.reply, -slope)))
            }
            _ => None,
        }
    }

    /// The offset by one of these methods.
    pub fn offset(&self, method: Method) -> Option<Offset> {
        let x_s = self.mean_s;
        let (ask, reply) = self.lines(method)?;
        let Some(ask) = ask else {
            return Some(Offset {
                line: Line {
                    x_s,
                    at_ns: -reply.at(x_s),
                    slope: -reply.slope,
                },
                gap_ns: None,
            });
        };
        Some(Offset {
            line: Line {
                x_s,
                at_ns: (ask.at(x_s) - reply.at(x_s)) / 2.0,
                slope: (ask.slope - reply.slope) / 2.0,
            },
            gap_ns: Some(ask.at(x_s) + reply.at(x_s)),
        })
    }

    /// The slope for which both lines together are highest at the mean abscissa. Their sum is
    /// concave and straight between the slopes of edges: the best is one of these.
    fn common_slope(&self) -> f64 {
        let edges = |hull: &LowerHull, sign: f64| -> Vec<f64> {
            let pairs = hull.vertices().windows(2);
            let slope = |pair: &[Point]| match pair {
                [a, b] => sign * (b.y_ns - a.y_ns) / (b.x_s - a.x_s),
                _ => 0.0,
            };
            pairs.map(slope).collect()
        };
        let mut slopes = edges(&self.ask, 1.0);
        slopes.extend(edges(&self.reply, -1.0));
        slopes.sort_by(f64::total_cmp);
        let height = |slope: f64| {
            self.ask.support_ns(slope, self.mean_s) + self.reply.support_ns(-slope, self.mean_s)
        };
        let (mut low, mut high) = (0, slopes.len().saturating_sub(1));
        while low < high {
            let middle = (low + high) / 2;
            let pair = slopes.get(middle).zip(slopes.get(middle + 1));
            if pair.is_some_and(|(a, b)| height(*b) > height(*a)) {
                low = middle + 1;
            } else {
                high = middle;
            }
        }
        slopes.get(low).copied().unwrap_or(0.0)
    }
}

/// The offset by any method; none without samples.
pub(super) fn offset(samples: &[Sample], method: Method) -> Option<Offset> {
    if samples.is_empty() {
        return None;
    }
    let plain = |line| Offset { line, gap_ns: None };
    match method {
        Method::Hull | Method::Joint | Method::OneWay => Hulls::of(samples).offset(method),
        Method::Mean => least_squares(samples.iter(), |_| 1.0).map(plain),
        Method::Window => least_squares(fastest(samples).into_iter(), |_| 1.0).map(plain),
        Method::MinRtt => {
            let slope = least_squares(fastest(samples).into_iter(), |_| 1.0)?.slope;
            let best = samples
                .iter()
                .min_by(|a, b| a.round_trip_ns().total_cmp(&b.round_trip_ns()))?;
            let line = Line {
                x_s: best.x_s,
                at_ns: best.middle_ns(),
                slope,
            };
            let x_s = mean(samples.iter().map(|s| s.x_s));
            Some(plain(Line {
                x_s,
                at_ns: line.at(x_s),
                slope,
            }))
        }
        Method::Weighted => {
            let mut delays: Vec<f64> = samples.iter().map(|s| s.round_trip_ns() / 2.0).collect();
            let least = delays.iter().copied().fold(f64::INFINITY, f64::min);
            let middle = delays.len() / 2;
            let median = *delays.select_nth_unstable_by(middle, f64::total_cmp).1;
            let sd = ((median - least) / 0.7).max(1.0);
            let weight = |s: &Sample| (1.0 + (s.round_trip_ns() / 2.0 - least) / sd).powi(-2);
            least_squares(samples.iter(), weight).map(plain)
        }
    }
}

/// The exchange with the shortest round trip of each second.
fn fastest(samples: &[Sample]) -> Vec<&Sample> {
    let mut best: Vec<&Sample> = Vec::new();
    for sample in samples {
        match best.last_mut() {
            Some(last) if last.x_s.floor() == sample.x_s.floor() => {
                if sample.round_trip_ns() < last.round_trip_ns() {
                    *last = sample;
                }
            }
            _ => best.push(sample),
        }
    }
    best
}

/// A weighted straight line through the middles, given at the weighted mean abscissa. Level where
/// all are at one instant.
fn least_squares<'a>(
    samples: impl Iterator<Item = &'a Sample> + Clone,
    weight: impl Fn(&Sample) -> f64,
) -> Option<Line> {
    let (mut sum, mut sum_x, mut sum_y) = (0.0, 0.0, 0.0);
    for sample in samples.clone() {
        let w = weight(sample);
        sum += w;
        sum_x += w * sample.x_s;
        sum_y += w * sample.middle_ns();
    }
    if !(sum > 0.0) {
        return None;
    }
    let (x_s, at_ns) = (sum_x / sum, sum_y / sum);
    let (mut xx, mut xy) = (0.0, 0.0);
    for sample in samples {
        let dx = sample.x_s - x_s;
        xx += weight(sample) * dx * dx;
        xy += weight(sample) * dx * (sample.middle_ns() - at_ns);
    }
    let slope = if xx > 0.0 { xy / xx } else { 0.0 };
    Some(Line { x_s, at_ns, slope })
}

pub(super) fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (count, sum) = values.fold((0.0, 0.0), |(n, sum), v| (n + 1.0, sum + v));
    if count > 0.0 { sum / count } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const METHODS: [Method; 7] = [
        Method::Hull,
        Method::Joint,
        Method::OneWay,
        Method::Mean,
        Method::MinRtt,
        Method::Window,
        Method::Weighted,
    ];

    #[test]
    fn nothing_has_no_offset() {
        assert!(METHODS.iter().all(|method| offset(&[], *method).is_none()));
    }

    proptest! {
        /// With equal delays both ways and at least two fast exchanges all methods find the line.
        #[test]
        fn an_exact_line_is_recovered(
            slope in -1e5..1e5f64,
            at_ns in -1e9..1e9f64,
            waits in prop::collection::vec(0.0..1e6f64, 20..100),
        ) {
            let sample = |(k, wait): (usize, &f64)| {
                let x_s = k as f64 * 0.3;
                let o = at_ns + slope * x_s;
                // The first and the last exchange are fast, the others equally slow both ways.
                let ends = k == 0 || k + 1 == waits.len();
                let wait = if ends { 0.0 } else { *wait };
                Sample { x_s, ask_ns: o + 100e3 + wait, reply_ns: 100e3 + wait - o }
            };
            let samples: Vec<Sample> = waits.iter().enumerate().map(sample).collect();
            for method in METHODS {
                let line = offset(&samples, method).unwrap().line;
                let bias = if method == Method::OneWay { -100e3 } else { 0.0 };
                let off = line.at(line.x_s) - (at_ns + slope * line.x_s + bias);
                prop_assert!(off.abs() < 1e-2, "{method:?}: {off}");
                prop_assert!((line.slope - slope).abs() < 1e-2, "{method:?}");
            }
        }

        #[test]
        fn the_common_slope_is_the_best(
            ys in prop::collection::vec((0.0..1e6f64, 0.0..1e6f64), 2..60),
            rival in -1e6..1e6f64,
        ) {
            let sample = |(k, (ask_ns, reply_ns)): (usize, &(f64, f64))| Sample {
                x_s: k as f64 * 0.1, ask_ns: *ask_ns, reply_ns: *reply_ns,
            };
            let samples: Vec<Sample> = ys.iter().enumerate().map(sample).collect();
            let hulls = Hulls::of(&samples);
            let best = hulls.offset(Method::Joint).unwrap().gap_ns.unwrap();
            let other = hulls.ask.support_ns(rival, hulls.mean_s)
                + hulls.reply.support_ns(-rival, hulls.mean_s);
            prop_assert!(other <= best + 1e-3);
        }
    }
}
