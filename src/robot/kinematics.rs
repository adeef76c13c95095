//! Cable lengths of a pose, the pose of cable lengths, and where winches put a platform.

use super::pulley::{Span, span};
use super::{Cable, Pose, Robot};
use crate::frame::euler_to_fixed_axes;
use nalgebra::{Matrix3, Matrix6, Vector3, Vector6};

/// Why lengths or a pose cannot be had.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum KinematicsError {
    /// An anchor within its pulley or straight along the pulley's axis.
    #[error("cable {cable} cannot reach its anchor: it lies within the pulley or on its axis")]
    Reach {
        /// Name of the cable, or its number.
        cable: String,
    },
    /// Another number of lengths than of cables.
    #[error("{lengths} lengths are given for {cables} cables")]
    Count {
        /// Lengths given.
        lengths: usize,
        /// Cables of the robot.
        cables: usize,
    },
    /// The cables leave a direction free.
    #[error("the cables do not hold the platform in every direction at this pose")]
    Loose,
    /// The search did not end.
    #[error("no pose was found for these lengths; the last one is off by {rms_m} m rms")]
    Search {
        /// Root mean square of what is left of the lengths, m.
        rms_m: f64,
    },
}

/// Where lengths put the platform.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Forward {
    /// The pose at which the sum of squared length differences is least.
    pub pose: Pose,
    /// Root mean square of those differences, m: 0 where the lengths agree.
    pub rms_m: f64,
}

/// Half the difference that second derivatives are taken over: m and rad.
const DIFFERENCE: f64 = 1e-5;
/// Steps of the search, and halvings of one step.
const STEPS: usize = 100;
const HALVINGS: usize = 40;
/// A step this small ends the search: m and rad. Lengths of ten metres have digits of 2e-15 m, which
/// the least stiff direction makes a hundred times larger.
const SMALL: f64 = 1e-12;
/// The search is good where it cannot get below that, but to here.
const GOOD: f64 = 1e-10;

/// R = Rz(yaw) Ry(pitch) Rx(roll), by libm: the same digits on every machine.
fn turned(pose: &Pose) -> Matrix3<f64> {
    let ([sr, sp, sy], [cr, cp, cy]) = (
        [pose[3], pose[4], pose[5]].map(libm::sin),
        [pose[3], pose[4], pose[5]].map(libm::cos),
    );
    Matrix3::new(
        cy * cp,
        cy * sp * sr - sy * cr,
        cy * sp * cr + sy * sr,
        sy * cp,
        sy * sp * sr + cy * cr,
        sy * sp * cr - cy * sr,
        -sp,
        cp * sr,
        cp * cr,
    )
}

impl Robot {
    /// Inverse kinematics: the cables' lengths, m, in the file's order.
    ///
    /// # Errors
    /// [`KinematicsError::Reach`].
    pub fn lengths(&self, pose: &Pose) -> Result<Vec<f64>, KinematicsError> {
        Ok(self.spans(pose)?.iter().map(|s| s.length_m).collect())
    }

    /// How the lengths change with x, y, z, roll, pitch, yaw: one row a cable. Its transpose, but
    /// for the angles' axes, is the structure matrix that turns cable forces into a wrench.
    ///
    /// # Errors
    /// [`KinematicsError::Reach`].
    pub fn jacobian(&self, pose: &Pose) -> Result<Vec<Vector6<f64>>, KinematicsError> {
        let spans = self.spans(pose)?;
        Ok(self.rows(pose, &spans).collect())
    }

