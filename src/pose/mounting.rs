//! Small turns of a device on the platform.

use nalgebra::Rotation3;

/// Roll, pitch, yaw of a mounting on P, deg, with a turn in P put before it.
pub(super) fn turned_by(turn: &Rotation3<f64>, mounting_deg: [f64; 3]) -> [f64; 3] {
    let [roll, pitch, yaw] = mounting_deg.map(f64::to_radians);
    let (roll, pitch, yaw) = (turn * Rotation3::from_euler_angles(roll, pitch, yaw)).euler_angles();
    [roll, pitch, yaw].map(f64::to_degrees)
}
