//! Small dense quadratic programs, and a trait that all their solvers implement.

mod active_set;
mod equalities;
mod interior_point;

pub use active_set::ActiveSet;
pub(crate) use equalities::smallest_step;
pub use interior_point::InteriorPoint;

use crate::model::{MAX_JOINTS, Row};

/// A bound `low <= row . d <= high` on a linear form of d; equal ends form an equality, infinite ends are ignored.
#[derive(Debug, Clone, Copy)]
pub struct Bound {
    /// Coefficients of the linear form.
    pub row: Row,
    /// Lower end of the bound; may be minus infinity.
    pub low: f64,
    /// Upper end of the bound; may be infinity.
    pub high: f64,
}

/// The program: minimize `d' H d / 2 + g' d` subject to bounds, with symmetric and positive definite `H`.
#[derive(Debug, Clone)]
pub struct Qp<'a> {
    /// Number of variables.
    pub n: usize,
    /// Rows of the Hessian `H`.
    pub hessian: &'a [Row],
    /// Gradient `g` at d = 0.
    pub gradient: &'a Row,
    /// Bounds on linear forms of d.
    pub bounds: &'a [Bound],
}

/// Result of solving a quadratic program.
// A step on the heap would cost more than moving it.
#[allow(clippy::large_enum_variant)]
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum QpOutcome {
    /// The program has been solved.
    Solved {
        /// The minimizer d.
        step: Row,
        /// Lagrange multiplier of each bound: positive if its lower end is active, negative if its upper end is active.
        multipliers: Vec<f64>,
    },
    /// No d satisfies all bounds.
    Infeasible,
    /// No solution was found: the Hessian is not positive definite or too small, the iteration limit was reached, there
    /// are more than [`MAX_JOINTS`] variables, or a number is not finite.
    Failed,
}

/// A solver of small dense quadratic programs.
pub trait QpSolver {
    /// Solves one quadratic program.
    fn solve(&mut self, qp: &Qp<'_>) -> QpOutcome;
}

impl Qp<'_> {
    /// Returns whether the Hessian has a row for each variable, and there are at most [`MAX_JOINTS`] variables.
    fn fits(&self) -> bool {
        self.n <= MAX_JOINTS && self.n <= self.hessian.len()
    }

    /// Returns whether all numbers are finite; only ends of bounds may be infinite.
    fn is_finite(&self) -> bool {
        let finite = |row: &Row| row[..self.n].iter().all(|v| v.is_finite());
        finite(self.gradient)
            && self.hessian[..self.n].iter().all(finite)
            && self.bounds.iter().all(|b| finite(&b.row) && !b.low.is_nan() && !b.high.is_nan())
    }
}

fn dot(n: usize, a: &Row, b: &Row) -> f64 {
    let mut sum = 0.0;
    // The known bound of `n` lets the compiler omit bounds checks.
    for i in 0..n.min(MAX_JOINTS) {
        sum += a[i] * b[i];
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::timing::testing::row;
    use proptest::prelude::*;

    #[test]
    fn a_corner_is_found_by_both() {
        let hessian = [row(&[1.0, 0.0]), row(&[0.0, 1.0])];
        let gradient = row(&[-3.0, -3.0]);
        let bounds = [
            Bound { row: row(&[1.0, 1.0]), low: f64::NEG_INFINITY, high: 2.0 },
            Bound { row: row(&[1.0, 0.0]), low: 0.0, high: 0.5 },
        ];
        let qp = Qp { n: 2, hessian: &hessian, gradient: &gradient, bounds: &bounds };
        for outcome in [ActiveSet::default().solve(&qp), InteriorPoint.solve(&qp)] {
            let QpOutcome::Solved { step, multipliers } = outcome else { panic!("{outcome:?}") };
            assert!((step[0] - 0.5).abs() < 1e-6 && (step[1] - 1.5).abs() < 1e-6, "{step:?}");
            assert!((multipliers[0] + 1.5).abs() < 1e-5 && (multipliers[1] + 1.0).abs() < 1e-5, "{multipliers:?}");
        }
    }

    #[test]
    fn contradictions_are_infeasible() {
        let hessian = [row(&[1.0])];
        let gradient = row(&[0.0]);
        let bounds =
            [Bound { row: row(&[1.0]), low: 1.0, high: 2.0 }, Bound { row: row(&[1.0]), low: -2.0, high: -1.0 }];
        let qp = Qp { n: 1, hessian: &hessian, gradient: &gradient, bounds: &bounds };
        assert_eq!(ActiveSet::default().solve(&qp), QpOutcome::Infeasible);
        assert_eq!(InteriorPoint.solve(&qp), QpOutcome::Infeasible);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(200))]
        #[test]
        fn both_solvers_agree(
            factors in prop::collection::vec(-1.0..1.0f64, 16),
            gradient in prop::collection::vec(-3.0..3.0f64, 4),
            rows in prop::collection::vec((prop::collection::vec(-1.0..1.0f64, 4), 0.0..0.5f64, -0.3..0.3f64, any::<bool>()), 1..8),
        ) {
            let n = 4;
            let mut hessian = [[0.0; MAX_JOINTS]; 4];
            for i in 0..n {
                for j in 0..n {
                    hessian[i][j] = (0..n).map(|k| factors[i * n + k] * factors[j * n + k]).sum::<f64>();
                }
                hessian[i][i] += 0.1;
            }
            let bounds: Vec<Bound> = rows
                .iter()
                .map(|(r, width, middle, equal)| {
                    // With more than three equalities, the random program would be infeasible.
                    let w = if *equal && rows.len() < 3 { 0.0 } else { *width };
                    Bound { row: row(r), low: middle - w, high: middle + w }
                })
                .collect();
            let g = row(&gradient);
            let qp = Qp { n, hessian: &hessian, gradient: &g, bounds: &bounds };
            let (a, b) = (ActiveSet::default().solve(&qp), InteriorPoint.solve(&qp));
            prop_assert_ne!(&a, &QpOutcome::Failed);
            if let (QpOutcome::Solved { step: x, .. }, QpOutcome::Solved { step: y, .. }) = (&a, &b) {
                let cost = |d: &Row| -> f64 {
                    (0..n).map(|i| g[i] * d[i] + 0.5 * d[i] * (0..n).map(|j| hessian[i][j] * d[j]).sum::<f64>()).sum()
                };
                prop_assert!((cost(x) - cost(y)).abs() < 1e-5 * (1.0 + cost(x).abs()), "{} {}", cost(x), cost(y));
                for bound in &bounds {
                    let v: f64 = (0..n).map(|i| bound.row[i] * x[i]).sum();
                    prop_assert!(v >= bound.low - 1e-8 && v <= bound.high + 1e-8);
                }
            } else {
                prop_assert_eq!(&a, &QpOutcome::Infeasible);
                prop_assert_eq!(&b, &QpOutcome::Infeasible);
            }
        }
    }
}
