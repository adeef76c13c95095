//! The lower hull of a cloud of points, and the line under it.
//!
//! A message can be late but never early. Plotted over time, the differences between two clocks
//! are therefore a cloud with a sharp lower edge, and that edge is the straight line sought. The
//! line below all points with the greatest sum of heights is the hull's edge that the mean abscissa
//! crosses (maximum likelihood for exponential delays).

/// A point: time, s, and a difference of clocks, ns. Both count from a start near the data, so that
/// a double holds them to fractions of a nanosecond.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// Abscissa, s.
    pub x_s: f64,
    /// Ordinate, ns.
    pub y_ns: f64,
}

/// A straight line.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Line {
    /// Where `at_ns` holds, s.
    pub x_s: f64,
    /// Height there, ns.
    pub at_ns: f64,
    /// Slope, ns/s (10^-9).
    pub slope: f64,
}

impl Line {
    /// Height at `x_s`, ns.
    pub fn at(&self, x_s: f64) -> f64 {
        self.at_ns + self.slope * (x_s - self.x_s)
    }
}

/// The lower hull of points that come in the order of their abscissae: left to right, convex.
#[derive(Clone, Debug, Default)]
pub struct LowerHull {
    vertices: Vec<Point>,
}

impl LowerHull {
    /// The hull of points sorted by abscissa.
    pub fn of(points: impl IntoIterator<Item = Point>) -> LowerHull {
        let mut hull = LowerHull::default();
        points.into_iter().for_each(|point| hull.push(point));
        hull
    }

    /// Takes a point that is not left of the last one; one that is, or that is no number, is left
    /// out. Amortised constant time.
    pub fn push(&mut self, point: Point) {
        if !(point.x_s.is_finite() && point.y_ns.is_finite()) {
            return;
        }
        if let Some(last) = self.vertices.last() {
            if point.x_s < last.x_s || (point.x_s == last.x_s && point.y_ns >= last.y_ns) {
                return;
            }
            if point.x_s == last.x_s {
                self.vertices.pop();
            }
        }
        while let [.., a, b] = self.vertices.as_slice()
            && (b.y_ns - a.y_ns) * (point.x_s - a.x_s) >= (point.y_ns - a.y_ns) * (b.x_s - a.x_s)
        {
            self.vertices.pop();
        }
        self.vertices.push(point);
    }

    /// Forgets all points.
    pub fn clear(&mut self) {
        self.vertices.clear();
    }

    /// The corners, left to right.
    pub fn vertices(&self) -> &[Point] {
        &self.vertices
    }

    /// The line below all points that is highest at `x_s`: the edge crossed there. Of a single
    /// point, or beyond the ends, it is level. None without points.
    pub fn line_at(&self, x_s: f64) -> Option<Line> {
        let right = self.vertices.partition_point(|vertex| vertex.x_s <= x_s);
        let left = right.checked_sub(1).and_then(|k| self.vertices.get(k));
        match (left, self.vertices.get(right)) {
            (Some(a), Some(b)) => {
                let slope = (b.y_ns - a.y_ns) / (b.x_s - a.x_s);
                let at_ns = a.y_ns + slope * (x_s - a.x_s);
                Some(Line { x_s, at_ns, slope })
            }
            (Some(end), None) | (None, Some(end)) => Some(Line {
                x_s: end.x_s,
                at_ns: end.y_ns,
                slope: 0.0,
            }),
            (None, None) => None,
        }
    }

    /// The height at `x_s` of the highest line of this slope below all points, ns; infinite without
    /// points. By bisection: convex in the vertices.
    pub fn support_ns(&self, slope: f64, x_s: f64) -> f64 {
        let touching = self.touching(slope);
        let vertex = self.vertices.get(touching);
        vertex.map_or(f64::INFINITY, |v| v.y_ns + slope * (x_s - v.x_s))
    }

    /// The vertex that a line of this slope touches from below.
    fn touching(&self, slope: f64) -> usize {
        let (mut low, mut high) = (0, self.vertices.len().saturating_sub(1));
        while low < high {
            let middle = (low + high) / 2;
            let steeper = match self.vertices.get(middle..=middle + 1) {
                Some([a, b]) => (b.y_ns - a.y_ns) >= slope * (b.x_s - a.x_s),
                _ => true,
            };
            if steeper {
                high = middle;
            } else {
                low = middle + 1;
            }
        }
        low
    }

