//! Which beams tell of a strip's edges, what their brightness is worth, and when it is not.
//!
//! Noise and incidence law are the device's and the material's: they are learned from scan to scan
//! and forgotten slowly. Levels are each strip's own in each scan.

use super::Found;
use super::classification::{Beam, State};
use super::footprint::{Slant, Spot};
use super::photometry::{self, Light, Sample, Start, StripFit};
use super::planes::Planes;
use crate::frame::{Frame, ScannerPose};
use crate::record::{BeamTable, Edge, EdgeBasis, EdgeKind, ReflectorLines, Scan};

/// Beams beyond the spot's reach on either side of an edge: on the background, on the strip.
const OUTSIDE: usize = 5;
const INSIDE: usize = 6;
/// Range to which remissions are referred, m, and the power of the range law (spec: (3 m/r)^0.5).
const REFERENCE_M: f64 = 3.0;
/// Strip and background are met alike if the cosines of incidence differ by less than this share.
const SAME_INCIDENCE: f64 = 0.03;
/// Where they are not, a mixed pixel this near to half-way may have the incidence of either.
const DOUBTFUL: f64 = 0.2;
/// What is believed of cos^p before any scan: mean and standard deviation of p.
const EXPONENT: (f64, f64) = (0.3, 0.3);
/// p is never held for better known than this.
const EXPONENT_FLOOR: f64 = 0.02;
/// This much of what is known of it is kept from scan to scan.
const EXPONENT_KEPT: f64 = 1.0 - 1e-3;
/// Relative noise of a remission before any scan, and for how many beams that counts.
const NOISE: f64 = 0.04;
const NOISE_BEAMS: f64 = 12.0;
/// It is never held for less.
const NOISE_FLOOR: f64 = 0.01;
/// The noise is forgotten over this many beams.
const MEMORY_BEAMS: f64 = 4000.0;
/// A saturated device repeats its highest digit: on at least this many beams, and on at least this
/// share of a strip's.
const CEILING_BEAMS: usize = 5;
const CEILING_SHARE: f64 = 0.1;
/// Highest digits of 8 and 16 bit (10-lms5xx), which need no repetition.
const CEILINGS: [f32; 3] = [254.0, 255.0, 65534.0];
/// A - B must stand out of its own uncertainty by this factor.
const CONTRAST_SIGMAS: f64 = 8.0;
/// An edge may lie outside its interval by this many spot radii (the hit threshold is not known
/// better) and this many sigma.
const OUTSIDE_SPOTS: f64 = 0.5;
const OUTSIDE_SIGMAS: f64 = 4.0;
/// On either side of an edge there is a beam no further away than so many spot radii and beams.
const CLOSE_SPOTS: f64 = 1.0;
const CLOSE_BEAMS: f64 = 1.6;
/// Mean squared normalised residual of the beams at an edge above which the model does not hold.
const NEAR_CHI2_MAX: f64 = 6.0;

/// A relative noise learned from residuals.
#[derive(Clone, Copy, Debug)]
struct Noise {
    sum: f64,
    beams: f64,
}

impl Noise {
    fn new(sigma: f64) -> Noise {
        Noise {
            sum: sigma * sigma * NOISE_BEAMS,
            beams: NOISE_BEAMS,
        }
    }

    fn sigma(&self) -> f64 {
        (self.sum / self.beams).sqrt().max(NOISE_FLOOR)
    }

    fn learn(&mut self, (sum, beams): (f64, f64)) {
        if sum.is_finite() && beams > 0.0 {
            self.sum = (self.sum + sum).max(0.0);
            self.beams += beams;
            let forget = (MEMORY_BEAMS / self.beams).min(1.0);
            self.sum *= forget;
            self.beams *= forget;
        }
    }
}

/// Turns intervals into sub-beam edges.
#[derive(Clone, Debug)]
pub(super) struct Photometer {
    spot: Spot,
    noise: [Noise; 2],
    /// Sum of information and of information times value, of p.
    exponent: (f64, f64),
    samples: Vec<Sample>,
}

/// The scan and what is known of it.
pub(super) struct View<'a> {
    pub scan: &'a Scan,
    pub table: &'a BeamTable,
    pub planes: &'a Planes,
    pub beams: &'a [Beam],
    pub lines: &'a ReflectorLines,
    pub pose: &'a ScannerPose,
}

