//! The offset and the rate of a device's clock, from exchanges, with what is not known of them.

use super::cloud::{Hulls, Method, Offset, Origin, Sample, offset};
use super::exchange::Exchange;
use super::hull::{Line, LowerHull};
use serde::Serialize;

/// How a fit is made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FitSettings {
    /// The estimator.
    pub method: Method,
    /// How often the log is drawn anew, block by block, to see how the result scatters; 0 is never.
    pub resamples: u32,
    /// How much longer the shortest answer is known to take than the shortest request, ns.
    pub asymmetry_ns: f64,
    /// Steps of the device's stamps, ns; none is told from them (1 us, 1 ms or 1 ns).
    pub tick_ns: Option<f64>,
}

impl Default for FitSettings {
    fn default() -> Self {
        FitSettings {
            method: Method::Hull,
            resamples: 200,
            asymmetry_ns: 0.0,
            tick_ns: None,
        }
    }
}

/// What may be believed of a fit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// Both ways were used: the offset is known to half the shortest round trip at worst.
    TwoWay,
    /// Only arrivals were used, because that was asked for: the shortest delay is in the offset.
    OneWay,
    /// Only arrivals were used, because the device's stamps lie before the requests that they
    /// answer: they say when a scan was done, not when it was sent.
    OneWayStampsVoid,
    /// The device's rate changed while it was watched: take the pieces, not the line.
    DriftChanged,
}

/// A straight line from the host's clock to the device's.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ClockLine {
    /// The instant on the host's clock for which the offset holds, ns.
    pub at_host_ns: i64,
    /// Device minus host at that instant, ns.
    pub offset_ns: i64,
    /// How much faster the device's clock runs than the host's, s/s times 10^9 (ppb).
    pub drift_ppb: f64,
}

impl ClockLine {
    /// What the device's clock reads at an instant of the host's, ns.
    pub fn device_ns(&self, host_ns: i64) -> i64 {
        let elapsed = host_ns.saturating_sub(self.at_host_ns) as f64;
        let gained_ns = (elapsed * self.drift_ppb * 1e-9).round() as i64;
        host_ns
            .saturating_add(self.offset_ns)
            .saturating_add(gained_ns)
    }

    /// What the host's clock reads when the device's reads this, ns.
    pub fn host_ns(&self, device_ns: i64) -> i64 {
        let at_device_ns = self.at_host_ns.saturating_add(self.offset_ns);
        let elapsed = device_ns.saturating_sub(at_device_ns) as f64;
        let rate = self.drift_ppb * 1e-9;
        let gained_ns = (elapsed * rate / (1.0 + rate)).round() as i64;
        device_ns
            .saturating_sub(self.offset_ns)
            .saturating_sub(gained_ns)
    }
}

/// A line that holds for a part of the log.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Piece {
    /// First and last instant on the host's clock, ns.
    pub from_host_ns: i64,
    /// See `from_host_ns`.
    pub to_host_ns: i64,
    /// The line.
    #[serde(flatten)]
    pub line: ClockLine,
}

/// The result.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ClockFit {
    /// The estimator that was used: not the one asked for where stamps are void.
    pub method: Method,
    /// What may be believed.
    pub verdict: Verdict,
    /// How many exchanges there were, and over how long, s.
    pub exchanges: usize,
    /// See `exchanges`.
    pub span_s: f64,
    /// The line through the whole log.
    #[serde(flatten)]
    pub line: ClockLine,
    /// Scatter of the offset at the middle and at the end of the log, and of the rate (1 sigma);
    /// none where it could not be found.
    pub offset_sigma_ns: Option<f64>,
    /// See `offset_sigma_ns`.
    pub end_sigma_ns: Option<f64>,
    /// See `offset_sigma_ns`.
    pub drift_sigma_ppb: Option<f64>,
    /// The shortest round trip, ns.
    pub rtt_min_ns: f64,
    /// The offset can be off by this much either way for reasons that cannot be seen, ns: half the
    /// shortest round trip. None for one-way fits, where it is off by the shortest delay.
    pub bracket_ns: Option<f64>,
    /// Asymmetry that was taken off the offset, ns of the answer's way.
    pub asymmetry_ns: f64,
    /// Line under the requests plus line under the answers, ns: the shortest round trip as the
    /// hulls see it. Below nothing where stamps are void.
    pub hull_gap_ns: Option<f64>,
    /// How many differences lie within a microsecond of a hull's line.
    pub support_points: usize,
    /// Straight pieces that follow a changing rate; one where the rate is even.
    pub pieces: Vec<Piece>,
}

