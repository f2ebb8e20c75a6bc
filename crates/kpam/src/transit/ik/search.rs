//! Joint values that bring links to poses, by the method of Levenberg and Marquardt.

use gensim2_geometry::{Chain, ChainFrames, Pose, rotation_log};
use nalgebra::{SMatrix, SVector};

use crate::model::{MAX_JOINTS, Model, Row};

/// Maximum number of Levenberg-Marquardt iterations from one start value.
const ROUNDS: usize = 60;
/// A pose counts as reached if its error is below this value (m and rad).
const MET: f64 = 1e-7;

/// A pose that the tip of a chain must reach.
#[derive(Debug, Clone)]
pub(super) struct Target {
    pub chain: Chain,
    pub goal: Pose,
}

/// Searches joint values that bring the tip of each target's chain to its pose. `D` is 6 for each target.
pub(super) struct Search<'a, const D: usize> {
    pub targets: &'a [Target],
    pub model: &'a Model,
    /// For each variable, whether the search changes it.
    pub searched: [bool; MAX_JOINTS],
    q: Vec<f64>,
    pub frames: Vec<ChainFrames>,
}

impl<'a, const D: usize> Search<'a, D> {
    pub fn new(targets: &'a [Target], model: &'a Model, searched: [bool; MAX_JOINTS]) -> Self {
        Self { targets, model, searched, q: Vec::new(), frames: vec![ChainFrames::default(); targets.len()] }
    }

    pub fn place(&mut self, x: &Row) {
        for (target, frames) in self.targets.iter().zip(&mut self.frames) {
            self.model.forward_along(&target.chain, x, &mut self.q, frames);
        }
    }

    /// Returns the error of the links' poses at `x`: for each target, translation (m) and rotation (rad) in the base
    /// frame.
    fn left(&mut self, x: &Row) -> SVector<f64, D> {
        self.place(x);
        let mut out = SVector::<f64, D>::zeros();
        for (k, (target, frames)) in self.targets.iter().zip(&self.frames).enumerate() {
            let tip = &frames.tip;
            let shift = target.goal.translation.vector - tip.translation.vector;
            let turn = rotation_log(&(target.goal.rotation * tip.rotation.inverse()));
            out.fixed_rows_mut::<3>(6 * k).copy_from(&shift);
            out.fixed_rows_mut::<3>(6 * k + 3).copy_from(&turn);
        }
        out
    }

    /// Returns the Jacobian of all targets' links by columns, at the configuration that was placed last.
    pub fn columns(&self) -> [SVector<f64, D>; MAX_JOINTS] {
        let mut out = [SVector::<f64, D>::zeros(); MAX_JOINTS];
        for (k, (target, frames)) in self.targets.iter().zip(&self.frames).enumerate() {
            let twists = self.model.twists(&target.chain, frames);
            for (column, twist) in out.iter_mut().zip(&twists).take(self.model.n()) {
                column.fixed_rows_mut::<6>(6 * k).copy_from(twist);
            }
        }
        out
    }

    /// Runs Levenberg-Marquardt from a start value, within the joint limits; `None` if it does not reach the goal pose.
    pub fn from(&mut self, x: &Row) -> Option<Row> {
        let n = self.model.n();
        let (mut x, mut damping) = (*x, 1e-2);
        for v in 0..n {
            x[v] = x[v].clamp(self.model.lower[v], self.model.upper[v]);
        }
        let mut left = self.left(&x);
        for _ in 0..ROUNDS {
            if left.amax() < MET {
                return Some(x);
            }
            let columns = self.columns();
            // A joint that is at a limit, and that the step would move beyond the limit, stays fixed.
            let mut normal = SMatrix::<f64, D, D>::identity() * (damping * left.norm_squared().min(1.0) + 1e-10);
            let pull = |v: usize, force: &SVector<f64, D>| columns[v].dot(force);
            let free: Vec<bool> = (0..n)
                .map(|v| {
                    let way = pull(v, &left);
                    !((x[v] <= self.model.lower[v] && way < 0.0) || (x[v] >= self.model.upper[v] && way > 0.0))
                })
                .collect();
            for v in (0..n).filter(|v| free[*v]) {
                normal += columns[v] * columns[v].transpose();
            }
            let force = normal.cholesky()?.solve(&left);
            let mut next = x;
            for v in (0..n).filter(|v| free[*v]) {
                next[v] = (x[v] + pull(v, &force)).clamp(self.model.lower[v], self.model.upper[v]);
            }
            let then = self.left(&next);
            if then.norm() < left.norm() {
                (x, left) = (next, then);
                damping = (0.3 * damping).max(1e-9);
            } else {
                damping *= 10.0;
                if damping > 1e6 {
                    return None;
                }
                left = self.left(&x);
            }
        }
        None
    }
}
