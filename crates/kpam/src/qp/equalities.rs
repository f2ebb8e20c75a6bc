//! Computes the smallest step that satisfies linear equalities. Most steps along a hand path need no inequalities.

use super::dot;
use crate::ldl::solve_ldl;
use crate::model::{MAX_JOINTS, Row};

/// If a pivot is smaller than this fraction of the squared length of its row, the rows count as linearly dependent.
const DEPENDENT: f64 = 1e-6;

/// Returns the minimizer of `d' d / 2 + g' d` under `rows . d = values`, from the normal equations of the rows; `None`
/// if the rows are nearly dependent.
pub(crate) fn smallest_step<const M: usize>(
    n: usize,
    rows: &[Row; M],
    values: &[f64; M],
    gradient: &Row,
) -> Option<Row> {
    // Optimality conditions: d = A' y - g with A A' y = b + A g.
    let mut a = [[0.0; M]; M];
    let mut b = [0.0; M];
    for i in 0..M {
        for k in 0..=i {
            a[i][k] = dot(n, &rows[i], &rows[k]);
        }
        b[i] = values[i] + dot(n, &rows[i], gradient);
    }
    let y = solve_ldl(M, &a, &b, |i| DEPENDENT * a[i][i])?;
    let mut step = [0.0; MAX_JOINTS];
    for v in 0..n {
        step[v] = (0..M).map(|i| rows[i][v] * y[i]).sum::<f64>() - gradient[v];
    }
    Some(step)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::qp::{ActiveSet, Bound, Qp, QpOutcome};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn agrees_with_the_active_set(
            entries in prop::array::uniform3(prop::array::uniform7(-1.0..1.0f64)),
            values in prop::array::uniform3(-1.0..1.0f64),
            slope in prop::array::uniform7(-1.0..1.0f64),
        ) {
            let row = |e: &[f64; 7]| {
                let mut out = [0.0; MAX_JOINTS];
                out[..7].copy_from_slice(e);
                out
            };
            let (rows, gradient) = (entries.map(|e| row(&e)), row(&slope));
            let Some(step) = smallest_step(7, &rows, &values, &gradient) else { return Ok(()) };
            let mut hessian = [[0.0; MAX_JOINTS]; 7];
            (0..7).for_each(|v| hessian[v][v] = 1.0);
            let bounds: Vec<Bound> =
                rows.iter().zip(values).map(|(row, b)| Bound { row: *row, low: b, high: b }).collect();
            let qp = Qp { n: 7, hessian: &hessian, gradient: &gradient, bounds: &bounds };
            let QpOutcome::Solved { step: wanted, .. } = ActiveSet::default().solve(&qp) else {
                return Err(TestCaseError::fail("the active set finds no solution"));
            };
            for v in 0..7 {
                prop_assert!((step[v] - wanted[v]).abs() < 1e-6 * (1.0 + wanted[v].abs()), "{step:?} {wanted:?}");
            }
        }
    }

    #[test]
    fn dependent_rows_are_refused() {
        let mut row = [0.0; MAX_JOINTS];
        row[0] = 1.0;
        assert_eq!(smallest_step(7, &[row, row], &[0.0, 0.0], &[0.0; MAX_JOINTS]), None);
        assert_eq!(smallest_step(7, &[[0.0; MAX_JOINTS]], &[0.0], &[0.0; MAX_JOINTS]), None);
    }
}
