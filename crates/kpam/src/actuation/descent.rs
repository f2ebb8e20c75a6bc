//! Minimizes the cost along the constraints by sequential quadratic programming (SQP) with the exact Hessian of the
//! Lagrangian. Second kinematic derivatives are cross products of columns of the Jacobian.

use nalgebra::Vector3;

use super::bands::{INSIDE, axis_bands};
use super::projection::STEP;
use super::{ActuationSearch, Candidate};
use crate::model::{MAX_JOINTS, Row, Weighed};
use crate::qp::{Bound, Qp, QpOutcome};
use gensim2_geometry::Pose;

/// Maximum number of SQP iterations.
const ITERATIONS: usize = 30;
/// The iterations end after a step that reduces the cost by less than this fraction.
const GAIN: f64 = 1e-5;
/// A descent is abandoned if even this multiple of the predicted cost reduction would not make the pose the cheapest.
const SURELY: f64 = 2.0;
/// If a descent comes closer than this (rad or m) to a known optimum with a short step, it counts as leading there.
const BASIN: f64 = 0.05;

impl ActuationSearch<'_> {
    /// Runs SQP from a pose that meets the constraints, and returns the cheapest pose on the way that still meets them.
    /// Returns `None` if the descent leads to an optimum in `known`, or would end at a higher cost than one of them.
    pub(super) fn descend(&mut self, from: &Row, known: &[Candidate]) -> Option<Candidate> {
        let n = self.model.n();
        let mut x = *from;
        let mut best: Option<Candidate> = None;
        let mut curvature = Curvature::default();
        let mut radius = STEP;
        let mut cost = self.cost(&x);
        let mut violation = self.violation(&x).max(0.0);
        for iteration in 0..ITERATIONS {
            let (gradient, mut hessian) = (self.gradient(&x), self.hessian(&x, &curvature));
            let mut bounds = std::mem::take(&mut self.bounds);
            self.linearize(&x, &mut bounds);
            let constraints = bounds.len();
            for v in 0..n {
                let mut row = [0.0; MAX_JOINTS];
                row[v] = 1.0;
                let low = (self.lower[v] - x[v]).max(-radius);
                let high = (self.upper[v] - x[v]).min(radius);
                bounds.push(Bound { row, low: low.min(high), high });
            }
            let mut shift = 0.0;
            let outcome = loop {
                let qp = Qp { n, hessian: &hessian[..n], gradient: &gradient, bounds: &bounds };
                match self.qp.solve(&qp) {
                    QpOutcome::Failed if shift < 1e3 => {
                        let more = if shift == 0.0 { 0.3 } else { 3.0 * shift };
                        for (i, row) in hessian.iter_mut().enumerate().take(n) {
                            row[i] += more - shift;
                        }
                        shift = more;
                    }
                    other => break other,
                }
            };
            self.bounds = bounds;
            let QpOutcome::Solved { step, multipliers } = outcome else {
                // The constraints are curved, so a step along their linearization leaves them; project the pose back.
                if self.project(&mut x) > 1e-6 {
                    break;
                }
                cost = self.cost(&x);
                violation = 0.0;
                radius *= 0.5;
                if radius < 1e-4 {
                    break;
                }
                continue;
            };
            let length = step[..n].iter().fold(0.0, |m: f64, s| m.max(s.abs()));
            // If the quadratic model is accurate and its optimum within reach, the model predicts the final cost.
            if iteration > 0 && length < 0.9 * radius {
                let predicted = predicted(n, &step, &gradient, &hessian);
                if known.iter().any(|c| c.cost < cost + SURELY * predicted) {
                    return best;
                }
            }
            let penalty = 1.5 * multipliers[..constraints].iter().fold(1.0, |m: f64, u| m.max(u.abs()));
            let merit = |cost: f64, violation: f64| cost + penalty * violation;
            let mut trial = x;
            for v in 0..n {
                trial[v] = (x[v] + step[v]).clamp(self.lower[v], self.upper[v]);
            }
            let trial_violation = self.project_gently(&mut trial);
            let trial_cost = self.cost(&trial);
            if trial_violation <= 0.0 && best.is_none_or(|b| trial_cost < b.cost) {
                best = Some(self.candidate(&trial));
            }
            if merit(trial_cost, trial_violation) <= merit(cost, violation) + 1e-12 {
                x = trial;
                let gain = cost - trial_cost;
                cost = trial_cost;
                violation = trial_violation;
                self.curvature_of(&multipliers, &mut curvature);
                if length < 0.3 * radius {
                    radius = radius.max(2.0 * length).min(STEP);
                } else {
                    radius = (2.0 * radius).min(STEP);
                }
                if length < 1e-6 || (gain.abs() < GAIN * (1.0 + cost) && violation <= 0.0) {
                    break;
                }
                if length < BASIN && known.iter().any(|c| self.model.are_near(&c.x, &x, BASIN)) {
                    return None;
                }
            } else {
                radius = 0.25 * length;
                if radius < 1e-5 {
                    break;
                }
            }
        }
        best
    }

    /// Moves a pose towards the constraints by two Gauss-Newton steps with the smallest joint changes. Returns the
    /// remaining violation.
    fn project_gently(&mut self, x: &mut Row) -> f64 {
        let n = self.model.n();
        for _ in 0..3 {
            let violation = self.violation(x);
            if violation <= 0.0 {
                return 0.0;
            }
            let mut bounds = std::mem::take(&mut self.bounds);
            self.linearize(x, &mut bounds);
            for v in 0..n {
                let mut row = [0.0; MAX_JOINTS];
                row[v] = 1.0;
                bounds.push(Bound { row, low: self.lower[v] - x[v], high: self.upper[v] - x[v] });
            }
            let mut hessian = [[0.0; MAX_JOINTS]; MAX_JOINTS];
            for (v, row) in hessian.iter_mut().enumerate().take(n) {
                row[v] = 1.0;
            }
            let gradient = [0.0; MAX_JOINTS];
            let qp = Qp { n, hessian: &hessian[..n], gradient: &gradient, bounds: &bounds };
            let outcome = self.qp.solve(&qp);
            self.bounds = bounds;
            let QpOutcome::Solved { step, .. } = outcome else { return violation };
            for v in 0..n {
                x[v] = (x[v] + step[v]).clamp(self.lower[v], self.upper[v]);
            }
        }
        self.violation(x).max(0.0)
    }

    /// Linearizes the constraints at `x` as bounds on the step. The link frames must already be placed at `x`.
    pub(super) fn linearize(&mut self, x: &Row, out: &mut Vec<Bound>) {
        self.place(x);
        out.clear();
        let placed = &self.placed;
        let hand = placed.hand;
        for p in &self.resolved.points {
            let at = hand.rotation * p.on_hand + hand.translation.vector;
            for (k, row) in placed.point_rows(&at).into_iter().enumerate() {
                let (miss, t) = (at[k] - p.target[k], INSIDE * p.tolerance);
                out.push(Bound { row, low: -t - miss, high: t - miss });
            }
        }
        for a in &self.resolved.axes {
            for (m, low, high) in axis_bands(a, &(hand.rotation * a.on_hand)) {
                let u = hand.rotation * a.on_hand;
                let row = placed.angular_row(&u.cross(&m));
                let value = u.dot(&m);
                out.push(Bound { row, low: low - value, high: high - value });
            }
        }
        if let Some([low, high]) = self.problem.options.workspace {
            let at = hand.translation.vector;
            for (k, row) in placed.point_rows(&at).into_iter().enumerate() {
                out.push(Bound { row, low: low[k] - at[k], high: high[k] - at[k] });
            }
        }
    }

    /// Combines the multipliers with hand points and directions, as weights of the second derivatives in the
    /// Lagrangian. They are taken at the pose at which the bounds were linearized, which is close to the next pose.
    fn curvature_of(&self, multipliers: &[f64], out: &mut Curvature) {
        out.points.clear();
        out.axes.clear();
        let mut next = multipliers.iter().copied();
        let mut take = || next.next().unwrap_or(0.0);
        for p in &self.resolved.points {
            let force = Vector3::new(take(), take(), take());
            out.points.push((p.on_hand, -force));
        }
        for a in &self.resolved.axes {
            let u = self.placed.hand.rotation * a.on_hand;
            let pull = axis_bands(a, &u).fold(Vector3::zeros(), |sum, (m, _, _)| sum - m * take());
            out.axes.push((a.on_hand, pull));
        }
        if self.problem.options.workspace.is_some() {
            let force = Vector3::new(take(), take(), take());
            out.points.push((Vector3::zeros(), -force));
        }
    }

    pub(super) fn gradient(&mut self, x: &Row) -> Row {
        self.place(x);
        let placed = &self.placed;
        let hand = placed.hand;
        let mut g = [0.0; MAX_JOINTS];
        let steps = self.steps(x);
        for v in 0..self.model.n() {
            g[v] = 2.0 * self.weights[v] * steps[v];
        }
        let mut add = |row: &Row, factor: f64| g.iter_mut().zip(row).for_each(|(a, b)| *a += factor * b);
        let way = hand.translation.vector - self.start_hand.translation.vector;
        add(&placed.linear_row(&hand.translation.vector, &way), 2.0);
        // Gradient: d(1 - cos) = -1/2 sum_k s_k . (w x r_k) = -1/2 w . sum_k r_k x s_k
        let pull = columns(&hand)
            .zip(columns(&self.start_hand))
            .fold(Vector3::zeros(), |sum: Vector3<f64>, (r, s)| sum + r.cross(&s));
        add(&placed.angular_row(&pull), -0.5);
        for t in &self.resolved.costs {
            let p = hand.rotation * t.on_hand + hand.translation.vector;
            let row = placed.linear_row(&p, &t.normal);
            add(&row, 2.0 * t.weight * t.normal.dot(&(p - t.target)));
        }
        g
    }

    /// Returns the Hessian of the Lagrangian. If it would be indefinite, adds stiffness perpendicular to the
    /// constraints.
    pub(super) fn hessian(&mut self, x: &Row, curvature: &Curvature) -> [Row; MAX_JOINTS] {
        self.place(x);
        let n = self.model.n();
        let placed = &self.placed;
        let hand = placed.hand;
        let origin = hand.translation.vector;
        let mut h = [[0.0; MAX_JOINTS]; MAX_JOINTS];
        for v in 0..n {
            h[v][v] = 2.0 * self.weights[v];
        }
        let mut add = |row: &Row, factor: f64| {
            for i in 0..n {
                for k in 0..n {
                    h[i][k] += factor * row[i] * row[k];
                }
            }
        };
        for row in placed.point_rows(&origin) {
            add(&row, 2.0);
        }
        for t in &self.resolved.costs {
            let p = hand.rotation * t.on_hand + origin;
            add(&placed.linear_row(&p, &t.normal), 2.0 * t.weight);
        }
        // The constraints alone determine the step perpendicular to them; the stiffness only keeps the Hessian convex.
        const STIFF: f64 = 20.0;
        for p in &self.resolved.points {
            let at = hand.rotation * p.on_hand + origin;
            for row in placed.point_rows(&at) {
                add(&row, STIFF);
            }
        }
        for (a, (_, pull)) in self.resolved.axes.iter().zip(&curvature.axes) {
            if pull.norm() > 1e-9 {
                let u = hand.rotation * a.on_hand;
                add(&placed.angular_row(&u.cross(&pull.normalize())), STIFF);
            }
        }
        let (mut points, mut axes) = (std::mem::take(&mut self.forces), std::mem::take(&mut self.pulls));
        points.clear();
        axes.clear();
        points.extend(curvature.points.iter().map(|(p, f)| (hand.rotation * p + origin, *f)));
        points.push((origin, 2.0 * (origin - self.start_hand.translation.vector)));
        axes.extend(curvature.axes.iter().map(|(a, m)| (hand.rotation * a, *m)));
        axes.extend(columns(&hand).zip(columns(&self.start_hand)).map(|(r, s)| (r, -0.5 * s)));
        for t in &self.resolved.costs {
            let p = hand.rotation * t.on_hand + origin;
            points.push((p, t.normal * (2.0 * t.weight * t.normal.dot(&(p - t.target)))));
        }
        placed.second_derivatives(&points, &axes, &mut h);
        (self.forces, self.pulls) = (points, axes);
        h
    }
}

/// Returns the change of the cost for a step by the quadratic model.
fn predicted(n: usize, step: &Row, gradient: &Row, hessian: &[Row; MAX_JOINTS]) -> f64 {
    let curved = |i: usize| (0..n).map(|k| hessian[i][k] * step[k]).sum::<f64>();
    (0..n).map(|i| step[i] * (gradient[i] + 0.5 * curved(i))).sum()
}

/// Weights of the second derivatives of hand points (forces) and of hand directions (torques).
#[derive(Default)]
pub(super) struct Curvature {
    points: Vec<Weighed>,
    axes: Vec<Weighed>,
}

pub(super) fn columns(pose: &Pose) -> impl Iterator<Item = Vector3<f64>> + '_ {
    (0..3).map(|k| pose.rotation.matrix().column(k).into())
}
