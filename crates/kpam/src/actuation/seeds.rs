//! Start values of the search for the actuation pose. They are evenly spread and the same on every machine.

use std::sync::LazyLock;

use super::ActuationSearch;
use crate::model::{MAX_JOINTS, Row};

/// Width of the region around the current joints for start values, as a fraction of each joint's range.
pub(super) const NEARBY: f64 = 0.4;
/// One in this many start values lies anywhere in the joint ranges; the others are near the current joints.
const ANYWHERE: usize = 3;
/// Width of the larger region for additional start values, which are tried if the cheap poses allow no motion. They
/// alternate with start values anywhere in the joint ranges.
const FURTHER: f64 = 2.0 * NEARBY;
/// Length of the sequence's section for one random seed: more points than a plan uses, coprime to the bases.
const STRETCH: usize = 104_729;

impl ActuationSearch<'_> {
    /// Returns start value `index`: first the current joints, then points around them, with every third point anywhere
    /// in the joint ranges. Each of the two kinds has its own counter, because the odd points of a Halton sequence, for
    /// example, all lie in one half of the first joint's range.
    pub(super) fn start(&self, index: usize) -> Row {
        if index == 0 {
            return self.start;
        }
        let so_far = index.div_ceil(ANYWHERE);
        if index % ANYWHERE == 1 { self.anywhere(so_far) } else { self.near(index - so_far, NEARBY) }
    }

    /// Returns additional start value `index`, which serves to find poses other than the cheapest. The sequence
    /// continues after the first start values, because repeated points would lead to the same poses.
    pub(super) fn further_start(&self, index: usize) -> Row {
        let first = self.problem.options.num_seeds + self.problem.options.num_seeds / 2;
        let number = first.div_ceil(ANYWHERE) + 1 + index / 2;
        if index.is_multiple_of(2) { self.anywhere(number) } else { self.near(number, FURTHER) }
    }

    fn anywhere(&self, number: usize) -> Row {
        let (mut x, number) = (self.start, self.drawn(number));
        for (v, value) in x.iter_mut().enumerate().take(self.model.n()) {
            let (low, high) = self.model.range(v);
            *value = low + (high - low) * halton(number, v);
        }
        x
    }

    fn near(&self, number: usize, width: f64) -> Row {
        let (mut x, number) = (self.start, self.drawn(number));
        for (v, value) in x.iter_mut().enumerate().take(self.model.n()) {
            let (low, high) = self.model.range(v);
            *value = (*value + width * (high - low) * (halton(number, v) - 0.5)).clamp(low, high);
        }
        x
    }

    /// Returns the index of point `number` in the Halton sequence; each random seed has its own section.
    fn drawn(&self, number: usize) -> usize {
        self.problem.options.seed * STRETCH + number
    }
}

/// Number of precomputed points of the Halton sequence; most plans use fewer.
const READY: usize = 256;

/// Returns coordinate `dimension` of point `index` of the Halton sequence, which is evenly spread and the same on every
/// machine. Digits are multiplied by a factor near the golden section of each base, because otherwise the first points
/// are correlated in large bases. On 230 recorded and 360 generated problems, 32 points scrambled in this way find the
/// cheapest pose as often as 48 unscrambled ones.
pub(crate) fn halton(index: usize, dimension: usize) -> f64 {
    static POINTS: LazyLock<Vec<Row>> =
        LazyLock::new(|| (0..READY).map(|index| std::array::from_fn(|d| inverted_digits(index, d))).collect());
    let dimension = dimension % MAX_JOINTS;
    POINTS.get(index).map_or_else(|| inverted_digits(index, dimension), |point| point[dimension])
}

fn inverted_digits(index: usize, dimension: usize) -> f64 {
    const BASES: [usize; MAX_JOINTS] = [2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37, 41, 43, 47, 53];
    const FACTORS: [usize; MAX_JOINTS] = [1, 2, 3, 4, 7, 8, 11, 12, 14, 18, 19, 23, 25, 27, 29, 33];
    let (base, factor) = (BASES[dimension], FACTORS[dimension]);
    let (mut rest, mut unit, mut out) = (index, 1.0, 0.0);
    while rest > 0 {
        unit /= base as f64;
        out += unit * (rest % base * factor % base) as f64;
        rest /= base;
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::actuation::tests::problem;
    use crate::model::Model;

    #[test]
    fn each_seed_starts_elsewhere_but_for_the_present_joints() {
        let seeds = |seed: usize| -> Vec<Row> {
            let mut problem = problem(-1.0, 0.02, [0.5, 0.1, 0.3]);
            problem.options.seed = seed;
            let model = Model::new(&problem.robot, &problem.q_start).unwrap();
            let resolved = problem.resolve().unwrap();
            let search = ActuationSearch::new(&problem, &model, &resolved);
            (0..48).map(|index| search.start(index)).chain((0..50).map(|index| search.further_start(index))).collect()
        };
        let (first, again, second, last) = (seeds(0), seeds(0), seeds(1), seeds(1_000_000));
        assert_eq!(first, again);
        assert_eq!(first[0], second[0]);
        for index in 1..first.len() {
            assert!(!second.contains(&first[index]) && !last.contains(&first[index]) && !last.contains(&second[index]));
        }
    }

    #[test]
    fn starts_of_either_kind_cover_the_whole_range_of_every_joint() {
        let problem = problem(-1.0, 0.02, [0.5, 0.1, 0.3]);
        let model = Model::new(&problem.robot, &problem.q_start).unwrap();
        let resolved = problem.resolve().unwrap();
        let search = ActuationSearch::new(&problem, &model, &resolved);
        // Each fifth of a joint's range must get its share of the points, for few points as in a plan and for many.
        for (count, least, most) in [(60, 2, 7), (3000, 180, 220)] {
            for v in 0..model.n() {
                let (low, high) = model.range(v);
                let width = high - low;
                let near = model.start()[v] - 0.5 * NEARBY * width;
                let (mut anywhere, mut nearby) = ([0; 5], [0; 5]);
                for index in 1..=count {
                    let x = search.start(index)[v];
                    assert!((low..=high).contains(&x));
                    if index % ANYWHERE == 1 {
                        anywhere[(5.0 * (x - low) / width) as usize] += 1;
                    } else {
                        nearby[(5.0 * (x - near) / (NEARBY * width)) as usize] += 1;
                    }
                }
                assert!(anywhere.iter().all(|b| (least..=most).contains(b)), "joint {v}: {anywhere:?}");
                assert!(nearby.iter().all(|b| (2 * least..=2 * most).contains(b)), "joint {v}: {nearby:?}");
            }
        }
    }
}
