//! Computes the residuals of the constraints, the normal equations of the Gauss-Newton step, and the cost, for eight
//! joint vectors at a time.

use gensim2_geometry::Frames;
use gensim2_geometry::lanes::{F32x8, Wide};

use super::batch::{BatchProjection, Lanes, Normal, Single};
use crate::model::MAX_JOINTS;

/// Evaluates constraints and cost for the current poses of the links.
pub(super) struct Look<'a> {
    pub batch: &'a BatchProjection,
    pub frames: &'a [Frames],
    pub x: &'a Lanes,
    pub begin: &'a Lanes,
    /// Where to write the normal equations; `None` if they are not needed.
    pub normal: Option<&'a mut Normal>,
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
        // Most arms have six or seven joints; with a fixed number the compiler unrolls all loops.
        match self.batch.n {
            6 => self.of::<6>(),
            7 => self.of::<7>(),
            ..=12 => self.of::<12>(),
            _ => self.of::<MAX_JOINTS>(),
        }
    }
}

impl Normal {
    #[inline(always)]
    fn clear<const N: usize>(&mut self) {
        for i in 0..N {
            self.gradient[i] = F32x8::ZERO;
            for k in 0..=i {
                self.matrix[i][k] = F32x8::ZERO;
            }
        }
    }

    /// Adds a residual and its gradient to the normal equations.
    #[inline(always)]
    fn add<const N: usize>(&mut self, row: &[F32x8; N], miss: F32x8) {
        for i in 0..N {
            self.gradient[i] = self.gradient[i] + row[i] * miss;
            for k in 0..=i {
                self.matrix[i][k] = self.matrix[i][k] + row[i] * row[k];
            }
        }
    }
}

impl Look<'_> {
    /// Returns the sum of squared residuals and the cost for an arm with at most `N` variables.
    #[inline(always)]
    fn of<const N: usize>(self) -> [F32x8; 2] {
        let Self { batch, frames, x, begin, mut normal } = self;
        let zero = F32x8::ZERO;
        // Angular velocity of the hand, and velocity of the hand point at the base's origin, per unit of each variable.
        let (mut turns, mut shifts) = ([[zero; 3]; N], [[zero; 3]; N]);
        for column in batch.columns.iter().filter(|_| normal.is_some()) {
            let frame = &frames[column.link];
            // Nearly every joint rotates about the z axis of its frame.
            let axis = match column.axis {
                [0.0, 0.0, factor] => [frame.r[0][2] * factor, frame.r[1][2] * factor, frame.r[2][2] * factor],
                axis => frame.direction(&axis),
            };
            let moment = cross(&frame.t, &axis);
            let v = column.variable.min(N - 1);
            for e in 0..3 {
                if column.turns {
                    turns[v][e] = turns[v][e] + axis[e];
                    shifts[v][e] = shifts[v][e] + moment[e];
                } else {
                    shifts[v][e] = shifts[v][e] + axis[e];
                }
            }
        }
        let hand = &frames[batch.hand];
        // The cost terms are those of `ActuationSearch::cost`.
        let mut cost = F32x8::splat(1.5);
        for v in 0..N {
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
        if let Some(normal) = &mut normal {
            normal.clear::<N>();
        }
        for p in &batch.points {
            let at = hand.point(&p[0]);
            let target = splat(&p[1]);
            let miss = [at[0] - target[0], at[1] - target[1], at[2] - target[2]];
            sum = sum + dot(&miss, &miss);
            let Some(normal) = &mut normal else { continue };
            let mut rows = [[zero; N]; 3];
            for v in 0..N {
                let way = cross(&turns[v], &at);
                for e in 0..3 {
                    rows[e][v] = shifts[v][e] + way[e];
                }
            }
            for e in 0..3 {
                normal.add(&rows[e], miss[e]);
            }
        }
        for a in &batch.axes {
            let u = hand.direction(&a.on_hand);
            let target = splat(&a.target);
            let between = cross(&u, &target);
            let sin = dot(&between, &between).sqrt();
            let angle = F32x8::angle(sin, dot(&u, &target));
            let miss = angle - angle.max(F32x8::splat(a.range[0])).min(F32x8::splat(a.range[1]));
            sum = sum + miss * miss;
            let Some(normal) = &mut normal else { continue };
            let flat = F32x8::splat(1e-5);
            let scale = F32x8::ONE / sin.max(flat);
            let across = splat(&a.across);
            let mut about = [zero; 3];
            for e in 0..3 {
                about[e] = sin.below(flat, across[e], between[e] * scale);
            }
            let mut row = [zero; N];
            for v in 0..N {
                row[v] = zero - dot(&about, &turns[v]);
            }
            normal.add(&row, miss);
        }
        if let Some([low, high]) = &batch.workspace {
            for e in 0..3 {
                let c = hand.t[e];
                let miss = c - c.max(F32x8::splat(low[e])).min(F32x8::splat(high[e]));
                // Most angles are within the permitted range and have no residual.
                if miss.all_at_least(zero) && zero.all_at_least(miss) {
                    continue;
                }
                sum = sum + miss * miss;
                let Some(normal) = &mut normal else { continue };
                let mut row = [zero; N];
                for v in 0..N {
                    let way = shifts[v][e] + cross(&turns[v], &hand.t)[e];
                    row[v] = zero.below(miss.abs(), way, zero);
                }
                normal.add(&row, miss);
            }
        }
        [sum, cost]
    }
}
