//! Paths in joint space, and the movement of the joints along them.

use super::{State, World};
use crate::model::{Row, between};

/// Waypoints joined by straight lines in joint space, and the travel of the object's joint at each waypoint (empty if
/// this joint does not move).
#[derive(Debug, Clone, Copy)]
pub(crate) struct Way<'w> {
    pub waypoints: &'w [Row],
    pub travel: &'w [f64],
    /// Permitted deviation (rad or m) of each joint from the straight segment after each waypoint; empty for none.
    pub off: &'w [Row],
}

impl<'w> Way<'w> {
    /// Returns a path on which the object's joint does not move.
    pub fn still(waypoints: &'w [Row]) -> Self {
        Self { waypoints, travel: &[], off: &[] }
    }

    pub(super) fn travel_at(&self, waypoint: usize) -> f64 {
        self.travel.get(waypoint).or(self.travel.last()).copied().unwrap_or(0.0)
    }

    /// Returns the state at a waypoint.
    pub fn state(&self, waypoint: usize) -> State<'w> {
        State { x: &self.waypoints[waypoint], travel: self.travel_at(waypoint) }
    }

    /// Returns the part up to and including waypoint `last`.
    pub fn until(&self, last: usize) -> Self {
        Self { waypoints: &self.waypoints[..=last], ..*self }
    }

    /// Returns joint values and travel at position `t`, a fractional index of the waypoints.
    pub(super) fn at(&self, t: f64) -> (Row, f64) {
        let last = self.waypoints.len() - 1;
        let k = (t as usize).min(last.saturating_sub(1));
        let next = (k + 1).min(last);
        let part = t - k as f64;
        let (from, to) = (self.travel_at(k), self.travel_at(next));
        (between(&self.waypoints[k], &self.waypoints[next], part), from + part * (to - from))
    }
}

/// Path length covered by each joint (rad or m), the object's joint last. It bounds the distance of positions.
pub(super) struct Gone {
    pub joints: usize,
    /// Path lengths up to each waypoint, one row for each waypoint.
    pub sums: Vec<f64>,
    /// Maximum deviation of each joint from the straight segments.
    pub off: Vec<f64>,
}

impl World<'_> {
    /// Returns the path length of each joint up to each waypoint.
    pub(super) fn gone(&mut self, way: &Way<'_>) -> Gone {
        let joints = self.movers.len() + 1;
        let mut out = Gone { joints, sums: vec![0.0; joints], off: vec![0.0; joints] };
        for k in 0..way.waypoints.len() - 1 {
            let steps = self.segment(way, k);
            for (j, step) in steps.iter().enumerate() {
                out.sums.push(out.sums[k * joints + j] + step);
            }
            self.steps = steps;
        }
        let mut aside = vec![0.0; joints];
        for off in way.off {
            aside.fill(0.0);
            self.add_off(Some(off), &mut aside);
            out.off.iter_mut().zip(&aside).for_each(|(most, off)| *most = most.max(*off));
        }
        out
    }

    /// Adds each joint's deviation from a segment to its movement along the segment.
    pub(super) fn add_off(&self, off: Option<&Row>, steps: &mut [f64]) {
        let Some(off) = off else { return };
        for (step, joint) in steps.iter_mut().zip(self.movers.iter()) {
            *step += (joint.factor * off[joint.variable]).abs();
        }
    }

    /// Returns how far each joint moves along the segment after waypoint `k` (not negative).
    pub(super) fn segment(&mut self, way: &Way<'_>, k: usize) -> Vec<f64> {
        let (a, b) = (way.state(k), way.state(k + 1));
        self.steps((a.x, a.travel), (b.x, b.travel))
    }
}
