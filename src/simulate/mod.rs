//! A virtual frame, scanner and IMU.
//!
//! The simulator turns beams by quaternions and meets the frame's faces with rays, plainly and for
//! any attitude and mounting; it shares no geometry with the solver, so that the two check each
//! other. A [`Simulator`] gives scan after scan with the truth at the scan's reference instant and
//! the IMU samples around it:
//!
//! - `rotation`, `world`, `coverage`: attitudes, what a beam meets, how much of its spot is on it
//! - [`scanner`]: beams, angles, firing times, modes
//! - `ranging`, `remission`, `occlusion`, `jitter`, `clock`, `inertial`: the physics of one effect each
//! - [`effects`], [`parameters`]: what is switched on and how large it is
//! - `course`: where the platform is
//! - [`random`]: independent streams of random numbers
//! - [`office`]: a floor of rooms for line extractors, which has nothing to do with the frame
//!
//! The same arguments give the same bytes: every transcendental function comes from `libm`, every
//! effect and every scan has its own stream of random numbers.

mod clock;
mod course;
mod coverage;
pub mod effects;
pub mod exchanges;
mod inertial;
mod jitter;
mod occlusion;
pub mod office;
pub mod parameters;
pub mod random;
mod ranging;
mod remission;
mod rotation;
mod run;
pub mod scanner;
mod world;

#[cfg(test)]
mod physics_tests;
#[cfg(test)]
pub(crate) mod staged;

pub use course::{Course, Grid, Places, Scatter, SharedMotion};
pub use effects::{Effect, Effects};
pub use inertial::Unit;
pub use parameters::Parameters;
pub use random::Seed;
pub use run::{Setup, Simulator, Step};
