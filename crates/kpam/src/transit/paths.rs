//! Repeated searches for a path, with ever more samples.

use super::field::Field;
use super::shorten;
use super::tree::{self, Manner, Unmet};
use crate::model::Row;

/// Maximum number of searches for one motion.
const TRIES: usize = 200;
/// Number of samples of the shortest search. Search times have a heavy tail, so many short searches with occasional
/// longer ones succeed where one long search fails (Luby, Sinclair and Zuckerman, 1993).
const SHORTEST: usize = 1000;
/// Number of samples of the first search, which is plain rather than thorough and solves most problems. The first
/// search uses at most half of all samples.
const PLAIN: usize = 250;

/// Searches for paths from one configuration to several, until their samples are used up.
pub(crate) struct Searches {
    /// Number of samples that are left.
    left: usize,
    attempt: usize,
    seed: usize,
}

impl Searches {
    pub fn new(samples: usize, seed: usize) -> Self {
        Self { left: samples, attempt: 0, seed }
    }

    /// Returns the paths that the next search gives, the preferred one first, or the reason of its failure. `None` if the
    /// samples are used up or the search must end. `pace` weights each variable of a path's length.
    pub fn next(
        &mut self,
        field: &mut Field<'_>,
        from: &Row,
        to: &[Row],
        pace: &Row,
    ) -> Option<Result<Vec<Vec<Row>>, Unmet>> {
        if self.attempt > 0 && (self.left == 0 || self.attempt == TRIES || field.is_over()) {
            return None;
        }
        let (samples, manner) = match self.attempt {
            0 => (PLAIN.min(self.left.div_ceil(2)), Manner::Plain),
            attempt => (self.left.min(SHORTEST * luby(attempt)), Manner::Thorough),
        };
        let seed = self.seed + self.attempt;
        self.attempt += 1;
        let found = tree::search(field, from, to, samples, seed, manner);
        if found.is_err() {
            self.left -= samples;
        }
        Some(found.map(|mut path| {
            shorten::shorten(field, &mut path, pace, seed);
            // The path before tightening is the fallback if no motion is found along the tightened path.
            shorten::tauten(field, &path, pace).into_iter().chain([path]).collect()
        }))
    }
}

/// Returns element `i`, from 1, of the Luby sequence 1, 1, 2, 1, 1, 2, 4, 1, ...
fn luby(i: usize) -> usize {
    let size = (i + 1).next_power_of_two();
    if size == i + 1 { size / 2 } else { luby(i + 1 - size / 2) }
}

#[cfg(test)]
mod tests {
    use super::luby;

    #[test]
    fn restarts_are_lubys() {
        let first: Vec<usize> = (1..=15).map(luby).collect();
        assert_eq!(first, [1, 1, 2, 1, 1, 2, 4, 1, 1, 2, 1, 1, 2, 4, 8]);
    }
}
