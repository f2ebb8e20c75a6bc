//! Residuals of the constraints, their gradients and the cost, for eight joint vectors at a time.

use gensim2_geometry::Frames;
use gensim2_geometry::lanes::{F32x8, Wide};

use super::batch::{BatchProjection, Lanes, Line, Single};
use crate::model::MAX_JOINTS;

/// Evaluation at the present poses of the links.
pub(super) struct Look<'a> {
    pub batch: &'a BatchProjection,
    pub frames: &'a [Frames],
    pub x: &'a Lanes,
    pub begin: &'a Lanes,
    pub lines: &'a mut Vec<Line>,
}

type Vector = [F32x8; 3];

#[inline(always)]
fn cross(a: &Vector, b: &Vector) -> Vector {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[inline(always)]
fn dot(a: &Vector, b: &Vector) -> F32x8 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline(always)]
fn splat(v: &Single) -> Vector {
    [F32x8::splat(v[0]), F32x8::splat(v[1]), F32x8::splat(v[2])]
}

impl Wide for Look<'_> {
    type Output = [F32x8; 2];

    #[inline(always)]
    fn run(self) -> [F32x8; 2] {
        let Self { batch, frames, x, begin, lines } = self;
        let zero = F32x8::ZERO;
        // Turn, and velocity of the point at the base origin, of each column.
        let mut columns = [([zero; 3], [zero; 3]); MAX_JOINTS];
        let count = batch.columns.len().min(MAX_JOINTS);
        for k in 0..count {
            let column = &batch.columns[k];
            let frame = &frames[column.link];
            let axis = frame.direction(&column.axis);
            let axis = [axis[0] * column.factor, axis[1] * column.factor, axis[2] * column.factor];
            columns[k] = if column.turns { (axis, cross(&frame.t, &axis)) } else { ([zero; 3], axis) };
        }
        let hand = &frames[batch.hand];
        // As `ActuationSearch::cost`.
        let mut cost = F32x8::splat(1.5);
        for v in 0..batch.n {
            let step = x[v] - begin[v];
            cost = cost + step * step * batch.weights[v];
        }
        for e in 0..3 {
            let way = hand.t[e] - F32x8::splat(batch.begin_at[e]);
            cost = cost + way * way;
            for k in 0..3 {
                cost = cost - hand.r[e][k] * (0.5 * batch.begin_turn[e][k]);
            }
        }
        for term in &batch.costs {
            let (at, target) = (hand.point(&term.on_hand), splat(&term.target));
            let off = dot(&[at[0] - target[0], at[1] - target[1], at[2] - target[2]], &splat(&term.normal));
            cost = cost + off * off * term.weight;
        }
        let mut sum = zero;
        for p in &batch.points {
            let at = hand.point(&p[0]);
            let mut rows = [[zero; MAX_JOINTS]; 3];
            for k in 0..count {
                let (turn, shift) = &columns[k];
                let way = cross(turn, &at);
                let v = batch.columns[k].variable;
                for e in 0..3 {
                    rows[e][v] = rows[e][v] + shift[e] + way[e];
                }
            }
            for e in 0..3 {
                let miss = at[e] - F32x8::splat(p[1][e]);
                sum = sum + miss * miss;
                lines.push((rows[e], miss));
            }
        }
        for a in &batch.axes {
            let u = hand.direction(&a.on_hand);
            let target = splat(&a.target);
            let between = cross(&u, &target);
            let sin = dot(&between, &between).sqrt();
            let angle = F32x8::angle(sin, dot(&u, &target));
            let miss = angle - angle.max(F32x8::splat(a.range[0])).min(F32x8::splat(a.range[1]));
            let flat = F32x8::splat(1e-5);
            let scale = F32x8::ONE / sin.max(flat);
            let across = splat(&a.across);
            let mut row = [zero; MAX_JOINTS];
            let mut normal = [zero; 3];
            for e in 0..3 {
                normal[e] = sin.below(flat, across[e], between[e] * scale);
            }
            for k in 0..count {
                let v = batch.columns[k].variable;
                row[v] = row[v] - dot(&normal, &columns[k].0);
            }
            sum = sum + miss * miss;
            lines.push((row, miss));
        }
        if let Some([low, high]) = &batch.workspace {
            for e in 0..3 {
                let c = hand.t[e];
                let miss = c - c.max(F32x8::splat(low[e])).min(F32x8::splat(high[e]));
                let mut row = [zero; MAX_JOINTS];
                if miss == zero {
                    lines.push((row, miss));
                    continue;
                }
                for k in 0..count {
                    let (turn, shift) = &columns[k];
                    let v = batch.columns[k].variable;
                    // Where the hand is inside, nothing pulls.
                    let way = shift[e] + cross(turn, &hand.t)[e];
                    row[v] = row[v] + zero.below(miss.abs(), way, zero);
                }
                sum = sum + miss * miss;
                lines.push((row, miss));
            }
        }
        [sum, cost]
    }
}
