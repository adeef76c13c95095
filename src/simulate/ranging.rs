//! From what a beam meets to the ranges and remissions that a device reports.

use super::effects::{Effect, Effects};
use super::occlusion::{Obstacles, Shadow};
use super::parameters::{Diameter, Held, Parameters};
use super::random::{Draws, Purpose, Seed};
use super::remission;
use super::world::{Sight, Spot, Surface, World};
use crate::frame::{Frame, Optics, ScannerModel};
use crate::record::Face;
use nalgebra::Vector3;

/// The scanner's physics for a whole run.
#[derive(Clone, Debug)]
pub struct Physics {
    effects: Effects,
    parameters: Parameters,
    seed: Seed,
    model: &'static ScannerModel,
    world: World,
    spot: Spot,
    /// Constant error of right, upper, left and everything else, m.
    face_bias_m: [f64; 4],
}

/// What one beam reports: an echo's range as the record has it and its remission.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Echo {
    /// m; `inf` no return, `-inf` too close.
    pub range_m: f64,
    /// Digits.
    pub remission: f32,
}

/// The most echoes that a record holds.
pub const MAX_ECHOES: usize = 5;

/// One surface's part in what comes back.
#[derive(Clone, Copy, Debug)]
struct Part {
    surface: Surface,
    /// Index into the face biases.
    face: usize,
    /// Remission before noise.
    power: f64,
}

const ELSEWHERE: usize = 3;

/// Draws and obstacles of one scan.
pub struct ScanPhysics<'a> {
    physics: &'a Physics,
    obstacles: Obstacles,
    hit_threshold: f64,
    bias_m: f64,
    /// Streams of the beams' draws; none where the effect is off.
    noise: Option<Draws>,
    remission: Option<Draws>,
    mixed: Option<Draws>,
    outliers: Option<Draws>,
    dropouts: Option<Draws>,
}

impl Physics {
    /// Builds the world that the effects leave.
    pub fn new(
        frame: &Frame,
        model: &'static ScannerModel,
        effects: Effects,
        parameters: &Parameters,
        seed: Seed,
    ) -> Physics {
        let missing = if effects.has(Effect::MissingStrip) {
            missing_strips(frame, parameters, seed)
        } else {
            Vec::new()
        };
        let mut draws = seed.draws(Purpose::FaceBias, 0);
        let face_bias_m = [0; 4].map(|_| parameters.bias.face_mm * 1e-3 * draws.normal());
        Physics {
            effects,
            parameters: parameters.clone(),
            seed,
            model,
            world: World::new(frame, &missing),
            spot: spot(model, effects, parameters),
            face_bias_m,
        }
    }

    /// Draws what is drawn once a scan. `aperture_rad` is where cables may be.
    pub fn scan(&self, number: u64, aperture_rad: [f64; 2]) -> ScanPhysics<'_> {
        let p = &self.parameters;
        let mut obstacles = Obstacles::default();
        if self.effects.has(Effect::Cables) {
            let mut draws = self.seed.draws(Purpose::Cables, number);
            obstacles.add_cables(&p.cables, aperture_rad, &mut draws);
        }
        if self.effects.has(Effect::Cargo) {
            let mut draws = self.seed.draws(Purpose::Cargo, number);
            obstacles.add_cargo(&p.cargo, &mut draws);
        }
        let hit_threshold = if self.effects.has(Effect::Mixed) {
            let mut draws = self.seed.draws(Purpose::Threshold, number);
            draws.between(p.mixed.hit_threshold)
        } else {
            p.footprint.hit_threshold
        };
        let held = match p.bias.held {
            Held::Scan => number,
            Held::Run => 0,
        };
        let bias_m = if self.effects.has(Effect::Bias) {
            let half_m = p.bias.common_mm * 1e-3;
            let mut draws = self.seed.draws(Purpose::Bias, held);
            draws.between([-half_m, half_m])
        } else {
            0.0
        };
        let draws = |effect, purpose| {
            let on = self.effects.has(effect);
            on.then(|| self.seed.draws(purpose, number))
        };
        ScanPhysics {
            physics: self,
            obstacles,
            hit_threshold,
            bias_m,
            noise: draws(Effect::Noise, Purpose::Noise),
            remission: draws(Effect::Remission, Purpose::Remission),
            mixed: draws(Effect::Mixed, Purpose::Mixed),
            outliers: draws(Effect::Outliers, Purpose::Outliers),
            dropouts: draws(Effect::Dropouts, Purpose::Dropouts),
        }
    }
}

fn missing_strips(frame: &Frame, parameters: &Parameters, seed: Seed) -> Vec<usize> {
    if !parameters.missing_strip.strips.is_empty() {
        return parameters.missing_strip.strips.clone();
    }
    let mut there: Vec<usize> = frame
        .strips_on(Face::Upper)
        .map(|(index, _)| index)
        .collect();
    let mut draws = seed.draws(Purpose::MissingStrip, 0);
    let count = parameters.missing_strip.count.min(there.len());
    (0..count)
        .map(|_| there.swap_remove((draws.unit() * there.len() as f64) as usize))
        .collect()
}

