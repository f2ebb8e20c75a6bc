//! Multi-start search that optimizes only a few of its starts: most poses that are expensive after one step onto the
//! constraints stay expensive, and most projections lead to the same few optima.

use std::ops::Range;

use gensim2_geometry::lanes::WIDTH;

use super::batch::{Arrival, Seed};
use super::projection::PROJECTIONS;
use super::seeds::NEARBY;
use super::{Actuation, ActuationSearch, Candidate, SAME};
use crate::model::{MAX_JOINTS, Row};

/// If fewer seeds than this converge, or if the cheapest pose lies outside the region of most seeds, half as many seeds
/// are added.
const ENOUGH: usize = 3;
/// Multiple of the number of seeds tried before the constraints count as infeasible.
const PERSISTENCE: usize = 5;
/// Number of steps after which seeds are compared.
const SCREEN: usize = 1;
/// One in this many seeds continues after the comparison.
const KEPT: usize = 4;
/// Number of steps that the continued seeds get first, enough for most that converge. Seeds that need more steps are
/// postponed.
const SOON: usize = 7;
/// Weight of a seed's remaining constraint error (m, rad) relative to its cost when seeds are compared.
const MISS: f32 = 10.0;
/// Share of the continued seeds that must converge; otherwise the constraints are hard to meet, and the other seeds
/// continue too.
const HARD: [usize; 2] = [3, 4];

/// Seeds and converged poses that the search for the cheapest pose has postponed.
#[derive(Default)]
pub(super) struct Aside {
    /// Seeds that were not continued.
    waiting: Vec<Seed>,
    /// Converged poses with a higher cost, not yet refined in double precision.
    arrived: Vec<Arrival>,
}

/// Poses that do not meet the constraints, in the order of discovery. Their errors matter only if no pose meets the
/// constraints.
type Missed = Vec<Row>;

