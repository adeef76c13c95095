//! The cable robot itself: eight cables that run over pulleys, the lengths that a pose asks for
//! (inverse kinematics), the pose that lengths ask for (forward kinematics), and what measured poses
//! tell of a controller that believes in wrong pulleys.
//!
//! The pulley is that of Bruckmann and others (2008): it swivels about the direction in which the
//! cable runs onto it, so that the cable leaves it in the plane of that direction and the platform's
//! anchor ([`pulley`]). Cables are straight; their own weight and the platform's are left out. Eight
//! lengths are two more than a pose needs. Where no pose has all eight, the platform takes the one at
//! which the sum of squared differences is least: that is where cables of equal stiffness, all of
//! them taut, would pull it ([`kinematics`]).
//!
//! A controller knows no lengths, only how far its winches have turned since the platform was locked
//! in its home pose ("prepare winches", Kurniawan 2017, Fig. 1.13). So what it winds is the
//! difference to the home pose, by the pulleys that it believes in ([`Winches`]); wrong pulleys do no
//! harm at home and more and more of it further away, as Table 5.1 shows.
//!
//! Poses are (x, y, z, roll, pitch, yaw), in m and rad, as in a covariance of poses.

mod calibration;
mod config;
pub mod kinematics;
mod places;
pub mod pulley;

pub use calibration::{Calibrated, CalibrationError, Coordinate, Shift, Unknown, calibrate};
pub use config::{Cable, Home, Robot};
pub use kinematics::{KinematicsError, Winches};
pub use places::{Place, Standing, places};

/// A pose: x, y, z (m), roll, pitch, yaw (rad).
pub type Pose = nalgebra::Vector6<f64>;