impl Photometer {
    pub(super) fn new(frame: &Frame) -> Photometer {
        Photometer {
            spot: Spot::new(frame),
            noise: [Noise::new(NOISE), Noise::new(1.5 * NOISE)],
            exponent: (0.0, 0.0),
            samples: Vec::new(),
        }
    }

    /// p and its standard deviation as the scans so far tell them.
    fn exponent(&self) -> (f64, f64) {
        let prior = 1.0 / (EXPONENT.1 * EXPONENT.1);
        let information = self.exponent.0 + prior;
        let mean = (self.exponent.1 + prior * EXPONENT.0) / information;
        (mean, (1.0 / information.sqrt()).max(EXPONENT_FLOOR))
    }

    /// Gives the edges their sub-beam estimates where the remissions allow it, and the word why
    /// where they do not.
    pub(super) fn measure(&mut self, frame: &Frame, view: &View<'_>, found: &mut [Found]) {
        let scan = view.scan;
        if scan.remissions.len() != scan.beams() {
            return;
        }
        let basis = if scan.further_remissions.is_empty() {
            EdgeBasis::Remission
        } else {
            EdgeBasis::Echoes
        };
        let ceiling = ceiling(&scan.remissions);
        // What a scan teaches is for those that follow.
        let exponent = self.exponent();
        let noise = self.noise.map(|n| n.sigma());
        let mut scatter = [(0.0, 0.0); 2];
        let mut exponent_learned = (0.0, 0.0);
        for first in 0..found.len() {
            let Some(window) = self.window(frame, view, found, first) else {
                continue;
            };
            match self.fit(view, &window, found, ceiling, exponent, noise) {
                Ok(fit) => {
                    for (sum, own) in scatter.iter_mut().zip(fit.scatter) {
                        sum.0 += own.0;
                        sum.1 += own.1;
                    }
                    let (own, information) = fit.exponent;
                    exponent_learned.0 += information;
                    exponent_learned.1 += information * own;
                    accept(&fit, basis, &window, found);
                }
                Err(basis) => {
                    for k in window.edges.into_iter().flatten() {
                        found[k].edge.basis = basis;
                    }
                }
            }
        }
        for (noise, scatter) in self.noise.iter_mut().zip(scatter) {
            noise.learn(scatter);
        }
        self.exponent = (
            self.exponent.0 * EXPONENT_KEPT + exponent_learned.0,
            self.exponent.1 * EXPONENT_KEPT + exponent_learned.1,
        );
    }

    /// The window of the strip that an edge belongs to; none where it belongs to none, or to one
    /// that an edge before it belongs to.
    fn window(
        &self,
        frame: &Frame,
        view: &View<'_>,
        found: &[Found],
        first: usize,
    ) -> Option<Window> {
        let edge = &found[first].edge;
        let strip = frame.strips.get(usize::try_from(edge.strip).ok()?)?;
        let same = |f: &Found| f.edge.face == edge.face && f.edge.strip == edge.strip;
        if found[..first].iter().any(same) {
            return None;
        }
        let second = (first + 1..found.len()).find(|k| same(&found[*k]));
        let edges = [Some(first), second];
        Some(Window::new(self, view, found, edges, strip.slope()))
    }

    /// Fits the edges of a strip; or the word why there is nothing to be had.
    fn fit(
        &mut self,
        view: &View<'_>,
        window: &Window,
        found: &[Found],
        ceiling: Option<f32>,
        exponent: (f64, f64),
        noise: [f64; 2],
    ) -> Result<StripFit, EdgeBasis> {
        let levels = self.gather(view, window, ceiling)?;
        let edge = |k: usize| &found[k].edge;
        let start = Start {
            edges_rad: window
                .edges
                .map(|e| e.map(|k| 0.5 * (edge(k).from_rad + edge(k).to_rad))),
            levels,
            reach_rad: window.edges.map(|e| {
                let wide_rad = e.map_or(0.0, |k| edge(k).to_rad - edge(k).from_rad);
                wide_rad + 1.0 / window.slant.spots_per_rad
            }),
            exponent,
            noise,
        };
        photometry::fit(&self.samples, &start)
            .filter(stands_out)
            .ok_or(EdgeBasis::Ambiguous)
    }