    /// Forward kinematics: the pose that eight (or more than five) lengths ask for, searched from
    /// `start` by Newton's steps. Where they contradict each other, the pose that cables of
    /// equal stiffness, all taut, would pull the platform to.
    ///
    /// # Errors
    /// Where cables do not reach, or leave a direction free, or no pose is found from `start`.
    pub fn forward(&self, lengths_m: &[f64], start: &Pose) -> Result<Forward, KinematicsError> {
        if lengths_m.len() != self.cables.len() {
            return Err(KinematicsError::Count {
                lengths: lengths_m.len(),
                cables: self.cables.len(),
            });
        }
        let mut pose = *start;
        let mut spans = self.spans(&pose)?;
        let mut cost = cost(&spans, lengths_m);
        if !cost.is_finite() {
            return Err(KinematicsError::Search { rms_m: cost });
        }
        let mut last = f64::INFINITY;
        for _ in 0..STEPS {
            let mut normal = Matrix6::zeros();
            let mut slope = Vector6::zeros();
            for ((row, span), length_m) in self.rows(&pose, &spans).zip(&spans).zip(lengths_m) {
                normal += row * row.transpose();
                slope -= row * (span.length_m - length_m);
            }
            // Contradictions bend the cost more than the soft direction's stiffness does: Gauss and
            // Newton's steps alone would creep. Far off, the whole curvature may not be convex.
            let whole = normal + self.bend(&pose, &spans, lengths_m)?;
            let factor = whole.cholesky().or_else(|| normal.cholesky());
            let factor = factor.ok_or(KinematicsError::Loose)?;
            let mut step = factor.solve(&slope);
            if !(step.amax() < 1e6) {
                return Err(KinematicsError::Loose);
            }
            let mut halvings = 0;
            let tried = loop {
                let next = pose + step;
                match self.spans(&next) {
                    Ok(spans) if self::cost(&spans, lengths_m) <= cost => {
                        break Some((next, spans));
                    }
                    // A step to where the cost only rounds up is the end, not too long a step.
                    _ if step.amax() < SMALL || halvings == HALVINGS => break None,
                    _ => {
                        step *= 0.5;
                        halvings += 1;
                    }
                }
            };
            let Some((next, there)) = tried else {
                return Ok(self.found(pose, cost));
            };
            (pose, spans) = (next, there);
            cost = self::cost(&spans, lengths_m);
            last = step.amax();
            if last < SMALL {
                return Ok(self.found(pose, cost));
            }
        }
        let found = self.found(pose, cost);
        if last < GOOD {
            Ok(found)
        } else {
            Err(KinematicsError::Search { rms_m: found.rms_m })
        }
    }

    /// The part of the cost's curvature that Gauss and Newton's leaves out: the sum over the cables of
    /// what its length is off by times its second derivatives, by central differences of the Jacobian.
    fn bend(
        &self,
        pose: &Pose,
        spans: &[Span],
        lengths_m: &[f64],
    ) -> Result<Matrix6<f64>, KinematicsError> {
        let off: Vec<f64> = spans
            .iter()
            .zip(lengths_m)
            .map(|(s, l)| s.length_m - l)
            .collect();
        let slope = |pose: &Pose| -> Result<Vector6<f64>, KinematicsError> {
            let spans = self.spans(pose)?;
            Ok(self
                .rows(pose, &spans)
                .zip(&off)
                .map(|(row, off)| row * *off)
                .sum())
        };
        let mut bend = Matrix6::zeros();
        for k in 0..6 {
            let h = Pose::ith(k, DIFFERENCE);
            let column = (slope(&(pose + h))? - slope(&(pose - h))?) / (2.0 * DIFFERENCE);
            bend.set_column(k, &column);
        }
        Ok((bend + bend.transpose()) * 0.5)
    }

    /// Whether all cables reach and hold the platform in a pose.
    pub(super) fn check_pose(&self, pose: &Pose) -> Result<(), KinematicsError> {
        let lengths = self.lengths(pose)?;
        self.forward(&lengths, pose).map(|_| ())
    }

    fn found(&self, pose: Pose, cost: f64) -> Forward {
        Forward {
            pose,
            rms_m: (cost / self.cables.len() as f64).sqrt(),
        }
    }

    fn spans(&self, pose: &Pose) -> Result<Vec<Span>, KinematicsError> {
        let turn = turned(pose);
        let origin = Vector3::new(pose[0], pose[1], pose[2]);
        let one = |(number, cable): (usize, &Cable)| {
            let anchor = origin + turn * Vector3::from(cable.anchor_m);
            let found = span(
                cable.pulley_m.into(),
                cable.axis.into(),
                self.pulley_radius_m,
                anchor,
            );
            found.ok_or_else(|| KinematicsError::Reach {
                cable: match cable.name.as_str() {
                    "" => number.to_string(),
                    name => format!("\"{name}\""),
                },
            })
        };
        self.cables.iter().enumerate().map(one).collect()
    }