    /// The line below all points that maximises `weight * height(x_s) - ((slope - prior) / sigma)^2 / 2`:
    /// the edge crossed at `x_s`, drawn towards a known slope as far as the points leave it open.
    /// `weight` in 1/ns (points by their mean height), `prior` and `sigma` in ns/s.
    pub fn line_with_prior(&self, x_s: f64, weight: f64, prior: f64, sigma: f64) -> Option<Line> {
        let first = self.vertices.first()?;
        // At a vertex the best slope is known in closed form; it must lie between the slopes of the
        // two edges that meet there. The best vertex is found by bisection, as the sum is concave.
        let free = |v: &Point| prior + sigma * sigma * weight * (x_s - v.x_s);
        let slope_of = |k: usize| match self.vertices.get(k..=k + 1) {
            Some([a, b]) => (b.y_ns - a.y_ns) / (b.x_s - a.x_s),
            _ => f64::INFINITY,
        };
        let (mut low, mut high) = (0, self.vertices.len() - 1);
        while low < high {
            let middle = (low + high) / 2;
            // Left of the optimum the free slope is steeper than the edge to the right.
            let right_edge = slope_of(middle);
            if self
                .vertices
                .get(middle)
                .is_some_and(|v| free(v) > right_edge)
            {
                low = middle + 1;
            } else {
                high = middle;
            }
        }
        let vertex = self.vertices.get(low).unwrap_or(first);
        let left_edge = low.checked_sub(1).map_or(f64::NEG_INFINITY, slope_of);
        let slope = free(vertex).max(left_edge).min(slope_of(low));
        Some(Line {
            x_s: vertex.x_s,
            at_ns: vertex.y_ns,
            slope,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn points(heights: &[f64]) -> Vec<Point> {
        let point = |(k, y): (usize, &f64)| Point {
            x_s: (k / 2) as f64 * 0.03,
            y_ns: *y,
        };
        heights.iter().enumerate().map(point).collect()
    }

    proptest! {
        #[test]
        fn lies_below_all_points_and_touches_some(
            heights in prop::collection::vec(-1e6..1e6f64, 1..200),
            share in 0.0..1.0f64,
            slope in -1e6..1e6f64,
            weight in 1e-6..1.0f64,
            sigma in 1.0..1e6f64,
        ) {
            let points = points(&heights);
            let hull = LowerHull::of(points.iter().copied());
            let last = points.last().unwrap().x_s;
            let x_s = share * last;
            let lines = [
                hull.line_at(x_s).unwrap(),
                hull.line_with_prior(x_s, weight, 0.0, sigma).unwrap(),
                Line { x_s, at_ns: hull.support_ns(slope, x_s), slope },
            ];
            for line in lines {
                let above = points.iter().map(|p| p.y_ns - line.at(p.x_s));
                let least = above.fold(f64::INFINITY, f64::min);
                prop_assert!(least.abs() < 1e-3, "{line:?}: {least}");
            }
        }

        #[test]
        fn no_line_below_is_higher(
            heights in prop::collection::vec(-1e6..1e6f64, 3..100),
            share in 0.01..0.99f64,
            other in -1e7..1e7f64,
            weight in 1e-6..1.0f64,
            sigma in 1.0..1e6f64,
        ) {
            let points = points(&heights);
            let hull = LowerHull::of(points.iter().copied());
            let x_s = share * points.last().unwrap().x_s;
            let best = hull.line_at(x_s).unwrap();
            let rival = points
                .iter()
                .map(|p| p.y_ns + other * (x_s - p.x_s))
                .fold(f64::INFINITY, f64::min);
            prop_assert!(rival <= best.at(x_s) + 1e-3);
            prop_assert!((rival - hull.support_ns(other, x_s)).abs() < 1e-3);
            let worth = |height: f64, slope: f64| weight * height - (slope / sigma).powi(2) / 2.0;
            let drawn = hull.line_with_prior(x_s, weight, 0.0, sigma).unwrap();
            let most = worth(drawn.at(x_s), drawn.slope);
            prop_assert!(worth(rival, other) <= most + 1e-6 * (1.0 + most.abs()));
        }
    }

    #[test]
    fn an_exact_line_is_recovered() {
        let points = (0..500).map(|k| Point {
            x_s: f64::from(k) * 0.02,
            y_ns: 150.0 - 20_000.0 * f64::from(k) * 0.02 + f64::from((k * 7919) % 13) * 1e3,
        });
        let line = LowerHull::of(points).line_at(5.0).unwrap();
        assert!((line.slope + 20_000.0).abs() < 1e-6);
        assert!((line.at(0.0) - 150.0).abs() < 1e-5);
    }
}
