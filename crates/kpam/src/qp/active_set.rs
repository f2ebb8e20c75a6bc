//! Dual active-set method of Goldfarb and Idnani (1983): starts at the unconstrained minimum and adds violated bounds
//! one by one. Its loop allocates no memory, and it distinguishes infeasible programs from failures.

use super::{Bound, Qp, QpOutcome, dot};
use crate::model::{MAX_JOINTS, Row};

/// A bound with ends closer to each other than this counts as an equality.
const EQUALITY: f64 = 1e-12;
/// Violations below this count as zero; rows are scaled to length 1.
const MET: f64 = 1e-10;
/// Maximum number of bounds that are added, and of passes in which one bound is added.
const ADDITIONS: usize = 240;
const PASSES: usize = 48;

/// The solver with its matrix factors, which are reused between programs.
pub struct ActiveSet {
    /// Columns of the inverse transpose of the Cholesky factor, rotated so that the first `active` columns span the
    /// active rows.
    j: [Row; MAX_JOINTS],
    /// Upper triangular factor of the active rows, by column.
    r: [Row; MAX_JOINTS],
    /// Active rows: index of the bound, sign (+1 for the lower end, -1 for the upper end), and multiplier.
    active: Vec<Active>,
}

#[derive(Clone, Copy)]
struct Active {
    bound: usize,
    sign: f64,
    multiplier: f64,
    equality: bool,
}

impl Default for ActiveSet {
    fn default() -> Self {
        Self {
            j: [[0.0; MAX_JOINTS]; MAX_JOINTS],
            r: [[0.0; MAX_JOINTS]; MAX_JOINTS],
            active: Vec::with_capacity(MAX_JOINTS),
        }
    }
}

impl ActiveSet {
    /// Factors the Hessian and returns the minimizer without bounds; `None` if the Hessian is not positive definite.
    fn start(&mut self, qp: &Qp<'_>) -> Option<Row> {
        // The known bound of `n` lets the compiler omit bounds checks.
        let n = qp.n.min(MAX_JOINTS);
        let mut l = [[0.0; MAX_JOINTS]; MAX_JOINTS];
        let mut inverse = [0.0; MAX_JOINTS];
        for i in 0..n {
            for k in 0..=i {
                let sum = qp.hessian[i][k] - dot(k, &l[i], &l[k]);
                if i == k {
                    if sum.is_nan() || sum <= 1e-12 {
                        return None;
                    }
                    inverse[i] = 1.0 / sum.sqrt();
                } else {
                    l[i][k] = sum * inverse[k];
                }
            }
        }
        // Column c of the inverse of L^T is the solution y of L^T y = e_c.
        self.j = [[0.0; MAX_JOINTS]; MAX_JOINTS];
        for c in 0..n {
            let column = &mut self.j[c];
            column[c] = inverse[c];
            for k in (1..=c).rev() {
                let value = column[k];
                for i in 0..k {
                    column[i] -= l[k][i] * value;
                }
                column[k - 1] *= inverse[k - 1];
            }
        }
        self.active.clear();
        let mut x = [0.0; MAX_JOINTS];
        for c in 0..n {
            let y = dot(n, &self.j[c], qp.gradient);
            for i in 0..n {
                x[i] -= self.j[c][i] * y;
            }
        }
        Some(x)
    }

    /// Rotates columns `c` and `c + 1` of `j` in the plane that they span.
    fn turn(&mut self, n: usize, c: usize, cos: f64, sin: f64) {
        let (head, tail) = self.j.split_at_mut(c + 1);
        for (u, v) in head[c].iter_mut().zip(&mut tail[0]).take(n) {
            (*u, *v) = (cos * *u + sin * *v, cos * *v - sin * *u);
        }
    }

    /// Adds the row whose product with J^T is `d`. Returns false if the row depends linearly on the active rows.
    fn add(&mut self, n: usize, d: &mut Row, entry: Active) -> bool {
        let q = self.active.len();
        for k in (q + 1..n).rev() {
            let (a, b) = (d[k - 1], d[k]);
            if b == 0.0 {
                continue;
            }
            let h = (a * a + b * b).sqrt();
            d[k] = 0.0;
            if h == 0.0 {
                continue;
            }
            d[k - 1] = h;
            self.turn(n, k - 1, a / h, b / h);
        }
        if q >= n || d[q].abs() < 1e-13 {
            return false;
        }
        self.r[q][..=q].copy_from_slice(&d[..=q]);
        self.active.push(entry);
        true
    }

    fn drop(&mut self, n: usize, at: usize) {
        self.active.remove(at);
        let q = self.active.len();
        for c in at..q {
            self.r[c] = self.r[c + 1];
        }
        for c in at..q {
            let (a, b) = (self.r[c][c], self.r[c][c + 1]);
            let h = (a * a + b * b).sqrt();
            if h == 0.0 {
                continue;
            }
            let (cos, sin) = (a / h, b / h);
            for column in self.r.iter_mut().take(q).skip(c) {
                let (u, v) = (column[c], column[c + 1]);
                column[c] = cos * u + sin * v;
                column[c + 1] = cos * v - sin * u;
            }
            self.turn(n, c, cos, sin);
        }
    }

