//! Searches from many start values, but optimizes only a few of them: a pose that is expensive after one step onto the
//! constraints usually stays expensive, and most projections lead to the same few optima.

use std::ops::Range;

use gensim2_geometry::lanes::WIDTH;

use super::batch::{Arrival, Seed};
use super::projection::{Aim, PROJECTIONS};
use super::seeds::NEARBY;
use super::{Actuation, ActuationSearch, Candidate, SAME};
use crate::model::{MAX_JOINTS, Row};

/// If fewer start values than this converge, or if the cheapest pose lies outside the region of most start values, the
/// search tries half as many start values in addition.
const ENOUGH: usize = 3;
/// Multiple of the number of start values that are tried before the constraints count as infeasible.
const PERSISTENCE: usize = 5;
/// Number of projection steps after which start values are compared by cost.
const SCREEN: usize = 1;
/// After the comparison, one in this many start values continues.
const KEPT: usize = 4;
/// Number of further steps for start values that continue, enough for most of those that converge. The others are
/// postponed.
const SOON: usize = 7;
/// Weight of the remaining constraint error (m, rad) relative to the cost when start values are compared.
const MISS: f32 = 10.0;
/// Fraction (numerator, denominator) of the continued start values that must converge. If fewer do, the constraints are
/// hard to meet, and the other start values continue too.
const HARD: [usize; 2] = [3, 4];

/// If no pose is found near the centre of the tolerances, the search restarts from this many poses with the smallest
/// constraint error.
const EDGE: usize = 64;

/// Start values and poses that were postponed while the cheapest pose is searched.
#[derive(Default)]
pub(super) struct Aside {
    /// Start values that did not continue after the comparison.
    waiting: Vec<Seed>,
    /// Poses with a higher cost, which have converged in single precision and have not been refined yet.
    arrived: Vec<Arrival>,
}

/// Poses that do not meet the constraints, in the order in which they were found. They matter only if no pose meets the
/// constraints.
type Missed = Vec<Row>;

impl ActuationSearch<'_> {
    /// Searches for the cheapest pose that meets the constraints. Start values are the current joints, points around
    /// them, and points all over the joint ranges. There are `seeds` of them; half as many more if few converge or if
    /// the cheapest pose lies far from the current joints; and more as long as none converges.
    ///
    /// Every start value makes one step onto the constraints. The cheapest quarter continues; the others only if few of
    /// these converge. Then the cheapest distinct poses are optimized.
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
                let candidates = self.at_the_edge(&missed);
                let best_effort = if candidates.is_empty() { self.least_missed(&missed) } else { None };
                return Actuation { candidates, best_effort };
            }
        }
    }

    /// Returns poses anywhere within the tolerances, cheapest first. Projections aim near the centre of the tolerances, so
    /// they miss a target that the arm reaches only with its tool tilted as far as the tolerances allow.
    fn at_the_edge(&mut self, missed: &Missed) -> Vec<Candidate> {
        let mut nearest: Vec<(f64, &Row)> = missed.iter().map(|x| (self.violation(x), x)).collect();
        nearest.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut poses = Vec::new();
        self.aim = Aim::anywhere();
        for (_, x) in nearest.into_iter().take(EDGE) {
            if self.over.is_cancelled() {
                break;
            }
            let mut x = *x;
            if self.project(&mut x) <= 0.0 {
                poses.push(self.candidate(&x));
            }
        }
        self.aim = Aim::default();
        let mut poses = self.distinct(poses);
        let mut optima: Vec<Candidate> = Vec::new();
        for pose in poses.iter().take(self.problem.options.num_refinements) {
            optima.extend(self.descend(&pose.x, &optima));
        }
        poses.extend(optima);
        self.distinct(poses)
    }

    /// Returns the pose with the smallest constraint error; of several, the one found first.
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

    /// Returns all distinct poses that the postponed start values lead to, cheapest first. They are needed if the
    /// cheapest pose allows no collision-free motion, and need not be optima. `known` holds the poses found before.
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

    /// Returns the cheapest pose and all other poses that the start values lead to.
    pub fn all(&mut self, seeds: usize) -> Actuation {
        let found = self.cheapest(seeds);
        Actuation { candidates: self.others(&found.candidates), best_effort: found.best_effort }
    }

    /// Creates a start value with unlimited joints shifted close to zero, where single precision is best.
    fn seed(&self, x: Row) -> Seed {
        Seed::at(self.model.unwound(&x, &[0.0; MAX_JOINTS]))
    }

    /// Returns the start values that are the cheapest after the first step; the others are postponed.
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

    /// Projects start values with at most `steps` steps. Returns those that meet the constraints in single precision,
    /// and the start values that may meet them after more steps.
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

    /// Refines a pose in double precision; returns `None` if it does not meet the constraints.
    fn home(&mut self, arrival: &Arrival, missed: &mut Missed) -> Option<Candidate> {
        let mut x = arrival.seed.x;
        if self.project(&mut x) > 0.0 {
            missed.push(x);
            return None;
        }
        Some(self.candidate(&x))
    }

    /// Refines and optimizes the cheapest poses that have converged; the others are postponed.
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

    /// Sorts converged poses by cost, and drops each pose that nearly equals a cheaper one.
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

    /// Returns whether the cheapest pose lies outside the region around the current joints, where start values are
    /// sparse.
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

