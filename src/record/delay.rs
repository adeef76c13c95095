//! The error that is left of a measured trajectory when a delay is assumed.

use super::time::Stamp;

/// One point of the curve of error against delay.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DelayPoint {
    /// Start of the desired trajectory.
    pub stamp: Stamp,
    /// The delay that is assumed, s; positive: the measurement lags.
    pub delay_s: f64,
    /// How many measured positions were compared.
    pub samples: u32,
    /// Rms distance between measured and delayed desired position along x, y, z, m.
    pub rms_m: [f64; 3],
    /// The largest such distance, m.
    pub max_m: [f64; 3],
}

impl Default for DelayPoint {
    fn default() -> Self {
        DelayPoint {
            stamp: Stamp::default(),
            delay_s: f64::NAN,
            samples: 0,
            rms_m: [f64::NAN; 3],
            max_m: [f64::NAN; 3],
        }
    }
}

const RMS_COLUMNS: [&str; 3] = ["rms_x_m", "rms_y_m", "rms_z_m"];
const MAX_COLUMNS: [&str; 3] = ["max_x_m", "max_y_m", "max_z_m"];

impl super::Record for DelayPoint {
    const KIND: &'static str = "delay";
    fn stamp(&self) -> Stamp {
        self.stamp
    }
    fn visit<V: super::Visit>(&self, v: &mut V) -> Result<(), V::Error> {
        use super::Presence::{Optional, Required};
        v.column("stamp_ns", Required, &self.stamp)?;
        v.column("delay_s", Required, &self.delay_s)?;
        v.column("samples", Optional, &self.samples)?;
        let columns = RMS_COLUMNS.iter().chain(&MAX_COLUMNS);
        for (name, value) in columns.zip(self.rms_m.iter().chain(&self.max_m)) {
            v.column(name, Required, value)?;
        }
        Ok(())
    }
    fn visit_mut<V: super::VisitMut>(&mut self, v: &mut V) -> Result<(), V::Error> {
        use super::Presence::{Optional, Required};
        v.column("stamp_ns", Required, &mut self.stamp)?;
        v.column("delay_s", Required, &mut self.delay_s)?;
        v.column("samples", Optional, &mut self.samples)?;
        let columns = RMS_COLUMNS.iter().chain(&MAX_COLUMNS);
        for (name, value) in columns.zip(self.rms_m.iter_mut().chain(&mut self.max_m)) {
            v.column(name, Required, value)?;
        }
        Ok(())
    }
}
