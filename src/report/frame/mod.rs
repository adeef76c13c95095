//! What a frame file allows, before anything is built: the frame drawn, its reflectors checked, how
//! much of them a scan shows over the workspace, and how well such scans could tell the pose.
//!
//! The prediction itself (the information in a scan) is the estimator's business and comes in as
//! numbers; the wiring has it made. What is checked here is the frame's geometry alone.

mod figures;
mod outputs;
mod page;
pub(super) mod view;

pub use figures::figures;
pub use outputs::{json, table};
pub(super) use outputs::{statistic, statistic_exists};
pub use page::page;
pub use view::{Beams, Seen, seen};

use super::number::fixed;
use super::workspace::{Cells, Layout};
use crate::frame::Frame;
use crate::record::Face;

/// Fewest beams on a face's reflectors that make a line.
const FEW: u32 = 8;
/// Edges that x and yaw need for some redundancy.
const ENOUGH_EDGES: u32 = 4;

/// One place of the workspace: poses about it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Place {
    /// y and z, m.
    pub at_m: [f64; 2],
    /// Poses tried.
    pub tried: u32,
    /// Poses that a scan can tell.
    pub told: u32,
    /// Sums of the told poses' variances of x, y, z (m^2), roll, pitch, yaw (rad^2).
    pub variances: [f64; 6],
    /// Fewest and all edges seen from the poses.
    pub edges: [u32; 2],
    /// Poses from which the ceiling and at least one wall, and both walls, are seen.
    pub walls: [u32; 2],
}

impl Place {
    /// A place without poses.
    pub fn at(at_m: [f64; 2]) -> Place {
        Place {
            at_m,
            edges: [u32::MAX, 0],
            ..Place::default()
        }
    }

    /// Adds a pose: what its scan shows, and the variances it leaves, if it tells the pose at all.
    pub fn add(&mut self, seen: &Seen, variances: Option<[f64; 6]>) {
        self.tried += 1;
        self.edges = [self.edges[0].min(seen.edges), self.edges[1] + seen.edges];
        let [right, upper, left] = seen.points.map(|p| p >= FEW);
        self.walls[0] += u32::from(upper && (right || left));
        self.walls[1] += u32::from(upper && right && left);
        if let Some(variances) = variances {
            self.told += 1;
            for (sum, v) in self.variances.iter_mut().zip(variances) {
                *sum += v;
            }
        }
    }

    /// Root of the mean variance of a component, m or rad; NaN where no pose is told.
    pub fn sigma(&self, k: usize) -> f64 {
        (self.variances[k] / f64::from(self.told)).sqrt()
    }
}

/// The gap between two neighbouring strips of a face.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gap {
    /// Their indices in the frame file.
    pub strips: [usize; 2],
    /// The face.
    pub face: Face,
    /// Where they come closest, m.
    pub least_m: f64,
}

/// What is drawn, checked and predicted.
#[derive(Clone, Debug)]
pub struct Survey {
    /// The file's name.
    pub source: String,
    /// The frame.
    pub frame: Frame,
    /// Frequency and resolution of the scanner, as text.
    pub mode: String,
    /// y from and to, z from and to, m.
    pub workspace_m: [[f64; 2]; 2],
    /// Where the places are.
    pub layout: Layout,
    /// The places, row by row from the lowest z.
    pub places: Vec<Place>,
    /// What the prediction assumes.
    pub conditions: String,
    /// Gaps between neighbouring strips.
    pub gaps: Vec<Gap>,
    /// The command line.
    pub command: String,
}

/// A key of the frame file and what is wrong there.
pub type Mistake = (String, String);

/// What `frame.toml`'s own checks let pass and no pose can come of: strips and plates in one place,
/// faces without any reflector.
///
/// # Errors
/// The key and what is wrong with it.
pub fn check(frame: &Frame) -> Result<(), Mistake> {
    for (i, strip) in frame.strips.iter().enumerate() {
        for (j, plate) in frame.plates.iter().enumerate() {
            let [from, to] = strip.x_span_m(&frame.bounds);
            let (from, to) = (from.max(plate.x_m[0]), to.min(plate.x_m[1]));
            if strip.face != plate.face || from >= to {
                continue;
            }
            let centres = [from, to].map(|x| strip.offset_m + x * strip.slope());
            let reach = 0.5 * strip.width_m;
            let low = centres[0].min(centres[1]) - reach;
            let high = centres[0].max(centres[1]) + reach;
            if low < plate.z_m[1] - 1e-9 && high > plate.z_m[0] + 1e-9 {
                let face = strip.face.name();
                return Err((
                    format!("strip[{i}]"),
                    format!(
                        "lies on plate[{j}] of the {face} face, where its edges cannot be seen"
                    ),
                ));
            }
        }
    }
    let bare = |face: Face| {
        frame.strips_on(face).next().is_none() && !frame.plates.iter().any(|p| p.face == face)
    };
    if bare(Face::Upper) {
        let why = "no strip is on the upper face: neither z nor roll can be told".to_owned();
        return Err(("strip".to_owned(), why));
    }
    if bare(Face::Right) && bare(Face::Left) {
        let why = "no reflector is on either side face: y cannot be told".to_owned();
        return Err(("plate".to_owned(), why));
    }
    Ok(())
}

