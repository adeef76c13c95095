//! The parts of a case's table that a run need not have.

use super::super::axis::{AXES, Axis, POSITION, ROTATION};
use super::super::case::Case;
use super::super::number::{count, fixed};
use super::super::statistics::Statistics;
use super::{Rows, SPARK, TITLES, Text, figures, name, spark};
use crate::record::Face;
use std::fmt::Write;

impl Text {
    /// What the poses were moved by; nothing where they are as measured.
    pub(super) fn alignment(&mut self, case: &Case) {
        if let Some(sentence) = case.alignment.sentence() {
            self.line(&format!("  {sentence}"));
        }
    }

    /// The delay, and what it makes of the error.
    pub(super) fn delay(&mut self, case: &Case) {
        let Some(delay) = &case.delay else {
            return;
        };
        self.line(&format!("{}{}", name("delay"), delay.figure()));
        let errors = if delay.removed {
            "the errors above are without it"
        } else {
            "the errors above are as measured"
        };
        self.line(&format!("{}{}; {errors}", name(""), delay.sentence()));
        self.out.push('\n');
    }

    /// The position's error along the way and across it.
    pub(super) fn track(&mut self, case: &Case) {
        let Some(track) = &case.track else {
            return;
        };
        let axis = &AXES[POSITION];
        let mut rows = Rows::default();
        rows.add("moving, mm", TITLES, String::new());
        for (title, result) in [("along", &track.along), ("cross", &track.cross)] {
            let end = format!("   {}", spark(&result.trace.means(SPARK)));
            rows.add(title, figures(axis, &result.statistics), end);
        }
        self.rows(&rows, true);
    }

    /// Relative errors, position and rotation for each distance.
    pub(super) fn relative(&mut self, case: &Case) {
        for (index, unit) in [(POSITION, "mm"), (ROTATION, "deg")] {
            let axis = &AXES[index];
            let found = case
                .relative
                .iter()
                .filter_map(|r| Some((r, r.axes.get(index)?)));
            let mut rows = Rows::default();
            rows.add(&format!("rpe, {unit}"), TITLES, String::new());
            for (relative, statistics) in found {
                let end = format!("   {} pairs", count(relative.pairs));
                rows.add(&relative.delta.text, figures(axis, statistics), end);
            }
            if rows.0.len() > 1 {
                self.rows(&rows, true);
            }
        }
    }

    /// Orientation against the IMU's.
    pub(super) fn orientation(&mut self, case: &Case) {
        let Some(found) = &case.orientation else {
            return;
        };
        let mut rows = Rows::default();
        let titles = ["offset", "deg/h", "rms", "p95", "max"];
        rows.add(
            "to IMU, deg",
            titles,
            "   pose minus IMU, less the offset".to_owned(),
        );
        for (angle, axis) in found.angles.iter().zip(AXES.iter().skip(3)) {
            let s = angle.residual.scaled(axis.factor);
            let cells = [
                fixed(angle.offset_rad.to_degrees(), axis.decimals),
                fixed(angle.drift_rad_s.to_degrees() * 3600.0, 2),
                fixed(s.rms, axis.decimals),
                fixed(s.p95, axis.decimals),
                fixed(s.max, axis.decimals),
            ];
            let end = format!("   {}", spark(&angle.trace.means(SPARK)));
            rows.add(axis.name, cells, end);
        }
        self.rows(&rows, true);
        if found.rates.iter().all(|rate| rate.n == 0) {
            return;
        }
        let mut rows = Rows::default();
        rows.add(
            "rates, deg/s",
            ["bias", "rms", "scale"],
            "   poses against gyros".to_owned(),
        );
        for (rate, title) in found.rates.iter().zip(["x", "y", "z"]) {
            let cells = [
                fixed(rate.bias_rad_s.to_degrees(), 3),
                fixed(rate.rms_rad_s.to_degrees(), 3),
                fixed(rate.scale, 4),
            ];
            rows.add(title, cells, String::new());
        }
        self.rows(&rows, true);
    }

    /// How still a standing run is.
    pub(super) fn stability(&mut self, case: &Case) {
        let Some(found) = &case.stability else {
            return;
        };
        let mut rows = Rows::default();
        let shown = |tau: f64| format!("{} s", fixed(tau, if tau < 1.0 { 2 } else { 1 }));
        let taus = [1usize, 10, 100, 1000];
        let titles = taus.map(|m| shown(m as f64 * found.period_s));
        let titles = titles
            .into_iter()
            .chain(["lowest".to_owned(), "after, s".to_owned()]);
        rows.add("standing", titles, "   Allan deviation".to_owned());
        for (i, axis) in AXES.iter().enumerate().take(6) {
            let Some(curve) = found.curves.get(i).filter(|c| !c.is_empty()) else {
                continue;
            };
            let at = |m: usize| {
                let wanted = m as f64 * found.period_s;
                let near = |p: &f64| (p / wanted - 1.0).abs() < 0.01;
                let point = curve.iter().find(|p| near(&p.tau_s));
                fixed(
                    point.map_or(f64::NAN, |p| p.deviation * axis.factor),
                    axis.decimals + 1,
                )
            };
            let mut cells: Vec<String> = taus.into_iter().map(at).collect();
            let floor = found.floor(i);
            let lowest = floor.map_or(f64::NAN, |p| p.deviation * axis.factor);
            cells.push(fixed(lowest, axis.decimals + 1));
            cells.push(fixed(floor.map_or(f64::NAN, |p| p.tau_s), 1));
            rows.add(
                &format!("{}, {}", axis.name, axis.unit),
                cells,
                String::new(),
            );
        }
        self.rows(&rows, true);
    }

    /// What the lines say.
    pub(super) fn lines_of(&mut self, case: &Case) {
        let Some(tally) = &case.quality.lines else {
            return;
        };
        let mut line = name("lines");
        for (face, name) in tally.faces.iter().zip(Face::ALL) {
            let _ = write!(
                line,
                "{} {} points, rms {} mm; ",
                name.name(),
                fixed(face.points(), 0),
                fixed(face.residual_rms_m() * 1e3, 2)
            );
        }
        let used = case.scans.edges.map_or(f64::NAN, |s| s.mean);
        let _ = write!(
            line,
            "{} strips and {} edges seen, {} used",
            fixed(tally.strips_seen(), 1),
            fixed(tally.edges_seen(), 1),
            fixed(used, 1)
        );
        self.line(&line);
    }
}

/// The figures of a row of errors.
pub(super) fn row_figures(axis: &Axis, statistics: &Statistics) -> [f64; 8] {
    let s = statistics.scaled(axis.factor);
    [s.bias, s.std, s.rms, s.median, s.mad, s.p95, s.p99, s.max]
}
