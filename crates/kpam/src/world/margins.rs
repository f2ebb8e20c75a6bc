//! Required clearances between pairs of bodies.

use super::Overlaps;
use crate::world::TOUCH;

/// Distances (m) of some pairs by [`World::place_of`](super::World::place_of), infinite for the others.
#[derive(Debug, Clone, Default)]
pub(crate) struct Distances(Vec<f64>);

impl Distances {
    pub fn get(&self, place: usize) -> f64 {
        self.0.get(place).copied().unwrap_or(f64::INFINITY)
    }

    /// Reduces the distance of a pair to `distance`, if that is smaller.
    pub fn reduce(&mut self, place: usize, distance: f64) {
        if self.0.len() <= place {
            self.0.resize(place + 1, f64::INFINITY);
        }
        self.0[place] = self.0[place].min(distance);
    }

    pub fn clear(&mut self) {
        self.0.clear();
    }

    /// Iterates over the finite distances and their places.
    pub fn iter(&self) -> impl Iterator<Item = (usize, f64)> {
        self.0.iter().copied().enumerate().filter(|(_, distance)| distance.is_finite())
    }
}

/// Required clearance of checked pairs, and smaller values for pairs that cannot keep it.
#[derive(Debug, Clone)]
pub(crate) struct Margins {
    /// Whether pairs that overlap at the start may continue to overlap.
    pub forgiving: bool,
    pub clearance: f64,
    pub smaller: Distances,
}

impl Margins {
    pub fn plain(clearance: f64) -> Self {
        Self { forgiving: true, clearance, smaller: Distances::default() }
    }

    /// Returns margins for a motion after the overlaps at the start have ended; they must not occur again.
    pub fn parted(self) -> Self {
        Self { forgiving: false, ..self }
    }

    /// Returns the margins with another clearance; smaller values for pairs close at the ends are unchanged.
    pub fn with_clearance(&self, clearance: f64) -> Self {
        Self { clearance, ..self.clone() }
    }

    /// Returns the margin of a pair that may overlap by `depth`, or by as much as it overlaps at the start.
    pub(super) fn touching(&self, known: &Overlaps, place: usize, depth: f64) -> f64 {
        known.start.get(place).min(-depth) - TOUCH
    }

    /// Returns the margin of a pair for a required `clearance`, with tolerance for rounding. A pair that is too close at
    /// the start need not move apart until it has been separated, and an overlap of a picked body may persist.
    pub(super) fn of(&self, known: &Overlaps, place: usize, clearance: f64) -> f64 {
        let start = if self.forgiving { known.start.get(place) } else { f64::INFINITY };
        (clearance.min(start).min(known.picked.get(place)) - TOUCH).min(self.smaller.get(place))
    }
}
