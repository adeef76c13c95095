//! The most likely partition of every group into lines and clutter, exactly.
//!
//! A run of beams on one line costs its chi-square plus [`MlOptions::line_cost`], a beam on none
//! costs [`MlOptions::clutter_cost`]; the cheapest partition of a group is found by dynamic
//! programming: with F(t) the least cost of the first t beams,
//! `F(t) = min(F(t - 1) + kappa, min over j of F(j) + C(j, t) + beta)`. Prefix sums give the
//! chi-square C of any run in O(1), so that the plain recursion is O(n^2) in a group of n beams.
//!
//! Most of its candidates j need no look. Chi-square is superadditive: a line through two runs costs
//! at least what the two cost each with its own. From that follow, with V_j(t) = F(j) + C(j, t):
//!
//! - A candidate with `V_j(t) >= F(t) + slack` can never win again: whatever comes after t is as
//!   cheap behind the best partition up to t. The slack pays for a rest too short for a line.
//! - `V_j(t) >= V_j(s) + C(s, t)` for any s between: as long as the candidate that was best at s is
//!   still better than this bound of all others, they need not be evaluated, and C(s, t) is the
//!   same for all of them. On a straight wall the best one's lead is about beta and its loss about
//!   chi-square of two degrees of freedom, so that a wall is passed with a few looks at the others.
//!
//! Both leave the optimum as it is. Neighbouring groups and runs behind an obstacle are joined
//! afterwards ([`super::runs`]).

use super::cutting::{Cutter, Cutting};
use super::extractor::ExtractorOptions;
use super::fit::{BeamSlice, DEGENERATE, InverseRangeSums, PrefixSums};
use super::runs::{MergeRule, Runs};
use crate::record::Scan;

/// Settings of the extractor. The defaults suit an LMS500.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MlOptions {
    /// What all extractors share.
    pub common: ExtractorOptions,
    /// Chi-square that a further line has to explain (beta).
    pub line_cost: f64,
    /// What a beam on no line costs (kappa).
    pub clutter_cost: f64,
    /// Fewest beams of a run; a line's own limit is judged after runs are joined.
    pub min_run: usize,
    /// 99.9 % quantile of chi-square with two degrees of freedom: two runs on one line differ by
    /// less.
    pub merge_chi2: f64,
    /// How uneven a wall may be, m: added to the noise, in squares, when lines are told apart.
    /// Walls are not flat to a fraction of the noise, and a wall of hundreds of beams shows it.
    pub flatness_m: f64,
}

impl Default for MlOptions {
    fn default() -> Self {
        MlOptions {
            common: ExtractorOptions::default(),
            line_cost: 22.0,
            clutter_cost: 9.0,
            min_run: 3,
            merge_chi2: 13.8,
            flatness_m: 0.011,
        }
    }
}

/// The extractor.
pub type Ml = Cutting<Partitioning>;

/// Cuts a group by its cheapest partition.
#[derive(Clone, Debug, Default)]
pub struct Partitioning {
    options: MlOptions,
    partition: Partition,
}

impl Partitioning {
    /// Standard deviation of a range, m, with the unevenness of the wall.
    fn sigma_m(&self) -> f64 {
        let noise_m = self.options.common.segmentation.sigma_m;
        noise_m.hypot(self.options.flatness_m)
    }
}

impl Cutter for Partitioning {
    type Options = MlOptions;

    fn new(options: MlOptions) -> Partitioning {
        Partitioning {
            options,
            ..Partitioning::default()
        }
    }

    fn common(&self) -> &ExtractorOptions {
        &self.options.common
    }

    fn merge_rule(&self, scan: &Scan) -> MergeRule {
        MergeRule {
            sigma_m: self.sigma_m(),
            ..MergeRule::new(self.options.merge_chi2, &self.options.common, scan)
        }
    }