/// Why there is no fit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FitError {
    /// Too few exchanges.
    #[error("{found} exchanges are too few: a line needs at least {needed}")]
    TooFew {
        /// How many there are.
        found: usize,
        /// How many are needed.
        needed: usize,
    },
    /// All at one instant.
    #[error("the device's clock stands still: all exchanges have the same device time")]
    Still,
}

/// Fewer exchanges tell nothing of a line.
pub const LEAST_EXCHANGES: usize = 4;
/// Length of the blocks that are drawn anew, s: delays within a burst belong together.
const BLOCK_S: f64 = 1.0;
/// At most so many blocks.
const BLOCKS: usize = 300;
/// A piece is not shorter, s, and has not fewer exchanges.
const PIECE_S: f64 = 10.0;
const PIECE_EXCHANGES: usize = 100;
/// Halves whose rates would bend the line by less are one line, ns.
const BEND_NS: f64 = 5_000.0;
/// Rates that differ by so many of their sigmas differ.
const BEND_SIGMAS: f64 = 4.0;
/// How far a stamp may seem to precede its request, ns: steps of the clocks.
const VOID_NS: f64 = 2_000.0;
/// Two quartz clocks drift apart by less than this, ns/s: a scan's period is far more.
const VOID_DRIFT: f64 = 500_000.0;
/// At least so many exchanges, and so long, s, show whether stamps precede their requests.
const STRETCH: usize = 8;
const STRETCH_S: f64 = 1.0;

/// Fits one session of a log, which is sorted by the device's clock.
///
/// # Errors
/// [`FitError`] where there are too few exchanges.
pub fn fit(exchanges: &[Exchange], settings: &FitSettings) -> Result<ClockFit, FitError> {
    let too_few = FitError::TooFew {
        found: exchanges.len(),
        needed: LEAST_EXCHANGES,
    };
    let (Some(first), Some(last)) = (exchanges.first(), exchanges.last()) else {
        return Err(too_few);
    };
    if exchanges.len() < LEAST_EXCHANGES {
        return Err(too_few);
    }
    if first.device_ns == last.device_ns {
        return Err(FitError::Still);
    }
    let origin = Origin::of(first);
    let tick_ns = settings.tick_ns.unwrap_or_else(|| tick_ns(exchanges));
    let mut samples = origin.samples(exchanges, tick_ns);
    let two_way = settings.method != Method::OneWay;
    let void = two_way && stamps_void(&samples, tick_ns);
    let method = if void {
        Method::OneWay
    } else {
        settings.method
    };
    if method == Method::OneWay {
        // The answers' line rests on stamps that were cut least: there nothing is missing.
        samples = origin.samples(exchanges, 0.0);
    }
    let found = offset(&samples, method).ok_or(too_few)?;
    let shift_ns = if method == Method::OneWay {
        0.0
    } else {
        settings.asymmetry_ns / 2.0
    };
    let scatter = scatter(&samples, method, settings.resamples);
    let end_s = samples.last().map_or(0.0, |s| s.x_s);
    let host_ns = |k: usize| exchanges.get(k).map_or(0, Exchange::middle_ns);
    let pieces: Vec<Piece> = Splitter::split(&samples, method, settings.resamples.min(60))
        .into_iter()
        .map(|part| Piece {
            from_host_ns: host_ns(part.first),
            to_host_ns: host_ns(part.last),
            line: clock_line(origin, part.line, shift_ns),
        })
        .collect();
    let rtt_min_ns = samples
        .iter()
        .map(Sample::round_trip_ns)
        .fold(f64::INFINITY, f64::min);
    let verdict = match (void, two_way) {
        (true, _) => Verdict::OneWayStampsVoid,
        _ if pieces.len() > 1 => Verdict::DriftChanged,
        (_, true) => Verdict::TwoWay,
        (_, false) => Verdict::OneWay,
    };
    let hulls = Hulls::of(&samples).offset(Method::Hull);
    Ok(ClockFit {
        method,
        verdict,
        exchanges: exchanges.len(),
        span_s: end_s,
        line: clock_line(origin, found.line, shift_ns),
        offset_sigma_ns: scatter.map(|s| s.middle_ns),
        end_sigma_ns: scatter.map(|s| s.end_ns),
        drift_sigma_ppb: scatter.map(|s| s.slope),
        rtt_min_ns,
        bracket_ns: (method != Method::OneWay).then_some(rtt_min_ns / 2.0),
        asymmetry_ns: 2.0 * shift_ns,
        hull_gap_ns: found.gap_ns.or(hulls.and_then(|hulls| hulls.gap_ns)),
        support_points: support_points(&samples, method),
        pieces,
    })
}

