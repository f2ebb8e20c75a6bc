//! The clearance that is asked of pairs.

use super::Overlaps;
use crate::world::TOUCH;

/// Clearance asked of judged pairs, and less where a pair cannot keep it.
#[derive(Debug, Clone)]
pub(crate) struct Margins {
    /// Whether overlaps of the start may persist.
    pub forgiving: bool,
    pub clearance: f64,
    pub bodies: Vec<((usize, usize), f64)>,
    pub pairs: Vec<(usize, f64)>,
}

impl Margins {
    pub fn plain(clearance: f64) -> Self {
        Self { forgiving: true, clearance, bodies: Vec::new(), pairs: Vec::new() }
    }

    /// The same margins after the overlaps of the start have come apart: they may not come back.
    pub fn parted(self) -> Self {
        Self { forgiving: false, ..self }
    }

    /// The same margins, all `by` smaller.
    pub fn eased(&self, by: f64) -> Self {
        let mut out = self.clone();
        out.clearance -= by.min(out.clearance);
        out.bodies.iter_mut().for_each(|(_, d)| *d = (*d - by).max(d.min(-TOUCH)));
        out.pairs.iter_mut().for_each(|(_, d)| *d = (*d - by).max(d.min(-TOUCH)));
        out
    }

    /// What is asked of a group and a body that stands, from which at least `least` is to be kept.
    pub fn body(&self, known: &Overlaps, group: usize, body: usize, least: f64) -> f64 {
        let (start, picked) = known.body(group, body);
        self.asked(&self.bodies, (group, body), self.clearance.max(least), start, picked)
    }

    /// What is asked of a pair of groups.
    pub fn pair(&self, known: &Overlaps, pair: usize) -> f64 {
        let (start, picked) = known.pair(pair);
        self.asked(&self.pairs, pair, self.clearance, start, picked)
    }

    /// Rounding is forgiven; what is too near at the start may stay so until it has parted, and what overlaps where a
    /// body is picked may persist.
    fn asked<K: PartialEq + Copy>(&self, less: &[(K, f64)], key: K, clearance: f64, start: f64, picked: f64) -> f64 {
        let asked = less.iter().filter(|(k, _)| *k == key).fold(clearance - TOUCH, |least, (_, d)| least.min(*d));
        let start = if self.forgiving { start } else { f64::INFINITY };
        asked.min(start.min(picked) - TOUCH)
    }
}