    /// The Jacobian's rows. A turn about an axis w of B moves an anchor at R b by w x R b.
    fn rows<'a>(
        &'a self,
        pose: &Pose,
        spans: &'a [Span],
    ) -> impl Iterator<Item = Vector6<f64>> + 'a {
        let turn = turned(pose);
        let axes = euler_to_fixed_axes([pose[3], pose[4], pose[5]]);
        self.cables.iter().zip(spans).map(move |(cable, span)| {
            let arm = turn * Vector3::from(cable.anchor_m);
            let angles = axes.transpose() * arm.cross(&span.direction);
            let d = span.direction;
            Vector6::new(d.x, d.y, d.z, angles.x, angles.y, angles.z)
        })
    }
}

fn cost(spans: &[Span], lengths_m: &[f64]) -> f64 {
    let difference = |(span, length_m): (&Span, &f64)| (span.length_m - length_m).powi(2);
    spans.iter().zip(lengths_m).map(difference).sum()
}

/// A robot as its controller believes it to be, and as it is.
#[derive(Clone, Debug, PartialEq)]
pub struct Winches {
    /// What the controller winds cables by.
    pub belief: Robot,
    /// What holds the platform.
    pub real: Robot,
}

impl Winches {
    /// The lengths that the cables really have when the controller wants `desired`, m: by the home
    /// pose of the belief, in which the platform is locked when the winches are prepared, and the
    /// difference that the controller winds; without a home the whole lengths that it believes in.
    ///
    /// # Errors
    /// [`KinematicsError::Reach`], or robots of different numbers of cables.
    pub fn lengths(&self, desired: &Pose) -> Result<Vec<f64>, KinematicsError> {
        if self.belief.cables.len() != self.real.cables.len() {
            return Err(KinematicsError::Count {
                lengths: self.belief.cables.len(),
                cables: self.real.cables.len(),
            });
        }
        let mut lengths = self.belief.lengths(desired)?;
        if let Some(home) = &self.belief.home {
            let home = home.pose();
            let (locked, believed) = (self.real.lengths(&home)?, self.belief.lengths(&home)?);
            for ((length, locked), believed) in lengths.iter_mut().zip(locked).zip(believed) {
                *length += locked - believed;
            }
        }
        Ok(lengths)
    }

    /// Where the platform goes when the controller wants it at `desired`.
    ///
    /// # Errors
    /// As [`Robot::forward`].
    pub fn goes(&self, desired: &Pose) -> Result<Forward, KinematicsError> {
        self.real.forward(&self.lengths(desired)?, desired)
    }
}

#[cfg(test)]
mod tests {
    use super::super::config::tests::cablar;
    use super::*;
    use proptest::prelude::*;

    fn some_pose() -> impl Strategy<Value = Pose> {
        let ranges = (
            -0.1..0.1f64,
            -4.0..4.0f64,
            0.465..4.0f64,
            -0.1..0.1f64,
            -0.1..0.1f64,
            -0.1..0.1f64,
        );
        ranges.prop_map(|(x, y, z, roll, pitch, yaw)| Pose::new(x, y, z, roll, pitch, yaw))
    }

    fn raised(by_m: f64) -> Robot {
        let mut robot = cablar();
        for cable in robot.cables.iter_mut().filter(|c| c.group == "upper") {
            cable.pulley_m[2] += by_m;
        }
        robot
    }

