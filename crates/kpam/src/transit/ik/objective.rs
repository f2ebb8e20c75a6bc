//! The secondary objective of inverse kinematics: closeness to a posture, and manipulability.

use gensim2_geometry::{Chain, ChainFrames};
use nalgebra::{Matrix6, SMatrix, SVector, Vector3, Vector6};

use super::search::Search;
use crate::model::{MAX_JOINTS, Model, Row};

/// Maximum number of steps by which the secondary objective improves one solution, and their maximum length (rad or m).
const STEPS: usize = 60;
const LONGEST: f64 = 0.3;
/// A solution is optimal if a step is shorter than this (rad or m), or improves the objective by less than this fraction.
const SHORT: f64 = 1e-6;
const GAIN: f64 = 1e-9;
/// Largest weight of short steps relative to the objective; beyond it, no step improves a solution.
const STIFFEST: f64 = 1e8;

/// Secondary objective of inverse kinematics: weighted squared distances from a posture minus the weighted
/// manipulability.
#[derive(Debug, Clone)]
pub(super) struct Objective {
    /// The posture and the weight of each variable.
    pub posture: Option<(Row, Row)>,
    pub manipulability: f64,
}

impl<const D: usize> Search<'_, D> {
    /// Moves a solution to a local minimum of the objective. Returns the solutions on the way with their objective; the
    /// first is `x`, and each is better than the one before.
    pub fn improve(&mut self, objective: &Objective, x: &Row) -> Vec<(f64, Row)> {
        let n = self.model.n();
        let (mut x, mut stiffness) = (*x, 1e-2);
        let (mut cost, mut gradient) = self.cost(objective, &x);
        let mut way = vec![(cost, x)];
        for _ in 0..STEPS {
            let Some(step) = self.step(objective, &x, &gradient, stiffness) else { break };
            let length = step[..n].iter().fold(0.0, |m: f64, s| m.max(s.abs()));
            if length < SHORT || stiffness > STIFFEST {
                break;
            }
            let mut next = x;
            let shrink = (LONGEST / length).min(1.0);
            for v in 0..n {
                next[v] = (x[v] + shrink * step[v]).clamp(self.model.lower[v], self.model.upper[v]);
            }
            let better = self.from(&next).map(|next| (next, self.cost(objective, &next))).filter(|(_, c)| c.0 < cost);
            let Some((next, (less, slope))) = better else {
                stiffness *= 8.0;
                continue;
            };
            let is_last = cost - less < GAIN * (1.0 + cost.abs());
            (x, cost, gradient) = (next, less, slope);
            stiffness = (0.2 * stiffness).max(1e-6);
            way.push((cost, x));
            if is_last {
                break;
            }
        }
        way
    }

    /// Returns the step that reduces the quadratic model of the objective most without moving the link, to first order.
    /// `stiffness` weights the squared step in addition.
    fn step(&mut self, objective: &Objective, x: &Row, gradient: &Row, stiffness: f64) -> Option<Row> {
        let n = self.model.n();
        self.place(x);
        let columns = self.columns();
        let scale = objective.manipulability.max(1.0);
        let weight = |v: usize| objective.posture.as_ref().map_or(0.0, |(_, w)| 2.0 * w[v]) + stiffness * scale;
        let mut free = self.searched;
        loop {
            let (mut normal, mut pushed) = (SMatrix::<f64, D, D>::identity() * 1e-12, SVector::<f64, D>::zeros());
            for v in (0..n).filter(|v| free[*v]) {
                normal += columns[v] * columns[v].transpose() / weight(v);
                pushed += columns[v] * (gradient[v] / weight(v));
            }
            let force = normal.cholesky()?.solve(&pushed);
            let mut step = [0.0; MAX_JOINTS];
            for v in (0..n).filter(|v| free[*v]) {
                step[v] = (columns[v].dot(&force) - gradient[v]) / weight(v);
            }
            // A joint that is at a limit, and that the step would move beyond the limit, stays fixed.
            let out = |v: usize| {
                (x[v] <= self.model.lower[v] && step[v] < 0.0) || (x[v] >= self.model.upper[v] && step[v] > 0.0)
            };
            let outside: Vec<usize> = (0..n).filter(|v| free[*v] && out(*v)).collect();
            if outside.is_empty() {
                return Some(step);
            }
            outside.into_iter().for_each(|v| free[v] = false);
        }
    }

    /// Returns the objective at `x` and its gradient.
    fn cost(&mut self, objective: &Objective, x: &Row) -> (f64, Row) {
        let (mut cost, mut gradient) = (0.0, [0.0; MAX_JOINTS]);
        if let Some((posture, weights)) = &objective.posture {
            let goal = self.model.unwound(posture, x);
            for v in 0..self.model.n() {
                let off = x[v] - goal[v];
                cost += weights[v] * off * off;
                gradient[v] = 2.0 * weights[v] * off;
            }
        }
        if objective.manipulability > 0.0 {
            let (value, slope) = self.manipulability(x);
            cost -= objective.manipulability * value;
            (0..self.model.n()).for_each(|v| gradient[v] -= objective.manipulability * slope[v]);
        }
        (cost, gradient)
    }

    /// Returns the sum of the manipulabilities of the targets' links at `x`, and its gradient.
    fn manipulability(&mut self, x: &Row) -> (f64, Row) {
        self.place(x);
        let (mut sum, mut gradient) = (0.0, [0.0; MAX_JOINTS]);
        for (target, frames) in self.targets.iter().zip(&self.frames) {
            let (value, slope) = manipulability(self.model, &target.chain, frames);
            sum += value;
            (0..self.model.n()).for_each(|v| gradient[v] += slope[v]);
        }
        (sum, gradient)
    }
}

