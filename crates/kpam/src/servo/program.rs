//! The quadratic program that chooses the velocities of a step.

use super::joint::Settled;
use super::pairs::Pair;
use super::task::Cost;
use crate::model::{MAX_JOINTS, Row};
use crate::qp::{ActiveSet, Bound, Qp, QpOutcome};

/// The velocities to which the variables settle after a step.
#[derive(Debug)]
pub(super) struct Choice {
    pub settled: Row,
    /// Multiplier of each bound: those of the ranges, then those of the pairs.
    pub multipliers: Vec<f64>,
}

/// The solver, with bounds that are reused.
#[derive(Default)]
pub(super) struct Program {
    solver: ActiveSet,
    bounds: Vec<Bound>,
}

impl Program {
    /// Minimizes a cost within the ranges of the variables and the permitted speeds of approach; `None` if no step meets
    /// the bounds.
    pub fn solve(&mut self, cost: &Cost, ranges: &[Settled], pairs: &[Pair]) -> Option<Choice> {
        let n = ranges.len();
        // A pair within its buffer moves apart, unless this contradicts the limits of the joints.
        for parting in [true, false] {
            self.bounds.clear();
            for (v, range) in ranges.iter().enumerate() {
                let mut row = [0.0; MAX_JOINTS];
                row[v] = 1.0;
                self.bounds.push(Bound { row, low: range.low, high: range.high });
            }
            for pair in pairs {
                let speed = if parting { pair.speed } else { pair.speed.max(0.0) };
                self.bounds.push(Bound { row: pair.gradient, low: -speed, high: f64::INFINITY });
            }
            let qp = Qp { n, hessian: &cost.hessian, gradient: &cost.gradient, bounds: &self.bounds };
            if let QpOutcome::Solved { step: settled, multipliers } = self.solver.solve(&qp) {
                return Some(Choice { settled, multipliers });
            }
            if pairs.iter().all(|pair| pair.speed >= 0.0) {
                break;
            }
        }
        None
    }
}
