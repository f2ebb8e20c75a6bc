//! Shorter ways: corners left out, then cut.

use super::field::Field;
use crate::free_space::Draws;
use crate::model::Row;

/// Rounds of cuts.
const ROUNDS: usize = 60;
/// A cut has to save this share of the way between its ends.
const WORTH: f64 = 0.995;
/// Rounds without a cut after which there are no more.
const IDLE: usize = 16;

/// Length of a straight edge in the time that the joints need for it at the least: root of the sum of squares of each
/// joint's.
pub(super) fn effort(n: usize, pace: &Row, a: &Row, b: &Row) -> f64 {
    (0..n).map(|v| ((b[v] - a[v]) * pace[v]).powi(2)).sum::<f64>().sqrt()
}

/// Shortens a way in place; `pace` weighs each variable (seconds for a unit of it).
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
            let mut x = path[k];
            for v in 0..n {
                x[v] += part * (path[k + 1][v] - path[k][v]);
            }
            (k, x)
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

/// Leaves out corners where the straight edge past them is free.
fn skip(field: &mut Field<'_>, path: &mut Vec<Row>) {
    let mut i = 0;
    while i + 2 < path.len() {
        let mut j = path.len() - 1;
        while j > i + 1 {
            if field.is_edge_free(&path[i].clone(), &path[j].clone()) {
                path.drain(i + 1..j);
                break;
            }
            // Ends far off first, then half as far.
            j = i + (j - i) / 2;
        }
        i += 1;
    }
}