/// The gaps between neighbouring strips of each face, in the order of their offsets.
pub fn gaps(frame: &Frame) -> Vec<Gap> {
    let mut gaps = Vec::new();
    for face in Face::ALL {
        let mut strips: Vec<_> = frame.strips_on(face).collect();
        strips.sort_by(|a, b| a.1.offset_m.total_cmp(&b.1.offset_m));
        for pair in strips.windows(2) {
            let [(i, a), (j, b)] = [pair[0], pair[1]];
            let [ends_a, ends_b] = [a, b].map(|s| s.x_span_m(&frame.bounds));
            let ends = [ends_a[0].max(ends_b[0]), ends_a[1].min(ends_b[1])];
            if ends[0] >= ends[1] {
                continue;
            }
            let apart = |x: f64| {
                let centres = b.offset_m - a.offset_m + x * (b.slope() - a.slope());
                centres.abs() - 0.5 * (a.width_m + b.width_m)
            };
            gaps.push(Gap {
                strips: [i, j],
                face,
                least_m: apart(ends[0]).min(apart(ends[1])),
            });
        }
    }
    gaps
}

/// The yaw at a place y, in rad from and to, within which beams meet the reflectors of the right and
/// of the left face, for x, roll and pitch zero (Kurniawan 2017, eq. 3.104: |tan yaw| <= w / 2 over
/// the distance to the wall); none for a face without reflectors.
pub fn yaw_limits(frame: &Frame, y_m: f64) -> [Option<[f64; 2]>; 2] {
    let mounting_rad = frame.scanner.rotation_deg[2].to_radians();
    let [x_m, lever_y_m, _] = frame.scanner.position_m;
    [(Face::Right, -1.0), (Face::Left, 1.0)].map(|(face, sign)| {
        let plates = frame
            .plates
            .iter()
            .filter(|p| p.face == face)
            .map(|p| p.x_m);
        let strips = frame
            .strips_on(face)
            .map(|(_, strip)| strip.x_span_m(&frame.bounds));
        let ends = plates
            .chain(strips)
            .reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])])?;
        let distance_m = 0.5 * frame.bounds.dy_m + sign * (y_m + lever_y_m);
        // Turned by yaw, the beam along +y drifts towards -x, the one along -y towards +x.
        let limits = ends.map(|x| (sign * (x - x_m)).atan2(distance_m) - mounting_rad);
        Some([limits[0].min(limits[1]), limits[0].max(limits[1])])
    })
}

/// The yaw up to which, to either side, both walls' reflectors are met, and at least one's: rad.
pub fn yaw_range(frame: &Frame, y_m: f64) -> [f64; 2] {
    let to_either_side =
        |limits: Option<[f64; 2]>| limits.map_or(0.0, |[low, high]| (-low).min(high).max(0.0));
    let [right, left] = yaw_limits(frame, y_m).map(to_either_side);
    [right.min(left), right.max(left)]
}

impl Survey {
    /// The predicted standard deviations as cells, for the maps.
    fn cells(&self) -> Cells {
        let mut cells = Cells::new(self.layout);
        for place in self.places.iter().filter(|p| p.told > 0) {
            cells.add(
                place.at_m,
                &std::array::from_fn(|k| place.sigma(k)),
                0,
                None,
            );
        }
        cells
    }

    /// Root of the mean variance of a component over all poses told, and its largest over the
    /// places; m or rad.
    fn sigma(&self, k: usize) -> [f64; 2] {
        let told: u32 = self.places.iter().map(|p| p.told).sum();
        let sum: f64 = self.places.iter().map(|p| p.variances[k]).sum();
        let worst = self
            .places
            .iter()
            .map(|p| p.sigma(k))
            .filter(|s| s.is_finite());
        [
            (sum / f64::from(told)).sqrt(),
            worst.fold(f64::NAN, f64::max),
        ]
    }

    fn share_pct(&self, count: impl Fn(&Place) -> u32) -> f64 {
        let tried: u32 = self.places.iter().map(|p| p.tried).sum();
        let counted: u32 = self.places.iter().map(count).sum();
        100.0 * f64::from(counted) / f64::from(tried)
    }

    /// Edges seen: the fewest from any pose, the mean, and as many as there are.
    fn edges(&self) -> [f64; 3] {
        let tried: u32 = self.places.iter().map(|p| p.tried).sum();
        let sum: u32 = self.places.iter().map(|p| p.edges[1]).sum();
        let least = self.places.iter().map(|p| p.edges[0]).min().unwrap_or(0);
        let all = 2 * self.frame.strips.len();
        [
            f64::from(least),
            f64::from(sum) / f64::from(tried),
            all as f64,
        ]
    }

    /// The smallest yaw range over the workspace's width: for both walls, for one; rad.
    fn least_yaw(&self) -> [f64; 2] {
        let [from, to] = self.workspace_m[0];
        let ranges =
            (0..=40).map(|i| yaw_range(&self.frame, from + (to - from) * f64::from(i) / 40.0));
        ranges.fold([f64::INFINITY; 2], |a, b| [a[0].min(b[0]), a[1].min(b[1])])
    }