    fn cut(&mut self, group: BeamSlice<'_>, offset: usize, runs: &mut Runs) {
        let costs = Costs {
            per_m2: self.sigma_m().powi(-2),
            line: self.options.line_cost,
            clutter: self.options.clutter_cost,
            min_run: self.options.min_run.max(2),
        };
        self.partition.find(group, &costs);
        for (a, b, sums) in self.partition.lines() {
            runs.push(offset + a, offset + b, sums);
        }
    }
}

/// What a partition costs.
#[derive(Clone, Copy, Debug)]
struct Costs {
    /// Chi-square of a squared metre: 1 / sigma^2.
    per_m2: f64,
    line: f64,
    clutter: f64,
    min_run: usize,
}

impl Costs {
    /// What a rest too short for a line may cost more than a line would.
    fn slack(&self) -> f64 {
        ((self.min_run - 1) as f64 * self.clutter - self.line).max(0.0)
    }
}

/// The cheapest partition of a group.
#[derive(Clone, Debug, Default)]
struct Partition {
    prefix: PrefixSums,
    /// F: least cost of the first t beams.
    least: Vec<f64>,
    /// Where the last line of that partition starts; the beam before t is clutter where it is t.
    start: Vec<u32>,
    candidates: Candidates,
    lines: Vec<(u32, u32)>,
}

impl Partition {
    fn find(&mut self, group: BeamSlice<'_>, costs: &Costs) {
        let n = group.len();
        self.prefix.read(group);
        self.least.clear();
        self.least.push(0.0);
        self.start.clear();
        self.start.push(0);
        self.candidates.clear();
        for t in 1..=n {
            let mut best = self.least[t - 1] + costs.clutter;
            let mut from = t as u32;
            if let Some(j) = t.checked_sub(costs.min_run) {
                self.candidates.add(j, self.prefix.before(j), self.least[j]);
                let (value, at) = self.candidates.least_at(t, &self.prefix, best, costs);
                if value + costs.line < best {
                    best = value + costs.line;
                    from = at;
                }
            }
            self.least.push(best);
            self.start.push(from);
            self.candidates
                .drop_hopeless(best + costs.slack() + ROUNDING);
        }
        self.lines.clear();
        let mut t = n;
        while t > 0 {
            let from = self.start[t] as usize;
            if from < t {
                self.lines.push((from as u32, t as u32));
                t = from;
            } else {
                t -= 1;
            }
        }
    }

    /// The lines of the partition found last: from, to, and sums.
    fn lines(&self) -> impl Iterator<Item = (usize, usize, InverseRangeSums)> + '_ {
        self.lines.iter().rev().map(|(from, to)| {
            let (from, to) = (*from as usize, *to as usize);
            (from, to, self.prefix.between(from, to))
        })
    }
}

/// First beams of a last line that may still win, as parallel arrays.
#[derive(Clone, Debug, Default)]
struct Candidates {
    at: Vec<u32>,
    /// Prefix sums at each, in [`InverseRangeSums::parts`]' order.
    sums: [Vec<f64>; 6],
    /// F at each.
    least: Vec<f64>,
    /// V of each when all were looked at last; of those that came since, F, which is no more.
    value: Vec<f64>,
    /// When all were looked at last.
    seen_at: usize,
    /// Which was best then.
    leader: usize,
    /// Least value of the others that were there then.
    runner_up: f64,
    /// Those that came since, in blocks of neighbours: behind the last of a block, and least F.
    newcomers: Vec<(u32, f64)>,
    /// Least F of all of them.
    newcomer: f64,
    /// Whether values are those of the beam at hand.
    fresh: bool,
    /// Which are kept.
    kept: Vec<u32>,
    /// How often all were looked at, for the test of that.
    looks: usize,
}

impl Candidates {
    fn clear(&mut self) {
        self.at.clear();
        for list in &mut self.sums {
            list.clear();
        }
        self.least.clear();
        self.value.clear();
        self.seen_at = 0;
        self.looks = 0;
        self.leader = 0;
        self.runner_up = f64::INFINITY;
        self.newcomers.clear();
        self.newcomer = f64::INFINITY;
        self.fresh = false;
    }