fn spot(model: &ScannerModel, effects: Effects, parameters: &Parameters) -> Spot {
    if !effects.has(Effect::Footprint) {
        return Spot::Pencil;
    }
    let optics = match parameters.footprint.diameter {
        Diameter::Linear => model.optics,
        Diameter::Constant => Optics {
            spot_m: parameters.footprint.constant_mm * 1e-3,
            divergence_rad: 0.0,
        },
    };
    Spot::Disc {
        optics,
        scale: parameters.footprint.scale,
    }
}

impl ScanPhysics<'_> {
    /// What the beam from `origin_m` along the unit vector `direction` (both in B) reports, one
    /// after the other, nearest first. `angle_rad` is its true angle in the scan plane. Returns the
    /// number of echoes, at least 1.
    pub fn measure(
        &mut self,
        angle_rad: f64,
        origin_m: Vector3<f64>,
        direction: Vector3<f64>,
        echoes: &mut [Echo; MAX_ECHOES],
    ) -> usize {
        let physics = self.physics;
        let sight = self.sight(origin_m, direction);
        let shadow = if self.obstacles.is_empty() {
            None
        } else {
            self.obstacles.look(angle_rad, &physics.spot)
        };
        // Of a stream that is on every beam takes the same number of draws, so that effects stay
        // independent.
        let mixed = self.mixed.as_mut();
        let mixed = mixed.is_some_and(|draws| draws.unit() < physics.parameters.mixed.share);
        let normal = self.noise.as_mut().map_or(0.0, Draws::normal);
        let remission = self.remission.as_mut().map_or(0.0, Draws::normal);
        let mut count = 1;
        if physics.effects.has(Effect::Echoes) {
            let parts = self.all_parts(&sight, shadow, mixed);
            let most = physics.parameters.echoes.count.clamp(1, MAX_ECHOES);
            let present = parts.iter().flatten();
            count = 0;
            for (echo, part) in echoes.iter_mut().take(most).zip(present) {
                *echo = self.report(part, normal, remission);
                count += 1;
            }
            if count == 0 {
                count = 1;
                echoes[0] = NOTHING;
            }
        } else {
            echoes[0] = match self.single_part(&sight, shadow, mixed) {
                Some(part) => self.report(&part, normal, remission),
                None => NOTHING,
            };
        }
        self.spoil(&mut echoes[0], &mut count);
        count
    }

    /// What the beam meets; the background only where it has a part in the range.
    fn sight(&self, origin_m: Vector3<f64>, direction: Vector3<f64>) -> Sight {
        let physics = self.physics;
        let reflector = physics.world.reflector(origin_m, direction, &physics.spot);
        let share = reflector.map_or(0.0, |hit| hit.share);
        let hidden = share > self.hit_threshold && share >= physics.parameters.mixed.between[1];
        let background = if hidden && !physics.effects.has(Effect::Echoes) {
            None
        } else {
            physics.world.background(origin_m, direction)
        };
        Sight {
            reflector,
            background,
        }
    }

    /// The one surface whose range a device with one echo returns.
    fn single_part(&self, sight: &Sight, shadow: Option<Shadow>, mixed: bool) -> Option<Part> {
        let p = &self.physics.parameters;
        if let Some(shadow) = shadow.filter(|s| s.share > s.threshold) {
            return Some(self.shadow_part(&shadow, 1.0));
        }
        let share = sight.reflector.map_or(0.0, |hit| hit.share);
        let power = |surface: &Surface| {
            remission::level(&p.remission, surface) * remission::partial(&p.remission, share)
        };
        let background = sight.background.map(|surface| Part {
            surface,
            face: ELSEWHERE,
            power: 0.0,
        });
        let mut part = match sight.reflector {
            Some(hit) if share > self.hit_threshold => Part {
                surface: hit.surface,
                face: hit.face as usize,
                power: 0.0,
            },
            _ => background?,
        };
        if let Some(range_m) = self.mixed_range_m(sight, share, mixed) {
            part.surface.range_m = range_m;
        }
        part.power = self.level_if_needed(|| power(&part.surface));
        Some(part)
    }

    /// The range between reflector and background that a mixed beam returns.
    fn mixed_range_m(&self, sight: &Sight, share: f64, mixed: bool) -> Option<f64> {
        let [low, high] = self.physics.parameters.mixed.between;
        let concerned = mixed && share > low && share < high;
        if !concerned || !self.physics.effects.has(Effect::Mixed) {
            return None;
        }
        // The pulse's centre of gravity: each surface counts with its share of the spot.
        let (hit, behind) = (sight.reflector?, sight.background?);
        Some(share * hit.surface.range_m + (1.0 - share) * behind.range_m)
    }

    /// All surfaces with enough of the spot, nearest first.
    fn all_parts(&self, sight: &Sight, shadow: Option<Shadow>, mixed: bool) -> [Option<Part>; 3] {
        let p = &self.physics.parameters;
        let share = sight.reflector.map_or(0.0, |hit| hit.share);
        // A mixed beam's two echoes have run into one.
        let mut sight = *sight;
        if let Some(range_m) = self.mixed_range_m(&sight, share, mixed) {
            sight.background = None;
            if let Some(hit) = &mut sight.reflector {
                hit.surface.range_m = range_m;
                hit.share = 1.0;
            }
        }
        let covered = shadow.map_or(0.0, |s| s.share);
        let on_reflector = (1.0 - covered) * sight.reflector.map_or(0.0, |hit| hit.share);
        let behind = 1.0 - covered - on_reflector;
        let lit = |share: f64| share > p.echoes.share;
        let part = |surface: Surface, face: usize, power: f64| Part {
            surface,
            face,
            power: self.level_if_needed(|| remission::level(&p.remission, &surface) * power),
        };
        let mut parts = [
            shadow
                .filter(|s| lit(s.share))
                .map(|s| self.shadow_part(&s, s.share)),
            sight
                .reflector
                .filter(|_| lit(on_reflector))
                .map(|hit| part(hit.surface, hit.face as usize, on_reflector)),
            sight
                .background
                .filter(|_| lit(behind))
                .map(|surface| part(surface, ELSEWHERE, p.remission.contrast * behind)),
        ];
        parts.sort_by(|a, b| {
            let range_m = |part: &Option<Part>| part.map_or(f64::INFINITY, |p| p.surface.range_m);
            range_m(a).total_cmp(&range_m(b))
        });
        parts
    }

    fn shadow_part(&self, shadow: &Shadow, share: f64) -> Part {
        let parameters = &self.physics.parameters.remission;
        Part {
            surface: shadow.surface,
            face: ELSEWHERE,
            power: self.level_if_needed(|| {
                remission::level(parameters, &shadow.surface) * shadow.remission * share
            }),
        }
    }

    /// Powers cost time and are wanted only for remissions and what depends on them.
    fn level_if_needed(&self, power: impl FnOnce() -> f64) -> f64 {
        let effects = self.physics.effects;
        let by_remission =
            effects.has(Effect::Bias) && self.physics.parameters.bias.remission_mm != 0.0;
        if effects.has(Effect::Remission) || by_remission {
            power()
        } else {
            0.0
        }
    }

    /// A part as the device measures it.
    fn report(&self, part: &Part, normal: f64, remission_normal: f64) -> Echo {
        let physics = self.physics;
        let (p, effects) = (&physics.parameters, physics.effects);
        let true_m = part.surface.range_m;
        let mut range_m = true_m;
        if effects.has(Effect::Bias) {
            let by_remission_m = if p.bias.remission_mm == 0.0 {
                0.0
            } else {
                p.bias.remission_mm * 1e-3 * (part.power - 1.0)
            };
            range_m = range_m * p.bias.scale
                + self.bias_m
                + physics.face_bias_m.get(part.face).copied().unwrap_or(0.0)
                + by_remission_m;
        }
        if effects.has(Effect::Noise) {
            range_m += normal * self.sigma_m(true_m);
        }
        let remission = if effects.has(Effect::Remission) {
            remission::digits(&p.remission, part.power, remission_normal)
        } else {
            0.0
        };
        Echo {
            range_m: self.within_limits(self.rounded(range_m)),
            remission,
        }
    }

    fn sigma_m(&self, range_m: f64) -> f64 {
        match self.physics.parameters.noise.sigma_mm {
            Some(sigma_mm) => sigma_mm * 1e-3,
            None => self.physics.model.noise_m(range_m),
        }
    }

    /// In the device's digits, or to the micrometre that the streams carry.
    fn rounded(&self, range_m: f64) -> f64 {
        if self.physics.effects.has(Effect::Quantisation) {
            let step_mm = self.physics.parameters.quantisation.step_mm;
            (range_m * 1e3 / step_mm).round() * step_mm / 1e3
        } else {
            (range_m * 1e6).round() / 1e6
        }
    }

    fn within_limits(&self, range_m: f64) -> f64 {
        let [low, high] = self.physics.model.range_m;
        if range_m < low {
            f64::NEG_INFINITY
        } else if range_m > high {
            f64::INFINITY
        } else {
            range_m
        }
    }

    /// Wild ranges and lost beams.
    fn spoil(&mut self, first: &mut Echo, count: &mut usize) {
        let physics = self.physics;
        let p = &physics.parameters;
        let wild = self.outliers.as_mut().map(|d| (d.unit(), d.unit()));
        if let Some((_, place)) = wild.filter(|(wild, _)| *wild < p.outliers.share) {
            let low_m = physics.model.range_m[0];
            first.range_m = self.rounded(low_m + (p.outliers.range_max_m - low_m) * place);
            *count = 1;
        }
        if let Some(draws) = &mut self.dropouts
            && draws.unit() < p.dropouts.share
        {
            *first = NOTHING;
            *count = 1;
        }
    }
}

const NOTHING: Echo = Echo {
    range_m: f64::INFINITY,
    remission: 0.0,
};
