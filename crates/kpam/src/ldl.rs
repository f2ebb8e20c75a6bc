//! Solves small symmetric linear systems.

/// Solves `a x = b` for the first `n` variables by LDL factorization; only the lower triangle of `a` is used. Returns
/// `None` if pivot `i` is not larger than `least(i)`, which means that `a` is not positive definite, or nearly so.
///
/// The function is inlined, so that the compiler unrolls the loops if the caller's `n` is a constant.
#[inline(always)]
pub(crate) fn solve_ldl<const M: usize>(
    n: usize,
    a: &[[f64; M]; M],
    b: &[f64; M],
    least: impl Fn(usize) -> f64,
) -> Option<[f64; M]> {
    let n = n.min(M); // avoids bounds checks
    let mut l = [[0.0; M]; M];
    // The product of L and D.
    let mut scaled = [[0.0; M]; M];
    let mut inverse = [1.0; M];
    let mut x = [0.0; M];
    for i in 0..n {
        let mut rest = b[i];
        let mut pivot = a[i][i];
        for k in 0..i {
            let mut sum = a[i][k];
            for m in 0..k {
                sum -= l[i][m] * scaled[k][m];
            }
            scaled[i][k] = sum;
            l[i][k] = sum * inverse[k];
            pivot -= l[i][k] * sum;
            rest -= l[i][k] * x[k];
        }
        if pivot.is_nan() || pivot <= least(i) {
            return None;
        }
        inverse[i] = 1.0 / pivot;
        x[i] = rest;
    }
    for i in (0..n).rev() {
        let mut sum = x[i] * inverse[i];
        for k in i + 1..n {
            sum -= l[k][i] * x[k];
        }
        x[i] = sum;
    }
    Some(x)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{SMatrix, SVector};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn agrees_with_cholesky(factors in prop::array::uniform25(-1.0..1.0f64), b in prop::array::uniform5(-1.0..1.0f64)) {
            let factor = SMatrix::<f64, 5, 5>::from_row_slice(&factors);
            let matrix = factor * factor.transpose() + SMatrix::identity() * 0.01;
            let a: [[f64; 5]; 5] = std::array::from_fn(|i| std::array::from_fn(|k| matrix[(i, k)]));
            let x = solve_ldl(5, &a, &b, |_| 0.0).unwrap();
            let wanted = matrix.cholesky().unwrap().solve(&SVector::from(b));
            prop_assert!((SVector::from(x) - wanted).amax() < 1e-9 * (1.0 + wanted.amax()), "{x:?} {wanted}");
        }
    }

    #[test]
    fn indefinite_systems_are_refused() {
        assert_eq!(solve_ldl(2, &[[1.0, 0.0], [2.0, 1.0]], &[1.0, 1.0], |_| 0.0), None);
        assert_eq!(solve_ldl(1, &[[f64::NAN]], &[1.0], |_| 0.0), None);
    }
}
