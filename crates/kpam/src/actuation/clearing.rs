//! Moves poses out of overlaps with bodies while they keep meeting the constraints.

use super::{ActuationSearch, Candidate};
use crate::model::{MAX_JOINTS, Row};
use crate::qp::{Bound, Qp, QpOutcome};
use crate::world::Clearance;

/// Maximum number of steps for one pose.
const STEPS: usize = 10;
/// Maximum change (rad or m) of a joint in one step.
const STEP: f64 = 0.15;
/// Maximum increase (m) of a distance that one step attempts; the direction out of a deep overlap changes on the way.
const GAIN: f64 = 0.03;
/// The search ends unless this many steps reduce the largest missing distance to the fraction `SLOWEST`.
const PATIENCE: usize = 3;
const SLOWEST: f64 = 0.9;
/// How often a step may halve the attempted increase of distance if the constraints do not allow it.
const HALVINGS: usize = 4;
/// Distance (m) beyond the required clearance that the steps aim for, and the smaller one at which the search succeeds.
const SPARE: f64 = 2e-3;
const ENOUGH: f64 = 1e-3;
/// Pairs of bodies are considered up to this distance (m) beyond the required clearance, so that a step away from one
/// body does not run into another.
pub(crate) const HEEDED: f64 = 0.03;

impl ActuationSearch<'_> {
    /// Returns a pose near `from` that meets the constraints and is collision-free; `None` if the search finds none.
    ///
    /// Each step is the smallest one that meets the linearized constraints, joint limits and clearances. `clearances`
    /// must append the clearances at a pose that are below [`HEEDED`].
    pub fn cleared(&mut self, from: &Row, mut clearances: impl FnMut(&Row, &mut Vec<Clearance>)) -> Option<Candidate> {
        let mut x = *from;
        let mut found = Vec::new();
        let mut milestone = f64::INFINITY;
        for step in 0..STEPS {
            found.clear();
            clearances(&x, &mut found);
            let worst = found.iter().fold(0.0, |worst: f64, clearance| worst.max(SPARE - clearance.gap));
            if worst <= SPARE - ENOUGH && self.violation(&x) <= 0.0 {
                return Some(self.candidate(&x));
            }
            if step % PATIENCE == 0 {
                if worst > SLOWEST * milestone {
                    return None;
                }
                milestone = worst;
            }
            let step = self.step_away(&x, &found)?;
            for v in 0..self.model.n() {
                x[v] = (x[v] + step[v]).clamp(self.lower[v], self.upper[v]);
            }
        }
        None
    }

    fn step_away(&mut self, x: &Row, clearances: &[Clearance]) -> Option<Row> {
        let n = self.model.n();
        let mut bounds = std::mem::take(&mut self.bounds);
        self.linearize(x, &mut bounds);
        let mut hessian = [[0.0; MAX_JOINTS]; MAX_JOINTS];
        for v in 0..n {
            hessian[v][v] = 1.0;
            let mut row = [0.0; MAX_JOINTS];
            row[v] = 1.0;
            let (low, high) = ((self.lower[v] - x[v]).max(-STEP), (self.upper[v] - x[v]).min(STEP));
            bounds.push(Bound { row, low, high });
        }
        let others = bounds.len();
        let mut outcome = QpOutcome::Infeasible;
        let mut share = 1.0;
        for _ in 0..=HALVINGS {
            bounds.truncate(others);
            bounds.extend(clearances.iter().map(|clearance| {
                let lacks = SPARE - clearance.gap;
                let low = if lacks > 0.0 { share * lacks.min(GAIN) } else { lacks };
                Bound { row: clearance.gradient, low, high: f64::INFINITY }
            }));
            outcome = self.qp.solve(&Qp { n, hessian: &hessian[..n], gradient: &[0.0; MAX_JOINTS], bounds: &bounds });
            if matches!(outcome, QpOutcome::Solved { .. }) {
                break;
            }
            share *= 0.5;
        }
        self.bounds = bounds;
        match outcome {
            QpOutcome::Solved { step, .. } => Some(step),
            QpOutcome::Infeasible | QpOutcome::Failed => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::problem;
    use super::*;
    use crate::model::Model;

    /// The tip stays at its goal while the hand tilts. If the tip lies deeper in the obstacle than the hand is long, no
    /// collision-free pose exists.
    #[test]
    fn a_hand_leans_out_of_a_plane() {
        let mut found = 0;
        for number in 0..48 {
            let (turn, towards) = (f64::from(number % 6) * 0.4 - 1.0, f64::from(number) * 0.9);
            let goal = [0.45 * turn.cos(), 0.45 * turn.sin(), 0.3];
            let problem = problem(-1.0, 0.5, goal);
            let model = Model::new(&problem.robot, &problem.q_start).unwrap();
            let resolved = problem.resolve().unwrap();
            let mut search = ActuationSearch::new(&problem, &model, &resolved);
            let from = search.all(24).candidates[0].x;
            let normal = nalgebra::Vector3::new(towards.cos(), towards.sin(), 0.0);
            let mut sight = ActuationSearch::new(&problem, &model, &resolved);
            let mut height = |x: &Row| sight.hand(x).translation.vector.dot(&normal);
            let begin = height(&from);
            let mut beyond = |by: f64| {
                search.cleared(&from, |x, clearances| {
                    let mut gradient = [0.0; MAX_JOINTS];
                    for v in 0..model.n() {
                        let (mut high, mut low) = (*x, *x);
                        high[v] += 1e-6;
                        low[v] -= 1e-6;
                        gradient[v] = (height(&high) - height(&low)) / 2e-6;
                    }
                    clearances.push(Clearance { gap: height(x) - begin - by, gradient });
                })
            };
            let (near, far) = (beyond(0.01), beyond(0.25));
            assert!(far.is_none(), "{number}");
            if let Some(pose) = near {
                found += 1;
                assert!(height(&pose.x) >= begin + 0.01 + ENOUGH - 1e-9, "{number}");
                assert!(search.violation(&pose.x) <= 0.0, "{number}");
            }
        }
        assert!(found >= 30, "{found} of 48");
    }
}
