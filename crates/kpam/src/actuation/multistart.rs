//! Many starts, few of which are taken to the end: most that look dear after a step onto the constraints are dear, and most
//! arrivals end in the same few optima.

use std::ops::Range;

use gensim2_geometry::lanes::WIDTH;

use super::batch::{Arrival, Seed};
use super::projection::PROJECTIONS;
use super::seeds::NEARBY;
use super::{Actuation, ActuationSearch, Candidate, SAME};
use crate::model::{MAX_JOINTS, Row};

/// Half as many seeds again are spent while fewer than this many have led to the constraints, or where the cheapest pose
/// lies beyond where most of them lie.
const ENOUGH: usize = 3;
/// So many times as many are spent before it is said that none leads there.
const PERSISTENCE: usize = 5;
/// Steps after which seeds are compared.
const SCREEN: usize = 1;
/// One of so many goes on then.
const KEPT: usize = 4;
/// Steps that those get first: most that arrive have by then. The others wait, as those that did not go on.
const SOON: usize = 7;
/// Weight of what a seed still misses the constraints by (m, rad) beside its cost, when seeds are compared.
const MISS: f32 = 10.0;
/// Share of the continued seeds that must arrive; below it the constraints are hard to meet, and the others continue too.
const HARD: [usize; 2] = [3, 4];

/// Seeds and arrivals that the search for the cheapest pose has postponed.
#[derive(Default)]
pub(super) struct Aside {
    /// Seeds that did not go on.
    waiting: Vec<Seed>,
    /// Arrivals that cost more, not brought home.
    arrived: Vec<Arrival>,
}

/// Poses that miss the constraints, in the order in which they were found. By how much matters only where no pose meets
/// them.
type Missed = Vec<Row>;

impl ActuationSearch<'_> {
    /// Searches for the cheapest pose from the present joints, from points about them, and from points spread evenly over
    /// the joint ranges: `seeds` of them, half as many more where few lead to the constraints or the cheapest pose lies
    /// beyond the points about the present joints, and wider ones while none does.
    ///
    /// Every start takes a step onto the constraints; a quarter of them, that cost least by then, go on, and the others
    /// where few of those arrive. The cheapest of the distinct poses that gives are then moved to their optima.
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

    /// The pose that misses the constraints least, the first of equals.
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

    /// Every distinct pose that the seeds lead to, cheapest first, where the motion to the cheapest one may not be free:
    /// off the optimum there are other points of the constraint set. `known` are poses that are found already.
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

    /// The cheapest pose and all others that the seeds lead to.
    pub fn all(&mut self, seeds: usize) -> Actuation {
        let found = self.cheapest(seeds);
        Actuation { candidates: self.others(&found.candidates), best_effort: found.best_effort }
    }

    /// A start value. Single precision knows angles near zero best; whole turns of joints without limits change nothing.
    fn seed(&self, x: Row) -> Seed {
        Seed::at(self.model.unwound(&x, &[0.0; MAX_JOINTS]))
    }

    /// Those of the start values that cost least after the first steps; the others wait.
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

    /// Arrivals of seeds that meet the constraints in single precision within `steps`, and those that may with more.
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

    /// The pose of an arrival, where it meets the constraints in double precision too.
    fn home(&mut self, arrival: &Arrival, missed: &mut Missed) -> Option<Candidate> {
        let mut x = arrival.seed.x;
        if self.project(&mut x) > 0.0 {
            missed.push(x);
            return None;
        }
        Some(self.candidate(&x))
    }

    /// Brings the cheapest arrivals home and down to their optima; the others stay aside.
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

    /// Arrivals by cost, without those that are near a cheaper one.
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

    /// Whether the cheapest arrival lies beyond the seeds about the present joints: what is cheapest there is told by few
    /// seeds.
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