    /// Collects the samples of a window; returns the levels to start from, or why there is nothing
    /// to fit.
    fn gather(
        &mut self,
        view: &View<'_>,
        window: &Window,
        ceiling: Option<f32>,
    ) -> Result<[f64; 2], EdgeBasis> {
        self.samples.clear();
        let echoes = Echoes::of(view.scan);
        let (mut at_ceiling, mut on_strip) = (0u32, 0u32);
        let (mut strip, mut behind) = ((0.0, 0.0), (0.0, 0.0));
        let mut ln_cos_strip = 0.0;
        for i in window.beams() {
            let beam = &view.beams[i];
            if beam.face != window.face {
                continue;
            }
            let place = window.place(i);
            let usable = match place {
                Place::Strip => beam.state == State::Hit,
                Place::Behind => beam.state == State::Gap,
                Place::Near => beam.state != State::Unknown,
            };
            let first = view.scan.remissions[i];
            if !(usable && first > 0.0) {
                continue;
            }
            if matches!(beam.state, State::Hit | State::Both) {
                on_strip += 1;
                if ceiling.is_some_and(|c| first >= c) {
                    at_ceiling += 1;
                }
            }
            let cos_incidence = view.planes.cos_incidence(beam.face, view.table, i);
            let Some(measured) = Measured::of(beam, cos_incidence, f64::from(first), echoes, i)
            else {
                continue;
            };
            if place == Place::Strip {
                strip = (strip.0 + measured.value, strip.1 + 1.0);
                ln_cos_strip += measured.ln_cos;
            } else if place == Place::Behind {
                behind = (behind.0 + measured.value, behind.1 + 1.0);
            }
            self.samples.push(Sample {
                angle_rad: view.table.seen_rad(i, beam.face_m),
                spots_per_rad: window.slant.across * beam.face_m / self.spot.radius_m(beam.face_m),
                light: measured.light,
                value: measured.value,
                rounding: measured.rounding,
                ln_cos: measured.ln_cos,
            });
        }
        if f64::from(at_ceiling) > CEILING_SHARE * f64::from(on_strip) {
            return Err(EdgeBasis::Saturated);
        }
        if strip.1 < 1.0 || behind.1 < 2.0 {
            return Err(EdgeBasis::Interval);
        }
        // Levels are those at the middle of the strip, so that they hardly hang together with p.
        let reference = ln_cos_strip / strip.1;
        for sample in &mut self.samples {
            if sample.light != Light::Ratio {
                sample.ln_cos -= reference;
            }
        }
        Ok([strip.0 / strip.1, behind.0 / behind.1])
    }
}

/// Whether strip and background differ by more than is not known of the two.
fn stands_out(fit: &StripFit) -> bool {
    (fit.levels[0] - fit.levels[1]).abs() > CONTRAST_SIGMAS * fit.contrast_sigma
}

/// Ranges and remissions of a scan's second echoes, where it has any.
#[derive(Clone, Copy)]
struct Echoes<'a> {
    first_m: &'a [f64],
    second_m: &'a [f64],
    remissions: &'a [f32],
}

