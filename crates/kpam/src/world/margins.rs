//! Required clearances between pairs of bodies.

use std::collections::BTreeMap;

use super::Overlaps;
use super::query::Seen;
use crate::world::TOUCH;

/// Required clearance of checked pairs, and smaller values for pairs that cannot keep it.
#[derive(Debug, Clone)]
pub(crate) struct Margins {
    /// Whether pairs that overlap at the start may continue to overlap.
    pub forgiving: bool,
    pub clearance: f64,
    pub bodies: BTreeMap<(usize, usize), f64>,
    pub pairs: BTreeMap<usize, f64>,
}

impl Margins {
    pub fn plain(clearance: f64) -> Self {
        Self { forgiving: true, clearance, bodies: BTreeMap::new(), pairs: BTreeMap::new() }
    }

    /// Reduces the margin of a group and another body to `margin`, if that is smaller.
    pub(super) fn reduce(&mut self, group: usize, seen: Seen, margin: f64) {
        let kept = match seen {
            Seen::Body(body) => self.bodies.entry((group, body)).or_insert(margin),
            Seen::Pair(pair) => self.pairs.entry(pair).or_insert(margin),
        };
        *kept = kept.min(margin);
    }

    /// Returns margins for a motion after the overlaps at the start have ended; they must not occur again.
    pub fn parted(self) -> Self {
        Self { forgiving: false, ..self }
    }

    /// Returns the margins with another clearance; smaller values for pairs close at the ends are unchanged.
    pub fn with_clearance(&self, clearance: f64) -> Self {
        Self { clearance, ..self.clone() }
    }

    /// Returns the margin of a group and a fixed body for a required `clearance`.
    pub fn body(&self, known: &Overlaps, group: usize, body: usize, clearance: f64) -> f64 {
        let (start, picked) = known.body(group, body);
        self.asked(self.bodies.get(&(group, body)), clearance, start, picked)
    }

    /// Returns the margin of a pair that may overlap by `depth`, or by as much as it overlaps at the start.
    pub(super) fn touching(&self, known: &Overlaps, group: usize, seen: Seen, depth: f64) -> f64 {
        let (start, _) = match seen {
            Seen::Body(body) => known.body(group, body),
            Seen::Pair(pair) => known.pair(pair),
        };
        (-depth).min(start) - TOUCH
    }

    /// Returns the margin of a pair of groups.
    pub fn pair(&self, known: &Overlaps, pair: usize) -> f64 {
        let (start, picked) = known.pair(pair);
        self.asked(self.pairs.get(&pair), self.clearance, start, picked)
    }

    /// Returns the required distance with tolerance for rounding. A pair that is too close at the start need not move
    /// apart until it has been separated, and an overlap of a picked body may persist.
    fn asked(&self, less: Option<&f64>, clearance: f64, start: f64, picked: f64) -> f64 {
        let asked = less.map_or(clearance - TOUCH, |less| less.min(clearance - TOUCH));
        let start = if self.forgiving { start } else { f64::INFINITY };
        asked.min(start.min(picked) - TOUCH)
    }
}