#[cfg(test)]
mod tests {
    use super::super::seeds::halton;
    use super::super::tests::problem;
    use super::*;
    use crate::model::{Model, Placed};

    /// Calls `test` with problems whose tool is tilted by 0.85 of the tolerance, and with joints that solve them; the
    /// sliding joint is `slide` of a number between 0 and 1. Returns how many tests hold, and how many were called.
    fn tilted(
        slide: impl Fn(f64) -> f64,
        mut test: impl FnMut(crate::KeypointProblem, &Model, &Row) -> bool,
    ) -> [usize; 2] {
        let template = problem(-1.0, 0.4, [0.5, 0.1, 0.3]);
        let model = Model::new(&template.robot, &template.q_start).unwrap();
        let mut placed = Placed::default();
        let (mut held, mut targets) = (0, 0);
        for number in 1..=80 {
            let mut q = [0.0; MAX_JOINTS];
            for (v, value) in q.iter_mut().enumerate().take(model.n()) {
                *value = 4.0 * (halton(number, v) - 0.5);
            }
            q[2] = slide(halton(number, 2));
            placed.place(&template.robot, &model, &q);
            let along = placed.hand.rotation * nalgebra::Vector3::z();
            let target = placed.hand.translation.vector + 0.1 * along;
            let center = along.z.acos() + if number % 2 == 0 { 0.34 } else { -0.34 };
            if !(0.5..=2.6).contains(&center) {
                continue;
            }
            let mut problem = problem(center.cos(), 0.4, target.into());
            problem.options.workspace = None;
            held += usize::from(test(problem, &model, &q));
            targets += 1;
        }
        [held, targets]
    }

    /// The arm is almost stretched: hardly any pose with a smaller tilt reaches the target.
    #[test]
    fn targets_that_need_most_of_the_tolerance_are_reached() {
        let [reached, targets] = tilted(
            |share| 4.0 * (share - 0.5) * 0.05,
            |problem, model, q| {
                let resolved = problem.resolve().unwrap();
                let mut search = ActuationSearch::new(&problem, model, &resolved);
                assert!(search.violation(q) <= 0.0, "{q:?}");
                let found = search.all(problem.options.num_seeds);
                assert!(found.candidates.iter().all(|c| search.violation(&c.x) <= 0.0), "{q:?}");
                !found.candidates.is_empty()
            },
        );
        assert!(10 * reached > 9 * targets, "{reached} of {targets}");
    }

    /// After the actuation pose, the hand moves on by 3 cm. Several of these motions exist only if the tool is tilted as
    /// far as the tolerance allows.
    #[test]
    fn motions_that_need_most_of_the_tolerance_are_planned() {
        let [solved, targets] = tilted(
            |share| 0.15 + 0.4 * share,
            |mut problem, _, _| {
                problem.config.post.push(crate::config::Motion::Translate { axis: 2, distance: 0.03 });
                crate::plan::plan(&problem).status() == crate::Status::Solved
            },
        );
        // Without poses at the edge of the tolerances, 55 are solved. Some of the others have no motion.
        assert!(solved >= 57, "{solved} of {targets}");
    }
}