/// The line on the host's clock.
fn clock_line(origin: Origin, line: Line, shift_ns: f64) -> ClockLine {
    // The abscissa is the device's clock: rates and instants are turned to the host's.
    let rate = line.slope * 1e-9;
    let device_ns = origin
        .device_ns
        .saturating_add((line.x_s * 1e9).round() as i64);
    // An answer that takes longer by 2 shift makes the device seem late by one shift.
    let offset_ns = origin
        .offset_ns
        .saturating_add((line.at_ns + shift_ns).round() as i64);
    ClockLine {
        at_host_ns: device_ns.saturating_sub(offset_ns),
        offset_ns,
        drift_ppb: rate / (1.0 - rate) * 1e9,
    }
}

/// The step of the device's stamps, ns.
fn tick_ns(exchanges: &[Exchange]) -> f64 {
    let all = |step: i64| exchanges.iter().all(|e| e.device_ns % step == 0);
    match (all(1_000_000), all(1000)) {
        (true, _) => 1e6,
        (_, true) => 1e3,
        _ => 1.0,
    }
}

/// Whether the device's stamps precede the requests: within a short time, where no clock drifts far, a
/// stamp lies further before its arrival than another one after its request. Most such times must show
/// it. Stamps cut to whole ticks may seem to do so by one tick.
fn stamps_void(samples: &[Sample], tick_ns: f64) -> bool {
    let (mut void, mut stretches) = (0, 0);
    let mut rest = samples;
    while let Some(first) = rest.first() {
        let long = |(k, s): (usize, &Sample)| k >= STRETCH && s.x_s - first.x_s >= STRETCH_S;
        let end = rest.iter().enumerate().position(|(k, s)| long((k, s)));
        let (stretch, after) = rest.split_at(end.unwrap_or(rest.len()));
        // A few at the end show nothing, unless there are no others.
        if stretch.len() < STRETCH && stretches > 0 {
            break;
        }
        rest = after;
        let least = |value: fn(&Sample) -> f64| {
            let values = stretch.iter().map(value);
            values.fold(f64::INFINITY, f64::min)
        };
        let span_s = stretch.last().map_or(0.0, |last| last.x_s - first.x_s);
        let most_ns = VOID_NS + tick_ns + VOID_DRIFT * span_s;
        stretches += 1;
        void += usize::from(least(|s| s.ask_ns) + least(|s| s.reply_ns) < -most_ns);
    }
    2 * void > stretches
}

/// How many differences lie within a microsecond of the lines under the clouds.
fn support_points(samples: &[Sample], method: Method) -> usize {
    let near = |hull: LowerHull, value: fn(&Sample) -> f64, mean_s: f64| {
        hull.line_at(mean_s).map_or(0, |line| {
            let on = samples.iter().filter(|s| value(s) - line.at(s.x_s) < 1e3);
            on.count()
        })
    };
    let hulls = Hulls::of(samples);
    let replies = near(hulls.reply, |s| s.reply_ns, hulls.mean_s);
    match method {
        Method::OneWay => replies,
        _ => replies + near(hulls.ask, |s| s.ask_ns, hulls.mean_s),
    }
}