impl<'a> Echoes<'a> {
    fn of(scan: &'a Scan) -> Option<Echoes<'a>> {
        let (second_m, remissions) = (
            scan.further_ranges_m.first()?,
            scan.further_remissions.first()?,
        );
        (remissions.len() == scan.beams() && second_m.len() == scan.beams()).then_some(Echoes {
            first_m: &scan.ranges_m,
            second_m,
            remissions,
        })
    }
}

/// What a beam's light says.
struct Measured {
    light: Light,
    value: f64,
    rounding: f64,
    ln_cos: f64,
}

impl Measured {
    /// None where the light cannot be laid to strip and background.
    fn of(
        beam: &Beam,
        [on_face, on_behind]: [f64; 2],
        digits: f64,
        echoes: Option<Echoes<'_>>,
        i: usize,
    ) -> Option<Measured> {
        // Remissions are brought to a common range; the surface is the one whose range came back.
        let corrected =
            |digits: f64, behind_m: f64| digits * ((beam.face_m + behind_m) / REFERENCE_M).sqrt();
        if let Some(echoes) = echoes {
            let value = corrected(digits, beam.excess_m);
            let single = |light: Light, cos: f64| Measured {
                light,
                value,
                rounding: Sample::rounding(value, digits),
                ln_cos: cos.ln(),
            };
            return match beam.state {
                State::Hit => Some(single(Light::Strip, on_face)),
                State::Gap if on_behind.is_nan() => None,
                State::Gap => Some(single(Light::Behind, on_behind)),
                State::Both => {
                    let second = f64::from(echoes.remissions[i]);
                    let behind_m = beam.excess_m + echoes.second_m[i] - echoes.first_m[i];
                    let far_enough = behind_m > 0.5 * beam.depth_m;
                    (second > 0.0 && far_enough && !on_behind.is_nan()).then(|| Measured {
                        light: Light::Ratio,
                        value: (value / corrected(second, behind_m)).ln(),
                        rounding: Sample::rounding(1.0, digits)
                            .hypot(Sample::rounding(1.0, second)),
                        ln_cos: (on_face / on_behind).ln(),
                    })
                }
                // Two echoes that ran into one.
                State::Mixed | State::Unknown => None,
            };
        }
        let towards = beam.excess_m / beam.depth_m;
        // Where two surfaces behind are as near, nobody knows which: then they differ.
        let differ = !((on_behind / on_face - 1.0).abs() < SAME_INCIDENCE);
        let doubtful = (towards - 0.5).abs() < DOUBTFUL || on_behind.is_nan();
        if beam.state == State::Mixed && differ && doubtful {
            return None;
        }
        let surface = if beam.state == State::Hit || towards < 0.5 {
            on_face
        } else {
            on_behind
        };
        let value = corrected(digits, beam.excess_m);
        (value + surface).is_finite().then(|| Measured {
            light: Light::Whole,
            value,
            rounding: Sample::rounding(value, digits),
            ln_cos: surface.ln(),
        })
    }
}

/// Puts a fit's edges into the record where they pass.
fn accept(fit: &StripFit, basis: EdgeBasis, window: &Window, found: &mut [Found]) {
    let mut both = true;
    for (k, index) in window.edges.into_iter().enumerate() {
        let Some(index) = index else {
            both = false;
            continue;
        };
        let edge = &mut found[index].edge;
        let sigma_rad = fit.covariance[k][k].sqrt();
        let spare_rad = OUTSIDE_SPOTS / window.slant.spots_per_rad + OUTSIDE_SIGMAS * sigma_rad;
        let at = fit.edges_rad[k];
        let fits = at > edge.from_rad - spare_rad && at < edge.to_rad + spare_rad;
        // An interval can say more than too few beams.
        let reach_rad =
            CLOSE_SPOTS / window.slant.spots_per_rad + CLOSE_BEAMS * window.increment_rad;
        let framed = fit.closest_rad[k].iter().all(|c| *c < reach_rad);
        let sharper = sigma_rad < 0.5 * (edge.to_rad - edge.from_rad);
        if sigma_rad.is_finite() && fits && framed && sharper && fit.near_chi2[k] < NEAR_CHI2_MAX {
            edge.edge_rad = at;
            edge.sigma_rad = sigma_rad;
            edge.d_footprint = fit.d_footprint[k];
            edge.basis = basis;
        } else {
            // Where no usable beam touches the edge, nothing was asked of the remissions.
            if fit.near[k] > 0 {
                edge.basis = EdgeBasis::Ambiguous;
            }
            both = false;
        }
    }
    if let ([Some(first), Some(second)], true) = (window.edges, both)
        && second == first + 1
    {
        found[first].edge.cov_next_rad2 = fit.covariance[0][1];
    }
}

/// Where a beam lies in a strip's window.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Place {
    Strip,
    Behind,
    /// An edge may cut its spot.
    Near,
}

/// The beams about a strip.
struct Window {
    face: u8,
    /// Indices of its edges among the found ones, in beam order.
    edges: [Option<usize>; 2],
    /// First and last beam.
    ends: [usize; 2],
    /// Beams that each edge's spot may reach, first and last.
    near: [Option<(usize, usize)>; 2],
    slant: Slant,
    increment_rad: f64,
}