    proptest! {
        /// From a start 0.2 m and 3 deg away.
        #[test]
        fn forward_undoes_inverse(pose in some_pose()) {
            let robot = cablar();
            let lengths = robot.lengths(&pose).unwrap();
            let start = pose + Pose::new(0.05, 0.2, -0.15, 0.05, -0.03, 0.05);
            let found = robot.forward(&lengths, &start).unwrap();
            prop_assert!((found.pose - pose).amax() < 1e-9, "{found:?} {pose:?}");
            prop_assert!(found.rms_m < 1e-10);
        }

        #[test]
        fn the_jacobian_is_the_finite_difference(pose in some_pose()) {
            let robot = cablar();
            let rows = robot.jacobian(&pose).unwrap();
            let h = 1e-6;
            for k in 0..6 {
                let step = Pose::ith(k, h);
                let above = robot.lengths(&(pose + step)).unwrap();
                let below = robot.lengths(&(pose - step)).unwrap();
                for ((row, a), b) in rows.iter().zip(above).zip(below) {
                    prop_assert!((row[k] - (a - b) / (2.0 * h)).abs() < 1e-7, "{k}");
                }
            }
        }

        /// Where lengths contradict each other, no pose nearby is better.
        #[test]
        fn the_pose_of_contradicting_lengths_is_a_least_squares_one(
            pose in some_pose(),
            off in proptest::array::uniform8(-0.02..0.02f64),
        ) {
            let robot = cablar();
            let lengths: Vec<f64> =
                robot.lengths(&pose).unwrap().iter().zip(off).map(|(l, o)| l + o).collect();
            let found = robot.forward(&lengths, &pose).unwrap();
            let cost = |pose: &Pose| -> f64 {
                robot.lengths(pose).unwrap().iter().zip(&lengths).map(|(a, b)| (a - b).powi(2)).sum()
            };
            let least = cost(&found.pose);
            for k in 0..6 {
                for step in [-1e-4, 1e-4] {
                    prop_assert!(cost(&(found.pose + Pose::ith(k, step))) > least);
                }
            }
            prop_assert!((found.rms_m - (least / 8.0).sqrt()).abs() < 1e-12);
        }
    }

    #[test]
    fn a_true_belief_puts_the_platform_where_it_is_wanted() {
        let winches = Winches {
            belief: cablar(),
            real: cablar(),
        };
        let desired = Pose::new(0.0, 2.0, 1.75, 0.03, 0.0, 0.0);
        let found = winches.goes(&desired).unwrap();
        assert!((found.pose - desired).amax() < 1e-9);
    }

    /// Table 5.1's pattern: nothing at home, lower than wanted above it, and more so the higher it is;
    /// without a home pose the whole platform hangs higher.
    #[test]
    fn pulleys_higher_than_believed_lower_the_platform_away_from_home() {
        let mut winches = Winches {
            belief: cablar(),
            real: raised(0.05),
        };
        let home = winches.belief.home.unwrap().pose();
        assert!((winches.goes(&home).unwrap().pose - home).amax() < 1e-9);
        let height = |winches: &Winches, z: f64| {
            let desired = Pose::new(0.0, 0.0, z, 0.0, 0.0, 0.0);
            winches.goes(&desired).unwrap().pose[2] - z
        };
        let heights = [0.765, 1.75, 2.0, 2.5].map(|z| height(&winches, z));
        assert!(heights.is_sorted_by(|a, b| a > b), "{heights:?}");
        assert!(heights[0] < -0.0005 && heights[3] < -0.005, "{heights:?}");
        winches.belief.home = None;
        assert!(height(&winches, 2.0) > 0.01);
    }

    #[test]
    fn what_makes_no_sense_is_refused() {
        let robot = cablar();
        let pose = Pose::new(0.0, 0.0, 2.0, 0.0, 0.0, 0.0);
        let few = robot.forward(&[1.0; 7], &pose);
        assert_eq!(
            few,
            Err(KinematicsError::Count {
                lengths: 7,
                cables: 8
            })
        );
        let mut flat = robot.clone();
        for cable in &mut flat.cables {
            // All in the plane x = 0: nothing holds the platform along x.
            (cable.pulley_m[0], cable.anchor_m[0]) = (0.0, 0.0);
        }
        let lengths = flat.lengths(&pose).unwrap();
        assert_eq!(flat.forward(&lengths, &pose), Err(KinematicsError::Loose));
        let nowhere = Pose::new(f64::NAN, 0.0, 2.0, 0.0, 0.0, 0.0);
        assert!(matches!(
            robot.lengths(&nowhere),
            Err(KinematicsError::Reach { .. })
        ));
        let mut never = robot.lengths(&pose).unwrap();
        never[0] = f64::NAN;
        assert!(robot.forward(&never, &pose).is_err());
    }
}