/// A part of the samples through which one line goes.
struct Straight {
    first: usize,
    last: usize,
    line: Line,
}

/// Splits the samples where the rates of two halves differ, and the halves again.
struct Splitter {
    method: Method,
    resamples: u32,
    parts: Vec<Straight>,
}

impl Splitter {
    /// 2^12 pieces of 10 s are half a day.
    const DEEPEST: u32 = 12;

    fn split(samples: &[Sample], method: Method, resamples: u32) -> Vec<Straight> {
        let mut splitter = Splitter {
            method,
            resamples,
            parts: Vec::new(),
        };
        splitter.add(samples, 0, 0);
        splitter.parts
    }

    /// Takes samples of which the first is number `first` of all.
    fn add(&mut self, samples: &[Sample], first: usize, depth: u32) {
        let (a, b) = samples.split_at(samples.len() / 2);
        if depth < Splitter::DEEPEST && self.is_bent(a, b) {
            self.add(a, first, depth + 1);
            self.add(b, first + a.len(), depth + 1);
        } else if let Some(Offset { line, .. }) = offset(samples, self.method) {
            self.parts.push(Straight {
                first,
                last: first + samples.len() - 1,
                line,
            });
        }
    }

    /// Whether two neighbours have rates that differ by more than they scatter, and by enough to bend
    /// a line through both.
    fn is_bent(&self, a: &[Sample], b: &[Sample]) -> bool {
        let span_s = |from: &[Sample], to: &[Sample]| match (from.first(), to.last()) {
            (Some(first), Some(last)) => last.x_s - first.x_s,
            _ => 0.0,
        };
        let long = |s: &[Sample]| s.len() >= PIECE_EXCHANGES && span_s(s, s) >= PIECE_S;
        if self.resamples == 0 || !long(a) || !long(b) {
            return false;
        }
        let Some((of_a, of_b)) = offset(a, self.method).zip(offset(b, self.method)) else {
            return false;
        };
        let change = (of_b.line.slope - of_a.line.slope).abs();
        if change * span_s(a, b) / 8.0 <= BEND_NS {
            return false;
        }
        let scatter = |s: &[Sample]| scatter(s, self.method, self.resamples);
        let sigmas = scatter(a).zip(scatter(b));
        sigmas.is_some_and(|(a, b)| change > BEND_SIGMAS * a.slope.hypot(b.slope))
    }
}

/// How a result scatters: standard deviations at the middle, at the end, and of the slope.
#[derive(Clone, Copy, Debug)]
struct Scatter {
    middle_ns: f64,
    end_ns: f64,
    slope: f64,
}

/// Draws blocks of the log anew and fits each draw. None for fewer than three blocks.
fn scatter(samples: &[Sample], method: Method, resamples: u32) -> Option<Scatter> {
    let (first, last) = (samples.first()?, samples.last()?);
    let span_s = last.x_s - first.x_s;
    let block_s = BLOCK_S.max(span_s / BLOCKS as f64);
    let index = |s: &Sample| ((s.x_s - first.x_s) / block_s).floor();
    let blocks: Vec<&[Sample]> = samples.chunk_by(|a, b| index(a) == index(b)).collect();
    if blocks.len() < 3 || resamples < 2 {
        return None;
    }
    let by_hulls = matches!(method, Method::Hull | Method::Joint | Method::OneWay);
    let hulls: Vec<Hulls> = match by_hulls {
        true => blocks.iter().map(|block| Hulls::of(block)).collect(),
        false => Vec::new(),
    };
    let middle_s = (first.x_s + last.x_s) / 2.0;
    let mut draws = SplitMix(0x9e37_79b9_7f4a_7c15);
    let mut moments = [Moments::default(); 3];
    let full = Hulls::of(samples).lines(method);
    let instants_s = [middle_s, last.x_s];
    let mut raised = [Raised::default(); 2];
    // Methods that look at every exchange get fewer draws of long logs.
    let affordable = (20_000_000 / samples.len().max(1)).max(20) as u32;
    let resamples = if by_hulls {
        resamples
    } else {
        resamples.min(affordable)
    };
    for _ in 0..resamples {
        let mut chosen: Vec<usize> = (0..blocks.len())
            .map(|_| draws.below(blocks.len()))
            .collect();
        chosen.sort_unstable();
        let found = if by_hulls {
            let drawn = union(&hulls, &blocks, &chosen);
            // Every other block: half as many as the log has.
            let half: Vec<usize> = chosen.iter().copied().step_by(2).collect();
            let half = union(&hulls, &blocks, &half).lines(method);
            if let Some((full, drawn)) = full.zip(half) {
                for (raised, x_s) in raised.iter_mut().zip(instants_s) {
                    raised.push(full, drawn, x_s);
                }
            }
            drawn.offset(method)
        } else {
            let drawn = chosen.iter().filter_map(|k| blocks.get(*k));
            let drawn: Vec<Sample> = drawn.flat_map(|block| block.iter().copied()).collect();
            offset(&drawn, method)
        };
        if let Some(Offset { line, .. }) = found {
            let values = [line.at(middle_s), line.at(last.x_s), line.slope];
            moments.iter_mut().zip(values).for_each(|(m, v)| m.push(v));
        }
    }
    let [mut middle_ns, mut end_ns, slope] = moments.map(|m| m.deviation());
    if by_hulls {
        [middle_ns, end_ns] = raised.map(|raised| raised.sigma_ns());
    }
    Some(Scatter {
        middle_ns,
        end_ns,
        slope,
    })
}

