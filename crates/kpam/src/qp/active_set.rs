//! Dual active-set method of Goldfarb and Idnani (1983): starts at the unconstrained minimum and adds violated bounds
//! one by one. At a dozen variables it needs no allocation in its loop, and it tells infeasible from unsolved.

use super::{Bound, Qp, QpOutcome, QpSolver};
use crate::model::{MOST_JOINTS, Row};

/// Bounds narrower than this are equalities.
const EQUALITY: f64 = 1e-12;
/// Violations below this (in units of a row scaled to length 1) are met.
const MET: f64 = 1e-10;

/// The solver with its factors.
pub struct ActiveSet {
    /// Inverse transpose of the Cholesky factor, turned so that the first `active` columns span the active rows.
    j: [Row; MOST_JOINTS],
    /// Upper triangular factor of the active rows, by column.
    r: [Row; MOST_JOINTS],
    /// Active rows: index of the bound and sign (+1 lower end, -1 upper end), with multiplier.
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
            j: [[0.0; MOST_JOINTS]; MOST_JOINTS],
            r: [[0.0; MOST_JOINTS]; MOST_JOINTS],
            active: Vec::with_capacity(MOST_JOINTS),
        }
    }
}

fn dot(n: usize, a: &Row, b: &Row) -> f64 {
    let mut sum = 0.0;
    for i in 0..n {
        sum += a[i] * b[i];
    }
    sum
}

impl ActiveSet {
    /// Factors the Hessian and returns the unconstrained minimizer.
    fn start(&mut self, qp: &Qp<'_>) -> Option<Row> {
        let n = qp.n;
        let mut l = [[0.0; MOST_JOINTS]; MOST_JOINTS];
        for i in 0..n {
            for k in 0..=i {
                let sum = qp.hessian[i][k] - dot(k, &l[i], &l[k]);
                if i == k {
                    if sum.is_nan() || sum <= 1e-12 {
                        return None;
                    }
                    l[i][i] = sum.sqrt();
                } else {
                    l[i][k] = sum / l[k][k];
                }
            }
        }
        // Column c of the inverse of L^T solves L^T y = e_c.
        self.j = [[0.0; MOST_JOINTS]; MOST_JOINTS];
        for c in 0..n {
            for i in (0..=c).rev() {
                let mut sum = if i == c { 1.0 } else { 0.0 };
                for k in i + 1..=c {
                    sum -= l[k][i] * self.j[k][c];
                }
                self.j[i][c] = sum / l[i][i];
            }
        }
        self.active.clear();
        let mut y = [0.0; MOST_JOINTS];
        for c in 0..n {
            for i in 0..n {
                y[c] += self.j[i][c] * qp.gradient[i];
            }
        }
        let mut x = [0.0; MOST_JOINTS];
        for i in 0..n {
            x[i] = -dot(n, &self.j[i], &y);
        }
        Some(x)
    }

    /// Adds the row whose image under J^T is `d`; false where it depends on those already active.
    fn add(&mut self, n: usize, d: &mut Row, entry: Active) -> bool {
        let q = self.active.len();
        for k in (q + 1..n).rev() {
            let (a, b) = (d[k - 1], d[k]);
            if b == 0.0 {
                continue;
            }
            let h = a.hypot(b);
            let (c, s) = (a / h, b / h);
            d[k - 1] = h;
            d[k] = 0.0;
            for i in 0..n {
                let (u, v) = (self.j[i][k - 1], self.j[i][k]);
                self.j[i][k - 1] = c * u + s * v;
                self.j[i][k] = c * v - s * u;
            }
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
            let h = a.hypot(b);
            if h == 0.0 {
                continue;
            }
            let (cos, sin) = (a / h, b / h);
            for column in self.r.iter_mut().take(q).skip(c) {
                let (u, v) = (column[c], column[c + 1]);
                column[c] = cos * u + sin * v;
                column[c + 1] = cos * v - sin * u;
            }
            for i in 0..n {
                let (u, v) = (self.j[i][c], self.j[i][c + 1]);
                self.j[i][c] = cos * u + sin * v;
                self.j[i][c + 1] = cos * v - sin * u;
            }
        }
    }

    /// Makes one more bound hold at `x`. `None` where that is impossible.
    fn enforce(&mut self, qp: &Qp<'_>, x: &mut Row, mut entry: Active) -> Option<()> {
        let n = qp.n;
        let bound = &qp.bounds[entry.bound];
        let mut normal = bound.row;
        normal.iter_mut().for_each(|v| *v *= entry.sign);
        let end = if entry.sign > 0.0 { bound.low } else { -bound.high };
        // Every pass adds the bound or drops one of at most n others.
        for _ in 0..4 * MOST_JOINTS {
            let q = self.active.len();
            let mut d = [0.0; MOST_JOINTS];
            for (c, value) in d.iter_mut().enumerate().take(n) {
                for i in 0..n {
                    *value += self.j[i][c] * normal[i];
                }
            }
            let mut z = [0.0; MOST_JOINTS];
            for i in 0..n {
                for c in q..n {
                    z[i] += self.j[i][c] * d[c];
                }
            }
            let mut r = [0.0; MOST_JOINTS];
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
}

impl QpSolver for ActiveSet {
    fn solve(&mut self, qp: &Qp<'_>) -> QpOutcome {
        let n = qp.n;
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
                // A repeated equality is fine where it already holds.
                let left = dot(n, &bound.row, &x) - bound.low;
                if left.abs() > 1e-8 {
                    return QpOutcome::Infeasible;
                }
            }
        }
        for _ in 0..20 * MOST_JOINTS {
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