impl ActuationSearch<'_> {
    /// Searches for the cheapest pose from the current joints, from points around them, and from points spread evenly
    /// over the joint ranges. It uses `seeds` starts, half as many more if few of them reach the constraints or if the
    /// cheapest pose lies far from the current joints, and more while no start reaches the constraints.
    ///
    /// Every start takes a step onto the constraints. The cheapest quarter continues, and the others only if few of
    /// these converge. The cheapest distinct poses are then optimized.
    pub fn cheapest(&mut self, seeds: usize) -> Actuation {
        let (most, last) = (seeds + seeds / 2, PERSISTENCE * seeds);
        let mut missed = Missed::new();
        let mut used = 0;
        self.aside = Aside::default();
        loop {
            let (mut arrived, mut sent): (Vec<Arrival>, usize) = (Vec::new(), 0);
            while !self.over.is_cancelled() {
                let few = arrived.len() < ENOUGH;
                let hard = few || HARD[1] * arrived.len() < HARD[0] * sent;
                let end = match used {
                    _ if used < seeds => seeds,
                    _ if used < most && (few || self.are_far(&arrived)) => most,
                    _ if hard && !self.aside.waiting.is_empty() => used,
                    _ if used < last && arrived.is_empty() => (used + WIDTH).min(last),
                    _ => break,
                };
                let (from, steps) = match end {
                    _ if end == used => (std::mem::take(&mut self.aside.waiting), PROJECTIONS),
                    _ if end <= most => (self.screened(used..end), SOON),
                    _ => ((used..end).map(|k| self.seed(self.further_start(k - most))).collect(), PROJECTIONS),
                };
                let (near, late) = self.arrivals(&from, steps, &mut missed);
                (used, sent) = (end, sent + from.len() - late.len());
                arrived.extend(near);
                self.aside.waiting.extend(late);
            }
            self.aside.arrived = self.distinct_arrivals(arrived);
            let candidates = self.descend_cheapest(&mut missed);
            if !candidates.is_empty() {
                return Actuation { candidates, best_effort: None };
            }
            if sent == 0 {
                return Actuation { candidates, best_effort: self.least_missed(&missed) };
            }
        }
    }

    /// Returns the pose with the smallest constraint error; the first one if several are equal.
    fn least_missed(&mut self, missed: &Missed) -> Option<Row> {
        let mut best: Option<(f64, &Row)> = None;
        for x in missed {
            let miss = self.violation(x);
            if best.is_none_or(|(least, _)| miss < least) {
                best = Some((miss, x));
            }
        }
        best.map(|(_, x)| self.model.unwound(x, &self.start))
    }

    /// Returns every distinct pose that the seeds lead to, cheapest first, for use when the cheapest pose allows no
    /// collision-free motion. Poses away from an optimum are included. `known` are poses that were already found.
    pub fn others(&mut self, known: &[Candidate]) -> Vec<Candidate> {
        let mut missed = Missed::new();
        let Aside { waiting, mut arrived } = std::mem::take(&mut self.aside);
        arrived.extend(self.arrivals(&waiting, PROJECTIONS, &mut missed).0);
        let mut poses = known.to_vec();
        for arrival in arrived {
            if self.over.is_cancelled() {
                break;
            }
            poses.extend(self.home(&arrival, &mut missed));
        }
        self.distinct(poses)
    }

    /// Returns the cheapest pose and all other poses that the seeds lead to.
    pub fn all(&mut self, seeds: usize) -> Actuation {
        let found = self.cheapest(seeds);
        Actuation { candidates: self.others(&found.candidates), best_effort: found.best_effort }
    }

    /// Creates a seed with unlimited joints unwound, since single precision is most accurate near zero.
    fn seed(&self, x: Row) -> Seed {
        Seed::at(self.model.unwound(&x, &[0.0; MAX_JOINTS]))
    }

    /// Returns the start values with the lowest cost after the first steps; the others are postponed.
    fn screened(&mut self, numbers: Range<usize>) -> Vec<Seed> {
        let seeds: Vec<Seed> = numbers.map(|k| self.seed(self.start(k))).collect();
        let seen = self.batch.project(&seeds, SCREEN);
        let rank = |(k, a): (usize, &Arrival)| (a.cost + MISS * a.miss.sqrt(), k);
        let mut order: Vec<(f32, usize)> = seen.iter().enumerate().map(rank).collect();
        order.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let (kept, waiting) = order.split_at(order.len().div_ceil(KEPT));
        self.aside.waiting.extend(waiting.iter().map(|(_, k)| seen[*k].seed));
        kept.iter().map(|(_, k)| seen[*k].seed).collect()
    }

    /// Returns the seeds that meet the constraints in single precision within `steps`, and those that may with more
    /// steps.
    fn arrivals(&mut self, from: &[Seed], steps: usize, missed: &mut Missed) -> (Vec<Arrival>, Vec<Seed>) {
        let (mut near, mut late) = (Vec::new(), Vec::new());
        for arrival in self.batch.project(from, steps) {
            if arrival.near {
                near.push(arrival);
                continue;
            }
            if arrival.late && steps < PROJECTIONS {
                late.push(arrival.seed);
            } else {
                missed.push(arrival.seed.x);
            }
        }
        (near, late)
    }

    /// Refines a converged pose in double precision; `None` if it does not meet the constraints.
    fn home(&mut self, arrival: &Arrival, missed: &mut Missed) -> Option<Candidate> {
        let mut x = arrival.seed.x;
        if self.project(&mut x) > 0.0 {
            missed.push(x);
            return None;
        }
        Some(self.candidate(&x))
    }

    /// Refines and optimizes the cheapest converged poses; the others are postponed.
    fn descend_cheapest(&mut self, missed: &mut Missed) -> Vec<Candidate> {
        let mut arrived = std::mem::take(&mut self.aside.arrived).into_iter();
        let (mut poses, mut optima): (Vec<Candidate>, Vec<Candidate>) = (Vec::new(), Vec::new());
        while poses.len() < self.problem.options.num_refinements && !self.over.is_cancelled() {
            let Some(arrival) = arrived.next() else { break };
            let Some(pose) = self.home(&arrival, missed) else { continue };
            optima.extend(self.descend(&pose.x, &optima));
            poses.push(pose);
        }
        self.aside.arrived = arrived.collect();
        poses.extend(optima);
        self.distinct(poses)
    }

    /// Sorts converged poses by cost and drops those close to a cheaper one.
    fn distinct_arrivals(&self, mut arrived: Vec<Arrival>) -> Vec<Arrival> {
        arrived.sort_by(|a, b| a.cost.total_cmp(&b.cost));
        let mut out: Vec<Arrival> = Vec::new();
        for arrival in arrived {
            if !out.iter().any(|a| self.model.are_near(&a.seed.x, &arrival.seed.x, SAME)) {
                out.push(arrival);
            }
        }
        out
    }

    /// Returns whether the cheapest pose lies outside the region of seeds around the current joints, in a region with
    /// few seeds.
    fn are_far(&self, arrived: &[Arrival]) -> bool {
        let best = arrived.iter().min_by(|a, b| a.cost.total_cmp(&b.cost));
        best.is_some_and(|best| {
            (0..self.model.n()).any(|v| {
                let (low, high) = self.model.range(v);
                (best.seed.x[v] - self.start[v]).abs() > 0.5 * NEARBY * (high - low)
            })
        })
    }
}
