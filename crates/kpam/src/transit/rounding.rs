//! Smooth curves near the corners of a path, as wide as obstacles permit at each corner.

use super::field::Field;
use crate::model::{Model, Row, between};
use crate::timing::{Spline, distance};

/// Initial spacing of waypoints (rad or m), which determines how far before and after a corner the curve bends.
const WIDEST: f64 = 0.9;
/// Minimum spacing of waypoints (rad or m). A curve with tighter corners would be slower than a stop at each corner.
const TIGHTEST: f64 = 0.02;
/// Distance between neighbouring checked configurations of a curve (rad or m).
const LOOKS: f64 = 0.05;

/// A sequence of curves along a path, each tighter than the previous one.
pub(crate) struct Rounding<'c> {
    corners: &'c [Row],
    /// Distance between neighbouring waypoints of each edge (rad or m).
    spacing: Vec<f64>,
    /// Whether the edges of the path are free, if they have been checked more densely than during the search.
    is_free: Option<bool>,
}

impl<'c> Rounding<'c> {
    pub fn new(corners: &'c [Row]) -> Self {
        Self { corners, spacing: vec![WIDEST; corners.len().saturating_sub(1)], is_free: None }
    }

    /// Returns the next curve whose checked configurations are free, its waypoints, and the number of waypoints after
    /// the first on the same edge; `None` if a corner would have to be too tight.
    pub fn next(&mut self, field: &mut Field<'_>, n: usize, model: &Model) -> Option<(Spline, Vec<Row>, usize)> {
        loop {
            if self.spacing.iter().any(|s| *s < TIGHTEST) || field.is_over() {
                return None;
            }
            let (waypoints, edge_of) = self.waypoints(n);
            let path = Spline::through(n, &waypoints, None);
            if path.intervals() + 1 != waypoints.len() {
                return None;
            }
            let outside = (0..path.intervals()).find(|i| !path.keeps_within(*i..i + 1, &model.lower, &model.upper));
            let blocked = outside.map(|i| (i, 0.5)).or_else(|| {
                let mut curve = Vec::new();
                let mut place = Vec::new();
                for i in 0..path.intervals() {
                    let steps = ((path.knots[i + 1] - path.knots[i]) / LOOKS).ceil().max(1.0) as usize;
                    for k in 0..steps {
                        let part = (k as f64 + 0.5) / steps as f64;
                        curve.push(path.at(i, part));
                        place.push((i, part));
                    }
                }
                field.blocked_at(&curve).map(|k| place[k])
            });
            let Some((interval, part)) = blocked else {
                let first = edge_of.iter().filter(|edge| **edge == 0).count();
                return Some((path, waypoints, first));
            };
            // A straight path has no corners to tighten, and no curve along a blocked path is free.
            if self.corners.len() < 3 || self.is_blocked(field) {
                return None;
            }
            let edge = edge_of[interval];
            let first = edge_of.iter().position(|e| *e == edge).unwrap_or(interval);
            let count = edge_of.iter().filter(|e| **e == edge).count();
            let along = ((interval - first) as f64 + part) / count.max(1) as f64;
            self.spacing[edge] *= 0.5;
            // The corner at the start of the edge determines the curve there.
            if along < 0.5 && edge > 0 {
                self.spacing[edge - 1] *= 0.5;
            } else if along >= 0.5 && edge + 1 < self.spacing.len() {
                self.spacing[edge + 1] *= 0.5;
            }
        }
    }

    /// Returns whether an edge of the path itself is blocked. Most curves are free at once, so the edges are checked only
    /// when a curve is blocked.
    pub fn is_blocked(&mut self, field: &mut Field<'_>) -> bool {
        !*self.is_free.get_or_insert_with(|| field.is_way_free(self.corners))
    }

    /// Makes every corner tighter.
    pub fn tighten(&mut self) {
        self.spacing.iter_mut().for_each(|s| *s *= 0.5);
    }

    /// Returns the waypoints, and the edge of each interval between them.
    fn waypoints(&self, n: usize) -> (Vec<Row>, Vec<usize>) {
        let (mut out, mut edge_of) = (vec![self.corners[0]], Vec::new());
        for (edge, pair) in self.corners.windows(2).enumerate() {
            let steps = (distance(n, &pair[0], &pair[1]) / self.spacing[edge]).ceil().max(1.0) as usize;
            for k in 1..=steps {
                out.push(if k < steps { between(&pair[0], &pair[1], k as f64 / steps as f64) } else { pair[1] });
                edge_of.push(edge);
            }
        }
        (out, edge_of)
    }
}
