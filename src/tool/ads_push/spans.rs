//! How long round trips took, for the summary.

use std::time::Duration;

/// The last few thousand round trips.
#[derive(Clone, Debug, Default)]
pub(super) struct Spans {
    ns: Vec<u64>,
    next: usize,
}

impl Spans {
    const MOST: usize = 4096;

    /// Takes one in, in place of the oldest where there are many.
    pub(super) fn add(&mut self, span: Duration) {
        let ns = u64::try_from(span.as_nanos()).unwrap_or(u64::MAX);
        if self.ns.len() < Spans::MOST {
            self.ns.push(ns);
        } else if let Some(place) = self.ns.get_mut(self.next) {
            *place = ns;
            self.next = (self.next + 1) % Spans::MOST;
        }
    }
}

impl std::fmt::Display for Spans {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let mut ns = self.ns.clone();
        ns.sort_unstable();
        let at = |share: f64| {
            let place = (ns.len() as f64 * share) as usize;
            let ns = ns.get(place.min(ns.len().saturating_sub(1)));
            ns.map_or(f64::NAN, |ns| *ns as f64 * 1e-3)
        };
        let (p50, p99, most) = (at(0.5), at(0.99), at(1.0));
        write!(
            f,
            "median {p50:.0} us, 99 % {p99:.0} us, longest {most:.0} us"
        )
    }
}