    /// Adds one more bound to those that hold at `x`; `None` if the bounds contradict each other.
    fn enforce(&mut self, qp: &Qp<'_>, x: &mut Row, mut entry: Active) -> Option<()> {
        // The known bound of `n` lets the compiler omit bounds checks.
        let n = qp.n.min(MAX_JOINTS);
        let bound = &qp.bounds[entry.bound];
        let mut normal = bound.row;
        normal.iter_mut().for_each(|v| *v *= entry.sign);
        let end = if entry.sign > 0.0 { bound.low } else { -bound.high };
        // Each pass adds the bound, or drops one of at most n other bounds.
        for _ in 0..PASSES {
            let q = self.active.len();
            let mut d = [0.0; MAX_JOINTS];
            for c in 0..n {
                d[c] = dot(n, &self.j[c], &normal);
            }
            let mut z = [0.0; MAX_JOINTS];
            for c in q..n {
                for i in 0..n {
                    z[i] += self.j[c][i] * d[c];
                }
            }
            let mut r = [0.0; MAX_JOINTS];
            for c in (0..q).rev() {
                let mut sum = d[c];
                for k in c + 1..q {
                    sum -= self.r[k][c] * r[k];
                }
                r[c] = sum / self.r[c][c];
            }
            let mut dual = f64::INFINITY;
            let mut leaving = 0;
            for (c, a) in self.active.iter().enumerate() {
                if !a.equality && r[c] > 1e-14 {
                    let t = a.multiplier / r[c];
                    if t < dual {
                        dual = t;
                        leaving = c;
                    }
                }
            }
            let slope = dot(n, &z, &normal);
            let scale = dot(n, &d, &d);
            let slack = dot(n, &normal, x) - end;
            let primal = if slope > 1e-11 * scale { -slack / slope } else { f64::INFINITY };
            let t = primal.min(dual);
            if !t.is_finite() {
                return None;
            }
            for (c, a) in self.active.iter_mut().enumerate() {
                a.multiplier -= t * r[c];
            }
            entry.multiplier += t;
            if primal.is_finite() {
                for i in 0..n {
                    x[i] += t * z[i];
                }
            }
            if primal <= dual {
                return self.add(n, &mut d, entry).then_some(());
            }
            self.drop(n, leaving);
        }
        None
    }

    /// Solves a quadratic program.
    pub fn solve(&mut self, qp: &Qp<'_>) -> QpOutcome {
        if !qp.fits() {
            return QpOutcome::Failed;
        }
        // The known bound of `n` lets the compiler omit bounds checks.
        let n = qp.n.min(MAX_JOINTS);
        let Some(mut x) = self.start(qp) else { return QpOutcome::Failed };
        let is_equality = |b: &Bound| b.high - b.low <= EQUALITY;
        for (index, bound) in qp.bounds.iter().enumerate().filter(|(_, b)| is_equality(b)) {
            if bound.high < bound.low {
                return QpOutcome::Infeasible;
            }
            let slack = dot(n, &bound.row, &x) - bound.low;
            let sign = if slack <= 0.0 { 1.0 } else { -1.0 };
            let entry = Active { bound: index, sign, multiplier: 0.0, equality: true };
            if self.enforce(qp, &mut x, entry).is_none() {
                // An equality that depends on earlier ones is accepted if it already holds.
                let left = dot(n, &bound.row, &x) - bound.low;
                if left.abs() > 1e-8 {
                    return QpOutcome::Infeasible;
                }
            }
        }
        for _ in 0..ADDITIONS {
            let mut worst = -MET;
            let mut found = None;
            for (index, bound) in qp.bounds.iter().enumerate() {
                if is_equality(bound) {
                    continue;
                }
                let value = dot(n, &bound.row, &x);
                for (slack, sign) in [(value - bound.low, 1.0), (bound.high - value, -1.0)] {
                    if slack < worst && !self.active.iter().any(|a| a.bound == index && a.sign == sign) {
                        worst = slack;
                        found = Some((index, sign));
                    }
                }
            }
            let Some((bound, sign)) = found else {
                let mut multipliers = vec![0.0; qp.bounds.len()];
                for a in &self.active {
                    multipliers[a.bound] += a.sign * a.multiplier;
                }
                return QpOutcome::Solved { step: x, multipliers };
            };
            let entry = Active { bound, sign, multiplier: 0.0, equality: false };
            if self.enforce(qp, &mut x, entry).is_none() {
                return QpOutcome::Infeasible;
            }
        }
        QpOutcome::Failed
    }
}
