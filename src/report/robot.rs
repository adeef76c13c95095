//! What measured poses tell of a robot's pulleys, as a table for people and as JSON.

use super::json;
use super::number::{self, count, fixed, signed};
use crate::record::POSE_STATE;
use crate::robot::{Calibrated, Place, Pose};
use serde_json::{Map, Value, json};

/// A calibration and what it was made from.
#[derive(Clone, Debug)]
pub struct Findings<'a> {
    /// Name of the file with the poses.
    pub source: &'a str,
    /// What the robot is called.
    pub robot: &'a str,
    /// The places.
    pub places: &'a [Place],
    /// What they tell.
    pub calibrated: &'a Calibrated,
}

const WIDTH: usize = 10;

/// From m and rad to what people read: mm and deg.
fn scale(component: usize) -> f64 {
    if component < 3 {
        1e3
    } else {
        1f64.to_degrees()
    }
}

fn unit(component: usize) -> &'static str {
    if component < 3 { "mm" } else { "deg" }
}

/// Differences of a pose: angles in (-pi, pi].
fn difference(a: &Pose, b: &Pose) -> Pose {
    let mut d = a - b;
    for angle in d.iter_mut().skip(3) {
        *angle -= std::f64::consts::TAU * (*angle / std::f64::consts::TAU).round();
    }
    d
}

impl Findings<'_> {
    fn errors(&self) -> Vec<Pose> {
        let error = |place: &Place| difference(&place.measured, &place.desired);
        self.places.iter().map(error).collect()
    }

    /// The findings as tables: Kurniawan 2017, Tables 5.1 and 5.2, and the shifts. `ascii` leaves out
    /// what is not ASCII.
    pub fn table(&self, ascii: bool) -> String {
        let mut out = String::new();
        let poses: usize = self.places.iter().map(|p| p.count).sum();
        let head = format!(
            "{}: {} places, {} poses; {}\n\n",
            self.source,
            count(self.places.len()),
            count(poses),
            self.robot
        );
        out.push_str(&head);
        out.push_str("measured − desired\n");
        self.rows(&mut out, &self.errors());
        out.push_str("\nwhat the shifts below leave of it\n");
        self.rows(&mut out, &self.calibrated.left);
        out.push_str("\nreal pulleys − believed ones\n");
        for shift in &self.calibrated.shifts {
            out.push_str(&format!(
                "  {:<12}{:>WIDTH$} mm, σ {} mm\n",
                shift.unknown.to_string(),
                signed(1e3 * shift.shift_m, 2),
                fixed(1e3 * shift.sigma_m, 2),
            ));
        }
        let chi2 = self.calibrated.chi2_per_dof;
        let honest = if chi2 > 2.0 {
            "; the robot differs in more than this, and σ is made larger by its root"
        } else {
            ""
        };
        out.push_str(&format!(
            "  chi-square per degree of freedom {}{honest}\n",
            fixed(chi2, 2)
        ));
        if ascii { number::ascii(&out) } else { out }
    }

    fn rows(&self, out: &mut String, errors: &[Pose]) {
        let title = format!(
            "{:>4}{:>9}{:>9}{:>9}{:>9}",
            "", "x m", "y m", "z m", "roll deg"
        );
        out.push_str(&title);
        for (k, name) in POSE_STATE.iter().enumerate() {
            out.push_str(&format!("{:>WIDTH$}", format!("{name} {}", unit(k))));
        }
        out.push('\n');
        let cells = |errors: &Pose| -> String {
            let digits = |k: usize| if k < 3 { 1 } else { 2 };
            let cell =
                |(k, e): (usize, &f64)| format!("{:>WIDTH$}", signed(e * scale(k), digits(k)));
            errors.iter().enumerate().map(cell).collect()
        };
        for (number, (place, error)) in self.places.iter().zip(errors).enumerate() {
            let d = &place.desired;
            let place = format!(
                "{:>4}{:>9}{:>9}{:>9}{:>9}",
                number + 1,
                fixed(d[0], 3),
                fixed(d[1], 3),
                fixed(d[2], 3),
                fixed(d[3].to_degrees(), 1)
            );
            out.push_str(&format!("{place}{}\n", cells(error)));
        }
        out.push_str(&format!(
            "{:>40}{}\n",
            "rms",
            cells(&rms(errors)).replace('+', " ")
        ));
    }

    /// The findings as indented JSON with a line feed at its end.
    ///
    /// # Errors
    /// None in practice: everything in it can be written.
    pub fn json(&self) -> Result<String, serde_json::Error> {
        let errors = self.errors();
        let place = |((place, error), left): ((&Place, &Pose), &Pose)| {
            json!({
                "poses": place.count,
                "desired": components(&place.desired, false),
                "error": components(error, true),
                "left": components(left, true),
            })
        };
        let rows = self.places.iter().zip(&errors);
        let places: Vec<Value> = rows.zip(&self.calibrated.left).map(place).collect();
        let shifts: Map<String, Value> = self
            .calibrated
            .shifts
            .iter()
            .map(|s| {
                let found = json!({
                    "shift_mm": json::value(1e3 * s.shift_m),
                    "sigma_mm": json::value(1e3 * s.sigma_m),
                });
                (s.unknown.to_string(), found)
            })
            .collect();
        let whole = json!({
            "robot": self.robot,
            "source": self.source,
            "places": places,
            "rms": { "error": components(&rms(&errors), true),
                     "left": components(&rms(&self.calibrated.left), true) },
            "shifts": shifts,
            "chi2_per_dof": json::value(self.calibrated.chi2_per_dof),
        });
        json::text(&whole)
    }
}

/// A pose by component: m and deg, or mm and deg.
fn components(pose: &Pose, is_error: bool) -> Value {
    let entry = |(k, value): (usize, &f64)| {
        let (unit, value) = match (k < 3, is_error) {
            (true, false) => ("m", *value),
            _ => (unit(k), value * scale(k)),
        };
        (format!("{}_{unit}", POSE_STATE[k]), json::value(value))
    };
    Value::Object(pose.iter().enumerate().map(entry).collect())
}

fn rms(errors: &[Pose]) -> Pose {
    let squares: Pose = errors.iter().map(|e| e.component_mul(e)).sum();
    (squares / errors.len().max(1) as f64).map(f64::sqrt)
}
