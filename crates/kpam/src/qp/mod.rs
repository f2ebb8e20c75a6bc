//! Small dense quadratic programs.

mod active_set;
mod equalities;

pub use active_set::ActiveSet;
pub(crate) use equalities::smallest_step;

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

impl Qp<'_> {
    /// Returns whether the Hessian has a row for each variable, and there are at most [`MAX_JOINTS`] variables.
    fn fits(&self) -> bool {
        self.n <= MAX_JOINTS && self.n <= self.hessian.len()
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
    use nalgebra::{DMatrix, DVector};
    use proptest::prelude::*;

    /// Asserts the conditions of Karush, Kuhn and Tucker, which only the minimizer of a convex program meets.
    fn is_minimizer(qp: &Qp<'_>, step: &Row, multipliers: &[f64]) -> Result<(), TestCaseError> {
        for i in 0..qp.n {
            let slope = dot(qp.n, &qp.hessian[i], step) + qp.gradient[i];
            let held: f64 = qp.bounds.iter().zip(multipliers).map(|(bound, m)| m * bound.row[i]).sum();
            prop_assert!((slope - held).abs() < 1e-7 * (1.0 + held.abs()), "{slope} {held}");
        }
        for (bound, multiplier) in qp.bounds.iter().zip(multipliers) {
            let value = dot(qp.n, &bound.row, step);
            prop_assert!(value >= bound.low - 1e-8 && value <= bound.high + 1e-8, "{value} {bound:?}");
            let end = if *multiplier > 0.0 { bound.low } else { bound.high };
            prop_assert!(*multiplier == 0.0 || (value - end).abs() < 1e-8, "{multiplier} {value} {bound:?}");
        }
        Ok(())
    }

    /// Returns whether some d satisfies all bounds. If so, some d is also at an end of as many bounds as there are
    /// independent rows.
    fn is_feasible(n: usize, bounds: &[Bound]) -> bool {
        let rank = n.min(bounds.len());
        (0..3_usize.pow(bounds.len() as u32)).any(|code| {
            let ends: Vec<(&Bound, f64)> = bounds
                .iter()
                .enumerate()
                .filter_map(|(k, bound)| match code / 3_usize.pow(k as u32) % 3 {
                    0 => None,
                    1 => Some((bound, bound.low)),
                    _ => Some((bound, bound.high)),
                })
                .collect();
            if ends.len() != rank {
                return false;
            }
            let rows = DMatrix::from_fn(rank, n, |i, j| ends[i].0.row[j]);
            let values = DVector::from_iterator(rank, ends.iter().map(|end| end.1));
            let Ok(d) = rows.svd(true, true).solve(&values, 1e-12) else { return false };
            bounds.iter().all(|bound| {
                let value: f64 = (0..n).map(|i| bound.row[i] * d[i]).sum();
                value > bound.low - 1e-7 && value < bound.high + 1e-7
            })
        })
    }

    #[test]
    fn a_corner_is_found() {
        let hessian = [row(&[1.0, 0.0]), row(&[0.0, 1.0])];
        let gradient = row(&[-3.0, -3.0]);
        let bounds = [
            Bound { row: row(&[1.0, 1.0]), low: f64::NEG_INFINITY, high: 2.0 },
            Bound { row: row(&[1.0, 0.0]), low: 0.0, high: 0.5 },
        ];
        let outcome = ActiveSet::default().solve(&Qp { n: 2, hessian: &hessian, gradient: &gradient, bounds: &bounds });
        let QpOutcome::Solved { step, multipliers } = outcome else { panic!("{outcome:?}") };
        assert!((step[0] - 0.5).abs() < 1e-6 && (step[1] - 1.5).abs() < 1e-6, "{step:?}");
        assert!((multipliers[0] + 1.5).abs() < 1e-5 && (multipliers[1] + 1.0).abs() < 1e-5, "{multipliers:?}");
    }

    #[test]
    fn contradictions_are_infeasible() {
        let hessian = [row(&[1.0])];
        let gradient = row(&[0.0]);
        let bounds =
            [Bound { row: row(&[1.0]), low: 1.0, high: 2.0 }, Bound { row: row(&[1.0]), low: -2.0, high: -1.0 }];
        let qp = Qp { n: 1, hessian: &hessian, gradient: &gradient, bounds: &bounds };
        assert!(ActiveSet::default().solve(&qp) == QpOutcome::Infeasible && !is_feasible(1, &bounds));
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(200))]
        #[test]
        fn the_minimizer_is_found_if_a_step_satisfies_all_bounds(
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
            match ActiveSet::default().solve(&qp) {
                QpOutcome::Solved { step, multipliers } => is_minimizer(&qp, &step, &multipliers)?,
                QpOutcome::Infeasible => prop_assert!(!is_feasible(n, &bounds)),
                QpOutcome::Failed => prop_assert!(false, "a program of four variables failed"),
            }
        }
    }
}