    fn add(&mut self, at: usize, sums: &InverseRangeSums, least: f64) {
        self.at.push(at as u32);
        for (list, part) in self.sums.iter_mut().zip(sums.parts()) {
            list.push(part);
        }
        self.least.push(least);
        self.value.push(least);
        self.newcomer = self.newcomer.min(least);
        match self.newcomers.last_mut() {
            Some((end, lowest)) if !self.at.len().is_multiple_of(BLOCK) => {
                *end = at as u32 + 1;
                *lowest = lowest.min(least);
            }
            _ => self.newcomers.push((at as u32 + 1, least)),
        }
    }

    /// Least V at `t`, and whose it is; something larger where a line cannot beat `best` anyway.
    fn least_at(&mut self, t: usize, prefix: &PrefixSums, best: f64, costs: &Costs) -> (f64, u32) {
        self.fresh = false;
        let run = |from: usize| prefix.cost_m2(from, t) * costs.per_m2;
        let leader = self.at[self.leader];
        let lead = self.least[self.leader] + run(leader as usize);
        let limit = lead.min(best - costs.line) + ROUNDING;
        let mut others = self.runner_up;
        if others < limit {
            others += run(self.seen_at);
        }
        if others >= limit && self.newcomer >= limit {
            return (lead, leader);
        }
        if others >= limit {
            // The newcomers' own bounds, and from now on they are no newcomers any more.
            others = self.runner_up + run(self.seen_at);
            for (end, least) in &self.newcomers {
                others = others.min(least + run((*end as usize).min(t)));
            }
            if others >= limit {
                self.runner_up = others;
                self.seen_at = t;
                self.newcomers.clear();
                self.newcomer = f64::INFINITY;
                return (lead, leader);
            }
        }
        self.look_at_all(t, prefix.before(t), costs.per_m2);
        (self.value[self.leader], self.at[self.leader])
    }

    fn look_at_all(&mut self, t: usize, to: &InverseRangeSums, per_m2: f64) {
        let n = self.at.len();
        let [yy, yz, zz, y, z, one] = self.sums.each_ref().map(|list| &list[..n]);
        let least = &self.least[..n];
        let value = &mut self.value[..n];
        let [to_yy, to_yz, to_zz, to_y, to_z, to_one] = to.parts();
        for i in 0..n {
            let (yy, yz, zz) = (to_yy - yy[i], to_yz - yz[i], to_zz - zz[i]);
            let (y, z, one) = (to_y - y[i], to_z - z[i], to_one - one[i]);
            let det = yy * zz - yz * yz;
            let explained = (y * (y * zz - z * yz) + z * (z * yy - y * yz)) / det;
            let cost_m2 = one - explained;
            let cost_m2 = if cost_m2 > 0.0 { cost_m2 } else { 0.0 };
            let cost_m2 = if det > DEGENERATE * yy * zz {
                cost_m2
            } else {
                0.0
            };
            value[i] = least[i] + cost_m2 * per_m2;
        }
        // Two beams contradict no line, but for rounding: as in `PrefixSums::cost_m2`.
        for i in (0..n).rev().take_while(|i| t - (self.at[*i] as usize) < 3) {
            value[i] = least[i];
        }
        self.seen_at = t;
        self.looks += 1;
        self.newcomers.clear();
        self.newcomer = f64::INFINITY;
        self.fresh = true;
        let least;
        (least, self.runner_up) = two_least(value);
        self.leader = value.iter().position(|v| *v == least).unwrap_or(0);
    }

    /// Drops what can never win again, as far as it has just been looked at and is worth it.
    fn drop_hopeless(&mut self, limit: f64) {
        if !self.fresh {
            return;
        }
        let hopeless = self.value.iter().filter(|value| **value >= limit).count();
        if hopeless * 8 < self.value.len() {
            return;
        }
        self.kept.clear();
        let values = self.value.iter().enumerate();
        let kept = values.filter(|(i, value)| **value < limit || *i == self.leader);
        self.kept.extend(kept.map(|(i, _)| i as u32));
        let leader = self.kept.partition_point(|i| (*i as usize) < self.leader);
        self.leader = leader;
        take(&mut self.at, &self.kept);
        let lists = [&mut self.least, &mut self.value];
        for list in lists.into_iter().chain(&mut self.sums) {
            take(list, &self.kept);
        }
    }
}

