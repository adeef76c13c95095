//! A run's errors made small for a picture: extremes per column of pixels, and a histogram.

use crate::record::Stamp;

/// Columns of a trace: as many as the widest figure has pixels.
pub const COLUMNS: usize = 840;

/// The errors that fall on one column of pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TraceColumn {
    /// Errors in the column.
    pub n: u32,
    /// Smallest error.
    pub min: f64,
    /// Largest error.
    pub max: f64,
    /// Sum of the errors.
    sum: f64,
    /// Sum and number of the solver's sigmas.
    sigma_sum: f64,
    sigma_n: u32,
}

const EMPTY: TraceColumn = TraceColumn {
    n: 0,
    min: f64::INFINITY,
    max: f64::NEG_INFINITY,
    sum: 0.0,
    sigma_sum: 0.0,
    sigma_n: 0,
};

impl TraceColumn {
    /// Mean error; NaN in an empty column.
    pub fn mean(&self) -> f64 {
        self.sum / f64::from(self.n)
    }

    /// Mean sigma; NaN where none is known.
    pub fn sigma(&self) -> f64 {
        self.sigma_sum / f64::from(self.sigma_n)
    }

    fn merge(&self, other: &TraceColumn) -> TraceColumn {
        TraceColumn {
            n: self.n + other.n,
            min: self.min.min(other.min),
            max: self.max.max(other.max),
            sum: self.sum + other.sum,
            sigma_sum: self.sigma_sum + other.sigma_sum,
            sigma_n: self.sigma_n + other.sigma_n,
        }
    }
}

/// Errors over time.
#[derive(Clone, Debug, PartialEq)]
pub struct Trace {
    /// The instant of the left end.
    pub start: Stamp,
    /// Seconds from the left to the right end.
    pub duration_s: f64,
    /// Left to right.
    pub columns: Vec<TraceColumn>,
}

impl Trace {
    /// An empty trace from `start` to `end`.
    pub fn new(start: Stamp, end: Stamp) -> Trace {
        Trace {
            start,
            duration_s: end.since_s(start),
            columns: vec![EMPTY; COLUMNS],
        }
    }

    /// Adds an error with the solver's sigma for it (NaN where unknown).
    pub fn add(&mut self, stamp: Stamp, error: f64, sigma: f64) {
        let share = if self.duration_s > 0.0 {
            stamp.since_s(self.start) / self.duration_s
        } else {
            0.5
        };
        let last = self.columns.len().saturating_sub(1);
        let index = ((share * self.columns.len() as f64).max(0.0) as usize).min(last);
        let known = sigma.is_finite();
        let one = TraceColumn {
            n: 1,
            min: error,
            max: error,
            sum: error,
            sigma_sum: if known { sigma } else { 0.0 },
            sigma_n: u32::from(known),
        };
        if let Some(column) = self.columns.get_mut(index) {
            *column = column.merge(&one);
        }
    }

    /// The same trace on `count` columns or a few less.
    #[must_use]
    pub fn coarser(&self, count: usize) -> Vec<TraceColumn> {
        let size = self.columns.len().div_ceil(count.max(1));
        let merged = |c: &[TraceColumn]| c.iter().fold(EMPTY, |sum, column| sum.merge(column));
        self.columns.chunks(size.max(1)).map(merged).collect()
    }

    /// Mean errors on `count` columns or a few less, for a sparkline; NaN where there are none.
    pub fn means(&self, count: usize) -> Vec<f64> {
        self.coarser(count).iter().map(TraceColumn::mean).collect()
    }
}

/// Bins of a histogram; odd, so that one of them is around zero.
const BINS: usize = 41;

/// How often an error has which size.
#[derive(Clone, Debug, PartialEq)]
pub struct Histogram {
    /// The bins go from minus this to this.
    pub limit: f64,
    /// Errors in each bin.
    pub bins: Vec<u32>,
    /// Errors beyond the limit on either side.
    pub beyond: u32,
}

impl Histogram {
    /// Counts `errors` between `-limit` and `limit`.
    pub fn of(errors: &[f64], limit: f64) -> Histogram {
        let mut histogram = Histogram {
            limit,
            bins: vec![0; BINS],
            beyond: 0,
        };
        for error in errors {
            let place = (error / limit + 1.0) * 0.5 * BINS as f64;
            // The upper end belongs to the last bin.
            let index = if *error == limit {
                BINS - 1
            } else {
                place.floor().max(-1.0) as usize
            };
            match histogram.bins.get_mut(index).filter(|_| place >= 0.0) {
                Some(bin) => *bin += 1,
                None => histogram.beyond += 1,
            }
        }
        histogram
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn extremes_survive_and_nothing_is_lost() {
        let (start, end) = (Stamp::from_ns(0), Stamp::from_ns(1_000_000));
        let mut trace = Trace::new(start, end);
        for i in 0..=100_000i64 {
            let spike = if i == 31_415 { 50.0 } else { 0.0 };
            trace.add(Stamp::from_ns(i * 10), spike - 1.0, 2.0);
        }
        assert_eq!(trace.columns.iter().map(|c| c.n).sum::<u32>(), 100_001);
        let top = trace.columns.iter().map(|c| c.max).fold(f64::MIN, f64::max);
        assert_eq!(top, 49.0);
        assert!(
            trace
                .columns
                .iter()
                .all(|c| c.min == -1.0 && c.sigma() == 2.0)
        );
        assert_eq!(trace.coarser(420).len(), 420);
        assert_eq!(trace.coarser(24).iter().map(|c| c.n).sum::<u32>(), 100_001);
        assert!((trace.means(1)[0] - (50.0 / 100_001.0 - 1.0)).abs() < 1e-12);
    }

    #[test]
    fn a_single_instant_has_a_place() {
        let mut trace = Trace::new(Stamp::from_ns(5), Stamp::from_ns(5));
        trace.add(Stamp::from_ns(5), 1.0, f64::NAN);
        assert_eq!(trace.columns.iter().map(|c| c.n).sum::<u32>(), 1);
        assert!(trace.columns.iter().all(|c| c.sigma().is_nan()));
    }

    #[test]
    fn a_histogram_counts_everything_once() {
        let errors: Vec<f64> = (-50..=50).map(|i| f64::from(i) / 10.0).collect();
        let histogram = Histogram::of(&errors, 4.1);
        assert_eq!(histogram.bins.iter().sum::<u32>() + histogram.beyond, 101);
        assert_eq!(histogram.beyond, 18);
        assert_eq!(Histogram::of(&[4.1, -4.1], 4.1).beyond, 0);
        let mirrored: Vec<u32> = histogram.bins.iter().rev().copied().collect();
        assert_eq!(histogram.bins[BINS / 2], mirrored[BINS / 2]);
    }
}
