//! Shortens paths: drops vertices, adds shortcuts, then tightens the path.

use super::field::Field;
use crate::model::{Row, between};
use gensim2_geometry::Draws;

/// Maximum number of shortcut attempts.
const ROUNDS: usize = 60;
/// A shortcut must be shorter than this fraction of the part of the path that it replaces.
const WORTH: f64 = 0.995;
/// Number of consecutive failed attempts after which no more shortcuts are tried.
const IDLE: usize = 16;
/// Fractions of the way to the straight line between its neighbours by which a vertex is moved, tried in turn.
const PULLS: [f64; 2] = [0.5, 0.2];
/// Tightening must shorten the whole path by at least this fraction of its length.
const SAVES: f64 = 0.002;

/// Returns the length of a straight edge, measured in seconds: the minimum time of each joint, combined as the root of
/// the sum of squares.
pub(super) fn effort(n: usize, pace: &Row, a: &Row, b: &Row) -> f64 {
    (0..n).map(|v| ((b[v] - a[v]) * pace[v]).powi(2)).sum::<f64>().sqrt()
}

/// Returns the sum of the lengths of a path's edges (s).
pub(crate) fn effort_along(n: usize, pace: &Row, path: &[Row]) -> f64 {
    path.windows(2).map(|edge| effort(n, pace, &edge[0], &edge[1])).sum()
}

/// Shortens a path in place; `pace` weights each variable (seconds per unit).
pub(super) fn shorten(field: &mut Field<'_>, path: &mut Vec<Row>, pace: &Row, seed: usize) {
    let n = field.model.n();
    skip(field, path);
    let mut draws = Draws::of(0x7368_6f72, seed);
    let mut idle = 0;
    for _ in 0..ROUNDS {
        if path.len() < 3 || idle > IDLE || field.is_over() {
            break;
        }
        idle += 1;
        let lengths: Vec<f64> = path.windows(2).map(|w| effort(n, pace, &w[0], &w[1])).collect();
        let total: f64 = lengths.iter().sum();
        let place = |share: f64| {
            let mut left = share * total;
            let mut k = 0;
            while k + 1 < lengths.len() && left > lengths[k] {
                left -= lengths[k];
                k += 1;
            }
            let part = if lengths[k] > 0.0 { (left / lengths[k]).min(1.0) } else { 0.0 };
            (k, between(&path[k], &path[k + 1], part))
        };
        let (s, t) = (draws.unit(), draws.unit());
        let ((i, a), (j, b)) = (place(s.min(t)), place(s.max(t)));
        if i == j {
            continue;
        }
        let along =
            effort(n, pace, &a, &path[i + 1]) + lengths[i + 1..j].iter().sum::<f64>() + effort(n, pace, &path[j], &b);
        if effort(n, pace, &a, &b) < WORTH * along && field.is_edge_free(&a, &b) {
            path.splice(i + 1..=j, [a, b]);
            idle = 0;
        }
    }
    skip(field, path);
}

/// Returns a path with its vertices moved towards the straight line between their neighbours, as far as the edges stay
/// free; `None` if the path does not become shorter.
pub(super) fn tauten(field: &mut Field<'_>, path: &[Row], pace: &Row) -> Option<Vec<Row>> {
    let n = field.model.n();
    let total = effort_along(n, pace, path);
    let (mut out, mut moved) = (path.to_vec(), false);
    for i in 1..out.len().saturating_sub(1) {
        let (a, x, b) = (out[i - 1], out[i], out[i + 1]);
        let (before, after) = (effort(n, pace, &a, &x), effort(n, pace, &x, &b));
        let part = before / (before + after).max(1e-12);
        for share in PULLS {
            let y = between(&x, &between(&a, &b, part), share);
            let saved = before + after - effort(n, pace, &a, &y) - effort(n, pace, &y, &b);
            if saved < SAVES * total || field.is_over() {
                break;
            }
            if field.is_edge_free(&a, &y) && field.is_edge_free(&y, &b) {
                (out[i], moved) = (y, true);
                break;
            }
        }
    }
    moved.then_some(out)
}

/// Drops vertices between two others if the straight edge that joins the two is free.
fn skip(field: &mut Field<'_>, path: &mut Vec<Row>) {
    let mut i = 0;
    while i + 2 < path.len() {
        let mut j = path.len() - 1;
        while j > i + 1 && !field.is_over() {
            if field.is_edge_free(&path[i].clone(), &path[j].clone()) {
                path.drain(i + 1..j);
                break;
            }
            // Skip to the most distant vertex first, then halve the distance.
            j = i + (j - i) / 2;
        }
        i += 1;
    }
}