impl Window {
    fn new(
        meter: &Photometer,
        view: &View<'_>,
        found: &[Found],
        edges: [Option<usize>; 2],
        slope: f64,
    ) -> Window {
        let first = edges[0].or(edges[1]).unwrap_or_default();
        let edge = &found[first].edge;
        // An edge of kind off alone has the strip before it.
        let edges = match edges {
            [Some(only), None] if edge.kind == EdgeKind::Off => [None, Some(only)],
            other => other,
        };
        let face = edge.face as u8;
        let slant = |e: &Edge| Slant::new(&meter.spot, view.pose, view.lines, e, slope);
        let increment_rad = view.table.increment_rad();
        let spot_beams = |slant: &Slant| {
            let beams = 1.2 / (slant.spots_per_rad * increment_rad);
            beams.ceil().clamp(1.0, 1e3) as usize
        };
        let last_beam = view.scan.beams() - 1;
        let near = |k: usize, slant: &Slant| {
            let spot = spot_beams(slant);
            let (before, behind) = found[k].beams;
            (before.saturating_sub(spot), (behind + spot).min(last_beam))
        };
        let own = slant(edge);
        let near = edges.map(|k| match k {
            Some(k) if k == first => Some(near(k, &own)),
            Some(k) => Some(near(k, &slant(&found[k].edge))),
            None => None,
        });
        // Up to the next thing on the face.
        let lead = edges.iter().flatten().min().copied().unwrap_or(first);
        let trail = edges.iter().flatten().max().copied().unwrap_or(first);
        let spot = spot_beams(&own);
        let low = match lead.checked_sub(1).map(|k| &found[k]) {
            Some(f) if f.edge.face == edge.face => f.beams.1 + spot,
            _ => 0,
        };
        let high = match found.get(trail + 1) {
            Some(f) if f.edge.face == edge.face => f.beams.0.saturating_sub(spot),
            _ => last_beam,
        };
        let start = match near[0] {
            Some((start, _)) => start.saturating_sub(OUTSIDE),
            None => near[1].map_or(0, |(start, _)| start.saturating_sub(INSIDE)),
        };
        let end = match near[1] {
            Some((_, end)) => end + OUTSIDE,
            None => near[0].map_or(0, |(_, end)| end + INSIDE),
        };
        Window {
            face,
            edges,
            ends: [start.max(low), end.min(high).min(last_beam)],
            near,
            slant: own,
            increment_rad,
        }
    }

    /// The beams: near the edges, and some on either side.
    fn beams(&self) -> impl Iterator<Item = usize> {
        let [start, end] = self.ends;
        let (left, right) = match self.near {
            [Some((_, left)), Some((right, _))] => (left + INSIDE, right.saturating_sub(INSIDE)),
            _ => (end, start),
        };
        (start..=end).filter(move |i| *i <= left || *i >= right)
    }

    fn place(&self, i: usize) -> Place {
        let [first, second] = self.near;
        for (from, to) in [first, second].into_iter().flatten() {
            if (from..=to).contains(&i) {
                return Place::Near;
            }
        }
        let before = first.is_some_and(|(from, _)| i < from);
        let behind = second.is_some_and(|(_, to)| i > to);
        if before || behind {
            Place::Behind
        } else {
            Place::Strip
        }
    }
}

/// The digit at which the device's remissions end, if beams are there.
fn ceiling(remissions: &[f32]) -> Option<f32> {
    let top = highest(remissions);
    let at_top = remissions.iter().filter(|r| **r == top).count();
    if CEILINGS.contains(&top) {
        return (at_top >= 2).then_some(top);
    }
    if at_top < CEILING_BEAMS || top <= 30.0 {
        return None;
    }
    // Digits so coarse that many beams share one are no ceiling: then the next lower is common too.
    let below = top * 0.97;
    let close = remissions
        .iter()
        .filter(|r| **r < top && **r >= below)
        .count();
    (at_top > 2 * close).then_some(top)
}

/// The highest of some numbers, at least 0. Eight of them are compared at a time.
fn highest(numbers: &[f32]) -> f32 {
    let mut top = [0.0f32; 8];
    let eights = numbers.chunks_exact(8);
    let rest = eights.remainder();
    for eight in eights {
        for (top, number) in top.iter_mut().zip(eight) {
            *top = if *number > *top { *number } else { *top };
        }
    }
    top.iter().chain(rest).copied().fold(0.0, f32::max)
}