/// What rounding in differences of prefix sums may make of a chi-square: bounds are trusted no
/// further, so that none of two equally cheap partitions is lost to the other's rounding.
const ROUNDING: f64 = 1e-3;
/// Newcomers that share a bound.
const BLOCK: usize = 4;

/// Keeps the entries at ascending indices.
fn take<T: Copy>(list: &mut Vec<T>, kept: &[u32]) {
    for (to, from) in kept.iter().enumerate() {
        list[to] = list[*from as usize];
    }
    list.truncate(kept.len());
}

/// The least value and the next one.
fn two_least(values: &[f64]) -> (f64, f64) {
    let mut first = [f64::INFINITY; LANES];
    let mut second = [f64::INFINITY; LANES];
    let (chunks, rest) = values.as_chunks::<LANES>();
    let mut see = |lane: usize, value: f64| {
        let larger = if value > first[lane] {
            value
        } else {
            first[lane]
        };
        second[lane] = if larger < second[lane] {
            larger
        } else {
            second[lane]
        };
        first[lane] = if value < first[lane] {
            value
        } else {
            first[lane]
        };
    };
    for chunk in chunks {
        for (lane, value) in chunk.iter().enumerate() {
            see(lane, *value);
        }
    }
    for (lane, value) in rest.iter().enumerate() {
        see(lane, *value);
    }
    let (mut least, mut next) = (f64::INFINITY, f64::INFINITY);
    for value in first.into_iter().chain(second) {
        next = next.min(value.max(least));
        least = least.min(value);
    }
    (least, next)
}

