//! Damped Gauss-Newton steps of eight joint vectors at a time.

use gensim2_geometry::lanes::{F32x8, Wide};

use super::batch::{BatchProjection, Lanes, Line};
use super::projection::STEP;
use crate::model::MAX_JOINTS;

/// The next step of every lane.
pub(super) struct Step<'a> {
    pub batch: &'a BatchProjection,
    pub x: &'a Lanes,
    pub lines: &'a [Line],
    pub damping: F32x8,
}

impl Wide for Step<'_> {
    type Output = Lanes;

    #[inline(always)]
    fn run(self) -> Lanes {
        // Arms have six or seven joints: for those the compiler unrolls all loops.
        match self.batch.n {
            6 => self.of::<6>(),
            7 => self.of::<7>(),
            _ => self.of::<MAX_JOINTS>(),
        }
    }
}

impl Step<'_> {
    /// Of an arm with at most `N` joints: those that are not there have no rows, and stay.
    #[inline(always)]
    fn of<const N: usize>(self) -> Lanes {
        let Self { batch, x, lines, damping } = self;
        let zero = F32x8::ZERO;
        let mut gradient = [zero; N];
        let mut normal = [[zero; N]; N];
        for (row, r) in lines {
            // Most are inside the workspace: then its lines are empty.
            if row[..N].iter().all(|value| *value == zero) {
                continue;
            }
            for i in 0..N {
                gradient[i] = gradient[i] + row[i] * *r;
                for k in 0..=i {
                    normal[i][k] = normal[i][k] + row[i] * row[k];
                }
            }
        }
        for v in 0..N {
            // Joints at a limit that would be pushed further stay there.
            let (low, high) = (F32x8::splat(batch.lower[v]), F32x8::splat(batch.upper[v]));
            let down = low.below(x[v], F32x8::ONE, zero.below(gradient[v], zero, F32x8::ONE));
            let up = x[v].below(high, F32x8::ONE, gradient[v].below(zero, zero, F32x8::ONE));
            let moves = down * up;
            gradient[v] = gradient[v] * moves;
            for k in 0..N {
                if k != v {
                    let (i, j) = if v > k { (v, k) } else { (k, v) };
                    normal[i][j] = normal[i][j] * moves;
                }
            }
            normal[v][v] = normal[v][v] * moves + (F32x8::ONE - moves) + damping * batch.metric[v];
        }
        // An LDL factorization, and the step that it gives.
        let mut l = [[zero; N]; N];
        let mut scaled = [[zero; N]; N];
        let mut inverse = [zero; N];
        let mut step = [zero; N];
        for i in 0..N {
            let mut rest = zero - gradient[i];
            let mut pivot = normal[i][i];
            for k in 0..i {
                let mut sum = normal[i][k];
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

/// Takes steps in the lanes where they lead nearer.
pub(super) struct Take<'a> {
    pub n: usize,
    pub before: F32x8,
    pub after: F32x8,
    pub cost: &'a mut F32x8,
    pub new_cost: F32x8,
    pub x: &'a mut Lanes,
    pub trial: &'a Lanes,
    pub lines: &'a mut [Line],
    pub new: &'a [Line],
}

impl Wide for Take<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { n, before, after, cost, new_cost, x, trial, lines, new } = self;
        let n = n.min(MAX_JOINTS);
        *cost = after.below(before, new_cost, *cost);
        for v in 0..n {
            x[v] = after.below(before, trial[v], x[v]);
        }
        for i in 0..lines.len().min(new.len()) {
            let ((row, r), (other, s)) = (&mut lines[i], &new[i]);
            for v in 0..n {
                row[v] = after.below(before, other[v], row[v]);
            }
            *r = after.below(before, *s, *r);
        }
    }
}