/// How far the lines under the clouds rise when half the log is drawn anew. A line lies above the
/// truth about as far as such a draw lies above it: with its mean, not without as for other
/// estimators. A whole draw rises too little where delays thin out towards the shortest one.
#[derive(Clone, Copy, Debug, Default)]
struct Raised {
    squares: [f64; 2],
    draws: f64,
    ways: f64,
}

impl Raised {
    fn push(&mut self, full: (Option<Line>, Line), drawn: (Option<Line>, Line), x_s: f64) {
        let [ask, reply] = &mut self.squares;
        *reply += (drawn.1.at(x_s) - full.1.at(x_s)).powi(2);
        self.ways = 1.0;
        if let Some((full, drawn)) = full.0.zip(drawn.0) {
            *ask += (drawn.at(x_s) - full.at(x_s)).powi(2);
            self.ways = 2.0;
        }
        self.draws += 1.0;
    }

    fn sigma_ns(&self) -> f64 {
        (self.squares.iter().sum::<f64>() / self.draws).sqrt() / self.ways
    }
}

/// The hulls of the chosen blocks together: a hull of hulls.
fn union(hulls: &[Hulls], blocks: &[&[Sample]], chosen: &[usize]) -> Hulls {
    let mut whole = Hulls::default();
    let (mut count, mut sum_s) = (0.0, 0.0);
    for k in chosen {
        let (Some(hull), Some(block)) = (hulls.get(*k), blocks.get(*k)) else {
            continue;
        };
        hull.ask.vertices().iter().for_each(|p| whole.ask.push(*p));
        hull.reply
            .vertices()
            .iter()
            .for_each(|p| whole.reply.push(*p));
        count += block.len() as f64;
        sum_s += block.len() as f64 * hull.mean_s;
    }
    whole.mean_s = sum_s / count;
    whole
}

/// Sums of which a standard deviation is made.
#[derive(Clone, Copy, Debug, Default)]
struct Moments {
    count: f64,
    mean: f64,
    squares: f64,
}

impl Moments {
    fn push(&mut self, value: f64) {
        self.count += 1.0;
        let off = value - self.mean;
        self.mean += off / self.count;
        self.squares += off * (value - self.mean);
    }

    fn deviation(&self) -> f64 {
        (self.squares / (self.count - 1.0).max(1.0)).sqrt()
    }
}

/// A small generator: which blocks are drawn is the same every time.
struct SplitMix(u64);

impl SplitMix {
    fn below(&mut self, bound: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^= z >> 31;
        ((u128::from(z) * bound as u128) >> 64) as usize
    }
}

#[cfg(test)]
#[path = "fit_tests.rs"]
mod tests;
