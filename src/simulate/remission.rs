//! From what a beam meets to the digits of its remission.

use super::parameters::{Law, Remission};
use super::world::Surface;

/// Received power of a surface that fills the spot, 1 for a reflector met squarely at the
/// reference range: (r0/r)^a cos(incidence)^b.
pub fn level(parameters: &Remission, surface: &Surface) -> f64 {
    let ratio = parameters.reference_range_m / surface.range_m;
    let by_range = if parameters.range_exponent == 0.5 {
        ratio.sqrt()
    } else {
        libm::pow(ratio, parameters.range_exponent)
    };
    // A power by logarithm: half the time of `pow`, which cares for the last digit.
    by_range * libm::exp(parameters.incidence_exponent * libm::log(surface.cos_incidence))
}

/// Remission of a spot that lies on a reflector with the given share and else on background:
/// contrast + (1 - contrast) share.
pub fn partial(parameters: &Remission, share: f64) -> f64 {
    parameters.contrast + (1.0 - parameters.contrast) * share
}

/// Digits of a power, `normal` being the beam's draw of the noise.
pub fn digits(parameters: &Remission, power: f64, normal: f64) -> f32 {
    let noisy = power * (1.0 + parameters.noise * normal);
    let value = match parameters.law {
        Law::Linear => parameters.digits * noisy,
        Law::Logarithmic if noisy > 0.0 => {
            parameters.digits * (1.0 + libm::log(noisy) / libm::log(parameters.span))
        }
        Law::Logarithmic => 0.0,
    };
    value
        .round()
        .clamp(0.0, parameters.ceiling.unwrap_or(f64::from(u32::MAX))) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_reference_law() {
        let parameters = Remission::default();
        let surface = Surface {
            range_m: 5.3,
            cos_incidence: 0.62,
        };
        let expected = (3.0f64 / 5.3).powf(0.5) * 0.62f64.powf(0.3) * (0.35 + 0.65 * 0.4);
        let power = level(&parameters, &surface) * partial(&parameters, 0.4);
        assert!((power - expected).abs() < 1e-12);
        assert_eq!(
            digits(&parameters, power, 0.0),
            (150.0 * expected).round() as f32
        );
        let noisy = digits(&parameters, power, 1.5);
        assert_eq!(noisy, (150.0 * expected * 1.06).round() as f32);
    }

    #[test]
    fn ceiling_and_logarithm() {
        let mut parameters = Remission {
            ceiling: Some(254.0),
            digits: 1270.0,
            noise: 0.0,
            ..Remission::default()
        };
        assert_eq!(digits(&parameters, 1.0, 0.0), 254.0);
        assert_eq!(digits(&parameters, 0.1, 0.0), 127.0);
        parameters.law = Law::Logarithmic;
        parameters.digits = 200.0;
        assert_eq!(digits(&parameters, 1.0, 0.0), 200.0);
        assert_eq!(digits(&parameters, 0.1, 0.0), 100.0);
        assert_eq!(digits(&parameters, 0.001, 0.0), 0.0);
        assert_eq!(digits(&parameters, 0.0, 0.0), 0.0);
    }
}