    /// What was looked at: whether it is well, and a sentence.
    pub fn findings(&self) -> Vec<(bool, String)> {
        let f = &self.frame;
        let mut out = vec![(
            true,
            format!(
                "{} plates and {} strips lie inside the box.",
                f.plates.len(),
                f.strips.len()
            ),
        )];
        let least = self
            .gaps
            .iter()
            .min_by(|a, b| a.least_m.total_cmp(&b.least_m));
        if let Some(gap) = least {
            let [a, b] = gap.strips;
            out.push((
                true,
                format!(
                    "No strips cross or overlap; the closest, strip[{a}] and strip[{b}] ({}), are {} m apart.",
                    gap.face.name(),
                    fixed(gap.least_m, 3)
                ),
            ));
        }
        let [fewest, mean, all] = self.edges();
        out.push((
            fewest >= f64::from(ENOUGH_EDGES),
            format!("A scan shows {fewest:.0} of the {all:.0} strip edges at least, {mean:.1} on average."),
        ));
        let both = self.share_pct(|p| p.walls[1]);
        let one = self.share_pct(|p| p.walls[0]);
        out.push((
            one > 99.95,
            format!("The ceiling and both walls show in {both:.1} % of the poses, with one wall or both in {one:.1} %."),
        ));
        let [both, one] = self.least_yaw().map(f64::to_degrees);
        out.push((
            both > 0.0,
            format!("Both walls stay in sight up to a yaw of {both:.2} deg, one of them up to {one:.2} deg (eq. 3.104; least over the width)."),
        ));
        let told = self.share_pct(|p| p.told);
        out.push((
            told > 99.95,
            format!("{told:.1} % of the poses can be told by a single scan."),
        ));
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    fn parse(text: &str) -> Frame {
        Frame::parse(text, Path::new("frame.toml")).unwrap()
    }

    const CABLAR: &str = include_str!("../../../testdata/cablar.toml");

    /// The closed form of the reference's plates, 0.25 m to either side.
    #[test]
    fn the_yaw_range_is_the_published_one() {
        let frame = parse(CABLAR);
        for y in [-4.0, 0.0, 1.3, 4.0f64] {
            let [right, left] = yaw_limits(&frame, y).map(|l| l.unwrap());
            let near = |got: f64, want: f64| assert!((got - want).abs() < 1e-12, "{got} {want}");
            near(right[1], (0.25 / (5.225 - y)).atan());
            near(right[0], -right[1]);
            near(left[1], (0.25 / (5.225 + y)).atan());
            let [both, one] = yaw_range(&frame, y);
            near(both, (0.25 / (5.225 + y.abs())).atan());
            near(one, (0.25 / (5.225 - y.abs())).atan());
        }
    }

    /// At the limit the beams really leave the plate: against the beams themselves.
    #[test]
    fn beams_leave_the_plate_at_the_limit() {
        let text = CABLAR.replacen("x_m = [-0.25, 0.25]", "x_m = [-0.10, 0.25]", 1);
        let frame = parse(&text);
        let beams = Beams {
            angle_min_rad: -0.01,
            step_rad: 0.001,
            count: 21,
        };
        let [right, _] = yaw_limits(&frame, 1.0).map(|l| l.unwrap());
        for (limit, outward) in [(right[0], -1e-3), (right[1], 1e-3)] {
            let at = |yaw: f64| seen(&frame, &beams, [0.0, 1.0, 2.0], [0.0, 0.0, yaw]).points[0];
            assert!(
                at(limit - outward) > 0 && at(limit + outward) == 0,
                "{right:?}"
            );
        }
        assert!(
            (right[0] + right[1]).abs() > 1e-9,
            "not the same to both sides"
        );
    }

    #[test]
    fn gaps_are_where_strips_come_closest() {
        let gaps = gaps(&parse(CABLAR));
        assert_eq!(gaps.len(), 3);
        // From -1.3 to 1.3 m, +30 and -30 deg, 0.8 m wide, +-0.75 m deep.
        let want = 2.6 - 2.0 * 0.75 * 30f64.to_radians().tan() - 0.8;
        assert!(
            gaps.iter().any(|g| (g.least_m - want).abs() < 1e-9),
            "{gaps:?}"
        );
    }

    #[test]
    fn what_no_pose_can_come_of_is_named() {
        let on_plate = format!(
            "{CABLAR}\n[[strip]]\nface = \"right\"\noffset_m = 2.0\nwidth_m = 0.3\ninclination_deg = 20.0\n"
        );
        let (key, why) = check(&parse(&on_plate)).unwrap_err();
        assert!(
            key == "strip[4]" && why.contains("plate[0]"),
            "{key}: {why}"
        );
        let box_only = "[box]\ndx_m = 1.5\ndy_m = 10\ndz_m = 5\n";
        assert_eq!(check(&parse(box_only)).unwrap_err().0, "strip");
        assert!(check(&parse(CABLAR)).is_ok());
        assert!(check(&parse(include_str!("../../../testdata/inclined.toml"))).is_ok());
    }
}