/// Returns the product of the singular values of the Jacobian of a chain's link, and its gradient; both are zero at a
/// singularity.
fn manipulability(model: &Model, chain: &Chain, frames: &ChainFrames) -> (f64, Row) {
    let columns = model.twists(chain, frames);
    let active: Vec<usize> = (0..model.n()).filter(|v| columns[*v] != Vector6::zeros()).collect();
    let few = active.len() < 6;
    let mut normal = if few { Matrix6::identity() } else { Matrix6::zeros() };
    if few {
        for (i, v) in active.iter().enumerate() {
            for (k, w) in active.iter().enumerate() {
                normal[(i, k)] = columns[*v].dot(&columns[*w]);
            }
        }
    } else {
        active.iter().for_each(|v| normal += columns[*v] * columns[*v].transpose());
    }
    let mut slope = [0.0; MAX_JOINTS];
    let Some(solved) = normal.cholesky() else { return (0.0, slope) };
    let value: f64 = solved.l_dirty().diagonal().product();
    // The gradient of the logarithm is the sum, over all columns, of the transposed pseudo-inverse times the
    // derivative of the column.
    let mut inverse = [Vector6::zeros(); MAX_JOINTS];
    for (i, v) in active.iter().enumerate() {
        inverse[*v] = if few {
            let row = solved.solve(&Vector6::ith(i, 1.0));
            active.iter().enumerate().fold(Vector6::zeros(), |sum, (k, w)| sum + columns[*w] * row[k])
        } else {
            solved.solve(&columns[*v])
        };
    }
    let driven = |joint: usize| model.map().driven().iter().find(|d| d.joint == joint);
    let tip = frames.tip.translation.vector;
    let joints: Vec<(usize, Vector3<f64>, Vector3<f64>)> = chain
        .joint_indices()
        .enumerate()
        .filter_map(|(i, joint)| {
            let driven = driven(joint)?;
            let (linear, angular) = (chain.linear(frames, i, &tip)?, chain.angular(frames, i)?);
            Some((driven.variable, linear * driven.factor, angular * driven.factor))
        })
        .collect();
    for (i, (moved, linear, angular)) in joints.iter().enumerate() {
        for (k, (mover, shift, turn)) in joints.iter().enumerate() {
            // A joint turns the axes of the joints after it, and moves the tip relative to the joints before it.
            let (one, two) = if k <= i {
                (turn.cross(linear), turn.cross(angular))
            } else {
                (angular.cross(shift), Vector3::zeros())
            };
            let row = &inverse[*moved];
            slope[*mover] += value * (row.fixed_rows::<3>(0).dot(&one) + row.fixed_rows::<3>(3).dot(&two));
        }
    }
    (value, slope)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use gensim2_geometry::{Draws, Joint, Link, Pose, Robot};

    use super::*;
    use crate::transit::ik::search::Target;

    /// An arm with seven revolute joints, one of which also drives a mimic joint, and a sliding joint.
    fn arm() -> Arc<Robot> {
        let joint = |i: usize, kind: &str, axis: &str, xyz: &str, mimic: &str| {
            format!(
                r#"<joint name="j{i}" type="{kind}"><parent link="l{}"/><child link="l{i}"/><origin xyz="{xyz}"/>
                <axis xyz="{axis}"/><limit lower="-2.5" upper="2.5" effort="1" velocity="2"/>{mimic}</joint>"#,
                i - 1
            )
        };
        let links: String = (0..9).map(|i| format!(r#"<link name="l{i}"/>"#)).collect();
        let mimic = r#"<mimic joint="j2" multiplier="-0.5" offset="0.1"/>"#;
        let joints = [
            joint(1, "revolute", "0 0 1", "0 0 0.3", ""),
            joint(2, "revolute", "0 1 0", "0 0.02 0.1", ""),
            joint(3, "revolute", "0 0 1", "0 0 0.2", ""),
            joint(4, "revolute", "0 1 0", "0.08 0 0.2", mimic),
            joint(5, "prismatic", "0 0 1", "-0.08 0 0.2", ""),
            joint(6, "revolute", "0 0.6 0.8", "0 0 0.2", ""),
            joint(7, "revolute", "0 1 0", "0 0.05 0", ""),
            joint(8, "revolute", "0 0 1", "0.09 0 0.1", ""),
        ]
        .concat();
        let text = format!(r#"<robot name="arm">{links}{joints}</robot>"#);
        Arc::new(Robot::from_urdf_str(&text, "arm.urdf", None, "l8", None).unwrap())
    }

    #[test]
    fn the_gradients_are_those_of_the_manipulability_and_of_the_objective() {
        let robot = arm();
        let model = Model::new(&robot, &[0.0; 8]).unwrap();
        assert_eq!(model.n(), 7);
        let mut draws = Draws::of(3, 4);
        // Chains of seven, five and two variables.
        for link in ["l8", "l6", "l2"] {
            let chain = robot.chain_to(robot.link_index(link).unwrap()).unwrap();
            let targets = [Target { chain, goal: Pose::identity() }];
            let mut search = Search::<6>::new(&targets, &model, [true; MAX_JOINTS]);
            let objective = Objective {
                posture: Some(([0.2; MAX_JOINTS], std::array::from_fn(|v| 0.1 * v as f64))),
                manipulability: 30.0,
            };
            for _ in 0..20 {
                let mut x = [0.0; MAX_JOINTS];
                x.iter_mut().take(7).for_each(|v| *v = 2.4 * (2.0 * draws.unit() - 1.0));
                let (value, slope) = search.manipulability(&x);
                let (_, gradient) = search.cost(&objective, &x);
                assert!(value > 0.0);
                for v in 0..7 {
                    let (mut high, mut low) = (x, x);
                    high[v] += 1e-6;
                    low[v] -= 1e-6;
                    let measured = (search.manipulability(&high).0 - search.manipulability(&low).0) / 2e-6;
                    assert!((measured - slope[v]).abs() < 1e-7 * (1.0 + value), "{link} {v}: {measured} {}", slope[v]);
                    let measured = (search.cost(&objective, &high).0 - search.cost(&objective, &low).0) / 2e-6;
                    assert!((measured - gradient[v]).abs() < 1e-5, "{link} {v}: {measured} {}", gradient[v]);
                }
            }
        }
    }

    #[test]
    fn the_manipulability_of_a_planar_arm_has_a_closed_form() {
        let turn = |name: &str| Joint::revolute(name, Vector3::z()).limits(-3.0, 3.0).velocity(1.0);
        let robot = Robot::builder("planar")
            .link(Link::base("base"))
            .link(Link::below("base", "upper").moved_by(turn("shoulder")))
            .link(Link::below("upper", "fore").moved_by(turn("elbow")).at(Pose::translation(0.7, 0.0, 0.0)))
            .link(Link::below("fore", "hand").at(Pose::translation(0.4, 0.0, 0.0)))
            .build("hand")
            .unwrap();
        let model = Model::new(&robot, &[0.0; 2]).unwrap();
        let targets = [Target { chain: robot.chain().clone(), goal: Pose::identity() }];
        let mut search = Search::<6>::new(&targets, &model, [true; MAX_JOINTS]);
        for elbow in [0.3_f64, 1.2, -2.0] {
            let mut x = [0.0; MAX_JOINTS];
            (x[0], x[1]) = (0.4, elbow);
            // Columns (p1, 1) and (p2, 1) with p1 = a u1 + b u2 and p2 = b u2, turned by a right angle.
            let (a, b) = (0.7, 0.4);
            let (first, second) = (a * a + b * b + 2.0 * a * b * elbow.cos() + 1.0, b * b + 1.0);
            let mixed = b * b + a * b * elbow.cos() + 1.0;
            let expected = (first * second - mixed * mixed).sqrt();
            assert!((search.manipulability(&x).0 - expected).abs() < 1e-12);
        }
    }
}
