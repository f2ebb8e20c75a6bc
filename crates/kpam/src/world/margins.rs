//! The clearance that is asked of pairs.

use super::Overlaps;
use super::query::Seen;
use crate::world::TOUCH;

/// Clearance asked of checked pairs, and less where a pair cannot keep it.
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

    /// The same margins with another clearance: what the ends leave stays.
    pub fn with_clearance(&self, clearance: f64) -> Self {
        Self { clearance, ..self.clone() }
    }

    /// Margin of a group and a body that stands, where `clearance` is kept.
    pub fn body(&self, known: &Overlaps, group: usize, body: usize, clearance: f64) -> f64 {
        let (start, picked) = known.body(group, body);
        self.asked(&self.bodies, (group, body), clearance, start, picked)
    }

    /// Margin of two things that may overlap by `depth`, or as they do at the start.
    pub(super) fn touching(&self, known: &Overlaps, group: usize, seen: Seen, depth: f64) -> f64 {
        let (start, _) = match seen {
            Seen::Body(body) => known.body(group, body),
            Seen::Pair(pair) => known.pair(pair),
        };
        (-depth).min(start) - TOUCH
    }

    /// Margin of a pair of groups.
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
