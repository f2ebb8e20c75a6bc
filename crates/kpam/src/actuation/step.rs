//! Computes damped Gauss-Newton steps of eight joint vectors at a time.

use gensim2_geometry::lanes::{F32x8, Wide};

use super::batch::{BatchProjection, Lanes, Normal};
use super::projection::STEP;
use crate::model::MAX_JOINTS;

/// Computes the next step in every SIMD lane.
pub(super) struct Step<'a> {
    pub batch: &'a BatchProjection,
    pub x: &'a Lanes,
    pub normal: &'a Normal,
    pub damping: F32x8,
}

impl Wide for Step<'_> {
    type Output = Lanes;

    #[inline(always)]
    fn run(self) -> Lanes {
        // Most arms have six or seven joints; with a fixed number the compiler unrolls all loops.
        match self.batch.n {
            6 => self.of::<6>(),
            7 => self.of::<7>(),
            ..=12 => self.of::<12>(),
            _ => self.of::<MAX_JOINTS>(),
        }
    }
}

impl Step<'_> {
    /// Computes the step for an arm with at most `N` variables; unused variables stay fixed.
    #[inline(always)]
    fn of<const N: usize>(self) -> Lanes {
        let Self { batch, x, normal, damping } = self;
        let zero = F32x8::ZERO;
        let mut gradient = [zero; N];
        let mut matrix = [[zero; N]; N];
        for i in 0..N {
            gradient[i] = normal.gradient[i];
            for k in 0..=i {
                matrix[i][k] = normal.matrix[i][k];
            }
        }
        for v in 0..N {
            // A joint at its limit stays there if the step would move it further out.
            let (low, high) = (F32x8::splat(batch.lower[v]), F32x8::splat(batch.upper[v]));
            let down = low.below(x[v], F32x8::ONE, zero.below(gradient[v], zero, F32x8::ONE));
            let up = x[v].below(high, F32x8::ONE, gradient[v].below(zero, zero, F32x8::ONE));
            let moves = down * up;
            gradient[v] = gradient[v] * moves;
            for k in 0..N {
                if k != v {
                    let (i, j) = if v > k { (v, k) } else { (k, v) };
                    matrix[i][j] = matrix[i][j] * moves;
                }
            }
            matrix[v][v] = matrix[v][v] * moves + (F32x8::ONE - moves) + damping * batch.metric[v];
        }
        // Factor the matrix as L D L^T and solve for the step.
        let mut l = [[zero; N]; N];
        let mut scaled = [[zero; N]; N];
        let mut inverse = [zero; N];
        let mut step = [zero; N];
        for i in 0..N {
            let mut rest = zero - gradient[i];
            let mut pivot = matrix[i][i];
            for k in 0..i {
                let mut sum = matrix[i][k];
                for m in 0..k {
                    sum = sum - l[i][m] * scaled[k][m];
                }
                scaled[i][k] = sum;
                l[i][k] = sum * inverse[k];
                pivot = pivot - l[i][k] * sum;
                rest = rest - l[i][k] * step[k];
            }
            inverse[i] = F32x8::ONE / pivot;
            step[i] = rest;
        }
        let mut longest = zero;
        for i in (0..N).rev() {
            let mut sum = step[i] * inverse[i];
            for k in i + 1..N {
                sum = sum - l[k][i] * step[k];
            }
            step[i] = sum;
            longest = longest.max(sum.abs());
        }
        let most = F32x8::splat(STEP as f32);
        let shrink = most / longest.max(most);
        let mut out = *x;
        for v in 0..N {
            let moved = x[v] + step[v] * shrink;
            out[v] = moved.max(F32x8::splat(batch.lower[v])).min(F32x8::splat(batch.upper[v]));
        }
        out
    }
}

/// Accepts a step in each SIMD lane in which it reduces the error.
pub(super) struct Take<'a> {
    pub n: usize,
    pub before: F32x8,
    pub after: F32x8,
    pub cost: &'a mut F32x8,
    pub new_cost: F32x8,
    pub x: &'a mut Lanes,
    pub trial: &'a Lanes,
    pub normal: &'a mut Normal,
    pub new: &'a Normal,
}

impl Wide for Take<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { n, before, after, cost, new_cost, x, trial, normal, new } = self;
        *cost = after.below(before, new_cost, *cost);
        for i in 0..n.min(MAX_JOINTS) {
            x[i] = after.below(before, trial[i], x[i]);
            normal.gradient[i] = after.below(before, new.gradient[i], normal.gradient[i]);
            for k in 0..=i {
                normal.matrix[i][k] = after.below(before, new.matrix[i][k], normal.matrix[i][k]);
            }
        }
    }
}