const LANES: usize = 4;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lines::fit::Beams;
    use proptest::prelude::*;

    const SIGMA_M: f64 = 0.01;

    fn costs() -> Costs {
        Costs {
            per_m2: 1.0 / (SIGMA_M * SIGMA_M),
            line: 22.0,
            clutter: 9.0,
            min_run: 3,
        }
    }

    /// The cost of a partition given as its lines, from sums of its own.
    fn cost(group: BeamSlice<'_>, lines: &[(usize, usize)], costs: &Costs) -> f64 {
        let chi2 = |(a, b): &(usize, usize)| {
            let sums: InverseRangeSums = group.run(*a, *b).iter().collect();
            sums.cost_m2() * costs.per_m2
        };
        let on_lines: usize = lines.iter().map(|(a, b)| b - a).sum();
        let clutter = costs.clutter * (group.len() - on_lines) as f64;
        clutter
            + lines
                .iter()
                .map(|line| chi2(line) + costs.line)
                .sum::<f64>()
    }

    fn found(partition: &Partition) -> Vec<(usize, usize)> {
        partition.lines().map(|(a, b, _)| (a, b)).collect()
    }

    /// The recursion as it stands, every candidate looked at for every beam.
    fn plain(group: BeamSlice<'_>, costs: &Costs) -> f64 {
        let mut prefix = PrefixSums::default();
        prefix.read(group);
        let mut least = vec![0.0];
        for t in 1..=group.len() {
            let lines = (0..(t + 1).saturating_sub(costs.min_run))
                .map(|j| least[j] + prefix.cost_m2(j, t) * costs.per_m2 + costs.line);
            least.push(lines.fold(least[t - 1] + costs.clutter, f64::min));
        }
        least[group.len()]
    }

    /// The least cost over all partitions of the beams from `from` on.
    fn brute(group: BeamSlice<'_>, from: usize, costs: &Costs) -> f64 {
        if from == group.len() {
            return 0.0;
        }
        let clutter = costs.clutter + brute(group, from + 1, costs);
        (from + costs.min_run..=group.len())
            .map(|to| {
                let sums: InverseRangeSums = group.run(from, to).iter().collect();
                sums.cost_m2() * costs.per_m2 + costs.line + brute(group, to, costs)
            })
            .fold(clutter, f64::min)
    }

    /// Beams on a chain of walls with noise, some of them in front.
    fn beams(walls: &[(f64, f64)], each: usize, noise: &[f64], clutter: &[usize]) -> Beams {
        let n = walls.len() * each;
        (0..n)
            .map(|i| {
                let angle = (i as f64 - n as f64 / 2.0) * 0.5f64.to_radians();
                let (d_m, alpha) = walls[i / each];
                let off = (angle - alpha).clamp(-1.2, 1.2);
                let mut range_m = d_m / off.cos() + SIGMA_M * noise[i % noise.len()];
                if clutter.contains(&i) {
                    range_m *= 0.8;
                }
                (angle, range_m)
            })
            .collect()
    }

    fn noise() -> impl Strategy<Value = Vec<f64>> {
        // The sum of three uniform numbers, near enough to normal.
        proptest::collection::vec((-1.0..1.0f64, -1.0..1.0f64, -1.0..1.0f64), 7..97)
            .prop_map(|all| all.iter().map(|(a, b, c)| a + b + c).collect())
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(200))]

        /// Pruning changes nothing, on walls, kinks, steps, clutter and rough things alike.
        #[test]
        fn the_optimum_is_that_of_the_plain_recursion(
            walls in proptest::collection::vec((1.5..4.0f64, -0.6..0.6f64), 1..5),
            each in 5usize..70,
            roughness in prop_oneof![Just(0.0), Just(1.0), Just(1.0), Just(6.0), Just(30.0)],
            noise in noise(),
            clutter in proptest::collection::vec(0usize..200, 0..9),
            line in 5.0..60.0f64,
            clutter_cost in 2.0..25.0f64,
            min_run in 2usize..7,
        ) {
            let noise: Vec<f64> = noise.iter().map(|e| e * roughness).collect();
            let beams = beams(&walls, each, &noise, &clutter);
            let costs = Costs { line, clutter: clutter_cost, min_run, ..costs() };
            let mut partition = Partition::default();
            partition.find(beams.all(), &costs);
            let least = *partition.least.last().unwrap();
            let reference = plain(beams.all(), &costs);
            prop_assert!((least - reference).abs() <= 1e-7 * (1.0 + reference), "{least} {reference}");
            let lines = found(&partition);
            let real = cost(beams.all(), &lines, &costs);
            prop_assert!((real - reference).abs() <= 1e-4 * (1.0 + reference), "{real} {reference}");
            prop_assert!(lines.iter().all(|(a, b)| b - a >= min_run));
            prop_assert!(lines.windows(2).all(|pair| pair[0].1 <= pair[1].0));
        }

        /// And the plain recursion finds the best of all partitions.
        #[test]
        fn the_optimum_is_the_best_of_all_partitions(
            walls in proptest::collection::vec((1.5..4.0f64, -0.6..0.6f64), 1..3),
            each in 2usize..7,
            noise in noise(),
            clutter in proptest::collection::vec(0usize..12, 0..3),
        ) {
            let beams = beams(&walls, each, &noise, &clutter);
            let mut partition = Partition::default();
            partition.find(beams.all(), &costs());
            let best = brute(beams.all(), 0, &costs());
            let real = cost(beams.all(), &found(&partition), &costs());
            prop_assert!((real - best).abs() <= 1e-6 * (1.0 + best), "{real} {best}");
        }
    }

    #[test]
    fn most_candidates_are_never_looked_at() {
        // The bound must hold on a straight wall, or a scan takes ten times as long.
        let walls = [(3.0, 0.0)];
        let noise: Vec<f64> = (0..61)
            .map(|i| f64::from(i * 37 % 61) / 25.0 - 1.2)
            .collect();
        let beams = beams(&walls, 240, &noise, &[]);
        let mut partition = Partition::default();
        partition.find(beams.all(), &costs());
        assert_eq!(found(&partition), [(0, 240)]);
        assert!(
            partition.candidates.looks < 40,
            "{}",
            partition.candidates.looks
        );
    }
}
