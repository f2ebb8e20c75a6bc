//! The sparse quadratic program of one round of refinement, solved by Clarabel.

use clarabel::algebra::CscMatrix;
use clarabel::solver::{
    DefaultSettings, DefaultSolver, IPSolver, NonnegativeConeT, SolverStatus, SupportedConeT, ZeroConeT,
};

use crate::model::{MAX_JOINTS, Row};

/// A bound `low <= sum of row . step <= high`, where the sum is over the steps of one or two waypoints.
#[derive(Debug, Clone)]
pub(super) struct Bound {
    pub parts: Vec<(usize, Row)>,
    pub low: f64,
    pub high: f64,
}

/// Minimizes weighted squared joint steps between neighbouring waypoints under bounds; the first waypoint is fixed.
pub(super) struct Program<'a> {
    pub joints: usize,
    pub weights: &'a Row,
    pub waypoints: &'a [Row],
    pub bounds: &'a [Bound],
    /// Lower and upper bound on the step of each waypoint.
    pub boxes: &'a [(Row, Row)],
}

impl Program<'_> {
    /// Returns the optimal step of each waypoint; `None` if the program has no solution.
    pub fn solve(&self) -> Option<Vec<Row>> {
        let n = self.joints;
        let count = self.waypoints.len() - 1;
        let variable = |k: usize, v: usize| (k - 1) * n + v;
        // Half of the derivative of sum w (x_k+1 + δ_k+1 - x_k - δ_k)^2 with respect to δ.
        let (mut rows, mut columns, mut values) = (Vec::new(), Vec::new(), Vec::new());
        let mut gradient = vec![0.0; count * n];
        for k in 1..=count {
            for v in 0..n {
                let last = k == count;
                let here = variable(k, v);
                let pull = self.waypoints[k][v] - self.waypoints[k - 1][v];
                let push = if last { 0.0 } else { self.waypoints[k + 1][v] - self.waypoints[k][v] };
                gradient[here] = self.weights[v] * (pull - push);
                if k > 1 {
                    rows.push(variable(k - 1, v));
                    columns.push(here);
                    values.push(-self.weights[v]);
                }
                rows.push(here);
                columns.push(here);
                values.push(self.weights[v] * if last { 1.0 } else { 2.0 });
            }
        }
        let p = CscMatrix::new_from_triplets(count * n, count * n, rows, columns, values);
        let mut a = (Vec::new(), Vec::new(), Vec::new());
        let mut b = Vec::new();
        let mut push = |entries: &mut dyn Iterator<Item = (usize, f64)>, limit: f64| {
            for (column, value) in entries {
                a.0.push(b.len());
                a.1.push(column);
                a.2.push(value);
            }
            b.push(limit);
        };
        let entries = |bound: &Bound, sign: f64| -> Vec<(usize, f64)> {
            let moving = bound.parts.iter().filter(|(k, _)| *k > 0);
            moving.flat_map(|(k, row)| (0..n).map(|v| (variable(*k, v), sign * row[v])).collect::<Vec<_>>()).collect()
        };
        let mut equalities = 0;
        for bound in self.bounds.iter().filter(|b| b.low == b.high) {
            push(&mut entries(bound, 1.0).into_iter(), bound.high);
            equalities += 1;
        }
        let mut inequalities = 0;
        for bound in self.bounds.iter().filter(|b| b.low != b.high) {
            if bound.high.is_finite() {
                push(&mut entries(bound, 1.0).into_iter(), bound.high);
                inequalities += 1;
            }
            if bound.low.is_finite() {
                push(&mut entries(bound, -1.0).into_iter(), -bound.low);
                inequalities += 1;
            }
        }
        for k in 1..=count {
            let (low, high) = &self.boxes[k];
            for v in 0..n {
                push(&mut [(variable(k, v), 1.0)].into_iter(), high[v]);
                push(&mut [(variable(k, v), -1.0)].into_iter(), -low[v]);
                inequalities += 2;
            }
        }
        let a = CscMatrix::new_from_triplets(b.len(), count * n, a.0, a.1, a.2);
        let cones: Vec<SupportedConeT<f64>> = vec![ZeroConeT(equalities), NonnegativeConeT(inequalities)];
        let settings =
            DefaultSettings { verbose: false, tol_gap_abs: 1e-6, tol_gap_rel: 1e-6, ..DefaultSettings::default() };
        let mut solver = DefaultSolver::new(&p, &gradient, &a, &b, &cones, settings).ok()?;
        solver.solve();
        if !matches!(solver.solution.status, SolverStatus::Solved | SolverStatus::AlmostSolved) {
            return None;
        }
        let mut out = vec![[0.0; MAX_JOINTS]; count + 1];
        for k in 1..=count {
            out[k][..n].copy_from_slice(&solver.solution.x[variable(k, 0)..variable(k, 0) + n]);
        }
        Some(out)
    }
}
