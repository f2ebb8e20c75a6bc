//! Solves quadratic programs with Clarabel's interior-point method, which is slower and serves to check the active-set
//! method.

use clarabel::algebra::CscMatrix;
use clarabel::solver::{
    DefaultSettings, DefaultSolver, IPSolver, NonnegativeConeT, SolverStatus, SupportedConeT, ZeroConeT,
};

use super::{Qp, QpOutcome, QpSolver};
use crate::model::MAX_JOINTS;

/// The solver Clarabel as a [`QpSolver`].
#[derive(Debug, Clone, Copy, Default)]
pub struct InteriorPoint;

impl QpSolver for InteriorPoint {
    fn solve(&mut self, qp: &Qp<'_>) -> QpOutcome {
        // Clarabel accepts neither a program without variables nor non-finite numbers.
        if !qp.fits() || qp.n == 0 || !qp.is_finite() {
            return QpOutcome::Failed;
        }
        let n = qp.n;
        // Clarabel's form is A x + s = b. Equalities come first, then upper ends, then lower ends with reversed sign.
        let mut rows: Vec<(usize, f64, f64)> = Vec::new();
        let equality = |b: &super::Bound| b.high - b.low <= 1e-12;
        for (i, b) in qp.bounds.iter().enumerate().filter(|(_, b)| equality(b)) {
            if b.high < b.low {
                return QpOutcome::Infeasible;
            }
            rows.push((i, 1.0, b.low));
        }
        let equalities = rows.len();
        for (i, b) in qp.bounds.iter().enumerate().filter(|(_, b)| !equality(b)) {
            if b.high.is_finite() {
                rows.push((i, 1.0, b.high));
            }
            if b.low.is_finite() {
                rows.push((i, -1.0, -b.low));
            }
        }
        let p: Vec<Vec<f64>> =
            (0..n).map(|i| (0..n).map(|j| if j >= i { qp.hessian[i][j] } else { 0.0 }).collect()).collect();
        let a: Vec<Vec<f64>> =
            rows.iter().map(|(i, sign, _)| (0..n).map(|j| sign * qp.bounds[*i].row[j]).collect()).collect();
        let b: Vec<f64> = rows.iter().map(|(_, _, b)| *b).collect();
        let cones: Vec<SupportedConeT<f64>> = vec![ZeroConeT(equalities), NonnegativeConeT(rows.len() - equalities)];
        let settings = DefaultSettings { verbose: false, ..DefaultSettings::default() };
        let (p, a) = (dense_to_csc(&p, n), dense_to_csc(&a, n));
        let Ok(mut solver) = DefaultSolver::new(&p, &qp.gradient[..n], &a, &b, &cones, settings) else {
            return QpOutcome::Failed;
        };
        solver.solve();
        match solver.solution.status {
            SolverStatus::Solved | SolverStatus::AlmostSolved => {
                let mut step = [0.0; MAX_JOINTS];
                step[..n].copy_from_slice(&solver.solution.x);
                let mut multipliers = vec![0.0; qp.bounds.len()];
                for ((i, sign, _), z) in rows.iter().zip(&solver.solution.z) {
                    multipliers[*i] -= sign * z;
                }
                QpOutcome::Solved { step, multipliers }
            }
            SolverStatus::PrimalInfeasible | SolverStatus::AlmostPrimalInfeasible => QpOutcome::Infeasible,
            _ => QpOutcome::Failed,
        }
    }
}

fn dense_to_csc(rows: &[Vec<f64>], n: usize) -> CscMatrix<f64> {
    let mut start = vec![0];
    let (mut index, mut value) = (Vec::new(), Vec::new());
    for c in 0..n {
        for (r, row) in rows.iter().enumerate() {
            if row[c] != 0.0 {
                index.push(r);
                value.push(row[c]);
            }
        }
        start.push(index.len());
    }
    CscMatrix::new(rows.len(), n, start, index, value)
}
